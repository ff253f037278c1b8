"""What a ship did, told from her track: each manoeuvre made by hand is called by its name, at any size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.hybrid.evaluation.study import MANOEUVRES, motion_class_of_windows, window_classes
from tests.hybrid.evaluation.windows_in_legs import windows_of_legs
from tests.hybrid.windows_by_hand import windows_at


@pytest.mark.parametrize("length_m", [12.0, 36.0, 300.0])
@pytest.mark.parametrize(
    ("froude", "sway_share", "lengths_of_radius", "expected"),
    [(0.3, 0.0, np.inf, "straight"), (0.3, 0.02, 100.0, "straight"), (0.3, 0.0, 5.0, "turning"),
     (0.3, 0.0, -5.0, "turning"), (0.03, 0.0, 5.0, "slow"), (-0.2, 0.0, np.inf, "other"),
     (0.2, 1.0, np.inf, "other")],
)  # fmt: skip
def test_held_motions_have_their_names(
    length_m: float, froude: float, sway_share: float, lengths_of_radius: float, expected: str
) -> None:
    surge = froude * np.sqrt(9.81 * length_m)
    rate = surge / (lengths_of_radius * length_m)
    window = windows_at([0.0, 0.0, 3.0, surge, sway_share * surge, rate], 15)
    assert list(motion_class_of_windows(window, length_m)) == [expected]


def test_gaining_and_losing_speed() -> None:
    window = windows_at([0.0, 0.0, 1.0, 5.0, 0.0, 0.0], 15)
    second = np.arange(16.0)
    for gain_mps2 in (0.1, -0.1):
        ahead = 5.0 * second + 0.5 * gain_mps2 * second**2
        track = np.stack([ahead * np.cos(1.0), ahead * np.sin(1.0), np.ones(16)], axis=-1)[None]
        assert list(motion_class_of_windows(replace(window, track=track), 36.0)) == ["accelerating"]


def test_wind_is_named_by_beaufort() -> None:
    """Tables of the Beaufort scale: 3.4 m/s begins force 3, 8.0 force 5, 13.9 force 7."""
    air = np.column_stack([np.zeros(6), [0.0, 3.3, 3.5, 7.9, 13.0, 40.0]])
    windows = replace(windows_at(np.zeros((6, 6)), 5), wind=air)
    by_wind = {name: list(np.flatnonzero(mask)) for name, mask in window_classes(windows, 36.0)["wind"].items()}
    assert by_wind == {"0-2 Bft": [0, 1], "3-4 Bft": [2, 3], "5-6 Bft": [4], "7 Bft and more": [5]}


def test_every_window_is_in_one_class_of_each_kind() -> None:
    windows = windows_of_legs([3] * 8, ("a", "b"))
    for kind, classes in window_classes(windows, 36.0).items():
        assert np.array_equal(np.sum(list(classes.values()), axis=0), np.ones(len(windows))), kind
        assert all(mask.any() for mask in classes.values())
    assert set(window_classes(windows, 36.0)["manoeuvre"]) <= set(MANOEUVRES)
    assert set(window_classes(windows, 36.0)["recording"]) == {"a", "b"}
