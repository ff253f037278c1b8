"""What NMEA 0183 sentences say of declared channels: any field of any sentence, and the transducers of XDR."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from acquisition.config.declarations import SentenceField, Transducer
from acquisition.core.channel import Channel
from acquisition.core.errors import ConfigurationError
from acquisition.core.units import Linear
from acquisition.decoders.sentences import Fields, Reading

_XDR = "XDR"
_XDR_UNITS = {
    ("A", "D"): "deg", ("A", "R"): "rad", ("C", "C"): "degC", ("C", "K"): "K", ("C", "F"): "degF", ("D", "M"): "m",
    ("D", "I"): "in", ("F", "H"): "Hz", ("H", "P"): "%", ("I", "A"): "A", ("N", "N"): "N", ("P", "B"): "bar",
    ("P", "P"): "Pa", ("R", "L"): "l/s", ("T", "R"): "rpm", ("U", "V"): "V", ("V", "M"): "m3",
}  # fmt: skip
"""The units of XDR by the letters of the transducer's type and of the unit (gpsd's account of NMEA 0183)."""


class _Field(NamedTuple):
    """One field that carries a channel."""

    channel: Channel
    origin: SentenceField
    step: Linear

    def read(self, fields: Fields) -> Reading:
        for place, wanted in self.origin.when.items():
            if fields.text(int(place) - 1) not in ((wanted,) if isinstance(wanted, str) else wanted):
                return Reading()
        number = fields.number(self.origin.field - 1)
        seconds = None if self.origin.time is None else fields.seconds_of_day(self.origin.time - 1)
        values = [] if number is None else [(self.channel.name, self.step.apply(number))]
        return Reading(values, seconds_of_day=seconds)


class _Transducer:
    """One transducer that carries a channel. XDR has four fields for each: type, value, unit, name."""

    def __init__(self, channel: Channel, origin: Transducer) -> None:
        self.channel, self._origin = channel, origin
        self._steps: dict[tuple[str, str], Linear | None] = {}

    def read(self, fields: Fields) -> Reading:
        for place in range(0, len(fields) - 3, 4):
            number = fields.number(place + 1)
            if fields.text(place + 3) == self._origin.transducer and number is not None:
                step = self._step(fields.text(place), fields.text(place + 2))
                if step is None:
                    return Reading(refused="unit unknown")
                return Reading([(self.channel.name, step.apply(number))])
        return Reading()

    def _step(self, kind: str, letter: str) -> Linear | None:
        """The step from the unit that the sentence tells; None where it measures something else."""
        if (kind, letter) not in self._steps:
            try:
                step = self._origin.step_to(self.channel, _XDR_UNITS.get((kind, letter)))
            except ConfigurationError:
                step = None
            self._steps[kind, letter] = step
        return self._steps[kind, letter]


class DeclaredSentences:
    """The declared channels on one line, by the letters of their sentences."""

    def __init__(self, wanted: Sequence[tuple[Channel, SentenceField | Transducer]]) -> None:
        self._readers: dict[str, list[_Field | _Transducer]] = {}
        for channel, origin in wanted:
            if isinstance(origin, SentenceField):
                reader: _Field | _Transducer = _Field(channel, origin, origin.step_to(channel))
                self._readers.setdefault(origin.sentence, []).append(reader)
            else:
                self._readers.setdefault(_XDR, []).append(_Transducer(channel, origin))

    def __contains__(self, kind: str) -> bool:
        return kind in self._readers

    def channels_in(self, kind: str) -> frozenset[str]:
        """The channels that these sentences carry: what they would say of them otherwise counts no more."""
        return frozenset(each.channel.name for each in self._readers.get(kind, ()))

    def read(self, kind: str, fields: Fields) -> Reading:
        """What a sentence says; of several origins of one channel in it the first that has a value counts."""
        readings = [each.read(fields) for each in self._readers[kind]]
        values = dict(value for each in reversed(readings) for value in each.values)
        seconds = next((each.seconds_of_day for each in readings if each.seconds_of_day is not None), None)
        refused = next((each.refused for each in readings if each.refused), "")
        return Reading(list(values.items()), refused=refused, seconds_of_day=seconds)
