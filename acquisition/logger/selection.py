"""Which source has a channel: one at a time, by the order of the configuration, its devices, fixes and messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from seatrial.acquisition.config.sections import AnySource, CanFrames, MqttLinks
from seatrial.acquisition.core.frames import Fix, Sample, label_parts, sensor_of
from seatrial.acquisition.decoders import NO_SATELLITES
from seatrial.acquisition.decoders.mqtt import device_and_signal
from seatrial.acquisition.logger.handovers import Handover
from seatrial.acquisition.logger.health import SILENT_NS

POSITION = frozenset({"north_m", "east_m", "latitude_deg", "longitude_deg"})
VARIATION = "magnetic_variation_deg"
VARIATION_KEEPS_NS = 600 * 10**9
"""The variation changes by tenths of a degree in an hour's way: what was told holds while its source is silent."""
_MOST_RANKS = 10_000

# What a device says in two messages, and which of them is the slower or coarser one: 129025 comes ten times as
# often as 129029, LOCAL_POSITION_NED has the finer speeds, GGA tells whether there is a fix at all.
_CHOICE = {
    **dict.fromkeys(("129029", "130577", "GLOBAL_POSITION_INT", "RMC", "GLL", "HDM", "VWR", "VWT", "HTD"), 1),
    **dict.fromkeys(("GPS_RAW_INT", "GPS_GLOBAL_ORIGIN"), 2),
}
_MEANING = {"": 0, "engine": 1, "magnetic": 2, "theoretical": 2, "water": 4, "apparent": 4}
"""How far from the channel itself a message's reference is: what needs less derivation is preferred."""
_OF_A_FIX = frozenset({"GGA", "GNS", "RMC", "GLL", "VTG", "129025", "129026", "129029"})
"""Messages that repeat one fix of one receiver: which of them a position is read from is no news."""

# By the numbers of GGA: fixed and floating ambiguities, then precise, differential, corrected by satellite; plain.
_GRADE = {4: 0, 5: 1, 3: 2, 2: 2, 9: 2}
_PLAIN_GRADE = 3
_NO_WORD = Fix()
_ITS_TURN = 0.75  # of the time from one message to the next: what comes earlier comes beside it

Rank = tuple[bool, bool, int, int, int, int]
"""No satellites, a stand-in's, grade of the fix; line, device on it, message: what is smaller is preferred."""


@dataclass(slots=True)
class _Holder:
    """Who has a channel: its last sample, its rank, and the time between its last two messages [ns]."""

    last: Sample
    rank: Rank
    interval_ns: int = 0

    def since(self, sample: Sample) -> int:
        """The time since its last message: between the measurements as far as both tell when they were [ns]."""
        if self.last.source_ns is not None and sample.source_ns is not None:
            return sample.source_ns - self.last.source_ns
        return sample.monotonic_ns - self.last.monotonic_ns


class Selector:
    """Lets one source a channel through, so that a channel never mixes two sensors sample by sample.

    The order of the configuration's sources is the order of preference, and within a bus the order of its devices;
    of an MQTT broker's a channel's own topic goes before sentences. A position by satellites is preferred to any
    other, and among those that stand in for the first the better fix, by ``fixes``: what each sensor's receiver
    says of its fix, by GGA's numbers. Of two messages the finer one has it, and what needs less derivation. What
    is equal in all this, two devices that are not listed, say, is decided by who came first, until that has been
    silent for ``patience_ns``.

    The talkers of satellite receivers are names of one receiver, which may change from one fix to the next, until
    two of them tell the same thing side by side. Every line may provide what is listed ``anywhere``, after those
    that list it, which are waited for at first: what is taken from another would change at once.
    """

    def __init__(
        self,
        sources: tuple[AnySource, ...],
        fixes: Mapping[str, Fix] | None = None,
        patience_ns: int = SILENT_NS,
        anywhere: str = "",
    ) -> None:
        self._lines = {
            (source.name, channel): rank for rank, source in enumerate(sources) for channel in source.channels
        }
        for rank, source in enumerate(sources, len(sources)):
            if anywhere:
                self._lines.setdefault((source.name, anywhere), rank)
        self._devices = {
            (source.name, device.name): rank
            for source in sources
            if isinstance(source, CanFrames)
            for rank, device in enumerate(source.devices)
        }
        self._mapped = {
            (source.name, device_and_signal(entry.topic)[0], channel)
            for source in sources
            if isinstance(source, MqttLinks)
            for channel, entry in source.values.items()
            if channel not in POSITION
        }
        self._first_line: dict[str, int] = {}
        for (_, quantity), rank in self._lines.items():
            self._first_line[quantity] = min(rank, self._first_line.get(quantity, rank))
        self._anywhere, self._listed = anywhere, len(sources)
        self._since_ns: int | None = None
        self._lists_devices = {line for line, _ in self._devices}
        self._fixes = fixes or {}
        self._patience_ns = patience_ns
        self._ranks: dict[tuple[str, str, int | None], Rank | None] = {}
        self._holders: dict[str, _Holder] = {}
        self._rivals: set[tuple[str, str]] = set()

    def admit(self, sample: Sample) -> tuple[bool, Handover | None]:
        """Whether the sample is the channel's, and the change to be reported if it comes from another source now.

        Call once a sample, in order of reception.
        """
        rank = self._rank(sample.source, sample.quantity)
        if rank is None:
            return False, None
        holder = self._holders.get(sample.quantity)
        if holder is None:
            if sample.quantity == self._anywhere and self._waits(sample, rank):
                return False, None
            self._holders[sample.quantity] = _Holder(sample, rank)
            return True, None
        pair = holder.last.source, sample.source
        if pair[0] == pair[1] or self._continues(holder, sample):
            holder.last, holder.rank, holder.interval_ns = sample, rank, holder.since(sample)
            return True, None
        if rank < holder.rank or sample.monotonic_ns - holder.last.monotonic_ns > self._patience_ns:
            handover = Handover(sample.quantity, *pair, rank < holder.rank)
            self._holders[sample.quantity] = _Holder(sample, rank)
            return True, None if _is_one_receiver(*pair) and pair not in self._rivals else handover
        return False, None

    def _waits(self, sample: Sample, rank: Rank) -> bool:
        """Whether a line or device that is listed before the sample's may yet be heard."""
        *_, line, device, _ = rank
        first = self._first_line[sample.quantity]
        before = (line > first and first < self._listed) or (
            device > 0 and label_parts(sample.source)[0] in self._lists_devices
        )
        if self._since_ns is None:
            self._since_ns = sample.monotonic_ns
        return before and sample.monotonic_ns - self._since_ns <= SILENT_NS

    def _continues(self, holder: _Holder, sample: Sample) -> bool:
        """Whether the holder itself goes on under another talker: in its turn, and never beside the other name."""
        pair = holder.last.source, sample.source
        messages = [label_parts(source)[2] for source in pair]
        if not _is_one_receiver(*pair) or pair in self._rivals or messages[0] != messages[1]:
            return False
        if holder.interval_ns <= 0 or (holder.last.source_ns is None) != (sample.source_ns is None):
            return False
        if holder.since(sample) >= _ITS_TURN * holder.interval_ns:
            return True
        if len(self._rivals) < _MOST_RANKS:
            self._rivals |= {pair, pair[::-1]}
        return False

    def _rank(self, source: str, quantity: str) -> Rank | None:
        fix = self._fixes.get(sensor_of(source), _NO_WORD).kind if quantity in POSITION else None
        key = source, quantity, fix
        if key not in self._ranks:
            if len(self._ranks) >= _MOST_RANKS:  # sources are named by what comes off the wire: without end
                self._ranks.clear()
            self._ranks[key] = self._work_out_rank(source, quantity, fix)
        return self._ranks[key]

    def _work_out_rank(self, source: str, quantity: str, fix: int | None) -> Rank | None:
        """How much a message is preferred; None where its line is not to provide the quantity."""
        line, device, (message, *meaning) = label_parts(source)
        line_rank = self._lines.get((line, quantity))
        if line_rank is None:
            return None
        derived = meaning[-1:] == ["derived"] and quantity not in POSITION
        kind = next((_MEANING[word] for word in meaning if word in _MEANING), 0)
        choice = 0 if quantity == VARIATION else 10 * _CHOICE.get(message, 0) + kind + derived
        device_rank = self._devices.get((line, device.partition("@")[0]), len(self._devices))
        if (line, device, quantity) in self._mapped:
            device_rank = -1
        if quantity not in POSITION:
            return False, False, 0, line_rank, device_rank, choice
        stands_in = line_rank > self._first_line[quantity] or (device_rank > 0 and line in self._lists_devices)
        grade = _GRADE.get(fix or 0, _PLAIN_GRADE)
        return fix in NO_SATELLITES, stands_in, grade, line_rank, device_rank, choice


@lru_cache(maxsize=4096)
def _is_one_receiver(first: str, second: str) -> bool:
    """Whether two sources are messages of a fix by one receiver, as far as their names tell."""
    messages = {label_parts(source)[2][0] for source in (first, second)}
    return sensor_of(first) == sensor_of(second) and messages <= _OF_A_FIX
