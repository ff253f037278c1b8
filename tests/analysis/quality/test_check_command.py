"""`seatrial check` as people and programs call it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.report.pages import binned_flags
from seatrial.analysis.tables.export import read_parquet
from seatrial.hybrid.simulation.trial import simulate_trial

RUN = CliRunner()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trial with a gap in all channels, spikes in the position and an overflow in the wind."""
    table = simulate_trial("gunnerus_short", "gentle", "voyage", 300.0, 4.0, seed=2)[0]
    table.iloc[[200, 500], table.columns.get_loc("north_m")] += 20.0
    table.iloc[700, table.columns.get_loc("wind_speed_mps")] = 655.35
    path = tmp_path_factory.mktemp("check") / "trial.mcap"
    write_table(table.drop(table.index[800:900]), path, Trial(name="a [b] trial"))
    return path


def test_json_is_one_object_with_what_was_put_in(recording: Path) -> None:
    run = RUN.invoke(app, ["check", str(recording), "--json"])
    assert run.exit_code == 0
    found = json.loads(run.stdout)
    assert {each["code"] for each in found["findings"]} == {"gap", "spike", "out_of_range"}
    assert found["channels"]["north_m"]["spikes"] == 2
    assert found["channels"]["wind_speed_mps"]["out_of_range"] == 1
    assert [each["seconds"] for each in found["channels"]["heading_deg"]["gaps"]] == [25.25]


def test_people_get_a_line_a_channel_and_the_findings_in_words(recording: Path) -> None:
    run = RUN.invoke(app, ["check", str(recording)])
    assert run.exit_code == 0
    assert "north_m" in run.stdout
    assert "suspect" in run.stdout
    assert "25.2" in run.stdout
    assert ".." not in run.stdout


def test_a_folder_gets_json_flags_and_a_page(recording: Path, tmp_path: Path) -> None:
    run = RUN.invoke(app, ["check", str(recording), "-o", str(tmp_path / "quality"), "--json"])
    assert run.exit_code == 0
    folder = tmp_path / "quality"
    written = json.loads((folder / "quality.json").read_text())
    assert written.pop("provenance")["recording_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert written == json.loads(run.stdout)
    flags, metadata = read_parquet(folder / "flags.parquet")
    assert flags.shape == (1100, 13)
    assert {str(each) for each in flags.dtypes} == {"uint8"}
    assert {each["code"] for each in json.loads(metadata["findings"])} == {"gap", "spike", "out_of_range"}
    page = (folder / "quality.html").read_text(encoding="utf-8")
    assert "a [b] trial" in page
    assert "http" not in page.split("<img")[0]


def test_a_repaired_recording_is_sound_and_the_original_stays(recording: Path, tmp_path: Path) -> None:
    before = recording.read_bytes()
    target = tmp_path / "repaired.mcap"
    assert RUN.invoke(app, ["check", str(recording), "--repair", str(target)]).exit_code == 0
    assert recording.read_bytes() == before
    codes = {
        each["code"] for each in json.loads(RUN.invoke(app, ["check", str(target), "--json"]).stdout)["findings"]
    }
    assert codes == {"gap"}


def test_what_is_no_recording_is_said_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("no recording")
    run = RUN.invoke(app, ["check", str(tmp_path / "text.mcap")])
    assert run.exit_code == 1


def test_flags_are_binned_by_the_gravest_and_gaps_stay_open() -> None:
    stamps = np.concatenate([np.arange(100), np.arange(200, 300)])
    flags = np.ones(200, dtype=np.uint8)
    flags[50] = 4
    bins = binned_flags(stamps.astype(np.int64), flags, np.linspace(0, 300, 31))
    assert bins[5] == 4
    assert (bins[[0, 4, 6, 9, 20, 29]] == 1).all()
    assert (bins[12:20] == 0).all()


def test_sparse_channels_are_drawn_without_holes() -> None:
    stamps = np.arange(0, 1000, 50)
    bins = binned_flags(stamps.astype(np.int64), np.ones(stamps.size, np.uint8), np.linspace(0, 1000, 101))
    assert bins[:90].min() == 1
    assert pd.Series(bins).nunique() <= 2


def test_a_copy_without_repairs_says_which_values_it_lacks(tmp_path: Path) -> None:
    """Those that the recording calls bad itself are in no table, and so not in the copy."""
    table = simulate_trial("gunnerus_short", "gentle", "voyage", 300.0, 4.0, seed=2)[0]
    qualities = {"north_m": np.where(np.arange(len(table)) % 100 == 50, Quality.BAD, Quality.GOOD).astype(np.uint8)}
    for name, flags in (("sound", {}), ("doubted", qualities)):
        write_table(table, tmp_path / f"{name}.mcap", Trial(), qualities=flags)
        said = ["check", str(tmp_path / f"{name}.mcap"), "--repair", str(tmp_path / f"{name}_copy.mcap")]
        told = RUN.invoke(app, said).stderr
        assert "nothing to repair" in told
        assert ("without 12 values" in told) == (name == "doubted")
