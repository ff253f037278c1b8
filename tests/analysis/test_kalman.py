"""Textbook filter, batch least squares, filterpy and the kernel say the same; jumps, gaps, time in between."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, expm
from scipy.stats import chi2

from seatrial.analysis.estimation.kalman import Gate, Start, Steps, Track, predict_states, smooth_steps
from seatrial.analysis.estimation.kalman_kernel import WIDTH, predict_covariance
from seatrial.analysis.estimation.process_models import Law, ProcessModel, WaveMotion, WhiteJerk, decay, oscillator

WIDE = Gate(limit=np.inf)
START = Start(np.zeros(9), np.diag([100.0, 10.0, 1.0] * 3))
SLOW, SLOW_AND_WAVES = (WhiteJerk(0.1),), (WhiteJerk(0.1), WaveMotion(0.3, 1.2, 0.1))


def north_steps(time_s: np.ndarray, values: np.ndarray, sigmas: tuple[float, float]) -> Steps:
    """Position and speed north [steps, 2] at some times, NaN where there is none."""
    row, jumps = np.zeros((time_s.size, 2, 9)), np.zeros((2, 9), dtype=bool)
    row[:, 0, 3] = row[:, 1, 4] = 1.0
    jumps[0, 3] = jumps[1, 4] = True
    variance = np.broadcast_to(np.square(sigmas), values.shape).copy()
    return Steps(time_s, values, row, variance, np.zeros(2), jumps)


def smoothed(steps: Steps, laws: tuple[Law, ...], gate: Gate, engine: str = "compiled") -> Track:
    model = ProcessModel((1,) * len(laws), laws)
    return smooth_steps(steps.for_model(model), START.for_model(model), model, gate, engine)  # type: ignore[arg-type]


def irregular(seed: int, count: int = 60) -> Steps:
    random = np.random.default_rng(seed)
    time_s = np.cumsum(random.uniform(0.05, 1.5, count))
    values = np.stack([np.sin(time_s / 9.0) * 20.0, np.cos(time_s / 9.0) * 20.0 / 9.0], axis=1)
    values += random.standard_normal(values.shape) * (0.3, 0.05)
    values[random.uniform(size=values.shape) < 0.3] = np.nan
    return north_steps(time_s, values, (0.3, 0.05))


def textbook(
    steps: Steps, start: Start, model: ProcessModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Filter and smoother as in any textbook, all values of a step at once, in the inverses' plain form."""
    mean, covariance, passed = start.mean, start.covariance, []
    gaps = np.diff(steps.time_s, prepend=steps.time_s[:1])
    forward, added = model.transition(gaps), model.process_noise(gaps)
    for k in range(steps.time_s.size):
        prior = forward[k] @ mean, forward[k] @ covariance @ forward[k].T + added[k]
        there = np.isfinite(steps.value[k])
        h, r = steps.row[k][there], np.diag(steps.variance[k][there])
        gain = prior[1] @ h.T @ np.linalg.inv(h @ prior[1] @ h.T + r)
        mean = prior[0] + gain @ (steps.value[k][there] - h @ prior[0])
        covariance = (np.eye(mean.size) - gain @ h) @ prior[1]
        passed.append((*prior, mean, covariance))
    means, covariances = [mean], [covariance]
    for k in range(steps.time_s.size - 2, -1, -1):
        gain = passed[k][3] @ forward[k + 1].T @ np.linalg.inv(passed[k + 1][1])
        means.append(passed[k][2] + gain @ (means[-1] - passed[k + 1][0]))
        covariances.append(passed[k][3] + gain @ (covariances[-1] - passed[k + 1][1]) @ gain.T)
    filtered = np.array([each[2] for each in passed]), np.array([each[3] for each in passed])
    return *filtered, np.array(means[::-1]), np.array(covariances[::-1])


@pytest.mark.parametrize("engine", ["filterpy", "compiled"])
@pytest.mark.parametrize("laws", [SLOW, SLOW_AND_WAVES])
def test_both_engines_are_the_textbook_filter(laws: tuple[Law, ...], engine: str) -> None:
    steps, model = irregular(1), ProcessModel((1,) * len(laws), laws)
    track = smoothed(steps, laws, WIDE, engine)
    expected = textbook(steps.for_model(model), START.for_model(model), model)
    found = (track.filtered.mean, track.filtered.covariance, track.mean, track.covariance)
    for own, book in zip(found, expected, strict=True):
        assert own == pytest.approx(book, rel=1e-6, abs=1e-7)


def test_rounding_leaves_the_covariance_symmetric() -> None:
    """Else it drifts apart where sensors are exact, until variances are negative and speeds run away."""
    random = np.random.default_rng(5)
    P, Q, work = (np.zeros((9, WIDTH)) for _ in range(3))
    root = random.standard_normal((9, 9)) * 10.0 ** random.uniform(-6.0, 2.0, 9)
    F, P[:, :9] = np.eye(9) + 0.1 * random.standard_normal((9, 9)), root.T @ root
    for _ in range(20):
        predict_covariance(F, Q, P, work)
        assert (P[:, :9] == P[:, :9].T).all()


def test_both_engines_judge_alike() -> None:
    """With outliers and a jump of the truth every number is the same, and every refusal."""
    steps = irregular(2, 120)
    steps.value[20, 0], steps.value[40:44, 1] = 500.0, 9.0
    steps.value[80:, 0] += 60.0
    first, second = (smoothed(steps, SLOW_AND_WAVES, Gate(), engine) for engine in ("filterpy", "compiled"))
    assert np.array_equal(first.filtered.refused, second.filtered.refused)
    assert first.filtered.refused[20, 0]
    assert second.mean == pytest.approx(first.mean, rel=1e-6, abs=1e-6)
    assert second.covariance == pytest.approx(first.covariance, rel=1e-5, abs=1e-7)


def test_a_jump_of_the_truth_is_believed_after_a_while_and_an_outlier_never() -> None:
    time_s = np.arange(0.0, 100.0, 0.5)
    values = np.full((time_s.size, 2), np.nan)
    values[:, 0] = np.where(time_s < 50.0, 0.0, 40.0) + 0.1 * np.random.default_rng(0).standard_normal(200)
    values[40, 0] = 70.0
    track = smoothed(north_steps(time_s, values, (0.1, 0.1)), SLOW, Gate())
    refused = track.filtered.refused[:, 0]
    assert refused[40]
    assert 5 <= refused[100:].sum() <= 15
    assert refused.sum() == refused[100:].sum() + 1
    assert track.mean[130:, 0] == pytest.approx(40.0, abs=0.3)
    assert np.abs(track.mean[:95, 0]).max() < 0.3


@given(
    speed=st.floats(0.01, 2.0),
    frequency=st.floats(0.3, 3.0),
    damping=st.floats(0.02, 0.6),
    first=st.floats(0.0, 5.0),
    second=st.floats(0.0, 5.0),
)
@settings(max_examples=40, deadline=None)
def test_a_law_over_two_times_is_the_law_over_their_sum(
    speed: float, frequency: float, damping: float, first: float, second: float
) -> None:
    """Chapman and Kolmogorov, for both laws; and a swing stays as large as it is."""
    for law in (WhiteJerk(speed), WaveMotion(speed, frequency, damping)):
        forward, added = law.discretise(np.array([first, second, first + second]))
        assert forward[1] @ forward[0] == pytest.approx(forward[2], rel=1e-7, abs=1e-8)
        both = forward[1] @ added[0] @ forward[1].T + added[1]
        assert both == pytest.approx(added[2], rel=1e-7, abs=1e-9 * max(1.0, float(np.abs(added[2]).max())))
    stationary = WaveMotion(speed, frequency, damping).covariance
    assert stationary[1, 1] == pytest.approx(speed**2)
    assert np.linalg.eigvalsh(stationary).min() > 0.0


def test_between_two_steps_the_state_is_that_of_a_step_without_values() -> None:
    steps, time_s = irregular(3), 0.0
    track = smoothed(steps, SLOW_AND_WAVES, WIDE)
    time_s = 0.3 * steps.time_s[20] + 0.7 * steps.time_s[21]
    more = north_steps(np.insert(steps.time_s, 21, time_s), np.insert(steps.value, 21, np.nan, axis=0), (0.3, 0.05))
    expected = smoothed(more, SLOW_AND_WAVES, WIDE)
    mean, covariance = track.interpolate_states(np.array([time_s, steps.time_s[21]]))
    assert mean == pytest.approx(expected.mean[21:23], rel=1e-6, abs=1e-8)
    assert covariance == pytest.approx(expected.covariance[21:23], rel=1e-6, abs=1e-8)


def test_beyond_the_last_step_the_covariance_grows() -> None:
    track = smoothed(irregular(4), SLOW, WIDE)
    ahead = track.time_s[-1] + np.array([0.0, 1.0, 5.0, 20.0])
    variance = track.interpolate_states(ahead)[1][:, 0, 0]
    assert np.all(np.diff(variance) > 0)
    last = track.filtered.mean[-1:], track.filtered.covariance[-1:]
    assert track.interpolate_states(ahead[2:3])[0] == pytest.approx(
        predict_states(*last, np.array([5.0]), track.model)[0]
    )


def batch_least_squares(steps: Steps, start: Start, model: ProcessModel) -> tuple[np.ndarray, np.ndarray]:
    """All states at once, the least squares of prior, process noise and measurements: means and covariances."""
    count, n = steps.time_s.size, start.mean.size
    gaps = np.diff(steps.time_s)
    forward, added = model.transition(gaps), model.process_noise(gaps)
    motion = np.eye(count * n)
    for k in range(1, count):
        motion[k * n : (k + 1) * n, (k - 1) * n : k * n] = -forward[k - 1]
    weight = block_diag(*(np.linalg.inv(each) for each in (start.covariance, *added)))
    information = motion.T @ weight @ motion
    right = motion.T @ weight @ np.concatenate([start.mean, np.zeros((count - 1) * n)])
    for k, c in np.argwhere(np.isfinite(steps.value)):
        row = np.zeros(count * n)
        row[k * n : (k + 1) * n] = steps.row[k, c]
        information += np.outer(row, row) / steps.variance[k, c]
        right += row * steps.value[k, c] / steps.variance[k, c]
    covariance = np.linalg.inv(information)
    own = np.stack([covariance[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(count)])
    return (covariance @ right).reshape(count, n), own


@pytest.mark.parametrize("engine", ["filterpy", "compiled"])
def test_the_smoother_is_the_batch_least_squares_solution(engine: str) -> None:
    steps, model = irregular(5, 25), ProcessModel((1,), SLOW)
    own, start = steps.for_model(model), START.for_model(model)
    mean, covariance = batch_least_squares(own, start, model)
    track = smoothed(steps, SLOW, WIDE, engine)
    assert track.mean == pytest.approx(mean, rel=1e-6, abs=1e-6)
    assert track.covariance == pytest.approx(covariance, rel=1e-5, abs=1e-8)


def test_innovations_of_data_from_the_model_itself_are_white_and_of_unit_variance() -> None:
    random, time_s, model = np.random.default_rng(6), np.arange(2000) * 0.7, ProcessModel((1, 1), SLOW_AND_WAVES)
    start = START.for_model(model)
    step, root = model.transition(np.array([0.7]))[0], np.linalg.cholesky(model.process_noise(np.array([0.7]))[0])
    state, values = np.linalg.cholesky(start.covariance) @ random.standard_normal(start.mean.size), []
    for _ in time_s:
        values.append((model.summing_matrix @ state)[[3, 4]] + random.standard_normal(2) * (0.3, 0.05))
        state = step @ state + root @ random.standard_normal(state.size)
    filtered = smoothed(north_steps(time_s, np.array(values), (0.3, 0.05)), SLOW_AND_WAVES, WIDE).filtered
    ratio = filtered.innovation / filtered.deviation
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], ratio.size)
    assert low < (ratio**2).sum() < high
    assert np.abs(ratio[1:].T @ ratio[:-1] / np.sqrt(len(ratio))).max() < 4.5


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_the_order_of_channels_does_not_matter(seed: int) -> None:
    """One after another they say what they say together."""
    steps = irregular(seed, 30)
    other = Steps(
        steps.time_s, steps.value[:, ::-1].copy(), steps.row[:, ::-1].copy(), steps.variance[:, ::-1].copy(),
        steps.turn, steps.jumps[::-1].copy(),
    )  # fmt: skip
    first, second = (smoothed(each, SLOW_AND_WAVES, WIDE) for each in (steps, other))
    assert second.mean == pytest.approx(first.mean, rel=1e-6, abs=1e-6)
    assert second.covariance == pytest.approx(first.covariance, rel=1e-5, abs=1e-7)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_what_comes_later_makes_no_state_less_certain(seed: int) -> None:
    track = smoothed(irregular(seed, 30), SLOW_AND_WAVES, WIDE)
    gained = track.filtered.covariance - track.covariance
    scale = np.sqrt(np.einsum("kii->ki", track.filtered.covariance))
    assert np.linalg.eigvalsh(gained / (scale[:, :, None] * scale[:, None])).min() > -1e-6


@given(dt_s=st.floats(0.01, 5.0), frequency=st.floats(0.3, 3.0), damping=st.floats(0.02, 0.9))
@settings(max_examples=40, deadline=None)
def test_the_oscillator_is_the_wave_without_a_low_pass_and_keeps_its_variances(
    dt_s: float, frequency: float, damping: float
) -> None:
    step = np.array(oscillator(dt_s, frequency, damping)).reshape(2, 2)
    exact = expm(dt_s * np.array([[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]]))
    assert step == pytest.approx(exact, rel=1e-8, abs=1e-10)
    stationary = np.diag([1.0, frequency**2])
    assert np.linalg.eigvalsh(stationary - step @ stationary @ step.T).min() > -1e-12
    (swing,), _ = WaveMotion(0.4, frequency, damping, order=0).discretise(np.array([dt_s]))
    assert swing == pytest.approx(step, rel=1e-8, abs=1e-10)
    assert decay(dt_s, 7.0) * decay(2.0, 7.0) == pytest.approx(decay(dt_s + 2.0, 7.0))
