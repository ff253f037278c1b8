"""The benchmark of effects hidden in measured data, without the data: what is hidden, how answers are scored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.hybrid.diagnosis.linearise import model_of
from seatrial.hybrid.effects import catalogue_of, vessel_plant
from seatrial.hybrid.vessel.files import load_vessel
from tests.benchmarks import hidden_in_measured
from tests.benchmarks.measured.judge import VESSEL, cases_of
from tests.benchmarks.measured.kinds import KINDS
from tests.benchmarks.measured.page import page
from tests.benchmarks.measured.scoring import against_good, alone_right, closed, outcome, tells

GOOD = load_vessel(VESSEL)
CATALOGUE = catalogue_of(GOOD)
ABOUT = {"wake", "X_vr of another convention"}
"""A wake that goes with the drift comes back as one that does not, and no factor changes a sign."""

TERMS = [name for name, kind in KINDS.items() if kind.names and not kind.in_record and name not in ABOUT]


@pytest.mark.parametrize("name", TERMS)
def test_what_is_taken_out_is_something_and_its_effect_puts_it_back(name: str) -> None:
    kind, good = KINDS[name], vessel_plant(GOOD).numbers()
    model = model_of(kind.model(GOOD), CATALOGUE)
    given = model.file_effects.get(kind.effect, (0.0,))
    at = {kind.effect: tuple(np.subtract(CATALOGUE[kind.effect].free_coordinates(kind.values), given).tolist())}
    assert vessel_plant(kind.model(GOOD)).numbers() != good
    returned = type(model)(model.base, model.catalogue, at, model.file_effects).plant().numbers()
    for number, value in good.items():
        assert returned[number] == pytest.approx(value), number


def test_every_right_name_is_in_the_ships_catalogue() -> None:
    assert all(kind.names <= set(CATALOGUE) for kind in KINDS.values())


def a_run() -> pd.DataFrame:
    """A minute on a circle, ten records a second, heading through north."""
    time_s = np.arange(600) / 10.0
    psi, u, v, r = np.deg2rad(300.0) + 0.05 * time_s, 0.5, 0.03, 0.05
    north = (u * np.sin(psi) + v * np.cos(psi)) / r
    east = (-u * np.cos(psi) + v * np.sin(psi)) / r
    return pd.DataFrame(
        {
            "north_m": north, "east_m": east, "heading_deg": np.rad2deg(psi) % 360.0, "surge_mps": u, "sway_mps": v,
            "yaw_rate_dps": np.rad2deg(r), "wind_direction_deg": 350.0, "wind_speed_mps": 2.0,
        },
        index=pd.to_datetime((1.6e18 + 1e8 * np.arange(600)).astype(np.int64), utc=True),
    )  # fmt: skip


def test_in_a_current_positions_and_speeds_still_agree() -> None:
    table = KINDS["current"].record(a_run())
    psi = np.deg2rad(table["heading_deg"])
    north_mps = table["surge_mps"] * np.cos(psi) - table["sway_mps"] * np.sin(psi)
    assert np.gradient(table["north_m"], 0.1)[5:-5] == pytest.approx(north_mps[5:-5], abs=1e-4)
    assert (north_mps.mean() - 0.04) == pytest.approx(np.gradient(a_run()["north_m"], 0.1).mean(), abs=2e-3)


def test_late_positions_are_those_of_two_seconds_before() -> None:
    late, table = KINDS["late positions"].record(a_run()), a_run()
    np.testing.assert_allclose(late["east_m"][20:], table["east_m"][:-20])
    pd.testing.assert_series_equal(late["heading_deg"], table["heading_deg"])


def test_turned_channels_stay_on_the_circle() -> None:
    assert KINDS["wind vane"].record(a_run())["wind_direction_deg"].unique().tolist() == [50.0]
    assert KINDS["heading bias"].record(a_run())["heading_deg"].between(0.0, 360.0, inclusive="left").all()


def a_result(kind: str, *named: str, tied: tuple[str, ...] = (), off: tuple[float, float, float]) -> dict[str, Any]:
    """What a case would give: distances as it is, with the term's own return, as diagnosed."""
    distances = dict(zip(("before", "own", "found"), off, strict=True))
    effects = [{"name": name, "parameters": {"factor": {"value": 1.0}}} for name in named]
    said = {"verdict": "named", "effects": effects, "indistinguishable": [list(tied)] if tied else []}
    return {"kind": kind, "part": "1 of 1", "said": said, "here": distances, "others": distances}


def test_a_right_name_a_group_with_it_and_a_wrong_one() -> None:
    off = (0.10, 0.06, 0.065)
    assert outcome(a_result("wind load", "wind_load", off=off)) == "right"
    assert outcome(a_result("yaw damping", "trim", tied=("trim", "yaw_damping"), off=off)) == "right"
    assert outcome(a_result("wind load", "loading", off=off)) == "wrong"
    assert outcome(a_result("wind load", off=off)) == "not named"


def test_other_names_beside_the_right_one_are_counted() -> None:
    off = (0.10, 0.06, 0.065)
    assert alone_right(a_result("wind load", "wind_load", off=off))
    assert alone_right(a_result("yaw damping", "trim", tied=("trim", "yaw_damping"), off=off))
    assert not alone_right(a_result("wind load", "wind_load", "loading", off=off))
    assert not alone_right(a_result("wind load", off=off))


def test_what_is_named_with_nothing_hidden_is_not_wrong() -> None:
    usual = a_result("nothing", "position_delay", off=(0.06, 0.06, 0.05))
    assert outcome(a_result("wind load", "position_delay", off=(0.1, 0.06, 0.1)), usual) == "not named"


def test_the_gap_is_a_share_of_what_the_terms_own_return_closes() -> None:
    result = a_result("wind load", "wind_load", off=(0.10, 0.06, 0.07))
    assert closed(result) == pytest.approx(0.75)
    assert np.isnan(closed(a_result("heading bias", "heading_bias", off=(0.10, 0.11, 0.10))))
    assert against_good(result) == pytest.approx(0.07 / 0.06)


def test_a_term_that_the_recordings_do_not_miss_does_not_count() -> None:
    assert tells(a_result("wind load", off=(0.10, 0.09, 0.10)))
    assert not tells(a_result("wind load", off=(0.10, 0.099, 0.10)))
    assert tells(a_result("late positions", off=(0.10, 0.10, 0.10)))
    assert not tells(a_result("nothing", off=(0.10, 0.05, 0.10)))


def test_parts_have_all_recordings_once_and_the_page_has_every_case(tmp_path: Path) -> None:
    for number in range(7):
        path = tmp_path / ("turning" if number < 4 else "zigzag") / f"{number}.csv.gz"
        path.parent.mkdir(exist_ok=True)
        path.touch()
    cases = cases_of(tmp_path, ["nothing"], parts=3)
    assert sorted(name for case in cases for name in case.recordings) == sorted(
        f"{'turning' if number < 4 else 'zigzag'}/{number}.csv.gz" for number in range(7)
    )
    written = page([a_result(kind, off=(0.1, 0.06, 0.1)) for kind in KINDS])
    assert all(f"| {kind} |" in written for kind in KINDS)


def test_without_recordings_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["x", str(tmp_path), "-o", str(tmp_path / "results.jsonl")])
    hidden_in_measured.main()
    assert capsys.readouterr().out.startswith("skipped: no recordings")
