"""The page for the bridge in a browser: what is called stays large, nothing is cut off, by day and at night."""

from __future__ import annotations

import socket
from typing import Any

from seatrial.acquisition.logger.requests import LOOPBACK
from seatrial.analysis.conduct.aboard import served_page
from tests.acquisition.conftest import free_port
from tests.browser import Browser, running_browser

LAST = [
    ["run 12, turning circle 35 deg to starboard on 126 deg: invalid", "bad"],
    ["the helm was let go 14 s before the order: <b>41 % of its heading is missing</b>", ""],
    *[[f"overshoot {number} from order 12.77 ± 0.48 deg, limit 25: not shown, the standards are for ships of 100 m"
       " and more, not 28.9 m", ""] for number in (1, 2, 3)],
    ["turning circle 35 deg to port need not be sailed: advance 3.4 L (3.3 to 3.5), limit 4.5; tactical diameter"
     " 3.5 L (3.3 to 3.7), limit 5; nor zigzag 20/20 to port, stop", "good"],
    ["a repeat (14 min) would narrow overshoot 2 from order: its interval holds the limit", "dim"],
    ["3 of 13 criteria measured, 2 predicted · 6 runs left, 123 min, time for 5", "dim"],
]  # fmt: skip
STATE: dict[str, Any] = {
    "title": "run 13: zigzag 20/20 to starboard on 126°", "time": "14:38:58 UTC",
    "say": "STEADY · order STARBOARD 35", "now": False, "due_s": 12.0, "last": LAST,
    "faults": ["the helm is moved", "41 % of the heading is missing"],
    "values": [["heading", "358.8°", 1.0], ["turn °/min", "-180", 0.4], ["speed m/s", "15.52", 0.0],
               ["helm", "-35°", 1.0]],
}  # fmt: skip
SIZES = [(1920, 1080), (1280, 800), (1024, 768), (2560, 1080), (800, 1280)]
_CUT = """[...document.querySelectorAll("#head, #words, #values b, #faults div, #last div")].filter(each => {
  const box = each.getBoundingClientRect(), part = each.closest("body > *"), below = part.nextElementSibling;
  const end = below && below.id ? below.getBoundingClientRect().top : innerHeight;
  const isWide = each.clientWidth && each.scrollWidth > each.clientWidth + 1;
  return isWide || box.right > innerWidth + 1 || box.bottom > end + 1
}).map(each => each.textContent)"""
"""What is beyond the window or lies over the part below it."""
_SHARES = """["#say", "#values b", "#last div"].map(name =>
  parseFloat(getComputedStyle(document.querySelector(name)).fontSize) / Math.min(innerWidth, 1.6 * innerHeight))"""


def colours(browser: Browser) -> tuple[list[int], list[int]]:
    """Those of the ground and the ink [red, green, blue]."""
    both = browser.evaluate(
        "[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color]"
        ".map(text => text.match(/\\d+/g).map(Number))"
    )
    return both[0], both[1]


def test_page_for_the_bridge_is_large_whole_and_dark_at_night() -> None:
    """On any screen: at 3 m letters need a two-hundredth of that, 15 mm, which of a screen of 33 cm are 4.5 %."""
    port = free_port(socket.SOCK_STREAM)
    with running_browser() as browser, served_page(LOOPBACK, port, lambda: STATE) as address:
        browser.open(address, "document.querySelectorAll('#last div').length > 0")
        for width, height in SIZES:
            browser.resize(width, height)
            browser.wait_for(f"innerWidth === {width} && innerHeight === {height}")
            browser.wait_for(f"({_CUT}).length === 0")
            call, value, line = browser.evaluate(_SHARES)
            assert call > 0.08, (width, height)
            assert value > 0.045, (width, height)
            assert line > 0.0135, (width, height)
        assert "<b>41 %" in browser.evaluate("document.getElementById('last').textContent")
        assert min(colours(browser)[0]) > 200
        browser.click_on("#light")
        ground, ink = colours(browser)
        assert max(ground) == 0
        assert ink[0] > 2 * max(ink[1:])  # red spares the eyes that are used to the dark
        assert not browser.errors


def test_page_says_that_its_conductor_is_gone() -> None:
    port = free_port(socket.SOCK_STREAM)
    with running_browser() as browser:
        with served_page(LOOPBACK, port, lambda: STATE) as address:
            browser.open(address, "document.querySelectorAll('#last div').length > 0")
        browser.wait_for("document.getElementById('words').textContent === 'NO CONNECTION'")
        browser.wait_for("document.getElementById('count').textContent === ''")
