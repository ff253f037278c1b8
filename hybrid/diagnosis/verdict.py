"""From what was named and what remains to a verdict, in words and numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import atan2, degrees, hypot, isfinite

import numpy as np

from hybrid.diagnosis.beyond import AXES, OPERATION
from hybrid.diagnosis.name import CLOSE, Naming, rivals_of
from hybrid.diagnosis.remainder import Remainder
from hybrid.diagnosis.result import Estimate, Rival, Unexplained, Verdict
from hybrid.diagnosis.words import number, plain
from hybrid.effects import Effect
from hybrid.vessel.compiling import Floats

WEAK = 9.0
"""A name stands whose rival lacks more than ``CLOSE``; below this another trial is worth its time."""

_WIDTH = 1.96
_CREDIBLE = 3  # effects at once; more are as a rule what imitates one that is missing in the catalogue


def estimates(naming: Naming, name: str) -> dict[str, Estimate]:
    """The parameters of a named effect with their 95 % intervals."""
    view, effect = naming.view, naming.view.examination.model.catalogue[name]
    fit = view.fit(naming.names, prior=True)
    places = view.places(fit, name)
    covariance = fit.covariance[np.ix_(places, places)] * naming.tests[name].spread
    given = naming.view.examination.model.given.get(name, (0.0,) * len(places))
    return intervals(effect, fit.values[places] + np.array(given), covariance)


def intervals(effect: Effect, free: Floats, covariance: Floats) -> dict[str, Estimate]:
    """Parameters and 95 % intervals from free coordinates and their covariance."""
    deviation = np.sqrt(np.diag(covariance))
    if effect.chart == "polar":
        return _polar(effect, free, covariance)
    result = {}
    values, low, high = (effect.values(list(free + side * _WIDTH * deviation)) for side in (0.0, -1.0, 1.0))
    for each in effect.parameters:
        ends = sorted((low[each.name], high[each.name]))
        bounded = [min(max(end, each.low), each.high) for end in ends]
        result[each.name] = Estimate(values[each.name], bounded[0], bounded[1], each.unit)
    return result


def _polar(effect: Effect, free: Floats, covariance: Floats) -> dict[str, Estimate]:
    """A size and a direction: deviations along and across the vector."""
    along, across = free
    size = max(hypot(along, across), 1e-12)
    ahead = np.array([along, across]) / size
    aside = np.array([-ahead[1], ahead[0]])
    length = float(np.sqrt(ahead @ covariance @ ahead)) * _WIDTH
    turn = degrees(float(np.sqrt(aside @ covariance @ aside)) / size) * _WIDTH
    towards = degrees(atan2(across, along)) % 360.0
    first, second = effect.parameters
    return {
        first.name: Estimate(size, max(size - length, 0.0), size + length, first.unit),
        second.name: Estimate(towards, towards - min(turn, 180.0), towards + min(turn, 180.0), second.unit),
    }


def close_rivals(naming: Naming) -> list[Rival]:
    """Effects that explain almost as much in the place of a named one, the closest first."""
    found = []
    for name in naming.names:
        for rival, less in rivals_of(naming.view, naming.names, name).items():
            less = min(less, naming.nearer.get((name, rival), less))
            if less < 3.0 * CLOSE:
                found.append(Rival(name, rival, float(less)))
    return sorted(found, key=lambda each: each.evidence)


def groups(names: Sequence[str], rivals: Sequence[Rival]) -> list[tuple[str, ...]]:
    """What these data cannot tell apart: each named effect with its close rivals."""
    result = []
    for name in names:
        tied = [each.name for each in rivals if each.instead_of == name and each.evidence < CLOSE]
        if tied:
            result.append((name, *tied))
    return result


def verdict_of(names: Sequence[str], tied: Sequence[tuple[str, ...]], unknown: Unexplained | None) -> Verdict:
    """One word for it."""
    if unknown:
        return "unknown"
    if not names:
        return "nothing_missing"
    return "indistinguishable" if tied else "named"


def unexplained(found: Sequence[Remainder], effects: Sequence[Effect], share_of_gap: float) -> Unexplained | None:
    """What remains, in words; or what so many named ``effects`` at once are likely to stand for."""
    if found:
        where = tuple(dict.fromkeys(each.depends for each in found))
        return Unexplained(share_of_gap, where, "; ".join(dict.fromkeys(looks_like(each) for each in found[:3])))
    if len(effects) <= _CREDIBLE:
        return None
    families = " and ".join(dict.fromkeys(each.family for each in effects))
    words = (
        f"{len(effects)} effects at once ({families}): rather one that is not in the catalogue and like all of them"
    )
    return Unexplained(share_of_gap, (OPERATION,), words)


_UNIT = {"surge": "N", "sway": "N", "yaw": "N m"}


def looks_like(remainder: Remainder) -> str:
    """One family in words: its axis or effect, on what it depends, and its size."""
    if remainder.what == "force":
        return (
            f"forces that depend on speeds and thrusters, off by some {100.0 * remainder.size:.2g} % of their range"
        )
    if remainder.what in AXES:
        kind = "moment" if remainder.what == "yaw" else "force"
        size = f"{remainder.size:.2g} {_UNIT[remainder.what]}"
        return f"a {remainder.what} {kind} of some {size} that varies with {_WORDS[remainder.depends]}"
    return f"{plain(remainder.what)} that varies with {_WORDS[remainder.depends]}"


_WORDS = {
    "heading": "the heading",
    "place": "the place",
    "time": "time",
    "azimuth": "large azimuth angles",
    OPERATION: "speed and thrusters",
}


def sentence(effect: Effect, parameters: Mapping[str, Estimate], share_of_gap: float) -> str:
    """A named effect in one plain sentence, with its size, certainty and share of the gap."""
    what = _SAYS.get(effect.name, _general)(effect, parameters)
    ends = "; ".join(_span(each) for each in parameters.values())
    return f"{what} ({ends}); it explains {100.0 * share_of_gap:.0f} % of the gap on legs not used to find it."


def _span(estimate: Estimate) -> str:
    return (
        f"{number(estimate.low)}-{number(estimate.high)}"
        if estimate.low >= 0.0
        else (f"{number(estimate.low)} to {number(estimate.high)}")
    )


def _general(effect: Effect, parameters: Mapping[str, Estimate]) -> str:
    sizes = ", ".join(
        f"{name.rsplit('_', 1)[0]} {number(each.value)} {each.unit}" for name, each in parameters.items()
    )
    return f"The model lacks {effect.name.replace('_', ' ')}: {sizes.replace(' 1,', ',').removesuffix(' 1')}"


def _current(effect: Effect, p: Mapping[str, Estimate]) -> str:
    return (
        f"The ship drifts with a current of {number(p['speed_mps'].value)} m/s "
        f"towards {p['direction_deg'].value:.0f} deg"
    )


def _waves(effect: Effect, p: Mapping[str, Estimate]) -> str:
    return (
        f"Waves push the ship with {number(p['force_n'].value)} N in beam sea towards "
        f"{p['direction_deg'].value:.0f} deg"
    )


def _loading(effect: Effect, p: Mapping[str, Estimate]) -> str:
    change = 100.0 * (p["mass_factor"].value - 1.0)
    return f"The ship is {number(abs(change))} % {'heavier' if change >= 0.0 else 'lighter'} than her model"


def _first(text: str) -> Callable[[Effect, Mapping[str, Estimate]], str]:
    """A sentence about the first parameter: its value, or its change in percent."""

    def say(effect: Effect, parameters: Mapping[str, Estimate]) -> str:
        value = next(iter(parameters.values())).value
        neutral = effect.parameters[0].neutral
        change = 100.0 * (value - neutral) if isfinite(neutral) else value
        more = "more" if value >= neutral else "less"
        return text.format(value=number(value), percent=f"{abs(change):.3g}", more=more)

    return say


_SAYS = {
    "ocean_current": _current,
    "wave_drift": _waves,
    "hull_lengthening": _first("The ship is {value} m longer than her model"),
    "loading": _loading,
    "hull_fouling": _first("The hull has {percent} % {more} resistance straight ahead"),
    "cross_flow_drag": _first("The hull has {percent} % {more} cross-flow drag"),
    "yaw_damping": _first("The hull has {percent} % {more} resistance to turning"),
    "wind_load": _first("The wind loads are {percent} % {more} than the tables say"),
    "towed_load": _first("Something holds the ship back with a steady {value} N"),
    "yaw_asymmetry": _first("A steady moment of {value} N m turns the ship"),
    "shallow_water": _first("The water is about {value} m deep, and the hull feels it"),
    "thrust_loss_port": _first("The port thruster lacks {percent} % of its thrust"),
    "thrust_loss_starboard": _first("The starboard thruster lacks {percent} % of its thrust"),
    "thrust_loss_both": _first("Both thrusters lack {percent} % of their thrust"),
    "azimuth_offset_port": _first("The port azimuth truly stands {value} deg beyond what it reports"),
    "azimuth_offset_starboard": _first("The starboard azimuth truly stands {value} deg beyond what it reports"),
    "azimuth_offset_both": _first("Both azimuths truly stand {value} deg beyond what they report"),
    "thruster_lag": _first("The thrusters follow what is recorded {value} s late"),
    "heading_bias": _first("The compass reads {value} deg too much"),
    "position_antenna_offset": _general,
    "position_delay": _first("Positions are stamped {value} s too late"),
    "speed_scale": _first("Reported speeds are {value} times the true ones"),
    "wind_direction_bias": _first("The wind vane reads {value} deg too much"),
}
