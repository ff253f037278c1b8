"""The equations of a vessel as a module of their own, translated from those of the simulator.

The module has the ship's numbers by name, ``derivative`` of the six states while the controls that act and the wind
hold, and ``step``, which has the drives of the simulator, too. The same text is executed with numpy, with jax.numpy
and with CasADi's symbols.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, sin
from typing import Any

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.export import translate
from seatrial.hybrid.export.translate import Code, Constant, Member, Record, Translator, Untranslatable
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.vessel import actuators, dynamics, files, hulls
from seatrial.hybrid.vessel.plant import TABLES, Plant, actuator_rows, number_of_controls, pack

_STRUCTURE = ("behind", "drift_as_angle")
"""Numbers of an actuator that say which equations hold."""

_WIND = ("frontal_area_m2", "lateral_area_m2")
Parameters = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Equations:
    """A ship's equations as Python for arrays.

    ``text`` are the functions, ``parameters`` the numbers that they read, by name, those of hull and actuators in
    tables of their own; ``extra_states`` are ``acting`` where drives lag behind their feedback, ``behind`` where
    gears have play. ``lengths_m`` are the ship's, by name, whether they are read or not.
    """

    text: str
    parameters: Parameters
    controls: tuple[str, ...]
    extra_states: tuple[str, ...]
    lengths_m: Mapping[str, float]


class ShipNumbers:
    """The numbers of a ship as the translation reads them; ``used`` are those that the translated code has."""

    def __init__(self, plant: Plant) -> None:
        self.plant, self.rows = plant, actuator_rows(pack(plant))
        self.used: Parameters = {}
        self.names = [actuator.name for actuator in plant.layout]
        self.kinds = [actuator.kind for actuator in plant.layout]
        self.no_wind = all(plant.number(name) == 0.0 for name in _WIND)

    @property
    def members(self) -> list[Member]:
        """The actuators."""
        return [Member(i, name, self._row_shape(i)) for i, name in enumerate(self.names)]

    def ship(self, node: ast.expr) -> Record:
        """The ship's record, ``p``."""
        return Record(node, "ship", self._of_ship)

    def control(self, node: ast.expr) -> Record:
        """The controls, a tuple of numbers."""
        size = number_of_controls(pack(self.plant))
        return Record(
            node, "control",
            lambda node, key, _: Constant(size) if key is len else Code(
                translate.subscript(node, key.node if isinstance(key, Code) else translate.constant(key))
            ),
        )  # fmt: skip

    def work(self) -> translate.WorkTable:
        """The working numbers of the actuators, which are to be filled."""
        rows = [
            translate.Work(name, self._work_record(kind)) for name, kind in zip(self.names, self.kinds, strict=True)
        ]
        return translate.WorkTable(rows, lambda node: Record(node, "work table", self._of_work_table))

    def _work_record(self, kind: str) -> Any:
        return lambda node: Record(
            node, ("work", kind),
            lambda node, _, written: Code(translate.subscript(node, translate.name_of(written))),  # type: ignore[arg-type]
        )  # fmt: skip

    def _of_work_table(self, node: ast.expr, key: Any, written: ast.expr | None) -> Any:
        place = key[0] if isinstance(key, tuple) else key
        index = place.index if isinstance(place, Member) else int(place)
        row = self._work_record(self.kinds[index])(translate.subscript(node, self._called(place)))
        return row.item(key[1], written.elts[-1]) if isinstance(key, tuple) else row  # type: ignore[union-attr]

    def _called(self, place: Any) -> Any:
        return ast.Name("name") if isinstance(place, Member) else self.names[int(place)]

    def _row_shape(self, i: int) -> Any:
        kind = actuators.KINDS[self.kinds[i]]
        facts = tuple(self._fixed(i, name) for name in kind.numbers)
        return (self.kinds[i], facts)

    def _fixed(self, i: int, name: str) -> float | None:
        """A number that decides which equations hold, or None: another ship of the kind may have another."""
        value = float(self.rows[i, actuators.FIRST_NUMBER + actuators.KINDS[self.kinds[i]].numbers.index(name)])
        lagging = name in (actuators.KINDS[self.kinds[i]].lag, actuators.PLAY) and value == 0.0
        return value if name in _STRUCTURE or lagging else None

    def _of_ship(self, node: ast.expr, key: Any, _: ast.expr | None) -> Any:
        if key == "hull":
            return Record(translate.subscript(node, "hull"), "hull", self._of_hull)
        if key == "actuators":
            return Record(node, "actuators", self._of_actuators)
        structure = {"actuator_count": float(len(self.names)), "hull_model": hulls.HULL_CODES[self.plant.form.hull]}
        if key in structure:
            return Constant(structure[key])
        value = self.plant.number(key)
        if key == "wind_model" or (key == "thruster_lag_s" and value == 0.0) or (key in _WIND and self.no_wind):
            return Constant(value)
        if key in TABLES:
            return Record(translate.subscript(node, key), key, self._of_table)
        return self._number(self.used, node, key, value)

    def _number(self, table: Parameters, node: ast.expr, name: str, value: float) -> Code:
        table[name] = float(value)
        code = translate.subscript(node, name)
        code.of_ship = True  # type: ignore[attr-defined]
        return Code(code)

    def _of_table(self, node: ast.expr, key: Any, _: ast.expr | None) -> Any:
        name = ast.literal_eval(node.slice)  # type: ignore[attr-defined]
        self.used[name] = self.plant.number(name)
        if isinstance(key, Code):
            return Code(translate.call("pick", node, key.node))
        return Code(translate.subscript(node, key))

    def _of_hull(self, node: ast.expr, key: Any, _: ast.expr | None) -> Any:
        name = self.plant.hull_model.numbers[key]
        return self._number(self.used.setdefault("hull", {}), node, name, self.plant.number(name))

    def _of_actuators(self, node: ast.expr, key: Any, _: ast.expr | None) -> Any:
        if key is len:
            return Constant(len(self.names))
        place, *column = key if isinstance(key, tuple) else (key,)
        index = place.index if isinstance(place, Member) else int(place)
        row = Record(translate.subscript(node, self._called(place)), self._row_shape(index), self._of_row(index))
        return row.item(column[0]) if column else row

    def _of_row(self, index: int) -> Any:
        def item(node: ast.expr, key: Any, _: ast.expr | None) -> Any:
            if key in (actuators.KIND, actuators.CONTROL):
                return Constant(
                    actuators.CODES[self.kinds[index]]
                    if key == actuators.KIND
                    else float(self.rows[index, actuators.CONTROL])
                )
            name = actuators.KINDS[self.kinds[index]].numbers[int(key) - actuators.FIRST_NUMBER]
            fixed = self._fixed(index, name)
            if fixed is not None:
                return Constant(fixed)
            for like, kind in enumerate(self.kinds):  # a function may be of all of its kind
                if kind == self.kinds[index]:
                    table = self.used.setdefault(self.names[like], {})
                    self._number(table, node, name, self.rows[like, int(key)])
            return self._number(self.used[self.names[index]], node, name, self.rows[index, int(key)])

        return item


def equations_of(vessel: files.Vessel, plant: Plant) -> Equations:
    """The equations of a vessel whose model, with its effects, is ``plant``.

    Raises :class:`ConfigurationError` for a force of one's own whose code cannot be translated.
    """
    numbers = ShipNumbers(plant)
    translator = Translator(numbers.members, RESERVED)
    try:
        derivative = _derivative_function(numbers, translator)
        forces = _forces_function(numbers, translator)
        inside = _inside_function(numbers, translator)
        before_step, extra_states = _acting_controls(numbers, translator)
        moving = _moved_drives(translator)
    except Untranslatable as error:
        raise ConfigurationError(
            f"the model of {vessel.name} cannot be exported",
            why=str(error),
            fix="take the effect that has it out of the vessel file, or write its force as the kernels are: "
            "numbers, if and else, loops of known length, and the functions of math",
        ) from error
    drives = [drive for entry in vessel.actuator for drive in actuators.KINDS[entry.kind].drives(entry)]
    drive_numbers = {
        name: tuple(float(getattr(drive, name)) for drive in drives) for name in ("lag_s", "limit", "rate")
    }
    functions = [*translator.functions, derivative, forces, inside, *before_step, moving]
    text = "\n\n\n".join([*(function.text() for function in functions), _step_text(extra_states)])
    read = {name: value for name, value in numbers.used.items() if isinstance(value, dict) or f'"{name}"' in text}
    lengths = {name: plant.number(name) for name in ("length_between_perpendiculars_m", "length_overall_m")}
    numbers_read = {**read, "drives": drive_numbers}
    return Equations(text, numbers_read, actuators.control_labels(plant.layout), extra_states, lengths)


RESERVED = (
    "xp", "where", "pick", "nonzero", "root", "angle_of", "length_of", "arcsine", "columns", "stacked",
    "derivative", "forces", "inside", "step", "runge_kutta", "PARAMETERS",
)  # fmt: skip


def _begin_function(
    translator: Translator, name: str, docstring: str
) -> tuple[translate.Function, tuple[Code, ...]]:
    """A function of the six states, the controls that act, and the wind, and its states."""
    function = translator.define_function("begin", ("state", "controls", "wind", "p"), docstring)
    function.name = name
    function.parameters[-1] = "p=PARAMETERS"
    for line in _OPENING:
        function.body += ast.parse(line).body
    function.names |= {*_MOTION, "control", "direction_rad", "speed_mps"}
    return function, tuple(Code(ast.Name(name)) for name in _MOTION)


_MOTION = ("north", "east", "psi", "u", "v", "r")
_OPENING = (
    "north, east, psi, u, v, r = columns(state)",
    "control = columns(controls)",
    "direction_rad, speed_mps = columns(wind)",
)


def _derivative_function(numbers: ShipNumbers, translator: Translator) -> translate.Function:
    text = "The rate of change of the state while the controls that act and the reported wind hold."
    function, state = _begin_function(translator, "derivative", text)
    p = numbers.ship(ast.Name("p"))
    force, parameters = _extra_force(numbers.plant)
    time = translate.Absent("the time, which the exported equations do not have,")
    wind = (Code(ast.Name("direction_rad")), Code(ast.Name("speed_mps")))
    arguments = (p, numbers.control(ast.Name("control")), numbers.work(), *wind, time, state, force, parameters)
    result = translator.inline_call(rate_of_change, arguments, function)
    function.body.append(ast.Return(translate.call("stacked", *(value.node for value in result))))
    return function


def rate_of_change(p, control, work, direction_rad, speed_mps, time_s, state, extra, parameters):  # type: ignore[no-untyped-def]
    """As a step of the simulator begins: its mass, what it holds constant, and the rate of change."""
    mass = dynamics.inverse_mass(p)
    held = dynamics.step_constants(p, control, work, direction_rad, speed_mps)
    return dynamics.state_rate(p, mass, held, time_s, state, extra, parameters)


def _extra_force(plant: Plant) -> tuple[Constant, Any]:
    """The sum of the forces that no slot of the plant expresses, and their parameters."""
    if not plant.forces:
        return Constant(None), ()
    functions = tuple(Constant(force.function) for force in plant.forces)
    return Constant(sum_of_forces), (
        functions,
        tuple(tuple(map(Constant, force.parameters)) for force in plant.forces),
    )


def sum_of_forces(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
    """The forces of one's own."""
    X, Y, N = 0.0, 0.0, 0.0
    functions, numbers = parameters
    for i in range(len(functions)):
        function_X, function_Y, function_N = functions[i](time_s, state, control, environment, numbers[i])
        X, Y, N = X + function_X, Y + function_Y, N + function_N
    return X, Y, N


def _forces_function(numbers: ShipNumbers, translator: Translator) -> translate.Function:
    text = "All forces on the ship X [N], Y [N], N [N m], the rigid body's Coriolis terms among them."
    function, state = _begin_function(translator, "forces", text)
    wind = (Code(ast.Name("direction_rad")), Code(ast.Name("speed_mps")))
    arguments = (numbers.ship(ast.Name("p")), numbers.control(ast.Name("control")), numbers.work(), *wind, state)
    result = translator.inline_call(forces_on_ship, arguments, function)
    function.body.append(ast.Return(translate.call("stacked", *(value.node for value in result))))
    return function


def forces_on_ship(p, control, work, direction_rad, speed_mps, state):  # type: ignore[no-untyped-def]
    """The forces at a state, in body axes, but for those of one's own."""
    held = dynamics.step_constants(p, control, work, direction_rad, speed_mps)
    _, _, psi, u, v, r = state
    cosine, sine = cos(psi), sin(psi)
    u_c = p.current_north_mps * cosine + p.current_east_mps * sine
    v_c = p.current_east_mps * cosine - p.current_north_mps * sine
    return dynamics.total_force(p, held, cosine, sine, u, v, r, u_c, v_c)


def _inside_function(numbers: ShipNumbers, translator: Translator) -> translate.Function:
    text = "Whether the speeds through the water are where the coefficients hold; not a number is not."
    function = translator.define_function("begin", ("state", "p=PARAMETERS"), text)
    function.name = "inside"
    function.body += ast.parse(_OPENING[0]).body
    function.names |= {*_MOTION, "p"}
    state = tuple(Code(ast.Name(name)) for name in _MOTION)
    result = translator.inline_call(dynamics.in_range, (numbers.ship(ast.Name("p")), state), function)
    function.body.append(ast.Return(result.node))
    return function


def _moved_drives(translator: Translator) -> translate.Function:
    text = "The drives' feedback a step of dt_s later: first-order lags, limits of orders and of their rates."
    function = translator.define_function("moved_drives", ("drives", "feedback", "order", "dt_s"), text)
    drives = Record(
        ast.Name("drives"), "drives",
        lambda node, key, _: translate.Vector(translate.subscript(node, key)),
    )  # fmt: skip
    vectors = [translate.Vector(ast.Name(name)) for name in ("feedback", "order")]
    result = translator.inline_call(move_drives, (drives, *vectors, Code(ast.Name("dt_s"))), function)
    function.body.append(ast.Return(result.node))
    return function


def move_drives(drives, feedback, order, dt_s):  # type: ignore[no-untyped-def]
    """The feedback a step later."""
    share = manoeuvres.lag_shares(drives, dt_s)
    manoeuvres.advance_drives(drives, share, feedback, order, dt_s)
    return feedback


def _acting_controls(
    numbers: ShipNumbers, translator: Translator
) -> tuple[list[translate.Function], tuple[str, ...]]:
    """The function of the controls that act where drives lag behind their feedback or gears have play."""
    plant, rows = numbers.plant, enumerate(numbers.kinds)
    lagging, loose = plant.number("thruster_lag_s") != 0.0, False
    for i, kind in rows:
        table = dict(
            zip(actuators.KINDS[kind].numbers, numbers.rows[i, actuators.FIRST_NUMBER :].tolist(), strict=False)
        )
        lagging = lagging or table.get(actuators.KINDS[kind].lag, 0.0) != 0.0
        loose = loose or table.get(actuators.PLAY, 0.0) != 0.0
    if not lagging and not loose:
        return [], ()
    text = "The controls that act, on average and at the end of a step of dt_s, and the gears behind their play."
    function = translator.define_function("acting_controls", ("p", "order", "acting", "behind", "dt_s"), text)
    size = number_of_controls(pack(plant))
    cells = []
    for name in ("order", "acting", "behind"):
        labels = [function.unused_name(f"{name}_{i}") for i in range(size)]
        function.body += ast.parse(f"{', '.join(labels)}, = columns({name})").body
        cells.append(translate.FilledArray({i: Code(ast.Name(label)) for i, label in enumerate(labels)}, name))
    order, acting, behind = cells
    arguments = (numbers.ship(ast.Name("p")), order, acting, behind, Code(ast.Name("dt_s")))
    mean = translator.inline_call(act_over_step, arguments, function)
    stacks = [
        translate.call("stacked", *map(translate.expression_of, array.values.values()))
        for array in (mean, acting, behind)
    ]
    function.body.append(ast.Return(ast.Tuple(stacks)))
    return [function], (*(["acting"] if lagging else []), *(["behind"] if loose else []))


def act_over_step(p, order, acting, behind, dt_s):  # type: ignore[no-untyped-def]
    """As a step of the simulator goes; fills ``acting`` and ``behind``."""
    mean = acting.copy()
    dynamics.take_up_play(p, behind, order)
    lag = dynamics.lag_shares_over_step(p, dt_s)
    dynamics.move_towards_orders(p, mean, acting, behind, lag.mean)
    dynamics.move_towards_orders(p, acting, acting, behind, lag.end)
    return mean


def _step_text(extra_states: tuple[str, ...]) -> str:
    """The step of a ship with its drives, whose states are in one array."""
    states = ("feedback", *extra_states)
    taken = [f"    motion, {', '.join(states)} = parts(state, {1 + len(states)})"]
    if extra_states:
        acting, behind = (name if name in extra_states else "feedback" for name in ("acting", "behind"))
        taken += [f"    control, acting, behind = acting_controls(p, feedback, {acting}, {behind}, dt_s)"]
    control = "control" if extra_states else "feedback"
    ends = ", ".join(['moved_drives(p["drives"], feedback, orders, dt_s)', *extra_states])
    return "\n".join([_STEP.format(states=", ".join(("motion", *states))), *taken,
                      f"    motion = runge_kutta(motion, {control}, wind, dt_s, p)",
                      f"    return joined(motion, {ends})"])  # fmt: skip


_STEP = '''def runge_kutta(state, controls, wind, dt_s, p=PARAMETERS):
    """The state one classical Runge-Kutta step of fourth order later; the controls act and hold meanwhile."""
    k1 = derivative(state, controls, wind, p)
    k2 = derivative(state + 0.5 * dt_s * k1, controls, wind, p)
    k3 = derivative(state + 0.5 * dt_s * k2, controls, wind, p)
    k4 = derivative(state + dt_s * k3, controls, wind, p)
    return state + dt_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def step(state, orders, wind, dt_s, p=PARAMETERS):
    """The ship with its drives a step of dt_s later, as the simulator goes: the feedback holds meanwhile.

    The last axis of ``state`` has {states}; all but the first have a number for each control.
    """'''


def flat_parameters(equations: Equations) -> dict[str, float]:
    """Every number by a name of its own: ``port_x_m``, ``CX_0``, ``port_rps_lag_s``."""
    flat = dict[str, float]()
    for name, value in equations.parameters.items():
        if name == "drives":
            flat |= {f"{control}_{number}": values[i] for i, control in enumerate(equations.controls)
                     for number, values in value.items()}  # fmt: skip
        elif isinstance(value, dict):
            flat |= {number if name == "hull" else f"{name}_{number}": part for number, part in value.items()}
        elif isinstance(value, tuple):
            flat |= {f"{name}_{place}": part for place, part in enumerate(value)}
        else:
            flat[name] = value
    return flat


def nested_parameters(equations: Equations, flat: Mapping[str, Any], array: Any) -> Parameters:
    """The numbers of :func:`flat_parameters`, or what stands for them, as the equations read them; ``array`` makes
    an array of several."""
    result: Parameters = {}
    for name, value in equations.parameters.items():
        if name == "drives":
            result[name] = {
                number: array([flat[f"{control}_{number}"] for control in equations.controls]) for number in value
            }
        elif isinstance(value, dict):
            result[name] = {number: flat[number if name == "hull" else f"{name}_{number}"] for number in value}
        elif isinstance(value, tuple):
            result[name] = array([flat[f"{name}_{place}"] for place in range(len(value))])
        else:
            result[name] = flat[name]
    return result
