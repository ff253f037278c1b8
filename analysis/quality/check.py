"""What is wrong with a recording: every channel by itself, its times, then the channels against each other.

Findings are grouped by their cause: what one outage or one source did to many channels is one thing to read, and to
correct. Findings of one code belong together where their channels share the places: silences that begin and end
together, whatever source each channel is from, as what is derived is silent with its inputs; other faults where
they come from one source in one stretch of time. The recorder's own event near an outage is quoted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core import errors, named_code
from seatrial.acquisition.core.quantities import Bools, Ints, Series
from seatrial.acquisition.core.result import Result
from seatrial.acquisition.core.ship import BY_NAME, channels_by_name_of, possible_channels_of_table, wrap_to_range
from seatrial.acquisition.core.trial import Quality
from seatrial.acquisition.recording.reader import Event, Recording, events_of_recording
from seatrial.analysis.quality import channel_checks, controls, situations, time_checks
from seatrial.analysis.quality import findings as quality
from seatrial.analysis.quality.motion.findings import check_motion
from seatrial.analysis.quality.motion.model import fit_coarsely
from seatrial.analysis.quality.wind import check_wind
from seatrial.analysis.series import ASSUMED, Stretch, expected_rates, rows_of_samples, series_from_values
from seatrial.analysis.tables import table as tables

CHECKS: tuple[quality.Check, ...] = (
    check_motion, channel_checks.check_heading_wrap, controls.check_orders, controls.check_thruster_feedback,
    controls.check_exchanged_feedback, controls.check_helm_sign, controls.check_shaft_sign,
    channel_checks.check_repeats, check_wind, situations.check_situations,
)  # fmt: skip
"""The checks across channels. Each gets the joined table with impossible values taken out."""

SEVERITY = ("time_outlier", "clock_jump", "alternating_levels", "time_backwards", "out_of_range", "feedback_frozen",
           "percent_scaled", "feedback_exchanged", "marked_suspect",
           "motion_contradiction", "helm_sign", "shaft_sign", "stuck", "position_jump", "heading_wrap_interpolated",
           "speed_scale", "yaw_rate_scale", "channel_delay", "position_time_jitter", "heading_time_jitter",
           "heading_offset", "yaw_rate_bias", "position_offset", "wind_apparent", "wind_direction_offset",
           "order_interpolated", channel_checks.REPEATED, "ship_held", "ship_towed", "spike", "gap", "quantised",
           "time_jitter", "duplicate")  # fmt: skip
"""Codes of findings, the most severe first; others come last."""

_PAIRS = {"north_m": "east_m", "east_m": "north_m", "surge_mps": "sway_mps", "sway_mps": "surge_mps"}
_WINDS = (("wind_direction_deg", "wind_speed_mps"), ("apparent_wind_angle_deg", "apparent_wind_speed_mps"))
_SPIKES_BY = frozenset({"heading_wrap_interpolated", "position_time_jitter", "heading_time_jitter"})
_FINDINGS_BY = {"stuck": frozenset({"feedback_frozen"})}
"""What explains spikes, sample by sample, and findings of one channel altogether."""
_FEW_STRAY = 0.05
"""The share of samples that may be stamped outside a recording for certain to be the wrong ones."""
_PRECEDENCE = (Quality.NOT_EVALUATED, Quality.GOOD, Quality.SUSPECT, Quality.BAD, Quality.MISSING)
_RANK = np.zeros(max(_PRECEDENCE) + 1, dtype=np.uint8)
_RANK[[*_PRECEDENCE]] = np.arange(len(_PRECEDENCE))
_FEW_OUTSIDE = 0.01
_NEAR_A_UNIT = 0.1
_OF_TIME = frozenset({"gap", "duplicate", "time_backwards", "time_jitter", "stuck", "clock_jump"})
"""Codes of what a source does to all of its channels at once; other faults are the channel's own, unless they are
of the very same samples."""
_SLACK_S = 3.0
"""Channels of one outage fall silent and come back within their intervals and what a source takes to start."""
_ALIKE = 0.7
"""The share of the time with a fault that two channels have in common, of the one with more."""
_EVENT_SLACK_S = 10.0
"""An event reports an outage up to that long after it: a silent source is noticed with a delay."""


@dataclass(frozen=True, slots=True, repr=False)
class DataQuality(Result):
    """The quality of a recording.

    ``flags`` has the index of the joined table and a column a channel, uint8: 1 good, 2 not evaluated, 3 suspect,
    4 bad, 9 missing. ``findings`` begin with the most severe. ``missing`` are the channels of a trial of this ship
    that the recording lacks altogether, which no check can judge, ``unevaluated`` what could not be judged for
    another reason. ``sources`` are those of each channel, ``events``
    the recording's log; ``causes`` are the findings by what they have in common.
    """

    channels: dict[str, channel_checks.ChannelQuality]
    findings: tuple[quality.Finding, ...]
    flags: pd.DataFrame
    missing: tuple[str, ...] = ()
    sources: Mapping[str, Sequence[str]] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    unevaluated: tuple[str, ...] = ()
    view = "seatrial.analysis.report.pages:quality_view"
    frame = "channels"
    drawing = "seatrial.analysis.report.pages:draw_flags"

    @property
    def marks(self) -> list[Event]:
        """The crew's marks, for axes of time."""
        return [event for event in self.events if event.kind == "mark"]

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The findings by cause, the most severe first."""
        gaps = {name: channel.gaps for name, channel in self.channels.items()}
        return group_findings_by_cause(self.findings, gaps, self.sources, self.events)

    def as_dict(self) -> dict[str, Any]:
        """The contract's object: channels by name, findings, the causes of these, the recording's events."""
        return {
            "channels": {name: channel.as_json() for name, channel in self.channels.items()},
            "findings": [finding.as_json() for finding in self.findings],
            "causes": [cause.as_json() for cause in self.causes],
            "events": [event.as_json() for event in self.events],
            "unevaluated": [*self.unevaluated],
        }


def check_recording(
    recording: Recording,
    table: pd.DataFrame | None = None,
    user_checks: Sequence[str] = (),
    progress: errors.Progress = lambda share: None,
) -> DataQuality:
    """Check a recording; ``table`` is its joined table if it is already made, ``user_checks`` are a user's checks.

    Raises :class:`DataShortageError` for a recording without channels.
    """
    joined = tables.table_of(recording) if table is None else table
    names = possible_channels_of_table(recording.series, joined.attrs)
    series = {name: recording.series[name] for name in names if name in recording.series}
    if any(step["step"] == "repair" for step in tables.history_of(joined)):  # what is suspect there, no source says
        plain = np.uint8(Quality.NOT_EVALUATED)
        series = {
            name: replace(samples, quality=np.where(samples.quality == Quality.SUSPECT, plain, samples.quality))
            for name, samples in series.items()
        }
    checked = _check_series(series, joined, user_checks, progress)
    return replace(checked, events=tuple(events_of_recording(recording)))


def check_table(table: pd.DataFrame, user_checks: Sequence[str] = ()) -> DataQuality:
    """Check a table of raw samples with a UTC index, its rows in the order of receipt; NaN is no sample.

    Columns that are no channels are passed over. ``flags`` have the table's rows. Raises :class:`InputError` for
    an index that is no time in UTC.
    """
    utc = table.set_axis(tables.utc_index(table), axis=0)
    columns = {
        name: utc[[name]].dropna() for name in possible_channels_of_table(utc.columns, utc.attrs) if name in utc
    }
    series = {
        name: series_from_values(tables.times_ns(column), column[name].to_numpy(dtype=float))
        for name, column in columns.items()
        if len(column)
    }
    order = np.argsort(tables.times_ns(utc), kind="stable")
    joined = utc.iloc[order][[*series]]
    joined.attrs = table.attrs
    checked = _check_series(series, joined, user_checks)
    flags = checked.flags.iloc[np.argsort(order, kind="stable")].set_axis(table.index, axis=0)
    return replace(checked, flags=flags)


def _check_series(
    series: Mapping[str, Series],
    joined: pd.DataFrame,
    user_checks: Sequence[str] = (),
    progress: errors.Progress = lambda share: None,
) -> DataQuality:
    """As :func:`_check_stretch`, of the recording proper; what is stamped years away from it is bad."""
    stamps = tables.times_ns(joined)
    first, last = tables.main_stretch(stamps) if stamps.size else (0, 0)
    inside = (stamps >= first) & (stamps <= last)
    if inside.all():
        return _check_stretch(series, joined, user_checks=user_checks, progress=progress)
    within = {name: (samples.measured_ns >= first) & (samples.measured_ns <= last)
              for name, samples in series.items()}  # fmt: skip
    parts = {name: samples.subset(within[name]) for name, samples in series.items() if within[name].any()}
    stray = {name: samples.measured_ns[~within[name]] for name, samples in series.items() if not within[name].all()}
    stray_ns = np.concatenate(list(stray.values()))
    distance_s = max(first - int(stray_ns.min()), int(stray_ns.max()) - last) / tables.NANO
    count, total = stray_ns.size, sum(samples.value.size for samples in series.values())
    finding = quality.Finding(
        "time_outlier", next(iter(stray)) if len(stray) == 1 else quality.ALL,
        quality.utc_timestamp(int(stray_ns.min())), quality.utc_timestamp(int(stray_ns.max())),
        f"{count:,} of {total:,} samples {'is' if count == 1 else 'are'} stamped "
        f"{tables.time_span_text(stray_ns)}, up to {distance_s / 86400:,.0f} days from the recording proper, "
        f"{tables.time_span_text(np.array([first, last]))}",
        "Look at the clock when recording began; --repair makes gaps of a few such samples",
        {"count": float(count), "seconds": distance_s},
        certain=count < _FEW_STRAY * total,  # a few are certain to be wrong, of two halves either may be
    )  # fmt: skip
    checked = _check_stretch(parts, joined[inside], (finding,), user_checks, progress)
    columns = joined[list(series)]
    flags = columns.notna().astype(np.uint8).replace({1: int(Quality.BAD), 0: int(Quality.MISSING)})
    flags.loc[inside, list(parts)] = checked.flags.to_numpy()
    channels = {name: replace(channel, count=series[name].value.size) for name, channel in checked.channels.items()}
    return replace(checked, channels=channels, flags=flags)


def _check_stretch(
    series: Mapping[str, Series],
    joined: pd.DataFrame,
    earlier_findings: tuple[quality.Finding, ...] = (),
    user_checks: Sequence[str] = (),
    progress: errors.Progress = lambda share: None,
) -> DataQuality:
    """All checks of one stretch of time. ``user_checks`` are those of a user by name."""
    stamps = tables.times_ns(joined)
    bounds = (int(stamps[0]), int(stamps[-1])) if stamps.size else None
    rates, sources = expected_rates(joined), joined.attrs.get("sources", {})
    channels = channels_by_name_of(joined.attrs)
    checks = [*CHECKS, *map(load_user_check, user_checks)]
    steps = len(series) + len(checks)
    faults = {}
    for number, (name, samples) in enumerate(series.items()):
        progress(number / steps)
        faults[name] = channel_checks.find_channel_faults(
            channels[name], samples, rates.get(name), bounds, sources.get(name) == [ASSUMED]
        )
    _drop_spikes_of_faint_wind(faults)
    rows = {name: rows_of_samples(stamps, samples.measured_ns) for name, samples in series.items()}
    joined, possible = _correct_impossible(joined, faults, rows)
    results = []
    for number, check in enumerate(checks, len(series)):
        progress(number / steps)
        results.append(check(possible))
    across = tuple(finding for result in results for finding in result.findings)
    for result in results:
        explained = {finding.channel for finding in result.findings if finding.code in _SPIKES_BY}
        for name in explained & set(faults) & set(result.flags.columns):
            doubtful = np.isin(result.flags[name].to_numpy()[rows[name]], (Quality.SUSPECT, Quality.BAD))
            faults[name].masks["spike"][doubtful] = False
    jumps, jump_findings = time_checks.check_clocks(series, joined)
    alternations = channel_checks.alternation_findings(
        {name: fault.samples for name, fault in faults.items()}, channels
    )
    results += [
        quality.CheckResult(quality.uniform_flags(joined, [finding.channel], Quality.SUSPECT))
        for finding in alternations
    ]
    findings = [
        *earlier_findings, *across, *jump_findings, *alternations,
        *_findings_of_single_channels(faults, across, jumps)
    ]  # fmt: skip
    flags = _merge_all_flags(faults, rows, results, joined)
    qualities = {}
    for name, fault in faults.items():
        has_finding = any(
            finding.channel == quality.ALL
            or name in finding.channel
            or (finding.code not in quality.WORDING and _PAIRS.get(name, name) in finding.channel)
            for finding in findings
        )
        qualities[name] = fault.quality(has_finding, jumps)
    missing = tuple(name for name in tables.required_channels(joined) if name not in faults)
    ranks = {code: rank for rank, code in enumerate(SEVERITY)}
    findings.sort(key=lambda finding: (ranks.get(finding.code, len(ranks)), finding.start, finding.channel))
    unevaluated = tuple(result.unevaluated for result in results if result.unevaluated)
    return DataQuality(qualities, tuple(findings), flags, missing, sources, unevaluated=unevaluated)


def _drop_spikes_of_faint_wind(faults: Mapping[str, channel_checks.ChannelFaults]) -> None:
    """Remove spikes of the wind's direction in which the wind itself, as a vector, has none: a faint one turns at
    random."""
    for direction, speed in _WINDS:
        if direction not in faults or speed not in faults:
            continue
        angle, size = faults[direction].samples, faults[speed].samples
        if np.array_equal(angle.measured_ns, size.measured_ns):
            wind = tables.valid_values(size) * np.exp(1j * np.deg2rad(angle.value))
            parts = (replace(size, value=component) for component in (wind.real, wind.imag))
            jumps = np.any([channel_checks.find_spikes(part, BY_NAME[speed]) for part in parts], axis=0)
            faults[direction].masks["spike"][~jumps] = False


def _correct_impossible(
    joined: pd.DataFrame, faults: Mapping[str, channel_checks.ChannelFaults], rows: Mapping[str, Ints]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The table as recorded, and without values out of range, which would dominate every estimate.

    Where the heading shows that the yaw rate is in degrees per minute, none of its values is impossible, and the
    fault is withdrawn. Angles of the other convention are brought into the channel's.
    """
    fault = faults.get("yaw_rate_dps")
    if fault is not None and fault.masks["out_of_range"].mean() >= _FEW_OUTSIDE:
        outside, value = fault.masks["out_of_range"], joined["yaw_rate_dps"].to_numpy(copy=True)
        value[rows["yaw_rate_dps"][outside]] = fault.samples.value[outside]
        value[np.abs(value) >= tables.LARGEST_VALUE] = np.nan
        recorded = joined.assign(yaw_rate_dps=value)
        with suppress(errors.DataShortageError, errors.InputError):
            if abs(60.0 * abs(fit_coarsely(recorded).yaw_rate_factor) - 1.0) < _NEAR_A_UNIT:
                outside[:] = False
                joined = recorded
    if not any(fault.masks["out_of_range"].any() for fault in faults.values()):
        return joined, joined
    possible = joined.copy()
    for name, fault in faults.items():
        outside = fault.masks["out_of_range"]
        if outside.any():
            column = possible[name].to_numpy(copy=True)
            values = fault.samples.value[outside]
            column[rows[name][outside]] = wrap_to_range(fault.channel, values) if fault.other_convention else np.nan
            possible[name] = column
    possible.attrs = joined.attrs
    return joined, possible


def _findings_of_single_channels(
    faults: Mapping[str, channel_checks.ChannelFaults],
    across: tuple[quality.Finding, ...],
    jumps: list[time_checks.ClockJump],
) -> list[quality.Finding]:
    """Findings of the checks of one channel, without those that a finding across channels explains."""
    jumped = {(jump.start_ns, jump.end_ns) for jump in jumps}
    channels, findings = {name: fault.channel for name, fault in faults.items()}, list[quality.Finding]()
    contradicted = {finding.channel for finding in across if finding.code == "motion_contradiction"}
    in_other_convention = {name for name, fault in faults.items() if fault.other_convention} - contradicted
    for code in quality.WORDING:
        explained = {finding.channel for finding in across if finding.code in _FINDINGS_BY.get(code, ())}
        stretches = {
            name: [stretch for stretch in fault.stretches(code) if (stretch.start_ns, stretch.end_ns) not in jumped]
            for name, fault in faults.items()
            if name not in explained
        }
        for finding in quality.findings_of_code(code, stretches, channels):
            if code == "out_of_range" and finding.channel in in_other_convention:  # which makes a repair certain
                range_text = "-180..180" if channels[finding.channel].low < 0.0 else "0..360"
                count = finding.estimate["count"]
                lie = "sample lies" if count == 1 else "samples lie"
                text = (
                    f"{finding.channel} counts otherwise than {range_text}, which is the convention: {count:,.0f} "
                    f"{lie} beyond, the first at {finding.start:%H:%M:%S}"
                )
                remedy = "--repair turns them into it; give the convention to what imports or decodes them"
                estimate = {**finding.estimate, quality.OTHER_TURN: 1.0}
                finding = replace(finding, text=text, remedy=remedy, estimate=estimate)
            findings.append(finding)
    return findings


def _merge_all_flags(
    faults: Mapping[str, channel_checks.ChannelFaults],
    rows: Mapping[str, Ints],
    results: list[quality.CheckResult],
    joined: pd.DataFrame,
) -> pd.DataFrame:
    """The most severe flag of all checks on the rows of the joined table; what was evaluated counts more than what
    was not."""
    columns = {}
    for name, fault in faults.items():
        column = np.full(len(joined), Quality.MISSING, dtype=np.uint8)
        column[rows[name]] = fault.flags()
        present: Bools = joined[name].notna().to_numpy() if name in joined else np.zeros(len(joined), dtype=bool)
        for result in results:
            if name in result.flags:
                flags = result.flags[name].to_numpy(np.uint8)
                column = np.where(present & (_RANK[flags] > _RANK[column]), flags, column)
        columns[name] = column
    return pd.DataFrame(columns, index=joined.index)


def load_user_check(name: str) -> quality.Check:
    """The check of that name: ``FILE.py:FUNCTION``, or an entry point of ``seatrial.checks``.

    The function takes the joined table (UTC index, a column a channel, impossible values taken out) and returns
    :class:`Finding`s, or a :class:`CheckResult` with flags. One that fails is a finding itself, ``check_failed``.
    Raises :class:`ConfigurationError` for what is not there or no such function.
    """
    function = named_code.load(name, "checks")
    named_code.require_signature(function, name, "table")

    def check(table: pd.DataFrame) -> quality.CheckResult:
        index = tables.utc_index(table)
        try:
            with named_code.report_user_code_errors(name, named_code.defining_file(function)):
                returned: object = function(table.copy())
                if isinstance(returned, quality.CheckResult):
                    return returned
                findings = tuple(returned) if isinstance(returned, Iterable) else (returned,)
                if not all(isinstance(finding, quality.Finding) for finding in findings):
                    kind = type(returned).__name__
                    raise TypeError(
                        f"it returned a {kind}, not a list of seatrial.analysis.quality.findings.Finding"
                    )
                return quality.CheckResult(quality.uniform_flags(table), findings)
        except named_code.UserCodeError as error:
            failed = quality.Finding("check_failed", "", index[0], index[-1], str(error))
            return quality.CheckResult(quality.uniform_flags(table), (failed,))

    return check


@dataclass(frozen=True, slots=True)
class Cause:
    """Findings of one cause, the most severe first, with their channels, the lines that these come from, and what
    the recorder itself reported of it."""

    findings: tuple[quality.Finding, ...]
    channels: tuple[str, ...]
    sources: tuple[str, ...] = ()
    events: tuple[str, ...] = ()

    @property
    def code(self) -> str:
        return self.findings[0].code

    @property
    def span(self) -> tuple[pd.Timestamp, pd.Timestamp]:
        """From the first beginning to the last end."""
        return min(finding.start for finding in self.findings), max(finding.end for finding in self.findings)

    @property
    def text(self) -> str:
        """All of it as one paragraph: the first finding's text, the channels, the events, what to do."""
        first = self.findings[0]
        shared_text = ""
        if len(self.findings) > 1:
            of_sources = f" of {', '.join(self.sources)}" if self.sources else ""
            remaining = [name for name in self.channels if name != first.channel]
            channels = f"{len(remaining)} other channel{'s' * (len(remaining) > 1)}"
            shared_text = f". The same holds for {channels}{of_sources}: {', '.join(remaining)}"
        quotation = f'. The recorder said: "{"; ".join(self.events)}"' if self.events else ""
        remedy = f" {first.remedy.rstrip('.')}." if first.remedy else ""
        return f"{first.text.rstrip('.')}{shared_text}{quotation}.{remedy}"

    def as_json(self) -> dict[str, Any]:
        """The cause as an object; its findings stand in ``findings`` of the whole."""
        start, end = self.span
        return {
            "code": self.code, "channels": list(self.channels), "sources": list(self.sources),
            "start": start.isoformat(), "end": end.isoformat(), "findings": len(self.findings),
            "events": list(self.events), "text": self.text,
        }  # fmt: skip


def group_findings_by_cause(
    findings: Sequence[quality.Finding],
    gaps: Mapping[str, Sequence[Stretch]],
    sources: Mapping[str, Sequence[str]],
    events: Iterable[Event] = (),
) -> tuple[Cause, ...]:
    """The causes of findings, in the order of their first ones.

    ``gaps`` and ``sources`` are those of each channel, ``events`` the recording's log, of which a cause quotes the
    first two entries and the last on its sources, or of the recorder, in its stretches of time.
    """
    groups: list[list[quality.Finding]] = []
    for finding in findings:
        match = next((group for group in groups if _have_same_cause(finding, group[0], gaps, sources)), None)
        if match is not None:
            match.append(finding)
        else:
            groups.append([finding])
    log = [event for event in events if event.level != "info" and event.kind in ("source", "recorder")]
    slack_ns = int(_EVENT_SLACK_S * tables.NANO)
    causes = []
    for group in groups:
        channels = tuple(dict.fromkeys(finding.channel for finding in group))
        names = tuple(sorted({name for channel in channels for name in _source_names_of_channel(sources, channel)}))
        spans = [(gap.start_ns, gap.end_ns) for name in channels for gap in gaps.get(name, ())]
        if group[0].code != "gap":
            spans = []
        elif quality.ALL in channels:
            spans = [(finding.start.value, finding.end.value) for finding in group]
        texts = [
            event.text for event in log
            if event.source in ("", *names)
            and any(start <= event.time_ns <= end + slack_ns for start, end in spans)
        ]  # fmt: skip
        texts = texts if len(texts) <= 3 else [*texts[:2], texts[-1]]
        causes.append(Cause(tuple(group), channels, names, tuple(dict.fromkeys(texts))))
    return tuple(causes)


def _have_same_cause(
    finding: quality.Finding,
    member: quality.Finding,
    gaps: Mapping[str, Sequence[Stretch]],
    sources: Mapping[str, Sequence[str]],
) -> bool:
    if finding.code != member.code or quality.ALL in (finding.channel, member.channel):
        return False
    if finding.code == "gap":  # silent for most of the time in silences that begin and end together
        first, second = (gaps.get(channel, ()) for channel in (finding.channel, member.channel))
        slack_ns = _SLACK_S * tables.NANO
        together_s = sum(
            gap.seconds for gap in first
            if any(abs(gap.start_ns - silence.start_ns) <= slack_ns and abs(gap.end_ns - silence.end_ns) <= slack_ns
                   for silence in second)
        )  # fmt: skip
        longest_s = max(sum(gap.seconds for gap in silences) for silences in (first, second))
        return together_s > 0.0 and together_s >= _ALIKE * longest_s
    names = _source_names_of_channel(sources, finding.channel)
    if not names or names != _source_names_of_channel(sources, member.channel):
        return False
    if finding.code in _OF_TIME:  # what they have in common is most of the time of both
        common_s = (min(finding.end, member.end) - max(finding.start, member.start)).total_seconds()
        longest_s = max((part.end - part.start).total_seconds() for part in (finding, member))
        return common_s >= _ALIKE * longest_s - _SLACK_S
    # The same samples, as a position's in metres and in degrees are.
    counts = finding.estimate.get("count"), member.estimate.get("count")
    same_span = (finding.start, finding.end) == (member.start, member.end)
    return same_span and None not in counts and counts[0] == counts[1]


def _source_names_of_channel(sources: Mapping[str, Sequence[str]], channel: str) -> frozenset[str]:
    """The sources, or tables, that a channel's samples came from: a label's beginning."""
    return frozenset(
        label.partition("/")[0].partition(":")[0].partition(" ")[0] for label in sources.get(channel, ())
    )
