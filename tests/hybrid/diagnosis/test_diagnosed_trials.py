"""From a recorded table to names, on trials that another simulator made."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import ENVIRONMENT
from seatrial.hybrid.diagnosis.acceptance import CLOSE, Acceptance, lack_of_fit
from seatrial.hybrid.diagnosis.verdict import close_rivals
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import diagnose_tables
from tests.benchmarks.other_ship.programmes import HOLD, Order, hold
from tests.benchmarks.other_ship.trial import make_trial
from tests.hybrid.diagnosis.conftest import Diagnosed

CURRENT = {"ocean_current": {"speed_mps": 0.3, "direction_deg": 200.0}}
SHORT_S = 1200.0


def standard_error(naming: Acceptance, name: str) -> Floats:
    """Of the free coordinates of a named effect."""
    fit = naming.evidence.fit(naming.names)
    places = [fit.columns.index(column) for column in naming.evidence.columns_of([name])]
    return np.sqrt(np.diag(fit.covariance)[places])


def error(naming: Acceptance, name: str, **truth: float) -> Floats:
    """Estimate less truth in free coordinates."""
    fit, model = naming.evidence.fit(naming.names), naming.evidence.equations.model
    places = [fit.columns.index(column) for column in naming.evidence.columns_of([name])]
    return np.asarray(fit.values[places] - np.array(model.catalogue[name].free_coordinates(truth)))


@pytest.mark.slow
def test_a_current_is_named_with_its_speed_and_direction(diagnosed: Diagnosed) -> None:
    naming = diagnosed(seed=3, hidden=CURRENT, sea="calm", duration_s=SHORT_S)
    assert naming.names == ("ocean_current",)
    off, sigma = error(naming, "ocean_current", **CURRENT["ocean_current"]), standard_error(naming, "ocean_current")
    assert (np.abs(off) < 4.0 * sigma + 0.002).all()
    assert sigma.max() < 0.01
    assert naming.tests["ocean_current"].is_accepted


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden(diagnosed: Diagnosed) -> None:
    naming = diagnosed(seed=4, hidden={}, sea="calm", duration_s=SHORT_S)
    assert naming.names == ()
    evidence = naming.evidence
    assert evidence.inner[0, 0] == pytest.approx(np.isfinite(evidence.equations.log.measured).sum(), rel=0.15)
    assert not any(each.is_significant for each in lack_of_fit(evidence, ()))


@pytest.mark.slow
def test_a_biased_compass_is_named_in_a_sea(diagnosed: Diagnosed) -> None:
    naming = diagnosed(seed=5, hidden={"heading_bias": {"angle_deg": 1.5}}, sea="gentle", duration_s=SHORT_S)
    assert naming.names == ("heading_bias",)
    assert np.abs(error(naming, "heading_bias", angle_deg=1.5)) < 4.0 * standard_error(naming, "heading_bias")


@pytest.mark.slow
def test_play_in_one_gear_is_named_within_its_interval() -> None:
    """Not a lag, nor a delay, nor play in the other gear."""
    table, _ = make_trial(31, {"backlash_starboard": {"width_deg": 6.0}}, duration_s=SHORT_S, rate_hz=4.0)
    (said,) = diagnose_tables([table], load_vessel("gunnerus_short")).diagnosis.effects
    assert said.name == "backlash_starboard"
    assert said.parameters["width_deg"].low < 6.0 < said.parameters["width_deg"].high
    assert said.sentence.startswith("The starboard thruster has ")


NEAR_REST = (
    Order(HOLD, 25.0, 25.0, seconds=60.0), hold(0, 0, 60), hold(0, 0, 40, 150), hold(0, 0, 60),
    Order(HOLD, -25.0, -25.0, seconds=60.0), hold(0, 0, 60), hold(0, 0, 40, -150), hold(0, 0, 60),
    hold(20, -90, 50, 110), hold(0, 0, 60), hold(20, 90, 50, -110), hold(0, 0, 60),
)  # fmt: skip
"""Short pushes ahead, astern, aside and round, and drifting between them."""


@pytest.mark.slow
@pytest.mark.parametrize("rates", [(0.02, 0.0, 0.0), (0.02, 0.02, 0.1), ()])
def test_damping_near_rest_is_named_where_a_ship_is_pushed_about_slowly(
    diagnosed: Diagnosed, rates: tuple[float, ...]
) -> None:
    """By axis: what is not there has an interval about zero. And nothing is named where nothing is hidden."""
    truth = dict(zip(("surge_ps", "sway_ps", "yaw_ps"), rates, strict=False))
    hidden = {"low_speed_damping": truth} if rates else {}
    naming = diagnosed(seed=2, hidden=hidden, sea="calm", programme=NEAR_REST, duration_s=SHORT_S, rate_hz=2.0)
    assert naming.names == tuple(hidden)
    for name in hidden:
        assert (np.abs(error(naming, name, **truth)) < 4.0 * standard_error(naming, name)).all()


@pytest.mark.slow
def test_two_effects_at_once_are_both_named(diagnosed: Diagnosed) -> None:
    pair = {**CURRENT, "thrust_loss_port": {"fraction": 0.15}}
    naming = diagnosed(seed=6, hidden=pair, sea="calm", duration_s=1800.0)
    assert set(naming.names) == set(pair)


@pytest.mark.slow
def test_a_moment_that_hangs_on_heading_is_no_effect_of_the_catalogue(diagnosed: Diagnosed) -> None:
    """A yaw moment of sin 4 psi: found beyond the catalogue, in yaw, on heading."""
    naming = diagnosed(seed=7, hidden={}, outside={"yaw_moment_4psi": 6e4}, sea="calm", duration_s=3600.0)
    found = [each for each in lack_of_fit(naming.evidence, naming.names) if each.is_significant]
    assert (found[0].depends, found[0].what) == ("heading", "yaw")


@pytest.mark.slow
def test_a_wind_scale_far_from_one_is_compared_with_the_wind_load_where_each_explains_most(
    diagnosed: Diagnosed,
) -> None:
    """About nothing, and about the other, a scale of two looks worse than it is."""
    scale = {"wind_speed_scale": {"factor": 2.2}}
    naming = diagnosed(seed=600403, hidden=scale, sea="gentle", programme="zigzags", duration_s=1800.0)
    assert len(naming.names) == 1
    alike = {each.name for each in close_rivals(naming) if each.evidence < CLOSE}
    assert "wind_speed_scale" in {*naming.names, *alike}


@pytest.mark.slow
def test_without_a_record_of_the_wind_a_steady_one_is_named_beside_the_rest() -> None:
    """A gentle sea's wind; without its name a current and a fouling would be the unknown's."""
    hidden = {
        "hull_fouling": {"resistance_factor": 1.35},
        "ocean_current": {"speed_mps": 0.25, "direction_deg": 40.0},
    }
    table, _ = make_trial(700500, hidden, sea="gentle", duration_s=1800.0, rate_hz=2.0)
    run = diagnose_tables([table.drop(columns=list(ENVIRONMENT))], load_vessel("gunnerus_short"))
    effects = {each.name: each for each in run.diagnosis.effects}
    assert set(effects) == {*hidden, "steady_wind"}
    for name, truth in hidden.items():
        for parameter, value in truth.items():
            assert effects[name].parameters[parameter].value == pytest.approx(value, rel=0.1)
    assert not effects["steady_wind"].in_vessel
    assert run.diagnosis.gap.after_m < 0.3 * run.diagnosis.gap.before_m
