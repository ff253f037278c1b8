"""Feedback under the name of the sister: two alike actuators of which each follows the orders to the other.

Numbers of thrusters and shafts are easily exchanged, in a configuration or a column map. Where both are ordered
alike nothing shows; where they are not, each feedback is near the other's orders all the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import pandas as pd

from seatrial.acquisition.core import ship, trial
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis import series
from seatrial.analysis.quality.findings import CheckResult, Finding, set_flags, uniform_flags
from seatrial.analysis.tables.table import table_actuators, utc_index

_STEP_S, _FEWEST, _PARTS = 1.0, 60, 2
_NEARER = 3.0
"""By so many times the feedback has to be nearer to the other's orders, as a root mean square, in every part."""
_LEAST = {"deg": 2.0, "rpm": 5.0, "%": 2.0}
"""What the orders have to differ by, as a root mean square: less is within what a drive is off anyway."""


def check_exchanged_feedback(table: pd.DataFrame) -> CheckResult:
    """Find two alike actuators whose feedback is exchanged (``feedback_exchanged``).

    One finding a control, under the first one's channel; ``estimate``: the root mean squares of feedback less
    ``own`` and less ``other`` orders, in the channel's unit. Both are flagged suspect. Without orders to both, or
    where these hardly differ, nothing is found.
    """
    flags, findings, index = uniform_flags(table), list[Finding](), utc_index(table)
    for first, second in _like_controls(table_actuators(table)):
        names = first.name, second.name
        orders = tuple(map(ship.order_channel_name, names))
        if not all(name in table and table[name].notna().any() for name in (*names, *orders)):
            continue
        values = _on_common_times(table, (*names, *orders))
        own, other, apart = _differences(values, circular=first.circular)
        if own.size < _PARTS or (apart < _LEAST[first.unit]).any() or (own < _NEARER * other).any():
            continue
        whole = {name: float(np.sqrt(np.mean(part**2))) for name, part in (("own", own), ("other", other))}
        text = (
            f"{names[0]} and {names[1]} follow the orders to each other, to {whole['other']:.3g} {first.unit}; "
            f"from their own they are {whole['own']:.3g} {first.unit} away"
        )
        remedy = "Exchange the two, or the orders, in the configuration or column map; a known order tells which"
        findings.append(Finding("feedback_exchanged", names[0], index[0], index[-1], text, remedy, whole))
        for name in names:
            flags[name] = uniform_flags(table, (name,))[name]
            set_flags(flags, name, series.finite_samples(table, name).rows, trial.Quality.SUSPECT)
    return CheckResult(flags, tuple(findings))


def _like_controls(actuators: ship.Actuators) -> Iterator[tuple[ship.Channel, ship.Channel]]:
    """The same control of every two actuators of a kind."""
    for first, second in combinations(actuators, 2):
        if first.kind == second.kind:
            yield from zip(first.channels, second.channels, strict=True)


def _on_common_times(table: pd.DataFrame, names: tuple[str, ...]) -> Floats:
    """The two feedbacks and their orders [4, seconds] from where all have begun to the end of a feedback; an order
    holds until the next."""
    samples = [series.finite_samples(table, name) for name in names]
    start = max(each.time_s[0] for each in samples)
    end = min(each.time_s[-1] for each in samples[:2])
    times = np.arange(start, end, _STEP_S)
    return np.array([
        each.value[np.maximum(np.searchsorted(each.time_s, times, side="right") - 1, 0)] for each in samples
    ])  # fmt: skip


def _differences(values: Floats, *, circular: bool) -> tuple[Floats, Floats, Floats]:
    """Root mean squares by part of the time: feedback less own and other orders, and of the orders themselves.

    Each is empty for too short a time.
    """
    first, second, first_order, second_order = values
    if first.size < _FEWEST:
        return np.zeros(0), np.zeros(0), np.zeros(0)

    def rms(*pairs: tuple[Floats, Floats]) -> Floats:
        squares = sum((ship.wrap_180(a - b) if circular else a - b) ** 2 for a, b in pairs)
        return np.array([np.sqrt(part.mean() / len(pairs)) for part in np.array_split(squares, _PARTS)])

    return (
        rms((first, first_order), (second, second_order)),
        rms((first, second_order), (second, first_order)),
        rms((first_order, second_order)),
    )
