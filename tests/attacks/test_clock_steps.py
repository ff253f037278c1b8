"""A computer's clock that is set while it records: no season refuses the recording, and no time is guessed."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import NANO, Sample, Trial
from seatrial.acquisition.logger.maintenance import Timescale, clock_metadata
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import (
    NEW_PART_NS,
    parts_by_recording,
    read_as_one_recording,
    read_parts_of_recording,
)
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.analysis.batch import MARKS, BatchJob, process_job, recordings_below
from seatrial.analysis.tables.table import times_ns
from tests.analysis.small_batch import QUICK, sailed
from tests.attacks.test_seasons import batch_here
from tests.conftest import Command

TRUE_NS = int(datetime(2026, 11, 28, 8, tzinfo=UTC).timestamp()) * NANO
"""UTC at the beginning of the recording."""
BEGAN_NS = 1_000 * NANO
"""The monotonic clock at that moment."""
DAYS_NS = 86_400 * NANO
NAMES = [
    "trial_19700101T000020Z.mcap",
    "trial_19700101T000020Z_part00002.mcap",
    "trial_19700101T000020Z_part00003.mcap",
]


@dataclass(frozen=True)
class Step:
    """A part of a recording: its rows, how far its computer's clock is off UTC, and what it states of the clock."""

    first: int
    end: int
    off_ns: int = 0
    boot: str | None = "boot"
    slept_ns: int = 0
    host_clock: str = "free-running"
    stated: bool = True

    def clock(self) -> dict[str, str]:
        offset_ns = TRUE_NS + self.off_ns - BEGAN_NS + self.slept_ns
        texts = {"host_clock": self.host_clock, "utc_minus_monotonic_ns": str(offset_ns)}
        asleep = {} if self.boot is None else {"boot": self.boot, "slept_ns": str(self.slept_ns)}
        return {**texts, **asleep} if self.stated else {}


def write(folder: Path, steps: Sequence[Step], names: Sequence[str] = NAMES, by_satellite: str = "") -> list[Path]:
    """A recording in parts, as the recorder writes them; ``by_satellite`` is a channel stamped by another clock."""
    table = sailed(120)
    seconds = (times_ns(table) - times_ns(table)[0]).tolist()
    paths = [folder / name for name in names[: len(steps)]]
    for number, (step, path) in enumerate(zip(steps, paths, strict=True), start=1):
        with RecordingWriter(path, Trial(name="trial", vessel="gunnerus_short")) as writer:
            follows = "" if number == 1 else paths[number - 2].name
            reason = "recording started" if number == 1 else "the computer's clock was set"
            writer.write_metadata("part", {"number": str(number), "follows": follows, "reason": reason})
            writer.write_metadata("clock", step.clock())
            for row in range(step.first, step.end):
                true_ns, monotonic_ns = TRUE_NS + seconds[row], BEGAN_NS + seconds[row] - step.slept_ns
                for name, value in table.iloc[row].items():
                    received_ns = true_ns + step.off_ns
                    measured_ns = true_ns if name == by_satellite else received_ns
                    writer.write_sample(Sample(str(name), value, "x", received_ns, monotonic_ns, measured_ns))
            writer.write_event("mark", TRUE_NS + seconds[step.end - 1] + step.off_ns)
    return paths


EARLY = -20_784 * DAYS_NS
MAPPED = {
    "begun in 1970": [Step(0, 60, EARLY), Step(60, 240)],
    "begun a year ahead": [Step(0, 60, 365 * DAYS_NS), Step(60, 240)],
    "set twice": [Step(0, 60, EARLY), Step(60, 100, 3600 * NANO), Step(100, 240)],
    "set wrongly, then kept": [Step(0, 60, -2 * NANO), Step(60, 240, 0, host_clock="kept by NTP or PTP")],
    "kept, then set wrongly": [Step(0, 60, 0, host_clock="kept by NTP or PTP"), Step(60, 240, 7200 * NANO)],
    "set back by two seconds": [Step(0, 60, 2 * NANO), Step(60, 240)],
    "slept for an hour": [Step(0, 60), Step(60, 240, slept_ns=3600 * NANO)],
    "slept and set": [Step(0, 60, EARLY), Step(60, 240, slept_ns=3600 * NANO)],
    "not set at all": [Step(0, 60), Step(60, 240)],
    "old parts, not set": [Step(0, 60, boot=None), Step(60, 240, boot=None)],
    "no word of a clock": [Step(0, 60, stated=False), Step(60, 240, stated=False)],
}
SPLIT = {
    "old, without a boot": [Step(0, 60, EARLY, boot=None), Step(60, 240, boot=None)],
    "another boot": [Step(0, 60, EARLY, boot="a"), Step(60, 240, boot="b")],
    "an empty boot": [Step(0, 60, EARLY, boot=""), Step(60, 240, boot="")],
    "old, set back": [Step(0, 60, 3600 * NANO, boot=None), Step(60, 240, boot=None)],
}


@pytest.mark.parametrize("steps", MAPPED.values(), ids=MAPPED.keys())
def test_times_are_moved_onto_one_clock_where_that_is_sure(steps: list[Step], tmp_path: Path) -> None:
    paths = write(tmp_path, steps)
    assert parts_by_recording(paths) == [tuple(paths)]
    recording = read_as_one_recording(paths)
    table = st.read(paths)
    assert (times_ns(table) - TRUE_NS == times_ns(sailed(120)) - times_ns(sailed(120))[0]).all()
    assert table["heading_deg"].to_numpy() == pytest.approx(sailed(120)["heading_deg"].to_numpy())
    assert all(0 <= time_ns - TRUE_NS < 120 * NANO for time_ns, _ in recording.events)
    assert recording.end_ns - recording.start_ns < 120 * NANO
    was_set = len({step.off_ns for step in steps}) > 1
    assert ("clock was set" in recording.clock) == was_set


@pytest.mark.parametrize("steps", SPLIT.values(), ids=SPLIT.keys())
def test_parts_are_recordings_of_their_own_where_it_is_not(
    steps: list[Step], tmp_path: Path, command: Command
) -> None:
    paths = write(tmp_path, steps)
    assert parts_by_recording(paths) == [(path,) for path in paths]
    with pytest.raises(InputError, match="not the parts of one recording"):
        st.read(paths)
    assert "not the parts of one recording" in command("info", *paths).err
    assert (
        "follows trial_19700101T000020Z.mcap: the computer's clock was set"
        in read_parts_of_recording(paths[1:]).clock
    )
    for path, step in zip(paths, steps, strict=True):
        (tmp_path / MARKS).mkdir(exist_ok=True)
        assert process_job(BatchJob(path.stem, str(path), str(tmp_path), QUICK))["status"] == "done"
        assert times_ns(st.read(path))[0] == TRUE_NS + step.off_ns + step.first * NANO // 2


def test_batch_page_info_check_and_export_agree(tmp_path: Path, command: Command) -> None:
    paths = write(tmp_path / "season", MAPPED["begun in 1970"])
    summary = batch_here(tmp_path / "season", tmp_path / "out")
    (row,) = summary.rows
    assert (row["status"], row["start"][:19], row["duration_s"]) == ("done", "2026-11-28T08:00:00", 119.0)
    remark = "the computer's clock was set meanwhile: times are moved, of 1 of its 2 parts by +1,795,737,600.000 s"
    assert remark in row["cause"]
    assert "clock was set meanwhile" in (tmp_path / "out" / row["name"] / "page.html").read_text()
    assert "clock was set meanwhile" in summary.index.read_text()
    said = command("info", *paths, "--json").json
    assert (said["start"][:19], remark in said["clock"]) == ("2026-11-28T08:00:00", True)
    assert remark in command("info", *paths).out
    checked = command("check", *paths, "--json")
    assert (checked.code, remark in checked.err) == (0, True)
    assert "span" not in checked.out
    assert command("export", *reversed(paths), "-o", tmp_path / "trial.csv").code == 0
    exported = pd.read_csv(tmp_path / "trial.csv")
    assert (len(exported), exported["time"].iloc[0][:19]) == (240, "2026-11-28T08:00:00")
    found = command("windows", *paths, "-o", tmp_path / "windows.parquet", "--json").json
    assert found["candidates"] == st.windows(paths).candidates == row["windows_candidates"]


@pytest.mark.parametrize("name", ["heading_deg", "north_m"])
def test_time_of_a_satellite_is_not_moved(name: str, tmp_path: Path) -> None:
    paths = write(tmp_path, MAPPED["begun in 1970"], by_satellite=name)
    series = read_parts_of_recording(paths).series
    for channel in (name, "surge_mps"):
        assert (series[channel].measured_ns == TRUE_NS + np.arange(240) * NANO // 2).all()
        assert (series[channel].received_ns == series[channel].measured_ns).all()


def test_parts_may_be_given_in_any_order(tmp_path: Path) -> None:
    paths = write(tmp_path, MAPPED["set twice"])
    for order in permutations(paths):
        assert read_as_one_recording(order).paths == tuple(paths)
        assert [set(parts) for parts in parts_by_recording(order)] == [set(paths)]


def test_parts_are_together_by_what_they_say_whatever_their_names(tmp_path: Path) -> None:
    names = ["b_19700101T000020Z.mcap", "a_20261128T080030Z.mcap", "c_20261128T080050Z_2.mcap"]
    paths = write(tmp_path, MAPPED["set twice"], names)
    (tmp_path / "none_20261128T080000Z.mcap").touch()
    found = recordings_below(tmp_path, tmp_path / "out")
    assert found == [tuple(paths), (tmp_path / "none_20261128T080000Z.mcap",)]


def with_part(path: Path, follows: str, number: str = "2", clock: Mapping[str, str] | None = None) -> Path:
    """A small part that says what it follows."""
    with RecordingWriter(path, Trial(name="trial")) as writer:
        writer.write_metadata("part", {"number": number, "follows": follows, "reason": "the part is full"})
        writer.write_metadata("clock", dict(clock or {}))
        writer.write_sample(Sample("heading_deg", 1.0, "x", TRUE_NS, 0, TRUE_NS))
    return path


A, B = "a_20260101T000000Z.mcap", "b_20260101T000000Z.mcap"


@pytest.mark.parametrize("follows", [
    (A, A), (B, A), ("", f"../{A}"), ("", "/etc/passwd"), ("", "\x00"), ("", "\n"), ("", "x" * 9999), ("no", "no"),
], ids=["itself", "circle", "another folder", "root", "null", "line feed", "long", "missing"])  # fmt: skip
def test_no_part_is_lost_whatever_it_says_it_follows(follows: tuple[str, str], tmp_path: Path) -> None:
    paths = [with_part(tmp_path / name, text) for name, text in zip((A, B), follows, strict=True)]
    recordings = parts_by_recording(paths)
    assert sorted(path for parts in recordings for path in parts) == paths


def test_two_that_say_they_follow_one_are_not_both_its_continuation(tmp_path: Path) -> None:
    """As a copy that was recovered says what its original says: no sample counts twice."""
    paths = [
        with_part(tmp_path / "a_20260101T000000Z.mcap", ""),
        with_part(tmp_path / "a_20260101T000000Z_part00002.mcap", "a_20260101T000000Z.mcap"),
        with_part(tmp_path / "a_20260101T000000Z_part00002_recovered.mcap", "a_20260101T000000Z.mcap"),
    ]
    assert parts_by_recording(paths) == [tuple(paths[:2]), (paths[2],)]


@pytest.mark.parametrize("offset", [
    "soon", "9" * 30, "-" + "9" * 18, "9" * 5000, "1e9",
], ids=["no number", "too large", "before 1970", "without end", "no integer"])  # fmt: skip
@pytest.mark.parametrize("sure", [{}, {"boot": "boot", "slept_ns": "0"}, {"boot": "boot", "slept_ns": "9" * 40}],
                         ids=["old", "sure", "slept for ever"])  # fmt: skip
def test_malformed_clock_is_no_traceback(offset: str, sure: dict[str, str], tmp_path: Path) -> None:
    stated = {"utc_minus_monotonic_ns": offset}
    sound = {"utc_minus_monotonic_ns": "0", "boot": "boot", "slept_ns": "0"}
    with_part(tmp_path / "a_20260101T000000Z.mcap", "", "1", sound)
    with_part(tmp_path / "a_20260101T000000Z_part00002.mcap", "a_20260101T000000Z.mcap", "2", {**sure, **stated})
    (tmp_path / MARKS).mkdir()
    for number, (first, *later) in enumerate(recordings_below(tmp_path, tmp_path / "out")):
        row = process_job(BatchJob(f"{number}", str(first), str(tmp_path), QUICK, later=tuple(map(str, later))))
        assert "unexpectedly" not in row["cause"]


@pytest.mark.parametrize("step_s", [20_784 * 86_400, 3600, -3600, -2])
def test_parts_of_a_recorder_whose_clock_is_set_are_one_recording(step_s: int, tmp_path: Path) -> None:
    monotonic_ns = time.monotonic_ns()
    scale = Timescale(TRUE_NS - step_s * NANO, monotonic_ns)
    parts = RecordingParts(tmp_path, Trial(name="trial"), {}, RecordingSection(), clock_metadata(scale))
    for second in range(10):
        now_ns = monotonic_ns + second * NANO
        if second == 5:
            scale.follow_wall_clock(TRUE_NS + second * NANO, now_ns)
            scale.adopt_wall_clock()
            parts.set_clock(clock_metadata(scale), "the computer's clock was set")
        utc_ns = scale.utc_ns(now_ns)
        parts.write_sample(Sample("heading_deg", float(second), "x", utc_ns, now_ns, utc_ns))
    parts.close()
    (files,) = recordings_below(tmp_path, tmp_path / "out")
    assert len(files) == 2
    assert times_ns(st.read(files)).tolist() == [TRUE_NS + second * NANO for second in range(10)]


def test_recorder_states_what_relates_its_parts() -> None:
    scale = Timescale(TRUE_NS, BEGAN_NS)
    texts = clock_metadata(scale)
    assert texts["utc_minus_monotonic_ns"] == str(TRUE_NS - BEGAN_NS)
    if Path("/proc/sys/kernel/random/boot_id").exists():
        assert len(texts["boot"]) == 36
        assert int(texts["slept_ns"]) >= 0
    assert json.loads(json.dumps(texts)) == texts
    assert NEW_PART_NS == NANO
