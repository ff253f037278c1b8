"""A recording's row in the index: plain values that a table and a page can hold."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from acquisition.core.channels import NAMES
from analysis.batch.products import Products
from analysis.manoeuvres import Manoeuvre

Row = dict[str, Any]
"""One recording in the index: plain values by name, see :func:`row_of`."""

GRADES = ("good", "suspect", "bad")
KEY_INDICES = frozenset({
    "overshoot_1_deg", "overshoot_2_deg", "overshoot_mean_deg", "advance_m", "transfer_m",
    "tactical_diameter_m", "steady_diameter_m", "speed_over_ground_mps", "speed_through_water_mps",
    "track_reach_m", "head_reach_m",
})  # fmt: skip
NOT_CLOSED = "was not closed and is read as far as it goes; see what is missing with `seatrial recover`"
"""The remark on a recording that was cut off: done, and explained."""

_COURSE_STEP_S = 5  # distances are summed over means of so long, or the noise of a position adds to them
_THUMBNAIL_POINTS = 60


def row_of(products: Products, provenance: Mapping[str, Any]) -> Row:
    """The row of a recording: plain values only, NaN as ``None``."""
    recording, one_hz, windows = products.recording, products.one_hz, products.windows
    trial, missing = recording.trial, missing_channels(products.table)
    row: Row = {
        "status": "failed" if products.shortfalls else "done",
        "cause": "; ".join(products.shortfalls) or ("" if recording.closed else NOT_CLOSED),
        "vessel": trial.vessel,
        "trial": trial.name,
        "place": trial.place,
        "start": one_hz.index[0].isoformat(),
        "duration_s": float(len(one_hz) - 1),
        "distance_m": distance_m(one_hz),
        "samples": sum(int(series.value.size) for series in recording.series.values()),
        "channels": len(NAMES) - len(missing),
        "missing": missing,
        "closed": recording.closed,
        "grade": max((each.grade for each in products.quality.channels.values()), key=GRADES.index, default=""),
        "findings": len(products.quality.findings),
        "findings_by_code": dict(Counter(each.code for each in products.quality.findings)),
        "repairs": len(products.repairs),
        "manoeuvres": dict(Counter(each.kind for each in products.manoeuvres)),
        "indices": key_indices(products.manoeuvres),
        "windows_kept": windows.kept if windows else None,
        "windows_candidates": windows.candidates if windows else None,
        "windows_dropped": windows.dropped if windows else {},
        "legs": windows.legs if windows else None,
        "track": thumbnail(one_hz),
        "provenance": dict(provenance),
    }
    return dict(plain(row))


def missing_channels(table: pd.DataFrame) -> list[str]:
    """Those of the 13 channels that have no value at all; no check can judge them."""
    return [name for name in NAMES if name not in table or not table[name].notna().any()]


def key_indices(manoeuvres: Iterable[Manoeuvre]) -> dict[str, float]:
    """The indices that a season is compared by: the median of each over a recording's manoeuvres of a kind."""
    values: dict[str, list[float]] = {}
    for each in manoeuvres:
        for name in KEY_INDICES & set(each.indices):
            values.setdefault(f"{each.kind}_{name}", []).append(each.indices[name].value)
    return {name: float(np.median(values[name])) for name in sorted(values)}


def distance_m(one_hz: pd.DataFrame) -> float | None:
    """The distance sailed over ground [m]: between means of its position over 5 s, straight across holes.

    ``None`` where there are not two of them.
    """
    if not {"north_m", "east_m"} <= set(one_hz.columns):
        return None
    position = one_hz[["north_m", "east_m"]].to_numpy()
    steps = position[: len(position) // _COURSE_STEP_S * _COURSE_STEP_S].reshape(-1, _COURSE_STEP_S, 2)
    means = steps.mean(axis=1)
    means = means[np.isfinite(means).all(axis=1)]
    if len(means) < 2:
        return None
    return float(np.hypot(*np.diff(means, axis=0).T).sum())


def thumbnail(one_hz: pd.DataFrame) -> str:
    """The track as points of a polyline in a square of 100 by 100, north up and to scale; empty without one."""
    if not {"north_m", "east_m"} <= set(one_hz.columns):
        return ""
    track = one_hz[["east_m", "north_m"]].dropna().to_numpy() * [1.0, -1.0]
    if len(track) < 2:
        return ""
    chosen = track[np.unique(np.linspace(0, len(track) - 1, _THUMBNAIL_POINTS).astype(int))]
    middle, size = (chosen.max(axis=0) + chosen.min(axis=0)) / 2.0, max(np.ptp(chosen, axis=0).max(), 1.0)
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in 50.0 + 92.0 * (chosen - middle) / size)


def plain(value: Any) -> Any:
    """A value as JSON has it: numbers of Python, no NaN, times as ISO 8601."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, pd.Timestamp):
        return value.isoformat()
    return None if isinstance(value, float) and not math.isfinite(value) else value
