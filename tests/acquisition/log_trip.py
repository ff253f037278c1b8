"""A simulated trip whose truth is known, and writers of it as logs by the formats' own libraries."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

START_NS = 1_779_019_200_123_456_789  # 2026-05-17 12:00 UTC
STEP_NS, DAY_NS = 200_000_000, 86_400_000_000_000
LEAP_S = 18
TIMES_NS = {"gps": 7, "gyro": 1_013, "log": 50_000_029, "engine": 90_000_031, "steering": 120_000_037}
"""How far each topic is sampled behind the others [ns]: no two have a stamp in common."""


@dataclass(frozen=True, slots=True)
class Trip:
    """The truth [n]: ``ns`` by topic, channels by name in the product's units and frames."""

    ns: dict[str, np.ndarray]
    channels: dict[str, tuple[str, np.ndarray]]

    def of(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The stamps and values of a channel."""
        topic, values = self.channels[name]
        return self.ns[topic], values


def trip(count: int = 300, start_ns: int = START_NS, resolution_ns: int = 1) -> Trip:
    """A ship that weaves, with surge, sway and rudder that change."""

    def state(ns: np.ndarray) -> dict[str, np.ndarray]:
        t = (ns - start_ns) / 1e9
        psi = 0.6 + 0.9 * (1.0 - np.cos(2.0 * np.pi * t / 70.0))
        return {
            "heading_deg": np.rad2deg(psi) % 360.0,
            "yaw_rate_dps": np.rad2deg(0.9 * 2.0 * np.pi / 70.0 * np.sin(2.0 * np.pi * t / 70.0)),
            "surge_mps": 3.0 + 0.4 * np.sin(2.0 * np.pi * t / 90.0),
            "sway_mps": 0.15 * np.sin(2.0 * np.pi * t / 55.0),
            "propeller_rpm": 600.0 + 50.0 * np.sin(t / 9.0),
            "rudder_angle_deg": 12.0 * np.sin(2.0 * np.pi * t / 70.0),
        }

    stamps = {
        topic: (start_ns + offset + STEP_NS * np.arange(count)) // resolution_ns * resolution_ns
        for topic, offset in TIMES_NS.items()
    }
    fine = start_ns + np.arange(0, count * STEP_NS + STEP_NS, STEP_NS // 10)
    moving = state(fine)
    psi = np.deg2rad(moving["heading_deg"])
    north = np.cumsum(moving["surge_mps"] * np.cos(psi) - moving["sway_mps"] * np.sin(psi)) * (STEP_NS / 1e10)
    east = np.cumsum(moving["surge_mps"] * np.sin(psi) + moving["sway_mps"] * np.cos(psi)) * (STEP_NS / 1e10)
    at = stamps["gps"]
    track = [np.interp((at - start_ns) / 1e9, (fine - start_ns) / 1e9, part) for part in (north, east)]
    latitude, longitude, _ = pymap3d.ned2geodetic(*track, 0.0 * track[0], 63.43, 10.39, 0.0)
    topics = {"heading_deg": "gyro", "yaw_rate_dps": "gyro", "surge_mps": "log", "sway_mps": "log",
              "propeller_rpm": "engine", "rudder_angle_deg": "steering"}  # fmt: skip
    channels = {name: (topic, state(stamps[topic])[name]) for name, topic in topics.items()}
    return Trip(stamps, {"latitude_deg": ("gps", latitude), "longitude_deg": ("gps", longitude), **channels})


def table_of(truth: Trip, topic: str) -> dict[str, np.ndarray]:
    """The channels of a topic by name."""
    return {name: values for name, (of, values) in truth.channels.items() if of == topic}


NAMES = {
    "latitude_deg": ("Latitude", "deg"), "longitude_deg": ("Longitude", "deg"), "heading_deg": ("Heading", "deg"),
    "yaw_rate_dps": ("Rate of turn", "deg/s"), "surge_mps": ("Surge", "m/s"), "sway_mps": ("Sway", "m/s"),
    "propeller_rpm": ("Propeller speed", "rpm"), "rudder_angle_deg": ("Rudder", "deg"),
}  # fmt: skip
"""What the channels are called in formats that name units beside."""


def with_units(truth: Trip, topic: str) -> dict[str, np.ndarray]:
    """The channels of a topic by names that state their units."""
    return {f"{NAMES[name][0]} [{NAMES[name][1]}]": values for name, values in table_of(truth, topic).items()}


def write_mdf(path: Path, truth: Trip, version: str = "4.10", ahead_of_utc: timedelta | None = None) -> None:
    """A measurement by ASAM MDF, a group for each topic; ``ahead_of_utc`` is a clock whose zone is not stated."""
    from asammdf import MDF, Signal

    with MDF(version=version) as file:
        start = datetime.fromtimestamp(START_NS // 10**9, UTC) + (ahead_of_utc or timedelta())
        file.start_time = start if ahead_of_utc is None or version < "4" else start.replace(tzinfo=None)
        origin_ns = START_NS // 10**9 * 10**9
        for topic, ns in truth.ns.items():
            signals = [
                Signal(values, (ns - origin_ns) / 1e9, name=NAMES[name][0], unit=NAMES[name][1])
                for name, values in table_of(truth, topic).items()
            ]
            file.append(signals, comment=topic)
        file.save(path.with_suffix(".mf4" if version > "4" else ".mdf"), overwrite=True).replace(path)


def write_tdms(path: Path, truth: Trip) -> None:
    """A LabVIEW measurement with waveforms, a group for each topic."""
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for topic, ns in truth.ns.items():
            about = {"wf_start_time": np.datetime64(int(ns[0]) // 1000, "us"), "wf_increment": STEP_NS / 1e9,
                     "wf_start_offset": (int(ns[0]) % 1000) / 1e9}  # fmt: skip
            writer.write_segment([
                ChannelObject(topic, NAMES[name][0], values, {**about, "unit_string": NAMES[name][1]})
                for name, values in table_of(truth, topic).items()
            ])  # fmt: skip


def write_hdf5(path: Path, truth: Trip) -> None:
    """A file with a group for each topic, and its time."""
    import h5py

    with h5py.File(path, "w") as file:
        for topic, ns in truth.ns.items():
            group = file.create_group(f"measured/{topic}")
            group["time"] = ns
            for name, values in table_of(truth, topic).items():
                group[NAMES[name][0]] = values
                group[NAMES[name][0]].attrs["units"] = NAMES[name][1]


def write_cf_hdf5(path: Path, truth: Trip) -> None:
    """Groups by the conventions of NetCDF: hours since midnight, quarters with an offset, a fill value."""
    import h5py

    with h5py.File(path, "w") as file:
        for topic, ns in truth.ns.items():
            group = file.create_group(topic)
            midnight = ns[0] // DAY_NS * DAY_NS
            group["time"] = (ns - midnight) / 3.6e12
            group["time"].attrs["units"] = f"hours since {pd.Timestamp(midnight)}"
            for name, values in table_of(truth, topic).items():
                item = group.create_dataset(NAMES[name][0], data=(np.append(values[:-1], np.nan) - 7.0) / 0.25)
                item[-1] = -9999.0
                item.attrs.update(units=NAMES[name][1], scale_factor=0.25, add_offset=7.0, _FillValue=-9999.0)


def write_npz(path: Path, truth: Trip) -> None:
    """Arrays with a stroke between group and name, and their units in the names."""
    arrays = {f"{topic}/time_ns": ns for topic, ns in truth.ns.items()}
    for name, (topic, values) in truth.channels.items():
        arrays[f"{topic}/{NAMES[name][0]} [{NAMES[name][1]}]"] = values
    np.savez(path, **arrays)


def write_json_lines(path: Path, truth: Trip) -> None:
    """An object a message, with a topic and an object of values, in order of time."""
    rows = [
        (int(ns), json.dumps({"topic": f"ship/{topic}", "time": f"{np.datetime64(int(ns), 'ns')}Z", "data": {
            name: float(values[index]) for name, values in table_of(truth, topic).items()}}))
        for topic, stamps in truth.ns.items() for index, ns in enumerate(stamps)
    ]  # fmt: skip
    path.write_text("\n".join(text for _, text in sorted(rows)) + "\n")


def write_long_json_lines(path: Path, truth: Trip) -> None:
    """An object a value: its name, its time in ns since 1970, itself."""
    rows = [
        json.dumps({"ts": int(ns), "name": name, "value": float(value)})
        for name in truth.channels for ns, value in zip(*truth.of(name), strict=True)
    ]  # fmt: skip
    path.write_text("\n".join(rows) + "\n")


def write_mqtt_json_lines(path: Path, truth: Trip) -> None:
    """An object a value, as programs log MQTT: the payload is text."""
    rows = [
        json.dumps({"ts": int(ns), "topic": f"ship/{name}", "payload": repr(float(value))})
        for name in truth.channels for ns, value in zip(*truth.of(name), strict=True)
    ]  # fmt: skip
    path.write_text("\n".join(rows) + "\n")


def write_json_array(path: Path, truth: Trip) -> None:
    """An array of objects, over several lines."""
    write_json_lines(path, truth)
    path.write_text(json.dumps([json.loads(line) for line in path.read_text().splitlines()], indent=1))


def write_json_columns(path: Path, truth: Trip) -> None:
    """An object of arrays, of the trip's values in rows."""
    ns = np.unique(np.concatenate([*truth.ns.values()]))
    columns: dict[str, list[Any]] = {"time": ns.tolist()}
    for name in truth.channels:
        at, values = truth.of(name)
        column = columns[f"{NAMES[name][0]} [{NAMES[name][1]}]"] = [None] * ns.size
        for row, value in zip(np.searchsorted(ns, at).tolist(), values.tolist(), strict=True):
            column[row] = value
    path.write_text(json.dumps(columns))


SIGNAL_K = {
    "heading_deg": ("navigation.headingTrue", np.pi / 180.0),
    "yaw_rate_dps": ("navigation.rateOfTurn", np.pi / 180.0),
    "rudder_angle_deg": ("steering.rudderAngle", np.pi / 180.0),
}


def write_signal_k(path: Path, truth: Trip) -> None:
    """Deltas of Signal K (SI units), each source with a number, beside those of another vessel by AIS."""

    def delta(
        ns: int, source: str, values: dict[str, Any], vessel: str = "vessels.urn:mrn:imo:mmsi:257000001"
    ) -> str:
        stamp = f"{np.datetime64(ns, 'ns')}Z"
        updates = [{"$source": source, "timestamp": stamp,
                    "values": [{"path": key, "value": value} for key, value in values.items()]}]  # fmt: skip
        return json.dumps({"context": vessel, "updates": updates})

    rows = []
    for name, (key, scale) in SIGNAL_K.items():
        rows += [delta(int(ns), f"n2k.{name}.3", {key: float(value) * scale})
                 for ns, value in zip(*truth.of(name), strict=True)]  # fmt: skip
    ns, latitude = truth.of("latitude_deg")
    for at, north, east in zip(ns, latitude, truth.of("longitude_deg")[1], strict=True):
        position = {"latitude": float(north), "longitude": float(east)}
        rows.append(delta(int(at), "gps.1", {"navigation.position": position}))
        rows.append(
            delta(int(at), "engine.7", {"propulsion.main.revolutions": 25.0})
        )  # the engine's, not the shaft's
        target = {"navigation.position": {"latitude": float(north) + 0.01, "longitude": float(east)},
                  "navigation.headingTrue": 1.0, "navigation.courseOverGroundMagnetic": 2.0}  # fmt: skip
        rows.append(delta(int(at), "ais", target, "vessels.urn:mrn:imo:mmsi:257000002"))
    path.write_text("\n".join(rows) + "\n")


def write_sqlite(path: Path, truth: Trip) -> None:
    """A table for each topic."""
    with sqlite3.connect(path) as connection:
        for topic, ns in truth.ns.items():
            frame = pd.DataFrame({"timestamp": ns, **with_units(truth, topic)})
            frame.to_sql(topic, connection, index=False)
    connection.close()


def write_long_sqlite(path: Path, truth: Trip) -> None:
    """One table with a row for each value."""
    rows = [
        (int(ns), NAMES[name][0], float(value), NAMES[name][1])
        for name in truth.channels for ns, value in zip(*truth.of(name), strict=True)
    ]  # fmt: skip
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE log (time INTEGER, signal TEXT, value REAL, unit TEXT)")
        connection.executemany("INSERT INTO log VALUES (?, ?, ?, ?)", rows)
    connection.close()


def write_historian(path: Path, truth: Trip) -> None:
    """A table of tags, and one of values by the number of their tag."""
    numbers = {name: number for number, name in enumerate(truth.channels, start=7)}
    rows = [
        (numbers[name], int(ns), float(value))
        for name in truth.channels for ns, value in zip(*truth.of(name), strict=True)
    ]  # fmt: skip
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE tags (id INTEGER, tagname TEXT, unit TEXT)")
        connection.executemany("INSERT INTO tags VALUES (?, ?, ?)", [(numbers[n], *NAMES[n]) for n in numbers])
        connection.execute("CREATE TABLE samples (tag_id INTEGER, t_stamp INTEGER, value REAL)")
        connection.executemany("INSERT INTO samples VALUES (?, ?, ?)", rows)
    connection.close()


def write_parquet_dataset(path: Path, truth: Trip) -> None:
    """A folder for each topic, partitioned by half of the trip."""
    for topic, ns in truth.ns.items():
        times = pd.DatetimeIndex(ns.view("datetime64[ns]"), tz="UTC")
        frame = pd.DataFrame({"time": times, **with_units(truth, topic)})
        for half, rows in (("1", slice(None, 100)), ("2", slice(100, None))):
            (path / topic / f"half={half}").mkdir(parents=True)
            frame[rows].to_parquet(path / topic / f"half={half}" / "part-0.parquet")


def write_parquet_folder(path: Path, truth: Trip) -> None:
    """A file for each topic."""
    path.mkdir()
    for topic, ns in truth.ns.items():
        times = pd.DatetimeIndex(ns.view("datetime64[ns]"), tz="UTC")
        frame = pd.DataFrame({"time": times, **with_units(truth, topic)})
        frame.to_parquet(path / f"{topic}.parquet")


def ros_messages(
    truth: Trip, types: dict[str, Any], *, is_first: bool, ned: bool = False
) -> Iterator[tuple[Any, ...]]:
    """The messages of the trip in the types of ROS: topic, type, time of the log [ns], message.

    In the axes of ROS, or with ``ned`` in those that the names of the frames then state.
    """
    turn = -1.0 if not ned else 1.0
    body = "base_link_frd" if ned else "base_link"

    def header(ns: int, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
        return types["std_msgs/msg/Header"](*([0] if is_first else []), stamp=stamp, frame_id=frame)

    vector, zeros = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    for index, ns in enumerate(truth.ns["gps"].tolist()):
        status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        latitude, longitude = (float(truth.channels[name][1][index]) for name in ("latitude_deg", "longitude_deg"))
        yield "/gnss/fix", "sensor_msgs/msg/NavSatFix", ns + 3_000_000, types["sensor_msgs/msg/NavSatFix"](
            header(ns, "antenna"), status, latitude, longitude, 0.0, zeros, 0)  # fmt: skip
    for index, ns in enumerate(truth.ns["gyro"].tolist()):
        heading, rate = (np.deg2rad(truth.channels[name][1][index]) for name in ("heading_deg", "yaw_rate_dps"))
        yaw = heading if ned else 0.5 * np.pi - heading
        turned = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, float(np.sin(yaw / 2.0)), float(np.cos(yaw / 2.0)))
        imu = types["sensor_msgs/msg/Imu"](
            header(ns, body if ned else "imu_link"), turned, zeros, vector(0.0, 0.0, float(turn * rate)), zeros,
            vector(0.0, 0.0, 9.8), zeros)  # fmt: skip
        yield "/imu/data", "sensor_msgs/msg/Imu", ns + 4_000_000, imu
    for index, ns in enumerate(truth.ns["log"].tolist()):
        surge, sway = (float(truth.channels[name][1][index]) for name in ("surge_mps", "sway_mps"))
        twist = types["geometry_msgs/msg/Twist"](vector(surge, turn * sway, 0.0), vector(0.0, 0.0, 0.0))
        stamped = types["geometry_msgs/msg/TwistStamped"](header(ns, body), twist)
        yield "/dvl/twist", "geometry_msgs/msg/TwistStamped", ns + 2_000_000, stamped
    for topic, of, name in (("/propeller/rpm", "engine", "propeller_rpm"),
                            ("/rudder/angle_deg", "steering", "rudder_angle_deg")):  # fmt: skip
        for index, ns in enumerate(truth.ns[of].tolist()):
            value = float(truth.channels[name][1][index])
            yield topic, "std_msgs/msg/Float64", ns, types["std_msgs/msg/Float64"](value)


def write_bag(path: Path, truth: Trip, *, storage: str, ned: bool = False) -> None:
    """A bag of ROS 1 (``storage`` "bag"), or of ROS 2 by "mcap" or "db3"."""
    from rosbags.rosbag1 import Writer as FirstWriter
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    is_first = storage == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    plugin = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}.get(storage)
    encode: Callable[..., Any] = store.serialize_ros1 if is_first else store.serialize_cdr
    messages = sorted(ros_messages(truth, store.types, is_first=is_first, ned=ned), key=lambda entry: entry[2])
    writer: Any = FirstWriter(path) if is_first else Writer(path, version=9, storage_plugin=plugin)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, log_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], log_ns, encode(message, kind))
        writer.add_connection("/empty", "std_msgs/msg/Float64", typestore=store)


def write_odometry(path: Path, *, ned: bool, faster_turns: float = 1.0) -> dict[str, np.ndarray]:
    """A bag of odometry and two propellers, in frames that do not say their axes, and the truth; ``faster_turns``
    is -1 where the propellers' names are exchanged."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, t = get_typestore(Stores.ROS2_HUMBLE), 0.5 * np.arange(400)
    rate = np.deg2rad(6.0 * np.sin(t / 9.0))
    psi = 0.5 + np.cumsum(rate) * 0.5
    sway = -0.1 * np.sin(t / 9.0)
    north, east = (np.cumsum(1.5 * part + sway * across) * 0.5 for part, across in (
        (np.cos(psi), -np.sin(psi)), (np.sin(psi), np.cos(psi))))  # fmt: skip
    difference = faster_turns * 100.0 * np.sin(t / 9.0)
    make, turn = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}, 1.0 if ned else -1.0
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        kinds = {"/odometry": "nav_msgs/msg/Odometry"} | dict.fromkeys(
            ("/propeller/port/rpm", "/propeller/starboard/rpm"), "std_msgs/msg/Float64")  # fmt: skip
        topics = {name: bag.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for n, ns in enumerate((START_NS + 5 * 10**8 * np.arange(t.size)).tolist()):
            yaw = psi[n] if ned else 0.5 * np.pi - psi[n]
            place = (north[n], east[n]) if ned else (east[n], north[n])
            turned = make["Quaternion"](0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
            pose, vector = make["Pose"](make["Point"](*place, 0.0), turned), make["Vector3"]
            twist = make["Twist"](vector(1.5, turn * sway[n], 0.0), vector(0.0, 0.0, turn * rate[n]))
            header = make["Header"](make["Time"](ns // 10**9, ns % 10**9), "odom")
            odometry = make["Odometry"](header, "base_link", make["PoseWithCovariance"](pose, np.zeros(36)),
                                        make["TwistWithCovariance"](twist, np.zeros(36)))  # fmt: skip
            shafts = make["Float64"](800.0 + difference[n]), make["Float64"](800.0 - difference[n])
            for name, message in zip(topics, (odometry, *shafts), strict=True):
                bag.write(topics[name], ns, store.serialize_cdr(message, kinds[name]))
    return {"north_m": north, "east_m": east, "heading_deg": np.rad2deg(psi) % 360.0, "sway_mps": sway,
            "yaw_rate_dps": np.rad2deg(rate)}  # fmt: skip


def write_json_mcap(path: Path, truth: Trip, chunk_bytes: int = 1_000_000) -> None:
    """An MCAP file of another program, with JSON messages."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_bytes)
        writer.start(library="another logger")
        for topic, stamps in truth.ns.items():
            schema = writer.register_schema(f"ship.{topic}", "jsonschema", b'{"type": "object"}')
            channel = writer.register_channel(f"/{topic}", "json", schema)
            for index, ns in enumerate(stamps.tolist()):
                values = {NAMES[name][0]: float(column[index]) for name, column in table_of(truth, topic).items()}
                body = {"timestamp": {"sec": ns // 10**9, "nsec": ns % 10**9}, **values}
                writer.add_message(channel, ns + 1_000_000, json.dumps(body).encode(), ns + 1_000_000)
        writer.finish()


def write_protobuf_mcap(path: Path, truth: Trip, *, late_ns: int = 0) -> None:
    """An MCAP file of another program, with protobuf messages; those that are logged late state their time [us]."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap_protobuf.writer import Writer

    file = descriptor_pb2.FileDescriptorProto(name="ship.proto", package="ship", syntax="proto3")
    for topic in truth.ns:
        entry = file.message_type.add(name=topic.capitalize())
        for number, name in enumerate(table_of(truth, topic), start=1):
            entry.field.add(name=name, number=number, type=1, label=1)
        entry.field.add(name="utime", number=9, type=4, label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    with path.open("wb") as stream, Writer(stream) as writer:
        for topic, stamps in truth.ns.items():
            kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"ship.{topic.capitalize()}"))
            for index, ns in enumerate(stamps.tolist()):
                message = kind(**{name: float(column[index]) for name, column in table_of(truth, topic).items()})
                message.utime = ns // 1000 if late_ns else 0
                writer.write_message(f"/{topic}", message, log_time=ns + late_ns, publish_time=ns + late_ns)


_ULOG_TOPICS = {
    "sensor_gps": ("gps", "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
                          "uint8_t fix_type;", "<QQddB"),
    "vehicle_attitude": ("gyro", "uint64_t timestamp;float[4] q;", "<Q4f"),
    "vehicle_angular_velocity": ("gyro", "uint64_t timestamp;float[3] xyz;", "<Q3f"),
    "vehicle_local_position": ("log", "uint64_t timestamp;float vx;float vy;", "<Q2f"),
}  # fmt: skip


def write_ulog(path: Path, truth: Trip) -> None:
    """A log of PX4, by its specification: there is no library that writes it. Times count from the start, in us."""
    boot_us, origin_ns = 20_000_000, int(truth.ns["gps"][0])

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    def since_boot(ns: int) -> int:
        return (ns - origin_ns) // 1000 + boot_us

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", boot_us), message("B", bytes(40))]
    parts += [message("F", f"{name}:{fields}".encode()) for name, (_, fields, _) in _ULOG_TOPICS.items()]
    parts += [
        message("A", struct.pack("<BH", 0, number) + name.encode()) for number, name in enumerate(_ULOG_TOPICS)
    ]
    rows: list[tuple[int, bytes]] = []
    for number, (name, (topic, _, form)) in enumerate(_ULOG_TOPICS.items()):
        for index, ns in enumerate(truth.ns[topic].tolist()):
            heading = np.deg2rad(
                np.interp(ns, truth.ns["gyro"], np.unwrap(truth.channels["heading_deg"][1], period=360))
            )
            surge, sway = (
                truth.channels[key][1][min(index, len(truth.ns["log"]) - 1)] for key in ("surge_mps", "sway_mps")
            )
            place = [truth.channels[key][1][index] for key in ("latitude_deg", "longitude_deg")]
            values: tuple[Any, ...] = {
                "sensor_gps": (ns // 1000, *place, 3),
                "vehicle_attitude": (np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)),
                "vehicle_angular_velocity": (0.0, 0.0, np.deg2rad(truth.channels["yaw_rate_dps"][1][index])),
                "vehicle_local_position": (surge * np.cos(heading) - sway * np.sin(heading),
                                           surge * np.sin(heading) + sway * np.cos(heading)),
            }[name]  # fmt: skip
            rows.append((ns, message("D", struct.pack("<H", number) + struct.pack(form, since_boot(ns), *values))))
    path.write_bytes(b"".join(parts) + b"".join(row for _, row in sorted(rows, key=lambda row: row[0])))


_DATAFLASH = {
    "GPS": (1, "QBHILLf", "TimeUS,Status,GWk,GMS,Lat,Lng,Spd", "gps"),
    "ATT": (2, "Qf", "TimeUS,Yaw", "gyro"),
    "IMU": (3, "Qf", "TimeUS,GyrZ", "gyro"),
    "XKF1": (4, "Qff", "TimeUS,VN,VE", "log"),
}


def write_dataflash_text(path: Path, truth: Trip) -> None:
    """The binary log as ground stations turn it into text, by the library that reads it."""
    from pymavlink.DFReader import DFReader_binary

    binary = path.with_suffix(".bin")
    write_dataflash(binary, truth)
    reader, lines = DFReader_binary(str(binary)), list[str]()
    while (message := reader.recv_msg()) is not None:
        cells = [f"{value:.7f}" if name in ("Lat", "Lng") else value.decode() if isinstance(value, bytes) else value
                 for name in message.fmt.columns for value in [getattr(message, name)]]  # fmt: skip
        lines.append(", ".join(map(str, [message.get_type(), *cells])))
    reader.close()
    path.write_text("\n".join(lines) + "\n")


def write_dataflash(path: Path, truth: Trip, parameters: dict[str, float] | None = None) -> None:
    """A log of ArduPilot, by its specification. Times count from the start, in us; positions are of 1e-7 deg.

    With ``parameters`` it has them, and outputs: 1 the rudder's angle by 30 deg, 3 the shaft's speed by 1000 rpm.
    """
    head = b"\xa3\x95"
    form = {"Q": "Q", "B": "B", "H": "H", "I": "I", "L": "i", "f": "f", "N": "16s"}
    parts = [head + struct.pack("<BBB4s16s64s", 128, 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")]
    rows: list[tuple[int, bytes]] = []
    gps_epoch_ns = int(datetime(1980, 1, 6, tzinfo=UTC).timestamp()) * 10**9
    outputs = {"PARM": (5, "QNf", "TimeUS,Name,Value", ""), "RCOU": (6, "QHH", "TimeUS,C1,C3", "steering")}
    for name, (number, letters, columns, topic) in (_DATAFLASH | (outputs if parameters else {})).items():
        layout = "<" + "".join(form[letter] for letter in letters)
        length = 3 + struct.calcsize(layout)
        parts.append(
            head
            + struct.pack("<BBB4s16s64s", 128, number, length, name.encode(), letters.encode(), columns.encode())
        )
        if name == "PARM":
            for key, value in (parameters or {}).items():
                parts.append(head + struct.pack("<B", number) + struct.pack(layout, 0, key.encode(), value))
            continue
        for index, ns in enumerate(truth.ns[topic].tolist()):
            gps_ms = (ns + LEAP_S * 10**9 - gps_epoch_ns) // 10**6
            week_ms = 604_800_000
            heading = np.interp(ns, truth.ns["gyro"], np.unwrap(truth.channels["heading_deg"][1], period=360))
            psi, at = np.deg2rad(heading), min(index, len(truth.ns["log"]) - 1)
            surge, sway = (truth.channels[key][1][at] for key in ("surge_mps", "sway_mps"))
            place = [round(1e7 * truth.channels[key][1][index]) for key in ("latitude_deg", "longitude_deg")]
            values: tuple[Any, ...] = {
                "GPS": (3, gps_ms // week_ms, gps_ms % week_ms, *place, surge),
                "ATT": (heading % 360.0,),
                "IMU": (np.deg2rad(truth.channels["yaw_rate_dps"][1][index]),),
                "XKF1": (surge * np.cos(psi) - sway * np.sin(psi), surge * np.sin(psi) + sway * np.cos(psi)),
                "RCOU": (
                    round(1500 + 400 * truth.channels["rudder_angle_deg"][1][index] / 30.0),
                    round(1500 + 400 * truth.channels["propeller_rpm"][1][index] / 1000.0),
                ),
            }[name]  # fmt: skip
            time_us = (ns - int(truth.ns["gps"][0])) // 1000 + 20_000_000
            rows.append((ns, head + struct.pack("<B", number) + struct.pack(layout, time_us, *values)))
    path.write_bytes(b"".join(parts) + b"".join(row for _, row in sorted(rows, key=lambda row: row[0])))
