"""The catalogue of effects that a model may lack: what each is, and what it does to a plant.

It has every effect by its name, users' own beside the built-in ones. The effects of the actuators follow from a
ship's list of them (:func:`catalogue_of_actuators`); :data:`CATALOGUE` is that of the default list. To add an
effect to Seatrial, write one :class:`.Effect` into the list in the file of its subject. To add one of your own,
write a Python file with ``EFFECTS = [Effect(...), ...]`` and give it to the command line.

An effect found in a recording is a force that the model lacks while the ship is in some regime of operation. A
regime is a span of one or two quantities, shafts that turn astern, or a tunnel thruster at work under way; the
force acts along one body axis, steadily or with the square of a quantity. It stands for physics that no effect of
the catalogue expresses, has no theory behind it, and holds outside the recordings that it was found in only as far
as its regime does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import lru_cache
from itertools import chain
from math import atan2, cos, degrees, hypot, inf, nan, sin
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from seatrial.acquisition.core import named_code, quantities, ship
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.analysis.compiling import compiled
from seatrial.hybrid.effects import body, environment, hull
from seatrial.hybrid.vessel.actuators import control_units, effects_by_kind
from seatrial.hybrid.vessel.black_box import BlackBox
from seatrial.hybrid.vessel.dynamics import Environment
from seatrial.hybrid.vessel.effect import (
    FAMILIES,
    USUAL_LENGTH_M,
    AnyModel,
    Effect,
    Parameter,
    Values,
    froude_growth,
    scale_of,
)
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant

Catalogue = Mapping[str, Effect]

VERSION = "6"
"""Stated with every verdict; to be raised when an effect is added, removed or changes its form."""


@lru_cache(maxsize=32)
def _catalogue_at_scale(actuators: ship.Actuators, scale: float, of_simulator: bool = False) -> dict[str, Effect]:
    effects = chain.from_iterable(effects_by_kind(actuators).values())
    actuator_effects = sorted(effects, key=lambda effect: FAMILIES.index(effect.family))
    unsized = (*hull.EFFECTS, *actuator_effects, *hull.ASYMMETRY, *environment.EFFECTS, *environment.SENSOR_EFFECTS)
    if of_simulator:
        names = {actuator.kind: ship.names_of_kind(actuators, actuator.kind) for actuator in actuators}
        gains = chain.from_iterable(body.gains(kind, of_kind) for kind, of_kind in names.items())
        unsized = (*unsized, *body.BODY, *gains)

    def scaled(parameter: Parameter) -> Parameter:
        factor = froude_growth(parameter.unit, scale)
        sizes = ("low", "high", "typical", "smallest", "tolerance")
        return replace(parameter, **{size: factor * getattr(parameter, size) for size in sizes})

    catalogue, duplicates = dict[str, Effect](), set[str]()
    for effect in unsized:
        duplicates |= {effect.name} & set(catalogue)
        if scale != 1.0:
            effect = replace(effect, parameters=tuple(map(scaled, effect.parameters)))
        catalogue[effect.name] = effect
    if duplicates:
        raise ConfigurationError(
            f"two effects of this ship are called {', '.join(sorted(duplicates))}",
            fix="rename an actuator in the vessel file",
        )
    # With more wake a propeller's race is slower, and the rudder behind it weaker: in trials of turns and zigzags
    # either explains 60 to 90 % of what the other does.
    losses = [effect.name for effect in actuator_effects if effect.name.startswith("rudder_loss_")]
    for name in [effect.name for effect in actuator_effects if losses and effect.name.startswith("wake_")]:
        rivals = {*catalogue[name].confused_with, *losses}
        catalogue[name] = replace(catalogue[name], confused_with=tuple(sorted(rivals)))
    for effect in tuple(catalogue.values()):
        _confuse_both_ways(catalogue, effect)
    return catalogue


def _confuse_both_ways(catalogue: dict[str, Effect], effect: Effect, in_order: bool = True) -> None:
    """Make ``confused_with`` symmetric; the new name is sorted in, or comes last."""
    for rival in effect.confused_with:
        try:
            rival_effect = effect_named(rival, catalogue)
        except ConfigurationError as error:
            raise error.at(f"effect {effect.name}, confused_with") from error
        if effect.name not in rival_effect.confused_with:
            names = (*rival_effect.confused_with, effect.name)
            catalogue[rival] = replace(rival_effect, confused_with=tuple(sorted(names)) if in_order else names)


def catalogue_of_actuators(actuators: ship.Actuators, length_m: float = USUAL_LENGTH_M) -> dict[str, Effect]:
    """The catalogue of a ship with these actuators: what any ship may lack, and the effects of each actuator.

    Typical sizes scale with the ship's length.
    """
    return dict(_catalogue_at_scale(actuators, scale_of(length_m)))


def catalogue_of(vessel: Vessel | BlackBox) -> dict[str, Effect]:
    """The catalogue of a vessel; of a simulator that of what can be asked from outside (:func:`asked_outside`) with
    gains of its drives and pushes on its hull (:mod:`.body`)."""
    if isinstance(vessel, BlackBox):
        scale = scale_of(vessel.length_between_perpendiculars_m)
        return asked_outside(vessel, _catalogue_at_scale(vessel.layout, scale, of_simulator=True))
    return catalogue_of_actuators(vessel.actuators, vessel.dimensions.length_between_perpendiculars_m)


def asked_outside(model: BlackBox, catalogue: Catalogue) -> dict[str, Effect]:
    """The effects of a catalogue that change nothing inside a simulator, nor any force, for it states no mass."""
    bare, result = replace(model, numbers={}), dict[str, Effect]()
    for name, effect in catalogue.items():
        is_force = any(parameter.unit in ("N", "N m") for parameter in effect.parameters)
        if is_force or (not model.takes_wind and "no wind" in effect.excluded_by):
            continue
        with suppress(ConfigurationError, AttributeError, KeyError, TypeError):
            effect.apply(bare, effect.typical_values)
            result[name] = effect
    return {
        name: replace(effect, confused_with=tuple(rival for rival in effect.confused_with if rival in result))
        for name, effect in result.items()
    }


def inside_effects(model: BlackBox) -> tuple[str, ...]:
    """The effects that would have to act inside a simulator, which no diagnosis with it can ask for."""
    return tuple(name for name in catalogue_of_actuators(model.layout) if name not in catalogue_of(model))


def effect_named(name: str, catalogue: Catalogue | None = None) -> Effect:
    """The effect of that name, or :class:`ConfigurationError` that lists what is possible."""
    catalogue = CATALOGUE if catalogue is None else catalogue
    if name in catalogue:
        return catalogue[name]
    near = get_close_matches(name, catalogue, n=1)
    hint = f"did you mean {near[0]}? All: " if near else "use one of "
    raise ConfigurationError(f"no effect {name!r} in the catalogue", fix=hint + ", ".join(catalogue))


CATALOGUE: dict[str, Effect] = catalogue_of_actuators(ship.DEFAULT)
"""The catalogue of the default list of actuators, R/V Gunnerus'."""


def apply_effects(plant: AnyModel, effects: Mapping[str, Values], catalogue: Catalogue | None = None) -> AnyModel:
    """``plant`` with each named effect at its values, in the order given; by default those of its own catalogue."""
    if catalogue is None:
        scale, of_simulator = scale_of(plant.length_between_perpendiculars_m), isinstance(plant, BlackBox)
        catalogue = _catalogue_at_scale(plant.layout, scale, of_simulator)
    for name, values in effects.items():
        plant = effect_named(name, catalogue).apply(plant, values)
    return plant


def simulator_with(model: BlackBox, effects: Mapping[str, Values]) -> BlackBox:
    """A simulator with effects added to those that it has, in the place of those of the same names. Raises
    :class:`ConfigurationError` for one that would act inside it."""
    merged = {**model.effects, **effects}
    return apply_effects(replace(model, numbers={}, effects=merged), merged)


def vessel_plant(vessel: Vessel, catalogue: Catalogue | None = None) -> Plant:
    """The plant of a vessel as its file states it, with the effects that the file adds."""
    return apply_effects(bare_plant(vessel), vessel.effects, catalogue)


def without_effects_of_day(vessel: Vessel) -> Vessel:
    """The vessel without what its effects say of the day of a trial: the current, waves, a wind, what it towed."""
    catalogue = catalogue_of(vessel)
    kept = {
        name: values for name, values in vessel.effects.items()
        if name not in catalogue or catalogue[name].scope != "day"
    }  # fmt: skip
    return replace(vessel, effects=kept)


def catalogue_with(
    files: Iterable[str | Path] = (), without: Iterable[str] = (), vessel: Vessel | BlackBox | None = None
) -> dict[str, Effect]:
    """The catalogue of a ship, by default R/V Gunnerus, with users' files added and some effects left out.

    What a user's effect is confused with is stated of the other effect, too.
    """
    catalogue = dict(CATALOGUE) if vessel is None else catalogue_of(vessel)
    for file in files:
        loaded = load_effects(file)
        catalogue |= loaded
        for effect in loaded.values():
            _confuse_both_ways(catalogue, effect, in_order=False)
    for name in without:
        del catalogue[effect_named(name, catalogue).name]
    return catalogue


def load_effects(path: str | Path) -> dict[str, Effect]:
    """The effects of a user's Python file, which has a list ``EFFECTS`` of :class:`Effect`, or of ``FILE.py:LIST``.

    The file is executed. Raises :class:`ConfigurationError` if that fails or the list is not there.
    """
    effects: Any = named_code.load(f"{path}:EFFECTS" if str(path).endswith(".py") else str(path), "effects")
    if not isinstance(effects, list | tuple) or not all(isinstance(entry, Effect) for entry in effects):
        raise ConfigurationError(
            "has no list of effects",
            where=str(path),
            fix="define EFFECTS = [Effect(...), ...] with Effect from seatrial.hybrid.effects",
        )
    return {effect.name: effect for effect in effects}


def parse_effects(texts: Iterable[str], catalogue: Catalogue = CATALOGUE) -> dict[str, dict[str, float]]:
    """Several effects, each as in :func:`parse_effect`. Raises :class:`ConfigurationError` for one named twice."""
    effects: dict[str, dict[str, float]] = {}
    for text in texts:
        name, values = parse_effect(text, catalogue)
        if name in effects:
            raise ConfigurationError(
                f"effect {name} is given twice", where=text, fix="put its parameters into one, with commas between"
            )
        effects[name] = values
    return effects


def parse_effect(text: str, catalogue: Catalogue = CATALOGUE) -> tuple[str, dict[str, float]]:
    """An effect and its values from ``NAME:PARAMETER=VALUE,...``, checked against the catalogue.

    >>> parse_effect("ocean_current:speed_mps=0.3,direction_deg=40")
    ('ocean_current', {'speed_mps': 0.3, 'direction_deg': 40.0})
    """
    name, _, assignments = text.partition(":")
    effect = effect_named(name.strip(), catalogue)
    possible = ",".join(f"{parameter.name}={parameter.typical:g}" for parameter in effect.parameters)
    values: dict[str, float] = {}
    for part in filter(None, assignments.split(",")):
        key, _, number = part.partition("=")
        try:
            values[key.strip()] = float(number)
        except ValueError as error:
            raise ConfigurationError(
                f"{part!r} is not PARAMETER=NUMBER", where=text, fix=f"write for example {name}:{possible}"
            ) from error
    if not values:
        raise ConfigurationError(
            f"no parameter given for {name}", where=text, fix=f"write for example {name}:{possible}"
        )
    effect.complete_values(values)
    return effect.name, values


__all__ = [
    "CATALOGUE",
    "FAMILIES",
    "Catalogue",
    "Effect",
    "Parameter",
    "apply_effects",
    "catalogue_with",
    "load_effects",
    "parse_effect",
    "vessel_plant",
]


AXES = ("surge", "sway", "yaw")
MOTION = ("speed_mps", "surge_mps", "sway_mps", "yaw_rate_dps", "drift_angle_deg", "wind_mps", "relative_wind_deg")
"""Quantities of the ship's motion and of the wind, which comes from so many degrees off the bow, positive to
starboard; the others are of its actuators (:func:`weights_of`)."""

MOST = 4
"""Regimes in one model."""

_LINEAR, _ANGLE, _ALWAYS = float(len(MOTION)), float(len(MOTION) + 1), -1.0
_CONDITIONS = 2
_MOVING_MPS, _WIND_MPS = 0.3, 1.0  # below, a drift angle and a direction of the wind mean nothing


@dataclass(frozen=True, slots=True)
class Regime:
    """Where a force acts, and how.

    ``within`` has the span of each quantity (from, less than). The force goes with the square of ``grows_with``,
    the other way where that has the other sign, and has its size where that is ``at``; or it is steady.
    """

    axis: str
    within: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    grows_with: str | None = None
    at: float = 1.0


def steering_angles(actuators: ship.Actuators) -> dict[str, tuple[str, ...]]:
    """By what their mean angle is called, the names of the actuators that steer alike: ``azimuth_deg``,
    ``rudder_deg``, ``nozzle_deg``."""
    names = {
        angle: tuple(actuator.name for actuator in actuators if actuator.steers_by == angle)
        for angle in ship.ANGLES
    }
    return {f"{angle}_deg": members for angle, members in names.items() if members}


def weights_of(actuators: ship.Actuators) -> dict[str, tuple[float, quantities.Floats]]:
    """Quantities of the actuators: the code of each, and what it is of their controls in SI, a weight for each.

    The mean speed of the shafts that drive the ship, the speed of each tunnel thruster's, and the mean angle of
    each kind that has one.
    """
    names, units = list(ship.control_names(actuators)), control_units(actuators)
    groups = {"rpm": ("rpm", ship.shafts(actuators))}
    groups |= {f"{name}_rpm": ("rpm", (name,)) for name in ship.names_of_kind(actuators, "tunnel")}
    groups |= {quantity: ("angle_deg", names) for quantity, names in steering_angles(actuators).items()}
    result = {}
    for quantity, (control, members) in groups.items():
        weights = np.zeros(len(names))
        for member in members:
            column = names.index(f"{member}_{control}")
            weights[column] = 1.0 / len(members) / (units[column] if control == "rpm" else 1.0)
        if members:
            result[quantity] = (_LINEAR if control == "rpm" else _ANGLE, weights)
    return result


@compiled
def _quantity_value(code, weights, state, control, environment):  # type: ignore[no-untyped-def]
    """A quantity by its code; NaN where it means nothing."""
    if code == _LINEAR:
        total = 0.0
        for i in range(len(control)):
            total += weights[i] * control[i]
        return total
    if code == _ANGLE:
        ahead, starboard = 0.0, 0.0
        for i in range(len(control)):
            ahead += weights[i] * cos(control[i])
            starboard += weights[i] * sin(control[i])
        return degrees(atan2(starboard, ahead))
    _, _, heading, u, v, r = state
    speed = hypot(u, v)
    if code == 0.0:
        return speed
    if code == 1.0:
        return u
    if code == 2.0:
        return v
    if code == 3.0:
        return degrees(r)
    if code == 4.0:
        return degrees(atan2(-v, u)) if speed > _MOVING_MPS else nan
    wind = hypot(environment.wind_north_mps, environment.wind_east_mps)
    if code == 5.0:
        return wind
    from_rad = atan2(-environment.wind_east_mps, -environment.wind_north_mps) - heading
    return degrees(atan2(sin(from_rad), cos(from_rad))) if wind > _WIND_MPS else nan


@compiled
def _acting_share(row, state, control, environment):  # type: ignore[no-untyped-def]
    """The share of its force that acts: 0 out of the regime."""
    size = 3 + len(control)
    for number in range(_CONDITIONS):
        block = row[2 + (number + 1) * size : 2 + (number + 2) * size]
        if block[0] != _ALWAYS:
            value = _quantity_value(block[0], block[3:], state, control, environment)
            if not block[1] <= value < block[2]:
                return 0.0
    growth = row[2 : 2 + size]
    if growth[0] == _ALWAYS:
        return 1.0
    value = _quantity_value(growth[0], growth[3:], state, control, environment)
    return value * abs(value) / (growth[1] * abs(growth[1]))


@njit(cache=True, error_model="numpy")
def regime_forces(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
    """The sum of all regimes' forces: X [N], Y [N], N [N m]."""
    X, Y, N = 0.0, 0.0, 0.0
    size = 2 + (1 + _CONDITIONS) * (3 + len(control))
    for number in range(len(parameters) // size):
        row = parameters[number * size : (number + 1) * size]
        if row[0] != 0.0:
            force = row[0] * _acting_share(row, state, control, environment)
            if row[1] == 0.0:
                X += force
            elif row[1] == 1.0:
                Y += force
            else:
                N += force
    return X, Y, N


def _regime_row(regime: Regime, force: float, actuators: ship.Actuators) -> tuple[float, ...]:
    """A regime as the compiled force reads it: force, axis, then what it grows with and each condition."""
    weights, size = weights_of(actuators), len(ship.control_names(actuators))
    if len(regime.within) > _CONDITIONS:
        raise ConfigurationError(f"a regime of {len(regime.within)} spans", fix=f"give at most {_CONDITIONS}")

    def block(quantity: str | None, low: float, high: float) -> tuple[float, ...]:
        if quantity is None:
            return (_ALWAYS, low, high, *np.zeros(size))
        if quantity in weights:
            code, weight = weights[quantity]
            return (code, low, high, *weight)
        if quantity not in MOTION:
            raise ConfigurationError(
                f"this ship has no quantity {quantity!r} for a regime", fix=f"use {', '.join([*MOTION, *weights])}"
            )
        return (float(MOTION.index(quantity)), low, high, *np.zeros(size))

    spans = [*regime.within.items(), *[(None, (-inf, inf))] * _CONDITIONS][:_CONDITIONS]
    blocks = [block(regime.grows_with, regime.at, inf), *(block(name, *span) for name, span in spans)]
    return (force, float(AXES.index(regime.axis)), *(number for part in blocks for number in part))


def quantities_along(
    actuators: ship.Actuators, states: quantities.Floats, controls: quantities.Floats, wind: quantities.Floats
) -> dict[str, quantities.Floats]:
    """Every quantity that a regime may be of along a motion [T].

    ``states`` [T, 6] and ``controls`` [T, controls] in SI, ``wind`` [T, 2] where from [rad] and how fast [m/s].
    """
    coded = {name: (float(code), np.zeros(controls.shape[1])) for code, name in enumerate(MOTION)}
    coded |= weights_of(actuators)
    air = -wind[:, 1:] * np.column_stack([np.cos(wind[:, 0]), np.sin(wind[:, 0])])
    states, controls = np.ascontiguousarray(states), np.ascontiguousarray(controls)  # else compiled once more
    return {name: _quantity_along(code, weight, states, controls, air) for name, (code, weight) in coded.items()}


@njit(cache=True, error_model="numpy")
def _quantity_along(code, weights, states, controls, air):  # type: ignore[no-untyped-def]
    result = np.empty(len(states))
    for k in range(len(states)):
        row = states[k]
        state = (row[0], row[1], row[2], row[3], row[4], row[5])
        around = Environment(air[k, 0], air[k, 1], 0.0, 0.0, 0.0)
        result[k] = _quantity_value(code, weights, state, controls[k], around)
    return result


def parameter_of(regime: Regime) -> tuple[str, str]:
    """What the size of a regime's force is called, and its unit."""
    return ("moment_nm", "N m") if regime.axis == "yaw" else ("force_n", "N")


def regime_effect(name: str, regime: Regime, typical: float) -> Effect:
    """The effect of a force in a regime; ``typical`` [N, or N m in yaw] is an ordinary size of it."""
    parameter, unit = parameter_of(regime)

    def change(plant: Plant, values: Values) -> Plant:
        # all regimes are one force to the compiler, which takes seconds over each new one
        row = _regime_row(regime, values[parameter], plant.layout)
        stored = next((term.parameters for term in plant.forces if term.function is regime_forces), ())
        used = [stored[start : start + len(row)] for start in range(0, len(stored), len(row))]
        rows = [*(used_row for used_row in used if used_row[0] != 0.0), row]
        if len(rows) > MOST:
            raise ConfigurationError(f"a model with {len(rows)} regimes", fix=f"give at most {MOST}")
        rows += [(0.0,) * len(row)] * (MOST - len(rows))
        regular_forces = tuple(term for term in plant.forces if term.function is not regime_forces)
        return replace(plant, forces=regular_forces).with_force(
            regime_forces, *(number for regime_row in rows for number in regime_row)
        )

    used = {*regime.within, *([regime.grows_with] if regime.grows_with else [])}
    wind, actuators = {"relative_wind_deg", "wind_mps"} & used, used - set(MOTION)
    return Effect(
        name,
        family="environment" if wind else "propulsion" if actuators else "hull",
        kind="physics",
        what=f"A {parameter.split('_')[0]} in {regime.axis} that was found in a recording, without a theory",
        source="What a model lacked there; no published form",
        parameters=(Parameter(parameter, unit, 0.0, -inf, inf, abs(typical), 0.1 * abs(typical)),),
        change=change,
    )


def as_file(regimes: Mapping[str, tuple[Regime, float]]) -> str:
    """A file of effects that has these regimes and their sizes by name; for ``--effects``."""
    head = '"""Effects that a diagnosis found: forces that the model lacks in some regimes of operation."""'
    imports = "from math import inf\n\nfrom seatrial.hybrid.effects import Regime, regime_effect"
    entries = []
    for name, (regime, typical) in regimes.items():
        within = ", ".join(f'"{quantity}": ({low!r}, {high!r})' for quantity, (low, high) in regime.within.items())
        growth = f', "{regime.grows_with}", {regime.at!r}' if regime.grows_with else ""
        call = f'Regime("{regime.axis}", {{{within}}}{growth})'
        entries.append(f'    regime_effect("{name}", {call}, {abs(typical)!r}),')
    return "\n".join([head, "", imports, "", "EFFECTS = [", *entries, "]", ""])
