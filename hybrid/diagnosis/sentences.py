"""Each named effect in one plain sentence: what it is, its size, how sure that is, its share of the gap."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from hybrid.diagnosis.result import Estimate
from hybrid.diagnosis.words import number
from hybrid.effects import Effect
from hybrid.report.words import plain

Parameters = Mapping[str, Estimate]


def sentence(effect: Effect, parameters: Parameters, share_of_gap: float) -> str:
    """A named effect in one plain sentence, with its size, certainty and share of the gap."""
    if effect.name in _TWO:
        what, ends = _of_two(_TWO[effect.name], parameters)
    elif effect.name in _ONE:
        what, ends = _of_one(effect, _ONE[effect.name], next(iter(parameters.values())))
    else:
        what, ends = _of_any(effect, parameters)
    return f"{what} ({ends}); it explains {100.0 * share_of_gap:.0f} % of the gap on legs not used to find it."


def _of_one(effect: Effect, texts: tuple[str, ...], estimate: Estimate) -> tuple[str, str]:
    """A size in words: where there are two texts, the second is for what is less than neutral, without a sign.

    In percent of change where the text has percent.
    """
    neutral = effect.parameters[0].neutral
    less = len(texts) == 2 and bool(estimate.value < neutral)
    text = texts[less]

    def size(value: float) -> float:
        change = 100.0 * (value - neutral) if "%" in text and isfinite(neutral) else value
        return -change if less else change

    low, high = sorted((size(estimate.low), size(estimate.high)))
    return text.format(number(size(estimate.value))), span(low, high)


def _of_two(text: str, parameters: Parameters) -> tuple[str, str]:
    values = [number(each.value) if each.unit != "deg" else f"{each.value:.0f}" for each in parameters.values()]
    ends = "; ".join(span(each.low, each.high, each.unit) for each in parameters.values())
    return text.format(*values), ends


def _of_any(effect: Effect, parameters: Parameters) -> tuple[str, str]:
    """What is in no list of ours: its name and its parameters."""
    sizes = ", ".join(
        f"{plain(name.rsplit('_', 1)[0])} {number(each.value)} {each.unit}".removesuffix(" 1")
        for name, each in parameters.items()
    )
    ends = "; ".join(span(each.low, each.high) for each in parameters.values())
    return f"The model lacks {plain(effect.name)}: {sizes}", ends


def span(low: float, high: float, unit: str = "") -> str:
    """The ends of an interval; angles in whole degrees.

    >>> span(0.341, 0.36), span(-1.2, 0.5), span(202.7, 206.9, "deg")
    ('0.341-0.36', '−1.2 to 0.5', '203-207')
    """
    ends = [f"{end:.0f}".replace("-", "\u2212") if unit == "deg" else number(end) for end in (low, high)]
    return "-".join(ends) if low >= 0.0 else " to ".join(ends)


_TWO = {
    "ocean_current": "The ship drifts with a current of {} m/s towards {} deg",
    "wave_drift": "Waves push the ship with {} N in beam sea towards {} deg",
    "position_antenna_offset": "The recorded position is that of a point {} m ahead and {} m to starboard of the "
    "reference point",
    "speed_sensor_offset": "The recorded speeds are those of a point {} m ahead and {} m to starboard of the "
    "reference point",
}
"""Effects of two parameters, in their order."""


def _more_or_less(what: str) -> tuple[str, str]:
    return what + " {} % more than the model's", what + " {} % less than the model's"


def _too(what: str, above: str, below: str) -> tuple[str, str]:
    return f"{what} {above}", f"{what} {below}"


_ONE: dict[str, tuple[str, ...]] = {
    "loading": ("The ship is {} % heavier than her model", "The ship is {} % lighter than her model"),
    "surge_added_mass": _more_or_less("The water's inertia ahead is"),
    "sway_added_mass": _more_or_less("The water's inertia sideways is"),
    "yaw_inertia": _more_or_less("The inertia in yaw is"),
    "hull_fouling": _more_or_less("The hull's resistance straight ahead is"),
    "cross_flow_drag": _more_or_less("The hull's cross-flow drag is"),
    "drift_force": _more_or_less("The side force of the drifting hull is"),
    "drift_moment": _more_or_less("The yaw moment of the drifting hull is"),
    "turning_force": _more_or_less("The side force of the turning hull is"),
    "turning_drag": _more_or_less("The resistance of the turning hull is"),
    "yaw_damping": _more_or_less("The hull's resistance to turning is"),
    "trim": (
        "The hull's side force acts {} m further forward than the model's, as of trim by the head",
        "The hull's side force acts {} m further aft than the model's, as of trim by the stern",
    ),
    "skeg": ("The hull has {} m2 more skeg than the model", "The hull has {} m2 less skeg than the model"),
    "towed_load": (
        "Something holds the ship back with a steady {} N",
        "Something pushes the ship ahead with a steady {} N",
    ),
    "hull_lengthening": ("The ship is {} m longer than her model", "The ship is {} m shorter than her model"),
    "shallow_water": ("The water is about {} m deep, and the hull feels it",),
    **{
        f"thrust_loss_{name}": (f"{drive} {{}} % of {its} thrust", f"{more} {{}} % more thrust than the model's")
        for name, drive, its, more in (
            ("port", "The port thruster lacks", "its", "The port thruster has"),
            ("starboard", "The starboard thruster lacks", "its", "The starboard thruster has"),
            ("both", "Both thrusters lack", "their", "Both thrusters have"),
        )
    },
    "wake_fraction": (
        "The wake slows the water at the thrusters by {} %",
        "The water at the thrusters is {} % faster than the ship",
    ),
    "pod_side_force": _more_or_less("The side force of the pods in oblique flow is"),
    "tunnel_thrust_loss": (
        "The tunnel thruster lacks {} % of its side force",
        "The tunnel thruster has {} % more side force than the model's",
    ),
    "azimuth_offset_port": ("The port azimuth truly stands {} deg beyond what it reports",),
    "azimuth_offset_starboard": ("The starboard azimuth truly stands {} deg beyond what it reports",),
    "azimuth_offset_both": ("Both azimuths truly stand {} deg beyond what they report",),
    "azimuth_scale": (
        "Both azimuths truly turn {} % more than they report",
        "Both azimuths truly turn {} % less than they report",
    ),
    "yaw_asymmetry": (
        "A steady moment of {} N m turns the ship to starboard",
        "A steady moment of {} N m turns the ship to port",
    ),
    "sway_asymmetry": (
        "A steady force of {} N pushes the ship to starboard",
        "A steady force of {} N pushes the ship to port",
    ),
    "wind_load": (
        "The wind loads are {} % more than the tables say",
        "The wind loads are {} % less than the tables say",
    ),
    "wind_drag": _more_or_less("The wind force along the ship is"),
    "wind_side_load": _more_or_less("The wind force across the ship is"),
    "wind_yaw_load": _more_or_less("The yaw moment of the wind is"),
    "position_delay": _too("Positions are stamped {} s", "too late", "too early"),
    "heading_delay": _too("Headings are stamped {} s", "too late", "too early"),
    "speed_delay": _too("Surge, sway and yaw rate are stamped {} s", "too late", "too early"),
    "command_delay": _too("The drives' feedback is stamped {} s", "too late", "too early"),
    "thruster_lag": ("The thrusters follow what is recorded with a lag of {} s",),
    "heading_bias": _too("The compass reads {} deg", "too much", "too little"),
    "speed_sensor_rotation": (
        "The speed sensor is turned {} deg clockwise",
        "The speed sensor is turned {} deg counter-clockwise",
    ),
    "speed_scale": ("Reported speeds are {} times the true ones",),
    "sway_bias": (
        "The speed sensor reports {} m/s too much to starboard",
        "The speed sensor reports {} m/s too much to port",
    ),
    "yaw_rate_bias": _too("The rate gyro reads {} deg/s", "too much", "too little"),
    "yaw_rate_scale": ("Reported yaw rates are {} times the true ones",),
    "wind_direction_bias": _too("The wind vane reads {} deg", "too much", "too little"),
    "wind_speed_scale": ("Reported wind speeds are {} times the true ones",),
}
"""Effects of one parameter: in words for more, and for less where that is said otherwise."""
