"""From recordings to a diagnosis, and from a diagnosis to its files.

A model that is off in many things at once is re-identified before, on request or where the diagnosis of it shows
that. What the structure of a model can close is what remains when its coefficients are as good as the trial can
make them. They are identified from all legs but those of a fold, and predictions are judged on that fold's, so that
the figure is of legs that took no part. Where these do not come closer, the model stays as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import Progress, part_of, printable_name
from seatrial.acquisition.core.files import remove_file, write_text, written_together
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.tables.table import NANO, refuse_duplicates, times_ns
from seatrial.hybrid.diagnosis.acceptance import HELD_OUT_LEVEL, chance_of_gains
from seatrial.hybrid.diagnosis.diagnose import TOLERANCE, diagnose
from seatrial.hybrid.diagnosis.gap import HORIZON_S, UnseenWindows, fold_of, predicted_tracks, unseen_windows
from seatrial.hybrid.diagnosis.linearise import linear_model, model_of, next_states, true_states
from seatrial.hybrid.diagnosis.log import Log, log_of
from seatrial.hybrid.diagnosis.nuisance_basis import force_range
from seatrial.hybrid.diagnosis.result import Diagnosis, Estimate, Extras, IdentifiedCorrection
from seatrial.hybrid.diagnosis.serialisation import DIAGNOSIS, write_figure_data
from seatrial.hybrid.diagnosis.verdict import Conclusion
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.effects.catalogue import catalogue_of, vessel_plant
from seatrial.hybrid.effects.regime import as_file
from seatrial.hybrid.identification.identify import Identification, identify_tables
from seatrial.hybrid.prediction.baselines import present_motion_held
from seatrial.hybrid.prediction.scores import distances
from seatrial.hybrid.report.diagnosis_sentences import describe
from seatrial.hybrid.report.diagnosis_words import correction_sentence, model_line, write_report
from seatrial.hybrid.report.words import plain
from seatrial.hybrid.vessel.files import reference_model, save_vessel, trials_of, with_effects
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.workflows.checked import Checked, checked_files, driven_by_orders, without_wind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEGMENT_S = 2.0 * HORIZON_S
"""A stretch that the fit simulates from a start of its own: what is to be foretold, and where that has led to."""

_FORCES = ("surge", "sway", "yaw")


@dataclass(frozen=True, slots=True)
class Refit:
    """A vessel with coefficients from all of a trial, or as it was where that is no better, and how that went."""

    vessel: Vessel
    correction: IdentifiedCorrection


def refit_model(tables: Sequence[pd.DataFrame], vessel: Vessel, progress: Progress = lambda share: None) -> Refit:
    """Re-identify ``vessel`` from raw tables, and judge that on legs left out.

    Raises as :func:`.identify_tables`.
    """
    log = log_of(tables)
    windows = unseen_windows(log, model_of(vessel, {}))
    folds = np.unique(windows.fold).tolist()
    named = {str(number): table for number, table in enumerate(tables)}
    after = windows.before.copy()
    for number, fold in enumerate(folds):
        others = _without_fold(named, log, fold)
        part = part_of(progress, number, len(folds) + 1)
        refitted = identify_tables(others, vessel, segment_s=SEGMENT_S, progress=part)[0].vessel
        mine = windows.fold == fold
        after[mine] = _predicted(windows, refitted, mine)
    whole = part_of(progress, len(folds), len(folds) + 1)
    found = identify_tables(named, vessel, segment_s=SEGMENT_S, progress=whole)[0]
    correction = _correction(windows, after, found, forces_moved(log, vessel, found.vessel))
    return Refit(found.vessel if correction.applied else vessel, correction)


def _without_fold(tables: Mapping[str, pd.DataFrame], log: Log, fold: int) -> dict[str, pd.DataFrame]:
    """The tables without the seconds of a fold's legs: segments that these would cross have no data."""
    left_out = log.time_s[fold_of(log) == fold]
    rest = {name: table[~np.isin(_seconds(table), left_out)] for name, table in tables.items()}
    return {name: table for name, table in rest.items() if len(table)}


def _seconds(table: pd.DataFrame) -> Floats:
    return np.asarray(np.rint(times_ns(table) / NANO))


def _predicted(windows: UnseenWindows, vessel: Vessel, mine: np.ndarray) -> Floats:
    plant = vessel_plant(vessel)
    return predicted_tracks(windows.log, plant, true_states(windows.log, plant), windows.starts[mine])


def forces_moved(log: Log, before: Vessel, after: Vessel) -> dict[str, float]:
    """How far the forces of two vessels are apart along a trial, root mean square as shares of the force range.

    They are the forces ahead, across and in yaw that would make the one move in a second as the other does: a
    mass or an inertia that differs counts as the force that it takes.
    """
    old, new = vessel_plant(before), vessel_plant(after)
    linear = linear_model(log, old)
    moved = next_states(log, new, linear.origin) - next_states(log, old, linear.origin)
    force = np.linalg.solve(linear.B[:, 3:], moved[:, 3:, None])[..., 0]
    shares = np.sqrt((force**2).mean(axis=0)) / force_range(log, old, linear.origin)
    return dict(zip(_FORCES, shares.tolist(), strict=True))


def _correction(
    windows: UnseenWindows, after: Floats, found: Identification, forces: Mapping[str, float]
) -> IdentifiedCorrection:
    gains = windows.by_leg_m(windows.before) - windows.by_leg_m(after)
    held = present_motion_held(windows.log.nominal[windows.starts], HORIZON_S)
    off_m = np.array([distances(each, windows.measured) for each in (held, windows.before, after)])
    known = np.isfinite(off_m).all(axis=0)
    held_m, before_m, after_m = off_m[:, known].mean(axis=1).tolist()
    each_of = {name: each for each in found.coefficients for name in (each.name, *each.twins)}
    return IdentifiedCorrection(
        applied=bool(gains.mean() > 0.0 and chance_of_gains(gains) < HELD_OUT_LEVEL),
        constant_velocity_m=held_m,
        before_m=before_m,
        after_m=after_m,
        held_out_windows=int(known.any(axis=1).sum()),
        forces=forces,
        coefficients={name: Estimate(each.value, each.low, each.high, "") for name, each in each_of.items()},
        start={name: each.start for name, each in each_of.items()},
        known=tuple(name for name, each in each_of.items() if each.known),
    )


@dataclass(frozen=True, slots=True)
class DiagnosisRun:
    """A diagnosis, the numbers and tables that it was made from, and what its page shows beside it.

    ``refit`` is the vessel that it started from, where that was identified before.
    """

    diagnosis: Diagnosis
    conclusion: Conclusion
    extras: Extras
    tables: Sequence[pd.DataFrame]
    refit: Vessel | None = None

    def __str__(self) -> str:
        return f"{model_line(self.diagnosis)}\n{self.diagnosis}"

    def plot(self) -> Figure:
        """The parameters that were named with their 95 % intervals, and below them the gap that they close."""
        from seatrial.hybrid.report.diagnosis_plots import overview_figure

        return overview_figure(self.diagnosis)


def diagnose_tables(
    tables: Sequence[pd.DataFrame],
    vessel: Vessel,
    tolerance: float = TOLERANCE,
    catalogue: Catalogue | None = None,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = lambda share: None,
) -> DiagnosisRun:
    """Diagnose raw tables and put the conclusion into words; errors as :func:`.diagnose.diagnose`.

    The catalogue is the vessel's unless another is given; where no wind was recorded, with a steady one in the
    place of the effects of the wind. Where feedback is dead and orders are there, these drive the model, which is
    the first remark.
    """
    tables, driven = driven_by_orders(tables, vessel)
    every = catalogue_of(vessel) if catalogue is None else catalogue
    known = without_wind(every, tables)
    said = {} if known == every else {"wind": "not recorded: only a steady one was looked for"}
    conclusion = diagnose(tables, vessel, tolerance, known, progress)
    diagnosis, extras = describe(conclusion, {**(provenance or {}), **said})
    return DiagnosisRun(replace(diagnosis, remarks=(*driven, *diagnosis.remarks)), conclusion, extras, tables)


def diagnose_files(
    files: Sequence[Path],
    vessel: Vessel,
    tolerance: float,
    catalogue: Catalogue,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool | None = None,
    identify: bool | None = None,
    progress: Progress = lambda share: None,
) -> DiagnosisRun:
    """Diagnose recordings, or a part of each one's time in percent; errors as :func:`.diagnose.diagnose`.

    Each is checked before (:func:`.checked_files`): it is parted where its positions jump, what stood still is
    left out, and faults of the record are repaired. With ``repair`` scales and delays of sensors are, too, and not
    diagnosed any more; ``rebuild_positions`` takes positions by dead reckoning, ``None`` where their time stamps
    jitter. ``identify`` has the model's coefficients identified from the recordings before (:func:`with_refit`),
    ``None`` where the diagnosis shows that it is off in many things.
    """
    hashes = refuse_duplicates(files)
    said = reference_model(trials_of(files), vessel).said
    provenance = {
        "software_version": software_version(),
        "recordings": ", ".join(printable_name(Path(file).name) for file in files),
        "recordings_sha256": ", ".join(hashes),
        "vessel": vessel.name,
        "rebuild_positions": "where their stamps jitter" if rebuild_positions is None else rebuild_positions,
        "part_percent": f"{part_percent[0]:g}..{part_percent[1]:g}",
    }

    def checked(repaired: bool) -> Checked:
        return checked_files(files, part_percent, repaired=repaired, rebuild_positions=rebuild_positions)

    def diagnosed(record: Checked, start: Vessel, part: Progress) -> DiagnosisRun:
        done = {"repaired": "; ".join(record.repairs), "left_out": "; ".join(record.remarks)}
        about = provenance | {"repair": record.repaired} | {name: text for name, text in done.items() if text}
        return diagnose_tables(record.tables, start, tolerance, catalogue, about, part)

    run, refit = with_refit(checked, diagnosed, vessel, identify=identify, repair=repair, progress=progress)
    first = replace(run.diagnosis, remarks=(*said.remarks.get("remarks", ()), *run.diagnosis.remarks))
    if refit is None:
        return replace(run, diagnosis=first)
    start = refit.vessel if refit.correction.applied else None
    return replace(run, diagnosis=replace(first, identified=refit.correction), refit=start)


def with_refit(
    checked: Callable[[bool], Checked],
    diagnosed: Callable[[Checked, Vessel, Progress], DiagnosisRun],
    vessel: Vessel,
    *,
    identify: bool | None = None,
    repair: bool = False,
    progress: Progress = lambda share: None,
) -> tuple[DiagnosisRun, Refit | None]:
    """What is ``diagnosed`` in a record that is ``checked``, with or without repair of its sensors.

    Before it, if ``identify`` or with None where the model proves :func:`off_in_many_things`, the coefficients are
    identified. The sensors are repaired then, too, because coefficients would absorb the scale of one. Where new
    coefficients are no better, the model as it is has been or is diagnosed.
    """
    record = checked(repair or bool(identify))
    progress(0.1)
    first = None if identify else diagnosed(record, vessel, lambda share: progress(0.1 + 0.3 * share))
    if first is not None and (identify is False or not off_in_many_things(first.diagnosis)):
        progress(1.0)
        return first, None
    record = record if record.repaired else checked(True)
    tables = driven_by_orders(record.tables, vessel)[0]
    refit = refit_model(tables, vessel, lambda share: progress(0.4 + 0.3 * share))
    if first is None or refit.correction.applied:
        run = diagnosed(record, refit.vessel, lambda share: progress(0.7 + 0.3 * share))
    else:
        run = first
    why = () if first is None else (_many_things(first.diagnosis, refit.correction.applied),)
    return replace(run, diagnosis=replace(run.diagnosis, remarks=(*why, *run.diagnosis.remarks))), refit


MANY = 5
"""Effects named at once from which a model that needs them is better re-identified: more than the three causes
that simulated trials had at most, and fewer than the eight to eleven named for halves of R/V Gunnerus' trials of
2022."""


def off_in_many_things(diagnosis: Diagnosis) -> bool:
    """Whether a model predicts worse than constant velocity does, needs many effects, and forces remain beside."""
    gap = diagnosis.gap
    worse = gap.before_m > gap.constant_velocity_m
    return worse and len({each.name for each in diagnosis.effects}) >= MANY and diagnosis.remainder is not None


def _many_things(diagnosis: Diagnosis, applied: bool) -> str:
    gap, names = diagnosis.gap, dict.fromkeys(plain(each.name) for each in diagnosis.effects)
    outcome = "its coefficients were re-identified" if applied else "new coefficients were not better"
    return (
        f"The model as it is predicts worse than constant velocity ({gap.before_m:.2f} m against "
        f"{gap.constant_velocity_m:.2f} m), and {len(names)} effects left forces unexplained: {outcome}. The "
        f"effects were {', '.join(names)}; with them the error on held-out legs was {gap.after_m:.2f} m"
    )


def write_diagnosis(run: DiagnosisRun, vessel: Vessel, folder: Path) -> Path:
    """Write ``diagnosis.json``, ``vessel.toml``, ``report.html`` and the numbers behind its figures.

    Where a calibrator was trained on top ``ladder.json``, where the model was identified before
    ``identified.toml``, and where regimes were found ``regimes.py``; files of an earlier diagnosis go. Returns the
    page's path.

    Raises :class:`StorageError`.
    """
    with written_together(folder / DIAGNOSIS):
        write_figure_data(run.diagnosis, run.extras, folder)
        _write_regimes(run.conclusion, folder / "regimes.py")
        if run.refit is None:
            remove_file(folder / "identified.toml")
        else:
            save_vessel(run.refit, folder / "identified.toml")
        save_vessel(vessel_with_effects(run.refit or vessel, run.diagnosis), folder / "vessel.toml")
        return write_report(run.diagnosis, run.extras, folder)


def _write_regimes(conclusion: Conclusion, path: Path) -> None:
    found = {each.name: (each.regime, each.value) for each in conclusion.regimes}
    if found:
        write_text(path, as_file(found))
    else:
        remove_file(path)


def vessel_with_effects(vessel: Vessel, diagnosis: Diagnosis) -> Vessel:
    """``vessel`` with what was named, and where that comes from.

    A named effect that the vessel has already takes that one's place: its value is what both come to. What is not
    the same in all of the trial stands as it is at the end; the sea and the sensors of each recording stay with it.
    """
    kept = [each for each in diagnosis.effects if each.in_vessel]
    effects = {each.name: {name: estimate.value for name, estimate in each.parameters.items()} for each in kept}
    notes = {
        f"diagnosis_{each.name}": "; ".join(
            f"{name} {estimate.value:.6g} ({estimate.low:.6g} to {estimate.high:.6g}) {estimate.unit}"
            for name, estimate in each.parameters.items()
        )
        for each in kept
    }
    if diagnosis.identified is not None:
        notes[f"diagnosis_{diagnosis.identified.name}"] = correction_sentence(diagnosis.identified)
    result = with_effects(vessel, effects, **_plain(diagnosis.provenance), **notes, verdict=diagnosis.verdict)
    return replace(result, name=f"{vessel.name}_diagnosed", description=_description(vessel, diagnosis))


_OF_SCOPE = {"day": " (of the day of that trial)", "recording": " (of its sensors)"}


def _description(vessel: Vessel, diagnosis: Diagnosis) -> str:
    added = dict[str, list[str]]()
    for each in diagnosis.effects:
        if each.in_vessel:
            added.setdefault(each.scope, []).append(each.name)
    parts = [", ".join(names) + _OF_SCOPE.get(scope, "") for scope, names in added.items()]
    if diagnosis.identified is not None and diagnosis.identified.applied:
        parts.insert(0, "identified coefficients")
    return f"{vessel.description or vessel.name}; a diagnosis added {'; '.join(parts) or 'nothing'}"


def _plain(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """What a TOML table may hold: texts and numbers."""
    return {
        f"diagnosis_{key}": value if isinstance(value, int | float) else str(value)
        for key, value in provenance.items()
    }
