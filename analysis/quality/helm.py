"""Whether a rudder or a nozzle turns the ship to the side that its sign says.

A rudder that is held over turns a ship that goes ahead, once she has answered: in the second half of every stretch
of one side her heading goes that way. Somebody who keeps a course puts the rudder against the turn, and so the
first half, and what turns her little, say nothing. Azimuth thrusters are not judged: they may pull, or look aft.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from acquisition.core.actuators import KINDS, Actuator
from acquisition.core.angles import unwrap
from acquisition.core.arrays import Floats
from analysis.quality.findings import CheckResult, Finding, initial_flags
from analysis.quality.samples import runs, samples_of
from analysis.tables.table import table_actuators, utc_index

_LEAST_DEG, _HELD_SHARE = 3.0, 0.3
_LEAST_S, _LEAST_TURN_DEG = 5.0, 10.0
_UNDER_WAY = 0.3
_FEWEST_DEG = 60.0
_CLEARLY = -0.8
_NEEDED = ("heading_deg", "surge_mps")


def check_helm_sign(table: pd.DataFrame) -> CheckResult:
    """Find rudders and nozzles that count to the other side (``helm_sign``).

    ``estimate``: the ``agreement`` of turns with the helm, the sum of those to its side less those to the other,
    over all, from -1 to 1; below -0.8 of 60 deg and more it is found. Without heading or surge nothing is said.
    """
    judged = [each for each in table_actuators(table) if _is_judged(each, table)]
    flags = initial_flags(table, ())
    if not all(name in table and table[name].notna().any() for name in _NEEDED):
        return CheckResult(flags)
    return CheckResult(flags, tuple(filter(None, (_finding(table, each) for each in judged))))


def _is_judged(actuator: Actuator, table: pd.DataFrame) -> bool:
    angle = actuator.angle
    return angle is not None and KINDS[actuator.kind].parts[-1] in ("rudder", "nozzle") and angle.name in table


def _finding(table: pd.DataFrame, actuator: Actuator) -> Finding | None:
    name = actuator.angle.name if actuator.angle else ""
    turned = KINDS[actuator.kind].turns * turns_with_helm(table, name)
    total = float(np.abs(turned).sum())
    agreement = float(turned.sum()) / total if total else 0.0
    if total < _FEWEST_DEG or agreement > _CLEARLY:
        return None
    index, rows = utc_index(table), samples_of(table, name).rows
    text = (
        f"{name} counts to the wrong side: while it was held over, the ship turned by {total:.0f} deg in all, "
        f"{(1.0 - agreement) / 2.0:.0%} of it to the other side"
    )
    return Finding(
        "helm_sign", name, index[rows[0]], index[rows[-1]], text,
        "Turn its sign, with scale = -1.0 in the column map, unless it is the heading's that is wrong",
        {"agreement": agreement},
    )  # fmt: skip


def turns_with_helm(table: pd.DataFrame, name: str) -> Floats:
    """How far the heading goes to the side of an angle's sign in the second half of each stretch of one side [deg].

    Turns of less than 10 deg are left out.
    """
    angle, heading, surge = (samples_of(table, each) for each in (name, *_NEEDED))
    if angle.value.size < 2:
        return np.zeros(0)
    at = angle.time_s
    course = np.interp(at, heading.time_s, unwrap(heading.value))
    ahead = np.interp(at, surge.time_s, surge.value) > _UNDER_WAY * np.quantile(np.abs(surge.value), 0.98)
    over = max(_LEAST_DEG, _HELD_SHARE * float(np.quantile(np.abs(angle.value), 0.98)))
    found = []
    for side in (1.0, -1.0):
        for first, stop in zip(*runs((side * angle.value > over) & ahead), strict=True):
            if at[stop - 1] - at[first] >= _LEAST_S:
                middle = int(np.searchsorted(at, 0.5 * (at[first] + at[stop - 1])))
                found.append(side * (course[stop - 1] - course[middle]))
    turned = np.array(found)
    return turned[np.abs(turned) >= _LEAST_TURN_DEG] if turned.size else turned
