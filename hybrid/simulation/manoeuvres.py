"""Manoeuvres as lists of legs: orders that are held, or a course that is steered, until an event ends the leg.

A list is repeated until the time is up. Headings are relative to the reference course: the ship's heading at the
start, or the course that the last steering leg held. Which controls drive the ship and which steer it follows from
the kinds of its actuators; a ship without any angle to steer by, with shafts to either side, is steered by their
difference.

Manoeuvres are stated for R/V Gunnerus: shaft speeds up to 203 rpm, and times for 28.9 m and 5.04 m/s.
:func:`scale_to_ship` scales them: the shaft speed is the same fraction of its limit, and times go with L / U, the
time in which a ship sails its own length at the usual shaft speed (Nomoto et al. 1957; Abkowitz 1964). So a ship
and its model at the same Froude number make the same manoeuvre in times that are as the roots of their lengths.

The ship under way, compiled: an autopilot that follows legs, drives with limits, the simulated ship.

Orders and controls are those of the vessel's list of actuators, in SI.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp, inf, isfinite, isnan, nan, pi, radians, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.analysis.compiling import FAST, Record, compiled, copy_row, source_stamp
from seatrial.hybrid.vessel import dynamics, files
from seatrial.hybrid.vessel.actuators import KINDS as ACTUATOR_MODELS
from seatrial.hybrid.vessel.actuators import control_units, wrapped
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel, inputs_inside
from seatrial.hybrid.vessel.plant import bare_plant
from seatrial.hybrid.vessel.sensors import HEADING, YAW_RATE, actuator_list_text
from seatrial.hybrid.vessel.signals import states_over_water
from seatrial.hybrid.vessel.simulator_process import RemoteRuns, pool_of

CRUISE_RPM = 171.0
"""The default shaft speed of R/V Gunnerus' manoeuvres."""

SETTLE_S = 60.0
HARD_OVER_DEG = 35.0
FULL_PITCH_PERCENT = 100.0
_LIMIT_RPM, _TUNNEL_LIMIT_RPM, _LENGTH_M, _SPEED_MPS = 203.0, 400.0, 28.9, 5.0437
"""R/V Gunnerus' limits of the shafts, its length, and its speed at :data:`CRUISE_RPM`."""

HandledShip = files.Vessel | BlackBox
"""What is sailed: the actuators with their drives, and dimensions."""

_APPROACH_STEPS, _MOST_APPROACHES, _START_MPS = 300, 8, 3.0
_STEADY_SHARE = 1e-5  # of the speed: a smaller change in a step is none
_SIGNIFICANT = 4  # digits of the times of other ships: no manoeuvre is stated finer


@dataclass(frozen=True, slots=True)
class Handling:
    """What each control of a ship does when it manoeuvres [controls], in the units of its channel.

    ``ahead``: how fast it turns where the shafts are ordered one rpm, 0 for what does not drive it; shafts with
    other limits turn in proportion to these. ``reversing`` says which of the shafts turn backwards for an order
    astern; ``pitch`` which controls are the pitches that do so for the others. ``helm``: how it answers a degree
    of helm that turns the ship to port: degrees of an angle, or rpm of the shafts of a ship that has no angle.
    """

    ahead: Floats
    reversing: Floats
    pitch: Floats
    helm: Floats

    @property
    def main(self) -> Bools:
        """Which controls are the shafts that drive the ship."""
        return np.asarray(self.ahead > 0.0)

    @property
    def steering_angles(self) -> Bools:
        """Which controls are the angles that steer the ship."""
        return np.asarray((self.helm != 0.0) & ~self.main)

    def orders(self, rpm: float, helm_deg: float) -> Floats:
        """The orders to all controls, in the units of their channels, for a shaft speed and a helm."""
        astern = -1.0 if rpm < 0.0 else 1.0
        shafts = self.ahead * rpm * np.where(self.reversing, 1.0, astern)
        return np.asarray(shafts + self.pitch * astern * FULL_PITCH_PERCENT + self.helm * helm_deg)


@dataclass(frozen=True, slots=True)
class Pace:
    """A ship against R/V Gunnerus: factors of shaft speed, tunnel thrusters' shaft speed, time and speed."""

    rpm: float = 1.0
    tunnel_rpm: float = 1.0
    time: float = 1.0
    speed: float = 1.0

    @property
    def length_s(self) -> float:
        """The time in which the ship goes its own length at the usual shaft speed [s]."""
        return self.time * _LENGTH_M / _SPEED_MPS


def handling_of(vessel: HandledShip) -> Handling:
    """How a ship is handled. Raises :class:`ConfigurationError` if nothing drives it."""
    limit = shaft_limit_rpm(vessel)
    entries = zip(vessel.actuator, vessel.actuators, strict=True)
    controls: list[tuple[Any, ship.Channel]] = [
        (entry, channel) for entry, actuator in entries for channel in actuator.channels
    ]
    main = np.array([ship.KINDS[entry.kind].drives and channel.unit == "rpm" for entry, channel in controls])
    ahead = np.array([entry.limit_rpm / limit if drives else 0.0
                      for (entry, _), drives in zip(controls, main, strict=True)])  # fmt: skip
    pitch = np.array([channel.unit == "%" for _, channel in controls])
    with_pitch = {entry.name for entry, channel in controls if channel.unit == "%"}
    reversing = np.array([entry.name not in with_pitch for entry, _ in controls])
    helm = np.array([  # ahead of midship the opposite angle turns the ship to port
        -ship.KINDS[entry.kind].turns * (-1.0 if entry.x_m > 0.0 else 1.0) if channel.unit == "deg" else 0.0
        for entry, channel in controls
    ])  # fmt: skip
    if not helm.any():  # with the helm hard over, the inner shafts stand
        side = np.array([np.sign(getattr(entry, "y_m", 0.0)) for entry, _ in controls]) * (ahead > 0.0)
        on_both_sides = side.min(initial=0.0) < 0.0 < side.max(initial=0.0)
        per_degree = side * ahead / HARD_OVER_DEG if on_both_sides else np.zeros(len(side))
        helm = main * per_degree * usual_rpm(vessel)
    return Handling(ahead, reversing, pitch, helm)


def shaft_limit_rpm(vessel: HandledShip) -> float:
    """The lowest limit of the shafts that drive a ship. Raises :class:`ConfigurationError` if nothing drives it."""
    entries: tuple[Any, ...] = vessel.actuator
    limits = [entry.limit_rpm for entry in entries if ship.KINDS[entry.kind].drives]
    if not limits:
        raise errors.ConfigurationError(
            f"{vessel.name} has no propulsion",
            why=f"it has {actuator_list_text(vessel.actuators)}",
            fix="add a propeller",
        )
    if not isfinite(min(limits)):
        raise errors.ConfigurationError(
            f"{vessel.name} states no limit_rpm of a shaft that drives it",
            why="a manoeuvre turns the shafts at a share of that",
            fix='write it with the actuator: {"kind": "propeller", "limit_rpm": 180.0}',
        )
    return float(min(limits))


def usual_rpm(vessel: HandledShip) -> float:
    """The shaft speed that a ship manoeuvres with: the same share of its limit for every ship."""
    return CRUISE_RPM * (shaft_limit_rpm(vessel) / _LIMIT_RPM)


def bare_model(vessel: HandledShip) -> MotionModel:
    """The model of a vessel file without its effects; a simulator is one itself."""
    return vessel if isinstance(vessel, BlackBox) else bare_plant(vessel)


def steady_speed_mps(plant: MotionModel, order: Floats) -> float:
    """The speed straight ahead in still water at an ``order`` [controls] in SI.

    Of a ship that nothing is ordered to drive, the one after a first run. A step of a run is a second for a ship of
    28.9 m, and goes with the root of the length. Raises :class:`ModelRangeError` where the speed is out of the
    range of the model.
    """
    root = sqrt(plant.length_between_perpendiculars_m / _LENGTH_M)
    state = np.array([0.0, 0.0, 0.0, min(_START_MPS * root, 0.8 * plant.surge_high_mps), 0.0, 0.0])
    orders, wind = np.tile(order, (_APPROACH_STEPS, 1)), np.zeros((_APPROACH_STEPS, 2))
    for _ in range(_MOST_APPROACHES if order.any() else 1):
        previous, state = dynamics.simulate(plant, state, orders, wind, root)[-2:]
        if abs(state[3] - previous[3]) < _STEADY_SHARE * abs(state[3]):
            break
    return float(state[3])


def pace_of(vessel: HandledShip) -> Pace:
    """A ship's pace. Raises :class:`ConfigurationError` where its shafts do not drive it ahead, or drive it out
    of the range of its model."""
    rpm = usual_rpm(vessel)
    order = handling_of(vessel).orders(rpm, 0.0) * control_units(vessel.actuators)
    try:
        speed_mps = steady_speed_mps(bare_model(vessel), order)
    except errors.ModelRangeError as error:
        raise errors.ConfigurationError(
            f"{vessel.name} leaves the range of its model straight ahead at {rpm:.0f} rpm, its usual shaft speed",
            why=error.why, fix="give the shafts a lower limit_rpm, or widen [validity] if the data allow",
        ) from error  # fmt: skip
    if speed_mps <= 0.0:
        raise errors.ConfigurationError(
            f"{vessel.name} does not move ahead at {rpm:.0f} rpm", fix="check the propellers in the vessel file"
        )
    tunnels = [tunnel.limit_rpm for tunnel in vessel.of_kind("tunnel")]
    tunnel_rpm = min(tunnels, default=_TUNNEL_LIMIT_RPM) / _TUNNEL_LIMIT_RPM
    slower = vessel.dimensions.length_between_perpendiculars_m / _LENGTH_M * (_SPEED_MPS / speed_mps)
    time, speed = (float(f"{factor:.{_SIGNIFICANT}g}") for factor in (slower, speed_mps / _SPEED_MPS))
    return Pace(shaft_limit_rpm(vessel) / _LIMIT_RPM, tunnel_rpm, time, speed)


Manoeuvre = tuple["Leg", ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """Orders and the events that end them, whichever comes first but not before ``at_least_s``.

    ``rpm`` goes to all shafts that drive the ship; a propeller of controllable pitch has it full, ahead or astern
    as the sign of ``rpm`` is. ``helm_deg`` is the angle of an azimuth thruster astern, positive turning the ship to
    port, and of all that steers the ship the angle that turns it alike: a rudder's is the opposite. Of a ship
    without any such angle it is the difference of its shafts. ``orders`` are those of single control channels, in
    their units, where they differ; other actuators are at rest. ``course_deg`` (relative to the first heading) is
    steered with all of that if given, and then ``settled`` ends the leg once it is reached; otherwise the helm is
    held. ``deviation_deg`` ends the leg when the heading is that far off the reference course (negative: to port);
    ``turn_deg`` when the ship has turned that much since the leg began; ``slower_mps`` when surge falls below.
    """

    rpm: float = CRUISE_RPM
    helm_deg: float = 0.0
    orders: Mapping[str, float] = field(default_factory=dict)
    course_deg: float = nan
    settled: bool = False
    deviation_deg: float = nan
    turn_deg: float = nan
    slower_mps: float = nan
    at_least_s: float = 0.0
    at_most_s: float = inf


ENDS = ("course", "settled", "deviation", "turn", "slower", "at_least", "at_most")
"""The columns of what a leg steers and what ends it, in SI units."""


def legs_as_arrays(manoeuvre: Manoeuvre, vessel: HandledShip) -> tuple[Floats, Floats]:
    """The legs for the compiled autopilot in SI units: orders [legs, controls] and :data:`ENDS` [legs, 7].

    Raises :class:`ConfigurationError` for an order to a channel that the vessel does not have, or where it has
    nothing to steer with.
    """
    names, units = ship.control_names(vessel.actuators), control_units(vessel.actuators)
    unknown = {name for leg in manoeuvre for name in leg.orders} - set(names)
    if unknown:
        raise errors.ConfigurationError(
            f"{vessel.name} has no {', '.join(sorted(unknown))}", fix=f"order {', '.join(names)}"
        )
    handling = handling_of(vessel)
    if any(leg.helm_deg or not isnan(leg.course_deg) for leg in manoeuvre) and not handling.helm.any():
        raise errors.ConfigurationError(
            f"{vessel.name} cannot be steered",
            why=f"it has {actuator_list_text(vessel.actuators)}",
            fix="add a rudder, an azimuth thruster, or propellers on both sides",
        )
    orders = []
    for leg in manoeuvre:
        steered = not isnan(leg.course_deg)  # then the autopilot adds the helm
        usual = handling.orders(leg.rpm, 0.0 if steered else leg.helm_deg)
        ordered = np.array([leg.orders.get(name, value) for name, value in zip(names, usual, strict=True)])
        orders.append(np.where(handling.steering_angles & steered, 0.0, ordered))
    ends = [
        (radians(leg.course_deg), float(leg.settled), radians(leg.deviation_deg), radians(leg.turn_deg),
         leg.slower_mps, leg.at_least_s, leg.at_most_s)
        for leg in manoeuvre
    ]  # fmt: skip
    return np.array(orders) * units, np.array(ends)


def shafts_rpm(leg: Leg, vessel: HandledShip) -> float:
    """The shaft speed of a leg ahead, without what its helm makes of it: the fastest of the shafts that are ordered
    one each, and none for a leg astern."""
    ahead = zip(ship.control_names(vessel.actuators), handling_of(vessel).ahead, strict=True)
    return float(max(0.0, *(leg.orders.get(name, share * leg.rpm) / share for name, share in ahead if share)))


def scale_to_ship(manoeuvre: Manoeuvre, vessel: HandledShip) -> Manoeuvre:
    """A manoeuvre that is stated for R/V Gunnerus, at another ship's shaft speeds and in its time."""
    pace = pace_of(vessel)
    if pace == Pace():
        return manoeuvre
    factors = [pace.rpm if main else pace.tunnel_rpm for main in handling_of(vessel).main]
    by_channel = {name: factor for name, factor in zip(ship.control_names(vessel.actuators), factors, strict=True)
                  if name.endswith("_rpm")}  # fmt: skip
    return tuple(
        replace(
            leg,
            rpm=leg.rpm * pace.rpm,
            orders={name: value * by_channel.get(name, 1.0) for name, value in leg.orders.items()},
            slower_mps=leg.slower_mps * pace.speed,
        )
        for leg in scale_times(manoeuvre, pace.time)
    )


def scale_times(manoeuvre: Manoeuvre, factor: float) -> Manoeuvre:
    """A manoeuvre whose times are multiplied by a factor."""
    if factor == 1.0:
        return manoeuvre
    return tuple(
        replace(leg, at_least_s=factor * leg.at_least_s, at_most_s=factor * leg.at_most_s) for leg in manoeuvre
    )


def helm_leg(angle_deg: float, rpm: float = CRUISE_RPM, at_most_s: float = inf) -> Leg:
    """One helm and one speed held."""
    return Leg(rpm=rpm, helm_deg=angle_deg, at_most_s=at_most_s)


def steer(course_deg: float, seconds: float, rpm: float = CRUISE_RPM) -> Leg:
    """Keep a course for so long."""
    return Leg(rpm=rpm, course_deg=course_deg, at_least_s=seconds, at_most_s=seconds)


def settle(course_deg: float, rpm: float = CRUISE_RPM) -> Leg:
    """Come to a course, and go on when it is reached."""
    return replace(steer(course_deg, 5.0, rpm), settled=True, at_most_s=SETTLE_S)


def zigzag(
    helm_deg: float = 20.0, switch_deg: float = 20.0, rpm: float = CRUISE_RPM, hold_s: float = 0.0, swings: int = 6
) -> Manoeuvre:
    """Helm to one side until the heading is off by ``switch_deg``, then to the other (IMO MSC.137(76)).

    Each swing holds the helm for ``hold_s`` at least. A positive helm turns the ship to port.
    """
    legs = []
    for swing in range(swings):
        side = 1.0 if swing % 2 == 0 else -1.0
        leg = helm_leg(side * helm_deg, rpm, at_most_s=max(120.0, 2.0 * hold_s))
        legs.append(replace(leg, deviation_deg=-side * switch_deg, at_least_s=hold_s))
    return tuple(legs)


def on_reciprocal_courses(legs_on: Callable[[float], Iterable[Leg]]) -> Manoeuvre:
    """Legs about the first heading, and once more about the reciprocal."""
    return tuple(leg for course in (0.0, 180.0) for leg in legs_on(course))


def turning_circle(helm_deg: float = 20.0, rpm: float = CRUISE_RPM, turn_deg: float = 720.0) -> Manoeuvre:
    """A straight approach and a turn, to one side and then to the other."""
    turns = (replace(helm_leg(side * helm_deg, rpm), turn_deg=turn_deg) for side in (1.0, -1.0))
    return tuple(leg for turn in turns for leg in (steer(0.0, 30.0, rpm), turn, settle(0.0, rpm)))


def speed_runs() -> Manoeuvre:
    """Straight runs at five shaft speeds, on a course and on its reciprocal."""
    speeds = (90.0, 120.0, 150.0, 175.0, 198.0)
    return on_reciprocal_courses(
        lambda course: (settle(course, 120.0), *(steer(course, 75.0, rpm) for rpm in speeds))
    )


def stopping_runs() -> Manoeuvre:
    """Speed up, slow down, coast without thrust, and once more on the reciprocal course."""
    idle = Leg(rpm=0.0, slower_mps=1.0, at_most_s=120.0)
    return on_reciprocal_courses(
        lambda course: (settle(course, 190.0), steer(course, 70.0, 190.0), steer(course, 60.0, 90.0), idle)
    )


def single_drive_legs(drives: Sequence[str], rpm: float, seconds: float, *, by_angle: bool) -> list[list[Leg]]:
    """Each of a ship's drives alone for so long: on a course, held straight, and held at an angle.

    Of a ship that is steered by the difference of its shafts, as it goes.
    """
    turns = []
    for name in drives:
        single = Leg(rpm=rpm, orders={f"{drive}_rpm": 0.0 for drive in drives if drive != name})
        turns.append([replace(single, at_most_s=seconds)])
        if by_angle:
            held_angles = (replace(single, helm_deg=angle, at_most_s=0.2 * seconds) for angle in (0.0, 15.0, -15.0))
            turns[-1] = [replace(single, course_deg=0.0, at_most_s=0.4 * seconds), *held_angles]
    return turns


def one_thruster_manoeuvre(actuators: ship.Actuators = ship.DEFAULT) -> Manoeuvre:
    """Each main thruster alone, one after the other, and back on the course."""
    by_angle = any(actuator.angle for actuator in actuators)
    turns = single_drive_legs(ship.shafts(actuators), 150.0, 100.0, by_angle=by_angle)
    return tuple(leg for legs in turns for leg in (*legs, settle(0.0, 150.0)))


def tunnel_test(actuators: ship.Actuators = ship.DEFAULT) -> Manoeuvre:
    """Each tunnel thruster both ways at slow speed, the helm held."""
    slow = Leg(rpm=50.0, at_most_s=40.0)
    pushes = (replace(slow, orders={f"{name}_rpm": rpm})
              for name in ship.names_of_kind(actuators, "tunnel") for rpm in (300.0, -300.0))  # fmt: skip
    return (steer(0.0, 60.0, 50.0), *(leg for push in pushes for leg in (push, slow)))


def straight_runs_on_four_headings(seconds: float = 80.0, rpm: float = 160.0) -> Manoeuvre:
    """Straight runs on four headings."""
    return tuple(
        leg for course in (0.0, 180.0, 90.0, 270.0) for leg in (settle(course, rpm), steer(course, seconds, rpm))
    )


def programme(actuators: ship.Actuators = ship.DEFAULT) -> Manoeuvre:
    """An hour that tells effects apart: turns, zigzags on reciprocal headings, four headings, stops, each drive."""
    swings = [
        leg
        for course, rpm in ((0.0, 171.0), (180.0, 171.0), (180.0, 130.0), (0.0, 130.0))
        for leg in (settle(course, rpm), *zigzag(20.0, 20.0, rpm, swings=12))
    ]
    turns = turning_circle(30.0, 160.0)
    gentle = (settle(90.0), *zigzag(10.0, 10.0, swings=12))
    return (
        *turns,
        *swings,
        *gentle,
        *straight_runs_on_four_headings(),
        *stopping_runs(),
        *one_thruster_manoeuvre(actuators),
        *tunnel_test(actuators),
    )


def paper_manoeuvre() -> Manoeuvre:
    """Zigzags at 10, 20 and 30 degrees of helm, about half ahead, whose swings are held for 38 s and more."""
    legs: list[Leg] = []
    for number, (angle, rpm) in enumerate(((10.0, 130.0), (20.0, 110.0), (30.0, 100.0))):
        course = 180.0 * (number % 2)
        legs += [settle(course, rpm), steer(course, 35.0, rpm)]
        legs += zigzag(angle, 20.0, rpm, hold_s=38.0, swings=6)
    return tuple(legs)


def voyage_manoeuvre() -> Manoeuvre:
    """Some twenty minutes for a demonstration: zigzags held for 20 s and more, turns, several shaft speeds."""
    legs: list[Leg] = []
    runs = ((0.0, 10.0, 171.0), (90.0, 20.0, 150.0), (180.0, 15.0, 185.0), (270.0, 10.0, 130.0))
    for course, angle, rpm in runs:
        legs += [settle(course, rpm), *zigzag(angle, 20.0, rpm, hold_s=26.0, swings=6)]
        legs += zigzag(20.0, 20.0, rpm, swings=2)
        legs += [helm_leg(0.0, rpm, at_most_s=30.0), helm_leg(-angle, rpm, at_most_s=40.0)]
    return tuple(legs)


MANOEUVRES: dict[str, Callable[[ship.Actuators], Manoeuvre]] = {
    "voyage": lambda _: voyage_manoeuvre(), "programme": programme, "paper": lambda _: paper_manoeuvre(),
    "zigzag": lambda _: zigzag(),
    "turning_circle": lambda _: turning_circle(), "speed_runs": lambda _: speed_runs(),
    "stopping": lambda _: stopping_runs(), "one_thruster": one_thruster_manoeuvre, "tunnel_test": tunnel_test,
    "reciprocal": lambda _: straight_runs_on_four_headings(),
}  # fmt: skip
"""The manoeuvres by name, for a ship with these actuators."""

_SIZED = re.compile(r"(zigzag|turning_circle)_(\d+)(?:_(\d+))?")


def manoeuvre_named(name: str, actuators: ship.Actuators = ship.DEFAULT) -> Manoeuvre:
    """A manoeuvre by name; ``zigzag_A_S`` and ``turning_circle_A`` give helm and switching angle.

    Shaft speeds and times are R/V Gunnerus': :func:`scale_to_ship` has those of another.
    """
    if name in MANOEUVRES:
        return MANOEUVRES[name](actuators)
    sized = _SIZED.fullmatch(name)
    if sized and sized[1] == "zigzag" and sized[3]:
        return zigzag(float(sized[2]), float(sized[3]))
    if sized and sized[1] == "turning_circle" and not sized[3]:
        return turning_circle(float(sized[2]))
    raise errors.ConfigurationError(
        f"no manoeuvre {name!r}", fix=f"use one of {', '.join(MANOEUVRES)}, zigzag_10_20, turning_circle_30"
    )


STAMP = source_stamp(Path(__file__).parent, Path(__file__).parents[1] / "vessel")
STEER_GAIN, STEER_DAMPING_S, STEER_LIMIT_RAD = 0.8, 3.0, 25.0 * pi / 180.0
COURSE = ENDS.index("course")
SETTLED_RAD, SETTLED_RADPS = 2.0 * pi / 180.0, 0.2 * pi / 180.0


class Drives(NamedTuple):
    """What the drive of each control can do [controls]: time constant [s], limit of the order, limit of the rate.

    ``helm`` is how each control answers a radian of the autopilot's helm, positive turning the ship to port: 1 for
    the angle of a stern azimuth, -1 for one ahead and for a rudder, 0 for what does not steer, shaft speed [rev/s]
    for a ship that is steered by its difference. ``damping_s`` is the helm for a rate of turn, and
    ``settled_radps`` the rate of turn of a settled course.
    """

    lag_s: Floats
    limit: Floats
    rate: Floats
    helm: Floats
    damping_s: float
    settled_radps: float


def drives_of(vessel: HandledShip, pace: Pace | None = None) -> Drives:
    """The drives of a vessel file, and how the autopilot uses them: its times go with the ship's own ``pace``."""
    pace = pace or pace_of(vessel)
    helm = handling_of(vessel).helm * (control_units(vessel.actuators) / radians(1.0))
    drives = [drive for entry in vessel.actuator for drive in ACTUATOR_MODELS[entry.kind].drives(entry)]
    return Drives(
        np.array([drive.lag_s for drive in drives]),
        np.array([drive.limit for drive in drives]),
        np.array([drive.rate for drive in drives]),
        helm,
        STEER_DAMPING_S * pace.time,
        SETTLED_RADPS / pace.time,
    )


@compiled
def clip_to_limit(value: float, limit: float) -> float:
    """``value`` within ``limit`` either way."""
    return float(min(max(value, -limit), limit))


@compiled
def lag_shares(drives: Drives, dt_s: float) -> dynamics.Control:
    """How much of the way to its order each control goes in a step, but for the limit of its rate."""
    fractions = np.ones(len(drives.lag_s))
    for i in range(len(fractions)):
        if drives.lag_s[i] > 0.0:
            fractions[i] = 1.0 - exp(-dt_s / drives.lag_s[i])
    return fractions


@compiled
def advance_drives(
    drives: Drives, share: dynamics.Control, feedback: dynamics.Control, order: dynamics.Control, dt_s: float
) -> None:
    """Move the drives a step on: first-order lags, none faster than it can, orders within limits."""
    for i in range(len(feedback)):
        step = share[i] * (clip_to_limit(order[i], drives.limit[i]) - feedback[i])
        feedback[i] += clip_to_limit(step, drives.rate[i] * dt_s)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def response_of(drives: Drives, orders: Floats, dt_s: float) -> Floats:
    """The drives' feedback [T, controls] to ``orders`` [T, controls], from the first of them on."""
    share, feedback = lag_shares(drives, dt_s), np.empty_like(orders)
    for k in range(orders.shape[0]):
        for i in range(orders.shape[1]):
            feedback[k, i] = feedback[k - 1, i] if k > 0 else clip_to_limit(orders[0, i], drives.limit[i])
        if k > 0:
            advance_drives(drives, share, feedback[k], orders[k - 1], dt_s)
    return feedback


@njit(cache=True, fastmath=FAST, error_model="numpy")
def follow_with_band(orders: Floats, start: float, rate: float, lag_s: float, band: float, step_s: float) -> Floats:
    """The angle [K] that follows ``orders`` [K] from ``start``, all in one unit; ``rate`` by second."""
    share = 1.0 - exp(-step_s / lag_s) if lag_s > 0.0 else 1.0
    angle, response = start, np.empty_like(orders)
    for k in range(len(orders)):
        response[k] = angle
        error = orders[k] - angle
        if abs(error) > band:
            angle += min(max(share * error, -rate * step_s), rate * step_s)
    return response


@compiled
def give_order(
    drives: Drives,
    leg: Floats,
    ends: Floats,
    base_rad: float,
    heading_rad: float,
    radps: float,
    order: dynamics.Control,
) -> None:
    """Fill ``order`` with a leg's; where it steers, helm that answers course error and rate of turn is added."""
    copy_row(order, leg)
    if isnan(ends[COURSE]):
        return
    error = wrapped(base_rad + ends[COURSE] - heading_rad)
    # A positive helm turns the ship to port, so that it is opposite to the error.
    helm_rad = clip_to_limit(drives.damping_s * radps - STEER_GAIN * error, STEER_LIMIT_RAD)
    for i in range(len(order)):
        order[i] += drives.helm[i] * helm_rad


@compiled
def leg_has_ended(
    settled_radps: float,
    ends: Floats,
    state: dynamics.State,
    base_rad: float,
    reference_rad: float,
    initial: dynamics.State,
    elapsed_s: float,
) -> bool:
    """Whether a leg is over; see :class:`~seatrial.hybrid.simulation.manoeuvres.Leg`."""
    _, _, heading, u, _, r = state
    course, settled, deviation, turn, slower, at_least_s, at_most_s = ends[:7]
    if elapsed_s >= at_most_s:
        return True
    if elapsed_s < at_least_s:
        return False
    deviation_rad = heading - reference_rad
    ended = (deviation > 0.0 and deviation_rad >= deviation) or (deviation < 0.0 and deviation_rad <= deviation)
    if settled > 0.0 and abs(wrapped(base_rad + course - heading)) < SETTLED_RAD and abs(r) < settled_radps:
        ended = True
    return bool(ended or abs(heading - initial[2]) >= turn or u <= slower)  # comparisons with NaN are false


def sail_black_box(
    model: BlackBox, start: Floats, legs: Floats, ends: Floats, drives: Drives, wind: Floats, dt_s: float,
    *, repeat: bool,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The states [K+1, 6] of a simulator and its drives' feedback [K+1, controls] through a manoeuvre.

    NaN after the manoeuvre, unless it is to ``repeat``. The autopilot is that of :data:`sail`.

    Raises :class:`ModelRangeError` where it fails or returns no number.
    """
    (north, east), push = model.current_mps, model.push
    states, controls = np.full((len(wind) + 1, 6), np.nan), np.full((len(wind) + 1, legs.shape[1]), np.nan)
    state = states[0] = start
    base = reference = start[HEADING]
    number, initial, elapsed_s = 0, start, 0.0
    drive, share = np.empty(legs.shape[1]), lag_shares(drives, dt_s)
    give_order(drives, legs[0], ends[0], base, state[HEADING], state[YAW_RATE], drive)
    order, runs = drive.copy(), RemoteRuns(pool_of(model.spec), 1)
    moved = states_over_water(start[None], model.current_mps, 0.0)
    inside, air = inputs_inside(model, drive[None, None], wind[None, :1], dt_s)
    runs.start(moved, inside[:, 0], air[:, 0])
    for k in range(len(wind)):
        if leg_has_ended(drives.settled_radps, ends[number], state, base, reference, initial, elapsed_s):
            number = (number + 1) % len(legs)
            initial, elapsed_s = state, 0.0
            if number == 0 and not repeat:
                controls[k] = drive
                return states, controls
        if not isnan(ends[number, COURSE]):
            reference = state[HEADING] + wrapped(base + ends[number, COURSE] - state[HEADING])
        controls[k] = drive
        inside, air = inputs_inside(model, drive[None, None], wind[None, k : k + 1], dt_s)
        pushed = None if push is None else push.accelerations(moved)
        begin = None if pushed is None or model.spec.takes_acceleration else moved
        moved = runs.step(begin, inside[:, 0], air[:, 0], dt_s, pushed)
        state = states[k + 1] = states_over_water(moved, (-north, -east), (k + 1) * dt_s)[0]
        if not np.isfinite(state).all():
            raise errors.ModelRangeError(
                f"{runs.failures.get(0, 'returned no number')} after {k * dt_s:g} s", where=model.file,
                fix="check the manoeuvre, and the simulator for such",
            )  # fmt: skip
        give_order(drives, legs[number], ends[number], base, state[HEADING], state[YAW_RATE], order)
        advance_drives(drives, share, drive, order, dt_s)
        elapsed_s += dt_s
    controls[-1] = drive
    return states, controls


def _make_sail(stamp: int) -> Callable[..., int]:
    @njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
    def sail(
        p: Record, start: Floats, legs: Floats, ends: Floats, drives: Drives, wind: Floats, drift_n: Floats,
        dt_s: float, substeps: int, extra: Callable[..., tuple[float, float, float]] | None, parameters: Floats,
        repeat: bool, states: Floats, controls: Floats,
    ) -> int:  # fmt: skip
        """Fill ``states`` [K+1, 6] and the drives' feedback ``controls`` [K+1, controls].

        ``legs`` [legs, controls] and ``ends`` [legs, 7] are the manoeuvre's: after the last comes the first again,
        or without ``repeat`` nothing more. Returns the first step that ends out of the model's range, or -1.
        Changes the drift force in ``p``.
        """
        if stamp == 0:
            return -1
        mass, lag = dynamics.inverse_mass(p), dynamics.lag_shares_over_step(p, dt_s / substeps)
        state = (start[0], start[1], start[2], start[3], start[4], start[5])
        base = reference = start[HEADING]
        number, initial, elapsed_s = 0, state, 0.0
        drive, share = np.empty(legs.shape[1]), lag_shares(drives, dt_s)
        give_order(drives, legs[0], ends[0], base, start[HEADING], start[YAW_RATE], drive)
        acting, order, scratch = drive.copy(), drive.copy(), dynamics.scratch_for(p, drive)
        copy_row(states[0], start)
        for k in range(wind.shape[0]):
            if leg_has_ended(drives.settled_radps, ends[number], state, base, reference, initial, elapsed_s):
                number = (number + 1) % legs.shape[0]
                initial, elapsed_s = state, 0.0
                if number == 0 and not repeat:
                    copy_row(controls[k], drive)
                    return -1
            if not isnan(ends[number, COURSE]):
                reference = state[HEADING] + wrapped(base + ends[number, COURSE] - state[HEADING])
            copy_row(controls[k], drive)
            p.drift_force_n = drift_n[k]
            air = (wind[k, 0], wind[k, 1])
            state = dynamics.advance(
                p, mass, lag, drive, acting, scratch, air, k * dt_s, dt_s, substeps, state, extra, parameters
            )
            give_order(drives, legs[number], ends[number], base, state[HEADING], state[YAW_RATE], order)
            advance_drives(drives, share, drive, order, dt_s)
            elapsed_s += dt_s
            for i in range(6):
                states[k + 1, i] = state[i]
            if not dynamics.in_range(p, state):
                return k
        copy_row(controls[wind.shape[0]], drive)
        return -1

    return sail  # type: ignore[no-any-return]


sail = _make_sail(STAMP)
