"""Findings from a comparison of position, heading, speeds and yaw rate: scales, offsets, delays, jittering stamps.

A difference is reported when it is larger than anyone should care about and larger than chance explains: the
level of significance is such that a sound trial gives a false finding less than once in five hundred, all figures
together.

The delayed channel is the odd one out among the three delays between the four groups of motion channels. The
delays of positions and headings after the speeds, and of headings after the yaw rate, and the lever arm forward,
which at steady speed looks just like a delay, are explained by as few causes as their covariance allows
(generalised least squares; an added cause must reduce the misfit by more than it costs).

What is significant may yet not be certain: a factor must be known to half a percent over the whole recording, and
be one that no other channel could be to blame for. A gross factor points to a unit. And it must show in the motion
that is slower than waves: what shows in waves alone may be the way of an antenna high up on a ship that rolls and
pitches. Each finding states in which band of frequencies it shows.

Heading and speeds are also compared with the track in every convention that an import compares. Speeds that were
derived from the heading agree with the positions whatever the heading is, so that comparing them shows nothing: the
drift angle does.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pandas as pd
import pymap3d

from seatrial.acquisition.core import conventions, quantities, trial
from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.acquisition.tables import evidence
from seatrial.analysis.quality.findings import CheckResult, Finding, set_flags, uniform_flags
from seatrial.analysis.quality.motion import fit as fits
from seatrial.analysis.quality.motion import model, positions
from seatrial.analysis.tables.table import NANO, Span, require, seconds_of, span_of, utc_index

_SMALLEST_DELAY_S = 0.2
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
_LEAST_DELAY_SAMPLES = 2.0
"""Within two samples of a channel its delay may as well be how it was sampled or averaged."""
_SIDES = {"forward": ("forward", "aft"), "starboard": ("to starboard", "to port")}
"""Where something is measured whose size is above zero, and below."""
OBSERVED = ("position_delay_s", "heading_delay_s", "heading_after_yaw_rate_s", "forward_m", "starboard_m")
CAUSES: dict[str, tuple[float, ...]] = {
    "north_m": (1.0, 0.0, 0.0, 0.0, 0.0),
    "heading_deg": (0.0, 1.0, 1.0, 0.0, 0.0),
    "surge_mps": (-1.0, -1.0, 0.0, 0.0, 0.0),
    "yaw_rate_dps": (0.0, 0.0, -1.0, 0.0, 0.0),
    "forward": (0.0, 0.0, 0.0, 1.0, 0.0),
    "starboard": (0.0, 0.0, 0.0, 0.0, 1.0),
}
"""What one unit of each cause does to the observed figures: seconds of delay, or metres of lever arm."""

_ADEQUATE = 25.0  # misfit that is still no reason for one more cause: five standard deviations
_AS_WELL = 9.0
_NEGLIGIBLE = np.array([0.1, 0.1, 0.05, 0.25, 0.25])
"""Unmodelled differences (smoothing inside sensors) of this size are left alone, as standard deviations / 2."""
_MATCHES = 0.005
FACTORS = (0.3, 3.0)
"""Beyond these a factor is corrected without asking only where it is a unit's."""
_REMEDY = "Correct it where it is recorded or imported; nothing else can be told of the motion until then."


def check_motion(table: pd.DataFrame) -> CheckResult:
    """Check the motion channels of a table of raw samples against each other.

    Good are the samples that took part, suspect all samples of a channel that a finding names, bad those of
    positions that jumped and returned. Where a motion channel is missing or the trial is too short for 5 blocks of
    40 s, nothing is evaluated, which the result says, and nothing found.
    """
    names = [name for name in model.MOTION if name in table]
    try:
        contradiction, coarse = _find_contradiction(table)
        if contradiction is not None:
            return _flag_findings(table, (contradiction,))
        fit = fits.fit_kinematics(table, coarse)
    except (DataShortageError, InputError) as error:
        reason = f"the recording {error.what}" + (f", {error.why}" if error.why else "")
    except np.linalg.LinAlgError:
        reason = "too few samples for all that is estimated"
    else:
        return _result_of_fit(table, fit)
    text = f"Position, heading, speeds and rate of turn are not compared with each other: {reason}"
    return CheckResult(uniform_flags(table, names, trial.Quality.NOT_EVALUATED), unevaluated=text)


def _result_of_fit(table: pd.DataFrame, fit: fits.Kinematics) -> CheckResult:
    """What a fit of the motion shows, or that it fits no motion."""
    if fit.converged:
        return _flag_findings(table, findings_of(table, fit), fits.position_jumps(table, fit))
    diverged = Finding(
        "motion_contradiction", "north_m", *span_of(table),
        "Positions, heading, speeds and yaw rate tell of no one motion, and nothing that was tried explains it",
        "Check signs, units and axes of the motion channels.",
    )  # fmt: skip
    return _flag_findings(table, (diverged,))


def _find_contradiction(table: pd.DataFrame) -> tuple[Finding | None, model.Coarse | None]:
    """A sign, unit or convention by which the motion channels contradict each other, and the coarse fit to them."""
    with suppress(DataShortageError, InputError):
        if (axes := axes_finding(table)) is not None:
            return axes, None
    coarse = model.fit_coarsely(table) if all(name in table for name in model.MOTION) else None
    if coarse is not None and coarse.is_explained:
        return model.contradiction_finding(table, coarse), coarse
    with suppress(DataShortageError, InputError):
        if (heading := heading_convention_finding(table)) is not None:
            return heading, coarse
    if coarse is not None and coarse.contradiction:
        return model.contradiction_finding(table, coarse), coarse
    return None, coarse


def _flag_findings(
    table: pd.DataFrame, findings: tuple[Finding, ...], jumps: tuple[fits.PositionJump, ...] = ()
) -> CheckResult:
    """Findings and jumps of positions with their flags: bad is what lies between a jump and its return."""
    flags = uniform_flags(table, [name for name in model.MOTION if name in table])
    suspect = {
        name
        for finding in findings
        for name in next((names for names in model.GROUPS.values() if finding.channel in names), (finding.channel,))
    }
    flags = flags.assign(**uniform_flags(table, suspect, trial.Quality.SUSPECT))
    index, time_s, displaced, jump_findings = utc_index(table), seconds_of(table), np.zeros(len(table), bool), []
    for jump in jumps:
        displaced |= (time_s >= jump.time_s - 1e-6) & (time_s < jump.until_s - 1e-6)
        returns, metres = bool(np.isfinite(jump.until_s)), float(np.hypot(jump.north_m, jump.east_m))
        start = index.min() + pd.Timedelta(round(jump.time_s * NANO), "ns")
        end = index.min() + pd.Timedelta(round(jump.until_s * NANO), "ns") if returns else start
        text = (
            f"The positions jump by {metres:.1f} m ({jump.north_m:+.1f} m north, {jump.east_m:+.1f} m east)"
            f" at {start:%H:%M:%S}"
        )
        text += f" and return after {jump.until_s - jump.time_s:.1f} s" if returns else " and do not return"
        remedy = "Leave out what is displaced." if returns else "Take what lies before and after as two recordings."
        estimate = {"metres": metres, "north_m": jump.north_m, "east_m": jump.east_m}
        jump_findings.append(Finding("position_jump", "north_m", start, end, text, remedy, estimate))
    for name in model.GROUPS["north_m"] if jumps else ():
        rows = np.flatnonzero(displaced & table[name].notna().to_numpy())
        set_flags(flags, name, rows, trial.Quality.BAD)
    return CheckResult(flags, (*findings, *jump_findings))


def findings_of(table: pd.DataFrame, fit: fits.Kinematics) -> tuple[Finding, ...]:
    """Findings from a fit to a table. The parts of the recording are only compared where there is a finding: that
    can only widen its interval."""
    # What an import derived is not compared with what it was derived from.
    of_turns = is_derived_from(table, "yaw_rate_dps", ("heading_deg",))
    of_path = is_derived_from(table, "surge_mps", ("north_m",))
    if of_turns and of_path:
        return ()
    circular = {"yaw_rate_dps", "heading_time_jitter"} if of_turns else set[str]()
    if of_path:
        circular = {"north_m", "surge_mps", "heading_offset"}
    span, independent = span_of(table), independent_groups(table)
    findings: list[Finding] = []
    for quarters in (False, True):
        fit = fits.widen_by_quarters(fit) if quarters else fit
        jitter = positions.position_stamp_jitter(table, fit)
        jitters = jitter.exceeds(positions.SMALLEST_POSITION_JITTER_S)
        explanation = explain_delays(fit, jitter.variance_s2 / max(jitter.stretches, 1.0) if jitters else 0.0)
        candidates = [
            *(figure(fit, span) for figure in FIGURES),
            *(
                _delay_finding(explanation, cause, fit, span, cause in independent)
                for cause in explanation.causes
                if cause in model.GROUPS
            ),
            _lever_arm_finding(explanation, fit, span),
            positions.position_jitter_finding(jitter, span),
            positions.heading_jitter_finding(table, fit, span),
        ]
        findings = [
            finding for finding in candidates
            if finding is not None and not {finding.channel, finding.code} & circular
        ]  # fmt: skip
        if not findings:
            break
    return tuple(findings)


def delays_in_findings(findings: Iterable[Finding], table: pd.DataFrame | None = None) -> dict[str, float]:
    """The delay of each channel's stamps [s], by channel, from findings of ``channel_delay``.

    Without those that show in waves alone.
    With a ``table``, the channels of it that the same receiver stamps have the delay of the positions.
    """
    delay_findings = [
        finding for finding in findings if finding.code == "channel_delay" and (finding.band_hz or (0.0,))[0] <= 0.0
    ]
    delay_of_group = {finding.channel: float(finding.estimate["seconds"]) for finding in delay_findings}
    delays = {
        name: seconds
        for channel, seconds in delay_of_group.items()
        for name in model.GROUPS.get(channel, (channel,))
    }
    if table is not None and "north_m" in delay_of_group:
        # Stamped with the positions: latitude and longitude, and speed and course over ground where their source is
        # that of the positions but not of the speeds.
        sources = table.attrs.get("sources", {})
        independent = sources.get("north_m") is not None and sources.get("north_m") != sources.get("surge_mps")
        same = [name for name in _OVER_GROUND if independent and sources.get(name) == sources["north_m"]]
        same = [name for name in (*_GEOGRAPHIC, *same) if name in table]
        delays |= dict.fromkeys(same, delay_of_group["north_m"])
    return delays


def independent_groups(table: pd.DataFrame) -> frozenset[str]:
    """The groups whose delay is seen against sensors of their own, by the sources that the table names.

    Speeds that were derived from the positions or with the heading, or come from the positions' own receiver, and a
    yaw rate that was derived from the heading, share noise and stamps with what they would be compared with. What
    names no source is taken for recorded.
    """
    sources: dict[str, list[str]] = table.attrs.get("sources", {})
    position, speed, yaw_rate = (
        [source for name in model.GROUPS[group] for source in sources.get(name, [])]
        for group in ("north_m", "surge_mps", "yaw_rate_dps")
    )
    receivers = {trial.line_and_device(source) for source in position if trial.split_source_label(source)[1]}
    is_derived = [any("derived" in source.split(" ") for source in labels) for labels in (speed, yaw_rate)]
    of_path, of_turn = (
        not is_derived[0] and not receivers & set(map(trial.line_and_device, speed)),
        not is_derived[1],
    )
    shown = {"north_m": of_path, "surge_mps": of_path, "heading_deg": of_path and of_turn, "yaw_rate_dps": of_turn}
    return frozenset(name for name, independent in shown.items() if independent)


def _delay_finding(
    explanation: Explanation, cause: str, fit: fits.Kinematics, span: Span, independent: bool
) -> Finding | None:
    seconds, error = explanation.size(cause)
    if abs(seconds) < max(_SMALLEST_DELAY_S, 4.0 * error):
        return None
    half, band_hz = _interval_half_and_band(explanation, cause, fit)
    low, high = seconds - half, seconds + half
    direction = "late" if seconds > 0.0 else "early"
    verb = "are" if cause in _PLURAL else "is"
    shift_s = abs(seconds)  # counted in that direction, and its ends with it
    ends = f"{shift_s - half:.2f} to {shift_s + half:.2f}".replace("-", "\u2212")
    text = f"{_WHAT[cause]} {verb} stamped {shift_s:.2f} s too {direction} (95 % {ends} s)"
    rivals = "; or ".join(
        f"{_WHAT[name].lower()} {abs(size):.2f} s too {'late' if size > 0.0 else 'early'}"
        if name in model.GROUPS
        else f"{_WHAT[name]} by {size:.1f} m"
        for name, size in explanation.rivals
    )
    if seconds < 0.0 and cause == "north_m":
        text += ", or all the others as much too late"
    if rivals:
        text += f"; this trial tells as well of {rivals}"
    steady = half <= max(3.0 * error, _SMALLEST_DELAY_S)
    if not steady:
        text += "; it is not the same throughout the recording"
    doubt = _objection_to_removing_delay(explanation, cause, fit, independent)
    certain = steady and not doubt
    remedy = "--repair takes it off the stamps."
    if not certain:
        remedy = f"--repair leaves it: {doubt or 'this trial does not tell enough'}."
    estimate = {"seconds": seconds, "low": low, "high": high}
    finding = Finding("channel_delay", cause, *span, text, remedy, estimate, certain=certain)
    return _limit_finding_to_band(finding, band_hz)


def _objection_to_removing_delay(
    explanation: Explanation, cause: str, fit: fits.Kinematics, independent: bool
) -> str:
    """Why a delay is not to be removed without asking; empty where there is no objection."""
    seconds, _ = explanation.size(cause)
    if not independent:
        return "what it was compared with is derived from the same values or of the same receiver"
    if explanation.rivals:
        return "this trial does not tell enough"
    interval_s = fit.motion.recorded_s[list(model.GROUPS).index(cause)]
    if abs(seconds) <= _LEAST_DELAY_SAMPLES * interval_s:
        return f"it is no more than two of its samples, which come every {interval_s:.3g} s"
    confirmed = 0
    for quarter in fit.quarters:
        size, error = _explain_by_causes(quarter, explanation.causes, 0.0).size(cause)
        half = fits.student_t_quantile(0.975, float(quarter.informative[_first_parameter_index(cause)])) * error
        confirmed += abs(size) > half and abs(size - seconds) < max(2.0 * half, _SMALLEST_DELAY_S)
    return "" if confirmed == len(fit.quarters) >= fits.PARTS else "not every quarter of the recording confirms it"


def _first_parameter_index(cause: str) -> int:
    """The first of the fitted parameters that a cause shows in."""
    return next(
        fits.NAMES.index(name) for name, cause_effect in zip(OBSERVED, CAUSES[cause], strict=True) if cause_effect
    )


def _limit_finding_to_band(finding: Finding, band_hz: tuple[float, float]) -> Finding:
    """The finding with the band in which it shows; certain only where the slow motion shows it."""
    low, high = band_hz
    text = f"{finding.text}; the same holds for motion up to {high:.2g} Hz"
    if not low > 0.0:
        return replace(finding, text=text, band_hz=band_hz)
    text = f"{finding.text}; it shows between {low:.2g} and {high:.2g} Hz, and slower motion does not tell"
    remedy = "Look where antenna and speed sensor stand: in waves, rolling and pitching do the same."
    return replace(finding, text=text, remedy=remedy, band_hz=band_hz, certain=False)


def _interval_half_and_band(
    explanation: Explanation, cause: str, fit: fits.Kinematics
) -> tuple[float, tuple[float, float]]:
    """Half of the 95 % interval of a cause, from its standard error or the quarters of the recording, and the band
    [Hz] in which it shows: from 0 where the slow motion alone gives the same."""
    between = [fit.quarters_half_width[fits.NAMES.index(name)] for name in OBSERVED]
    effects = map(abs, CAUSES[cause])
    _, error = explanation.size(cause)
    half = float(max(1.96 * error, *(size * effect for size, effect in zip(between, effects, strict=True))))
    if fit.from_slow[_first_parameter_index(cause)]:
        return half, (0.0, fit.slow_hz)
    slow_size, slow_error = _explain_by_causes(fit.slow, explanation.causes, 0.0).size(cause)
    return half, (0.0 if abs(slow_size) > 4.0 * slow_error else fit.slow_hz, fit.fastest_hz)


def _lever_arm_finding(explanation: Explanation, fit: fits.Kinematics, span: Span) -> Finding | None:
    sizes = {cause: explanation.size(cause) for cause in ("forward", "starboard") if cause in explanation.causes}
    if not any(abs(size) > max(_SMALLEST_ARM_M, 4.0 * error) for size, error in sizes.values()):
        return None
    main = max(sizes, key=lambda cause: abs(sizes[cause][0]))
    size, _ = sizes[main]
    half, band_hz = _interval_half_and_band(explanation, main, fit)
    where = " and ".join(
        f"{abs(length_m):.2f} m {_SIDES[cause][length_m < 0.0]}" for cause, (length_m, _) in sizes.items()
    )
    metres = {f"{cause}_m": sizes[cause][0] if cause in sizes else 0.0 for cause in _SIDES}
    finding = Finding(
        "position_offset", "north_m", *span, f"The positions are measured {where} of the speeds",
        "Give the lever arm of the antenna when recording.", {**metres, "low": size - half, "high": size + half},
    )  # fmt: skip
    return _limit_finding_to_band(finding, band_hz)


@dataclass(frozen=True, slots=True)
class Explanation:
    """Sizes of the ``causes`` with standard errors, the misfit they leave (chi squared), rival causes."""

    causes: tuple[str, ...]
    sizes: quantities.Floats
    standard_errors: quantities.Floats
    misfit: float
    rivals: tuple[tuple[str, float], ...] = ()

    def size(self, cause: str) -> tuple[float, float]:
        place = self.causes.index(cause)
        return float(self.sizes[place]), float(self.standard_errors[place])


def explain_delays(fit: fits.Kinematics, jitter_s2: float = 0.0) -> Explanation:
    """The simplest adequate explanation of the delays and the lever arm; no cause where all is well.

    ``jitter_s2`` is the variance of the mean of the positions' stamps: by chance they are delayed on the whole, or
    on one leg and not on the next, which looks like a delayed heading. No sensor stamps one channel before it was
    measured, but positions may be in time and all others late.
    """
    for count in range(4):
        explanations = sorted(
            (_explain_by_causes(fit.selected, causes, jitter_s2) for causes in combinations(CAUSES, count)),
            key=lambda explanation: explanation.misfit,
        )
        best = explanations[0]
        if best.misfit > _ADEQUATE:
            continue
        equivalent = [
            explanation for explanation in explanations if explanation.misfit <= best.misfit + _AS_WELL
        ]  # fmt: skip
        if count == 1 and best.causes[0] in model.GROUPS and best.causes[0] != "north_m" and best.sizes[0] < 0.0:
            adequate = [explanation for explanation in equivalent if explanation.misfit <= _ADEQUATE]
            delayed = (single for single in adequate if single.causes[0] in model.GROUPS and single.sizes[0] > 0.0)
            best = next(delayed, best)
        rivals: dict[str, float] = {}
        for explanation in equivalent[::-1]:
            extra = {*explanation.causes} - {*best.causes}
            if len(extra) == 1:
                (cause,) = extra
                rivals[cause] = explanation.size(cause)[0]
        return replace(best, rivals=tuple(rivals.items()))
    return best


def _explain_by_causes(fit: fits.MotionSolution, causes: tuple[str, ...], jitter_s2: float) -> Explanation:
    places = [fits.NAMES.index(name) for name in OBSERVED]
    observed = fit.parameters[places]
    # The spread of few blocks is less certain than a normal deviate's: widened as Student's t is at 95 %.
    widening = np.array([fits.student_t_quantile(0.975, fit.informative[place]) / 1.96 for place in places])
    covariance = fit.covariance[np.ix_(places, places)] * np.outer(widening, widening) + np.diag(
        (0.5 * _NEGLIGIBLE) ** 2 / 9.0
    )
    covariance[[0, 1], [0, 1]] += jitter_s2
    inverse = np.linalg.inv(covariance)
    design = np.array([CAUSES[cause] for cause in causes]).reshape(-1, len(OBSERVED)).T
    normal = design.T @ inverse @ design
    sizes = np.linalg.solve(normal, design.T @ inverse @ observed)
    residual, errors = observed - design @ sizes, np.sqrt(np.diag(np.linalg.inv(normal)))
    return Explanation(causes, sizes, errors, float(residual @ inverse @ residual))


@dataclass(frozen=True, slots=True)
class Limits:
    """When a figure is reported: its ``neutral`` value, the ``least`` difference from it that matters, and what
    sampling and interpolation may do, as a standard deviation (of a factor in proportion): no interval is narrower.
    """

    neutral: float
    least: float
    systematic: float


LIMITS = {
    "speed_factor": Limits(1.0, 0.005, 2e-4),
    "yaw_rate_factor": Limits(1.0, 0.01, 5e-4),
    "yaw_rate_bias_radps": Limits(0.0, np.deg2rad(0.02), np.deg2rad(5e-4)),
    "heading_offset_rad": Limits(0.0, np.deg2rad(0.3), np.deg2rad(0.01)),
}
_CERTAIN_HALF_WIDTH = 0.005


def _significant_figure(fit: fits.Kinematics, name: str) -> tuple[float, float, float] | None:
    """A figure and its 95 % interval; None where it does not differ from its neutral value significantly, or not by
    enough to matter."""
    value, limits = fit.value(name), LIMITS[name]
    systematic = limits.systematic * (abs(value) if limits.neutral else 1.0)
    critical = fits.student_t_quantile(1.0 - 0.5 * fits.CHANCE, fit.selected.informative[fits.NAMES.index(name)])
    error = float(np.hypot(fit.standard_error(name), systematic))
    if abs(value - limits.neutral) <= max(limits.least, critical * error):
        return None
    low, high = fit.interval(name)
    half = float(np.hypot(0.5 * (high - low), 1.96 * systematic))
    return value, value - half, value + half


def speed_scale_finding(fit: fits.Kinematics, span: Span) -> Finding | None:
    """The factor of surge and sway against the rate of the positions."""
    factor = fit.value("speed_factor")
    how = f"are {abs(1.0 / factor - 1.0):.1%} too {'low' if factor > 1.0 else 'high'} for"
    text = f"Surge and sway {how if factor > 0.0 else 'run against'} the rate of the positions"
    finding = Finding("speed_scale", "surge_mps", *span, text)
    return _add_factor(finding, fit, "speed_factor", SPEED_UNITS, "surge and sway")


def yaw_rate_scale_finding(fit: fits.Kinematics, span: Span) -> Finding | None:
    """The factor of the yaw rate against the turns of the heading."""
    factor = fit.value("yaw_rate_factor")
    how = f"{abs(1.0 / factor - 1.0):.1%} {'less' if factor > 1.0 else 'more'} than the heading turns"
    text = f"The yaw rate reads {how if factor > 0.0 else 'against the turns of the heading'}"
    finding = Finding("yaw_rate_scale", "yaw_rate_dps", *span, text)
    return _add_factor(finding, fit, "yaw_rate_factor", YAW_RATE_UNITS, "the yaw rate")


def _add_factor(
    finding: Finding, fit: fits.Kinematics, name: str, units: tuple[Unit, ...], what: str
) -> Finding | None:
    """The finding with its factor in the text and the estimate, and what to do about it; None for none.

    A factor whose interval holds that nothing is wrong is not applied.
    """
    reported = _significant_figure(fit, name)
    if reported is None:
        return None
    factor, low, high = reported
    matches = (  # within the interval and half a percent
        unit for unit in units
        if low - abs(_MATCHES * unit.factor) <= unit.factor <= high + abs(_MATCHES * unit.factor)
        and abs(factor / unit.factor - 1.0) < _MATCHES
    )  # fmt: skip
    unit = next(matches, None)
    text = f"{finding.text} (factor {factor:.4f}, 95 % {low:.4f} to {high:.4f})"
    if unit is not None:
        text += f", {unit.words}"
    if fit.quarters_half_width[fits.NAMES.index(name)] > max(LIMITS[name].least, 2.0 * fit.standard_error(name)):
        text += "; it is not the same throughout the recording"
    if unit is not None and unit.sure:
        factor = unit.factor  # exact: the estimate would leave its own error in the channel
        low, high = min(low, factor), max(high, factor)
    remedy = f"Multiply {what} by {factor:.6g}."
    if unit is not None and not unit.sure:
        remedy = "Find out which it is."
    elif low <= 1.0 <= high:
        remedy = f"Look at {what} part by part: over the whole recording no one factor is right."
    half = 0.5 * (high - low)
    precise = half < _CERTAIN_HALF_WIDTH * abs(factor) and abs(factor - 1.0) > 4.0 * half
    plausible = unit.sure if unit is not None else FACTORS[0] <= factor <= FACTORS[1]
    estimate = {"factor": factor, "low": low, "high": high}
    scaled = replace(finding, text=text, remedy=remedy, estimate=estimate, certain=bool(precise and plausible))
    return _limit_finding_to_band(scaled, fit.band_hz(name, 1.0))


def yaw_rate_bias_finding(fit: fits.Kinematics, span: Span) -> Finding | None:
    """What the yaw rate reads while the heading stays [deg/s]."""
    reported = _significant_figure(fit, "yaw_rate_bias_radps")
    if reported is None:
        return None
    bias, high, low = (-180.0 / np.pi / fit.value("yaw_rate_factor") * np.array(reported)).tolist()
    finding = Finding(
        "yaw_rate_bias", "yaw_rate_dps", *span,
        f"The yaw rate reads {bias:+.3f} deg/s while the heading stays (95 % {low:+.3f} to {high:+.3f})",
        "Subtract it, and set the gyro's zero.", {"bias_dps": bias, "low": low, "high": high},
    )  # fmt: skip
    return _limit_finding_to_band(finding, fit.band_hz("yaw_rate_bias_radps"))


def heading_offset_finding(fit: fits.Kinematics, span: Span) -> Finding | None:
    """The heading against course and drift angle [deg]."""
    reported = _significant_figure(fit, "heading_offset_rad")
    if reported is None:
        return None
    angle, low, high = np.rad2deg(reported).tolist()
    astern = ", unless surge and sway have the wrong sign" if abs(angle) > 175.0 else ""
    finding = Finding(
        "heading_offset", "heading_deg", *span,
        f"The heading reads {abs(angle):.2f} deg too far to {'starboard' if angle > 0.0 else 'port'} for course and"
        f" drift angle (95 % {low:+.2f} to {high:+.2f}){astern}",
        "Align the compass or subtract the offset, unless the speed sensor's axes are turned the other way.",
        {"angle_deg": angle, "low": low, "high": high},
    )  # fmt: skip
    return _limit_finding_to_band(finding, fit.band_hz("heading_offset_rad"))


@dataclass(frozen=True, slots=True)
class Unit:
    """A factor that a unit or sign makes, in words; ``sure`` where no other channel could be to blame."""

    factor: float
    words: str
    sure: bool = True


SPEED_UNITS = (
    Unit(quantities.KNOT_MPS, "as if knots were taken for m/s"),
    Unit(1.0 / 3.6, "as if km/h were taken for m/s"),
    Unit(1.0 / quantities.KNOT_MPS, "as if m/s had been converted from knots twice"),
    Unit(3.6, "as if m/s had been converted from km/h twice"),
    Unit(1.0 / 0.3048, "as if the positions were in feet", sure=False),
    Unit(0.3048, "as if ft/s were taken for m/s", sure=False),
    Unit(-1.0, "as if surge and sway counted the wrong way, unless the heading is half a turn off", sure=False),
)
YAW_RATE_UNITS = (
    Unit(57.29577951308232, "as if rad/s were taken for deg/s"),
    Unit(1.0 / 60.0, "as if deg/min were taken for deg/s"),
    Unit(60.0, "as if deg/s had been converted from deg/min twice"),
    Unit(1.0 / 57.29577951308232, "as if deg/s had been converted from rad/s twice"),
    Unit(-1.0, "as if it counted positive to port"),
    Unit(-57.29577951308232, "as if rad/s were taken for deg/s, and counted positive to port"),
    Unit(-1.0 / 60.0, "as if deg/min were taken for deg/s, and counted positive to port"),
)


FIGURES = (speed_scale_finding, yaw_rate_scale_finding, yaw_rate_bias_finding, heading_offset_finding)


def is_derived_from(table: pd.DataFrame, name: str, channels: tuple[str, ...]) -> bool:
    """Whether an import derived a channel from one of others, so that it is no evidence on them."""
    return any(
        channel in source.partition(" derived from ")[2]
        for source in table.attrs.get("sources", {}).get(name, ())
        for channel in channels
    )


def heading_convention_finding(table: pd.DataFrame) -> Finding | None:
    """The unit or convention in which the heading agrees with the positions, where that is not ours.

    Raises :class:`InputError` where positions or heading are missing and :class:`DataShortageError` for less than 8
    samples of them.
    """
    table = _add_plane_positions(table)
    require(table, ("north_m", "east_m", "heading_deg"))
    position, heading = (model.group_samples(table, model.GROUPS[name]) for name in ("north_m", "heading_deg"))
    grid = evidence.comparison_grid(np.concatenate([position.time_s, heading.time_s]))
    if grid.size < 3:
        return None
    moves = _moves_between_instants(position, grid)
    moves[evidence.gap_mask_of_grid(heading.time_s, grid)] = np.nan
    recorded, readings = np.rad2deg(heading.levels[:, 0]), {}
    for unit in conventions.ANGLE_UNITS:
        scale = quantities.unit_scale("deg", unit)  # parts of a degree may have been wrapped at 360
        angle = np.unwrap(recorded * max(scale, 1.0), period=360.0) * min(scale, 1.0)
        readings[unit] = evidence.interval_means_on_grid(heading.time_s, angle, grid)
    verdict = conventions.find_heading_convention(moves, readings)
    if not verdict.unit or (verdict.unit == "deg" and verdict.convention in (conventions.CLOCKWISE, None)):
        return None
    turning = None
    if "yaw_rate_dps" in table and not is_derived_from(table, "yaw_rate_dps", ("heading_deg",)):
        rate = model.group_samples(table, model.GROUPS["yaw_rate_dps"])
        turned = evidence.integrals_on_grid(rate.time_s, np.rad2deg(rate.levels[:, 0]), grid)
        turning = evidence.fit_scale(np.diff(readings["deg"]), 0.5 * (turned[1:] + turned[:-1]))
    convention = verdict.convention or conventions.CLOCKWISE
    sense = "" if convention is conventions.CLOCKWISE else f" counts {convention.words}"
    if verdict.unit != "deg":
        words = f"the heading is in {conventions.ANGLE_UNITS[verdict.unit]}{' and' * bool(sense)}{sense}"
    elif turning is not None and turning.is_clear and turning.factor < 0.0:
        words = f"the heading{sense}, which the yaw rate confirms"
    else:  # unless the yaw rate turns with the track, mirrored positions make the two agree as well
        words = f"the heading{sense}, or as well if the positions are wrong: {convention.mirrored}"
    text = f"The track and the heading agree if {words}: {verdict.evidence}"
    estimate = {"drift_spread_deg": verdict.best.spread_deg, "recorded_spread_deg": verdict.recorded.spread_deg}
    return Finding("motion_contradiction", "heading_deg", *span_of(table), text, _REMEDY, estimate)


def _add_plane_positions(table: pd.DataFrame) -> pd.DataFrame:
    """The table with positions in metres where it has geographic ones alone."""
    if "north_m" in table or not {"latitude_deg", "longitude_deg"} <= set(table.columns):
        return table
    latitude, longitude = (table[name].to_numpy(dtype=float) for name in ("latitude_deg", "longitude_deg"))
    located = np.flatnonzero(evidence.valid_position_mask(latitude, longitude))
    north, east = np.full((2, latitude.size), np.nan)
    if located.size:
        origin = latitude[located[0]], longitude[located[0]], 0.0
        north[located], east[located], _ = pymap3d.geodetic2ned(latitude[located], longitude[located], 0.0, *origin)
    return table.assign(north_m=north, east_m=east)


def _moves_between_instants(position: model.Group, grid: quantities.Floats) -> quantities.Complexes:
    """The moves between instants, NaN where the positions have a gap."""
    north, east = (evidence.increments_on_grid(position.time_s, column, grid) for column in position.levels.T)
    return np.where(evidence.gap_mask_of_grid(position.time_s, grid), np.nan, north + 1j * east)


def axes_finding(table: pd.DataFrame) -> Finding | None:
    """Surge and sway that are speeds along north and east; raises as :func:`heading_convention_finding`."""
    require(table, tuple(name for group in ("north_m", "heading_deg", "surge_mps") for name in model.GROUPS[group]))
    position, heading, speed = (
        model.group_samples(table, model.GROUPS[name]) for name in ("north_m", "heading_deg", "surge_mps")
    )
    grid = evidence.comparison_grid(position.time_s)
    if grid.size < 3:
        return None
    surge, sway = speed.levels.T
    angle = np.interp(speed.time_s, heading.time_s, np.unwrap(heading.levels[:, 0]))
    velocities = {
        "ship": quantities.to_earth(surge, sway, angle),
        "north_east": (surge, sway),
        "east_north": (sway, surge),
        "east_south": (-sway, surge),
    }
    travelled = {
        axes: np.asarray(
            evidence.integrals_on_grid(speed.time_s, north, grid)
            + 1j * evidence.integrals_on_grid(speed.time_s, east, grid)
        )
        for axes, (north, east) in velocities.items()
    }
    axes, fits = conventions.find_velocity_axes(_moves_between_instants(position, grid), travelled)
    if axes in ("", "ship"):
        return None
    unexplained, as_ship = (float(np.sqrt(fits[name].residual)) for name in (axes, "ship"))
    text = (
        f"Surge and sway are speeds {conventions.AXES[axes]}: {unexplained:.1%} of the way by the positions is left"
        f" over by them, and {as_ship:.1%} along the ship"
    )
    estimate = {"left": as_ship}
    return Finding("motion_contradiction", "surge_mps", *span_of(table), text, _REMEDY, estimate)
