"""The samples of the last minute, a prediction from their newest whole second, as by ``seatrial predict``, and
that prediction as the body of a ``/prediction`` message and as GeoJSON for a map.

Only a fraction of a second of data follows that second. So the filter that brings the channels to 1 Hz is
one-sided there, and the start state of all methods is that of a Kalman filter
(:mod:`seatrial.hybrid.prediction.kalman_filter`), less certain than a two-sided state computed from a recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson
import pandas as pd
import pymap3d

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Floats, Series
from seatrial.acquisition.core.ship import POSE_AND_VELOCITY, trial_names, wrap_360
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.tables.resample import own_gap_s, resample_recording
from seatrial.analysis.tables.table import NANO, actuators_in_recording
from seatrial.analysis.windows.held import SecondBySecond
from seatrial.hybrid.calibrators.predict import Prediction, predict
from seatrial.hybrid.prediction.regions import bands, outlines
from seatrial.hybrid.twin.running_error import MeanErrors, TrackError
from seatrial.hybrid.vessel.plant import Plant

if TYPE_CHECKING:
    from seatrial.hybrid.calibrators.train import TrainedCalibrator


_SOURCE = ("",)


@dataclass(frozen=True, slots=True)
class Forecast:
    """A prediction, the 1 Hz table that it was made of, and the channels that were held to its start."""

    prediction: Prediction
    table: pd.DataFrame
    held: tuple[str, ...]


def newest_second_ns(recording: Recording) -> int | None:
    """The newest whole second [ns] covered by all motion channels; None if there is none.

    Wind and thrusters are held anyway, and may be older.
    """
    spans = [_span_ns(recording.series.get(name)) for name in POSE_AND_VELOCITY]
    known = [each for each in spans if each is not None]
    if len(known) < len(POSE_AND_VELOCITY):
        return None
    second_ns = min(newest for _, newest in known) // NANO * NANO
    return second_ns if second_ns >= max(oldest for oldest, _ in known) else None


def missing_channels(recording: Recording, at_ns: int | None) -> list[str]:
    """The trial's channels without a value at a second: never received, or too long before it.

    Without a second (None) those that were never received.
    """
    return [
        name
        for name in trial_names(actuators_in_recording(recording))
        if (span := _span_ns(recording.series.get(name))) is None
        or (at_ns is not None and at_ns - span[1] > _longest_hold_ns(recording.series[name]))
    ]


def predict_now(
    recording: Recording,
    horizon_s: int,
    plant: Plant,
    trained: TrainedCalibrator | None = None,
    at_ns: int | None = None,
    commands: pd.DataFrame | None = None,
) -> Forecast:
    """Predict from the newest whole second of the last minute or so, or from the second ``at_ns``, with the
    thrusters as they are or under planned ``commands`` (:func:`.read_commands`).

    Raises :class:`DataShortageError` naming the channels that are missing, :class:`InputError` where one has a gap
    at that second, :class:`ModelRangeError` where the reference leaves its range.
    """
    start_ns = newest_second_ns(recording) if at_ns is None else at_ns
    missing = missing_channels(recording, start_ns)
    if missing:
        raise DataShortageError(f"{', '.join(missing)} missing", fix="run `seatrial record --check`")
    if start_ns is None:
        raise DataShortageError("no whole second of the ship's motion", fix="wait for more")
    filled, held = hold_until(recording, start_ns)
    table = resample_recording(filled)
    at = pd.Timestamp(start_ns, unit="ns", tz="UTC")
    return Forecast(predict(SecondBySecond(table), at, horizon_s, plant, trained, commands), table, held)


def hold_until(recording: Recording, until_ns: int) -> tuple[Recording, tuple[str, ...]]:
    """Wind and thrusters held from their newest sample to a second, where that is later; and which these are."""
    series, held = dict(recording.series), []
    for name in trial_names(actuators_in_recording(recording)):
        span = _span_ns(series[name])
        if name not in POSE_AND_VELOCITY and span is not None and span[1] < until_ns:
            series[name] = _longer(series[name], until_ns)
            held.append(name)
    return (replace(recording, series=series) if held else recording), tuple(held)


def _longer(series: Series, until_ns: int) -> Series:
    """A series with its newest valid value repeated, as if measured at ``until_ns``."""
    believed = np.flatnonzero(series.quality < Quality.BAD)
    last = believed[np.argmax(series.measured_ns[believed])]
    repeated = replace(series.subset(np.array([last])), measured_ns=np.array([until_ns]))
    return Series.joined([series, repeated])


def _span_ns(series: Series | None) -> tuple[int, int] | None:
    """The times of a channel's first and last valid samples [ns]; None without one."""
    if series is None:
        return None
    believed = series.measured_ns[series.quality < Quality.BAD]
    return (int(believed.min()), int(believed.max())) if believed.size else None


def _longest_hold_ns(series: Series) -> float:
    """The longest gap that resampling bridges in this channel [ns]."""
    apart = np.diff(np.sort(series.measured_ns))
    return own_gap_s(float(np.median(apart)) if apart.size else 0.0) * NANO


class RecentSamples:
    """The samples received in the last ``keep_s`` seconds before the newest one, by channel."""

    def __init__(self, keep_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._samples: dict[str, Series] = {}
        self.newest_received_ns = 0

    def clear(self) -> None:
        """Drop all samples."""
        self._samples.clear()
        self.newest_received_ns = 0

    def add(self, samples: Mapping[str, Series], *, again: bool = False) -> None:
        """Append samples by channel; with ``again``, known ones are skipped."""
        for name, each in samples.items():
            added, known = each, self._samples.get(name)
            if again and known is not None and known.received_ns.size:
                added = added.subset(added.received_ns > known.received_ns.max())
            if added.received_ns.size:
                self.newest_received_ns = max(self.newest_received_ns, int(added.received_ns.max()))
            self._samples[name] = added if known is None else Series.joined([known, added])
        oldest_ns = self.newest_received_ns - self._keep_ns
        self._samples = {name: each.subset(each.received_ns >= oldest_ns) for name, each in self._samples.items()}

    def recording(self, trial: Trial, path: Path) -> Recording:
        """The samples as a recording, without their sources."""
        series = {
            name: replace(each, sources=_SOURCE, source_index=np.zeros(each.value.size, np.int32))
            for name, each in self._samples.items()
            if each.value.size
        }
        return Recording(path, trial, series, {}, [], 0, False, 0, self.newest_received_ns)


Origin = tuple[float, float] | None
"""Latitude and longitude of the plane's origin [deg], if it is known."""

_TRACK_STYLE = {"color": "#ff7f0e", "weight": 4}
_BAND_STYLE = {"color": "#ff7f0e", "weight": 1, "fillOpacity": 0.15}


def message_body(
    prediction: Prediction,
    held: Sequence[str],
    origin: Origin,
    model: tuple[str, str],
    made_ns: int,
    latency_s: float,
    error: TrackError | None,
    running: tuple[float, MeanErrors],
    band_factor: float = 1.0,
) -> dict[str, Any]:
    """The message body. ``model`` names the vessel and the calibrator's folder, ``running`` has the mean errors
    and the seconds that they cover, ``band_factor`` is the factor on the band."""
    over_s, mean = running
    body = {
        "start": prediction.at.as_unit("ns").value / NANO,
        "made_at": made_ns / NANO,
        "latency_s": round(latency_s, 4),
        "horizon_s": len(prediction.track) - 1,
        "method": prediction.method,
        "vessel": model[0][-200:],
        "calibrator": model[1][-200:],
        "outside_training_range": prediction.outside_domain,
        "held_channels": list(held),
        "track": track_arrays(prediction, origin),
        "running": {"over_s": over_s, **_without_none(asdict(mean))},
    }
    if prediction.region_m is not None:
        body["band_factor"] = round(band_factor, 4)
    if prediction.planned:
        body["planned_channels"] = list(prediction.planned)
    return body if error is None else {**body, "error": _without_none(error.as_dict())}


def _without_none(values: dict[str, Any]) -> dict[str, Any]:
    """The dictionary without None values."""
    return {name: value for name, value in values.items() if value is not None}


def track_arrays(prediction: Prediction, origin: Origin) -> dict[str, list[float]]:
    """The track as arrays by second; positions to the millimetre, unknown quantities empty."""
    north_m, east_m, heading = prediction.track.T
    latitude_deg, longitude_deg = positions(north_m, east_m, origin)
    regions = bands(prediction.region_m)
    return {
        "seconds": np.arange(len(north_m), dtype=float).tolist(),
        "north_m": north_m.round(3).tolist(),
        "east_m": east_m.round(3).tolist(),
        "heading_deg": wrap_360(np.rad2deg(heading)).round(3).tolist(),
        **{name: [] if each is None else each.round(3).tolist() for name, each in regions.items()},
        "latitude_deg": latitude_deg.round(8).tolist(),
        "longitude_deg": longitude_deg.round(8).tolist(),
    }


def positions(north_m: Floats, east_m: Floats, origin: Origin) -> tuple[Floats, Floats]:
    """Latitudes and longitudes [deg] of points of the plane; empty without an origin."""
    if origin is None:
        return np.empty(0), np.empty(0)
    latitude, longitude, _ = pymap3d.ned2geodetic(north_m, east_m, np.zeros_like(north_m), *origin, 0.0)
    return np.asarray(latitude), np.asarray(longitude)


def track_geojson(prediction: Prediction, origin: Origin) -> str:
    """The track as a line, and the 95 % region at its end, for a map; empty without an origin."""
    if origin is None:
        return ""
    north_m, east_m = prediction.track.T[:2]
    name = f"{prediction.method}, {len(north_m) - 1} s"
    features = [_feature("LineString", _coordinates(north_m, east_m, origin), name, _TRACK_STYLE)]
    if prediction.region_m is not None:
        corners = outlines(prediction.track, prediction.region_m[1:])[-1]
        ring = _coordinates(corners[:, 0], corners[:, 1], origin)
        ring.append(ring[0])
        features.append(_feature("Polygon", [ring], f"95 % after {len(north_m) - 1} s", _BAND_STYLE))
    return orjson.dumps({"type": "FeatureCollection", "features": features}).decode()


def _coordinates(north_m: Floats, east_m: Floats, origin: Origin) -> list[list[float]]:
    """Points as GeoJSON has them: longitude first [deg]."""
    latitude, longitude = positions(north_m, east_m, origin)
    points: list[list[float]] = np.column_stack([longitude, latitude]).round(8).tolist()
    return points


def _feature(kind: str, coordinates: list[Any], name: str, style: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"name": name, "style": style},
        "geometry": {"type": kind, "coordinates": coordinates},
    }
