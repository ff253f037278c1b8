"""Runs of an FMU in the process of a simulator, by FMPy. It imports nothing that compiles, to start quickly.

A step of a compiled model takes some microseconds, and a filter starts it anew in each second of thousands of runs.
So the functions of the standards are called with arguments made once: FMPy's lists cost more than such a step.
"""

from __future__ import annotations

import atexit
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from ctypes import POINTER, byref, c_bool, c_double, c_int, c_uint32
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.vessel.signals import HEADING, STATES, SURGE, SWAY
from seatrial.hybrid.vessel.simulator_process import Beacon, SimulatorSpec, raised_text
from seatrial.hybrid.vessel.step_lengths import LONGEST_STEP_S, steps_per_second

INSTALL = "pip install 'seatrial[fmu]'"
_START_TOLERANCE = 1e-6
_WHOLE_STEPS = 1e-6  # of a step: what a number of them may be off a whole one by rounding


def require_fmpy() -> Any:
    """FMPy. Raises :class:`ConfigurationError` where it is not installed."""
    if find_spec("fmpy") is None:
        raise ConfigurationError("FMUs are run by FMPy, which is not installed", fix=INSTALL)
    import fmpy

    return fmpy


def read_description(file: Path) -> Any:
    """The model description of an FMU for co-simulation. Raises :class:`InputError`."""
    fmpy = require_fmpy()
    try:
        description = fmpy.read_model_description(str(file), validate=False)
    except Exception as error:  # foreign files may fail in every possible way
        reason = str(error).splitlines()[0][:160] if str(error) else type(error).__name__
        raise InputError("is not a readable FMU", where=str(file), why=reason,
                         fix="export it again, for FMI 2.0 or 3.0 and co-simulation") from error  # fmt: skip
    version = str(description.fmiVersion)
    if not version.startswith(("2.", "3.")) or description.coSimulation is None:
        kind = "only for model exchange" if version.startswith(("2.", "3.")) else f"of FMI {version}"
        raise InputError(f"is {kind}", where=str(file), fix="export it for FMI 2.0 or 3.0 and co-simulation")
    return description


class _Values:
    """Some variables of an instance, and room for their values that the FMU reads and writes itself."""

    __slots__ = ("arguments", "values")

    def __init__(self, references: Iterable[int], *, third: bool) -> None:
        numbers = tuple(references)
        self.values = np.zeros(len(numbers))
        pointer = self.values.ctypes.data_as(POINTER(c_double))
        counted = [len(numbers)] if third else []
        self.arguments = (c_uint32 * len(numbers))(*numbers), len(numbers), pointer, *counted


class _Slave:
    """One instance of an FMU, through the standard's own functions."""

    def __init__(self, description: Any, folder: str, name: str, switches: Iterable[tuple[int, bool]]) -> None:
        from fmpy import fmi2, fmi3

        third = is_of_fmi_3(description)
        self._fmu = (fmi3.FMU3Slave if third else fmi2.FMU2Slave)(
            guid=description.guid, unzipDirectory=folder, instanceName=name,
            modelIdentifier=description.coSimulation.modelIdentifier, requireFunctions=False,
        )  # fmt: skip
        self._fmu.instantiate()
        self.time_s = 0.0
        functions, component = self._fmu._functions, self._fmu.component

        def function(name: str, *arguments: Any) -> Callable[..., int]:
            return partial(functions[f"fmi{3 if third else 2}{name}"], component, *arguments)

        boolean, counted = (c_bool, (1,)) if third else (c_int, ())
        self._begin = [] if third else [function("SetupExperiment", 0, 0.0, 0.0, 0, 0.0)]
        self._begin += [
            function("SetBoolean", (c_uint32 * 1)(reference), 1, (boolean * 1)(value), *counted)
            for reference, value in switches
        ]
        self._enter = function("EnterInitializationMode", *([False, 0.0, 0.0, False, 0.0] if third else []))
        self._exit = function("ExitInitializationMode")
        number = "Float64" if third else "Real"
        self._set, self._get, self._step = (function(f"Set{number}"), function(f"Get{number}"), function("DoStep"))
        flags = (c_bool(), c_bool(), c_bool(), c_double())  # of an event, of an end, of an early return, its time
        self._of_step = (True, *(byref(flag) for flag in flags)) if third else (1,)

    def write(self, variables: _Values, values: Any) -> None:
        """Set variables."""
        if len(variables.values):
            variables.values[:] = values
            _require(self._set(*variables.arguments), "set a variable")

    def read(self, variables: _Values) -> Floats:
        """Get variables; the array is that of the next reading, too."""
        _require(self._get(*variables.arguments), "return its state")
        return variables.values

    def reset(self) -> None:
        """Go back to before initialisation."""
        self._fmu.reset()

    def initialise(self, before: tuple[_Values, Floats], inside: tuple[_Values, Floats]) -> None:
        """Initialise, with the switches and values set ``before`` that and values ``inside`` it."""
        for begin in self._begin:
            _require(begin(), "set a switch")
        self.write(*before)
        _require(self._enter(), "initialise")
        self.write(*inside)
        _require(self._exit(), "initialise")
        self.time_s = 0.0

    def step(self, dt_s: float) -> None:
        """Step by ``dt_s``."""
        _require(self._step(self.time_s, dt_s, *self._of_step), "step")
        self.time_s += dt_s

    def free(self) -> None:
        """Release the instance."""
        with suppress(Exception):
            self._fmu.terminate()
        with suppress(Exception):
            self._fmu.freeInstance()


def is_of_fmi_3(description: Any) -> bool:
    """Whether an FMU is of FMI 3.0, else of 2.0."""
    return str(description.fmiVersion).startswith("3.")


class RefusedCallError(Exception):
    """An FMU answered a call with an error."""


_STATUS = {2: "discard", 3: "error", 4: "fatal", 5: "pending"}
_ADVICE = {
    "initialise": ": a number that it needs is set in [parameters] of its map",
    "step": ": if it takes steps of one length alone, that is fixed_step_s in [solver] of its map",
}


def _require(status: int, what: str) -> None:
    if status > 1:  # ok and warning
        answer = _STATUS.get(status, str(status))
        raise RefusedCallError(f"could not {what} (FMI status {answer}){_ADVICE.get(what, '')}")


class FmuRuns:
    """Runs of an FMU: an instance for each of those that go on side by side. Those that start anew before each
    step, or sail one after the other, may be more than the instances."""

    def __init__(self, spec: SimulatorSpec, beacon: Beacon) -> None:
        fmpy = require_fmpy()
        assert spec.fmu is not None
        self._spec, self._beacon, self._variables, self._steps = spec, beacon, spec.fmu, 0
        self._description = read_description(Path(spec.source))
        self._folder = fmpy.extract(spec.source)
        atexit.register(shutil.rmtree, self._folder, ignore_errors=True)
        self._slaves: list[_Slave | None] = [None] * spec.instances
        variables, values = spec.fmu, partial(_Values, third=is_of_fmi_3(self._description))
        own_step = () if variables.own_step is None else (variables.own_step,)
        constants = [reference for reference, _ in variables.parameters]
        self._state, self._start = values(variables.state), values(variables.start)
        self._before = values([*constants, *variables.start, *own_step])
        self._inputs = values([*variables.control, *variables.wind, *variables.acceleration])
        self._checked = not variables.start
        self.failures: dict[int, str] = {}

    def start(self, states: Floats, controls: Floats, wind: Floats) -> None:
        self.failures, self._steps = {}, 0  # an FMU is started where it first steps

    def step(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, changed: bool,
             acceleration: Floats | None) -> Floats:  # fmt: skip
        self._refuse_broken_step(dt_s)
        is_first, self._steps = self._steps == 0, self._steps + 1
        is_set = changed and self._spec.settable and not is_first
        is_started = is_first or (changed and not is_set and bool(self._variables.start))
        later, inputs = np.full_like(states, np.nan), self._inputs_of(controls, wind, acceleration)
        in_filter = acceleration is not None and not self._spec.settable
        before = self._before_start(states, in_filter=in_filter) if is_started else None
        for number in np.flatnonzero(np.isfinite(states).all(axis=1)).tolist():
            if number in self.failures:
                continue
            self._beacon(number, self._steps)
            try:
                if before is not None:
                    slave = self._started(number, states[number], before[number], inputs[number])
                else:
                    slave = cast("_Slave", self._slaves[number % len(self._slaves)])
                    if is_set:
                        slave.write(self._start, self._starts_of(states[number]))
                    slave.write(self._inputs, inputs[number])
                slave.step(dt_s)
                later[number] = slave.read(self._state)
            except Exception as error:  # an FMU may fail in every possible way
                self._fail(number, error)
        return later

    def run(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, count: int) -> Floats:
        self._refuse_broken_step(dt_s)
        result = np.full((len(states), controls.shape[1], 6), np.nan)
        inputs, before = self._inputs_of(controls, wind, None), self._before_start(states, in_filter=False)
        for number in np.flatnonzero(np.isfinite(states).all(axis=1)).tolist():
            self._beacon(number, 1)
            try:
                slave = self._started(number, states[number], before[number], inputs[number, 0])
                for place, values in enumerate(inputs[number]):
                    slave.write(self._inputs, values)
                    for part in range(1, count + 1):
                        self._beacon(number, place * count + part)
                        slave.step(dt_s)
                    result[number, place] = slave.read(self._state)
                    if not np.isfinite(self._state.values).all():
                        break
            except Exception as error:
                self._fail(number, error)
        return result

    def _inputs_of(self, controls: Floats, wind: Floats, acceleration: Floats | None) -> Floats:
        """What the inputs of each run are set to [..., inputs]; without an acceleration it is zero."""
        width = len(self._variables.acceleration)
        if acceleration is None:
            acceleration = np.zeros((*controls.shape[:-1], width))
        return np.concatenate([controls, wind, acceleration[..., :width]], axis=-1)

    def _starts_of(self, states: Floats) -> Floats:
        """States [..., 6] in the units of the variables that runs start with."""
        return states * np.array(self._variables.start_scale) if self._variables.start_scale else states

    def _before_start(self, states: Floats, *, in_filter: bool) -> Floats:
        """What is set before each run starts [N, ...]: constants, the state, and the longest step of the FMU's own
        integration, that of a vessel file's."""
        constants = np.tile([value for _, value in self._variables.parameters], (len(states), 1))
        parts = [constants, self._starts_of(states)] if self._variables.start else [constants]
        if self._variables.own_step is not None:
            longest_s = np.full((len(states), 1), LONGEST_STEP_S)
            if in_filter:
                ours = self._spec.signals.state_to_ours(states, np.zeros_like(states))[:, SURGE : SWAY + 1]
                length_m = self._variables.length_m
                longest_s[:, 0] = [1.0 / steps_per_second(surge, sway, length_m) for surge, sway in ours.tolist()]
            parts.append(longest_s)
        return np.hstack(parts)

    def _refuse_broken_step(self, dt_s: float) -> None:
        """Raise :class:`ConfigurationError` for a step that the FMU's own step does not divide."""
        fixed_s = self._variables.fixed_step_s
        if fixed_s is not None and abs(dt_s / fixed_s - max(1, round(dt_s / fixed_s))) > _WHOLE_STEPS:
            raise ConfigurationError(
                f"cannot step by {dt_s:g} s", where=self._spec.source,
                why=f"it integrates in steps of {fixed_s:g} s, and would be behind by what is left of one",
                fix="export it with a step that divides a quarter of a second, such as 0.05 s",
            )  # fmt: skip

    def _started(self, number: int, state: Floats, before: Floats, inputs: Floats) -> _Slave:
        """The instance of a run, started in a state."""
        place = number % len(self._slaves)
        slave = self._slaves[place]
        if slave is not None:
            try:
                slave.reset()
            except Exception:  # not every exporter has written it
                slave.free()
                slave = None
        if slave is None:
            switches = self._variables.switches
            slave = self._slaves[place] = _Slave(self._description, self._folder, f"run{place}", switches)
        slave.initialise((self._before, before), (self._inputs, inputs))
        if not self._checked:
            self._refuse_other_start(slave, state)
            self._checked = True
        return slave

    def _refuse_other_start(self, slave: _Slave, state: Floats) -> None:
        """Raise :class:`ConfigurationError` where the FMU did not start in the state that it was given."""
        difference = slave.read(self._state) - state
        turn = 2.0 * np.pi / abs(self._spec.signals.state.scale[HEADING])
        difference[HEADING] -= turn * np.round(difference[HEADING] / turn)
        wrong = np.flatnonzero(np.abs(difference) > _START_TOLERANCE * (1.0 + np.abs(state)))
        if wrong.size:
            name, place = list(STATES)[wrong[0]], int(wrong[0])
            raise ConfigurationError(
                f"starts with {name} at {self._state.values[place]:.6g} where it was given {state[place]:.6g}",
                where=self._spec.source, why="the variable that it is started with does not reach that output",
                fix=f'write the one that does as start of {name} in its map, or start = "run_in" in [solver]',
            )  # fmt: skip

    def _fail(self, number: int, error: Exception) -> None:
        """Note why a run failed, and release its instance. Raises what ends all of them."""
        if isinstance(error, ConfigurationError):
            raise error
        self.failures[number] = str(error) if isinstance(error, RefusedCallError) else raised_text(error)
        place = number % len(self._slaves)
        slave, self._slaves[place] = self._slaves[place], None
        if slave is not None:
            slave.free()
