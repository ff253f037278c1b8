"""The model linearised along the measured motion, second by second, and effects whose size varies over a trial.

With x the true state, x0 the state of the linearisation, f the simulator over one second and h the sensors:

    x[k+1] - x0[k+1] = A (x[k] - x0[k]) + (f(x0[k]) - x0[k+1]) + B force + sum of D_e a_e
    y[k] - h(x0[k])  = H (x[k] - x0[k]) + sum of E_e a_e + noise

All matrices are finite differences of the simulator itself, so whatever can be simulated can be diagnosed: an
effect is its change of f and h, and needs no formula of its own here. The linearisation follows the measured
motion, so a poor model does no harm: its error over one second is the defect f(x0[k]) - x0[k+1].

An effect may vary: currents differ from day to day, a tow may be dropped, a tide turns. It then has a size in
each of several pieces of a trial, and its signatures are those of the constant effect times the weight of each
piece in each second. It joins the catalogue beside the constant effect, and the evidence decides between the
two: every further size has to pay for itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from math import inf, sqrt
from operator import attrgetter
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, to_earth
from seatrial.analysis.compiling import threads_for
from seatrial.analysis.series import robust_spread
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.effects import Catalogue, apply_effects
from seatrial.hybrid.vessel import dynamics, files, sensors
from seatrial.hybrid.vessel.actuators import KINDS, PLAY, angle_columns
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel
from seatrial.hybrid.vessel.effect import Effect, froude_growth, scale_of
from seatrial.hybrid.vessel.outside import assumed_inertia, lagged_means
from seatrial.hybrid.vessel.plant import bare_plant

_STATE_STEPS = np.array([1.0, 1.0, 1e-3, 1e-2, 1e-2, 1e-4])
_FORCE_STEPS = {"constant_X_n": (1e3, "N"), "constant_Y_n": (1e3, "N"), "constant_N_nm": (1e4, "N m")}
_PART, _ONE_SIDED_PART = 0.2, 0.5  # finite-difference steps, in typical sizes of the effect
_SMALL_PART = 0.01  # for smooth forces: one side of it is within 0.4 % of both sides of a tenth of _PART
_ROUNDS, _SAME = 4, 1e-9
_LEAST = 1e-12  # of a sum of squared changes: of a ship at rest
_RANGE = 1.69  # mean range of three normal readings, in standard deviations; a wider one misses slow reversals
_MOST_STAGES = 8  # enough for changes in steps; drifts have more, and signatures take most of the time
Shape = Literal["recordings", "until", "since", "step", "drift"]
_MOST = 0.5  # of the time has to be in recordings with more than one leg

_LEVELS = 24  # steps into which a drift is divided for linearisation; between them it is followed to first order


@dataclass(frozen=True, slots=True)
class LinearModel:
    """The linear model over T seconds: ``A`` [T, 6, 6], ``B`` [T, 6, 3] (per N, N, N m), ``H`` [T, 6, 6].

    ``defect`` [T, 6] is that of the second after each node; ``observed`` [T, 6] is y - h(x0), NaN where there
    is no measurement; ``origin`` [T, 6] is x0.
    """

    A: Floats
    B: Floats
    H: Floats
    defect: Floats
    observed: Floats
    origin: Floats


@dataclass(frozen=True, slots=True)
class Signature:
    """Sensitivity to a free coordinate of an effect: ``D`` [T, 6] of the next state, ``E`` [T, 6] of sensors."""

    effect: str
    coordinate: int
    D: Floats
    E: Floats


@dataclass(frozen=True, slots=True)
class ModelWithEffects:
    """A reference plant and the effects added to it, by their free coordinates.

    ``base`` has no effects; ``file_effects`` are those of the vessel file; ``at`` are coordinates added to those
    or to zero. ``vessel`` is the content of the vessel file, if there is one.
    """

    base: MotionModel
    catalogue: Catalogue
    at: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    file_effects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    vessel: files.Vessel | None = None

    @property
    def scale(self) -> float:
        """The ship's length over the reference length, as a power of two (:mod:`seatrial.hybrid.vessel.effect`)."""
        return scale_of(self.base.length_between_perpendiculars_m)

    def stages(self, log: Log, limit: float = inf) -> list[Stage]:
        """Masks [T] of the stages in which the added effects are constant, with the model of each stage.

        A single stage, with the mean of the added effects, if there would be more than ``limit``.
        """
        changing = time_varying_among(self.at, self.catalogue)
        if not changing:
            return [(np.ones(len(log), dtype=np.bool_), self)]
        shares = [change.profile.rounded_weights(log) for change in changing]
        kinds, stage_of = np.unique(np.hstack(shares), axis=0, return_inverse=True)
        if len(kinds) > limit:
            kinds, stage_of = np.hstack(shares).mean(axis=0)[None], np.zeros(len(log), dtype=np.int64)
        stages = []
        for number, kind in enumerate(kinds):
            at, first = {name: free for name, free in self.at.items() if name not in {c.name for c in changing}}, 0
            for effect in changing:
                part = kind[first : first + effect.profile.piece_count]
                at[effect.base] = tuple(
                    (part @ np.array(effect.coordinates_by_piece(self.at[effect.name]))).tolist()
                )
                first += effect.profile.piece_count
            stages.append((stage_of.reshape(-1) == number, replace(self, at=at)))
        return stages

    def plant(self) -> MotionModel:
        """The plant with the effects; if some of them change with time, use it on the models of :meth:`stages`."""
        names = [*self.file_effects, *(name for name in self.at if name not in self.file_effects)]
        values = {name: self.values_by_piece(name, self.at.get(name))[-1] for name in names}
        return apply_effects(self.base, values, self.catalogue)

    def values_by_piece(self, name: str, added: Sequence[float] | None = None) -> list[dict[str, float]]:
        """The parameters of an effect, with ``added`` on top of the coordinates in the vessel file.

        One set for each part of the trial in which the effect has its own size. Raises
        :class:`ConfigurationError` if they are out of bounds.
        """
        effect = self.catalogue[name]
        pieces = effect.coordinates_by_piece(added or (0.0,) * len(effect.free_scale))
        file_free = self.file_effects.get(effect.base, (0.0,) * len(pieces[0]))
        sizes = []
        for piece in pieces:
            free = [a + b for a, b in zip(file_free, piece, strict=True)]
            if effect.chart == "inverse_square" and free[0] < 0.0:
                raise ConfigurationError(f"effect {effect.base} is not defined below zero")
            sizes.append(effect.complete_values(effect.values_at(free)))
        return sizes

    def nearest_within_bounds(self, at: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
        """The free coordinates closest to ``at`` that, with those in the vessel file, are within bounds."""
        result = {}
        for name, added in at.items():
            pieces = self.catalogue[name].coordinates_by_piece(added)
            file_free = self.file_effects.get(self.catalogue[name].base, (0.0,) * len(pieces[0])) * len(pieces)
            bounded = self.catalogue[name].nearest_within_bounds(
                [a + b for a, b in zip(file_free, added, strict=True)]
            )
            result[name] = tuple(a - b for a, b in zip(bounded, file_free, strict=True))
        return result

    def plant_with_step(self, name: str, coordinate: int, by: float) -> MotionModel | None:
        """The plant with one coordinate changed, or None if the effect is not defined there."""
        free = list(self.at.get(name, (0.0,) * len(self.catalogue[name].free_scale)))
        free[coordinate] += by
        try:
            return replace(self, at={**self.at, name: tuple(free)}).plant()
        except ConfigurationError:
            return None


Stage = tuple[Bools, ModelWithEffects]
"""The seconds [T] in which added effects are constant, and the model with them."""


def model_of(vessel: files.Vessel | BlackBox, catalogue: Catalogue) -> ModelWithEffects:
    """The model of a vessel file or a simulator; the file's own effects may change as well."""
    file_free = {
        name: tuple(catalogue[name].free_coordinates(values))
        for name, values in vessel.effects.items()
        if name in catalogue
    }
    fixed = {name: values for name, values in vessel.effects.items() if name not in catalogue}
    if isinstance(vessel, BlackBox):
        return ModelWithEffects(
            apply_effects(replace(vessel, numbers={}), fixed), catalogue, file_effects=file_free
        )
    return ModelWithEffects(
        apply_effects(bare_plant(vessel), fixed), catalogue, file_effects=file_free, vessel=vessel
    )


@dataclass(frozen=True, slots=True)
class Linearisation:
    """The result of the first stage: a model linearised along a log, and the sensitivities to each effect.

    ``log`` has T seconds; ``model`` holds the effects at which it is linearised; ``tolerance`` [1] is the model
    error allowed for, as a share of the force range. ``linear`` holds A, B, H and the data (SI, angles in
    radians); ``effects`` the signatures D, E [T, 6] of the P free coordinates of the catalogue, in its order,
    per unit of each coordinate.
    """

    log: Log
    model: ModelWithEffects
    tolerance: float
    linear: LinearModel
    effects: tuple[Signature, ...]


def linearise(
    log: Log, model: ModelWithEffects, tolerance: float, effects: Sequence[Signature] | None = None
) -> Linearisation:
    """Linearise ``model`` along ``log``; signatures are computed unless given as ``effects``.

    Raises :class:`ConfigurationError` for an effect whose bounds are narrower than its typical size, and
    :class:`InputError` if the log and the model have different actuators.
    """
    sensors.check_ship(log.actuators, model.base)
    parts = attrgetter(*(attribute.name for attribute in fields(LinearModel)))
    stages = model.stages(log)
    linear = LinearModel(
        *_in_stages(log, stages, lambda log, stage_model: parts(linear_model(log, stage_model.plant())))
    )
    sensitivities = effects or signatures(log, model, linear.origin, list(model.catalogue))
    defect, observed = linear.defect, linear.observed  # to first order with what stages leave out of an effect
    for effect in time_varying_among(model.at, model.catalogue):
        deviation = effect.profile.weights_of_pieces(log) - effect.profile.rounded_weights(log)
        offsets = deviation @ np.array(effect.coordinates_by_piece(model.at[effect.name]))
        matching = [signature for signature in sensitivities if signature.effect == effect.base]
        for signature, size in zip(matching, offsets.T[:, :, None], strict=True):
            defect, observed = defect + size * signature.D, observed - size * signature.E
    linear = replace(linear, defect=defect, observed=observed)
    return Linearisation(log, model, tolerance, linear, tuple(sensitivities))


def by_stage(log: Log, model: ModelWithEffects, compute: Callable[..., Floats], *arrays: Floats) -> Floats:
    """``compute(log, plant, *arrays)`` evaluated in each stage of a model; arrays and result [T, ...]."""
    return _in_stages(
        log,
        model.stages(log),
        lambda log, stage_model, *stage_arrays: (compute(log, stage_model.plant(), *stage_arrays),),
        *arrays,
    )[0]


def _in_stages(
    log: Log, stages: Sequence[Stage], compute: Callable[..., tuple[Floats, ...]], *arrays: Floats
) -> tuple[Floats, ...]:
    """The arrays that ``compute(log, model, *arrays)`` computes in each stage, put together [T, ...]."""
    if len(stages) == 1:
        return compute(log, stages[0][1], *arrays)
    with threads_for(0):  # the batches of a stage are too short for threads to pay
        parts = [
            compute(log.subset(rows), stage_model, *(array[rows] for array in arrays))
            for rows, stage_model in stages
        ]
    results = tuple(np.empty((len(log), *first.shape[1:])) for first in parts[0])
    for (rows, _), part in zip(stages, parts, strict=True):
        for result, values in zip(results, part, strict=True):
            result[rows] = values
    return results


def linear_model(log: Log, plant: MotionModel) -> LinearModel:
    """The linear model along a log's smoothed motion, corrected for the errors of the plant's sensors."""
    origin = true_states(log, plant)
    ways = one_second_paths(log, plant, origin)
    # no force in the catalogue depends on position
    A = _derivatives_by_state(lambda states: next_states(log, plant, states), origin, range(2, 6))
    H = _derivatives_by_state(lambda states: sensors.measure(states[:, None], plant, 1.0)[:, 0], origin, range(6))
    B = np.empty((len(log), 6, 3))
    for column, (name, (usual, unit)) in enumerate(_FORCE_STEPS.items()):
        size = usual * froude_growth(unit, scale_of(plant.length_between_perpendiculars_m))
        ahead, behind = (next_states(log, plant.shifted(**{name: side * size}), origin) for side in (1.0, -1.0))
        B[:, :, column] = (ahead - behind) / (2.0 * size)
    defect = np.zeros_like(origin)
    defect[:-1] = ways[:-1, -1] - origin[1:]
    around = _readings_around(log, plant, ways)
    now = around[:, log.steps_per_second // 2]
    readings = now + np.einsum("tcq,tqc->tc", log.weight, around - now[:, None])
    return LinearModel(A, B, H, defect, log.measured - readings, origin)


def _derivatives_by_state(compute: Callable[[Floats], Floats], origin: Floats, columns: Iterable[int]) -> Floats:
    """The derivative of ``compute(states)`` by some states [T, 6, 6], the identity in the other columns."""
    result = np.tile(np.eye(6), (len(origin), 1, 1))
    for column in columns:
        step = np.where(np.arange(6) == column, _STATE_STEPS, 0.0)
        ahead, behind = (compute(origin + side * step) for side in (1.0, -1.0))
        result[:, :, column] = (ahead - behind) / (2.0 * _STATE_STEPS[column])
    return result


def signatures(log: Log, model: ModelWithEffects, origin: Floats, names: Iterable[str]) -> list[Signature]:
    """The sensitivities to each free coordinate of each effect about ``origin``, by finite differences.

    Drifting effects are held at their mean: the change of the other sensitivities is of second order.
    """
    stages, names, catalogue = model.stages(log, _MOST_STAGES), list(names), model.catalogue
    (ways,) = _in_stages(
        log,
        stages,
        lambda log, stage_model, stage_origin: (one_second_paths(log, stage_model.plant(), stage_origin),),
        origin,
    )
    constant = [
        Signature(name, coordinate, *_in_stages(log, stages, partial(_sensitivity, name, coordinate), origin, ways))
        for name in names if not isinstance(catalogue[name], TimeVaryingEffect)
        for coordinate in range(len(catalogue[name].free_scale))
    ]  # fmt: skip
    return [*constant, *time_varying_signatures(log, time_varying_among(names, catalogue), constant)]


def time_varying_signatures(
    log: Log, changing: Sequence[TimeVaryingEffect], constant: Sequence[Signature]
) -> list[Signature]:
    """The signatures of effects that vary with time, from those of the ``constant`` effects."""
    result = []
    for effect in changing:
        matching = [signature for signature in constant if signature.effect == effect.base]
        for number, share in enumerate(effect.profile.weights_of_pieces(log).T[:, :, None]):
            first = number * len(matching)
            result += [Signature(effect.name, first + s.coordinate, s.D * share, s.E * share) for s in matching]
    return result


def _sensitivity(
    name: str, coordinate: int, log: Log, model: ModelWithEffects, origin: Floats, ways: Floats
) -> tuple[Floats, Floats]:
    """The change of the next state and of the readings [T, 6] with one free coordinate of an effect.

    ``ways`` [T, 5, 6] are the model's own paths from ``origin``, which an error of a sensor does not change.
    """
    if small := small_step(model, name, coordinate):
        plant, step = small
        return (next_states(log, plant, origin) - ways[:, -1]) / step, np.zeros_like(origin)
    size = model.catalogue[name].free_scale[coordinate]
    for steps in ((_PART, -_PART), (_ONE_SIDED_PART, 0.0), (0.0, -_ONE_SIDED_PART)):  # the last two at a bound
        plus, minus = (step * size for step in steps)
        ahead, behind = (model.plant_with_step(name, coordinate, by) for by in (plus, minus))
        if ahead is not None and behind is not None:
            break
    else:
        raise ConfigurationError(f"effect {name} has bounds too narrow for its ordinary size of {size:g}")
    if sensors.differ_only_in_sensors(ahead, behind):
        further = before = ways
    else:
        further, before = one_second_paths(log, ahead, origin), one_second_paths(log, behind, origin)
    D = (further[:, -1] - before[:, -1]) / (plus - minus)
    if sensors.sensors_are_equal(ahead, behind):
        return D, np.zeros_like(origin)
    return D, (_readings_at_start(log, ahead, further) - _readings_at_start(log, behind, before)) / (plus - minus)


def small_step(model: ModelWithEffects, name: str, coordinate: int) -> tuple[MotionModel, float] | None:
    """The plant at a small step of a coordinate, and the step; None where motion may have a kink or sensors change.

    One side of so small a step is as accurate as both of a large one, and the other side is the model as it is.
    """
    effect = model.catalogue[name]
    if effect.kind == "sensor" or effect.chart != "linear":
        return None
    step = _SMALL_PART * effect.free_scale[coordinate]
    ahead, behind = (model.plant_with_step(name, coordinate, by) for by in (step, -step))
    if ahead is None or behind is None or not sensors.sensors_are_equal(ahead, behind):
        return None
    return (ahead, step) if _delays_of(ahead) == _delays_of(behind) else None


def next_states(log: Log, plant: MotionModel, origin: Floats) -> Floats:
    """The states [T, 6] that the simulator reaches one second after each of ``origin`` [T, 6]."""
    return one_second_paths(log, plant, origin)[:, -1]


def one_second_paths(log: Log, plant: MotionModel, origin: Floats) -> Floats:
    """The simulated states at each step of a second from each of ``origin`` [T, 6]: [T, S + 1, 6]."""
    controls, acting = acting_settings(log, plant)
    wind = np.repeat(log.wind[:, None, :], log.steps_per_second, axis=1)
    dt_s = 1.0 / log.steps_per_second
    runs = dynamics.simulate_batch(without_delays(plant), origin, controls, wind, dt_s, 1, acting)
    if not runs.in_range.all():  # outside the model's range a second carries no information: assume steady motion
        runs.states[~runs.in_range] = origin[~runs.in_range, None]
    return runs.states


def integration_delays_s(log: Log, plant: MotionModel) -> tuple[float, float]:
    """How much later a simulator moves and turns than its own speeds and yaw rate say [s, s].

    Half a step by Euler's method, which moves by the speeds before the step; a whole step where outputs are read
    one step late; hardly anything by a method of second order. Least squares over a log, against the trapezoidal
    rule.
    """
    ways, dt_s = one_second_paths(log, plant, true_states(log, plant)), 1.0 / log.steps_per_second
    heading, surge, sway, yaw_rate = np.moveaxis(ways[..., sensors.HEADING :], -1, 0)
    rates = np.stack([*to_earth(surge, sway, heading), yaw_rate], axis=-1)
    change, mean = np.diff(rates, axis=1), 0.5 * (rates[:, 1:] + rates[:, :-1])
    late = dt_s * mean - np.diff(ways[..., : sensors.SURGE], axis=1)
    moves, turns = (
        float((late[..., part] * change[..., part]).sum() / max(float((change[..., part] ** 2).sum()), _LEAST))
        for part in (slice(2), slice(2, 3))
    )
    return moves, turns


def acting_settings(log: Log, plant: MotionModel) -> tuple[Floats, Floats]:
    """The controls that act in each step of a second [T, S, controls] and at its start [T, controls].

    As reported, corrected for the feedback's delay and for play; at the start also for the lag, which the
    simulator continues (:func:`without_delays`); one of another make is given what has lagged.
    """
    return _acting(log, *_delays_of(plant), lagged=isinstance(plant, BlackBox))


def actuator_forces_of_simulator(log: Log, model: BlackBox, origin: Floats) -> Floats:
    """The forces [T, 3] (N, N, N m) of a simulator's actuators, had it the mass of an ordinary ship of its length:
    how else it would move within a second if they stood still."""
    still = replace(log, controls=np.zeros_like(log.controls), cut_from=None)
    answer = next_states(log, model, origin) - next_states(still, model, origin)
    return np.asarray(answer[:, 3:] * assumed_inertia(model.length_between_perpendiculars_m))


@lru_cache(maxsize=4)  # few effects concern the controls: all other plants of a linearisation have the same
def _acting(
    log: Log, delay_s: float, lags_s: tuple[float, ...], plays_rad: tuple[float, ...], *, lagged: bool = False
) -> tuple[Floats, Floats]:
    if delay_s == 0.0 and not any(lags_s) and not any(plays_rad):
        return log.controls, log.controls[:, 0]
    if log.cut_from is not None:
        parent, rows = log.cut_from
        controls, acting = _acting(parent, delay_s, lags_s, plays_rad, lagged=lagged)
        return controls[rows], acting[rows]
    controls, acting = np.empty_like(log.controls), log.controls[:, 0].copy()
    angles = angle_columns(log.actuators)
    for first, last in _stretches(log):
        series = log.controls[first:last].reshape(-1, log.controls.shape[-1])
        series = np.column_stack([np.unwrap(c) if i in angles else c for i, c in enumerate(series.T)])
        series = sensors.acting_controls(series, delay_s, 1.0 / log.steps_per_second, angles)
        interval = max(1, round(log.setting_step_s * log.steps_per_second))
        for column in np.flatnonzero(plays_rad):  # the offset of a gear's output from its motor's side
            # feedback noise would drag the output to its extremes: movements within its usual range are ignored
            noise_rad = robust_spread(np.diff(series[::interval, column], 2)) / sqrt(6.0)
            motor = sensors.behind_play(np.ascontiguousarray(series[:, column]), _RANGE * noise_rad)
            series[:, column] += sensors.behind_play(motor, plays_rad[column]) - motor
        if lagged:
            means = [
                lagged_means(c, lag_s, 1.0 / log.steps_per_second) if lag_s > 0.0 else c
                for c, lag_s in zip(series.T, lags_s, strict=True)
            ]
            controls[first:last] = np.column_stack(means).reshape(controls[first:last].shape)
            continue
        controls[first:last] = series.reshape(controls[first:last].shape)
        for values, lag_s in zip(series.T, lags_s, strict=True):
            if lag_s > 0.0:  # at the start of each step, after a first-order lag
                decay = np.exp(-1.0 / (lag_s * log.steps_per_second))
                before = np.append(values[:1], values[:-1])
                values[:] = lfilter([1.0 - decay], [1.0, -decay], before, zi=decay * values[:1])[0]
        acting[first:last] = series[:: log.steps_per_second]
    return controls, acting


def _delays_of(plant: MotionModel) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """What lies between a reported control and the one that acts: the record's delay, lags and plays."""
    return plant.command_delay_s, lags_of(plant), plays_of(plant)


def without_delays(plant: MotionModel) -> MotionModel:
    """The plant for the controls of :func:`acting_settings`: no delay and play, of a simulator no lags, too."""
    tight = {f"{actuator.name}_{PLAY}": 0.0 for actuator in plant.layout if PLAY in KINDS[actuator.kind].numbers}
    undelayed = plant.replaced(command_delay_s=0.0)
    if isinstance(undelayed, BlackBox):
        lags = (f"{actuator.name}_{lag}" for actuator in plant.layout if (lag := KINDS[actuator.kind].lag))
        undelayed = undelayed.replaced(thruster_lag_s=0.0, **dict.fromkeys(lags, 0.0))
    return undelayed.replaced(**tight) if any(plays_of(plant)) else undelayed


def _stretches(log: Log) -> Iterator[tuple[int, int]]:
    """First and last row of each stretch without a gap in time."""
    breaks = np.flatnonzero(np.diff(log.time_s) != 1) + 1
    return itertools.pairwise([0, *breaks.tolist(), len(log)])


def lags_of(plant: MotionModel) -> tuple[float, ...]:
    """The time constant [s] with which each control acts after it is reported [controls]."""
    lags_s = []
    for actuator in plant.layout:
        kind = KINDS[actuator.kind]
        lag_s = plant.number(f"{actuator.name}_{kind.lag}") if kind.lag else 0.0
        lags_s += [plant.thruster_lag_s + lag_s] * len(kind.units)
    return tuple(lags_s)


def plays_of(plant: MotionModel) -> tuple[float, ...]:
    """The play [rad] of each control between its feedback and its action [controls]."""
    plays_rad = []
    for actuator in plant.layout:
        kind = KINDS[actuator.kind]
        play_rad = plant.number(f"{actuator.name}_{PLAY}") if PLAY in kind.numbers else 0.0
        plays_rad += [play_rad if angle else 0.0 for angle in kind.angles]
    return tuple(plays_rad)


def sensor_readings(log: Log, plant: MotionModel, states: Floats) -> Floats:
    """States [T, 6] as the plant's sensors report them, with delays applied within each unbroken stretch."""
    if not sensors.has_sensor_delay(plant):  # without delays, readings equal states
        return sensors.measure(states[:, None], plant, 1.0)[:, 0]
    return _readings_at_start(log, plant, one_second_paths(log, plant, states))


def _readings_at_start(log: Log, plant: MotionModel, ways: Floats) -> Floats:
    """The sensor readings [T, 6] at the start of each path [T, S + 1, 6] of :func:`one_second_paths`."""
    return _readings_around(log, plant, ways, [log.steps_per_second // 2])[:, 0]


def _readings_around(log: Log, plant: MotionModel, ways: Floats, places: Sequence[int] | None = None) -> Floats:
    """The sensor readings at each step from half a second before each path's start to half a second after.

    [T, S + 1, 6], or only at some ``places`` of these. They are simulated from the start state: an error in it
    carries over.
    """
    steps = log.steps_per_second
    chosen = range(steps + 1) if places is None else places
    result, half, dt_s = np.empty((len(ways), len(chosen), 6)), steps // 2, 1.0 / steps
    delays_s = [0.0] * 3 + [plant.speed_delay_s] * 3
    for first, last in _stretches(log):
        stretch, seconds = ways[first:last], np.arange(last - first, dtype=np.float64)
        share = np.arange(steps)[:, None] / steps  # jumps are spread evenly over each second
        jumped = np.concatenate([stretch[1:, :1] - stretch[:-1, -1:], np.zeros_like(stretch[:1, :1])])
        track = np.concatenate([(stretch[:, :-1] + share * jumped).reshape(-1, 6), stretch[-1:, -1]])
        readings = sensors.measure(track, plant, dt_s)
        readings = np.concatenate([2.0 * readings[:1] - readings[half:0:-1], readings])
        jumps = np.concatenate([np.zeros((1, 6)), stretch[1:, 0] - stretch[:-1, -1]]).cumsum(axis=0)
        for place, step in enumerate(chosen):
            result[first:last, place] = readings[step::steps][: len(stretch)]
            for column, delay_s in enumerate(delays_s):
                times = seconds + (step - half) * dt_s - delay_s
                missed = jumps[:, column] - np.interp(times, seconds, jumps[:, column])
                result[first:last, place, column] += missed
    return result


def true_states(log: Log, plant: MotionModel, rows: Ints | None = None) -> Floats:
    """The states [T, 6], or some ``rows``, that the plant's sensors would report as the log's smoothed motion."""
    if rows is not None and sensors.has_sensor_delay(plant):
        return true_states(log, plant)[rows]
    nominal = log.nominal if rows is None else log.nominal[rows]
    states = nominal.copy()
    for _ in range(_ROUNDS):
        error = nominal - sensor_readings(log, plant, states)
        states += error
        if (
            np.abs(error[:, sensors.HEADING :]).max(initial=0.0) < _SAME
        ):  # no reading but its own depends on a position
            break
    return states


@dataclass(frozen=True, slots=True)
class TimeProfile:
    """The profile of an effect's size over a trial.

    A separate size in each of the ``times_s`` recordings (their numbers); one size ``until`` a time, ``since``
    a time, or on both sides of it (``step``); or a linear ``drift`` from the first of two times to the second.
    Times are UTC since 1970 [s], ``interval_s`` is the 95 % interval of the time of a change.
    """

    shape: Shape
    times_s: tuple[float, ...]
    interval_s: tuple[float, float] | None = None

    @property
    def piece_count(self) -> int:
        """The number of pieces with separate sizes."""
        return {"recordings": len(self.times_s), "until": 1, "since": 1, "step": 2, "drift": 2}[self.shape]

    def weights_of_pieces(self, log: Log) -> Floats:
        """The weight of each piece's size in each second [T, pieces]."""
        if self.shape == "recordings":
            return np.asarray(log.recording[:, None] == np.array(self.times_s), dtype=np.float64)
        if self.shape == "drift":
            first, last = self.times_s
            weight = np.clip((log.time_s - first) / max(last - first, 1.0), 0.0, 1.0)
        else:
            weight = np.asarray(log.time_s >= self.times_s[0], dtype=np.float64)
        ends = {"until": (1.0 - weight,), "since": (weight,)}
        return np.column_stack(ends.get(self.shape, (1.0 - weight, weight)))

    def rounded_weights(self, log: Log) -> Floats:
        """The weights rounded to a few levels, each constant within a block."""
        mean = [
            np.bincount(log.block, weights=share) / np.bincount(log.block)
            for share in self.weights_of_pieces(log).T
        ]
        levels = _LEVELS if self.shape == "drift" else 1
        return np.asarray(np.round(np.column_stack(mean)[log.block] * levels) / levels)


@dataclass(frozen=True)
class TimeVaryingEffect(Effect):
    """An effect ``of`` the catalogue whose size follows a profile: the coordinates of its pieces in order."""

    of: str = ""
    profile: TimeProfile = TimeProfile("since", (0.0,))

    @property
    def base(self) -> str:
        """The name in the catalogue."""
        return self.of

    def coordinates_by_piece(self, free: Sequence[float]) -> list[tuple[float, ...]]:
        """Free coordinates of each piece."""
        width = len(free) // self.profile.piece_count
        return [tuple(free[first : first + width]) for first in range(0, len(free), width)]

    def nearest_within_bounds(self, free: Sequence[float]) -> tuple[float, ...]:
        """The closest free coordinates within bounds, piece by piece."""
        return tuple(
            coordinate
            for piece in self.coordinates_by_piece(free)
            for coordinate in super(TimeVaryingEffect, self).nearest_within_bounds(piece)
        )

    @property
    def free_scale(self) -> tuple[float, ...]:
        """The typical size of each free coordinate."""
        return super().free_scale * self.profile.piece_count

    @property
    def smallest_free(self) -> tuple[float, ...]:
        """The smallest size of interest of each free coordinate."""
        return super().smallest_free * self.profile.piece_count


def time_varying(effect: Effect, profile: TimeProfile) -> TimeVaryingEffect:
    """An effect with a profile, under a name of its own."""
    values = {attribute.name: getattr(effect, attribute.name) for attribute in fields(Effect)}
    return TimeVaryingEffect(
        **{**values, "name": f"{effect.name}, {profile.shape}"}, of=effect.name, profile=profile
    )


def with_recordings(catalogue: Catalogue, log: Log) -> Catalogue:
    """The catalogue plus environmental and sensor effects with a separate size in each recording.

    The catalogue itself if there is only one recording, or most of the time is in recordings of a single leg:
    there is no other leg to test such a size on.
    """
    recordings = tuple(np.unique(log.recording).tolist())
    legs = {recording: np.unique(log.leg[log.recording == recording]).size for recording in recordings}
    judged = np.isin(log.recording, [recording for recording in recordings if legs[recording] > 1])
    if len(recordings) < 2 or judged.mean() < _MOST:
        return catalogue
    profile = TimeProfile("recordings", recordings)
    varying = [time_varying(effect, profile) for effect in catalogue.values() if effect.scope != "ship"]
    return {**catalogue, **{effect.name: effect for effect in varying}}


def time_varying_among(names: Iterable[str], catalogue: Catalogue) -> list[TimeVaryingEffect]:
    """Those of ``names`` that have a profile."""
    return [effect for effect in map(catalogue.__getitem__, names) if isinstance(effect, TimeVaryingEffect)]


def base_names(names: Iterable[str], catalogue: Catalogue) -> tuple[str, ...]:
    """Names as in the catalogue, each once."""
    return tuple(dict.fromkeys(catalogue[name].base for name in names))
