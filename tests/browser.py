"""A headless browser for tests of pages: opens a file, evaluates JavaScript, moves a real mouse, presses real keys.

Playwright drives the Chromium that the system has, and tells what a page asked for and what went wrong in it.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import ConsoleMessage, Error, Page, sync_playwright

_LIMIT_MS = 120_000  # for machines that are busy; whatever is waited for is met as soon as it holds
_LOOK_MS = 20
_FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
          "--disable-component-update", "--disable-sync"]  # fmt: skip


class Browser:
    """A tab of a browser that runs; ``requests`` are the addresses asked for, ``errors`` what went wrong."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.requests: list[str] = []
        self.errors: list[str] = []
        page.set_default_timeout(_LIMIT_MS)
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._keep)

    def _keep(self, message: ConsoleMessage) -> None:
        if message.type in {"error", "warning", "assert"}:
            self.errors.append(message.text)

    def open(self, page: Path | str, ready: str) -> None:
        """Open a file or an address and wait until the expression ``ready`` is true in it."""
        self.requests.clear()
        self.errors.clear()
        self._page.goto(page.as_uri() if isinstance(page, Path) else page)
        self.wait_for(ready)

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page; it has to be fit for JSON."""
        return self._page.evaluate(expression)

    def wait_for(self, expression: str) -> None:
        """Return as soon as the expression is true; the test fails when it never is.

        It is asked from outside: a page whose policy forbids ``eval`` can be waited for too.
        """
        until_s = time.monotonic() + _LIMIT_MS / 1000.0
        while not self._holds(expression):
            assert time.monotonic() < until_s, f"never true: {expression}"
            self._page.wait_for_timeout(_LOOK_MS)

    def _holds(self, expression: str) -> bool:
        try:
            return bool(self._page.evaluate(expression))
        except Error:  # of a page that is not complete yet, or gives way to another
            return False

    def resize(self, width: int, height: int = 900) -> None:
        """A window of another size [px]."""
        self._page.set_viewport_size({"width": width, "height": height})

    def move(self, x: float, y: float) -> None:
        """The mouse to a point of the window [px]."""
        self._page.mouse.move(x, y)

    def click(self, x: float, y: float) -> None:
        """The mouse to a point of the window [px], its left button down and up."""
        self._page.mouse.click(x, y)

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """The left button down at one point of the window [px] and up at another."""
        self._page.mouse.move(*begin)
        self._page.mouse.down()
        self._page.mouse.move(*end, steps=3)
        self._page.mouse.up()

    def click_on(self, selector: str) -> None:
        """A real click in the middle of the first such element, which is scrolled into view."""
        self._page.locator(selector).first.click()

    def choose(self, selector: str, value: str) -> None:
        """An option of a list, by its value."""
        self._page.select_option(selector, value)

    def give_file(self, selector: str, path: Path) -> None:
        """A file for a field that takes one."""
        self._page.set_input_files(selector, path)

    def press(self, key: str, *, shift: bool = False) -> None:
        """A key down and up."""
        self._page.keyboard.press(f"Shift+{key}" if shift else key)


@contextmanager
def running_browser() -> Iterator[Browser]:
    """A browser; the test is skipped, saying so, where there is none."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium to open the page with")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=_FLAGS, timeout=_LIMIT_MS)
        try:
            yield Browser(browser.new_page(viewport={"width": 1400, "height": 1500}))
        finally:
            browser.close()
