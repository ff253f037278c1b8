"""From recordings to a diagnosis and its files, and the folder in which the trials of a ship begin.

Before a diagnosis a recording is checked: it is parted where its positions jump, which to a filter would be a
force beyond any ship, and what is frozen is left out. Each part has its own start, so that a jump between them
costs nothing. Dead feedback is replaced by the order where it was recorded.

A model that is structurally wrong is re-identified first, on request or where a diagnosis of it shows that. The
coefficients are identified from all legs but those of a fold, and predictions are judged on that fold's legs.
Where these do not come closer, the model stays as it was.

``seatrial demo``: the whole chain on this machine, without hardware and without network.

A simulated ship sails a voyage; the emulator puts what its sensors would say onto a CAN bus, a serial line and
a MAVLink link; the recorder, a process of its own, records them, while a calibrator is trained on earlier voyages;
the recording is cut into held windows, the calibrator is judged on it, and a diagnosis names what the model lacks.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from pydantic import TypeAdapter
from pymap3d import ned2geodetic

from seatrial.acquisition.config import declarations, run_sheet, sources, trial_file
from seatrial.acquisition.core import errors, quantities
from seatrial.acquisition.core import ship as ships
from seatrial.acquisition.core.files import remove_file, write_text, written_together
from seatrial.acquisition.core.trial import Quality, Trial, software_version
from seatrial.acquisition.emulator import NullModem, Playback, emulate
from seatrial.acquisition.recording import reader, writer
from seatrial.acquisition.recording.parts import safe_file_name
from seatrial.acquisition.tables.import_table import refuse_overwriting
from seatrial.analysis.quality import check, situations
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.model import GROUPS
from seatrial.analysis.quality.repairs import repair_table
from seatrial.analysis.tables.table import (
    NANO,
    hash_distinct_files,
    select,
    table_actuators,
    table_controls,
    table_of,
    times_ns,
    utc_index,
)
from seatrial.analysis.windows.held import HeldWindows, tables_of_recordings, windows_of_tables
from seatrial.hybrid import effects
from seatrial.hybrid.calibrators import choose_reference, train_calibrator
from seatrial.hybrid.calibrators.own import load, save
from seatrial.hybrid.diagnosis import acceptance, linearise, regression, result, verdict
from seatrial.hybrid.diagnosis.gap import HORIZON_S, UnseenWindows, fold_of, predicted_tracks, unseen_windows
from seatrial.hybrid.diagnosis.log import BLOCK_S, Log, join_tables, log_of
from seatrial.hybrid.effects import context as contexts
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.effects.simulators import save_simulator
from seatrial.hybrid.evaluation.predicted_indices import index_table, uncertain_effects
from seatrial.hybrid.evaluation.validate import Validation, refuse_training_data, validate_predictions
from seatrial.hybrid.identification.fit import fixed_surroundings
from seatrial.hybrid.identification.identify import Identification, identify_tables, uncertain_estimates
from seatrial.hybrid.prediction.baselines import constant_motion_tracks, distances
from seatrial.hybrid.prediction.dataset import load_dataset
from seatrial.hybrid.report.diagnosis import correction_sentence, describe, model_line, write_report
from seatrial.hybrid.report.folder import Choices, write_folder_report
from seatrial.hybrid.report.text import plain
from seatrial.hybrid.simulation.index_table import IndexTable
from seatrial.hybrid.simulation.manoeuvres import Drives, response_of
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.vessel import files as vessel_files
from seatrial.hybrid.vessel.actuators import KINDS, Drive
from seatrial.hybrid.vessel.black_box import BlackBox, inside_error
from seatrial.hybrid.vessel.estimate.new_vessel import NewVessel
from seatrial.hybrid.vessel.outside import assumed_inertia

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SEGMENT_S = 2.0 * HORIZON_S
"""The length of a segment that the fit simulates from a start of its own: twice the horizon of a prediction."""

_FORCES = ("surge", "sway", "yaw")

CLOSED_ENOUGH = 0.8
"""The share of the gap that what is named has to close where the model predicts worse than constant velocity, or
its coefficients are identified: few causes close 0.7 and none of it in the halves of R/V Gunnerus' trial of 2022,
and 0.9 of it for a tanker model in a towing tank."""

_OF_SCOPE = {"day": " (of the day of that trial)", "recording": " (of its sensors)"}
_STEP_S = 0.1
_TURNS_DEG = 30.0  # by drift and wind alone, or at an even surge, sway or yaw rate, a ship hardly turns so far
_AHEAD_DEG = 1.0  # an angle held further from ahead turns the ship by right

_AROUND = pd.Timedelta(seconds=2.5)
"""Filters and interpolation make a ramp of a jump, and its stamps may be late: so much on either side goes."""

_FROZEN = ("stuck", "feedback_frozen", "position_jump")
_MOST_FROZEN = 0.5

_FOR_A_NAME = ("speed_scale", "yaw_rate_scale", "channel_delay")
"""Errors of sensors that the catalogue has: a diagnosis names them."""

TEMPLATES = ships.VESSELS.parent / "start"
_CONTROLS = "# CONTROLS\n"
_EXAMPLE_S, _PLACE_DEG = 420.0, (63.44, 10.4)


@dataclass(frozen=True, slots=True)
class Refit:
    """A vessel with coefficients from all of a trial, or as it was where that is no better, and how that went."""

    vessel: vessel_files.Vessel
    correction: result.IdentifiedCorrection


def reidentify_model(
    tables: Sequence[pd.DataFrame],
    vessel: vessel_files.Vessel,
    progress: errors.Progress = lambda share: None,
    fixed: Collection[str] = (),
) -> Refit:
    """Re-identify ``vessel`` from raw tables, and judge that on legs left out.

    ``fixed`` surroundings are not fitted. Raises as :func:`.identify_tables`.
    """
    log = log_of(tables, vessel.dimensions.length_overall_m, actuators=vessel.actuators)
    windows = unseen_windows(log, linearise.model_of(vessel, {}))
    folds = np.unique(windows.fold).tolist()
    named = {str(number): table for number, table in enumerate(tables)}
    refit_tracks = windows.before.copy()
    for number, fold in enumerate(folds):
        other_folds = _tables_without_fold(named, log, fold)
        part = errors.subtask_progress(progress, number, len(folds) + 1)
        refitted = identify_tables(other_folds, vessel, segment_s=SEGMENT_S, fixed=fixed, progress=part)[0]
        plant = effects.vessel_plant(refitted.vessel)
        in_fold = windows.fold == fold
        refit_tracks[in_fold] = predicted_tracks(
            log, plant, linearise.true_states(log, plant, windows.starts[in_fold]), windows.starts[in_fold]
        )
    last_part = errors.subtask_progress(progress, len(folds), len(folds) + 1)
    identification = identify_tables(named, vessel, segment_s=SEGMENT_S, fixed=fixed, progress=last_part)[0]
    forces = force_difference_by_component(log, vessel, identification.vessel)
    correction = _identified_correction(windows, refit_tracks, identification, forces)
    return Refit(identification.vessel if correction.applied else vessel, correction)


def _tables_without_fold(named_tables: Mapping[str, pd.DataFrame], log: Log, fold: int) -> dict[str, pd.DataFrame]:
    """The tables without the seconds of a fold's legs: segments that these would cross have no data."""
    left_out = log.time_s[fold_of(log) == fold]
    remaining = {
        name: table[~np.isin(np.rint(times_ns(table) / NANO), left_out)] for name, table in named_tables.items()
    }
    return {name: table for name, table in remaining.items() if len(table)}


def force_difference_by_component(
    log: Log, before: vessel_files.Vessel, after: vessel_files.Vessel
) -> dict[str, float]:
    """How far the forces of two vessels are apart along a trial, root mean square as shares of the force range.

    They are the forces ahead, across and in yaw that would make the one move in a second as the other does: a
    mass or an inertia that differs counts as the force that it takes.
    """
    old, new = effects.vessel_plant(before), effects.vessel_plant(after)
    linear = linearise.linear_model(log, old)
    moved = linearise.next_states(log, new, linear.origin) - linearise.next_states(log, old, linear.origin)
    force = np.linalg.solve(linear.B[:, 3:], moved[:, 3:, None])[..., 0]
    shares = np.sqrt((force**2).mean(axis=0)) / regression.force_range(log, old, linear.origin)
    return dict(zip(_FORCES, shares.tolist(), strict=True))


def _identified_correction(
    windows: UnseenWindows,
    refit_tracks: quantities.Floats,
    identification: Identification,
    forces: Mapping[str, float],
) -> result.IdentifiedCorrection:
    gains = windows.by_leg_m(windows.before) - windows.by_leg_m(refit_tracks)
    held = constant_motion_tracks(windows.log.nominal[windows.starts], HORIZON_S)
    off_m = np.array([distances(track, windows.measured) for track in (held, windows.before, refit_tracks)])
    complete = np.isfinite(off_m).all(axis=0)
    held_m, before_m, after_m = off_m[:, complete].mean(axis=1).tolist()
    estimates = {
        name: estimate for estimate in identification.coefficients for name in (estimate.name, *estimate.tied)
    }
    return result.IdentifiedCorrection(
        applied=bool(gains.mean() > 0.0 and acceptance.chance_of_gains(gains) < acceptance.HELD_OUT_LEVEL),
        constant_velocity_m=held_m,
        before_m=before_m,
        after_m=after_m,
        held_out_windows=int(complete.any(axis=1).sum()),
        forces=forces,
        coefficients={
            name: result.Estimate(estimate.value, estimate.low, estimate.high, "")
            for name, estimate in estimates.items()
        },
        start={name: estimate.start for name, estimate in estimates.items()},
        known=tuple(name for name, estimate in estimates.items() if estimate.known),
    )


@dataclass(frozen=True, slots=True)
class DiagnosisRun:
    """A diagnosis, the numbers and tables that it was made from, and what its page shows beside it.

    ``refit`` is the vessel that it started from, where that was identified before.
    """

    diagnosis: result.Diagnosis
    conclusion: verdict.Conclusion
    extras: result.Extras
    tables: Sequence[pd.DataFrame]
    refit: vessel_files.Vessel | None = None

    def __str__(self) -> str:
        return f"{model_line(self.diagnosis)}\n{self.diagnosis}"

    def plot(self) -> Figure:
        """The parameters that were named with their 95 % intervals, and below them the gap that they close."""
        from seatrial.hybrid.report.plots import make_overview_figure

        return make_overview_figure(self.diagnosis)


DiagnosedShip = vessel_files.Vessel | BlackBox


def _provenance_of_simulator_diagnosis(model: BlackBox) -> dict[str, str]:
    """What no diagnosis with a simulator can ask, and how it is pushed, for its provenance."""
    mass_t = assumed_inertia(model.length_between_perpendiculars_m)[0] / 1e3
    pushed = "its input for accelerations" if model.spec.takes_acceleration else "half before each step, half after"
    return {
        "not_asked": "the model is a simulator, and these would act inside it: "
        + ", ".join(map(plain, effects.inside_effects(model)))
        + "; what is wrong among them shows as what it does from outside: a loss of thrust as a shaft gain, "
        "fouling as added resistance",
        "pushes": f"accelerations, by {pushed}; newtons are those of {mass_t:,.0f} t, usual at its length",
    }


def diagnose_tables(
    tables: Sequence[pd.DataFrame],
    vessel: DiagnosedShip,
    tolerance: float = verdict.TOLERANCE,
    catalogue: effects.Catalogue | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: errors.Progress = lambda share: None,
    context: run_sheet.Context | None = None,
) -> DiagnosisRun:
    """Diagnose raw tables and put the conclusion into words; errors as :func:`.verdict.diagnose`.

    The catalogue is the vessel's unless another is given; where no wind was recorded, with a steady one in the
    place of the effects of the wind. What the ``context`` rules out or knows is not searched; known effects have to
    be in the vessel. Where feedback is dead and orders are there, these drive the model, which is
    the first remark.
    """
    tables, driven = replace_dead_feedback_by_orders(tables, vessel)
    available = effects.catalogue_of(vessel) if catalogue is None else catalogue
    considered = replace_wind_effects(available, tables, of_simulator=isinstance(vessel, BlackBox))
    context = context or run_sheet.Context()
    searched = contexts.searched_effects(considered, context)
    looked_for_wind = considered != available and STEADY_WIND.name in searched
    wind_remark = {"wind": "not recorded: only a steady one was looked for"} if looked_for_wind else {}
    conclusion = verdict.diagnose(tables, vessel, tolerance, searched, progress)
    asked = {} if isinstance(vessel, vessel_files.Vessel) else _provenance_of_simulator_diagnosis(vessel)
    diagnosis, extras = describe(conclusion, {**(provenance or {}), **asked, **wind_remark})
    names = [effect.name for effect in diagnosis.effects] + [suspect.name for suspect in diagnosis.suspects]
    names += [name for group in diagnosis.indistinguishable for name in group]
    refuted = ("no wind",) if conclusion.first.evidence.equations.log.wind[:, 1].any() else ()
    declared = contexts.DeclaredContext(
        context.declarations, context.known, tuple(name for name in considered if name not in searched),
        contexts.excluding_declarations([searched[name] for name in dict.fromkeys(names)], context, refuted),
    )  # fmt: skip
    diagnosis = replace(diagnosis, context=declared, remarks=(*driven, *diagnosis.remarks))
    return DiagnosisRun(diagnosis, conclusion, extras, tables)


def diagnose_files(
    files: Sequence[Path],
    vessel: DiagnosedShip,
    tolerance: float,
    catalogue: effects.Catalogue,
    time_range: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool | None = None,
    identify: bool | None = None,
    context: run_sheet.Context | None = None,
    progress: errors.Progress = lambda share: None,
) -> DiagnosisRun:
    """Diagnose recordings, or a part of each one's time in percent; errors as :func:`.verdict.diagnose`.

    Each is checked before (:func:`.checked_tables`): it is parted where its positions jump, what stood still is
    left out, and faults of the record are repaired. With ``repair`` scales and delays of sensors are, too, and not
    diagnosed any more; ``rebuild_positions`` takes positions by dead reckoning, ``None`` where their time stamps
    jitter. What the recordings and the vessel declare completes the ``context``. ``identify`` has the model's
    coefficients identified from the recordings before (:func:`diagnose_with_refit`), ``None`` where the diagnosis
    shows that it is off in many things.
    """
    if isinstance(vessel, BlackBox):
        if identify:
            raise inside_error(vessel, "its coefficients cannot be identified")
        if vessel.run_in_s is not None:
            raise inside_error(vessel, "a diagnosis sets its state each second, and it cannot start from one")
        identify = False
    hashes, trials = hash_distinct_files(files), vessel_files.trials_of_recordings(files)
    model_choice = choose_reference(trials, vessel).choice
    declared = contexts.context_of_recordings(trials, vessel, context or run_sheet.Context())
    vessel = contexts.with_known_effects(vessel, declared, catalogue)
    provenance = {
        "software_version": software_version(),
        "recordings": ", ".join(errors.printable_path(Path(file).name) for file in files),
        "recordings_sha256": ", ".join(hashes),
        "vessel": vessel.name,
        "rebuild_positions": "where their stamps jitter" if rebuild_positions is None else rebuild_positions,
        "part_percent": f"{time_range[0]:g}..{time_range[1]:g}",
    }

    def checked(repaired: bool) -> Checked:
        tables, remarks, repairs = list[pd.DataFrame](), list[str](), list[str]()
        for recording in reader.read_recordings(map(Path, files)):
            record = checked_tables(recording, time_range, repaired=repaired, rebuild_positions=rebuild_positions)
            name = errors.printable_path(recording.path.name)
            tables += record.tables
            remarks += [f"{name}: {remark}" for remark in record.remarks]
            repairs += [f"{name}: {action}" for action in record.repairs]
        return Checked(tuple(tables), tuple(remarks), tuple(repairs), repaired)

    def diagnosed(record: Checked, start: DiagnosedShip, part: errors.Progress) -> DiagnosisRun:
        repairs = {"repaired": "; ".join(record.repairs), "left_out": "; ".join(record.remarks)}
        details = provenance | {"repair": record.repaired} | {name: text for name, text in repairs.items() if text}
        return diagnose_tables(record.tables, start, tolerance, catalogue, details, part, declared)

    run, refit = diagnose_with_refit(
        checked,
        diagnosed,
        vessel,
        identify=identify,
        repair=repair,
        fixed=fixed_surroundings(declared, catalogue),
        progress=progress,
    )
    if isinstance(vessel, BlackBox):
        remarks = (*model_choice.remarks.get("remarks", ()), *run.diagnosis.remarks)
        return replace(run, diagnosis=replace(run.diagnosis, remarks=remarks))
    first = replace(run.diagnosis, remarks=(*model_choice.remarks.get("remarks", ()), *run.diagnosis.remarks))
    start = refit.vessel if refit is not None and refit.correction.applied else None
    first = replace(first, indices=tuple(indices_of_diagnosis(run, vessel, start or vessel).as_json()))
    if refit is None:
        return replace(run, diagnosis=first)
    return replace(run, diagnosis=replace(first, identified=refit.correction), refit=start)


def indices_of_diagnosis(run: DiagnosisRun, before: vessel_files.Vessel, start: vessel_files.Vessel) -> IndexTable:
    """The standard indices of the model ``before``, and of the ``start`` of a diagnosis with what it named."""
    named = {effect.name: effect.parameters for effect in run.diagnosis.effects if effect.in_vessel}
    tables = {str(number): table for number, table in enumerate(run.tables)}
    after = uncertain_effects(vessel_with_effects(start, run.diagnosis), named)
    return index_table(tables, before, after, estimates=uncertain_estimates(after.vessel))


def diagnose_with_refit(
    checked: Callable[[bool], Checked],
    diagnosed: Callable[[Checked, DiagnosedShip, errors.Progress], DiagnosisRun],
    vessel: DiagnosedShip,
    *,
    identify: bool | None = None,
    repair: bool = False,
    fixed: Collection[str] = (),
    progress: errors.Progress = lambda share: None,
) -> tuple[DiagnosisRun, Refit | None]:
    """What is ``diagnosed`` in a record that is ``checked``, with or without repair of its sensors.

    Before it, if ``identify`` or with None where the model :func:`is_structurally_wrong`, the coefficients are
    identified. The sensors are repaired then, too, because coefficients would absorb the scale of one. Where new
    coefficients are no better, the model as it is has been or is diagnosed.
    """
    record = checked(repair or bool(identify))
    progress(0.1)
    first = None if identify else diagnosed(record, vessel, lambda share: progress(0.1 + 0.3 * share))
    if first is not None and (identify is False or not is_structurally_wrong(first.diagnosis)):
        progress(1.0)
        return first, None

    assert isinstance(vessel, vessel_files.Vessel)
    record = record if record.repaired else checked(True)
    tables = replace_dead_feedback_by_orders(record.tables, vessel)[0]
    try:
        refit = reidentify_model(tables, vessel, lambda share: progress(0.4 + 0.3 * share), fixed)
    except errors.ModelRangeError as error:
        if first is None:
            raise
        remark = f"The model's coefficients could not be re-identified: {error}"
        diagnosis = replace(first.diagnosis, remarks=(remark, *first.diagnosis.remarks))
        return replace(first, diagnosis=diagnosis), None
    run = first
    if run is None or refit.correction.applied:
        run = diagnosed(record, refit.vessel, lambda share: progress(0.7 + 0.3 * share))
    if first is None:
        return run, refit
    gap, names = first.diagnosis.gap, dict.fromkeys(plain(effect.name) for effect in first.diagnosis.effects)
    applied = refit.correction.applied
    outcome = "its coefficients were re-identified" if applied else "new coefficients were not better"
    remark = (
        f"The model as it is predicts worse than constant velocity ({gap.before_m:.2f} m against "
        f"{gap.constant_velocity_m:.2f} m), and what could be named left forces unexplained: {outcome}. Named "
        f"{'were ' + ', '.join(names) if names else 'was nothing'}; the error on held-out legs was then "
        f"{gap.after_m:.2f} m"
    )
    return replace(run, diagnosis=replace(run.diagnosis, remarks=(remark, *run.diagnosis.remarks))), refit


def is_structurally_wrong(diagnosis: result.Diagnosis) -> bool:
    """Whether a model predicts worse than constant velocity does, and what is named leaves its forces wrong."""
    gap, remainder = diagnosis.gap, diagnosis.remainder or diagnosis.unknown
    is_coarse = remainder is not None and regression.OPERATION in remainder.where
    return is_coarse and gap.before_m > gap.constant_velocity_m and gap.closed < CLOSED_ENOUGH


def write_diagnosis(run: DiagnosisRun, vessel: DiagnosedShip, folder: Path) -> Path:
    """Write ``diagnosis.json``, ``vessel.toml``, ``report.html`` and the numbers behind its figures.

    Where a calibrator was trained on top ``ladder.json``, where the model was identified before
    ``identified.toml``, and where regimes were found ``regimes.py``; files of an earlier diagnosis go. Returns the
    page's path.

    Raises :class:`StorageError`.
    """
    with written_together(folder / result.DIAGNOSIS):
        result.write_figure_data(run.diagnosis, run.extras, folder)
        regimes = {regime.name: (regime.regime, regime.value) for regime in run.conclusion.regimes}
        if regimes:
            write_text(folder / "regimes.py", effects.as_file(regimes))
        else:
            remove_file(folder / "regimes.py")
        if run.refit is None:
            remove_file(folder / "identified.toml")
        else:
            vessel_files.save_vessel(run.refit, folder / "identified.toml")
        if isinstance(vessel, BlackBox):
            named, notes = effects_and_notes(run.diagnosis)
            save_simulator(effects.simulator_with(vessel, named), folder / "vessel.toml", notes)
        else:
            vessel_files.save_vessel(
                vessel_with_effects(run.refit or vessel, run.diagnosis), folder / "vessel.toml"
            )
        return write_report(run.diagnosis, run.extras, folder)


def effects_and_notes(diagnosis: result.Diagnosis) -> tuple[dict[str, dict[str, float]], dict[str, Any]]:
    """What was known and named, for a file of the model, and where that comes from."""
    added = [effect for effect in diagnosis.effects if effect.in_vessel]
    named = {
        effect.name: {name: estimate.value for name, estimate in effect.parameters.items()} for effect in added
    }
    stated = {name: dict(values) for name, values in diagnosis.context.known.items()}
    notes = {
        f"diagnosis_{effect.name}": "; ".join(
            f"{name} {estimate.value:.6g} ({estimate.low:.6g} to {estimate.high:.6g}) {estimate.unit}"
            for name, estimate in effect.parameters.items()
        )
        for effect in added
    }
    if diagnosis.identified is not None:
        notes[f"diagnosis_{diagnosis.identified.name}"] = correction_sentence(diagnosis.identified)
    provenance = {  # a TOML table holds texts and numbers
        f"diagnosis_{key}": value if isinstance(value, int | float) else str(value)
        for key, value in diagnosis.provenance.items()
    }
    return stated | named, {**provenance, **notes, "verdict": diagnosis.verdict}


def vessel_with_effects(vessel: vessel_files.Vessel, diagnosis: result.Diagnosis) -> vessel_files.Vessel:
    """``vessel`` with what was known and what was named, and where that comes from.

    A named effect that the vessel has already takes that one's place: its value is what both come to. What is not
    the same in all of the trial stands as it is at the end; the sea and the sensors of each recording stay with it.
    """
    named, notes = effects_and_notes(diagnosis)
    updated = vessel_files.add_effects(vessel, named, **notes)

    added = [effect for effect in diagnosis.effects if effect.in_vessel]
    by_scope = dict[str, list[str]]()
    for effect in added:
        by_scope.setdefault(effect.scope, []).append(effect.name)
    parts = [", ".join(names) + _OF_SCOPE.get(scope, "") for scope, names in by_scope.items()]
    if diagnosis.identified is not None and diagnosis.identified.applied:
        parts.insert(0, "identified coefficients")
    description = f"{vessel.description or vessel.name}; a diagnosis added {'; '.join(parts) or 'nothing'}"
    return replace(updated, name=f"{vessel.name}_diagnosed", description=description)


def replace_dead_feedback_by_orders(
    tables: Sequence[pd.DataFrame], vessel: DiagnosedShip
) -> tuple[tuple[pd.DataFrame, ...], tuple[str, ...]]:
    """Raw tables with orders, through the drives of ``vessel``, in the place of dead feedback, and what was done.

    Feedback is dead where it has no values, or one value throughout although the order moves.
    """
    driven, remarks = list[pd.DataFrame](), dict[str, None]()
    for table in tables:
        filled = dict[str, quantities.Floats]()
        for actuator, entry in zip(vessel.actuators, vessel.actuator, strict=True):
            kind = KINDS[actuator.kind]
            parts = zip(actuator.channels, kind.drives(entry), kind.units, kind.still, strict=True)
            for channel, drive, unit, idle_limit in parts:
                name, order = channel.name, ships.order_channel_name(channel.name)
                how = dead_channel_in_words(table, name)
                if not how or not _has_values(table, order):
                    continue
                if (
                    _has_values(table, name)
                    and np.ptp(table[order].dropna().to_numpy(dtype=float)) * unit <= idle_limit
                ):
                    continue
                in_its_unit = Drive(drive.lag_s, drive.limit / unit, drive.rate / unit)
                filled[name] = follow_orders(table, order, in_its_unit, circular=channel.circular)
                remarks[f"{name} {how}: its order drives the model, with a lag of {drive.lag_s:g} s"] = None
        driven.append(table.assign(**filled) if filled else table)
    return tuple(driven), tuple(remarks)


def dead_channel_in_words(table: pd.DataFrame, name: str) -> str:
    """In words what is wrong with a channel that has no values, or one throughout; empty for any other."""
    if not _has_values(table, name):
        return "has no values"
    return f"stands at {table[name].min():g} throughout" if table[name].min() == table[name].max() else ""


def idle_angles(table: pd.DataFrame, actuators: ships.Actuators) -> tuple[str, ...]:
    """In words the angles that stand still although the ship turns or others like them move: unused, or dead.

    Where their orders were recorded these say it, and :func:`replace_dead_feedback_by_orders` takes them.
    """
    angles = {
        actuator.angle.name: actuator.kind
        for actuator in actuators
        if actuator.angle and actuator.angle.name in table
    }
    idle = {name for name in angles if _has_values(table, name) and dead_channel_in_words(table, name)}
    unknown = {name for name in idle if not _has_values(table, ships.order_channel_name(name))}
    moving = {kind for name, kind in angles.items() if name not in idle}
    turned_deg, remarks = _heading_range_deg(table), []
    for name in sorted(unknown):
        ahead = abs(float(table[name].median())) < _AHEAD_DEG
        if angles[name] in moving or (ahead and turned_deg > _TURNS_DEG):
            contrast = (
                "others like it move" if angles[name] in moving else f"the ship turns by {turned_deg:.0f} deg"
            )
            remarks.append(
                f"{name} {dead_channel_in_words(table, name)} although {contrast}: taken as recorded; "
                "if it was used, what is named may stand for that"
            )
    return tuple(remarks)


def _has_values(table: pd.DataFrame, name: str) -> bool:
    return name in table and bool(table[name].notna().any())


def _heading_range_deg(table: pd.DataFrame) -> float:
    """How far the heading reaches from its least value to its most [deg], 0 without one."""
    heading = table["heading_deg"].dropna().to_numpy(dtype=float) if "heading_deg" in table else np.empty(0)
    return float(np.ptp(ships.unwrap(heading))) if heading.size else 0.0


def follow_orders(table: pd.DataFrame, order: str, drive: Drive, *, circular: bool) -> quantities.Floats:
    """What a drive makes of its orders, each held until the next, at the times of a table; NaN before the first.

    ``drive`` has its limits in the channel's unit; it begins at the first order (:func:`.response_of`).
    """
    recorded, table_s = table[order].notna().to_numpy(), times_ns(table) / NANO
    times, values = table_s[recorded], table[order].to_numpy(dtype=float)[recorded]
    values = ships.unwrap(values) if circular else values
    grid = np.arange(times[0], table_s[-1] + _STEP_S, _STEP_S)
    held = values[np.searchsorted(times, grid, side="right") - 1]

    lag_s, limit, rate, helm = (np.array([value]) for value in (drive.lag_s, drive.limit, drive.rate, 0.0))
    drives = Drives(lag_s, limit, rate, helm, damping_s=0.0, settled_radps=0.0)
    acting = np.interp(table_s, grid, response_of(drives, held[:, np.newaxis], _STEP_S)[:, 0])
    return np.where(table_s >= times[0], ships.wrap_180(acting) if circular else acting, np.nan)


@dataclass(frozen=True, slots=True)
class Checked:
    """The tables that a diagnosis takes in, and in a sentence each what was left out of the recording and what was
    repaired in it; ``repaired`` says whether scales and delays of sensors were."""

    tables: tuple[pd.DataFrame, ...]
    remarks: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    repaired: bool = False


def checked_tables(
    recording: reader.Recording,
    time_range: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool | None = None,
) -> Checked:
    """The raw tables of a recording, or of a part of its time in percent, as its check says that they can be used.

    Faults of the record that no effect could be (a heading interpolated through north, orders interpolated from
    event to event, spikes) are put right. ``repaired`` has the errors put right as well that a diagnosis would
    name: factors of speeds and yaw rate, delays. ``rebuild_positions`` takes the path that speeds and heading give
    for the positions; ``None`` does so where the check finds that their stamps jitter.

    Raises :class:`DataShortageError` where the ship is held or towed throughout.
    """
    raw = table_of(recording)
    quality = check.check_recording(recording, raw)
    faults = [finding for finding in quality.findings if repaired or finding.code not in _FOR_A_NAME]
    record = repair_table(raw, faults, quality.flags, recording, rebuild_positions=rebuild_positions)
    flags = select(quality.flags if record.flags is None else record.flags, time_range)
    table, remarks = select(record.table, time_range).copy(), list[str]()

    # gaps where a channel stood still or positions were displaced; a control that is frozen for most of the time
    # stays: without it nothing is known of what drives the ship
    for finding in (finding for finding in quality.findings if finding.code in _FROZEN):
        for name in filter(flags.__contains__, GROUPS.get(finding.channel, (finding.channel,))):
            bad = (flags[name] == Quality.BAD).to_numpy() & table[name].notna().to_numpy()
            if name in table_controls(table) and bad.sum() > _MOST_FROZEN * table[name].count():
                remarks.append(f"{name} stands still for most of the time and was taken as recorded")
            elif bad.any():
                table[name] = table[name].mask(bad)
                remarks.append(f"{int(bad.sum()):,} values of {name} left out: {finding.text}")

    # speeds and yaw rate that have one value throughout although the heading turns: nobody measured them
    dead = [name for name in ships.VELOCITY if _has_values(table, name) and dead_channel_in_words(table, name)]
    dead = dead if _heading_range_deg(table) > _TURNS_DEG else []
    free, situation_remarks = free_motion(table.assign(**dict.fromkeys(dead, np.nan)), quality.findings)
    parts, part_remarks = split_at_jumps(free, quality.findings)
    remarks += [f"{name} has one value throughout although the ship turns: it is left out" for name in dead]
    remarks += [*idle_angles(table, table_actuators(table)), *situation_remarks, *part_remarks]
    repairs = (f"{entry.channel}: " * (entry.channel not in entry.text) + entry.text for entry in record.repairs)
    return Checked(parts, tuple(remarks), tuple(dict.fromkeys(repairs)), repaired)


def usable_tables(
    recordings: Mapping[str, reader.Files],
    time_range: tuple[float, float] = (0.0, 100.0),
    *,
    repaired: bool = False,
    rebuild_positions: bool | None = None,
) -> tuple[dict[str, pd.DataFrame], tuple[str, ...]]:
    """One raw table for each recording by name, with a gap where :func:`checked_tables` parts it, and remarks."""
    tables, remarks = dict[str, pd.DataFrame](), list[str]()
    for name, files in recordings.items():
        checked = checked_tables(
            reader.read_as_one_recording(files), time_range, repaired=repaired, rebuild_positions=rebuild_positions
        )
        tables[name] = join_tables(checked.tables)
        remarks += [f"{name}: {remark}" for remark in checked.remarks]
    return tables, tuple(remarks)


def free_motion(table: pd.DataFrame, findings: Iterable[Finding]) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """A table without the time in which the ship is held or towed, and what was left out.

    Raises :class:`DataShortageError` where less than a minute remains.
    """
    times, remarks = utc_index(table), list[str]()
    free = np.ones(len(table), dtype=bool)
    for finding in (finding for finding in findings if finding.code in situations.KINDS):
        within = np.asarray((times >= finding.start) & (times <= finding.end))
        if (within & free).any():
            free &= ~within
            remarks.append(f"{(finding.end - finding.start).total_seconds():,.0f} s left out: {finding.text}")
    if remarks and np.unique(times[free].floor("s")).size < BLOCK_S:
        raise errors.DataShortageError(
            "the ship is not free to move for a minute", where=str(table.attrs.get("recording", "the table")),
            why="; ".join(remarks), fix="give a recording, or a part of one, in which it sails",
        )  # fmt: skip
    return (table[free] if remarks else table), tuple(remarks)


def split_at_jumps(
    table: pd.DataFrame, findings: Iterable[Finding]
) -> tuple[tuple[pd.DataFrame, ...], tuple[str, ...]]:
    """The parts of a table between jumps of the positions that do not return, those of a minute and more; and what
    was parted where."""
    jumps = [finding for finding in findings if finding.code == "position_jump" and finding.start == finding.end]
    times = utc_index(table)
    inside = [jump for jump in jumps if times.min() < jump.start < times.max()]
    edges = [times.min() - _AROUND, *sorted(jump.start for jump in inside), times.max() + _AROUND]
    parts = [table[(times >= first + _AROUND) & (times <= last - _AROUND)] for first, last in pairwise(edges)]
    long = tuple(part for part in parts if len(part) and np.ptp(utc_index(part).asi8) >= BLOCK_S * 1e9)
    return long or (table,), tuple(f"parted: {jump.text}" for jump in inside)


def replace_wind_effects(
    catalogue: effects.Catalogue, tables: Sequence[pd.DataFrame], *, of_simulator: bool = False
) -> effects.Catalogue:
    """The catalogue; where a table has no wind, a steady one in the place of the effects of a recorded one,
    of a simulator none."""
    if all(
        set(ships.ENVIRONMENT) <= set(table) and table[list(ships.ENVIRONMENT)].notna().any().all()
        for table in tables
    ):
        return catalogue
    windless = {name: effect for name, effect in catalogue.items() if not name.startswith("wind_")}
    if of_simulator:
        return windless
    return {**windless, STEADY_WIND.name: STEADY_WIND}


def start_folder(
    folder: Path, vessel: NewVessel | str | Path, name: str = "", *, force: bool = False
) -> list[Path]:
    """Write a ship's ``vessel.toml``, ``trial.toml``, ``columns.toml`` and ``example.csv`` into a folder.

    Parameters
    ----------
    folder
        Made if it does not exist.
    vessel
        The ship: estimated from main dimensions, or a vessel's name or file. A ship that comes with Seatrial, and a
        ``vessel.toml`` that is in the folder already, are not written.
    name
        What the trial is called; by default as the folder.
    force
        Whether files that exist are replaced.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        For a file that exists, without ``force``.
    ConfigurationError
        For a vessel file at fault, and for a ship of one's own with the name of one in Seatrial.
    StorageError
        For a folder that cannot be written to.
    """
    name = safe_file_name(name or folder.resolve().name)
    ship, text = _ship_and_vessel_text(vessel, folder)
    texts = {} if text is None else {"vessel.toml": text}
    controls = ships.control_channels(ship.actuators)
    settings = {"name": "bridge", "type": "udp", "port": 10110, "channels": ()}
    possible = trial_file.possible_channels_of_source(
        TypeAdapter(sources.UdpSource).validate_python(settings), ship.actuators
    )
    rows = [
        f'"{channel.name}",' if channel.name in possible else f'# "{channel.name}": no sentence carries it'
        for channel in controls
    ]
    titles = {  # as the columns of a table are called: "Port pitch %"
        channel.name: f"{channel.name.rpartition('_')[0].replace('_', ' ').capitalize()} {channel.unit}"
        for channel in controls
    }
    columns = [
        f'{channel.name:<18} = {{ column = "{titles[channel.name]}", unit = "{channel.unit}" }}\n'
        for channel in controls
    ]
    texts["trial.toml"] = _filled_template("trial.toml", name, ship, "\n  ".join(rows))
    texts["columns.toml"] = _filled_template("columns.toml", name, ship, "".join(columns))
    for file in (*texts, "example.csv"):
        refuse_overwriting(folder / file, force)

    # a 10/10 zigzag of the ship in a calm sea, by sensors so good that its columns agree by eye
    table, _ = simulate_trial(ship, "calm", "zigzag_10_10", _EXAMPLE_S, 1.0, noise=SimulationNoise().scaled(0.1))
    lat, lon, _ = ned2geodetic(table["north_m"], table["east_m"], 0.0, *_PLACE_DEG, 0.0)
    knots = table[["surge_mps", "sway_mps", "wind_speed_mps"]] / quantities.KNOT_MPS
    texts["example.csv"] = pd.DataFrame({
        "Time UTC": pd.DatetimeIndex(table.index).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "Lat": lat.round(7), "Lon": lon.round(7),
        "Heading": table["heading_deg"].round(2), "ROT deg/min": (60.0 * table["yaw_rate_dps"]).round(2),
        "Speed ahead kn": knots["surge_mps"].round(2), "Speed to starboard kn": knots["sway_mps"].round(2),
        "Wind from": table["wind_direction_deg"].round(1), "Wind kn": knots["wind_speed_mps"].round(1),
        **{title: table[channel].round(1) for channel, title in titles.items()},
    }).to_csv(index=False)  # fmt: skip
    with written_together(folder / "trial.toml"):
        return [write_text(folder / file, text) for file, text in texts.items()]


def _ship_and_vessel_text(vessel: NewVessel | str | Path, folder: Path) -> tuple[vessel_files.Vessel, str | None]:
    """The ship, and the text of its vessel file; None where that need not be written."""
    with TemporaryDirectory(prefix="seatrial-init-") as scratch:
        copy = Path(scratch) / "vessel.toml"
        if isinstance(vessel, NewVessel):
            vessel.save(copy)
            ship, exists = vessel_files.load_vessel(copy), False
        else:
            file = declarations.find_vessel(vessel)
            ship = vessel_files.load_vessel(file)
            if file.parent == ships.VESSELS:
                return ship, None
            vessel_files.save_vessel(ship, copy)
            exists = file.resolve() == (folder / "vessel.toml").resolve()
        if ship.name in declarations.vessel_names():
            fix = "give yours another one with --name, or in its vessel file"
            raise errors.ConfigurationError(f"{ship.name} is the name of a ship in Seatrial", fix=fix)
        return ship, None if exists else copy.read_text(encoding="utf-8")


def _filled_template(file: str, name: str, ship: vessel_files.Vessel, controls: str) -> str:
    """A template with the names and the controls in their places."""
    words = {"NAME": name, "SHIP": json.dumps(ship.name)[1:-1], _CONTROLS: controls}
    template = (TEMPLATES / file).read_text(encoding="utf-8")
    return re.sub("|".join(words), lambda match: words[match[0]], template)


TEMPLATE = Path(__file__).resolve().parents[1] / "trials" / "demo.toml"
SHIP, MODEL, SEA_STATE = "gunnerus_long", "gunnerus_short", "gentle"
COMPILING_S = 300.0
VOYAGE_S, TRAINING_VOYAGES, TRAINING_S = 1200.0, 6, 1800.0
SPEED = 24.0
DEMO_HORIZON_S, STRIDE_S = 15, 5
_RECORDER_TIMEOUT_S = 30.0
_SILENCE_S = 5.0  # after which nothing more is on its way to a recording


@dataclass(frozen=True, slots=True)
class Demonstration:
    """What the demo made and found."""

    report: Path
    recording: Path
    played: Playback
    lost: dict[str, int]
    windows: HeldWindows
    validation: Validation
    diagnosis: result.Diagnosis


def run_demonstration(folder: Path, seed: int, say: Callable[[str], None]) -> Demonstration:
    """Run the whole chain into ``folder``. ``say`` gets a line a step."""
    folder.mkdir(parents=True, exist_ok=True)
    say("1  simulate a voyage of the lengthened ship, as its sensors would report it")
    voyage = simulate_to(folder / "voyage.mcap", "voyage", VOYAGE_S, seed)
    say(f"2  play it {SPEED:g} times as fast onto a CAN bus, a serial line and MAVLink, and record them; meanwhile")
    say(f"   train a calibrator on {TRAINING_VOYAGES} earlier voyages, on top of the model of the ship before")
    with run_in_processes(partial(train_on_earlier, str(folder), seed), partial(compile_diagnosis)):
        played, path = play_and_record(voyage, folder)
    trained = load(folder / "calibrator")
    recording = reader.read_recording(path)
    recorded = {name: series.value.size for name, series in recording.series.items()}
    lost = {name: count - recorded.get(name, 0) for name, count in played.counts.items() if name in ships.NAMES}
    say(f"   {sum(played.counts.values()):,} values played, {sum(lost.values()):,} lost")
    say("3  check the data")
    quality = check.check_recording(recording)
    good = sum(channel.grade == "good" for channel in quality.channels.values())
    codes = Counter(finding.code for finding in quality.findings)
    findings = ", ".join(f"{count} {code.replace('_', ' ')}" for code, count in codes.items())
    say(f"   {good} of {len(quality.channels)} channels good; {findings or 'nothing found'}")
    say("4  bring it to 1 Hz and cut the windows in which the thrusters were held")
    windows = windows_of_tables(tables_of_recordings([path]), DEMO_HORIZON_S, STRIDE_S)
    dropped = ", ".join(f"{count} {plain(reason)}" for reason, count in windows.dropped.items())
    say(f"   {windows.kept} of {windows.candidates} windows held, dropped: {dropped or 'none'}")
    say("5  validate the calibrator on the recorded voyage, which it has not seen")
    dataset = load_dataset([path], DEMO_HORIZON_S, STRIDE_S)
    refuse_training_data(dataset.sources, trained)
    model = vessel_files.reference_model(vessel_files.trials_of_recordings([path]), MODEL)
    validation = replace(
        validate_predictions(dataset, effects.vessel_plant(model.vessel), trained), model=model.choice
    )
    say("6  diagnose what the model of the ship before lacks")
    diagnosis = diagnose_to(folder / "diagnosis", path)
    for effect in diagnosis.effects:
        say(f"   {effect.sentence}")
    say("7  write the report")
    with errors.progress_bar("report") as progress:
        report, *_ = write_folder_report(folder, Choices(), progress, [path])
    return Demonstration(report, path, played, lost, windows, validation, diagnosis)


@contextmanager
def run_in_processes(*calls: partial[None]) -> Iterator[None]:
    """Make calls of this module's functions in processes of their own, and wait for them at the end.

    Beside other work a recorder at 24 times the pace comes late, which looks like jumps of the ship's clock. Two
    processors at most are kept for it and the emulator, the calls have the others, or what is idle of a single one.
    Raises :class:`SeatrialError` for a call that fails; an error of this process ends the others.
    """
    processors = sorted(os.sched_getaffinity(0))
    own_count = max(1, min(2, len(processors) - 1))

    def start_worker(call: partial[None]) -> subprocess.Popen[str]:
        code = f"from seatrial.hybrid import workflows; workflows.{call.func.__name__}(*{call.args!r})"
        worker = stack.enter_context(
            subprocess.Popen([sys.executable, "-P", "-c", code], stderr=subprocess.PIPE, text=True)
        )
        stack.callback(worker.kill)
        # for good: only root may take a process out of this class again
        os.sched_setscheduler(worker.pid, os.SCHED_IDLE, os.sched_param(0))
        return worker

    def assign_processors(own_processors: Sequence[int], worker_processors: Sequence[int]) -> None:
        os.sched_setaffinity(0, own_processors)
        for worker in workers:
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setaffinity(worker.pid, worker_processors)

    with ExitStack() as stack:
        workers = [start_worker(call) for call in calls]
        try:
            assign_processors(processors[:own_count], processors[own_count:] or processors)
            yield
        finally:
            assign_processors(processors, processors)
        for call, worker in zip(calls, workers, strict=True):
            _, stderr = worker.communicate()
            if worker.returncode:
                why = stderr.strip()[-300:] or f"it ended with status {worker.returncode}"
                raise errors.SeatrialError(f"{call.func.__name__} failed", where="demo", why=why)


def diagnose_to(out: Path, recording: Path) -> result.Diagnosis:
    """Diagnose a voyage against the model of the ship before; a report of its own in ``out``."""
    vessel = vessel_files.load_vessel(MODEL)
    out.mkdir(exist_ok=True)
    with errors.progress_bar("diagnosing") as progress:
        run = diagnose_files([recording], vessel, verdict.TOLERANCE, effects.CATALOGUE, progress=progress)
    write_diagnosis(run, vessel, out)
    return run.diagnosis


def compile_diagnosis() -> None:
    """Diagnose a short voyage, for the sake of the compiled code that this leaves on the disk."""
    with TemporaryDirectory() as folder:
        voyage = simulate_to(Path(folder) / "voyage.mcap", "voyage", COMPILING_S, 0)
        diagnose_to(Path(folder) / "diagnosis", voyage)


def simulate_to(path: Path, manoeuvre: str, duration_s: float, seed: int) -> Path:
    """Simulate a trial of the lengthened ship and write it as a recording."""
    table, _ = simulate_trial(SHIP, SEA_STATE, manoeuvre, duration_s, 10.0, seed)
    origin = trial_file.load_config(TEMPLATE).trial.origin
    latitude_deg, longitude_deg = origin or (None, None)
    trial = Trial(path.stem, SHIP, origin_latitude_deg=latitude_deg, origin_longitude_deg=longitude_deg)
    writer.write_table(table, path, trial, source="simulated")
    return path


def play_and_record(voyage: Path, folder: Path) -> tuple[Playback, Path]:
    """Play a recording onto simulated lines while the recorder, a process of its own, records them."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with errors.progress_bar("recording") as progress, NullModem() as can, NullModem() as serial:
        sending = _write_demo_configuration(
            folder / "emulator.toml", can.emulator_device, serial.emulator_device, port
        )
        receiving = _write_demo_configuration(folder / "logger.toml", can.logger_device, serial.logger_device, port)
        recordings = folder / "recordings"
        recorder = subprocess.Popen(
            [sys.executable, "-P", "-c", "import seatrial; seatrial.main()", "record", receiving, "-o", recordings],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        lines = list[str]()
        while not (lines and lines[-1].startswith("recording to")):  # its lines are open then
            if recorder.stderr is None or not (line := recorder.stderr.readline()):
                raise errors.SourceError("the recorder did not start", where="demo", why=" ".join(lines))
            lines.append(line)
        try:
            played = emulate(voyage, trial_file.load_config(sending), SPEED, progress)
            _wait_for_all(recordings, played.counts)
        finally:
            recorder.send_signal(signal.SIGINT)
            stdout, stderr = recorder.communicate(timeout=_RECORDER_TIMEOUT_S)
    if recorder.returncode != 0:
        raise errors.SourceError("the recorder failed", where="demo", why=stderr.strip())
    return played, Path(stdout.strip())


def _wait_for_all(folder: Path, counts: Mapping[str, int]) -> None:
    """Return when the recording holds all that was played, or has not grown for a while: then some are lost."""
    held, grown_s = -1, time.monotonic()
    while held < sum(counts.values()) and time.monotonic() - grown_s < _SILENCE_S:
        time.sleep(0.5)
        now = _count_recorded_values(folder, counts)
        if now > held:
            held, grown_s = now, time.monotonic()


def _count_recorded_values(folder: Path, names: Iterable[str]) -> int:
    """The number of values of these channels in the recording that a recorder is writing."""
    recordings = [reader.read_recording(path).series for path in folder.glob("*.mcap")]
    return sum(series[name].value.size for series in recordings for name in names if name in series)


def _write_demo_configuration(path: Path, can_device: str, serial_device: str, port: int) -> Path:
    """The demo's configuration with its cables and port filled in."""
    text = TEMPLATE.read_text(encoding="utf-8")
    dbc = TEMPLATE.parent / "vessels" / "thrusters.dbc"
    text = text.replace('"CAN_LINE"', f'"{can_device}"').replace('"SERIAL_LINE"', f'"{serial_device}"')
    text = text.replace("port = 14554", f"port = {port}").replace("vessels/thrusters.dbc", str(dbc))
    return write_text(path, text)


def train_on_earlier(folder: str, seed: int) -> None:
    """Train on voyages of other days, on top of the model of the ship before; the calibrator is in ``folder``."""
    paths = [
        simulate_to(Path(folder, "training", f"voyage_{number}.mcap"), "voyage", TRAINING_S, seed + 99 + number)
        for number in range(1, TRAINING_VOYAGES + 1)
    ]
    plant = effects.vessel_plant(vessel_files.load_vessel(MODEL))
    dataset = load_dataset(paths, DEMO_HORIZON_S, STRIDE_S, shorter=True)
    save(train_calibrator(dataset, MODEL, plant, seed=seed), Path(folder, "calibrator"))
