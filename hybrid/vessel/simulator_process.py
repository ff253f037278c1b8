"""Simulators of another make in processes of their own, so that one that hangs or dies takes nothing with it.

The product's side sends batches of runs and receives their states; the other side, :func:`serve_runs`, holds the
simulator: a class of a user's Python file, or an FMU. It notes which run it is at in memory that both sides see, so
that a run in which nothing comes back any more can be named. Pipes carry arrays and texts between the two sides of
one program; nothing from a file is unpickled.
"""

from __future__ import annotations

import atexit
import inspect
import mmap
import os
import socket
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import ceil, isfinite
from multiprocessing.connection import Connection
from pathlib import Path
from struct import Struct
from tempfile import TemporaryFile
from traceback import extract_tb
from typing import Any, Protocol

import numpy as np

from seatrial.acquisition.core import errors, named_code
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.vessel.signals import HEADING, SURGE, BodyPush, Signals

_PLACE = Struct("qq")  # the run, and its step; -1 for all of a batch
_SERVED = "seatrial.hybrid.vessel.simulator_process:serve_runs"
_WORKERS, _MOST_POOLS = 8, 3
_START_S = 120.0  # a file of a user's own may import much
_LEAST_STEP_S = 1e-9
_STATES = 6
_LOOKS = 0.125  # of the patience, between looks at where a run is


@dataclass(frozen=True, slots=True)
class FmuVariables:
    """Value references of an FMU: of the states and of what starts and sets them, of controls, wind and what the
    simulator lacks per mass; constant parameters, switches among them; and the longest step of its own integration,
    which depends on the ship's ``length_m``. A start is the state times ``start_scale``, where that is in another
    unit. An FMU that integrates in steps of ``fixed_step_s`` can only be stepped by whole ones."""

    state: tuple[int, ...]
    start: tuple[int, ...]
    control: tuple[int, ...]
    wind: tuple[int, ...]
    parameters: tuple[tuple[int, float], ...] = ()
    switches: tuple[tuple[int, bool], ...] = ()
    acceleration: tuple[int, ...] = ()
    own_step: int | None = None
    length_m: float = 0.0
    start_scale: tuple[float, ...] = ()
    fixed_step_s: float | None = None


@dataclass(frozen=True, slots=True)
class SimulatorSpec:
    """What a process must know of a simulator.

    ``source`` is ``FILE.py:CLASS`` or ``FILE.fmu``, with the SHA-256 of that file. Its own time step is ``step_s``
    at most, if it has one. A simulator that is ``vectorised`` steps all runs of a batch at once.
    It is ``settable`` if its state can be set before any step, else only when it starts. ``patience_s`` is the
    longest time that one step may take, ``batch`` how many runs one process is given at once, of which it can have
    ``instances`` going on side by side.
    """

    source: str
    sha256: str
    signals: Signals
    step_s: float | None = None
    vectorised: bool = False
    settable: bool = True
    takes_acceleration: bool = False
    patience_s: float = 30.0
    batch: int = 512
    instances: int = 512
    fmu: FmuVariables | None = None


class StuckRunError(Exception):
    """A batch did not come back: the ``run`` that did not, -1 if not known, and why."""

    def __init__(self, run: int, why: str) -> None:
        super().__init__(why)
        self.run, self.why = run, why


class SimulatorRuns(Protocol):
    """Runs of one simulator side by side; states and inputs are the simulator's own, [N, ...].

    A run that fails is NaN from then on and said in ``failures``.
    """

    failures: dict[int, str]

    def start(self, states: Floats, controls: Floats, wind: Floats) -> None:
        """Begin all runs anew in these states."""

    def step(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, changed: bool,
             acceleration: Floats | None) -> Floats:  # fmt: skip
        """The states ``dt_s`` later; ``changed`` says that they are not those that the last step returned."""

    def run(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, count: int) -> Floats:
        """The states [N, K, 6] from the ones begun with, each after ``count`` steps of ``dt_s`` under controls
        [N, K, controls] and wind [N, K, ...]. There may be more of them than instances."""


Beacon = Callable[[int, int], None]


class ClassRuns:
    """Runs of a user's class: one object for all of them if it is vectorised, else one for each."""

    def __init__(self, spec: SimulatorSpec, beacon: Beacon) -> None:
        self._factory = named_code.load(spec.source, "simulators")
        self._spec, self._beacon, self._steps = spec, beacon, 0
        self._objects: list[Any] = []
        self.failures: dict[int, str] = {}

    def start(self, states: Floats, controls: Floats, wind: Floats) -> None:
        self.failures, self._steps = {}, 0
        count = 1 if self._spec.vectorised else len(states)
        self._objects += [self._factory() for _ in range(count - len(self._objects))]
        resets = [getattr(simulator, "reset", None) for simulator in self._objects[:count]]
        for number, reset in enumerate(resets):
            if reset is None:
                continue
            row = states[number].tolist(), controls[number].tolist()
            inputs = (states, controls) if self._spec.vectorised else row
            self._beacon(-1 if self._spec.vectorised else number, 0)
            with self._report_failure(number):
                reset(*inputs[: len(inspect.signature(reset).parameters)])

    def step(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, changed: bool,
             acceleration: Floats | None) -> Floats:  # fmt: skip
        self._steps += 1
        later = np.full_like(states, np.nan)
        forces = {} if acceleration is None else {"acceleration": acceleration}
        if self._spec.vectorised:
            self._beacon(-1, self._steps)
            with self._report_failure(-1):
                later[:] = _require_size(self._objects[0].step(states, controls, wind, dt_s, **forces), len(states))
            return later
        # Equations written out are three times as fast on lists of numbers as on arrays.
        inputs = zip(states.tolist(), controls.tolist(), wind.tolist(), strict=True)
        valid, none = np.asarray(np.isfinite(states).all(axis=1)).tolist(), [np.nan] * 6
        rows: list[Any] = []
        for number, (simulator, row) in enumerate(zip(self._objects, inputs, strict=False)):
            rows.append(none)
            if number in self.failures or not valid[number]:
                continue
            self._beacon(number, self._steps)
            try:
                own = {} if acceleration is None else {"acceleration": acceleration[number].tolist()}
                rows[number] = _require_size(simulator.step(*row, dt_s, **own), 6)
            except Exception as error:
                self.failures[number] = raised_text(error)
        return self._as_array(rows)

    def run(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, count: int) -> Floats:
        if self._spec.vectorised:
            return run_step_by_step(self, states, controls, wind, dt_s, count)
        # One run after the other: between its steps nothing but the user's own lists, and none of them is kept.
        steps, kept, beacon = controls.shape[1] * count, array("d"), self._beacon
        valid = np.asarray(np.isfinite(states).all(axis=1)).tolist()
        inputs = (np.repeat(values, count, axis=1).tolist() for values in (controls, wind))
        rows = zip(self._objects, states.tolist(), *inputs, strict=False)
        for number, (simulator, state, own_controls, own_wind) in enumerate(rows):
            is_run, step = valid[number] and number not in self.failures, simulator.step
            try:
                for place, (control, air) in enumerate(
                    zip(own_controls, own_wind, strict=True) if is_run else (), 1
                ):
                    beacon(number, place)
                    state = step(state, control, air, dt_s)
                    if len(state) != _STATES:
                        _require_size(state, _STATES)
                    kept.extend(state)
                    if not isfinite(sum(state)):
                        break
            except Exception as error:
                is_result = isinstance(error, TypeError) and error.__traceback__ and not error.__traceback__.tb_next
                self.failures[number] = f"returned {state!r:.80}: {error}" if is_result else raised_text(error)
            del kept[len(kept) - len(kept) % _STATES :]  # of a state that is not all numbers
            kept.extend([np.nan] * ((number + 1) * steps * _STATES - len(kept)))
        return np.array(kept).reshape(len(states), steps, _STATES)[:, count - 1 :: count]

    def _as_array(self, rows: list[Any]) -> Floats:
        """What the steps returned [N, 6]; one that is not numbers is the failure of its run."""
        with suppress(TypeError, ValueError):
            return np.array(rows, dtype=np.float64)
        result = np.full((len(rows), 6), np.nan)
        for number, row in enumerate(rows):
            try:
                result[number] = row
            except (TypeError, ValueError) as error:
                self.failures[number] = f"returned {row!r:.80}: {error}"
        return result

    @contextmanager
    def _report_failure(self, number: int) -> Iterator[None]:
        """An exception becomes the failure of its run; of a whole batch, it ends the batch."""
        try:
            yield
        except Exception as error:
            if number < 0 or self._spec.vectorised:
                raise StuckRunError(-1, raised_text(error)) from error
            self.failures[number] = raised_text(error)


def _require_size(result: Any, size: int) -> Any:
    """What a step returned. Raises :class:`ValueError` for other than so many numbers or rows."""
    if len(result) != size:
        raise ValueError(f"step returned {len(result)} numbers or rows, not {size}")
    return result


def raised_text(error: Exception) -> str:
    """What a simulator raised, and the last line of code that did."""
    lines = extract_tb(error.__traceback__)
    place = f" ({Path(lines[-1].filename).name}, line {lines[-1].lineno})" if lines else ""
    return f"raised {type(error).__name__}: {error}{place}"


def run_step_by_step(
    runs: SimulatorRuns, states: Floats, controls: Floats, wind: Floats, dt_s: float, count: int
) -> Floats:
    """What :meth:`SimulatorRuns.run` returns, all runs a step at once."""
    result = np.empty((len(states), controls.shape[1], 6))
    for place in range(controls.shape[1]):
        for _ in range(count):
            states = runs.step(states, controls[:, place], wind[:, place], dt_s, False, None)
        result[:, place] = states
    return result


@dataclass(slots=True)
class ServedRuns:
    """Runs in our units, signals translated, long steps divided into the simulator's own."""

    spec: SimulatorSpec
    runs: SimulatorRuns
    last: Floats = field(default_factory=lambda: np.empty((0, 6)))

    def start(self, states: Floats, controls: Floats, wind: Floats) -> None:
        """Begin all runs in ``states`` [N, 6]."""
        self.last = states
        self.runs.start(*self._theirs(states, controls, wind))

    def step(
        self, states: Floats | None, controls: Floats, wind: Floats, dt_s: float, acceleration: Floats | None = None
    ) -> Floats:
        """The states [N, 6] ``dt_s`` later, from the last ones unless others are given.

        What the simulator lacks per mass, ``acceleration`` [N, 3], acts over the step, or where it takes none as
        one half of its impulse before the step and one half after.
        """
        changed = states is not None
        states = self.last if states is None else states
        if acceleration is not None and not self.spec.takes_acceleration:
            changed, states = True, states.copy()
            states[:, SURGE:] += 0.5 * dt_s * acceleration
        count = self._steps_in(dt_s)
        pushing = acceleration if self.spec.takes_acceleration else None
        for number in range(count):
            theirs, own_controls, own_wind = self._theirs(states, controls, wind)
            later = self.runs.step(theirs, own_controls, own_wind, dt_s / count, changed and number == 0, pushing)
            states = self.spec.signals.state_to_ours(later, states)
        if acceleration is not None and not self.spec.takes_acceleration:
            states = states.copy()
            states[:, SURGE:] += 0.5 * dt_s * acceleration
            self.last = np.full_like(states, np.nan)  # so that the next step sets it
        else:
            self.last = states
        return states

    def run(
        self, states: Floats, controls: Floats, wind: Floats, dt_s: float, push: BodyPush | None = None
    ) -> Floats:
        """The states [N, K+1, 6] under controls [N, K, controls], wind [N, K, 2] and a push."""
        self.start(states, controls[:, 0], wind[:, 0])
        if push is None and not self.spec.signals.wind.is_of_motion:
            return self._run_in_theirs(states, controls, wind, dt_s)
        result = np.empty((len(states), controls.shape[1] + 1, 6))
        result[:, 0] = states
        for k in range(controls.shape[1]):
            before = result[:, k]
            start = None if push is None or self.spec.takes_acceleration else before
            pushes = None if push is None else push.accelerations(before)
            result[:, k + 1] = self.step(start, controls[:, k], wind[:, k], dt_s, pushes)
        return result

    def _run_in_theirs(self, states: Floats, controls: Floats, wind: Floats, dt_s: float) -> Floats:
        """The same where no input depends on the motion: translated once before and once after all steps."""
        signals, (count, steps) = self.spec.signals, controls.shape[:2]
        own_controls = controls if signals.control.is_identity else signals.control.to_theirs(controls)
        own_wind = signals.wind.to_theirs(wind.reshape(-1, 2), np.zeros((count * steps, 6)))
        divided = self._steps_in(dt_s)
        later = self.runs.run(
            signals.state_to_theirs(states), own_controls, own_wind.reshape(count, steps, -1),
            dt_s / divided, divided,
        )  # fmt: skip
        start = np.repeat(states, steps, axis=0)
        result = np.empty((count, steps + 1, 6))
        result[:, 0], result[:, 1:] = (
            states,
            signals.state_to_ours(later.reshape(-1, 6), start).reshape(later.shape),
        )
        result[..., HEADING] = np.unwrap(result[..., HEADING], axis=1)
        self.last = result[:, -1]
        return result

    def _steps_in(self, dt_s: float) -> int:
        """Into how many of the simulator's own steps one of ``dt_s`` is divided."""
        return 1 if self.spec.step_s is None else max(1, ceil(dt_s / self.spec.step_s - _LEAST_STEP_S))

    def _theirs(self, states: Floats, controls: Floats, wind: Floats) -> tuple[Floats, Floats, Floats]:
        signals = self.spec.signals
        own_controls = controls if signals.control.is_identity else signals.control.to_theirs(controls)
        return signals.state_to_theirs(states), own_controls, signals.wind.to_theirs(wind, states)


def serve_runs(connection_number: int, memory_number: int) -> None:
    """The loop of the simulator's process: a specification first, then calls of :class:`ServedRuns`."""
    connection = Connection(connection_number)
    os.dup2(2, 1)  # what a simulator prints is no result
    memory = mmap.mmap(memory_number, _PLACE.size)

    def beacon(run: int, step: int) -> None:
        _PLACE.pack_into(memory, 0, run, step)

    spec: SimulatorSpec = connection.recv()
    served: ServedRuns | None = None
    while True:
        try:
            name, arguments = connection.recv()
        except (EOFError, ConnectionError):  # the product has ended it, perhaps with an answer on its way
            return
        beacon(-1, 0)
        try:
            if served is None:
                served = ServedRuns(spec, make_runs(spec, beacon))
            result = None if name == "load" else getattr(served, name)(*arguments)
            answer = ("done", result, dict(served.runs.failures))
        except StuckRunError as error:
            answer = ("failed", None, {error.run: error.why})
        except errors.SeatrialError as error:
            answer = ("refused", error, {})
        except Exception as error:  # a simulator may fail in every possible way
            answer = ("failed", None, {-1: raised_text(error)})
        with suppress(ConnectionError):
            connection.send(answer)


def make_runs(spec: SimulatorSpec, beacon: Beacon) -> SimulatorRuns:
    """The runs of the kind of simulator that a specification is of."""
    if spec.fmu is None:
        return ClassRuns(spec, beacon)
    from seatrial.hybrid.vessel.fmu_runs import FmuRuns

    return FmuRuns(spec, beacon)


class _Worker:
    """The process of a simulator, as the product sees it."""

    def __init__(self, spec: SimulatorSpec) -> None:
        self._spec = spec
        ours, theirs = socket.socketpair()
        with TemporaryFile() as file:
            file.truncate(_PLACE.size)
            self._memory = mmap.mmap(file.fileno(), _PLACE.size)
            code = "import sys; from seatrial.acquisition.core.named_code import import_object; " \
                   f"import_object({_SERVED!r})(*map(int, sys.argv[1:]))"  # fmt: skip
            numbers = theirs.fileno(), file.fileno()
            threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", code, *map(str, numbers)],
                stdin=subprocess.DEVNULL, pass_fds=numbers, env={**os.environ, **threads},
            )  # fmt: skip
        theirs.close()
        self._connection = Connection(ours.detach())
        self._connection.send(spec)

    def send(self, name: str, *arguments: Any) -> None:
        """Send a call. Raises :class:`StuckRunError` where the process is gone."""
        try:
            self._connection.send((name, arguments))
        except OSError as error:
            raise StuckRunError(-1, "its process ended") from error

    def receive(self, patience_s: float) -> tuple[Any, dict[int, str]]:
        """The result of a call and the failures of runs.

        Raises :class:`StuckRunError` where no step of a run comes back within ``patience_s``, and the error of a
        simulator that cannot be loaded.
        """
        place, since_s = _PLACE.unpack_from(self._memory), time.monotonic()
        while not self._connection.poll(_LOOKS * patience_s):
            now = _PLACE.unpack_from(self._memory)
            if now != place:
                place, since_s = now, time.monotonic()
            elif time.monotonic() - since_s > patience_s:
                raise StuckRunError(now[0], f"did not come back from step {now[1]} within {patience_s:g} s")
        try:
            kind, result, failures = self._connection.recv()
        except (EOFError, OSError) as error:
            run, step = _PLACE.unpack_from(self._memory)
            code = self._process.wait()
            raise StuckRunError(run, f"ended its process in step {step}, with code {code}") from error
        if kind == "refused":
            raise result
        if kind == "failed":
            ((run, why),) = failures.items()
            raise StuckRunError(run, why)
        return result, failures

    def close(self) -> None:
        """End the process."""
        with suppress(OSError):
            self._connection.close()
        self._process.kill()
        self._process.wait()


class SimulatorPool:
    """The processes of one simulator; started when needed, and again where one was ended."""

    def __init__(self, spec: SimulatorSpec) -> None:
        self.spec = spec
        self._workers: list[_Worker] = []
        atexit.register(self.close)

    def workers(self, runs: int) -> list[_Worker]:
        """As many processes as so many runs are worth."""
        worth = ceil(runs / (64 if self.spec.vectorised else 4))
        count = max(1, min(worth, os.cpu_count() or 1, _WORKERS))
        added = [_Worker(self.spec) for _ in range(count - len(self._workers))]
        self._workers += added
        try:
            for worker in added:
                worker.send("load")
            for worker in added:
                worker.receive(_START_S)
        except BaseException:
            self.close()
            raise
        return self._workers[:count]

    def close(self) -> None:
        """End all processes."""
        for worker in self._workers:
            worker.close()
        self._workers = []


_POOLS: dict[SimulatorSpec, SimulatorPool] = {}


def pool_of(spec: SimulatorSpec) -> SimulatorPool:
    """The processes of a simulator, kept until :data:`_MOST_POOLS` others have been used since."""
    pool = _POOLS.pop(spec, None) or SimulatorPool(spec)
    _POOLS[spec] = pool  # the last one used
    while len(_POOLS) > _MOST_POOLS:
        _POOLS.pop(next(iter(_POOLS))).close()
    return pool


class RemoteRuns:
    """Runs [N] divided among the processes of a simulator, with the calls of :class:`ServedRuns`.

    ``failures`` are the reasons of the runs that failed by their numbers.
    """

    def __init__(self, pool: SimulatorPool, count: int) -> None:
        self._pool, self._workers = pool, pool.workers(count)
        self._parts: list[Ints] = np.array_split(np.arange(count), len(self._workers))
        self.failures: dict[int, str] = {}

    def start(self, states: Floats, controls: Floats, wind: Floats) -> None:
        """Begin all runs in ``states`` [N, 6]."""
        self._call("start", lambda part: (states[part], controls[part], wind[part]))

    def step(
        self, states: Floats | None, controls: Floats, wind: Floats, dt_s: float, acceleration: Floats | None = None
    ) -> Floats:
        """The states [N, 6] ``dt_s`` later."""
        later: Floats = self._call("step", lambda part: (
            None if states is None else states[part], controls[part], wind[part], dt_s,
            None if acceleration is None else acceleration[part],
        ))  # fmt: skip
        return later

    def run(
        self, states: Floats, controls: Floats, wind: Floats, dt_s: float, push: BodyPush | None = None
    ) -> Floats:
        """The states [N, K+1, 6] under controls [N, K, controls], wind [N, K, 2] and a push."""
        states = self._call("run", lambda part: (states[part], controls[part], wind[part], dt_s, push))
        return states

    def _call(self, name: str, arguments: Callable[[Ints], tuple[Any, ...]]) -> Any:
        pairs = list(zip(self._workers, self._parts, strict=True))
        offset = 0
        try:
            for worker, part in pairs:
                worker.send(name, *arguments(part))
            results = []
            for worker, part in pairs:
                offset = int(part[0])
                result, failures = worker.receive(self._pool.spec.patience_s)
                results.append(result)
                self.failures.update({offset + run: why for run, why in failures.items()})
        except StuckRunError as error:
            self._pool.close()
            raise StuckRunError(error.run if error.run < 0 else offset + error.run, error.why) from error
        except BaseException:
            self._pool.close()
            raise
        return np.concatenate(results) if results[0] is not None else None
