"""Reference models made worse step by step, from the truth itself to a hopeless one.

The main axis goes from the truth to the reference in equal steps of every number, and from there on to a ship that
is ever more lively: her hull's coefficients divided and her thrust multiplied by one factor. The other axes change
one thing of the truth only. How bad a model is, is said by its error, never by these factors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hybrid.vessel.plant import HULL, NUMBERS, Plant

OVERALL, COEFFICIENTS, THRUST, MISSING = "overall", "hull coefficients", "thrust", "missing effects"
THRUST_NUMBERS = ("thrust_nn", "thrust_nu", "thrust_uu", "side_nv", "side_uv", "side_vv")
ENVIRONMENT = ("current_north_mps", "current_east_mps", "drift_force_n", "drift_north", "drift_east")

SHARES = (0.0, 0.15, 0.3, 0.6, 1.0)
FACTORS = (1.25, 1.6, 2.5, 5.0)
SINGLE_FACTORS = (0.5, 0.8, 1.25, 2.0)


@dataclass(frozen=True, slots=True)
class Degradation:
    """A reference model that is worse than the truth: along which axis, how far, and its plant."""

    axis: str
    label: str
    plant: Plant


def degradations(
    truth: Plant, reference: Plant, shares: Sequence[float] = SHARES, factors: Sequence[float] = FACTORS
) -> tuple[Degradation, ...]:
    """The main axis in order: ``shares`` of the way from truth to reference, then ``factors`` beyond it."""
    on_the_way = [
        Degradation(OVERALL, f"{share:.0%} of the way to the reference", blended(truth, reference, share))
        for share in shares
    ]
    beyond = [
        Degradation(OVERALL, f"the reference, hull / {factor:g}, thrust x {factor:g}", livelier(reference, factor))
        for factor in factors
    ]
    return (*on_the_way, *beyond)


def single_degradations(
    truth: Plant, reference: Plant, factors: Sequence[float] = SINGLE_FACTORS
) -> tuple[Degradation, ...]:
    """The truth with one thing wrong: its hull, its thrust, or an effect that the reference does not know."""
    weather = {name: getattr(reference, name) for name in ENVIRONMENT}
    other_weather = {name: getattr(truth, name) for name in ENVIRONMENT}
    return (
        *(Degradation(COEFFICIENTS, f"hull x {each:g}", truth.scaled(each, *HULL)) for each in factors),
        *(Degradation(THRUST, f"thrust x {each:g}", truth.scaled(each, *THRUST_NUMBERS)) for each in factors),
        Degradation(MISSING, "without current and wave drift", replace(truth, **weather)),
        Degradation(MISSING, "without what changed the ship", replace(reference, **other_weather)),
    )


def blended(truth: Plant, reference: Plant, share: float) -> Plant:
    """Every number of the truth moved by ``share`` of the way to the reference's; the truth's extra forces stay."""
    numbers: dict[str, Any] = {}
    for name in NUMBERS:
        ours, theirs = np.asarray(getattr(truth, name)), np.asarray(getattr(reference, name))
        value = (1.0 - share) * ours + share * theirs
        numbers[name] = tuple(value.tolist()) if value.ndim else float(value)
    return replace(truth, **numbers)


def livelier(reference: Plant, factor: float) -> Plant:
    """The hull's coefficients divided, the thrust multiplied: a ship that answers ever more than she should."""
    return reference.scaled(1.0 / factor, *HULL).scaled(factor, *THRUST_NUMBERS)
