"""Where the windows start from: the smoothed motion at second 0 of each, with how sure it is.

A prediction starts from a state that nobody measured without noise. Here it is the Kalman smoother's, with its
covariance, from the raw samples at their own times (:mod:`analysis.estimation.smoother`): the motion as perfect
sensors would have measured it, the swing in waves included, and beside it the ship's own slow motion without
that swing.

Predictions do not start from that slow motion but from :mod:`analysis.estimation.local_polynomial`'s local fit:
held at constant speed over 15 s and 30 s, neither is the better everywhere. The smoother's is on a docking (1.3
m for 1.45 m rms at 15 s), and in waves it is as good in position and up to 10 % worse in heading; on a
recording whose positions jitter in time it is much worse (16.9 m for 6.8 m).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import pandas as pd

from acquisition.core.channels import POSE, VELOCITY
from acquisition.recording.reader import read_recording
from analysis.estimation.smoother import COVARIANCE_NAMES, Smoothed, smooth
from analysis.prepare import Preparation, prepared
from analysis.tables.duplicates import refuse_twins
from analysis.tables.provenance import provenance_of
from analysis.tables.resample import resample
from analysis.windows.held import HeldWindows, held_windows, joined, nothing_held_is_an_error
from analysis.windows.recordings import trial_names

STATES = (*POSE, *VELOCITY)
SLOW = tuple(f"slow_{name}" for name in STATES)
START_COLUMNS = ("window", "trial", "leg", "start", *STATES, *COVARIANCE_NAMES, *SLOW)
"""The columns of the starts: states in the units of the channels, covariances in SI with angles in radians."""


@dataclass(frozen=True, slots=True)
class Cutting:
    """How windows are cut out of recordings.

    ``keep_moving`` keeps those in which a thruster moved; ``repair`` and ``remove_delays`` put right before what
    a check is certain of, ``rebuild_positions`` with the repairs the positions too; ``starts`` adds where they
    start from.
    """

    horizon_s: int = 15
    stride_s: int = 5
    keep_moving: bool = False
    repair: bool = False
    remove_delays: bool = False
    starts: bool = True
    rebuild_positions: bool = False


def with_starts(windows: HeldWindows, motion: Mapping[str, Smoothed]) -> HeldWindows:
    """The windows with ``starts``, from the smoothed motion of each of their trials at whole seconds.

    One row a window in the order of their numbers; NaN where the motion has no estimate.
    """
    first = windows.rows.loc[windows.rows["second"] == 0, ["window", "trial", "leg", "start"]]
    parts = [_starts(first[first["trial"] == trial], each) for trial, each in motion.items()]
    filled = [part for part in parts if len(part)] or parts[:1]
    starts = pd.concat(filled).sort_values("window", ignore_index=True) if filled else None
    return replace(windows, starts=starts)


def _starts(first: pd.DataFrame, motion: Smoothed) -> pd.DataFrame:
    at = pd.DatetimeIndex(first["start"])
    columns = (
        motion.states[list(STATES)],
        motion.covariance_columns(),
        motion.slow[list(STATES)].set_axis(list(SLOW), axis=1),
    )
    values = [each.reindex(at).reset_index(drop=True) for each in columns]
    return pd.concat([first.reset_index(drop=True), *values], axis=1)[list(START_COLUMNS)]


def windows_of_recordings(
    paths: Sequence[Path], how: Cutting | None = None, progress: Callable[[float], None] = lambda share: None
) -> HeldWindows:
    """The windows of recordings, by the trial's name, which is the file's, with their starts.

    Raises :class:`DataShortageError` with the counts by reason when no window is held in any of them, and
    :class:`InputError` when one recording is given twice.
    """
    cutting = how or Cutting()
    refuse_twins(paths)
    parts, motion, names, provenance = [], {}, trial_names(paths), {}
    for number, (path, trial) in enumerate(zip(paths, names, strict=True)):
        raw = Preparation(repair=cutting.repair, remove_delays=cutting.remove_delays)
        simple = not (cutting.starts or cutting.repair or cutting.remove_delays)
        how_raw = replace(raw, rate_hz=1.0) if simple else raw
        table = prepared(read_recording(path), how_raw, rebuild_positions=cutting.rebuild_positions)
        seconds = table if simple else resample(table, 1.0)
        parts.append(
            held_windows(seconds, cutting.horizon_s, cutting.stride_s, trial=trial, keep_moving=cutting.keep_moving)
        )
        provenance[trial] = provenance_of(seconds, asdict(cutting), path)
        if cutting.starts and parts[-1].kept:
            motion[trial] = smooth(table, 1.0)
        progress((number + 1) / len(paths))
    windows = replace(nothing_held_is_an_error(joined(parts), ", ".join(names)), provenance=provenance)
    return with_starts(windows, motion) if cutting.starts else windows
