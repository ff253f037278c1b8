"""Values that alternate between two levels: two sources under one name, read in turn, as of two compasses.

Their mean points where neither does, and nothing else shows it: each value is possible, and the rate is twice what
it was. The steps from sample to sample are then of two kinds, far apart in size: those of the one quantity that
both measure, and those from one level to the other, which come in turn up and down and hardly differ from each
other. Noise, waves and manoeuvres fill what is between; a rudder that is thrown over and back stays over for some
samples; values that flicker between two neighbouring codes are no more than the channel's own step apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Series
from seatrial.acquisition.core.ship import Channel, difference, is_possible
from seatrial.analysis.quality.findings import Finding, utc_time
from seatrial.analysis.quality.repeated_values import EVERYDAY, everyday_resolution
from seatrial.analysis.quality.samples import sort_by_time

ALTERNATING = "alternating_levels"
_BLOCK = 64
"""Steps that are judged together: sources that take turns do so within seconds."""
_FEWEST_TURNS = 8
_FEWEST_STEPS = 16
_BETWEEN = (0.25, 0.75)
"""Steps of these shares of the distance belong to neither kind."""
_MOST_BETWEEN = 0.02
_EVEN = 0.12
"""The spread of the steps between the levels, as a share of the distance; of waves near half the rate it is 0.3."""
_RETURNS = 0.5
"""The share of turns with another right beside them: three in four where two sources come at random, none of a
rudder that stays over for three samples."""
_TO_AND_FRO = 0.85
"""The share of steps against the one before: two thirds of white noise."""
_RATES = ("deg/s", "m/s")
_SYMMETRIC = 0.1
"""Levels of a rate or speed that lie about zero, within this share of their distance, are waves at half the rate of
recording: two sources that measure the same rate differ by a constant from something that changes."""
_COARSEST = 20.0
"""Everyday resolutions that the levels are apart at least."""
_HALF_TURN_DEG = 150.0
"""Levels as far apart turn either way, by their noise."""


@dataclass(frozen=True, slots=True)
class AlternatingLevels:
    """Two levels at the place where they first come in turn, how often they do, and the samples [n] of the channel
    that lie on the upper one (1), the lower one (-1) or in no such part (0)."""

    lower: float
    upper: float
    separation: float
    turns: int
    side: Ints


def find_levels(samples: Series, channel: Channel) -> AlternatingLevels | None:
    """The two levels that the values of a channel alternate between; None where they do not."""
    places, _, values = sort_by_time(samples, channel)
    steps = np.diff(values)
    if steps.size < _FEWEST_STEPS:
        return None
    width = min(_BLOCK, steps.size)
    count = steps.size // width
    blocks = np.concatenate([steps[: count * width], steps[-width:]]).reshape(-1, width)  # the end is judged, too
    firsts = np.append(np.arange(count) * width, steps.size - width)
    separation = np.quantile(np.abs(blocks), 1.0 - 0.5 * _FEWEST_TURNS / _BLOCK, axis=1)
    alternate = _alternate(blocks, separation, channel)
    distance = float(np.median(separation[alternate])) if alternate.any() else 0.0
    alternate &= np.abs(separation - distance) < _EVEN * distance
    if (
        not alternate.any()
        or _is_own_step(values, distance, channel)
        or _is_oscillation(blocks, separation, alternate)
    ):
        return None
    side = np.zeros(samples.value.size, dtype=np.int64)
    for first in firsts[alternate][::-1]:
        inside = slice(first, first + width + 1)
        side[places[inside]] = sides = _sides(values[inside], distance, channel)
    lower, upper = (channel.wrapped(float(np.median(values[inside][sides == level]))) for level in (-1, 1))
    if channel.unit in _RATES and abs(lower + upper) < _SYMMETRIC * distance:
        return None
    turns = np.count_nonzero(np.diff(side[places]) != 0)
    return AlternatingLevels(lower, upper, distance, int(turns), side)


def _alternate(blocks: Floats, separation: Floats, channel: Channel) -> Bools:
    """Which blocks of steps [blocks, steps] alternate between two levels that are ``separation`` [blocks] apart."""
    size = np.abs(blocks) / np.maximum(separation, 1e-300)[:, np.newaxis]
    turns = size > _BETWEEN[1]
    enough = turns.sum(axis=1) >= _FEWEST_TURNS
    between = np.mean((size > _BETWEEN[0]) & ~turns, axis=1) <= _MOST_BETWEEN
    spread = np.array([1.4826 * np.median(np.abs(row[turn] - np.median(row[turn]))) if turn.any() else np.inf
                       for row, turn in zip(size, turns, strict=True)])  # fmt: skip
    balance = np.cumsum(np.sign(blocks) * turns, axis=1)
    either_way = channel.circular & (separation > _HALF_TURN_DEG)
    in_turn = (np.ptp(np.pad(balance, ((0, 0), (1, 0))), axis=1) <= 1.0) | either_way
    neighbours = np.pad(turns, ((0, 0), (1, 1)))
    returning = (turns & (neighbours[:, :-2] | neighbours[:, 2:])).sum(axis=1) >= _RETURNS * turns.sum(axis=1)
    is_coarse = separation > _COARSEST * _resolution(channel)
    return np.asarray(enough & between & (spread <= _EVEN) & in_turn & returning & is_coarse)


def _is_oscillation(blocks: Floats, separation: Floats, alternate: Bools) -> bool:
    """Whether the steps of other blocks go up and down in turn as well, but by less: waves at half the rate of
    recording, whose size comes and goes, look like two levels while it is at its largest."""
    distance = float(np.median(separation[alternate]))
    to_and_fro = np.mean(blocks[:, 1:] * blocks[:, :-1] < 0.0, axis=1) > _TO_AND_FRO
    smaller = (separation > _BETWEEN[0] * distance) & (separation < (1.0 - _EVEN) * distance)
    return bool((to_and_fro & smaller & ~alternate).any())


def _resolution(channel: Channel) -> float:
    """The everyday resolution of a channel, of a declared one by its unit."""
    return EVERYDAY.get(channel.unit, 0.0) if channel.group == "declared" else everyday_resolution(channel)


def _is_own_step(values: Floats, separation: float, channel: Channel) -> bool:
    """Whether the levels are neighbours on the grid of the channel's values.

    A ship that lies still shows no values but two: they are no neighbours on a grid that counts from zero unless
    both are multiples of their distance; where a position's grid counts from is not known.
    """
    distances = np.diff(np.unique(values))
    if (distances < 0.5 * separation).any():
        return False
    from_grid = np.abs(values / separation - np.rint(values / separation))
    return channel.unit == "m" or bool(np.quantile(from_grid, 0.9) < 0.02)


def _sides(values: Floats, separation: float, channel: Channel) -> Ints:
    """On which level each of some values lies, by the turns between them: 1 the upper, -1 the lower."""
    turned = np.concatenate([[0], np.cumsum(np.abs(np.diff(values)) > _BETWEEN[1] * separation)]) % 2
    offset = difference(values, values[0]) if channel.circular else values
    odd, even = (np.median(offset[turned == which]) for which in (1, 0))
    return np.where(turned == (1 if odd > even else 0), 1, -1)


def alternation_findings(series: Mapping[str, Series], channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding for each channel that alternates between two levels, which names both and, if they are known, both
    sources."""
    detected = {
        name: find_levels(_values_in_range(samples, channels[name]), channels[name])
        for name, samples in series.items()
        if not channels[name].state
    }
    return [
        _finding(channels[name], series[name], levels) for name, levels in detected.items() if levels is not None
    ]


def _values_in_range(samples: Series, channel: Channel) -> Series:
    """The samples without the values that no such channel has, of which arithmetic makes no number."""
    return replace(samples, value=np.where(is_possible(channel, samples.value), samples.value, np.nan))


def _finding(channel: Channel, samples: Series, levels: AlternatingLevels) -> Finding:
    lower, upper = (_main_source(samples, levels.side == side) for side in (-1, 1))
    named = lower != upper and bool(lower and upper)
    of = (f" ({lower})", f" ({upper})") if named else ("", "")
    times = samples.measured_ns[levels.side != 0]
    text = (
        f"{channel.name} alternates between two levels, {levels.lower:.4g}{of[0]} and {levels.upper:.4g} "
        f"{channel.unit}{of[1]}, {levels.separation:.3g} {channel.unit} apart, {levels.turns:,} times: "
        f"two sources under one name"
    )
    remedy = "Record or import one of the sources alone; a mean of both is what neither measured"
    estimate = {
        "level": levels.lower,
        "other_level": levels.upper,
        "apart": levels.separation,
        "count": float(levels.turns),
    }
    ends = utc_time(int(times.min())), utc_time(int(times.max()))
    return Finding(ALTERNATING, channel.name, *ends, text, remedy, estimate)


def _main_source(samples: Series, chosen: Bools) -> str:
    """The source of most of the chosen samples; empty where it is not known."""
    index = samples.source_index[chosen]
    return samples.sources[int(np.bincount(index).argmax())] if index.size and samples.sources else ""
