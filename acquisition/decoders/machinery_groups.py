"""The parameter groups of a ship's own rudders and engines: which of them a message means, by its instance.

Instances count from 0 in the order of her list, so that of a pair the port one is 0. No standard group tells the
speed of a shaft, nor a propeller's pitch; those of engines and gearboxes stand for the speed where the reduction
ratio is known.
"""

from __future__ import annotations

from collections.abc import Mapping

from acquisition.core.actuators import Actuators, name_of_order, rudder_channels, rudders, shafts
from acquisition.decoders.parameter_groups import (
    ENGINE_SPEED,
    GEARBOX,
    RUDDER_GROUP,
    Message,
    Reader,
    Reading,
    Values,
    given,
)

_NO_INSTANCE = 255
_NEUTRAL, _REVERSE = 1, 2


def _instance(message: Message) -> int:
    instance = message["instance"]
    return _NO_INSTANCE if isinstance(instance, str) else int(instance)


class _Rudders:
    """127245: position and order. Of a single rudder the lowest instance that a device tells of is hers."""

    def __init__(self, actuators: Actuators) -> None:
        self._channels = rudder_channels(actuators)
        self._tells_orders = bool(rudders(actuators))

    def read(self, message: Message) -> Reading:
        number = _instance(message)
        meaning = f"rudder {number}" if number else ""
        if len(self._channels) == 1:
            return Reading(self._values(self._channels[0], message), meaning, instance=number)
        if number >= len(self._channels):
            return Reading([("rudder", "another instance")], meaning)
        return Reading(self._values(self._channels[number], message), meaning)

    def _values(self, channel: str, message: Message) -> Values:
        position: Values = [(channel, message.degrees("position"))]
        order: Values = [(name_of_order(channel), message.degrees("angleOrder"))] if self._tells_orders else []
        return [*given(position), *given(order)] or position


class _Engines:
    """127488 and 127493: an engine's speed, which has no sign, and whether its gearbox reverses the shaft."""

    def __init__(self, actuators: Actuators, reduction_ratios: Mapping[str, float]) -> None:
        self._ratios = {
            number: (f"{name}_rpm", reduction_ratios[name])
            for number, name in enumerate(shafts(actuators))
            if name in reduction_ratios
        }
        self._gears: dict[int, int] = {}

    def read_gear(self, message: Message) -> Reading:
        self._gears[_instance(message)] = int(message["transmissionGear"])
        return Reading([])

    def read_speed(self, message: Message) -> Reading:
        number, rpm = _instance(message), message["speed"]
        if number not in self._ratios:
            return Reading([("engine", "engine without a reduction ratio")])
        channel, ratio = self._ratios[number]
        gear = self._gears.get(number)
        if gear == _NEUTRAL:
            return Reading([(channel, "gearbox in neutral")])
        sign = -1.0 if gear == _REVERSE else 1.0
        return Reading([(channel, rpm if isinstance(rpm, str) else sign * rpm / ratio)], f"engine {number}")


def machinery_readers(actuators: Actuators, reduction_ratios: Mapping[str, float]) -> dict[int, Reader]:
    """The reader of each of these groups on a ship with these actuators; engines only where a ratio is known."""
    readers: dict[int, Reader] = {RUDDER_GROUP: _Rudders(actuators).read}
    if reduction_ratios:
        engines = _Engines(actuators, reduction_ratios)
        readers |= {ENGINE_SPEED: engines.read_speed, GEARBOX: engines.read_gear}
    return readers
