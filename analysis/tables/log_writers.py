"""A table as a log of other tools: a bag of ROS 2, or a measurement by ASAM MDF. `seatrial import` reads both back.

Neither has a row for all channels: each message, and each group of channels, has the times of its own samples.

The bag has the axes of ROS (REP 103, REP 105): x ahead, y to port, z up, yaw counter-clockwise from east.

- ``/fix`` (NavSatFix): latitude and longitude, or those of north and east by the trial's origin;
- ``/imu`` (Imu): the heading, with roll and pitch where all of its samples have them; what is not measured has a
  variance of 1e6 (robot_localization's convention for what is not to be used), or -1 as the message's type says;
- ``/imu/rate`` (Imu): the yaw rate; ``/velocity`` (TwistStamped): surge and sway, not a number where not measured;
- north and east, and every other channel, under its name (Float64), in its unit;
- ``/seatrial`` (String): units, trial and provenance as JSON, by which the import knows its own again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pymap3d import ned2geodetic

from seatrial.acquisition.core import errors, files
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.trial import software_version
from seatrial.acquisition.tables import log_frames, log_readers
from seatrial.analysis.tables.table import NANO, times_ns

_MICRO_NS = 1000
_BODY = "base_link"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NAVSAT, _IMU, _TWIST, _NUMBER = (
    "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Imu", "geometry_msgs/msg/TwistStamped", "std_msgs/msg/Float64",
)  # fmt: skip
_TILT, _PLACE = ("roll_deg", "pitch_deg"), ("latitude_deg", "longitude_deg")
_NO_FIX_TYPE = 0


class _Samples(NamedTuple):
    """The rows of a table [n] in which a value is known: their times [n, ns], and their values by channel [n]."""

    time_ns: Ints
    columns: dict[str, Floats]


def _samples_of(table: pd.DataFrame, *names: str, among: Sequence[str] = ()) -> _Samples:
    """The samples of channels, at the rows in which one ``among`` them (by default any) is known; NaN elsewhere."""
    columns = {name: table[name].to_numpy(dtype=float) for name in names if name in table.columns}
    rows = np.zeros(len(table), dtype=bool)
    for name in set(among or names) & set(columns):
        rows |= np.isfinite(columns[name])
    return _Samples(times_ns(table)[rows], {name: values[rows] for name, values in columns.items()})


def _import_description(table: pd.DataFrame, about: Mapping[str, Any]) -> str:
    """What the import needs to know its own again."""
    return json.dumps({"columns": list(map(str, table.columns)), **about})


def write_bag(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """A bag of ROS 2 in one file (SQLite), with units, trial and provenance in its metadata.

    Raises :class:`ConfigurationError` without rosbags, :class:`DataShortageError` for a table without a value.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        fix = "pip install 'seatrial[ros]'"
        raise errors.ConfigurationError("a bag of ROS needs the package rosbags", fix=fix) from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    topics = [topic for topic in _topics_of_table(table, BagMessages(store.types)) if topic[2].size]
    if not topics:
        raise errors.DataShortageError("holds no value", where=about["recording"])
    text = store.types["std_msgs/msg/String"](data=_import_description(table, about))
    topics.insert(0, (log_readers.ABOUT_TOPIC, "std_msgs/msg/String", times_ns(table)[:1], iter([text])))
    with files.atomic_file(path) as partial, TemporaryDirectory(prefix="seatrial-") as scratch:
        folder = Path(scratch) / path.stem
        with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
            for name, kind, times, messages in topics:
                connection = bag.add_connection(name, kind, typestore=store)
                for time_ns, message in zip(times.tolist(), messages, strict=True):
                    bag.write(connection, time_ns, store.serialize_cdr(message, kind))
        shutil.copyfile(next(folder.glob("*.db3")), partial)
    return [path]


class BagMessages:
    """Messages of ROS 2 in its axes, by the ``types`` of a store."""

    def __init__(self, types: Mapping[str, Any]) -> None:
        self._types = types
        self._zero = self._vector()

    def _vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return self._types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    def _header(self, time_ns: int) -> Any:
        stamp = self._types["builtin_interfaces/msg/Time"](sec=time_ns // NANO, nanosec=time_ns % NANO)
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id=_BODY)

    def fix(self, time_ns: int, latitude_deg: float, longitude_deg: float) -> Any:
        """A position; how good it is, is not known."""
        status = self._types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        return self._types[_NAVSAT](
            header=self._header(time_ns), status=status, latitude=latitude_deg, longitude=longitude_deg,
            altitude=float("nan"), position_covariance=np.zeros(9), position_covariance_type=_NO_FIX_TYPE,
        )  # fmt: skip

    def attitude(self, time_ns: int, heading_deg: float, *tilt_deg: float) -> Any:
        """The heading, and roll and pitch if they are given."""
        yaw, (roll, pitch) = np.deg2rad(90.0 - heading_deg), np.deg2rad(tilt_deg or (0.0, 0.0)) / 2.0
        half = yaw / 2.0
        pitch = -pitch  # bow up turns y, which is to port, the other way
        sr, cr, sp, cp, sy, cy = (part(angle) for angle in (roll, pitch, half) for part in (np.sin, np.cos))
        orientation = self._types["geometry_msgs/msg/Quaternion"](
            x=sr * cp * cy - cr * sp * sy, y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy, w=cr * cp * cy + sr * sp * sy,
        )  # fmt: skip
        covariance = np.zeros(9)
        covariance[[0, 4]] = 0.0 if tilt_deg else log_frames.UNUSED_VARIANCE
        return self._imu(time_ns, orientation, covariance, self._zero, _not_measured())

    def yaw_rate(self, time_ns: int, yaw_rate_dps: float) -> Any:
        """The yaw rate alone."""
        orientation = self._types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=0.0)
        covariance = np.zeros(9)
        covariance[[0, 4]] = log_frames.UNUSED_VARIANCE
        turning = self._vector(z=-np.deg2rad(yaw_rate_dps))
        return self._imu(time_ns, orientation, _not_measured(), turning, covariance)

    def _imu(self, time_ns: int, orientation: Any, covariance: Floats, rate: Any, rate_covariance: Floats) -> Any:
        return self._types[_IMU](
            header=self._header(time_ns), orientation=orientation, orientation_covariance=covariance,
            angular_velocity=rate, angular_velocity_covariance=rate_covariance,
            linear_acceleration=self._zero, linear_acceleration_covariance=_not_measured(),
        )  # fmt: skip

    def velocity(self, time_ns: int, surge_mps: float, sway_mps: float) -> Any:
        """Surge and sway; what is not measured is not a number."""
        nan = float("nan")
        twist = self._types["geometry_msgs/msg/Twist"](
            linear=self._vector(surge_mps, -sway_mps, nan), angular=self._vector(nan, nan, nan)
        )
        return self._types[_TWIST](header=self._header(time_ns), twist=twist)

    def number(self, _time_ns: int, value: float) -> Any:
        """A value, which has no stamp of its own."""
        return self._types[_NUMBER](data=value)


def _not_measured() -> Floats:
    covariance = np.zeros(9)
    covariance[0] = -1.0
    return covariance


def _topics_of_table(table: pd.DataFrame, messages: BagMessages) -> Iterator[tuple[str, str, Ints, Iterator[Any]]]:
    """Each topic of a table: its name, its type, the times, and the messages."""

    def made(make: Callable[..., Any], samples: _Samples, *names: str) -> Iterator[Any]:
        return map(make, samples.time_ns.tolist(), *(samples.columns[name].tolist() for name in names))

    fixes, used = _positions_of_table(table), {"heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps"}
    if fixes is not None:
        used |= {*_PLACE}
        yield "/fix", _NAVSAT, fixes.time_ns, made(messages.fix, fixes, *_PLACE)
    heading = _samples_of(table, "heading_deg", *_TILT, among=("heading_deg",))
    has_tilt = all(np.isfinite(heading.columns.get(name, np.array([np.nan]))).all() for name in _TILT)
    tilt = _TILT if has_tilt else ()
    if heading.columns.get("heading_deg") is not None:
        used |= set(tilt)
        yield "/imu", _IMU, heading.time_ns, made(messages.attitude, heading, "heading_deg", *tilt)
    rate = _samples_of(table, "yaw_rate_dps")
    yield "/imu/rate", _IMU, rate.time_ns, made(messages.yaw_rate, rate, *rate.columns)
    velocity = _samples_of(table, "surge_mps", "sway_mps")
    missing = np.full(velocity.time_ns.size, np.nan)
    parts = {name: velocity.columns.get(name, missing) for name in ("surge_mps", "sway_mps")}
    yield "/velocity", _TWIST, velocity.time_ns, made(messages.velocity, velocity._replace(columns=parts), *parts)
    for name in map(str, table.columns):
        if name not in used:
            samples = _samples_of(table, name)
            yield f"/{name}", _NUMBER, samples.time_ns, made(messages.number, samples, name)


def _positions_of_table(table: pd.DataFrame) -> _Samples | None:
    """Latitudes and longitudes [deg]: as they are, or of north and east by the trial's origin; None without."""
    trial = table.attrs.get("trial", {})
    origin = trial.get("origin_latitude_deg"), trial.get("origin_longitude_deg")
    names = _PLACE if set(_PLACE) <= set(table.columns) else ("north_m", "east_m")
    if not set(names) <= set(table.columns) or (names != _PLACE and None in origin):
        return None
    rows = table[table[list(names)].notna().all(axis=1)]
    samples = _samples_of(rows, *names)
    if names == _PLACE:
        return samples
    latitude, longitude, _ = ned2geodetic(*samples.columns.values(), 0.0, *origin, 0.0)
    return samples._replace(columns=dict(zip(_PLACE, (latitude, longitude), strict=True)))


def write_mdf(table: pd.DataFrame, path: Path, about: Mapping[str, Any]) -> list[Path]:
    """A measurement by ASAM MDF 4.1: a group of channels for each set of times, with units, from the first time on.

    Its start is in UTC, in whole microseconds; times since then are exact to the ns over 31 days. Units, trial and
    provenance are JSON in the comment of the file. Raises :class:`ConfigurationError` without asammdf,
    :class:`DataShortageError` for a table without a value.
    """
    try:
        from asammdf import MDF, Signal
        from asammdf.blocks.v4_blocks import FileHistory
    except ImportError as error:
        fix = "pip install 'seatrial[mf4]'"
        raise errors.ConfigurationError("a measurement by ASAM MDF needs the package asammdf", fix=fix) from error
    groups: dict[bytes, list[str]] = {}
    for name in map(str, table.columns):
        rows = np.isfinite(table[name].to_numpy(dtype=float))
        if rows.any():
            groups.setdefault(rows.tobytes(), []).append(name)
    if not groups:
        raise errors.DataShortageError("holds no value", where=about["recording"])
    time_ns = times_ns(table)
    start_ns = int(time_ns.min()) // _MICRO_NS * _MICRO_NS
    with (
        files.atomic_file(path) as partial,
        TemporaryDirectory(prefix="seatrial-") as scratch,
        MDF(version="4.10") as mdf,
    ):
        mdf.header.start_time = _EPOCH + timedelta(microseconds=start_ns // _MICRO_NS)
        mdf.header.description = _import_description(table, about)
        history = FileHistory()
        history.time_stamp = mdf.header.start_time  # the time of day has no place in a product
        history.comment = f"<FHcomment><TX>exported</TX><tool_id>{software_version()}</tool_id></FHcomment>"
        mdf.file_history.append(history)
        for names in groups.values():
            samples = _samples_of(table, *names)
            seconds = (samples.time_ns - start_ns) / NANO
            signals = [
                Signal(values, seconds, unit=about["units"].get(name, ""), name=name)
                for name, values in samples.columns.items()
            ]
            mdf.append(signals, acq_name=names[0] if len(names) == 1 else "", comment="", common_timebase=True)
        written = mdf.save(Path(scratch) / f"{path.stem}.mf4", compression=2, add_history_block=False)
        shutil.copyfile(written, partial)
    return [path]
