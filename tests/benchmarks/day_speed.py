"""From MCAP to held windows for a long recording: time and memory by step; printed and never asserted.

Run as ``python tests/benchmarks/day_speed.py [HOURS] [FILE.mcap]``; two hours without arguments, 24 is the day of
13 channels at 20 Hz, 22.5 million samples, which takes some ten minutes, half of them to write it. The channels
never share a time, as sources of their own do not, so that the joined raw table would have a row for every sample.
A FILE that already exists is used as it is.

The steps run in a process of their own, whose peak memory is that of reading, resampling, smoothing and cutting
windows. The smoother gets the 1 Hz table, for which the raw samples would be more than 2 GB as one table. The
plain version of the windows asks the same rule row by row, of the first half hour, and is extrapolated by the
number of candidates.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

RATE_HZ, PART_S, PLAIN_S = 20.0, 3600, 1800
START_NS = 1_780_000_000 * 10**9
T = TypeVar("T")


def write_voyage(path: Path, hours: float) -> int:
    """Simulated hours one after the other, each channel at times of its own; the number of samples."""
    from seatrial.acquisition.core.trial import Sample, Trial
    from seatrial.acquisition.recording.writer import RecordingWriter
    from seatrial.hybrid.simulation.trial import simulate_trial

    samples = 0
    with RecordingWriter(path, Trial(name=path.stem, vessel="gunnerus_long")) as writer:
        for part in range(int(np.ceil(hours))):
            seconds = min(PART_S, hours * 3600 - part * PART_S)
            table, _ = simulate_trial("gunnerus_long", "gentle", "voyage", seconds, RATE_HZ, part)
            names = [str(name) for name in table.columns]
            for row, values in enumerate(table.to_numpy().tolist()):
                at_ns = START_NS + part * PART_S * 10**9 + round(row / RATE_HZ * 1e9)
                for name, value in zip(names, values, strict=True):
                    at_ns += 3_000_000
                    writer.write_sample(Sample(name, value, "simulated", at_ns, 0, at_ns, at_ns, "simulated"))
            samples += table.size
            writer.flush()  # or it would gather all of it in memory
    return samples


def timed(step: Callable[[], T]) -> tuple[float, T]:
    """How long a step takes [s], and its result."""
    begin = time.perf_counter()
    result = step()
    return time.perf_counter() - begin, result


def processed(step: Callable[[], T]) -> tuple[float, float, T]:
    """As :func:`timed`, the processor's time too [s]: on a busy machine the clock says more of the others."""
    begin = time.process_time()
    seconds, result = timed(step)
    return seconds, time.process_time() - begin, result


def peak_mb() -> float:
    """The most memory that this process had so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(path: Path) -> dict[str, Any]:
    """Every step on the file, in this process: seconds, the processor's too, and the peak memory after it."""
    from windows_speed import HORIZON_S, STRIDE_S, plain

    from seatrial.acquisition.recording.reader import read_recording
    from seatrial.analysis.estimation.smoother import smooth
    from seatrial.analysis.tables.resample import resample_recording
    from seatrial.analysis.windows.held import held_windows

    steps: dict[str, tuple[float, float, float]] = {}

    def step(name: str, call: Callable[[], T]) -> T:
        seconds, processor_s, result = processed(call)
        steps[name] = seconds, processor_s, peak_mb()
        print(f"  {name}: {seconds:.1f} s", file=sys.stderr, flush=True)
        return result

    recordings = [step("reading", lambda: read_recording(path))]
    messages = recordings[0].messages
    table = step("resampling", lambda: resample_recording(recordings.pop()))  # and let go of
    step("smoothing", lambda: smooth(table, 1.0))
    windows = step("windows", lambda: held_windows(table, HORIZON_S, STRIDE_S))
    part = table.iloc[:PLAIN_S]
    plain_s, kept = timed(lambda: plain(part))
    of_part = held_windows(part, HORIZON_S, STRIDE_S)
    return {
        "messages": messages,
        "rows": len(table),
        "steps": steps,
        "candidates": windows.candidates,
        "kept": windows.kept,
        "plain_s": plain_s * windows.candidates / max(of_part.candidates, 1),
        "plain_agrees": len(kept) == of_part.kept,
    }


def report(found: dict[str, Any]) -> None:
    """Print seconds, shares and peak memory by step, and the windows against the plain version."""
    total = sum(seconds for seconds, _, _ in found["steps"].values())
    print(f"{found['messages']:,} samples to {found['rows']:,} rows at 1 Hz and {found['kept']:,} of "
          f"{found['candidates']:,} windows in {total:.1f} s; load {os.getloadavg()[0]:.1f}")  # fmt: skip
    for name, (seconds, processor_s, peak) in found["steps"].items():
        print(f"  {name:<11}{seconds:8.2f} s {seconds / total:6.1%}   processor {processor_s:8.2f} s   "
              f"peak memory so far {peak:6.0f} MB")  # fmt: skip
    rate = found["messages"] / found["steps"]["reading"][1] / 1e6
    print(f"read at {rate:.1f} million messages a second of processor time")
    windows_s = found["steps"]["windows"][0]
    agree = "the same windows" if found["plain_agrees"] else "OTHER WINDOWS"
    print(f"windows {windows_s:.3f} s, row by row {found['plain_s']:.0f} s (extrapolated, {agree}): "
          f"{found['plain_s'] / windows_s:.0f} times as fast")  # fmt: skip


def main(arguments: list[str]) -> None:
    """Write the recording if need be, measure in a process of its own, and print."""
    if arguments[:1] == ["--measure"]:
        print(json.dumps(measure(Path(arguments[1]))))
        return
    hours = float(arguments[0]) if arguments else 2.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(arguments[1]) if len(arguments) > 1 else Path(folder) / "day.mcap"
        if not path.exists():
            seconds, samples = timed(lambda: write_voyage(path, hours))
            print(f"{samples:,} samples of {hours:g} h simulated and written in {seconds:.0f} s, "
                  f"{path.stat().st_size / 1e6:.0f} MB", flush=True)  # fmt: skip
        command = [sys.executable, __file__, "--measure", str(path)]
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
        child = subprocess.run(command, stdout=subprocess.PIPE, check=True, env=environment)
    report(json.loads(child.stdout))


if __name__ == "__main__":
    main(sys.argv[1:])
