"""Between reception and recording: bounded, and fair to every source.

Each source has a share of its own, so that one that floods cannot push out the frames of another.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from operator import attrgetter

from acquisition.core.frames import Frame

_MOST_AT_ONCE = 100  # of one source, so that the recorder's clock work is never kept waiting for long


class Inbox:
    """Frames that wait to be recorded: one writer thread a source, one reader thread for all.

    Nobody is woken: the reader comes by often enough, and a thread that is woken for every frame would cost more
    than the frame.
    """

    def __init__(self, sources: Iterable[str], share: int) -> None:
        self._lines: dict[str, deque[Frame]] = {name: deque() for name in sources}
        self._share = share

    def put(self, source: str, frames: list[Frame]) -> int:
        """Take in what the source's share has room for, and return how many frames that is."""
        line = self._lines[source]
        room = max(self._share - len(line), 0)
        line.extend(frames if len(frames) <= room else frames[:room])
        return min(len(frames), room)

    def take(self) -> list[Frame]:
        """What waits, in the order of reception; of each source at most some."""
        taken: list[Frame] = []
        for line in self._lines.values():
            taken.extend([line.popleft() for _ in range(min(len(line), _MOST_AT_ONCE))])
        taken.sort(key=attrgetter("monotonic_ns"))
        return taken

    def __len__(self) -> int:
        """How many frames wait."""
        return sum(len(line) for line in self._lines.values())
