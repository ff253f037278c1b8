"""``seatrial watch``: running the twin, its display in a terminal and its summary."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console, ConsoleOptions, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text
from threadpoolctl import threadpool_limits

from seatrial.acquisition.config.trial_file import TrialConfig
from seatrial.acquisition.core.errors import Terminal
from seatrial.acquisition.core.quantities import to_ship
from seatrial.acquisition.core.ship import wrap_360
from seatrial.acquisition.logger.health import LOG, LogFormat, log_to
from seatrial.hybrid.calibrators.predict import Prediction, Predictor
from seatrial.hybrid.twin.running_error import MeanErrors, RegionFactor, TrackError
from seatrial.hybrid.twin.twin import PlanFile, Statistics, Twin, warm_up

_POLL_S = 0.1
_LOG_EVERY_S = 30.0
_REDRAW_PER_S = 2.0
_MESSAGES = 5  # that are shown
_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_ROWS = 6
_LEVEL_STYLES = {"info": "dim", "warning": "yellow", "error": "bold red"}


@dataclass(frozen=True, slots=True)
class WatchSummary:
    """Counts of predictions, mean errors, and latencies.

    ``made`` predictions, of which the logger ``recorded`` some; ``judged`` against measurements, ``left_out``
    of the means because a thruster departed from the plan, ``unmeasured`` for lack of a measured track.
    ``band_factor`` is the final factor on the calibrator's band.
    """

    made: int
    recorded: int
    judged: int
    left_out: int
    unmeasured: int
    mean_distance_m: float | None
    end_distance_m: float | None
    heading_deg: float | None
    inside_band: float | None
    band_factor: float | None
    latency_median_s: float | None
    latency_95_s: float | None
    latency_max_s: float | None

    def __str__(self) -> str:
        text = f"{self.made:,} predictions, {self.recorded:,} recorded, {self.judged:,} judged"
        text += f", {self.left_out:,} left out as a thruster moved"
        if self.mean_distance_m is not None:
            text += f"; {self.mean_distance_m:.2f} m off on the way, {self.end_distance_m:.2f} m at the end"
        if self.inside_band is not None:
            text += f", {self.inside_band:.0%} inside the band"
        if self.band_factor is not None:
            text += f"; {RegionFactor(self.band_factor)}"
        if self.latency_median_s is not None:
            text += f"; latency {self.latency_median_s:.2f} s, {self.latency_95_s:.2f} s in 95 of 100 cases"
        return text


def summary_of(statistics: Statistics, unmeasured: int, region: RegionFactor) -> WatchSummary:
    """A summary of the statistics and of the adaptation of the regions."""
    errors, latency_s = statistics.errors, statistics.latency_s
    latencies = np.quantile(latency_s, (0.5, 0.95, 1.0)).tolist() if latency_s else (None, None, None)
    return WatchSummary(
        statistics.made, statistics.recorded, errors.predictions, errors.left_out, unmeasured,
        errors.mean_distance_m, errors.end_distance_m, errors.heading_deg, errors.inside_band,
        None if errors.inside_band is None else region.factor, *latencies,
    )  # fmt: skip


def watch(
    config: TrialConfig,
    predictor: Predictor,
    stop: threading.Event,
    duration_s: float | None = None,
    log_format: LogFormat = "text",
    folder: Path | None = None,
    commands: Path | None = None,
) -> WatchSummary:
    """Predict beside the recorder of a trial until ``stop`` is set or ``duration_s`` is over.

    Waits where there is no recorder, and goes on with the next where one ends. ``folder`` is where recorders
    leave their sockets, if not in the usual place; ``commands`` a file of planned orders (:class:`.PlanFile`).
    Raises :class:`InputError` for a calibrator of held controls beside such a file.
    """
    if commands is not None and predictor.trained is not None:
        predictor.trained.refuse_commands()
    messages: deque[tuple[str, str]] = deque(maxlen=_MESSAGES)
    on_terminal = sys.stderr.isatty()

    def notify(level: str, text: str) -> None:
        if on_terminal:
            messages.append((level, text))
        else:
            LOG.log(_LEVELS[level], text)

    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(limits=1))  # leave the other cores to the logger
        plan = None if commands is None else PlanFile(commands, predictor.plant.layout, notify)
        twin = Twin(config.trial.name, config.path, predictor, notify, folder, plan)
        stack.callback(twin.close)
        display = Live(
            Display(twin, messages), console=Terminal(stderr=True), refresh_per_second=_REDRAW_PER_S, screen=True
        )  # drawn by a thread of its own
        stack.enter_context(display if on_terminal else log_to(sys.stderr, log_format))
        warm_up(predictor)
        _run(twin, stop, duration_s)
        return summary_of(twin.statistics, twin.errors.unmeasured, twin.region)


def _run(twin: Twin, stop: threading.Event, duration_s: float | None) -> None:
    until_s = float("inf") if duration_s is None else time.monotonic() + duration_s
    logged_s = time.monotonic()
    while time.monotonic() < until_s and not stop.wait(_POLL_S):
        twin.poll()
        if time.monotonic() - logged_s >= _LOG_EVERY_S and twin.statistics.made:
            logged_s = time.monotonic()
            mean = mean_error_text(twin.errors.mean(), twin.errors.over_s)
            LOG.info("%s; %s; %s", latency_text(twin), mean, twin.region)


def as_json(summary: WatchSummary, predictor: Predictor) -> dict[str, object]:
    """One object for other programs."""
    return {
        **predictor.said.remarks,
        "horizon_s": predictor.horizon_s,
        "vessel": predictor.vessel,
        "calibrator": predictor.calibrator,
        **asdict(summary),
    }


@dataclass(frozen=True, slots=True)
class Display:
    """A twin's state for a terminal, drawn anew each time."""

    twin: Twin
    messages: deque[tuple[str, str]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        twin = self.twin
        path = twin.follower.path
        part = "waiting" if path is None else path.name
        yield _one_line(("● TWIN ", "bold cyan"), f"{twin.statistics.made:,} predictions  {part}")
        if twin.last is not None:
            yield _one_line(
                (source_text(twin.last.prediction), "yellow" if twin.last.prediction.outside_domain else "green")
            )
            yield track_table(twin.last.prediction)
            if twin.last.prediction.region_m is not None:
                yield _one_line((str(twin.region), "red" if twin.region.is_at_bound else ""))
        yield _one_line(latency_text(twin))
        yield _one_line(last_error_text(twin.last_error))
        for line in mean_error_text(twin.errors.mean(), twin.errors.over_s).split("; "):
            yield _one_line(line)
        for level, text in tuple(self.messages):
            yield _one_line((text, _LEVEL_STYLES.get(level, "")))


def _one_line(*parts: str | tuple[str, str]) -> Text:
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis")


def source_text(prediction: Prediction) -> str:
    """The method and the start of a prediction."""
    beyond = ", outside the calibrator's training range" if prediction.outside_domain else ""
    planned = f", with {', '.join(prediction.planned)} as planned" if prediction.planned else ""
    return f"{prediction.method} from {prediction.at:%H:%M:%SZ}{beyond}{planned}"


def track_table(prediction: Prediction) -> Table:
    """A row every few seconds: distance ahead and to starboard of the present position, heading, band."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    for title in ("in s", "ahead m", "starboard m", "heading deg", "95 % band m"):
        table.add_column(title, justify="right", min_width=8, no_wrap=True)
    horizon_s = len(prediction.track) - 1
    north, east, heading = prediction.track[0]
    for second in np.unique(np.linspace(0, horizon_s, _ROWS + 1).round().astype(int))[1:]:
        away_north, away_east = prediction.track[second, :2] - (north, east)
        ahead, aside = to_ship(away_north, away_east, heading)
        band = "–" if prediction.band_m is None else f"{prediction.band_m[second]:.1f}"
        there_deg = float(wrap_360(np.rad2deg(prediction.track[second, 2])))
        table.add_row(str(second), f"{ahead:.1f}", f"{aside:.1f}", f"{there_deg:.1f}", band)
    return table


def latency_text(twin: Twin) -> str:
    """The latency of the newest prediction."""
    times_s = twin.statistics.latency_s
    return f"latency {times_s[-1]:.2f} s" if times_s else "no prediction yet"


def last_error_text(error: TrackError | None) -> str:
    """The error of the prediction whose horizon has just passed."""
    if error is None:
        return "no earlier prediction to judge"
    why = "  a thruster moved: not in the means" if error.thrusters_moved else ""
    return f"then: {error.end_distance_m:.1f} m off at the end, {error.mean_distance_m:.1f} m on the way{why}"


def mean_error_text(mean: MeanErrors, over_s: float) -> str:
    """The means over the last minutes."""
    if mean.mean_distance_m is None or mean.along_m is None or mean.across_m is None:
        return f"last {over_s / 60:g} min: none judged, {mean.left_out} left out as a thruster moved"
    inside = "" if mean.inside_band is None else f", {mean.inside_band:.0%} inside the band"
    over = f"last {over_s / 60:g} min"
    return (
        f"{over}: {mean.mean_distance_m:.2f} m on the way, {mean.end_distance_m:.2f} m at the end "
        f"({mean.along_m:+.2f} ahead, {mean.across_m:+.2f} to starboard), {mean.heading_deg:.2f} deg{inside}; "
        f"{mean.predictions} judged, {mean.left_out} left out as a thruster moved"
    )
