"""FMUs as simulators: FMI 2.0 and 3.0, co-simulation, by FMPy (the extra ``fmu``).

The map (:mod:`.simulator_map`) names the variables; whether they can be what it says follows from the FMU's own
description: a control is an input or a tunable parameter, a state is an output, and what a run starts with can be
set before it starts. Whether it then starts there is checked when it first does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.files import read_regular_file
from seatrial.acquisition.core.process import CALIBRATOR_BYTES
from seatrial.acquisition.core.quantities import canonical_unit, is_unit, unit_scale
from seatrial.hybrid.vessel import simulator_map
from seatrial.hybrid.vessel.fmu_runs import read_description, require_fmpy
from seatrial.hybrid.vessel.signals import STATES
from seatrial.hybrid.vessel.simulator_map import SignalEntry, SimulatorMap
from seatrial.hybrid.vessel.simulator_process import FmuVariables, SimulatorSpec

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.black_box import BlackBox

_NUMBERS = ("Real", "Float64")
_ALLOWED_BEFORE = ("exact", "approx")
_UNITS = {"1/s": "rps", "rev/s": "rps", "r/s": "rps", "rad": "rad", "Hz": "Hz", "1": "", "": "", "-": ""}
"""Names of units in FMUs that are not ours."""
_PURE = ("%", "ratio")
"""Units that state nothing but a share of something."""


def load_fmu(file: Path) -> BlackBox:
    """The model of an FMU with the map beside it. Raises :class:`ConfigurationError` and :class:`InputError`."""
    from seatrial.hybrid.vessel.black_box import BATCH, black_box

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
    instances = 1 if once else solver.instances
    keeps_nothing = solver.start == "reset" and solver.step_s is None  # from one step of a filter to the next
    spec = SimulatorSpec(
        str(file), digest, simulator_map.signals_of_map(mapped, mapped.actuators, path, complete=True),
        step_s=solver.step_s, settable=solver.start == "set", patience_s=solver.patience_s,
        takes_acceleration=mapped.acceleration is not None,
        batch=BATCH if keeps_nothing else instances, instances=instances,
        fmu=_variables_of(description, mapped, path),
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
        size, plain = simulator_map.split_unit(unit)
        if stated and stated != canonical_unit(plain) and not (size and stated in _PURE):
            why = f"the FMU states {stated} for {variable.name}"
            simulator_map.map_error(path, [*keys, key], f"is {unit!r}", f"write {stated}", why)
        return int(variable.valueReference)

    geodetic = mapped.state.keys() & simulator_map.GEODETIC.keys()
    states = list(STATES)
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
