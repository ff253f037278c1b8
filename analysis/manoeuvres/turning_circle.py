"""Turning circles: the helm put over and held, the path and the heading that follow (IMO MSC.137(76), 4.2).

Advance and transfer are measured along and across the heading of the approach, from the position at which the
rudder order is given to where the heading has changed by 90 deg; the tactical diameter is the way across when it
has changed by 180 deg (MSC.137(76), 4.2.3 and 4.2.4).

The drift: in steady turning a ship comes back to the same point of the water after each turn, so that the way
between two points of the track one turn apart, over the time between them, is the velocity of the water, with
what the wind adds to it (ITTC 7.5-04-02-01, correction for drift). All pairs of the steady part count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from seatrial.acquisition.core.quantities import Floats, to_ship
from seatrial.analysis.manoeuvres.indices import Current, LeftOut, Manoeuvre, side_of
from seatrial.analysis.manoeuvres.measures import (
    APPROACH_S,
    Plateau,
    along_and_across,
    approach_of,
    approach_settings,
    bootstrap_indices,
    contradiction_of,
    count_notes,
    crossing_s,
    distance_m,
    half_width_s,
    helm_execute,
    helm_settings,
    helm_text,
    manoeuvre_of,
    mean_between,
    smooth_motion,
)
from seatrial.analysis.manoeuvres.motion import Motion

LEAST_CIRCLE_DEG, LEAST_TURN_OF_ONE_SIDE_DEG = 180.0, 90.0
_MARGIN_S = 20.0
_SLOWEST_APPROACH = 0.3
_STEADIEST_APPROACH = 0.25
REMOVED = "_current_removed"


def turn_of(motion: Motion, each: Plateau, fastest_mps: float) -> Manoeuvre | LeftOut | None:
    """The turn of a held helm, or the reason why it is none; None for one that turns the ship by less than 90 deg.

    After a straight approach it is a turning circle from 180 deg of turn on. Without one, only what is steady
    counts, which takes a turn of :data:`LEAST_STEADY_DEG`.
    """
    heading = motion.heading_deg[each.first : each.end]
    turned = abs(float(heading[-1] - heading[0]))
    if turned < LEAST_TURN_OF_ONE_SIDE_DEG:
        return None
    kind = "turning_circle" if turned >= LEAST_CIRCLE_DEG else "course_change"
    start, end = (motion.utc(float(motion.time_s[row])) for row in (each.first, each.end - 1))
    if motion.broken[each.first : each.end].any():
        return LeftOut(kind, start, end, "position or heading jump in it")
    shortfall = _approach_shortfall(motion, each, turned, fastest_mps)
    if shortfall and turned < LEAST_STEADY_DEG:
        return LeftOut(kind, start, end, shortfall)
    return turning_circle(motion, each, shortfall)


def _approach_shortfall(motion: Motion, each: Plateau, turned_deg: float, fastest_mps: float) -> str:
    """Why there is no straight approach under way before a held helm; empty where there is."""
    order_s = helm_execute(motion, each).order_s
    before = approach_of(motion, order_s - 1.0)
    rate_dps, speed_mps = abs(before["approach_yaw_rate_dps"]), before["approach_mps"]
    mean_rate_dps = turned_deg / ((each.end - each.first) * motion.step_s)
    begins = order_s - float(motion.time_s[0])
    if begins < 2.0 * motion.step_s:
        return "no approach: the recording begins with the helm over"
    if rate_dps >= _STEADIEST_APPROACH * mean_rate_dps:
        begun = (
            "the recording begins in the turn" if begins < APPROACH_S else "the ship was turning before the order"
        )
        return f"no straight approach: {begun}, by {rate_dps:.2g} deg/s"
    if speed_mps <= _SLOWEST_APPROACH * fastest_mps:
        return f"no approach under way: the ship made {speed_mps:.2g} m/s of {fastest_mps:.2g} m/s before the order"
    return ""


def turning_circle(motion: Motion, each: Plateau, shortfall: str = "") -> Manoeuvre:
    """The turning circle, or the turn of less than half a circle, of a held helm, with its indices.

    After an approach with a ``shortfall`` those are left out that hang on it.
    """
    execute = helm_execute(motion, each)
    start = execute.order_s
    end = float(motion.time_s[each.end - 1])
    part = motion.around(start, end, _MARGIN_S)
    turned = motion.at("heading_deg", end) - motion.at("heading_deg", start)
    quarter_s = (end - start) * min(1.0, 90.0 / abs(turned))
    width = half_width_s(part, quarter_s)
    times, within_s = np.array([start, end]), np.array([execute.order_within_s, 0.5 * motion.step_s])
    current = current_of(smooth_motion(part, width), start, end)
    measure = steady_turn_indices if shortfall else circle_indices
    found = _with_drift_error(bootstrap_indices(part, times, width, measure, within_s), current)
    settings = {
        **helm_settings(part, each.level, start, end),
        "turned_deg": abs(turned),
        "turning_rpm": float(part.between(start, end).main_rpm.mean()),
    }
    if not shortfall:
        settings |= {"half_command_s": execute.half_command_s, **approach_settings(part, start)}
    is_circle = abs(turned) >= LEAST_CIRCLE_DEG
    kind, word = ("turning_circle", "turning circle") if is_circle else ("course_change", "turn")
    without = f"{shortfall}; advance, transfer, tactical diameter and times count from the order after one"
    notes = (without,) if shortfall else count_notes(motion, [execute])
    shortfalls = (shortfall,) if shortfall else contradiction_of([execute])
    return manoeuvre_of(
        motion, kind, f"{word} {helm_text(motion, each.level)}", times, side_of(turned), settings, found,
        current=current, notes=notes, shortfalls=shortfalls,
    )  # fmt: skip


def steady_turn_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """Those of :func:`circle_indices` that need no approach: what is steady, also with the current removed."""
    values = circle_indices(motion, times)
    return {name: value for name, value in values.items() if name.removesuffix(REMOVED) in _STEADY}


_STEADY = ("steady_yaw_rate_dps", "steady_diameter_m", "steady_speed_mps", "drift_angle_deg")


def circle_indices(motion: Motion, times: Floats) -> dict[str, float]:
    """The indices of a smooth motion from the order to the end, ``times`` [s]; also with the current removed where
    it is known."""
    order, end = map(float, times)
    values = _indices_over_ground(motion, order, end)
    turned = abs(motion.at("heading_deg", end) - motion.at("heading_deg", order))
    if turned >= LEAST_TURN_DEG:
        north, east = drift_pairs(motion, order, end)
        if north.size:
            water = remove_current(motion, _settled_mean(north), _settled_mean(east), order)
            values |= {name + REMOVED: each for name, each in _indices_over_ground(water, order, end).items()
                       if not name.endswith(("_s", "_dps"))}  # fmt: skip
    return values


_COUNTED_FOR = {
    "advance_m": "time_to_90_deg_s", "transfer_m": "time_to_90_deg_s",
    "tactical_diameter_m": "time_to_180_deg_s",
}  # fmt: skip
"""Ways, and how long the drift has gone into them."""


def _with_drift_error(
    found: Mapping[str, tuple[float, float]], current: Current | None
) -> dict[str, tuple[float, float]]:
    """The indices with their intervals: a way less the drift is no better known than the drift over its time."""
    wider = dict(found)
    for name, seconds in _COUNTED_FOR.items():
        if current is not None and name + REMOVED in found:
            value, within = found[name + REMOVED]
            drift_m = np.hypot(current.north_within_mps, current.east_within_mps) * found[seconds][0]
            wider[name + REMOVED] = value, float(np.hypot(within, drift_m))
    return wider


def _indices_over_ground(motion: Motion, start: float, end: float) -> dict[str, float]:
    """Indices from the order at ``start`` [s]."""
    approach = approach_of(motion, start)
    side = 1.0 if motion.at("heading_deg", end) > motion.at("heading_deg", start) else -1.0
    turned = side * (motion.heading_deg - approach["approach_unwrapped_deg"])
    ahead = approach["approach_unwrapped_deg"]
    times = {angle: crossing_s(motion.time_s, turned, angle, start, end) for angle in (10.0, 90.0, 180.0, 360.0)}
    values: dict[str, float] = {"initial_turning_m": distance_m(motion, start, times[10.0])}
    if np.isfinite(times[90.0]):
        advance, transfer = along_and_across(motion, start, times[90.0], ahead)
        values |= {"advance_m": advance, "transfer_m": side * transfer}
    if np.isfinite(times[180.0]):
        values["tactical_diameter_m"] = side * along_and_across(motion, start, times[180.0], ahead)[1]
    values |= {f"time_to_{angle:.0f}_deg_s": time - start for angle, time in times.items() if angle >= 90.0}
    if np.isfinite(times[180.0]):
        values |= _steady(motion, turned, times[180.0], end, approach["approach_mps"])
    return values


def _steady(motion: Motion, turned: Floats, half_s: float, end: float, approach_mps: float) -> dict[str, float]:
    """Rate, diameter, drift angle and speed of the settled turn, over whole turns where there are any.

    Wind and current come from all sides in a whole turn and leave the means alone. It ends with the last quarter
    of a turn that was done, as nobody knows to the second when a helm was taken off.
    """
    total = 90.0 * np.floor(float(np.interp(end, motion.time_s, turned)) / 90.0)
    whole = 360.0 * np.floor((total - 180.0) / 360.0)
    first_s, last_s = (
        crossing_s(motion.time_s, turned, angle, half_s, end + motion.step_s)
        for angle in (total - whole if whole > 0 else 180.0, total)
    )
    steady = motion.between(first_s, last_s)
    if steady.time_s.size < 5 or total <= 180.0:
        return {}
    span = steady.time_s - steady.time_s.mean()
    rate_dps = float(abs(span @ steady.heading_deg) / (span @ span))
    speed, surge, sway = (
        mean_between(motion, name, first_s, last_s) for name in ("speed_mps", "surge_mps", "sway_mps")
    )
    drift = np.rad2deg(np.arctan2(-sway, surge))
    side = np.sign(steady.heading_deg[-1] - steady.heading_deg[0])
    return {
        "steady_yaw_rate_dps": rate_dps,
        "steady_diameter_m": 2.0 * speed / np.deg2rad(rate_dps),
        "steady_speed_mps": speed,
        "drift_angle_deg": float(side * drift),
        "speed_loss": 1.0 - speed / approach_mps,
    }


LEAST_TURN_DEG = 510.0
LEAST_STEADY_DEG = 270.0
"""From what turn on something of it is steady: the first half of a circle is not, and of the rest a quarter."""
_STEADY_AFTER_DEG = 120.0
_FEWEST_PAIRS = 10


def drift_pairs(motion: Motion, start: float, end: float) -> tuple[Floats, Floats]:
    """Drift north and east [m/s] from every pair of rows one turn apart, once the turn has settled."""
    inside = motion.between(start, end)
    turned = np.maximum.accumulate(np.abs(inside.heading_deg - inside.heading_deg[0]))
    rising = turned + 1e-9 * np.arange(turned.size)
    later = np.flatnonzero(turned >= _STEADY_AFTER_DEG + 360.0)
    then_s = np.interp(turned[later] - 360.0, rising, inside.time_s)
    span = inside.time_s[later] - then_s
    north = inside.north_m[later] - np.interp(then_s, inside.time_s, inside.north_m)
    east = inside.east_m[later] - np.interp(then_s, inside.time_s, inside.east_m)
    return north / span, east / span


def current_of(motion: Motion, start: float, end: float) -> Current | None:
    """The drift with its interval, None if the ship turned less than 510 deg."""
    turned = abs(motion.at("heading_deg", end) - motion.at("heading_deg", start))
    if turned < LEAST_TURN_DEG:
        return None
    north, east = drift_pairs(motion, start, end)
    if north.size < _FEWEST_PAIRS:
        return None
    return Current(_settled_mean(north), _settled_mean(east), _half_interval(north), _half_interval(east))


def _settled_mean(values: Floats) -> float:
    """The mean of the later half of the pairs: in the first turn a large ship still loses way."""
    return float(values[values.size // 2 :].mean())


def _half_interval(values: Floats) -> float:
    """Half of the 95 % interval; pairs of one circle share points, so their spread is not divided by their
    number."""
    return float(1.96 * np.std(values))


def remove_current(motion: Motion, north_mps: float, east_mps: float, start: float) -> Motion:
    """The motion through the water: path and speeds minus a steady current, the path fixed at ``start``."""
    passed = motion.time_s - start
    north, east = np.full(passed.size, north_mps), np.full(passed.size, east_mps)
    ahead, aside = to_ship(north, east, np.deg2rad(motion.heading_deg))
    return replace(
        motion,
        north_m=motion.north_m - north_mps * passed,
        east_m=motion.east_m - east_mps * passed,
        surge_mps=motion.surge_mps - ahead,
        sway_mps=motion.sway_mps - aside,
    )


def shows_current(run: Manoeuvre) -> bool:
    """Whether a run shows the current itself, as a circle and a half does; others have it from such ones."""
    return run.current is not None and run.settings.get("turned_deg", 0.0) >= LEAST_TURN_DEG
