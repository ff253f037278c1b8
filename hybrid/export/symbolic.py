"""The equations of a ship with CasADi's symbols: functions to differentiate and optimise with, and their C code."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, inf, nan, pi, radians
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid.export.equations import Equations, flat_parameters, nested_parameters

ARRAY_FUNCTIONS = Path(__file__).with_name("array_functions.txt")


def load_casadi() -> Any:
    """CasADi. Raises :class:`ConfigurationError` where it is not installed."""
    try:
        import casadi
    except ImportError as error:
        raise ConfigurationError(
            "this export needs CasADi, which is not installed",
            fix="pip install 'seatrial[casadi]', or export a .py, .csv, .m, .mat or .sdf",
        ) from error
    return casadi


_LARGE = 1e30


def finite_parameters(equations: Equations) -> dict[str, float]:
    """The numbers by name, with a large one for infinity, which has no gradient and not every simulator reads."""
    return {name: min(max(value, -_LARGE), _LARGE) for name, value in flat_parameters(equations).items()}


def array_functions() -> str:
    """The functions that exported equations call beside an array library's own."""
    return ARRAY_FUNCTIONS.read_text(encoding="utf-8").strip()


def execute(equations: Equations, xp: Any, parameters: Any, **instead: Any) -> SimpleNamespace:
    """The functions of the equations on an array library, with functions ``instead`` of those for arrays."""
    space = {"xp": xp, "PARAMETERS": parameters}
    exec(array_functions(), space)
    space |= instead
    exec(equations.text, space)
    return SimpleNamespace(
        **{name: space[name] for name in ("derivative", "forces", "inside", "clip_to_limit", "step")}
    )


def _symbolic_arrays(ca: Any) -> tuple[Any, dict[str, Any]]:
    """CasADi in numpy's words, and the functions that arrays have and symbols lack."""

    def where(condition: Any, first: Any, second: Any) -> Any:
        if isinstance(condition, bool | int | float):
            return first if condition else second
        return ca.if_else(condition, first, second)

    def nearest_even(x: Any) -> Any:
        up = ca.floor(x + 0.5)
        return where(ca.logic_and(up == x + 0.5, ca.fabs(ca.fmod(up, 2.0)) == 1.0), up - 1.0, up)

    def pick(table: Any, place: Any) -> Any:
        return sum(where(place == i, table[i], 0.0) for i in range(table.numel()))

    def parts(state: Any, number: int) -> Any:
        size = (state.numel() - 6) // (number - 1)
        return ca.vertsplit(state, [0, *(6 + size * i for i in range(number))])

    functions = {
        name: getattr(ca, name) for name in ("sin", "cos", "tan", "exp", "log", "tanh", "sqrt", "floor", "sign")
    }
    xp = SimpleNamespace(
        **functions, abs=ca.fabs, minimum=ca.fmin, maximum=ca.fmax, arctan2=ca.atan2, arcsin=ca.asin,
        logical_and=ca.logic_and, logical_or=ca.logic_or, logical_not=ca.logic_not, where=where, round=nearest_even,
        degrees=lambda x: degrees(1.0) * x, radians=lambda x: radians(1.0) * x, pi=pi, inf=inf, nan=nan,
    )  # fmt: skip
    return xp, {
        "pick": pick, "columns": ca.vertsplit, "stacked": ca.vertcat, "parts": parts, "joined": ca.vertcat,
    }  # fmt: skip


class SymbolicShip:
    """A ship's equations with CasADi's symbols, and its numbers as symbols by their names."""

    def __init__(self, equations: Equations) -> None:
        self.ca, self.equations = load_casadi(), equations
        self.values = finite_parameters(equations)
        self.parameters = {name: self.ca.SX.sym(name) for name in self.values}
        nested = nested_parameters(equations, self.parameters, lambda parts: self.ca.vertcat(*parts))
        self.drive_limits = nested["drives"]["limit"]
        self.functions = self._functions(self.parameters)
        self.state, self.wind = self.ca.SX.sym("state", 6), self.ca.SX.sym("wind", 2)
        self.controls = self.ca.SX.sym("controls", len(equations.controls))
        self.dt = self.ca.SX.sym("dt")

    @property
    def full_state(self) -> Any:
        """The symbols of the motion, the drives' feedback and what else is a state of the drives."""
        return self.ca.SX.sym("state", 6 + len(self.equations.controls) * (1 + len(self.equations.extra_states)))

    def derivative(self) -> Any:
        """``derivative``: state, controls that act, wind, and every number by name, which may be left out."""
        x = self.functions.derivative(self.state, self.controls, self.wind)
        forces = self.functions.forces(self.state, self.controls, self.wind)
        return self._function("derivative", {"state": self.state, "controls": self.controls, "wind": self.wind},
                              {"derivative": x, "forces": forces})  # fmt: skip

    def step(self) -> Any:
        """``step``: state with the drives', orders, wind, the step, and every number by name."""
        state = self.full_state
        after = self.functions.step(state, self.controls, self.wind, self.dt)
        inputs = {"state": state, "orders": self.controls, "wind": self.wind, "dt": self.dt}
        return self._function("step", inputs, {"next_state": after})

    def _function(self, name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> Any:
        defaults = [0.0] * len(inputs) + list(self.values.values())
        inputs = {**inputs, **self.parameters}
        return self.ca.Function(
            name,
            list(inputs.values()),
            list(outputs.values()),
            list(inputs),
            list(outputs),
            {"default_in": defaults},
        )

    def _functions(self, numbers: Mapping[str, Any]) -> SimpleNamespace:
        """The functions of the equations with these numbers."""
        xp, instead = _symbolic_arrays(self.ca)
        nested = nested_parameters(self.equations, numbers, lambda parts: self.ca.vertcat(*parts))
        return execute(self.equations, xp, nested, **instead)

    def _numbers_with_force(self, acceleration: Any) -> dict[str, Any]:
        """The numbers with the force of an acceleration [3] on mass and added mass in the constant force."""
        p, (ahead, starboard, yaw) = self.parameters, self.ca.vertsplit(acceleration)
        force = {
            "constant_X_n": (p["mass_kg"] - p["Xud"]) * ahead,
            "constant_Y_n": (p["mass_kg"] - p["Yvd"]) * starboard - p["Yrd"] * yaw,
            "constant_N_nm": (p["yaw_inertia_kgm2"] - p["Nrd"]) * yaw - p["Yrd"] * starboard,
        }
        return p | {name: p[name] + value for name, value in force.items()}

    def c_code(self) -> str:
        """C code of ``ship_start``, ``ship_step`` and ``ship_outputs`` for an FMU.

        Their inputs are state, orders, wind, the step, whether there are drives, what other forces accelerate the
        ship by, and the numbers in their order.
        They give the drives' feedback at the start, the next state, and outputs: the drives' feedback, the forces,
        and whether the model holds.
        """
        ca, n = self.ca, len(self.equations.controls)
        state, use, acceleration = self.full_state, ca.SX.sym("drives"), ca.SX.sym("acceleration", 3)
        functions = self._functions(self._numbers_with_force(acceleration))
        start = ca.vertcat(state[:6], ca.if_else(use, state[6 : 6 + n], self.controls), state[6 + n :])
        after = functions.step(start, self.controls, self.wind, self.dt)
        after[6 : 6 + n] = ca.if_else(use, after[6 : 6 + n], self.controls)
        numbers = ca.vertcat(*self.parameters.values())
        inputs = [state, self.controls, self.wind, self.dt, use, acceleration, numbers]
        feedback = start[6 : 6 + n]
        forces = functions.forces(state[:6], feedback, self.wind)
        outputs = ca.vertcat(feedback, forces, self.functions.inside(state[:6]))
        limited = self.functions.clip_to_limit(self.controls, self.drive_limits)
        begin = ca.if_else(use, limited, self.controls)
        generator = ca.CodeGenerator("ship", {"with_header": False})
        generator.add(ca.Function("ship_start", inputs, [begin]))
        generator.add(ca.Function("ship_step", inputs, [after]))
        generator.add(ca.Function("ship_outputs", inputs, [outputs]))
        return str(generator.dump())
