"""Checks a table's heading against its track before anything is derived from it: unit, sense, zero and axes.

The rate of turn and the axes and signs of the speeds are then judged by the heading; a wrong one would make correct
columns wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seatrial.acquisition.core import conventions, ship
from seatrial.acquisition.core.quantities import Complexes, Floats, unit_scale
from seatrial.acquisition.tables import column_map, evidence, log_frames
from seatrial.acquisition.tables.evidence import ColumnCandidate, MappingDraft, ScaleFit, TableContext, UnitGuess

_MIN_VALUES_BEYOND_TURN = 3  # distinct values beyond a turn: codes for no value are fewer
_TURN_DEG = 360.5
_CLEAR_VARIANCE_RATIO = 3.0  # times the variance of the drift angle
_FASTEST_DRIFT_MPS = 2.0  # a drifting ship moves in any direction, and slower than this
_FULL_CIRCLE_CHANNELS = ("heading_deg", "heading_magnetic_deg", "course_over_ground_deg", "wind_direction_deg")
_MAX_RADIANS = 7.0
_SMALL_HELM = 1.0  # degrees of a helm that hardly moves, or radians of one that is put over
_AS_ROS_HAS_THEM = "as ROS has angles (REP 103)"
_SMALL_ROLL = 0.35  # degrees of a ship in calm water, or radians: 20 degrees
_ROLL_AND_PITCH = ("roll_deg", "pitch_deg")
_ALONG_COURSE = 0.7  # of the way sailed, by its projection on the course over ground
_STEADY_VARIATION_DEG = 1.0
_TRUE_WORDS = frozenset({"true", "t", "hdt", "hdgt", "gyro", "gyrocompass", "kreiselkurs", "psi", "yaw", "rw",
                         "rwk", "vrai", "verdadero", "wahr", "rechtweisender", "gps", "gnss"})  # fmt: skip
_FAR_M = 100.0  # from first to last: at rest a course is noise


def unit_of_angle_column(context: TableContext, candidate: ColumnCandidate, name: str) -> UnitGuess | None:
    """The unit of an angle: by the header, else by the track, the range or the heading, else asked."""
    if candidate.header_unit:
        return candidate.header_unit
    values = evidence.replace_codes_by_nan(context.draft.numbers_or_nan(candidate.column))
    values = values[np.isfinite(values)]
    if values.size == 0:
        return "deg", "no value"
    if name in ("heading_deg", "heading_magnetic_deg", "course_over_ground_deg") and (
        unit_guess := _angle_unit_by_track(context, candidate)
    ):
        return unit_guess
    largest, span = float(np.max(np.abs(values))), float(np.ptp(values))
    headings = (context.channels.get(heading, {}) for heading in ("heading_deg", "heading_magnetic_deg"))
    heading_unit = next((entry["unit"] for entry in headings if entry), "")
    is_ros = log_frames.are_axes_of_ros(context.draft.raw.remarks)
    rules = (
        (largest > _MAX_RADIANS, "deg", f"up to {largest:.4g}"),
        (is_ros and 0.0 < largest <= np.pi, "rad", _AS_ROS_HAS_THEM),
        (heading_unit == "rad" and largest <= 2.0 * np.pi + 0.01, "rad", "as the other angles"),
        (heading_unit == "deg", "deg", "as the other angles"),
        (name in _FULL_CIRCLE_CHANNELS and span > np.pi, "rad", f"within {values.min():.2f} to {values.max():.2f}"),
        (largest == 0.0, "deg", "all zero"),
    )
    for applies, unit, why in rules:
        if applies:
            small = _SMALL_HELM if name.endswith("_angle_deg") else _SMALL_ROLL if name in _ROLL_AND_PITCH else 0.0
            if why == _AS_ROS_HAS_THEM or (why == "as the other angles" and 0.0 < largest < small):
                context.draft.warnings.append(
                    f"{candidate.column!r} goes up to {largest:.3g} and is taken for {unit}, {why};"
                    f" --answer unit.{candidate.column}={'rad' if unit == 'deg' else 'deg'} if it is not"
                )
            return unit, why
    text = f"{candidate.column!r}, taken for {name}, goes up to {largest:.3g}: degrees or radians?"
    return evidence.ask_unit(context.draft, f"unit.{candidate.column}", text, ("deg", "rad"))


def _angle_unit_by_track(context: TableContext, candidate: ColumnCandidate) -> UnitGuess | None:
    """The unit in which an angle turns as the track does, whichever of its two coordinates is north."""
    draft = context.draft
    if "north_m" in context.series or context.grid.size < 3:
        moves = evidence.displacements(context)
    else:
        pairs = [
            [draft.candidates_for(name) for name in names] for names in (evidence.POSITION_CHANNELS, ("x", "y"))
        ]
        pair = next((pair for pair in pairs if all(pair)), [])
        steps = [
            evidence.increments_on_grid(context.t, draft.numbers_or_nan(candidates[0].column), context.grid)
            for candidates in pair
        ]
        moves = np.asarray(steps[0] + 1j * steps[1]) if steps else None
    if moves is None:
        return None
    unit = conventions.find_heading_convention(moves, _mean_angles_by_unit(context, candidate.column)).unit
    if not unit:
        return None
    why = f"in {conventions.ANGLE_UNITS[unit]} it turns as the track does"
    if unit_scale("deg", unit) < 1.0:
        draft.warnings.append(f"{candidate.column!r} is taken for {conventions.ANGLE_UNITS[unit]}: {why}")
    return unit, why


def _mean_angles_by_unit(context: TableContext, column: str, assumed: str = "deg") -> dict[str, Floats]:
    """The mean angle [deg] between the instants of the grid by each unit that a column may have, ``assumed`` first.

    Fractions of a degree only where values exceed a turn: a heading of a few degrees is not one of many tenths.
    """
    numbers = context.draft.numbers_or_nan(column)
    exceeds_turn = np.unique(numbers[np.abs(numbers) > _TURN_DEG]).size >= _MIN_VALUES_BEYOND_TURN
    units = [unit for unit in conventions.ANGLE_UNITS if exceeds_turn or unit_scale("deg", unit) >= 1.0]
    return {unit: evidence.mean_angle(context, numbers * unit_scale("deg", unit)) for unit in (assumed, *units)}


def assign_heading_column(context: TableContext) -> None:
    """Assign a column, or the quaternion, to the heading, or make it of a magnetic one and the variation.

    A column named course is the heading if there is a course over ground as well, else asked.
    """
    draft = context.draft
    quaternion = [draft.candidates_for(f"quaternion_{part}") for part in "xyzw"]
    candidate = evidence.best_candidate(draft, "heading_deg")
    if candidate is not None and _counts_from_magnetic_north(context, candidate):
        magnetic = replace(candidate.quantity, name="heading_magnetic_deg")
        draft.candidates.append(replace(candidate, quantity=magnetic))
        candidate = None
    if candidate is None and all(quaternion):
        names = [candidates[0].column for candidates in quaternion]
        draft.tree["orientation"] = dict(zip("xyzw", names, strict=True)) | {"frame": "enu"}
        x, y, z, w = (draft.numbers_or_nan(name) for name in names)
        context.series["heading_deg"] = column_map.heading_of_quaternion(x, y, z, w)
        for name in names:
            draft.note_interpretation(name, "heading_deg", "", "a quaternion in the frames of ROS (REP 103)")
        return
    if candidate is None and _assign_heading_by_variation(context):
        return
    if candidate is None and (courses := draft.candidates_for("course")):
        candidate = courses[0]
        if not draft.candidates_for("course_over_ground_deg"):
            text = f"is {candidate.column!r} the heading or the course over ground?"
            answer = draft.ask("course", text, ("heading", "course over ground"))
            if answer and answer != "heading":
                quantity = replace(candidate.quantity, name="course_over_ground_deg")
                draft.candidates.append(replace(candidate, quantity=quantity))
            candidate = candidate if answer == "heading" else None
    if candidate is not None and (unit_guess := unit_of_angle_column(context, candidate, "heading_deg")):
        evidence.assign_column(context, "heading_deg", candidate, *unit_guess)


def _counts_from_magnetic_north(context: TableContext, candidate: ColumnCandidate) -> bool:
    """Whether a heading whose name leaves it open is magnetic, beside a column of the variation: by how far the
    track runs off it, else asked."""
    draft, variations = context.draft, context.draft.candidates_for("magnetic_variation_deg")
    if not variations or candidate.words & _TRUE_WORDS or candidate.column in ship.BY_NAME:
        return False
    if draft.candidates_for("heading_magnetic_deg"):
        return False
    assign_variation_column(context)
    variation_deg = float(np.nanmedian(context.series.get("magnetic_variation_deg", np.zeros(1))))
    if not abs(variation_deg) >= _STEADY_VARIATION_DEG:
        return False
    moves, unit = evidence.displacements(context), (candidate.units or ("deg",))[0]
    if "north" not in draft.answers and moves is not None:
        heading = evidence.mean_angle(context, draft.numbers_or_nan(candidate.column) * unit_scale("deg", unit))
        verdict = conventions.find_heading_convention(moves, {"deg": heading})
        drift_deg = _drift_angle_without_turning(moves, heading)
        off_deg = abs(drift_deg), abs(drift_deg - variation_deg)
        if verdict.convention is conventions.CLOCKWISE and max(off_deg) > _CLEAR_VARIANCE_RATIO * min(off_deg):
            if is_magnetic := off_deg[1] < off_deg[0]:
                draft.warnings.append(
                    f"{candidate.column!r} is taken for magnetic: the track runs {drift_deg:.1f} deg off it, and"
                    f" the variation is {variation_deg:.1f} deg; --answer north=true if it is not"
                )
            return is_magnetic
    text = f"does {candidate.column!r} count from magnetic or true north? The variation is {variation_deg:.1f} deg"
    return draft.ask("north", text, ("magnetic", "true")) == "magnetic"


def _drift_angle_without_turning(moves: Complexes, heading_deg: Floats) -> float:
    """The mean drift angle [deg] of moves [n] beside headings [n, deg], less what follows the turning."""
    angles = np.rad2deg(np.angle(moves * np.exp(-1j * np.deg2rad(heading_deg))))
    terms = np.column_stack([np.ones(angles.size), np.gradient(heading_deg)])
    valid = np.isfinite(angles) & np.isfinite(terms).all(axis=1)
    return float(np.linalg.lstsq(terms[valid], angles[valid])[0][0])


def _unit_of_variation(context: TableContext, candidate: ColumnCandidate, name: str) -> UnitGuess | None:
    largest = float(np.nanmax(np.abs(context.draft.numbers_or_nan(candidate.column)), initial=0.0))
    if not candidate.units and largest >= _STEADY_VARIATION_DEG:
        return "deg", f"up to {largest:.3g}"
    return unit_of_angle_column(context, candidate, name)


def assign_variation_column(context: TableContext) -> None:
    """Assign a column to the variation, to the west negative by its column of letters."""
    draft, name = context.draft, "magnetic_variation_deg"
    if name in context.channels:
        return
    evidence.assign_best_column(context, name, _unit_of_variation)
    if name not in context.channels:
        return
    column, labels = context.channels[name]["column"], draft.raw.names
    position = draft.tree.get("position", {})
    for label in labels[labels.index(column) + 1 :][:1]:
        cells = draft.raw.columns[label]
        if label in position.values() or not column_map.holds_hemispheres(cells, "east_west"):
            continue
        signs = column_map.hemisphere_signs(cells, "east_west")
        draft.note_interpretation(label, "sign of the variation", "", "letters")
        if np.nanmax(signs) < 0.0 and not np.nanmin(context.series[name]) < 0.0:
            evidence.rescale_assigned_channel(context, name, -1.0, 0.0, f"{label!r} says west")
        elif np.nanmin(signs) < 0.0 < np.nanmax(signs):
            draft.warnings.append(
                f"{label!r} names both east and west: the signs of {column!r} are not turned by it"
            )


def _assign_heading_by_variation(context: TableContext) -> bool:
    """Make the heading of a magnetic one and the variation in a column, or as answered; whether that is done."""
    draft, parts = context.draft, ("heading_magnetic_deg", "magnetic_variation_deg")
    variations = draft.candidates_for(parts[1])
    if not draft.candidates_for(parts[0]):
        return False
    if "variation" in draft.answers or not (variations and draft.is_numeric(variations[0].column)):
        return assign_by_one_variation(context, "heading_deg", parts[0])
    evidence.assign_best_column(context, parts[0], unit_of_angle_column)
    assign_variation_column(context)
    if not set(parts) <= set(context.series):
        return False
    context.series["heading_deg"] = ship.wrap_360(context.series[parts[0]] + context.series[parts[1]])
    return True


def assign_by_one_variation(context: TableContext, name: str, magnetic_name: str) -> bool:
    """Assign a column that counts from magnetic north to a channel, by one variation; whether it is.

    The variation is that answered, or that of a column in which it is the same within a degree. Not where the
    channel has a column of its own. Without a variation the column is left out, and that is reported.
    """
    draft, candidates = context.draft, context.draft.candidates_for(magnetic_name)
    if name in context.channels or not candidates:
        return False
    candidate = candidates[0]
    if "variation" not in draft.answers and (variation_deg := _steady_variation_deg(context)) is not None:
        return _assign_from_magnetic_north(context, name, candidate, variation_deg, "by its column")
    text = f"{candidate.column!r} counts from magnetic north: what is the variation [deg], positive to the east?"
    answer = draft.ask("variation", text, (), evidence.SKIP)
    if answer in (None, evidence.SKIP):
        draft.warnings.append(
            f"{candidate.column!r} counts from magnetic north, and no column has the variation: no {name} is made"
            " of it; --answer variation=DEG, positive to the east, corrects it"
        )
        if magnetic_name not in ship.BY_NAME:
            draft.note_interpretation(candidate.column, "-", "", "left out: magnetic, without the variation")
        return False
    return _assign_from_magnetic_north(context, name, candidate, float(str(answer)), "as answered")


def _steady_variation_deg(context: TableContext) -> float | None:
    """The variation of a table whose column of it hardly changes; None for any other."""
    name = "magnetic_variation_deg"
    if name not in context.channels:
        variations = context.draft.candidates_for(name)
        if not variations or not context.draft.is_numeric(variations[0].column):
            return None
        assign_variation_column(context)
    values = context.series.get(name, np.empty(0))
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size and np.ptp(values) < _STEADY_VARIATION_DEG else None


def _assign_from_magnetic_north(
    context: TableContext, name: str, candidate: ColumnCandidate, variation_deg: float, why: str
) -> bool:
    if unit_guess := unit_of_angle_column(context, candidate, name):
        evidence.assign_column(context, name, candidate, *unit_guess)
        reason = f"magnetic, and the variation is {variation_deg:g} deg, {why}"
        evidence.rescale_assigned_channel(context, name, 1.0, variation_deg, reason)
    return name in context.channels


def settle_heading_convention(context: TableContext) -> None:
    """Check the heading against the track: a clear other convention is corrected and reported, else asked.

    A quaternion is read in the frames of aircraft and ships if the track shows these; an answer needs no check.
    """
    draft, series = context.draft, context.series
    moves, entry = evidence.displacements(context), context.channels.get("heading_deg")
    if entry is None:
        if moves is not None and (orientation := draft.tree.get("orientation")):
            verdict = conventions.find_heading_convention(
                moves, {"deg": evidence.mean_angle(context, series["heading_deg"])}
            )
            context.heading_is_sure = verdict.convention is not None
            if verdict.convention is conventions.FROM_EAST:
                orientation["frame"] = "ned"
                series["heading_deg"] = ship.wrap_360(90.0 - series["heading_deg"])
                draft.warnings.append(f"the quaternion is in axes to north, east and down: {verdict.evidence}")
        return
    if "heading" in draft.answers:
        name = draft.ask("heading", "", tuple(convention.name for convention in conventions.HEADINGS))
        convention = next(
            (heading for heading in conventions.HEADINGS if heading.name == name), conventions.CLOCKWISE
        )
        if convention is not conventions.CLOCKWISE:
            why = f"counts {convention.words}, as answered"
            evidence.rescale_assigned_channel(context, "heading_deg", convention.scale, convention.offset_deg, why)
        context.heading_is_sure = True
        return
    if moves is None:
        return
    column, unit = entry["column"], entry["unit"]
    verdict = conventions.find_heading_convention(moves, _mean_angles_by_unit(context, column, unit), unit)
    if verdict.unit and verdict.unit != unit:
        _ask_heading_unit(draft, column, unit, verdict)
    elif verdict.unit and verdict.convention is None:
        mean_deg = verdict.best.mean_deg
        side = "starboard" if mean_deg > 0.0 else "port"
        draft.warnings.append(
            f"{column!r} turns as the track does, but the track runs {abs(mean_deg):.0f} deg to {side} of it"
            " throughout: does it count from elsewhere than north, or does the ship go so, astern or abeam?"
            " It stays as it is; a map's `offset` corrects it"
        )
    elif verdict.convention is None:
        _ask_about_track_off_heading(context, moves)
    elif verdict.convention is conventions.CLOCKWISE:
        context.heading_is_sure = True
    else:
        _correct_heading(context, moves, verdict.convention, verdict)


def _ask_heading_unit(draft: MappingDraft, column: str, unit: str, verdict: conventions.HeadingVerdict) -> None:
    """Ask for the unit of a heading whose header or answer contradicts the track."""
    if f"unit.{column}" in draft.answers:
        return
    text = (
        f"{column!r} in {conventions.ANGLE_UNITS.get(unit, unit)} does not turn as the track does: is it in"
        f" {conventions.ANGLE_UNITS[verdict.unit]}? {verdict.evidence}"
    )
    draft.ask(f"unit.{column}", text, (verdict.unit, unit))


def _correct_heading(
    context: TableContext,
    moves: Complexes,
    convention: conventions.HeadingConvention,
    verdict: conventions.HeadingVerdict,
) -> None:
    """Convert a heading of another convention, or ask if the positions may be mirrored instead."""
    draft, variance = context.draft, verdict.best.variance
    exchanged: float | None = None  # the variance of the drift angle if latitude and longitude were exchanged
    if convention is conventions.FROM_EAST and context.origin is not None:
        latitude, longitude = np.deg2rad(context.origin)
        exchanged = 1.0
        if (
            abs(longitude) <= 0.5 * np.pi
        ):  # a minute of longitude is the shorter one: an exchange distorts the track
            swapped = moves.imag / np.cos(latitude) + 1j * moves.real * np.cos(longitude)
            heading = evidence.mean_angle(context, context.series["heading_deg"])
            exchanged = conventions.drift_angle_statistics(swapped, heading).variance
    if exchanged is not None and _CLEAR_VARIANCE_RATIO * exchanged < variance:
        draft.warnings.append("the track runs along the heading with its axes exchanged: latitude for longitude?")
        return

    is_settled = exchanged is not None and _CLEAR_VARIANCE_RATIO * variance < exchanged
    coordinates = {conventions.ANTICLOCKWISE: 1, conventions.FROM_SOUTH: 0}  # whose lost sign would look the same
    if convention in coordinates and context.origin is not None:
        position, index = draft.tree.get("position", {}), coordinates[convention]
        has_letters = ("north_south", "east_west")[index] in position or position.get("unit") == "text"
        is_settled = has_letters or context.origin[index] < 0.0
    column = context.channels["heading_deg"]["column"]
    reading_text = f"counts {convention.words}: {verdict.evidence}"
    if is_settled or _is_track_confirmed(context, moves):
        evidence.rescale_assigned_channel(
            context, "heading_deg", convention.scale, convention.offset_deg, reading_text
        )
        draft.warnings.append(f"{column!r} {reading_text}; it is turned, --answer heading=clockwise leaves it")
        context.heading_is_sure = True
        return
    course, remark = context.series.get("course_over_ground_deg"), ""
    if course is not None:
        course_verdict = conventions.find_heading_convention(moves, {"deg": evidence.mean_angle(context, course)})
        if course_verdict.convention is convention:
            remark = ", against which the course over ground turns as well"
    text = (
        f"{column!r} turns against the track. Either it {reading_text}. Or it is right and the positions are not:"
        f" {convention.mirrored}; then correct these{remark}. Which is it?"
    )
    draft.ask("heading", text, (convention.name, conventions.CLOCKWISE.name))


def check_course_convention(context: TableContext) -> None:
    """Check the course over ground against the positions: another unit is asked, another sense reported."""
    moves, entry = evidence.displacements(context), context.channels.get("course_over_ground_deg")
    if entry is None or moves is None or "north_m" not in context.series:
        return
    column = entry["column"]
    verdict = conventions.find_heading_convention(
        moves, _mean_angles_by_unit(context, column, entry["unit"]), entry["unit"]
    )
    if verdict.unit and verdict.unit != entry["unit"]:
        _ask_heading_unit(context.draft, column, entry["unit"], verdict)
    elif verdict.convention not in (None, conventions.CLOCKWISE):
        context.draft.warnings.append(
            f"{column!r}, a course, is {verdict.convention.words}, or the positions are wrong:"
            f" {verdict.convention.mirrored}; {verdict.evidence}"
        )
    elif verdict.convention is None:
        course = evidence.mean_angle(context, context.series["course_over_ground_deg"])
        if evidence.direction_agreement(moves.real, moves.imag, course) < _ALONG_COURSE and (
            np.abs(np.nansum(moves)) > _FAR_M
        ):
            context.draft.warnings.append(
                f"the positions do not move along {column!r}: does one of them count otherwise, or did the"
                " longitudes lose the sign of the west, the latitudes that of the south?"
            )


def _is_track_confirmed(context: TableContext, moves: Complexes) -> bool:
    """Whether the course, or a rate of turn against the heading, shows that the track is not mirrored."""
    if "north_m" not in context.series or context.positions_are_sure:
        return True
    if "course_over_ground_deg" in context.series:
        course = evidence.mean_angle(context, context.series["course_over_ground_deg"])
        return conventions.find_heading_convention(moves, {"deg": course}).convention is conventions.CLOCKWISE
    candidate = next(iter(context.draft.candidates_for("yaw_rate_dps")), None)
    turning = evidence.NO_FIT if candidate is None else _fit_to_heading(context, candidate.column)
    return turning.is_clear and turning.factor < 0.0


def _ask_about_track_off_heading(context: TableContext, moves: Complexes) -> None:
    """Ask about a straight track that does not run along the heading, which stays as it is without an answer."""
    draft, heading = context.draft, evidence.mean_angle(context, context.series["heading_deg"])
    alignment = evidence.direction_agreement(moves.real, moves.imag, heading)
    is_fast = float(np.nanmedian(np.abs(moves) / np.diff(context.grid))) > _FASTEST_DRIFT_MPS
    column = context.channels["heading_deg"]["column"]
    if is_fast and (candidates := conventions.heading_conventions_along_course(moves, heading)):
        drift_deg = conventions.drift_angle_statistics(moves, heading).mean_deg
        words = " or ".join(convention.words for convention in candidates)
        side = "starboard" if drift_deg > 0.0 else "port"
        text = (
            f"the track runs {abs(drift_deg):.0f} deg to {side} of {column!r}: does it count {words}?"
            " A straight course does not tell"
        )
        draft.ask(
            "heading",
            text,
            (conventions.CLOCKWISE.name, *(convention.name for convention in candidates)),
            conventions.CLOCKWISE.name,
        )
        draft.warnings.append(f"{text}; it stays as it is, --answer heading={candidates[0].name} turns it")
    elif alignment < -0.5:
        draft.warnings.append(
            "the ship moves astern most of the time by position and heading: heading of the stern?"
        )


def _fit_to_heading(context: TableContext, column: str) -> ScaleFit:
    """The scale of a rate of turn, as the table has it, by the changes of the heading."""
    if not (turns := evidence.channel_increments(context, "heading_deg")):
        return evidence.NO_FIT
    rates = evidence.replace_codes_by_nan(context.draft.numbers_or_nan(column))
    return evidence.fit_scale(turns[0], evidence.integrals_on_grid(context.t, rates, context.grid))


def assign_yaw_rate_column(context: TableContext) -> None:
    """Assign a column to the yaw rate, in the unit and sense of the heading's changes."""
    candidate = evidence.best_candidate(context.draft, "yaw_rate_dps")
    if candidate is None:
        return
    column, regression = candidate.column, _fit_to_heading(context, candidate.column)
    text = f"{column!r}, taken for yaw_rate_dps: in which unit? The heading does not tell."
    unit_guess = evidence.rate_unit(context, candidate, regression, evidence.TURNING)
    unit_guess = unit_guess or evidence.ask_unit(context.draft, f"unit.{column}", text, evidence.TURNING.units)
    if unit_guess is None:
        return
    evidence.assign_column(context, "yaw_rate_dps", candidate, *unit_guess)
    turns = np.sign(regression.factor) if regression.is_clear and not context.heading_is_asked else 0.0
    if turns > 0.0 or (turns == 0.0 and candidate.positive != "port"):
        return
    if candidate.positive == "port" and not (turns and context.heading_is_sure):
        evidence.invert_sign_of_assigned_channel(context, "yaw_rate_dps", evidence.POSITIVE_TO_PORT)
        return
    if context.heading_is_sure:
        evidence.invert_sign_of_assigned_channel(context, "yaw_rate_dps", "positive to starboard by the heading")
        return
    text = f"{column!r} turns against the heading, which no track confirms: does it count positive to port?"
    if context.draft.ask("rate_of_turn", text, ("port", "starboard"), "port") == "port":
        evidence.invert_sign_of_assigned_channel(
            context, "yaw_rate_dps", "positive to starboard by the heading, which no track confirms"
        )


def assign_earth_velocity_columns(context: TableContext) -> None:
    """Assign columns named surge and sway to the velocity to north and east if the track shows that.

    Surge and sway then follow from it with the heading; without one the columns are left out.
    """
    draft, series = context.draft, context.series
    pair = [draft.candidates_for(name) for name in ("surge_mps", "sway_mps")]
    moves = evidence.displacements(context)
    if not all(pair) or "north_m" not in series or moves is None:
        return
    columns = [candidates[0] for candidates in pair]
    numbers = [evidence.replace_codes_by_nan(draft.numbers_or_nan(candidate.column)) for candidate in columns]
    factors = [unit_scale("m/s", (candidate.units or ("m/s",))[0]) for candidate in columns]
    speeds = [values * factor for values, factor in zip(numbers, factors, strict=True)]
    body = speeds[0] + 1j * speeds[1]
    in_axes = {"north_east": body, "east_north": 1j * body.conj(), "east_south": 1j * body}
    if "heading_deg" in series:
        heading_deg = column_map.fill_short_gaps(context.t, ship.unwrap(series["heading_deg"]))
        in_axes |= {"ship": body * np.exp(1j * np.deg2rad(heading_deg))}
    elif conventions.keeps_its_course(moves):  # along the ship and along any axes would look alike
        return
    moves_in_axes = {name: evidence.integrate_velocity(context, velocity) for name, velocity in in_axes.items()}
    axes, fits = conventions.find_velocity_axes(moves, moves_in_axes)
    if axes in ("", "ship"):
        return
    names = " and ".join(repr(candidate.column) for candidate in columns)
    if "heading_deg" not in series:
        draft.candidates = [candidate for candidate in draft.candidates if candidate not in columns]
        draft.warnings.append(
            f"{names} are speeds {conventions.AXES[axes]} by the track: without a heading these make no surge"
            " and sway"
        )
        return
    unit_guess = columns[0].header_unit or evidence.rate_unit_by_fit(
        ScaleFit(fits[axes].factor, 1.0, moves.size), evidence.SPEED
    )
    text = f"in which unit is {columns[0].column!r}?"
    unit_guess = unit_guess or evidence.ask_unit(draft, "unit.speed", text, evidence.SPEED.units[:3])
    if unit_guess is None:
        return

    residual, as_ship = (f"{np.sqrt(fits[name].residual):.1%}" for name in (axes, "ship"))
    why = f"{residual} of the way is left over, {as_ship} as surge and sway"
    north, east = columns if axes == "north_east" else columns[::-1]
    _assign_earth_velocity(context, north, east, unit_guess, why, -1.0 if axes == "east_south" else 1.0)
    draft.warnings.append(
        f"{names} are speeds {conventions.AXES[axes]}: {why}; surge and sway are made of them by the heading"
    )


def _assign_earth_velocity(
    context: TableContext,
    north: ColumnCandidate,
    east: ColumnCandidate,
    unit_guess: UnitGuess,
    why: str,
    north_sign: float = 1.0,
) -> None:
    """Make surge and sway of two columns of the velocity to north and to east, by the heading."""
    draft, (unit, reason) = context.draft, unit_guess
    draft.tree["velocity"] = {"north": north.column, "east": east.column, "unit": unit}
    if north_sign < 0.0:
        draft.tree["velocity"]["positive"] = "south"
    context.speed_units.add(unit)
    for component, direction in ((north, "north"), (east, "east")):
        draft.note_interpretation(component.column, f"velocity to {direction}", unit, reason, why)
    numbers = [draft.numbers_or_nan(candidate.column) * unit_scale("m/s", unit) for candidate in (north, east)]
    heading_deg = column_map.fill_short_gaps(context.t, ship.unwrap(context.series["heading_deg"]))
    body = (north_sign * numbers[0] + 1j * numbers[1]) * np.exp(-1j * np.deg2rad(heading_deg))
    context.series |= {"surge_mps": body.real, "sway_mps": body.imag}


def assign_named_earth_velocity(context: TableContext) -> None:
    """Assign columns that are named as the velocity to north and to east, where no other tells surge and sway."""
    draft = context.draft
    pair = [draft.candidates_for(name) for name in ("velocity_north", "velocity_east")]
    has_body = any(draft.candidates_for("surge_mps")) and any(draft.candidates_for("sway_mps"))
    if not all(pair) or has_body or "heading_deg" not in context.series or "velocity" in draft.tree:
        return
    north, east = (candidates[0] for candidates in pair)
    speeds = [draft.numbers_or_nan(candidate.column) for candidate in (north, east)]
    if not np.nansum(np.abs(speeds)):
        return  # a logger's columns that are never filled
    if _runs_along_ship(context, *speeds):
        draft.warnings.append(
            f"{north.column!r} and {east.column!r} are along the ship by the track, though called to north and"
            " east: they are left out"
        )
    elif unit_guess := north.header_unit or evidence.ask_unit(
        draft, "unit.speed", f"in which unit is {north.column!r}?", evidence.SPEED.units[:3]
    ):
        _assign_earth_velocity(context, north, east, unit_guess, "by its name")


def _runs_along_ship(context: TableContext, north: Floats, east: Floats) -> bool:
    """Whether speeds [n] that are called to north and east are ahead (east) and to port (north), as a body's in ROS
    whose frame is called as the world's."""
    moves = evidence.displacements(context)
    if moves is None or "north_m" not in context.series:
        return False
    heading_deg = column_map.fill_short_gaps(context.t, ship.unwrap(context.series["heading_deg"]))
    along_ship = (east - 1j * north) * np.exp(1j * np.deg2rad(heading_deg))
    in_axes = {"north_east": north + 1j * east, "ship": along_ship}
    travelled = {axes: evidence.integrate_velocity(context, velocity) for axes, velocity in in_axes.items()}
    return conventions.find_velocity_axes(moves, travelled)[0] == "ship"


def correct_sway_sign(context: TableContext) -> None:
    """Invert the sign of a sway that is positive to port by the track, or by its head if no track shows it."""
    if "sway_mps" not in context.channels:
        return
    moves = evidence.channel_increments(context, *evidence.POSITION_CHANNELS, "heading_deg", "sway_mps")
    candidate = evidence.best_candidate(context.draft, "sway_mps")
    is_to_port, regression = candidate is not None and candidate.positive == "port", evidence.NO_FIT
    if moves and not context.heading_is_asked:
        heading = np.deg2rad(evidence.mean_angle(context, context.series["heading_deg"]))
        across = moves[1] * np.cos(heading) - moves[0] * np.sin(heading)
        regression = evidence.fit_scale(
            across, evidence.integrals_on_grid(context.t, context.series["sway_mps"], context.grid)
        )
    if regression.is_clear and regression.factor < 0.0:
        evidence.invert_sign_of_assigned_channel(context, "sway_mps", "positive to starboard by the track")
    elif is_to_port and not regression.is_clear:
        evidence.invert_sign_of_assigned_channel(context, "sway_mps", evidence.POSITIVE_TO_PORT)
