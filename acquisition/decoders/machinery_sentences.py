"""What the sentences of rudders, shafts and thrusters say (IEC 61162-1): which actuator each of them means.

Rudders are told apart by their place in RSA and ROR (HTD knows one only), shafts by their number in RPM and PRC,
azimuth and tunnel thrusters by theirs in TRD and TRC. Of two rudders or shafts the port one is listed first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from acquisition.config.sections import Thrusters
from acquisition.core.actuators import (
    Actuator,
    Actuators,
    name_of_order,
    numbered_shafts,
    rudder_channels,
    rudders,
    shaft_of_number,
)
from acquisition.decoders.sentences import NOT_VALID, Fields, Reader, Reading, present

_Controls = dict[float, tuple[str, str]]
"""The channels of each thruster's shaft speed and angle, empty if it has none, by its number in TRD and TRC."""


def _rudders(fields: Fields, channels: tuple[str, ...]) -> Reading:
    """RSA and ROR: starboard or single rudder first, then port. Of a single one any sensor will do."""
    if len(channels) > 2:
        return Reading(refused="more than two rudders")
    valid = [fields.number(index) if fields.text(index + 1) == "A" else None for index in (0, 2)]
    if fields.text(1) != "A" and fields.text(3) != "A":
        return Reading(refused=NOT_VALID)
    if len(channels) == 1:
        return Reading(present((channels[0], valid[0] if fields.text(1) == "A" else valid[1])))
    port, starboard = channels
    return Reading(present((port, valid[1]), (starboard, valid[0])))


def _heading_control(fields: Fields, channels: tuple[str, ...]) -> Reading:
    """HTD: the rudder angle that a heading or track control system orders, and its side."""
    if len(channels) > 1:
        return Reading(refused="one order to several rudders")
    angle, sign = fields.number(1), {"R": 1.0, "L": -1.0}.get(fields.text(2))
    ordered = None if angle is None or sign is None or angle < 0.0 else sign * angle
    return _as_orders(Reading(present((channels[0], ordered))))


def _rpm(fields: Fields, shafts: Actuators, reduction_ratios: Mapping[str, float]) -> Reading:
    """A shaft's speed and pitch; an engine's speed stands for its shaft's where its reduction ratio is known."""
    source, number = fields.text(0), fields.number(1)
    if source not in ("S", "E"):
        return Reading(refused="rpm of no shaft")
    shaft = shaft_of_number(number, shafts)
    if shaft is None:
        return Reading(refused="rpm of a single or unknown shaft")
    ratio = reduction_ratios.get(shaft.name) if source == "E" else 1.0
    if ratio is None:
        return Reading(refused="engine rpm")
    if fields.text(4) != "A":
        return Reading(refused=NOT_VALID)
    rpm = fields.number(2)
    values = _of_shaft(shaft, None if rpm is None else rpm / ratio, fields.number(3))
    return Reading(values, f"{'shaft' if source == 'S' else 'engine'} {number:.0f}")


def _of_shaft(shaft: Actuator, rpm: float | None, pitch_percent: float | None) -> list[tuple[str, float]]:
    """Those of the two values that a shaft has a channel for: pitch, with a controllable one only."""
    known = {channel.name for channel in shaft.channels}
    both = present((f"{shaft.name}_rpm", rpm), (f"{shaft.name}_pitch_percent", pitch_percent))
    return [(name, value) for name, value in both if name in known]


def _in_rpm(value: float | None, mode: str, rated_rpm: float | None) -> float | None:
    """A shaft's speed by its mode: R rpm, P percent of the rated one; None where it is neither, or not known."""
    if value is None or mode == "R":
        return value
    return None if mode != "P" or rated_rpm is None else value * rated_rpm / 100.0


def _propulsion_order(fields: Fields, shafts: Actuators, rated_rpm: Mapping[str, float]) -> Reading:
    """PRC: lever, its status, rpm, its mode, pitch, its mode, location, shaft."""
    shaft = shaft_of_number(fields.number(7), shafts)
    if shaft is None:
        return Reading(refused="order to an unknown shaft")
    rpm = _in_rpm(fields.number(2), fields.text(3), rated_rpm.get(shaft.name))
    pitch_percent = fields.number(4) if fields.text(5) == "P" else None
    return _as_orders(Reading(_of_shaft(shaft, rpm, pitch_percent), f"shaft {fields.number(7):.0f}"))


def _thruster(fields: Fields, controls: _Controls, rated_rpm: Mapping[str, float]) -> Reading:
    """TRD and TRC: number, rpm, its mode, pitch, its mode, azimuth, which is the direction of the thrust.

    ``rated_rpm`` is by channel.
    """
    number = fields.number(0)
    shaft, azimuth = ("", "") if number is None else controls.get(number, ("", ""))
    if not shaft:
        return Reading(refused="thruster not understood")
    said, mode = fields.number(1), fields.text(2)
    rpm = present((shaft, _in_rpm(said, mode, rated_rpm.get(shaft))))
    angle = present((azimuth, fields.number(5))) if azimuth else []
    if rpm or said is None:
        return Reading(rpm + angle)
    return Reading(angle, refused="thruster in percent" if mode == "P" else NOT_VALID)


def _thruster_order(
    fields: Fields, controls: _Controls, rated_rpm: Mapping[str, float], fills_channels: bool
) -> Reading:
    reading = _thruster(fields, controls, rated_rpm)
    orders = _as_orders(reading)
    return replace(orders, values=orders.values + reading.values) if fills_channels else orders


def _as_orders(reading: Reading) -> Reading:
    return replace(reading, values=[(name_of_order(name), value) for name, value in reading.values])


def machinery_readers(
    thrusters: Thrusters,
    actuators: Actuators,
    reduction_ratios: Mapping[str, float],
    rated_rpm: Mapping[str, float],
) -> dict[str, Reader]:
    """The reader of each of these sentences, by its last three letters, on a ship with these actuators."""
    controls: _Controls = {}
    for each in actuators:
        if each.name in thrusters.numbers:
            shaft, azimuth, *_ = (*(channel.name for channel in each.channels), "")
            controls[thrusters.numbers[each.name]] = shaft, azimuth
    rated = {f"{name}_rpm": each for name, each in rated_rpm.items()}
    demand = thrusters.channels_from == "demand"
    unwanted = Reading(refused="thruster response where demands are wanted")
    angles, shafts = rudder_channels(actuators), numbered_shafts(actuators)
    readers: dict[str, Reader] = {
        "RSA": partial(_rudders, channels=angles),
        "RPM": partial(_rpm, shafts=shafts, reduction_ratios=reduction_ratios),
        "TRD": (lambda fields: unwanted) if demand else partial(_thruster, controls=controls, rated_rpm=rated),
        "TRC": partial(_thruster_order, controls=controls, rated_rpm=rated, fills_channels=demand),
    }
    if rudders(actuators):
        readers["ROR"] = lambda fields: _as_orders(_rudders(fields, angles))
        readers["HTD"] = partial(_heading_control, channels=angles)
    if not {each.name for each in shafts} & thrusters.numbers.keys():  # else TRC tells the orders to them
        readers["PRC"] = partial(_propulsion_order, shafts=shafts, rated_rpm=rated_rpm)
    return readers
