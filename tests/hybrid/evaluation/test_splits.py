"""What is judged was never fitted, whatever the windows; only the random split breaks that, and it is known to."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import ConfigurationError, DataShortageError
from seatrial.hybrid.evaluation.study import SPLITS, refuse_unknown_splits, shared_seconds
from tests.hybrid.evaluation.windows_in_legs import SECONDS, windows_of_legs

legs_of_windows = st.lists(st.integers(1, 8), min_size=6, max_size=12)


@settings(deadline=None, max_examples=40)
@given(
    sizes=legs_of_windows,
    gap_s=st.integers(1, 90),
    kind=st.sampled_from(["leg", "time", "recording"]),
    seed=st.integers(0, 99),
)
def test_no_second_is_on_both_sides(sizes: list[int], gap_s: int, kind: str, seed: int) -> None:
    """Held-out windows share no second with any window that is fitted or stopped by."""
    windows = windows_of_legs(sizes, ("first", "second"), gap_s)
    try:
        draws = SPLITS[kind](windows, 2, seed)
    except DataShortageError:
        assume(False)
    for draw in draws:
        assert shared_seconds(windows, draw.fitting | draw.stopping, draw.held_out) == 0
        assert shared_seconds(windows, draw.fitting, draw.stopping) == 0
        assert draw.fitting.any()
        assert draw.stopping.any()
        assert draw.held_out.any()


@pytest.mark.parametrize("seed", range(5))
def test_windows_at_random_share_most_of_their_seconds(seed: int) -> None:
    """That is the leak: of what is judged, most was fitted."""
    windows = windows_of_legs([12] * 8)
    (draw,) = SPLITS["random"](windows, 1, seed)
    judged = shared_seconds(windows, draw.held_out, draw.held_out)
    assert shared_seconds(windows, draw.fitting, draw.held_out) > 0.5 * judged


def test_legs_are_kept_whole_and_drawn_anew() -> None:
    """About 30 % of the windows in each draw, other legs in the next, the same legs with the same seed."""
    windows = windows_of_legs([5] * 20)
    draws = SPLITS["leg"](windows, 4, 7)
    for draw in draws:
        assert not set(windows.leg[draw.held_out]) & set(windows.leg[draw.fitting | draw.stopping])
        assert 0.2 < draw.held_out.mean() < 0.4
        assert (draw.fitting | draw.stopping | draw.held_out).all()
    assert len({tuple(draw.held_out) for draw in draws}) > 1
    again = SPLITS["leg"](windows, 4, 7)
    assert all((one.fitting == other.fitting).all() for one, other in zip(draws, again, strict=True))


def test_the_end_of_every_recording_is_kept_back() -> None:
    """What is fitted ends before what is judged begins, in each recording; both sides hold their share."""
    windows = windows_of_legs([4] * 20, ("first", "second"))
    (draw,) = SPLITS["time"](windows, 5, 0)
    known = draw.fitting | draw.stopping
    for trial in ("first", "second"):
        mine = windows.trial == trial
        last_known = windows.start_time[known & mine].max()
        first_judged = windows.start_time[draw.held_out & mine].min()
        assert (first_judged - last_known).total_seconds() > SECONDS
        assert draw.held_out[mine].mean() == pytest.approx(0.3, abs=0.06)


def test_each_recording_is_kept_back_once() -> None:
    windows = windows_of_legs([3] * 6, ("a", "b", "c"))
    held_out = [set(windows.trial[draw.held_out]) for draw in SPLITS["recording"](windows, 5, 0)]
    assert held_out == [{"a"}, {"b"}, {"c"}]


def test_what_cannot_be_parted_is_said() -> None:
    """One recording, one leg, a name that is no split: one line each."""
    with pytest.raises(DataShortageError, match="two or more"):
        SPLITS["recording"](windows_of_legs([3] * 6), 1, 0)
    with pytest.raises(DataShortageError, match="one leg"):
        SPLITS["leg"](windows_of_legs([9]), 1, 0)
    with pytest.raises(DataShortageError, match="longer"):
        SPLITS["time"](windows_of_legs([1]), 1, 0)
    with pytest.raises(ConfigurationError, match="leg, time, recording, random"):
        refuse_unknown_splits(["leg", "month"])


def test_shared_seconds_are_counted_one_by_one() -> None:
    """Two windows of 10 s that start 5 s apart have six seconds in common; in two trials none."""
    windows = windows_of_legs([2])
    first, second = np.array([True, False]), np.array([False, True])
    assert shared_seconds(windows, first, second) == 6
    apart = windows_of_legs([1], ("first", "second"))
    assert shared_seconds(apart, first, second) == 0
