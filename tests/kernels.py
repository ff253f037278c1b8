"""Compiles the kernels that tests of several files need, once and not in each of pytest's processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import seatrial as st
from seatrial.hybrid import workflows
from seatrial.hybrid.effects import Regime, regime_effect, vessel_plant
from seatrial.hybrid.vessel.dynamics import simulate_batch
from seatrial.hybrid.vessel.files import load_vessel
from tests.benchmarks.other_ship.trial import make_trial

DIAGNOSIS = "from seatrial.hybrid import workflows; workflows.compile_diagnosis()"


def compile_others() -> None:
    """The kernels of the other ship, of runs with a force added, and of the filter of the starts."""
    make_trial(1, duration_s=60.0, rate_hz=1.0)
    plant = vessel_plant(load_vessel("gunnerus_short"))
    pushed = regime_effect("push", Regime("surge"), 1.0).apply(plant, {"force_n": 1.0})
    for count in (1, 2):
        simulate_batch(pushed, np.zeros((count, 6)), np.zeros((count, 2, 5)), np.zeros((count, 2, 2)), 0.1)
    with TemporaryDirectory() as folder:
        voyage = workflows.simulate_to(Path(folder) / "voyage.mcap", "voyage", 120.0, 0)
        st.validate(voyage, vessel="gunnerus_short", all_windows=True)


if __name__ == "__main__":
    with subprocess.Popen([sys.executable, "-c", DIAGNOSIS]) as diagnosing:
        compile_others()
    sys.exit(diagnosing.returncode)
