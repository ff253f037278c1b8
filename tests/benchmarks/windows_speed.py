"""How many times as fast as a plain row-by-row version the held windows are cut; prints the ratio.

Run as ``python tests/benchmarks/windows_speed.py``. The plain version asks the same rule of every candidate in
turn with pandas, and must find the same windows.
"""

from __future__ import annotations

import time

import numpy as np
import pandas as pd

from seatrial.acquisition.core.ship import CIRCULAR, COMMAND, NAMES, unwrap
from seatrial.analysis.estimation.motion_model import noise_standard_deviation
from seatrial.analysis.tables.table import index_of
from seatrial.analysis.windows.held import (
    DRIFT_SIGMAS,
    IDLE_DRIFT_RPM,
    IDLE_RPM,
    SPAN_SIGMAS,
    held_windows,
    tolerance_of,
)

HOURS, HORIZON_S, STRIDE_S = 4, 15, 5


def voyage(seconds: int) -> pd.DataFrame:
    """Settings that change every minute, with noise on the feedback, at 1 Hz."""
    random = np.random.default_rng(7)
    table = {name: random.normal(0.0, 0.2, seconds) for name in NAMES}
    for name in COMMAND:
        table[name] += np.repeat(random.uniform(-100, 100, seconds // 60 + 1), 60)[:seconds]
    return pd.DataFrame(table, index=index_of((1_700_000_000 + np.arange(seconds)) * 1_000_000_000))


def plain(table: pd.DataFrame) -> list[pd.DataFrame]:
    """The same rule, one candidate and one row at a time."""
    smooth = {name: unwrap(table[name]) if name in CIRCULAR else table[name].to_numpy() for name in COMMAND}
    noise = {name: min(noise_standard_deviation(smooth[name]), tolerance_of(name).noise) for name in COMMAND}
    kept = []
    centred = np.arange(HORIZON_S + 1) - HORIZON_S / 2
    weights = centred / (centred @ centred) * HORIZON_S
    for start in range(0, len(table) - HORIZON_S, STRIDE_S):
        window = table.iloc[start : start + HORIZON_S + 1]
        if all(_held(window, smooth, start, name, noise, weights) for name in COMMAND):
            kept.append(pd.DataFrame([row for _, row in window.iterrows()]))
    return kept


def _held(
    window: pd.DataFrame,
    smooth: dict[str, np.ndarray],
    start: int,
    name: str,
    noise: dict[str, float],
    weights: np.ndarray,
) -> bool:
    values = pd.Series(smooth[name][start : start + len(window)])
    tolerance = tolerance_of(name)
    drift = abs(sum(value * weight for value, weight in zip(values, weights, strict=True)))
    limit = np.hypot(tolerance.drift, DRIFT_SIGMAS * noise[name] * np.sqrt(weights @ weights))
    steady = values.max() - values.min() <= tolerance.span + SPAN_SIGMAS * noise[name] and drift <= limit
    idle = name not in CIRCULAR and values.abs().max() <= IDLE_RPM and drift <= IDLE_DRIFT_RPM
    return bool(steady or idle)


def main() -> None:
    """Print both times and their ratio."""
    table = voyage(HOURS * 3600)
    begin = time.perf_counter()
    windows = held_windows(table, HORIZON_S, STRIDE_S)
    fast = time.perf_counter() - begin
    begin = time.perf_counter()
    kept = plain(table)
    slow = time.perf_counter() - begin
    if len(kept) != windows.kept:
        raise SystemExit(f"the plain version keeps {len(kept)} windows, ours {windows.kept}")
    print(f"{HOURS} h at 1 Hz, {windows.candidates} candidates, {windows.kept} kept")
    print(f"held_windows {fast:.4f} s, row by row {slow:.2f} s: {slow / fast:.0f} times as fast")


if __name__ == "__main__":
    main()
