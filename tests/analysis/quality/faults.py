"""Faults put into sound trials, as sensors, buses and careless exports make them; each returns what is to be found.

A fault takes a table of the 13 channels, evenly spaced, and gives it back spoilt, with the code that a check
should report, the channels it may name and, where it has a size, the true value of the estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from seatrial.acquisition.core.ship import BY_NAME, CIRCULAR, COMMAND, unwrap, wrap_180, wrap_360
from seatrial.analysis.tables.table import NANO, index_of, times_ns

MOTION = {"position": ("north_m", "east_m"), "heading": ("heading_deg",), "speed": ("surge_mps", "sway_mps"),
          "yaw_rate": ("yaw_rate_dps",)}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Spoilt:
    """A table with a fault in it: the code of the finding that is due, and its true size by estimate key."""

    table: pd.DataFrame
    code: str
    channels: tuple[str, ...]
    truth: dict[str, float] = field(default_factory=dict)


Fault = Callable[[pd.DataFrame, np.random.Generator], Spoilt]


def speed_scale(factor: float) -> Fault:
    """Speeds scaled by a wrong knot factor: recorded = ``factor`` times true."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        spoilt = table.assign(**{name: table[name] * factor for name in MOTION["speed"]})
        return Spoilt(spoilt, "speed_scale", MOTION["speed"], {"factor": 1.0 / factor})

    return spoil


def yaw_rate_scale(factor: float) -> Fault:
    """A rate gyro that reads ``factor`` times the true rate."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        spoilt = table.assign(yaw_rate_dps=table["yaw_rate_dps"] * factor)
        return Spoilt(spoilt, "yaw_rate_scale", MOTION["yaw_rate"], {"factor": 1.0 / factor})

    return spoil


def heading_offset(angle_deg: float) -> Fault:
    """A compass that was mounted askew."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        spoilt = table.assign(heading_deg=wrap_360(table["heading_deg"].to_numpy() + angle_deg))
        return Spoilt(spoilt, "heading_offset", MOTION["heading"], {"angle_deg": angle_deg})

    return spoil


def channel_delay(group: str, seconds: float) -> Fault:
    """A group of channels stamped ``seconds`` too late, on the same grid as before."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        at_s = _seconds(table)
        late = {name: _at(table, name, at_s - seconds) for name in MOTION[group]}
        return Spoilt(table.assign(**late), "channel_delay", MOTION[group], {"seconds": seconds})

    return spoil


def position_time_jitter(seconds: float, block_s: float = 0.0) -> Fault:
    """Positions taken at times that differ from their stamps; one error for each block of ``block_s``."""
    return _time_jitter("position", seconds, block_s)


def heading_time_jitter(seconds: float, block_s: float = 0.0) -> Fault:
    """Headings taken at times that differ from their stamps; one error for each block of ``block_s``."""
    return _time_jitter("heading", seconds, block_s)


def _time_jitter(group: str, seconds: float, block_s: float) -> Fault:
    def spoil(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
        at_s = _seconds(table)
        if block_s:
            block = (at_s // block_s).astype(int)
            error_s = generator.normal(0.0, seconds, block.max() + 1)[block]
        else:
            error_s = generator.normal(0.0, seconds, at_s.size)
        moved = {name: _at(table, name, at_s + error_s) for name in MOTION[group]}
        return Spoilt(table.assign(**moved), f"{group}_time_jitter", MOTION[group], {"seconds": seconds})

    return spoil


def heading_wrap_interpolated(from_hz: float) -> Fault:
    """Headings brought from ``from_hz`` onto the table's rows by a straight line between 0 and 360 degrees."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        at_s = _seconds(table)
        coarse_s = np.arange(0.0, at_s[-1] + 1.0 / from_hz, 1.0 / from_hz)
        heading = np.interp(at_s, coarse_s, _at(table, "heading_deg", coarse_s))
        return Spoilt(table.assign(heading_deg=heading), "heading_wrap_interpolated", MOTION["heading"])

    return spoil


def order_interpolated(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
    """Orders that were written down when they changed, joined by straight lines."""
    spoilt = {}
    at_s = _seconds(table)
    for name in COMMAND:
        values = unwrap(table[name].to_numpy()) if name in CIRCULAR else table[name].to_numpy()
        steady = pd.Series(values).rolling(int(3 / at_s[1]) | 1, center=True, min_periods=1).median().to_numpy()
        whole = np.round(steady / 2.0) * 2.0
        knots = np.append(np.flatnonzero(np.abs(np.diff(whole, prepend=np.inf)) > 3.0), whole.size - 1)
        line = np.interp(at_s, at_s[knots], whole[knots])
        spoilt[name] = wrap_180(line) if name in CIRCULAR else line
    moved = tuple(name for name in COMMAND if np.ptp(spoilt[name]) > 3.0)
    return Spoilt(table.assign(**spoilt), "order_interpolated", moved)


def clock_jump(seconds: float) -> Fault:
    """Every stamp after some moment is ``seconds`` later, or earlier, than it should be."""

    def spoil(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
        row = int(len(table) * generator.uniform(0.3, 0.7))
        time_ns = times_ns(table).copy()
        time_ns[row:] += round(seconds * NANO)
        return Spoilt(table.set_axis(index_of(time_ns), axis=0), "clock_jump", (), {"seconds": seconds})

    return spoil


def quantised(name: str, step: float) -> Fault:
    """A channel rounded to multiples of ``step``."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        rounded = np.round(table[name].to_numpy() / step) * step
        values = wrap_360(rounded) if name in CIRCULAR else rounded
        return Spoilt(table.assign(**{name: values}), "quantised", (name,), {"step": step})

    return spoil


def stuck(name: str, seconds: float) -> Fault:
    """A channel that repeats one value for so long, while the ship goes on."""

    def spoil(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
        at_s = _seconds(table)
        start_s = at_s[-1] * generator.uniform(0.3, 0.7)
        held = (at_s >= start_s) & (at_s < start_s + seconds)
        first = table[name].to_numpy()[np.flatnonzero(held)[0]]
        code = "feedback_frozen" if name in COMMAND else "stuck"
        return Spoilt(table.assign(**{name: np.where(held, first, table[name])}), code, (name,))

    return spoil


def spikes(name: str, size: float, count: int = 5) -> Fault:
    """Single samples that are off by ``size``."""

    def spoil(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
        rows = generator.choice(np.arange(20, len(table) - 20, 7), count, replace=False)
        values = table[name].to_numpy().copy()
        values[rows] += size * generator.choice([-1.0, 1.0], count)
        if name in CIRCULAR:
            values = (wrap_180 if BY_NAME[name].low < 0 else wrap_360)(values)
        return Spoilt(table.assign(**{name: values}), "spike", (name,))

    return spoil


def out_of_range(name: str, value: float) -> Fault:
    """A sentinel or an overflow in a few rows."""

    def spoil(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
        values = table[name].to_numpy().copy()
        values[generator.choice(len(table), 4, replace=False)] = value
        return Spoilt(table.assign(**{name: values}), "out_of_range", (name,))

    return spoil


def gap(seconds: float) -> Fault:
    """Nothing at all for so long."""

    def spoil(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
        at_s = _seconds(table)
        start_s = at_s[-1] * generator.uniform(0.3, 0.7)
        return Spoilt(table[(at_s < start_s) | (at_s >= start_s + seconds)], "gap", ())

    return spoil


def duplicates(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
    """Some rows that were written twice."""
    rows = np.sort(np.append(np.arange(len(table)), generator.choice(len(table), 30, replace=False)))
    return Spoilt(table.iloc[rows], "duplicate", ())


def time_backwards(table: pd.DataFrame, generator: np.random.Generator) -> Spoilt:
    """Stretches of rows that arrived after their successors."""
    order = np.arange(len(table))
    for row in generator.choice(np.arange(50, len(table) - 50, 40), 6, replace=False):
        order[row : row + 8] = np.roll(order[row : row + 8], 4)
    return Spoilt(table.iloc[order], "time_backwards", ())


def percent_scaled(full_scale_rpm: float) -> Fault:
    """One shaft in percent of its full speed where the other is in rpm."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        percent = np.clip(table["port_rpm"] / full_scale_rpm * 100.0, -100.0, 100.0)
        return Spoilt(table.assign(port_rpm=percent), "percent_scaled", ("port_rpm",))

    return spoil


def wind_apparent(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
    """The wind past the ship, counted from the bow, taken for the true wind."""
    north, east, heading_rad = _apparent_wind(table)
    from_bow = wrap_360(np.rad2deg(np.arctan2(-east, -north) - heading_rad))
    spoilt = table.assign(wind_direction_deg=from_bow, wind_speed_mps=np.hypot(north, east))
    return Spoilt(spoilt, "wind_apparent", ("wind_direction_deg",))


def wind_direction_offset(angle_deg: float) -> Fault:
    """True wind worked out from a vane that was mounted askew by ``angle_deg``."""

    def spoil(table: pd.DataFrame, _: np.random.Generator) -> Spoilt:
        north, east, _heading = _apparent_wind(table)
        turn = np.deg2rad(angle_deg)
        askew = np.cos(turn) * north - np.sin(turn) * east, np.sin(turn) * north + np.cos(turn) * east
        ship = _ship_velocity(table)
        true = askew[0] + ship[0], askew[1] + ship[1]
        spoilt = table.assign(
            wind_direction_deg=wrap_360(np.rad2deg(np.arctan2(-true[1], -true[0]))), wind_speed_mps=np.hypot(*true)
        )
        return Spoilt(spoilt, "wind_direction_offset", ("wind_direction_deg",), {"angle_deg": angle_deg})

    return spoil


def _ship_velocity(table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    heading = np.deg2rad(table["heading_deg"].to_numpy())
    surge, sway = table["surge_mps"].to_numpy(), table["sway_mps"].to_numpy()
    return surge * np.cos(heading) - sway * np.sin(heading), surge * np.sin(heading) + sway * np.cos(heading)


def _apparent_wind(table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The air's velocity past the ship, north and east, and the heading [rad]."""
    towards = np.deg2rad(table["wind_direction_deg"].to_numpy() + 180.0)
    ship_north, ship_east = _ship_velocity(table)
    speed = table["wind_speed_mps"].to_numpy()
    heading = np.deg2rad(table["heading_deg"].to_numpy())
    return speed * np.cos(towards) - ship_north, speed * np.sin(towards) - ship_east, heading


def _seconds(table: pd.DataFrame) -> np.ndarray:
    time_ns = times_ns(table)
    return np.asarray((time_ns - time_ns[0]) / NANO)


def _at(table: pd.DataFrame, name: str, at_s: np.ndarray) -> np.ndarray:
    """A channel at other times than its own, on the circle where it is one."""
    values = table[name].to_numpy()
    moved = np.interp(at_s, _seconds(table), unwrap(values) if name in CIRCULAR else values)
    return np.asarray(wrap_360(moved) if name in CIRCULAR else moved)
