"""The outlook of a programme from the runs that were sailed: criteria predicted by the ship as identified from
them, and the information that each run which remains would add.

A criterion is predicted with the interval of :mod:`seatrial.hybrid.evaluation.predicted_indices`: the errors of the
coefficients, and those of the model's form as runs show them that were held out of a fit. The latter is not known
at larger helms than were sailed; it is taken to grow with the helm. A criterion is not predicted where fewer than
three indices of its family (turn, overshoot, stop) were held out: a circle or a stop has as many, a zigzag two or
three.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite

from seatrial.acquisition.core.errors import DataShortageError, SeatrialError
from seatrial.analysis.conduct.outlook import Outlook, RecordedRun, RunOutlook
from seatrial.analysis.conduct.programme import PlannedRun, TrialProgramme
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.indices import Index
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.evaluation import predicted_indices
from seatrial.hybrid.identification import fit, identify
from seatrial.hybrid.identification.steering_gear import fit_gear
from seatrial.hybrid.simulation import manoeuvres, vessel_check
from seatrial.hybrid.simulation.index_table import FormErrors, family_of
from seatrial.hybrid.vessel.files import Vessel

_APPROACH_LENGTHS = 5.0  # simulated before a run, in L / V: it begins on a straight course
_PULL_OUT_DEG = 180.0  # of turn before the helm is put amidships: the turn is steady by then
_FEWEST_HELD_OUT = 3  # indices of a family that were held out, from which the error of the form is estimated


def outlook_of_runs(
    vessel: Vessel, programme: TrialProgramme, recorded: Sequence[RecordedRun], remaining: Mapping[int, PlannedRun]
) -> Outlook:
    """The outlook by a vessel's model, identified anew from all recorded runs.

    Raises :class:`DataShortageError` and :class:`InputError` as :func:`.identify_with_folds`.
    """
    tables = {f"{run.planned.sided_name} ({number} of those recorded)": run.table
              for number, run in enumerate(recorded, 1)}  # fmt: skip
    vessel, _ = fit_gear(tables, vessel)
    shortest_s, *longer_s = fit.segment_durations_s(tables, vessel_plant(vessel))
    segment_s = longer_s[0] if longer_s else shortest_s  # 5 ship lengths, which predict circles best (see identify)
    best, _, _ = identify.fit_with_folds(tables, vessel, segment_s=segment_s)
    identified = identify.identification_of(best.model, best.fitted)
    ship = identify.uncertain_vessel(best.model, best.fitted)
    form = predicted_indices.form_errors(
        predicted_indices.unseen_rows(best.held_out_vessels, identified.currents), at_least_shown=True
    )
    sailed_deg = max((run.planned.helm_deg or 0.0 for run in recorded if run.valid), default=0.0)
    outlooks = {}
    for place, run in remaining.items():
        outlook = RunOutlook(predicted_criteria(ship, form, run, programme, sailed_deg))
        with suppress(SeatrialError):
            legs = legs_of_run(run, trial_ship_of(run, programme, ship.vessel), programme.length_s)
            duration_s = duration_of_run_s(run, programme)
            added = identify.expected_information(best.model, best.fitted, run.sided_name, legs, duration_s)
            outlook = replace(outlook, gain=added.gain, left=added.left)
        outlooks[place] = outlook
    known = sum(coefficient.known for coefficient in identified.coefficients)
    return Outlook(outlooks, len(tables), known, len(identified.coefficients))


def predicted_criteria(
    ship: predicted_indices.UncertainVessel,
    form: FormErrors,
    run: PlannedRun,
    programme: TrialProgramme,
    sailed_deg: float,
) -> dict[str, Index]:
    """The indices of a run's criteria by name, with limits and results, ``sailed_deg`` the largest helm so far.

    Empty where too few indices of the family were held out, for a kind without criteria, and where the ship cannot
    make the run.
    """
    wanted = [criterion for criterion in criteria.CRITERIA if criterion.name in run.purpose
              and form.get(family_of(criterion.index), (0.0, 0))[1] >= _FEWEST_HELD_OUT]  # fmt: skip
    if not wanted or not sailed_deg:
        return {}
    indices = predicted_indices.predicted_by_test(lambda vessel: indices_of_run(run, programme, vessel), ship, form)
    length_m, growth = programme.programme.length_m, max((run.helm_deg or 0.0) / sailed_deg, 1.0)
    predicted = {}
    for criterion in wanted:
        index, limit = indices.get(criterion.index), criterion.limit(length_m, programme.speed_mps(run))
        if index is None or limit is None or not isfinite(index.high):
            continue
        reach = (index.high / index.value) ** growth
        lengths = index.value / length_m if index.unit == "m" else None
        index = replace(index, low=index.value / reach, high=index.value * reach, lengths=lengths, limit=limit)
        predicted[criterion.name] = replace(index, result=criteria.compare_with_limit(index, limit, ()))
    return predicted


def trial_ship_of(run: PlannedRun, programme: TrialProgramme, vessel: Vessel) -> vessel_check.TrialShip:
    """A vessel with the shaft speed of a run's approach. Raises :class:`DataShortageError` where it does not make
    the speed."""
    return vessel_check.ship_for_trials(vessel, programme.speed_mps(run))


def indices_of_run(run: PlannedRun, programme: TrialProgramme, vessel: Vessel) -> dict[str, float]:
    """The indices of a run as a vessel makes it in calm; none of a kind that has no criteria. Raises
    :class:`DataShortageError` and :class:`ModelRangeError` where it cannot."""
    ship, helm_deg = trial_ship_of(run, programme, vessel), run.helm_deg or 0.0
    if run.kind == "turning_circle":
        test = vessel_check.turning_circle_test(ship, run.sign, helm_deg)
    elif run.kind == "zigzag":
        test = vessel_check.zigzag_test(ship, run.sign, helm_deg, run.switch_deg or 0.0)
    elif run.kind == "stopping":
        test = vessel_check.stopping_test(ship, -ship.rpm)
    else:
        return {}
    return {name: index.value for name, index in test.indices.items()}


def duration_of_run_s(run: PlannedRun, programme: TrialProgramme) -> float:
    """How long a simulated run takes with its approach [s]."""
    return 60.0 * programme.minutes_of(run) + _APPROACH_LENGTHS * programme.length_s


def legs_of_run(run: PlannedRun, ship: vessel_check.TrialShip, length_s: float) -> manoeuvres.Manoeuvre:
    """What a simulated ship does in a run after a straight approach; ``length_s`` is L / V.

    Raises :class:`DataShortageError` for a kind that is not simulated.
    """
    helm_deg = -run.sign * (run.helm_deg or 0.0)
    helm, straight = manoeuvres.helm_leg(helm_deg, ship.rpm), manoeuvres.steer(0.0, inf, ship.rpm)
    legs: manoeuvres.Manoeuvre
    if run.kind == "zigzag":
        legs = manoeuvres.zigzag(helm_deg, -run.sign * (run.switch_deg or 0.0), ship.rpm, swings=run.swings)
        legs = tuple(replace(leg, at_most_s=inf) for leg in legs)
    elif run.kind == "turning_circle":
        legs = (replace(helm, turn_deg=run.turn_deg),)
    elif run.kind == "pull_out":
        legs = (replace(helm, turn_deg=_PULL_OUT_DEG), manoeuvres.helm_leg(0.0, ship.rpm))
    elif run.kind == "stopping":
        legs = (manoeuvres.Leg(rpm=-ship.rpm if run.astern else 0.0, slower_mps=0.0), manoeuvres.Leg(rpm=0.0))
    elif run.kind == "speed_run":
        legs = (straight,)
    else:
        raise DataShortageError(f"a {run.kind} is not simulated")
    return (replace(straight, at_most_s=_APPROACH_LENGTHS * length_s), *legs)
