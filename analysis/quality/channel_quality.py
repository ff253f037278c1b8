"""All checks of one channel together: its flags, its counts and its grade."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pandas as pd

from acquisition.core.arrays import Bools
from acquisition.core.channels import BY_NAME
from acquisition.core.frames import Quality, iso
from analysis.quality.channel_checks import (
    find_gaps,
    flag_out_of_range,
    flag_spikes,
    flag_time_backwards,
    is_other_convention,
)
from analysis.quality.findings import Flags
from analysis.quality.repeated_values import flag_stuck, quantisation_step
from analysis.quality.samples import ASSUMED, Stretch, interval_ns, stretches_of, times_of
from analysis.quality.time_checks import ClockJump, jitter_s
from analysis.tables.time_index import NANO

ASSUMED_SOURCES = list(ASSUMED)
Grade = Literal["good", "suspect", "bad"]
BAD_SHARE, SUSPECT_SHARE, JITTER_SHARE = 0.2, 0.01, 0.15


@dataclass(frozen=True, slots=True)
class ChannelQuality:
    """One channel in figures. ``gaps`` and ``stuck`` are stretches, the other faults are counted.

    ``flagged`` counts its samples by flag; ``missing`` is about how many samples the gaps lack.
    """

    count: int
    rate_hz: float
    gaps: tuple[Stretch, ...]
    stuck: tuple[Stretch, ...]
    spikes: int
    out_of_range: int
    duplicates: int
    time_backwards: int
    grade: Grade
    missing: int = 0
    flagged: dict[int, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The contract's keys."""
        return {
            "count": self.count,
            "rate_hz": self.rate_hz,
            "gaps": [{"start": iso(each.start_ns), "seconds": each.seconds} for each in self.gaps],
            "stuck": [{"start": iso(each.start_ns), "seconds": each.seconds} for each in self.stuck],
            "spikes": self.spikes,
            "out_of_range": self.out_of_range,
            "duplicates": self.duplicates,
            "time_backwards": self.time_backwards,
            "grade": self.grade,
        }


@dataclass(frozen=True, slots=True)
class ChannelFaults:
    """What the checks of one channel found: masks over its samples, stretches, sizes (0 where there is nothing)."""

    samples: pd.Series[Any]
    gaps: list[Stretch]
    stuck: Bools
    spikes: Bools
    out_of_range: Bools
    duplicates: Bools
    behind: Bools
    steps_back: list[Stretch]
    step: float
    jitter_s: float
    other_turn: bool = False
    """Whether what is out of range is an angle in the other convention."""

    def flags(self) -> Flags:
        """The graver flag of all checks, sample by sample; a value that its decoder called bad is bad."""
        flags = np.full(len(self.samples), Quality.GOOD, dtype=np.uint8)
        flags[self.duplicates | self.behind] = Quality.SUSPECT
        flags[self.stuck | self.spikes | self.out_of_range | self.samples.isna().to_numpy()] = Quality.BAD
        return flags

    def stretches(self, code: str) -> list[Stretch]:
        """Where the channel has this kind of trouble, sized in the unit that the finding speaks of."""
        if code in ("gap", "time_backwards"):
            return self.gaps if code == "gap" else self.steps_back
        if code in ("quantised", "time_jitter"):
            size = self.step if code == "quantised" else self.jitter_s
            times = times_of(self.samples)
            return [Stretch(int(times.min()), int(times.max()), size)] if size else []
        mask = {"stuck": self.stuck, "spike": self.spikes, "out_of_range": self.out_of_range,
                "duplicate": self.duplicates}[code]  # fmt: skip
        found = stretches_of(self.samples, mask)
        return [_sized(self.samples, each) for each in found] if code == "spike" else found

    def quality(self, named: bool, whole: pd.Series[Any], jumps: list[ClockJump]) -> ChannelQuality:
        """The channel in figures; ``named`` is whether a finding is about it."""
        times = times_of(self.samples)
        span_s = float(times.max() - times.min()) / NANO if times.size else 0.0
        flags, interval = self.flags(), interval_ns(times) / NANO
        jumped = {(jump.start_ns, jump.end_ns) for jump in jumps}
        silent_s = sum(each.size for each in self.gaps if (each.start_ns, each.end_ns) not in jumped)
        missing = round(silent_s / interval) if interval else 0
        kinds, counts = np.unique(flags, return_counts=True)
        flagged = {int(kind): int(count) for kind, count in zip(kinds, counts, strict=True)}
        return ChannelQuality(
            count=len(whole),
            rate_hz=(times.size - 1) / span_s if span_s > 0 else 0.0,
            gaps=tuple(self.gaps),
            stuck=tuple(self.stretches("stuck")),
            spikes=len(self.stretches("spike")),
            out_of_range=int(self.out_of_range.sum()),
            duplicates=int(self.duplicates.sum()),
            time_backwards=len(self.steps_back),
            grade=grade_of(flagged, missing, named),
            missing=missing,
            flagged=flagged,
        )


def channel_faults(
    samples: pd.Series[Any],
    whole: pd.Series[Any],
    rate: pd.Series[Any] | None = None,
    bounds_ns: tuple[int, int] | None = None,
    assumed: bool = False,
) -> ChannelFaults:
    """Every check of one channel. ``whole`` also has the values that its decoder flagged bad.

    ``rate`` is how fast related channels say that it changes, ``bounds_ns`` the recording's start and end.
    An assumed constant is neither stuck nor quantised.
    """
    channel, times = BY_NAME[str(samples.name)], times_of(samples)
    outside = flag_out_of_range(whole, channel) == Quality.BAD
    sound = samples.mask(outside)
    none = np.zeros(len(samples), dtype=bool)
    behind, steps_back = flag_time_backwards(samples)
    jitter = jitter_s(times)
    return ChannelFaults(
        samples=samples,
        gaps=find_gaps(samples, *(bounds_ns or (None, None))),
        stuck=none if assumed else flag_stuck(sound, channel, rate) == Quality.BAD,
        spikes=none.copy() if assumed else flag_spikes(sound, channel) == Quality.BAD,
        out_of_range=outside,
        duplicates=samples.index.duplicated(),
        behind=behind == Quality.SUSPECT,
        steps_back=steps_back,
        step=0.0 if assumed else quantisation_step(sound, channel),
        other_turn=is_other_convention(whole, channel),
        jitter_s=jitter if jitter * np.sqrt(2.0) * NANO > JITTER_SHARE * interval_ns(times) else 0.0,
    )


def grade_of(flagged: dict[int, int], missing: int, named: bool) -> Grade:
    """Bad if more than 20 % of the samples due are bad or missing; suspect if more than 1 % are not good, or if a
    finding names the channel; else good."""
    due = sum(flagged.values()) + missing
    lost = flagged.get(Quality.BAD, 0) + missing
    doubtful = lost + flagged.get(Quality.SUSPECT, 0)
    if not due or lost > BAD_SHARE * due:
        return "bad"
    return "suspect" if named or doubtful > SUSPECT_SHARE * due else "good"


def _sized(samples: pd.Series[Any], stretch: Stretch) -> Stretch:
    """A spike sized by how far it leaves what is around it [the channel's unit]."""
    channel, times = BY_NAME[str(samples.name)], times_of(samples)
    at = int(np.flatnonzero(times == stretch.start_ns)[0])
    near = samples.to_numpy(dtype=float)[max(at - 4, 0) : at + 7]
    turns = np.array([channel.wrapped(each) for each in near - near[min(at, 4)]])
    turns = np.where(turns > 180.0, turns - 360.0, turns) if channel.circular else turns
    return Stretch(stretch.start_ns, stretch.end_ns, abs(float(np.nanmedian(turns))))
