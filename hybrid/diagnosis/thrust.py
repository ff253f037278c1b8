"""Measured thrust as a witness: what a meter on a propeller's shaft says of the model, whatever moves the ship.

Tracks alone hardly tell a propeller that pushes more from a hull that resists less; the thrust does at once. The
thrust of the model at the measured speeds and shaft speeds is compared with the measured one, in means over the
windows of a track. A meter may be off by one factor throughout, whose usual size is granted; what scatters beside
it, with the model's own form, is taken for the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from seatrial.acquisition.core.quantities import Floats, Ints, rotate_earth_to_ship
from seatrial.analysis.series import robust_spread
from seatrial.hybrid.diagnosis import linearise
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.vessel import dynamics
from seatrial.hybrid.vessel.black_box import BlackBox, equations_of
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import HEADING, SURGE, SWAY, YAW_RATE

METER_ERROR = 0.03
"""The usual error of a meter's factor, one standard deviation: strain gauges measure the thrust of a shaft, a
hundredth of its strain by torque, to some percent (ITTC 7.5-04-01-01.1, on torque to 1 to 2 %)."""

_LEAST_NOISE = 0.02  # of the mean square's root: no polynomial of an open-water test is closer


def model_thrust(log: Log, model: linearise.ModelWithEffects, rows: Ints) -> Floats:
    """The thrust [N] of the model at the smoothed motion of some seconds of a log [rows, actuators].

    Errors of sensors, which an effect may add, change the motion too little to matter here.
    """
    thrust = np.empty((len(rows), len(log.actuators)))
    for in_stage, stage_model in model.stages(log):
        chosen = in_stage[rows]
        thrust[chosen] = _plant_thrust(
            log, equations_of(stage_model.plant(), "its thrust is asked for"), rows[chosen]
        )
    return thrust


def _plant_thrust(log: Log, plant: Plant, rows: Ints) -> Floats:
    heading, speeds = log.nominal[rows, HEADING], log.nominal[rows][:, [SURGE, SWAY, YAW_RATE]]
    surge, sway = rotate_earth_to_ship(plant.current_north_mps, plant.current_east_mps, heading)
    speeds[:, :2] -= np.column_stack([surge, sway])
    return dynamics.shaft_thrusts(plant, speeds, linearise.acting_settings(log, plant)[1][rows])


@dataclass(frozen=True)
class ThrustWitness:
    """The measured thrust over windows of a log: ``measured`` [N, H, actuators] in N, NaN without a meter.

    ``rows`` [N, H] are the seconds of the windows, ``model`` has no added effects.
    """

    log: Log
    model: linearise.ModelWithEffects
    rows: Ints
    measured: Floats

    def error(self, at: Mapping[str, tuple[float, ...]]) -> Floats:
        """The model's mean thrust less the measured one, by window and shaft, in units of the noise [M]."""
        return (self._means_n(at) - self._measured_n) / self._noise_n

    def form(self, error_and_slopes: Sequence[Floats]) -> Floats:
        """The inner products of an error and its derivatives [1 + K, 1 + K], one factor of the meter left free."""
        columns = np.stack(error_and_slopes, axis=-1)
        factor = self._measured_n / self._noise_n
        along = columns.T @ factor
        return np.asarray(
            columns.T @ columns - METER_ERROR**2 * np.outer(along, along) / (1.0 + METER_ERROR**2 * factor @ factor)
        )

    @cached_property
    def _seen(self) -> Floats:
        """Mask [N, actuators] of windows with a measured thrust."""
        return np.asarray(np.isfinite(self.measured).any(axis=1))

    @cached_property
    def _measured_n(self) -> Floats:
        return self._mean_by_window(self.measured)

    def _means_n(self, at: Mapping[str, tuple[float, ...]]) -> Floats:
        thrust = model_thrust(self.log, replace(self.model, at=at), self.rows.ravel())
        by_window = thrust.reshape(self.measured.shape)
        return self._mean_by_window(np.where(np.isfinite(self.measured), by_window, np.nan))

    def _mean_by_window(self, thrust: Floats) -> Floats:
        counted = np.isfinite(thrust)
        mean = np.where(counted, thrust, 0.0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1)
        return np.asarray(mean[self._seen])

    @cached_property
    def _noise_n(self) -> float:
        """The scatter [N] of the measured means about the model's, times the factor that fits best."""
        modelled, measured = self._means_n({}), self._measured_n
        factor = float(modelled @ measured / max(float(modelled @ modelled), 1e-300))
        usual = float(np.sqrt(np.mean(measured**2)))
        return max(float(robust_spread(measured - factor * modelled)), _LEAST_NOISE * usual, 1e-300)


def thrust_excess(log: Log, model: linearise.ModelWithEffects) -> dict[str, float]:
    """By actuator whose thrust was measured, the share by which the model's mean thrust exceeds that."""
    if log.thrust is None or isinstance(model.base, BlackBox):
        return {}
    modelled = model_thrust(log, model, np.arange(len(log)))
    both, result = np.isfinite(modelled) & np.isfinite(log.thrust), dict[str, float]()
    for number, actuator in enumerate(log.actuators):
        rows = both[:, number]
        measured_n = float(log.thrust[rows, number].sum())
        if measured_n != 0.0:
            result[actuator.name] = float(modelled[rows, number].sum()) / measured_n - 1.0
    return result


def witness_of(log: Log, model: linearise.ModelWithEffects, rows: Ints) -> ThrustWitness | None:
    """The witness over windows whose seconds are ``rows`` [N, H]; None where no propeller's thrust is recorded."""
    if log.thrust is None or isinstance(model.base, BlackBox):  # which states no thrust
        return None
    bare = replace(model, at={})
    has_shaft = np.isfinite(model_thrust(log, bare, rows.ravel())).reshape(*rows.shape, -1)
    measured = np.where(has_shaft, log.thrust[rows], np.nan)
    return ThrustWitness(log, bare, rows, measured) if np.isfinite(measured).any() else None
