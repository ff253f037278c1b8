"""One source a channel: the preferred one while it is alive, the next one when it falls silent."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.config.sections import AnySource, CanFrames
from acquisition.core.frames import Sample
from acquisition.logger.health import SILENT_NS

_MOST_RANKS = 10_000

# What a device says in two messages, and which of them is the slower or coarser one: 129025 comes ten times as
# often as 129029, LOCAL_POSITION_NED has the finer speeds, GGA tells whether there is a fix at all.
_CHOICE = {
    **dict.fromkeys(("129029", "130577", "GLOBAL_POSITION_INT", "RMC", "GLL", "HDM", "VWR", "VWT"), 1),
    **dict.fromkeys(("GPS_RAW_INT", "GPS_GLOBAL_ORIGIN"), 2),
}
_MEANING = {"": 0, "magnetic": 2, "theoretical": 2, "water": 4, "apparent": 4}
"""How far from the channel itself a message's reference is: what needs less derivation is preferred."""

Rank = tuple[int, int, int]


@dataclass(slots=True)
class _Holder:
    source: str
    rank: Rank
    last_ns: int


class Selector:
    """Lets one source a channel through, so that a channel never mixes two sensors sample by sample.

    The order of the configuration's sources is the order of preference, and within a bus the order of its
    devices. Of two messages the finer one has it, and what needs less derivation. What is equal in all this, two
    devices that are not listed, say, is decided by who came first, until that has been silent for 2.5 s.
    """

    def __init__(self, sources: tuple[AnySource, ...]) -> None:
        self._lines = {
            (source.name, channel): rank for rank, source in enumerate(sources) for channel in source.channels
        }
        self._devices = {
            (source.name, device.name): rank
            for source in sources
            if isinstance(source, CanFrames)
            for rank, device in enumerate(source.devices)
        }
        self._ranks: dict[tuple[str, str], Rank | None] = {}
        self._holders: dict[str, _Holder] = {}

    def admit(self, sample: Sample) -> tuple[bool, str]:
        """Whether the sample is the channel's, and a text for the event log if the channel changed hands.

        Call once a sample, in order of reception.
        """
        rank = self._rank(sample.source, sample.quantity)
        if rank is None:
            return False, ""
        holder = self._holders.get(sample.quantity)
        if holder is None:
            self._holders[sample.quantity] = _Holder(sample.source, rank, sample.monotonic_ns)
            return True, ""
        if holder.source == sample.source:
            holder.last_ns = sample.monotonic_ns
            return True, ""
        if rank < holder.rank or sample.monotonic_ns - holder.last_ns > SILENT_NS:
            text = f"{sample.quantity}: from {holder.source} to {sample.source}"
            self._holders[sample.quantity] = _Holder(sample.source, rank, sample.monotonic_ns)
            return True, text
        return False, ""

    def _rank(self, source: str, quantity: str) -> Rank | None:
        key = source, quantity
        if key not in self._ranks:
            if (
                len(self._ranks) >= _MOST_RANKS
            ):  # sources are named by what comes off the wire: there is no end to them
                self._ranks.clear()
            self._ranks[key] = self._work_out_rank(source, quantity)
        return self._ranks[key]

    def _work_out_rank(self, source: str, quantity: str) -> Rank | None:
        """Preference of the line, of the device on it, of the message; None where the line is not to provide it."""
        line, _, rest = source.partition("/")
        line_rank = self._lines.get((line, quantity))
        if line_rank is None:
            return None
        device, _, words = rest.partition(":")
        message, *meaning = words.split(" ")
        derived = meaning[-1:] == ["derived"] and quantity not in ("north_m", "east_m")
        kind = next((_MEANING[word] for word in meaning if word in _MEANING), 0)
        device_rank = self._devices.get((line, device), len(self._devices))
        return line_rank, device_rank, 10 * _CHOICE.get(message, 0) + kind + derived
