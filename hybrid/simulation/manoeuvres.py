"""Manoeuvres as lists of legs: orders that are held, or a course that is steered, until something happens.

A list is gone through again and again until the time is up. Headings are relative to the reference course:
the ship's heading at the start, or the course that the last steering leg held.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, nan, radians

import numpy as np

from acquisition.core.arrays import Floats
from acquisition.core.errors import ConfigurationError
from hybrid.vessel.channels import RPM_PER_RPS

CRUISE_RPM = 171.0
SETTLE_S = 60.0
Manoeuvre = tuple["Leg", ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """Orders and the events that end them, whichever comes first but not before ``at_least_s``.

    ``course_deg`` (relative to the first heading) is steered with both azimuths if given, and then
    ``settled`` ends the leg once it is reached; otherwise the angles are held. ``deviation_deg`` ends the leg
    when the heading is that far off the reference course (negative: to port); ``turn_deg`` when the ship has
    turned that much since the leg began; ``slower_mps`` when surge falls below.
    """

    port_rpm: float = CRUISE_RPM
    starboard_rpm: float = CRUISE_RPM
    port_angle_deg: float = 0.0
    starboard_angle_deg: float = 0.0
    tunnel_rpm: float = 0.0
    course_deg: float = nan
    settled: bool = False
    deviation_deg: float = nan
    turn_deg: float = nan
    slower_mps: float = nan
    at_least_s: float = 0.0
    at_most_s: float = inf


COLUMNS = (
    "port_rps", "starboard_rps", "port_angle", "starboard_angle", "tunnel_rpm", "course", "settled",
    "deviation", "turn", "slower", "at_least", "at_most",
)  # fmt: skip


def as_array(manoeuvre: Manoeuvre) -> Floats:
    """The legs as numbers in SI units for the compiled autopilot: [legs, len(COLUMNS)]."""
    return np.array([_numbers(leg) for leg in manoeuvre])


def _numbers(leg: Leg) -> tuple[float, ...]:
    shafts = leg.port_rpm / RPM_PER_RPS, leg.starboard_rpm / RPM_PER_RPS
    angles = radians(leg.port_angle_deg), radians(leg.starboard_angle_deg)
    steering = radians(leg.course_deg), float(leg.settled)
    ends = radians(leg.deviation_deg), radians(leg.turn_deg), leg.slower_mps, leg.at_least_s, leg.at_most_s
    return *shafts, *angles, leg.tunnel_rpm, *steering, *ends


def helm(angle_deg: float, rpm: float = CRUISE_RPM, at_most_s: float = inf) -> Leg:
    """Both pods held at one angle and speed."""
    return turned(Leg(port_rpm=rpm, starboard_rpm=rpm, at_most_s=at_most_s), angle_deg)


def turned(leg: Leg, angle_deg: float) -> Leg:
    """``leg`` with both pods at one angle."""
    return replace(leg, port_angle_deg=angle_deg, starboard_angle_deg=angle_deg)


def steer(course_deg: float, seconds: float, rpm: float = CRUISE_RPM) -> Leg:
    """Keep a course for so long."""
    return Leg(port_rpm=rpm, starboard_rpm=rpm, course_deg=course_deg, at_least_s=seconds, at_most_s=seconds)


def settle(course_deg: float, rpm: float = CRUISE_RPM) -> Leg:
    """Come to a course, and go on when it is reached."""
    return replace(steer(course_deg, 5.0, rpm), settled=True, at_most_s=SETTLE_S)


def zigzag(
    azimuth_deg: float = 20.0,
    switch_deg: float = 20.0,
    rpm: float = CRUISE_RPM,
    hold_s: float = 0.0,
    swings: int = 6,
) -> Manoeuvre:
    """Azimuth to one side until the heading is off by ``switch_deg``, then to the other (IMO MSC.137(76)).

    Each swing holds the thrusters for ``hold_s`` at least. A positive azimuth turns the ship to port.
    """
    legs = []
    for swing in range(swings):
        side = 1.0 if swing % 2 == 0 else -1.0
        leg = helm(side * azimuth_deg, rpm, at_most_s=max(120.0, 2.0 * hold_s))
        legs.append(replace(leg, deviation_deg=-side * switch_deg, at_least_s=hold_s))
    return tuple(legs)


def turning_circle(azimuth_deg: float = 20.0, rpm: float = CRUISE_RPM, turn_deg: float = 720.0) -> Manoeuvre:
    """A straight approach and a turn, to one side and then to the other."""
    turns = [replace(helm(side * azimuth_deg, rpm), turn_deg=turn_deg) for side in (1.0, -1.0)]
    return (
        steer(0.0, 30.0, rpm),
        turns[0],
        settle(0.0, rpm),
        steer(0.0, 30.0, rpm),
        turns[1],
        settle(0.0, rpm),
    )


def speed_runs(seconds: float = 75.0) -> Manoeuvre:
    """Straight runs at five shaft speeds, on a course and on its reciprocal."""
    legs: list[Leg] = []
    for course in (0.0, 180.0):
        legs.append(settle(course, 120.0))
        legs += [steer(course, seconds, rpm) for rpm in (90.0, 120.0, 150.0, 175.0, 198.0)]
    return tuple(legs)


def stopping() -> Manoeuvre:
    """Speed up, slow down, coast without thrust, and once more on the reciprocal course."""
    legs: list[Leg] = []
    for course in (0.0, 180.0):
        idle = Leg(port_rpm=0.0, starboard_rpm=0.0, slower_mps=1.0, at_most_s=120.0)
        legs += [settle(course, 190.0), steer(course, 70.0, 190.0), steer(course, 60.0, 90.0), idle]
    return tuple(legs)


def one_thruster(seconds: float = 100.0, rpm: float = 150.0) -> Manoeuvre:
    """Port alone, then starboard alone: held straight, held at an angle, and on a course."""
    legs: list[Leg] = []
    for port, starboard in ((rpm, 0.0), (0.0, rpm)):
        alone = Leg(port_rpm=port, starboard_rpm=starboard)
        legs.append(replace(alone, course_deg=0.0, at_most_s=0.4 * seconds))
        legs += [replace(turned(alone, angle), at_most_s=0.2 * seconds) for angle in (0.0, 15.0, -15.0)]
        legs.append(settle(0.0, rpm))
    return tuple(legs)


def tunnel_test(seconds: float = 40.0) -> Manoeuvre:
    """The tunnel thruster both ways at slow speed, the pods astern of it held."""
    slow = Leg(port_rpm=50.0, starboard_rpm=50.0, at_most_s=seconds)
    both = (replace(slow, tunnel_rpm=300.0), slow, replace(slow, tunnel_rpm=-300.0), slow)
    return steer(0.0, 60.0, 50.0), *both


def reciprocal(seconds: float = 80.0, rpm: float = 160.0) -> Manoeuvre:
    """Straight runs on four headings."""
    return tuple(
        leg for course in (0.0, 180.0, 90.0, 270.0) for leg in (settle(course, rpm), steer(course, seconds, rpm))
    )


def programme() -> Manoeuvre:
    """An hour that tells effects apart: turns, zigzags on reciprocal headings, four headings, stops, one pod."""
    swings = [
        leg
        for course, rpm in ((0.0, 171.0), (180.0, 171.0), (180.0, 130.0), (0.0, 130.0))
        for leg in (settle(course, rpm), *zigzag(20.0, 20.0, rpm, swings=12))
    ]
    turns = turning_circle(30.0, 160.0)
    gentle = (settle(90.0), *zigzag(10.0, 10.0, swings=12))
    return *turns, *swings, *gentle, *reciprocal(), *stopping(), *one_thruster(), *tunnel_test()


def paper() -> Manoeuvre:
    """Zigzags at 10, 20 and 30 degrees of azimuth, about half ahead, whose swings are held for 38 s and more."""
    legs: list[Leg] = []
    for number, (angle, rpm) in enumerate(((10.0, 130.0), (20.0, 110.0), (30.0, 100.0))):
        course = 180.0 * (number % 2)
        legs += [settle(course, rpm), steer(course, 35.0, rpm)]
        legs += zigzag(angle, 20.0, rpm, hold_s=38.0, swings=6)
    return tuple(legs)


def voyage() -> Manoeuvre:
    """Some twenty minutes for a demonstration: zigzags held for 20 s and more, turns, several shaft speeds."""
    legs: list[Leg] = []
    runs = ((0.0, 10.0, 171.0), (90.0, 20.0, 150.0), (180.0, 15.0, 185.0), (270.0, 10.0, 130.0))
    for course, angle, rpm in runs:
        legs += [settle(course, rpm), *zigzag(angle, 20.0, rpm, hold_s=26.0, swings=6)]
        legs += zigzag(20.0, 20.0, rpm, swings=2)
        legs += [helm(0.0, rpm, at_most_s=30.0), helm(-angle, rpm, at_most_s=40.0)]
    return tuple(legs)


MANOEUVRES: dict[str, Callable[[], Manoeuvre]] = {
    "voyage": voyage,
    "programme": programme,
    "paper": paper,
    "zigzag": zigzag,
    "turning_circle": turning_circle,
    "speed_runs": speed_runs,
    "stopping": stopping,
    "one_thruster": one_thruster,
    "tunnel_test": tunnel_test,
    "reciprocal": reciprocal,
}
_SIZED = re.compile(r"(zigzag|turning_circle)_(\d+)(?:_(\d+))?")


def manoeuvre_named(name: str) -> Manoeuvre:
    """A manoeuvre by name; ``zigzag_A_S`` and ``turning_circle_A`` give azimuth and switching angle."""
    if name in MANOEUVRES:
        return MANOEUVRES[name]()
    sized = _SIZED.fullmatch(name)
    if sized and sized[1] == "zigzag" and sized[3]:
        return zigzag(float(sized[2]), float(sized[3]))
    if sized and sized[1] == "turning_circle" and not sized[3]:
        return turning_circle(float(sized[2]))
    raise ConfigurationError(
        f"no manoeuvre {name!r}", fix=f"use one of {', '.join(MANOEUVRES)}, zigzag_10_20, turning_circle_30"
    )
