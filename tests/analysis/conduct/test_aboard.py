"""The conductor beside a recorder: what it calls and shows of a recorded day, restarts, marks, page, keys."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from urllib.error import HTTPError

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core import ship
from seatrial.acquisition.core.errors import StorageError, Terminal
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.logger.health import Health, Predictions
from seatrial.acquisition.logger.requests import LOOPBACK, RecorderState, RequestServer
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import parts_by_recording, read_parts_of_recording
from seatrial.analysis.conduct import aboard
from seatrial.analysis.conduct.aboard import ConductedTrial, TerminalView, last_lines, picture_of, served_page
from seatrial.analysis.conduct.conductor import Conductor
from seatrial.analysis.conduct.outlook import OutlookMaker, StoredRun
from seatrial.analysis.conduct.run import Call, RunState, judge_run
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.report.tables import terminal_tables
from seatrial.analysis.tables.table import NANO, read_table
from tests.acquisition.conftest import free_port
from tests.analysis.conduct.outlooks import all_met
from tests.benchmarks.conducted_days import Day
from tests.conftest import nightly

SEED = 0


@pytest.fixture(scope="module")
def day() -> Day:
    """R/V Gunnerus' day with a helmsman who errs, as another conductor has conducted it."""
    return Day("gunnerus", SEED)


class RecorderOfDay:
    """What a conductor sees of a recorder: a growing file and an ear for marks."""

    def __init__(self, day: Day, folder: Path, runtime: Path) -> None:
        self.folder, self.day, self.marks, self.now_ns = folder, day, list[str](), 0
        depth = ship.declared_channels_as_json([ship.declare("depth_below_transducer_m", "m", 0.0, 12_000.0)])
        trial = Trial("bay", vessel=day.vessel.name, antenna_forward_m=0.0, antenna_starboard_m=0.0, channels=depth)
        self.trial, self.row, self.shift_ns, self.boot = trial, 0, 0, "x"
        self.parts = RecordingParts(folder, trial, {}, RecordingSection(), self.clock())
        self.hearing = RequestServer(self.mark, self.state, Predictions(Health({})), runtime)

    def mark(self, text: str, at_ns: int) -> None:
        self.marks.append(text)
        self.parts.write_event(text, self.now_ns, name="mark")

    def state(self) -> RecorderState:
        return RecorderState("bay", "/bay.toml", str(self.parts.path), False, 1, 0, 0)

    def write(self, rows: int) -> bool:
        """Record so many rows more; whether there were any."""
        end = min(self.row + rows, len(self.day.rows))
        for row in range(self.row, end):
            self.now_ns = time_ns = self.day.times_ns[row] + self.shift_ns
            for name, value in self.day.rows[row].items():
                if value == value:
                    self.parts.write_sample(Sample(name, float(value), "x", time_ns, 0, time_ns))
        self.parts.flush()
        more, self.row = end > self.row, end
        return more

    def restart(self) -> None:
        """Another recording, as after a kill."""
        self.parts.close()
        self.parts = RecordingParts(self.folder, self.trial, {}, RecordingSection(), self.clock())

    def clock(self) -> dict[str, str]:
        """What a part states of the computer's clock."""
        return {"utc_minus_monotonic_ns": str(self.shift_ns), "boot": self.boot, "slept_ns": "0"}

    def reboot(self, shift_ns: int, rows: int) -> None:
        """Another recording by another clock, so far ahead of the day's own, some rows later."""
        self.shift_ns, self.boot, self.row = shift_ns, f"{self.boot}x", self.row + rows
        self.restart()

    def set_clock(self, shift_ns: int) -> None:
        """Set the computer's clock, so far ahead of the day's own."""
        self.shift_ns = shift_ns
        self.parts.set_clock(self.clock(), "the computer's clock was set")


@pytest.fixture
def recorder(day: Day, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RecorderOfDay]:
    """No second passes between its news, nor between marks."""
    monkeypatch.setattr("seatrial.acquisition.logger.requests._ASK_PERIOD_S", 0.0)
    monkeypatch.setattr("seatrial.acquisition.logger.requests._ASK_SOON_S", 0.0)
    monkeypatch.setattr("seatrial.acquisition.logger.requests._QUIET_S", 0.0)
    monkeypatch.setattr(aboard, "_MARK_PERIOD_S", 0.0)
    running = RecorderOfDay(day, tmp_path / "out", tmp_path / "run")
    with running.hearing:
        yield running
    running.parts.close()


def conducted(
    recorder: RecorderOfDay,
    path: Path | None = None,
    maker: OutlookMaker | None = None,
    notify: aboard.Notify = lambda level, text: None,
) -> ConductedTrial:
    conductor = Conductor(recorder.day.programme, path)
    return ConductedTrial("bay", Path("/bay.toml"), conductor, notify, recorder.hearing.path.parent, maker)


def sail(trial: ConductedTrial, recorder: RecorderOfDay, until: int = 10**9, rows: int = 8) -> list[Call]:
    """Record and follow up to a row."""
    calls = trial.poll()
    while recorder.row < until and recorder.write(min(rows, until - recorder.row)):
        calls += trial.poll()
    return calls


def poll_at_leisure(trial: ConductedTrial) -> None:
    """Leave the processor to what is waited for."""
    trial.poll()
    time.sleep(0.05)


def test_recorded_day_is_conducted_as_it_was_sailed(recorder: RecorderOfDay, tmp_path: Path) -> None:
    """The same calls, verdicts and indices as without a recorder; the recording's own analysis gives them, too."""
    trial = conducted(recorder)
    recorder.write(1)
    calls = sail(trial, recorder)
    trial.poll()
    before = recorder.day.conductor
    due = [call for run in recorder.day.runs for call in run.calls if call.kind != "ready"]
    assert [call for call in calls if call.kind != "ready"] == due
    assert [(run.name, run.outcome) for run in trial.conductor.sailed] == [
        (run.name, run.outcome) for run in before.sailed
    ]
    trial.close()
    recorder.parts.close()

    (path,) = (tmp_path / "out").glob("*.mcap")
    recording = read_parts_of_recording([path])
    runs = find_manoeuvres(read_table(path), recorder.day.programme.programme.length_m, recording.events)
    shown = [run.manoeuvre for run in trial.conductor.sailed if run.outcome == "valid" and run.manoeuvre]
    assert len(shown) == 7
    for run in shown:
        (ashore,) = [other for other in runs if other.kind == run.kind and other.start == run.start]
        for name, index in run.indices.items():
            other = ashore.indices[name]
            assert index.value == other.value
            # of a stop the other runs of the trial show the current, by which its interval is wider ashore
            assert (index.low, index.high) == (other.low, other.high) or run.kind == "stopping"
    assert [text for text in recorder.marks if text.endswith("over")] == [
        f"run {run.number}: over" for run in trial.conductor.sailed
    ]
    table = st.manoeuvres(path)
    assert [(run.number, run.outcome) for run in table.recorded[0].programme] == [
        (run.number, run.outcome) for run in trial.conductor.sailed
    ]
    counted = table[table["not_counted"] == ""].drop_duplicates("start")
    assert list(counted["kind"]) == [run.kind for run in shown]
    printed = StringIO()
    Terminal(file=printed, width=160).print(terminal_tables(table.recorded[0]))
    case = st.load_case([path], length_m=recorder.day.programme.programme.length_m)
    report = st.sections("trial.html", case=case, remark="", folder=None, links={})("criteria").html
    for text in (printed.getvalue(), report):
        assert "the wind was of force 8, above 5" in text
        assert "does not count" in text or "do not count" in text
    assert [run.manoeuvre.start for run in case.runs if not run.manoeuvre.not_counted] == list(counted["start"])


def sail_over_bank(recorder: RecorderOfDay, monkeypatch: pytest.MonkeyPatch, depths_m: Sequence[float]) -> None:
    """Have a sounder read these depths row by row [m], NaN where it tells none, in a programme for 11 m."""
    rows = [{**row, "depth_below_transducer_m": depth} if np.isfinite(depth) else row
            for row, depth in zip(recorder.day.rows, depths_m, strict=True)]  # fmt: skip
    monkeypatch.setattr(recorder.day, "rows", rows)
    programme = recorder.day.programme
    deep = replace(programme, programme=replace(programme.programme, least_depth_m=11.0))
    monkeypatch.setattr(recorder.day, "programme", deep)


def test_recorded_depth_is_watched(recorder: RecorderOfDay, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sounder's 9 m below the transducer, in a programme for 11 m; the marks say so ashore."""
    sail_over_bank(recorder, monkeypatch, [9.0] * len(recorder.day.rows))
    trial = conducted(recorder)
    recorder.write(1)
    while not trial.conductor.sailed:
        sail(trial, recorder, recorder.row + 8)
    trial.poll()
    trial.close()
    assert trial.conductor.sailed[0].reasons == ("the water was less than 11 m deep: 9.0 m",)
    assert recorder.marks[-1].endswith(": the water was less than 11 m deep: 9.0 m")


@pytest.mark.slow
def test_depth_of_each_run_is_judged_aboard_by_the_value_that_is_found_ashore(
    recorder: RecorderOfDay, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A seabed that comes and goes, a sounder that tells twice a second, later each fifth, and its outliers: a run
    is over a bank where what `seatrial manoeuvres` gives as its least depth is less than the programme's."""
    row = np.arange(len(recorder.day.rows))
    depths_m = 11.5 + 2.0 * np.sin(row / 350.0) - 8.0 * (row % 97 == 0)
    depths_m[(row >= 1500) & (row % 10 != 0)] = np.nan
    sail_over_bank(recorder, monkeypatch, depths_m.tolist())
    trial = conducted(recorder)
    recorder.write(1)
    sail(trial, recorder)
    trial.poll()
    trial.close()
    recorder.parts.close()
    (path,) = recorder.folder.glob("*.mcap")
    events = read_parts_of_recording([path]).events
    length_m = recorder.day.programme.programme.length_m
    ashore = {run.start: run for run in find_manoeuvres(read_table(path), length_m, events)}
    shallow = []
    for entry in trial.conductor.sailed:
        if entry.manoeuvre is not None:
            depth_m = ashore[entry.manoeuvre.start].settings["water_depth_m"]
            assert entry.manoeuvre.settings["water_depth_m"] == depth_m
            shallow.append(depth_m < 11.0)
            assert (f"the water was less than 11 m deep: {depth_m:.1f} m" in entry.reasons) == shallow[-1]
            assert not (shallow[-1] and entry.outcome == "valid")
            assert ashore[entry.manoeuvre.start].not_counted == "" or entry.outcome != "valid"
    assert {True, False} == set(shallow)


@pytest.mark.parametrize("share", [0.3, 0.95, *nightly(0.15, 0.7)])
def test_conductor_that_comes_in_the_middle_of_a_run_waits_for_the_next(
    recorder: RecorderOfDay, share: float
) -> None:
    """Also where what was recorded before shows its order; nothing of it is marked or called."""
    first, second = recorder.day.conductor.sailed[:2]
    times = recorder.day.times_ns
    came = next(row for row, time_ns in enumerate(times)
                if time_ns > first.executed_ns + share * (first.ended_ns - first.executed_ns))  # fmt: skip
    recorder.write(came)
    shown = list[str]()
    trial = conducted(recorder, notify=lambda level, text: shown.append(text))
    calls = sail(trial, recorder, next(row for row, time_ns in enumerate(times) if time_ns > first.ended_ns))
    assert trial.conductor.state.phase == "approach"
    assert not trial.conductor.sailed
    assert not recorder.marks
    assert not calls
    assert sum(aboard._UNLED in text for text in shown) == 1
    trial.key("s")  # nor is it the next one's
    assert picture_of(trial)["say"] == "in a manoeuvre begun before · not judged"
    while trial.conductor.state.phase == "approach":
        sail(trial, recorder, recorder.row + 8)
    assert trial.conductor.state.executed_ns == second.executed_ns
    trial.close()


HOUR_NS, TO_1970_NS = 3600 * NANO, 20 * NANO - pd.Timestamp("2026-06-01T06:00:00Z").value


@pytest.mark.parametrize(
    ("clock_ns", "set_ns"), [(0, -HOUR_NS), (TO_1970_NS, 0), *nightly((0, HOUR_NS), (0, TO_1970_NS))]
)
def test_clock_that_is_set_breaks_the_run_that_is_sailed_and_nothing_else(
    recorder: RecorderOfDay, tmp_path: Path, clock_ns: int, set_ns: int
) -> None:
    """An hour ahead or back, from 1970 or to it: said at once, and the programme goes on. In an approach it costs
    nothing; so it is where the conductor was away."""
    shown, state = list[str](), tmp_path / "state.json"
    notify = lambda level, text: shown.append(text)  # noqa: E731
    recorder.set_clock(clock_ns)
    trial = conducted(recorder, state, notify=notify)
    sail(trial, recorder, 20)
    recorder.set_clock(set_ns)
    while len(trial.conductor.sailed) < 2 or trial.conductor.state.phase != "sailing":
        sail(trial, recorder, recorder.row + 8)
    before = recorder.day.conductor.sailed[:2]
    assert [(run.name, run.outcome) for run in trial.conductor.sailed] == [
        (run.name, run.outcome) for run in before
    ]
    words = "the times of the recording went " + ("ahead" if set_ns > clock_ns else "back")
    assert sum(words in text for text in shown) == 1
    assert 0.0 < trial.newest_ns - trial.conductor.started_ns < HOUR_NS  # so much of the time has passed

    trial.close()
    recorder.set_clock(clock_ns)
    recorder.write(8)
    trial = conducted(recorder, state, notify=notify)
    sail(trial, recorder, recorder.row + 16)
    broken = trial.conductor.sailed[-1]
    assert (broken.number, broken.outcome) == (3, "invalid")
    assert any(words in broken.reasons[0] for words in ("clock was set", "nothing was received"))
    assert (trial.conductor.state.phase, trial.silent_s < 1.0) == ("approach", True)
    assert trial.newest_ns == recorder.now_ns
    trial.close()


BACK, AHEAD = "went back by", "begins 5.0 h after the end"


@pytest.mark.parametrize(
    ("phase", "away", "shift_s", "words"),
    [
        ("sailing", False, -3600.0, BACK), ("sailing", True, -150.0, BACK), ("approach", True, 18_000.0, AHEAD),
        *nightly(
            ("sailing", True, -3600.0, BACK), ("sailing", False, -150.0, BACK), ("sailing", True, 18_000.0, AHEAD),
            ("sailing", False, 18_000.0, AHEAD), ("approach", True, -3600.0, BACK),
            ("approach", False, -3600.0, BACK), ("approach", True, -150.0, BACK), ("approach", False, -150.0, BACK),
            ("approach", False, 18_000.0, AHEAD),
        ),
    ],
)  # fmt: skip
def test_clock_set_while_the_computer_was_restarted_is_named_and_the_programme_goes_on(
    recorder: RecorderOfDay, tmp_path: Path, phase: str, away: bool, shift_s: float, words: str
) -> None:
    """Two minutes later, with another boot's clock; the conductor comes back (``away``) when the new recording has
    run for a while, so that by a clock 150 s behind it has times of the one before as well as later ones."""
    shown, state = list[str](), tmp_path / "state.json"
    notify = lambda level, text: shown.append(text)  # noqa: E731
    trial = conducted(recorder, state, notify=notify)
    sail(trial, recorder, 20)
    while trial.conductor.state.phase != phase:
        sail(trial, recorder, recorder.row + 4)
    sail(trial, recorder, recorder.row + 40)
    assert trial.conductor.state.phase == phase
    if away:
        trial.close()
    recorder.reboot(round(shift_s * NANO), 240)
    recorder.write(160 if away else 2)
    if away:
        trial = conducted(recorder, state, notify=notify)
    sail(trial, recorder, recorder.row + 80)
    assert sum(words in text and text.startswith("the ") for text in shown) == 1, shown
    broken = [run for run in trial.conductor.sailed if any("clock was set" in reason for reason in run.reasons)]
    assert [run.outcome for run in broken] == ["invalid"] * (phase == "sailing")
    while trial.conductor.state.phase != "sailing":
        sail(trial, recorder, recorder.row + 4)
    ordered_ns = trial.conductor.state.executed_ns - recorder.shift_ns
    assert min(abs(ordered_ns - run.executed_ns) for run in recorder.day.conductor.sailed) < 0.1 * NANO
    trial.close()


@pytest.mark.parametrize(
    ("channels", "words"),
    [("heading", "the heading"), ("surge", "the speed"), ("angle", "the helm"), ("rpm", "the helm"),
     ("north", "the position"), ("wind", "the wind")],
)  # fmt: skip
def test_what_is_not_recorded_is_named_and_ends_no_programme(
    recorder: RecorderOfDay, monkeypatch: pytest.MonkeyPatch, channels: str, words: str
) -> None:
    """R/V Gunnerus is steered by thrusters that run. Without a position runs are called, and not judged."""
    rows = [{name: value for name, value in row.items() if channels not in name} for row in recorder.day.rows]
    monkeypatch.setattr(recorder.day, "rows", rows)
    trial = conducted(recorder)
    sail(trial, recorder, 300)
    picture = picture_of(trial)
    assert picture["faults"][0] == f"nothing comes of {words}"
    assert not any("nan" in str(value) for _, value, _ in picture["values"])
    verdicts = [run.reasons[-1] for run in trial.conductor.sailed if run.outcome != "valid"]
    assert set(verdicts) == ({"it cannot be judged: has no north_m"} if channels == "north" else set())
    trial.close()


def test_recording_without_anything_is_no_data_and_obeys_the_keys(
    recorder: RecorderOfDay, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(aboard, "_SILENT_S", -1.0)
    trial = conducted(recorder)
    trial.poll()
    assert str(picture_of(trial)["say"]).startswith("NO DATA")
    for key in "asr":
        trial.key(key)
    trial.poll()
    assert [run.outcome for run in trial.conductor.sailed] == ["aborted", "skipped"]
    assert len(recorder.marks) == 2
    trial.close()


def test_conductor_that_is_killed_in_every_minute_goes_on(recorder: RecorderOfDay, tmp_path: Path) -> None:
    """It reads what it missed of the recording again; nothing of the state is lost, and nothing is called twice."""
    path, calls = tmp_path / "bay.sailed.json", list[Call]()
    recorder.write(1)
    trial = conducted(recorder, path)
    calls += sail(trial, recorder, 40)
    while len(trial.conductor.sailed) < 4:
        trial.close()  # as if killed: nothing is saved here
        recorder.write(11)
        trial = conducted(recorder, path)
        calls += sail(trial, recorder, recorder.row + 109)
    trial.poll()
    trial.close()
    assert [(run.name, run.outcome) for run in trial.conductor.sailed] == [
        (run.name, run.outcome) for run in recorder.day.conductor.sailed[:4]
    ]
    reversals = [call for run in recorder.day.runs[:4] for call in run.calls if call.kind == "reverse"]
    assert len([call for call in calls if call.kind == "reverse"]) == len(reversals) > 0
    assert len(set(recorder.marks)) == len(recorder.marks)  # none is set twice


@pytest.mark.parametrize("seed", [0, *nightly(1)])
def test_restarts_at_any_moment_change_no_verdict(recorder: RecorderOfDay, tmp_path: Path, seed: int) -> None:
    """Of the recorder, of the conductor while the recorder runs on, and of both."""
    chance, state = np.random.default_rng(seed), tmp_path / "state.json"
    trial = conducted(recorder, state)
    while recorder.write(8):
        trial.poll()
        if chance.random() < 0.03:
            which = chance.choice(["recorder", "conductor", "both"])
            trial.close()
            if which != "conductor":
                recorder.restart()
            if which != "recorder":
                recorder.write(int(chance.choice([1, 8, 60])))
            trial = conducted(recorder, state)
    trial.poll()
    trial.close()
    assert [(run.name, run.outcome) for run in trial.conductor.sailed] == [
        (run.name, run.outcome) for run in recorder.day.conductor.sailed
    ]


def test_recording_of_another_ship_is_named(recorder: RecorderOfDay, tmp_path: Path) -> None:
    shown, state = list[str](), tmp_path / "state.json"
    trial = conducted(recorder, state)
    sail(trial, recorder, 20)
    trial.close()
    recorder.trial = replace(recorder.trial, vessel="kvlcc2_7m")
    recorder.restart()
    recorder.write(8)
    trial = conducted(recorder, state, notify=lambda level, text: shown.append(text))
    trial.poll()
    words = f"this recording is of the vessel 'kvlcc2_7m', the one before of {recorder.day.vessel.name!r}"
    assert sum(text.startswith(words) for text in shown) == 1
    trial.close()


def test_run_in_two_recordings_is_judged_by_both_after_a_restart(recorder: RecorderOfDay, tmp_path: Path) -> None:
    """Recorder and conductor were restarted in the middle of it, at once: nothing is lost."""
    trial = conducted(recorder, tmp_path / "state.json")
    while trial.conductor.state.phase != "sailing" or len(trial.conductor.state.orders_ns) < 3:
        sail(trial, recorder, recorder.row + 4)
    trial.close()
    recorder.restart()
    recorder.write(8)
    trial = conducted(recorder, tmp_path / "state.json")
    while not trial.conductor.sailed:
        sail(trial, recorder, recorder.row + 8)
    first, expected = trial.conductor.sailed[0], recorder.day.conductor.sailed[0]
    assert (first.outcome, first.reasons, first.recordings) == (
        expected.outcome, expected.reasons, tuple(map(str, sorted(recorder.folder.glob("*.mcap")))),
    )  # fmt: skip
    assert first.manoeuvre is not None
    assert expected.manoeuvre is not None
    values = [{name: index.value for name, index in run.indices.items()}
              for run in (first.manoeuvre, expected.manoeuvre)]  # fmt: skip
    assert values[0] == pytest.approx(values[1])
    trial.close()


def test_recorder_that_is_killed_costs_the_run_and_nothing_else(recorder: RecorderOfDay) -> None:
    """A run without two minutes of its samples is not valid; a pause of some seconds does no harm."""
    trial = conducted(recorder)
    recorder.write(1)
    while trial.conductor.state.phase != "sailing":
        sail(trial, recorder, recorder.row + 4)
    for lost in (4, 240):
        recorder.restart()
        recorder.row += lost  # which nobody recorded
        sail(trial, recorder, recorder.row + 8)
        sail(trial, recorder, recorder.row + 8)
        assert (trial.conductor.last is None and trial.conductor.state.phase == "sailing") == (lost == 4)
    sail(trial, recorder, recorder.row + 80)
    assert trial.conductor.last is not None
    assert trial.conductor.last.outcome == "invalid"
    trial.close()
    assert len(parts_by_recording(sorted((recorder.folder).glob("*.mcap")))) == 3


def test_outlook_of_the_runs_so_far_is_shown_beside_the_conductor(recorder: RecorderOfDay, tmp_path: Path) -> None:
    state, shown = tmp_path / "state.json", list[str]()
    trial = conducted(recorder, state)
    while len(trial.conductor.sailed) < 3 and sail(trial, recorder, recorder.row + 200) is not None:
        pass
    trial.close()
    trial = conducted(recorder, state, maker=all_met)
    trial.poll()
    while trial.conductor.outlook is None:  # at once, of the runs before the restart
        poll_at_leisure(trial)
    trial.close()
    trial = conducted(recorder, state, maker=all_met, notify=lambda level, text: shown.append(text))
    while trial.conductor.outlook is None and not any("no outlook" in text for text in shown):
        poll_at_leisure(trial)
    assert trial.conductor.outlook is not None, shown
    ordered = sum(run.executed_ns > 0 for run in trial.conductor.sailed)  # those before the restart, too
    assert trial.conductor.outlook.sailed == ordered
    assert any("need not be sailed" in text for text, _ in picture_of(trial)["last"])
    trial.close()


@pytest.mark.slow
def test_outlook_is_by_the_runs_of_all_recordings(recorder: RecorderOfDay, tmp_path: Path) -> None:
    """Recorder and conductor were restarted, the second time in the middle of a run: others are in other files, of
    which one is gone at last."""
    shown, state = list[str](), tmp_path / "state.json"
    for number in (1, 2):
        trial = conducted(recorder, state)
        while len(trial.conductor.sailed) < number or (number == 2 and trial.conductor.state.phase != "sailing"):
            sail(trial, recorder, recorder.row + 8)
        trial.close()
        recorder.restart()
    trial = conducted(recorder, state, all_met, lambda level, text: shown.append(text))
    while len(trial.conductor.sailed) < 3:
        sail(trial, recorder, recorder.row + 100)
    while trial.conductor.outlook is None or trial.conductor.outlook.sailed < 3:
        poll_at_leisure(trial)
    less = "the outlook is by 2 of 3 runs: the recordings of the others cannot be read"
    assert less not in shown
    first, _, third = trial.conductor.sailed
    assert len(third.recordings) == 2
    planned, programme = trial.conductor.programme.run[first.place], trial.conductor.programme
    stored = StoredRun(
        planned, list(map(Path, first.recordings)), trial.conductor.judged_span_of(first), valid=True
    )
    state_of_first = RunState(orders_ns=(first.executed_ns,), ended_ns=first.ended_ns)
    again = judge_run(stored.read().table, state_of_first, planned, programme)
    values = [{name: index.value for name, index in run.indices.items()}
              for run in (again.manoeuvre, first.manoeuvre) if run]  # fmt: skip
    assert values[0] == values[1]
    trial.close()

    min((tmp_path / "out").glob("*.mcap")).unlink()
    trial = conducted(recorder, state, all_met, lambda level, text: shown.append(text))
    while trial.conductor.outlook is None:
        poll_at_leisure(trial)
    assert trial.conductor.outlook.sailed == 2
    assert less in shown
    trial.close()


def test_picture_fits_a_terminal_of_80_by_24(recorder: RecorderOfDay) -> None:
    trial = conducted(recorder)
    recorder.write(1)
    says, typed = set[str](), list[str]()
    view = TerminalView(lambda: picture_of(trial), deque([("warning", "x" * 100)] * 3), typed)
    trial.conductor.take_outlook(all_met([], dict(enumerate(trial.conductor.programme.run))))
    while recorder.row < len(recorder.day.rows):
        sail(trial, recorder, recorder.row + 6)
        picture = picture_of(trial)
        says.add(str(picture["say"]).partition(" ")[0])
        if recorder.row % 60 < 6:
            console = Terminal(record=True, file=StringIO(), width=80, height=24)
            console.print(view)
            lines = console.export_text().splitlines()
            assert len(lines) <= 24
            assert max(map(len, lines)) <= 80
    assert {"approach", "STEADY", "next:", "OVER", "PROGRAMME", "STARBOARD", "PORT", "MIDSHIPS"} <= says
    trial.close()


def test_texts_are_wrapped_where_the_screen_has_room(recorder: RecorderOfDay) -> None:
    """The reason of an invalid run is read to its end, and the keys stay on the screen."""
    why = "the helm was moved when no order was due: to starboard 2; it went to port, not to starboard; the wind"
    picture = {**picture_of(conducted(recorder)), "last": [(why, "bad")] * 3}
    for height, shown in ((24, 3), (13, 0), (12, 0)):
        console = Terminal(record=True, file=StringIO(), width=80, height=height)
        console.print(TerminalView(lambda: picture, deque(), []))
        lines = console.export_text().splitlines()
        assert len(lines) <= max(height, 13)
        assert sum(line.endswith("the wind") for line in lines) == shown
        assert lines[-1].startswith("a abort")


def test_no_data_counts_nothing_down(recorder: RecorderOfDay, monkeypatch: pytest.MonkeyPatch) -> None:
    trial = conducted(recorder)
    recorder.write(1)
    while picture_of(trial)["due_s"] is None:
        sail(trial, recorder, recorder.row + 2)
    monkeypatch.setattr(aboard, "_SILENT_S", -1.0)
    picture = picture_of(trial)
    assert str(picture["say"]).startswith("NO DATA")
    assert picture["due_s"] is None
    trial.close()


def test_trial_has_one_conductor_and_waiting_ends_in_time(tmp_path: Path) -> None:
    """The marks of two could not be told apart ashore; other trials are not concerned."""
    with aboard.only_conductor("bay", tmp_path), aboard.only_conductor("cape", tmp_path):
        second = (
            "import sys; from pathlib import Path; from seatrial.analysis.conduct import aboard; "
            "aboard.only_conductor('bay', Path(sys.argv[1])).__enter__()"
        )
        command = [sys.executable, "-c", second, str(tmp_path)]  # a lock is for other processes
        refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "is conducted already" in refused.stderr
    assert aboard.recorder_to_follow(threading.Event(), lambda level, text: None, tmp_path, 0.0) is None


def test_run_that_is_sailed_is_aborted_by_the_key_pressed_twice(recorder: RecorderOfDay) -> None:
    shown = list[str]()
    trial = conducted(recorder, notify=lambda level, text: shown.append(text))
    recorder.write(1)
    while trial.conductor.state.phase != "sailing":
        sail(trial, recorder, recorder.row + 4)
    for key in "asa":
        trial.key(key)
        assert not trial.conductor.sailed
        assert shown[-1] == f"run 1 is being sailed: press {key} again to {aboard.KEYS[key]} it"
    trial.key("a")
    assert [run.outcome for run in trial.conductor.sailed] == ["aborted"]
    assert aboard.outcome_line(trial.conductor.sailed[0]).endswith(": aborted")
    while trial.conductor.state.phase != "sailing":
        sail(trial, recorder, recorder.row + 4)
    for _ in range(2):
        trial.key("s")
    assert trial.conductor.sailed[-1].outcome == "skipped"
    assert "ordered at" in trial.conductor.marks[-1]
    assert "1970" not in trial.conductor.marks[-1]
    trial.close()


def test_state_that_cannot_be_written_does_not_end_the_run(
    recorder: RecorderOfDay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a full disk: the run is conducted on, and the warning is shown once."""
    shown, path = list[str](), tmp_path / "bay.sailed.json"

    def full(path: Path, text: str) -> None:
        raise StorageError("cannot be written", where=str(path), why="No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("seatrial.analysis.conduct.conductor.write_text", full)
        trial = conducted(recorder, path, notify=lambda level, text: shown.append(text))
        recorder.write(1)
        while not trial.conductor.sailed:
            sail(trial, recorder, recorder.row + 4)
    assert sum("No space left" in text for text in shown) == 1
    trial.conductor.note("disk emptied")
    trial.poll()
    assert shown[-1] == "the state is saved again"
    trial.close()


def test_keys_skip_abort_repeat_and_note(recorder: RecorderOfDay) -> None:
    trial, typed = conducted(recorder), list[str]()
    recorder.write(40)
    trial.poll()
    for key in "ntug alongside\n":
        aboard._handle_key(key, typed, trial)
    for key in "asr":
        aboard._handle_key(key, typed, trial)
    assert [run.outcome for run in trial.conductor.sailed] == ["aborted", "skipped"]
    assert trial.conductor.place == trial.conductor.sailed[-1].place
    trial.poll()
    assert recorder.marks == [
        "run 1: note: tug alongside", "run 1: aborted, zigzag 10/10 to starboard",
        "run 2: skipped, zigzag 10/10 to starboard",
    ]  # fmt: skip
    trial.close()


def test_page_is_read_only_and_for_this_computer() -> None:
    port = free_port(socket.SOCK_STREAM)
    with served_page(LOOPBACK, port, lambda: {"say": "STARBOARD 20"}) as address:
        with urllib.request.urlopen(address) as answer:
            policy = answer.headers["Content-Security-Policy"]
            assert "script-src 'sha256-" in policy
            assert b"<!doctype html>" in answer.read()
        with urllib.request.urlopen(f"{address}state.json") as answer:
            assert json.load(answer) == {"say": "STARBOARD 20"}
        foreign = urllib.request.Request(address, headers={"Host": "ship.example"})
        for request in (urllib.request.Request(address, method="POST", data=b"x"), foreign, f"{address}other"):
            with pytest.raises(HTTPError):
                urllib.request.urlopen(request)


def test_last_lines_name_what_is_missing_to_a_criterion(day: Day) -> None:
    conductor = day.conductor
    entry = next(run for run in conductor.sailed if run.outcome == "valid")
    lines = [text for text, _ in last_lines(replace_last(conductor, entry), day.times_ns[-1])]
    assert any("±" in line for line in lines)
    assert any(line.endswith("min") for line in lines)
    assert pd.Timestamp(entry.executed_ns, unit="ns").year == 2026


def replace_last(conductor: Conductor, entry: object) -> Conductor:
    return replace(conductor, path=None, sailed=[*conductor.sailed[:0], entry])  # type: ignore[list-item]
