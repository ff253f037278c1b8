"""What the fields of robots' and autopilots' logs mean: their frames, signs and units turned into the product's.

ROS has x ahead, y to port and z up in a body and x to the east and y to the north in the world (REP 103, REP 105);
a frame whose name ends in ``ned`` or ``frd`` is read as aircraft and ships have it. PX4 and ArduPilot count to the
north, the east and down, forward, to starboard and down. Without these turns a log is a mirrored trial.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.quantities import AnyArray, Floats

_NED_WORLD = re.compile(r"(?:^|[_/])ned(?:$|[_/])")
_NED_BODY = re.compile(r"(?:^|[_/])(?:ned|frd|fsd)(?:$|[_/])")
_WORLD = frozenset(
    [
        "map",
        "odom",
        "world",
        "earth",
        "enu",
        "ned",
        "utm",
        "global",
        "local_origin",
        "map_ned",
        "odom_ned",
        "world_ned",
    ]
)
"""The last names of frames that do not turn with the ship."""
AS_IN_ROS = "x to the east, as in ROS"
"""How the remark on a position ends that no frame says to be in other axes."""
_MIN_NORM = 0.5  # a quaternion of length 0 is none
UNUSED_VARIANCE = 1e6
"""The variance [rad2] of what a message has to state and nobody measured; of angles more than a turn squared."""
_LARGEST_VARIANCE = (2.0 * np.pi) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class LogField:
    """A column of a topic [n]: its unit and meaning as words of a column's head; ``meaning`` None hides it from
    recognition, so that only a map takes it."""

    samples: AnyArray
    unit: str = ""
    meaning: str | None = ""

    @property
    def changes(self) -> bool:
        """Whether the samples have more than one value."""
        finite = self.samples[np.isfinite(self.samples)]
        return bool(finite.size and (finite != finite[0]).any())


Fields = dict[str, LogField]


def are_axes_of_ros(remarks: Iterable[str]) -> bool:
    """Whether a remark on how a log was read says that a message is in the axes of ROS."""
    return any(remark.endswith((AS_IN_ROS, "REP 103)")) for remark in remarks)


@dataclass(slots=True)
class Interpretation:
    """The fields of a topic as they are taken, and remarks on how."""

    fields: Fields
    remarks: list[str] = field(default_factory=list)


def attitude_of_quaternion(x: Floats, y: Floats, z: Floats, w: Floats, *, is_ned: bool) -> dict[str, Floats]:
    """Heading, roll and pitch [deg] of quaternions [n], NaN for those of length 0; bow up is a positive pitch.

    From ROS axes the heading is 90 deg less the yaw, and the pitch changes sign; Fossen (2021, eq. 2.74).
    """
    norm = np.sqrt(x * x + y * y + z * z + w * w)
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z, w = (np.where(norm > _MIN_NORM, part / norm, np.nan) for part in (x, y, z, w))
        yaw = np.rad2deg(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
        roll = np.rad2deg(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
        pitch = np.rad2deg(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
    heading = ship.wrap_360(yaw if is_ned else 90.0 - yaw)
    return {"heading": np.asarray(heading), "roll": roll, "pitch": pitch if is_ned else -pitch}


def wind_towards(north: Floats, east: Floats) -> dict[str, Floats]:
    """Where the wind comes from [deg] and its speed [m/s] by the velocity of the air to north and east [n]."""
    return {"direction": np.asarray(ship.wrap_360(np.rad2deg(np.arctan2(-east, -north)))),
            "speed": np.hypot(north, east)}  # fmt: skip


def interpret_ros(name: str, kind: str, fields: Fields, frames: Mapping[str, str]) -> Interpretation:
    """The fields of a topic of ROS; groups of x, y and z are recognised by their names, in messages of any type.

    ``frames`` are the names of its ``frame_id`` and ``child_frame_id``, if it states them.
    """
    result = Interpretation(dict(fields))
    frame, child = frames.get("frame_id", ""), frames.get("child_frame_id", "")
    _drop_without_fix(result)
    is_measured = fields.get("orientation_covariance[0]")
    has_orientation = is_measured is None or not np.all(is_measured.samples == -1.0)
    has_tilt = is_measured is None or not np.all(is_measured.samples > _LARGEST_VARIANCE)
    for path in _paths_with_parts(fields, "xyzw"):
        is_ned = bool(_NED_WORLD.search(frame) or _NED_BODY.search(frame))
        _add_attitude(result, path, is_ned, frame, has_orientation)
        for name in () if has_tilt else ("roll", "pitch"):
            result.fields.pop(f"{path}.{name}" if path else name, None)
    for path in _paths_with_parts(fields, "xyz"):
        last = path.rpartition(".")[2]
        if last in ("position", "translation"):
            _add_position(result, path, frame)
        elif "acceleration" in path or last in ("angular", "magnetic_field"):
            _hide_parts(result, path)
            if last == "angular" and "wind" not in name:
                _add_turning(result, path, child or frame)
        elif last == "angular_velocity":
            _hide_parts(result, path)
            _add_turning(result, path, child or frame)
        elif last in ("linear", "velocity", "vector", "twist", "wind"):
            _add_velocity(result, path, name, kind, child or frame)
    for path in [path for path in result.fields if "covar" in path.lower()]:
        del result.fields[path]
    if kind.endswith("JointState"):
        for path, entry in result.fields.items():
            quantity, _, joint = path.partition(".")
            unit, scale = {"position": ("rad", 1.0), "velocity": ("rpm", 30.0 / np.pi)}.get(quantity, ("Nm", 1.0))
            result.fields[path] = LogField(scale * entry.samples, unit, "" if joint else None)
    if kind.endswith("Joy"):
        result.fields = {path: LogField(entry.samples, "", None) for path, entry in result.fields.items()}
    return result


def _paths_with_parts(fields: Mapping[str, LogField], parts: str) -> list[str]:
    """The paths below which there are exactly these parts."""
    parts_by_stem = dict[str, set[str]]()
    for path in fields:
        stem, _, part = path.rpartition(".")
        parts_by_stem.setdefault(stem, set()).add(part)
    return [stem for stem, names in parts_by_stem.items() if names & set("xyzw") == set(parts)]


def _values_of_parts(result: Interpretation, path: str, parts: str) -> list[Floats]:
    return [np.asarray(result.fields[f"{path}.{part}" if path else part].samples, dtype=float) for part in parts]


def _hide_parts(result: Interpretation, path: str, parts: str = "xyz") -> None:
    for part in parts:
        name = f"{path}.{part}" if path else part
        result.fields[name] = LogField(result.fields[name].samples, result.fields[name].unit, None)


def _put(result: Interpretation, path: str, name: str, values: Floats, unit: str, meaning: str) -> None:
    result.fields[f"{path}.{name}" if path else name] = LogField(values, unit, meaning)


def _drop_without_fix(result: Interpretation) -> None:
    """Remove positions that a receiver reports without a fix (sensor_msgs/NavSatStatus: -1)."""
    status = result.fields.get("status.status")
    if status is None or "latitude" not in result.fields:
        return
    no_fix = np.asarray(status.samples) < 0
    for name in ("latitude", "longitude"):
        values = np.where(no_fix, np.nan, result.fields[name].samples)
        result.fields[name] = LogField(values, "deg", name)
    if no_fix.any():
        result.remarks.append(f"{int(no_fix.sum()):,} positions without a fix are left out")


def _add_attitude(result: Interpretation, path: str, is_ned: bool, frame: str, is_measured: bool) -> None:
    x, y, z, w = _values_of_parts(result, path, "xyzw")
    _hide_parts(result, path, "xyzw")
    is_identity = bool(np.all((x == 0.0) & (y == 0.0) & (z == 0.0)))
    if not is_measured or is_identity:
        result.remarks.append(f"{path or 'the quaternion'} is not filled in")
        return
    axes = f"north, east, down, as its frame {frame!r} says" if is_ned else "ROS (east, north, up; REP 103)"
    result.remarks.append(f"{path or 'the quaternion'} in the axes of {axes}")
    names = {"heading": "true heading", "roll": "roll", "pitch": "pitch"}
    for name, values in attitude_of_quaternion(x, y, z, w, is_ned=is_ned).items():
        _put(result, path, name, values, "deg", names[name])


def _add_position(result: Interpretation, path: str, frame: str) -> None:
    x, y = _values_of_parts(result, path, "xy")
    _hide_parts(result, path)
    is_ned = bool(_NED_WORLD.search(frame))
    axes = f"x to the north, as its frame {frame!r} says" if is_ned else AS_IN_ROS
    result.remarks.append(f"{path} with {axes}")
    _put(result, path, "north", x if is_ned else y, "m", "north position")
    _put(result, path, "east", y if is_ned else x, "m", "east position")


def _add_turning(result: Interpretation, path: str, frame: str) -> None:
    (z,) = _values_of_parts(result, path, "z")
    is_down = bool(_NED_BODY.search(frame))
    if not np.any(z):  # exactly: a gyroscope has noise
        result.remarks.append(f"{path} is not filled in")
    elif not np.all(np.isnan(z)):
        _put(result, path, "yaw_rate", z if is_down else -z, "rad/s", "yaw rate")


def _add_velocity(result: Interpretation, path: str, name: str, kind: str, frame: str) -> None:
    """Put a vector as surge and sway, velocity to north and east, or wind, by its frame and the topic's name."""
    words = set(re.findall(r"[a-z]+", f"{name} {path} {kind}".lower()))
    x, y = _values_of_parts(result, path, "xy")
    if {"rpy", "euler"} & words:
        return
    _hide_parts(result, path)
    is_velocity = path.rpartition(".")[2] != "vector" or bool({"vel", "velocity", "speed", "twist"} & words)
    if not is_velocity and "wind" not in words:
        return
    is_world = frame.strip("/").rpartition("/")[2].lower() in _WORLD
    is_ned = bool((_NED_WORLD if is_world else _NED_BODY).search(frame))
    north, east = (x, y) if is_ned else (y, x)
    if "wind" in words:
        if is_world or not frame:
            for part, values in wind_towards(north, east).items():
                _put(result, path, part, values, "m/s" if part == "speed" else "deg", f"true wind {part}")
            result.remarks.append(f"{path} is where the air goes to: the wind comes from there")
        return
    if is_world:
        result.remarks.append(f"{path} is a velocity of the world, as its frame {frame!r} says")
        _put(result, path, "to_north", north, "m/s", "velocity north")
        _put(result, path, "to_east", east, "m/s", "velocity east")
        return
    side = "starboard" if is_ned else "port"
    says = f"its frame {frame!r} says" if is_ned else "in ROS (REP 103)"
    result.remarks.append(f"{path} with y to {side}, as {says}")
    _put(result, path, "surge", x, "m/s", "surge")
    _put(result, path, "sway", y if is_ned else -y, "m/s", "sway")


_PX4: dict[str, dict[str, tuple[str, str]]] = {
    "vehicle_gps_position": {
        "lat": ("degE7", "latitude"), "lon": ("degE7", "longitude"),
        "latitude_deg": ("deg", "latitude"), "longitude_deg": ("deg", "longitude"),
        "vel_m_s": ("m/s", "speed over ground"), "cog_rad": ("rad", "course over ground"),
        "vel_n_m_s": ("m/s", "velocity north"), "vel_e_m_s": ("m/s", "velocity east"),
    },
    "vehicle_global_position": {"lat": ("deg", "latitude"), "lon": ("deg", "longitude")},
    "vehicle_local_position": {
        "x": ("m", "north position"), "y": ("m", "east position"), "heading": ("rad", "true heading"),
        "vx": ("m/s", "velocity north"), "vy": ("m/s", "velocity east"),
    },
    "vehicle_angular_velocity": {"xyz[2]": ("rad/s", "yaw rate")},
    "vehicle_attitude": {"yawspeed": ("rad/s", "yaw rate")},
    "rpm": {"indicated_frequency_rpm": ("rpm", "rpm"), "rpm_estimate": ("rpm", "rpm")},
}  # fmt: skip
_PX4["sensor_gps"] = _PX4["vehicle_gps_position"]
"""The fields of PX4's topics that are channels, with unit and meaning."""
_ARDUPILOT: dict[str, dict[str, tuple[str, str]]] = {
    "GPS": {"Lat": ("deg", "latitude"), "Lng": ("deg", "longitude"), "Spd": ("m/s", "speed over ground"),
            "GCrs": ("deg", "course over ground")},
    "POS": {"Lat": ("deg", "latitude"), "Lng": ("deg", "longitude")},
    "ATT": {"Yaw": ("deg", "true heading"), "Roll": ("deg", "roll"), "Pitch": ("deg", "pitch")},
    "AHR2": {"Yaw": ("deg", "true heading"), "Roll": ("deg", "roll"), "Pitch": ("deg", "pitch")},
    "XKF1": {"Yaw": ("deg", "true heading"), "VN": ("m/s", "velocity north"), "VE": ("m/s", "velocity east"),
             "PN": ("m", "north position"), "PE": ("m", "east position")},
    "IMU": {"GyrZ": ("rad/s", "yaw rate")},
    "ESC": {"RPM": ("rpm", "rpm")},
    "RPM": {"rpm1": ("rpm", "1 rpm"), "rpm2": ("rpm", "2 rpm")},
}  # fmt: skip
_ARDUPILOT |= {"GPS2": _ARDUPILOT["GPS"], "NKF1": _ARDUPILOT["XKF1"]}
"""The same of ArduPilot's messages."""
SHAFT_SPEEDS = frozenset(["ESC", "RPM"])
"""The messages that tell what the shafts did; without them their orders stand for it."""
_FUNCTIONS = {26: "rudder", 70: "propeller speed", 73: "port propeller speed", 74: "starboard propeller speed"}
"""ArduPilot's SERVOn_FUNCTION of a boat: steering, throttle, and the throttles of two sides (Rover 4)."""
_RUDDER = 26
_USUAL_PULSES_US = {"MIN": 1100.0, "TRIM": 1500.0, "MAX": 1900.0, "REVERSED": 0.0}
ServoOutputs = Mapping[str, tuple[str, dict[str, float]]]
"""ArduPilot's outputs that drive or steer, by their field: what they mean, and the pulses [us] of their range."""


def servo_outputs(parameters: Mapping[str, float], *, has_shaft_speed: bool) -> ServoOutputs:
    """The outputs that drive or steer a boat by ArduPilot's parameters, without those to measured shafts."""
    outputs = dict[str, tuple[str, dict[str, float]]]()
    for name, function in parameters.items():
        number = name.removeprefix("SERVO").removesuffix("_FUNCTION")
        if number.isdigit() and function in _FUNCTIONS and (function == _RUDDER or not has_shaft_speed):
            pulses = {key: parameters.get(f"SERVO{number}_{key}", usual) for key, usual in _USUAL_PULSES_US.items()}
            outputs[f"C{number}"] = _FUNCTIONS[int(function)], pulses
    return outputs


def _add_outputs(result: Interpretation, outputs: ServoOutputs) -> None:
    """Put the outputs that drive or steer, in percent to either side of their trim; a pulse of 0 is none."""
    for path, (meaning, pulse) in outputs.items():
        if path not in result.fields or not pulse["MIN"] <= pulse["TRIM"] < pulse["MAX"]:
            continue
        width = np.asarray(result.fields[path].samples, dtype=float) - pulse["TRIM"]
        side = np.where(width >= 0.0, pulse["MAX"] - pulse["TRIM"], max(pulse["TRIM"] - pulse["MIN"], 1.0))
        percent = np.where(width == -pulse["TRIM"], np.nan, (-100.0 if pulse["REVERSED"] else 100.0) * width / side)
        _put(result, "", f"{path}_percent", percent, "%", meaning)
        result.remarks.append(f"{path} is the order to the {meaning.removesuffix(' speed')}, by the log's SERVO"
                              f"{path[1:]}_FUNCTION: what it does lags behind")  # fmt: skip


_MIN_FIX = {"fix_type": 2, "Status": 2}  # of two dimensions


def interpret_autopilot(name: str, kind: str, fields: Fields, outputs: ServoOutputs) -> Interpretation:
    """The fields of a topic of PX4 or ArduPilot: what is known to be a channel, the others for maps alone."""
    table = _PX4.get(kind) or _ARDUPILOT.get(kind) or {}
    number = next(iter(re.findall(r"\[(\d+)\]$", name)), "")
    result = Interpretation({path: LogField(entry.samples, entry.unit, None) for path, entry in fields.items()})
    for path, (unit, meaning) in table.items():
        if path in fields and meaning:
            actuator = f"{number} {meaning}" if meaning == "rpm" and number else meaning
            result.fields[path] = LogField(fields[path].samples, unit, actuator)
    for path in [path for path in fields if kind == "esc_status" and path.endswith("esc_rpm")]:
        esc = next(iter(re.findall(r"\d+", path)), "")
        if np.any(fields[path].samples):
            result.fields[path] = LogField(fields[path].samples, "rpm", f"{esc} rpm")
    if kind == "vehicle_attitude" and "q[0]" in fields:
        w, x, y, z = (np.asarray(fields[f"q[{index}]"].samples, dtype=float) for index in range(4))
        for part, values in attitude_of_quaternion(x, y, z, w, is_ned=True).items():
            _put(result, "", part, values, "deg", f"true {part}" if part == "heading" else part)
    wind = next(
        (pair for pair in (("windspeed_north", "windspeed_east"), ("VWN", "VWE")) if pair[0] in fields), None
    )
    if wind and wind[1] in fields:
        parts = wind_towards(*(np.asarray(fields[part].samples, dtype=float) for part in wind))
        for part, values in parts.items():
            _put(result, "", f"wind_{part}", values, "m/s" if part == "speed" else "deg", f"true wind {part}")
    if kind == "RCOU":
        _add_outputs(result, outputs)
    _drop_low_fix(result)
    return result


def _drop_low_fix(result: Interpretation) -> None:
    """Remove the positions and speeds of a receiver without a fix."""
    for flag, least in _MIN_FIX.items():
        if flag not in result.fields or not any(entry.meaning == "latitude" for entry in result.fields.values()):
            continue
        no_fix = np.asarray(result.fields[flag].samples) < least
        if no_fix.any():
            result.remarks.append(f"{int(no_fix.sum()):,} rows without a fix are left out")
        for path, entry in result.fields.items():
            if entry.meaning:
                result.fields[path] = LogField(np.where(no_fix, np.nan, entry.samples), entry.unit, entry.meaning)
