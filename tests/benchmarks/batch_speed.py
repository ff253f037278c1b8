"""What a second worker process is worth: recordings a second with one and with two.

Two processes on two cores cannot be twice as fast where others use them too: the load is printed beside it.

    python tests/benchmarks/batch_speed.py [recordings]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from analysis.batch import run_batch
from analysis.one_recording import Options
from tests.analysis.season import sailed, write_season


def seconds_of(folder: Path, out: Path, workers: int, options: Options) -> float:
    """The time from the first result to the last, without the start of the processes [s a recording]."""
    times: list[float] = []
    run_batch(folder, out, workers, options=options, progress=lambda share: times.append(time.perf_counter()))
    return (times[-1] - times[workers - 1]) / (len(times) - workers)


def main(count: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "season"
        write_season(folder, [sailed(120, 2.0, seed) for seed in range(10)], count)
        for name, options in (("without smoother and pictures", Options(smooth=False, pictures=False)),
                              ("with pictures", Options(smooth=False))):  # fmt: skip
            each = {workers: seconds_of(folder, Path(place) / f"{name} {workers}", workers, options)
                    for workers in (1, 2)}  # fmt: skip
            print(f"{count} recordings {name}: {each[1]:.2f} s each with one worker, {each[2]:.2f} s with two, "
                  f"{each[1] / each[2]:.2f} times as fast; load {os.getloadavg()[0]:.1f}")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
