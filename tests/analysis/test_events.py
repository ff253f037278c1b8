"""The event log: marks, alarms and sources' events in Python, in files, in `info`, and on axes of time."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import seatrial as st
from seatrial import app
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording.reader import Event, event_counts_text
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.analysis.report.plots import channels_figure
from tests.analysis.conftest import steady_table

START_NS = pd.Timestamp("2026-06-01T08:00:00Z").value
SECOND = 1_000_000_000
LOG = [
    ("recording started", "info", "seatrial", "recorder", ""),
    ("zigzag 20/20 start", "info", "mark", "mark", ""),
    ("ALARM deep: depth_m is 3.1", "error", "alarm", "alarm", ""),
    ("source 'gps' is back after 12.0 s", "warning", "seatrial", "source", "gps"),
    ("gps/GP:RMC: its clock is 3 s behind", "warning", "seatrial", "source", "gps"),
    ("gypsy: nothing of ours", "info", "seatrial", "recorder", ""),
]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "log.mcap"
    with RecordingWriter(path, Trial("trial", "ship")) as writer:
        for second in range(60):
            now = START_NS + second * SECOND
            writer.write_sample(Sample("heading_deg", second % 360.0, "gps/GP:HDT", now, now, now))
        for number, (text, level, name, _, _) in enumerate(LOG):
            writer.write_event(text, START_NS + (10 + number) * SECOND, level, name)
    return path


def test_events_have_kind_level_and_source(recording: Path) -> None:
    table = st.events(recording)
    assert table.index.name == "time"
    assert str(table.index.tz) == "UTC"
    assert table["text"].tolist() == [text for text, *_ in LOG]
    assert table["kind"].tolist() == [kind for *_, kind, _ in LOG]
    assert table["source"].tolist() == [source for *_, source in LOG]
    assert table["level"].tolist() == [level for _, level, *_ in LOG]
    assert table.index[1] == pd.Timestamp(START_NS + 11 * SECOND, unit="ns", tz="UTC")


def test_a_recording_without_events_has_an_empty_table(tmp_path: Path) -> None:
    path = tmp_path / "quiet.mcap"
    with RecordingWriter(path, Trial("trial", "ship")) as writer:
        writer.write_sample(Sample("heading_deg", 1.0, "a/b:c", START_NS, START_NS, START_NS))
    assert st.events(path).empty
    assert list(st.events(path)) == ["kind", "level", "source", "text"]


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".xlsx"])
def test_exported_events_come_back(recording: Path, tmp_path: Path, ending: str) -> None:
    output = tmp_path / f"events{ending}"
    result = CliRunner().invoke(app, ["export", str(recording), "--events", "-o", str(output)])
    assert result.exit_code == 0, result.output
    if ending == ".xlsx":
        read = pd.read_excel(output, engine="openpyxl")
    else:
        read = pd.read_csv(output) if ending == ".csv" else pd.read_parquet(output)
    assert read["text"].tolist() == [text for text, *_ in LOG]


def test_events_are_exported_alone(recording: Path, tmp_path: Path) -> None:
    for options in (["--rate", "1"], ["--flags"]):
        output = str(tmp_path / "events.csv")
        assert (
            CliRunner().invoke(app, ["export", str(recording), "--events", *options, "-o", output]).exit_code == 2
        )


def test_info_and_check_tell_of_events(recording: Path) -> None:
    told = CliRunner().invoke(app, ["info", str(recording)]).output
    assert "1 mark, 1 alarm, 2 events of sources, 2 events of the recorder" in told
    assert "mark: zigzag 20/20 start" in told
    for command in ("info", "check"):
        found = json.loads(CliRunner().invoke(app, [command, str(recording), "--json"]).stdout)
        assert [event["text"] for event in found["events"]] == [text for text, *_ in LOG]
    assert st.info(recording)["events"] == found["events"]


def test_marks_stand_on_the_axes_of_time() -> None:
    table = steady_table(600).assign(surge_mps=3.0)
    at = table.index[100]
    marks = [
        Event(at.value, "mark", "info", "", "zigzag"),
        Event(at.value - 10**13, "mark", "info", "", "long ago"),
    ]
    drawing = channels_figure(table, marks=marks)
    assert drawing is not None
    figure = Figure()
    drawing[0](figure)
    assert [text.get_text().strip() for text in figure.axes[0].texts] == ["zigzag"]
    assert event_counts_text(marks) == "2 marks"
