"""Assigns a table's columns to channels of motion, wind and control: which column, in which unit and why.

Channels are read one after another, each by those before: positions decide the unit of speeds, the heading that of
the rate of turn, ranges that of angles. Where two readings are equally likely the user is asked. Actuators are
recognised by the kinds and sides in their columns' names, or by the ship's list.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

from seatrial.acquisition.core import conventions, quantities
from seatrial.acquisition.core import ship as ships
from seatrial.acquisition.tables import column_map, column_names, evidence, heading_columns, log_frames
from seatrial.acquisition.tables.evidence import ColumnCandidate, MappingDraft, TableContext, UnitGuess

FASTEST_MPS = 30.0  # what a speed channel holds
_CLEAR_RATIO = 2.0  # of two readings of the wind the one with half the mean square change is right
_CONTRADICTING_RATIO = 4.0  # of a reading against what a column is called
_WIND_STEPS = 6  # of the grid, half a minute: a ship turns meanwhile, the wind keeps
_EARTH_M = 6.371e6
_MOVED_M = 1.0  # between two instants of the grid: more than a receiver's noise
_CLEAR_CORRELATION = 0.5  # of the turning with the difference of two shafts
_FAR_FROM_AMIDSHIPS_DEG = 8.0  # more than wind and current ask for
_MIN_CERTAIN_RPM = 30.0  # higher values are not revolutions per second
_WIND_CHANNELS = {
    "true": ("wind_direction_deg", "wind_speed_mps"),
    "apparent": ("apparent_wind_angle_deg", "apparent_wind_speed_mps"),
}
_ALONG_TRACK = ("speed_over_ground_mps", "surge_mps")
_SPEEDS = ("surge_mps", "sway_mps", "speed_through_water_mps")
_AXES = ("north", "east")
_CLEAR_TURN = 0.6  # of the correlation of turns with the difference of two propellers
_SHIP_WORDS = frozenset({"psi", "heading", "hdg", "compass", "gyro", "surge", "sway", "u", "v"})
"""Words of compasses and of SNAME's notation (1950), whose headings and axes count from north and down."""
_ROS_NAME = re.compile(r"(?:^|[./])(?:field|header|odom|pose|twist)[./]")
_ANGLES = ("roll_deg", "pitch_deg", "heading_magnetic_deg")


def assign_channels(context: TableContext, ship: ships.Actuators) -> ships.Actuators:
    """Assign columns to channels in ``context`` and the map of its draft; returns the ship's actuators."""
    assign_motion_columns(context)
    for name in _ANGLES:
        if name not in context.channels:
            evidence.assign_best_column(context, name, heading_columns.unit_of_angle_column)
    heading_columns.assign_variation_column(context)
    evidence.assign_best_column(context, "heave_m", lambda _, heave, __: heave.header_unit or ("m", "by its name"))
    _read_wind(context)
    actuators, columns = find_actuators(context, ship)
    if not ship and ships.actuators_as_text(actuators):
        context.draft.tree["actuator"] = [{"name": actuator.name, "kind": actuator.kind} for actuator in actuators]
    for column in columns:
        _assign_control_column(context, column)
    if any(remark.endswith(log_frames.AS_IN_ROS) for remark in context.draft.raw.remarks):
        _settle_axes_of_ros(context, actuators)
    return actuators


def _settle_axes_of_ros(context: TableContext, actuators: ships.Actuators) -> None:
    """Turn a log that was read in the axes of ROS and counts to the north, the east and down, as answered.

    Read so it is a whole mirror image, in which nothing contradicts but the propellers: a ship that turns to the
    side of the faster one. Then it is asked.
    """
    draft, turning = context.draft, _turn_by_faster_propeller(context, actuators)
    if not {"north_m", "east_m", "heading_deg"} <= set(context.channels):
        return
    if not turning > _CLEAR_TURN and "x_axis" not in draft.answers:
        return
    text = (
        "the ship turns to the side of its faster propeller, as in a mirror: either the log counts to the north,"
        " the east and down (NED) though no frame is called so, or port and starboard are exchanged. Is x to the"
        " north or, as in ROS, to the east?"
    )
    if draft.ask("x_axis", text, _AXES) != "north":
        return
    channels, series = context.channels, context.series
    channels["north_m"], channels["east_m"] = channels["east_m"], channels["north_m"]
    series["north_m"], series["east_m"] = series["east_m"], series["north_m"]
    if velocity := draft.tree.get("velocity"):
        velocity["north"], velocity["east"] = velocity["east"], velocity["north"]
    evidence.rescale_assigned_channel(context, "heading_deg", -1.0, 90.0, "x is to the north, as answered")
    for name in ("sway_mps", "yaw_rate_dps", "pitch_deg"):
        if name in channels:
            evidence.rescale_assigned_channel(context, name, -1.0, 0.0, "x is to the north, as answered")


def _turn_by_faster_propeller(context: TableContext, actuators: ships.Actuators) -> float:
    """How much a ship steered by two propellers turns to the side of the faster one: the correlation of its turns
    with their difference, 0 for any other ship."""
    rates = [
        context.series.get(f"{actuator.name}_rpm")
        for words in (column_names.PORT, column_names.STARBOARD)
        for actuator in actuators
        if actuator.drives and not words.isdisjoint(actuator.name.split("_"))
    ]
    is_steered_otherwise = any(actuator.angle for actuator in actuators)
    turn = context.series.get("yaw_rate_dps")
    if is_steered_otherwise or len(rates) != 2 or turn is None or context.grid.size < 3:
        return 0.0
    port, starboard = (np.zeros(turn.size) if values is None else values for values in rates)
    turning = evidence.interval_means_on_grid(context.t, turn, context.grid)
    return -_correlation_with_difference(context, turning, port, starboard)


def _correlation_with_difference(
    context: TableContext, turning: quantities.Floats, first: quantities.Floats, second: quantities.Floats
) -> float:
    """How the ship turns to starboard, between the instants of the grid, as one shaft turns more than another: 1 in
    step, 0 not at all, -1 against."""
    means = [evidence.interval_means_on_grid(context.t, values, context.grid) for values in (first, second)]
    return evidence.fit_scale(turning, means[0] - means[1]).correlation


def assign_motion_columns(context: TableContext) -> None:
    """Assign positions, heading, speeds and rate of turn in ``context``, each judged by those before."""
    _assign_geographic_columns(context)
    heading_columns.assign_heading_column(context)
    _read_plane_position(context)
    evidence.assign_best_column(context, "speed_over_ground_mps", _unit_of_speed_column)
    evidence.assign_best_column(context, "course_over_ground_deg", heading_columns.unit_of_angle_column)
    heading_columns.assign_by_one_variation(context, "course_over_ground_deg", "course_magnetic")
    heading_columns.check_course_convention(context)
    heading_columns.settle_heading_convention(context)
    heading_columns.assign_earth_velocity_columns(context)
    heading_columns.assign_named_earth_velocity(context)
    for name in _SPEEDS:
        if name not in context.series:
            evidence.assign_best_column(context, name, _unit_of_speed_column)
    heading_columns.correct_sway_sign(context)
    heading_columns.assign_yaw_rate_column(context)


def _assign_geographic_columns(context: TableContext) -> None:
    """Assign the first pair of a latitude and a longitude that is a position on earth in a possible unit."""
    draft = context.draft
    pairs = [
        (latitude, longitude)
        for latitude in draft.candidates_for("latitude")
        for longitude in draft.candidates_for("longitude")
        if latitude.units == longitude.units or not (latitude.units and longitude.units)
    ]
    for latitude, longitude in pairs:
        for unit_guess, degrees, entries in _positions_by_unit(context, latitude, longitude):
            valid = np.isfinite(degrees[0]) | np.isfinite(degrees[1])
            if valid.any() and np.mean(evidence.valid_position_mask(*degrees)[valid]) > 0.5:
                _assign_position(context, latitude, longitude, unit_guess, degrees, entries)
                rivals = {angle.column for pair in pairs for angle in pair} - {latitude.column, longitude.column}
                for column in sorted(rivals):
                    draft.note_interpretation(column, "-", "", f"not used: {latitude.column!r} is taken")
                return
    if pairs:
        names = ", ".join(f"{first.column!r} and {second.column!r}" for first, second in pairs)
        draft.warnings.append(f"{names} are no latitude and longitude in any unit; they are left out")


_MINUTES, _SECONDS = frozenset({"min", "minutes", "minute", "m", "'"}), frozenset({"sec", "seconds", "s", '"'})


def _parts_of_degrees(draft: MappingDraft, angle: ColumnCandidate) -> list[str]:
    """The columns of minutes, and perhaps seconds, beside one of whole degrees; warns of whole degrees alone."""
    degrees = draft.numbers_or_nan(angle.column)
    degrees = degrees[np.isfinite(degrees)]
    if not degrees.size or np.any(degrees % 1.0) or np.max(np.abs(degrees)) > 180.0:
        return []
    columns = list[str]()
    for words in (_MINUTES, _SECONDS):
        for column in draft.raw.names:
            name, _, text = column_names.split_header(column)
            values = draft.numbers_or_nan(column)
            is_part = text.lower() in words and column_names.quantity_of_header(name) == angle.quantity.name
            if is_part and np.nanmin(values) >= 0.0 and np.nanmax(values) < 60.0:
                columns.append(column)
                break
        else:
            break
    if not columns and degrees.size >= evidence.MIN_INCREMENTS:
        draft.warnings.append(
            f"{angle.column!r} is in whole degrees, 60 nautical miles: are the minutes elsewhere?"
        )
    return columns


def _positions_by_unit(
    context: TableContext, latitude: ColumnCandidate, longitude: ColumnCandidate
) -> Iterator[tuple[UnitGuess, list[quantities.Floats], dict[str, Any]]]:
    """The units that two columns may be in, with the reason, and both columns in degrees by each; also entries of
    the map that this needs."""
    draft = context.draft
    if draft.is_empty(latitude.column):
        return
    names = latitude.column, longitude.column
    if not all(map(draft.is_numeric, names)):
        columns = [draft.raw.columns[name] for name in names]
        values, signs = column_map.parse_positions_in_degrees(
            columns[0], columns[1], _ask_hemisphere_of_letter_o(draft, columns[1])
        )
        yield (
            ("text", "degrees, minutes and letters"),
            [
                np.where(np.isnan(sign), value, np.abs(value) * sign)
                for value, sign in zip(values, signs, strict=True)
            ],
            {},
        )
        return
    stated = latitude.units or longitude.units
    if not stated and (small := _unit_of_small_position(context, *names)):
        stated = (small,)
    parts = [_parts_of_degrees(draft, angle) for angle in (latitude, longitude)]
    if all(parts):
        for angle, names_of_parts in zip((latitude, longitude), parts, strict=True):
            for column in names_of_parts:
                draft.note_interpretation(column, f"{angle.quantity.name}, its part", "", "beside whole degrees")
        degrees = [
            column_map.add_parts_of_degrees(
                draft.numbers_or_nan(name), [*map(draft.numbers_or_nan, names_of_parts)]
            )
            for name, names_of_parts in zip(names, parts, strict=True)
        ]
        entries = dict(zip(("latitude_parts", "longitude_parts"), parts, strict=True))
        yield ("deg", "whole degrees, with their minutes"), degrees, entries
        return
    for unit in stated or ("deg", "ddmm", "degE7"):
        values = [draft.numbers_or_nan(name) for name in names]
        if unit == "ddmm":  # 60 minutes and more are none
            values = [
                np.where(np.abs(angles) % 100.0 < 60.0, quantities.from_degrees_and_minutes(angles), np.nan)
                for angles in values
            ]
        else:
            values = [angles * quantities.unit_scale("deg", unit) for angles in values]
        yield (unit, f"head says {unit}" if stated else f"{unit} by their size"), values, {}


def _unit_of_small_position(context: TableContext, latitude: str, longitude: str) -> str:
    """The unit, degrees or radians, of a position whose numbers may be either: by a speed in a stated unit, or one
    that no ship reaches, else asked; empty for any other position."""
    draft = context.draft
    angles = [evidence.replace_codes_by_nan(draft.numbers_or_nan(name)) for name in (latitude, longitude)]
    largest = [float(np.nanmax(np.abs(values), initial=0.0)) for values in angles]
    if largest[0] > 0.5 * np.pi or largest[1] > np.pi or not max(largest):
        return ""
    steps = [
        evidence.increments_on_grid(context.t, values, context.grid) for values in angles if context.grid.size > 2
    ]
    moves = _EARTH_M * np.hypot(steps[0], steps[1] * np.cos(np.nanmean(angles[0]))) if steps else np.empty(0)
    if np.isfinite(moves).any() and np.nanmedian(moves / np.diff(context.grid)) > FASTEST_MPS:
        return "deg"
    speed = next((entry for entry in draft.candidates_for("speed_over_ground_mps") if entry.units), None)
    if speed is not None and steps:
        travelled = evidence.integrals_on_grid(context.t, draft.numbers_or_nan(speed.column), context.grid)
        travelled *= quantities.unit_scale("m/s", speed.units[0])
        for unit, metres in (("rad", moves), ("deg", np.deg2rad(moves))):
            fit = evidence.fit_scale(metres, travelled)
            if fit.is_clear and abs(np.log(abs(fit.factor))) < np.log(_CLEAR_RATIO):
                return unit
    text = f"{latitude!r} and {longitude!r} go up to {largest[0]:.4g} and {largest[1]:.4g}: degrees or radians?"
    return (evidence.ask_unit(draft, f"unit.{latitude}", text, ("deg", "rad")) or ("",))[0]


def _ask_hemisphere_of_letter_o(draft: MappingDraft, column: pd.Series[Any]) -> column_map.HemisphereOfO | None:
    """What the letter O means among hemispheres, asked where no other letter decides; None without an O."""
    if "o_is" not in draft.answers and not column_map.has_ambiguous_letter_o(column):
        return None
    text = (
        f"column {column.name!r} has the letter O, which is east in some languages and west in others: which is it?"
    )
    return "west" if draft.ask("o_is", text, ("east", "west")) == "west" else "east"


def _hemisphere_column(draft: MappingDraft, angle: ColumnCandidate, axis: column_map.Axis) -> pd.Series[Any] | None:
    """The column of an angle's hemispheres, by its name or, next to the angle, by its cells."""
    columns = draft.raw.columns
    names = list(map(str, columns.columns))
    index = names.index(angle.column)
    neighbours = [
        name for name in names[max(index - 1, 0) : index + 2] if column_map.holds_hemispheres(columns[name], axis)
    ]
    by_name = [  # without counts, such as a column ns of satellites: signs and flags are at most 1
        candidate.column
        for candidate in draft.candidates_for(axis)
        if not np.nanmax(np.abs(draft.numbers_or_nan(candidate.column)), initial=0.0) > 1.0
    ]
    for name in [*by_name, *neighbours]:
        if not draft.is_empty(name):
            return columns[name]
        side = "north" if axis == "north_south" else "east"
        draft.warnings.append(f"the column of hemispheres {name!r} is empty: {side} is taken")
    return None


def _assign_position(
    context: TableContext,
    latitude: ColumnCandidate,
    longitude: ColumnCandidate,
    unit_guess: UnitGuess,
    degrees: list[quantities.Floats],
    entries: dict[str, Any],
) -> None:
    draft = context.draft
    entry: dict[str, Any] = {"latitude": latitude.column, "longitude": longitude.column, "unit": unit_guess[0]}
    entry |= entries
    axes: tuple[tuple[ColumnCandidate, column_map.Axis], ...] = (
        (latitude, "north_south"),
        (longitude, "east_west"),
    )
    for index, (angle, axis) in enumerate(axes):
        if (letters := _hemisphere_column(draft, angle, axis)) is not None:
            entry[axis] = str(letters.name)
            signs = column_map.hemisphere_signs(
                letters, axis, _ask_hemisphere_of_letter_o(draft, letters) if axis == "east_west" else None
            )
            degrees[index] = column_map.apply_hemisphere_sign(
                degrees[index], signs, draft.raw.columns[angle.column]
            )
            draft.note_interpretation(str(letters.name), f"{axis} of the position", "", "letters")
    if "o_is" in draft.used_answers:
        entry["o_is"] = draft.answers["o_is"]
    numbers = draft.numbers_or_nan(latitude.column)
    if missing := [code for code in (91.0, 181.0) if np.any(numbers == code)]:
        entry["missing"] = missing
    draft.tree["position"] = entry
    draft.note_interpretation(latitude.column, "latitude_deg, north_m", *unit_guess)
    draft.note_interpretation(longitude.column, "longitude_deg, east_m", *unit_guess)
    valid = evidence.valid_position_mask(*degrees)
    if (no_fix := column_map.no_fix_mask(*degrees)).any():
        draft.warnings.append(column_map.remark_on_missing_fixes(degrees[0][no_fix]))
    valid &= ~_find_lost_fixes(draft, valid.size)
    fixes = [coordinate[valid] for coordinate in degrees]
    context.origin = float(fixes[0][0]), float(fixes[1][0])
    plane = np.full((2, valid.size), np.nan)
    plane[:, valid] = pymap3d.geodetic2ned(*fixes, 0.0, fixes[0][0], fixes[1][0], 0.0)[:2]
    context.series |= dict(zip(evidence.POSITION_CHANNELS, plane, strict=True))


_LETTERS_OF_FIX = frozenset("ADEFMNPRSV")  # of NMEA 0183: status, and mode indicators since 2.3
_LOST_LETTERS = ("V", "N")
_FIX_WORDS = frozenset({"fix", "gps", "gnss", "quality", "position", "pos"})  # other numbers may be of any device


def _find_lost_fixes(draft: MappingDraft, rows: int) -> quantities.Bools:
    """Which rows [n] have no fix by a column for its quality, which goes into the map; what else differs is told.

    Zero is none (NMEA, u-blox, PX4) beside positive numbers, a negative number (ROS), or the letter V or N.
    """
    for candidate in draft.candidates_for("fix_quality"):
        cells = column_map.cells_as_names(draft.raw.columns[candidate.column])
        counts, numbers = cells[cells != ""].value_counts(), draft.numbers_or_nan(candidate.column)
        is_code = draft.is_numeric(candidate.column) and not np.any(numbers[np.isfinite(numbers)] % 1.0)
        if {*counts.index} <= _LETTERS_OF_FIX:
            lost = [letter for letter in _LOST_LETTERS if letter in counts]
        elif is_code and candidate.words & _FIX_WORDS:
            lost = [name for name in counts.index if name.startswith("-")] or [*counts.index.intersection(["0"])]
        else:
            continue
        if counts.size < 2 and not lost:
            break
        of_rows = ", ".join(f"{name} in {count:,} rows" for name, count in counts.items())
        text = f"{candidate.column!r}, of the fix, is {of_rows}"
        if not lost or counts[lost].sum() > 0.5 * counts.sum():
            draft.warnings.append(f"{text}: all positions are taken; `no_fix` in a map leaves some out")
            break
        draft.tree["position"] |= {"fix": candidate.column, "no_fix": lost}
        draft.warnings.append(
            f"{text}: position, course and speed over ground are left out where it is {' or '.join(lost)}"
        )
        draft.note_interpretation(candidate.column, "quality of the fix", "", "no position without")
        return np.asarray(cells.isin(lost))
    return np.zeros(rows, np.bool_)


def _read_plane_position(context: TableContext) -> None:
    """Assign metres to north and east, or x and y, where there is no latitude.

    Positions of a grid such as UTM, millions of metres, begin near zero.
    """
    draft, why = context.draft, "by its name"
    north, east, x, y = (evidence.best_candidate(draft, name) for name in (*evidence.POSITION_CHANNELS, "x", "y"))
    if "position" in draft.tree:
        return
    if not (north and east) and x and y:
        x_is_east = None if "x_axis" in draft.answers else _is_x_east(context, x, y)
        words = [
            candidate.words
            for name in ("heading_deg", "surge_mps", "sway_mps")
            for candidate in draft.candidates_for(name)[:1]
        ]
        # not the heading of a compass, nor beside SNAME's words: no name states its axes
        is_yaw = bool(words) and "yaw" in words[0] and not any(names & _SHIP_WORDS for names in words)
        yaw = context.channels.get("heading_deg", {}).get("column", "") if is_yaw else ""
        if x_is_east is False and yaw:
            x_is_east, why = _resolve_mirrored_axes(context, x, y, yaw)
        elif x_is_east is None:
            answer = draft.ask("x_axis", f"is {x.column!r} to the north or to the east?", _AXES)
            x_is_east, why = answer == "east", "as answered" if answer else "not clear"
        else:
            why = "the track runs where the heading points"
        context.positions_are_sure |= "x_axis" in draft.used_answers
        north, east = (y, x) if x_is_east else (x, y)
    if not (north and east):
        return
    for name, candidate in zip(evidence.POSITION_CHANNELS, (north, east), strict=True):
        evidence.assign_column(context, name, candidate, (candidate.units or ("m",))[0], why)
        values = context.series[name]
        start = next(iter(values[np.isfinite(values)]), 0.0)
        if abs(start) > ships.BY_NAME[name].high:
            offset = -1000.0 * round(start / 1000.0)
            context.channels[name]["offset"] = offset
            context.series[name] = values + offset
            grid_start = f"{1000 * round(start / 1000.0):,} m"
            draft.warnings.append(f"{candidate.column!r} counts from {grid_start}, as grids do (UTM)")


def _resolve_mirrored_axes(
    context: TableContext, x: ColumnCandidate, y: ColumnCandidate, yaw: str
) -> tuple[bool, str]:
    """Whether x is to the east where a yaw turns as x and y do, and why: the two readings are mirror images.

    The names of ROS decide (REP 103), else the user is asked.
    """
    draft = context.draft
    readings = (
        f"{yaw!r} turns as the track of {x.column!r} and {y.column!r} does in either of two readings: x to the"
        f" north and {yaw!r} clockwise from north (NED), or x to the east and {yaw!r} {conventions.FROM_EAST.words}"
    )
    if any(_ROS_NAME.search(name) for name in draft.raw.names):
        draft.warnings.append(f"{readings}; the names of ROS say the second, --answer x_axis=north the first")
        context.positions_are_sure = True
        return True, "to the east, as in ROS"
    answer = draft.ask(
        "x_axis", f"{readings}, which mirrors it. Is {x.column!r} to the north or to the east?", _AXES
    )
    return answer == "east", "as answered" if answer else "not clear"


def _is_x_east(context: TableContext, x: ColumnCandidate, y: ColumnCandidate) -> bool | None:
    """Whether x is to the east by the heading; None if that is not clear."""
    if "heading_deg" not in context.series or context.grid.size < 3:
        return None
    draft, angle = context.draft, evidence.mean_angle(context, context.series["heading_deg"])
    x_moves, y_moves = (
        evidence.increments_on_grid(context.t, draft.numbers_or_nan(candidate.column), context.grid)
        for candidate in (x, y)
    )
    body = [draft.candidates_for(name) for name in ("surge_mps", "sway_mps")]
    if all(body):
        surge, sway = (
            evidence.integrals_on_grid(context.t, draft.numbers_or_nan(candidates[0].column), context.grid)
            for candidates in body
        )
        angle = angle + np.rad2deg(np.arctan2(sway, surge))
    as_north = evidence.direction_agreement(x_moves, y_moves, angle)
    as_east = evidence.direction_agreement(y_moves, x_moves, angle)
    return None if abs(as_north - as_east) < 0.3 or max(as_north, as_east) < 0.5 else as_east > as_north


def _unit_of_speed_column(context: TableContext, candidate: ColumnCandidate, name: str) -> UnitGuess | None:
    """A speed's unit, and why; None if the column is to be left out."""
    values, regression = context.draft.numbers_or_nan(candidate.column), evidence.NO_FIT
    steps = evidence.channel_increments(context, *evidence.POSITION_CHANNELS) if name in _ALONG_TRACK else []
    if steps:  # not for sway, across the track, nor for speed through the water, which moves
        sway = next(iter(context.draft.candidates_for("sway_mps")), None) if name == "surge_mps" else None
        columns = [values] if sway is None else [values, context.draft.numbers_or_nan(sway.column)]
        distances = [
            evidence.integrals_on_grid(context.t, evidence.replace_codes_by_nan(column), context.grid)
            for column in columns
        ]
        regression = evidence.fit_scale(np.hypot(*steps), np.hypot(distances[0], distances[1] if sway else 0.0))
    moved = next(iter(evidence.channel_increments(context, "north_m")), np.zeros(1))
    if not np.any(values[np.isfinite(values)]) and np.any(np.abs(moved) > _MOVED_M):
        context.draft.warnings.append(
            f"{candidate.column!r} is zero throughout, while the positions move: left out"
        )
        context.draft.note_interpretation(candidate.column, "-", "", "left out: all zero while the positions move")
        return None
    if unit_guess := evidence.rate_unit(context, candidate, regression, evidence.SPEED):
        context.speed_units.add(unit_guess[0])
        return unit_guess
    if len(context.speed_units) == 1:
        return next(iter(context.speed_units)), "as the other speeds"
    if not np.any(values[np.isfinite(values)]):
        return "m/s", "all zero"
    largest = float(np.nanmax(np.abs(evidence.replace_codes_by_nan(values))))
    if largest > FASTEST_MPS:
        context.draft.warnings.append(f"{candidate.column!r} goes up to {largest:.4g}: km/h?")
    text = f"{candidate.column!r}, taken for {name}, goes up to {largest:.3g} in no unit: m/s or knots?"
    return evidence.ask_unit(context.draft, "unit.speed", text, evidence.SPEED.units[:3])


def _read_wind(context: TableContext) -> None:
    """Assign the true and the apparent wind; of an unnamed kind whichever makes the wind over ground steadier."""
    draft = context.draft
    has_speed = bool(draft.candidates_for("wind_speed_mps", "wind_speed"))
    if has_speed and not draft.candidates_for("wind_direction_deg", "wind_direction"):
        heading_columns.assign_by_one_variation(context, "wind_direction_deg", "wind_direction_magnetic")
    towards = evidence.best_candidate(draft, "wind_direction_to")
    if towards and (unit_guess := heading_columns.unit_of_angle_column(context, towards, "wind_direction_deg")):
        evidence.assign_column(context, "wind_direction_deg", towards, *unit_guess)
        why = "where the wind blows to, turned to where it comes from"
        evidence.rescale_assigned_channel(context, "wind_direction_deg", 1.0, 180.0, why)
    if "wind_direction_deg" in context.channels:
        _assign_wind(context, "true", None, evidence.best_candidate(draft, "wind_speed"))
    for kind, names in _WIND_CHANNELS.items():
        _assign_wind(context, kind, *(evidence.best_candidate(draft, name) for name in names))
    _settle_named_wind(context)
    if "wind_direction_deg" in context.channels or _assign_wind_angle(context) or _assign_wind_velocity(context):
        return
    direction, speed = (evidence.best_candidate(draft, name) for name in ("wind_direction", "wind_speed"))
    if direction is None or speed is None:
        return
    if "apparent_wind_angle_deg" in context.channels:
        _assign_wind(context, "true", direction, speed)
        return
    angle_deg, speed_mps = _wind_in_columns(context, direction, speed)
    changes = _mean_wind_changes(context, angle_deg, speed_mps)
    changes = {kind: changes[kind] for kind in _WIND_CHANNELS if kind in changes}
    wind_kind = None if "wind" in draft.answers else _clearly_steadiest_reading(changes)
    if wind_kind:
        times = max(changes.values()) / max(min(changes.values()), 1e-12)
        why = f"{wind_kind}: taken otherwise it would change {times:.1f} times as much"
        draft.note_interpretation(direction.column, "wind", "", why)
    else:
        text = f"{direction.column!r} and {speed.column!r}: the true wind, or the apparent wind from the bow?"
        wind_kind = draft.ask("wind", text, tuple(_WIND_CHANNELS))
    if wind_kind in _WIND_CHANNELS:
        _assign_wind(context, wind_kind, direction, speed)
        _settle_named_wind(context)


def _settle_named_wind(context: TableContext) -> None:
    """Take a true wind for one from the bow, or an apparent one for one that is positive to port, and report it,
    where the wind over ground is so much steadier; an answer needs no check."""
    draft, channels = context.draft, context.channels
    for kind, other, words in (
        ("true", "true from the bow", "counts from the bow and not from north"),
        ("apparent", "apparent to port", "is positive to port"),
    ):
        names = _WIND_CHANNELS[kind]
        draft.used_answers.add("wind")
        if "wind" in draft.answers or not {*names} <= {*channels}:
            continue
        changes = _mean_wind_changes(context, *(context.series[name] for name in names))
        if not changes or changes[kind] <= _CONTRADICTING_RATIO * changes[other]:
            continue
        column, speed = (channels[name] for name in names)
        times = changes[kind] / max(changes[other], 1e-3 * changes[kind])
        draft.warnings.append(
            f"{column['column']!r} {words}: the wind over ground would change {times:.0f} times as much otherwise;"
            f" --answer wind={kind} takes it as it is called"
        )
        if kind == "apparent":
            evidence.rescale_assigned_channel(context, names[0], -1.0, 0.0, "positive to port")
            if "apparent_wind" in draft.tree:
                draft.tree["apparent_wind"]["positive"] = "port"
        else:
            del channels[names[0]], channels[names[1]]
            _note_wind_from_bow(context, column, speed)


def _note_wind_from_bow(context: TableContext, angle: dict[str, Any], speed: dict[str, Any]) -> None:
    """Put true wind from the bow, by the entries of its columns, into the map."""
    units = {"angle_unit": angle["unit"], "speed_unit": speed["unit"]}
    context.draft.tree["true_wind"] = {"angle": angle["column"], "speed": speed["column"]} | units


def _assign_wind_angle(context: TableContext) -> bool:
    """Make the wind's direction of a true wind's angle from the bow, by the heading; whether that is done."""
    draft, speed = context.draft, context.channels.get("wind_speed_mps")
    angle = evidence.best_candidate(draft, "true_wind_angle")
    if angle is None or speed is None or "heading_deg" not in context.series:
        return False
    unit_guess = heading_columns.unit_of_angle_column(context, angle, "wind_direction_deg")
    if unit_guess is None:
        return False
    del context.channels["wind_speed_mps"]
    _note_wind_from_bow(context, {"column": angle.column, "unit": unit_guess[0]}, speed)
    draft.note_interpretation(
        angle.column, "wind_direction_deg", *unit_guess, "from the bow, turned by the heading"
    )
    draft.warnings.append(
        f"{angle.column!r} is the true wind from the bow: its direction is made by the heading; instruments"
        " with a log reckon it by the speed through water"
    )
    return True


def _assign_wind_velocity(context: TableContext) -> bool:
    """Read the wind's parts to east and north as meteorology has them, where it blows to; whether that is done."""
    draft = context.draft
    east, north = (evidence.best_candidate(draft, name) for name in ("wind_east", "wind_north"))
    if east is None or north is None:
        return False
    names = f"{east.column!r} and {north.column!r}"
    unit_guess = east.header_unit or evidence.ask_unit(
        draft, "unit.wind", f"in which unit are {names}?", evidence.SPEED.units[:3]
    )
    if unit_guess is None:
        return False
    scale = quantities.unit_scale("m/s", unit_guess[0])
    air = [scale * draft.numbers_or_nan(candidate.column) for candidate in (north, east)]
    wind = log_frames.wind_towards(*air)
    changes = _mean_wind_changes(context, wind["direction"], wind["speed"])
    in_ship = _mean_wind_changes(context, np.rad2deg(np.arctan2(*air)), wind["speed"])
    if changes and changes["true"] > _CONTRADICTING_RATIO * min(in_ship["apparent"], in_ship["apparent to port"]):
        draft.warnings.append(
            f"{names} change with the heading: they are left out, as they may be along the ship's axes"
        )
        return False
    draft.tree["wind_velocity"] = {"north": north.column, "east": east.column, "unit": unit_guess[0]}
    for candidate, direction in ((north, "north"), (east, "east")):
        draft.note_interpretation(candidate.column, f"wind to {direction}", *unit_guess)
    draft.warnings.append(
        f"{names} are taken for where the wind blows to, to east and to north, as meteorology has them; a map's"
        " [wind_velocity] says otherwise"
    )
    return True


def _wind_in_columns(
    context: TableContext, direction: ColumnCandidate, speed: ColumnCandidate, unit: str = ""
) -> tuple[quantities.Floats, quantities.Floats]:
    """The angle [n, deg] and the speed [n, m/s] in two columns, by their heads or in a ``unit`` of speed."""
    scales = (quantities.unit_scale("deg", (direction.units or ("deg",))[0]),
              quantities.unit_scale("m/s", unit or (speed.units or ("m/s",))[0]))  # fmt: skip
    angle, size = (context.draft.numbers_or_nan(candidate.column) for candidate in (direction, speed))
    return scales[0] * angle, scales[1] * size


def _assign_wind(
    context: TableContext, kind: str, angle: ColumnCandidate | None, speed: ColumnCandidate | None
) -> None:
    """Assign a direction and a speed; a speed in no unit is in that by which the wind over ground is steadier."""
    draft, (angle_name, speed_name) = context.draft, _WIND_CHANNELS[kind]
    angle_guess = heading_columns.unit_of_angle_column(context, angle, angle_name) if angle else None
    if angle and angle_guess:
        evidence.assign_column(context, angle_name, angle, *angle_guess)
    if not speed:
        return
    values, change_by_unit = draft.numbers_or_nan(speed.column), dict[str, float]()
    if angle and kind == "apparent" and not speed.header_unit:
        changes = {
            unit: _mean_wind_changes(context, *_wind_in_columns(context, angle, speed, unit))
            for unit in ("m/s", "knots")
        }
        change_by_unit = {unit: change["apparent"] for unit, change in changes.items() if change}
    unit_guess: UnitGuess | None
    if speed.header_unit:
        unit_guess = speed.header_unit
    elif not np.any(values[np.isfinite(values)]):
        unit_guess = "m/s", "all zero"
    elif steadiest := _clearly_steadiest_reading(change_by_unit):
        unit_guess = steadiest, "so the wind over ground is steadiest"
    else:
        text = f"{speed.column!r}, a wind speed, goes up to {np.nanmax(values):.3g} in no unit: m/s or knots?"
        unit_guess = evidence.ask_unit(draft, "unit.wind", text, evidence.SPEED.units[:3])
    if not unit_guess:
        return
    evidence.assign_column(context, speed_name, speed, *unit_guess)
    needs_true_wind = "wind_direction_deg" not in context.channels and "heading_deg" in context.series
    if angle and angle_guess and kind == "apparent" and needs_true_wind:
        units = {"speed_unit": unit_guess[0], "angle_unit": angle_guess[0]}
        draft.tree["apparent_wind"] = {"angle": angle.column, "speed": speed.column} | units


def _clearly_steadiest_reading(changes: dict[str, float]) -> str | None:
    """The reading by which the wind is clearly steadier than by another, if there is one."""
    is_clear = bool(changes) and max(changes.values()) > _CLEAR_RATIO * min(changes.values())
    return min(changes, key=changes.__getitem__) if is_clear else None


def _mean_wind_changes(
    context: TableContext, angle: quantities.Floats, size: quantities.Floats
) -> dict[str, float]:
    """The mean square change, over half a minute, of the wind over ground if an angle [n, deg] and a size [n, m/s]
    are the true wind, that from the bow, the apparent wind, and that to port; empty where the ship's velocity or
    its heading is not known."""
    series = context.series
    if "heading_deg" not in series or context.grid.size < 3:
        return {}

    def at_all_rows(name: str) -> quantities.Floats:
        angle = name in ("heading_deg", "course_over_ground_deg")
        return column_map.fill_short_gaps(context.t, ships.unwrap(series[name]) if angle else series[name])

    heading = at_all_rows("heading_deg")
    if {"surge_mps", "sway_mps"} <= set(series):  # the velocity, north + i east
        velocity = at_all_rows("surge_mps") + 1j * at_all_rows("sway_mps")
        motion = np.asarray(velocity * _complex_from_polar(1.0, heading))
    elif set(column_map.GROUND_CHANNELS) <= set(series):
        motion = _complex_from_polar(*map(at_all_rows, ("speed_over_ground_mps", "course_over_ground_deg")))
    elif "north_m" in series:
        north, east = (
            column_map.fill_short_gaps(context.t, column_map.local_least_squares_slopes(context.t, series[name]))
            for name in evidence.POSITION_CHANNELS
        )
        motion = np.asarray(north + 1j * east)
    else:
        return {}
    changes = {}
    for kind, wind in (
        ("true", _complex_from_polar(size, angle)),
        ("true from the bow", _complex_from_polar(size, heading + angle)),
        ("apparent", _complex_from_polar(size, heading + angle) - motion),
        ("apparent to port", _complex_from_polar(size, heading - angle) - motion),
    ):
        parts = [
            evidence.interval_means_on_grid(context.t, part, context.grid)
            for part in (np.real(wind), np.imag(wind))
        ]
        mean_wind = parts[0] + 1j * parts[1]
        steps = mean_wind[_WIND_STEPS:] - mean_wind[:-_WIND_STEPS]
        steps = steps[np.isfinite(steps)]
        if steps.size < evidence.MIN_INCREMENTS:
            return {}
        changes[kind] = float(np.mean(np.abs(steps) ** 2))
    return changes


def _complex_from_polar(size: quantities.Floats | float, angle_deg: quantities.Floats) -> np.ndarray:
    """Complex numbers by magnitude [n] and angle [n]."""
    return np.asarray(size * np.exp(1j * np.deg2rad(angle_deg)))


def _assign_control_column(context: TableContext, control: ActuatorColumn) -> None:
    draft, candidate, unit = context.draft, control.candidate, ships.BY_NAME[control.channel].unit
    if "percent" in candidate.units[:1] and unit != "%":
        _assign_percentage_column(context, control, "deg" if unit == "deg" else "rpm")
        return
    unit_guess: UnitGuess | None
    if unit == "%":
        unit_guess = (candidate.units or ("%",))[0], ""
    elif unit == "deg":
        unit_guess = heading_columns.unit_of_angle_column(context, candidate, control.channel)
    elif candidate.header_unit:
        unit_guess = candidate.header_unit
    else:
        values = draft.numbers_or_nan(candidate.column)
        largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
        if "rpm" in candidate.words or largest == 0.0:
            unit_guess = "rpm", "by its name" if largest else "all zero"
        elif largest > _MIN_CERTAIN_RPM:
            unit_guess = "rpm", f"up to {largest:.4g}"
        else:
            text = f"{candidate.column!r} goes up to {largest:.3g}: turns a minute or a second?"
            unit_guess = evidence.ask_unit(draft, f"unit.{candidate.column}", text, ("rpm", "rps"))
    if unit_guess:
        evidence.assign_column(context, control.channel, candidate, *unit_guess, control.why)
        if unit == "deg":
            _correct_helm_sign(context, control)


def _assign_percentage_column(context: TableContext, control: ActuatorColumn, unit: str) -> None:
    """Assign a column in percent of a full scale, which is asked."""
    draft, column = context.draft, control.candidate.column
    key = f"full_scale.{control.channel.removesuffix('_rpm').removesuffix('_angle_deg')}"
    is_general_answer = "full_scale" in draft.answers and key not in draft.answers
    text = f"{column!r} is in percent: of how many {unit}?"
    full_scale = draft.ask("full_scale" if is_general_answer else key, text, (), evidence.SKIP)
    if full_scale is None or full_scale == evidence.SKIP:
        draft.warnings.append(
            f"{column!r} is in percent of an unknown full scale and left out; use --answer {key}=NUMBER"
        )
        draft.note_interpretation(column, "-", "percent", "left out: percent of an unknown full scale")
        return
    why = f"100 % is {full_scale} {unit}, as answered"
    evidence.assign_column(
        context, control.channel, control.candidate, "percent", why, control.why, full_scale=float(full_scale)
    )


def _correct_helm_sign(context: TableContext, control: ActuatorColumn) -> None:
    """Invert the sign of a helm that turns the ship the other way, or of a rudder by its head if nothing turns."""
    turns, rate_of_turn = ships.KINDS[control.kind].turns, context.series.get("yaw_rate_dps")
    steps = evidence.channel_increments(context, "heading_deg")
    is_rudder, strongest, rest_deg = control.kind == "rudder", 0.0, 0.0
    if turns and not context.heading_is_asked and context.grid.size >= 3 and (rate_of_turn is not None or steps):
        turning = (
            steps[0]
            if rate_of_turn is None
            else evidence.interval_means_on_grid(context.t, rate_of_turn, context.grid)
        )
        helm_deg = evidence.interval_means_on_grid(context.t, context.series[control.channel], context.grid)
        helm = np.sin(np.deg2rad(helm_deg))
        correlations = [evidence.fit_scale(turning[lag:], helm[: helm.size - lag]).correlation for lag in range(4)]
        strongest = max(correlations, key=abs) * turns
        rest_deg = _helm_without_turning(turning, helm_deg) if is_rudder else 0.0
    if strongest < -0.5:
        side = "port" if turns > 0 else "starboard"
        evidence.invert_sign_of_assigned_channel(context, control.channel, f"positive turned the ship to {side}")
    elif is_rudder and control.candidate.positive == "port" and strongest <= 0.5:
        evidence.invert_sign_of_assigned_channel(context, control.channel, evidence.POSITIVE_TO_PORT)
    if abs(rest_deg) > _FAR_FROM_AMIDSHIPS_DEG:
        context.draft.warnings.append(
            f"{control.candidate.column!r} is about {rest_deg:.0f} deg while the ship does not turn: does it count"
            " from elsewhere than amidships? A map's `offset` corrects it"
        )


def _helm_without_turning(turning: quantities.Floats, helm_deg: quantities.Floats) -> float:
    """The helm [deg] at which a ship does not turn, by rates of turn and helms [n]; 0 if these do not show it."""
    valid = np.isfinite(turning) & np.isfinite(helm_deg)
    pairs = np.stack([turning[valid], helm_deg[valid]])
    if pairs.shape[1] < evidence.MIN_INCREMENTS or not np.ptp(pairs, axis=1).all():
        return 0.0
    covariance, means = np.cov(pairs), pairs.mean(axis=1)
    correlation = float(covariance[0, 1] ** 2 / (covariance[0, 0] * covariance[1, 1]))
    rest_deg = float(means[1] - covariance[0, 1] / covariance[0, 0] * means[0])
    return rest_deg if correlation > _CLEAR_CORRELATION else 0.0


_KIND_BY_QUANTITY = {"rudder": "rudder", "azimuth": "azimuth", "shaft": "propeller", "propeller_pitch": "propeller"}
_SUFFIXES = {"rudder": "_angle_deg", "azimuth": "_angle_deg", "shaft": "_rpm", "propeller_pitch": "_pitch_percent"}
"""How the channel of each quantity ends."""
_COMPATIBLE_KINDS = {
    "propeller": tuple(
        sorted((name for name, kind in ships.KINDS.items() if kind.drives), key=lambda name: name == "azimuth")
    ),
    "azimuth": tuple(name for name, kind in ships.KINDS.items() if kind.drives and kind.turns),
    "rudder": ("rudder",),
    "tunnel": ("tunnel",),
}
"""The kinds of a known ship's actuators that a column of a kind may belong to, the likeliest first."""
_QUANTITY_BY_UNIT = {"rpm": "shaft", "deg": "azimuth", "%": "propeller_pitch"}
_NUMBERED = re.compile(r"[a-z]{1,2}\d")
_SIDES = {
    "port": column_names.PORT,
    "starboard": column_names.STARBOARD,
    "bow": column_names.BOW,
    "stern": column_names.STERN,
}
_ANY_THRUSTER = frozenset({"thr", "thruster", "propulseur"})
_AZIMUTH_WORDS = frozenset({"az", "azi", "azimuth", "azimut", "asimut", "pod"})


@dataclass(frozen=True, slots=True)
class ActuatorColumn:
    """A column of an actuator, and its channel: that of the control, or of the orders to it."""

    candidate: ColumnCandidate
    channel: str
    kind: str
    why: str


@dataclass(frozen=True, slots=True)
class _ControlColumn:
    """The kind and side of the actuator that a column's name means, and whether it is an order."""

    candidate: ColumnCandidate
    kind: str
    side: str
    is_order: bool


def find_actuators(
    context: TableContext, ship: ships.Actuators = ()
) -> tuple[ships.Actuators, list[ActuatorColumn]]:
    """The actuators of a table's columns, or of a known ``ship``, and the columns with their channels."""
    draft = context.draft
    exact = _columns_by_channel_name(draft, ship or _actuators_by_angle_names(draft))
    used_columns = {column.candidate.column for column in exact}
    controls = [
        _classify_control(candidate)
        for candidate in draft.candidates_for(*_KIND_BY_QUANTITY)
        if candidate.column not in used_columns
    ]
    controls = _with_shaft_that_drives(draft, controls, ship or exact)
    azimuths = {control.side for control in controls if control.kind == "azimuth"}
    controls = [  # a shaft at the side of an azimuth thruster is the thruster's
        replace(control, kind="azimuth") if control.kind == "propeller" and control.side in azimuths else control
        for control in controls
    ]
    controls = _with_sides_of_pair(context, controls, ship)
    columns = {column.channel: column for column in exact}
    kinds = {actuator.name: actuator.kind for actuator in _actuators_by_angle_names(draft)}
    for control in sorted(controls, key=lambda control: control.is_order):
        matching = _candidate_actuators_of_column(control, controls, ship)
        if len(matching) > 1:
            names = " and ".join(actuator.name for actuator in matching)
            draft.warnings.append(f"{control.candidate.column!r} names no side: it is taken for {names} alike")
        for actuator in matching:
            name = actuator.name + _SUFFIXES[control.candidate.quantity.name]
            if name not in {channel.name for channel in actuator.channels}:
                continue
            channel = ships.order_channel_name(name) if control.is_order and name in columns else name
            if channel in columns:
                rival = columns[channel].candidate.column
                draft.note_interpretation(control.candidate.column, "-", "", f"not used: {rival!r} is taken for it")
                continue
            why = f"{actuator.name}: {actuator.kind.replace('_', ' ')}{', its order' if control.is_order else ''}"
            if control.is_order and channel == name:
                draft.warnings.append(
                    f"{control.candidate.column!r} is an order, which is followed with a lag: no column has what"
                    f" was done, and it is taken for {name}"
                )
            columns[channel] = ActuatorColumn(control.candidate, channel, actuator.kind, why)
            kinds[actuator.name] = actuator.kind
    named = (ships.Actuator(name, kind) for name, kind in kinds.items())
    used = (actuator for actuator in named if any(channel.name in columns for channel in actuator.channels))
    actuators = tuple(  # as in most vessel files: first what drives the ship, then what steers it
        sorted(used, key=lambda entry: (not entry.drives, not ships.KINDS[entry.kind].turns, entry.name))
    )
    if set(actuators) == set(ships.DEFAULT):
        actuators = ships.DEFAULT
    return ship or actuators, list(columns.values())


def _actuators_by_angle_names(draft: MappingDraft) -> ships.Actuators:
    """The default ship's actuators if columns have the names of their angles, as another ship may have such shafts;
    else thrusters whose shaft and angle share a short name, as t1 [rpm] and t1 angle [deg]."""
    names = draft.raw.names
    angles = {channel.name for actuator in ships.DEFAULT for channel in actuator.channels if channel.unit == "deg"}
    if angles & set(names):
        return ships.DEFAULT
    units_by_name = {
        name.lower().replace(" ", "_"): units for name, units, _ in map(column_names.split_header, names)
    }
    return tuple(
        ships.Actuator(name, "azimuth")
        for name, units in units_by_name.items()
        if _NUMBERED.fullmatch(name) and "rpm" in units and f"{name}_angle" in units_by_name
    )


def _columns_by_channel_name(draft: MappingDraft, ship: ships.Actuators) -> list[ActuatorColumn]:
    """The columns named as a ship's channels, perhaps with blanks for underscores or the unit in brackets."""
    channels = {channel.name: (actuator, channel.unit) for actuator in ship for channel in actuator.channels}
    orders = {ships.order_channel_name(name): entry for name, entry in channels.items()}
    columns: dict[str, ActuatorColumn] = {}
    for column in draft.raw.names:
        head = column_names.split_header(column)
        stems = {re.sub(r"\W+", "_", name.strip().lower()) for name in (column, head.name)}
        for channel, (actuator, unit) in (channels | orders).items():
            is_named = channel in stems or (channel.rpartition("_")[0] in stems and bool(head.units))
            if not is_named or channel in columns:
                continue
            quantity = next(entry for entry in column_names.QUANTITIES if entry.name == _QUANTITY_BY_UNIT[unit])
            if not head.units or any(evidence.accepts_unit(quantity, stated) for stated in head.units):
                units = head.units or column_names.parse_units(draft.raw.units.get(column, ""))
                candidate = ColumnCandidate(
                    column, quantity, 1.0, units, frozenset(column_names.split_into_words(column))
                )
                why = f"{actuator.name}: by its name"
                columns[channel] = ActuatorColumn(candidate, channel, actuator.kind, why)
    return list(columns.values())


def _classify_control(candidate: ColumnCandidate) -> _ControlColumn:
    words = candidate.words
    kind = _KIND_BY_QUANTITY[candidate.quantity.name]
    if candidate.quantity.name == "shaft" and words & (
        column_names.TUNNEL | (column_names.BOW | column_names.STERN) - {"forward", "aft", "fwd"}
    ):
        kind = "tunnel"
    if candidate.quantity.name == "shaft" and words & _AZIMUTH_WORDS:
        kind = "azimuth"
    return _ControlColumn(candidate, kind, side_of_words(words), bool(words & column_names.ORDER))


def side_of_words(words: frozenset[str]) -> str:
    """Where on the ship what a column's words name is, or its number; empty where they do not say."""
    sides = [name for name, markers in _SIDES.items() if words & markers]
    if sides[:2] == ["port", "starboard"]:  # "rudder port/stb": which way it counts, not where it is
        sides = sides[2:]
    return next(iter(sides), "") or next((word for word in sorted(words) if word.isdigit() and len(word) == 1), "")


def _with_shaft_that_drives(
    draft: MappingDraft, controls: list[_ControlColumn], others: Collection[object]
) -> list[_ControlColumn]:
    """The controls; where no shaft drives the ship, and there are no ``others``, thrusters of no place do."""
    drives = any(control.kind in ("azimuth", "propeller") for control in controls)
    places = column_names.BOW | column_names.STERN | (column_names.TUNNEL - _ANY_THRUSTER)
    bare = [control for control in controls if control.kind == "tunnel" and not control.candidate.words & places]
    if drives or others or not bare:
        return controls
    names = ", ".join(repr(control.candidate.column) for control in bare)
    draft.warnings.append(f"{names}: taken for what drives the ship, as no other shaft does")
    return [replace(control, kind="propeller") if control in bare else control for control in controls]


def _with_sides_of_pair(
    context: TableContext, controls: list[_ControlColumn], ship: ships.Actuators
) -> list[_ControlColumn]:
    """The controls; two numbered shafts, one to port and one to starboard, are told apart by how the ship turns."""
    pair = sorted(
        (control for control in controls if control.kind == "propeller" and control.side.isdigit()),
        key=lambda control: control.side,
    )
    names, sides = [control.candidate.column for control in pair], ("port", "starboard")
    at_side = [sum(not _SIDES[side].isdisjoint(shaft.name.split("_")) for shaft in ship) for side in sides]
    if len(pair) != 2 or at_side != [1, 1]:
        return controls
    turning, shafts = evidence.channel_increments(context, "heading_deg"), map(context.draft.numbers_or_nan, names)
    turned = 0.0
    if turning and not context.heading_is_asked:
        turned = _correlation_with_difference(context, turning[0], *shafts)
    if "first_shaft" in context.draft.answers or abs(turned) < _CLEAR_CORRELATION:
        text = f"is {names[0]!r} the shaft to port or to starboard? The other is {names[1]!r}"
        if context.draft.ask("first_shaft", text, sides) == "starboard":
            sides = ("starboard", "port")
    elif turned < 0.0:
        sides = ("starboard", "port")
    side_by_column = dict(zip(names, sides, strict=True))
    return [replace(entry, side=side_by_column.get(entry.candidate.column, entry.side)) for entry in controls]


def _candidate_actuators_of_column(
    control: _ControlColumn, controls: Iterable[_ControlColumn], ship: ships.Actuators
) -> list[ships.Actuator]:
    """The ship's actuators that a column may be of; without a side all of a kind, as of one order to a pair.

    Of a ship whose actuators are not known it is a new one, named by its side.
    """
    side, kind = control.side, control.kind
    if not ship:
        name = f"{kind}_{side}" if side.isdigit() else f"{side}_{kind}" if side else kind
        if kind == "azimuth" and side and not side.isdigit():
            name = side
        if kind == "tunnel" and side != "stern":
            sides = {tunnel.side for tunnel in controls if tunnel.kind == "tunnel"}
            name = "tunnel" if len(sides) == 1 else name
        pitched = {
            propeller.side for propeller in controls if propeller.candidate.quantity.name == "propeller_pitch"
        }
        kind = "controllable_propeller" if kind == "propeller" and side in pitched else kind
        return [ships.Actuator(name, kind)]
    words = _SIDES.get(side, {side})
    for compatible_kind in _COMPATIBLE_KINDS[kind]:
        of_kind = [actuator for actuator in ship if actuator.kind == compatible_kind]
        at_side = [actuator for actuator in of_kind if not words.isdisjoint(actuator.name.split("_"))]
        if of_kind and (at_side or not side or len(of_kind) == 1):
            return at_side or of_kind
    return []
