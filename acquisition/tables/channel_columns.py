"""Which column is taken for which channel of motion, wind and control, in which unit and why.

The channels are read one after another, each by what is known before: the positions tell the unit of speeds, the
heading that of the rate of turn, ranges that of angles. Where two readings are as likely as each other the draft
asks.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

from acquisition.core.actuators import KINDS, Actuators, as_text
from acquisition.core.arrays import Floats
from acquisition.core.channels import BY_NAME
from acquisition.core.conventions import FROM_EAST
from acquisition.core.units import scale_to
from acquisition.tables import evidence
from acquisition.tables.actuator_columns import Found, find_actuators
from acquisition.tables.column_map import without_fix
from acquisition.tables.coordinates import (
    Axis,
    MeaningOfO,
    degrees_of_text,
    has_unclear_o,
    names_hemispheres,
    signs_of,
    with_hemisphere,
)
from acquisition.tables.derived_columns import rate
from acquisition.tables.draft import SKIP, Candidate, Draft
from acquisition.tables.evidence import Told, agreement, fit, increments, integrals, means, restlessness
from acquisition.tables.heading_columns import (
    angle_unit,
    check_sway,
    judge_course_column,
    judge_heading_column,
    read_earth_velocity,
    read_heading,
    read_yaw_rate,
)
from acquisition.tables.table_context import (
    GROUND,
    POSITION,
    UNKNOWN,
    Known,
    asked,
    best,
    changes_of,
    mean_angle,
    rate_unit,
    take,
    take_best,
    turn_round,
)

FASTEST_MPS = 30.0  # what a speed channel holds
_STEADIER = 2.0  # a reading of the wind by which it changes half as much, in the mean square, is the right one
_WINDS = {
    "true": ("wind_direction_deg", "wind_speed_mps"),
    "apparent": ("apparent_wind_angle_deg", "apparent_wind_speed_mps"),
}
_ALONG_TRACK = ("speed_over_ground_mps", "surge_mps")
_SPEEDS = ("surge_mps", "sway_mps", "speed_through_water_mps")
_AXES = ("north", "east")
_SHIP_WORDS = frozenset({"psi", "heading", "hdg", "compass", "gyro", "surge", "sway", "u", "v"})
"""Words of compasses and of SNAME's notation (1950), whose headings and axes count from north and down."""
_ROS_NAME = re.compile(r"(?:^|[./])(?:field|header|odom|pose|twist)[./]")
_ANGLES = ("roll_deg", "pitch_deg", "heading_magnetic_deg", "magnetic_variation_deg")


def read_channels(known: Known, ship: Actuators) -> Actuators:
    """Put the channels that columns hold into ``known`` and the map of its draft; the ship's actuators."""
    read_motion(known)
    for name in _ANGLES:
        take_best(known, name, angle_unit)
    take_best(known, "heave_m", lambda _, heave, __: heave.headed or ("m", "by its name"))
    _read_wind(known)
    return _read_actuators(known, ship)


def read_motion(known: Known) -> None:
    """Put positions, heading, speeds and rate of turn into ``known``, each judged by those before."""
    _read_geographic(known)
    read_heading(known)
    _read_plane(known)
    take_best(known, "speed_over_ground_mps", _speed_unit)
    take_best(known, "course_over_ground_deg", angle_unit)
    judge_course_column(known)
    judge_heading_column(known)
    read_earth_velocity(known)
    for name in _SPEEDS:
        if name not in known.series:
            take_best(known, name, _speed_unit)
    check_sway(known)
    read_yaw_rate(known)


def _read_geographic(known: Known) -> None:
    draft = known.draft
    pairs = [
        (latitude, longitude)
        for latitude in draft.of("latitude")
        for longitude in draft.of("longitude")
        if latitude.units == longitude.units or not (latitude.units and longitude.units)
    ]
    for latitude, longitude in pairs:
        if found := _degrees(draft, latitude, longitude):
            _take_position(known, latitude, longitude, *found)
            return
    if pairs:
        names = ", ".join(f"{one.column!r} and {two.column!r}" for one, two in pairs)
        draft.warnings.append(f"{names} are no latitude and longitude in any unit; they are left out")


def _degrees(draft: Draft, latitude: Candidate, longitude: Candidate) -> tuple[Told, list[Floats]] | None:
    """The unit, why, and both in degrees; None where they cannot be a position."""
    if draft.is_empty(latitude.column):
        return None
    columns = [draft.raw.columns[each.column] for each in (latitude, longitude)]
    if not all(pd.api.types.is_numeric_dtype(column.dtype) for column in columns):
        values, signs = degrees_of_text(columns[0], columns[1], _meaning_of_o(draft, columns[1]))
        values = [
            np.where(np.isnan(sign), value, np.abs(value) * sign) for value, sign in zip(values, signs, strict=True)
        ]
        return (("text", "degrees, minutes and letters"), values) if evidence.are_places(*values) else None
    said = latitude.units or longitude.units
    for unit in said or ("deg", "ddmm", "degE7"):
        values = [evidence.in_degrees(draft.numbers(each.column), unit) for each in (latitude, longitude)]
        if evidence.are_places(*values):
            return (unit, f"head says {unit}" if said else f"{unit} by their size"), values
    return None


def _meaning_of_o(draft: Draft, column: pd.Series[Any]) -> MeaningOfO | None:
    """What an O means among hemispheres, asked where nothing beside it decides; None where there is none."""
    if "o_is" not in draft.answers and not has_unclear_o(column):
        return None
    text = (
        f"column {column.name!r} has the letter O, which is east in some languages and west in others: which is it?"
    )
    return "west" if draft.ask("o_is", text, ("east", "west")) == "west" else "east"


def _hemispheres(draft: Draft, angle: Candidate, axis: Axis) -> pd.Series[Any] | None:
    """The column of an angle's hemispheres, by its name or, beside the angle, by what it holds."""
    columns = draft.raw.columns
    names = list(map(str, columns.columns))
    place = names.index(angle.column)
    beside = [name for name in names[max(place - 1, 0) : place + 2] if names_hemispheres(columns[name], axis)]
    named = [each.column for each in draft.of(axis) if not _is_count(draft, each.column)]
    for name in [*named, *beside]:
        if not draft.is_empty(name):
            return columns[name]
        side = "north" if axis == "north_south" else "east"
        draft.warnings.append(f"the column of hemispheres {name!r} is empty: {side} is taken")
    return None


def _is_count(draft: Draft, column: str) -> bool:
    """Whether a column has numbers beyond those of signs and flags, as ``ns`` has those of satellites."""
    return bool(np.nanmax(np.abs(draft.numbers(column)), initial=0.0) > 1.0)


def _take_position(
    known: Known, latitude: Candidate, longitude: Candidate, told: Told, degrees: list[Floats]
) -> None:
    draft = known.draft
    entry: dict[str, Any] = {"latitude": latitude.column, "longitude": longitude.column, "unit": told[0]}
    axes: tuple[tuple[Candidate, Axis], ...] = ((latitude, "north_south"), (longitude, "east_west"))
    for place, (angle, axis) in enumerate(axes):
        if (letters := _hemispheres(draft, angle, axis)) is not None:
            entry[axis] = str(letters.name)
            signs = signs_of(letters, axis, _meaning_of_o(draft, letters) if axis == "east_west" else None)
            degrees[place] = with_hemisphere(degrees[place], signs, draft.raw.columns[angle.column])
            draft.note(str(letters.name), f"{axis} of the position", "", "letters")
    if "o_is" in draft.used:
        entry["o_is"] = draft.answers["o_is"]
    numbers = draft.numbers(latitude.column)
    if missing := [each for each in (91.0, 181.0) if np.any(numbers == each)]:
        entry["missing"] = missing
    draft.tree["position"] = entry
    draft.note(latitude.column, "latitude_deg, north_m", *told)
    draft.note(longitude.column, "longitude_deg, east_m", *told)
    valid = evidence.is_place(*degrees)
    if (nowhere := (degrees[0] == 0.0) & (degrees[1] == 0.0)).any():
        draft.warnings.append(without_fix(nowhere))
    there = [each[valid] for each in degrees]
    known.origin = float(there[0][0]), float(there[1][0])
    plane = np.full((2, valid.size), np.nan)
    plane[:, valid] = pymap3d.geodetic2ned(*there, 0.0, there[0][0], there[1][0], 0.0)[:2]
    known.series |= dict(zip(POSITION, plane, strict=True))


def _read_plane(known: Known) -> None:
    """Metres to north and east, or x and y, where there is no latitude."""
    draft, why = known.draft, "by its name"
    north, east, x, y = (best(draft, name) for name in (*POSITION, "x", "y"))
    if "position" in draft.tree:
        return
    if not (north and east) and x and y:
        turned = None if "x_axis" in draft.answers else _is_x_east(known, x, y)
        if turned is False and (column := _yaw_of_any_axes(known)):
            turned, why = _is_x_east_beside_yaw(known, x, y, column)
        elif turned is None:
            answer = draft.ask("x_axis", f"is {x.column!r} to the north or to the east?", _AXES)
            turned, why = answer == "east", "as answered" if answer else "not clear"
        else:
            why = "the track runs where the heading points"
        known.positions_are_sure |= "x_axis" in draft.used
        north, east = (y, x) if turned else (x, y)
    if north and east:
        for name, each in zip(POSITION, (north, east), strict=True):
            take(known, name, each, (each.units or ("m",))[0], why)
            _count_from_start(known, name)


def _yaw_of_any_axes(known: Known) -> str:
    """The heading's column where no name states its axes; empty for a compass' heading and SNAME's words."""
    column = known.channels.get("heading_deg", {}).get("column", "")
    names = [each.words for name in ("heading_deg", "surge_mps", "sway_mps") for each in known.draft.of(name)[:1]]
    is_yaw = bool(names) and "yaw" in names[0] and not any(words & _SHIP_WORDS for words in names)
    return column if is_yaw else ""


def _is_x_east_beside_yaw(known: Known, x: Candidate, y: Candidate, yaw: str) -> tuple[bool, str]:
    """Whether x is to the east beside a yaw that turns as x and y do, and why: the two readings are mirror images.

    The names of ROS say so (REP 103), else it is asked.
    """
    draft = known.draft
    readings = (
        f"{yaw!r} turns as the track of {x.column!r} and {y.column!r} does in either of two readings: x to the"
        f" north and {yaw!r} clockwise from north (NED), or x to the east and {yaw!r} {FROM_EAST.words}"
    )
    if any(_ROS_NAME.search(name) for name in map(str, draft.raw.columns.columns)):
        draft.warnings.append(f"{readings}; the names of ROS say the second, --answer x_axis=north the first")
        known.positions_are_sure = True
        return True, "to the east, as in ROS"
    answer = draft.ask(
        "x_axis", f"{readings}, which mirrors it. Is {x.column!r} to the north or to the east?", _AXES
    )
    return answer == "east", "as answered" if answer else "not clear"


def _count_from_start(known: Known, name: str) -> None:
    """Positions of a grid such as UTM, millions of metres, count from about where they begin."""
    values = known.series[name]
    first = next(iter(values[np.isfinite(values)]), 0.0)
    if abs(first) > BY_NAME[name].high:
        known.channels[name]["offset"] = -1000.0 * round(first / 1000.0)
        known.series[name] = values + known.channels[name]["offset"]
        column = known.channels[name]["column"]
        known.draft.warnings.append(f"{column!r} counts from {1000 * round(first / 1000.0):,} m, as grids do (UTM)")


def _is_x_east(known: Known, x: Candidate, y: Candidate) -> bool | None:
    """Whether x is to the east by the heading; None where that cannot be told."""
    if "heading_deg" not in known.series or known.grid.size < 3:
        return None
    draft, angle = known.draft, mean_angle(known, known.series["heading_deg"])
    one, two = (increments(known.t, draft.numbers(each.column), known.grid) for each in (x, y))
    body = [draft.of(name) for name in ("surge_mps", "sway_mps")]
    if all(body):
        surge, sway = (integrals(known.t, draft.numbers(each[0].column), known.grid) for each in body)
        angle = angle + np.rad2deg(np.arctan2(sway, surge))
    as_north, as_east = agreement(one, two, angle), agreement(two, one, angle)
    return None if abs(as_north - as_east) < 0.3 or max(as_north, as_east) < 0.5 else as_east > as_north


def _speed_unit(known: Known, candidate: Candidate, name: str) -> Told | None:
    """A speed's unit, and why; None where it is to be left out."""
    values, found = known.draft.numbers(candidate.column), UNKNOWN
    if name in _ALONG_TRACK and (steps := changes_of(known, *POSITION)):  # sway is across it, and water moves
        aside = next(iter(known.draft.of("sway_mps")), None) if name == "surge_mps" else None
        columns = [values] if aside is None else [values, known.draft.numbers(aside.column)]
        made = [integrals(known.t, evidence.without_codes(each), known.grid) for each in columns]
        found = fit(np.hypot(*steps), np.hypot(made[0], made[1] if aside else 0.0))
    if told := rate_unit(known, candidate, found, evidence.SPEED):
        known.speed_units.add(told[0])
        return told
    if len(known.speed_units) == 1:
        return next(iter(known.speed_units)), "as the other speeds"
    if not np.any(values[np.isfinite(values)]):
        return "m/s", "all zero"
    largest = float(np.nanmax(np.abs(evidence.without_codes(values))))
    if largest > FASTEST_MPS:
        known.draft.warnings.append(f"{candidate.column!r} goes up to {largest:.4g}: km/h?")
    text = f"{candidate.column!r}, taken for {name}, goes up to {largest:.3g} in no unit: m/s or knots?"
    return asked(known.draft, "unit.speed", text, evidence.SPEED.units[:3])


def _read_wind(known: Known) -> None:
    draft = known.draft
    for kind, names in _WINDS.items():
        _take_wind(known, kind, *(best(draft, name) for name in names))
    direction, speed = best(draft, "wind_direction"), best(draft, "wind_speed")
    if direction is None or speed is None or "wind_direction_deg" in known.channels:
        return
    told = "true" if "apparent_wind_angle_deg" in known.channels else _kind_of_wind(known, direction, speed)
    if told in _WINDS:
        _take_wind(known, told, direction, speed)


def _take_wind(known: Known, kind: str, angle: Candidate | None, speed: Candidate | None) -> None:
    angle_name, speed_name = _WINDS[kind]
    told = angle_unit(known, angle, angle_name) if angle else None
    if angle and told:
        take(known, angle_name, angle, *told)
    unit = _wind_unit(known, speed, angle if kind == "apparent" else None) if speed else None
    if not speed or not unit:
        return
    take(known, speed_name, speed, *unit)
    known_wind = "wind_direction_deg" in known.channels or "heading_deg" not in known.series
    if angle and told and kind == "apparent" and not known_wind:
        entry = {"angle": angle.column, "speed": speed.column, "speed_unit": unit[0], "angle_unit": told[0]}
        known.draft.tree["apparent_wind"] = entry


def _wind_unit(known: Known, speed: Candidate, apparent: Candidate | None) -> Told | None:
    if speed.headed:
        return speed.headed
    values = known.draft.numbers(speed.column)
    if not np.any(values[np.isfinite(values)]):
        return "m/s", "all zero"
    if apparent is not None:
        changes = {unit: _restlessness(known, apparent, speed, unit) for unit in ("m/s", "knots")}
        told = {unit: change["apparent"] for unit, change in changes.items() if change}
        if steadiest := _steadiest(told):
            return steadiest, "so the wind over ground is steadiest"
    text = f"{speed.column!r}, a wind speed, goes up to {np.nanmax(values):.3g} in no unit: m/s or knots?"
    return asked(known.draft, "unit.wind", text, evidence.SPEED.units[:3])


def _steadiest(changes: dict[str, float]) -> str | None:
    """The reading of the wind by which it is clearly steadier than by another, if there is one."""
    clear = bool(changes) and max(changes.values()) > _STEADIER * min(changes.values())
    return min(changes, key=changes.__getitem__) if clear else None


def _kind_of_wind(known: Known, direction: Candidate, speed: Candidate) -> str | None:
    """True wind, or apparent: of the two the one that makes the steadier wind over ground."""
    changes = _restlessness(known, direction, speed, (speed.units or ("m/s",))[0])
    kind = None if "wind" in known.draft.answers else _steadiest(changes)
    if kind:
        times = max(changes.values()) / max(min(changes.values()), 1e-12)
        why = f"{kind}: taken otherwise it would change {times:.1f} times as much"
        known.draft.note(direction.column, "wind", "", why)
        return kind
    text = f"{direction.column!r} and {speed.column!r}: the true wind, or the apparent wind from the bow?"
    return known.draft.ask("wind", text, tuple(_WINDS))


def _restlessness(known: Known, direction: Candidate, speed: Candidate, unit: str) -> dict[str, float]:
    """How much the wind over ground changes if the columns are of the true wind, and of the apparent."""
    heading, motion = known.series.get("heading_deg"), _velocity(known)
    if heading is None or motion is None or known.grid.size < 3:
        return {}
    size = known.draft.numbers(speed.column) * scale_to("m/s", unit)
    angle = known.draft.numbers(direction.column) * scale_to("deg", (direction.units or ("deg",))[0])
    winds = {"true": _vector(size, angle), "apparent": _vector(size, angle + heading) - motion}
    changes = {kind: restlessness(known.t, each, known.grid) for kind, each in winds.items()}
    return {} if np.isnan(list(changes.values())).any() else changes


def _velocity(known: Known) -> np.ndarray | None:
    """The ship's velocity to north + i east [n], if it is known."""
    series = known.series
    if {"surge_mps", "sway_mps", "heading_deg"} <= set(series):
        return np.asarray((series["surge_mps"] + 1j * series["sway_mps"]) * _vector(1.0, series["heading_deg"]))
    if set(GROUND) <= set(series):
        return _vector(series["speed_over_ground_mps"], series["course_over_ground_deg"])
    if "north_m" not in series:
        return None
    return np.asarray(rate(known.t, series["north_m"]) + 1j * rate(known.t, series["east_m"]))


def _vector(size: Floats | float, angle_deg: Floats) -> np.ndarray:
    """Complex numbers of a size [n] and an angle [n]."""
    return np.asarray(size * np.exp(1j * np.deg2rad(angle_deg)))


def _read_actuators(known: Known, ship: Actuators) -> Actuators:
    actuators, columns = find_actuators(known.draft, ship)
    if not ship and as_text(actuators):
        known.draft.tree["actuator"] = [{"name": each.name, "kind": each.kind} for each in actuators]
    for each in columns:
        _take_control(known, each)
    return actuators


def _take_control(known: Known, found: Found) -> None:
    candidate, unit = found.candidate, BY_NAME[found.channel].unit
    if "percent" in candidate.units[:1] and unit != "%":
        _take_share(known, found, "deg" if unit == "deg" else "rpm")
        return
    if unit == "%":
        told: Told | None = ((candidate.units or ("%",))[0], "")
    elif unit == "deg":
        told = angle_unit(known, candidate, found.channel)
    else:
        told = _turns_unit(known.draft, candidate)
    if told:
        take(known, found.channel, candidate, *told, found.why)
        if unit == "deg":
            _check_helm(known, found)


def _take_share(known: Known, found: Found, unit: str) -> None:
    """A column in percent of a full scale that only a person knows."""
    draft, column = known.draft, found.candidate.column
    key = f"full_scale.{found.channel.removesuffix('_rpm').removesuffix('_angle_deg')}"
    wide = "full_scale" in draft.answers and key not in draft.answers
    text = f"{column!r} is in percent: of how many {unit}?"
    given = draft.ask("full_scale" if wide else key, text, (), SKIP)
    if given is None or given == SKIP:
        draft.warnings.append(
            f"{column!r} is in percent of an unknown full scale and left out; use --answer {key}=NUMBER"
        )
        draft.note(column, "-", "percent", "left out: percent of an unknown full scale")
        return
    why = f"100 % is {given} {unit}, as answered"
    take(known, found.channel, found.candidate, "percent", why, found.why, full_scale=float(given))


def _turns_unit(draft: Draft, candidate: Candidate) -> Told | None:
    if candidate.headed:
        return candidate.headed
    values = draft.numbers(candidate.column)
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    text = f"{candidate.column!r} goes up to {largest:.3g}: turns a minute or a second?"
    return evidence.turns_by_range(largest, candidate.words) or asked(
        draft, f"unit.{candidate.column}", text, ("rpm", "rps")
    )


def _check_helm(known: Known, found: Found) -> None:
    """Turn the sign of a helm that turns the ship the other way."""
    turns, rate_of_turn = KINDS[found.kind].turns, known.series.get("yaw_rate_dps")
    steps = changes_of(known, "heading_deg")
    if not turns or known.heading_is_asked or known.grid.size < 3 or (rate_of_turn is None and not steps):
        return
    turned = steps[0] if rate_of_turn is None else means(known.t, rate_of_turn, known.grid)
    helm = np.sin(np.deg2rad(means(known.t, known.series[found.channel], known.grid)))
    lagged = [fit(turned[lag:], helm[: helm.size - lag]).correlation for lag in range(4)]
    if max(lagged, key=abs) * turns < -0.5:
        way = "port" if turns > 0 else "starboard"
        turn_round(known, found.channel, f"positive turned the ship to {way}")
