"""IMO MSC.137(76), section 5.3: the figures of the resolution."""

from __future__ import annotations

import pytest

from analysis.manoeuvres.limits import first_overshoot_10_10_deg, overshoot_limit_deg, second_overshoot_10_10_deg


@pytest.mark.parametrize(("ratio_s", "first", "second"), [(5, 10, 25), (10, 10, 25), (20, 15, 32.5), (30, 20, 40),
                                                          (60, 20, 40)])  # fmt: skip
def test_overshoots_of_the_10_10_test(ratio_s: float, first: float, second: float) -> None:
    assert first_overshoot_10_10_deg(ratio_s) == first
    assert second_overshoot_10_10_deg(ratio_s) == second


def test_a_limit_holds_for_its_own_test_only() -> None:
    assert overshoot_limit_deg(1, 20.3, 19.4, None, 5.0) == 25.0
    assert overshoot_limit_deg(2, 20.3, 19.4, None, 5.0) is None
    assert overshoot_limit_deg(1, 10.0, 20.0, 100.0, 5.0) is None
    assert overshoot_limit_deg(1, 10.0, 10.0, None, 5.0) is None
    assert overshoot_limit_deg(1, 10.0, 10.0, 100.0, 5.0) == 15.0
    assert overshoot_limit_deg(2, 10.0, 10.0, 100.0, 5.0) == 32.5
