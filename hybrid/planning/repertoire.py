"""Manoeuvres of some ten minutes that a ship can be asked for, in her own range of shaft speeds.

Made of the parts of :mod:`hybrid.simulation.manoeuvres`. Each comes with the words in which an officer of the
watch may be asked for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from hybrid.simulation.manoeuvres import Leg, Manoeuvre, reciprocal, settle, steer, turned, turning_circle, zigzag
from hybrid.vessel.parameters import Vessel

MINUTES = 10
_SLOW, _FAST = 0.7, 1.15  # of the usual shaft speed
_TUNNEL = 0.75  # of the tunnel thruster's limit
_ROUND_RPM = 5.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """A manoeuvre by name, in words, and as legs that are gone through again until the time is up."""

    name: str
    what: str
    legs: Manoeuvre


@dataclass(frozen=True, slots=True)
class Shafts:
    """Shaft speeds [rpm] to make manoeuvres with: usual, half of it, slower, faster; the tunnel thruster's."""

    usual: float
    half: float
    slow: float
    fast: float
    tunnel: float


def shafts_of(vessel: Vessel, usual_rpm: float) -> Shafts:
    """Round figures about a usual shaft speed, within what the drives can do."""
    most = vessel.pods.limit_rpm
    usual_rpm = min(usual_rpm, most)
    usual, half, slow, fast = (
        min(max(_ROUND_RPM, round(usual_rpm * share / _ROUND_RPM) * _ROUND_RPM), most)
        for share in (1.0, 0.5, _SLOW, _FAST)
    )
    return Shafts(usual, half, slow, fast, round(_TUNNEL * vessel.tunnel.limit_rpm / _ROUND_RPM) * _ROUND_RPM)


def repertoire(shafts: Shafts) -> tuple[Candidate, ...]:
    """All candidates."""
    return tuple(make(shafts) for make in _MAKERS)


def _reciprocal(at: Shafts) -> Candidate:
    legs = (
        settle(0.0, at.usual),
        steer(0.0, 220.0, at.usual),
        settle(180.0, at.usual),
        steer(180.0, 220.0, at.usual),
    )
    what = f"Run straight at {at.usual:g} rpm, 4 minutes on a heading and 4 on the reciprocal"
    return Candidate("reciprocal_headings", what, legs)


def _four_headings(at: Shafts) -> Candidate:
    what = f"Run straight at {at.usual:g} rpm on four headings 90 degrees apart, 2 minutes each"
    return Candidate("four_headings", what, reciprocal(110.0, at.usual))


def _speed_runs(at: Shafts) -> Candidate:
    speeds = (at.half, at.slow, at.usual, at.fast)
    legs = [
        leg
        for course in (0.0, 180.0)
        for leg in (settle(course, speeds[0]), *(steer(course, 65.0, rpm) for rpm in speeds))
    ]
    steps = ", ".join(f"{rpm:g}" for rpm in speeds)
    what = f"Run straight at {steps} rpm, a minute each, on a heading and on the reciprocal"
    return Candidate("speed_runs", what, tuple(legs))


def _turns(azimuth_deg: float, turn_deg: float) -> Callable[[Shafts], Candidate]:
    def make(at: Shafts) -> Candidate:
        what = (
            f"Turn through {turn_deg:g} degrees at {at.usual:g} rpm with both azimuths at {azimuth_deg:g} degrees, "
            "to one side and then to the other"
        )
        return Candidate(f"turns_{azimuth_deg:g}", what, turning_circle(azimuth_deg, at.usual, turn_deg))

    return make


def _zigzag(name: str, azimuth_deg: float, switch_deg: float, share: float = 1.0) -> Callable[[Shafts], Candidate]:
    def make(at: Shafts) -> Candidate:
        rpm = at.usual if share == 1.0 else at.slow
        legs = [
            leg
            for course in (0.0, 180.0)
            for leg in (settle(course, rpm), *zigzag(azimuth_deg, switch_deg, rpm, swings=10))
        ]
        what = f"Zigzags {azimuth_deg:g}/{switch_deg:g} at {rpm:g} rpm, about a heading and about the reciprocal"
        return Candidate(name, what, tuple(legs))

    return make


def _speed_changes(at: Shafts) -> Candidate:
    legs = [
        leg
        for course in (0.0, 180.0)
        for leg in (
            settle(course, at.fast),
            *(steer(course, 30.0, rpm) for rpm in (at.half, at.fast) * 4),
        )
    ]
    what = (
        f"Speed up to {at.fast:g} rpm and slow down to {at.half:g} rpm every 30 seconds, 5 minutes on a "
        "heading and 5 on the reciprocal"
    )
    return Candidate("speed_changes", what, tuple(legs))


def _coasting(at: Shafts) -> Candidate:
    idle = Leg(port_rpm=0.0, starboard_rpm=0.0, at_most_s=180.0)
    legs = [
        leg for course in (0.0, 180.0) for leg in (settle(course, at.usual), steer(course, 60.0, at.usual), idle)
    ]
    what = (
        f"Speed up to {at.usual:g} rpm and coast without thrust for 3 minutes, on a heading and on the reciprocal"
    )
    return Candidate("coasting", what, tuple(legs))


def _one_pod(at: Shafts) -> Candidate:
    legs: list[Leg] = []
    for port, starboard in ((at.usual, 0.0), (0.0, at.usual)):
        alone = Leg(port_rpm=port, starboard_rpm=starboard)
        legs.append(replace(alone, course_deg=0.0, at_most_s=120.0))
        legs += [replace(turned(alone, angle), at_most_s=60.0) for angle in (0.0, 15.0, -15.0)]
    what = (
        f"Run on the port thruster alone at {at.usual:g} rpm, then on the starboard alone: 2 minutes on a course, "
        "then 1 minute each held straight, at 15 degrees and at -15 degrees"
    )
    return Candidate("one_thruster_at_a_time", what, tuple(legs))


def _toed(at: Shafts) -> Candidate:
    legs = [
        Leg(port_rpm=at.usual, starboard_rpm=at.usual, port_angle_deg=a, starboard_angle_deg=-a, at_most_s=75.0)
        for a in (20.0, -20.0, 35.0, -35.0)
    ]
    what = (
        f"Hold both thrusters at {at.usual:g} rpm with azimuths opposed, 20 and 35 degrees inwards and outwards, "
        "75 seconds each, twice"
    )
    return Candidate("azimuths_opposed", what, tuple(legs))


def _uneven(at: Shafts) -> Candidate:
    legs = [
        leg
        for port, starboard in ((at.usual, at.slow), (at.slow, at.usual))
        for leg in (
            Leg(port_rpm=port, starboard_rpm=starboard, course_deg=0.0, at_most_s=90.0),
            *(
                replace(turned(Leg(port_rpm=port, starboard_rpm=starboard), angle), at_most_s=45.0)
                for angle in (10.0, -10.0)
            ),
        )
    ]
    what = (
        f"Run with port at {at.usual:g} and starboard at {at.slow:g} rpm, then the other way round: 90 seconds on "
        "a course, 45 seconds each at 10 degrees and at -10 degrees"
    )
    return Candidate("uneven_thrusters", what, tuple(legs))


def _tunnel(at: Shafts) -> Candidate:
    def push(pods: float, tunnel: float) -> Leg:
        return Leg(port_rpm=pods, starboard_rpm=pods, tunnel_rpm=tunnel, at_most_s=60.0)

    ahead = 0.3 * at.usual
    legs = [push(pods, side) for pods in (0.0, ahead) for side in (at.tunnel, 0.0, -at.tunnel, 0.0)]
    what = (
        f"Run the tunnel thruster at {at.tunnel:g} rpm to either side, a minute each and a minute of rest between, "
        f"stopped and at {ahead:.0f} rpm ahead"
    )
    return Candidate("tunnel_thruster", what, tuple(legs))


def _drifting(at: Shafts) -> Candidate:
    legs = (Leg(port_rpm=0.0, starboard_rpm=0.0, at_most_s=60.0 * MINUTES),)
    return Candidate("drifting", "Lie stopped without any thrust and drift", legs)


_MAKERS: tuple[Callable[[Shafts], Candidate], ...] = (
    _reciprocal,
    _four_headings,
    _speed_runs,
    _turns(15.0, 360.0),
    _turns(30.0, 720.0),
    _zigzag("zigzags_10_10", 10.0, 10.0),
    _zigzag("zigzags_20_20", 20.0, 20.0),
    _zigzag("zigzags_20_20_slow", 20.0, 20.0, _SLOW),
    _zigzag("zigzags_30_5", 30.0, 5.0),
    _speed_changes,
    _coasting,
    _one_pod,
    _uneven,
    _toed,
    _tunnel,
    _drifting,
)
