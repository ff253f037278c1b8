"""Windows as arrays in SI units and radians: the input and the truth of every prediction method.

A method may use the start of a window (state, wind and controls at second 0), the measurements of the minute
before, and, for windows with any commands, these second by second. The measured track that follows is what its
prediction is compared with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.quantities import Bools, Floats, Ints, Strings
from seatrial.acquisition.core.ship import (
    DEFAULT,
    POSE_AND_VELOCITY,
    Actuators,
    control_names,
    trial_channel_names,
    unwrap,
)
from seatrial.analysis.tables.table import NANO, table_actuators
from seatrial.analysis.windows.held import OneHertzTables
from seatrial.hybrid.vessel.actuators import angle_columns, control_units
from seatrial.hybrid.vessel.black_box import MotionModel, RunIn
from seatrial.hybrid.vessel.sensors import HEADING, STATE_UNITS, WIND_UNITS, check_ship

WIND, CONTROLS = slice(6, 8), slice(8, None)
"""The columns of wind and controls among the channels of a window: after the state."""

PAST_S = 180
"""The seconds before its start that a window includes: enough to see whether a model from another day fits this
one."""
ENOUGH_RECORDINGS = 3


@dataclass(frozen=True, slots=True)
class PredictionWindows:
    """N windows of H seconds, arrays with N first.

    ``start`` [N, 6]: north, east [m], heading [rad], surge, sway [m/s], yaw rate [rad/s] at second 0, as it was
    known then: measured, or by the seconds before too (:func:`.filtered_starts`); ``two_sided`` [N, 6]: the same as
    it is known afterwards, by the seconds to either side, or None; ``track`` [N, H+1, 3]: measured north, east [m]
    and heading [rad] without jumps, second by second; ``wind`` [N, 2]: direction it comes
    from [rad], speed [m/s]; ``control`` [N, controls]: those of ``actuators`` in their order, in SI; ``trial``,
    ``leg`` [N] name where each window comes from and ``start_ns`` [N] is when it starts, in nanoseconds since 1970.

    ``past`` [N, P+1, channels] is what was measured at second 0 and at each of the P seconds before, newest first,
    as it was known at second 0: the six columns of ``start``, the two of ``wind``, those of ``control``; NaN where
    nothing was recorded. The heading has no jumps and meets that of ``track`` at second 0.

    ``truths`` [N, K, H+1, 2] are tracks by each of K sensors alone or combined, and ``truth_errors`` of the same
    shape the errors that such sensors make, both of :mod:`seatrial.hybrid.evaluation.validate`; None if not
    requested.

    A ``track`` may end in NaN: such windows are learned from, but not used for testing.

    ``commands`` [N, H, controls] are the controls over each second of the horizon, where they may be any; None
    where those of second 0 are held.
    """

    start: Floats
    track: Floats
    wind: Floats
    control: Floats
    trial: Strings
    leg: Strings
    start_ns: Ints
    past: Floats
    actuators: Actuators = DEFAULT
    commands: Floats | None = None
    two_sided: Floats | None = None
    truths: Floats | None = None
    truth_errors: Floats | None = None

    def __len__(self) -> int:
        return len(self.start)

    @property
    def start_time(self) -> pd.DatetimeIndex:
        """The start of each window [N], UTC."""
        return pd.DatetimeIndex(self.start_ns, tz="UTC")

    @property
    def horizon_s(self) -> int:
        """The length of the windows [s]."""
        return int(self.track.shape[1]) - 1

    @property
    def acting_controls(self) -> Floats:
        """The controls over each second of the horizon [N, H, controls], held or as commanded."""
        if self.commands is None:
            return np.repeat(self.control[:, None, :], self.horizon_s, axis=1)
        return self.commands

    @property
    def is_complete(self) -> Bools:
        """Mask [N] of the windows whose track is known to the end."""
        return np.asarray(np.isfinite(self.track[:, -1]).all(axis=1))

    def measured_seconds(self) -> tuple[Ints, Ints]:
        """The first and the last known second of each window [N], in seconds since 1970."""
        first = self.start_ns // NANO
        return first, first + np.isfinite(self.track[:, 1:, 0]).sum(axis=1)

    def subset(self, chosen: Bools | Ints) -> PredictionWindows:
        """The windows chosen by a mask or by indices."""
        return replace(self, **{name: values[chosen] for name, values in self.arrays_by_name().items()})

    def in_order_of(self, plant: MotionModel) -> PredictionWindows:
        """The windows with their controls in the order in which a model lists its ship's actuators.

        Raises :class:`InputError` for a model of a ship with other ones.
        """
        check_ship(self.actuators, plant)
        if self.actuators == plant.layout:
            return self
        names = control_names(self.actuators)
        order = np.array([names.index(name) for name in control_names(plant.layout)])
        past = np.concatenate([self.past[..., : CONTROLS.start], self.past[..., CONTROLS][..., order]], axis=-1)
        commands = None if self.commands is None else self.commands[..., order]
        return replace(self, control=self.control[..., order], past=past, commands=commands, actuators=plant.layout)

    def arrays_by_name(self) -> dict[str, Any]:
        """The arrays with a row for each window, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "actuators"}
        return {name: value for name, value in values.items() if value is not None}


def concatenate_windows(parts: Sequence[PredictionWindows]) -> PredictionWindows:
    """The windows of all parts, of one ship, concatenated."""
    arrays = [part.arrays_by_name() for part in parts]
    columns: dict[str, Any] = {name: np.concatenate([part[name] for part in arrays]) for name in arrays[0]}
    return replace(parts[0], **columns)


def windows_from_rows(
    rows: pd.DataFrame,
    motion: pd.DataFrame | None = None,
    tables: Mapping[str, OneHertzTables] | None = None,
    *,
    any_commands: bool = False,
) -> PredictionWindows:
    """Arrays from the long table of windows: one row for each window and second, second 0 first.

    ``tables`` by trial provide what came before; without them only second 0 is known. Windows start from the
    measurement at second 0; ``motion``, in the order of the windows' numbers, is the two-sided estimate. With
    ``any_commands`` the controls of all rows become the windows' commands; otherwise those of second 0 are
    held.

    Raises :class:`DataShortageError` if there is no window.
    """
    if rows.empty:
        raise DataShortageError(
            "no held windows", fix="lower --horizon, or record longer periods with steady controls"
        )
    ordered = rows.sort_values(["window", "second"], kind="stable")
    count = ordered["window"].nunique()
    actuators = table_actuators(rows)
    names = trial_channel_names(actuators)
    channels = ordered[list(names)].to_numpy(dtype=float).reshape(count, -1, len(names))
    first = ordered.groupby("window", sort=True).first()
    trial, leg = (first[name].to_numpy(dtype=str) for name in ("trial", "leg"))
    start_ns = pd.DatetimeIndex(first["start"]).as_unit("ns").asi8
    return windows_of_channels(
        channels, actuators, trial, leg, start_ns, motion, tables or {}, any_commands=any_commands
    )


def windows_of_channels(
    channels: Floats,
    actuators: Actuators,
    trial: Strings,
    leg: Strings,
    start_ns: Ints,
    motion: pd.DataFrame | None,
    tables: Mapping[str, OneHertzTables],
    *,
    any_commands: bool = False,
) -> PredictionWindows:
    """As :func:`windows_from_rows`, from ``channels`` [N, H+1, channels] in the order of
    :func:`.trial_channel_names` and in their own units, and the names of N windows."""
    heading = np.deg2rad(np.apply_along_axis(unwrap, 1, channels[..., HEADING]))
    track = np.concatenate([channels[..., :HEADING], heading[..., None]], axis=-1)
    units = np.concatenate([STATE_UNITS, WIND_UNITS, control_units(actuators)])
    past = np.full((len(channels), PAST_S + 1, len(units)), np.nan)
    past[:, 0] = channels[:, 0] * units
    for name, recorded in tables.items():
        in_trial = np.flatnonzero(trial == name)
        settled = np.arange(len(recorded.newest), PAST_S + 1)
        earlier = channel_rows_after_starts(recorded.table, start_ns[in_trial], -settled, actuators)
        past[np.ix_(in_trial, settled)] = earlier * units
        for second, table in enumerate(recorded.newest):
            row = channel_rows_after_starts(table, start_ns[in_trial], np.array([-second]), actuators)[:, 0]
            past[in_trial, second] = row * units
    turn = angle_difference_rad(past[:, :-1, HEADING], past[:, 1:, HEADING])
    past[:, 1:, HEADING] = past[:, :1, HEADING] - np.cumsum(turn, axis=1)
    past[..., HEADING] += np.round((track[:, :1, HEADING] - past[:, :1, HEADING]) / (2.0 * np.pi)) * 2.0 * np.pi
    two_sided = None
    if motion is not None:
        two_sided = motion[list(POSE_AND_VELOCITY)].to_numpy(dtype=float) * STATE_UNITS
        heading = track[:, 0, HEADING]
        two_sided[:, HEADING] = heading + angle_difference_rad(two_sided[:, HEADING], heading)
    return PredictionWindows(
        start=past[:, 0, : WIND.start].copy(), track=track, wind=past[:, 0, WIND], control=past[:, 0, CONTROLS],
        trial=trial, leg=leg, start_ns=start_ns, past=past, actuators=actuators,
        commands=mean_controls((channels * units)[..., CONTROLS], actuators) if any_commands else None,
        two_sided=two_sided,
    )  # fmt: skip


def mean_controls(settings: Floats, actuators: Actuators) -> Floats:
    """The mean controls [N, H, controls] over each second between ``settings`` [N, H+1, controls] in SI.

    Angles go the shorter way round.
    """
    change, angles = np.diff(settings, axis=1), angle_columns(actuators)
    change[..., angles] = angle_difference_rad(settings[:, 1:, angles], settings[:, :-1, angles])
    return np.asarray(settings[:, :-1] + 0.5 * change)


def channel_rows_after_starts(table: pd.DataFrame, start_ns: Ints, seconds: Ints, actuators: Actuators) -> Floats:
    """The rows of a table the given ``seconds`` after each start [N, seconds, channels] in the channels' own
    units; NaN where there are none."""
    row = row_numbers_after_starts(table, start_ns, seconds)
    columns = np.array([table.columns.get_loc(name) for name in trial_channel_names(actuators)])
    values = table.to_numpy(dtype=float)[row[..., None], columns]  # a tenth of the time of choosing columns first
    values[row < 0] = np.nan
    return np.asarray(values)


def row_numbers_after_starts(table: pd.DataFrame, start_ns: Ints, seconds: Ints) -> Ints:
    """The row number of a table the given ``seconds`` after each start [N, seconds]; -1 where there is none."""
    times_ns = pd.DatetimeIndex(table.index).as_unit("ns").asi8
    requested_ns = start_ns[:, None] + seconds * NANO
    row = np.searchsorted(times_ns, requested_ns).clip(max=len(times_ns) - 1)
    return np.where(times_ns[row] == requested_ns, row, -1)


def hindcast_windows(windows: PredictionWindows, *seconds: int, horizon_s: int | None = None) -> PredictionWindows:
    """Windows that start the given ``seconds`` earlier, with their recorded commands, and end at second 0 or
    after ``horizon_s``; for several such starts, which need a horizon, the windows are concatenated.

    NaN where the past was not recorded.
    """
    count, past_length = len(windows), windows.past.shape[1]
    columns = slice(None, None if horizon_s is None else horizon_s + 1)
    recorded = np.concatenate([windows.past[:, lead_s::-1][:, columns] for lead_s in seconds])
    past = np.full((len(recorded), *windows.past.shape[1:]), np.nan)
    for number, lead_s in enumerate(seconds):
        past[number * count : (number + 1) * count, : past_length - lead_s] = windows.past[:, lead_s:]
    bare = replace(windows, past=windows.past[:, :0], truths=None, truth_errors=None)
    return replace(
        bare if len(seconds) == 1 else bare.subset(np.tile(np.arange(count), len(seconds))),
        start=recorded[:, 0, :6],
        track=recorded[..., :3],
        wind=recorded[:, 0, WIND],
        control=recorded[:, 0, CONTROLS],
        past=past,
        commands=mean_controls(recorded[..., CONTROLS], windows.actuators),
    )


def seconds_without_gap(past: Floats) -> Ints:
    """How many seconds before second 0 of ``past`` [N, P+1, channels] have no gap, that second included [N]."""
    complete = np.isfinite(past).all(axis=2)
    return np.asarray((np.cumprod(complete, axis=1).sum(axis=1) - 1).clip(min=0))


def history_before_start(windows: PredictionWindows, seconds: int) -> RunIn:
    """What drove the ships of windows over the last ``seconds`` before their start, oldest first; where less is
    known, the earliest of it is held."""
    past = windows.past.copy()
    initial = np.concatenate([windows.start, windows.wind, windows.control], axis=1)
    past[:, 0] = np.where(np.isfinite(past[:, 0]), past[:, 0], initial)
    row = np.minimum(np.arange(seconds, -1, -1), seconds_without_gap(past)[:, None])
    known = past[np.arange(len(past))[:, None], row]
    controls = mean_controls(known[..., CONTROLS], windows.actuators)
    return RunIn(controls, known[:, 1:, WIND], known[:, :-1, HEADING])


def angle_difference_rad(angle: Floats, subtracted: Floats) -> Floats:
    """``angle - subtracted`` the short way round, in radians."""
    return np.asarray(np.angle(np.exp(1j * (angle - subtracted))))


def replace_by_two_sided_starts(windows: PredictionWindows) -> PredictionWindows:
    """The windows with their two-sided start states."""
    return replace(windows, start=windows.start if windows.two_sided is None else windows.two_sided)


def draw_groups(groups: Strings, share: float, seed: int) -> Bools:
    """A mask of windows, by whole groups (legs, recordings) and never by row, that holds about ``share`` of
    them.

    Groups are drawn at random, at least one and never all. Raises :class:`DataShortageError` if there is only
    one group.
    """
    names, counts = np.unique(groups, return_counts=True)
    if len(names) < 2:
        raise DataShortageError(
            f"only one leg ({names[0] if len(names) else 'none'}), which cannot be split",
            fix="give more recordings, or longer ones with more periods of steady controls",
        )
    target = share * len(groups)
    held_out: list[int] = []
    taken = 0
    for group in np.random.default_rng(seed).permutation(len(names)):
        fits = taken + counts[group] <= 1.25 * target  # so that one long leg does not take half of the windows
        if fits and taken < target and len(held_out) < len(names) - 1:
            held_out.append(int(group))
            taken += int(counts[group])
    return np.isin(groups, names[held_out or [int(np.argmin(counts))]])


def draw_windows(windows: PredictionWindows, groups: Strings, share: float, seed: int) -> Bools:
    """The windows [N] of ``groups`` [N] drawn by :func:`draw_groups` to hold that share of the whole ones."""
    complete = windows.is_complete
    return np.isin(groups, groups[complete][draw_groups(groups[complete], share, seed)])


def held_out_group_names(windows: PredictionWindows) -> Strings:
    """The names [N] of the groups that are held out whole when a method is tested.

    These are legs if thrusters were held. With any commands one leg passes into the next, on the same day in
    the same wind, so recordings are held out whole, if there are :data:`ENOUGH_RECORDINGS`.
    """
    by_recording = windows.commands is not None and len(np.unique(windows.trial)) >= ENOUGH_RECORDINGS
    return windows.trial if by_recording else windows.leg


def drop_overlapping_windows(windows: PredictionWindows, chosen: Bools, excluded: Bools) -> Bools:
    """The ``chosen`` windows [N] that share no second with any of the ``excluded`` [N] of their recording."""
    first, last = windows.measured_seconds()
    clear = chosen.copy()
    for trial in np.unique(windows.trial[excluded]):
        candidates, conflicting = chosen & (windows.trial == trial), excluded & (windows.trial == trial)
        order = np.argsort(first[conflicting], kind="stable")
        ends = np.append(np.iinfo(np.int64).min, np.maximum.accumulate(last[conflicting][order]))
        begun = np.searchsorted(first[conflicting][order], last[candidates], side="right")
        clear[candidates] = ends[begun] < first[candidates]
    return clear
