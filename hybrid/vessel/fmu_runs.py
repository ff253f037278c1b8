"""Runs of an FMU in the process of a simulator, by FMPy. It imports nothing that compiles, to start quickly."""

from __future__ import annotations

import atexit
import shutil
from collections.abc import Iterable
from contextlib import suppress
from ctypes import POINTER, c_double, c_uint32
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.vessel.signals import HEADING, STATES, SURGE, SWAY
from seatrial.hybrid.vessel.simulator_process import Beacon, SimulatorSpec, raised_text, run_step_by_step
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


class _Numbers:
    """Some variables of an instance, and room for their values that the FMU reads and writes itself."""

    __slots__ = ("_count", "_pointer", "_references", "values")

    def __init__(self, references: Iterable[int]) -> None:
        numbers = tuple(references)
        self.values = np.zeros(len(numbers))
        self._references, self._count = (c_uint32 * len(numbers))(*numbers), len(numbers)
        self._pointer = self.values.ctypes.data_as(POINTER(c_double))

    def write(self, slave: Any, values: Any) -> None:
        """Set the variables."""
        if self._count:
            self.values[:] = values
            slave.set_numbers(self._references, self._count, self._pointer)

    def read(self, slave: Any) -> Floats:
        """Get the variables."""
        slave.get_numbers(self._references, self._count, self._pointer)
        return self.values


class _Slave:
    """One instance of an FMU, through the standard's own functions: FMPy's lists cost more than many a step."""

    def __init__(self, description: Any, folder: str, name: str) -> None:
        from fmpy import fmi2, fmi3

        self.is_third = str(description.fmiVersion).startswith("3.")
        kind = fmi3.FMU3Slave if self.is_third else fmi2.FMU2Slave
        self._fmu = kind(
            guid=description.guid, unzipDirectory=folder, instanceName=name,
            modelIdentifier=description.coSimulation.modelIdentifier, requireFunctions=False,
        )  # fmt: skip
        self._fmu.instantiate()
        functions = self._fmu._functions
        prefix = "fmi3" if self.is_third else "fmi2"
        number = "Float64" if self.is_third else "Real"
        self._set, self._get = functions[f"{prefix}Set{number}"], functions[f"{prefix}Get{number}"]
        self._step = functions[f"{prefix}DoStep"]
        self.time_s = 0.0

    def set_numbers(self, references: Any, count: int, pointer: Any) -> None:
        """Set values."""
        extra = (count,) if self.is_third else ()
        self._require(self._set(self._fmu.component, references, count, pointer, *extra), "set a variable")

    def get_numbers(self, references: Any, count: int, pointer: Any) -> None:
        """Get values."""
        extra = (count,) if self.is_third else ()
        self._require(self._get(self._fmu.component, references, count, pointer, *extra), "return its state")

    def reset(self) -> None:
        """Go back to before initialisation."""
        self._fmu.reset()
        self.time_s = 0.0

    def initialise(
        self, before: tuple[_Numbers, Floats], inside: tuple[_Numbers, Floats],
        switches: Iterable[tuple[int, bool]] = (),
    ) -> None:  # fmt: skip
        """Initialise, with values and ``switches`` set ``before`` that and values ``inside`` it."""
        if not self.is_third:
            self._fmu.setupExperiment(startTime=0.0)
        for reference, value in switches:
            self._fmu.setBoolean([reference], [value])
        numbers, values = before
        numbers.write(self, values)
        self._fmu.enterInitializationMode(*([] if not self.is_third else [None, 0.0]))
        numbers, values = inside
        numbers.write(self, values)
        self._fmu.exitInitializationMode()
        self.time_s = 0.0

    def step(self, dt_s: float) -> None:
        """Step by ``dt_s``."""
        if self.is_third:
            self._fmu.doStep(self.time_s, dt_s)
        else:
            self._require(self._step(self._fmu.component, self.time_s, dt_s, 1), "step")
        self.time_s += dt_s

    def free(self) -> None:
        """Release the instance."""
        with suppress(Exception):
            self._fmu.terminate()
        with suppress(Exception):
            self._fmu.freeInstance()

    @staticmethod
    def _require(status: int, what: str) -> None:
        if status > 1:  # ok and warning
            raise RuntimeError(f"could not {what} (FMI status {status})")


class FmuRuns:
    """Runs of an FMU: an instance for each."""

    def __init__(self, spec: SimulatorSpec, beacon: Beacon) -> None:
        fmpy = require_fmpy()
        assert spec.fmu is not None
        self._spec, self._beacon, self._variables, self._steps = spec, beacon, spec.fmu, 0
        self._description = read_description(Path(spec.source))
        self._folder = fmpy.extract(spec.source)
        atexit.register(shutil.rmtree, self._folder, ignore_errors=True)
        self._slaves: list[_Slave | None] = []
        variables = spec.fmu
        self._state, self._start = _Numbers(variables.state), _Numbers(variables.start)
        own_step = () if variables.own_step is None else (variables.own_step,)
        constants = [reference for reference, _ in variables.parameters]
        self._before = _Numbers([*constants, *variables.start, *own_step])
        self._inputs = _Numbers([*variables.control, *variables.wind, *variables.acceleration])
        self._checked = not variables.start
        self.failures: dict[int, str] = {}

    def start(self, states: Floats, controls: Floats, wind: Floats) -> None:
        self.failures, self._steps = {}, 0
        self._slaves += [None] * (len(states) - len(self._slaves))
        before, inputs = self._before_start(states, in_filter=False), self._inputs_of(controls, wind, None)
        for number in np.flatnonzero(np.isfinite(states).all(axis=1)).tolist():
            self._start_one(number, states[number], before[number], inputs[number])

    def step(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, changed: bool,
             acceleration: Floats | None) -> Floats:  # fmt: skip
        self._refuse_broken_step(dt_s)
        self._steps += 1
        later, inputs = np.full_like(states, np.nan), self._inputs_of(controls, wind, acceleration)
        is_set = changed and self._spec.settable
        is_started = changed and not is_set and bool(self._variables.start)
        before = self._before_start(states, in_filter=acceleration is not None) if is_started else None
        for number in np.flatnonzero(np.isfinite(states).all(axis=1)).tolist():
            if number in self.failures:
                continue
            if before is not None:
                self._start_one(number, states[number], before[number], inputs[number])
            slave = self._slaves[number]
            if slave is None:
                continue
            self._beacon(number, self._steps)
            try:
                if is_set:
                    self._start.write(slave, self._starts_of(states[number]))
                if before is None:
                    self._inputs.write(slave, inputs[number])
                slave.step(dt_s)
                later[number] = self._state.read(slave)
            except Exception as error:  # an FMU may fail in every possible way
                self._fail(number, error)
        return later

    def run(self, states: Floats, controls: Floats, wind: Floats, dt_s: float, count: int) -> Floats:
        return run_step_by_step(self, states, controls, wind, dt_s, count)

    def _inputs_of(self, controls: Floats, wind: Floats, acceleration: Floats | None) -> Floats:
        """What the inputs of each run are set to [N, inputs]; without an acceleration it is zero."""
        if acceleration is None:
            acceleration = np.zeros((len(controls), len(self._variables.acceleration)))
        return np.hstack([controls, wind, acceleration[:, : len(self._variables.acceleration)]])

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

    def _start_one(self, number: int, state: Floats, before: Floats, inputs: Floats) -> None:
        self._beacon(number, self._steps)
        try:
            slave = self._slaves[number]
            if slave is not None:
                try:
                    slave.reset()
                except Exception:  # not every exporter has written it
                    slave.free()
                    slave = None
            if slave is None:
                slave = self._slaves[number] = _Slave(self._description, self._folder, f"run{number}")
            slave.initialise((self._before, before), (self._inputs, inputs), self._variables.switches)
        except Exception as error:
            self._fail(number, error)
            return
        if not self._checked:
            self._refuse_other_start(slave, state)
            self._checked = True

    def _refuse_other_start(self, slave: _Slave, state: Floats) -> None:
        """Raise :class:`ConfigurationError` where the FMU did not start in the state that it was given."""
        difference = self._state.read(slave) - state
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
        self.failures[number] = raised_text(error)
        slave, self._slaves[number] = self._slaves[number], None
        if slave is not None:
            slave.free()
