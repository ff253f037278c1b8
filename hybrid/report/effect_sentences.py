"""A named effect in one plain sentence: what it is, its size, and how certain it is.

Effects of the ship and her sensors have texts of their own; those of actuators have one for each kind of effect,
with the actuator's name and noun in it: one actuator, a pair, or all of a kind.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from string import Template

from seatrial.acquisition.core.ship import DEFAULT, Actuators, names_of
from seatrial.hybrid.diagnosis.result import Estimate
from seatrial.hybrid.effects import Effect
from seatrial.hybrid.report.diagnosis_words import number
from seatrial.hybrid.report.words import plain
from seatrial.hybrid.vessel.actuators import KINDS

Parameters = Mapping[str, Estimate]


def sentence(effect: Effect, parameters: Parameters, share_of_gap: float, actuators: Actuators = DEFAULT) -> str:
    """A named effect in one plain sentence, with its size, certainty and share of the gap.

    ``actuators`` are the ship's, by default R/V Gunnerus'.
    """
    what, ends = words_and_interval(effect, parameters, actuators)
    return f"{what} ({ends}); it explains {100.0 * share_of_gap:.0f} % of the gap on legs not used to find it."


def words_and_interval(effect: Effect, parameters: Parameters, actuators: Actuators) -> tuple[str, str]:
    """An effect with its size, and the ends of its 95 % intervals."""
    if effect.base in _SEVERAL:
        return _of_several(_SEVERAL[effect.base], parameters)
    if text := _ONE.get(effect.base) or _actuator_text(effect.base, actuators):
        return _of_one(effect, text, next(iter(parameters.values())))
    return _of_any(effect, parameters)


def _of_one(effect: Effect, text: str, estimate: Estimate) -> tuple[str, str]:
    """A size in words, in percent of change where the text has percent."""
    neutral = effect.parameters[0].neutral
    less = "[" in text and bool(estimate.value < neutral)
    text = re.sub(r"\[(.*?)\|(.*?)\]", rf"\{1 + less}", text)

    def size(value: float) -> float:
        change = 100.0 * (value - neutral) if "%" in text and isfinite(neutral) else value
        return -change if less else change

    low, high = sorted((size(estimate.low), size(estimate.high)))
    return text.format(number(size(estimate.value))), span(low, high)


def _of_several(text: str, parameters: Parameters) -> tuple[str, str]:
    """A place is said by its side of the reference point, and its interval on that side; shares in percent."""
    if "%" in text:
        parameters = {name: _times(each, 100.0) for name, each in parameters.items()}
    for way, other, each in zip(("ahead", "to starboard"), ("astern", "to port"), parameters, strict=False):
        if f"{{}} m {way}" in text and parameters[each].value < 0.0:
            text = text.replace(f"m {way}", f"m {other}")
            parameters = {**parameters, each: _times(parameters[each], -1.0)}
    values = [number(each.value) if each.unit != "deg" else f"{each.value:.0f}" for each in parameters.values()]
    ends = "; ".join(span(each.low, each.high, each.unit) for each in parameters.values())
    return text.format(*values), ends


def _times(estimate: Estimate, factor: float) -> Estimate:
    low, high = sorted((factor * estimate.low, factor * estimate.high))
    return replace(estimate, value=factor * estimate.value, low=low, high=high)


def _of_any(effect: Effect, parameters: Parameters) -> tuple[str, str]:
    """What is in no list of ours: its name and its parameters."""
    sizes = ", ".join(
        f"{plain(name.rsplit('_', 1)[0])} {number(each.value)} {each.unit}".removesuffix(" 1")
        for name, each in parameters.items()
    )
    ends = "; ".join(span(each.low, each.high) for each in parameters.values())
    return f"The model lacks {plain(effect.base)}: {sizes}", ends


def span(low: float, high: float, unit: str = "") -> str:
    """The ends of an interval; angles in whole degrees.

    >>> span(0.341, 0.36), span(-1.2, 0.5), span(202.7, 206.9, "deg")
    ('0.341-0.36', '−1.2 to 0.5', '203-207')
    """
    ends = [f"{end:.0f}".replace("-", "\u2212") if unit == "deg" else number(end) for end in (low, high)]
    return "-".join(ends) if low >= 0.0 else " to ".join(ends)


_SEVERAL = {
    "ocean_current": "The ship drifts with a current of {} m/s towards {} deg",
    "steady_wind": "A wind that was not recorded blows at {} m/s towards {} deg",
    "wave_drift": "Waves push the ship with {} N in beam sea towards {} deg",
    "low_speed_damping": "At low speed the water slows the ship more than in the model: surge by {} % a second, "
    "sway by {} %, yaw by {} %",
    "position_antenna_offset": "The recorded position is that of a point {} m ahead and {} m to starboard of the "
    "reference point",
    "speed_sensor_offset": "The recorded speeds are those of a point {} m ahead and {} m to starboard of the "
    "reference point",
}
"""Effects of two parameters and more, in their order."""


_ONE = {
    "loading": "The ship is {} % [heavier|lighter] than her model",
    "surge_added_mass": "The added mass in surge is {} % [more|less] than the model's",
    "sway_added_mass": "The added mass in sway is {} % [more|less] than the model's",
    "yaw_inertia": "The inertia in yaw is {} % [more|less] than the model's",
    "hull_fouling": "The hull's resistance straight ahead is {} % [more|less] than the model's",
    "cross_flow_drag": "The hull's cross-flow drag is {} % [more|less] than the model's",
    "drift_force": "The side force of the drifting hull is {} % [more|less] than the model's",
    "drift_moment": "The yaw moment of the drifting hull is {} % [more|less] than the model's",
    "turning_force": "The side force of the turning hull is {} % [more|less] than the model's",
    "turning_drag": "The resistance of the turning hull is {} % [more|less] than the model's",
    "yaw_damping": "The hull's yaw damping is {} % [more|less] than the model's",
    "trim": "The hull's side force acts {} m further [forward|aft] than the model's, as with trim by the "
    "[head|stern]",
    "skeg": "The hull has {} m2 [more|less] skeg than the model",
    "towed_load": "Something [holds the ship back|pushes the ship ahead] with a steady {} N",
    "hull_lengthening": "The ship is {} m [longer|shorter] than her model",
    "shallow_water": "The water is about {} m deep, which affects the hull forces",
    "wake_fraction": "[The wake slows the water at the thrusters by {} %|"
    "The water at the thrusters is {} % faster than the ship]",
    "pod_side_force": "The side force of the pods in oblique flow is {} % [more|less] than the model's",
    "azimuth_scale": "The true angles of both azimuths are {} % [larger|smaller] than reported",
    "yaw_asymmetry": "A steady moment of {} N m turns the ship to [starboard|port]",
    "sway_asymmetry": "A steady force of {} N pushes the ship to [starboard|port]",
    "wind_load": "The wind loads are {} % [more|less] than the tables say",
    "wind_drag": "The wind force along the ship is {} % [more|less] than the model's",
    "wind_side_load": "The wind force across the ship is {} % [more|less] than the model's",
    "wind_yaw_load": "The yaw moment of the wind is {} % [more|less] than the model's",
    "position_delay": "Positions are stamped {} s too [late|early]",
    "heading_delay": "Headings are stamped {} s too [late|early]",
    "speed_delay": "Surge, sway and yaw rate are stamped {} s too [late|early]",
    "command_delay": "The drives' feedback is stamped {} s too [late|early]",
    "thruster_lag": "The thrusters follow the recorded settings with a lag of {} s",
    "heading_bias": "The compass reads {} deg too [much|little]",
    "speed_sensor_rotation": "The speed sensor is turned {} deg [clockwise|counter-clockwise]",
    "speed_scale": "Reported speeds are {} times the true ones",
    "sway_bias": "The speed sensor reports {} m/s too much to [starboard|port]",
    "yaw_rate_bias": "The rate gyro reads {} deg/s too [much|little]",
    "yaw_rate_scale": "Reported yaw rates are {} times the true ones",
    "wind_direction_bias": "The wind vane reads {} deg too [much|little]",
    "wind_speed_scale": "Reported wind speeds are {} times the true ones",
}
"""Effects of one parameter; in brackets what is said of more, and of less, which is then without a sign."""

_LOSS = "$Subject [<lacks|lack> {} % of <its|their> $force|<has|have> {} % more $force than the model's]"

_ACTUATORS = {
    "thrust_loss": _LOSS,
    "azimuth_offset": "The true angle<|s> of $azimuth <is|are> the reported angle<|s> plus {} deg",
    "nozzle_offset": "The true angle<|s> of $nozzle <is|are> the reported angle<|s> plus {} deg",
    "rudder_loss": _LOSS,
    "rudder_offset": "$Subject <is|are> truly {} deg to [starboard|port] of the reported angle<|s>",
    "wake": "The water at $subject is {} % [slower than the model's: the hull's wake is larger|faster than the "
    "model's]",
    "thrust_deduction": "$Subject <loses|lose> {} % [more|less] of <its|their> thrust to the hull than the model's",
    "rudder_interaction": "$Subject <draws|draw> {} % [more|less] of <its|their> side force from the hull than "
    "the model's",
    "flow_straightening": "$Subject <meets|meet> {} % [more|less] of the drift at the stern than the model's",
    "astern_thrust": "$Subject <gives|give> {} % [more|less] thrust astern than the model's",
    "speed_loss": "$Subject <loses|lose> half the side force at {} m/s ahead",
    "backlash": "$Subject <has|have> {} deg of backlash between the reported and the true angle<|s>",
    "lag": "$Subject <follows|follow> the recorded settings with a lag of {} s",
}
"""Effects of actuators by their stem, which is followed by an actuator's name, ``both`` or ``all``.

``<one|several>`` is what is said of one actuator and of several. An angle of thrust is to starboard of what is
reported where it is positive, which astern turns the ship to port.
"""


def _actuator_text(effect: str, actuators: Actuators) -> str:
    """The text for an effect of one actuator, of a pair, or of all of a kind; empty for another effect."""
    effect = "thrust_loss_tunnel" if effect == "tunnel_thrust_loss" else effect
    stem = next((each for each in _ACTUATORS if effect.startswith(f"{each}_")), None)
    if stem is None:
        return ""
    which = effect.removeprefix(f"{stem}_")
    one = next((each for each in actuators if each.name == which), None)
    if one is not None:
        return _text_of(stem, f"The {which.replace('_', ' ')}", one.noun, one.kind)
    first, _, group = which.partition("_")
    member = next((each for each in actuators if effect in _effects_of(each.kind, actuators)), None)
    if first not in ("both", "all") or member is None:
        return ""
    return _text_of(stem, first.capitalize(), group or f"{member.noun}s", member.kind, several=True)


def _text_of(stem: str, which: str, noun: str, kind: str, several: bool = False) -> str:
    """The text of an effect of ``which`` actuators; a name that says its kind does not say it twice."""

    def named(noun: str) -> str:
        return which if noun in which else f"{which} {noun}"

    def inside(words: str) -> str:
        return words[0].lower() + words[1:]

    words = {
        "Subject": named(noun), "subject": inside(named(noun)),
        "azimuth": inside(named("azimuth")) + "s" * several, "nozzle": inside(named("nozzle")) + "s" * several,
        "force": {"tunnel": "side force", "rudder": "force"}.get(kind, "thrust"),
    }  # fmt: skip
    return Template(re.sub(r"<(.*?)\|(.*?)>", rf"\{1 + several}", _ACTUATORS[stem])).substitute(words)


def _effects_of(kind: str, actuators: Actuators) -> set[str]:
    """The names of the effects of a ship's actuators of one kind."""
    return {each.name for each in KINDS[kind].effects(names_of(actuators, kind))}
