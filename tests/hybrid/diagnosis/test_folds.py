"""The parts of a trial that judge what the others named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seatrial.hybrid.diagnosis.gap import fold_of
from seatrial.hybrid.diagnosis.log import Log


@given(st.lists(st.integers(1, 13), min_size=1, max_size=6), st.integers(2, 5))
def test_folds_are_parts_of_each_recording_that_lie_together(legs: list[int], folds: int) -> None:
    """As many as there can be, in each recording one after the other, none much larger than another."""
    recording = np.repeat(np.arange(len(legs)), legs)
    number = np.arange(len(recording))
    fold = fold_of(cast("Log", SimpleNamespace(leg=number, recording=recording, leg_count=len(number))), folds)
    assert np.unique(fold).size == min(folds, len(number)) or max(legs) < folds
    for each, count in enumerate(legs):
        own = fold[recording == each]
        runs = 1 + np.count_nonzero(np.diff(own))
        assert runs == np.unique(own).size == min(folds, count, len(number))
        sizes = np.unique(own, return_counts=True)[1]
        assert sizes.max() - sizes.min() <= 1


def test_recordings_of_one_leg_are_left_out_in_turn() -> None:
    number = np.arange(6)
    fold = fold_of(cast("Log", SimpleNamespace(leg=number, recording=number, leg_count=6)))
    assert fold.tolist() == [0, 1, 2, 3, 0, 1]
