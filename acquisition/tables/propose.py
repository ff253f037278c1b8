"""A column map for a table that nobody has described: what each column is taken for, in which unit, and why.

Names say what a column may be, heads say units, and what neither says is looked for in the numbers: positions tell
the unit of speeds, the heading that of the rate of turn, ranges that of angles. Where two readings are as likely as
each other the proposal asks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import pymap3d

from acquisition.core.actuators import DEFAULT as DEFAULT_SHIP
from acquisition.core.actuators import KINDS, Actuators, as_text
from acquisition.core.angles import unwrap
from acquisition.core.arrays import Floats
from acquisition.core.channels import BY_NAME, find_channel, trial_names
from acquisition.core.errors import InputError
from acquisition.core.units import from_degrees_and_minutes, scale_to
from acquisition.tables.actuator_columns import Found, find_actuators
from acquisition.tables.column_map import Long, from_text, widen
from acquisition.tables.draft import (
    SKIP,
    Candidate,
    Draft,
    Question,
    Reading,
    as_toml,
    candidates_of,
    check_keys,
    with_answers,
)
from acquisition.tables.motion_evidence import (
    Fit,
    agreement,
    fit,
    grid_of,
    increments,
    integrals,
    means,
    restlessness,
)
from acquisition.tables.table_files import RawTable, parse_numbers, read_times
from acquisition.tables.time_columns import TimeColumn, resolve_times
from acquisition.tables.time_reading import read_time

_SPEED_UNITS = ("m/s", "knots", "km/h", "cm/s", "mm/s")
_RATE_UNITS = ("deg/s", "deg/min", "rad/s")
_WINDS = {
    "true": ("wind_direction_deg", "wind_speed_mps"),
    "apparent": ("apparent_wind_angle_deg", "apparent_wind_speed_mps"),
}
_NO_VALUE = (
    -9999.0, -999.0, -99.0, -9999.9, -999.9, 999.0, 999.9, 999.99, 9999.0, 9999.9, 99999.0, 999999.0, 511.0, 102.3,
    91.0, 181.0, 32767.0, -32768.0, 65535.0, 1e10, -1e10, 1e20, 1e30, 1e35,
)  # fmt: skip
"""Numbers that loggers and AIS (ITU-R M.1371) write for no value, where the quantity cannot have them."""
_FASTEST_MPS = 30.0  # what a speed channel holds
_NEAR = 1.35  # a fit this near to a unit is of it: knots and m/s are a factor 1.94 apart, km/h and knots 1.85
_ODD = 1.15  # a fit further off than this is said
_MOST_VARIABLES = 500
_STEADIER = 2.0  # a reading of the wind by which it changes half as much, in the mean square, is the right one
_UNKNOWN = Fit(np.nan, 0.0, 0)


@dataclass(frozen=True, slots=True)
class Proposal:
    """A map as TOML, what each column was taken for, what is asked and what looks odd."""

    text: str
    readings: tuple[Reading, ...]
    questions: tuple[Question, ...]
    warnings: tuple[str, ...]
    passed_over: tuple[str, ...]

    @property
    def unanswered(self) -> tuple[Question, ...]:
        """The questions that have to be answered before an import."""
        return tuple(each for each in self.questions if each.default is None)


def propose(
    raw: RawTable, answers: Mapping[str, str] | None = None, ship: Actuators = (), vessel: str = ""
) -> Proposal:
    """A map for a table as it is in its file, by the ``answers`` to what a proposal before has asked.

    ``ship`` are the actuators of the vessel, if she is known, ``vessel`` her name. Raises :class:`InputError` for
    a table without times, or in which nothing is known.
    """
    draft = Draft(raw, answers or {})
    _find_long(draft)
    check_keys(draft.answers, list(map(str, draft.raw.columns.columns)))
    draft.candidates = with_answers(draft)
    if vessel:
        draft.tree["trial"] = {"vessel": vessel}
    used = set(read_time(draft))
    draft.candidates = [each for each in draft.candidates if each.column not in used]
    _Motion(draft, _seconds(draft), ship).read()
    asked = any(each.default is None for each in draft.questions)
    if not asked and not draft.tree.get("channels") and "position" not in draft.tree:
        raise InputError("has no column that is a channel", where=str(raw.path), fix="give a map with --columns")
    known = {each.column for each in draft.readings} | used
    comments = {each.taken_for: "; ".join(each.reasons) for each in draft.readings}
    passed = tuple(name for name in map(str, draft.raw.columns.columns) if name not in known)
    return Proposal(
        as_toml(_in_order(draft.tree), comments),
        tuple(draft.readings),
        tuple(draft.questions),
        tuple(draft.warnings),
        passed,
    )


def _in_order(tree: dict[str, Any]) -> dict[str, Any]:
    """A map's keys as a reader expects them: plain values, the ship, the time, the channels."""
    order = (
        "absent", "derive", "unreadable_rows", "trial", "actuator", "long", "time", "position", "orientation",
        "channels",
    )  # fmt: skip
    return {key: tree[key] for key in (*order, *(set(tree) - set(order))) if key in tree}


def _find_long(draft: Draft) -> None:
    """Spread a table that has a row for each value."""
    found = candidates_of(draft.raw)
    roles = {
        name: [each.column for each in found if each.quantity.name == name]
        for name in ("variable", "value", "unit")
    }
    keys = [each.column for each in found if each.quantity.name in ("time", "date")]
    for variable in roles["variable"]:
        column = draft.raw.columns[variable]
        names = column.dropna().unique()
        text = not pd.api.types.is_numeric_dtype(column.dtype)
        if text and keys and roles["value"] and 1 < len(names) <= min(_MOST_VARIABLES, column.size // 2):
            long = Long(variable, roles["value"][0], next(iter(roles["unit"]), None))
            draft.tree["long"] = {key: value for key, value in vars(long).items() if value is not None}
            draft.raw, twice = widen(draft.raw, long, keys, names)
            if twice:
                draft.warnings.append(f"{twice:,} values come twice of one variable and time; the last counts")
            return


def _seconds(draft: Draft) -> Floats:
    """Seconds since the first row of each row, NaN without a time."""
    time = TimeColumn(**draft.tree["time"])
    raw, plain = resolve_times(draft.raw, replace(time, in_name=None, zone=time.zone or "UTC"))
    if plain.format == "seconds":
        parse_numbers(raw, plain.column)
    times = read_times(raw, plain.column, plain.zone or "UTC", plain.start, plain.format == "seconds")
    ns = times.as_unit("ns").asi8
    known = ~np.asarray(times.isna())
    if not known.any():
        raise InputError(f"no time of column {time.column!r} can be read", where=str(draft.raw.path))
    if not known.all():
        draft.tree["unreadable_rows"] = "drop"
        draft.warnings.append(f"{int((~known).sum()):,} rows have no time that can be read; they are dropped")
    return np.where(known, (ns - ns[known][0]) / 1e9, np.nan)


class _Motion:
    """The channels of motion, wind and actuators, one after another, each by what is known before."""

    def __init__(self, draft: Draft, seconds: Floats, ship: Actuators) -> None:
        self.draft, self.t, self.ship = draft, seconds, ship
        self.grid = grid_of(seconds)
        self.channels: dict[str, dict[str, Any]] = {}
        self.values: dict[str, Floats] = {}
        self.north: Floats | None = None
        self.east: Floats | None = None
        self.speed_units: set[str] = set()
        self.angle_units: set[str] = set()

    def read(self) -> None:
        self._read_geographic()
        self._read_heading()
        self._read_plane()
        self._check_heading()
        self._read_speeds()
        self._read_yaw_rate()
        self._read_attitude()
        self._read_wind()
        self._read_actuators()
        self._derive()
        self._check_times()

    # what is taken

    def take(self, name: str, candidate: Candidate, unit: str, *why: str, scale: float = 1.0, **more: Any) -> None:
        """Let a column be a channel."""
        channel = BY_NAME[name]
        entry: dict[str, Any] = {"column": candidate.column, "unit": unit}
        factor = scale * (scale_to(channel.unit, unit) if "full_scale" not in more else more["full_scale"] / 100.0)
        values = self.draft.numbers(candidate.column)
        missing = _no_values(values, factor, channel.low, channel.high, channel.circular)
        if missing:
            entry["missing"] = missing
            why = (*why, f"{', '.join(f'{each:g}' for each in missing)} stands for no value")
            values = np.where(np.isin(values, missing), np.nan, values)
        if scale != 1.0:
            entry["scale"] = scale
        self.channels[name] = entry | more
        self.values[name] = values * factor
        self.draft.note(candidate.column, name, unit, *why)
        if np.isnan(values).all():
            self.draft.warnings.append(f"column {candidate.column!r}, taken for {name}, holds no value at all")

    def best(self, *names: str) -> Candidate | None:
        """The likeliest column for a quantity; the others are said to be left."""
        found = self.draft.of(*names)
        for each in found[1:]:
            self.draft.note(each.column, "-", "", f"not used: {found[0].column!r} is taken for it")
        return found[0] if found else None

    def _asked(self, key: str, text: str, options: tuple[str, ...]) -> tuple[str, str] | None:
        """The unit that a person says, the first one until then; None for a column that is to be left out."""
        answer = self.draft.ask(key, text, options)
        return None if answer == SKIP else (answer or options[0], "as answered")

    def _steps(self, *names: str) -> list[Floats] | None:
        """How much channels change from one moment of the grid to the next; None where that cannot be told."""
        if self.grid.size < 3 or not set(names) <= set(self.values):
            return None
        runs_on = {"heading_deg": unwrap(self.values["heading_deg"])} if "heading_deg" in names else {}
        return [increments(self.t, (self.values | runs_on)[name], self.grid) for name in names]

    def _fit_displacement(self, values: Floats) -> Fit:
        """Factor from a speed's integral to the length of the track."""
        if self.north is None or self.east is None or self.grid.size < 2:
            return _UNKNOWN
        length = np.hypot(increments(self.t, self.north, self.grid), increments(self.t, self.east, self.grid))
        return fit(length, np.abs(integrals(self.t, values, self.grid)))

    # position

    def _read_geographic(self) -> None:
        pairs = [
            (latitude, longitude)
            for latitude in self.draft.of("latitude")
            for longitude in self.draft.of("longitude")
            if latitude.units == longitude.units or not (latitude.units and longitude.units)
        ]
        for latitude, longitude in pairs:
            found = self._degrees(latitude, longitude)
            if found is not None:
                self._take_position(latitude, longitude, *found)
                return
        if pairs:
            names = ", ".join(f"{one.column!r} and {two.column!r}" for one, two in pairs)
            self.draft.warnings.append(f"{names} are no latitude and longitude in any unit; they are left out")

    def _degrees(self, latitude: Candidate, longitude: Candidate) -> tuple[str, str, Floats, Floats] | None:
        """The unit, why, and both in degrees; None where they cannot be a position."""
        columns = [self.draft.raw.columns[each.column] for each in (latitude, longitude)]
        if self.draft.is_empty(latitude.column):
            return None
        if not all(pd.api.types.is_numeric_dtype(column.dtype) for column in columns):
            values = [from_text(column) for column in columns]
            return ("text", "degrees, minutes and letters", values[0], values[1]) if _are_degrees(*values) else None
        told = [self.draft.numbers(each.column) for each in (latitude, longitude)]
        for unit in latitude.units or longitude.units or ("deg", "ddmm", "degE7"):
            values = [_in_degrees(each, unit) for each in told]
            if _are_degrees(*values):
                said = latitude.units or longitude.units
                why = f"head says {unit}" if said else f"{unit} by their size"
                return unit, why, values[0], values[1]
        return None

    def _take_position(
        self, latitude: Candidate, longitude: Candidate, unit: str, why: str, north: Floats, east: Floats
    ) -> None:
        entry: dict[str, Any] = {"latitude": latitude.column, "longitude": longitude.column, "unit": unit}
        angles = {"north_south": north, "east_west": east}
        for name, word in (("north_south", "S"), ("east_west", "W")):
            for letters in self.draft.of(name)[:1]:
                entry[name] = letters.column
                said = self.draft.raw.columns[letters.column].astype("str").str.strip().str.upper()
                angles[name] = np.where(said.eq(word), -angles[name], angles[name])
                self.draft.note(letters.column, f"{name} of the position", "", "letters")
        north, east = angles.values()
        told = self.draft.numbers(latitude.column)
        if missing := [each for each in (91.0, 181.0) if np.any(told == each)]:
            entry["missing"] = missing
        self.draft.tree["position"] = entry
        self.draft.note(latitude.column, "latitude_deg, north_m", unit, why)
        self.draft.note(longitude.column, "longitude_deg, east_m", unit, why)
        valid = _valid(north, east)
        first = int(np.flatnonzero(valid)[0])
        self.north, self.east = np.full((2, north.size), np.nan)
        self.north[valid], self.east[valid], _ = pymap3d.geodetic2ned(
            north[valid], east[valid], 0.0, north[first], east[first], 0.0
        )
        self.values |= {"north_m": self.north, "east_m": self.east}

    def _read_plane(self) -> None:
        """Metres to north and east, or x and y, where there is no latitude."""
        north, east = self.best("north_m"), self.best("east_m")
        x, y = self.best("x"), self.best("y")
        if "position" in self.draft.tree:
            return
        why = "by its name"
        if not (north and east) and x and y:
            turned = None if "x_axis" in self.draft.answers else self._is_x_east(x, y)
            if turned is None:
                text = f"is {x.column!r} to the north or to the east?"
                answer = self.draft.ask("x_axis", text, ("north", "east"))
                turned, why = answer == "east", "as answered" if answer else "not clear"
            else:
                why = "the track runs where the heading points"
            north, east = (y, x) if turned else (x, y)
        if north and east:
            for name, each in (("north_m", north), ("east_m", east)):
                self.take(name, each, (each.units or ("m",))[0], why)
            self.north, self.east = self.values["north_m"], self.values["east_m"]

    def _is_x_east(self, x: Candidate, y: Candidate) -> bool | None:
        """Whether x is to the east by the heading; None where that cannot be told."""
        heading = self.values.get("heading_deg")
        if heading is None or self.grid.size < 3:
            return None
        steps = [increments(self.t, self.draft.numbers(each.column), self.grid) for each in (x, y)]
        angle = means(self.t, unwrap(heading), self.grid)
        body = [self.draft.of(name) for name in ("surge_mps", "sway_mps")]
        if all(body):
            surge, sway = (integrals(self.t, self.draft.numbers(each[0].column), self.grid) for each in body)
            angle = angle + np.rad2deg(np.arctan2(sway, surge))
        as_north, as_east = agreement(steps[0], steps[1], angle), agreement(steps[1], steps[0], angle)
        return None if abs(as_north - as_east) < 0.3 or max(as_north, as_east) < 0.5 else as_east > as_north

    # heading

    def _angle_unit(self, candidate: Candidate, name: str) -> tuple[str, str]:
        """Degrees or radians: as the head says, else by the range, else as the other angles, else asked."""
        if candidate.units:
            return candidate.units[0], "head says so"
        values = self.draft.numbers(candidate.column)
        values = values[np.isfinite(values) & ~np.isin(values, _NO_VALUE)]
        if values.size == 0:
            return "deg", "no value"
        largest, span = float(np.max(np.abs(values))), float(np.ptp(values))
        if name == "heading_deg" and (found := self._turns_as_the_track(candidate)):
            return found
        if largest > 7.0:
            return "deg", f"up to {largest:.4g}"
        if self.angle_units == {"rad"} and largest <= 2.0 * np.pi + 0.01:
            return "rad", "as the other angles"
        if self.angle_units == {"deg"}:
            return "deg", "as the other angles"
        if name in ("heading_deg", "course_over_ground_deg", "wind_direction_deg") and span > np.pi:
            return "rad", f"within {values.min():.2f} to {values.max():.2f}"
        if largest == 0.0:
            return "deg", "all zero"
        text = f"{candidate.column!r}, taken for {name}, goes up to {largest:.3g}: degrees or radians?"
        return self.draft.ask(f"unit.{candidate.column}", text, ("deg", "rad")) or "deg", "as answered"

    def _turns_as_the_track(self, candidate: Candidate) -> tuple[str, str] | None:
        """The unit in which a heading turns as much as the track does, radians that run on among them."""
        track = self._track()
        if track is None or self.grid.size < 3:
            return None
        north, east = (increments(self.t, each, self.grid) for each in track)
        course = unwrap(np.rad2deg(np.arctan2(east, north)))
        heading, found = self.draft.numbers(candidate.column), dict[str, Fit]()
        for unit in ("deg", "rad"):
            values = unwrap(heading * scale_to("deg", unit))
            found[unit] = fit(np.diff(course), np.diff(means(self.t, values, self.grid)))
        fitting = [unit for unit, each in found.items() if each.is_clear and 1.0 / _NEAR < abs(each.factor) < _NEAR]
        return (fitting[0], "it turns as the track does") if len(fitting) == 1 else None

    def _track(self) -> tuple[Floats, Floats] | None:
        """Two coordinates of the position, whichever is which."""
        if self.north is not None and self.east is not None:
            return self.north, self.east
        for names in (("north_m", "east_m"), ("x", "y")):
            one, two = (self.draft.of(name) for name in names)
            if one and two:
                return self.draft.numbers(one[0].column), self.draft.numbers(two[0].column)
        return None

    def _read_heading(self) -> None:
        quaternion = [self.draft.of(f"quaternion_{part}") for part in "xyzw"]
        candidate = self.best("heading_deg")
        if candidate is None and all(quaternion):
            from acquisition.tables.derived_columns import heading_of_quaternion

            names = [each[0].column for each in quaternion]
            self.draft.tree["orientation"] = dict(zip("xyzw", names, strict=True)) | {"frame": "enu"}
            x, y, z, w = (self.draft.numbers(name) for name in names)
            self.values["heading_deg"] = heading_of_quaternion(x, y, z, w)
            for name in names:
                self.draft.note(name, "heading_deg", "", "a quaternion in the frames of ROS (REP 103)")
            return
        if candidate is None:
            candidate = self._course_as_heading()
        if candidate is not None:
            unit, why = self._angle_unit(candidate, "heading_deg")
            self.angle_units.add(unit)
            self.take("heading_deg", candidate, unit, why)

    def _course_as_heading(self) -> Candidate | None:
        """A column called course: over ground where it follows the track to the degree, else asked."""
        found = self.draft.of("course")
        if not found:
            return None
        candidate = found[0]
        if self.draft.of("course_over_ground_deg"):
            return candidate
        answer = self.draft.ask(
            "course",
            f"is {candidate.column!r} the heading or the course over ground?",
            ("heading", "course over ground"),
        )
        if answer == "heading":
            return candidate
        if answer:
            quantity = replace(candidate.quantity, name="course_over_ground_deg")
            self.draft.candidates.append(replace(candidate, quantity=quantity))
        return None

    def _check_heading(self) -> None:
        """Say so where the track runs elsewhere than the heading points."""
        steps = self._steps("north_m", "east_m", "heading_deg")
        if steps is None:
            return
        heading = means(self.t, unwrap(self.values["heading_deg"]), self.grid)
        along = agreement(steps[0], steps[1], heading)
        mirrored = agreement(steps[1], steps[0], heading)  # of a straight run to the north-east both may be high
        if along < 0.5 and mirrored > 0.8:
            self.draft.warnings.append(
                "the track runs along the heading with its axes exchanged: latitude for longitude?"
            )
        elif along < -0.5:
            self.draft.warnings.append(
                "the ship moves astern most of the time by position and heading: heading of the stern?"
            )

    # speeds

    def _read_speeds(self) -> None:
        for name in ("speed_over_ground_mps", "surge_mps", "sway_mps", "speed_through_water_mps"):
            candidate = self.best(name)
            if candidate is not None and (found := self._speed_unit(candidate, name)):
                self.take(name, candidate, *found)
        course = self.best("course_over_ground_deg")
        if course is not None:
            self.take("course_over_ground_deg", course, *self._angle_unit(course, "course_over_ground_deg"))
        self._check_sway()

    def _speed_unit(self, candidate: Candidate, name: str) -> tuple[str, str] | None:
        """A speed's unit, and why; None where it is to be left out."""
        values = self.draft.numbers(candidate.column)
        no_track = name in ("sway_mps", "speed_through_water_mps")  # across it, and through water that moves
        found = _UNKNOWN if no_track else self._fit_displacement(values)
        if candidate.units:
            self._warn_of_factor(candidate.column, candidate.units[0], found, _SPEED_UNITS, "m/s", "the positions")
            self.speed_units.add(candidate.units[0])
            return candidate.units[0], "head says so"
        if found.is_clear and (unit := _nearest(found.factor, "m/s", _SPEED_UNITS)):
            self.speed_units.add(unit)
            return unit, f"positions move {found.factor:.3g} m/s for 1 of it"
        if len(self.speed_units) == 1:
            return next(iter(self.speed_units)), "as the other speeds"
        if not np.any(values[np.isfinite(values)]):
            return "m/s", "all zero"
        largest = float(np.nanmax(np.abs(np.where(np.isin(values, _NO_VALUE), np.nan, values))))
        if largest > _FASTEST_MPS:
            self.draft.warnings.append(f"{candidate.column!r} goes up to {largest:.4g}: km/h?")
        text = f"{candidate.column!r}, taken for {name}, goes up to {largest:.3g} in no unit: m/s or knots?"
        return self._asked("unit.speed", text, ("m/s", "knots", "km/h"))

    def _warn_of_factor(
        self, column: str, unit: str, found: Fit, units: Sequence[str], house: str, source: str
    ) -> None:
        """Say so where a column in its unit is off from what others say, with the unit that would fit."""
        if not found.is_clear:
            return
        factor = abs(found.factor) / scale_to(house, unit)
        if 1.0 / _ODD < factor < _ODD:
            return
        likely = _nearest(found.factor, house, units)
        guess = f": {likely}?" if likely and likely != unit else ""
        self.draft.warnings.append(f"{column!r} in {unit} is off from {source} by a factor {factor:.3f}{guess}")

    def _check_sway(self) -> None:
        steps = self._steps("north_m", "east_m", "heading_deg", "sway_mps")
        if steps is None:
            return
        heading = np.deg2rad(means(self.t, unwrap(self.values["heading_deg"]), self.grid))
        across = steps[1] * np.cos(heading) - steps[0] * np.sin(heading)
        found = fit(across, integrals(self.t, self.values["sway_mps"], self.grid))
        if found.is_clear and found.factor < 0.0:
            self._turn_round("sway_mps", "positive to starboard by the track")

    def _turn_round(self, name: str, why: str) -> None:
        """Change the sign of a channel that was taken."""
        entry = self.channels[name]
        entry["scale"] = -entry.get("scale", 1.0)
        self.values[name] = -self.values[name]
        place = next(i for i, each in enumerate(self.draft.readings) if each.taken_for == name)
        reading = self.draft.readings[place]
        self.draft.readings[place] = replace(reading, reasons=(*reading.reasons, f"sign turned: {why}"))
        self.draft.warnings.append(f"the sign of {reading.column!r} is turned round: {why}")

    def _read_yaw_rate(self) -> None:
        candidate = self.best("yaw_rate_dps")
        if candidate is None:
            return
        values = self.draft.numbers(candidate.column)
        turned, found = self._steps("heading_deg"), _UNKNOWN
        if turned is not None:
            rates = np.where(np.isin(values, _NO_VALUE), np.nan, values)
            found = fit(turned[0], integrals(self.t, rates, self.grid))
        unit: tuple[str, str] | None
        if candidate.units:
            unit = candidate.units[0], "head says so"
            self._warn_of_factor(candidate.column, unit[0], found, _RATE_UNITS, "deg/s", "the heading")
        elif found.is_clear and (likely := _nearest(found.factor, "deg/s", _RATE_UNITS)):
            unit = likely, f"the heading turns {found.factor:.3g} deg/s for 1 of it"
        else:
            text = f"{candidate.column!r}, taken for yaw_rate_dps: in which unit? The heading does not tell."
            unit = self._asked(f"unit.{candidate.column}", text, _RATE_UNITS)
        if unit is None:
            return
        self.take("yaw_rate_dps", candidate, *unit)
        if found.is_clear and found.factor < 0.0:
            self._turn_round("yaw_rate_dps", "positive to starboard by the heading")

    def _read_attitude(self) -> None:
        for name in ("roll_deg", "pitch_deg", "heading_magnetic_deg", "magnetic_variation_deg"):
            candidate = self.best(name)
            if candidate is not None:
                self.take(name, candidate, *self._angle_unit(candidate, name))
        heave = self.best("heave_m")
        if heave is not None:
            self.take(
                "heave_m", heave, *((heave.units[0], "head says so") if heave.units else ("m", "by its name"))
            )

    # wind

    def _read_wind(self) -> None:
        for names in _WINDS.values():
            self._take_wind(self.best(names[0]), self.best(names[1]), *names)
        direction, speed = self.best("wind_direction"), self.best("wind_speed")
        if direction is None or speed is None or "wind_direction_deg" in self.channels:
            return
        known = "apparent_wind_angle_deg" in self.channels
        kind = "true" if known else self._kind_of_wind(direction, speed)
        if kind in _WINDS:
            self._take_wind(direction, speed, *_WINDS[kind])

    def _take_wind(
        self, angle: Candidate | None, speed: Candidate | None, angle_name: str, speed_name: str
    ) -> None:
        if angle is not None:
            self.take(angle_name, angle, *self._angle_unit(angle, angle_name))
        if speed is None:
            return
        unit = self._wind_unit(speed, angle if angle_name == "apparent_wind_angle_deg" else None)
        if unit is not None:
            self.take(speed_name, speed, *unit)
        if angle is None or unit is None or angle_name != "apparent_wind_angle_deg":
            return
        if "wind_direction_deg" not in self.channels and "heading_deg" in self.values:
            entry = {"angle": angle.column, "speed": speed.column, "speed_unit": unit[0]}
            entry["angle_unit"] = self.channels[angle_name]["unit"]
            self.draft.tree["apparent_wind"] = entry

    def _wind_unit(self, speed: Candidate, apparent: Candidate | None) -> tuple[str, str] | None:
        if speed.units:
            return speed.units[0], "head says so"
        values = self.draft.numbers(speed.column)
        if not np.any(values[np.isfinite(values)]):
            return "m/s", "all zero"
        if apparent is not None:
            steady = {
                unit: told["apparent"]
                for unit in ("m/s", "knots")
                if (told := self._restlessness_of_wind(apparent, speed, unit))
            }
            if steady and max(steady.values()) > _STEADIER * min(steady.values()):
                return min(steady, key=steady.__getitem__), "so the wind over ground is steadiest"
        text = f"{speed.column!r}, a wind speed, goes up to {np.nanmax(values):.3g} in no unit: m/s or knots?"
        return self._asked("unit.wind", text, ("m/s", "knots", "km/h"))

    def _kind_of_wind(self, direction: Candidate, speed: Candidate) -> str | None:
        """True wind, or apparent: of the two the one that makes the steadier wind over ground."""
        text = f"{direction.column!r} and {speed.column!r}: the true wind, or the apparent wind from the bow?"
        steady = self._restlessness_of_wind(direction, speed, (speed.units or ("m/s",))[0])
        told = "wind" in self.draft.answers
        if steady and not told and max(steady.values()) > _STEADIER * min(steady.values()):
            kind = min(steady, key=steady.__getitem__)
            other = max(steady.values()) / max(min(steady.values()), 1e-12)
            self.draft.note(
                direction.column, "wind", "", f"{kind}: taken otherwise it would change {other:.1f} times as much"
            )
            return kind
        return self.draft.ask("wind", text, ("true", "apparent"))

    def _restlessness_of_wind(self, direction: Candidate, speed: Candidate, unit: str) -> dict[str, float]:
        """How much the wind over ground changes if the columns are of the true wind, and of the apparent."""
        heading, motion = self.values.get("heading_deg"), self._velocity()
        if heading is None or motion is None or self.grid.size < 3:
            return {}
        size = self.draft.numbers(speed.column) * scale_to("m/s", unit)
        angle = np.deg2rad(self.draft.numbers(direction.column) * scale_to("deg", (direction.units or ("deg",))[0]))
        told = {
            "true": size * np.exp(1j * angle),
            "apparent": size * np.exp(1j * (angle + np.deg2rad(heading))) - motion,
        }
        steady = {kind: restlessness(self.t, each, self.grid) for kind, each in told.items()}
        return {} if np.isnan(list(steady.values())).any() else steady

    def _velocity(self) -> np.ndarray | None:
        """The ship's velocity to north + i east [n], if it is known."""
        if {"surge_mps", "sway_mps", "heading_deg"} <= set(self.values):
            body = self.values["surge_mps"] + 1j * self.values["sway_mps"]
            return np.asarray(body * np.exp(1j * np.deg2rad(self.values["heading_deg"])))
        if {"course_over_ground_deg", "speed_over_ground_mps"} <= set(self.values):
            course = np.deg2rad(self.values["course_over_ground_deg"])
            return np.asarray(self.values["speed_over_ground_mps"] * np.exp(1j * course))
        if self.north is None or self.east is None:
            return None
        from acquisition.tables.derived_columns import rate

        return np.asarray(rate(self.t, self.north) + 1j * rate(self.t, self.east))

    # actuators

    def _read_actuators(self) -> None:
        found = find_actuators(self.draft, self.ship)
        ship = self.ship or found.actuators
        if ship and not self.ship and as_text(ship):
            self.draft.tree["actuator"] = [{"name": each.name, "kind": each.kind} for each in ship]
        for each in found.columns:
            self._take_control(each)
        self.ship = ship

    def _take_control(self, found: Found) -> None:
        channel = find_channel(found.channel)
        assert channel is not None
        candidate = found.candidate
        if channel.unit == "deg":
            unit, why = self._angle_unit(candidate, found.channel)
            if unit == "percent":
                self._take_share(found, "deg")
                return
            self.take(found.channel, candidate, unit, why, found.why)
            self._check_helm(found)
        elif channel.unit == "%":
            self.take(found.channel, candidate, (candidate.units or ("%",))[0], found.why)
        elif candidate.units and candidate.units[0] == "percent":
            self._take_share(found, "rpm")
        else:
            unit_of_turns = self._turns_unit(candidate)
            if unit_of_turns is not None:
                self.take(found.channel, candidate, *unit_of_turns, found.why)

    def _take_share(self, found: Found, unit: str) -> None:
        """A column in percent of a full scale that only a person knows."""
        group = found.channel.removesuffix("_rpm").removesuffix("_angle_deg")
        key = f"full_scale.{group}"
        text = f"{found.candidate.column!r} is in percent: of how many {unit}?"
        wide = "full_scale" in self.draft.answers and key not in self.draft.answers
        given = self.draft.ask("full_scale" if wide else key, text, (), SKIP)
        if given is None or given == SKIP:
            self.draft.warnings.append(
                f"{found.candidate.column!r} is in percent of an unknown full scale and left out; "
                f"say --answer {key}=NUMBER"
            )
            self.draft.note(found.candidate.column, "-", "percent", "left out: percent of an unknown full scale")
            return
        self.take(found.channel, found.candidate, "percent", f"100 % is {given} {unit}, as answered", found.why,
                  full_scale=float(given))  # fmt: skip

    def _turns_unit(self, candidate: Candidate) -> tuple[str, str] | None:
        if candidate.units:
            return candidate.units[0], "head says so"
        values = self.draft.numbers(candidate.column)
        largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
        if "rpm" in candidate.words or largest == 0.0:
            return "rpm", "by its name" if largest else "all zero"
        if largest > 30.0:
            return "rpm", f"up to {largest:.4g}"
        text = f"{candidate.column!r} goes up to {largest:.3g}: turns a minute or a second?"
        return self._asked(f"unit.{candidate.column}", text, ("rpm", "rps"))

    def _check_helm(self, found: Found) -> None:
        """Turn the sign of a helm that turns the ship the other way."""
        turns = KINDS[found.kind].turns
        rate_of_turn, steps = self.values.get("yaw_rate_dps"), self._steps("heading_deg")
        if not turns or self.grid.size < 3 or (rate_of_turn is None and steps is None):
            return
        turned = means(self.t, rate_of_turn, self.grid) if rate_of_turn is not None else (steps or [])[0]
        helm = np.sin(np.deg2rad(means(self.t, self.values[found.channel], self.grid)))
        lagged = [fit(turned[lag:], helm[: helm.size - lag]).correlation for lag in range(4)]
        strongest = max(lagged, key=abs)
        if strongest * turns < -0.5:
            self._turn_round(found.channel, f"positive turned the ship to {'port' if turns > 0 else 'starboard'}")

    # the rest

    def _derive(self) -> None:
        has = set(self.channels) | ({"north_m", "east_m"} if self.north is not None else set())
        wanted: list[str] = []
        over_ground = {"course_over_ground_deg", "speed_over_ground_mps"} <= has
        if "heading_deg" in self.values:
            wanted += [] if "yaw_rate_dps" in has else ["yaw_rate_dps"]
            if over_ground or "north_m" in has:
                wanted += [name for name in ("surge_mps", "sway_mps") if name not in has]
        elif "north_m" in has:
            wanted += [name for name in ("speed_over_ground_mps", "course_over_ground_deg") if name not in has]
            self.draft.warnings.append("no column tells the heading: surge, sway and yaw rate are left out")
        if wanted:
            self.draft.tree["derive"] = wanted
        has |= set(wanted) | ({"heading_deg"} if "heading_deg" in self.values else set())
        if "apparent_wind" in self.draft.tree:
            if {"surge_mps", "sway_mps"} <= has:
                has |= {"wind_direction_deg", "wind_speed_mps"}
            else:
                del self.draft.tree["apparent_wind"]
        self.draft.tree["channels"] = self.channels
        absent = [name for name in trial_names(self.ship or DEFAULT_SHIP) if name not in has]
        self.draft.tree["absent"] = absent
        self._note_declared()

    def _note_declared(self) -> None:
        """Shaft power and torque are channels that the map declares."""
        for name, channel, unit in (("power", "shaft_power_kw", "kW"), ("torque", "shaft_torque_knm", "kNm")):
            candidate = self.best(name)
            if candidate is None:
                continue
            if not candidate.units:
                self.draft.warnings.append(f"{candidate.column!r} is left out: its head names no unit")
                self.draft.note(candidate.column, "-", "", "left out: no unit")
                continue
            self.draft.tree.setdefault("channel", []).append({"name": channel, "unit": unit, "range": [-1e5, 1e5]})
            self.channels[channel] = {"column": candidate.column, "unit": candidate.units[0]}
            self.draft.note(candidate.column, channel, candidate.units[0], "declared in the map")

    def _check_times(self) -> None:
        """Say so where span, step or track cannot be a trial's."""
        t = self.t[np.isfinite(self.t)]
        steps = np.diff(t)
        if t.size < 2:
            return
        span, usual = float(np.ptp(t)), float(np.median(np.abs(steps)))
        if span > 400 * 86_400.0:
            self.draft.warnings.append(
                f"the table lasts {span / 86_400:.0f} days: day and month in the wrong order, or ms for s?"
            )
        elif 0.0 < usual < 1e-3:
            self.draft.warnings.append(f"rows are {usual:.2g} s apart: the times may be in a larger unit")
        if self.north is None or self.east is None:
            return
        moved = np.hypot(np.diff(self.north[np.isfinite(self.t)]), np.diff(self.east[np.isfinite(self.t)]))
        speed = float(np.nanmedian(moved[steps > 0.0] / steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
        if speed > _FASTEST_MPS:
            self.draft.warnings.append(
                f"by its positions the ship makes {speed:.3g} m/s half of the time: times in ms, or positions in"
                " another unit?"
            )


def _no_values(values: Floats, factor: float, low: float, high: float, circular: bool) -> list[float]:
    """The codes for no value among numbers: known ones that the channel cannot hold."""
    seen = set(np.unique(values[np.isfinite(values)]).tolist()) & set(_NO_VALUE)
    if circular:
        low, high = -360.0, 360.0
    outside = [each for each in sorted(seen) if not low <= each * factor <= high]
    rest = values[np.isfinite(values) & ~np.isin(values, outside)]
    runs_on = circular and rest.size and np.max(np.abs(rest)) * abs(factor) > 360.0
    return [] if runs_on else outside


def _in_degrees(values: Floats, unit: str) -> Floats:
    if unit == "ddmm":
        return np.where(np.abs(values) % 100.0 < 60.0, from_degrees_and_minutes(values), np.nan)
    return values * scale_to("deg", unit)


def _valid(latitude: Floats, longitude: Floats) -> Any:
    return (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0) & ((latitude != 0.0) | (longitude != 0.0))


def _are_degrees(latitude: Floats, longitude: Floats) -> bool:
    """Whether nearly all rows that have both are a place on earth."""
    there = np.isfinite(latitude) | np.isfinite(longitude)
    return bool(there.any() and np.mean(_valid(latitude, longitude)[there]) > 0.5)


def _nearest(factor: float, house: str, units: Sequence[str]) -> str | None:
    """The unit whose size a factor is near to; None for one between all of them."""
    off = {unit: abs(np.log(abs(factor) / scale_to(house, unit))) for unit in units}
    best = min(off, key=off.__getitem__)
    return best if off[best] < np.log(_NEAR) else None
