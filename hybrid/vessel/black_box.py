"""A simulator of another make as a reference model: an FMU, or a class of a user's own Python file.

Its equations cannot be looked into: it predicts and simulates, and that is all. Whatever needs only that asks it as
it asks a vessel file's plant (:data:`MotionModel`); what needs the coefficients refuses it (:func:`equations_of`).
What acts outside it can be changed as a plant's numbers are (:mod:`.outside`), so that effects are added to it.
Runs go through processes of their own (:mod:`.simulator_process`): one that raises, returns no number, hangs or
dies is left out and named, and the others go on.

A run starts from the six numbers of a state alone. What else a simulator remembers, as the lag of a drive, begins
as its own reset leaves it. One that cannot start from a state is run in before: through what was recorded until
then, or else under the first controls, and its track is then moved and turned onto the measured pose.

In a current a ship moves as in still water that is carried along (Galilei's principle), with the wind as it is over
that water.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Context
from seatrial.acquisition.core import named_code, ship
from seatrial.acquisition.core.errors import ConfigurationError, SourceError
from seatrial.acquisition.core.files import parse_toml, read_text, validate_toml
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Strings
from seatrial.hybrid.vessel import outside, simulator_map
from seatrial.hybrid.vessel.files import Dimensions
from seatrial.hybrid.vessel.plant import Plant, plant_hash
from seatrial.hybrid.vessel.signals import (
    NO_PUSH,
    BodyPush,
    align_tracks,
    contradictions,
    states_over_water,
    wind_over_water,
)
from seatrial.hybrid.vessel.simulator_map import SimulatorMap
from seatrial.hybrid.vessel.simulator_process import RemoteRuns, SimulatorSpec, StuckRunError, pool_of

LOG = logging.getLogger("seatrial.own")
_MOST_STUCK = 12  # runs that hang or die: then the simulator is at fault, not the run
_ALL_RUNS = 8  # so many runs or more that all fail are the simulator's fault
_NAMED = 3  # runs named of each kind of failure
BATCH, _VECTOR_BATCH = 512, 4096
_EXAMINED: set[tuple[str, str]] = set()  # files and fingerprints of simulators whose first runs were examined
_AGAIN_STEPS, _CHANCE = 5, 1e-9  # of a run that is done again, and by which the result may then be another


@dataclass(frozen=True, slots=True)
class BlackBox:
    """A simulator as the model of a ship.

    ``file`` is its path, with ``:CLASS`` of a Python file; ``digest`` a fingerprint of simulator and map.
    ``actuator`` are the actuators with the limits of their drives. With ``run_in_s`` it cannot start from a state
    and is run in for that long. ``numbers`` are those outside it that are not neutral; ``effects`` are added to it
    and made them.
    """

    name: str
    file: str
    digest: str
    spec: SimulatorSpec
    actuator: tuple[simulator_map.MappedActuator, ...]
    length_between_perpendiculars_m: float
    length_overall_m: float
    draught_m: float | None = None
    run_in_s: float | None = None
    numbers: Mapping[str, float] = field(default_factory=dict, hash=False)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict, compare=False)
    surge_high_mps: float = field(default=inf, init=False)
    layout: ship.Actuators = field(init=False, compare=False)
    _neutral: Mapping[str, float] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Keep names and kinds of the actuators, in the order of their controls, and their neutral numbers."""
        layout = tuple(ship.Actuator(entry.name, entry.kind) for entry in self.actuator)
        object.__setattr__(self, "layout", layout)
        object.__setattr__(self, "_neutral", outside.neutral_numbers(layout))

    @property
    def actuators(self) -> ship.Actuators:
        """The layout, as a vessel file calls it."""
        return self.layout

    @property
    def dimensions(self) -> Dimensions:
        """The dimensions, as of a vessel file; NaN where the simulator states none."""
        nan = float("nan")
        draught_m = nan if self.draught_m is None else self.draught_m
        return Dimensions(self.length_overall_m, self.length_between_perpendiculars_m, nan, draught_m)

    def __getattr__(self, name: str) -> float:
        """A number outside the simulator by its name."""
        if name.startswith("_") or name not in self._neutral:
            raise AttributeError(f"a simulator has no {name}")
        return self.number(name)

    def number(self, name: str) -> float:
        """A number outside the simulator. Raises :class:`ConfigurationError` for one inside it."""
        if name not in self._neutral:
            raise inside_error(self, f"{name} cannot be changed in it")
        return self.numbers.get(name, self._neutral[name])

    @property
    def context(self) -> Context:
        """What is known of it beforehand: nothing."""
        return Context()

    @property
    def current_mps(self) -> tuple[float, float]:
        """How fast the water moves north and east."""
        return self.number("current_north_mps"), self.number("current_east_mps")

    @property
    def push(self) -> BodyPush | None:
        """What pushes the ship beside the simulator."""
        return outside.body_push(self.number, self.length_between_perpendiculars_m)

    @property
    def fixed_step_s(self) -> float | None:
        """The one step in which it integrates, of which all others have to be multiples; None if it takes any."""
        return None if self.spec.fmu is None else self.spec.fmu.fixed_step_s

    @property
    def takes_wind(self) -> bool:
        """Whether the wind makes a difference to it."""
        return self.spec.signals.wind.form != "none"

    def of_kind(self, kind: str) -> tuple[simulator_map.MappedActuator, ...]:
        """The actuators of one kind."""
        return tuple(entry for entry in self.actuator if entry.kind == kind)

    def replaced(self, **values: float) -> BlackBox:
        """This simulator with numbers outside it of these names instead. Raises :class:`ConfigurationError` for
        other numbers."""
        neutral, numbers = self._neutral, {**self.numbers, **values}
        if unknown := [name for name in values if name not in neutral]:
            raise inside_error(self, f"{unknown[0]} cannot be changed in it")
        return replace(self, numbers={name: value for name, value in numbers.items() if value != neutral[name]})

    def shifted(self, **amounts: float) -> BlackBox:
        """This simulator with each amount added to the number of its name."""
        return self.replaced(**{name: self.number(name) + amount for name, amount in amounts.items()})

    def scaled(self, factor: float, *names: str) -> BlackBox:
        """This simulator with the named numbers multiplied by ``factor``."""
        return self.replaced(**{name: factor * self.number(name) for name in names})


MotionModel = Plant | BlackBox
"""A model of a ship that predicts and simulates: the plant of a vessel file, or a simulator of another make."""


def inside_error(model: BlackBox, why: str) -> ConfigurationError:
    """The error for a question that only the equations of a simulator could answer."""
    return ConfigurationError(
        "is a simulator, whose equations cannot be looked into", where=model.file, why=why,
        fix="give a vessel file, which `seatrial vessel new` makes; simulators are for validate, evaluate, train, "
        "predict, watch, simulate and diagnose",
    )  # fmt: skip


def equations_of(model: MotionModel, why: str) -> Plant:
    """The plant of a model whose numbers are needed. Raises :class:`ConfigurationError` for a simulator."""
    if isinstance(model, BlackBox):
        raise inside_error(model, why)
    return model


def model_digest(model: MotionModel) -> str:
    """A fingerprint (SHA-256) of a model, the same in every session."""
    if not isinstance(model, BlackBox):
        return plant_hash(model)
    added = json.dumps({name: dict(values) for name, values in model.effects.items()}, sort_keys=True)
    return hashlib.sha256((model.digest + added).encode()).hexdigest() if model.effects else model.digest


def bare_simulator(name: str | Path) -> BlackBox:
    """The simulator of ``FILE.fmu`` or ``FILE.py:CLASS``, with the map beside it. Raises
    :class:`ConfigurationError`."""
    location = named_code.split_code_reference(str(name))
    if location is not None:
        return _simulator_of_class(str(name), *location)
    from seatrial.hybrid.vessel import fmu

    model: BlackBox = fmu.load_fmu(Path(name).resolve())
    return model


def _simulator_of_class(name: str, file: Path, attribute: str) -> BlackBox:
    """A class of a Python file, which states ship and actuators; the map beside it, if any, its units."""
    name = named_code.absolute_code_reference(name)
    factory: Any = named_code.load(name, "simulators")
    if not callable(factory) or not hasattr(factory, "__mro__"):
        raise ConfigurationError("is not a class", where=name, fix="write a class with step")
    parameters = ("state", "controls", "wind", "dt_s")
    named_code.require_signature(factory, name, *parameters, method="step")
    path = file.resolve().with_suffix(".toml")
    mapped = _map_of_class(factory, attribute, name, path)
    vectorised = bool(getattr(factory, "vectorised", False))
    code = file.read_bytes()
    batch = _VECTOR_BATCH if vectorised else BATCH
    spec = SimulatorSpec(
        name, hashlib.sha256(code).hexdigest(),
        simulator_map.signals_of_map(mapped, mapped.actuators, path, complete=False),
        step_s=mapped.solver.step_s, vectorised=vectorised, patience_s=mapped.solver.patience_s,
        takes_acceleration="acceleration" in inspect.signature(factory.step).parameters,
        batch=batch, instances=batch,
    )  # fmt: skip
    return black_box(name, spec, mapped, code, path)


def _map_of_class(factory: Any, attribute: str, name: str, path: Path) -> SimulatorMap:
    """What a class states of itself, and above that the map beside it. Raises :class:`ConfigurationError`."""
    length_m, actuators = getattr(factory, "length_m", None), getattr(factory, "actuators", None)
    if length_m is None:
        fix = "write its length between perpendiculars [m]: length_m = 30.0"
        raise ConfigurationError("states no length_m", where=name, fix=fix)
    if not isinstance(actuators, Mapping) or not actuators:
        fix = 'write them by name and kind: actuators = {"propeller": "propeller", "rudder": "rudder"}'
        raise ConfigurationError("states no actuators", where=name, fix=fix)
    stated: dict[str, Any] = {
        "ship": {"name": getattr(factory, "name", attribute), "length_m": length_m},
        "actuator": [
            {"name": actuator, **({"kind": numbers} if isinstance(numbers, str) else numbers)}
            for actuator, numbers in actuators.items()
        ],
        "solver": {key: getattr(factory, key) for key in ("step_s", "patience_s") if hasattr(factory, key)},
    }
    stated["ship"] |= {
        key: getattr(factory, key) for key in ("length_overall_m", "draught_m") if hasattr(factory, key)
    }
    text = read_text(path) if path.is_file() else ""
    written = parse_toml(text, path)
    stated["solver"] |= written.pop("solver", {})
    return validate_toml({**stated, **written}, text, path if text else name, SimulatorMap)


def black_box(
    file: str, spec: SimulatorSpec, mapped: SimulatorMap, content: bytes, map_path: Path, *, run_in: bool = False
) -> BlackBox:
    """The model of a simulator, of whose file ``content`` is what its fingerprint is made of, with its map."""
    stated = mapped.ship
    digest = hashlib.sha256(content)
    if map_path.is_file():
        digest.update(map_path.read_bytes())
    return BlackBox(
        name=stated.name, file=file, digest=digest.hexdigest(), spec=spec, actuator=mapped.actuator,
        length_between_perpendiculars_m=stated.length_m,
        length_overall_m=stated.length_overall_m or stated.length_m, draught_m=stated.draught_m,
        run_in_s=mapped.solver.run_in_s if run_in else None,
    )  # fmt: skip


RunNames = Callable[[int], str]
"""What a run is called in a message: the window that it predicts."""


@dataclass(slots=True)
class FailedRuns:
    """Runs of ``count`` in which a simulator failed, and why, for one message at the end."""

    model: BlackBox
    count: int
    why: dict[int, str] = field(default_factory=dict)

    def warn(self, name_of: RunNames | None) -> None:
        """Log what failed, a line each reason, whatever its numbers: by name, or where runs have none how many."""
        by_reason: dict[str, list[int]] = {}
        for number, reason in sorted(self.why.items()):
            by_reason.setdefault(re.sub(r"\d[\d.e+-]*", "0", reason), []).append(number)
        for numbers in by_reason.values():
            reason = self.why[numbers[0]]
            left_out = f"{len(numbers):,} of {self.count:,} runs"
            if name_of is not None:
                left_out = ", ".join(name_of(number) for number in numbers[:_NAMED])
                left_out += f" and {len(numbers) - _NAMED:,} more" if len(numbers) > _NAMED else ""
            LOG.warning("%s: left out %s: the simulator %s", self.model.name, left_out, reason)


Job = Callable[[Ints, RemoteRuns], None]


def run_all(
    model: BlackBox, count: int, job: Job, name_of: RunNames | None = None, *, may_fail: bool = False,
    goes_on: bool = False,
) -> Bools:  # fmt: skip
    """Run a job on batches of so many runs; which of them [count] came back.

    The ``job`` is given the numbers of a batch's runs and the runs themselves. A run that hangs or takes its
    process with it is left out and the rest of its batch is done again; where it is not known which run that is,
    the batch is halved. Raises :class:`SourceError` where that happens again and again, or where all runs fail.
    Where runs ``may_fail``, as those of a model that is being adapted, all of them may, and nothing is logged.
    A job that ``goes_on`` steps all runs of a batch side by side from where they are.
    """
    pool, failed, stuck = pool_of(model.spec), FailedRuns(model, count), 0
    size = (model.spec.instances if goes_on else model.spec.batch) * max(1, len(pool.workers(count)))
    pending = [numbers for numbers in np.array_split(np.arange(count), max(1, -(-count // size))) if len(numbers)]
    while pending:
        numbers = pending.pop(0)
        try:
            runs = RemoteRuns(pool, len(numbers))
            job(numbers, runs)
            failed.why.update({int(numbers[run]): why for run, why in runs.failures.items()})
        except StuckRunError as error:
            if error.run < 0 and len(numbers) > 1:
                pending = [*np.array_split(numbers, 2), *pending]
                continue
            run, stuck = max(error.run, 0), stuck + 1
            failed.why[int(numbers[run])] = error.why
            if stuck >= _MOST_STUCK or len(failed.why) == count:
                failed.warn(name_of)
                raise SourceError(
                    f"failed in {len(failed.why)} runs of {count}", where=model.file, why=error.why,
                    fix="run one of them by itself and correct it, or raise patience_s",
                ) from error  # fmt: skip
            if len(numbers) > 1:
                pending = [np.delete(numbers, run), *pending]
    if not may_fail:
        failed.warn(name_of)
    if not may_fail and count >= _ALL_RUNS and len(failed.why) == count:
        reason = next(iter(failed.why.values()))
        raise SourceError(
            f"failed in all {count} runs", where=model.file, why=f"it {reason}", fix="correct it there"
        )
    came_back = np.ones(count, dtype=bool)
    came_back[list(failed.why)] = False
    return came_back


@dataclass(frozen=True, slots=True)
class RunIn:
    """What was recorded before N runs, oldest first: ``controls`` [N, P, controls] and ``wind`` [N, P, 2] over each
    second, and ``heading`` [N, P] at its start."""

    controls: Floats
    wind: Floats
    heading: Floats

    def subset(self, numbers: Ints) -> RunIn:
        """That of some of the runs."""
        return RunIn(self.controls[numbers], self.wind[numbers], self.heading[numbers])


def simulate_black_box(
    model: BlackBox,
    start: Floats,
    controls: Floats,
    wind: Floats,
    dt_s: float,
    name_of: RunNames | None = None,
    history: RunIn | None = None,
) -> Floats:
    """The states [N, K+1, 6] of runs; NaN where a run failed, from the step on in which it returned no number.

    ``start`` [N, 6], ``controls`` [N, K, controls] and ``wind`` [N, K, 2] as in :func:`.simulate_batch`. Of a model
    that is run in, ``history`` is what it is run in with; without it the first controls and wind.
    """
    count, steps = len(start), controls.shape[1]
    states = np.full((count, steps + 1, 6), np.nan)
    start, push = states_over_water(start, model.current_mps, 0.0), model.push
    controls, wind = inputs_inside(model, controls, wind, dt_s)
    history = history and RunIn(*inputs_inside(model, history.controls, history.wind, 1.0), history.heading)

    def job(numbers: Ints, runs: RemoteRuns) -> None:
        if model.run_in_s is None:
            states[numbers] = runs.run(start[numbers], controls[numbers], wind[numbers], dt_s, push)
        else:
            states[numbers] = _run_in(
                model, runs, start[numbers], controls[numbers], wind[numbers], dt_s,
                None if history is None else history.subset(numbers),
            )  # fmt: skip

    follows = push is not None or model.spec.signals.wind.is_of_motion  # its inputs follow from the last step
    came_back = run_all(model, count, job, name_of, goes_on=follows or model.run_in_s is not None)
    is_examined, again = (model.file, model.digest) in _EXAMINED, list[Floats]()
    if not is_examined and count >= _ALL_RUNS and came_back[0] and model.run_in_s is None:
        first = start[:1], controls[:1, :_AGAIN_STEPS], wind[:1, :_AGAIN_STEPS]
        run_all(model, 1, lambda _, runs: again.append(runs.run(*first, dt_s, push)[0]))
    states[~came_back, 1:] = np.nan
    states[:, 0] = start
    failed, valid = FailedRuns(model, count), np.asarray(np.isfinite(states).all(axis=2))
    for row in np.flatnonzero(came_back & valid[:, 0] & ~valid.all(axis=1)):  # that started well
        failed.why[int(row)] = f"returned no number after {dt_s * int(np.argmin(valid[row])):g} s"
    failed.warn(name_of)
    if not is_examined:
        _EXAMINED.add((model.file, model.digest))
        _examine_first_runs(model, states[came_back], dt_s, again)
    elapsed_s = dt_s * np.arange(steps + 1)
    north, east = model.current_mps
    return states_over_water(states, (-north, -east), elapsed_s)


def inputs_inside(model: BlackBox, controls: Floats, wind: Floats, dt_s: float) -> tuple[Floats, Floats]:
    """The controls [N, K, controls] that reach a simulator's drives and the wind [N, K, 2] over its water, where
    these were recorded over steps of ``dt_s``."""
    air = wind_over_water(outside.true_wind(wind, model.number), model.current_mps)
    return outside.controls_inside(controls, model.number, model.layout, dt_s), air


Step = Callable[[Floats, Floats, Floats, float, Floats], Floats]


def step_over_ground(models: Sequence[BlackBox], step: Step) -> Step:
    """The ``step`` (states, controls, wind, dt_s, acceleration) of runs of one simulator, each with what pushes the
    ship of its model beside it, over ground. Its inputs are those of :func:`inputs_inside`."""
    currents = np.array([model.current_mps for model in models]).T
    pushes = [model.push or NO_PUSH for model in models]
    push = BodyPush(np.array([own.constant for own in pushes]), np.array([own.drag for own in pushes]))

    def stepped(states: Floats, controls: Floats, wind: Floats, dt_s: float, acceleration: Floats) -> Floats:
        over_water = states_over_water(states, currents, 0.0)
        later = step(over_water, controls, wind, dt_s, acceleration + push.accelerations(over_water))
        return states_over_water(later, -currents, dt_s)

    return stepped if any(model.numbers for model in models) else step


def _examine_first_runs(model: BlackBox, states: Floats, dt_s: float, again: Sequence[Floats]) -> None:
    """Warn where the poses of runs [N, K+1, 6] do not change as their speeds say, and where the first, done again
    [K+1, 6], has another result."""
    if sentences := contradictions(states, dt_s):
        LOG.warning("%s: %s: compare variable, unit, positive and zero of these and of heading in its map with "
                    "what the simulator counts", model.name, "; ".join(sentences))  # fmt: skip
    for repeated in again:
        difference = np.abs(states[0, : len(repeated)] - repeated)
        if (difference > _CHANCE * (1.0 + np.abs(repeated))).any():
            LOG.warning("%s: the same run has another result when it is done again, by up to %.2g m after %d steps:"
                        " chance plays in it, or it remembers what its reset does not clear; figures will vary",
                        model.name, difference[-1, :2].max(), len(repeated) - 1)  # fmt: skip


def _run_in(
    model: BlackBox, runs: RemoteRuns, start: Floats, controls: Floats, wind: Floats, dt_s: float,
    history: RunIn | None,
) -> Floats:  # fmt: skip
    """The states [N, K+1, 6] of a model that is run in first: the wind comes from where it did off its bow."""
    if history is None:
        inputs = controls[:, :1], wind[:, :1], start[:, 2:3]
        history = RunIn(*(np.repeat(values, round(model.run_in_s or 0.0), axis=1) for values in inputs))
    states = np.zeros((len(start), 6))
    runs.start(states, history.controls[:, 0], history.wind[:, 0])

    def turned(air: Floats, heading: Floats) -> Floats:
        turn = heading - np.nan_to_num(states[:, 2])
        return np.column_stack([air[:, 0] - turn, air[:, 1]])

    for second in range(history.controls.shape[1]):
        air = turned(history.wind[:, second], history.heading[:, second])
        states = runs.step(None, history.controls[:, second], air, 1.0)
    result = np.empty((len(start), controls.shape[1] + 1, 6))
    result[:, 0] = states
    lag = start[:, 2] - states[:, 2]
    for step in range(controls.shape[1]):
        air = np.column_stack([wind[:, step, 0] - lag, wind[:, step, 1]])
        result[:, step + 1] = runs.step(None, controls[:, step], air, dt_s)
    return align_tracks(result, start, 0)


def names_of_windows(trial: Strings, start_time: pd.DatetimeIndex) -> RunNames:
    """The names of windows: their recording and when they start."""
    return lambda number: f"the window of {trial[number]} from {start_time[number]:%Y-%m-%d %H:%M:%S}Z"
