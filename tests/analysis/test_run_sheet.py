"""The run sheet: what the crew said, what the channels say, and plainly what nobody wrote down."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.manoeuvres.indices import Current, Manoeuvre
from seatrial.analysis.quality.wind import BEAUFORT_MPS, beaufort_number
from seatrial.analysis.report.pages import event_rows
from seatrial.analysis.report.tables import UNKNOWN, ShipDimensions, run_sheet_rows, wind_in_words
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import table_of
from tests.analysis.conftest import steady_table


def sheet_of(tmp_path: Path, trial: Trial, *more: object) -> dict[str, str]:
    path = tmp_path / "trial.mcap"
    write_table(steady_table(120), path, trial, source="test")
    recording = read_recording(path)
    return dict(run_sheet_rows(recording, resample(table_of(recording)), *more))  # type: ignore[arg-type]


def test_what_was_written_down_is_there(tmp_path: Path) -> None:
    trial = Trial(
        "docking", "gunnerus", "Trondheim", 63.5, -10.25, 20.0, 2.5, "<calm>", 0.1, "half fuel", "2, from the west"
    )
    sheet = sheet_of(tmp_path, trial, (), ShipDimensions("long", 36.25, 33.9, 9.6, 2.7))
    assert sheet["ship"] == "gunnerus"
    assert sheet["water depth"] == "20 m, 8.0 draughts"
    assert sheet["draughts fore, aft"] == "2.45 m, 2.55 m, from the mean of 2.5 m and the trim"
    assert sheet["trim by the stern"] == "0.1 m"
    assert sheet["origin of north and east"] == "63.50000\u00b0 N, 10.25000\u00b0 W"
    assert (sheet["loading"], sheet["sea state"], sheet["crew notes"]) == (
        "half fuel",
        "2, from the west",
        "<calm>",
    )
    assert sheet["ratios"].startswith("L/B 3.53, B/T 3.84")
    assert len(sheet["SHA-256"]) == 64
    assert sheet["closed properly"] == "yes"


def test_what_nobody_wrote_down_says_so(tmp_path: Path) -> None:
    sheet = sheet_of(tmp_path, Trial())
    for what in ("ship", "place", "loading", "water depth", "sea state", "crew notes"):
        assert sheet[what] == UNKNOWN
    assert sheet["current"].startswith("unknown")


def test_the_current_is_that_of_the_turns(tmp_path: Path) -> None:
    start = pd.Timestamp("2026-01-01", tz="UTC")
    turns = [Manoeuvre("turning_circle", "circle", start, start, "port", {"turned_deg": 560.0}, {}, current=each)
             for each in (Current(0.0, 0.3, 0.01, 0.01), Current(0.0, 0.5, 0.01, 0.01))]  # fmt: skip
    said = sheet_of(tmp_path, Trial(), turns)["current"]
    assert said.startswith("0.40 \u00b1 0.11 m/s towards 90\u00b0 (the range of both)")
    more = sheet_of(tmp_path, Trial(), [*turns, turns[0]])["current"]
    assert more.startswith("0.37 \u00b1 0.29 m/s towards 90\u00b0 (95 % interval)")
    on_a_pond = replace(turns[0], current=Current(0.0, 0.0213, 0.0012, 0.0012))
    said = sheet_of(tmp_path, Trial(), [on_a_pond])["current"]
    assert said.startswith("0.021 \u00b1 0.001 m/s")  # no interval is of no width


@pytest.mark.parametrize("force", range(1, 13))
def test_the_wind_force_begins_at_its_lowest_speed(force: int) -> None:
    lowest = BEAUFORT_MPS[force - 1]
    assert (beaufort_number(lowest - 0.01), beaufort_number(lowest)) == (force - 1, force)


def test_a_wind_about_north_is_no_wind_from_the_south() -> None:
    table = pd.DataFrame({"wind_speed_mps": [6.0, 6.0], "wind_direction_deg": [350.0, 10.0]})
    assert wind_in_words(table).startswith("6.0 m/s from 0\u00b0") or wind_in_words(table).startswith(
        "6.0 m/s from 360\u00b0"
    )
    assert wind_in_words(table.assign(wind_speed_mps=np.nan)) == UNKNOWN


def test_events_are_listed_with_their_time(tmp_path: Path) -> None:
    path = tmp_path / "trial.mcap"
    write_table(steady_table(5), path, Trial(), source="test")
    recording = read_recording(path)
    recording.events.append((1_700_000_000_000_000_000, "start zigzag"))
    assert event_rows(recording)[-1] == ["2023-11-14 22:13:20", "start zigzag"]
    recording.events.extend((1_700_000_001_000_000_000 + k, f"clock set by +{k}.5 s") for k in range(9))
    assert event_rows(recording)[-1] == ["2023-11-14 22:13:21", "clock set by +0.5 s (9 similar events)"]
