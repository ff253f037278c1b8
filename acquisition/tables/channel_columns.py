"""Which column is taken for which channel of motion, wind and control, in which unit and why.

The channels are read one after another, each by what is known before: the positions tell the unit of speeds, the
heading that of the rate of turn, ranges that of angles. Where two readings are as likely as each other the draft
asks.

Which columns are of which actuator: kinds and sides by the words of their names, or the ship's own list.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

from seatrial.acquisition.core.conventions import FROM_EAST
from seatrial.acquisition.core.quantities import Floats, scale_to
from seatrial.acquisition.core.ship import BY_NAME, DEFAULT, KINDS, Actuator, Actuators, as_text, name_of_order
from seatrial.acquisition.tables import evidence
from seatrial.acquisition.tables.column_map import (
    Axis,
    MeaningOfO,
    degrees_of_text,
    has_unclear_o,
    names_hemispheres,
    rate,
    signs_of,
    with_hemisphere,
    without_fix,
)
from seatrial.acquisition.tables.column_names import (
    BOW,
    ORDER,
    PORT,
    QUANTITIES,
    STARBOARD,
    STERN,
    TUNNEL,
    headed,
    units_called,
    words_of,
)
from seatrial.acquisition.tables.evidence import (
    GROUND,
    POSITION,
    SKIP,
    UNKNOWN,
    ColumnCandidate,
    Draft,
    Known,
    Told,
    agreement,
    asked,
    best,
    changes_of,
    fit,
    increments,
    integrals,
    mean_angle,
    means,
    measures,
    rate_unit,
    restlessness,
    take,
    take_best,
    turn_round,
)
from seatrial.acquisition.tables.heading_columns import (
    angle_unit,
    check_sway,
    judge_course_column,
    judge_heading_column,
    read_earth_velocity,
    read_heading,
    read_yaw_rate,
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


def read_channels(context: Known, ship: Actuators) -> Actuators:
    """Put the channels that columns hold into ``context`` and the map of its draft; the ship's actuators."""
    read_motion(context)
    for name in _ANGLES:
        take_best(context, name, angle_unit)
    take_best(context, "heave_m", lambda _, heave, __: heave.headed or ("m", "by its name"))
    _read_wind(context)
    return _read_actuators(context, ship)


def read_motion(context: Known) -> None:
    """Put positions, heading, speeds and rate of turn into ``context``, each judged by those before."""
    _read_geographic(context)
    read_heading(context)
    _read_plane(context)
    take_best(context, "speed_over_ground_mps", _speed_unit)
    take_best(context, "course_over_ground_deg", angle_unit)
    judge_course_column(context)
    judge_heading_column(context)
    read_earth_velocity(context)
    for name in _SPEEDS:
        if name not in context.series:
            take_best(context, name, _speed_unit)
    check_sway(context)
    read_yaw_rate(context)


def _read_geographic(context: Known) -> None:
    draft = context.draft
    pairs = [
        (latitude, longitude)
        for latitude in draft.of("latitude")
        for longitude in draft.of("longitude")
        if latitude.units == longitude.units or not (latitude.units and longitude.units)
    ]
    for latitude, longitude in pairs:
        if position := _degrees(draft, latitude, longitude):
            _take_position(context, latitude, longitude, *position)
            return
    if pairs:
        names = ", ".join(f"{first.column!r} and {second.column!r}" for first, second in pairs)
        draft.warnings.append(f"{names} are no latitude and longitude in any unit; they are left out")


def _degrees(
    draft: Draft, latitude: ColumnCandidate, longitude: ColumnCandidate
) -> tuple[Told, list[Floats]] | None:
    """The unit, why, and both in degrees; None where they cannot be a position."""
    if draft.is_empty(latitude.column):
        return None
    columns = [draft.raw.columns[candidate.column] for candidate in (latitude, longitude)]
    if not all(pd.api.types.is_numeric_dtype(column.dtype) for column in columns):
        values, signs = degrees_of_text(columns[0], columns[1], _meaning_of_o(draft, columns[1]))
        values = [
            np.where(np.isnan(sign), value, np.abs(value) * sign) for value, sign in zip(values, signs, strict=True)
        ]
        return (("text", "degrees, minutes and letters"), values) if evidence.are_places(*values) else None
    stated = latitude.units or longitude.units
    for unit in stated or ("deg", "ddmm", "degE7"):
        values = [evidence.in_degrees(draft.numbers(candidate.column), unit) for candidate in (latitude, longitude)]
        if evidence.are_places(*values):
            return (unit, f"head says {unit}" if stated else f"{unit} by their size"), values
    return None


def _meaning_of_o(draft: Draft, column: pd.Series[Any]) -> MeaningOfO | None:
    """What an O means among hemispheres, asked where nothing beside it decides; None where there is none."""
    if "o_is" not in draft.answers and not has_unclear_o(column):
        return None
    text = (
        f"column {column.name!r} has the letter O, which is east in some languages and west in others: which is it?"
    )
    return "west" if draft.ask("o_is", text, ("east", "west")) == "west" else "east"


def _hemispheres(draft: Draft, angle: ColumnCandidate, axis: Axis) -> pd.Series[Any] | None:
    """The column of an angle's hemispheres, by its name or, beside the angle, by what it holds."""
    columns = draft.raw.columns
    names = list(map(str, columns.columns))
    place = names.index(angle.column)
    neighbours = [name for name in names[max(place - 1, 0) : place + 2] if names_hemispheres(columns[name], axis)]
    named = [candidate.column for candidate in draft.of(axis) if not _is_count(draft, candidate.column)]
    for name in [*named, *neighbours]:
        if not draft.is_empty(name):
            return columns[name]
        side = "north" if axis == "north_south" else "east"
        draft.warnings.append(f"the column of hemispheres {name!r} is empty: {side} is taken")
    return None


def _is_count(draft: Draft, column: str) -> bool:
    """Whether a column has numbers beyond those of signs and flags, as ``ns`` has those of satellites."""
    return bool(np.nanmax(np.abs(draft.numbers(column)), initial=0.0) > 1.0)


def _take_position(
    context: Known, latitude: ColumnCandidate, longitude: ColumnCandidate, unit_guess: Told, degrees: list[Floats]
) -> None:
    draft = context.draft
    entry: dict[str, Any] = {"latitude": latitude.column, "longitude": longitude.column, "unit": unit_guess[0]}
    axes: tuple[tuple[ColumnCandidate, Axis], ...] = ((latitude, "north_south"), (longitude, "east_west"))
    for place, (angle, axis) in enumerate(axes):
        if (letters := _hemispheres(draft, angle, axis)) is not None:
            entry[axis] = str(letters.name)
            signs = signs_of(letters, axis, _meaning_of_o(draft, letters) if axis == "east_west" else None)
            degrees[place] = with_hemisphere(degrees[place], signs, draft.raw.columns[angle.column])
            draft.note(str(letters.name), f"{axis} of the position", "", "letters")
    if "o_is" in draft.used:
        entry["o_is"] = draft.answers["o_is"]
    numbers = draft.numbers(latitude.column)
    if missing := [code for code in (91.0, 181.0) if np.any(numbers == code)]:
        entry["missing"] = missing
    draft.tree["position"] = entry
    draft.note(latitude.column, "latitude_deg, north_m", *unit_guess)
    draft.note(longitude.column, "longitude_deg, east_m", *unit_guess)
    valid = evidence.is_place(*degrees)
    if (no_fix := (degrees[0] == 0.0) & (degrees[1] == 0.0)).any():
        draft.warnings.append(without_fix(no_fix))
    fixes = [coordinate[valid] for coordinate in degrees]
    context.origin = float(fixes[0][0]), float(fixes[1][0])
    plane = np.full((2, valid.size), np.nan)
    plane[:, valid] = pymap3d.geodetic2ned(*fixes, 0.0, fixes[0][0], fixes[1][0], 0.0)[:2]
    context.series |= dict(zip(POSITION, plane, strict=True))


def _read_plane(context: Known) -> None:
    """Metres to north and east, or x and y, where there is no latitude."""
    draft, why = context.draft, "by its name"
    north, east, x, y = (best(draft, name) for name in (*POSITION, "x", "y"))
    if "position" in draft.tree:
        return
    if not (north and east) and x and y:
        turned = None if "x_axis" in draft.answers else _is_x_east(context, x, y)
        if turned is False and (column := _yaw_of_any_axes(context)):
            turned, why = _is_x_east_beside_yaw(context, x, y, column)
        elif turned is None:
            answer = draft.ask("x_axis", f"is {x.column!r} to the north or to the east?", _AXES)
            turned, why = answer == "east", "as answered" if answer else "not clear"
        else:
            why = "the track runs where the heading points"
        context.positions_are_sure |= "x_axis" in draft.used
        north, east = (y, x) if turned else (x, y)
    if north and east:
        for name, candidate in zip(POSITION, (north, east), strict=True):
            take(context, name, candidate, (candidate.units or ("m",))[0], why)
            _count_from_start(context, name)


def _yaw_of_any_axes(context: Known) -> str:
    """The heading's column where no name states its axes; empty for a compass' heading and SNAME's words."""
    column = context.channels.get("heading_deg", {}).get("column", "")
    names = [
        candidates.words
        for name in ("heading_deg", "surge_mps", "sway_mps")
        for candidates in context.draft.of(name)[:1]
    ]
    is_yaw = bool(names) and "yaw" in names[0] and not any(words & _SHIP_WORDS for words in names)
    return column if is_yaw else ""


def _is_x_east_beside_yaw(context: Known, x: ColumnCandidate, y: ColumnCandidate, yaw: str) -> tuple[bool, str]:
    """Whether x is to the east beside a yaw that turns as x and y do, and why: the two readings are mirror images.

    The names of ROS say so (REP 103), else it is asked.
    """
    draft = context.draft
    readings = (
        f"{yaw!r} turns as the track of {x.column!r} and {y.column!r} does in either of two readings: x to the"
        f" north and {yaw!r} clockwise from north (NED), or x to the east and {yaw!r} {FROM_EAST.words}"
    )
    if any(_ROS_NAME.search(name) for name in map(str, draft.raw.columns.columns)):
        draft.warnings.append(f"{readings}; the names of ROS say the second, --answer x_axis=north the first")
        context.positions_are_sure = True
        return True, "to the east, as in ROS"
    answer = draft.ask(
        "x_axis", f"{readings}, which mirrors it. Is {x.column!r} to the north or to the east?", _AXES
    )
    return answer == "east", "as answered" if answer else "not clear"


def _count_from_start(context: Known, name: str) -> None:
    """Positions of a grid such as UTM, millions of metres, count from about where they begin."""
    values = context.series[name]
    first = next(iter(values[np.isfinite(values)]), 0.0)
    if abs(first) > BY_NAME[name].high:
        context.channels[name]["offset"] = -1000.0 * round(first / 1000.0)
        context.series[name] = values + context.channels[name]["offset"]
        column = context.channels[name]["column"]
        context.draft.warnings.append(
            f"{column!r} counts from {1000 * round(first / 1000.0):,} m, as grids do (UTM)"
        )


def _is_x_east(context: Known, x: ColumnCandidate, y: ColumnCandidate) -> bool | None:
    """Whether x is to the east by the heading; None where that cannot be told."""
    if "heading_deg" not in context.series or context.grid.size < 3:
        return None
    draft, angle = context.draft, mean_angle(context, context.series["heading_deg"])
    x_moves, y_moves = (
        increments(context.t, draft.numbers(candidate.column), context.grid) for candidate in (x, y)
    )
    body = [draft.of(name) for name in ("surge_mps", "sway_mps")]
    if all(body):
        surge, sway = (
            integrals(context.t, draft.numbers(candidates[0].column), context.grid) for candidates in body
        )
        angle = angle + np.rad2deg(np.arctan2(sway, surge))
    as_north, as_east = agreement(x_moves, y_moves, angle), agreement(y_moves, x_moves, angle)
    return None if abs(as_north - as_east) < 0.3 or max(as_north, as_east) < 0.5 else as_east > as_north


def _speed_unit(context: Known, candidate: ColumnCandidate, name: str) -> Told | None:
    """A speed's unit, and why; None where it is to be left out."""
    values, regression = context.draft.numbers(candidate.column), UNKNOWN
    if name in _ALONG_TRACK and (steps := changes_of(context, *POSITION)):  # sway is across it, and water moves
        sway = next(iter(context.draft.of("sway_mps")), None) if name == "surge_mps" else None
        columns = [values] if sway is None else [values, context.draft.numbers(sway.column)]
        distances = [integrals(context.t, evidence.without_codes(column), context.grid) for column in columns]
        regression = fit(np.hypot(*steps), np.hypot(distances[0], distances[1] if sway else 0.0))
    if unit_guess := rate_unit(context, candidate, regression, evidence.SPEED):
        context.speed_units.add(unit_guess[0])
        return unit_guess
    if len(context.speed_units) == 1:
        return next(iter(context.speed_units)), "as the other speeds"
    if not np.any(values[np.isfinite(values)]):
        return "m/s", "all zero"
    largest = float(np.nanmax(np.abs(evidence.without_codes(values))))
    if largest > FASTEST_MPS:
        context.draft.warnings.append(f"{candidate.column!r} goes up to {largest:.4g}: km/h?")
    text = f"{candidate.column!r}, taken for {name}, goes up to {largest:.3g} in no unit: m/s or knots?"
    return asked(context.draft, "unit.speed", text, evidence.SPEED.units[:3])


def _read_wind(context: Known) -> None:
    draft = context.draft
    for kind, names in _WINDS.items():
        _take_wind(context, kind, *(best(draft, name) for name in names))
    direction, speed = best(draft, "wind_direction"), best(draft, "wind_speed")
    if direction is None or speed is None or "wind_direction_deg" in context.channels:
        return
    wind_kind = (
        "true" if "apparent_wind_angle_deg" in context.channels else _kind_of_wind(context, direction, speed)
    )
    if wind_kind in _WINDS:
        _take_wind(context, wind_kind, direction, speed)


def _take_wind(context: Known, kind: str, angle: ColumnCandidate | None, speed: ColumnCandidate | None) -> None:
    angle_name, speed_name = _WINDS[kind]
    angle_guess = angle_unit(context, angle, angle_name) if angle else None
    if angle and angle_guess:
        take(context, angle_name, angle, *angle_guess)
    unit = _wind_unit(context, speed, angle if kind == "apparent" else None) if speed else None
    if not speed or not unit:
        return
    take(context, speed_name, speed, *unit)
    known_wind = "wind_direction_deg" in context.channels or "heading_deg" not in context.series
    if angle and angle_guess and kind == "apparent" and not known_wind:
        entry = {"angle": angle.column, "speed": speed.column, "speed_unit": unit[0], "angle_unit": angle_guess[0]}
        context.draft.tree["apparent_wind"] = entry


def _wind_unit(context: Known, speed: ColumnCandidate, apparent: ColumnCandidate | None) -> Told | None:
    if speed.headed:
        return speed.headed
    values = context.draft.numbers(speed.column)
    if not np.any(values[np.isfinite(values)]):
        return "m/s", "all zero"
    if apparent is not None:
        changes = {unit: _restlessness(context, apparent, speed, unit) for unit in ("m/s", "knots")}
        restlessness_by_unit = {unit: change["apparent"] for unit, change in changes.items() if change}
        if steadiest := _steadiest(restlessness_by_unit):
            return steadiest, "so the wind over ground is steadiest"
    text = f"{speed.column!r}, a wind speed, goes up to {np.nanmax(values):.3g} in no unit: m/s or knots?"
    return asked(context.draft, "unit.wind", text, evidence.SPEED.units[:3])


def _steadiest(changes: dict[str, float]) -> str | None:
    """The reading of the wind by which it is clearly steadier than by another, if there is one."""
    clear = bool(changes) and max(changes.values()) > _STEADIER * min(changes.values())
    return min(changes, key=changes.__getitem__) if clear else None


def _kind_of_wind(context: Known, direction: ColumnCandidate, speed: ColumnCandidate) -> str | None:
    """True wind, or apparent: of the two the one that makes the steadier wind over ground."""
    changes = _restlessness(context, direction, speed, (speed.units or ("m/s",))[0])
    kind = None if "wind" in context.draft.answers else _steadiest(changes)
    if kind:
        times = max(changes.values()) / max(min(changes.values()), 1e-12)
        why = f"{kind}: taken otherwise it would change {times:.1f} times as much"
        context.draft.note(direction.column, "wind", "", why)
        return kind
    text = f"{direction.column!r} and {speed.column!r}: the true wind, or the apparent wind from the bow?"
    return context.draft.ask("wind", text, tuple(_WINDS))


def _restlessness(
    context: Known, direction: ColumnCandidate, speed: ColumnCandidate, unit: str
) -> dict[str, float]:
    """How much the wind over ground changes if the columns are of the true wind, and of the apparent."""
    heading, motion = context.series.get("heading_deg"), _velocity(context)
    if heading is None or motion is None or context.grid.size < 3:
        return {}
    size = context.draft.numbers(speed.column) * scale_to("m/s", unit)
    angle = context.draft.numbers(direction.column) * scale_to("deg", (direction.units or ("deg",))[0])
    winds = {"true": _vector(size, angle), "apparent": _vector(size, angle + heading) - motion}
    changes = {kind: restlessness(context.t, wind, context.grid) for kind, wind in winds.items()}
    return {} if np.isnan(list(changes.values())).any() else changes


def _velocity(context: Known) -> np.ndarray | None:
    """The ship's velocity to north + i east [n], if it is known."""
    series = context.series
    if {"surge_mps", "sway_mps", "heading_deg"} <= set(series):
        return np.asarray((series["surge_mps"] + 1j * series["sway_mps"]) * _vector(1.0, series["heading_deg"]))
    if set(GROUND) <= set(series):
        return _vector(series["speed_over_ground_mps"], series["course_over_ground_deg"])
    if "north_m" not in series:
        return None
    return np.asarray(rate(context.t, series["north_m"]) + 1j * rate(context.t, series["east_m"]))


def _vector(size: Floats | float, angle_deg: Floats) -> np.ndarray:
    """Complex numbers of a size [n] and an angle [n]."""
    return np.asarray(size * np.exp(1j * np.deg2rad(angle_deg)))


def _read_actuators(context: Known, ship: Actuators) -> Actuators:
    actuators, columns = find_actuators(context.draft, ship)
    if not ship and as_text(actuators):
        context.draft.tree["actuator"] = [{"name": actuator.name, "kind": actuator.kind} for actuator in actuators]
    for column in columns:
        _take_control(context, column)
    return actuators


def _take_control(context: Known, control: Found) -> None:
    candidate, unit = control.candidate, BY_NAME[control.channel].unit
    if "percent" in candidate.units[:1] and unit != "%":
        _take_share(context, control, "deg" if unit == "deg" else "rpm")
        return
    if unit == "%":
        unit_guess: Told | None = ((candidate.units or ("%",))[0], "")
    elif unit == "deg":
        unit_guess = angle_unit(context, candidate, control.channel)
    else:
        unit_guess = _turns_unit(context.draft, candidate)
    if unit_guess:
        take(context, control.channel, candidate, *unit_guess, control.why)
        if unit == "deg":
            _check_helm(context, control)


def _take_share(context: Known, control: Found, unit: str) -> None:
    """A column in percent of a full scale that only a person knows."""
    draft, column = context.draft, control.candidate.column
    key = f"full_scale.{control.channel.removesuffix('_rpm').removesuffix('_angle_deg')}"
    wide = "full_scale" in draft.answers and key not in draft.answers
    text = f"{column!r} is in percent: of how many {unit}?"
    full_scale = draft.ask("full_scale" if wide else key, text, (), SKIP)
    if full_scale is None or full_scale == SKIP:
        draft.warnings.append(
            f"{column!r} is in percent of an unknown full scale and left out; use --answer {key}=NUMBER"
        )
        draft.note(column, "-", "percent", "left out: percent of an unknown full scale")
        return
    why = f"100 % is {full_scale} {unit}, as answered"
    take(context, control.channel, control.candidate, "percent", why, control.why, full_scale=float(full_scale))


def _turns_unit(draft: Draft, candidate: ColumnCandidate) -> Told | None:
    if candidate.headed:
        return candidate.headed
    values = draft.numbers(candidate.column)
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    text = f"{candidate.column!r} goes up to {largest:.3g}: turns a minute or a second?"
    return evidence.turns_by_range(largest, candidate.words) or asked(
        draft, f"unit.{candidate.column}", text, ("rpm", "rps")
    )


def _check_helm(context: Known, control: Found) -> None:
    """Turn the sign of a helm that turns the ship the other way."""
    turns, rate_of_turn = KINDS[control.kind].turns, context.series.get("yaw_rate_dps")
    steps = changes_of(context, "heading_deg")
    if not turns or context.heading_is_asked or context.grid.size < 3 or (rate_of_turn is None and not steps):
        return
    turned = steps[0] if rate_of_turn is None else means(context.t, rate_of_turn, context.grid)
    helm = np.sin(np.deg2rad(means(context.t, context.series[control.channel], context.grid)))
    lagged = [fit(turned[lag:], helm[: helm.size - lag]).correlation for lag in range(4)]
    if max(lagged, key=abs) * turns < -0.5:
        way = "port" if turns > 0 else "starboard"
        turn_round(context, control.channel, f"positive turned the ship to {way}")


_KIND_OF = {"rudder": "rudder", "azimuth": "azimuth", "shaft": "propeller", "propeller_pitch": "propeller"}
_ENDING = {"rudder": "_angle_deg", "azimuth": "_angle_deg", "shaft": "_rpm", "propeller_pitch": "_pitch_percent"}
_LIKE = {
    "propeller": ("propeller", "controllable_propeller", "waterjet", "azimuth"),
    "azimuth": ("azimuth", "waterjet"),
    "rudder": ("rudder",),
    "tunnel": ("tunnel",),
}
"""The kinds of a known ship's actuators that a column of a kind may be of, the likeliest first."""
_QUANTITY_OF = {"rpm": "shaft", "deg": "azimuth", "%": "propeller_pitch"}
_NUMBERED = re.compile(r"[a-z]{1,2}\d")
_SIDES = {"port": PORT, "starboard": STARBOARD, "bow": BOW, "stern": STERN}
_AZIMUTH_WORDS = frozenset({"az", "azi", "azimuth", "azimut", "asimut", "pod"})


@dataclass(frozen=True, slots=True)
class Found:
    """A column that tells of an actuator: its control channel, or the channel of the orders to it."""

    candidate: ColumnCandidate
    channel: str
    kind: str
    why: str


@dataclass(frozen=True, slots=True)
class _Part:
    candidate: ColumnCandidate
    kind: str
    side: str
    is_order: bool


def find_actuators(draft: Draft, ship: Actuators = ()) -> tuple[Actuators, list[Found]]:
    """The actuators that columns tell of, or a known ``ship``'s, and the columns with the channels they become."""
    exact = _by_name(draft, ship or _named(draft))
    used_columns = {column.candidate.column for column in exact}
    parts = [_part(candidate) for candidate in draft.of(*_KIND_OF) if candidate.column not in used_columns]
    azimuths = {control.side for control in parts if control.kind == "azimuth"}
    parts = [  # a shaft at the side of an azimuth thruster is the thruster's
        replace(control, kind="azimuth") if control.kind == "propeller" and control.side in azimuths else control
        for control in parts
    ]
    columns = {column.channel: column for column in exact}
    kinds = {device.name: device.kind for device in _named(draft)}
    pitched = {control.side for control in parts if control.candidate.quantity.name == "propeller_pitch"}
    for part in sorted(parts, key=lambda control: control.is_order):
        matched = _actuators_of_part(part, ship) if ship else [_new_actuator(part, parts, pitched)]
        if len(matched) > 1:
            names = " and ".join(device.name for device in matched)
            draft.warnings.append(f"{part.candidate.column!r} names no side: it is taken for {names} alike")
        for actuator in matched:
            stem = actuator.name + _ENDING[part.candidate.quantity.name]
            if stem not in {channel.name for channel in actuator.channels}:
                continue
            channel = name_of_order(stem) if part.is_order and stem in columns else stem
            if channel in columns:
                rival = columns[channel].candidate.column
                draft.note(part.candidate.column, "-", "", f"not used: {rival!r} is taken for it")
                continue
            why = f"{actuator.name}: {actuator.kind.replace('_', ' ')}"
            columns[channel] = Found(
                part.candidate, channel, actuator.kind, why + (", its order" if part.is_order else "")
            )
            kinds[actuator.name] = actuator.kind
    actuators = tuple(Actuator(name, kind) for name, kind in kinds.items())
    if set(actuators) <= set(DEFAULT) and actuators:
        actuators = DEFAULT
    return ship or actuators, list(columns.values())


def _named(draft: Draft) -> Actuators:
    """The usual ship's actuators where columns have the names of their angles, as shafts alone may be another's;
    else thrusters whose shaft and angle have one short name of their own."""
    names = list(map(str, draft.raw.columns.columns))
    angles = {channel.name for actuator in DEFAULT for channel in actuator.channels if channel.unit == "deg"}
    if angles & set(names):
        return DEFAULT
    heads = {name.lower().replace(" ", "_"): units for name, units, _ in map(headed, names)}
    return tuple(  # t1 rpm beside t1 angle [deg]: a number of a maker's own
        Actuator(name, "azimuth")
        for name, units in heads.items()
        if _NUMBERED.fullmatch(name) and "rpm" in units and f"{name}_angle" in heads
    )


def _by_name(draft: Draft, ship: Actuators) -> list[Found]:
    """The columns that are called as a ship's own channels, with a blank for a line or their unit in brackets."""
    channels = {channel.name: (actuator, channel.unit) for actuator in ship for channel in actuator.channels}
    orders = {name_of_order(name): owner for name, owner in channels.items()}
    columns: dict[str, Found] = {}
    for column in map(str, draft.raw.columns.columns):
        head = headed(column)
        stems = {re.sub(r"\W+", "_", name.strip().lower()) for name in (column, head.name)}
        for channel, (actuator, unit) in (channels | orders).items():
            is_called = channel in stems or (channel.rpartition("_")[0] in stems and bool(head.units))
            if is_called and channel not in columns and (not head.units or _fits(unit, head.units)):
                quantity = next(entry for entry in QUANTITIES if entry.name == _QUANTITY_OF[unit])
                units = head.units or units_called(draft.raw.units.get(column, ""))
                candidate = ColumnCandidate(column, quantity, 1.0, units, frozenset(words_of(column)))
                columns[channel] = Found(candidate, channel, actuator.kind, f"{actuator.name}: by its name")
    return list(columns.values())


def _fits(unit: str, stated: tuple[str, ...]) -> bool:
    quantity = next(entry for entry in QUANTITIES if entry.name == _QUANTITY_OF[unit])
    return any(measures(quantity, spelling) for spelling in stated)


def _part(candidate: ColumnCandidate) -> _Part:
    words = candidate.words
    kind = _KIND_OF[candidate.quantity.name]
    if candidate.quantity.name == "shaft" and words & (TUNNEL | (BOW | STERN) - {"forward", "aft", "fwd"}):
        kind = "tunnel"
    if candidate.quantity.name == "shaft" and words & _AZIMUTH_WORDS:
        kind = "azimuth"
    side = next((name for name, markers in _SIDES.items() if words & markers), "")
    number = next((word for word in sorted(words) if word.isdigit() and len(word) == 1), "")
    return _Part(candidate, kind, side or number, bool(words & ORDER))


def _actuators_of_part(part: _Part, ship: Actuators) -> list[Actuator]:
    """The ship's actuators that a column tells of; without a side all of a kind, as of one order to a pair."""
    words = _SIDES.get(part.side, {part.side})
    for kind in _LIKE[part.kind]:
        of_kind = [actuator for actuator in ship if actuator.kind == kind]
        at_side = [actuator for actuator in of_kind if not words.isdisjoint(actuator.name.split("_"))]
        if of_kind and (at_side or not part.side or len(of_kind) == 1):
            return at_side or of_kind
    return []


def _new_actuator(part: _Part, parts: Iterable[_Part], pitched: set[str]) -> Actuator:
    """An actuator of a ship that nothing else is known of."""
    if part.kind == "azimuth":
        return Actuator(
            _name(part.side, "azimuth") if part.side.isdigit() or not part.side else part.side, "azimuth"
        )
    if part.kind == "tunnel":
        sides = {control.side for control in parts if control.kind == "tunnel"}
        return Actuator(
            "tunnel" if len(sides) == 1 and part.side != "stern" else _name(part.side, "tunnel"), "tunnel"
        )
    kind = "controllable_propeller" if part.kind == "propeller" and part.side in pitched else part.kind
    assert kind in KINDS
    return Actuator(_name(part.side, part.kind), kind)


def _name(side: str, kind: str) -> str:
    return f"{kind}_{side}" if side.isdigit() else f"{side}_{kind}" if side else kind
