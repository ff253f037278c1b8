"""Files from strangers: none runs code, opens what it names, writes to the terminal, or ends in a traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition.core.errors import unexpected
from tests.conftest import Command, Done


def refused(done: Done) -> str:
    """The one line with which a command was refused."""
    lines = done.err.splitlines()
    assert done.code == 1, done.out + done.err
    assert "Traceback" not in done.err
    assert sum(line.startswith("seatrial: ") for line in lines) == 1, done.err
    return lines[-1]


# What nobody foresaw


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ValueError("no such thing"), "ValueError: no such thing"),
        (KeyError("speed"), "KeyError: 'speed'"),
        (ZeroDivisionError(), "ZeroDivisionError"),
        (RecursionError("maximum recursion depth exceeded"), "RecursionError"),
        (np.linalg.LinAlgError("singular\x1b[2J matrix"), r"singular\x1b[2J matrix"),
        (MemoryError(), "not enough memory"),
        (OSError(5, "Input/output error", "disk.mcap"), "disk.mcap: the system refused: Input/output error"),
        (AssertionError("\n".join(["quoted input"] * 9_000)), "AssertionError"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_any_exception_is_one_line(
    error: Exception, words: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path) -> None:
        raise error

    monkeypatch.setattr("acquisition.recording.reader.read_recording", fail)
    line = refused(command("info", "trial.mcap"))
    assert words in line
    assert len(line) < 600


def test_debug_variable_shows_the_traceback(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acquisition.recording.reader.read_recording", lambda path: 1 // 0)
    monkeypatch.setenv("SEATRIAL_DEBUG", "1")
    done = command("info", "trial.mcap")
    assert done.code == 1
    assert "Traceback (most recent call last)" in done.err
    assert done.err.splitlines()[-1].startswith("seatrial: ")


def test_unexpected_error_names_the_line_of_seatrial_that_raised_it() -> None:
    from acquisition.core.units import ending_of

    with pytest.raises(AttributeError) as raised:
        ending_of(None)  # type: ignore[arg-type]
    assert "acquisition.core.units, line " in str(unexpected(raised.value))
