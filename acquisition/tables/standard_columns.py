"""Heading, speeds and rates under standard names held against their track, as those of other tables are.

A standard name states unit and sense, but not that the column keeps to it. What is clear is converted as a map
would convert it, and reported; what is not is an error that states the question.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.channels import BY_NAME
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.tables.channel_columns import read_motion
from seatrial.acquisition.tables.column_map import Column, ColumnMap, Velocity, apply_column_map
from seatrial.acquisition.tables.derived_columns import seconds_of
from seatrial.acquisition.tables.draft import Draft, check_keys, with_answers
from seatrial.acquisition.tables.evidence import grid_of
from seatrial.acquisition.tables.table_context import Known
from seatrial.acquisition.tables.table_files import RawTable, TableFile
from seatrial.acquisition.tables.time_columns import TimeColumn


def judge_columns(file: TableFile, raw: RawTable, time: TimeColumn, answers: Mapping[str, str]) -> None:
    """Convert the columns of motion whose track shows another unit, sense or axes than their names state.

    ``raw`` are the rows of ``file`` before any conversion, ``time`` their time column, ``answers`` those that are
    not about times. Raises :class:`InputError` with a question that the track leaves open, and
    :class:`ConfigurationError` for an answer to none.
    """
    names = [name for name in map(str, file.table) if name in BY_NAME and raw.columns[name].notna().any()]
    draft = Draft(replace(raw, columns=raw.columns[names]), answers)
    check_keys(answers, names)
    draft.candidates = with_answers(draft)
    seconds = seconds_of(pd.DatetimeIndex(file.table.index))
    context = Known(draft, seconds, grid_of(seconds))
    read_motion(context)
    if unused := [key for key in answers if key not in draft.used]:
        raise ConfigurationError(
            f"the answer {', '.join(unused)} is to no question of this table", fix="name a column map"
        )
    if (question := next((entry for entry in draft.questions if entry.default is None), None)) is not None:
        raise InputError(str(question), where=str(raw.path))
    file.remarks = (*file.remarks, *draft.warnings)
    _convert(file, raw, time, context)


def _convert(file: TableFile, raw: RawTable, time: TimeColumn, context: Known) -> None:
    """Put the channels that are not as their names state into the table, as a map of them would."""
    velocity = context.draft.tree.get("velocity")
    channels = {name: entry for name, entry in context.channels.items() if _is_changed(name, entry)}
    if not channels and not velocity:
        return
    if velocity:
        channels |= {"heading_deg": context.channels["heading_deg"]}
    columns = ColumnMap(
        time=time,
        channels={name: Column(**entry) for name, entry in channels.items()},
        velocity=None if velocity is None else Velocity(**velocity),
    )
    converted = apply_column_map(raw, columns, raw.path)
    for name in map(str, converted.table):
        file.table[name] = np.asarray(converted.table[name])
        file.sources[name] = converted.sources[name]


def _is_changed(name: str, entry: Mapping[str, Any]) -> bool:
    return entry["unit"] != BY_NAME[name].unit or bool({"scale", "offset"} & set(entry))
