"""Trials of ships with a propeller and a rudder, diagnosed blind: a few of the benchmark's."""

from __future__ import annotations

import pytest

from tests.benchmarks.diagnosis.rudder_ships import RudderCase, hidden_in, judged, singles
from tests.benchmarks.diagnosis.scoring import exact, names_something
from tests.benchmarks.sea_trials import outcome

pytestmark = pytest.mark.slow

CASES = [
    RudderCase("esso_osaka_3m", "rudder_offset_rudder", 13),
    RudderCase("kvlcc2_7m", "wake_propeller", 7),
    RudderCase("kvlcc2_7m", "lag_rudder", 23),
    RudderCase("esso_osaka_120m", "rudder_loss_rudder", 16),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.key)
def test_what_is_hidden_is_named_at_its_size(case: RudderCase) -> None:
    result = judged(case)
    assert exact(result)
    ((name, value),) = hidden_in(case)[case.effect].items()
    (named,) = result["said"]["effects"]
    found = named["parameters"][name]
    assert abs(found["value"] - value) < 0.3 * abs(value)


@pytest.mark.parametrize("ship", ["esso_osaka_3m", "kvlcc2_7m"])
def test_nothing_is_named_where_nothing_is_hidden(ship: str) -> None:
    assert not names_something(judged(RudderCase(ship, "", 3001)))


@pytest.mark.parametrize(("ship", "sea", "seed"), [("kvlcc2_7m", "gentle", 1), ("esso_osaka_3m", "moderate", 3)])
def test_a_sea_whose_drift_is_slow_and_uneven_is_current_and_drift(ship: str, sea: str, seed: int) -> None:
    """The ship moves as the force on her comes and goes, which is no other form of it."""
    assert outcome((ship, sea, seed)) == "right"


def test_the_benchmark_meets_both_hulls_and_hides_what_their_catalogues_have() -> None:
    cases = singles()
    assert len({case.key for case in cases}) == 40
    assert sum(case.ship.startswith("kvlcc2") for case in cases) == 20
    assert all(hidden_in(case) for case in cases)
