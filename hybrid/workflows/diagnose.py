"""From recordings to a diagnosis, and from a diagnosis to its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from acquisition.core.files import write_text
from acquisition.core.progress import Progress
from acquisition.core.trial import software_version
from acquisition.recording.reader import read_recording
from analysis.tables.table import refuse_duplicates
from hybrid.diagnosis.diagnose import TOLERANCE, diagnose
from hybrid.diagnosis.result import Diagnosis, Extras
from hybrid.diagnosis.serialisation import write_figure_data
from hybrid.diagnosis.verdict import Conclusion
from hybrid.effects import Catalogue
from hybrid.effects.catalogue import catalogue_of
from hybrid.effects.regime import as_file
from hybrid.report.diagnosis_sentences import describe
from hybrid.report.diagnosis_words import correction_sentence, model_line, write_report
from hybrid.vessel.files import save_vessel, with_effects
from hybrid.vessel.parameters import Vessel
from hybrid.vessel.reference import reference_model, trials_of
from hybrid.workflows.checked import checked_tables, without_wind
from hybrid.workflows.orders import driven_by_orders
from hybrid.workflows.refit import refit_model

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class DiagnosisRun:
    """A diagnosis, the numbers that it was made from, and what its page shows beside it.

    ``refit`` is the vessel that it started from, where that was identified before.
    """

    diagnosis: Diagnosis
    conclusion: Conclusion
    extras: Extras
    refit: Vessel | None = None

    def __str__(self) -> str:
        return f"{model_line(self.diagnosis)}\n{self.diagnosis}"

    def plot(self) -> Figure:
        """The parameters that were named with their 95 % intervals, and below them the gap that they close."""
        from hybrid.report.diagnosis_plots import overview_figure

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
    return DiagnosisRun(replace(diagnosis, remarks=(*driven, *diagnosis.remarks)), conclusion, extras)


def diagnose_files(
    files: Sequence[Path],
    vessel: Vessel,
    tolerance: float,
    catalogue: Catalogue,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
    identify: bool = False,
    progress: Progress = lambda share: None,
) -> DiagnosisRun:
    """Diagnose recordings, or a part of each one's time in percent; errors as :func:`.diagnose.diagnose`.

    Each is checked before: it is parted where its positions jump, and what stood still is left out.
    ``repair`` puts right before what is certainly wrong, ``rebuild_positions`` with the repairs the positions too.
    What a repair puts right is not diagnosed any more. ``identify`` has the model's coefficients identified from
    the recordings before (:mod:`.refit`).
    """
    hashes = refuse_duplicates(files)
    said = reference_model(trials_of(files), vessel).said
    tables, left_out = list[pd.DataFrame](), list[str]()
    for number, file in enumerate(files):
        found = checked_tables(
            read_recording(file), part_percent, repaired=repair, rebuild_positions=rebuild_positions
        )
        tables += found.tables
        left_out += [f"{Path(file).name}: {each}" for each in found.remarks]
        progress(0.1 * (number + 1) / len(files))
    provenance = {
        "software_version": software_version(),
        "recordings": ", ".join(Path(file).name for file in files),
        "recordings_sha256": ", ".join(hashes),
        "vessel": vessel.name,
        "repair": repair,
        "rebuild_positions": rebuild_positions,
        "part_percent": f"{part_percent[0]:g}..{part_percent[1]:g}",
        **({"left_out": "; ".join(left_out)} if left_out else {}),
    }
    whole, driven = driven_by_orders(tables, vessel)
    refit = refit_model(whole, vessel, lambda share: progress(0.1 + 0.4 * share)) if identify else None
    begun = 0.1 if refit is None else 0.5
    start = vessel if refit is None else refit.vessel
    run = diagnose_tables(
        whole, start, tolerance, catalogue, provenance, lambda share: progress(begun + (1.0 - begun) * share)
    )
    remarks = (*said.remarks.get("remarks", ()), *driven, *run.diagnosis.remarks)
    correction = None if refit is None else refit.correction
    said_first = replace(run.diagnosis, remarks=remarks, identified=correction)
    return replace(run, diagnosis=said_first, refit=None if start is vessel else start)


def write_diagnosis(run: DiagnosisRun, vessel: Vessel, folder: Path) -> Path:
    """Write ``diagnosis.json``, ``vessel.toml``, ``report.html`` and the numbers behind its figures.

    Where a calibrator was trained on top ``ladder.json``, where the model was identified before
    ``identified.toml``, and where regimes were found ``regimes.py``; files of an earlier diagnosis go. Returns the
    page's path.

    Raises :class:`StorageError`.
    """
    write_figure_data(run.diagnosis, run.extras, folder)
    _write_regimes(run.conclusion, folder / "regimes.py")
    if run.refit is None:
        (folder / "identified.toml").unlink(missing_ok=True)
    else:
        save_vessel(run.refit, folder / "identified.toml")
    save_vessel(vessel_with_effects(run.refit or vessel, run.diagnosis), folder / "vessel.toml")
    return write_report(run.diagnosis, run.extras, folder)


def _write_regimes(conclusion: Conclusion, path: Path) -> None:
    found = {each.name: (each.regime, each.value) for each in conclusion.regimes}
    if found:
        write_text(path, as_file(found))
    else:
        path.unlink(missing_ok=True)


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


def _description(vessel: Vessel, diagnosis: Diagnosis) -> str:
    named = ", ".join(each.name for each in diagnosis.effects if each.in_vessel) or "nothing"
    return f"{vessel.description or vessel.name}; a diagnosis added {named}"


def _plain(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """What a TOML table may hold: texts and numbers."""
    return {
        f"diagnosis_{key}": value if isinstance(value, int | float) else str(value)
        for key, value in provenance.items()
    }
