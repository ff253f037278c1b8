"""A headless browser for tests of pages: opens a file, evaluates JavaScript, moves a real mouse, presses real keys.

It speaks the DevTools protocol and keeps what the page asked the network for and what went wrong in it.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

_START_LIMIT_S, _ANSWER_LIMIT_S, _WAIT_LIMIT_S = 60.0, 60.0, 30.0
_POLL_S = 0.02
_SHIFT = 8  # the protocol's bit for the key
_KEYS = {"ArrowLeft": 37, "ArrowRight": 39}


class Browser:
    """A tab of a browser that runs; ``requests`` are the addresses asked for, ``errors`` what went wrong."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._numbers = socket, count(1)
        self.requests: list[str] = []
        self.errors: list[str] = []
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """What the browser answers to a command of the protocol."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=_ANSWER_LIMIT_S))
            if message.get("id") == number:
                assert "error" not in message, message
                return dict(message["result"])
            self._keep(message.get("method", ""), message.get("params", {}))

    def _keep(self, event: str, told: dict[str, Any]) -> None:
        if event == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        elif event == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(told["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and told["type"] in {"error", "warning", "assert"}:
            self.errors.append(json.dumps(told["args"]))
        elif event == "Log.entryAdded" and told["entry"]["level"] in {"error", "warning"}:
            self.errors.append(told["entry"]["text"])

    def open(self, page: Path | str, ready: str) -> None:
        """Open a file or an address and wait until the expression ``ready`` is true in it."""
        self.requests.clear()
        self.errors.clear()
        self.ask("Page.navigate", url=page.as_uri() if isinstance(page, Path) else page)
        self.wait_for(f"document.readyState === 'complete' && Boolean({ready})")

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page; it has to be fit for JSON."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Return as soon as the expression is true; the test fails when it never is."""
        until = time.monotonic() + _WAIT_LIMIT_S
        while not self.evaluate(expression):
            assert time.monotonic() < until, f"never true: {expression}; {self.errors}"
            time.sleep(_POLL_S)

    def move(self, x: float, y: float) -> None:
        """The mouse to a point of the window [px]."""
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def click(self, x: float, y: float) -> None:
        """The mouse to a point of the window [px], its left button down and up."""
        self.drag((x, y), (x, y))

    def drag(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """The left button down at one point of the window [px] and up at another."""
        self.move(*begin)
        self._button("mousePressed", begin, 1)
        if end != begin:
            for share in (0.3, 0.6, 1.0):
                x, y = (a + share * (b - a) for a, b in zip(begin, end, strict=True))
                self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        self._button("mouseReleased", end, 0)

    def _button(self, kind: str, at: tuple[float, float], buttons: int) -> None:
        self.ask(
            "Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=buttons, clickCount=1
        )

    def click_on(self, selector: str) -> None:
        """A real click in the middle of an element, which is scrolled into view."""
        where = (
            f"(()=>{{const e=document.querySelector({json.dumps(selector)});e.scrollIntoView({{block:'center'}});"
        )
        x, y = self.evaluate(where + "const r=e.getBoundingClientRect();return[r.x+r.width/2,r.y+r.height/2]})()")
        self.click(x, y)

    def press(self, key: str, *, shift: bool = False) -> None:
        """A key down and up."""
        for kind in ("rawKeyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=_KEYS[key],
                     modifiers=_SHIFT if shift else 0)  # fmt: skip


@contextmanager
def running_browser(folder: Path, width_px: int = 1400, height_px: int = 1500) -> Iterator[Browser]:
    """A browser with its profile in ``folder``; the test is skipped, saying so, where there is none."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium to open the page with")
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
               f"--user-data-dir={folder / 'profile'}", f"--window-size={width_px},{height_px}",
               "--hide-scrollbars", "--remote-debugging-port=0", "about:blank"]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            address = _debugger(folder / "profile" / "DevToolsActivePort")
            with connect(address, proxy=None, max_size=None) as socket:
                yield Browser(socket)
        finally:
            process.terminate()


def _debugger(told: Path) -> str:
    """The address at which the browser's tab is spoken to, once it is there."""
    until = time.monotonic() + _START_LIMIT_S
    while time.monotonic() < until:
        if told.exists() and told.read_text().count("\n"):
            port = told.read_text().split()[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=10) as answer:
                pages = [each for each in json.load(answer) if each["type"] == "page"]
            if pages:
                return str(pages[0]["webSocketDebuggerUrl"])
        time.sleep(_POLL_S)
    pytest.skip("the browser did not start in time")
