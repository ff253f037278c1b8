"""The parameter vector of the adaptive calibrator, the plant and the observer's Kalman gains that follow from it.

The vector has the model's coefficients, steady forces, current, drift, wind and the observer's noise levels, each
as a deviation from the reference in units of its prior standard deviation: zero is the reference itself, and the
prior is a standard normal distribution.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from acquisition.core.actuators import Actuators
from acquisition.core.arrays import Complexes, Floats
from analysis.compiling import threads_for
from analysis.estimation.kalman_kernel import WIDTH, gain_sequence
from analysis.estimation.process_models import decay, oscillator
from hybrid.calibrators.adaptive.observer import TURN_RADPS, TURNS, observe_and_predict
from hybrid.prediction.prediction_windows import CONTROLS, WIND, PredictionWindows, difference_rad
from hybrid.vessel.actuators import KINDS, angle_columns
from hybrid.vessel.extra_forces import combine_forces
from hybrid.vessel.hulls import HULLS
from hybrid.vessel.plant import Form, Plant, flat, pack, places_of

_DIFFUSE = 10.0
WAVE_DAMPING = 0.1


def wave_step(wave_radps: float) -> Floats:
    """The transition of displacement and speed in waves over a second [2, 2]: a lightly damped oscillator."""
    return np.array(oscillator(1.0, wave_radps, WAVE_DAMPING)).reshape(2, 2)


def kalman_gains(
    speed_walk: float,
    force_walk: float,
    position_noise: float,
    kept_force: float,
    steps: int,
    wave_walk: float = 0.0,
    wave_radps: float = 1.0,
) -> Floats:
    """The gains [steps, 5, 2] of position, speed, force, and of displacement and speed in waves, on the innovations
    of position and speed, step by step.

    One axis, a second a step: position changes by the speed, the speed by a force (per mass) that wanders; the
    measurements swing in waves beside. All variances are in units of the measured speed's, [m/s]^2 (or [rad/s]^2):
    ``speed_walk``, ``force_walk`` and ``wave_walk`` by which speed, force and speed in waves wander in a second,
    ``position_noise`` of the measured position; ``kept_force`` is the share of the force that is left a second
    later. Kalman, A new approach to linear filtering (1960); Fossen, Handbook of marine craft hydrodynamics and
    motion control (2011), section 11.3, for the waves.
    """
    F, Q, P = np.zeros((3, 5, WIDTH))
    F[:3, :3] = [[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, kept_force]]
    F[3:, 3:5] = wave_step(wave_radps)
    H = np.array([[1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0]])
    swing = wave_walk / (4.0 * WAVE_DAMPING * wave_radps)
    each = np.arange(5)
    Q[each, each] = [0.0, speed_walk, force_walk, 0.0, wave_walk]
    P[each, each] = [position_noise, 1.0, _DIFFUSE * force_walk, swing / wave_radps**2, swing]
    return np.asarray(gain_sequence(F, Q, H, np.array([position_noise, 1.0]), P, steps))


_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd")
_WIND_AREAS = ("frontal_area_m2", "lateral_area_m2")
"""Force of the wind ahead and aside. R/V Gunnerus, whose hull is the polynomial, has hers from a wind tunnel."""


def positive_names(form: Form) -> tuple[str, ...]:
    """Numbers that keep their sign, as masses and damping must: adapted by factors, the others by shares."""
    kinds = dict.fromkeys(each.kind for each in form.actuators)
    damping = HULLS[form.hull].keeps_sign
    areas = () if form.hull == "polynomial" else _WIND_AREAS
    return (*_POSITIVE, *damping, *areas, *(name for kind in kinds for name in KINDS[kind].keeps_sign))


def signed_names(form: Form) -> tuple[str, ...]:
    """Numbers that may change their sign, each actuator's own among them."""
    hull = HULLS[form.hull]
    own = (f"{each.name}_{name}" for each in form.actuators for name in KINDS[each.kind].adapted)
    return (*(name for name in hull.numbers if name not in hull.keeps_sign), "Yrd", *own)


def parameter_names(form: Form) -> tuple[str, ...]:
    """The names of the vector's numbers: of the model of a ship of this form, and of what acts on her."""
    return (*positive_names(form), *signed_names(form), *SURROUNDED)


USUAL_SHARE = 0.5
"""A coefficient of another ship of the kind is off by half, more or less."""
STEADY = {"constant_X_n": 3000.0, "constant_Y_n": 3000.0, "constant_N_nm": 30000.0}
STEADY_MASS_KG = 4.0e5
"""The ship for which the usual steady forces above hold; they grow with the mass."""
CURRENT_MPS, WIND_MPS, DRIFT_N = 0.2, 3.0, 3000.0
SURROUNDINGS = ("current_north", "current_east", "drift_north", "drift_east", "wind_north", "wind_east")
AXES = ("surge", "sway", "yaw")
NOISE_LEVELS = tuple(f"{what}_{axis}" for axis in AXES for what in ("speed_walk", "force_walk", "position_noise"))
FORCE_DECAY = tuple(f"force_decay_{axis}" for axis in AXES)
LAG, LAG_S = "thruster_lag", 1.0
"""Thrusters that are recorded as ordered act later; a lag below zero means none."""
JITTER, JITTER_S = "stamp_jitter", 0.1
"""By how much headings are stamped too early or too late, now and then: noise that grows with the yaw rate."""
WAVES = ("wave_period", *(f"wave_walk_{axis}" for axis in AXES))
SURROUNDED = (*STEADY, *SURROUNDINGS, LAG, JITTER, *NOISE_LEVELS, *FORCE_DECAY, *WAVES)
"""The names of the vector's last numbers: what acts on any ship, and how closely she is followed."""
_PLACES = {name: number - len(SURROUNDED) for number, name in enumerate(SURROUNDED)}  # from the end

_WALKS = np.array([[-1.0, -2.5, 0.0], [-1.0, -2.5, 0.0], [-1.0, -2.5, 1.5]])  # powers of ten
_USUAL_POWER = 1.5
_FORCE_DECAY_S = 120.0
_WAVE_S, _USUAL_PERIOD = 6.0, 0.3
_WAVE_WALK = -1.0  # a power of ten
_OBSERVED_S = 30
_RATE_NOISE_RADPS = 1e-3  # of a usual gyro, in whose square the noise levels of yaw are
_AVERAGED_S = 5
_GUSTING_S, _GUSTS_APART_S, _GUST_BOUNDS_S = 3, 10, (2.0, 300.0)
LARGEST_FACTOR = 2.0


@dataclass(frozen=True, slots=True)
class Observations:
    """What the observer is given of N windows.

    ``past`` [N, P+1, channels] in the order of :class:`~hybrid.prediction.prediction_windows.PredictionWindows`,
    newest first, without gaps for ``known_s`` [N] seconds; ``control`` [N, H, controls] and ``wind`` [N, H, 2] that
    act from second 0.
    """

    past: Floats
    known_s: NDArray[np.int64]
    control: Floats
    wind: Floats

    def __len__(self) -> int:
        return len(self.past)


def observations_of(windows: PredictionWindows, gust_s: float | None = None) -> Observations:
    """The observations of windows, with their commands from second 0 and the wind that is to be expected.

    Without commands the mean of the last seconds in which the thrusters stood still is held. Without ``gust_s``
    the mean wind of the last seconds is; with it what is left of gusts dies away in that time
    (:func:`expected_wind`).
    """
    now = np.concatenate([windows.start, windows.wind, windows.control], axis=1)
    measured = windows.past.copy()
    measured[:, 0] = np.where(np.isfinite(measured[:, 0]), measured[:, 0], now)
    known_s = np.cumprod(np.isfinite(measured).all(axis=2), axis=1).sum(axis=1).astype(np.int64) - 1
    past = measured[:, : _OBSERVED_S + 1]
    control = windows.commands
    if control is None:
        control = np.repeat(_mean_control(past, windows.actuators)[:, None], windows.horizon_s, axis=1)
    wind = np.repeat(_mean_wind(past)[:, None], windows.horizon_s, axis=1)
    if gust_s is not None:
        wind = expected_wind(measured, gust_s, windows.horizon_s)
    past, control = np.ascontiguousarray(past), np.ascontiguousarray(control)
    return Observations(past, known_s.clip(0, _OBSERVED_S), control, wind)


def _mean_control(past: Floats, actuators: Actuators) -> Floats:
    """The controls at second 0 [N, controls], averaged over the seconds before in which they stood still."""
    recent, angles = past[:, :_AVERAGED_S, CONTROLS], angle_columns(actuators)
    most = np.array([most for each in actuators for most in KINDS[each.kind].still])
    off = recent - recent[:, :1]
    off[..., angles] = difference_rad(recent[..., angles], recent[:, :1, angles])
    still = np.cumprod((np.abs(off) < most).all(axis=2), axis=1)[..., None]
    return np.asarray(recent[:, 0] + (np.nan_to_num(off) * still).sum(axis=1) / still.sum(axis=1))


def _mean_wind(past: Floats) -> Floats:
    """The mean wind vector of the last seconds' finite ones, as direction [rad] and speed [m/s]: [N, 2]."""
    vector = _mean_vector(_wind_vectors(past)[:, :_AVERAGED_S])
    return np.column_stack([np.angle(vector), np.abs(vector)])


def expected_wind(past: Floats, gust_s: float, horizon_s: int) -> Floats:
    """The wind [N, H, 2] that follows what was measured: the mean of the ``past``, and what the last seconds differ
    by from it, dying away as exp(-t / ``gust_s``): the best forecast of gusts that are a first-order process.
    """
    vectors = _wind_vectors(past)
    mean, now = _mean_vector(vectors), _mean_vector(vectors[:, :_GUSTING_S])
    left = np.exp(-(np.arange(horizon_s) + 0.5) / gust_s)
    expected = mean[:, None] + (now - mean)[:, None] * left
    return np.ascontiguousarray(np.stack([np.angle(expected), np.abs(expected)], axis=-1))


def gust_decay_s(windows: PredictionWindows) -> float:
    """The time in which gusts die away, by how much alike the winds :data:`_GUSTS_APART_S` apart are [s].

    Winds are counted from the mean of their recording; the longest such time where it did not blow.
    """
    vectors = _wind_vectors(windows.past)
    for trial in np.unique(windows.trial):
        mine = windows.trial == trial
        vectors[mine] -= np.nan_to_num(np.nanmean(vectors[mine, 0]))
    now, then = vectors[:, 0], vectors[:, _GUSTS_APART_S]
    both = np.isfinite(now) & np.isfinite(then)
    power = 0.5 * (np.abs(now[both]) ** 2 + np.abs(then[both]) ** 2).sum()
    alike = float((now[both] * then[both].conj()).real.sum() / power) if power > 0.0 else 1.0
    bounds = np.exp(-_GUSTS_APART_S / np.array(_GUST_BOUNDS_S))
    return float(-_GUSTS_APART_S / np.log(np.clip(alike, *bounds)))


def _wind_vectors(past: Floats) -> Complexes:
    """The winds of the past as complex numbers, north and east [N, P+1]; NaN where they are not known."""
    direction, speed = np.moveaxis(past[..., WIND], -1, 0)
    return np.asarray(speed * np.exp(1j * direction))


def _mean_vector(vectors: Complexes) -> Complexes:
    """The mean of the finite ones [N], none where there is none."""
    known = np.isfinite(vectors)
    return np.asarray(np.where(known, vectors, 0.0).sum(axis=1) / known.sum(axis=1).clip(min=1))


def parameter(vector: Floats, name: str) -> float:
    """One number of the vector, by one of :data:`SURROUNDED`."""
    return float(vector[_PLACES[name]])


@lru_cache(maxsize=32)
def _adapted_numbers(form: Form) -> tuple[list[int], list[int], int]:
    """Where in a flat plant the vector's numbers stand, which of them it is, and how many keep their sign."""
    positive = positive_names(form)
    every = [
        (place, number)
        for number, name in enumerate((*positive, *signed_names(form)))
        for place in places_of(form, name)
    ]
    return [place for place, _ in every], [number for _, number in every], len(positive)


def adapt_plant(vector: Floats, plant: Plant) -> NDArray[np.void]:
    """The plant, packed [1], with coefficients, steady forces, current, drift and lag changed by the vector."""
    packed = pack(plant)
    places, numbers, kept = _adapted_numbers(plant.form)
    departed = USUAL_SHARE * vector[: -len(SURROUNDED)]
    factor = np.exp(departed[:kept].clip(-LARGEST_FACTOR, LARGEST_FACTOR))
    flat(packed)[0, places] *= np.concatenate([factor, 1.0 + departed[kept:]])[numbers]
    heavier = plant.mass_kg / STEADY_MASS_KG
    for name, usual in STEADY.items():
        packed[name] += heavier * usual * parameter(vector, name)
    packed["current_north_mps"] += CURRENT_MPS * parameter(vector, "current_north")
    packed["current_east_mps"] += CURRENT_MPS * parameter(vector, "current_east")
    packed["thruster_lag_s"] = max(0.0, plant.thruster_lag_s + LAG_S * parameter(vector, LAG))
    own = plant.drift_force_n
    north = own * plant.drift_north + heavier * DRIFT_N * parameter(vector, "drift_north")
    east = own * plant.drift_east + heavier * DRIFT_N * parameter(vector, "drift_east")
    size = np.hypot(north, east)
    packed["drift_force_n"] = size
    packed["drift_north"], packed["drift_east"] = (north / size, east / size) if size > 0.0 else (1.0, 0.0)
    return packed


def add_wind(vector: Floats, direction_rad: Floats, speed_mps: Floats) -> tuple[Floats, Floats]:
    """A measured wind with the vector's steady one added: direction it comes from [rad] and speed [m/s]."""
    north, east = WIND_MPS * parameter(vector, "wind_north"), WIND_MPS * parameter(vector, "wind_east")
    if north == 0.0 == east:
        return direction_rad, speed_mps
    vector_mps = speed_mps * np.exp(1j * direction_rad) + (north + 1j * east)
    return np.angle(vector_mps), np.abs(vector_mps)


def observer_gains(vector: Floats) -> tuple[Floats, Floats, Floats]:
    """The gains [turns, steps, 3 axes, 5, 2], the share of the force left a second later [3], and the step of waves
    [2, 2]."""
    return _gains(*(parameter(vector, name) for name in (JITTER, *NOISE_LEVELS, *FORCE_DECAY, *WAVES)))


@lru_cache(maxsize=64)
def _gains(jitter: float, *numbers: float) -> tuple[Floats, Floats, Floats]:
    """The gains of the vector's JITTER, NOISE_LEVELS, FORCE_DECAY and WAVES; remembered, as most steps do not
    change them.
    """
    powers, lasting, (period, *walks) = np.split(
        np.array(numbers), [len(NOISE_LEVELS), len(NOISE_LEVELS) + len(FORCE_DECAY)]
    )
    levels = 10.0 ** np.clip(_WALKS + _USUAL_POWER * powers.reshape(3, 3), -6.0, 4.0)
    wave_walks = 10.0 ** np.clip(_WAVE_WALK + _USUAL_POWER * np.array(walks), -6.0, 4.0)
    wave_radps = 2.0 * np.pi / (_WAVE_S * np.exp(np.clip(_USUAL_PERIOD * period, -0.9, 0.9)))
    kept = decay(1.0, _FORCE_DECAY_S * np.exp(lasting))
    stamped = (
        JITTER_S * np.exp(np.clip(jitter, -4.0, 4.0)) * TURN_RADPS * np.arange(TURNS) / _RATE_NOISE_RADPS
    ) ** 2
    noises = levels[:, 2:] + np.array([[0.0], [0.0], [1.0]]) * stamped
    gains = [
        [_axis_gains(speed, force, noise, left, wave, wave_radps) for noise in axis_noises]
        for (speed, force, _), axis_noises, left, wave in zip(levels, noises, kept, wave_walks, strict=True)
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(gains), 0, 2)), kept, wave_step(wave_radps)


@lru_cache(maxsize=256)
def _axis_gains(speed: float, force: float, noise: float, left: float, wave: float, wave_radps: float) -> Floats:
    """The gains of one axis; most steps change none of its numbers, and without turning three times the same."""
    return kalman_gains(speed, force, noise, left, _OBSERVED_S, wave, wave_radps)


def run_observer(vector: Floats, plant: Plant, observations: Observations) -> tuple[Floats, Floats]:
    """Run the observer of the adapted model along the observations of N windows, and the model on from second 0.

    Returns the states [N, H+1, 6] without the motion in waves, and that motion as north, east [m] and heading [rad]
    [N, H+1, 3].
    """
    gains, kept, wave = observer_gains(vector)
    past, wind = observations.past, observations.wind
    if parameter(vector, "wind_north") or parameter(vector, "wind_east"):
        past = past.copy()
        past[..., WIND] = np.stack(add_wind(vector, *np.moveaxis(past[..., WIND], -1, 0)), axis=-1)
        wind = np.stack(add_wind(vector, wind[..., 0], wind[..., 1]), axis=-1)
    plants = np.repeat(adapt_plant(vector, plant), len(observations))
    extra, parameters = combine_forces(plant)
    shape = len(observations), observations.control.shape[1] + 1
    states, waves = np.empty((*shape, 6)), np.empty((*shape, 3))
    known, control = observations.known_s, observations.control
    with threads_for(len(observations) * (past.shape[1] + control.shape[1])):
        observe_and_predict(plants, past, known, gains, kept, wave, control, wind, extra, parameters, states, waves)
    return states, waves
