"""A recording as a table: one row a measured time, one column a channel, NaN where a channel has no sample.

Its times are a UTC index named ``time`` in nanoseconds. pandas counts in microseconds unless asked otherwise; the
arithmetic here is done on int64 nanoseconds. A clock that starts in 1970 until it receives a satellite, or a stamp
with a wrong year, would make any regular grid longer than memory holds: such stamps are distinguished by the
silence between them, which no trial contains.

Where a table comes from and what was done to it is carried in its ``attrs`` and written into every product. There
is no time of day and no folder in it, so that the same input gives the same bytes anywhere.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import process, ship
from seatrial.acquisition.core.errors import DataShortageError, InputError, printable_path
from seatrial.acquisition.core.files import open_regular_file, parse_json
from seatrial.acquisition.core.quantities import Floats, Ints, Series
from seatrial.acquisition.core.stores import lasting_copies
from seatrial.acquisition.core.trial import Quality, Trial, software_version
from seatrial.acquisition.recording.reader import Files, Recording, read_as_one_recording

LOG = logging.getLogger("seatrial")
NANO = 1_000_000_000
DAY_NS = 86_400 * NANO
LONGEST_DAYS = 31
"""Of one recording; anyone who claims more had the clock set while recording."""
LARGEST_VALUE = 1e30
"""No channel in any unit has values as large, and the fourth powers of smaller ones are still numbers."""
HISTORY_KEY, LATER_PARTS = "history", "later_parts"
CALM = "no wind was recorded: calm is taken in its place, and what the wind did counts as error of the model"
"""What should be known of a table that :func:`with_calm` has filled."""
_LONGEST_DELAY_S = 3600.0
_KEY = np.dtype([("time", np.int64), ("repeat", np.int64)])

TimedValues = tuple[Ints, Floats]
"""Times [ns since 1970] and the values at them, both [n]."""
Span = tuple[pd.Timestamp, pd.Timestamp]
"""Beginning and end, in UTC."""


def read_table(files: Files) -> pd.DataFrame:
    """The raw samples of all channels joined on their measured time.

    Parameters
    ----------
    files
        A recording, or its parts.

    Returns
    -------
    pandas.DataFrame
        One column a channel, its unit in the name, NaN where a value is flagged bad. The index is UTC in ns, named
        ``time`` and sorted; a time that one channel has twice stands in two rows. ``attrs`` holds the trial's
        metadata and the sources by channel.

    Raises
    ------
    InputError
        For what is no recording, or more than its budget.
    DataShortageError
        For one without channels.

    See Also
    --------
    prepare
        The table at one rate, repaired.

    Examples
    --------
    >>> import seatrial as st
    >>> table = st.read("trial.mcap")
    >>> table.columns[:3].tolist()
    ['north_m', 'east_m', 'heading_deg']
    >>> table.attrs["trial"]["vessel"]
    'gunnerus_short'
    """
    paths = [Path(files)] if isinstance(files, Path | str) else list(map(Path, files))
    return table_of(read_as_one_recording(lasting_copies(paths)))


def table_of(recording: Recording) -> pd.DataFrame:
    """As :func:`read_table`, of a recording that is already read."""
    series = {name: recording.series[name] for name in channels_of(recording)}
    size_bytes = sum(path.stat().st_size for path in recording.paths if path.is_file())
    rows = sum(samples.measured_ns.size for samples in series.values())  # if no two have a time in common
    cell_count = len(series) * rows
    process.RECORDING_CELLS.require_within_budget(cell_count, recording.path, size_bytes)
    table = join_channels({name: (samples.measured_ns, valid_values(samples)) for name, samples in series.items()})
    table.attrs.update(attributes_of(recording))
    return table


def channels_of(recording: Recording) -> list[str]:
    """The channels that a recording holds, in their order. Raises :class:`DataShortageError` if there is none."""
    channels = ship.possible_channels_of_table(recording.series, {"trial": asdict(recording.trial)})
    names = [name for name in channels if name in recording.series]
    if not names:
        raise DataShortageError(
            "holds no channel",
            where=str(recording.path),
            why="it is another program's log" if recording.is_foreign else "",
            fix=(
                f"import it first: `seatrial import {recording.path.name} -o TRIAL.mcap`"
                if recording.is_foreign
                else "check the sources of its configuration"
            ),
        )
    return names


def actuators_in_recording(recording: Recording) -> ship.Actuators:
    """The actuators of the ship that a recording is of, as it states them; else by rule from its channels."""
    return ship.actuators_of_table(recording.series, {"trial": asdict(recording.trial)})


def actuator_attributes(actuators: ship.Actuators) -> dict[str, Any]:
    """The ``attrs`` of a table for its ship's actuators: nothing for the default list."""
    text = ship.actuators_as_text(actuators)
    return {"trial": {"actuators": text}} if text else {}


def trial_of(table: pd.DataFrame) -> Trial:
    """The trial that a table is of, as far as its ``attrs`` state it."""
    attributes = table.attrs.get("trial", {})
    return Trial.from_metadata({**{name: str(value) for name, value in attributes.items() if value is not None},
                                "trial": str(attributes.get("trial", attributes.get("name", "")))})  # fmt: skip


def table_actuators(table: pd.DataFrame) -> ship.Actuators:
    """The actuators of the ship that a table is of, as it states them; else by rule from its columns."""
    return ship.actuators_of_table(table.columns, table.attrs)


def with_order_of_actuators(table: pd.DataFrame, actuators: ship.Actuators) -> pd.DataFrame:
    """The table with its ship's actuators in the order of ``actuators``, if they are the same ones."""
    stated = table_actuators(table)
    if stated == actuators or set(stated) != set(actuators):
        return table
    trial = {**(table.attrs.get("trial") or {}), "actuators": ship.actuators_as_text(actuators, omit_default=False)}
    ordered = table.copy(deep=False)
    ordered.attrs = {**table.attrs, "trial": trial}
    return ordered


def declared_channels(table: pd.DataFrame) -> tuple[ship.Channel, ...]:
    """The channels that the trial of a table declares, of those that it holds."""
    return tuple(channel for channel in ship.declared_channels_of(table.attrs) if channel.name in table)


def trial_channels(table: pd.DataFrame) -> tuple[str, ...]:
    """The channels of the trial that a table is of: motion, wind, and the controls of that ship."""
    return ship.trial_channel_names(table_actuators(table))


def required_channels(table: pd.DataFrame) -> tuple[str, ...]:
    """The channels that a table has to have: motion, wind, and the controls of the ship that its trial names."""
    trial = table.attrs.get("trial") or {}
    ship_is_known = ship.is_ship_known(trial.get("vessel") or "", trial.get("actuators") or "")
    return ship.required_channel_names(table_actuators(table), table.columns, ship_is_known=ship_is_known)


def table_controls(table: pd.DataFrame) -> tuple[str, ...]:
    """The control channels of the ship that a table is of."""
    return ship.control_names(table_actuators(table))


def attributes_of(recording: Recording) -> dict[str, Any]:
    """What a table of a recording carries in its ``attrs``: the trial, the file, the sources by channel.

    A recording that was made of a table has that table's history too; one that cannot be read is left out.
    """
    trial = asdict(recording.trial)
    attributes = {
        "trial": {key: value for key, value in trial.items() if value or key != "channels"},
        "recording": str(recording.path),
        "sources": {name: list(recording.series[name].sources) for name in channels_of(recording)},
    }
    text = recording.metadata.get(HISTORY_KEY, {}).get(HISTORY_KEY, "")
    try:
        history = parse_json(text) if text else []
    except ValueError:
        history = []
    if not (isinstance(history, list) and all(isinstance(step, dict) for step in history)):
        history = []
    later = {LATER_PARTS: list(map(str, recording.later_parts))} if recording.later_parts else {}
    return {**attributes, **later, **({HISTORY_KEY: history} if history else {})}


def valid_values(series: Series) -> Floats:
    """The values of a series, NaN where they are flagged bad or larger than :data:`LARGEST_VALUE`."""
    valid = (series.quality < Quality.BAD) & (np.abs(series.value) < LARGEST_VALUE)
    return np.where(valid, series.value, np.nan)


def count_invalid_values(recording: Recording) -> int:
    """How many values a recording flags bad itself, or cannot hold (:data:`LARGEST_VALUE`); tables of it lack
    them."""
    lacking = (
        np.isfinite(samples.value) & np.isnan(valid_values(samples)) for samples in recording.series.values()
    )
    return sum(int(mask.sum()) for mask in lacking)


def join_channels(channels: Mapping[str, TimedValues]) -> pd.DataFrame:
    """Channels as times [ns] and values in one table, a row for each time; NaN where a channel has no sample.

    The rows are in the order of time; a time that one channel has twice stands in two rows, in its order.
    """
    row_keys = {}
    for name, (time_ns, _) in channels.items():  # a row is a measured time and how often it came before
        order = np.argsort(time_ns, kind="stable")
        times = time_ns[order]
        keys = row_keys[name] = np.empty(times.size, dtype=_KEY)
        keys["time"][order] = times
        keys["repeat"][order] = np.arange(times.size) - np.searchsorted(times, times, side="left")
    rows = np.unique(np.concatenate(list(row_keys.values())))
    columns = {}
    for name, (_, values) in channels.items():
        column = np.full(rows.size, np.nan)
        column[np.searchsorted(rows, row_keys[name])] = values
        columns[name] = column
    return pd.DataFrame(columns, index=index_of(np.ascontiguousarray(rows["time"])))


def remove_delays(table: pd.DataFrame, delays: Mapping[str, float]) -> pd.DataFrame:
    """The raw samples joined again after each channel's delay [s] is subtracted from its times.

    A positive delay means stamped that much too late. Cells that are NaN are no samples here: a row that would
    hold nothing else is not made. The history gains a step. Raises :class:`InputError` for a name that is no
    channel or a delay that is no number.
    """
    moved = move_stamps(
        table,
        {name: -delay_ns for name, delay_ns in delays_in_ns(delays, ship.channels_by_name_of(table.attrs)).items()},
    )
    return add_step(moved, "remove_delays", delays_s={name: float(delay_s) for name, delay_s in delays.items()})


def move_stamps(table: pd.DataFrame, by_ns: Mapping[str, int]) -> pd.DataFrame:
    """The values of a table joined again after the stamps of the named columns are moved [ns]."""
    time_ns, columns = times_ns(table), {}
    for name in map(str, table.columns):
        values = table[name].to_numpy(dtype=float)
        valid = np.isfinite(values)
        columns[name] = time_ns[valid] + by_ns.get(name, 0), values[valid]
    result = join_channels(columns)
    result.attrs.update(table.attrs)
    return result


def delays_in_ns(delays: Mapping[str, float], channels: ship.ChannelsByName = ship.BY_NAME) -> dict[str, int]:
    """Delays by channel [s] in ns, ``channels`` being those known. Raises :class:`InputError` for what is none of
    them or no possible delay."""
    for name, delay_s in delays.items():
        if ship.find_channel(name, channels) is None:
            raise InputError(
                f"a delay of {name} was requested, but there is no such channel", fix="name one of the channels"
            )
        if not abs(delay_s) <= _LONGEST_DELAY_S:
            raise InputError(f"a delay of {delay_s} s of {name} is not possible", fix="give at most an hour")
    return {name: round(delay_s * NANO) for name, delay_s in delays.items()}


def require(table: pd.DataFrame, names: tuple[str, ...] | None = None) -> None:
    """Raise :class:`InputError` naming the channels of ``names``, by default the trial's, that a table lacks."""
    missing = [
        name for name in names or trial_channels(table) if name not in table or not table[name].notna().any()
    ]
    if missing:
        fix = "record the channel, or import with a map that gives it a constant"
        raise InputError(f"has no {', '.join(missing)}", where=str(table.attrs.get("recording", "table")), fix=fix)


def require_actuators(table: pd.DataFrame, actuators: ship.Actuators) -> None:
    """Raise :class:`InputError` where ``actuators``, those of a table that drive or steer, are none."""
    if not actuators:
        stated = trial_of(table).actuators
        raise InputError(
            f"is of a ship that nothing drives or steers ({stated})" if stated else
            "names no ship and has no channel of a propeller, thruster, rudder or waterjet",
            where=str(table.attrs.get("recording", "table")),
            fix="record or import what drives and steers the ship, too: a column map names the columns, and the"
            " import is told the ship",
        )  # fmt: skip


def with_calm(table: pd.DataFrame) -> pd.DataFrame:
    """The table, with a calm (0 m/s) where it has no wind at all, which its history records.

    Models of a ship take the wind as an input; a trial in a basin, or of a ship without an anemometer, has none.
    """
    absent = [name for name in ship.ENVIRONMENT if name not in table or not table[name].notna().any()]
    if not absent:
        return table
    return add_step(table, "calm", channels=absent).assign(**dict.fromkeys(absent, 0.0))


def warn_of_calm(table: pd.DataFrame) -> None:
    """Report, with the recording's name, that :func:`with_calm` has filled a table."""
    if any(step["step"] == "calm" for step in history_of(table)):
        LOG.warning("%s: %s", printable_path(Path(str(table.attrs.get("recording", "table"))).stem), CALM)


def select(table: pd.DataFrame, time_range: tuple[float, float] | str) -> pd.DataFrame:
    """The rows in a part of the table's time, in percent of its span; (0, 100) or ``"0..100"`` is all.

    Parts that meet share no row. Raises :class:`InputError` for a part that is not inside 0 to 100 or is empty.
    """
    times = times_ns(table)
    first_ns, last_ns = bounds_ns([times], percent_of(time_range))
    selected: pd.DataFrame = table[(times >= first_ns) & (times <= last_ns)]
    return selected


def bounds_ns(times: Iterable[Ints], time_range: tuple[float, float]) -> tuple[int, int]:
    """The first and the last time [ns] of a part of the span of all ``times``, in percent; both belong to it.

    Raises :class:`InputError` for a part that is not inside 0 to 100 or is empty.
    """
    _, high = percent_of(time_range)
    ends = [(int(stamps.min()), int(stamps.max())) for stamps in times if stamps.size]
    start = min((first for first, _ in ends), default=0)
    span = max((last for _, last in ends), default=0) - start
    first, last = (start + round(span * share / 100.0) for share in time_range)
    return first, last if high == 100.0 else last - 1


def percent_of(part: tuple[float, float] | str) -> tuple[float, float]:
    """Where a part like ``(0, 70)`` or ``"0..70"`` begins and ends, in percent. Raises :class:`InputError`."""
    try:
        low, high = (float(end) for end in (part.split("..") if isinstance(part, str) else part))
    except ValueError as error:
        raise InputError(f"{part!r} is not a valid part", fix="write it like 0..70") from error
    if 0.0 <= high <= low <= 100.0:
        raise InputError(f"part {low:g}..{high:g} is empty", fix="write it like 0..70")
    if not 0.0 <= low < high <= 100.0:
        raise InputError(f"part {low:g}..{high:g} is not within 0..100", fix="write it like 0..70")
    return low, high


def utc_index(table: pd.DataFrame) -> pd.DatetimeIndex:
    """The table's index in UTC and nanoseconds.

    Raises :class:`InputError` when the index is no time or has no zone.
    """
    index = table.index
    if not isinstance(index, pd.DatetimeIndex):
        raise InputError(f"the table is indexed by {index.dtype}, not by time", fix="give it a UTC DatetimeIndex")
    if index.tz is None:
        raise InputError("the table's times have no zone", fix="localise the index to UTC")
    return index.tz_convert("UTC").as_unit("ns").rename("time")


def times_ns(table: pd.DataFrame) -> Ints:
    """The table's times [ns since 1970], in the order of its rows."""
    return utc_index(table).asi8


def span_of(table: pd.DataFrame) -> Span:
    """The first and the last time of a table."""
    index = utc_index(table)
    return index.min(), index.max()


def seconds_of(table: pd.DataFrame) -> Floats:
    """The table's times [s] after its first row, in the order of its rows."""
    time_ns = times_ns(table)
    return np.asarray((time_ns - time_ns[:1]) / NANO)


def index_of(time_ns: Ints) -> pd.DatetimeIndex:
    """Times [ns since 1970] as the index of a table."""
    return pd.DatetimeIndex(time_ns.astype("datetime64[ns]"), name="time").tz_localize("UTC")


def main_stretch(time_ns: Ints) -> tuple[int, int]:
    """The first and the last time [ns] of the recording proper: of the parts between silences of more than
    :data:`LONGEST_DAYS`, the one with the most samples, or all where it is no longer than that.

    ``time_ns`` may be in any order, and holds one time at least.

    >>> main_stretch(np.array([0, 1, 2, 400 * DAY_NS]))
    (0, 2)
    """
    times, longest_ns = np.sort(time_ns), LONGEST_DAYS * DAY_NS
    proper = times
    if int(times[-1]) - int(times[0]) > longest_ns:
        proper = max(np.split(times, np.flatnonzero(np.diff(times) > longest_ns) + 1), key=len)
    return int(proper[0]), int(proper[-1])


def require_plausible_span(first_ns: int, last_ns: int, times: Iterable[Ints], where: str = "") -> None:
    """Raise :class:`InputError` where a span [ns] is longer than one recording can be, and name the stamps.

    ``times`` of all channels [ns] are only looked at to name them.
    """
    if last_ns - first_ns <= LONGEST_DAYS * DAY_NS:
        return
    all_ns = np.concatenate(list(times))
    first, last = main_stretch(all_ns)
    stray = all_ns[(all_ns < first) | (all_ns > last)]
    days = (last_ns - first_ns) / DAY_NS
    why = (
        f"{stray.size:,} of {all_ns.size:,} are stamped {time_span_text(stray)}"
        if stray.size
        else "its clock was set"
    )
    raise InputError(
        f"its samples span {days:,.0f} days, more than the {LONGEST_DAYS} of one recording", where=where,
        why=why, fix="see `seatrial check`; `check --repair OUT.mcap` removes a few such samples",
    )  # fmt: skip


def time_span_text(time_ns: Ints) -> str:
    """When samples are stamped, as text: one time, or from the first to the last."""
    first, last = (pd.Timestamp(int(stamp_ns), tz="UTC") for stamp_ns in (time_ns.min(), time_ns.max()))
    text = f"{first:%Y-%m-%d %H:%M:%S}"
    return text if first == last else f"{text} to {last:%Y-%m-%d %H:%M:%S}"


def provenance_of(
    table: pd.DataFrame, options: Mapping[str, Any] | None = None, recording: Path | None = None
) -> dict[str, Any]:
    """How a table came about: software, recording with its SHA-256, options, trial, and the history step by step.

    ``recording`` is the file it was read from, where the table's ``attrs`` do not name it. One that is no longer
    there has no hash (None).
    """
    origin = table.attrs.get("recording")
    path = recording or (Path(str(origin)) if origin else None)
    trial = {key: value for key, value in table.attrs.get("trial", {}).items() if value not in (None, "")}
    later = map(Path, table.attrs.get(LATER_PARTS, []))
    return {
        "software_version": software_version(),
        "recording": printable_path(path.name) if path else "",
        "recording_sha256": sha256_of(path, *later) if path else None,
        "options": dict(options or {}),
        "history": history_of(table),
        "trial": trial,
    }


def sha256_of(*paths: Path) -> str | None:
    """The SHA-256 of each file in hexadecimal, commas between them; None where one cannot be read."""
    digests = []
    try:
        for path in paths:
            with open_regular_file(path) as stream:
                digests.append(hashlib.file_digest(stream, "sha256").hexdigest())
    except OSError:
        return None
    return ", ".join(digests)


def add_step(table: pd.DataFrame, step: str, **options: Any) -> pd.DataFrame:
    """``table`` with one more step in its history: its name, the version of Seatrial and the options.

    The data are shared with ``table``; only the history is new.
    """
    result = table.copy(deep=False)
    entry = {"step": step, "version": software_version(), "options": options}
    result.attrs = {**table.attrs, HISTORY_KEY: [*history_of(table), entry]}
    return result


def history_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The steps so far, the oldest first."""
    return list(table.attrs.get(HISTORY_KEY, []))


def hash_distinct_files(paths: Sequence[Path]) -> list[str]:
    """The SHA-256 of each recording, in their order; empty where one cannot be read, which its reader will report.

    Raises :class:`InputError` where two files hold the same.
    """
    first: dict[str, Path] = {}
    hashes = []
    for path in paths:
        digest = sha256_of(path) or ""
        duplicate = first.setdefault(digest, path)
        if digest and duplicate is not path:
            raise InputError(
                "is given twice",
                where=str(path),
                why=f"it is the same recording as {duplicate}",
                fix="give it once",
            )
        hashes.append(digest)
    return hashes
