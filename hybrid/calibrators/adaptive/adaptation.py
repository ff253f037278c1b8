"""The parameter vector of the adaptive calibrator, and the plant and observer gains that follow from it.

The vector has the model's coefficients, steady forces, current, drift, wind and the observer's noise levels,
each as a deviation from the reference in units of its prior standard deviation: zero is the reference, and the
prior is a standard normal distribution.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Complexes, Floats
from seatrial.acquisition.core.ship import Actuators
from seatrial.hybrid.prediction.kalman_filter import (
    AXES,
    FILTER_NUMBERS,
    OBSERVED_S,
    Observations,
    filter_gains,
    measured_past,
    run_filter,
)
from seatrial.hybrid.prediction.prediction_windows import CONTROLS, WIND, PredictionWindows, difference_rad
from seatrial.hybrid.vessel.actuators import KINDS, angle_columns
from seatrial.hybrid.vessel.hulls import HULLS
from seatrial.hybrid.vessel.plant import Form, Plant, flat, pack, places_of

_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd")
_WIND_AREAS = ("frontal_area_m2", "lateral_area_m2")
"""Wind force coefficients in surge and sway. R/V Gunnerus, whose hull model is the polynomial, has hers from a
wind tunnel."""


def positive_names(form: Form) -> tuple[str, ...]:
    """Coefficients that keep their sign, as masses and damping must: adapted by factors, the others by shares."""
    kinds = dict.fromkeys(actuator.kind for actuator in form.actuators)
    damping = HULLS[form.hull].keeps_sign
    areas = () if form.hull == "polynomial" else _WIND_AREAS
    return (*_POSITIVE, *damping, *areas, *(name for kind in kinds for name in KINDS[kind].keeps_sign))


def signed_names(form: Form) -> tuple[str, ...]:
    """Coefficients that may change sign, including each actuator's own."""
    hull = HULLS[form.hull]
    adapted = (f"{actuator.name}_{name}" for actuator in form.actuators for name in KINDS[actuator.kind].adapted)
    return (*(name for name in hull.numbers if name not in hull.keeps_sign), "Yrd", *adapted)


def parameter_names(form: Form) -> tuple[str, ...]:
    """The names of the vector's parameters: of the model of a ship of this form, and of her environment."""
    return (*positive_names(form), *signed_names(form), *SURROUNDED)


USUAL_SHARE = 0.5
"""The prior relative standard deviation of a coefficient, as between ships of a kind."""
STEADY = {"constant_X_n": 3000.0, "constant_Y_n": 3000.0, "constant_N_nm": 30000.0}
STEADY_MASS_KG = 4.0e5
"""The mass for which the steady forces above hold; they scale with mass."""
CURRENT_MPS, WIND_MPS, DRIFT_N = 0.2, 3.0, 3000.0
SURROUNDINGS = ("current_north", "current_east", "drift_north", "drift_east", "wind_north", "wind_east")
LAG, LAG_S = "thruster_lag", 1.0
"""The prior of the thrusters' lag when commands are recorded; negative values mean none."""
SURROUNDED = (*STEADY, *SURROUNDINGS, LAG, *FILTER_NUMBERS)
"""The names of the vector's last parameters: the environment of any ship, and the observer's noise levels."""
_PLACES = {name: number - len(SURROUNDED) for number, name in enumerate(SURROUNDED)}  # from the end

_AVERAGED_S = 5
_MEAN_WIND_S = 60
_GUSTING_S, _GUSTS_APART_S, _GUST_BOUNDS_S = 3, 10, (2.0, 300.0)
LARGEST_FACTOR = 2.0


def observations_of(windows: PredictionWindows, gust_s: float | None = None) -> Observations:
    """The observations of windows, with their commands from second 0 and the expected wind.

    Without commands the mean control over the last steady seconds is held. Without ``gust_s`` the mean wind of
    the last seconds is held; with it gusts decay with that time constant (:func:`expected_wind`).
    """
    measured, known_s = measured_past(windows, _MEAN_WIND_S)
    past = measured[:, : OBSERVED_S + 1]
    control = windows.commands
    if control is None:
        control = np.repeat(_mean_control(past, windows.actuators)[:, None], windows.horizon_s, axis=1)
    if gust_s is None:
        mean = _mean_vector(_wind_vectors(past)[:, :_AVERAGED_S])
        wind = np.repeat(np.column_stack([np.angle(mean), np.abs(mean)])[:, None], windows.horizon_s, axis=1)
    else:
        wind = expected_wind(measured, gust_s, windows.horizon_s)
    past, control = np.ascontiguousarray(past), np.ascontiguousarray(control)
    return Observations(past, known_s.clip(max=OBSERVED_S), control, wind)


def _mean_control(past: Floats, actuators: Actuators) -> Floats:
    """The controls at second 0 [N, controls], averaged over the preceding seconds in which they were steady."""
    recent, angles = past[:, :_AVERAGED_S, CONTROLS], angle_columns(actuators)
    most = np.array([most for actuator in actuators for most in KINDS[actuator.kind].still])
    deviation = recent - recent[:, :1]
    deviation[..., angles] = difference_rad(recent[..., angles], recent[:, :1, angles])
    still = np.cumprod((np.abs(deviation) < most).all(axis=2), axis=1)[..., None]
    return np.asarray(recent[:, 0] + (np.nan_to_num(deviation) * still).sum(axis=1) / still.sum(axis=1))


def expected_wind(past: Floats, gust_s: float, horizon_s: int) -> Floats:
    """The expected wind [N, H, 2]: the mean of the ``past``, plus the deviation of the last seconds decaying as
    exp(-t / ``gust_s``), the optimal forecast of gusts as a first-order process."""
    vectors = _wind_vectors(past)
    mean, now = _mean_vector(vectors), _mean_vector(vectors[:, :_GUSTING_S])
    decay = np.exp(-(np.arange(horizon_s) + 0.5) / gust_s)
    expected = mean[:, None] + (now - mean)[:, None] * decay
    return np.ascontiguousarray(np.stack([np.angle(expected), np.abs(expected)], axis=-1))


def gust_decay_s(windows: PredictionWindows) -> float:
    """The decay time of gusts [s], from the correlation of winds :data:`_GUSTS_APART_S` apart.

    Winds are relative to the mean of their recording; the longest such time if there was no wind.
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
    """The winds of the past as complex numbers, north and east [N, P+1]; NaN where unknown."""
    direction, speed = np.moveaxis(past[..., WIND], -1, 0)
    return np.asarray(speed * np.exp(1j * direction))


def _mean_vector(vectors: Complexes) -> Complexes:
    """The mean of the finite vectors [N], zero if there are none."""
    finite = np.isfinite(vectors)
    return np.asarray(np.where(finite, vectors, 0.0).sum(axis=1) / finite.sum(axis=1).clip(min=1))


def parameter(vector: Floats, name: str) -> float:
    """One parameter of the vector, by one of :data:`SURROUNDED`."""
    return float(vector[_PLACES[name]])


@lru_cache(maxsize=32)
def _adapted_numbers(form: Form) -> tuple[list[int], list[int], int]:
    """The positions of the vector's parameters in a flat plant, their indices, and the number that keep their
    sign."""
    positive = positive_names(form)
    pairs = [
        (place, number)
        for number, name in enumerate((*positive, *signed_names(form)))
        for place in places_of(form, name)
    ]
    return [place for place, _ in pairs], [number for _, number in pairs], len(positive)


def adapt_plant(vector: Floats, plant: Plant) -> NDArray[np.void]:
    """The plant, packed [1], with coefficients, steady forces, current, drift and lag changed by the vector.

    Recent results are cached, since one prediction needs each member's several times.
    """
    return _adapt_plant(vector.tobytes(), plant)


@lru_cache(maxsize=32)
def _adapt_plant(stored: bytes, plant: Plant) -> NDArray[np.void]:
    vector = np.frombuffer(stored)
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
    drift_n = plant.drift_force_n
    north = drift_n * plant.drift_north + heavier * DRIFT_N * parameter(vector, "drift_north")
    east = drift_n * plant.drift_east + heavier * DRIFT_N * parameter(vector, "drift_east")
    size = np.hypot(north, east)
    packed["drift_force_n"] = size
    packed["drift_north"], packed["drift_east"] = (north / size, east / size) if size > 0.0 else (1.0, 0.0)
    packed.setflags(write=False)
    return packed


def add_wind(vector: Floats, direction_rad: Floats, speed_mps: Floats) -> tuple[Floats, Floats]:
    """A measured wind plus the vector's steady one: direction it comes from [rad] and speed [m/s]."""
    north, east = WIND_MPS * parameter(vector, "wind_north"), WIND_MPS * parameter(vector, "wind_east")
    if north == 0.0 == east:
        return direction_rad, speed_mps
    vector_mps = speed_mps * np.exp(1j * direction_rad) + (north + 1j * east)
    return np.angle(vector_mps), np.abs(vector_mps)


def observer_gains(vector: Floats) -> tuple[Floats, Floats, Floats]:
    """The observer's gains for a vector, as :func:`.filter_gains`."""
    return filter_gains(*(parameter(vector, name) for name in FILTER_NUMBERS))


def follow_closer(vector: Floats, deviations: float) -> Floats:
    """The vector with the process noise of the bias force raised by this number of prior standard deviations in
    each axis."""
    closer = vector.copy()
    closer[[_PLACES[f"force_walk_{axis}"] for axis in AXES]] += deviations
    return closer


def run_observer(vector: Floats, plant: Plant, observations: Observations) -> tuple[Floats, Floats]:
    """Run the adapted model as a filter along the observations of N windows, and freely from second 0.

    Returns the states [N, H+1, 6] and the wave motion [N, H+1, 3], as :func:`.run_filter`.
    """
    if parameter(vector, "wind_north") or parameter(vector, "wind_east"):
        past, wind = observations.past.copy(), observations.wind
        past[..., WIND] = np.stack(add_wind(vector, *np.moveaxis(past[..., WIND], -1, 0)), axis=-1)
        wind = np.stack(add_wind(vector, wind[..., 0], wind[..., 1]), axis=-1)
        observations = replace(observations, past=past, wind=wind)
    return run_filter(adapt_plant(vector, plant), plant, observer_gains(vector), observations)
