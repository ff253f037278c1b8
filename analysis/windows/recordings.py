"""Held windows of recordings with their start states, and as files.

A prediction starts from a state that cannot be measured without noise. Here it is the Kalman smoother's, with
its covariance, from the samples at their own times (:mod:`seatrial.analysis.estimation.smoother`): the motion as
perfect sensors would have measured it, including waves, and also the slow motion without them.

Predictions start not from that slow motion but from the causal state of the model's Kalman filter at second 0,
and, marked two-sided, from :mod:`seatrial.analysis.estimation.local_polynomial`. Of the two that use later data,
judged by constant velocity over 15 s and 30 s, neither is always better: the smoother's is on a docking (1.3 m for
1.45 m rms at 15 s), and in waves it is equal in position and up to 10 % worse in heading; on a recording with
jitter in the times of positions it is much worse (16.9 m for 6.8 m).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path

import pandas as pd

from seatrial.acquisition.core.errors import InputError, printable_name
from seatrial.acquisition.core.files import parse_json, written_together
from seatrial.acquisition.core.ship import BY_NAME, POSE_AND_VELOCITY, from_text
from seatrial.acquisition.recording.grouping import read_parts, whole_recordings
from seatrial.analysis.estimation.smoother import COVARIANCE_NAMES, SmoothedMotion, smooth
from seatrial.analysis.prepare import Preparation, prepare
from seatrial.analysis.tables.files import read_parquet, write_parquet
from seatrial.analysis.tables.resample import MOTION_FILTER, resample, resample_recording
from seatrial.analysis.tables.table import (
    actuator_attributes,
    provenance_of,
    refuse_duplicates,
    select,
    table_actuators,
    trial_channels,
    warn_of_calm,
    with_calm,
)
from seatrial.analysis.windows.held import HeldWindows, columns_for, held_windows, join_windows, require_windows


@dataclass(frozen=True, slots=True)
class SecondBySecond:
    """A recording at 1 Hz: ``table`` with two-sided resampling, ``newest`` with its rows as they were known 0,
    1, ... seconds later.

    A channel recorded more often than once a second is filtered, by samples of the seconds on either side.
    """

    table: pd.DataFrame
    newest: tuple[pd.DataFrame, ...] = ()

    def known(self, seconds: int) -> pd.DataFrame:
        """The rows as they were known this many seconds after each."""
        return self.newest[seconds] if seconds < len(self.newest) else self.table


def second_by_second(resampled: Callable[..., pd.DataFrame]) -> SecondBySecond:
    """Samples at 1 Hz by one of the functions of :mod:`seatrial.analysis.tables.resample`, its samples given.

    Where no wind was recorded, they are of a calm, which is reported.
    """
    newest = (with_calm(resampled(known_steps=seconds)) for seconds in range(MOTION_FILTER.reach))
    table = with_calm(resampled())
    warn_of_calm(table)
    return SecondBySecond(table, tuple(newest))


def tables_of_recordings(
    paths: Sequence[Path],
    progress: Callable[[float], None] = lambda share: None,
    part_percent: tuple[float, float] = (0.0, 100.0),
    *,
    repair: bool = False,
    rebuild_positions: bool = False,
) -> dict[str, SecondBySecond]:
    """Recordings, or a part of each one's time, at 1 Hz, by the trial's name, which is the first file's.

    ``repair`` first corrects faults that a check of the whole recording is certain of, ``rebuild_positions``
    the positions as well (:func:`seatrial.analysis.prepare.prepare`).
    """
    tables = {}
    recordings = named_recordings(paths)
    for number, (trial, parts) in enumerate(recordings.items()):
        recording = read_parts(parts)
        if repair:
            prepared = prepare(recording, Preparation(repair=True), rebuild_positions=rebuild_positions)
            tables[trial] = second_by_second(partial(resample, select(prepared, part_percent)))
        else:
            tables[trial] = second_by_second(partial(resample_recording, recording, part_percent=part_percent))
        progress((number + 1) / len(recordings))
    return tables


def named_recordings(paths: Sequence[Path]) -> dict[str, tuple[Path, ...]]:
    """The recordings in some files, each with its parts, by :func:`names_of_trials` of their first files."""
    recordings = whole_recordings(map(Path, paths))
    return dict(zip(names_of_trials([parts[0] for parts in recordings]), recordings, strict=True))


def windows_of_tables(
    tables: Mapping[str, SecondBySecond], horizon_s: int = 15, stride_s: int = 5, *, keep_moving: bool = False
) -> HeldWindows:
    """The held windows of 1 Hz tables by trial, joined; with ``keep_moving`` all windows that have data.

    Raises :class:`DataShortageError` with the counts by reason when there is none in any of them.
    """
    parts = [
        held_windows(sampled.table, horizon_s, stride_s, trial=trial, keep_moving=keep_moving)
        for trial, sampled in tables.items()
    ]
    return require_windows(join_windows(parts), ", ".join(tables))


def names_of_trials(paths: Sequence[Path]) -> list[str]:
    """The files' names without suffix, numbered where files in different folders are called the same."""
    stems = [printable_name(Path(path).stem) for path in paths]
    alone = {stem for stem in stems if stems.count(stem) == 1}
    names, taken = [], set(alone)
    for stem in stems:
        if stem not in alone:
            stem = next(name for name in (f"{stem}-{number}" for number in count(1)) if name not in taken)
            taken.add(stem)
        names.append(stem)
    return names


SLOW_STATES = tuple(f"slow_{name}" for name in POSE_AND_VELOCITY)
START_COLUMNS = ("window", "trial", "leg", "start", *POSE_AND_VELOCITY, *COVARIANCE_NAMES, *SLOW_STATES)
"""The columns of the starts: states in the units of the channels, covariances in SI with angles in radians."""


@dataclass(frozen=True, slots=True)
class WindowOptions:
    """Options for extracting windows from recordings.

    ``keep_moving`` keeps those in which a thruster moved; ``repair`` and ``remove_delays`` first correct faults
    that a check is certain of, ``rebuild_positions`` the positions as well; ``starts`` adds start states.
    """

    horizon_s: int = 15
    stride_s: int = 5
    keep_moving: bool = False
    repair: bool = False
    remove_delays: bool = False
    starts: bool = True
    rebuild_positions: bool = False


def add_start_states(windows: HeldWindows, motion: Mapping[str, SmoothedMotion]) -> HeldWindows:
    """The windows with ``starts``, from the smoothed motion of each of their trials at whole seconds.

    One row a window in the order of their numbers; NaN where the motion has no estimate.
    """
    first = windows.rows.loc[windows.rows["second"] == 0, ["window", "trial", "leg", "start"]]
    parts = [_starts(first[first["trial"] == trial], smoothed) for trial, smoothed in motion.items()]
    filled = [part for part in parts if len(part)] or parts[:1]
    starts = pd.concat(filled).sort_values("window", ignore_index=True) if filled else None
    return replace(windows, starts=starts)


def _starts(first: pd.DataFrame, motion: SmoothedMotion) -> pd.DataFrame:
    at = pd.DatetimeIndex(first["start"])
    columns = (
        motion.states[list(POSE_AND_VELOCITY)],
        motion.covariance_columns(),
        motion.slow[list(POSE_AND_VELOCITY)].set_axis(list(SLOW_STATES), axis=1),
    )
    values = [frame.reindex(at).reset_index(drop=True) for frame in columns]
    return pd.concat([first.reset_index(drop=True), *values], axis=1)[list(START_COLUMNS)]


def windows_of_recordings(
    paths: Sequence[Path], how: WindowOptions | None = None, progress: Callable[[float], None] = lambda share: None
) -> HeldWindows:
    """The windows of recordings, by the trial's name, which is the file's, with their starts.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them, and
    :class:`InputError` when one recording is given twice.
    """
    options = how or WindowOptions()
    refuse_duplicates(paths)
    pieces, motion, provenance, recordings = [], {}, {}, named_recordings(paths)
    simple = not (options.starts or options.repair or options.remove_delays)
    rate_hz = 1.0 if simple else None
    preparation = Preparation(rate_hz, repair=options.repair, remove_delays=options.remove_delays)
    for number, (trial, parts) in enumerate(recordings.items()):
        table = prepare(read_parts(parts), preparation, rebuild_positions=options.rebuild_positions)
        seconds = with_calm(table if simple else resample(table, 1.0))
        warn_of_calm(seconds)
        pieces.append(
            held_windows(seconds, options.horizon_s, options.stride_s, trial=trial, keep_moving=options.keep_moving)
        )
        provenance[trial] = provenance_of(seconds, asdict(options), parts[0])
        if options.starts and pieces[-1].kept:
            motion[trial] = smooth(table, 1.0)
        progress((number + 1) / len(recordings))
    windows = replace(require_windows(join_windows(pieces), ", ".join(recordings)), provenance=provenance)
    return add_start_states(windows, motion) if options.starts else windows


def write_windows(windows: HeldWindows, path: Path | str) -> None:
    """Write the windows as Parquet, the account of the candidates and their provenance in the file's metadata.

    Their starts, if they have them, go into ``<name>.starts.parquet`` beside. Raises
    :class:`seatrial.acquisition.core.errors.StorageError` when a file cannot be written.
    """
    account = {key: getattr(windows, key) for key in ("candidates", "kept", "dropped", "horizon_s", "stride_s")}
    units = {name: BY_NAME[name].unit for name in trial_channels(windows.rows)} | {"second": "s"}
    provenance = {"provenance": json.dumps(windows.provenance)}
    attributes = actuator_attributes(table_actuators(windows.rows)).get("trial", {})
    states = {f"{kind}{name}": unit for name, unit in units.items() for kind in ("", "slow_")}
    with written_together(Path(path)):
        if windows.starts is not None:
            about = {"covariance": "SI, angles in radians", **provenance}
            write_parquet(windows.starts, starts_path(path), states, about)
        write_parquet(windows.rows, path, units, {"windows": json.dumps(account), **provenance, **attributes})


def starts_path(path: Path | str) -> Path:
    """The path of the start states of windows written to ``path``."""
    return Path(path).with_suffix(".starts.parquet")


def read_windows(path: Path | str) -> HeldWindows:
    """Read what :func:`write_windows` wrote. Raises :class:`InputError` for any other file."""
    rows, metadata = read_parquet(path)
    actuators = from_text(metadata["actuators"]) if "actuators" in metadata else table_actuators(rows)
    columns = columns_for(actuators)
    if "windows" not in metadata or set(columns) - set(rows.columns):
        raise InputError("contains no windows", where=str(path), fix="make one with `seatrial windows`")
    rows.attrs.update(actuator_attributes(actuators))
    names = [*columns, *(["held"] if "held" in rows else [])]
    try:
        account, provenance = (parse_json(metadata.get(name, "{}")) for name in ("windows", "provenance"))
        return HeldWindows(rows[names], **account, starts=_stored_starts(rows, path), provenance=provenance)
    except (ValueError, TypeError) as error:
        raise InputError("was not written by this version", where=str(path), why=str(error),
                         fix="run `seatrial windows` again") from error  # fmt: skip


def _stored_starts(rows: pd.DataFrame, path: Path | str) -> pd.DataFrame | None:
    """The start states stored beside a file of windows, unless they belong to others."""
    if not starts_path(path).is_file():
        return None
    starts, _ = read_parquet(starts_path(path))
    first, keys = rows.loc[rows["second"] == 0], ["window", "trial", "start"]
    same = set(keys) <= set(starts.columns) and len(first) == len(starts)
    return starts if same and all((first[key].to_numpy() == starts[key].to_numpy()).all() for key in keys) else None
