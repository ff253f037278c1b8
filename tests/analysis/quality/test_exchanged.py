"""Two alike actuators whose feedback is exchanged are found; sound ones, and orders that hardly differ, are not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.ship import wrap_180
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.quality.controls import check_exchanged_feedback
from seatrial.analysis.quality.findings import Finding

SECONDS = 400


def ordered(differ: float, lag_s: int = 1) -> pd.DataFrame:
    """R/V Gunnerus' two pods: orders in steps, of which those to starboard differ, and feedback after a while."""
    random = np.random.default_rng(0)
    steps = np.repeat(random.uniform(-1.0, 1.0, (SECONDS // 40, 4)), 40, axis=0)
    port = np.column_stack([120.0 + 10.0 * steps[:, 0], 175.0 + 10.0 * steps[:, 1]])
    starboard = port + differ * (1.0 + steps[:, 2:])
    columns = {}
    for side, orders in (("port", port), ("starboard", starboard)):
        for name, order in zip(("rpm", "angle_deg"), orders.T, strict=True):
            followed = np.roll(order, lag_s) + 0.2 * random.standard_normal(SECONDS)
            turn = wrap_180 if name == "angle_deg" else np.asarray
            columns |= {f"{side}_{name}": turn(followed), f"{side}_order_{name}": turn(order)}
    index = pd.date_range("2026-05-17T12:00Z", periods=SECONDS, freq="s")
    return pd.DataFrame(columns, index=index)


def exchanged(table: pd.DataFrame, name: str) -> pd.DataFrame:
    return table.assign(**{f"port_{name}": table[f"starboard_{name}"], f"starboard_{name}": table[f"port_{name}"]})


def found(table: pd.DataFrame) -> list[Finding]:
    return list(check_exchanged_feedback(table).findings)


@pytest.mark.parametrize("name", ["rpm", "angle_deg"])
def test_exchanged_feedback_is_found_through_the_whole_check(name: str) -> None:
    """Angles on both sides of astern, so that they count across the turn."""
    quality = check_table(exchanged(ordered(15.0), name))
    (finding,) = (each for each in quality.findings if each.code == "feedback_exchanged")
    assert finding.channel == f"port_{name}"
    assert finding.estimate["other"] < finding.estimate["own"] / 3.0
    assert (quality.flags[[f"port_{name}", f"starboard_{name}"]] >= 3).all().all()
    assert (quality.flags[f"port_order_{name}"] < 3).all()


def test_orders_that_are_recorded_when_they_change_hold() -> None:
    table = exchanged(ordered(15.0), "rpm")
    for order in ("port_order_rpm", "starboard_order_rpm"):
        table[order] = table[order].where(table[order].diff() != 0.0)
    assert [each.channel for each in found(table)] == ["port_rpm"]


@pytest.mark.parametrize("table", [
    ordered(15.0), ordered(0.0), exchanged(ordered(0.3), "rpm"),
    exchanged(ordered(15.0), "rpm").drop(columns="port_order_rpm"), exchanged(ordered(15.0), "rpm")[:50],
], ids=["sound", "alike", "hardly different", "without orders", "short"])  # fmt: skip
def test_nothing_is_said_without_evidence(table: pd.DataFrame) -> None:
    assert found(table) == []
