"""Shapes that what is in no catalogue may have: even, smooth, and none of them a difference of two alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuator
from seatrial.hybrid.diagnosis.linearise import Signature
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.regression import INTERACTIONS, NuisanceBasis, nuisance_basis
from seatrial.hybrid.vessel.plant import Plant
from tests.hybrid.diagnosis.log_by_hand import a_log


@pytest.fixture(scope="module")
def log(plant: Plant) -> Log:
    return a_log(plant, 400)


def shapes(log: Log) -> NuisanceBasis:
    return nuisance_basis(log, log.nominal, [])


def test_squares_of_coefficients_are_the_mean_square_of_what_they_make(log: Log) -> None:
    found = shapes(log)
    for depends in set(found.depends):
        own = found.features[:, [each == depends for each in found.depends]]
        assert own.T @ own / len(log) == pytest.approx(np.eye(own.shape[1]), abs=1e-9)


def test_azimuths_that_are_held_at_a_few_angles_make_no_steps(log: Log) -> None:
    """Edges at the angles themselves would make of half a tenth of a degree an angle of its own."""
    random = np.random.default_rng(1)
    held = np.deg2rad(random.choice([0.0, 20.0, -20.0, 30.0, -30.0], (len(log), 1, 1), p=[0.4, 0.2, 0.2, 0.1, 0.1]))
    angle = held + np.deg2rad(0.05) * random.standard_normal((len(log), 1, 1))
    controls = log.controls.copy()
    controls[:, :, (1, 3)] = angle
    found = shapes(replace(log, controls=controls))
    own = found.features[:, [each == "azimuth" for each in found.depends]]
    assert own.shape[1] >= 3
    for side in np.unique(held):
        same = own[held[:, 0, 0] == side]
        assert np.ptp(same, axis=0).max() < 0.25


def test_a_bank_beside_the_track_is_among_the_places(log: Log) -> None:
    """A force that falls off within a fifth of the area."""
    random = np.random.default_rng(2)
    nominal = np.zeros((3000, 6))
    nominal[:, :2] = random.uniform(-1000.0, 1000.0, (3000, 2))
    log = replace(
        log, controls=np.resize(log.controls, (3000, *log.controls.shape[1:])), nominal=nominal,
        time_s=np.arange(3000), leg=np.zeros(3000, dtype=np.int64), block=np.arange(3000) // 60,
    )  # fmt: skip
    found = nuisance_basis(log, nominal, [])
    own = found.features[:, [each == "place" for each in found.depends]]
    bank = np.exp(-np.abs(nominal[:, 0] - 500.0) / 300.0)
    bank -= bank.mean()
    left = bank - own @ np.linalg.lstsq(own, bank, rcond=None)[0]
    assert (left**2).sum() < 0.25 * (bank**2).sum()


def test_a_named_effect_may_change_with_each_form_and_with_nothing_that_stays(log: Log) -> None:
    """Shapes away from their mean and of one size, so that sizes of forms compare."""
    ones = Signature("hull_fouling", 0, np.ones((len(log), 6)), np.zeros((len(log), 6)))
    other = replace(ones, effect="towed_load")
    found = {
        each.effect: each.D[:, 0]
        for each in nuisance_basis(log, log.nominal, [ones, other], ["hull_fouling"]).varying
    }
    assert set(found) == {f"hull_fouling*{name}" for name in INTERACTIONS}
    for shape in found.values():
        assert shape.mean() == pytest.approx(0.0, abs=1e-9)
        assert (shape**2).mean() == pytest.approx(1.0)
    steady = log.nominal.copy()
    steady[:, 4] = 0.2
    rest = {each.effect for each in nuisance_basis(log, steady, [ones], ["hull_fouling"]).varying}
    assert set(found) - rest == {"hull_fouling*drift"}


def test_an_effect_varies_with_the_motion_of_some_seconds_ago(log: Log) -> None:
    """A smoothed motion knows the forces of the next seconds, which would pass for a form of the effect."""
    log = replace(log, block=np.arange(len(log)) // 100)
    ones = Signature("wave_drift", 0, np.ones((len(log), 6)), np.zeros((len(log), 6)))

    def of(nominal: Floats) -> Floats:
        varying = nuisance_basis(log, nominal, [ones], ["wave_drift"]).varying
        return np.column_stack([each.D[:, 0] for each in varying])

    def changed(rows: slice) -> Floats:
        moved = log.nominal.copy()
        moved[rows, 3:] += 0.3
        return np.asarray(np.abs(of(moved) - of(log.nominal)).max(axis=1))

    by_push = changed(slice(220, 223))
    ordinary = np.median(by_push)  # the mean, too, has changed a little
    assert by_push[220:223].max() < 3.0 * ordinary
    assert by_push[223:226].min() > 10.0 * ordinary
    assert not changed(slice(297, 300)).any()  # what follows is another block, perhaps another recording


def test_a_rudder_and_an_azimuth_that_turn_the_ship_together_do_not_cancel(log: Log) -> None:
    """A rudder turns her to starboard at the angle at which an azimuth turns her to port."""
    ship = (Actuator("pod", "azimuth"), Actuator("rudder", "rudder"))
    helm = np.deg2rad(25.0 * np.sin(np.arange(len(log)) / 20.0))[:, None, None] * np.ones((1, 4, 1))
    both = np.concatenate([np.full_like(helm, 2.0), helm, -helm], axis=2)
    one = replace(log, actuators=ship[:1], controls=both[:, :, :2])
    together = [shapes(each) for each in (one, replace(log, actuators=ship, controls=both))]
    of_one, of_both = (each.features[:, [on == "azimuth" for on in each.depends]] for each in together)
    assert of_both.shape[1] == of_one.shape[1] >= 3
    assert of_both == pytest.approx(of_one, abs=1e-9)
