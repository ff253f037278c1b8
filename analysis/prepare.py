"""From a recording to the table that is asked for: repaired, delays removed, resampled, smoothed, with flags.

The recording is checked once, impossible values left out, and everything follows from what that found: repairs,
flags and delays. The steps come in the order in which each needs the one before; a smoother has to have the times
right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from seatrial.acquisition.recording.reader import Recording
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.tables.export import SIGMA_SUFFIX, add_flags
from seatrial.analysis.tables.resample import resample, resample_recording
from seatrial.analysis.tables.table import add_step, remove_delays, table_of

if TYPE_CHECKING:
    from seatrial.analysis.estimation.smoother import SmoothedMotion

SMOOTHED_RATE_HZ = 1.0
"""The rate of a smoothed table for which none is given."""


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is to be done with a recording's samples before they are written as a table.

    Without ``rate_hz`` [Hz] the raw samples stay as they are, unless ``smooth`` asks for a rate.
    """

    rate_hz: float | None = None
    repair: bool = False
    remove_delays: bool = False
    smooth: bool = False
    flags: bool = False


def prepare(recording: Recording, how: Preparation, *, rebuild_positions: bool = False) -> pd.DataFrame:
    """The recording's table, the steps that were done in its history.

    ``rebuild_positions``, with the repairs, takes the path that speeds and heading give for the positions
    (:func:`seatrial.analysis.quality.repairs.request_position_repair`).
    Raises :class:`seatrial.acquisition.core.errors.DataShortageError` for a recording without samples,
    :class:`seatrial.acquisition.core.errors.InputError` where smoothing lacks position or heading.
    """
    if how == Preparation(rate_hz=how.rate_hz) and how.rate_hz is not None:
        return resample_recording(recording, how.rate_hz)  # needs no joined table
    raw = table_of(recording)
    if not (how.repair or how.flags or how.remove_delays):
        return _at_rate(raw, how, {})
    from seatrial.analysis.quality.motion.checks import delays_of

    table, flags, findings = checked_table(recording, raw, repaired=how.repair, rebuild_positions=rebuild_positions)
    left = [each for each in findings if not (how.repair and each.certain)]
    delays = delays_of(left, raw) if how.remove_delays else {}
    result = _at_rate(table, how, delays)
    return add_flags(result, flags, delays) if how.flags else result


def checked_table(
    recording: Recording, raw: pd.DataFrame, *, repaired: bool = False, rebuild_positions: bool = False
) -> tuple[pd.DataFrame, pd.DataFrame, tuple[Finding, ...]]:
    """The recording's table, ``repaired`` or as it is, its flags, and all that a check of it finds."""
    from seatrial.analysis.quality.check import check_recording
    from seatrial.analysis.quality.repairs import repair

    quality = check_recording(recording, raw)
    table, flags = raw, quality.flags
    if repaired:
        done = repair(raw, quality.findings, flags, recording, rebuild_positions=rebuild_positions)
        table, flags = done.table, flags if done.flags is None else done.flags
    return table, flags, quality.findings


def _at_rate(table: pd.DataFrame, how: Preparation, delays: Mapping[str, float]) -> pd.DataFrame:
    if how.smooth:
        return smooth_table(table, how.rate_hz or SMOOTHED_RATE_HZ, delays)
    if how.rate_hz is not None:
        return resample(table, how.rate_hz, delays=delays)
    return remove_delays(table, delays) if delays else table


def smooth_table(table: pd.DataFrame, rate_hz: float, delays: Mapping[str, float] | None = None) -> pd.DataFrame:
    """All channels at ``rate_hz``, motion from the Kalman smoother with the standard deviation of each.

    The motion channels and their rates of change come from :func:`seatrial.analysis.estimation.smoother.smooth`, a
    column ``<name>_sigma`` beside each; all others are resampled. ``delays`` [s by channel] are removed first.
    """
    from seatrial.analysis.estimation.smoother import smooth

    motion = smooth(remove_delays(table, delays) if delays else table, rate_hz)
    return with_motion(resample(table, rate_hz, delays=delays), motion)


def with_motion(table: pd.DataFrame, motion: SmoothedMotion) -> pd.DataFrame:
    """A table with motion and its rates of change from the smoother, the standard deviation of each beside it."""
    states, sigmas = (each.reindex(table.index) for each in (motion.states, motion.standard_deviations()))
    result = add_step(table, "smooth", rate_hz=float(table.attrs["rate_hz"]))
    for name in states.columns:
        result[name], result[f"{name}{SIGMA_SUFFIX}"] = states[name], sigmas[name]
    return result
