"""The catalogue of effects that a model may lack: what each is, and what it does to a plant.

The catalogue: every effect by its name, users' own beside the built-in ones.

The effects of the actuators follow from a ship's list of them (:func:`catalogue_for`); :data:`CATALOGUE` is that
of the default list. To add an effect to Seatrial, write one :class:`.Effect` into the list in the file of its
subject. To add one of your own, write a Python file with ``EFFECTS = [Effect(...), ...]`` and give it to the
command line.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.named_code import load
from seatrial.acquisition.core.ship import DEFAULT, Actuators
from seatrial.hybrid.effects import environment, hull
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.effect import FAMILIES, USUAL_LENGTH_M, Effect, Parameter, Values, growth, scale_of
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant

Catalogue = Mapping[str, Effect]

VERSION = "6"
"""Stated with every verdict; to be raised when an effect is added, removed or changes its form."""


@lru_cache(maxsize=32)
def _catalogue_for(actuators: Actuators, scale: float) -> dict[str, Effect]:
    names = {kind: tuple(actuator.name for actuator in actuators if actuator.kind == kind) for kind in KINDS}
    effects = [effect for kind, of_kind in names.items() if of_kind for effect in KINDS[kind].effects(of_kind)]
    actuator_effects = sorted(effects, key=lambda effect: FAMILIES.index(effect.family))
    unsized = (*hull.EFFECTS, *actuator_effects, *hull.ASYMMETRY, *environment.EFFECTS, *environment.SENSOR_EFFECTS)

    def scaled(parameter: Parameter) -> Parameter:
        factor = growth(parameter.unit, scale)
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


def catalogue_for(actuators: Actuators, length_m: float = USUAL_LENGTH_M) -> dict[str, Effect]:
    """The catalogue of a ship with these actuators: what any ship may lack, and the effects of each actuator.

    Typical sizes scale with the ship's length.
    """
    return dict(_catalogue_for(actuators, scale_of(length_m)))


def catalogue_of(vessel: Vessel) -> dict[str, Effect]:
    """The catalogue of a vessel."""
    return catalogue_for(vessel.actuators, vessel.dimensions.length_between_perpendiculars_m)


def effect_named(name: str, catalogue: Catalogue | None = None) -> Effect:
    """The effect of that name, or :class:`ConfigurationError` that lists what is possible."""
    catalogue = CATALOGUE if catalogue is None else catalogue
    if name in catalogue:
        return catalogue[name]
    near = get_close_matches(name, catalogue, n=1)
    hint = f"did you mean {near[0]}? All: " if near else "use one of "
    raise ConfigurationError(f"no effect {name!r} in the catalogue", fix=hint + ", ".join(catalogue))


CATALOGUE: dict[str, Effect] = catalogue_for(DEFAULT)
"""The catalogue of the default list of actuators, R/V Gunnerus'."""


def apply_effects(plant: Plant, effects: Mapping[str, Values], catalogue: Catalogue | None = None) -> Plant:
    """``plant`` with each named effect at its values, in the order given; by default those of its own catalogue."""
    if catalogue is None:
        catalogue = _catalogue_for(plant.layout, scale_of(plant.length_between_perpendiculars_m))
    for name, values in effects.items():
        plant = effect_named(name, catalogue).apply(plant, values)
    return plant


def vessel_plant(vessel: Vessel, catalogue: Catalogue | None = None) -> Plant:
    """The plant of a vessel as its file states it, with the effects that the file adds."""
    return apply_effects(bare_plant(vessel), vessel.effects, catalogue)


def catalogue_with(
    files: Iterable[str | Path] = (), without: Iterable[str] = (), vessel: Vessel | None = None
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
    effects: Any = load(f"{path}:EFFECTS" if str(path).endswith(".py") else str(path), "effects")
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
    effect.checked(values)
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
