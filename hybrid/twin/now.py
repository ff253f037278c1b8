"""One prediction from the newest second of what was measured, as ``seatrial predict`` makes it of a recording.

Nothing lies ahead of that second but what has come since, less than a second. So the filter that brings the
channels to 1 Hz is one-sided there, and the state that reference, constant velocity and networks start from is that
of :mod:`analysis.estimation.local_polynomial`: less certain than the one that a recording gives afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from acquisition.core.channels import NAMES, POSE, VELOCITY
from acquisition.core.errors import DataShortageError
from acquisition.core.frames import Quality
from acquisition.recording.reader import Recording, Series
from analysis.tables.resample import own_gap_s, resample_recording
from analysis.tables.time_index import NANO
from hybrid.vessel.plant import Plant
from hybrid.workflows.predict import Prediction, predict

if TYPE_CHECKING:
    from hybrid.calibrators.artefact import TrainedCalibrator

MOTION = (*POSE, *VELOCITY)
"""What must have been measured up to the start; wind and thrusters are held anyhow, and may be older."""


@dataclass(frozen=True, slots=True)
class Foretold:
    """A prediction, the 1 Hz table that it was made of, and the channels that were held to its start."""

    prediction: Prediction
    table: pd.DataFrame
    held: tuple[str, ...]


def newest_second_ns(recording: Recording) -> int | None:
    """The newest whole second within what was measured of all of the ship's motion [ns]; None without one."""
    spans = [_span_ns(recording.series.get(name)) for name in MOTION]
    known = [each for each in spans if each is not None]
    if len(known) < len(MOTION):
        return None
    second_ns = min(newest for _, newest in known) // NANO * NANO
    return second_ns if second_ns >= max(oldest for oldest, _ in known) else None


def missing_channels(recording: Recording, at_ns: int | None) -> list[str]:
    """Those of the 13 channels that have nothing to say at a second: never came, or too long ago.

    Without a second (None) those that never came.
    """
    return [
        name
        for name in NAMES
        if (span := _span_ns(recording.series.get(name))) is None
        or (at_ns is not None and at_ns - span[1] > _longest_hold_ns(recording.series[name]))
    ]


def predict_now(
    recording: Recording,
    horizon_s: int,
    plant: Plant,
    trained: TrainedCalibrator | None = None,
    at_ns: int | None = None,
) -> Foretold:
    """Predict from the newest whole second of the last minute or so, or from the second ``at_ns``.

    Raises :class:`DataShortageError` naming the channels that are missing, :class:`InputError` where one has a gap
    at that second, :class:`ModelRangeError` where the reference leaves its range.
    """
    start_ns = newest_second_ns(recording) if at_ns is None else at_ns
    missing = missing_channels(recording, start_ns)
    if missing:
        raise DataShortageError(f"{', '.join(missing)} missing", fix="see what `seatrial record --check` says")
    if start_ns is None:
        raise DataShortageError("no whole second of the ship's motion", fix="wait for more")
    filled, held = held_until(recording, start_ns)
    table = resample_recording(filled)
    at = pd.Timestamp(start_ns, unit="ns", tz="UTC")
    return Foretold(predict(table, at, horizon_s, plant, trained), table, held)


def held_until(recording: Recording, until_ns: int) -> tuple[Recording, tuple[str, ...]]:
    """Wind and thrusters held from their newest sample to a second, where that is later; and which these are."""
    series, held = dict(recording.series), []
    for name in NAMES:
        span = _span_ns(series[name])
        if name not in MOTION and span is not None and span[1] < until_ns:
            series[name] = _longer(series[name], until_ns)
            held.append(name)
    return (replace(recording, series=series) if held else recording), tuple(held)


def _longer(series: Series, until_ns: int) -> Series:
    """A series with its newest believed value once more, as if measured at ``until_ns``."""
    believed = np.flatnonzero(series.quality < Quality.BAD)
    last = believed[np.argmax(series.measured_ns[believed])]
    return Series(
        np.append(series.measured_ns, until_ns),
        np.append(series.received_ns, series.received_ns[last]),
        np.append(series.value, series.value[last]),
        np.append(series.quality, series.quality[last]),
        series.sources,
        np.append(series.source_index, series.source_index[last]),
    )


def _span_ns(series: Series | None) -> tuple[int, int] | None:
    """When the first and the last believed sample of a channel were measured [ns]; None without one."""
    if series is None:
        return None
    believed = series.measured_ns[series.quality < Quality.BAD]
    return (int(believed.min()), int(believed.max())) if believed.size else None


def _longest_hold_ns(series: Series) -> float:
    """As long a gap as resampling bridges in this channel [ns]."""
    apart = np.diff(np.sort(series.measured_ns))
    return own_gap_s(float(np.median(apart)) if apart.size else 0.0) * NANO
