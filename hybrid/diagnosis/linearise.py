"""The model made linear along the measured motion, second by second.

With x the true state, x0 the motion it is made linear about, f the simulator over one second and h the sensors:

    x[k+1] - x0[k+1] = A (x[k] - x0[k]) + (f(x0[k]) - x0[k+1]) + B force + sum of D_e a_e
    y[k] - h(x0[k])  = H (x[k] - x0[k]) + sum of E_e a_e + noise

All by differences of the simulator itself, so that whatever it can simulate can be diagnosed: an effect is what it
does to f and h, not a formula of its own here. Because the motion made linear about is the measured one, a model
that is far off costs nothing: its error stands in the defect f(x0[k]) - x0[k+1] of one second.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError
from analysis.compiling import threads_for
from hybrid.diagnosis.course import Varied, courses
from hybrid.diagnosis.log import STEPS_PER_SECOND, Log
from hybrid.effects import Catalogue, apply_effects
from hybrid.vessel.actuators import KINDS, angle_columns
from hybrid.vessel.actuators.kind import PLAY
from hybrid.vessel.channels import check_ship
from hybrid.vessel.effect import growth, scale_of
from hybrid.vessel.parameters import Vessel
from hybrid.vessel.plant import Plant, bare_plant
from hybrid.vessel.sensors import acting_controls, behind_play, measure, report_alike, report_late
from hybrid.vessel.simulate import simulate_batch

DT_S = 1.0 / STEPS_PER_SECOND
_STATE_STEPS = np.array([1.0, 1.0, 1e-3, 1e-2, 1e-2, 1e-4])
_FORCE_STEPS = {"constant_X_n": (1e3, "N"), "constant_Y_n": (1e3, "N"), "constant_N_nm": (1e4, "N m")}
_PART, _ONE_SIDED_PART = 0.2, 0.5  # of an effect's ordinary size: the steps of its differences
_ROUNDS = 4
_RANGE = 1.69  # of three readings, on average, in standard deviations: wider, and a slow turn back is missed
_MOST_STAGES = 8  # of effects that change in steps; a drift has more, and signatures take most of the time


@dataclass(frozen=True, slots=True)
class LinearModel:
    """T seconds of the linear model: ``A`` [T, 6, 6], ``B`` [T, 6, 3] (per N, N, N m), ``H`` [T, 6, 6].

    ``defect`` [T, 6] belongs to the second after each node; ``observed`` [T, 6] is y - h(x0), NaN where nothing was
    measured; ``origin`` [T, 6] is x0.
    """

    A: Floats
    B: Floats
    H: Floats
    defect: Floats
    observed: Floats
    origin: Floats


@dataclass(frozen=True, slots=True)
class Signature:
    """What one free coordinate of an effect does: ``D`` [T, 6] to the next state, ``E`` [T, 6] to the sensors."""

    effect: str
    coordinate: int
    D: Floats
    E: Floats


@dataclass(frozen=True, slots=True)
class Model:
    """A reference plant, and the effects added to it by their free coordinates.

    ``base`` has no effects; ``given`` are those of the vessel's own file, ``at`` is what is added to these and to
    others. ``vessel`` is the file's content, where there is one.
    """

    base: Plant
    catalogue: Catalogue
    at: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    given: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    vessel: Vessel | None = None

    @property
    def scale(self) -> float:
        """How many times as long the ship is as the usual one, in powers of two (:mod:`hybrid.vessel.effect`)."""
        return scale_of(self.base.length_between_perpendiculars_m)

    def stages(self, log: Log, most: float = inf) -> list[tuple[NDArray[np.bool_], Model]]:
        """The seconds [T] in which what is added stays as it is, and the model there; one stage where all does.

        Where there were more than ``most``, one of what is added in the mean.
        """
        changing = courses(self.at, self.catalogue)
        if not changing:
            return [(np.ones(len(log), dtype=np.bool_), self)]
        shares = [each.course.levels(log) for each in changing]
        kinds, which = np.unique(np.hstack(shares), axis=0, return_inverse=True)
        if len(kinds) > most:
            kinds, which = np.hstack(shares).mean(axis=0)[None], np.zeros(len(log), dtype=np.int64)
        found = []
        for number, kind in enumerate(kinds):
            at, first = {name: free for name, free in self.at.items() if name not in {c.name for c in changing}}, 0
            for each in changing:
                part = kind[first : first + each.course.pieces]
                at[each.base] = tuple((part @ np.array(each.pieces(self.at[each.name]))).tolist())
                first += each.course.pieces
            found.append((which.reshape(-1) == number, replace(self, at=at)))
        return found

    def plant(self) -> Plant:
        """The plant with the effects; where some of them change, of one of the :meth:`stages`."""
        names = [*self.given, *(name for name in self.at if name not in self.given)]
        values = {name: self.values(name, self.at.get(name)) for name in names}
        return apply_effects(self.base, values, self.catalogue)

    def values(self, name: str, added: Sequence[float] | None = None) -> dict[str, float]:
        """The parameters of an effect when ``added`` comes to what is given of it.

        Raises :class:`ConfigurationError` where they are out of bounds.
        """
        return self.piecewise(name, added)[-1]

    def piecewise(self, name: str, added: Sequence[float] | None = None) -> list[dict[str, float]]:
        """The same in each piece of the trial in which the effect has a size of its own."""
        effect = self.catalogue[name]
        pieces = effect.pieces(added or (0.0,) * len(effect.free_scale))
        given = self.given.get(effect.base, (0.0,) * len(pieces[0]))
        found = []
        for piece in pieces:
            free = [a + b for a, b in zip(given, piece, strict=True)]
            if effect.chart == "inverse_square" and free[0] < 0.0:
                raise ConfigurationError(f"effect {effect.base} is not defined below zero")
            found.append(effect.checked(effect.values(free)))
        return found

    def bounded(self, at: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
        """The nearest free coordinates that, added to what is given, are in bounds."""
        result = {}
        for name, added in at.items():
            pieces = self.catalogue[name].pieces(added)
            given = self.given.get(self.catalogue[name].base, (0.0,) * len(pieces[0])) * len(pieces)
            whole = self.catalogue[name].bounded([a + b for a, b in zip(given, added, strict=True)])
            result[name] = tuple(a - b for a, b in zip(whole, given, strict=True))
        return result

    def plant_with_step(self, name: str, coordinate: int, by: float) -> Plant | None:
        """The plant with one coordinate moved, or None where the effect is not defined there."""
        free = list(self.at.get(name, (0.0,) * len(self.catalogue[name].free_scale)))
        free[coordinate] += by
        try:
            return replace(self, at={**self.at, name: tuple(free)}).plant()
        except ConfigurationError:
            return None


def model_of(vessel: Vessel, catalogue: Catalogue) -> Model:
    """The model of a vessel file, its own effects among what may change."""
    given = {
        name: tuple(catalogue[name].free(values)) for name, values in vessel.effects.items() if name in catalogue
    }
    rest = {name: values for name, values in vessel.effects.items() if name not in catalogue}
    return Model(apply_effects(bare_plant(vessel), rest), catalogue, given=given, vessel=vessel)


@dataclass(frozen=True, slots=True)
class Linearisation:
    """The first stage's result: a model made linear along a log, and what each effect does to both.

    ``log`` has the T seconds; ``model`` stands at the effects that it is made linear about; ``tolerance`` [1] is
    the share of the force range that the model is granted to be off by. ``linear`` holds A, B, H and the data (SI,
    angles in radians); ``effects`` the signatures D, E [T, 6] of the P free coordinates of the catalogue, in its
    order, each per unit of its coordinate.
    """

    log: Log
    model: Model
    tolerance: float
    linear: LinearModel
    effects: tuple[Signature, ...]


def linearise(
    log: Log, model: Model, tolerance: float, effects: Sequence[Signature] | None = None
) -> Linearisation:
    """Make ``model`` linear along ``log``; ``effects`` are signatures that are at hand, else they are computed.

    Raises :class:`ConfigurationError` for an effect whose bounds are too narrow for its ordinary size, and
    :class:`InputError` for a log of a ship with other actuators than the model's.
    """
    check_ship(log.actuators, model.base)
    linear = _linear_by_stages(log, model)
    known = effects or signatures(log, model, linear.origin, list(model.catalogue))
    return Linearisation(log, model, tolerance, _between_levels(log, model, linear, known), tuple(known))


def _between_levels(log: Log, model: Model, linear: LinearModel, known: Sequence[Signature]) -> LinearModel:
    """The same with what changing effects are beside the levels of :meth:`Model.stages`, by their slopes."""
    defect, observed = linear.defect, linear.observed
    for each in courses(model.at, model.catalogue):
        beside = each.course.shares(log) - each.course.levels(log)
        off = beside @ np.array(each.pieces(model.at[each.name]))
        own = [signature for signature in known if signature.effect == each.base]
        for signature, size in zip(own, off.T[:, :, None], strict=True):
            defect, observed = defect + size * signature.D, observed - size * signature.E
    return replace(linear, defect=defect, observed=observed)


def by_stage(log: Log, model: Model, of: Callable[..., Floats], *arrays: Floats) -> Floats:
    """What ``of`` a log, a plant and parts of ``arrays`` [T, ...] comes to in each stage of a model, [T, ...]."""
    stages = model.stages(log)
    if len(stages) == 1:
        return of(log, stages[0][1].plant(), *arrays)
    with threads_for(0):  # batches of a stage are so short that threads cost more than they save
        parts = [of(log.subset(rows), each.plant(), *(some[rows] for some in arrays)) for rows, each in stages]
    return _joined([rows for rows, _ in stages], parts)


def _joined(rows: Sequence[NDArray[np.bool_]], parts: Sequence[Floats]) -> Floats:
    result = np.empty((len(rows[0]), *parts[0].shape[1:]))
    for some, part in zip(rows, parts, strict=True):
        result[some] = part
    return result


def _linear_by_stages(log: Log, model: Model) -> LinearModel:
    stages = model.stages(log)
    if len(stages) == 1:
        return linear_model(log, stages[0][1].plant())
    with threads_for(0):
        parts = [linear_model(log.subset(rows), each.plant()) for rows, each in stages]
    rows = [rows for rows, _ in stages]
    names = [each.name for each in fields(LinearModel)]
    return LinearModel(*(_joined(rows, [getattr(part, name) for part in parts]) for name in names))


def linear_model(log: Log, plant: Plant) -> LinearModel:
    """The linear model of a log about its smoothed motion, freed of what the plant's sensors do to it."""
    origin = true_states(log, plant)
    ways = one_second_paths(log, plant, origin)
    A, B = np.tile(np.eye(6), (len(log), 1, 1)), np.empty((len(log), 6, 3))
    for column in range(2, 6):  # a force of the catalogue does not depend on where the ship is
        step = np.zeros(6)
        step[column] = _STATE_STEPS[column]
        ahead, behind = (next_states(log, plant, origin + side * step) for side in (1.0, -1.0))
        A[:, :, column] = (ahead - behind) / (2.0 * _STATE_STEPS[column])
    for column, (name, (usual, unit)) in enumerate(_FORCE_STEPS.items()):
        size = usual * growth(unit, scale_of(plant.length_between_perpendiculars_m))
        ahead, behind = (next_states(log, plant.shifted(**{name: side * size}), origin) for side in (1.0, -1.0))
        B[:, :, column] = (ahead - behind) / (2.0 * size)
    defect = np.zeros_like(origin)
    defect[:-1] = ways[:-1, -1] - origin[1:]
    around = _around(log, plant, ways)
    now = around[:, STEPS_PER_SECOND // 2]
    seen = now + np.einsum("tcq,tqc->tc", log.weight, around - now[:, None])
    return LinearModel(A, B, _sensor_slopes(plant, origin), defect, log.measured - seen, origin)


def sampling_offset(log: Log, ways: Floats) -> Floats:
    """How the mean state at the samples' times differs from that at the full second [T, 6].

    ``ways`` are those of :func:`one_second_paths`.
    """
    half = STEPS_PER_SECOND // 2
    ahead = ways[:, 1 : half + 1] - ways[:, :1]
    behind = np.empty_like(ahead)
    behind[1:] = ways[:-1, half:-1] - ways[:-1, -1:]
    first = np.append(True, np.diff(log.block) != 0)
    behind[first] = -ahead[first, ::-1]
    around = np.concatenate([behind, np.zeros_like(ways[:, :1]), ahead], axis=1)
    return np.asarray(np.einsum("tcq,tqc->tc", log.weight, around))


def signatures(log: Log, model: Model, origin: Floats, names: Iterable[str]) -> list[Signature]:
    """What each free coordinate of each effect does about ``origin``, by differences of simulator and sensors.

    About effects that drift, in the mean: what that changes in the slopes of others is of second order.
    """
    stages, names = model.stages(log, _MOST_STAGES), list(names)
    plain = [name for name in names if not isinstance(model.catalogue[name], Varied)]
    whole = stages[0][1]
    if len(stages) == 1:
        known = [_signature(log, whole, origin, *each) for each in _coordinates(whole, plain)]
    else:
        known = [_signature_by_stages(log, stages, origin, *each) for each in _coordinates(whole, plain)]
    return [*known, *varied_signatures(log, courses(names, model.catalogue), known)]


def _coordinates(model: Model, names: Iterable[str]) -> list[tuple[str, int]]:
    return [(name, each) for name in names for each in range(len(model.catalogue[name].free_scale))]


def varied_signatures(log: Log, changing: Sequence[Varied], known: Sequence[Signature]) -> list[Signature]:
    """The signatures of effects with a course, from those ``known`` of the effects that they are of."""
    result = []
    for each in changing:
        own = [signature for signature in known if signature.effect == each.base]
        for number, share in enumerate(each.course.shares(log).T[:, :, None]):
            first = number * len(own)
            result += [Signature(each.name, first + s.coordinate, s.D * share, s.E * share) for s in own]
    return result


def _signature_by_stages(
    log: Log, stages: Sequence[tuple[NDArray[np.bool_], Model]], origin: Floats, name: str, coordinate: int
) -> Signature:
    parts = [_signature(log.subset(rows), each, origin[rows], name, coordinate) for rows, each in stages]
    rows = [rows for rows, _ in stages]
    return Signature(
        name, coordinate, _joined(rows, [part.D for part in parts]), _joined(rows, [part.E for part in parts])
    )


def _signature(log: Log, model: Model, origin: Floats, name: str, coordinate: int) -> Signature:
    (ahead, plus), (behind, minus) = _sides(model, name, coordinate)
    further, before = one_second_paths(log, ahead, origin), one_second_paths(log, behind, origin)
    D = (further[:, -1] - before[:, -1]) / (plus - minus)
    if report_alike(ahead, behind):
        return Signature(name, coordinate, D, np.zeros_like(origin))
    E = (_seen(log, ahead, further) - _seen(log, behind, before)) / (plus - minus)
    return Signature(name, coordinate, D, E)


def _sides(model: Model, name: str, coordinate: int) -> list[tuple[Plant, float]]:
    """The plant with a coordinate moved by two steps: to both sides, or to one where the other is out of bounds."""
    size = model.catalogue[name].free_scale[coordinate]
    for steps in ((_PART, -_PART), (_ONE_SIDED_PART, 0.0), (0.0, -_ONE_SIDED_PART)):
        plants = [(model.plant_with_step(name, coordinate, step * size), step * size) for step in steps]
        known = [(plant, by) for plant, by in plants if plant is not None]
        if len(known) == len(plants):
            return known
    raise ConfigurationError(f"effect {name} has bounds too narrow for its ordinary size of {size:g}")


def next_states(log: Log, plant: Plant, origin: Floats) -> Floats:
    """Where the simulator takes each of ``origin`` [T, 6] within a second: [T, 6]."""
    return one_second_paths(log, plant, origin)[:, -1]


def one_second_paths(log: Log, plant: Plant, origin: Floats) -> Floats:
    """The way the simulator takes from each of ``origin`` [T, 6], quarter by quarter of a second: [T, 5, 6]."""
    controls, acting = acting_settings(log, plant)
    wind = np.repeat(log.wind[:, None, :], STEPS_PER_SECOND, axis=1)
    runs = simulate_batch(prompt(plant), origin, controls, wind, DT_S, 1, acting)
    if not runs.inside.all():  # a second beyond the model's range says nothing: as if she went on as she is
        runs.states[~runs.inside] = origin[~runs.inside, None]
    return runs.states


def acting_settings(log: Log, plant: Plant) -> tuple[Floats, Floats]:
    """The settings that act in each quarter of a second [T, 4, 5], and those that act at its start [T, 5].

    As reported but for the delay of the plant's feedback and the play behind it, and at the start its lag, which
    the simulator goes on with (:func:`prompt`).
    """
    lags_s, plays_rad = lags_of(plant), plays_of(plant)
    if plant.command_delay_s == 0.0 and not lags_s.any() and not plays_rad.any():
        return log.controls, log.controls[:, 0]
    if log.cut_from is not None:
        whole, rows = log.cut_from
        controls, acting = acting_settings(whole, plant)
        return controls[rows], acting[rows]
    controls, acting = np.empty_like(log.controls), np.empty((len(log), log.controls.shape[-1]))
    angles = angle_columns(log.actuators)
    for first, last in _stretches(log):
        series = log.controls[first:last].reshape(-1, log.controls.shape[-1])
        series = np.column_stack([np.unwrap(c) if i in angles else c for i, c in enumerate(series.T)])
        series = acting_controls(series, plant.command_delay_s, DT_S, angles)
        for column in np.flatnonzero(plays_rad):
            series[:, column] += _lost_motion(series[:, column], plays_rad[column], log.setting_step_s)
        controls[first:last] = series.reshape(controls[first:last].shape)
        acting[first:last] = _lagged(series, lags_s)[::STEPS_PER_SECOND]
    return controls, acting


def prompt(plant: Plant) -> Plant:
    """The plant for controls as :func:`acting_settings` gives them: without delay and play."""
    tight = {f"{each.name}_{PLAY}": 0.0 for each in plant.actuators if PLAY in KINDS[each.kind].numbers}
    still = replace(plant, command_delay_s=0.0)
    return still.replaced(**tight) if plays_of(plant).any() else still


def _lost_motion(motor: Floats, play_rad: float, step_s: float) -> Floats:
    """How far the end of a gear with play is from its motor's side [K], recorded every ``step_s`` [s].

    Noise of the feedback would drag the end along to its extremes: what stays in its usual range moves nothing.
    """
    every = max(1, round(step_s * STEPS_PER_SECOND))
    noise_rad = 1.4826 * float(np.median(np.abs(np.diff(motor[::every], 2)))) / sqrt(6.0)
    moved = behind_play(motor, _RANGE * noise_rad)
    return np.asarray(behind_play(moved, play_rad) - moved)


def _stretches(log: Log) -> Iterator[tuple[int, int]]:
    """The rows at which each stretch without a break in time begins and ends."""
    breaks = np.flatnonzero(np.diff(log.time_s) != 1) + 1
    return itertools.pairwise([0, *breaks.tolist(), len(log)])


def lags_of(plant: Plant) -> Floats:
    """The time constant [s] with which each control of a plant acts after it is reported [controls]."""
    lags_s = []
    for each in plant.actuators:
        kind = KINDS[each.kind]
        own = plant.number(f"{each.name}_{kind.lag}") if kind.lag else 0.0
        lags_s += [plant.thruster_lag_s + own] * len(kind.units)
    return np.array(lags_s)


def plays_of(plant: Plant) -> Floats:
    """The play [rad] between each control of a plant as it is reported and as it acts [controls]."""
    plays_rad = []
    for each in plant.actuators:
        kind = KINDS[each.kind]
        own = plant.number(f"{each.name}_{PLAY}") if PLAY in kind.numbers else 0.0
        plays_rad += [own if angle else 0.0 for angle in kind.angles]
    return np.array(plays_rad)


def _lagged(series: Floats, lags_s: Floats) -> Floats:
    """What acts at the start of each step of a series [K, controls] when each follows with its first-order lag."""
    result = series.copy()
    for column in np.flatnonzero(lags_s > 0.0):
        own = series[:, column]
        kept = np.exp(-DT_S / lags_s[column])
        before = np.append(own[:1], own[:-1])
        result[:, column] = lfilter([1.0 - kept], [1.0, -kept], before, zi=kept * own[:1])[0]
    return result


def sensor_readings(log: Log, plant: Plant, states: Floats) -> Floats:
    """States [T, 6] as the plant's sensors report them, delays along each unbroken stretch."""
    if not report_late(plant):  # the way there and back tells nothing
        return measure(states[:, None], plant, 1.0)[:, 0]
    return _seen(log, plant, one_second_paths(log, plant, states))


def _seen(log: Log, plant: Plant, ways: Floats) -> Floats:
    """What the sensors report at the start of each way [T, 5, 6] of :func:`one_second_paths`: [T, 6]."""
    return _around(log, plant, ways, [STEPS_PER_SECOND // 2])[:, 0]


def _around(log: Log, plant: Plant, ways: Floats, quarters: Sequence[int] = range(STEPS_PER_SECOND + 1)) -> Floats:
    """What the sensors report by quarters from half a second before each start of a way to half a second after.

    [T, 5, 6], or of some of the quarters. Seen from a start, the simulator says what was before and after: if the
    start is off, so are these.
    """
    result, half = np.empty((len(ways), len(quarters), 6)), STEPS_PER_SECOND // 2
    delays_s = [0.0] * 3 + [plant.speed_delay_s] * 3
    for first, last in _stretches(log):
        some, seconds = ways[first:last], np.arange(last - first, dtype=np.float64)
        seen = measure(_track(some), plant, DT_S)
        seen = np.concatenate([2.0 * seen[:1] - seen[half:0:-1], seen])
        jumps = np.concatenate([np.zeros((1, 6)), some[1:, 0] - some[:-1, -1]]).cumsum(axis=0)
        for place, quarter in enumerate(quarters):
            result[first:last, place] = seen[quarter::STEPS_PER_SECOND][: len(some)]
            for column, delay_s in enumerate(delays_s):
                times = seconds + (quarter - half) * DT_S - delay_s
                missed = jumps[:, column] - np.interp(times, seconds, jumps[:, column])
                result[first:last, place, column] += missed
    return result


def _track(ways: Floats) -> Floats:
    """Ways [T, 5, 6] joined to one track [4 T + 1, 6]: bent as the simulator's, jumps made up for evenly."""
    share = np.arange(STEPS_PER_SECOND)[:, None] / STEPS_PER_SECOND
    jumps = np.concatenate([ways[1:, :1] - ways[:-1, -1:], np.zeros_like(ways[:1, :1])])
    return np.concatenate([(ways[:, :-1] + share * jumps).reshape(-1, 6), ways[-1:, -1]])


def true_states(log: Log, plant: Plant) -> Floats:
    """The states [T, 6] that the plant's sensors would report as the log's smoothed motion."""
    states = log.nominal.copy()
    for _ in range(_ROUNDS):
        states += log.nominal - sensor_readings(log, plant, states)
    return states


def _sensor_slopes(plant: Plant, origin: Floats) -> Floats:
    """How the reported state changes with the true one of the same second [T, 6, 6]."""
    H = np.tile(np.eye(6), (len(origin), 1, 1))
    for column in range(6):
        step = np.zeros(6)
        step[column] = _STATE_STEPS[column]
        ahead, behind = (measure((origin + side * step)[:, None], plant, 1.0)[:, 0] for side in (1.0, -1.0))
        H[:, :, column] = (ahead - behind) / (2.0 * _STATE_STEPS[column])
    return H
