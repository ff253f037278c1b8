"""What NMEA 0183 sentences say of declared channels: any field of any sentence, and the transducers of XDR."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

from acquisition.config.declarations import SentenceField, Transducer
from acquisition.core.channel import Channel
from acquisition.core.errors import ConfigurationError
from acquisition.core.units import Linear
from acquisition.decoders.sentences import Fields, Reading

_ANY = "?"
"""Stands for a unit that XDR tells by a letter that is not in its table."""

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


class _Transducer(NamedTuple):
    """One transducer that carries a channel; the steps by the unit that the sentence tells, "" where it tells none.

    XDR has four fields for each: type, value, unit, name.
    """

    channel: Channel
    name: str
    steps: Mapping[str, Linear]

    def read(self, fields: Fields) -> Reading:
        for place in range(0, len(fields) - 3, 4):
            number, letter = fields.number(place + 1), fields.text(place + 2)
            if fields.text(place + 3) == self.name and number is not None:
                unit = _XDR_UNITS.get((fields.text(place), letter), letter and _ANY)
                step = self.steps.get(unit)
                return Reading(refused="unit unknown") if step is None else self._reading(step.apply(number))
        return Reading()

    def _reading(self, value: float) -> Reading:
        return Reading([(self.channel.name, value)])


def _steps(channel: Channel, origin: Transducer) -> dict[str, Linear]:
    """The step from each unit of XDR that measures what the channel does; from any, where the origin gives one."""
    if origin.unit is not None or origin.full_scale is not None:
        return dict.fromkeys(("", _ANY, *_XDR_UNITS.values()), origin.step_to(channel))
    steps = {"": origin.step_to(channel)}
    for unit in _XDR_UNITS.values():
        with suppress(ConfigurationError):
            steps[unit] = origin.step_to(channel, unit)
    return steps


class DeclaredSentences:
    """The declared channels on one line, by the letters of their sentences."""

    def __init__(self, wanted: Sequence[tuple[Channel, SentenceField | Transducer]]) -> None:
        self._readers: dict[str, list[_Field | _Transducer]] = {}
        for channel, origin in wanted:
            if isinstance(origin, SentenceField):
                reader: _Field | _Transducer = _Field(channel, origin, origin.step_to(channel))
                self._readers.setdefault(origin.sentence, []).append(reader)
            else:
                transducer = _Transducer(channel, origin.transducer, _steps(channel, origin))
                self._readers.setdefault("XDR", []).append(transducer)

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
