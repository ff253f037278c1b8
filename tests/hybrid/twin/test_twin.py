"""The twin step by step beside a recorder of a few lines: missing channels, another recording, what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.logger.health import Health, Predictions
from seatrial.acquisition.logger.requests import RecorderState, RequestServer
from seatrial.acquisition.recording.messages import PREDICTION_TOPIC, Topic, decode
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.hybrid import twin as twin_module
from seatrial.hybrid.calibrators import TrainedCalibrator
from seatrial.hybrid.calibrators.predict import Predictor
from seatrial.hybrid.twin import LARGEST_FACTOR, PlanFile, Twin, region_factor_step, watch
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.twin.steady_ship import ORIGIN, steady_table

HORIZON_S = 3


class Recorder:
    """What a twin sees of a recorder: a growing file and an ear. It writes a steady ship's seconds."""

    def __init__(self, folder: Path, runtime: Path) -> None:
        trial = Trial("bay", "gunnerus_long", origin_latitude_deg=ORIGIN[0], origin_longitude_deg=ORIGIN[1])
        self.parts = RecordingParts(folder, trial, {}, RecordingSection())
        self.predictions = Predictions(Health({}))
        self.hearing = RequestServer(lambda text, at_ns: None, self.who, self.predictions, runtime)
        self.table = steady_table(60.0)

    def who(self) -> RecorderState:
        return RecorderState("bay", "/bay.toml", str(self.parts.path), False, 1, 0, 0)

    def write(self, begin_s: float, end_s: float, without: str = "") -> None:
        seconds = (self.table.index - self.table.index[0]) / pd.Timedelta(seconds=1)
        for time, row in self.table[(seconds > begin_s) & (seconds <= end_s)].iterrows():
            time_ns = pd.Timestamp(str(time)).as_unit("ns").value
            for name, value in row.items():
                if name != without:
                    self.parts.write_sample(Sample(str(name), float(value), "x", time_ns, 0, time_ns))
        self.parts.flush()

    def said(self) -> list[dict[str, Any]]:
        return [decode(Topic(PREDICTION_TOPIC), each.data) for each in self.predictions.take()]


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    running = Recorder(tmp_path / "out", tmp_path / "run")
    with running.hearing:
        yield running


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def twin(tmp_path: Path, plant: Plant, told: list[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Twin]:
    """One that does not wait between predictions, nor before it says what is missing."""
    monkeypatch.setattr(twin_module, "_LEAST_APART_S", 0.0)
    monkeypatch.setattr(twin_module, "_STALLED_S", -1.0)
    model = Predictor("gunnerus_short", plant, HORIZON_S)
    watching = Twin("bay", Path("/bay.toml"), model, lambda level, text: told.append(text), tmp_path / "run")
    yield watching
    watching.close()


def test_it_says_where_the_ship_will_be_and_how_far_off_it_was(recorder: Recorder, twin: Twin) -> None:
    said: list[dict[str, Any]] = []
    for second in range(16):
        recorder.write(second - 0.65, second + 0.35)
        recorder.predictions._allowed = 4.0  # as if a second had passed
        assert twin.poll()
        said += recorder.said()
    starts = [body["start"] for body in said]
    assert starts == [starts[0] + number for number in range(len(starts))]
    assert len(said) >= 15
    judged = [body for body in said if "error" in body]
    assert [body["error"]["start"] for body in judged] == [body["start"] - HORIZON_S - 3 for body in judged]
    assert twin.statistics.recorded == len(said)
    assert twin.statistics.errors.left_out == 0
    assert twin.statistics.errors.predictions == len(judged) >= 8


def test_a_plan_is_followed_and_read_again_when_it_changes(
    recorder: Recorder, plant: Plant, told: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file yet, a plan, a spoilt one, another, none any more."""
    monkeypatch.setattr(twin_module, "_LEAST_APART_S", 0.0)
    path = tmp_path / "plan.csv"
    plan = PlanFile(path, plant.layout, lambda level, text: told.append(text))
    model = Predictor("gunnerus_short", plant, 10)
    watching = Twin("bay", Path("/bay.toml"), model, lambda level, text: None, tmp_path / "run", plan)
    over, out = (recorder.table.index[0] + pd.Timedelta(seconds=each) for each in (5.0, 300.0))
    texts = [
        None, f"time,port_angle_deg\n{over.isoformat()},20\n{out.isoformat()},0\n", "time,port_angle_deg\n",
        "second,starboard_rpm\n2,0\n", None,
    ]  # fmt: skip
    planned, said = [], list[dict[str, Any]]()
    for second, text in enumerate(texts, 8):
        path.unlink(missing_ok=True) if text is None else path.write_text(text)
        recorder.write(0.0 if second == 8 else second - 0.65, second + 0.35)
        recorder.predictions._allowed = 4.0
        assert watching.poll()
        assert watching.last is not None
        planned.append({name: each.tolist() for name, each in watching.last.prediction.planned.items()})
        said += recorder.said()
    port = {"port_angle_deg": pytest.approx([20.0] * 10)}
    starboard = {"starboard_rpm": pytest.approx([140.0] * 2 + [0.0] * 8)}
    assert planned == [{}, port, port, starboard, {}]
    assert [body.get("planned_channels", []) for body in said] == [list(each) for each in planned]
    assert [text.partition(" ")[0] for text in told] == ["no", "plan", "no", "plan", "no"]
    assert "the plan before goes on" in told[2]
    watching.close()


def test_a_calibrator_of_held_controls_watches_no_plan(small: TrainedCalibrator) -> None:
    unused: Any = None
    with pytest.raises(InputError, match=r"held controls.*--commands"):
        watch(unused, Predictor("x", small.plant, HORIZON_S, small), unused, commands=Path("plan.csv"))


def test_regions_that_the_ship_left_are_wider_from_then_on(
    recorder: Recorder, small: TrainedCalibrator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regions a thousandth as wide as they were: they grow as the errors come in, by what these say."""
    monkeypatch.setattr(twin_module, "_LEAST_APART_S", 0.0)
    fallback = replace(small.fallback, region=1e-3 * small.fallback.region)
    narrow = replace(small, region_m=1e-3 * small.region_m, fallback=fallback)
    model = Predictor("gunnerus_short", small.plant, HORIZON_S, narrow)
    watching = Twin("bay", Path("/bay.toml"), model, lambda level, text: None, tmp_path / "run")
    said = list[dict[str, Any]]()
    for second in range(8, 26):
        recorder.write(0.0 if second == 8 else second - 0.65, second + 0.35)
        recorder.predictions._allowed = 4.0
        assert watching.poll()
        said += recorder.said()
        assert watching.last is not None
        band_m = watching.last.prediction.band_m
        assert said[-1]["track"]["band_m"] == pytest.approx(band_m, abs=1e-3)
    factors = [body["band_factor"] for body in said]
    inside = [body["error"]["inside_band"] for body in said if "error" in body]
    first = len(factors) - len(inside) + 1  # that knows of two judged ones and the time between
    assert set(factors[:first]) == {1.0}
    assert factors[-1] > 1.2
    learned = np.arange(1, len(inside)) / HORIZON_S
    raised = np.array([region_factor_step(each) for each in learned]) / HORIZON_S * (0.95 - np.array(inside[1:]))
    expected = accumulate(raised, lambda log, more: min(log + more, np.log(LARGEST_FACTOR)))
    assert np.log(factors[first:]) == pytest.approx(list(expected), abs=2e-4)
    watching.close()


@pytest.mark.parametrize("name", ["tunnel_rpm", "north_m"])
def test_a_channel_that_is_missing_is_named_and_it_goes_on_when_it_comes(
    recorder: Recorder, twin: Twin, told: list[str], name: str
) -> None:
    for second in range(3):
        recorder.write(second, second + 1.0, without=name)
        assert not twin.poll()
    assert any(text.startswith("no prediction: ") and name in text for text in told)
    recorder.write(3.0, 5.3)
    assert twin.poll()
    assert len(recorder.said()) == 1
    assert told[-1] == "predicting"


def test_another_recording_forgets_what_was_foretold_of_the_first(
    recorder: Recorder, twin: Twin, tmp_path: Path
) -> None:
    recorder.write(0.0, 5.3)
    assert twin.poll()
    other = Recorder(tmp_path / "other", tmp_path / "run")
    recorder.hearing.__exit__()
    with other.hearing:
        twin.follower._heard_s = twin.follower._asked_s = 0.0  # as if it had been quiet
        other.write(20.0, 25.3)
        assert twin.poll()
        assert twin.errors.unmeasured == 1
        assert len(other.said()) == 1
    recorder.hearing.__enter__()


def test_what_the_recorder_refuses_is_told_and_it_goes_on(recorder: Recorder, twin: Twin, told: list[str]) -> None:
    recorder.predictions._allowed = 0.0
    recorder.write(0.0, 5.3)
    assert twin.poll()
    assert told[-1] == "not recorded: more than 2 predictions a second"
    recorder.predictions._allowed = 4.0
    recorder.write(5.3, 6.3)
    assert twin.poll()
    assert told[-1] == "predicting"
    assert (twin.statistics.made, twin.statistics.recorded) == (2, 1)
