"""A day of ``seatrial watch`` played as fast as it goes: memory, open files, and the time that a prediction takes.

A recorder of a few lines writes one second of a voyage after the other, a new part every hour, and takes the twin's
predictions through its socket; the twin reads the growing file, predicts from each second and judges what it said.
Prints a line for each tenth of the day: memory and open files of both together, and the time from a second's
samples in the file to the prediction at the recorder. Aboard up to 0.2 s come before, until the samples are in the
file, and 0.1 s until the twin looks (``watch_load.py``). Run it as ``python -m tests.benchmarks.watch_day [HOURS
[CALIBRATOR [RECORDING]]]``; without a recording a simulated voyage is played again and again.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import seatrial as st
from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.ship import trial_channel_names
from seatrial.acquisition.core.trial import Sample
from seatrial.acquisition.logger.health import Health, Predictions
from seatrial.acquisition.logger.requests import RecorderState, RequestServer
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.analysis.tables.table import NANO, actuators_in_recording
from seatrial.hybrid import twin as twin_module
from seatrial.hybrid.calibrators.predict import HORIZON_S, choose_predictor
from seatrial.hybrid.twin import Twin, compile_predictor, watch_summary
from tests.benchmarks.recorder_soak import state

PATIENCE_S = 0.5  # for the twin to find the next part


def seconds_of(recording: Recording) -> Iterator[list[tuple[int, str, float]]]:
    """The samples of each second, again and again: time [ns] since the first, channel, value."""
    every = [
        (int(at_ns), name, float(value))
        for name in trial_channel_names(actuators_in_recording(recording))
        for at_ns, value in zip(recording.series[name].measured_ns, recording.series[name].value, strict=True)
    ]
    every.sort()
    first_ns = every[0][0] // NANO * NANO
    seconds: list[list[tuple[int, str, float]]] = [[] for _ in range((every[-1][0] - first_ns) // NANO + 1)]
    for at_ns, name, value in every:
        seconds[(at_ns - first_ns) // NANO].append((at_ns - first_ns, name, value))
    turn = 0
    while True:
        for each in seconds:
            yield [(at_ns + turn * len(seconds) * NANO, name, value) for at_ns, name, value in each]
        turn += 1


class Day:
    """The recorder, and the twin beside it, second by second."""

    def __init__(self, folder: Path, recording: Path, calibrator: str) -> None:
        source = read_recording(recording)
        self.start_ns, self.seconds = source.start_ns, seconds_of(source)
        self.parts = RecordingParts(folder / "out", source.trial, {}, RecordingSection())
        self.predictions, self.took_s = Predictions(Health({})), list[float]()
        self.hearing = RequestServer(lambda text, at_ns: None, self.who, self.predictions, folder / "run")
        self.predictor = choose_predictor({recording: source.trial}, calibrator or None, None, None, HORIZON_S)
        self.twin = Twin(
            source.trial.name, Path("/day.toml"), self.predictor, lambda level, text: None, folder / "run"
        )

    def who(self) -> RecorderState:
        return RecorderState(self.parts._trial.name, "/day.toml", str(self.parts.path), False, 1, 0, 0)

    def second(self, number: int) -> None:
        """Record one second, and let the twin predict from it."""
        if number and number % 3600 == 0:
            self.parts.begin_next_part("an hour is over")
        for at_ns, name, value in next(self.seconds):
            time_ns = self.start_ns + at_ns
            self.parts.write_sample(Sample(name, value, "played", time_ns, 0, time_ns))
        for _, start_ns, data, geojson in self.predictions.take():
            self.parts.write_prediction(data, geojson, start_ns, start_ns)
        self.parts.flush()
        self.parts.sync_in_background()
        self.predictions._allowed = 4.0  # as if a second had passed
        began_s = time.perf_counter()
        while not (made := self.twin.poll()) and time.perf_counter() - began_s < PATIENCE_S and number > 1:
            time.sleep(0.001)
        if made:
            self.took_s.append(time.perf_counter() - began_s)


def told(hours: float, took_s: list[float]) -> None:
    """Print how it stands."""
    gc.collect()
    median, most, late = 1e3 * np.quantile(took_s, (0.5, 0.95, 0.99))
    print(f"{hours:5.1f} h  {state():32}  {median:6.1f} ms  {most:6.1f} ms  {late:6.1f} ms", flush=True)


def main(hours: float = 24.0, calibrator: str = "", recording: str = "") -> None:
    """Play the day."""
    twin_module._LEAST_APART_S = 0.0
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(recording or f"{scratch}/voyage.mcap")
        if not recording:
            st.simulate(path, duration_s=3600.0, rate_hz=4.0)
        day = Day(Path(scratch), path, calibrator)
        compile_predictor(day.predictor)
        count, seen = int(hours * 3600), 0
        print(f"{os.cpu_count()} cores; horizon {day.predictor.horizon_s} s; latency: median, 95 %, 99 %")
        with day.hearing:
            for number in range(count):
                day.second(number)
                if number + 1 in (300, *(count * tenth // 10 for tenth in range(1, 11))):
                    told((number + 1) / 3600.0, day.took_s[seen:])
                    seen = len(day.took_s)
        summary = watch_summary(day.twin.statistics, day.twin.errors.unmeasured, day.twin.region)
        print(replace(summary, latency_median_s=None))  # which is by the clock, not by that of the voyage
        day.twin.close()
        day.parts.close()
        told(hours, day.took_s)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 24.0, *sys.argv[2:])
