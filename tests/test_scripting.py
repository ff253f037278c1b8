"""``import seatrial as st``: costs nothing, gives what its page says, and agrees with the command line."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

import seatrial as st
from tests.conftest import Simulated


def test_importing_loads_nothing_heavy() -> None:
    heavy = ("numpy", "pandas", "torch", "typer", "numba")
    script = f"import sys, seatrial; print([each for each in {heavy} if each in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [each for each in st.__all__ if each != "main"])
def test_every_name_is_a_documented_function(name: str) -> None:
    assert name in dir(st)
    value = getattr(st, name)
    assert callable(value)
    assert value.__doc__


def test_another_name_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="no attribute 'frobnicate'"):
        st.frobnicate  # noqa: B018


def test_a_table_goes_into_a_recording_and_comes_back(tmp_path: Path) -> None:
    table = st.simulate(tmp_path / "trial.mcap", duration_s=120.0, rate_hz=2.0, seed=3)
    again = st.read(st.write(table, tmp_path / "again.mcap", vessel="gunnerus_short"))
    pd.testing.assert_frame_equal(again[table.columns], table, check_freq=False, check_names=False)
    assert st.info(tmp_path / "again.mcap")["trial"]["vessel"] == "gunnerus_short"


def test_a_table_of_a_ship_with_a_rudder_goes_into_a_recording_too(tmp_path: Path) -> None:
    index = pd.date_range("2026-05-17", periods=60, freq="1s", tz="UTC", name="time", unit="ns")
    columns = ("north_m", "heading_deg", "propeller_rpm", "rudder_angle_deg")
    table = pd.DataFrame({name: float(place) for place, name in enumerate(columns)}, index=index)
    again = st.read(st.write(table, tmp_path / "again.mcap"))
    pd.testing.assert_frame_equal(again[[*columns]], table, check_freq=False, check_names=False)


def test_a_script_from_recording_to_prediction(small_folder: Path, unseen: Path) -> None:
    assert st.check(unseen).as_dict()["channels"]
    one_hz = st.prepare(unseen, rate_hz=1.0)
    assert len(st.windows(one_hz, horizon_s=30).rows) == len(st.windows(unseen, horizon_s=30).rows)
    calibrator = st.load_calibrator(small_folder)
    prediction = st.predict(unseen, at="+600", calibrator=calibrator)
    assert len(prediction.track) == calibrator.horizon_s + 1
    assert st.plot(one_hz).axes


def test_results_print_and_plot(small_folder: Path, unseen: Path) -> None:
    """What a script prints of a result is what the command shows of it, and each draws itself."""
    calibrator = st.load_calibrator(small_folder)
    results = {
        "channel": st.check(unseen),
        "windows of 30 s held": st.windows(unseen, horizon_s=30),
        "windows of legs kept out": calibrator,
        "at end m": st.validate(unseen, calibrator),
        "heading deg": st.predict(unseen, at="+600", calibrator=calibrator),
    }
    for words, result in results.items():
        assert words in str(result)
        assert any(axes.has_data() for axes in result.plot().axes)


def test_a_script_and_the_command_agree(small_folder: Path, unseen: Path) -> None:
    arguments = ["validate", str(unseen), "--calibrator", str(small_folder), "--json"]
    told = CliRunner().invoke(st.app, arguments, catch_exceptions=False)
    assert json.loads(told.stdout) == json.loads(json.dumps(st.validate(unseen, small_folder).as_dict()))


def test_manoeuvres_and_effects_are_tables(tmp_path: Path) -> None:
    st.simulate(tmp_path / "circle.mcap", manoeuvre="turning_circle_30", duration_s=400.0, rate_hz=1.0)
    indices = st.manoeuvres(tmp_path / "circle.mcap", length_m=28.9)
    advance = indices[indices["index"] == "advance_m"].iloc[0]
    assert advance["low"] <= advance["value"] <= advance["high"]
    assert {"ocean_current", "hull_fouling"} <= set(st.effects()["effect"])


@pytest.mark.pages
def test_the_readmes_script_runs(
    earlier: list[Path],
    simulated: Simulated,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Word by word, on two simulated voyages: it prints three results and leaves two pictures."""
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    script = readme.split("```python\n")[1].split("```")[0]
    shutil.copyfile(earlier[0], tmp_path / "earlier.mcap")
    shutil.copyfile(simulated("gentle", 101, 600.0), tmp_path / "trial.mcap")
    monkeypatch.chdir(tmp_path)
    exec(compile(script, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert all(words in printed for words in ("rate Hz", "mean m", "hybrid"))
    assert "% of the force range tolerated" in printed
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("trial.png", "prediction.png"))
