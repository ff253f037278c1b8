"""A ship's equations as a Python module of its own, which imports numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from math import isinf
from textwrap import fill
from types import SimpleNamespace
from typing import Any

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.export import deviations, symbolic
from seatrial.hybrid.export.equations import Equations
from seatrial.hybrid.vessel.files import Vessel

_WIDTH = 100
_HEAD = '''"""{title}

{remarks}

``derivative`` is the rate of change of the six states while the controls that act hold, ``runge_kutta`` a step of
it, ``step`` one of the ship with its drives, which follow orders. The last axis of an array has the states, the
controls or the wind; other axes are of a batch. Angles are in radians, shafts turn in revolutions per
second{rpm}.

    state     north [m], east [m], heading [rad], surge, sway over ground [m/s], yaw rate [rad/s]
    controls  {controls}
    wind      where it comes from [rad], its speed [m/s]

For ``step`` the state goes on with {drives}, a number for each control.
A number of ``PARAMETERS`` may be changed, or an own table handed over as ``p``. For gradients and compilation put
jax.numpy in numpy's place below.
"""

import numpy as xp
'''


def module_text(vessel: Vessel, equations: Equations, remarks: Sequence[str]) -> str:
    """The source of the module."""
    states = {"acting": "the controls that act", "behind": "the controls behind their gears' play"}
    drives = ["the drives' feedback", *(states[name] for name in equations.extra_states)]
    head = _HEAD.format(
        title=_safe_in_docstring(f"{vessel.name}: {vessel.description or 'a ship in three degrees of freedom'}."),
        remarks="\n\n".join(_safe_in_docstring(fill(remark, _WIDTH + 12)) for remark in remarks),
        controls=", ".join(equations.controls), drives=", then ".join(drives),
        rpm=", those of tunnel thrusters per minute" if any("_rpm" in name for name in equations.controls) else "",
    )  # fmt: skip
    names = f"CONTROLS = ({', '.join(_quoted(name) for name in equations.controls)},)"
    numbers = f"PARAMETERS = {_dict_source(equations.parameters, '')}"
    return "\n\n".join([head, f"{symbolic.array_functions()}\n", f"{names}\n\n{numbers}\n", equations.text]) + "\n"


def _safe_in_docstring(text: str) -> str:
    """A text that ends no docstring and begins no escape."""
    return text.replace("\\", "/").replace('"""', "'''")


def _quoted(text: str) -> str:
    return f'"{text}"'


def _dict_source(values: dict[str, Any], indent: str) -> str:
    inner = f"{indent}    "
    entries = [f"{inner}{_quoted(name)}: {_value_source(value, inner)}," for name, value in values.items()]
    return "\n".join(["{", *entries, f"{indent}}}"])


def _value_source(value: Any, indent: str) -> str:
    if isinstance(value, dict):
        return _dict_source(value, indent)
    if isinstance(value, tuple):
        return f"xp.array([{', '.join(_value_source(part, indent) for part in value)}])"
    return ("-xp.inf" if value < 0.0 else "xp.inf") if isinf(value) else repr(float(value))


def track_of_module(text: str, equations: Equations, run: deviations.StandardRun) -> Floats:
    """The states [K+1, 6] of a run by the module's source."""
    space: dict[str, Any] = {}
    exec(compile(text, "exported.py", "exec"), space)
    module = SimpleNamespace(**space)

    def after(state: Floats, orders: Floats) -> Floats:
        return np.asarray(module.step(state, orders, np.zeros(2), run.dt_s))

    return deviations.step_by_step(run, len(equations.extra_states), after)
