"""The catalogue: every effect by its name, users' own beside the built-in ones.

To add an effect to Seatrial, write one :class:`Effect` in the file of its family and one line here. To add
one of your own, write a Python file with ``EFFECTS = [Effect(...), ...]`` and give it to the command line.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from acquisition.core.errors import ConfigurationError
from hybrid.effects import alignment, clock, environment, hull, hull_shape, inertia, propulsion, sensors
from hybrid.effects.effect import Effect, Values
from hybrid.vessel.parameters import Vessel
from hybrid.vessel.plant import Plant, bare_plant

Catalogue = Mapping[str, Effect]

VERSION = "2"
"""Stated with every verdict; to be raised when an effect is added, removed or changes its form."""

CATALOGUE: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        inertia.LOADING,
        inertia.SURGE_ADDED_MASS,
        inertia.SWAY_ADDED_MASS,
        inertia.YAW_INERTIA,
        hull.HULL_FOULING,
        hull.CROSS_FLOW_DRAG,
        hull.DRIFT_FORCE,
        hull.DRIFT_MOMENT,
        hull.TURNING_FORCE,
        hull.TURNING_DRAG,
        hull.YAW_DAMPING,
        hull.TRIM,
        hull.SKEG,
        hull.TOWED_LOAD,
        hull_shape.HULL_LENGTHENING,
        hull_shape.SHALLOW_WATER,
        propulsion.THRUST_LOSS_PORT,
        propulsion.THRUST_LOSS_STARBOARD,
        propulsion.THRUST_LOSS_BOTH,
        propulsion.WAKE_FRACTION,
        propulsion.POD_SIDE_FORCE,
        propulsion.TUNNEL_THRUST_LOSS,
        alignment.AZIMUTH_OFFSET_PORT,
        alignment.AZIMUTH_OFFSET_STARBOARD,
        alignment.AZIMUTH_OFFSET_BOTH,
        alignment.AZIMUTH_SCALE,
        alignment.YAW_ASYMMETRY,
        alignment.SWAY_ASYMMETRY,
        environment.OCEAN_CURRENT,
        environment.WAVE_DRIFT,
        environment.WIND_LOAD,
        environment.WIND_DRAG,
        environment.WIND_SIDE_LOAD,
        environment.WIND_YAW_LOAD,
        clock.POSITION_DELAY,
        clock.HEADING_DELAY,
        clock.SPEED_DELAY,
        clock.COMMAND_DELAY,
        clock.THRUSTER_LAG,
        sensors.HEADING_BIAS,
        sensors.POSITION_ANTENNA_OFFSET,
        sensors.SPEED_SENSOR_OFFSET,
        sensors.SPEED_SENSOR_ROTATION,
        sensors.SPEED_SCALE,
        sensors.SWAY_BIAS,
        sensors.YAW_RATE_BIAS,
        sensors.YAW_RATE_SCALE,
        sensors.WIND_DIRECTION_BIAS,
        sensors.WIND_SPEED_SCALE,
    )
}


def effect_named(name: str, catalogue: Catalogue = CATALOGUE) -> Effect:
    """The effect of that name, or :class:`ConfigurationError` that lists what is possible."""
    if name in catalogue:
        return catalogue[name]
    near = get_close_matches(name, catalogue, n=1)
    hint = f"did you mean {near[0]}? All: " if near else "use one of "
    raise ConfigurationError(f"no effect {name!r} in the catalogue", fix=hint + ", ".join(catalogue))


def apply_effects(plant: Plant, effects: Mapping[str, Values], catalogue: Catalogue = CATALOGUE) -> Plant:
    """``plant`` with each named effect at its values, in the order given."""
    for name, values in effects.items():
        plant = effect_named(name, catalogue).apply(plant, values)
    return plant


def vessel_plant(vessel: Vessel, catalogue: Catalogue = CATALOGUE) -> Plant:
    """The plant of a vessel as its file states it, with the effects that the file adds."""
    return apply_effects(bare_plant(vessel), vessel.effects, catalogue)


def catalogue_with(files: Iterable[str | Path] = (), without: Iterable[str] = ()) -> dict[str, Effect]:
    """The catalogue with users' files added and some effects left out.

    What a user's effect is confused with is told of that other, too.
    """
    catalogue = dict(CATALOGUE)
    for file in files:
        own = load_effects(file)
        catalogue |= own
        for effect in own.values():
            for rival in effect.confused_with:
                other = effect_named(rival, catalogue)
                if effect.name not in other.confused_with:
                    catalogue[rival] = replace(other, confused_with=(*other.confused_with, effect.name))
    for name in without:
        del catalogue[effect_named(name, catalogue).name]
    return catalogue


def load_effects(path: str | Path) -> dict[str, Effect]:
    """The effects of a user's Python file, which has a list ``EFFECTS`` of :class:`Effect`.

    The file is executed. Raises :class:`ConfigurationError` if that fails or the list is not there.
    """
    file = Path(path)
    spec = spec_from_file_location(f"seatrial_effects_{file.stem}", file)
    if not file.is_file() or spec is None or spec.loader is None:
        raise ConfigurationError("is no Python file", where=str(path), fix="give a file ending in .py")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ConfigurationError(
            "fails when it is read", where=str(path), why=f"{type(error).__name__}: {error}"
        ) from error
    effects: Any = getattr(module, "EFFECTS", None)
    if not isinstance(effects, list | tuple) or not all(isinstance(each, Effect) for each in effects):
        raise ConfigurationError(
            "has no list of effects",
            where=str(path),
            fix="define EFFECTS = [Effect(...), ...] with Effect from hybrid.effects",
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
    name, _, rest = text.partition(":")
    effect = effect_named(name.strip(), catalogue)
    possible = ",".join(f"{each.name}={each.typical:g}" for each in effect.parameters)
    values: dict[str, float] = {}
    for part in filter(None, rest.split(",")):
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
    effect.checked(values)
    return effect.name, values
