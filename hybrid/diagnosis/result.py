"""Results of a diagnosis: how they print, and how they are written and read.

The serialised fields, in their order, are ``diagnosis.json`` and ``ladder.json``, whose form is a contract
(:mod:`seatrial.acquisition.core.quantities`). ``shown.json`` has what else the page shows, ``map.parquet`` the
missing force second by second and ``tracks.parquet`` the held-out windows, measured and predicted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field, computed_field

from seatrial.acquisition.core import errors, files
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.result import Number, from_json, to_json
from seatrial.analysis.estimation.process_models import correlated_pairs
from seatrial.analysis.tables.export import read_parquet, write_parquet
from seatrial.hybrid.effects.context import DeclaredContext
from seatrial.hybrid.prediction.baselines import Interval

Verdict = Literal["named", "nothing_missing", "unknown", "indistinguishable"]

FORCES = ("surge_force_n", "sway_force_n", "yaw_moment_nm")
"""The forces of a map: surge, sway and yaw."""

DIAGNOSIS, SHOWN, LADDER = "diagnosis.json", "shown.json", "ladder.json"
MAP, TRACKS = "map.parquet", "tracks.parquet"
_WAYS = ("measured", "before", "after", "floor", "constant_velocity")
_CONTROL = "control_"
_TRACK = ("north_m", "east_m", "heading_rad")

_UNITS = {
    "_m": "m",
    "_rad": "rad",
    "_s": "s",
    "_mps": "m/s",
    "_dps": "deg/s",
    "_deg": "deg",
    "rpm": "rpm",
    "_percent": "%",
}
"""Units by the endings of names, in their printed form."""


@dataclass(frozen=True, slots=True)
class Estimate(Interval):
    """A parameter's value with its 95 % interval, in its unit."""

    unit: str


@dataclass(frozen=True, slots=True)
class RankedEffect:
    """One effect of the catalogue in the ranking.

    ``evidence`` is the log odds by which the model is better with it alone, ``p_value`` is corrected for the
    size of the catalogue. ``limit`` is the size of the first parameter that would be found in 9 of 10 such
    trials.
    """

    name: str
    family: str
    evidence: Number
    p_value: Number
    limit: Number
    unit: str


@dataclass(frozen=True, slots=True)
class Suspect:
    """An effect that was found in some parts of a trial, ``found_in``, but does not replicate: it is not named."""

    name: str
    found_in: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Replication:
    """In how many ``parts`` of a trial an effect is ``found`` with its sign in the whole: in disjoint ones, or by a
    coarse model in the halves that choose it."""

    parts: int
    found: int


@dataclass(frozen=True, slots=True)
class When:
    """The part of a trial in which an effect has the given size: a recording, until or since a time (UTC).

    ``low`` and ``high`` are the ends of the 95 % interval of that time.
    """

    recording: str | None = None
    since: str | None = None
    until: str | None = None
    low: str | None = None
    high: str | None = None


@dataclass(frozen=True, slots=True)
class EffectDrift:
    """The size from which an effect drifted linearly to its own, ``since`` one time ``until`` another (UTC)."""

    since: str
    until: str
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """A named effect, with its share of the gap on windows not used for fitting.

    ``scope`` is the ship, the day or a recording. An effect that varies over the trial has one entry for each
    part, each with its ``when``; the share of the gap, the p-value and the replication are those of the whole.
    ``in_vessel`` says whether it is still present at the end and belongs to the ship, and so is written to the
    vessel file.
    """

    name: str
    family: str
    kind: str
    share_of_gap: Number
    p_value: Number
    sentence: str
    parameters: Mapping[str, Estimate]
    replicated: Replication
    evidence: Annotated[Number, Field(exclude=True)]
    scope: str = "ship"
    when: When | None = None
    drift: EffectDrift | None = None
    in_vessel: bool = True

    @property
    def part_of_trial(self) -> str:
        """The part of the trial of these sizes, for a table; empty if all of it."""
        if self.when is None:
            return "" if self.drift is None else f" at {self.drift.until}"
        if self.when.recording is not None:
            return f" in {self.when.recording}"
        return f" until {self.when.until}" if self.when.until else f" since {self.when.since}"


@dataclass(frozen=True, slots=True)
class Rival:
    """An effect that would explain almost as much ``instead_of`` a named one: ``evidence`` it lacks, log odds."""

    instead_of: str
    name: str
    evidence: Number


@dataclass(frozen=True, slots=True)
class UnknownCause:
    """What no effect of the catalogue explains: its share of the gap, what it depends on, what it resembles."""

    share_of_gap: Number
    where: tuple[str, ...]
    looks_like: str


@dataclass(frozen=True, slots=True)
class Remainder:
    """What remains unexplained beside the named effects: its share of the force range and of the gap, what it
    depends on, what it resembles."""

    share_of_range: Number
    share_of_gap: Number
    where: tuple[str, ...]
    looks_like: Annotated[str, Field(exclude=True)] = ""


@dataclass(frozen=True, slots=True)
class RegimeEffect:
    """A force that the model lacks in an operating regime, written as an effect
    (:mod:`seatrial.hybrid.effects`).

    ``within`` has the ends of each quantity's span, None if open; ``parameters`` its size; ``share_of_force``
    its share of the missing force of its axis, ``after_m`` the mean distance on held-out legs with it and those
    before it [m].
    """

    name: str
    sentence: str
    axis: str
    within: Mapping[str, tuple[float | None, float | None]]
    grows_with: str | None
    at: Number
    parameters: Mapping[str, Estimate]
    share_of_force: Number
    replicated: Replication
    after_m: Number


@dataclass(frozen=True, slots=True)
class GapCell:
    """One cell of the map of where model and trial disagree: mean ``error`` of a channel there, and its z."""

    channel: str
    cell: Mapping[str, tuple[float, float]]
    windows: int
    error: Number
    z: Number


@dataclass(frozen=True, slots=True)
class Gap:
    """Mean distance of predicted from measured tracks [m], over windows not used for naming or fitting.

    ``constant_velocity_m`` is that of keeping surge, sway and yaw rate of a window's start.
    """

    before_m: Number
    after_m: Number
    floor_m: Number
    constant_velocity_m: Number
    held_out_windows: int
    horizon_s: Annotated[int, Field(exclude=True)]

    @computed_field  # type: ignore[prop-decorator]
    @property
    def closed(self) -> float:
        """The share closed of the gap that could be closed; of none, all, unless the predictions became worse."""
        closable = self.before_m - self.floor_m
        return (self.before_m - self.after_m) / closable if closable > 0.0 else float(self.after_m <= self.before_m)

    def distances_text(self, named: bool) -> str:
        """The distances in words, for a terminal; before and after only where effects were named."""
        if not named:
            return f"{self.before_m:.3f} m" + (f", {self.floor_m:.3f} m at best" * (self.floor_m < self.before_m))
        return f"{self.before_m:.3f} m before, {self.after_m:.3f} m after, {self.floor_m:.3f} m at best"


@dataclass(frozen=True, slots=True)
class Tracks:
    """Windows of H seconds [N]: measured and predicted tracks [N, H+1, 3] (north, east [m], heading [rad]).

    ``before`` is the reference model's, ``after`` that with the effects from other legs, ``floor`` that with
    the effects from all legs; ``constant_velocity`` keeps the initial speeds. ``leg`` and ``start_s`` [N]
    locate the windows, ``controls`` has the actuator channels [N, H+1].
    """

    measured: Floats
    before: Floats
    after: Floats
    floor: Floats
    constant_velocity: Floats
    leg: Ints
    start_s: Ints
    controls: Mapping[str, Floats]


@dataclass(frozen=True, slots=True)
class Ratio:
    """The mean distance ``of`` one model over that of another, ``to``, paired, with its 95 % interval."""

    of: str
    to: str
    value: Number
    low: Number
    high: Number


@dataclass(frozen=True, slots=True)
class CalibratorComparison:
    """The gain of a calibrator: mean distances [m] by model, with 95 % intervals over legs, on held windows of
    held-out legs.

    The models are constant_velocity, reference, named, reference_calibrated and named_calibrated, those of the
    named model only if something was named. Without models ``why_not`` gives the reason.
    """

    horizon_s: int
    method: str
    windows: int = 0
    legs: int = 0
    mean_distance_m: Mapping[str, Interval] = field(default_factory=dict)
    ratios: tuple[Ratio, ...] = ()
    why_not: str | None = None

    def ratio(self, of: str, to: str) -> Ratio:
        """The ratio of two models. Raises :class:`StopIteration` if it is none of :attr:`ratios`."""
        return next(ratio for ratio in self.ratios if (ratio.of, ratio.to) == (of, to))


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlations of the estimates of the named effects: ``names`` of free coordinates, ``matrix`` [P, P]."""

    names: tuple[str, ...]
    matrix: Floats

    def correlated_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs whose sizes these data cannot separate, with their correlation."""
        return correlated_pairs(self.names, self.matrix)


@dataclass(frozen=True, slots=True)
class NextTrial:
    """The next trial: the manoeuvre, the effects it separates, and the evidence expected from it."""

    what: str
    separates: tuple[str, str]
    expected_evidence: Number
    minutes: Annotated[float, Field(exclude=True)]


@dataclass(frozen=True, slots=True)
class IdentifiedCorrection:
    """A refit of the model's coefficients that a diagnosis starts from, and how much the model structure can
    close.

    ``before_m`` and ``after_m`` are mean distances over windows of held-out legs, of the model as it was and
    with the coefficients fitted to the other legs; ``applied`` says whether the diagnosis starts from the
    refit, which it does if it improves these. ``forces`` are the changes of the forces by the refit to all
    legs, root mean square along the trial as shares of the force range; ``coefficients`` are its values and
    ``start`` the ones before; ``known`` are those that the data determine.
    """

    applied: bool
    constant_velocity_m: Number
    before_m: Number
    after_m: Number
    held_out_windows: int
    forces: Mapping[str, Number]
    coefficients: Mapping[str, Estimate]
    start: Mapping[str, Number]
    known: tuple[str, ...]
    name: str = "identified_correction"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The named effects, how certain they are, and how they change predictions: ``diagnosis.json``."""

    verdict: Verdict
    tolerance: float
    effects: tuple[NamedEffect, ...]
    rivals: tuple[Rival, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    unknown: UnknownCause | None
    where: tuple[GapCell, ...]
    gap: Gap
    next_manoeuvre: NextTrial | None
    ranking: Annotated[tuple[RankedEffect, ...], Field(exclude=True)] = ()
    tracks: Annotated[Tracks | None, Field(exclude=True)] = None
    remarks: tuple[str, ...] = ()
    remainder: Remainder | None = None
    regimes: tuple[RegimeEffect, ...] = ()
    suspects: tuple[Suspect, ...] = ()
    context: DeclaredContext = field(default_factory=DeclaredContext)
    identified: IdentifiedCorrection | None = None
    indices: tuple[Mapping[str, Any], ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The JSON object; numbers that are not finite are None."""
        return dict(to_json(self))

    def __str__(self) -> str:
        """The verdict, the effects with their 95 % intervals and the gap, as a short table."""
        lines = [f"{self.verdict.replace('_', ' ')}, {100.0 * self.tolerance:g} % of the force range tolerated"]
        rows = [
            (
                f"{effect.name}{effect.part_of_trial}",
                name,
                f"{size.value:.4g}",
                f"{size.low:.4g} to {size.high:.4g}",
                size.unit,
            )
            for effect in self.effects
            for name, size in effect.parameters.items()
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        if self.unknown is not None:
            lines.append(f"unknown: {self.unknown.looks_like}")
        if self.remainder is not None:
            lines.append(f"remains: {self.remainder.looks_like}")
        gap = self.gap
        windows = f"({gap.held_out_windows} held-out windows)"
        lines.append(f"mean distance over {gap.horizon_s} s: {gap.distances_text(bool(self.effects))} {windows}")
        return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Map:
    """Where model and trial disagree: all cells, and the missing force second by second.

    ``force`` [T, 3] is the reconstructed slow force [N, N, N m], ``quantities`` [T] are those of the cells.
    """

    places: tuple[GapCell, ...]
    force: Floats
    quantities: dict[str, Floats]


@dataclass(frozen=True, slots=True)
class SensorContradiction:
    """A contradiction between sensors: the sensor fault that explains it best, and its size.

    ``free`` and ``standard_errors`` are of its free coordinates, in the units of its parameters; ``p_value`` is
    corrected for the number of effects tested. ``alike`` are effects that are indistinguishable without a ship
    model.
    """

    effect: str
    free: tuple[Number, ...]
    standard_errors: tuple[Number, ...]
    p_value: Number
    alike: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True)
class Extras:
    """What the page shows besides the diagnosis: the maps of the reference model and of the repaired one,
    contradictions between sensors, correlations of the estimates, and the gain of a calibrator (None if not
    computed)."""

    map: Map | None = None
    map_after: Map | None = None
    consistency: tuple[SensorContradiction, ...] | None = None
    comparison: CalibratorComparison | None = None
    correlation: Correlation | None = None

    @property
    def maps(self) -> dict[str, Map | None]:
        """Both maps, before and after."""
        return {"before": self.map, "after": self.map_after}


@dataclass(frozen=True, slots=True)
class FigureData:
    """The content of ``shown.json``: what the page shows and ``diagnosis.json`` does not have.

    ``evidence`` is by named effect, ``minutes`` those of the next manoeuvre, ``cells`` those of the maps before
    and after; ``remainder_looks_like`` says what the forces that remain beside named effects resemble.
    """

    horizon_s: int
    evidence: Mapping[str, Number]
    minutes: float | None
    suspects: tuple[RankedEffect, ...]
    cells: Mapping[str, tuple[GapCell, ...] | None]
    consistency: tuple[SensorContradiction, ...] | None
    correlation: Correlation | None
    remainder_looks_like: str = ""


def write_figure_data(diagnosis: Diagnosis, extras: Extras, folder: Path) -> None:
    """Write all but page and vessel, removing files of an earlier diagnosis. Raises :class:`StorageError`."""
    request = diagnosis.next_manoeuvre
    shown = FigureData(
        horizon_s=diagnosis.gap.horizon_s,
        evidence={effect.name: effect.evidence for effect in diagnosis.effects},
        minutes=None if request is None else request.minutes,
        suspects=diagnosis.ranking,
        cells={name: None if force_map is None else force_map.places for name, force_map in extras.maps.items()},
        consistency=extras.consistency,
        correlation=extras.correlation,
        remainder_looks_like="" if diagnosis.remainder is None else diagnosis.remainder.looks_like,
    )
    results = ((DIAGNOSIS, diagnosis, 2), (SHOWN, shown, None), (LADDER, extras.comparison, 2))
    maps = [
        pd.DataFrame({"map": name, **dict(zip(FORCES, force_map.force.T, strict=True)), **force_map.quantities})
        for name, force_map in extras.maps.items() if force_map is not None
    ]  # fmt: skip
    map_table = pd.concat(maps, ignore_index=True) if maps else None
    tables = ((MAP, map_table), (TRACKS, _tracks_table(diagnosis.tracks)))
    with files.written_together(folder / DIAGNOSIS):
        for name, result, indent in results:
            if result is None:
                files.remove_file(folder / name)
            else:
                files.write_text(folder / name, json.dumps(to_json(result), indent=indent) + "\n")
        for name, table in tables:
            if table is None:
                files.remove_file(folder / name)
            else:
                units = {str(column): unit for column in table for ending, unit in _UNITS.items()
                         if str(column).endswith(ending)}  # fmt: skip
                units |= {
                    force: unit for force, unit in zip(FORCES, ("N", "N", "N m"), strict=True) if force in table
                }
                write_parquet(table, folder / name, units, {})


def read_diagnosis(folder: Path | str) -> tuple[Diagnosis, Extras]:
    """Read a diagnosis, and what else its page shows, from the ``folder`` of ``seatrial diagnose``.

    Parameters
    ----------
    folder
        The ``output`` of :func:`seatrial.diagnose`.

    Returns
    -------
    diagnosis : Diagnosis
        The verdict, the effects named, and the gap before and after.
    extras : Extras
        What its page shows beside it: the maps of the gap, the consistency, the comparison of calibrators.

    Raises
    ------
    InputError
        For a folder without one, or with one of another version.

    Examples
    --------
    >>> import seatrial as st
    >>> run = st.diagnose("trial.mcap", output="diagnosis")
    >>> diagnosis, extras = st.load_diagnosis("diagnosis")
    >>> diagnosis.verdict == run.diagnosis.verdict
    True
    """
    folder = Path(folder)
    stored, shown = read_json(folder / DIAGNOSIS), read_json(folder / SHOWN)
    try:
        data = from_json(FigureData, shown)
        for effect in stored["effects"]:
            effect["evidence"] = data.evidence[effect["name"]]
        stored["gap"]["horizon_s"] = data.horizon_s
        if stored["next_manoeuvre"] is not None:
            stored["next_manoeuvre"]["minutes"] = data.minutes
        if stored["remainder"] is not None:
            stored["remainder"]["looks_like"] = data.remainder_looks_like
        tracks = _tracks_of(read_parquet(folder / TRACKS)[0]) if (folder / TRACKS).is_file() else None
        diagnosis = replace(from_json(Diagnosis, stored), ranking=data.suspects, tracks=tracks)
        comparison = (
            from_json(CalibratorComparison, read_json(folder / LADDER)) if (folder / LADDER).is_file() else None
        )
        maps: list[Map | None] = [None, None]
        if (folder / MAP).is_file():
            table = read_parquet(folder / MAP)[0]
            for number, name in enumerate(("before", "after")):
                rows, places = table[table["map"] == name].drop(columns="map"), data.cells[name]
                quantities = {
                    str(column): rows[column].to_numpy(dtype=float) for column in rows if column not in FORCES
                }
                force = rows[list(FORCES)].to_numpy(dtype=float)
                maps[number] = None if places is None else Map(places, force, quantities)
        return diagnosis, Extras(maps[0], maps[1], data.consistency, comparison, data.correlation)
    except Exception as error:  # what others wrote into it may fail in every possible way
        raise errors.InputError("was not written by this version", where=str(folder), why=str(error),
                         fix="run `seatrial diagnose` again") from error  # fmt: skip


def _tracks_table(tracks: Tracks | None) -> pd.DataFrame | None:
    """One row for each window and second; columns like ``before_north_m`` and ``control_port_rpm``."""
    if tracks is None:
        return None
    windows, seconds = tracks.measured.shape[:2]
    columns = {
        "window": np.repeat(np.arange(windows), seconds),
        "second": np.tile(np.arange(seconds), windows),
        "leg": np.repeat(tracks.leg, seconds),
        "start_s": np.repeat(tracks.start_s, seconds),
    }
    for way in _WAYS:
        values = getattr(tracks, way).reshape(-1, len(_TRACK))
        columns |= {f"{way}_{name}": values[:, number] for number, name in enumerate(_TRACK)}
    controls = {f"{_CONTROL}{name}": values.ravel() for name, values in tracks.controls.items()}
    return pd.DataFrame({**columns, **controls})


def _tracks_of(table: pd.DataFrame) -> Tracks:
    windows = int(table["window"].nunique())
    first = table[table["second"] == 0]
    ways = {
        way: table[[f"{way}_{name}" for name in _TRACK]].to_numpy(dtype=float).reshape(windows, -1, len(_TRACK))
        for way in _WAYS
    }
    controls = {
        str(name).removeprefix(_CONTROL): table[name].to_numpy(dtype=float).reshape(windows, -1)
        for name in table if str(name).startswith(_CONTROL)
    }  # fmt: skip
    window_columns = {name: first[name].to_numpy(dtype=np.int64) for name in ("leg", "start_s")}
    return Tracks(**ways, **window_columns, controls=controls)


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object. Raises :class:`InputError` for anything else."""
    try:
        return dict(files.read_json(path))
    except FileNotFoundError as error:
        raise errors.InputError(
            "does not exist", where=str(path), fix="give the output folder of `seatrial diagnose`"
        ) from error
    except (OSError, ValueError, TypeError) as error:
        raise errors.InputError("cannot be read", where=str(path), why=str(error)) from error
