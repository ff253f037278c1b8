"""The matrix form of a ship as files of MATLAB, and as plugins of Gazebo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, pi, radians
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from seatrial.acquisition.core.files import atomic_file, write_text
from seatrial.hybrid.export.matrices import SECOND_ORDER, MatrixModel, Thruster
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant

FACTORS = {
    "u": ("u", "1"), "v": ("v", "1"), "r": ("r", "1"), "u|u|": ("u", "abs(u)"), "vv": ("v", "v"), "rr": ("r", "r"),
    "vr": ("r", "v"), "u|v|": ("u", "abs(v)"), "uv": ("v", "u"), "ur": ("r", "u"), "v|v|": ("v", "abs(v)"),
    "v|r|": ("v", "abs(r)"), "r|v|": ("r", "abs(v)"), "r|r|": ("r", "abs(r)"), "uvv": ("v", "u*v"),
    "uvr": ("r", "u*v"), "urr": ("r", "u*r"), "uuv": ("v", "u*u"), "uur": ("r", "u*u"), "vvv": ("v", "v*v"),
    "vvr": ("r", "v*v"), "vrr": ("r", "v*r"), "rrr": ("r", "r*r"),
}  # fmt: skip
"""Each term as an entry of D(nu): the speed that the entry multiplies, and the entry over its coefficient."""


def write_m(path: Path, name: str, model: MatrixModel, remarks: Sequence[str]) -> Path:
    """Write a function of MATLAB: the accelerations and the matrices at speeds and controls."""
    damping = [
        f"D({'XYN'.index(axis) + 1},{'uvr'.index(FACTORS[term][0]) + 1}) = "
        f"D({'XYN'.index(axis) + 1},{'uvr'.index(FACTORS[term][0]) + 1}) - ({value!r}) * {FACTORS[term][1]};"
        for axis, terms in model.hull.items() for term, value in terms.items()
    ]  # fmt: skip
    arm = model.mass_kg * model.centre_of_gravity_m
    lines = [
        f"function [nu_dot, M, C, D, tau, D_linear, C_linear] = {name}(nu, controls)",
        *(f"% {remark}" for remark in remarks),
        "% M nu_dot + C(nu) nu + D(nu) nu = tau(controls, u); nu = [u; v; r] through the water [m/s, m/s, rad/s].",
        f"% controls, in SI: {', '.join(_names_of_controls(model))}",
        "% D has the Coriolis force of the added mass in it. D_linear and C_linear hold about the service speed",
        f"% {model.service_mps:.4g} m/s: M nu_dot + (C_linear + D_linear) (nu - nu_0) = tau - tau_0.",
        "u = nu(1); v = nu(2); r = nu(3);",
        f"M = {_matrix_text(model.mass)};",
        f"C = [0, 0, -({model.mass_kg!r}*v + ({arm!r})*r); 0, 0, {model.mass_kg!r}*u; "
        f"{model.mass_kg!r}*v + ({arm!r})*r, -{model.mass_kg!r}*u, 0];",
        "D = zeros(3, 3);", *damping,
        f"D_linear = {_matrix_text(model.linear_damping())};",
        f"C_linear = {_matrix_text(model.linear_coriolis())};",
        "tau = [0; 0; 0];", *(line for thruster in model.thrusters for line in _thruster_lines(thruster)),
        "nu_dot = M \\ (tau - C * nu - D * nu);", "end", "",
    ]  # fmt: skip
    return write_text(path, "\n".join(lines))


def _names_of_controls(model: MatrixModel) -> list[str]:
    names = dict[int, str]()
    for thruster in model.thrusters:
        unit = "rev/s" if thruster.shaft_per_unit == 1.0 else "rpm"
        names[thruster.control] = f"{thruster.name} [{unit}]" if thruster.direction else f"{thruster.name} [rad]"
        if thruster.angle > thruster.control:
            names[thruster.angle] = f"{thruster.name} [rad]"
        if thruster.pitch >= 0:
            names[thruster.pitch] = f"{thruster.name} pitch [full ahead = 1]"
    return [names[place] for place in sorted(names)]


def _matrix_text(values: Any) -> str:
    return "[" + "; ".join(", ".join(repr(float(value)) for value in row) for row in values) + "]"


def _thruster_lines(thruster: Thruster) -> list[str]:
    lines = [f"% {thruster.name} ({thruster.kind})"]
    if thruster.direction:
        pitch = f" * controls({thruster.pitch + 1})" if thruster.pitch >= 0 else ""
        angle = f"controls({thruster.angle + 1})" if thruster.angle >= 0 else "0"
        direction = {"abeam": "[0; 1]", "ahead": "[1; 0]"}.get(thruster.direction, f"[cos({angle}); sin({angle})]")
        lines += [
            f"n = controls({thruster.control + 1}) * {thruster.shaft_per_unit!r};",
            f"if n >= 0, pull = ({thruster.nn!r})*n*n + ({thruster.nu!r})*n*u; "
            f"else, pull = -({thruster.nn_astern!r})*n*n - ({thruster.nu_astern!r})*n*u; end",
            f"F = pull{pitch} * {direction};",
            f"tau = tau + [F(1); F(2); ({thruster.x_m!r})*F(2) - ({thruster.y_m!r})*F(1)];",
        ]  # fmt: skip
    if thruster.steering:
        shaft = f"controls({thruster.shaft + 1})" if thruster.shaft >= 0 else "0"
        lines += [
            f"s = sin(controls({thruster.angle + 1})); n = {'max' if thruster.kind == 'rudder' else 'abs'}({shaft}"
            f"{', 0' if thruster.kind == 'rudder' else ''});",
            *(f"tau({place}) = tau({place}) + (({c['uu']!r})*u*abs(u) + ({c['nn']!r})*n*n + ({c['nu']!r})*n*u)"
              f" * {'s*s' if axis == 'X' else 's'};"
              for place, (axis, c) in enumerate(thruster.steering.items(), 1)),
        ]  # fmt: skip
    return lines


def write_mat(path: Path, vessel: Vessel, model: MatrixModel, remarks: Sequence[str]) -> Path:
    """Write the matrices, coefficients and thrusters as a file of MATLAB."""
    from scipy.io import savemat

    terms = ("uu", "nn", "nu")
    thrusters = [
        {
            "name": thruster.name, "kind": thruster.kind, "x_m": thruster.x_m, "y_m": thruster.y_m,
            "nn": thruster.nn, "nn_astern": thruster.nn_astern, "nu": thruster.nu, "nu_astern": thruster.nu_astern,
            "direction": _thrust_column(thruster),
            "steering": np.array([
                [thruster.steering.get(axis, {}).get(term, 0.0) for term in terms] for axis in "XYN"
            ]),
        }
        for thruster in model.thrusters
    ]  # fmt: skip
    contents = {
        "name": vessel.name, "remarks": "\n".join(remarks), "M": model.mass, "M_RB": model.rigid,
        "M_A": model.added,
        "D_linear": model.linear_damping(), "C_linear": model.linear_coriolis(), "service_mps": model.service_mps,
        "mass_kg": model.mass_kg, "centre_of_gravity_m": model.centre_of_gravity_m,
        "B": np.column_stack([_thrust_column(thruster) for thruster in model.thrusters]),
        "terms": {axis: {"names": np.array(list(terms), dtype=object), "values": np.array(list(terms.values()))}
                  for axis, terms in model.hull.items()},
        "thrusters": np.array(thrusters, dtype=object),
    }  # fmt: skip
    with atomic_file(path) as temporary, temporary.open("wb") as stream:
        savemat(stream, contents, do_compression=True)
    return path


def _thrust_column(thruster: Thruster) -> list[float]:
    """The column of the thrust configuration: force and moment for one newton, of what turns where it is ahead."""
    if thruster.direction in ("", "abeam"):
        return [0.0, 1.0, thruster.x_m]
    return [1.0, 0.0, -thruster.y_m]


_GAZEBO = {
    "u": "U", "v": "V", "r": "R", "u|u|": "UabsU", "vv": "VV", "rr": "RR", "vr": "VR", "u|v|": "UabsV", "uv": "UV",
    "ur": "UR", "v|v|": "VabsV", "v|r|": "VabsR", "r|v|": "RabsV", "r|r|": "RabsR",
}  # fmt: skip
"""The terms as the plugin names them, after the letter of the force."""


def write_sdf(path: Path, vessel: Vessel, plant: Plant, model: MatrixModel, remarks: Sequence[str]) -> Path:
    """Write a model with the plugins of Gazebo for the hull and the thrusters."""
    root = ElementTree.Element("sdf", version="1.9")
    ship = ElementTree.SubElement(root, "model", name=vessel.name)
    link = ElementTree.SubElement(ship, "link", name="base_link")
    inertial = ElementTree.SubElement(link, "inertial")
    _add_texts(inertial, {"pose": f"{model.centre_of_gravity_m!r} 0 0 0 0 0", "mass": repr(model.mass_kg)})
    turning = float(model.rigid[2, 2] - model.mass_kg * model.centre_of_gravity_m**2)
    roll = model.mass_kg * (0.35 * plant.beam_m) ** 2
    _add_texts(
        ElementTree.SubElement(inertial, "inertia"), {"ixx": repr(roll), "iyy": repr(turning), "izz": repr(turning)}
    )
    hydrodynamics = _add_plugin(ship, "gz-sim-hydrodynamics-system", "gz::sim::systems::Hydrodynamics")
    added = {"xDotU": plant.Xud, "yDotV": plant.Yvd, "yDotR": plant.Yrd, "nDotV": plant.Yrd, "nDotR": plant.Nrd}
    terms = {f"{axis.lower()}{_GAZEBO[term]}": value
             for axis, values in _without_fins(model).items() for term, value in values.items()}  # fmt: skip
    _add_texts(hydrodynamics, {
        "link_name": "base_link", "water_density": repr(plant.water_density_kgpm3), "disable_coriolis": "true",
        **{name: repr(float(value)) for name, value in {**added, **terms}.items()},
    })  # fmt: skip
    for thruster in model.thrusters:
        if thruster.direction:
            _add_thruster(ship, vessel, plant, thruster)
        else:
            _add_rudder(ship, vessel, plant, thruster)
    ElementTree.indent(root)
    comment = "\n".join(remark.replace("--", "- -") for remark in remarks)
    text = ElementTree.tostring(root, encoding="unicode")
    return write_text(path, f'<?xml version="1.0"?>\n<!--\n{comment}\n-->\n{text}\n')


def _without_fins(model: MatrixModel) -> dict[str, dict[str, float]]:
    """The hull's terms less what a rudder's plugin adds by itself in drift and turn, with its angle at zero."""
    hull = {axis: dict(terms) for axis, terms in model.hull.items()}
    for thruster in model.thrusters:
        if not thruster.direction and thruster.steering:
            lift = -thruster.steering["Y"]["uu"]
            for axis, arm in (("Y", 1.0), ("N", thruster.x_m)):
                hull[axis]["uv"] += lift * arm
                hull[axis]["ur"] += lift * arm * thruster.x_m
    return hull


def _add_plugin(parent: ElementTree.Element, file: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, "plugin", filename=file, name=name)


def _add_texts(parent: ElementTree.Element, texts: Mapping[str, str]) -> None:
    for name, text in texts.items():
        ElementTree.SubElement(parent, name).text = text


def _add_thruster(ship: ElementTree.Element, vessel: Vessel, plant: Plant, thruster: Thruster) -> None:
    """A thruster's link and joint, and the plugin; its axis points ahead, to starboard if it pushes abeam.

    One that turns has a link of its own in between, whose joint a controller turns about the downward axis.
    """
    entry: Any = next(entry for entry in vessel.actuator if entry.name == thruster.name)
    diameter = float(getattr(entry, "propeller_diameter_m", getattr(entry, "diameter_m", 1.0)))
    coefficient = thruster.nn / (plant.water_density_kgpm3 * diameter**4 * (2.0 * pi) ** 2)
    n = float(entry.limit_rpm) / 60.0
    abeam = thruster.direction == "abeam"
    ElementTree.SubElement(
        ElementTree.SubElement(ship, "link", name=thruster.name), "pose"
    ).text = f"{thruster.x_m!r} {-thruster.y_m!r} 0 0 0 {-pi / 2.0 if abeam else 0.0!r}"
    parent = "base_link"
    if thruster.angle >= 0:
        parent = steering_link(thruster)
        pod = ElementTree.SubElement(ship, "link", name=parent)
        ElementTree.SubElement(pod, "pose").text = f"{thruster.x_m!r} {-thruster.y_m!r} 0 0 0 0"
        _add_steering_joint(ship, vessel, entry, parent)
    _add_joint(ship, f"{thruster.name}_joint", parent, thruster.name, "1 0 0")
    _add_texts(_add_plugin(ship, "gz-sim-thruster-system", "gz::sim::systems::Thruster"), {
        "namespace": vessel.name, "joint_name": f"{thruster.name}_joint", "propeller_diameter": repr(diameter),
        "fluid_density": repr(plant.water_density_kgpm3), "thrust_coefficient": repr(float(coefficient)),
        "max_thrust_cmd": repr(float(thruster.nn * n * n)),
        "min_thrust_cmd": repr(float(-thruster.nn_astern * n * n)),
        "velocity_control": "true",
    })  # fmt: skip


def _add_joint(ship: ElementTree.Element, name: str, parent: str, child: str, axis: str) -> None:
    joint = ElementTree.SubElement(ship, "joint", name=name, type="revolute")
    _add_texts(joint, {"parent": parent, "child": child})
    ElementTree.SubElement(ElementTree.SubElement(joint, "axis"), "xyz").text = axis


def _add_steering_joint(ship: ElementTree.Element, vessel: Vessel, actuator: Any, child: str) -> None:
    """The joint about which an actuator steers, downward as our angles are, and the controller of its position.

    It turns at the actuator's rate where that is stated (``cmd_max`` of a controller by velocities [rad/s]).
    """
    _add_joint(ship, f"{child}_joint", "base_link", child, "0 0 -1")
    rate_dps = float(getattr(actuator, "azimuth_rate_limit_dps", getattr(actuator, "rate_limit_dps", inf)))
    system = "gz-sim-joint-position-controller-system"
    _add_texts(_add_plugin(ship, system, "gz::sim::systems::JointPositionController"), {
        "joint_name": f"{child}_joint", "topic": steering_topic(vessel, child), "use_velocity_commands": "true",
        **({"cmd_max": repr(radians(rate_dps)), "cmd_min": repr(-radians(rate_dps))} if rate_dps < inf else {}),
    })  # fmt: skip


def steering_link(thruster: Thruster) -> str:
    """The link that steers: a rudder's own, of a pod that which its propeller turns on."""
    return f"{thruster.name}_steering" if thruster.direction else thruster.name


def steering_topic(vessel: Vessel, link: str) -> str:
    """The topic of the angle [rad] of a link that steers."""
    return f"/model/{vessel.name}/joint/{link}_joint/cmd_pos"


def command_remarks(vessel: Vessel, model: MatrixModel) -> list[str]:
    """What each thruster and rudder is told in Gazebo, for the orders of the ship.

    The plugin's force is the command [N] itself; by a shaft speed (``use_angvel_cmd``) it has one coefficient for
    ahead and astern and clamps rad/s by the limits in newtons (Thruster.cc of gz-sim 7 and 8).
    """
    remarks = []
    for thruster in model.thrusters:
        if thruster.direction:
            topic = f"/model/{vessel.name}/joint/{thruster.name}_joint/cmd_thrust"
            remarks.append(
                f"{thruster.name}: newtons on {topic}, of n rev/s "
                f"{thruster.nn:.6g} n^2 ahead and -{thruster.nn_astern:.6g} n^2 astern."
            )
        if not thruster.direction or thruster.angle >= 0:
            topic = steering_topic(vessel, steering_link(thruster))
            remarks.append(f"{thruster.name}: its angle [rad], as recorded, on {topic}.")
    return remarks


def _add_rudder(ship: ElementTree.Element, vessel: Vessel, plant: Plant, thruster: Thruster) -> None:
    """A rudder's link and joint, and the plugin of a lifting surface with the slope of the fit."""
    area = float(plant.number(f"{thruster.name}_area_m2"))
    slope = -2.0 * thruster.steering["Y"]["uu"] / (plant.water_density_kgpm3 * area)
    ElementTree.SubElement(
        ElementTree.SubElement(ship, "link", name=thruster.name), "pose"
    ).text = f"{thruster.x_m!r} 0 0 0 0 0"
    entry = next(entry for entry in vessel.actuator if entry.name == thruster.name)
    _add_steering_joint(ship, vessel, entry, steering_link(thruster))
    _add_texts(_add_plugin(ship, "gz-sim-lift-drag-system", "gz::sim::systems::LiftDrag"), {
        "link_name": thruster.name, "air_density": repr(plant.water_density_kgpm3), "area": repr(area),
        "a0": "0", "cla": repr(float(slope)), "cda": "0", "alpha_stall": "0.6", "cla_stall": "0", "cda_stall": "0",
        "cp": "0 0 0", "forward": "1 0 0", "upward": "0 1 0",
    })  # fmt: skip


def added_mass_shares(model: MatrixModel) -> dict[str, float]:
    """The added mass in sway and the added inertia in yaw over the ship's own: above one the plugin is unstable."""
    return {
        "surge": float(model.added[0, 0] / model.rigid[0, 0]), "sway": float(model.added[1, 1] / model.rigid[1, 1]),
        "yaw": float(model.added[2, 2] / model.rigid[2, 2]),
    }  # fmt: skip


GAZEBO_TERMS, GAZEBO_STEERING = SECOND_ORDER, {"rudder": ("uu",)}
"""What the plugins can express: terms of second order, and of steering a rudder in the flow of the ship's speed."""
