"""A trial with all that its report is made from: recordings analysed, predictions judged, residuals, parameters.

Read once, each part made when it is first asked for, so that a notebook that shows less does less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.config.declarations import vessel_of_ship
from seatrial.acquisition.config.run_sheet import statement_from_text
from seatrial.acquisition.core.errors import ConfigurationError, DataShortageError, InputError, SeatrialError
from seatrial.acquisition.core.result import ChosenModel
from seatrial.acquisition.core.ship import MOTION
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_trial
from seatrial.analysis.conditions import recorded_conditions
from seatrial.analysis.estimation.smoother import smooth
from seatrial.analysis.manoeuvres.criteria import CriterionResult, IndexRow, criteria_of, index_rows
from seatrial.analysis.manoeuvres.find import RecordedRuns, runs_of_trial
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.products import Options, Products, analyse
from seatrial.analysis.report.tables import ShipDimensions
from seatrial.analysis.speed_power import SpeedPower, power_columns, speed_power
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import percent_of, refuse_duplicates, select
from seatrial.analysis.windows.held import named_recordings, second_by_second
from seatrial.hybrid.calibrators.adaptive.calibrator import AdaptiveCalibrator
from seatrial.hybrid.calibrators.adaptive.parameters import Parameters, parameters_of
from seatrial.hybrid.calibrators.artefact import load
from seatrial.hybrid.calibrators.calibrator import DomainOfApplicability
from seatrial.hybrid.calibrators.predict import HORIZON_S, Predictor, predictor_of
from seatrial.hybrid.calibrators.train import TrainedCalibrator
from seatrial.hybrid.evaluation.length_times import LengthErrors, errors_by_length
from seatrial.hybrid.evaluation.manoeuvre_indices import IndexComparisons, index_comparison
from seatrial.hybrid.evaluation.validate import Validation, refuse_training_data, validate
from seatrial.hybrid.prediction.dataset import Dataset, WindowSource, dataset_of
from seatrial.hybrid.report.errors import (
    Calibration,
    ErrorComponents,
    Residuals,
    calibration_of,
    consecutive_windows,
    errors_of,
    pooled,
    predicted_motion,
    residuals_of,
)
from seatrial.hybrid.report.trial_form import NumberedRun, numbered_runs
from seatrial.hybrid.vessel.files import load_vessel, locate_vessel
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.windage import known_conditions

SHOWN = ("reference", "hybrid")
"""The methods that are drawn beside what was measured; tables have all."""


@dataclass(frozen=True)
class Case:
    """Recordings and the model, and perhaps calibrator, that they are held against."""

    paths: tuple[Path, ...]
    vessel: str | None
    trained: TrainedCalibrator | None = None
    horizon_s: int = HORIZON_S
    part_percent: tuple[float, float] = (0.0, 100.0)
    stride_s: int = 5
    repair: bool = True
    allow_seen: bool = False
    length_m: float | None = None
    statement: str = ""

    @cached_property
    def named_parts(self) -> dict[str, tuple[Path, ...]]:
        """The recordings, each with its parts, by the names of their trials."""
        return named_recordings(self.paths)

    @cached_property
    def named_paths(self) -> dict[str, Path]:
        """The first file of each recording."""
        return {name: parts[0] for name, parts in self.named_parts.items()}

    @cached_property
    def _analysed(self) -> tuple[dict[str, Products], dict[str, str]]:
        """What the analysis makes of each recording, and why it can make nothing of some."""
        made, left_out = dict[str, Products](), dict[str, str]()
        for name, parts in self.named_parts.items():
            try:
                made[name] = self._products_of(parts, name)
            except SeatrialError as error:
                left_out[name] = str(error.at(""))
        if not made:
            raise DataShortageError(
                "no recording can be read", why="; ".join(f"{name}: {why}" for name, why in left_out.items())
            )
        return self._with_trial_currents(made), left_out

    def _with_trial_currents(self, made: dict[str, Products]) -> dict[str, Products]:
        """The recordings with their manoeuvres as those of one trial of each ship."""
        judged = dict(made)
        for vessel in dict.fromkeys(products.recording.trial.vessel for products in made.values()):
            names = [name for name, products in made.items() if products.recording.trial.vessel == vessel]
            recorded = [self._recorded_runs(made[name], self.named_paths[name]) for name in names]
            for name, runs in zip(names, runs_of_trial(recorded), strict=True):
                judged[name] = replace(made[name], manoeuvres=runs)
        return judged

    def _recorded_runs(self, products: Products, path: Path) -> RecordedRuns:
        ship = self._ship_of(products.recording.trial, path)
        length_m = None if ship is None else ship.between_perpendiculars_m
        return RecordedRuns(products.table, products.manoeuvres, Conditions(length_m=length_m))

    def _products_of(self, parts: Sequence[Path], name: str) -> Products:
        """The analysis of one recording; channels of motion and wind that it lacks are there, and empty."""
        stated = statement_from_text(self.statement)
        ship = self._ship_of(stated.added_to(read_trial(parts[0])), parts[0])
        options = Options(repair=self.repair, smooth=False, horizon_s=self.horizon_s, stride_s=self.stride_s,
                          length_m=None if ship is None else ship.between_perpendiculars_m,
                          rebuild_positions=None if self.repair else False,
                          statement=self.statement)  # fmt: skip
        products = analyse(parts, options, name)
        lacking = [each for each in MOTION if each not in products.one_hz]
        return replace(products, one_hz=products.one_hz.assign(**dict.fromkeys(lacking, np.nan)))

    def _ship_of(self, trial: Trial, recording: Path) -> ShipDimensions | None:
        """The ship of a trial: what was given or is stated of her dimensions stands above those of a file."""
        stated = recorded_conditions(trial, pd.DataFrame())
        of_file = ship_of(self._vessel_of(trial.vessel, recording))
        length_m = self.length_m or stated.length_m
        if of_file is None:
            return (
                ShipDimensions(trial.vessel, length_m, length_m, stated.beam_m, stated.draught_m)
                if length_m
                else None
            )
        if length_m and length_m != of_file.between_perpendiculars_m:
            of_file = replace(of_file, over_all_m=length_m, between_perpendiculars_m=length_m)
        return replace(of_file, beam_m=stated.beam_m or of_file.beam_m)

    def _vessel_of(self, name: str, recording: Path) -> Vessel | None:
        """The vessel file of the ship that a recording names, or of the model asked for where it names none."""
        try:
            asked = locate_vessel(self.vessel) if self.vessel and not name else None
            file = asked or vessel_of_ship(name, recording.parent)
            return None if file is None else load_vessel(file)
        except ConfigurationError:
            return None

    @property
    def products(self) -> dict[str, Products]:
        """What the analysis makes of each recording that can be read, by the name of its trial."""
        return self._analysed[0]

    @property
    def left_out(self) -> dict[str, str]:
        """Why recordings are not in the report, by the name of their trial."""
        return self._analysed[1]

    def ship(self, name: str) -> ShipDimensions | None:
        """The main dimensions of the ship that a recording names, None where it names none that is known.

        A length that was given stands above those of a file.
        """
        return self._ship_of(self.products[name].recording.trial, self.named_paths[name])

    def length_of(self, name: str) -> float | None:
        """The length between perpendiculars of the ship of a recording [m], None where it is not known."""
        ship = self.ship(name)
        return None if ship is None else ship.between_perpendiculars_m

    @cached_property
    def runs(self) -> list[NumberedRun]:
        """The manoeuvres of all recordings, numbered in the order of time."""
        return numbered_runs(self.products)

    @cached_property
    def index_rows(self) -> dict[str, list[IndexRow]]:
        """The indices of each ship, by the name that its recordings have for it: no means over several ships."""
        by_vessel: dict[str, list[Manoeuvre]] = {}
        for run in self.runs:
            vessel = self.products[run.recording].recording.trial.vessel
            by_vessel.setdefault(vessel, []).append(run.manoeuvre)
        return {vessel: index_rows(manoeuvres) for vessel, manoeuvres in by_vessel.items()}

    @cached_property
    def criteria(self) -> dict[str, list[CriterionResult]]:
        """What the trial shows of each criterion of the standards, by ship, of those with a test of one."""
        return {vessel: criteria_of(rows) for vessel, rows in self.index_rows.items()
                if any(row.criterion for row in rows)}  # fmt: skip

    @cached_property
    def speed_power(self) -> SpeedPower | None:
        """Speed at power in still water; None without power at a shaft or without reciprocal runs."""
        made = {name: each for name, each in self.products.items() if power_columns(each.table)}
        if not made:
            return None
        recorded = [(each.recording.trial, each.table) for each in made.values()]
        ship = self._vessel_of(recorded[0][0].vessel, self.named_paths[next(iter(made))])
        events = [event for each in made.values() for event in each.recording.events]
        try:
            given = Conditions(length_m=self.length_m)
            return speed_power([table for _, table in recorded], known_conditions(recorded, ship, given), events)
        except (DataShortageError, InputError):
            return None

    @cached_property
    def _predictor(self) -> Predictor:
        trials = {self.named_paths[name]: each.recording.trial for name, each in self.products.items()}
        return predictor_of(trials, self.trained, self.vessel)

    @property
    def model(self) -> ChosenModel:
        """The reference model by name, and what is to be said of it: the calibrator's where there is one."""
        return self._predictor.said

    @property
    def plant(self) -> Plant:
        """The numbers of the reference model. Raises as :func:`.reference_model`."""
        return self._predictor.plant

    @cached_property
    def dataset(self) -> Dataset:
        """The held windows of all recordings. Raises :class:`DataShortageError` where there is none."""
        every = self.products
        held = {name: each for name, each in every.items() if each.windows is not None and each.windows.kept}
        used = held or every
        paths = [path for name in used for path in self.named_parts[name]]
        return dataset_of(
            {name: second_by_second(partial(resample, select(each.table, self.part_percent)))
             for name, each in used.items()},
            self.horizon_s, self.stride_s,
            [WindowSource(path, digest, self.part_percent)
             for path, digest in zip(paths, refuse_duplicates(paths), strict=True)],
            length_m=self.plant.length_overall_m,
        )  # fmt: skip

    @property
    def training_overlap(self) -> str:
        """What the calibrator was trained on of what it is judged on: ``some`` of it, ``another part`` of its
        recordings, or ``nothing``."""
        others = () if self.trained is None else self.trained.sources
        pairs = [(each, other) for each in self.dataset.sources for other in others]
        if any(each.overlaps(other) for each, other in pairs):
            return "some"
        return "another part" if any(each.sha256 == other.sha256 for each, other in pairs) else "nothing"

    @cached_property
    def validation(self) -> Validation:
        """Every method on the held windows. Raises :class:`InputError` where a calibrator has seen them."""
        if self.trained is not None and not self.allow_seen:
            refuse_training_data(self.dataset.sources, self.trained)
        return validate(self.dataset, self.plant, self.trained)

    @cached_property
    def indices(self) -> IndexComparisons:
        """The measured indices beside those of the model, of all recordings."""
        runs = [(each.table, each.manoeuvres) for each in self.products.values()]
        return index_comparison(runs, self._predictor)

    @cached_property
    def by_length(self) -> LengthErrors | None:
        """The errors after so many L/V; None where no recording is long enough."""
        return errors_by_length(self.dataset.tables, self.validation.windows, self.plant, self.trained)

    @property
    def _names_a_model(self) -> bool:
        try:
            return not self.model.doubt
        except InputError:
            return False

    @cached_property
    def why_not(self) -> str:
        """Why nothing is predicted on these recordings; empty where it is.

        Of a ship without a model of her own none is judged unless one was asked for.
        """
        try:
            if self.trained is None and self.vessel is None and not self._names_a_model:
                return "there is no model of the ship that the recordings name"
            _ = self.validation
        except (ConfigurationError, DataShortageError, InputError) as error:
            return str(error.at(""))
        return ""

    @property
    def best(self) -> str:
        """The method that is drawn where one is: the hybrid where there is a calibrator."""
        return "hybrid" if "hybrid" in self.validation.tracks else "reference"

    @property
    def most_judged(self) -> str:
        """The trial with most windows."""
        names, counts = np.unique(self.validation.windows.trial, return_counts=True)
        return str(names[np.argmax(counts)])

    @cached_property
    def errors(self) -> dict[str, ErrorComponents]:
        """The errors of every method."""
        return {name: errors_of(track, self.validation.windows) for name, track in self.validation.tracks.items()}

    @cached_property
    def calibration(self) -> Calibration | None:
        """Whether the hybrid's regions hold what they say."""
        judged = self.validation
        if judged.region_m is None:
            return None
        return calibration_of(judged.tracks["hybrid"], judged.region_m, judged.windows)

    def figure_name(self, what: str, trial: str) -> str:
        """What a recording's figure is called: by its trial where there are several."""
        return what if len(self.paths) == 1 else f"{what}_{trial}"

    def predicted(self, name: str) -> dict[str, pd.DataFrame]:
        """What :data:`SHOWN` methods predict in windows of a trial that follow each other."""
        windows, tracks = self.validation.windows, self.validation.tracks
        chosen = consecutive_windows(windows)
        chosen = chosen[windows.trial[chosen] == name]
        if not len(chosen):
            return {}
        return {each: predicted_motion(windows, tracks[each], chosen) for each in SHOWN if each in tracks}

    @cached_property
    def residuals(self) -> Residuals | None:
        """The accelerations that the model lacks, over all recordings that can be smoothed; None without one."""
        found = [
            residuals_of(each.one_hz, smooth(each.table, 1.0), self.plant)
            for each in self.products.values() if each.windows is not None
        ]  # fmt: skip
        return pooled(found) if found else None

    @cached_property
    def domain(self) -> DomainOfApplicability | None:
        """What the trial has of what the calibrator was trained on."""
        if self.trained is None:
            return None
        judged = self.validation
        return self.trained.calibrator.domain(judged.windows, judged.tracks["reference"])

    @cached_property
    def parameters(self) -> Parameters | None:
        """What an adaptive calibrator has learned; networks have no parameters that mean anything."""
        calibrator = None if self.trained is None else self.trained.calibrator
        return parameters_of(calibrator) if isinstance(calibrator, AdaptiveCalibrator) else None


def ship_of(vessel: Vessel | None) -> ShipDimensions | None:
    """The main dimensions of a ship, with what lengthens her; None without a vessel file."""
    if vessel is None:
        return None
    size, added_m = vessel.dimensions, vessel.effects.get("hull_lengthening", {}).get("length_m", 0.0)
    return ShipDimensions(
        vessel.name, size.length_overall_m + added_m, size.length_between_perpendiculars_m + added_m, size.beam_m,
        size.draught_m, vessel.description.partition(",")[0],  # what comes after a comma is about the model
    )  # fmt: skip


def load_case(
    recordings: Sequence[Path | str],
    calibrator: Path | str | None = None,
    vessel: str | None = None,
    horizon_s: int | None = None,
    *,
    part: str = "0..100",
    repair: bool = True,
    allow_seen: bool = False,
    length_m: float | None = None,
    method: str | None = None,
    statement: str = "",
) -> Case:
    """A case from files; without a horizon that of the calibrator, or 15 s. Predictions are judged in a ``part`` of
    each recording's time in percent; ``length_m`` is the ship's where no vessel file says it; ``method`` is the
    code of a calibrator of your own, ``FILE.py:CLASS``; ``statement`` is what a person states of the trials
    (:meth:`seatrial.acquisition.config.run_sheet.Statement.as_text`).

    Raises :class:`InputError` for a recording given twice and for a calibrator that cannot be read,
    :class:`ConfigurationError` for a vessel that is not the calibrator's.
    """
    paths = tuple(map(Path, recordings))
    refuse_duplicates(paths)
    trained = load(Path(calibrator), method) if calibrator else None
    seconds = horizon_s or HORIZON_S
    if trained is not None or vessel is not None:
        seconds = predictor_of({}, trained, vessel, horizon_s).horizon_s
    return Case(paths, vessel, trained, seconds, percent_of(part), repair=repair, allow_seen=allow_seen,
                length_m=length_m, statement=statement)  # fmt: skip
