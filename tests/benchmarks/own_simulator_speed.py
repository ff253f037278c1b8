"""What predictions by a simulator of another make take beside the simulator alone: ratios, on one process.

``python tests/benchmarks/own_simulator_speed.py``: 200 runs of 30 s of a ship of another make, as a Python class
(not vectorised), and as FMUs beside FMPy's own loop, with an instance for every run and lists for every call.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import seatrial as st  # noqa: E402
from seatrial.acquisition.core.quantities import Floats  # noqa: E402
from seatrial.hybrid.vessel import simulator_process  # noqa: E402
from seatrial.hybrid.vessel.dynamics import simulate_batch  # noqa: E402
from tests.hybrid.own_simulator import fmus  # noqa: E402
from tests.hybrid.own_simulator.test_predictions import class_of  # noqa: E402

RUNS, SECONDS, REPEATS = 200, 30, 15


def fastest_s(call: Callable[[], object]) -> float:
    """The shortest time of some calls, after one that is not counted."""
    call()
    times = []
    for _ in range(REPEATS):
        start_s = time.perf_counter()
        call()
        times.append(time.perf_counter() - start_s)
    return min(times)


def alone_as_class(file: Path) -> None:
    """The class, called for every run and second."""
    ship = class_of(file, "Sailer")()
    for _ in range(RUNS):
        state = [0.0, 0.0, 0.0, 8.0, 0.0, 0.0]
        for _ in range(SECONDS):
            state = ship.step(state, [2.0, 5.0], [30.0, 8.0], 1.0)


def alone_in_fmpy(file: Path) -> None:
    """The FMU by FMPy's own functions, one instance after the other."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    description = fmpy.read_model_description(str(file), validate=False)
    third = str(description.fmiVersion).startswith("3.")
    folder = fmpy.extract(str(file))
    for _ in range(RUNS):
        slave = (FMU3Slave if third else FMU2Slave)(
            guid=description.guid, unzipDirectory=folder, modelIdentifier="sailer", instanceName="alone"
        )
        slave.instantiate()
        if not third:
            slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        put, take = (slave.setFloat64, slave.getFloat64) if third else (slave.setReal, slave.getReal)
        for second in range(SECONDS):
            put([6, 7, 8, 9], [2.0, 5.0, 30.0, 8.0])
            slave.doStep(float(second), 1.0)
            take([0, 1, 2, 3, 4, 5])
        slave.terminate()
        slave.freeInstance()
    shutil.rmtree(folder)


def main() -> None:
    """Print a line for each form."""
    simulator_process._WORKERS = 1
    start: Floats = np.tile([0.0, 0.0, 1.0, 4.0, 0.0, 0.0], (RUNS, 1))
    controls, wind = np.tile([2.0, 0.1], (RUNS, SECONDS, 1)), np.tile([0.5, 4.0], (RUNS, SECONDS, 1))
    with TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "sailer.py"
        shutil.copy(ROOT / "tests/hybrid/own_simulator/sailer.txt", file)
        file.with_suffix(".toml").write_text(fmus.without_variables(fmus.MAP))
        forms: list[tuple[str, str, Callable[[], None]]] = [
            ("Python class", f"{file}:Sailer", lambda: alone_as_class(file))
        ]
        for version in (2, 3):
            path = fmus.build_fmu(folder, version, name=f"speed{version}")
            forms.append((f"FMU of FMI {version}.0", str(path), lambda path=path: alone_in_fmpy(path)))  # type: ignore[misc]
        for form, source, alone in forms:
            model = st.load_simulator(source)
            ours_s = fastest_s(lambda model=model: simulate_batch(model, start, controls, wind, 1.0))  # type: ignore[misc]
            alone_s = fastest_s(alone)
            microseconds = 1e6 * alone_s / RUNS / SECONDS
            print(f"{form}: {ours_s / alone_s:.2f} times the model alone, {microseconds:.1f} us a step")


if __name__ == "__main__":
    main()
