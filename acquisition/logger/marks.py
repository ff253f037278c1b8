"""Event marks from another terminal: ``seatrial mark TEXT`` reaches every recorder that runs on this computer."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from acquisition.core.errors import SourceError
from acquisition.logger.local_socket import ask, runtime_folder, servers

_MOST_LETTERS = 500
_MOST_APART_NS = 60_000_000_000

Mark = Callable[[str, int], None]
"""What takes a mark: its text, and when it was set on the monotonic clock [ns]."""


def parse_mark(message: Mapping[str, Any]) -> tuple[str, int]:
    """A mark's text and moment; one that cannot be true is replaced by now.

    Raises KeyError or TypeError for what is no mark.
    """
    text, at_ns, now_ns = message["text"], message["monotonic_ns"], time.monotonic_ns()
    if not isinstance(text, str) or type(at_ns) is not int:
        raise TypeError("no mark")
    return _writable(text), at_ns if abs(at_ns - now_ns) <= _MOST_APART_NS else now_ns


def _writable(text: str) -> str:
    """As much of a text as a mark holds; halves of letters, which no file takes, become question marks."""
    return text[:_MOST_LETTERS].encode(errors="replace").decode()


def send_mark(text: str, folder: Path | None = None) -> int:
    """Set a mark in every recording that runs here, and return how many heard it.

    Raises :class:`SourceError` when none does.
    """
    mark = {"text": _writable(text), "monotonic_ns": time.monotonic_ns()}
    message = json.dumps(mark, ensure_ascii=False).encode()
    heard = sum(ask(path, message) == b"ok" for path in servers(folder))
    if not heard:
        raise SourceError(
            "no recorder is running that could take the mark",
            where=str(folder or runtime_folder()),
            fix="start `seatrial record`, or set SEATRIAL_RUNTIME to the folder that it uses",
        )
    return heard
