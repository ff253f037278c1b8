"""The ship's motion from samples at any rate, with its uncertainty: a Kalman smoother over all six channels.

Every sample is used at its own time; channels may have different and irregular rates and gaps, and any of the
velocities may be absent. Noise and jerk are estimated from the data and the states are described in
:mod:`.motion_model`; outliers are rejected and flagged (:mod:`.kalman`).

Consistency of the uncertainty: innovations of a correct filter are white with the predicted variance: the mean
of their normalised squares (NIS) is 1 within chi-square bounds, and 95 % of them lie within 1.96 (Bar-Shalom,
Li and Kirubarajan 2001, section 5.4). Those of real recordings are correlated, so the bounds come from the
scatter of block means, which counts the independent ones.

Systematic errors are not noise: a speed that is 2 % low, or a delayed position, is not corrected here. It shows
in the consistency; check and repair a recording first.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.special import gammaincinv  # scipy.stats would take longer to import than all else here

from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.acquisition.core.ship import POSE, wrap_360
from seatrial.analysis.estimation import motion_model
from seatrial.analysis.estimation.kalman import Engine, Gate, smooth_steps
from seatrial.analysis.tables import export, resample
from seatrial.analysis.tables import table as tables

if TYPE_CHECKING:
    from xarray import Dataset

_BLOCKS = 20
_NORMAL_95 = 1.959964
_HARMLESS = (0.816, 1.170)  # NIS at which bands of 95 % hold 97 and 93 %: (1.960 / 2.170)^2, (1.960 / 1.812)^2
_UNITS = {"m": "m", "deg": "deg", "mps": "m/s", "dps": "deg/s", "mps2": "m/s2", "dps2": "deg/s2"}
_CHANNELS_OF = {
    "heading_rad": ("heading_deg",),
    "yaw_rate_radps": ("yaw_rate_dps",),
    "position_m": ("north_m", "east_m"),
    "speed_mps": ("surge_mps", "sway_mps"),
    "yaw_jerk": ("heading_deg", "yaw_rate_dps"),
    "jerk": ("north_m", "east_m", "surge_mps", "sway_mps"),
}
"""The channels of each level of :class:`.motion_model.NoiseLevels`."""

COVARIANCE_NAMES = tuple(
    f"cov_{first}_{second}"
    for row, first in enumerate(motion_model.BODY[:6])
    for second in motion_model.BODY[row:6]
)
"""The 21 distinct elements of the covariance of pose and velocity, row by row of its upper triangle."""

_RESTART_S = 300.0  # the covariance grows with the fifth power of time: beyond this there is no information left
_BLOCK_STEPS, _OVERLAP_STEPS = 6_000, 400
_IN_DEGREES = np.array([name in ("heading_deg", "yaw_rate_dps", "yaw_dps2") for name in motion_model.BODY])


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
        return self.low <= self.nis <= self.high


def _consistency_by_channel(
    time_s: Floats, innovation: Floats, deviation: Floats, refused: Bools
) -> dict[str, ChannelConsistency]:
    """Compare innovations [steps, channels] with their standard deviations, by channel; rejected ones are counted
    and left out. A channel without samples is absent."""
    consistencies = {}
    for number, name in enumerate(motion_model.CHANNELS):
        valid = np.isfinite(innovation[:, number])
        used = valid & ~refused[:, number] & (time_s > time_s[0] + 10.0)
        if used.sum() < 2 * _BLOCKS:
            continue
        ratio = innovation[used, number] / deviation[used, number]
        nis = ratio**2
        mean = float(nis.mean())
        means = np.array([block.mean() for block in np.array_split(nis, _BLOCKS)])
        scatter = float(means.var(ddof=1)) / _BLOCKS
        independent = min(float(nis.size), 2.0 * mean**2 / scatter) if scatter > 0 else float(nis.size)
        independent = max(independent, 1.0)
        low, high = (2.0 * float(gammaincinv(0.5 * independent, p)) / independent for p in (0.025, 0.975))
        inside, outliers = float((np.abs(ratio) <= _NORMAL_95).mean()), int((valid & refused[:, number]).sum())
        consistencies[name] = ChannelConsistency(mean, low, high, inside, int(nis.size), independent, outliers)
    return consistencies


@dataclass(frozen=True, slots=True)
class SmoothedMotion:
    """The motion on whole multiples of 1 / rate in UTC.

    ``states`` [rows] has the columns :data:`.motion_model.BODY`: pose and velocity in the units of the
    channels, and the rates of change of surge, sway [m/s2] and yaw rate [deg/s2]. ``covariance`` [rows, 9, 9] is
    theirs in the same order in SI, angles in radians. ``slow`` is the same as ``states`` without the swing in
    waves, and the same altogether where the data show none. Rows inside long gaps are NaN. ``rejected``
    has the index of the table it was made from and a column for each motion channel, true where a sample was
    refused.
    """

    states: pd.DataFrame
    covariance: Floats
    slow: pd.DataFrame
    noise: motion_model.NoiseLevels
    rejected: pd.DataFrame
    consistency: Mapping[str, ChannelConsistency]

    @property
    def remarks(self) -> tuple[str, ...]:
        """One line for each channel with doubtful uncertainties: NIS well out of its bounds, or a level at a bound.

        With six channels one in four good recordings has one just outside its 95 % bounds, and a long recording
        distinguishes a NIS of 0.97 from 1: deviations that leave 95 % bands between 93 and 97 % are not reported.
        """
        lines = []
        for name, channel in self.consistency.items():
            doubts = []
            if not channel.consistent and not _HARMLESS[0] <= channel.nis <= _HARMLESS[1]:
                bands = "too narrow" if channel.nis > channel.high else "too wide"
                bounds = f"{channel.low:.2f} to {channel.high:.2f}"
                doubts.append(f"bands {bands}: mean normalised squared error {channel.nis:.2f}, expected {bounds}")
            ends = [level for level in self.noise.channels_at_bounds if name in _CHANNELS_OF[level]]
            doubts += [f"the noise level {level} could not be determined" for level in ends]
            if doubts:
                lines.append(f"{name}: {'; '.join(doubts)}")
        return tuple(lines)

    def standard_deviations(self) -> pd.DataFrame:
        """The standard deviation of each state, in the unit of its column.

        NaN where rounding leaves no positive variance: before the first sample of a channel whose noise is some
        1e-5 of its prior uncertainty, such as a model's position from cameras.
        """
        variance = np.diagonal(self.covariance, axis1=1, axis2=2)
        deviation = np.sqrt(np.where(variance < 0.0, np.nan, variance))
        factor = np.where(_IN_DEGREES, 180.0 / np.pi, 1.0)
        return pd.DataFrame(deviation * factor, index=self.states.index, columns=list(motion_model.BODY))

    def to_xarray(self) -> Dataset:
        """The states [time], UTC, and their covariance [time, state, other_state] in SI, angles in radians.

        ``attrs`` holds the run sheet of the trial as JSON text. Raises :class:`ConfigurationError` without xarray.
        """
        names = [str(name) for name in self.states]
        variables: dict[str, tuple[tuple[str, ...], Any]] = {
            name: (("time",), self.states[name].to_numpy()) for name in names
        }
        variables["covariance"] = (("time", "state", "other_state"), self.covariance)
        times = pd.DatetimeIndex(self.states.index).tz_convert(None)
        return export.as_dataset(
            variables,
            {"time": times.to_numpy(), "state": names, "other_state": names},
            {"rate_hz": self.states.attrs["rate_hz"], "trial": json.dumps(self.states.attrs.get("trial", {}))},
        )

    def covariance_columns(self) -> pd.DataFrame:
        """The 21 distinct elements of the covariance of pose and velocity [rows], SI and radians."""
        upper = np.triu_indices(6)
        return pd.DataFrame(
            self.covariance[:, upper[0], upper[1]], index=self.states.index, columns=list(COVARIANCE_NAMES)
        )


def smooth(
    table: pd.DataFrame,
    rate_hz: float = 1.0,
    *,
    longest_gap_s: float | None = None,
    levels: motion_model.NoiseLevels | None = None,
    gate: Gate | None = None,
    engine: Engine = "auto",
) -> SmoothedMotion:
    """Smooth the raw samples of a table and give the motion ``rate_hz`` times a second.

    Rows may be unsorted and hold NaN where a channel has no sample. Rows further inside a gap in which neither
    heading nor yaw rate, or neither position nor speed, has a sample for longer than ``longest_gap_s`` are NaN;
    without it the limit is that of :func:`seatrial.analysis.tables.resample.resample`. With a long limit they hold
    the prediction with its grown covariance, up to 300 s, beyond which the filter restarts. ``levels`` gives
    noise levels that are known; else they are estimated. Raises :class:`InputError` for a table without position or
    heading.
    """
    tables.require(table, POSE)
    times = tables.times_ns(table)[np.isfinite(motion_model.motion_values(table)).any(axis=1)]
    tables.require_plausible_span(
        int(times.min()), int(times.max()), [times], str(table.attrs.get("recording", ""))
    )
    rules = gate or Gate()
    data = motion_model.combine_into_steps(table)
    noise = levels or motion_model.estimate_noise_levels(data, rules)
    first_ns, last_ns = (data.epoch_ns + round(float(time_s) * tables.NANO) for time_s in data.time_s[[0, -1]])
    grid_ns = resample.grid(first_ns, last_ns, resample.rate_fraction(rate_hz))
    grid_s = (grid_ns - data.epoch_ns) / tables.NANO
    motion, slow = np.full((2, grid_s.size, 9), np.nan)
    spread = np.full((grid_s.size, 9, 9), np.nan)
    parts, yaw, everything = [], noise.heading_model, noise.motion_model
    sums = everything.summing_matrix
    for first, last, core in _overlapping_blocks(data.time_s):
        part = data.part(first, last)
        begin = motion_model.initial_state(part)
        steps = motion_model.heading_steps(part, noise.heading_rad, noise.yaw_rate_radps).for_model(yaw)
        heading = smooth_steps(steps, begin.for_model(yaw), yaw, rules, engine)  # by itself, then all about it
        steps = motion_model.motion_steps(part, heading.mean @ yaw.summing_matrix[0], noise.by_channel).for_model(
            everything
        )
        track = smooth_steps(steps, begin.for_model(everything), everything, rules, engine)
        inside, filtered = slice(core.start - first, core.stop - first), track.filtered
        means = track.mean[inside] @ sums.T
        parts.append((filtered.innovation[inside], filtered.deviation[inside], filtered.refused[inside], means))
        # The time of the block's core: until the next step's, or just past the last one's.
        until_s = data.time_s[core.stop] if core.stop < last else np.nextafter(data.time_s[last - 1] + 1e-6, np.inf)
        rows = slice(*np.searchsorted(grid_s, [data.time_s[core.start], until_s]))
        mean, covariance = track.interpolate_states(grid_s[rows])
        motion[rows] = motion_model.body_states_of_filter_states(mean @ sums.T)
        spread[rows] = motion_model.body_covariance(mean @ sums.T, sums @ covariance @ sums.T)
        slow[rows] = motion_model.body_states_of_filter_states((mean * everything.may_jump) @ sums.T)
    innovation, deviation, refused, means = map(np.concatenate, zip(*parts, strict=True))
    in_gap = motion_model.gap_mask(table, data.epoch_ns, grid_s, longest_gap_s)
    for values in (motion, spread, slow):
        values[in_gap] = np.nan
    return SmoothedMotion(
        _states_as_table(motion, grid_ns, rate_hz, table),
        spread,
        _states_as_table(slow, grid_ns, rate_hz, table),
        noise,
        _rejected_samples(table, data, np.sqrt(rules.limit) * noise.by_channel, refused, means),
        _consistency_by_channel(data.time_s, innovation, deviation, refused),
    )


def _states_as_table(mean: Floats, grid_ns: Ints, rate_hz: float, table: pd.DataFrame) -> pd.DataFrame:
    values = np.where(_IN_DEGREES, np.rad2deg(mean), mean)
    states = pd.DataFrame(values, index=tables.index_of(grid_ns), columns=list(motion_model.BODY))
    states["heading_deg"] = wrap_360(states["heading_deg"])
    states.attrs = {**table.attrs, "rate_hz": float(rate_hz)}
    return tables.add_step(states, "smooth", rate_hz=float(rate_hz))


def _overlapping_blocks(time_s: Floats) -> Iterator[tuple[int, int, slice]]:
    """Stretches between long gaps, in overlapping blocks, so that memory stays bounded: the first step and one past
    the last that are smoothed together, and those whose results are used."""
    edges = [0, *(np.flatnonzero(np.diff(time_s) > _RESTART_S) + 1).tolist(), time_s.size]
    for first, last in itertools.pairwise(edges):
        for core in range(first, last, _BLOCK_STEPS):
            begin, end = max(core - _OVERLAP_STEPS, first), min(core + _BLOCK_STEPS + _OVERLAP_STEPS, last)
            yield begin, end, slice(core, min(core + _BLOCK_STEPS, last))


def _rejected_samples(
    table: pd.DataFrame, data: motion_model.MotionSamples, limit: Floats, refused_steps: Bools, means: Floats
) -> pd.DataFrame:
    """The rejected samples: those of a rejected step that are outliers themselves, or all if none is.

    An outlier is off the smoothed state ``means`` [steps, 9], moved to its own time, by more than its channel's
    ``limit`` [channels].
    """
    flags = np.zeros((len(table), len(motion_model.CHANNELS)), dtype=bool)
    has_refusals: Bools = np.asarray(refused_steps.any(axis=1))
    rows = np.flatnonzero((data.step_of >= 0) & has_refusals[data.step_of])
    values, step = motion_model.motion_values(table.iloc[rows]), data.step_of[rows]
    refused = refused_steps[step] & np.isfinite(values)
    offset_s = ((tables.times_ns(table)[rows] - data.epoch_ns) / tables.NANO - data.time_s[step])[:, None]
    state, moved = means[step], means[step]
    moved[:, [0, 3, 6]] += offset_s * (state[:, [1, 4, 7]] + 0.5 * offset_s * state[:, [2, 5, 8]])
    moved[:, [1, 4, 7]] += offset_s * state[:, [2, 5, 8]]
    residual = (
        values
        - motion_model.body_states_of_filter_states(moved)[
            :, [motion_model.BODY.index(name) for name in motion_model.CHANNELS]
        ]
    )
    residual[:, motion_model.HEADING] = np.remainder(residual[:, motion_model.HEADING] + np.pi, 2 * np.pi) - np.pi
    is_outlier = np.abs(residual) > limit
    for channel in range(len(motion_model.CHANNELS)):
        outliers = refused[:, channel] & is_outlier[:, channel]
        explained = np.bincount(step[outliers], minlength=data.time_s.size) > 0
        flags[rows, channel] = outliers | (refused[:, channel] & ~explained[step])
    return pd.DataFrame(flags, index=table.index, columns=list(motion_model.CHANNELS))


def summarise_smoothing(smoothed: SmoothedMotion) -> dict[str, Any]:
    """The figures of a result for a reader or a program: rows, levels, refusals, consistency."""
    return {
        "rows": len(smoothed.states),
        "missing": int(smoothed.states["north_m"].isna().sum()),
        "noise": asdict(smoothed.noise),
        "rejected": {str(name): int(count) for name, count in smoothed.rejected.sum().items()},
        "consistency": {
            name: asdict(channel) | {"consistent": channel.consistent}
            for name, channel in smoothed.consistency.items()
        },
    }


def write_smoothed(smoothed: SmoothedMotion, path: Path | str) -> None:
    """Write a result as Parquet: states, the standard deviation of each in its unit as
    ``<name>_sigma``, the 21 elements of the covariance of pose and velocity in SI, and the slow states.

    Units stand on the columns, the figures of :func:`summarise_smoothing` and the provenance in the metadata.
    Raises :class:`seatrial.acquisition.core.errors.StorageError` when the file cannot be written.
    """
    slow, deviations = smoothed.slow.add_prefix("slow_"), smoothed.standard_deviations()
    sigmas = deviations.add_suffix("_sigma")
    rows = pd.concat([smoothed.states, sigmas, smoothed.covariance_columns(), slow], axis=1)
    names = (*motion_model.BODY, *map(str, sigmas.columns), *map(str, slow.columns))
    units = {name: _UNITS[name.removesuffix("_sigma").rsplit("_", 1)[1]] for name in names}
    provenance = tables.provenance_of(smoothed.states, {"rate_hz": smoothed.states.attrs["rate_hz"]})
    figures = {
        "smoothing": summarise_smoothing(smoothed),
        "history": provenance["history"],
        "provenance": provenance,
    }
    export.write_parquet(rows, path, units, {key: json.dumps(figure) for key, figure in figures.items()})
