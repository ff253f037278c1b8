"""The kinds of actuators, one file each, and the compiled loop's way from a row's kind to its equations.

To add a kind: its controls in :data:`seatrial.acquisition.core.ship.KINDS`, and a file of its name here, like
``azimuth.py``, whose ``DEFINITION`` is a :class:`~seatrial.hybrid.vessel.actuators.kind.ActuatorModel`.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import KINDS as RECORDED_KINDS
from seatrial.acquisition.core.ship import Actuators
from seatrial.analysis.compiling import by_code, compiled
from seatrial.hybrid.vessel.actuators.kind import FIRST_NUMBER, KIND, PLAY, ActuatorModel

KINDS: dict[str, ActuatorModel] = {name: import_module(f"{__name__}.{name}").DEFINITION for name in RECORDED_KINDS}
"""The kinds by name, each from the file of its name."""


CODES: dict[str, float] = {name: float(code) for code, name in enumerate(KINDS)}
ROW_SIZE = FIRST_NUMBER + max(len(kind.numbers) for kind in KINDS.values())
WORK_SIZE = max(kind.work for kind in KINDS.values())
_WIDEST = max(len(kind.units) for kind in KINDS.values())
CONTROLS_OF = np.array([len(kind.units) for kind in KINDS.values()])
"""How many controls an actuator of each kind has, by its code."""

LAG_COLUMN = np.array([
    FIRST_NUMBER + kind.numbers.index(kind.lag) if kind.lag else -1 for kind in KINDS.values()
])  # fmt: skip
"""Where in its row an actuator of each kind has a lag of its own; -1 for none."""

PLAY_COLUMN = np.array([
    FIRST_NUMBER + kind.numbers.index(PLAY) if PLAY in kind.numbers else -1 for kind in KINDS.values()
])  # fmt: skip
"""Where in its row an actuator of each kind has the play of its angle; -1 for none."""

IS_ANGLE = np.array([[*kind.angles, *[False] * (_WIDEST - len(kind.angles))] for kind in KINDS.values()])
"""Which controls of each kind are angles, [kinds, most controls]."""


def control_units(actuators: Actuators) -> Floats:
    """What a ship's control channels are multiplied with to be controls in SI: [controls]."""
    return np.array([unit for actuator in actuators for unit in KINDS[actuator.kind].units])


def control_labels(actuators: Actuators) -> tuple[str, ...]:
    """The names of a ship's controls in SI: ``port_rps``, ``port_angle``, ``tunnel_rpm``."""
    return tuple(f"{actuator.name}_{label}" for actuator in actuators for label in KINDS[actuator.kind].labels)


def angle_columns(actuators: Actuators) -> list[int]:
    """Which of a ship's controls are angles."""
    angles = [angle for actuator in actuators for angle in KINDS[actuator.kind].angles]
    return [number for number, angle in enumerate(angles) if angle]


@compiled
def _kind_of_row(p, row, control, first, work):  # type: ignore[no-untyped-def]
    return row[KIND]


@compiled
def _kind_of_number(p, i, work, u, v, r):  # type: ignore[no-untyped-def]
    return p.actuators[i, KIND]


hold_actuator = by_code([kind.hold for kind in KINDS.values()], _kind_of_row)
"""``hold_actuator(p, row, control, first, work)``: the working numbers of one actuator while the control holds."""

actuator_force = by_code([kind.force for kind in KINDS.values()], _kind_of_number)
"""``actuator_force(p, i, work, u, v, r)``: the force and moment X [N], Y [N], N [N m]."""
