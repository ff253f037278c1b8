"""Witnesses: what meters say of the model besides the track, of thrust, power, speed through water and current.

Tracks alone hardly tell a propeller that pushes more from a hull that resists less, nor either from a current on a
straight course; meters on the shaft, a speed log and a current meter do at once. The model's value at the measured
motion and settings is compared with the measured one, in means over the windows of a track. A meter may be off by
one factor throughout, whose usual size is granted; what scatters beside it, with the model's own form, is taken for
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
from seatrial.hybrid.vessel.sensors import HEADING, SURGE, SWAY, YAW_RATE

_LEAST_NOISE = 0.02  # of the mean square's root: no polynomial of an open-water test is closer


def shaft_thrust(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """The thrust [N] on the shafts at the smoothed motion of some seconds of a log [rows, actuators].

    Errors of sensors, which an effect may add, change the motion too little to matter here.
    """
    return _shaft_loads(log, plant, rows)[:, :, 0]


def shaft_power(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """The power [W] of the shafts, likewise [rows, actuators]."""
    return _shaft_loads(log, plant, rows)[:, :, 1]


def total_power(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """The power [W] of all shafts together, likewise [rows, 1]."""
    power = shaft_power(log, plant, rows)
    shafts = [number for number, actuator in enumerate(log.actuators) if actuator.drives]
    return np.asarray(power[:, shafts].sum(axis=1, keepdims=True))


def water_speed(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """The speed through the water along the ship [m/s], the smoothed one over ground less the model's current,
    likewise [rows, 1]."""
    return _speeds_through_water(log, plant, rows)[:, :1]


def current(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """The model's current to north and to east [m/s], likewise [rows, 2]."""
    return np.tile([plant.current_north_mps, plant.current_east_mps], (len(rows), 1))


def _shaft_loads(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    equations = equations_of(plant, "its shafts' load is asked for")
    settings = linearise.acting_settings(log, equations)[1][rows]
    return dynamics.shaft_loads(equations, _speeds_through_water(log, plant, rows), settings)


def _speeds_through_water(log: Log, plant: MotionModel, rows: Ints) -> Floats:
    """Surge, sway [m/s] and yaw rate [rad/s] through the water of some seconds [rows, 3]."""
    heading, speeds = log.nominal[rows, HEADING], log.nominal[rows][:, [SURGE, SWAY, YAW_RATE]]
    surge, sway = rotate_earth_to_ship(plant.current_north_mps, plant.current_east_mps, heading)
    speeds[:, :2] -= np.column_stack([surge, sway])
    return speeds


@dataclass(frozen=True)
class MeterKind:
    """A kind of meter: the usual error of its factor, one standard deviation, what a plant says that it reads, for
    some seconds of a log [rows, meters], whether only equations of motion tell that, no black box, and its name."""

    factor_error: float
    of_plant: Callable[[Log, MotionModel, Ints], Floats]
    needs_equations: bool
    words: str

    def modelled_readings(self, log: Log, model: linearise.ModelWithEffects, rows: Ints) -> Floats:
        """What the model says that the meters read, for some seconds of a log [rows, meters]."""
        parts = [(in_stage[rows], stage_model.plant()) for in_stage, stage_model in model.stages(log)]
        values = [(chosen, self.of_plant(log, plant, rows[chosen])) for chosen, plant in parts]
        result = np.empty((len(rows), values[0][1].shape[1]))
        for chosen, part in values:
            result[chosen] = part
        return result


METERS = {
    # Strain gauges measure the thrust of a shaft, a hundredth of its strain by torque, to some percent (ITTC
    # 7.5-04-01-01.1, on torque to 1 to 2 %).
    "thrust": MeterKind(0.03, shaft_thrust, True, "thrust"),
    # That of a screw by its thrust: 5 % by ``propeller.screw_power``, and as much by the hull's wake and the meter.
    "shaft_power": MeterKind(0.07, shaft_power, True, "shaft power"),
    "total_power": MeterKind(0.07, total_power, True, "shaft power"),
    # A speed log in the boundary layer, calibrated on measured miles (IMO MSC.96(72): 2 % or 0.2 kn).
    "water_speed": MeterKind(0.03, water_speed, False, "speed through the water"),
    # Doppler current meters are off by a hundredth; the layer that they measure is not quite the hull's.
    "current": MeterKind(0.1, current, False, "current"),
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

    def standardised_error(self, at: Mapping[str, tuple[float, ...]]) -> Floats:
        """The model's mean less the measured one, by window and meter, in units of the noise [M]."""
        return (self._means(at) - self._measured_mean) / self._noise

    def inner_products(self, error_and_slopes: Sequence[Floats]) -> Floats:
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
        modelled = self.meter.modelled_readings(self.log, replace(self.model, at=at), self.rows.ravel())
        by_window = modelled.reshape(self.measured.shape)
        return self._mean_by_window(np.where(np.isfinite(self.measured), by_window, np.nan))

    def _mean_by_window(self, values: Floats) -> Floats:
        counted = np.isfinite(values)
        mean = np.where(counted, values, 0.0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1)
        return np.asarray(mean[self._seen])

    @cached_property
    def _noise(self) -> Floats:
        """The scatter of each meter's means about the model's, times the factor that fits best [M]."""
        modelled, measured = self._means({}), self._measured_mean
        factor = float(modelled @ measured / max(float(modelled @ modelled), 1e-300))
        least = max(_LEAST_NOISE * float(np.sqrt(np.mean(measured**2))), 1e-300)
        meter, rest = np.nonzero(self._seen)[1], measured - factor * modelled
        spreads = {number: float(robust_spread(rest[meter == number])) for number in np.unique(meter)}
        return np.array([max(spreads[number], least) for number in meter])


def shaft_excess(log: Log, model: linearise.ModelWithEffects) -> dict[tuple[str, str], float]:
    """By what meters on shafts measured and the actuator, "" for all together, the share by which the model's mean
    exceeds that."""
    result = dict[tuple[str, str], float]()
    for name, measured in log.meters.items():
        meter = METERS[name]
        if not meter.needs_equations or isinstance(model.base, BlackBox):
            continue
        modelled = meter.modelled_readings(log, model, np.arange(len(log)))
        both = np.isfinite(modelled) & np.isfinite(measured)
        shafts = [actuator.name for actuator in log.actuators] if name != "total_power" else [""]
        for number, shaft in enumerate(shafts):
            rows = both[:, number]
            total = float(measured[rows, number].sum())
            if total != 0.0:
                result[meter.words, shaft] = float(modelled[rows, number].sum()) / total - 1.0
    return result


def witnesses_of(log: Log, model: linearise.ModelWithEffects, rows: Ints) -> tuple[Witness, ...]:
    """The witnesses over windows whose seconds are ``rows`` [N, H]; none where no meter was recorded."""
    bare, witnesses = replace(model, at={}), list[Witness]()
    for name, recorded in log.meters.items():
        if METERS[name].needs_equations and isinstance(model.base, BlackBox):
            continue
        modelled = METERS[name].modelled_readings(log, bare, rows.ravel())
        readable = np.isfinite(modelled).reshape(*rows.shape, -1)
        measured = np.where(readable, recorded[rows], np.nan)
        if np.isfinite(measured).any():
            witnesses.append(Witness(METERS[name], log, bare, rows, measured))
    return tuple(witnesses)
