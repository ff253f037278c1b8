"""A prediction as the body of a ``/prediction`` message, and its track as GeoJSON for a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import orjson
import pymap3d

from acquisition.core.angles import wrap_360
from acquisition.core.arrays import Floats
from analysis.tables.time_index import NANO
from hybrid.calibrators.predict import Prediction
from hybrid.twin.running_error import MeanErrors, TrackError

Origin = tuple[float, float] | None
"""Latitude and longitude of the plane's origin [deg], if it is known."""

_TRACK_STYLE = {"color": "#ff7f0e", "weight": 4}
_BAND_STYLE = {"color": "#ff7f0e", "weight": 1, "fillOpacity": 0.15}
_CORNERS = 24


def message_body(
    prediction: Prediction,
    held: Sequence[str],
    origin: Origin,
    model: tuple[str, str],
    made_ns: int,
    latency_s: float,
    error: TrackError | None,
    running: tuple[float, MeanErrors],
) -> dict[str, Any]:
    """The message. ``model`` names the vessel and the calibrator's folder, ``running`` is over how many seconds the
    means are and what they are.
    """
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
    return body if error is None else {**body, "error": _without_none(error.as_dict())}


def _without_none(values: dict[str, Any]) -> dict[str, Any]:
    """Without what is None."""
    return {name: value for name, value in values.items() if value is not None}


def track_arrays(prediction: Prediction, origin: Origin) -> dict[str, list[float]]:
    """The track as arrays, a second an element; positions to the millimetre, what is not known empty."""
    north_m, east_m, heading = prediction.track.T
    latitude_deg, longitude_deg = positions(north_m, east_m, origin)
    band_m = np.empty(0) if prediction.band_m is None else prediction.band_m
    return {
        "seconds": [float(each) for each in range(len(north_m))],
        "north_m": _rounded(north_m, 3),
        "east_m": _rounded(east_m, 3),
        "heading_deg": _rounded(wrap_360(np.rad2deg(heading)), 3),
        "band_m": _rounded(band_m, 3),
        "latitude_deg": _rounded(latitude_deg, 8),
        "longitude_deg": _rounded(longitude_deg, 8),
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
    if prediction.band_m is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS + 1)
        radius_m = prediction.band_m[-1]
        ring = _coordinates(north_m[-1] + radius_m * np.cos(angle), east_m[-1] + radius_m * np.sin(angle), origin)
        ring[-1] = ring[0]
        features.append(_feature("Polygon", [ring], f"95 % after {len(north_m) - 1} s", _BAND_STYLE))
    return orjson.dumps({"type": "FeatureCollection", "features": features}).decode()


def _coordinates(north_m: Floats, east_m: Floats, origin: Origin) -> list[list[float]]:
    """Points as GeoJSON has them: longitude first [deg]."""
    latitude, longitude = positions(north_m, east_m, origin)
    return [[float(east), float(north)] for east, north in np.column_stack([longitude, latitude]).round(8)]


def _feature(kind: str, coordinates: list[Any], name: str, style: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"name": name, "style": style},
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def _rounded(values: Floats, digits: int) -> list[float]:
    return [float(each) for each in np.round(values, digits)]
