"""The parameter vector of the adaptive calibrator: what it changes of a model, and by how much.

Without it the calibrator could adapt nothing. Of a vessel file it adapts the coefficients, of a simulator of
another make what acts on it from outside (:mod:`~seatrial.hybrid.vessel.outside`): gains of its drives, and drag
and steady pushes per mass. Both have current, wind, the thrusters' lag and the observer's noise levels. Each
parameter is a deviation from the reference in units of its prior standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.hybrid.prediction import kalman_filter
from seatrial.hybrid.vessel import hulls
from seatrial.hybrid.vessel.actuators import KINDS
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
from seatrial.hybrid.vessel.effect import USUAL_LENGTH_M
from seatrial.hybrid.vessel.outside import DRAG, assumed_inertia
from seatrial.hybrid.vessel.plant import Form, Plant, flat_numbers, number_places, pack

_POSITIVE = ("mass_kg", "yaw_inertia_kgm2", "Xud", "Yvd", "Nrd")
_WIND_AREAS = ("frontal_area_m2", "lateral_area_m2")
"""Wind force coefficients in surge and sway. R/V Gunnerus, whose hull model is the polynomial, has its own from a
wind tunnel."""


def positive_coefficient_names(form: Form) -> tuple[str, ...]:
    """Coefficients that keep their sign, as masses and damping must: adapted by factors, the others by shares."""
    kinds = dict.fromkeys(actuator.kind for actuator in form.actuators)
    damping = hulls.HULLS[form.hull].keeps_sign
    areas = () if form.hull == "polynomial" else _WIND_AREAS
    return (*_POSITIVE, *damping, *areas, *(name for kind in kinds for name in KINDS[kind].keeps_sign))


def signed_coefficient_names(form: Form) -> tuple[str, ...]:
    """Coefficients that may change sign, including each actuator's own."""
    hull = hulls.HULLS[form.hull]
    adapted = (f"{actuator.name}_{name}" for actuator in form.actuators for name in KINDS[actuator.kind].adapted)
    return (*(name for name in hull.numbers if name not in hull.keeps_sign), "Yrd", *adapted)


def parameter_names(form: Form | BlackBox) -> tuple[str, ...]:
    """The names of the vector's parameters: of the model of a ship of this form or of a simulator, and of its
    environment."""
    if isinstance(form, BlackBox):
        return (*drive_gains(form), *DRAG, *SURROUNDED)
    return (*positive_coefficient_names(form), *signed_coefficient_names(form), *SURROUNDED)


def form_of(model: MotionModel) -> Form | BlackBox:
    """What the names of a model's parameters depend on."""
    return model if isinstance(model, BlackBox) else model.form


def sign_keeping_shares(form: Form | BlackBox) -> dict[str, float]:
    """The parameters that are factors, with the prior standard deviation of their logarithm."""
    if isinstance(form, BlackBox):
        return drive_gains(form)
    return dict.fromkeys(positive_coefficient_names(form), USUAL_SHARE)


def drive_gains(model: BlackBox) -> dict[str, float]:
    """The gains of a simulator's drives, with the prior standard deviation of their logarithm.

    The share of a coefficient, as for rudders; half of it for shafts and pitch, the square of which gives thrust.
    The angle of an azimuth thruster is where its force points and has none.
    """
    return {
        f"{actuator.name}_{label}_scale": USUAL_SHARE if is_angle else 0.5 * USUAL_SHARE
        for actuator in model.layout
        for label, is_angle in zip(KINDS[actuator.kind].labels, KINDS[actuator.kind].angles, strict=True)
        if (actuator.kind, label) != ("azimuth", "angle")
    }


USUAL_SHARE = 0.5
"""The prior relative standard deviation of a coefficient, as between ships of a kind."""
_USUAL_DRAG_PM = (2e-3, 5e-2, 5e-2)
"""The prior standard deviation of a simulator's drag in surge, sway and yaw [1/m] at the usual length: half of R/V
Gunnerus' resistance and yaw damping (docs/own_simulator.md), and of a cross flow with a drag coefficient of one."""
STEADY = {"constant_X_n": 3000.0, "constant_Y_n": 3000.0, "constant_N_nm": 30000.0}
STEADY_MASS_KG = 4.0e5
"""The mass for which the steady forces above hold; they scale with mass."""
CURRENT_MPS, WIND_MPS, DRIFT_N = 0.2, 3.0, 3000.0
SURROUNDINGS = ("current_north", "current_east", "drift_north", "drift_east", "wind_north", "wind_east")
LAG, LAG_S = "thruster_lag", 1.0
"""The prior of the thrusters' lag when commands are recorded; negative values mean none."""
SURROUNDED = (*STEADY, *SURROUNDINGS, LAG, *kalman_filter.FILTER_NUMBERS)
"""The names of the vector's last parameters: the environment of any ship, and the observer's noise levels."""
PLACES = {name: number - len(SURROUNDED) for number, name in enumerate(SURROUNDED)}
"""Their positions, from the vector's end."""
LARGEST_FACTOR = 2.0


def parameter_value(vector: Floats, name: str) -> float:
    """One parameter of the vector, by one of :data:`SURROUNDED`."""
    return float(vector[PLACES[name]])


@lru_cache(maxsize=32)
def _positions_of_adapted_numbers(form: Form) -> tuple[list[int], list[int], int]:
    """The positions of the vector's parameters in a flat plant, their indices, and the number that keep their
    sign."""
    positive = positive_coefficient_names(form)
    pairs = [
        (place, number)
        for number, name in enumerate((*positive, *signed_coefficient_names(form)))
        for place in number_places(form, name)
    ]
    return [place for place, _ in pairs], [number for _, number in pairs], len(positive)


def adapt_plant(vector: Floats, plant: Plant) -> NDArray[np.void]:
    """The plant, packed [1], with coefficients, steady forces, current, drift and lag changed by the vector.

    Recent results are cached, since one prediction needs each member's several times.
    """
    return _adapt_plant_cached(vector.tobytes(), plant)


@lru_cache(maxsize=32)
def _adapt_plant_cached(stored: bytes, plant: Plant) -> NDArray[np.void]:
    vector = np.frombuffer(stored)
    packed = pack(plant)
    places, numbers, kept = _positions_of_adapted_numbers(plant.form)
    departed = USUAL_SHARE * vector[: -len(SURROUNDED)]
    factor = np.exp(departed[:kept].clip(-LARGEST_FACTOR, LARGEST_FACTOR))
    flat_numbers(packed)[0, places] *= np.concatenate([factor, 1.0 + departed[kept:]])[numbers]
    heavier = plant.mass_kg / STEADY_MASS_KG
    for name, usual in STEADY.items():
        packed[name] += heavier * usual * parameter_value(vector, name)
    packed["current_north_mps"] += CURRENT_MPS * parameter_value(vector, "current_north")
    packed["current_east_mps"] += CURRENT_MPS * parameter_value(vector, "current_east")
    packed["thruster_lag_s"] = max(0.0, plant.thruster_lag_s + LAG_S * parameter_value(vector, LAG))
    drift_n = plant.drift_force_n
    north = drift_n * plant.drift_north + heavier * DRIFT_N * parameter_value(vector, "drift_north")
    east = drift_n * plant.drift_east + heavier * DRIFT_N * parameter_value(vector, "drift_east")
    size = np.hypot(north, east)
    packed["drift_force_n"] = size
    packed["drift_north"], packed["drift_east"] = (north / size, east / size) if size > 0.0 else (1.0, 0.0)
    packed.setflags(write=False)
    return packed


def adapt_simulator(vector: Floats, model: BlackBox) -> BlackBox:
    """The simulator with gains, drag, steady pushes, current and lag changed by the vector."""
    units = parameter_units_and_conversions(model)
    value = {
        name: units[name][2](deviation)
        for name, deviation in zip(parameter_names(model), vector, strict=True)
        if name in units
    }
    gains = {name: model.number(name) * value[name] for name in drive_gains(model)}
    return model.replaced(
        **gains, **{name: value[name] for name in (*DRAG, *STEADY)}, current_north_mps=value["current_north"],
        current_east_mps=value["current_east"], thruster_lag_s=value[LAG],
    )  # fmt: skip


def add_steady_wind(vector: Floats, direction_rad: Floats, speed_mps: Floats) -> tuple[Floats, Floats]:
    """A measured wind plus the vector's steady one: direction it comes from [rad] and speed [m/s]."""
    north, east = WIND_MPS * parameter_value(vector, "wind_north"), WIND_MPS * parameter_value(vector, "wind_east")
    if north == 0.0 == east:
        return direction_rad, speed_mps
    vector_mps = speed_mps * np.exp(1j * direction_rad) + (north + 1j * east)
    return np.angle(vector_mps), np.abs(vector_mps)


def observer_gains(vector: Floats, model: MotionModel) -> kalman_filter.Gains:
    """The observer's gains for a vector, as :func:`.filter_gains`."""
    numbers = (parameter_value(vector, name) for name in kalman_filter.FILTER_NUMBERS)
    return kalman_filter.filter_gains(model.length_overall_m, *numbers)


ValueOfDeviation = Callable[[float], float]


def parameter_units_and_conversions(model: MotionModel) -> dict[str, tuple[str, float, ValueOfDeviation]]:
    """Unit, the reference model's value and the conversion from deviation to value, for each parameter of ship
    and environment. Wind is relative to the measured one; forces on a simulator are those on an assumed mass."""

    def additive_conversion(model_value: float, usual_deviation: float) -> ValueOfDeviation:
        return lambda z: model_value + usual_deviation * z

    def factor_conversion(share: float) -> ValueOfDeviation:
        return lambda z: float(np.exp(np.clip(share * z, -LARGEST_FACTOR, LARGEST_FACTOR)))

    is_ship = isinstance(model, Plant)
    mass_kg = model.mass_kg if is_ship else float(assumed_inertia(model.length_between_perpendiculars_m)[0])
    heavier = mass_kg / STEADY_MASS_KG
    factors = {name: factor_conversion(share) for name, share in sign_keeping_shares(form_of(model)).items()}
    if isinstance(model, Plant):
        factors |= dict.fromkeys(signed_coefficient_names(model.form), lambda z: 1.0 + USUAL_SHARE * z)
    units: dict[str, tuple[str, float, ValueOfDeviation]] = {
        name: ("times the model's", 1.0, conversion) for name, conversion in factors.items()
    }
    if isinstance(model, BlackBox):
        shorter = USUAL_LENGTH_M / model.length_between_perpendiculars_m
        for name, usual in zip(DRAG, _USUAL_DRAG_PM, strict=True):
            units[name] = ("1/m", model.number(name), additive_conversion(model.number(name), shorter * usual))
    for name, usual in STEADY.items():
        steady = float(getattr(model, name))
        units[name] = ("N m" if name.endswith("_nm") else "N", steady, additive_conversion(steady, heavier * usual))
    for axis in ("north", "east"):
        current_mps = float(getattr(model, f"current_{axis}_mps"))
        units[f"current_{axis}"] = ("m/s", current_mps, additive_conversion(current_mps, CURRENT_MPS))
        if isinstance(model, Plant):
            drift_n = model.drift_force_n * float(getattr(model, f"drift_{axis}"))
            units[f"drift_{axis}"] = ("N", drift_n, additive_conversion(drift_n, heavier * DRIFT_N))
        units[f"wind_{axis}"] = ("m/s", 0.0, additive_conversion(0.0, WIND_MPS))
    lag_s = model.thruster_lag_s
    return units | {LAG: ("s", lag_s, lambda z: max(0.0, lag_s + LAG_S * z))}


def parameters_with_effect(model: MotionModel) -> Bools:
    """Which parameters change the model or the observer [parameters]: coefficients that are zero stay so, a
    simulator has no drift force, and may take no wind."""
    names = parameter_names(form_of(model))
    if isinstance(model, BlackBox):
        absent = ("drift_north", "drift_east", *(("wind_north", "wind_east") if not model.takes_wind else ()))
        return ~np.isin(names, absent)
    places, numbers, _ = _positions_of_adapted_numbers(model.form)
    effective = np.ones(len(names), dtype=bool)
    effective[: -len(SURROUNDED)] = np.bincount(numbers, flat_numbers(pack(model))[0, places] != 0.0) > 0.0
    return effective
