"""What holds for every effect of the catalogue: nothing at neutral, smooth from there, described in full."""

from __future__ import annotations

import json
from math import inf, isfinite
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.effects import CATALOGUE, FAMILIES, Effect
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant, flat_numbers, pack
from seatrial.hybrid.vessel.sensors import differ_only_in_sensors, measure

EFFECTS = list(CATALOGUE.values())
BY_NAME = pytest.mark.parametrize("effect", EFFECTS, ids=lambda each: each.name)
DT_S = 0.5


def weaving(plant: Plant, effect: Effect) -> Floats:
    """What is measured [61, 6] of :func:`moving`."""
    return measure(moving(plant, effect), plant, DT_S)


def moving(plant: Plant, effect: Effect) -> Floats:
    """The states [61, 6] of half a minute in which shafts, both helms and the tunnel thruster all move.

    The shafts turn astern, slowly, where the effect is of that, and hardly at all where it is of a ship near rest.
    """
    near_rest = "low_speed" in effect.name
    sense = -0.5 if "astern" in effect.name else 0.1 if near_rest else 1.0
    phase = np.linspace(0.0, 2.0 * np.pi, 60)
    swing = 0.5 - 0.5 * np.cos(phase)
    controls = np.column_stack([
        sense * (2.0 + swing), 0.1 + 0.2 * np.sin(phase) * swing,
        sense * (2.2 + 0.5 * swing), 0.15 - 0.1 * swing, 300.0 * swing,
    ])  # fmt: skip
    wind = np.tile([0.8, 9.0], (60, 1))
    start = [0.0, 0.0, 0.2, 0.4 if near_rest else 4.0, 0.1, 0.01]
    return simulate(plant, start, controls, wind, DT_S)


def at(effect: Effect, free: Any) -> dict[str, float]:
    """Values at free coordinates that may be off the bounds by a rounding."""
    return {
        each.name: min(max(value, each.low), each.high)
        for each, value in zip(effect.parameters, effect.values_at(free).values(), strict=True)
    }


@BY_NAME
def test_neutral_changes_not_a_bit(effect: Effect, plant: Plant) -> None:
    """At neutral the plant is the same, and the change itself tends to nothing there."""
    assert effect.apply(plant, effect.neutral_values) is plant
    at_neutral = effect.change(plant, effect.neutral_values)
    assert np.array_equal(flat_numbers(pack(at_neutral)), flat_numbers(pack(plant)))


@BY_NAME
def test_an_ordinary_size_shows_in_what_is_measured(effect: Effect, plant: Plant) -> None:
    """More than the mean of many samples errs: 2 cm, 0.1 degree, 0.02 m/s or 0.025 deg/s."""
    changed = np.abs(weaving(effect.apply(plant, effect.typical_values), effect) - weaving(plant, effect)).max(
        axis=0
    )
    assert (changed / [0.02, 0.02, 0.0017, 0.02, 0.02, 0.0004]).max() > 1.0


@BY_NAME
def test_plants_move_alike_where_only_what_is_reported_differs(effect: Effect, plant: Plant) -> None:
    """Nothing that moves the ship is taken for an error of a sensor, and no such error for more than it is."""
    changed = effect.apply(plant, effect.typical_values)
    same = bool((moving(changed, effect) == moving(plant, effect)).all())
    assert differ_only_in_sensors(changed, plant) == differ_only_in_sensors(plant, changed) == same


@pytest.mark.parametrize(("effect", "which"), [
    pytest.param(each, which, id=f"{each.name}-{parameter.name}")
    for each in EFFECTS for which, parameter in enumerate(each.parameters)
])  # fmt: skip
def test_effects_begin_smoothly(effect: Effect, which: int, plant: Plant) -> None:
    """From neutral an effect grows in proportion, either way where it has two: nothing jumps, nothing bends."""
    step = np.zeros(len(effect.parameters))
    step[which] = effect.free_scale[which] * 1e-3
    base = weaving(plant, effect)

    def slope(share: float) -> Floats:
        return (weaving(effect.apply(plant, at(effect, share * step)), effect) - base) / share

    forward = slope(1.0)
    one_sided = effect.parameters[0].neutral in (effect.parameters[0].low, effect.parameters[0].high)
    other = slope(2.0) if one_sided else slope(-1.0)
    size = np.abs(forward).max()
    assert 0.0 < size < 1.0
    # Controls are held over steps and so move in steps, by a tenth of their range here.
    allowed = 0.15 if effect.name == "command_delay" else 0.02
    assert np.abs(forward - other).max() < allowed * size


@BY_NAME
@settings(max_examples=20)
@given(data=st.data())
def test_free_coordinates_and_values_are_each_others_inverse(effect: Effect, data: st.DataObject) -> None:
    """Estimation works in coordinates that are zero where the effect is absent; they translate back."""
    values = {
        each.name: data.draw(st.floats(each.low, each.high if isfinite(each.high) else 1e3))
        for each in effect.parameters
    }
    if effect.chart == "polar":
        values["direction_deg"] %= 360.0
        values[effect.parameters[0].name] += 1e-3
    assert effect.free_coordinates(effect.neutral_values) == pytest.approx([0.0] * len(effect.parameters), abs=0.0)
    assert effect.values_at(effect.free_coordinates(values)) == pytest.approx(values, rel=1e-9, abs=1e-9)
    assert all(size > 0.0 for size in effect.free_scale)


@BY_NAME
def test_effects_describe_themselves(effect: Effect) -> None:
    """Sizes lie in bounds and in order; the plain form is JSON without infinities."""
    assert effect.family in FAMILIES
    assert effect.what
    assert effect.source
    for each in effect.parameters:
        assert each.low <= each.neutral <= each.high
        assert each.low <= each.typical <= each.high
        assert 0.0 <= each.tolerance < each.smallest
        reach = max(each.high - each.neutral, each.neutral - each.low)
        assert each.neutral == inf or each.smallest <= abs(each.typical - each.neutral) <= reach
        assert each.tolerance == 0.0 or effect.kind != "physics"
    plain = effect.as_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert set(plain["parameters"][0]) >= {"name", "unit", "low", "high", "typical", "smallest", "tolerance"}


@BY_NAME
def test_confusion_is_mutual(effect: Effect) -> None:
    """Whatever an effect is confused with is in the catalogue and says the same of it."""
    for other in effect.confused_with:
        assert effect.name in CATALOGUE[other].confused_with
    assert effect.name not in effect.confused_with
    assert len(set(effect.confused_with)) == len(effect.confused_with)


def test_every_family_has_siblings() -> None:
    """The families are those of the list, each with several effects, listed together."""
    families = [effect.family for effect in EFFECTS]
    assert tuple(dict.fromkeys(families)) == FAMILIES
    assert families == sorted(families, key=FAMILIES.index)
    assert min(families.count(each) for each in FAMILIES) >= 4
