"""One source a channel: the preferred one while it is alive, the next one when it falls silent."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.frames import Sample
from acquisition.sections import AnySource

SILENT_NS = 2_500_000_000

# What a device says in two messages, and which of them is the slower or coarser one: 129025 comes ten times as
# often as 129029, LOCAL_POSITION_NED has the finer speeds, GGA tells whether there is a fix at all.
_SECOND_CHOICE = frozenset({"129029", "GLOBAL_POSITION_INT", "RMC", "GLL"})


@dataclass(slots=True)
class _Holder:
    source: str
    rank: tuple[int, bool]
    last_ns: int


class Selector:
    """Lets one source a channel through, so that a channel never mixes two sensors sample by sample.

    The order of the configuration's sources is the order of preference. Of two devices on one line the first
    that came keeps the channel until it has been silent for 2.5 s; of two messages the finer one has it.
    """

    def __init__(self, sources: tuple[AnySource, ...]) -> None:
        self._rank = {
            (source.name, channel): rank for rank, source in enumerate(sources) for channel in source.channels
        }
        self._holders: dict[str, _Holder] = {}

    def admit(self, sample: Sample) -> tuple[bool, str]:
        """Whether the sample is the channel's, and a text for the event log if the channel changed hands.

        Call once a sample, in order of reception.
        """
        line, _, device = sample.source.partition("/")
        line_rank = self._rank.get((line, sample.quantity))
        if line_rank is None:
            return False, ""
        rank = line_rank, device.removesuffix(" derived").rpartition(":")[2] in _SECOND_CHOICE
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
