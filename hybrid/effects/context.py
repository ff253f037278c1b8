"""What is known of a trial beforehand, and what a diagnosis and an identification leave out for it.

A context is declared in the trial's file, in the vessel's file, or by options. What cannot be there is not
searched, so that it does not stand for something else; what is known belongs to the model.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import TypeVar, get_args

from seatrial.acquisition.config import run_sheet
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Trial
from seatrial.hybrid.effects import Catalogue, Effect, effect_named, parse_effects, simulator_with
from seatrial.hybrid.vessel.black_box import BlackBox
from seatrial.hybrid.vessel.effect import Values
from seatrial.hybrid.vessel.files import Vessel, add_effects

AnyShip = TypeVar("AnyShip", bound=Vessel | BlackBox)


@dataclass(frozen=True, slots=True)
class PossibleDeclaration:
    """A declaration that was not made, and the ``effects`` that it would rule out."""

    declaration: str
    effects: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class DeclaredContext:
    """What was known of the trial beforehand: the declarations, the ``known`` effects, and what they exclude.

    ``excluded`` are effects that are not searched, and surroundings that are not fitted, for what was declared;
    ``would_exclude`` are declarations that were not made and would rule out effects that were named or suspected.
    """

    declared: tuple[str, ...] = ()
    known: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    excluded: tuple[str, ...] = ()
    would_exclude: tuple[PossibleDeclaration, ...] = ()


def declared_context(
    catalogue: Catalogue,
    *,
    still_water: bool = False,
    no_waves: bool = False,
    no_wind: bool = False,
    surveyed: Sequence[str] = (),
    known: Mapping[str, Values] | Iterable[str] = (),
) -> run_sheet.Context:
    """A context from options; ``known`` as a mapping or as ``EFFECT:PARAMETER=VALUE``.

    Raises :class:`ConfigurationError` for what can be neither surveyed nor known.
    """
    for kind in surveyed:
        if kind not in get_args(run_sheet.SurveyKind):
            raise ConfigurationError(
                f"{kind!r} cannot be surveyed",
                where="--surveyed",
                fix=f"give {', '.join(get_args(run_sheet.SurveyKind))}",
            )
    values = known if isinstance(known, Mapping) else parse_effects(known, catalogue)
    return run_sheet.Context(
        still_water=still_water, no_waves=no_waves, no_wind=no_wind,
        surveyed=tuple(surveyed),  # type: ignore[arg-type] # checked above
        known={name: dict(parameters) for name, parameters in values.items()},
    )  # fmt: skip


def context_of_recordings(
    trials: Mapping[Path, Trial], vessel: AnyShip, declared: run_sheet.Context
) -> run_sheet.Context:
    """What is declared by options, in the vessel's file, or of all recordings, each with the file beside it.

    Raises :class:`ConfigurationError` for a file that cannot be read.
    """
    statements = {path: run_sheet.statement_from_text(run_sheet.read_statement_text(None, path)) for path in trials}
    return context_of([statements[path].apply_to_trial(trial) for path, trial in trials.items()], vessel, declared)


def context_of(trials: Iterable[Trial], vessel: AnyShip, declared: run_sheet.Context) -> run_sheet.Context:
    """What is declared by options, in the vessel's file, or in all of the trials.

    An effect that may be in one recording has to be searched.
    """
    carried = [run_sheet.context_in_trial(trial) for trial in trials] or [run_sheet.Context()]
    return reduce(run_sheet.Context.shared_with, carried).joined_with(vessel.context).joined_with(declared)


def searched_effects(catalogue: Catalogue, context: run_sheet.Context) -> dict[str, Effect]:
    """The effects of a catalogue that a context neither rules out nor knows."""
    declarations = set(context.declarations)
    return {
        name: effect
        for name, effect in catalogue.items()
        if not declarations.intersection(effect.excluded_by) and name not in context.known
    }


def with_known_effects(vessel: AnyShip, context: run_sheet.Context, catalogue: Catalogue) -> AnyShip:
    """The vessel or simulator with the effects of known sizes. Raises :class:`ConfigurationError` for no effect."""
    try:
        effects = {
            name: effect_named(name, catalogue).complete_values(values) for name, values in context.known.items()
        }
    except ConfigurationError as error:
        raise error.at("[context.known]") from error
    if isinstance(vessel, BlackBox):
        return simulator_with(vessel, effects)  # type: ignore[return-value] # of its own kind
    return add_effects(vessel, effects) if effects else vessel  # type: ignore[return-value]


def excluding_declarations(
    effects: Iterable[Effect], context: run_sheet.Context, refuted: Collection[str] = ()
) -> tuple[PossibleDeclaration, ...]:
    """The declarations that were not made and would each rule out some of ``effects``; none that is ``refuted`` by
    the recordings."""
    proposed = dict[str, tuple[str, ...]]()
    for effect in effects:
        for declaration in effect.excluded_by:
            if declaration not in (*context.declarations, *refuted):
                proposed[declaration] = (*proposed.get(declaration, ()), effect.base)
    return tuple(PossibleDeclaration(declaration, names) for declaration, names in proposed.items())


def option_of(declaration: str) -> str:
    """The option that makes a declaration.

    >>> option_of("still water"), option_of("yaw rate surveyed")
    ('--still-water', '--surveyed yaw_rate')
    """
    kind = declaration.removesuffix(" surveyed")
    return f"--surveyed {kind.replace(' ', '_')}" if kind != declaration else f"--{kind.replace(' ', '-')}"
