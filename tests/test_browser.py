"""The browser of the tests of pages misses neither a request nor a word of complaint."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser import running_browser

PAGE = """<!doctype html><title>bad</title><link rel="icon" href="data:,"><img src="near.png">
<script>console.warn("warned"); setTimeout(() => { document.title = "done"; throw new Error("thrown") })</script>"""


def test_what_a_bad_page_does_is_kept_until_the_next_is_opened(tmp_path: Path) -> None:
    bad, good = tmp_path / "bad.html", tmp_path / "good.html"
    bad.write_text(PAGE, encoding="utf-8")
    good.write_text("<!doctype html><title>good</title>", encoding="utf-8")
    with running_browser() as browser:
        browser.open(bad, "document.title === 'done'")
        assert browser.requests == [bad.as_uri(), (tmp_path / "near.png").as_uri()]
        for complaint in ("warned", "thrown", "ERR_FILE_NOT_FOUND"):
            assert any(complaint in error for error in browser.errors), complaint
        browser.open(good, "document.title === 'good'")
        assert (browser.requests, browser.errors) == ([good.as_uri()], [])


def test_without_a_browser_the_test_is_skipped_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(pytest.skip.Exception, match="no chromium"), running_browser():
        pass
