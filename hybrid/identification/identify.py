"""``seatrial identify``: coefficients from recordings, what they are worth, and the vessel file with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from acquisition.core.arrays import Floats
from acquisition.core.progress import Progress
from acquisition.core.result import ModelResult
from acquisition.core.serialisation import to_json
from acquisition.core.trial import software_version
from analysis.estimation.likelihood import UNKNOWN, correlated_pairs
from hybrid.effects.catalogue import vessel_plant
from hybrid.identification.coefficients import Coefficient, coefficients_of
from hybrid.identification.fit import Fit, fit
from hybrid.identification.next_trial import Candidate, rank_trials
from hybrid.identification.response import Model, model_of
from hybrid.identification.segments import segments_of
from hybrid.prediction.scores import Score, scores_json
from hybrid.vessel.parameters import Vessel

_NORMAL_95 = 1.959964


@dataclass(frozen=True, slots=True)
class Estimate:
    """One coefficient: its value with the 95 % interval, what it was at the start with the interval that was
    thought of then, and whether the data know it.

    ``share`` is the standard error in units of the prior's; ``twins`` are names of the same number elsewhere.
    """

    name: str
    value: float
    low: float
    high: float
    start: float
    start_low: float
    start_high: float
    share: float
    twins: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """Whether the data say more of it than was thought before."""
        return self.share < UNKNOWN


@dataclass(frozen=True, slots=True)
class Judgement:
    """How far predictions are off on what took no part in the fits: scores by method on so many windows."""

    horizon_s: int
    windows: int
    scores: Mapping[str, Score]
    held_out: str


@dataclass(frozen=True, slots=True)
class Identification(ModelResult):
    """A vessel with coefficients from trials.

    ``correlation`` [P, P] is that of the ``coefficients`` in their order; ``surroundings`` are current and sensor
    errors by recording, in SI; ``candidates`` are trials that would tell more, the best first; ``set_aside`` says
    what of the recordings was not used; ``tracks`` are what a picture of the fit needs, measured and simulated.
    """

    vessel: Vessel
    coefficients: tuple[Estimate, ...]
    correlation: Floats
    surroundings: Mapping[str, Mapping[str, float]]
    segments: int
    duration_s: float
    left_out: int
    validation: Judgement | None = None
    candidates: tuple[Candidate, ...] = ()
    file: str = ""
    set_aside: tuple[str, ...] = ()
    tracks: tuple[Floats, Floats] = field(default=(np.zeros((0, 0, 2)), np.zeros((0, 0, 2))), repr=False)
    view = "hybrid.report.identification:identification_view"
    drawing = "hybrid.report.identification:draw_identification"
    size_inch = (11.0, 8.0)

    @property
    def entangled(self) -> list[tuple[str, str, float]]:
        """Pairs of known coefficients that cannot be told apart, and their correlation."""
        known = [number for number, each in enumerate(self.coefficients) if each.known]
        names = [self.coefficients[number].name for number in known]
        return correlated_pairs(names, self.correlation[np.ix_(known, known)])

    def as_dict(self) -> dict[str, Any]:
        """The JSON object of ``seatrial identify --json``."""
        names = ("value", "low", "high", "start", "known")
        judged = self.validation
        return {
            **self.remarks,
            "vessel": self.file,
            "set_aside": list(self.set_aside),
            "segments": self.segments,
            "segment_s": self.duration_s,
            "coefficients": {
                own: {name: getattr(each, name) for name in names}
                for each in self.coefficients
                for own in (each.name, *each.twins)
            },
            "correlated": [list(each) for each in self.entangled],
            "surroundings": {name: dict(own) for name, own in self.surroundings.items()},
            "validation": None
            if judged is None
            else {
                "horizon_s": judged.horizon_s,
                "windows": judged.windows,
                "held_out": judged.held_out,
                "methods": scores_json(judged.scores),
            },
            "next_manoeuvres": to_json(self.candidates),
        }


def identify_tables(
    tables: Mapping[str, pd.DataFrame],
    vessel: Vessel,
    *,
    only: Sequence[str] = (),
    candidates: Sequence[str] = (),
    segment_s: float | None = None,
    progress: Progress = lambda share: None,
) -> tuple[Identification, Fit, Model]:
    """The coefficients of ``vessel`` from tables of raw samples by recording, without a validation.

    ``only`` names those that are not known, by default all of :func:`coefficients_of`; ``candidates`` are
    manoeuvres to rank; ``segment_s`` is how long each stretch is that has a start of its own. Raises
    :class:`DataShortageError`, :class:`InputError` for recordings of another ship, :class:`ModelRangeError` where
    the model cannot follow them.
    """
    with threadpool_limits(1, user_api="blas"):  # small matrices, on which more threads only wait for each other
        wanted = set(only)
        coefficients = [each for each in coefficients_of(vessel) if not only or wanted & {each.name, *each.twins}]
        model = model_of(vessel, coefficients, segments_of(tables, vessel_plant(vessel), segment_s))
        found = fit(model, progress=progress)
        return _identification(model, found, rank_trials(model, found, candidates)), found, model


def _identification(model: Model, found: Fit, candidates: Sequence[Candidate]) -> Identification:
    kept = len(model.coefficients)
    deviation = np.sqrt(np.diag(found.covariance))[:kept]
    share = np.minimum(deviation, 1.0)
    estimates = [
        _estimate(each, at, own) for each, at, own in zip(model.coefficients, found.z[:kept], share, strict=True)
    ]
    around, segments = model.around(found.z), model.segments
    return Identification(
        vessel=identified_vessel(model, found.z, estimates),
        coefficients=tuple(estimates),
        correlation=found.covariance[:kept, :kept] / np.outer(deviation, deviation),
        surroundings={
            name: {each.name: float(value) for each, value in zip(model.surroundings, own, strict=True)}
            for name, own in zip(segments.names, around, strict=True)
        },
        segments=len(segments),
        duration_s=segments.duration_s,
        left_out=segments.left_out,
        candidates=tuple(candidates),
        tracks=(segments.measured[..., :2], model.reported(found.z, found.starts)[..., :2]),
    )


def _estimate(coefficient: Coefficient, at: float, share: float) -> Estimate:
    low, high = sorted(coefficient.value(at + side * _NORMAL_95 * share) for side in (-1.0, 1.0))
    before = sorted(coefficient.value(side * _NORMAL_95) for side in (-1.0, 1.0))
    return Estimate(
        coefficient.name,
        coefficient.value(at),
        low,
        high,
        coefficient.start,
        before[0],
        before[1],
        float(share),
        coefficient.twins,
    )


def identified_vessel(model: Model, z: Floats, estimates: Sequence[Estimate]) -> Vessel:
    """The vessel with the numbers at ``z``; what is known of each stands in its ``estimated``."""
    vessel, errors = model.vessel_at(z), dict(model.vessel.estimated)
    for coefficient, each in zip(model.coefficients, estimates, strict=True):
        if not coefficient.name.startswith("effects.") and each.value != 0.0:
            own = abs(coefficient.start / each.value) if not coefficient.keeps_sign else 1.0
            error = float(coefficient.width * each.share * own)
            errors |= dict.fromkeys((coefficient.name, *coefficient.twins), error)
    said = {
        "identified_from": ", ".join(model.segments.names),
        "identified_at": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "identified_by": software_version(),
        "identified_start": model.vessel.name,
    }
    return replace(vessel, estimated=errors, provenance={**model.vessel.provenance, **said})
