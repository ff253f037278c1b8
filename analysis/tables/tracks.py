"""The way of a ship over ground in latitude and longitude: for maps as KML, for plotters as GPX."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
from pymap3d import ned2geodetic

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.files import atomic_file
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.tables.resample import interpolate, own_gap_s
from seatrial.analysis.tables.table import NANO, times_ns

_KML, _GX, _GPX = (
    "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2", "http://www.topografix.com/GPX/1/1",
)  # fmt: skip
_DECIMALS = 8  # of a degree: a millimetre


def places_of(table: pd.DataFrame) -> dict[str, Floats]:
    """Latitude and longitude [deg] of each row as ``lat`` and ``lon``: from north and east, or as they are.

    They are interpolated between positions that lie close together, NaN elsewhere. Nothing without positions, or
    without an origin.
    """
    time_ns, trial = times_ns(table), table.attrs.get("trial", {})
    origin = trial.get("origin_latitude_deg"), trial.get("origin_longitude_deg")

    def at_rows(values: Any) -> Floats:
        return interpolate(time_ns, np.asarray(values, dtype=float), time_ns)

    if None not in origin and {"north_m", "east_m"} <= set(table.columns):
        lat, lon, _ = ned2geodetic(at_rows(table["north_m"]), at_rows(table["east_m"]), 0.0, *origin, 0.0)
    elif {"latitude_deg", "longitude_deg"} <= set(table.columns):
        lat, turned = at_rows(table["latitude_deg"]), table["longitude_deg"].to_numpy(dtype=float, copy=True)
        valid = np.isfinite(turned)
        turned[valid] = np.unwrap(turned[valid], period=360.0)
        lon = (at_rows(turned) + 180.0) % 360.0 - 180.0
    else:
        return {}
    return {"lat": np.asarray(lat), "lon": np.asarray(lon)}


def write_gpx(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """GPX 1.1: one track, a segment for each stretch without a hole. Raises :class:`DataShortageError`."""
    root = ET.Element("gpx", xmlns=_GPX, version="1.1", creator=software_version())
    track = _child(root, "trk")
    _child(track, "name", _title(about))
    for segment in _segments(table):
        written = _child(track, "trkseg")
        for time, lat, lon in segment:
            _child(_child(written, "trkpt", lat=lat, lon=lon), "time", time)
    return _write(root, path)


def write_kml(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """KML 2.2: each stretch without a hole as a line, and as a track that an Earth viewer plays.

    Raises :class:`DataShortageError` where no position is known.
    """
    root = ET.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = _child(root, "Document")
    _child(document, "name", _title(about))
    for segment in _segments(table):
        placemark = _child(document, "Placemark")
        _child(placemark, "name", f"{segment[0][0]} to {segment[-1][0]}")
        line = _child(placemark, "LineString")
        _child(line, "tessellate", "1")
        _child(line, "coordinates", " ".join(f"{lon},{lat}" for _, lat, lon in segment))
        played = _child(document, "Placemark")
        _child(played, "name", about["trial"].get("vessel") or "ship")
        track = _child(played, "gx:Track")
        for time, _, _ in segment:
            _child(track, "when", time)
        for _, lat, lon in segment:
            _child(track, "gx:coord", f"{lon} {lat} 0")
    return _write(root, path)


def _title(about: Mapping[str, Any]) -> str:
    return about["trial"].get("name") or about["recording"] or "trial"


def _segments(table: pd.DataFrame) -> list[list[tuple[str, str, str]]]:
    """Time (ISO 8601), latitude and longitude [deg] as text of the rows of each stretch whose place is known."""
    where = places_of(table)
    located = np.flatnonzero(np.isfinite(where["lat"]) & np.isfinite(where["lon"])) if where else np.empty(0, int)
    if located.size == 0:
        raise DataShortageError(
            "contains no latitude and longitude", why="it has no positions, or its north and east have no origin",
            fix="give [trial] an origin before recording, or export a table",
        )  # fmt: skip
    times = np.datetime_as_string(times_ns(table).astype("datetime64[ns]"), unit="ms")
    lat, lon = ([f"{value:.{_DECIMALS}f}" for value in where[name]] for name in ("lat", "lon"))
    step_ns = np.diff(times_ns(table)[located])
    holes = (np.diff(located) > 1) | (step_ns > own_gap_s(np.median(step_ns) if step_ns.size else 0.0) * NANO)
    stretches = np.split(located, np.flatnonzero(holes) + 1)
    return [[(f"{times[row]}Z", lat[row], lon[row]) for row in rows] for rows in stretches]


def _child(parent: ET.Element, tag: str, text: str = "", **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text or None
    return element


def _write(root: ET.Element, path: Path) -> list[Path]:
    ET.indent(root, " ")
    with atomic_file(path) as partial:
        ET.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
    return [path]
