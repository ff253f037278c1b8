"""A base model that is some percent off, in forms that are no random functions of a diagnosis's own making.

``coefficients``: groups of hull and thruster coefficients are each off by a factor. ``polynomial``: a smooth
body force in surge, sway, yaw rate and azimuth angle. Both are scaled on a run of the ship without error: the
root mean square of the error force stays within the percentage of the root mean square that the thrusters exert
(in the full programme some 45 kN ahead, 35 kN across, 450 kN m).
"""

from __future__ import annotations

from copy import deepcopy

import numpy as np

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from tests.benchmarks.other_ship.forces import POWERS, Body, body_of
from tests.benchmarks.other_ship.motion import forces_along
from tests.benchmarks.other_ship.outside import Outside
from tests.benchmarks.other_ship.sheet import Sheet

FORMS = ("coefficients", "polynomial")
EACH = "each coefficient"
"""The form in which every coefficient is off by a draw of its own, of that percentage, whatever force it makes."""
LEAST_SHARE = 0.3
"""Of the force ahead, granted across and in yaw in a trial that never turns."""
SMALLEST_SCALES = np.array([1.0, 0.2, 0.01, 0.1])  # of u, v, r, azimuth angle: where a run has next to none
GROUPS = (
    ("surge", ("Xuu",)),
    ("surge", ("Xvv", "Xrr", "Xrv", "Xuvv", "Xrvu", "Xurr", "Xu_absv")),
    ("sway", ("Yuv", "Yuuv")),
    ("sway", ("Yur", "Yuur", "Yrrr", "Y_absr_r")),
    ("sway", ("Yvvv", "Yrrv", "Yvvr", "Y_absr_v", "Y_absv_v", "Y_absv_r")),
    ("yaw", ("Nuv", "Nuuv")),
    ("yaw", ("Nur", "Nuur", "Nrrr", "N_absr_r")),
    ("yaw", ("Nvvv", "Nrrv", "Nvvr", "N_absr_v", "N_absv_v", "N_absv_r")),
    ("pods", ("thrust_nn",)),
    ("pods", ("thrust_nu", "thrust_uu")),
    ("pods", ("side_nv", "side_uv", "side_vv")),
    ("tunnel", ("cubic_n", "quadratic_n", "linear_n")),
)


def with_error(
    random: np.random.Generator,
    sheet: Sheet,
    heel_coupling: bool,
    percent: float,
    form: str,
    dt_s: float,
    states: Floats,
    acting: Floats,
) -> tuple[Body, dict[str, list[float]]]:
    """The ship with a model error, and its root mean square beside the force range [N, N, N m].

    ``states`` [rows, 8] and ``acting`` [rows, 5] are a run of the ship without error.
    """
    body = body_of(sheet, heel_coupling)
    if form == EACH:
        return body_of(_each_off(random, sheet, percent / 100.0), heel_coupling), {}
    right = forces_of(body, Outside(), dt_s, states, acting)
    allowed = percent / 100.0 * _range(sheet, right[:, 3:])
    if form == "coefficients":
        shares = percent / 100.0 * random.normal(size=len(GROUPS)).clip(-2.0, 2.0)
        off = forces_of(body_of(_off(sheet, shares), heel_coupling), Outside(), dt_s, states, acting)
        rms = _rms(off[:, :3] - right[:, :3])
        wanted = min(1.0, float(np.min(allowed / np.maximum(rms, 1e-9))))  # forces are linear in the shares
        wrong = body_of(_off(sheet, wanted * shares), heel_coupling)
    elif form == "polynomial":
        wrong = body._replace(error=random.normal(size=(3, len(POWERS))), error_scale=_scales(states, acting))
        off = forces_of(wrong, Outside(), dt_s, states, acting)
        rms = _rms(off[:, :3] - right[:, :3])
        wrong = wrong._replace(error=wrong.error * (allowed / rms)[:, np.newaxis])
    else:
        raise ConfigurationError(f"no model error of form {form!r}", fix=f"use one of {', '.join(FORMS)}")
    seen = _rms(forces_of(wrong, Outside(), dt_s, states, acting)[:, :3] - right[:, :3])
    return wrong, {"error_rms": seen.tolist(), "force_range": (100.0 * allowed / percent).tolist()}


def forces_of(body: Body, outside: Outside, dt_s: float, states: Floats, acting: Floats) -> Floats:
    """Total forces and the thrusters' own along a run: [rows, 6] in N, N, N m twice."""
    out = np.empty((len(states), 6))
    forces_along(body, outside, dt_s, np.ascontiguousarray(states), np.ascontiguousarray(acting), out)
    return out


def _off(sheet: Sheet, shares: Floats) -> Sheet:
    wrong = deepcopy(sheet)
    for (section, names), share in zip(GROUPS, shares, strict=True):
        for name in names:
            wrong.numbers[section][name] *= 1.0 + share
    return wrong


def _each_off(random: np.random.Generator, sheet: Sheet, share: float) -> Sheet:
    wrong = deepcopy(sheet)
    for section, names in GROUPS:
        for name in names:
            wrong.numbers[section][name] *= 1.0 + share * float(random.normal())
    return wrong


def _scales(states: Floats, acting: Floats) -> Floats:
    columns = np.column_stack([states[:, 3:6], 0.5 * (acting[:, 1] + acting[:, 3])])
    return np.asarray(np.maximum(np.quantile(np.abs(columns), 0.99, axis=0), SMALLEST_SCALES))


def _range(sheet: Sheet, forces: Floats) -> Floats:
    """The size of the thrusters' forces [N, N, N m], none much smaller than the others."""
    surge, sway, yaw = _rms(forces)
    return np.array(
        [
            surge,
            max(sway, LEAST_SHARE * surge),
            max(yaw, LEAST_SHARE * surge * abs(sheet.numbers["pods"]["port_x_m"])),
        ]
    )


def _rms(forces: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(forces**2, axis=0)))
