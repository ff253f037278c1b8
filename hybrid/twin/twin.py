"""The twin: follows the recorder of a trial, predicts once a second and evaluates its earlier predictions.

A person may write, change and delete a file of planned orders while it runs.
"""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import InputError, SeatrialError
from seatrial.acquisition.core.quantities import Series
from seatrial.acquisition.core.ship import DEFAULT, Actuators, as_text, trial_names
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.logger.requests import Follower, send_prediction
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.tables.table import NANO, actuators_in_recording
from seatrial.hybrid.prediction.planned_commands import read_commands
from seatrial.hybrid.prediction.prediction_windows import PAST_S
from seatrial.hybrid.twin.forecast import (
    Forecast,
    RecentSamples,
    message_body,
    missing_channels,
    newest_second_ns,
    predict_now,
    track_geojson,
)
from seatrial.hybrid.twin.running_error import MeanErrors, RegionFactor, RunningError, TrackError

if TYPE_CHECKING:
    from seatrial.hybrid.calibrators.predict import Predictor


Notify = Callable[[str, str], None]


class PlanFile:
    """The orders of a plan file, reread whenever it changes; ``notify`` gets level and text each time.

    Without the file the present orders continue. An unreadable file is reported, and the previous plan is
    followed until it can be read.
    """

    def __init__(self, path: Path, actuators: Actuators, notify: Notify) -> None:
        self.path = path
        self._actuators, self._notify = actuators, notify
        self._orders: pd.DataFrame | None = None
        self._seen: tuple[int, ...] | None = ()  # as no file is

    def orders(self) -> pd.DataFrame | None:
        """The orders as :func:`.read_commands` gives them; None without a plan."""
        seen = _version_of(self.path)
        if seen != self._seen:
            self._seen = seen
            self._read()
        return self._orders

    def _read(self) -> None:
        if self._seen is None:
            self._orders = None
            self._notify("warning", f"no plan at {self.path}: what is ordered now goes on")
            return
        try:
            self._orders = read_commands(self.path, self._actuators)
        except InputError as error:
            before = "what is ordered now goes on" if self._orders is None else "the plan before goes on"
            self._notify("warning", f"no new plan, {before}: {error}")
            return
        self._notify("info", plan_text(self._orders))


def _version_of(path: Path) -> tuple[int, ...] | None:
    """A file's version, which changes when it does; None without a file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def plan_text(orders: pd.DataFrame) -> str:
    """A plan in one line: what it orders, and from when to when.

    >>> plan_text(pd.DataFrame({"rudder_angle_deg": [0.0, -20.0]}, index=pd.Index([0.0, 5.0], name="second")))
    'plan of rudder_angle_deg: 2 orders, 0 to 5 s after the start of each prediction'
    """
    first, last = orders.index[[0, -1]]
    when = (
        f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"
        if isinstance(first, pd.Timestamp)
        else f"{first:g} to {last:g} s after the start of each prediction"
    )
    number = "1 order" if len(orders) == 1 else f"{len(orders)} orders"
    return f"plan of {', '.join(map(str, orders.columns))}: {number}, {when}"


_MARGIN_S = 15.0  # longer than the filters' reach and the evaluation's delay
_LEAST_APART_S = 0.55  # the recorder accepts two a second
_STALLED_S = 3.0
_BACK_NS = 5_000_000_000  # a wrong time stamp in the future must not silence the twin for good


def keep_s(horizon_s: int) -> float:
    """The seconds of data needed for prediction and evaluation."""
    return max(PAST_S, horizon_s) + _MARGIN_S


@dataclass(slots=True)
class Statistics:
    """Counts and means since the start, and the latency of each prediction [s]."""

    made: int = 0
    recorded: int = 0
    latency_s: array[float] = field(default_factory=lambda: array("d"))
    errors: MeanErrors = field(default_factory=MeanErrors)


class Twin:
    """The twin of the recorder of trial ``name``; to be closed. Call :meth:`poll` about ten times a second.

    The thrusters are held, or follow a ``plan`` of orders.
    """

    def __init__(
        self,
        name: str,
        configuration: Path,
        predictor: Predictor,
        notify: Notify,
        folder: Path | None = None,
        plan: PlanFile | None = None,
    ) -> None:
        self.predictor, self.statistics, self.errors = predictor, Statistics(), RunningError()
        self.region = RegionFactor()
        self.last: Forecast | None = None
        self.last_error: TrackError | None = None
        self.follower = Follower(name, configuration, keep_s(predictor.horizon_s), notify, folder)
        self._recent, self._plan = RecentSamples(keep_s(predictor.horizon_s)), plan
        self._notify, self._last_notice = notify, ""
        self._start_ns, self._made_s, self._new_s = 0, 0.0, time.monotonic()

    def close(self) -> None:
        """Close the recording."""
        self.follower.close()

    def poll(self) -> bool:
        """Read new samples; whether they led to a new prediction."""
        news = self.follower.news()
        if news.anew:
            self._recent.clear()
            self.errors.clear()
            self._start_ns, self._new_s = 0, time.monotonic()
        for samples in news.samples:
            self._recent.add(samples, again=news.again)
        path = self.follower.path
        if not news.samples or path is None or time.monotonic() - self._made_s < _LEAST_APART_S:
            return False
        recording = self._recent.recording(self.follower.trial, path)
        start_ns = newest_second_ns(recording)
        if start_ns is not None and start_ns < self._start_ns - _BACK_NS:
            back_s = (self._start_ns - start_ns) / NANO
            self._notify_once("warning", f"the sources' times went back by {back_s:.0f} s: begun anew")
            self._start_ns = 0
            self.errors.clear()
        if start_ns is None or start_ns <= self._start_ns:
            self._notify_missing_channels(recording)
            return False
        self._start_ns = start_ns
        return self._predict(recording, start_ns)

    def _predict(self, recording: Recording, start_ns: int) -> bool:
        self._made_s = time.monotonic()
        by, orders = self.predictor, None if self._plan is None else self._plan.orders()
        try:
            forecast = predict_now(recording, by.horizon_s, by.plant, by.trained, start_ns, orders)
        except SeatrialError as error:
            self._notify_once("warning", f"no prediction: {error}")
            return False
        self._new_s = time.monotonic()
        self._evaluate(forecast, start_ns)
        forecast = replace(forecast, prediction=self.region.widened(forecast.prediction))
        self.last = forecast
        self.errors.add(forecast.prediction)
        self._publish(forecast)
        return True

    def _evaluate(self, forecast: Forecast, until_ns: int) -> None:
        errors = self.errors.evaluate(forecast.table, until_ns)
        for error in errors:
            self.statistics.errors = self.statistics.errors.with_error(error)
            self.region = self.region.after(error, self.predictor.horizon_s)
        self.last_error = errors[-1] if errors else None

    def _publish(self, forecast: Forecast) -> None:
        """Send the prediction to the recorder."""
        origin, made_ns = self.follower.trial.origin, self.follower.utc_ns
        latency_s = max((made_ns - self._recent.newest_received_ns) / NANO, 0.0)
        self.statistics.made += 1
        self.statistics.latency_s.append(latency_s)
        names = self.predictor.vessel, self.predictor.calibrator
        running = self.errors.over_s, self.errors.mean()
        body = message_body(
            forecast.prediction, forecast.held, origin, names, made_ns, latency_s, self.last_error, running,
            self.region.factor,
        )  # fmt: skip
        if self.follower.recorder is None:
            return
        refused = send_prediction(self.follower.recorder[0], body, track_geojson(forecast.prediction, origin))
        self.statistics.recorded += not refused
        self._notify_once("warning" if refused else "info", f"not recorded: {refused}" if refused else "predicting")

    def _notify_missing_channels(self, recording: Recording) -> None:
        """Name the channels without which no prediction can be made."""
        if time.monotonic() - self._new_s < _STALLED_S:
            return
        newest = [int(each.measured_ns.max()) for name, each in recording.series.items()
                  if name in trial_names(actuators_in_recording(recording))]  # fmt: skip
        missing = missing_channels(recording, max(newest) // NANO * NANO if newest else None)
        if missing:
            self._notify_once("warning", f"no prediction: nothing comes of {', '.join(missing)}")

    def _notify_once(self, level: str, text: str) -> None:
        """Notify once of each new text."""
        if text != self._last_notice:
            self._last_notice = text
            self._notify(level, text)


def warm_up(predictor: Predictor) -> None:
    """Make one prediction for a ship at rest, so that compilation happens before it matters."""
    with suppress(SeatrialError):
        still = recording_at_rest(keep_s(predictor.horizon_s), predictor.plant.layout)
        predict_now(still, predictor.horizon_s, predictor.plant, predictor.trained)


def recording_at_rest(seconds: float, actuators: Actuators = DEFAULT) -> Recording:
    """A recording with all channels of a ship at zero, one sample a second."""
    times_ns = np.arange(int(seconds) + 1, dtype=np.int64) * NANO
    zeros = np.zeros(times_ns.size)
    flags = np.full(times_ns.size, Quality.GOOD, np.uint8)
    series = Series(times_ns, times_ns, zeros, flags, ("",), np.zeros(times_ns.size, np.int32))
    return Recording(
        Path(), Trial(actuators=as_text(actuators)), dict.fromkeys(trial_names(actuators), series), {}, [], 0,
        True, 0, int(times_ns[-1]),
    )  # fmt: skip
