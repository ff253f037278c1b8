"""What is wrong between position, heading, speeds and yaw rate: scales, offsets, delays, jittering stamps.

A difference is found when it is larger than anyone should care about and larger than chance explains: the level
of significance is such that a sound trial gives a false finding less than once in five hundred, all figures
together.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from acquisition.core.errors import DataShortageError, InputError
from acquisition.core.frames import Quality
from analysis.quality.findings import Checked, Finding, no_flags
from analysis.quality.motion.coarse import coarse_fit
from analysis.quality.motion.contradictions import contradiction, flag_displaced, jump_finding, unfitted
from analysis.quality.motion.delays import CAUSES, OBSERVED, Explanation, explain
from analysis.quality.motion.heading_jitter import certain, heading_jitter
from analysis.quality.motion.jitter import Jitter, stamp_jitter
from analysis.quality.motion.jumps import PositionJump, position_jumps
from analysis.quality.motion.kinematics import NAMES, Kinematics, fit_kinematics
from analysis.quality.motion.parts import with_parts
from analysis.quality.motion.scales import heading_offset, speed_scale, yaw_rate_bias, yaw_rate_scale
from analysis.quality.motion.series import GROUPS, MOTION
from analysis.tables.time_index import utc_index

_SMALLEST_DELAY_S = 0.2
_SMALLEST_JITTER_S = 0.15
_SMALLEST_ARM_M = 0.5
_WHAT = {
    "north_m": "The positions",
    "heading_deg": "The heading",
    "surge_mps": "Surge and sway",
    "yaw_rate_dps": "The yaw rate",
    "forward": "positions measured forward of the point of the speeds",
    "starboard": "positions measured to starboard of the point of the speeds",
}

_GEOGRAPHIC = ("latitude_deg", "longitude_deg")
_OVER_GROUND = ("speed_over_ground_mps", "course_over_ground_deg")
_PLURAL = ("north_m", "surge_mps")


def motion(table: pd.DataFrame) -> Checked:
    """Check the motion channels of a table of raw samples against each other.

    Good are the samples that took part, suspect all samples of a channel that a finding names, bad those of
    positions that jumped and returned. Where a motion channel is missing or the trial is too short for 5 blocks of
    40 s, nothing is evaluated and nothing found.
    """
    flags = no_flags(table, tuple(name for name in MOTION if name in table))
    try:
        coarse = coarse_fit(table)
        if coarse.contradiction:
            return _flagged(flags, table, (contradiction(table, coarse),), ())
        fit = fit_kinematics(table, coarse)
    except (DataShortageError, InputError):
        return Checked(flags)
    if not fit.converged:
        return _flagged(flags, table, (unfitted(table),), ())
    return _flagged(flags, table, findings_of(table, fit), position_jumps(table, fit))


def _flagged(
    flags: pd.DataFrame, table: pd.DataFrame, findings: tuple[Finding, ...], jumps: tuple[PositionJump, ...]
) -> Checked:
    flags = flags.where(flags != Quality.NOT_EVALUATED, int(Quality.GOOD)).astype(np.uint8)
    for finding in findings:
        for name in _stamped_with(finding.channel):
            flags[name] = flags[name].where(flags[name] != Quality.GOOD, int(Quality.SUSPECT)).astype(np.uint8)
    flag_displaced(flags, table, jumps)
    return Checked(flags, (*findings, *(jump_finding(table, jump) for jump in jumps)))


def _stamped_with(channel: str) -> tuple[str, ...]:
    """The channel and those of its group."""
    return next((names for names in GROUPS.values() if channel in names), (channel,))


def findings_of(table: pd.DataFrame, fit: Kinematics) -> tuple[Finding, ...]:
    """What a fit to a table says in words. Only where it says something are the parts of the recording compared,
    which cannot but widen what is said."""
    found = _findings_of(table, fit)
    return _findings_of(table, with_parts(fit)) if found else ()


def _findings_of(table: pd.DataFrame, fit: Kinematics) -> tuple[Finding, ...]:
    index = utc_index(table)
    start, end = index.min(), index.max()
    jitter = stamp_jitter(table, fit)
    explanation = explain(fit, jitter.variance_s2 if jitter.beyond(_SMALLEST_JITTER_S) else 0.0)
    found = [
        speed_scale(fit, start, end),
        yaw_rate_scale(fit, start, end),
        yaw_rate_bias(fit, start, end),
        heading_offset(fit, start, end),
        *(_delay(explanation, cause, fit, start, end) for cause in explanation.causes if cause in GROUPS),
        _arm(explanation, fit, start, end),
        _jitter(jitter, start, end),
        _turning_jitter(heading_jitter(table, fit), start, end),
    ]
    return tuple(each for each in found if each is not None)


def delays_of(findings: Iterable[Finding], table: pd.DataFrame | None = None) -> dict[str, float]:
    """How much too late each channel is stamped [s], by channel, from findings of ``channel_delay``.

    With a ``table``, the channels of it that the same receiver stamps are late with the positions.
    """
    late = {each.channel: float(each.estimate["seconds"]) for each in findings if each.code == "channel_delay"}
    delays = {name: seconds for channel, seconds in late.items() for name in GROUPS.get(channel, (channel,))}
    if table is not None and "north_m" in late:
        delays |= dict.fromkeys(_with_positions(table), late["north_m"])
    return delays


def _with_positions(table: pd.DataFrame) -> list[str]:
    """Latitude and longitude always, speed and course over ground where their source is the positions' and not
    everybody's."""
    sources = table.attrs.get("sources", {})
    own = sources.get("north_m") is not None and sources.get("north_m") != sources.get("surge_mps")
    same = [name for name in _OVER_GROUND if own and sources.get(name) == sources["north_m"]]
    return [name for name in (*_GEOGRAPHIC, *same) if name in table]


def _delay(
    explanation: Explanation, cause: str, fit: Kinematics, start: pd.Timestamp, end: pd.Timestamp
) -> Finding | None:
    seconds, error = explanation.size(cause)
    if abs(seconds) < max(_SMALLEST_DELAY_S, 4.0 * error):
        return None
    half = _half(fit, cause, error)
    low, high = seconds - half, seconds + half
    way = "late" if seconds > 0.0 else "early"
    verb = "are" if cause in _PLURAL else "is"
    text = f"{_WHAT[cause]} {verb} stamped {abs(seconds):.2f} s too {way} (95 % {low:+.2f} to {high:+.2f} s)"
    rivals = "; or ".join(_rival(name, size) for name, size in explanation.rivals)
    if seconds < 0.0 and cause == "north_m":
        text += ", or all the others as much too late"
    if rivals:
        text += f"; this trial tells as well of {rivals}"
    if half > 3.0 * error and half > _SMALLEST_DELAY_S:
        text += "; it is not the same throughout the recording"
    return Finding(
        "channel_delay", cause, start, end, text, "Remove the delay when resampling.",
        {"seconds": seconds, "low": low, "high": high},
    )  # fmt: skip


def _half(fit: Kinematics, cause: str, error: float) -> float:
    """Half of the 95 % interval of a cause, by its error and by what it is seen in where that changes."""
    row = [abs(each) for each in CAUSES[cause]]
    between = [fit.half_between[NAMES.index(name)] for name in OBSERVED]
    return float(max(1.96 * error, *(size * each for size, each in zip(between, row, strict=True))))


def _rival(cause: str, size: float) -> str:
    if cause in GROUPS:
        return f"{_WHAT[cause].lower()} {abs(size):.2f} s too {'late' if size > 0.0 else 'early'}"
    return f"{_WHAT[cause]} by {size:.1f} m"


_SIDES = {"forward": ("forward", "aft"), "starboard": ("to starboard", "to port")}
"""Where something is measured whose size is above zero, and below."""


def _arm(explanation: Explanation, fit: Kinematics, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    sizes = {cause: explanation.size(cause) for cause in ("forward", "starboard") if cause in explanation.causes}
    if not any(abs(size) > max(_SMALLEST_ARM_M, 4.0 * error) for size, error in sizes.values()):
        return None
    main = max(sizes, key=lambda cause: abs(sizes[cause][0]))
    size, error = sizes[main]
    half = _half(fit, main, error)
    where = " and ".join(
        f"{abs(metres):.2f} m {_SIDES[cause][metres < 0.0]}" for cause, (metres, _) in sizes.items()
    )
    metres = {f"{cause}_m": sizes[cause][0] if cause in sizes else 0.0 for cause in _SIDES}
    return Finding(
        "position_offset", "north_m", start, end, f"The positions are measured {where} of the speeds",
        "Give the lever arm of the antenna when recording.", {**metres, "low": size - half, "high": size + half},
    )  # fmt: skip


def _jitter(jitter: Jitter, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    if not jitter.beyond(_SMALLEST_JITTER_S):
        return None
    low, high = jitter.interval()
    text = (
        f"The positions err along the way, with {jitter.ratio:.0f} times the variance across: their stamps jitter"
        f" by {jitter.seconds:.2f} s (95 % {low:.2f} to {high:.2f})"
    )
    return Finding(
        "position_time_jitter", "north_m", start, end, text,
        "Take the receiver's own times; the path integrated from the speeds is the better truth meanwhile.",
        {"seconds": jitter.seconds, "low": low, "high": high},
    )  # fmt: skip


def _turning_jitter(jitter: Jitter, start: pd.Timestamp, end: pd.Timestamp) -> Finding | None:
    if not certain(jitter):
        return None
    low, high = jitter.interval()
    text = (
        f"The heading errs as the ship turns, with {jitter.ratio:.0f} times the variance about the integrated yaw"
        f" rate that it has without turning: its stamps jitter by {jitter.seconds:.2f} s"
        f" (95 % {low:.2f} to {high:.2f})"
    )
    return Finding(
        "heading_time_jitter", "heading_deg", start, end, text,
        "Take the compass's own times; the integrated yaw rate is the better guide to the shape of a turn until"
        " then, and --rebuild-positions takes it.",
        {"seconds": jitter.seconds, "low": low, "high": high},
    )  # fmt: skip
