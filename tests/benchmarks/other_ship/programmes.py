"""What the ship is told to do: lists of orders, made as a master would write them down."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import inf, radians

import numpy as np
from numpy.typing import NDArray

STEER, HOLD, TURN, ZIGZAG = 0, 1, 2, 3


@dataclass(frozen=True, slots=True)
class Order:
    """One order, in degrees and rpm; courses count from the trial's first heading.

    ``STEER`` keeps a course for ``seconds``; ``HOLD`` keeps thrusters as they are for ``seconds``; ``TURN`` does
    so until the heading has changed by ``turn_deg``; ``ZIGZAG`` puts the azimuths to ``port_deg`` either way
    whenever the heading is ``turn_deg`` off the course, ``switches`` times. ``seconds`` ends every order.
    """

    kind: int
    port_rpm: float
    starboard_rpm: float
    port_deg: float = 0.0
    starboard_deg: float = 0.0
    tunnel_rpm: float = 0.0
    course_deg: float = 0.0
    turn_deg: float = 0.0
    switches: float = 0.0
    seconds: float = inf


def steer(course_deg: float, rpm: float, seconds: float, **other: float) -> Order:
    """Keep a course."""
    return Order(STEER, rpm, other.pop("starboard_rpm", rpm), course_deg=course_deg, seconds=seconds, **other)


def hold(rpm: float, angle_deg: float, seconds: float, tunnel_rpm: float = 0.0) -> Order:
    """Hold the thrusters."""
    return Order(HOLD, rpm, rpm, angle_deg, angle_deg, tunnel_rpm, seconds=seconds)


def turn(rpm: float, angle_deg: float, turn_deg: float) -> Order:
    """Turn through an angle; ten minutes at most."""
    return Order(TURN, rpm, rpm, angle_deg, angle_deg, turn_deg=turn_deg, seconds=600.0)


def zigzag(course_deg: float, rpm: float, angle_deg: float, turn_deg: float, switches: int = 5) -> Order:
    """A zigzag about a course; five minutes at most."""
    return Order(
        ZIGZAG, rpm, rpm, angle_deg, angle_deg,
        course_deg=course_deg, turn_deg=turn_deg, switches=switches, seconds=300.0,
    )  # fmt: skip


_ONE_THRUSTER = tuple(
    Order(kind, 170.0 * port, 170.0 * (1 - port), *2 * (angle,), course_deg=course, seconds=seconds)
    for port, course in ((1, 0.0), (0, 180.0))
    for kind, angle, seconds in ((STEER, 0.0, 120.0), (HOLD, 15.0, 60.0), (HOLD, -15.0, 60.0))
)
PROGRAMMES: dict[str, tuple[Order, ...]] = {
    "programme": (
        steer(0, 170, 90), turn(170, 30, 720), steer(0, 170, 90), turn(170, -30, 720),
        steer(0, 170, 80), zigzag(0, 170, 20, 20), steer(180, 170, 100), zigzag(180, 170, 20, 20),
        steer(180, 130, 60), zigzag(180, 130, 20, 20), steer(0, 130, 120), zigzag(0, 130, 20, 20),
        steer(0, 170, 60), zigzag(0, 170, 10, 10), zigzag(0, 170, 10, 10),
        steer(90, 170, 130), steer(180, 170, 130), steer(270, 170, 130), steer(0, 170, 130),
        steer(0, 90, 90), steer(0, 195, 100), hold(0, 0, 80), steer(180, 170, 150), hold(0, 0, 80),
        *_ONE_THRUSTER,
        steer(0, 40, 60), hold(30, 0, 60, 200), hold(30, 0, 60, -200), hold(30, 0, 30),
    ),
    "zigzags": (
        steer(0, 170, 60), zigzag(0, 170, 20, 20, 6), steer(0, 170, 60), zigzag(0, 170, 10, 10, 6),
    ),
    "straights": tuple(
        steer(course, rpm, 180) for rpm in (170, 140, 100) for course in (0, 90, 180, 270)
    ),
    "one_heading": tuple(steer(0, rpm, 240) for rpm in (170, 120, 190, 150)),
    "one_speed": (
        steer(0, 165, 120), turn(165, 20, 360), steer(90, 165, 120), turn(165, -20, 360),
        steer(180, 165, 120), turn(165, 30, 360), steer(270, 165, 120), turn(165, -30, 360),
    ),
    "harbour": (
        steer(0, 80, 120), turn(80, 40, 180), steer(180, 60, 90), hold(60, 0, 60, 220), hold(60, 0, 60, -220),
        turn(90, -45, 270), steer(90, 100, 90), hold(-60, 0, 40), hold(40, 20, 60, -150), steer(270, 80, 120),
    ),
}  # fmt: skip
"""By name; a programme that is through begins again."""

WIDTH = len(fields(Order))


def packed(orders: tuple[Order, ...]) -> NDArray[np.float64]:
    """Orders for the compiled loop [orders, WIDTH], in rev/s, rad and s."""
    rows = [
        (
            each.kind, each.port_rpm / 60.0, each.starboard_rpm / 60.0, radians(each.port_deg),
            radians(each.starboard_deg), each.tunnel_rpm, radians(each.course_deg), radians(each.turn_deg),
            each.switches, each.seconds,
        )
        for each in orders
    ]  # fmt: skip
    return np.array(rows, dtype=np.float64)
