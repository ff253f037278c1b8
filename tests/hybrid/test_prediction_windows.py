"""Windows as arrays: units, circles, order, and splits that never leak."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.ship import CIRCULAR, NAMES
from seatrial.hybrid.prediction.window_sets import draw_groups, replace_by_two_sided_starts, windows_from_rows

START = pd.Timestamp("2026-06-01T08:00:00Z")


def rows_of(heading_deg: list[list[float]], seconds: int) -> pd.DataFrame:
    """Windows in which every channel is its own number, north the second and the heading as given."""
    frames = []
    for window, headings in enumerate(heading_deg):
        frame = pd.DataFrame({name: np.full(seconds + 1, 10.0 + at) for at, name in enumerate(NAMES)})
        frame["north_m"], frame["heading_deg"] = np.arange(seconds + 1.0) + 1000 * window, headings
        frame = frame.assign(window=window, second=range(seconds + 1), trial="t", leg=f"t/{window}")
        frames.append(frame.assign(start=START + pd.Timedelta(minutes=window)))
    return pd.concat(frames, ignore_index=True)


def test_edges_are_in_degrees_and_rpm_and_the_inside_is_not() -> None:
    """Radians, revolutions a second for the shafts, rpm for the tunnel; what is in metres stays."""
    windows = windows_from_rows(rows_of([[20.0] * 4], 3))
    value = {name: 10.0 + at for at, name in enumerate(NAMES)}
    assert windows.start[0] == pytest.approx(
        [0.0, value["east_m"], np.deg2rad(20.0), value["surge_mps"], value["sway_mps"],
         np.deg2rad(value["yaw_rate_dps"])]
    )  # fmt: skip
    assert windows.wind[0] == pytest.approx([np.deg2rad(value["wind_direction_deg"]), value["wind_speed_mps"]])
    assert windows.control[0] == pytest.approx(
        [value["port_rpm"] / 60, np.deg2rad(value["port_angle_deg"]), value["starboard_rpm"] / 60,
         np.deg2rad(value["starboard_angle_deg"]), value["tunnel_rpm"]]
    )  # fmt: skip
    assert windows.horizon_s == 3
    assert windows.track[0, :, 0].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_a_heading_through_north_does_not_jump() -> None:
    """359 to 1 is a turn of two degrees to starboard, and back one to port."""
    windows = windows_from_rows(rows_of([[359.0, 0.0, 1.0, 2.0], [1.0, 0.5, 359.5, 358.0]], 3))
    turns = np.rad2deg(np.diff(windows.track[..., 2], axis=1))
    assert turns == pytest.approx(np.array([[1.0, 1.0, 1.0], [-0.5, -1.0, -1.5]]))


@pytest.mark.parametrize(("measured_deg", "smooth_deg"), [(359.9, 0.2), (0.1, 359.7), (180.0, 180.3)])
def test_a_smoothed_start_is_in_the_turn_of_the_track(measured_deg: float, smooth_deg: float) -> None:
    """The heading that is known afterwards lies beside the measured one, not a turn away; the rest is as given."""
    motion = pd.DataFrame({"north_m": [1.0], "east_m": [2.0], "heading_deg": [smooth_deg], "surge_mps": [3.0],
                           "sway_mps": [4.0], "yaw_rate_dps": [5.0]})  # fmt: skip
    windows = replace_by_two_sided_starts(windows_from_rows(rows_of([[measured_deg] * 4], 3), motion))
    assert abs(np.rad2deg(windows.start[0, 2] - windows.track[0, 0, 2])) < 0.5
    assert windows.start[0, [0, 1, 3, 4]].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_rows_may_come_in_any_order() -> None:
    """Windows and seconds are sorted by their numbers, not by their place in the table."""
    rows = rows_of([[10.0, 20.0, 30.0, 40.0], [50.0, 60.0, 70.0, 80.0]], 3)
    shuffled = rows.sample(frac=1.0, random_state=1)
    straight, other = windows_from_rows(rows), windows_from_rows(shuffled)
    assert np.array_equal(straight.track, other.track)
    assert straight.leg.tolist() == other.leg.tolist() == ["t/0", "t/1"]
    assert straight.start_time.equals(other.start_time)


def test_a_subset_keeps_what_belongs_together() -> None:
    windows = windows_from_rows(rows_of([[float(10 * number)] * 4 for number in range(5)], 3))
    chosen = windows.subset(np.array([True, False, False, True, True]))
    assert chosen.leg.tolist() == ["t/0", "t/3", "t/4"]
    assert chosen.track[:, 0, 0].tolist() == [0.0, 3000.0, 4000.0]
    assert np.rad2deg(chosen.start[:, 2]) == pytest.approx([0.0, 30.0, 40.0])
    assert len(chosen.start_time) == len(chosen) == 3


def test_no_window_is_said() -> None:
    with pytest.raises(DataShortageError, match="no held windows"):
        windows_from_rows(rows_of([[0.0] * 4], 3).iloc[:0])


@given(
    groups=arrays(np.int64, st.integers(2, 80), elements=st.integers(0, 12)),
    share=st.floats(0.05, 0.95),
    seed=st.integers(0, 1000),
)
def test_a_split_never_leaks(groups: np.ndarray, share: float, seed: int) -> None:
    """Every window is on one side, every group too; neither side is empty; a seed repeats."""
    names = groups.astype(str)
    if len(np.unique(names)) < 2:
        with pytest.raises(DataShortageError, match="only one leg"):
            draw_groups(names, share, seed)
        return
    drawn = draw_groups(names, share, seed)
    assert not set(names[drawn]) & set(names[~drawn])
    assert drawn.any()
    assert not drawn.all()
    assert np.array_equal(drawn, draw_groups(names, share, seed))


@given(seed=st.integers(0, 200))
def test_a_split_of_many_even_groups_has_its_share(seed: int) -> None:
    """Forty legs of five windows and a fifth asked for: a fifth is given, within a leg."""
    names = np.repeat(np.arange(40), 5).astype(str)
    assert abs(draw_groups(names, 0.2, seed).sum() - 40) <= 5


def test_seeds_choose_different_legs() -> None:
    names = np.repeat(np.arange(40), 5).astype(str)
    chosen = {tuple(np.unique(names[draw_groups(names, 0.2, seed)])) for seed in range(10)}
    assert len(chosen) > 5


def test_the_circular_channels_of_a_window_are_those_of_the_contract() -> None:
    """Whatever is an angle among the 13 is turned into radians somewhere above; this list has to agree."""
    assert CIRCULAR & set(NAMES) == {
        "heading_deg", "wind_direction_deg", "port_angle_deg", "starboard_angle_deg",
    }  # fmt: skip
