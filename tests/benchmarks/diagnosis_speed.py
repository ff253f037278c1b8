"""How long the diagnosis takes, and how that grows with the windows of 15 s and with the effects of the catalogue.

Run it as ``python tests/benchmarks/diagnosis_speed.py``; it prints and asserts nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path
from typing import TypeVar

import pandas as pd
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[2]))

from seatrial.hybrid.diagnosis.acceptance import accept, select_effects
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise
from seatrial.hybrid.diagnosis.linearise import linearise, model_of
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.diagnosis.regression import weigh_evidence
from seatrial.hybrid.diagnosis.verdict import TOLERANCE, diagnose
from seatrial.hybrid.effects import CATALOGUE, Catalogue
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel

WINDOWS, WINDOW_S = (250, 500, 1000), 15.0
FEWER = (12, 25)  # effects
Result = TypeVar("Result")


def trials(windows: int) -> list[pd.DataFrame]:
    """So many windows of a lengthened ship's programme in a gentle sea."""
    return [simulate_trial("gunnerus_long", "gentle", "programme", windows * WINDOW_S, 10.0, seed=1)[0]]


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Wall-clock time [s] of one call, and what it gives."""
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def stages(tables: list[pd.DataFrame], catalogue: Catalogue = CATALOGUE) -> dict[str, float]:
    """Times [s] of the log with its noise, one score of every effect, the naming, and the whole diagnosis."""
    vessel = load_vessel("gunnerus_short")
    model = model_of(vessel, catalogue)
    with threadpool_limits(1, user_api="blas"):
        log_s, estimate = timed(lambda: estimate_noise(linearise(log_of(tables), model, TOLERANCE)))
        score_s, evidence = timed(lambda: weigh_evidence(estimate))
        naming_s, _ = timed(lambda: accept(select_effects(evidence)))
    whole_s, _ = timed(lambda: diagnose(tables, vessel, TOLERANCE, catalogue))
    return {"log and noise": log_s, "one score of all": score_s, "naming": naming_s, "whole diagnosis": whole_s}


def row(title: str, cells: Iterable[str]) -> None:
    """Print one line of the table as soon as it is known."""
    print(f"{title:26s}" + "".join(f"{cell:>18s}" for cell in cells), flush=True)


def main() -> None:
    """Measure and print."""
    names = list(stages(trials(80)))  # compiles
    row("", names)
    designs = [(WINDOWS[0], number) for number in FEWER] + [(windows, len(CATALOGUE)) for windows in WINDOWS]
    found = []
    for windows, effects in designs:
        times = stages(trials(windows), dict(islice(CATALOGUE.items(), effects)))
        found.append(times)
        row(f"{windows:5d} windows, {effects:2d} effects", (f"{each:.1f} s" for each in times.values()))
    growth = (found[-1][name] / found[len(FEWER)][name] for name in names)
    row(f"with {WINDOWS[-1] / WINDOWS[0]:g} x the windows", (f"{each:.1f} x" for each in growth))


if __name__ == "__main__":
    main()
