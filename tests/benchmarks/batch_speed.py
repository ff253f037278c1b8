"""What a second worker process is worth: recordings a second with one and with two, and processor time in all.

Two processes on two cores cannot be twice as fast where others use them too. So the load is printed beside it, and
the processor time that each recording took in all processes: what the second worker costs beside the work itself.

    python tests/benchmarks/batch_speed.py [recordings]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seatrial.analysis.batch import run_batch
from seatrial.analysis.products import Options
from tests.analysis.small_batch import sailed, write_batch


def seconds_of(folder: Path, out: Path, workers: int, options: Options) -> tuple[float, float]:
    """Seconds a recording from the first result to the last, and processor seconds a recording, start and all."""
    times: list[float] = []
    before = _processor_s()
    run_batch(folder, out, workers, options=options, progress=lambda share: times.append(time.perf_counter()))
    return (times[-1] - times[workers - 1]) / (len(times) - workers), (_processor_s() - before) / len(times)


def _processor_s() -> float:
    """Processor time of this process and of its children that have ended [s]."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def main(count: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "batch"
        write_batch(folder, [sailed(600, 2.0, seed) for seed in range(10)], count)
        for name, options in (("without smoother and pictures", Options(smooth=False, pictures=False)),
                              ("with pictures", Options(smooth=False))):  # fmt: skip
            each = {workers: seconds_of(folder, Path(place) / f"{name} {workers}", workers, options)
                    for workers in (1, 2)}  # fmt: skip
            (one_s, one_cpu_s), (two_s, two_cpu_s) = each[1], each[2]
            print(f"{count} recordings {name}: {one_s:.2f} s each with one worker, {two_s:.2f} s with two, "
                  f"{one_s / two_s:.2f} times as fast; processor time {one_cpu_s:.2f} and {two_cpu_s:.2f} s each; "
                  f"load {os.getloadavg()[0]:.1f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
