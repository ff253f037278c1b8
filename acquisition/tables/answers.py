"""Answers to questions, ``--answer KEY=VALUE``, where a map or standard names leave none: they count for more."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.tables.column_map import Column, ColumnMap
from seatrial.acquisition.tables.column_names import units_called
from seatrial.acquisition.tables.draft import check_answer
from seatrial.acquisition.tables.time_columns import TEXT, TimeColumn, with_zone

_TIME = {"zone": "zone", "start": "start", "day": "day", "date_order": "order", "time_unit": "unit", "year": "year"}
"""The parts of ``[time]`` by the key of the answer."""
TIME_KEYS = frozenset(_TIME)
"""The keys of answers about times."""


def map_as_answered(columns: ColumnMap, answers: Mapping[str, str]) -> ColumnMap:
    """A map with the times, units and full scales as answered.

    Raises :class:`ConfigurationError` for an answer that is none, or to what a map does not leave open.
    """
    of_time = {key: value for key, value in answers.items() if key in _TIME}
    channels = dict(columns.channels)
    for key, value in answers.items():
        kind, _, name = key.partition(".")
        if key in _TIME:
            continue
        check_answer(key, value)
        for channel in _answered_channels(channels, kind, name, key):
            entry = channels[channel]
            unit = next(iter(units_called(value)), value)
            is_scale = kind == "full_scale"
            channels[channel] = replace(entry, full_scale=float(value)) if is_scale else replace(entry, unit=unit)
    answered = copy(columns)  # `replace` would check channels that the map declares without their declarations
    object.__setattr__(answered, "time", time_as_answered(columns.time, of_time))
    object.__setattr__(answered, "channels", channels)
    return answered


def _answered_channels(channels: Mapping[str, Column], kind: str, name: str, key: str) -> list[str]:
    """The channels of a map that an answer is about."""
    if kind == "unit" and name:
        names = [channel for channel, entry in channels.items() if entry.column == name]
    elif kind == "full_scale":
        scaled = [channel for channel, entry in channels.items() if entry.unit == "percent"]
        names = [channel for channel in scaled if not name or channel in (f"{name}_rpm", f"{name}_angle_deg")]
    else:
        names = []
    if not names:
        raise ConfigurationError(f"the answer {key} is to no question of this table", fix="change the map")
    return names


def time_as_answered(time: TimeColumn, answers: Mapping[str, str]) -> TimeColumn:
    """A time column with its zone, start, day, order and unit as answered; the text's own zone is then ignored."""
    for key, value in answers.items():
        if key not in _TIME:
            raise ConfigurationError(f"the answer {key} is to no question of this table", fix="name a column map")
        check_answer(key, value)
        is_counted = time.format == "seconds"
        has_no_use = {
            "zone": is_counted and time.in_name is None and not time.in_head,
            "date_order": time.format != TEXT,
            "year": time.format != TEXT,
            "time_unit": not is_counted,
            "day": time.day is None,
        }
        if has_no_use.get(key, False):
            raise ConfigurationError(
                f"the answer {key}={value} has no use: column {time.column!r} is read as {time.format!r}",
                fix="leave it out, or change `format` under [time] in the map",
            )
        change: dict[str, Any] = {_TIME[key]: int(value) if key == "year" else value}
        time = replace(
            time, **({"start": with_zone(value), "in_name": None, "in_head": False} if key == "start" else change)
        )
    return replace(time, zone_in_text="ignored") if "zone" in answers else time
