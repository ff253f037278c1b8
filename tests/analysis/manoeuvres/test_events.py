"""Orders that were recorded when they changed: interpolated between the events, or repaired to steps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.manoeuvres.motion import motion_of
from seatrial.analysis.quality.controls import hold_orders
from seatrial.analysis.tables.table import add_step
from tests.analysis.manoeuvres.conftest import Sail

AZIMUTHS = ("port_angle_deg", "starboard_angle_deg")


@pytest.fixture(scope="module")
def recorded(sail: Sail) -> pd.DataFrame:
    return sail("gunnerus_short", "gentle", "zigzag_20_20", 300.0).recorded


def as_events(table: pd.DataFrame, least_deg: float = 1.5) -> pd.DataFrame:
    """The azimuths known only where they had changed by so much, at random moments else, and lines between."""
    random = np.random.default_rng(3)
    result = table.copy()
    for name in AZIMUTHS:
        values = table[name].to_numpy()
        kept = [0]
        for row in range(1, values.size):
            if abs(values[row] - values[kept[-1]]) > least_deg or random.random() < 0.02:
                kept.append(row)
        result[name] = np.interp(np.arange(values.size), kept, values[kept])
    return result


def repaired(table: pd.DataFrame) -> pd.DataFrame:
    steps = table.assign(**{name: hold_orders(table, name) for name in AZIMUTHS})
    steps.attrs = dict(table.attrs)
    for name in AZIMUTHS:
        steps = add_step(steps, "repair", code="order_interpolated", channel=name)
    return steps


def zigzag_of(table: pd.DataFrame) -> Manoeuvre:
    return next(each for each in find_manoeuvres(table, 28.9) if each.kind == "zigzag")


def test_measured_azimuths_are_no_events(recorded: pd.DataFrame) -> None:
    found = zigzag_of(recorded)
    assert not motion_of(recorded).orders_are_events
    assert not any("events" in note for note in found.notes)


@pytest.mark.parametrize("mended", [False, True])
def test_a_zigzag_of_events_is_found_and_a_note_says_what_they_are(recorded: pd.DataFrame, mended: bool) -> None:
    events = as_events(recorded)
    found = zigzag_of(repaired(events) if mended else events)
    assert found.name == zigzag_of(recorded).name
    assert any("recorded as events" in note for note in found.notes)
    assert found.indices["overshoot_1_from_order_deg"].limit == 25.0


@pytest.mark.parametrize("mended", [False, True])
def test_what_events_say_agrees_with_what_was_measured(recorded: pd.DataFrame, mended: bool) -> None:
    """From half way of the change, which events place to within a change of 1.5 deg of helm and its seconds."""
    events = as_events(recorded)
    found, measured = zigzag_of(repaired(events) if mended else events), zigzag_of(recorded)
    for number in (1, 2):
        values = [each.indices[f"overshoot_{number}_deg"].value for each in (found, measured)]
        assert abs(values[0] - values[1]) < 3.0  # a second of this ship's fastest turn


def test_the_interval_of_a_circle_of_events_allows_for_the_moment_of_the_order(sail: Sail) -> None:
    table = sail("gunnerus_short", "calm", "turning_circle_30", 800.0).recorded
    both = []
    for each in (table, as_events(table)):
        both.append(next(found for found in find_manoeuvres(each) if found.kind == "turning_circle").indices)
    measured, events = both
    assert events["advance_m"].low < measured["advance_m"].high
    assert events["advance_m"].high > measured["advance_m"].low
    widths = [advance.high - advance.low for advance in (events["advance_m"], measured["advance_m"])]
    assert widths[0] > 1.5 * widths[1]
    assert abs(events["advance_m"].value - measured["advance_m"].value) < 5.0
    assert abs(events["tactical_diameter_m"].value - measured["tactical_diameter_m"].value) < 2.0
