"""``seatrial watch``: the twin from start to end, with its display and its summary."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from acquisition.config.configuration import TrialConfig
from acquisition.logger.supervision import LOG, LogFormat, log_to
from hybrid.twin.display import Picture, latency, running
from hybrid.twin.twin import Account, Model, Twin, warm_up

_LOOK_S = 0.1
_LOG_EVERY_S = 30.0
_REDRAW_PER_S = 2.0
_MESSAGES = 5  # that are shown
_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


@dataclass(frozen=True, slots=True)
class Summary:
    """What a twin was worth: predictions ``made`` and those of them that are ``recorded``; those that were judged,
    that were ``left_out`` as a thruster moved, or could not be measured; means of their errors, and latencies.
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
        if self.latency_median_s is not None:
            text += f"; latency {self.latency_median_s:.2f} s, {self.latency_95_s:.2f} s in 95 of 100 cases"
        return text


def summary_of(account: Account, unmeasured: int) -> Summary:
    """The account in a few numbers."""
    median_s, most_s, longest_s = (_quantile(account.latency_s, share) for share in (0.5, 0.95, 1.0))
    return Summary(
        made=account.made,
        recorded=account.said,
        judged=len(account.mean_distance_m),
        left_out=account.left_out,
        unmeasured=unmeasured,
        mean_distance_m=_mean(account.mean_distance_m),
        end_distance_m=_mean(account.end_distance_m),
        heading_deg=_mean(account.heading_deg),
        inside_band=_mean(account.inside_band),
        latency_median_s=median_s,
        latency_95_s=most_s,
        latency_max_s=longest_s,
    )


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _quantile(values: Sequence[float], share: float) -> float | None:
    return float(np.quantile(values, share)) if values else None


def watch(
    config: TrialConfig,
    model: Model,
    stop: threading.Event,
    duration_s: float | None = None,
    log_format: LogFormat = "text",
    folder: Path | None = None,
) -> Summary:
    """Predict beside the recorder of a trial until ``stop`` is set or ``duration_s`` is over.

    Waits where there is no recorder, and goes on with the next where one ends. ``folder`` is where recorders
    leave their sockets, if not in the usual place.
    """
    messages: deque[tuple[str, str]] = deque(maxlen=_MESSAGES)
    on_terminal = sys.stderr.isatty()

    def tell(level: str, text: str) -> None:
        if on_terminal:
            messages.append((level, text))
        else:
            LOG.log(_LEVELS[level], text)

    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(limits=1))  # the other cores are the logger's
        twin = Twin(config.trial.name, config.path, model, tell, folder)
        stack.callback(twin.close)
        stack.enter_context(_display(Picture(twin, messages)) if on_terminal else log_to(sys.stderr, log_format))
        warm_up(model)
        _run(twin, stop, duration_s)
        return summary_of(twin.account, twin.errors.unmeasured)


def _run(twin: Twin, stop: threading.Event, duration_s: float | None) -> None:
    until_s = float("inf") if duration_s is None else time.monotonic() + duration_s
    logged_s = time.monotonic()
    while time.monotonic() < until_s and not stop.wait(_LOOK_S):
        twin.step()
        if time.monotonic() - logged_s >= _LOG_EVERY_S and twin.account.made:
            logged_s = time.monotonic()
            LOG.info("%s; %s", latency(twin), running(twin.errors.mean(), twin.errors.over_s))


def _display(picture: Picture) -> AbstractContextManager[object]:
    """The picture on a terminal, drawn anew by a thread of its own."""
    from rich.console import Console
    from rich.live import Live

    return Live(picture, console=Console(stderr=True), refresh_per_second=_REDRAW_PER_S, screen=True)


def as_json(summary: Summary, model: Model) -> dict[str, object]:
    """One object for other programs."""
    return {"horizon_s": model.horizon_s, "vessel": model.vessel, "calibrator": model.calibrator, **asdict(summary)}
