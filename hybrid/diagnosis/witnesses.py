"""Witnesses: what meters aboard say of the model besides the track, of the thrust and of the speed through water.

Tracks alone hardly tell a propeller that pushes more from a hull that resists less, nor either from a current on a
straight course; a thrust meter on the shaft and a speed log do at once. The model's value at the measured motion
and settings is compared with the measured one, in means over the windows of a track. A meter may be off by one
factor throughout, whose usual size is granted; what scatters beside it, with the model's own form, is taken for
the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from seatrial.acquisition.core.quantities import Floats, Ints, rotate_earth_to_ship
from seatrial.analysis.series import robust_spread
from seatrial.hybrid.diagnosis import linearise
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.vessel import dynamics
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel, equations_of
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import HEADING, SURGE, SWAY, YAW_RATE

_LEAST_NOISE = 0.02  # of the mean square's root: no polynomial of an open-water test is closer


def model_thrust(log: Log, model: linearise.ModelWithEffects, rows: Ints) -> Floats:
    """The thrust [N] of the model at the smoothed motion of some seconds of a log [rows, actuators].

    Errors of sensors, which an effect may add, change the motion too little to matter here.
    """
    thrust = np.empty((len(rows), len(log.actuators)))
    for in_stage, stage_model in model.stages(log):
        chosen = in_stage[rows]
        plant = equations_of(stage_model.plant(), "its thrust is asked for")
        thrust[chosen] = _plant_thrust(log, plant, rows[chosen])
    return thrust


def model_water_speed(log: Log, model: linearise.ModelWithEffects, rows: Ints) -> Floats:
    """The model's speed through the water along the ship [m/s] at some seconds of a log [rows, 1]: the smoothed one
    over ground less the model's current."""
    speed = np.empty((len(rows), 1))
    for in_stage, stage_model in model.stages(log):
        chosen = in_stage[rows]
        speed[chosen, 0] = _speeds_through_water(log, stage_model.plant(), rows[chosen])[:, 0]
    return speed


def _plant_thrust(log: Log, plant: Plant, rows: Ints) -> Floats:
    speeds = _speeds_through_water(log, plant, rows)
    return dynamics.shaft_thrusts(plant, speeds, linearise.acting_settings(log, plant)[1][rows])


def _speeds_through_water(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """Surge, sway [m/s] and yaw rate [rad/s] through the water of some seconds [rows, 3]."""
    heading, speeds = log.nominal[rows, HEADING], log.nominal[rows][:, [SURGE, SWAY, YAW_RATE]]
    surge, sway = rotate_earth_to_ship(plant.current_north_mps, plant.current_east_mps, heading)
    speeds[:, :2] -= np.column_stack([surge, sway])
    return speeds


@dataclass(frozen=True)
class MeterKind:
    """A kind of meter: the usual error of its factor, one standard deviation, and what the model says that it
    reads, for some seconds of a log [rows, meters]."""

    factor_error: float
    modelled: Callable[[Log, linearise.ModelWithEffects, Ints], Floats]


METERS = {
    # Strain gauges measure the thrust of a shaft, a hundredth of its strain by torque, to some percent (ITTC
    # 7.5-04-01-01.1, on torque to 1 to 2 %).
    "thrust": MeterKind(0.03, model_thrust),
    # A speed log in the boundary layer, calibrated on measured miles (IMO MSC.96(72): 2 % or 0.2 kn).
    "water_speed": MeterKind(0.03, model_water_speed),
}


@dataclass(frozen=True)
class Witness:
    """Measurements of a kind of ``meter`` over windows of a log: ``measured`` [N, H, meters], NaN without one.

    ``rows`` [N, H] are the seconds of the windows, ``model`` has no added effects.
    """

    meter: MeterKind
    log: Log
    model: linearise.ModelWithEffects
    rows: Ints
    measured: Floats

    def error(self, at: Mapping[str, tuple[float, ...]]) -> Floats:
        """The model's mean less the measured one, by window and meter, in units of the noise [M]."""
        return (self._means(at) - self._measured_mean) / self._noise

    def form(self, error_and_slopes: Sequence[Floats]) -> Floats:
        """The inner products of an error and its derivatives [1 + K, 1 + K], one factor of the meter left free."""
        columns = np.stack(error_and_slopes, axis=-1)
        factor, error = self._measured_mean / self._noise, self.meter.factor_error
        along = columns.T @ factor
        return np.asarray(
            columns.T @ columns - error**2 * np.outer(along, along) / (1.0 + error**2 * factor @ factor)
        )

    @cached_property
    def _seen(self) -> Floats:
        """Mask [N, meters] of windows with a measurement."""
        return np.asarray(np.isfinite(self.measured).any(axis=1))

    @cached_property
    def _measured_mean(self) -> Floats:
        return self._mean_by_window(self.measured)

    def _means(self, at: Mapping[str, tuple[float, ...]]) -> Floats:
        modelled = self.meter.modelled(self.log, replace(self.model, at=at), self.rows.ravel())
        by_window = modelled.reshape(self.measured.shape)
        return self._mean_by_window(np.where(np.isfinite(self.measured), by_window, np.nan))

    def _mean_by_window(self, values: Floats) -> Floats:
        counted = np.isfinite(values)
        mean = np.where(counted, values, 0.0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1)
        return np.asarray(mean[self._seen])

    @cached_property
    def _noise(self) -> float:
        """The scatter of the measured means about the model's, times the factor that fits best."""
        modelled, measured = self._means({}), self._measured_mean
        factor = float(modelled @ measured / max(float(modelled @ modelled), 1e-300))
        usual = float(np.sqrt(np.mean(measured**2)))
        return max(float(robust_spread(measured - factor * modelled)), _LEAST_NOISE * usual, 1e-300)


def thrust_excess(log: Log, model: linearise.ModelWithEffects) -> dict[str, float]:
    """By actuator whose thrust was measured, the share by which the model's mean thrust exceeds that."""
    if "thrust" not in log.meters or isinstance(model.base, BlackBox):
        return {}
    modelled = model_thrust(log, model, np.arange(len(log)))
    measured = log.meters["thrust"]
    both, result = np.isfinite(modelled) & np.isfinite(measured), dict[str, float]()
    for number, actuator in enumerate(log.actuators):
        rows = both[:, number]
        measured_n = float(measured[rows, number].sum())
        if measured_n != 0.0:
            result[actuator.name] = float(modelled[rows, number].sum()) / measured_n - 1.0
    return result


def witnesses_of(log: Log, model: linearise.ModelWithEffects, rows: Ints) -> tuple[Witness, ...]:
    """The witnesses over windows whose seconds are ``rows`` [N, H]; none where no meter was recorded."""
    bare, witnesses = replace(model, at={}), list[Witness]()
    for name, recorded in log.meters.items():
        if name == "thrust" and isinstance(model.base, BlackBox):  # which states none
            continue
        modelled = METERS[name].modelled(log, bare, rows.ravel())
        readable = np.isfinite(modelled).reshape(*rows.shape, -1)
        measured = np.where(readable, recorded[rows], np.nan)
        if np.isfinite(measured).any():
            witnesses.append(Witness(METERS[name], log, bare, rows, measured))
    return tuple(witnesses)
