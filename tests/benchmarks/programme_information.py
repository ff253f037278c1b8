"""How soon a programme of trials tells what it tells of the coefficients, in its own order and in the conductor's.

    python -m tests.benchmarks.programme_information [--ships tanker gunnerus twin_screw]

The runs of the template ``identification`` are simulated once each with the ship of the file; their information on
its coefficients is added to the prior. Printed is when nine tenths, and 95 %, of what the whole programme takes off
their mean variance are taken off: kind by kind (zigzags, speed runs, circles, pull-outs, a stop), in the order of
the file, and where each next run is the one that tells most for its time, as with an outlook. No fault, no wind: a
comparison of designs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.conduct.programme import PlannedRun, TrialProgramme, programme_from_template
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.identification import fit, identify
from seatrial.hybrid.identification.outlook import duration_of_run_s, legs_of_run, trial_ship_of
from seatrial.hybrid.simulation import vessel_check
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import Vessel
from tests.benchmarks.conducted_days import vessel_of

KINDS = ("zigzag", "speed_run", "turning_circle", "pull_out", "stopping")


def information_of_runs(programme: TrialProgramme, vessel: Vessel) -> list[Floats]:
    """The information of each run on the coefficients [P, P], none where it is too short to tell anything."""
    legs = [legs_of_run(run, trial_ship_of(run, programme, vessel), programme.length_s) for run in programme.run]
    first = next(place for place, run in enumerate(programme.run) if run.kind == "zigzag")
    duration_s = duration_of_run_s(programme.run[first], programme)
    noisy, _ = simulate_trial(vessel, "gentle", legs[first], duration_s, 4.0, 1)
    segment_s = fit.segment_durations_s({"run": noisy}, vessel_plant(vessel))[:2][-1]
    _, fitted, model = identify.identify_tables({"run": noisy}, vessel, segment_s=segment_s)  # for its noise
    fitted, count, information = replace(fitted, z=0.0 * fitted.z), len(model.coefficients), list[Floats]()
    for run, sailed in zip(programme.run, legs, strict=True):
        try:
            told = identify.information_of(model, fitted, sailed, duration_of_run_s(run, programme))
        except SeatrialError:
            told = np.zeros((count, count))
        information.append(told)
    return information


def minutes_to_know(
    programme: TrialProgramme, information: Sequence[Floats],
    choose: Callable[[list[int], PlannedRun | None, Floats], int],
) -> list[tuple[float, float]]:  # fmt: skip
    """After each run the time [min] and the mean variance left, where ``choose`` takes the next of the places that
    remain, after a run and with what is known."""
    waiting = [place for place, run in enumerate(programme.run) for _ in range(run.repeats)]
    minutes, last, known, after = 0.0, None, np.eye(len(information[0])), list[tuple[float, float]]()
    while waiting:
        place = choose(waiting, last, known)
        waiting.remove(place)
        run = programme.run[place]
        minutes += programme.minutes_between(last, run) + programme.minutes_of(run)
        last, known = run, known + information[place]
        after.append((minutes, float(np.mean(np.diag(np.linalg.inv(known))))))
    return after


def most_for_its_time(
    programme: TrialProgramme, information: Sequence[Floats],
    waiting: list[int], last: PlannedRun | None, known: Floats,
) -> int:  # fmt: skip
    """The place of the run with the most information for its minutes."""

    def rate(place: int) -> float:
        run = programme.run[place]
        minutes = programme.minutes_between(last, run) + programme.minutes_of(run)
        gain = np.linalg.slogdet(known + information[place])[1] - np.linalg.slogdet(known)[1]
        return float(gain / minutes)

    return max(waiting, key=rate)


def main() -> None:
    """Print the times of the three orders."""
    parser = argparse.ArgumentParser(prog="programme_information", description=__doc__)
    parser.add_argument("--ships", nargs="*", default=["tanker", "gunnerus", "twin_screw"])
    for name in parser.parse_args().ships:
        vessel = vessel_of(name)
        ship = vessel_check.ship_for_trials(vessel)
        programme = programme_from_template(
            "identification", ship.length_m, vessel_check.test_speed_mps(vessel, ship.rpm), wind_from_deg=0.0,
            largest_helm_deg=vessel_check.largest_helm_deg(ship),
        )  # fmt: skip
        information = information_of_runs(programme, vessel)
        by_kind = [KINDS.index(run.kind) for run in programme.run]
        orders = {
            "kind by kind": lambda waiting, last, known, by_kind=by_kind: min(waiting, key=by_kind.__getitem__),
            "in the order of the file": lambda waiting, last, known: waiting[0],
            "by the outlook": partial(most_for_its_time, programme, information),
        }  # fmt: skip
        for order, choose in orders.items():
            after = minutes_to_know(programme, information, choose)
            minutes, left = np.array(after).T
            wanted = (1.0 - share * (1.0 - left[-1]) + 1e-12 for share in (0.9, 0.95, 1.0))
            most, more, everything = (minutes[np.argmax(left <= level)] for level in wanted)
            print(
                f"{name}, {order}: 90 % after {most:.0f} min, 95 % after {more:.0f}, all after {everything:.0f}; "
                f"variance left {left[-1]:.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
