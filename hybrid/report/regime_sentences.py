"""What a model lacks in a regime of operation, in plain words."""

from __future__ import annotations

from math import isfinite

from hybrid.diagnosis.regimes import FoundRegime
from hybrid.diagnosis.result import Estimate, RegimeEffect
from hybrid.effects.regime import Regime, parameter_of
from hybrid.report.diagnosis_words import number, percent
from hybrid.report.words import join_words, plain

_WHAT = {
    "speed_mps": "the speed",
    "surge_mps": "surge",
    "sway_mps": "sway",
    "yaw_rate_dps": "the yaw rate",
    "drift_angle_deg": "the drift angle",
    "wind_mps": "the wind",
    "relative_wind_deg": "the direction of the wind off the bow",
    "rpm": "the mean shaft speed",
    "azimuth_deg": "the mean azimuth",
    "rudder_deg": "the mean rudder angle",
    "nozzle_deg": "the mean nozzle angle",
}
_UNITS = {"mps": "m/s", "dps": "deg/s", "deg": "deg", "rpm": "rpm"}
_WAYS = {"surge": ("ahead", "astern"), "sway": ("to starboard", "to port"), "yaw": ("to starboard", "to port")}
_WIDTH = 1.96


def regime_in_words(found: FoundRegime) -> RegimeEffect:
    """A regime that was found as the contract has it."""
    regime = found.regime
    name, unit = parameter_of(regime)
    ends = sorted((found.value - _WIDTH * found.error, found.value + _WIDTH * found.error))
    return RegimeEffect(
        found.name,
        regime_sentence(found),
        regime.axis,
        {each: (_end(low), _end(high)) for each, (low, high) in regime.within.items()},
        regime.grows_with,
        regime.at,
        {name: Estimate(found.value, ends[0], ends[1], unit)},
        found.share,
        found.replicated,
        found.after_m,
    )


def _end(value: float) -> float | None:
    return value if isfinite(value) else None


def regime_sentence(found: FoundRegime) -> str:
    """Force, regime, and what it brings, in one sentence."""
    regime, kilo = found.regime, abs(found.value) / 1e3
    unit, what = ("kN m", "moment") if regime.axis == "yaw" else ("kN", "force")
    way = _WAYS[regime.axis][found.value < 0.0]
    return (
        f"The model lacks {number(kilo)} {unit} {way}{_where(regime)}{_growth(regime)}: "
        f"{percent(found.share)} of the missing {regime.axis} {what}; "
        f"with it the error on held-out legs is {found.after_m:.2f} m."
    )


def _where(regime: Regime) -> str:
    spans = [f"{_what(name)} is {_span(name, *span)}" for name, span in regime.within.items()]
    return f" while {join_words(spans)}" if spans else ""


def _growth(regime: Regime) -> str:
    if regime.grows_with is None:
        return ""
    of = _what(regime.grows_with)
    return (
        f", proportional to the square of {of} (the figure is for {number(regime.at)} {_unit(regime.grows_with)})"
    )


def _span(name: str, low: float, high: float) -> str:
    unit = _unit(name)
    if not isfinite(low):
        return f"below {number(high)} {unit}"
    return f"above {number(low)} {unit}" if not isfinite(high) else f"{number(low)} to {number(high)} {unit}"


def _what(name: str) -> str:
    return _WHAT.get(name) or f"the shaft speed of the {plain(name.removesuffix('_rpm'))} thruster"


def _unit(name: str) -> str:
    return _UNITS[name.rsplit("_", 1)[-1]]
