"""R/V Gunnerus, elongated, 27 October 2022: zigzags and circles against figures measured by others.

The published advances and overshoots count from the middle of the change of command: the orders were stored as
events and interpolated, so that a change lasts two to nine seconds. So do the indices here, as all do.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.indices import Manoeuvre
from seatrial.analysis.tables.table import read_table

pytestmark = pytest.mark.shared

MAPS = Path(__file__).parents[3] / "trials" / "columns"
FILES = {
    "gunnerus_2022_trials": "trials_2022-10-27_part1.csv",
    "gunnerus_2019_docking": "docking_2019-11-09_part1.csv",
}
WRONG_KNOT = 1.0203


def table_of(shared_data: Path, folder: Path, name: str) -> pd.DataFrame:
    import_table(shared_data / name / FILES[name], folder / f"{name}.mcap", MAPS / f"{name}.toml")
    return read_table(folder / f"{name}.mcap")


@pytest.fixture(scope="module")
def trials(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Manoeuvre, ...]:
    """The manoeuvres of 2022 with the speeds put right; wrong headings and jumping positions are left in."""
    table = table_of(shared_data, tmp_path_factory.mktemp("2022"), "gunnerus_2022_trials")
    mended = {name: WRONG_KNOT * table[name] for name in ("surge_mps", "sway_mps")}
    return find_manoeuvres(table.assign(**mended), 33.9)


def circles(trials: tuple[Manoeuvre, ...], azimuth_deg: float) -> dict[str, Manoeuvre]:
    return {each.side: each for each in trials if each.kind == "turning_circle"
            and abs(abs(each.settings["azimuth_deg"]) - azimuth_deg) < 2.0}  # fmt: skip


def test_the_programme_of_the_day_is_found(trials: tuple[Manoeuvre, ...]) -> None:
    names = [each.name for each in trials if each.kind == "zigzag"]
    assert [names.count(f"zigzag {kind}") for kind in ("10/10", "10/20", "5/10", "20/20")] == [1, 2, 2, 1]
    assert sum(each.kind == "turning_circle" for each in trials) == 4
    assert [each.side for each in trials if each.kind == "turning_circle"] == [
        "port", "starboard", "starboard", "port"]  # fmt: skip


@pytest.mark.parametrize(
    ("azimuth_deg", "advance_m", "diameter_m", "rate_dps"),
    [(10.0, (136, 149), (225, 254), (2.3, 2.5)), (30.0, (65, 87), (84, 95), (2.8, 3.0))],
)
def test_circles_agree_with_the_published_figures(
    trials: tuple[Manoeuvre, ...],
    azimuth_deg: float,
    advance_m: tuple[float, float],
    diameter_m: tuple[float, float],
    rate_dps: tuple[float, float],
) -> None:
    """Of the published advances nobody says what they count from; here it is the order, known from events only."""
    found = circles(trials, azimuth_deg)
    assert set(found) == {"port", "starboard"}
    for each in found.values():
        value = {name: index.value for name, index in each.indices.items()}
        advance = each.indices["advance_m"]
        assert advance.low < advance_m[1] + 5
        assert advance.high > advance_m[0] - 5
        assert diameter_m[0] - 5 < value["tactical_diameter_m"] < diameter_m[1] + 5
        assert rate_dps[0] - 0.05 < value["steady_yaw_rate_dps"] < rate_dps[1] + 0.05


def test_overshoots_of_the_10_10_tests_agree_with_the_published_ones(trials: tuple[Manoeuvre, ...]) -> None:
    found = [each for each in trials if each.name in ("zigzag 10/10", "zigzag 8/10")]
    values = [index.value for each in found for name, index in each.indices.items()
              if name in ("overshoot_1_deg", "overshoot_2_deg")]  # fmt: skip
    assert len(values) == 4
    assert all(1.6 - 0.5 < value < 2.7 + 0.5 for value in values)


def test_orders_known_from_events_are_said_to_be(trials: tuple[Manoeuvre, ...]) -> None:
    for each in trials:
        if each.kind in ("zigzag", "turning_circle"):
            assert any("recorded as events" in note for note in each.notes), each.name


def test_limits_stand_beside_the_test_that_they_are_for(trials: tuple[Manoeuvre, ...]) -> None:
    def limited(each: Manoeuvre) -> set[str]:
        return {name.removesuffix("_current_removed") for name, index in each.indices.items() if index.limit}

    for each in circles(trials, 30.0).values():
        assert limited(each) == {"advance_m", "tactical_diameter_m"}
    for each in circles(trials, 10.0).values():
        assert limited(each) == {"initial_turning_m"}
    by_name = {each.name: limited(each) for each in trials if each.kind == "zigzag"}
    assert by_name["zigzag 20/20"] == {"overshoot_1_from_order_deg"}
    assert by_name["zigzag 10/10"] == {
        "overshoot_1_from_order_deg", "overshoot_2_from_order_deg", "initial_turning_m",
    }  # fmt: skip


def test_where_a_piece_was_cut_out_no_manoeuvre_goes_on(trials: tuple[Manoeuvre, ...]) -> None:
    for at in ("2022-10-27T00:44:59Z", "2022-10-27T01:10:13.5Z"):
        assert not any(each.start < pd.Timestamp(at) < each.end for each in trials)


def test_no_zigzag_is_seen_in_harbour_work(shared_data: Path, tmp_path: Path) -> None:
    found = find_manoeuvres(table_of(shared_data, tmp_path, "gunnerus_2019_docking"))
    kinds = {each.kind for each in found}
    assert {"thruster_test", "crabbing"} <= kinds
    assert not kinds & {"zigzag", "turning_circle"}
