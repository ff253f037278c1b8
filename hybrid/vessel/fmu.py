"""FMUs as simulators: FMI 2.0 and 3.0, co-simulation, by FMPy (the extra ``fmu``).

The map (:mod:`.simulator_map`) names the variables; whether they can be what it says follows from the FMU's own
description: a control is an input or a tunable parameter, a state is an output, and what a run starts with can be
set before it starts. Whether it then starts there is checked when it first does.
"""

from __future__ import annotations

import atexit
import hashlib
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from ctypes import POINTER, c_double, c_uint32
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.files import read_regular_file
from seatrial.acquisition.core.process import CALIBRATOR_BYTES
from seatrial.acquisition.core.quantities import Floats, canonical_unit, is_unit, unit_scale
from seatrial.hybrid.vessel import simulator_map
from seatrial.hybrid.vessel.dynamics import LONGEST_STEP_S, steps_per_second
from seatrial.hybrid.vessel.signals import HEADING, SURGE, SWAY
from seatrial.hybrid.vessel.simulator_map import SignalEntry, SimulatorMap
from seatrial.hybrid.vessel.simulator_process import (
    Beacon,
    FmuVariables,
    SimulatorSpec,
    raised_text,
    run_step_by_step,
)

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.black_box import BlackBox

INSTALL = "pip install 'seatrial[fmu]'"
_NUMBERS = ("Real", "Float64")
_ALLOWED_BEFORE = ("exact", "approx")
_START_TOLERANCE = 1e-6
_WHOLE_STEPS = 1e-6  # of a step: what a number of them may be off a whole one by rounding
_UNITS = {"1/s": "rps", "rev/s": "rps", "r/s": "rps", "rad": "rad", "Hz": "Hz", "1": "", "": "", "-": ""}
"""Names of units in FMUs that are not ours."""


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


def load_fmu(file: Path) -> BlackBox:
    """The model of an FMU with the map beside it. Raises :class:`ConfigurationError` and :class:`InputError`."""
    from seatrial.hybrid.vessel.black_box import black_box

    fmpy = require_fmpy()
    try:
        content = read_regular_file(file, CALIBRATOR_BYTES)
    except OSError as error:
        raise ConfigurationError("cannot be read", where=str(file), why=error.strerror or str(error)) from error
    description = read_description(file)
    if fmpy.platform not in fmpy.supported_platforms(str(file)) and fmpy.platform_tuple not in (
        platforms := fmpy.supported_platforms(str(file))
    ):
        raise InputError(f"has no program for {fmpy.platform_tuple}", where=str(file),
                         why=f"it has those for {', '.join(platforms) or 'none'}",
                         fix="export it on this kind of computer")  # fmt: skip
    path = file.with_suffix(".toml")
    if not path.is_file():
        raise ConfigurationError("has no map of its variables", where=str(file), why=f"there is no {path.name}",
                                 fix=f"`seatrial vessel map {file.name}` proposes one")  # fmt: skip
    mapped = simulator_map.read_map(path)
    digest = hashlib.sha256(content).hexdigest()
    solver, once = mapped.solver, description.coSimulation.canBeInstantiatedOnlyOncePerProcess
    spec = SimulatorSpec(
        str(file), digest, simulator_map.signals_of_map(mapped, mapped.actuators, path, complete=True),
        step_s=solver.step_s, settable=solver.start == "set", patience_s=solver.patience_s,
        takes_acceleration=mapped.acceleration is not None,
        batch=1 if once else solver.instances, fmu=_variables_of(description, mapped, path),
    )  # fmt: skip
    return black_box(str(file), spec, mapped, content, path, run_in=solver.start == "run_in")


def _variables_of(description: Any, mapped: SimulatorMap, path: Path) -> FmuVariables:
    """The value references that a map names. Raises :class:`ConfigurationError` for what cannot be what it says."""
    variables = {variable.name: variable for variable in description.modelVariables}

    def reference(table: str, key: str, role: str) -> int:
        entry: SignalEntry = getattr(mapped, table)[key]
        name, keys = entry.variable, [table, key]
        if role == "start":
            name = entry.start or name
        variable = variables.get(name)
        if variable is None or variable.type not in _NUMBERS or variable.dimensions:
            near = get_close_matches(name, variables, n=3) or list(variables)[:8]
            what = "is no single number of the FMU" if variable else f"is {name!r}, which the FMU does not have"
            place = "start" if role == "start" and entry.start else "variable"
            simulator_map.map_error(path, [*keys, place], what, f"write one of {', '.join(near)}")
        _refuse_causality(variable, mapped, [*keys, "start" if role == "start" else "variable"], path, role)
        stated, unit, key = unit_of(variable), entry.unit, "unit"
        if role == "start" and name != entry.variable:
            unit, key = entry.start_unit or unit, "start_unit"
        if stated and stated != canonical_unit(unit):
            why = f"the FMU states {stated} for {variable.name}"
            simulator_map.map_error(path, [*keys, key], f"is {unit!r}", f"write {stated}", why)
        return int(variable.valueReference)

    geodetic = mapped.state.keys() & simulator_map.GEODETIC.keys()
    states = list(simulator_map.STATES)
    states = [*simulator_map.GEODETIC, *states[2:]] if geodetic else states
    starts = states if mapped.solver.start != "run_in" else []
    form = simulator_map.wind_form(mapped.wind)
    winds = [] if form == "none" else list(simulator_map.WINDS[form])
    channels = [channel.name for actuator in mapped.actuators for channel in actuator.channels]
    stated_s = description.coSimulation.fixedInternalStepSize  # of FMI 3.0; a text
    scales = tuple(_start_scale(mapped.state[name], ["state", name], path) for name in starts)
    parameter, own_step = partial(_parameter_reference, variables, path), mapped.solver.own_step
    return FmuVariables(
        state=tuple(reference("state", name, "state") for name in states),
        start=tuple(reference("state", name, "start") for name in starts),
        control=tuple(reference("control", name, "control") for name in channels),
        wind=tuple(reference("wind", name, "control") for name in winds),
        parameters=tuple((parameter(["parameters", name], name, _NUMBERS), value)
                         for name, value in mapped.parameters.items() if not isinstance(value, bool)),
        switches=tuple((parameter(["parameters", name], name, ("Boolean",)), value)
                       for name, value in mapped.parameters.items() if isinstance(value, bool)),
        acceleration=_accelerations_of(variables, mapped, path),
        own_step=parameter(["solver", "own_step"], own_step, _NUMBERS) if own_step else None,
        length_m=mapped.ship.length_overall_m or mapped.ship.length_m,
        start_scale=scales if any(scale != 1.0 for scale in scales) else (),
        fixed_step_s=mapped.solver.fixed_step_s or (float(stated_s) if stated_s else None),
    )  # fmt: skip


def _start_scale(entry: SignalEntry, keys: list[str | int], path: Path) -> float:
    """What a state is multiplied with to be in the unit of what it starts with."""
    if not entry.start_unit:
        return 1.0
    try:
        return unit_scale(canonical_unit(entry.start_unit), entry.unit)
    except ConfigurationError as error:
        what = f"is {entry.start_unit!r}, which does not measure it"
        simulator_map.map_error(path, [*keys, "start_unit"], what, error.fix)


def _parameter_reference(
    variables: Mapping[str, Any], path: Path, keys: list[str | int], name: str, kinds: tuple[str, ...]
) -> int:
    """The value reference of a parameter of some types. Raises :class:`ConfigurationError` for another variable."""
    fitting = [key for key, one in variables.items() if one.causality == "parameter" and one.type in kinds]
    if name not in fitting:
        what = "number" if kinds == _NUMBERS else "switch"
        near = get_close_matches(name, fitting, n=3) or fitting[:8]
        fix = f"write one of {', '.join(near)}" if near else f"leave it out: it has no {what}"
        simulator_map.map_error(path, keys, f"is {name!r}, which is no {what} among the parameters of the FMU", fix)
    return int(variables[name].valueReference)


def _accelerations_of(variables: Mapping[str, Any], mapped: SimulatorMap, path: Path) -> tuple[int, ...]:
    """The value references of the inputs for what the simulator lacks, if it has any."""
    entry = mapped.acceleration
    if entry is None:
        return ()
    inputs = [name for name, one in variables.items() if one.causality == "input" and one.type in _NUMBERS]
    for axis, name in (("surge", entry.surge), ("sway", entry.sway), ("yaw", entry.yaw)):
        if name not in inputs:
            simulator_map.map_error(path, ["acceleration", axis], f"is {name!r}, which is no input of the FMU",
                                    f"write one of {', '.join(inputs[:12])}")  # fmt: skip
    return tuple(int(variables[name].valueReference) for name in (entry.surge, entry.sway, entry.yaw))


def _refuse_causality(variable: Any, mapped: SimulatorMap, keys: list[str], path: Path, role: str) -> None:
    """Raise :class:`ConfigurationError` for a variable that cannot be a control, a state or a start."""
    causality = str(variable.causality)
    between = causality == "input" or (causality == "parameter" and variable.variability == "tunable")
    started = between or causality == "parameter" or variable.initial in _ALLOWED_BEFORE
    refusals = {
        "state": (causality == "output", "", "name an output: a state is read after each step"),
        "control": (between, "", "name an input or a tunable parameter: they are set before each step"),
        "start": (started, ", and its start cannot be set",
                  'name the parameter that it starts with, or write start = "run_in" in [solver]'),
    }  # fmt: skip
    if role == "start" and mapped.solver.start == "set":
        fix = 'name an input or a tunable parameter, or write start = "reset" in [solver]'
        refusals[role] = (between, ", and solver.start is set", fix)
    allowed, why, fix = refusals[role]
    if not allowed:
        article = "an" if causality[0] in "aeiou" else "a"
        what = f"is {variable.name!r}, which is {article} {causality} of the FMU{why}"
        simulator_map.map_error(path, [*keys], what, fix)


def unit_of(variable: Any) -> str:
    """The unit that an FMU states of a variable, by our name; empty where it states none that we know."""
    declared = variable.declaredType.unit if variable.declaredType is not None else None
    unit = str(variable.unit or declared or "").strip()
    unit = canonical_unit(_UNITS.get(unit, unit))
    return unit if is_unit(unit) else ""


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
                longest_s[:, 0] = [1.0 / steps_per_second(*speeds, length_m) for speeds in ours.tolist()]
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
            name, place = list(simulator_map.STATES)[wrong[0]], int(wrong[0])
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
