"""Noise levels found again in data drawn with known ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.disturbance_model import Columns, DisturbanceNoise, whiten
from seatrial.hybrid.diagnosis.estimate_noise import estimate_noise, fit_noise, start_of_drift, start_of_wave_drift
from seatrial.hybrid.diagnosis.linearise import LinearModel, linearise, model_of
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import load_vessel
from tests.hybrid.diagnosis.linear_by_hand import a_ship, drawn

EDGES = 60 * np.arange(21)
FAR = 3
"""Standard errors that an estimate may be off by."""

CALM = DisturbanceNoise(
    position_m=0.05, heading_rad=0.002, surge_mps=0.03, sway_mps=0.015, yaw_rate_radps=0.0008,
    gust=(2e4, 1.5e4, 2e5), slow=(2e4, 3e4, 3e5), slow_s=25.0,
)  # fmt: skip
SWELL = replace(
    CALM, waves=(0.5, 0.35, 0.01), wave_correlation=0.5, wave_frequency_radps=1.0, wave_damping=0.2,
    wave_towards_rad=0.6,
)  # fmt: skip
SLOW_DRIFT = replace(SWELL, wave_drift_n=8e4, wave_drift_s=8.0, length_m=30.0)
SCALES = ("position_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps", "slow_s")
SWING = ("wave_frequency_radps", "wave_damping")
PUSH = ("wave_drift_n", "wave_drift_s")


def levels(noise: DisturbanceNoise) -> Floats:
    """What can be found: logarithms of levels and times; of waves also where they go and what they share."""
    scales = [*(getattr(noise, name) for name in SCALES), *noise.gust, *noise.slow]
    if not noise.has_waves:
        return np.log(scales)
    scales += [*noise.waves, *(getattr(noise, name) for name in SWING)]
    push = [getattr(noise, name) for name in PUSH] if noise.wave_drift_n else []
    return np.hstack([np.log(scales), np.arctanh(noise.wave_correlation), noise.wave_towards_rad, np.log(push)])


def with_levels(noise: DisturbanceNoise, at: Floats) -> DisturbanceNoise:
    """The inverse of :func:`levels`."""
    scales = [float(each) for each in np.exp(at)]
    named = dict(zip(SCALES, scales, strict=False))
    gust, slow = tuple(scales[6:9]), tuple(scales[9:12])
    plain = replace(noise, **named, gust=gust, slow=slow)  # type: ignore[arg-type]
    if not noise.has_waves:
        return plain
    swing = dict(zip(SWING, scales[15:17], strict=True))
    swing |= {"wave_correlation": float(np.tanh(at[17])), "wave_towards_rad": float(at[18])}
    push = dict(zip(PUSH, scales[19:], strict=True)) if noise.wave_drift_n else {}
    return replace(plain, waves=tuple(scales[12:15]), **swing, **push)  # type: ignore[arg-type]


def minus_log_likelihood(linear: LinearModel, data: Columns, noise: DisturbanceNoise) -> float:
    """Of the data, up to a constant: all of the innovations, however large."""
    z, spread = whiten(linear, data, noise, EDGES)
    return 0.5 * float((z**2).sum() + np.log(spread).sum())


def standard_errors(linear: LinearModel, data: Columns, noise: DisturbanceNoise) -> Floats:
    """From the expected information (Fisher): how whitened data and their spread hang on each level."""
    at, step, by_log, by_z = levels(noise), 1e-3, [], []
    for number in range(len(at)):
        ends = []
        for side in (1.0, -1.0):
            moved = at.copy()
            moved[number] += side * step
            z, spread = whiten(linear, data, with_levels(noise, moved), EDGES)
            ends.append((z.ravel(), np.log(spread).ravel()))
        by_z.append((ends[0][0] - ends[1][0]) / (2.0 * step))
        by_log.append((ends[0][1] - ends[1][1]) / (2.0 * step))
    slope, own = np.array(by_log), np.array(by_z)
    errors = own + 0.5 * whiten(linear, data, noise, EDGES)[0].ravel() * slope
    return np.sqrt(np.diag(np.linalg.inv(0.5 * slope @ slope.T + errors @ errors.T)))


@pytest.fixture(scope="module", params=[CALM, SWELL, SLOW_DRIFT], ids=["calm", "swell", "slow drift"])
def case(request: pytest.FixtureRequest) -> tuple[DisturbanceNoise, LinearModel, Columns, DisturbanceNoise]:
    """True levels, a system, data drawn from it, and the levels fitted to them from a start that is far off."""
    truth: DisturbanceNoise = request.param
    linear = a_ship(int(EDGES[-1]), 31)
    data = drawn(linear, truth, EDGES, 32)
    away = np.random.default_rng(33).uniform(-0.7, 0.7, len(levels(truth)))
    if truth.has_waves:
        away[15:] *= 0.4
    fitted, _ = fit_noise(linear, data, EDGES, with_levels(truth, levels(truth) + away), 25)
    return truth, linear, data, fitted


def test_every_level_is_found_within_its_error(
    case: tuple[DisturbanceNoise, LinearModel, Columns, DisturbanceNoise],
) -> None:
    truth, linear, data, fitted = case
    off = (levels(fitted) - levels(truth)) / standard_errors(linear, data, truth)
    assert np.abs(off).max() < FAR, dict(enumerate(off.round(1)))


def test_the_fit_is_likelier_than_the_truth_by_what_chance_brings(
    case: tuple[DisturbanceNoise, LinearModel, Columns, DisturbanceNoise],
) -> None:
    """Twice the gain in log likelihood is chi-square with as many degrees as there are levels (Wilks)."""
    truth, linear, data, fitted = case
    gain = 2.0 * (minus_log_likelihood(linear, data, truth) - minus_log_likelihood(linear, data, fitted))
    assert 0.0 < gain < chi2.ppf(0.9999, len(levels(truth)))


def test_a_few_outliers_do_not_pass_for_noise() -> None:
    linear = a_ship(600, 34)
    edges: NDArray[np.int64] = 60 * np.arange(11)
    data = drawn(linear, CALM, edges, 35)
    sound, _ = fit_noise(linear, data, edges, CALM, 15)
    data.readings[[140, 440], 2, 0] += 30.0 * CALM.heading_rad
    spoilt, _ = fit_noise(linear, data, edges, CALM, 15)
    assert spoilt.heading_rad == pytest.approx(sound.heading_rad, rel=0.25)  # a mean square would double it


def test_no_waves_stay_no_waves(case: tuple[DisturbanceNoise, LinearModel, Columns, DisturbanceNoise]) -> None:
    truth, *_, fitted = case
    assert fitted.has_waves == truth.has_waves


def test_slow_errors_of_sensors_are_found_where_there_are_any() -> None:
    """Which sensors err slowly, by how much and for how long; white noise passes for none of it."""
    truth = replace(CALM, drift=(0.1, 1e-9, 0.05, 1e-9, 0.002), drift_s=8.0)
    linear = a_ship(int(EDGES[-1]), 36)
    data = drawn(linear, truth, EDGES, 37)
    plain, cost = fit_noise(linear, data, EDGES, CALM, 12)
    start = start_of_drift(linear, data, EDGES, plain)
    fitted, less = fit_noise(linear, data, EDGES, start, 20)
    assert cost - less > 100.0
    for number in (0, 2, 4):
        assert fitted.drift[number] == pytest.approx(truth.drift[number], rel=0.2)
    assert fitted.drift_s == pytest.approx(truth.drift_s, rel=0.3)
    assert max(fitted.drift[1] / CALM.heading_rad, fitted.drift[3] / CALM.sway_mps) < 0.5


def test_slow_drift_of_the_waves_is_told_from_slow_forces_of_the_ship() -> None:
    """It pushes where the waves go, whatever her heading; without waves there is none."""
    linear = a_ship(int(EDGES[-1]), 38)
    data = drawn(linear, SLOW_DRIFT, EDGES, 39)
    plain, cost = fit_noise(linear, data, EDGES, replace(SWELL, length_m=SLOW_DRIFT.length_m), 12)
    fitted, less = fit_noise(linear, data, EDGES, start_of_wave_drift(plain), 20)
    assert cost - less > 20.0
    assert fitted.slow == pytest.approx(SLOW_DRIFT.slow, rel=0.3)
    assert fitted.wave_drift_n == pytest.approx(SLOW_DRIFT.wave_drift_n, rel=0.3)
    assert start_of_wave_drift(CALM) is CALM


def test_waves_without_slow_drift_pass_for_none() -> None:
    """Two more parameters gain what chance brings, less than their price."""
    linear, truth = a_ship(int(EDGES[-1]), 40), replace(SWELL, length_m=30.0)
    data = drawn(linear, truth, EDGES, 41)
    plain, cost = fit_noise(linear, data, EDGES, truth, 20)
    _, less = fit_noise(linear, data, EDGES, start_of_wave_drift(plain), 20)
    assert cost - less < 6.0


def test_white_noise_passes_for_no_slow_error(
    case: tuple[DisturbanceNoise, LinearModel, Columns, DisturbanceNoise],
) -> None:
    _, linear, data, fitted = case
    start = start_of_drift(linear, data, EDGES, fitted)
    assert not start.has_drift


def test_levels_are_found_at_half_a_hertz() -> None:
    """Every other second has no reading: what bounds the noise are differences of those that have one."""
    everything = CATALOGUE["ocean_current"], CATALOGUE["hull_fouling"]
    ship = model_of(load_vessel("gunnerus_short"), {each.name: each for each in everything})
    table, truth = simulate_trial("gunnerus_short", "calm", "voyage", 400.0, 0.5, 4)
    found = estimate_noise(linearise(log_of([table]), ship, 0.01), lambda share: None).noise
    assert found.position_m == pytest.approx(truth["noise"]["position_m"], rel=0.3)
    assert found.surge_mps == pytest.approx(truth["noise"]["speed_mps"], rel=0.3)
