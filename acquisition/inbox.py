"""Between reception and recording: bounded, and fair to every source.

Each source has a share of its own, so that one that floods cannot push out the frames of another.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable
from operator import attrgetter

from acquisition.frames import Frame

_MOST_AT_ONCE = 100  # of one source, so that the recorder's clock work is never kept waiting for long


class Inbox:
    """Frames that wait to be recorded: one writer thread a source, one reader thread for all."""

    def __init__(self, sources: Iterable[str], share: int) -> None:
        self._lines: dict[str, deque[Frame]] = {name: deque() for name in sources}
        self._share = share
        self._something = threading.Event()

    def put(self, source: str, frames: list[Frame]) -> int:
        """Take in what the source's share has room for, and return how many frames that is."""
        line = self._lines[source]
        room = max(self._share - len(line), 0)
        line.extend(frames if len(frames) <= room else frames[:room])
        self._something.set()
        return min(len(frames), room)

    def take(self, timeout_s: float) -> list[Frame]:
        """What waits, in the order of reception; of each source at most some hundreds. Empty after the timeout."""
        self._something.wait(timeout_s)
        self._something.clear()
        taken: list[Frame] = []
        for line in self._lines.values():
            count = len(line)
            if count > _MOST_AT_ONCE:
                count = _MOST_AT_ONCE
                self._something.set()
            taken.extend([line.popleft() for _ in range(count)])
        taken.sort(key=attrgetter("monotonic_ns"))
        return taken

    def __len__(self) -> int:
        """How many frames wait."""
        return sum(len(line) for line in self._lines.values())
