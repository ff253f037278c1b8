"""Is a smoother as sure as it says? Innovations against their predicted standard deviations.

Innovations of a filter that fits are white with the spread it predicts: the mean of their normalised squares
(NIS) is 1 within the bounds of a chi-square, and 95 % of them lie within 1.96 (Bar-Shalom, Li and Kirubarajan
2001, section 5.4). Those of real recordings follow each other; so their bounds come from the scatter of the
means of blocks, which counts what is independent.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from acquisition.core.arrays import Bools, Floats
from analysis.estimation.motion_model import CHANNELS

_BLOCKS = 20
_NORMAL_95 = 1.959964
_HARMLESS = (0.816, 1.170)  # NIS at which bands of 95 % hold 97 and 93 %: (1.960 / 2.170)^2, (1.960 / 1.812)^2


@dataclass(frozen=True, slots=True)
class ChannelConsistency:
    """A channel's mean NIS with the 95 % bounds it should lie in, and the share of innovations inside 95 %.

    ``independent`` is the number of independent innovations that the bounds count.
    """

    nis: float
    low: float
    high: float
    inside_95: float
    innovations: int
    independent: float
    refused: int

    @property
    def consistent(self) -> bool:
        """Whether the mean NIS lies in its bounds."""
        return self.low <= self.nis <= self.high


@dataclass(frozen=True, slots=True)
class Consistency:
    """Consistency channel by channel; a channel without samples is absent."""

    channels: Mapping[str, ChannelConsistency]

    def as_json(self) -> dict[str, dict[str, float]]:
        """The figures by channel."""
        return {name: asdict(each) | {"consistent": each.consistent} for name, each in self.channels.items()}


def consistency_of(time_s: Floats, innovation: Floats, deviation: Floats, refused: Bools) -> Consistency:
    """Judge innovations [steps, channels] by their standard deviations; refused ones are counted and left out."""
    judged = {}
    for number, name in enumerate(CHANNELS):
        there = np.isfinite(innovation[:, number])
        kept = there & ~refused[:, number] & (time_s > time_s[0] + 10.0)
        if kept.sum() >= 2 * _BLOCKS:
            ratio = innovation[kept, number] / deviation[kept, number]
            judged[name] = _judged(ratio, int((there & refused[:, number]).sum()))
    return Consistency(judged)


def _judged(ratio: Floats, refused: int) -> ChannelConsistency:
    from scipy.stats import chi2

    nis = ratio**2
    means = np.array([block.mean() for block in np.array_split(nis, _BLOCKS)])
    scatter = float(means.var(ddof=1)) / _BLOCKS
    independent = min(float(nis.size), 2.0 * float(nis.mean()) ** 2 / scatter) if scatter > 0 else float(nis.size)
    independent = max(independent, 1.0)
    low, high = (float(chi2.ppf(share, independent)) / independent for share in (0.025, 0.975))
    inside = float((np.abs(ratio) <= _NORMAL_95).mean())
    return ChannelConsistency(float(nis.mean()), low, high, inside, int(nis.size), independent, refused)


_CHANNELS_OF = {
    "heading_rad": ("heading_deg",),
    "yaw_rate_radps": ("yaw_rate_dps",),
    "position_m": ("north_m", "east_m"),
    "speed_mps": ("surge_mps", "sway_mps"),
    "yaw_jerk": ("heading_deg", "yaw_rate_dps"),
    "jerk": ("north_m", "east_m", "surge_mps", "sway_mps"),
}
"""Which channels a level of :class:`.noise_levels.NoiseLevels` speaks for."""


def remarks_of(consistency: Consistency, at_bounds: Collection[str]) -> tuple[str, ...]:
    """One line for each channel whose uncertainties are in doubt: NIS well out of its bounds, or a level at one.

    Of six channels one in four good recordings has one just out of its bounds of 95 %, and a long recording tells
    a NIS of 0.97 from 1: what would leave 95 % bands between 93 and 97 % is not worth a remark.
    ``at_bounds`` are names of levels, as :attr:`analysis.estimation.noise_levels.NoiseLevels.at_bounds` gives them.
    """
    lines = []
    for name, channel in consistency.channels.items():
        doubts = []
        if not channel.consistent and not _HARMLESS[0] <= channel.nis <= _HARMLESS[1]:
            bands = "too narrow" if channel.nis > channel.high else "too wide"
            doubts.append(f"bands {bands}: NIS {channel.nis:.2f}, expected {channel.low:.2f} to {channel.high:.2f}")
        ends = [level for level in at_bounds if name in _CHANNELS_OF[level]]
        doubts += [f"no level found: {level} ends where the search does" for level in ends]
        if doubts:
            lines.append(f"{name}: {'; '.join(doubts)}")
    return tuple(lines)
