"""A column map: the TOML file that says what a foreign table's columns are, in which unit and frame."""

from __future__ import annotations

from dataclasses import field
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal
from zoneinfo import available_timezones

from pydantic import AfterValidator, ConfigDict
from pydantic.dataclasses import dataclass

from acquisition.config.sections import ChannelName
from acquisition.config.toml_file import line_of, load_toml, read_text
from acquisition.config.trial_section import RunSheet
from acquisition.core.channels import BY_NAME
from acquisition.core.errors import ConfigurationError
from acquisition.core.units import scale_to

_STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)
PERCENT, DEGREES_AND_MINUTES = "percent", "ddmm"


@dataclass(frozen=True, config=_STRICT)
class Column:
    """One channel's column, or a constant where the table has none.

    ``unit`` is the column's; ``percent`` needs ``full_scale`` in the channel's unit. The channel's value is
    ``scale * column in the channel's unit + offset``; a ``scale`` of -1 turns a sign round.
    """

    column: str | None = None
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    full_scale: float | None = None
    constant: float | None = None


def _known_zone(zone: str) -> str:
    if zone not in available_timezones():
        raise ValueError("is no time zone; write UTC, or a name like Europe/Oslo")
    return zone


def _instant(text: str) -> str:
    try:
        zoned = datetime.fromisoformat(text).tzinfo is not None
    except ValueError as error:
        raise ValueError("is no ISO 8601 time") from error
    if not zoned:
        raise ValueError("has no zone; add Z or an offset like +02:00")
    return text


@dataclass(frozen=True, config=_STRICT)
class TimeColumn:
    """The time column: ISO 8601 (``zone`` where the text has none), or seconds from 1970 or from ``start``."""

    column: str
    format: Literal["iso", "seconds"] = "iso"
    zone: Annotated[str, AfterValidator(_known_zone)] | None = None
    start: Annotated[str, AfterValidator(_instant)] | None = None


def _known_angle_unit(unit: str) -> str:
    if unit not in ("deg", DEGREES_AND_MINUTES):
        raise ValueError(f"is neither deg nor {DEGREES_AND_MINUTES}")
    return unit


@dataclass(frozen=True, config=_STRICT)
class Position:
    """Latitude and longitude columns that ``north_m`` and ``east_m`` are made from."""

    latitude: str
    longitude: str
    unit: Annotated[str, AfterValidator(_known_angle_unit)] = "deg"


@dataclass(frozen=True, config=_STRICT)
class ApparentWind:
    """Wind measured aboard: where it comes from relative to the bow, and its speed past the ship.

    True wind is made of it with the ship's own heading, surge and sway.
    """

    angle: str
    speed: str
    angle_unit: str = "deg"
    speed_unit: str = "m/s"


@dataclass(frozen=True, config=_STRICT)
class ColumnMap:
    """A whole map. ``absent`` names channels that the table has not and that stay away."""

    time: TimeColumn
    channels: dict[ChannelName, Column] = field(default_factory=dict)
    position: Position | None = None
    apparent_wind: ApparentWind | None = None
    trial: RunSheet = field(default_factory=RunSheet)
    absent: tuple[ChannelName, ...] = ()


def load_column_map(path: Path | str) -> ColumnMap:
    """Read and check a map. Raises :class:`ConfigurationError` that names the line."""
    loaded = load_toml(path, ColumnMap)
    text = read_text(path)
    for name, column in loaded.channels.items():
        complaint = _complaint(name, column)
        if complaint:
            line = line_of(text, ["channels", name, "unit"])
            raise ConfigurationError(f"{name}: {complaint}", where=f"{path}, line {line}")
    return loaded


def _complaint(name: str, column: Column) -> str:
    """What is wrong with one channel's entry; empty when nothing is."""
    if (column.column is None) == (column.constant is None):
        return "needs either a column or a constant"
    if column.unit == PERCENT:
        return "" if column.full_scale else "percent needs full_scale, the value at 100 %"
    if column.unit is not None:
        try:
            scale_to(BY_NAME[name].unit, column.unit)
        except ConfigurationError as error:
            return str(error)
    return ""


def factor(name: str, column: Column) -> float:
    """What the column's numbers are multiplied with to be in the channel's unit."""
    house: Any = BY_NAME[name].unit
    if column.unit == PERCENT:
        return column.scale * (column.full_scale or 0.0) / 100.0
    return column.scale * (scale_to(house, column.unit) if column.unit else 1.0)
