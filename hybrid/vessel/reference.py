"""The reference model: of the ship that the recordings name, unless another is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from acquisition.config.vessel_file import vessel_names, vessel_of_ship
from acquisition.core.errors import InputError
from acquisition.core.result import ChosenModel
from acquisition.core.trial import Trial
from acquisition.recording.reader import read_trial
from hybrid.vessel.files import DEFAULT, load_vessel, locate_vessel
from hybrid.vessel.parameters import Vessel

Trials = Mapping[Path, Trial]
"""What recordings, or the configuration of one to come, say of themselves, by their paths."""


@dataclass(frozen=True, slots=True)
class ReferenceModel:
    """A vessel as the model of recordings, where it comes from, and what is to be said of that.

    ``file`` is the name of one of Seatrial's own or a path, and means the same from any folder.
    """

    vessel: Vessel
    file: str
    said: ChosenModel


def trials_of(recordings: Iterable[Path]) -> Trials:
    """The run sheets of recordings. Raises :class:`InputError` for what is none."""
    return {path: read_trial(path) for path in map(Path, recordings)}


def reference_model(trials: Trials, vessel: str | Path | Vessel | None = None) -> ReferenceModel:
    """The model of recordings: ``vessel``, else the vessel file of the ship that they name.

    That is one of Seatrial's own, or a file beside the recording or in the working directory. Recordings that name
    no ship and have R/V Gunnerus' actuators, as all had before ships were told apart, are hers. Raises
    :class:`InputError` where no ship is named, no file is of her, or recordings are of several ships.
    """
    if isinstance(vessel, Vessel):
        return ReferenceModel(vessel, vessel.name, chosen(vessel.name, ships_of(vessel), trials))
    file = locate_vessel(str(vessel or _named_by(trials)))
    ship = load_vessel(file)
    name = ship.name if Path(file).stem == ship.name else f"{ship.name} ({Path(file).name})"
    return ReferenceModel(ship, file, chosen(name, ships_of(ship) | {Path(file).stem}, trials))


def ships_of(vessel: Vessel) -> set[str]:
    """The names of the ships that a vessel is a model of: with its own that of the model it was made from."""
    made_from = {str(vessel.provenance.get(key, "")) for key in ("diagnosis_vessel", "identified_start")}
    base = set() if vessel.name in vessel_names() else {Path(vessel.base).stem}
    return {vessel.name, *base, *made_from}


def chosen(name: str, ships: set[str], trials: Trials) -> ChosenModel:
    """A model that is called ``name`` and is one of ``ships``, and whether the recordings name another."""
    named = [trial.vessel for trial in trials.values()]
    one = "the recording names" if len(named) == 1 else "the recordings name"
    others = sorted({Path(each).stem if each.endswith(".toml") else each for each in named if each} - ships)
    if others:
        return ChosenModel(name, f", not the ship that {one} ({', '.join(others)})")
    return ChosenModel(name, "" if all(named) else f"; {one} no ship" if not any(named) else "; some name no ship")


def _named_by(trials: Trials) -> str:
    """The vessel file of the one ship that recordings name."""
    named = {path: trial.vessel for path, trial in trials.items() if trial.vessel}
    ships = sorted(set(named.values()))
    if len(ships) > 1:
        raise InputError(
            f"the recordings are of different ships: {', '.join(ships)}",
            fix="give those of one ship, or say with --vessel whose model is meant",
        )
    for path, ship in named.items():
        if found := vessel_of_ship(ship, path.parent):
            return str(found)
    unknown = [path for path, trial in trials.items() if trial.vessel or trial.actuators]
    if not unknown:
        return DEFAULT
    what = f"names the ship {ships[0]!r}, of which there is no vessel file" if ships else "names no ship"
    raise InputError(
        what, where=str(unknown[0]),
        fix=f"say with --vessel which of {', '.join(vessel_names())} she is, or give her file, or put it beside "
        "the recording; `seatrial vessel new` makes one",
    )  # fmt: skip
