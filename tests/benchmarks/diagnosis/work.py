"""The jobs that worker processes do: a sound trial, the size of something outside the catalogue, a case."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import ModelRangeError, SeatrialError
from seatrial.hybrid.diagnosis.result import Diagnosis
from seatrial.hybrid.diagnosis.verdict import TOLERANCE
from seatrial.hybrid.effects import CATALOGUE, catalogue_with
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import DiagnosisRun, diagnose_tables
from tests.benchmarks.diagnosis import at_sea, rudder_ships
from tests.benchmarks.diagnosis.at_sea import SeaCase
from tests.benchmarks.diagnosis.cases import Case
from tests.benchmarks.diagnosis.design import VESSEL, Design, Hidden, simulated
from tests.benchmarks.diagnosis.outside_size import size_found
from tests.benchmarks.diagnosis.rudder_ships import RudderCase
from tests.benchmarks.diagnosis.second_trial import with_next_manoeuvre
from tests.benchmarks.diagnosis.sound import sound
from tests.benchmarks.measured import judge as measured_judge
from tests.benchmarks.measured.judge import MeasuredCase

Plain = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Planned:
    """A case with the hidden drawn: what the analyst must not know."""

    case: Case
    hidden: Hidden
    outside: Mapping[str, float]
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SizeOutside:
    """The question how large something outside the catalogue must be."""

    name: str
    design: Design

    @property
    def key(self) -> str:
        """The question in one word."""
        return f"size/{self.design.key}/{self.name}"


Job = Planned | SizeOutside | Design | RudderCase | MeasuredCase | SeaCase


def key_of(job: Job) -> str:
    """The key of a job's line in the file of results."""
    return job.case.key if isinstance(job, Planned) else job.key


def done(job: Job) -> Plain:
    """A job's result as plain values; what went wrong stands in it."""
    began = time.perf_counter()
    try:
        result = _result(job)
    except ModelRangeError as error:  # a hidden effect may take the ship out of the range of her coefficients
        result = {"refused": str(error)}
    except (SeatrialError, ArithmeticError, ValueError, LookupError, np.linalg.LinAlgError) as error:
        result = {"crashed": repr(error), "where": traceback.format_exc(limit=-3)}
    return {"key": key_of(job), "seconds": round(time.perf_counter() - began, 1), **result}


def _result(job: Job) -> Plain:
    if isinstance(job, Design):
        return sound(job)
    if isinstance(job, RudderCase):
        return rudder_ships.judged(job)
    if isinstance(job, MeasuredCase):
        return measured_judge.judged(job)
    if isinstance(job, SeaCase):
        return at_sea.judged(job)
    if isinstance(job, SizeOutside):
        return {"size": size_found(job.name, job.design)}
    return judged(job)


def judged(planned: Planned) -> Plain:
    """Simulate, diagnose from the 13 channels alone, and put the truth beside what was said."""
    case = planned.case
    table, truth = simulated(case.design, planned.hidden, planned.outside)
    vessel = load_vessel(VESSEL)
    catalogue = catalogue_with((), tuple(planned.hidden) if case.blind else ())
    began = time.perf_counter()
    examined = diagnose_tables([table], vessel, TOLERANCE, catalogue)
    took = time.perf_counter() - began
    result = {
        **described(planned, truth),
        "said": said(examined.diagnosis),
        "diagnosis_s": round(took, 2),
        "errors": [] if case.blind else errors_over_bounds(examined, planned.hidden),
    }
    if case.group == "cannot_tell" and examined.diagnosis.next_manoeuvre is not None:
        after = with_next_manoeuvre(case.design, planned.hidden, table, examined, vessel)
        result["after_next_manoeuvre"] = said(after.diagnosis)
    return result


def described(planned: Planned, truth: Mapping[str, Any]) -> Plain:
    """The case and its truth."""
    case, design = planned.case, planned.case.design
    return {
        "group": case.group, "simulator": design.simulator, "sea": design.sea, "programme": design.programme,
        "model_error_percent": design.model_error_percent, "multiple": case.multiple,
        "tolerance": TOLERANCE,
        "hidden": {name: dict(values) for name, values in planned.hidden.items()},
        "outside": dict(planned.outside), "rivals": list(planned.rivals), "truth": dict(truth),
    }  # fmt: skip


def said(diagnosis: Diagnosis) -> Plain:
    """What the diagnosis says, without its map."""
    plain = diagnosis.as_dict()
    kept = ("verdict", "effects", "indistinguishable", "unknown", "gap", "next_manoeuvre")
    force_range = diagnosis.provenance["force_range"]
    return {**{name: plain[name] for name in kept}, "force_range": list(force_range.values())}


def errors_over_bounds(examined: DiagnosisRun, hidden: Hidden) -> list[float]:
    """Error over standard error, by free coordinate, of effects that are hidden and named.

    The standard errors are those of a joint fit of what is truly hidden on the last view of the data: the bound.
    """
    named = {each.name: each for each in examined.diagnosis.effects}
    evidence, result = examined.conclusion.accepted.sized, []
    fit = evidence.fit(tuple(hidden))
    for name, values in hidden.items():
        if name not in named:
            continue
        effect = CATALOGUE[name]
        found = effect.free_coordinates({key: each.value for key, each in named[name].parameters.items()})
        places = [fit.columns.index(column) for column in evidence.columns_of([name])]
        bound = np.sqrt(np.diag(fit.covariance)[places])
        result += [float(each) for each in (np.array(found) - np.array(effect.free_coordinates(values))) / bound]
    return result
