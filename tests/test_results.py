"""Results show themselves: a line, a table, a picture in a notebook; settings of calibrators, attributes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.result import Result
from seatrial.hybrid.calibrators import METHODS, make_calibrator


@pytest.fixture(scope="module")
def results(small_folder: Path, unseen: Path) -> dict[str, Any]:
    return {
        "check": st.check(unseen),
        "windows": st.windows(unseen, horizon_s=30),
        "validate": st.validate(unseen, small_folder),
        "predict": st.predict(unseen, at="+600", calibrator=small_folder),
    }


@pytest.mark.parametrize("name", ["check", "windows", "validate", "predict"])
def test_result_has_a_line_a_page_and_a_table(name: str, results: dict[str, Any]) -> None:
    result = results[name]
    assert isinstance(result, Result)
    line = repr(result)
    assert line.startswith(f"<{type(result).__name__}: ")
    assert "\n" not in line
    assert len(line) < 300
    html = result._repr_html_()
    assert "<pre" in html
    assert "data:image/png;base64," in html
    assert len(result.to_frame()) > 0


def test_table_of_a_prediction_is_its_track(results: dict[str, Any]) -> None:
    track = results["predict"].to_frame()
    assert list(track["second"]) == list(range(len(results["predict"].track)))
    assert track["north_m"].to_numpy() == pytest.approx(results["predict"].track[:, 0])


def test_parquet_read_by_pandas_has_units_and_trial(tmp_path: Path) -> None:
    table = st.simulate(tmp_path / "trial.mcap", "gunnerus_long", duration_s=60.0, rate_hz=1.0)
    st.export(tmp_path / "trial.mcap", tmp_path / "trial.parquet", rate_hz=1.0)
    attributes = pd.read_parquet(tmp_path / "trial.parquet").attrs
    assert attributes["units"]["heading_deg"] == "deg"
    assert set(attributes["units"]) >= set(table.columns)
    assert attributes["trial"]["vessel"] == "gunnerus_long"


@pytest.mark.parametrize("method", METHODS)
def test_settings_of_a_calibrator_are_those_it_was_made_with(method: str) -> None:
    calibrator = make_calibrator(method, seed=7)
    settings = calibrator.get_params()
    assert settings["seed"] == 7
    assert type(calibrator)(**settings).get_params() == settings
    assert calibrator.set_params(seed=8).get_params()["seed"] == 8
    with pytest.raises(ConfigurationError, match="no setting depth"):
        calibrator.set_params(depth=3)
