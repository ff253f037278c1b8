"""The last minute of every channel, as it grows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition.recording.batches import Samples
from acquisition.recording.reader import Recording, Series
from acquisition.recording.trial import Trial

_SOURCE = ("",)


@dataclass(frozen=True, slots=True)
class _Line:
    """One channel: times of measurement and of reception [ns], values and flags, all [n]."""

    measured_ns: NDArray[np.int64]
    received_ns: NDArray[np.int64]
    value: NDArray[np.float64]
    quality: NDArray[np.uint8]

    @classmethod
    def of_samples(cls, samples: Samples) -> _Line:
        """A line of what was read; it has memory of its own."""
        return cls(
            np.array(samples.measured_ns, np.int64),
            np.array(samples.received_ns, np.int64),
            np.array(samples.value, np.float64),
            np.array(samples.quality, np.uint8),
        )

    def chosen(self, which: NDArray[np.bool_]) -> _Line:
        """Some of the samples."""
        if which.all():
            return self
        return _Line(self.measured_ns[which], self.received_ns[which], self.value[which], self.quality[which])

    def and_then(self, other: _Line) -> _Line:
        """This and what came after."""
        return _Line(
            np.concatenate([self.measured_ns, other.measured_ns]),
            np.concatenate([self.received_ns, other.received_ns]),
            np.concatenate([self.value, other.value]),
            np.concatenate([self.quality, other.quality]),
        )


class Recent:
    """What was received in the last ``keep_s`` seconds before the newest sample."""

    def __init__(self, keep_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._lines: dict[str, _Line] = {}
        self.newest_received_ns = 0

    def clear(self) -> None:
        """Forget all of it."""
        self._lines.clear()
        self.newest_received_ns = 0

    def add(self, samples: Mapping[str, Samples], *, again: bool = False) -> None:
        """Take in what is new by channel; ``again``: part of it may be here already, and is passed over."""
        for name, each in samples.items():
            line, known = _Line.of_samples(each), self._lines.get(name)
            if again and known is not None and known.received_ns.size:
                line = line.chosen(line.received_ns > known.received_ns.max())
            if line.received_ns.size:
                self.newest_received_ns = max(self.newest_received_ns, int(line.received_ns.max()))
            self._lines[name] = line if known is None else known.and_then(line)
        oldest_ns = self.newest_received_ns - self._keep_ns
        self._lines = {name: each.chosen(each.received_ns >= oldest_ns) for name, each in self._lines.items()}

    def recording(self, trial: Trial, path: Path) -> Recording:
        """All of it as a recording that has just been read; it does not say which source a sample came from."""
        series = {
            name: Series(
                each.measured_ns, each.received_ns, each.value, each.quality, _SOURCE,
                np.zeros(each.value.size, np.int32),
            )
            for name, each in self._lines.items()
            if each.value.size
        }  # fmt: skip
        return Recording(path, trial, series, {}, [], 0, False, 0, self.newest_received_ns)
