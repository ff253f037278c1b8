"""The twin's picture for a terminal: where the ship will be, how far off that was before, and how late it comes."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from acquisition.core.angles import wrap_360
from hybrid.prediction.prediction_windows import in_ship_axes
from hybrid.twin.running_error import Judged, Mean
from hybrid.twin.twin import Twin
from hybrid.workflows.predict import Prediction

_ROWS = 6
_LEVEL_STYLES = {"info": "dim", "warning": "yellow", "error": "bold red"}


@dataclass(frozen=True, slots=True)
class Picture:
    """Everything worth seeing of a twin, drawn anew each time."""

    twin: Twin
    messages: deque[tuple[str, str]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        twin = self.twin
        path = twin.follower.path
        part = "waiting" if path is None else path.name
        yield _one_line(("● TWIN ", "bold cyan"), f"{twin.account.made:,} predictions  {part}")
        if twin.last is not None:
            yield _one_line(
                (spoken(twin.last.prediction), "yellow" if twin.last.prediction.outside_domain else "green")
            )
            yield track_table(twin.last.prediction)
        yield _one_line(latency(twin))
        yield _one_line(earlier(twin.last_error))
        for line in running(twin.errors.mean(), twin.errors.over_s).split("; "):
            yield _one_line(line)
        for level, text in tuple(self.messages):
            yield _one_line((text, _LEVEL_STYLES.get(level, "")))


def _one_line(*parts: str | tuple[str, str]) -> Text:
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis")


def spoken(prediction: Prediction) -> str:
    """Who speaks, and from when on."""
    beyond = ", beyond what the calibrator was trained on" if prediction.outside_domain else ""
    return f"{prediction.method} from {prediction.at:%H:%M:%SZ}{beyond}"


def track_table(prediction: Prediction) -> Table:
    """A row every few seconds: how far ahead and to starboard of where she is now, heading, band."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    for title in ("in s", "ahead m", "starboard m", "heading deg", "95 % band m"):
        table.add_column(title, justify="right", min_width=8, no_wrap=True)
    horizon_s = len(prediction.track) - 1
    north, east, heading = prediction.track[0]
    for second in np.unique(np.linspace(0, horizon_s, _ROWS + 1).round().astype(int))[1:]:
        away_north, away_east = prediction.track[second, :2] - (north, east)
        ahead, starboard = in_ship_axes(away_north, away_east, heading)
        band = "–" if prediction.band_m is None else f"{prediction.band_m[second]:.1f}"
        there_deg = float(wrap_360(np.rad2deg(prediction.track[second, 2])))
        table.add_row(str(second), f"{ahead:.1f}", f"{starboard:.1f}", f"{there_deg:.1f}", band)
    return table


def latency(twin: Twin) -> str:
    """How late predictions come."""
    times_s = twin.account.latency_s
    return f"latency {times_s[-1]:.2f} s" if times_s else "no prediction yet"


def earlier(error: Judged | None) -> str:
    """The error of the prediction whose horizon has just passed."""
    if error is None:
        return "no earlier prediction to judge"
    why = "  a thruster moved: not in the means" if error.thrusters_moved else ""
    return f"then: {error.end_distance_m:.1f} m off at the end, {error.mean_distance_m:.1f} m on the way{why}"


def running(mean: Mean, over_s: float) -> str:
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
