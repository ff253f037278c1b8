"""Manoeuvres of some ten minutes that a ship can be asked for, scaled to her shaft speeds and pace, and their
simulation.

They are made of the parts of :mod:`seatrial.hybrid.simulation.manoeuvres`, with the words in which an officer of
the watch may be asked for them. A simulated candidate is a log without noise or gaps: the information of a trial
depends on where it takes the ship, not on the noise of the readings, so its true motion serves as the measured one
and needs no smoothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuators, names_of
from seatrial.acquisition.core.ship import shafts as drives_in
from seatrial.hybrid.diagnosis.log import BLOCK_S, LEG_S, STEPS_PER_SECOND, Log
from seatrial.hybrid.simulation.handling import HARD_OVER_DEG, pace_of, shaft_limit_rpm
from seatrial.hybrid.simulation.handling import usual_rpm as own_usual_rpm
from seatrial.hybrid.simulation.manoeuvres import (
    Leg,
    Manoeuvre,
    both_ways,
    in_time,
    one_by_one,
    reciprocal,
    settle,
    steer,
    turning_circle,
    zigzag,
)
from seatrial.hybrid.simulation.sea_state import SeaState
from seatrial.hybrid.simulation.trial import sail_through
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import measure

MINUTES = 10.0
"""The length of a manoeuvre for R/V Gunnerus [min]; other ships' lengths are scaled."""

_FEWEST_MINUTES = 2
_IN_SECONDS_S = 100.0  # shorter times are given in seconds
_SLOW, _FAST = 0.7, 1.15  # of the usual shaft speed
_TUNNEL = 0.75  # of the tunnel thruster's limit
_ROUND_RPM = 5.0
_MIXED = "helm"  # what steers a ship by more than one sort of angle


@dataclass(frozen=True, slots=True, eq=False)
class CandidateManoeuvre:
    """A manoeuvre: name, description, and legs that are repeated until its ``minutes`` are over."""

    name: str
    what: str
    legs: Manoeuvre
    minutes: float = MINUTES


@dataclass(frozen=True, slots=True)
class Shafts:
    """Shaft speeds [rpm] for manoeuvres: usual, half, slower, faster; the tunnel thruster's.

    ``drives`` and ``tunnels`` are the names of propulsors and tunnel thrusters, ``steering`` those of the
    actuators that steer by an angle, none for a ship steered by differential thrust. ``drive`` and ``steers``
    are words for one of them. ``time`` is the length of her manoeuvres relative to R/V Gunnerus'. ``most`` is
    the lowest limit of her shafts, ``hard_over`` the rpm that a hard-over helm adds to one shaft and subtracts
    from the other.
    """

    usual: float
    half: float
    slow: float
    fast: float
    tunnel: float
    drives: tuple[str, ...]
    steering: tuple[str, ...]
    tunnels: tuple[str, ...]
    drive: str = "thruster"
    steers: str = "azimuth"
    time: float = 1.0
    most: float = inf
    hard_over: float = 0.0

    @property
    def minutes(self) -> float:
        """The length of a manoeuvre, with repetitions, in whole minutes."""
        return float(max(_FEWEST_MINUTES, round(MINUTES * self.time)))

    def candidate(self, name: str, what: str, legs: Sequence[Leg]) -> CandidateManoeuvre:
        """A candidate whose legs are given in R/V Gunnerus' time."""
        return CandidateManoeuvre(name, what, in_time(tuple(legs), self.time), self.minutes)

    def span(self, seconds: float) -> str:
        """A time given for R/V Gunnerus, scaled to this ship, in words."""
        own_s = seconds * self.time
        if own_s < _IN_SECONDS_S:
            return "a minute" if round(own_s) == 60 else f"{max(5.0, 5.0 * round(own_s / 5.0)):g} seconds"
        return f"{round(own_s / 30.0) / 2.0:g} minutes"

    def helm(self, angle_deg: float, rpm: float) -> str:
        """The helm at an angle and a shaft speed, in words."""
        if not self.steering:
            apart = angle_deg / HARD_OVER_DEG * self.hard_over
            return f"one shaft at {min(rpm + apart, self.most):.0f} and the other at {rpm - apart:.0f} rpm"
        number = {1: f"the {self.steers}", 2: f"both {self.steers}s"}
        return f"{number.get(len(self.steering), f'all {self.steers}s')} at {angle_deg:g} degrees"


def shafts_of(vessel: Vessel, usual_rpm: float) -> Shafts:
    """Round figures around a usual shaft speed, within the limits of the drives."""
    most = shaft_limit_rpm(vessel)
    usual_rpm = min(usual_rpm, most)
    usual, half, slow, fast = (
        min(max(_ROUND_RPM, round(usual_rpm * share / _ROUND_RPM) * _ROUND_RPM), most)
        for share in (1.0, 0.5, _SLOW, _FAST)
    )
    aside = min((each.limit_rpm for each in vessel.of_kind("tunnel")), default=0.0)
    steering = [each for each in vessel.actuators if each.angle]
    return Shafts(
        usual, half, slow, fast, round(_TUNNEL * aside / _ROUND_RPM) * _ROUND_RPM,
        drives_in(vessel.actuators), tuple(each.name for each in steering), names_of(vessel.actuators, "tunnel"),
        _common((each.noun for each in vessel.actuators if each.drives), "thruster"),
        _common((each.steers_by for each in steering), _MIXED), pace_of(vessel).time, most, own_usual_rpm(vessel),
    )  # fmt: skip


def _common(words: Iterable[str], otherwise: str) -> str:
    """The word that all of ``words`` are."""
    found = set(words)
    return found.pop() if len(found) == 1 else otherwise


def repertoire(shafts: Shafts) -> tuple[CandidateManoeuvre, ...]:
    """All candidates that a ship with these thrusters can make."""
    by_angle, alike = len(shafts.steering) > 0, shafts.steers != _MIXED
    needed: dict[Callable[[Shafts], CandidateManoeuvre], bool] = {
        _uneven: len(shafts.drives) == 2 and by_angle, _opposed: len(shafts.steering) == 2 and alike,
        _crash_stop: shafts.drive == "propeller", _one_drive: len(shafts.drives) > 1,
        _tunnel: len(shafts.tunnels) > 0,
    }  # fmt: skip
    return tuple(make(shafts) for make in _MAKERS if needed.get(make, True))


def _reciprocal(at: Shafts) -> CandidateManoeuvre:
    what = f"Run straight at {at.usual:g} rpm, {at.span(240.0)} on a heading and as long on the reciprocal"
    legs = both_ways(lambda course: (settle(course, at.usual), steer(course, 220.0, at.usual)))
    return at.candidate("reciprocal_headings", what, legs)


def _four_headings(at: Shafts) -> CandidateManoeuvre:
    what = f"Run straight at {at.usual:g} rpm on four headings 90 degrees apart, {at.span(120.0)} each"
    return at.candidate("four_headings", what, reciprocal(110.0, at.usual))


def _speed_runs(at: Shafts) -> CandidateManoeuvre:
    speeds = (at.half, at.slow, at.usual, at.fast)
    steps = ", ".join(f"{rpm:g}" for rpm in speeds)
    what = f"Run straight at {steps} rpm, {at.span(60.0)} each, on a heading and on the reciprocal"
    legs = both_ways(lambda course: (settle(course, speeds[0]), *(steer(course, 65.0, rpm) for rpm in speeds)))
    return at.candidate("speed_runs", what, legs)


def _turns(at: Shafts, helm_deg: float, turn_deg: float) -> CandidateManoeuvre:
    what = (
        f"Turn through {turn_deg:g} degrees at {at.usual:g} rpm with {at.helm(helm_deg, at.usual)}, "
        "to one side and then to the other"
    )
    return at.candidate(f"turns_{helm_deg:g}", what, turning_circle(helm_deg, at.usual, turn_deg))


def _zigzag(at: Shafts, helm_deg: float, switch_deg: float, slow: bool = False) -> CandidateManoeuvre:
    rpm = at.slow if slow else at.usual
    swings = zigzag(helm_deg, switch_deg, rpm, swings=10)
    by = "" if at.steering else f" with {at.helm(helm_deg, rpm)}"
    what = f"Zigzags {helm_deg:g}/{switch_deg:g} at {rpm:g} rpm{by}, about a heading and about the reciprocal"
    name = f"zigzags_{helm_deg:g}_{switch_deg:g}{'_slow' * slow}"
    return at.candidate(name, what, both_ways(lambda course: (settle(course, rpm), *swings)))


def _speed_changes(at: Shafts) -> CandidateManoeuvre:
    what = (
        f"Speed up to {at.fast:g} rpm and slow down to {at.half:g} rpm every {at.span(30.0)}, {at.span(300.0)} on "
        "a heading and as long on the reciprocal"
    )
    changes = (at.half, at.fast) * 4
    legs = both_ways(lambda course: (settle(course, at.fast), *(steer(course, 30.0, rpm) for rpm in changes)))
    return at.candidate("speed_changes", what, legs)


def _coasting(at: Shafts) -> CandidateManoeuvre:
    idle = Leg(rpm=0.0, at_most_s=180.0)
    what = (
        f"Speed up to {at.usual:g} rpm and coast without thrust for {at.span(180.0)}, on a heading and on the "
        "reciprocal"
    )
    legs = both_ways(lambda course: (settle(course, at.usual), steer(course, 60.0, at.usual), idle))
    return at.candidate("coasting", what, legs)


def _crash_stop(at: Shafts) -> CandidateManoeuvre:
    astern = Leg(rpm=-at.usual, slower_mps=0.0, at_most_s=120.0)
    what = (
        f"Speed up to {at.usual:g} rpm and stop at {at.usual:g} rpm astern until she stands, on a heading and on "
        "the reciprocal"
    )
    legs = both_ways(lambda course: (settle(course, at.usual), steer(course, 90.0, at.usual), astern))
    return at.candidate("crash_stops", what, legs)


def _one_drive(at: Shafts) -> CandidateManoeuvre:
    first, *others = (_named(name, at.drive) for name in at.drives)
    then = "".join(f", then on the {name} alone" for name in others)
    seconds, spans = 120.0, f"{at.span(120.0)} each"
    if at.steering:
        held = f"{at.span(60.0)} each held straight, at 15 degrees and at -15 degrees"
        seconds, spans = 300.0, f"{at.span(120.0)} on a course, then {held}"
    legs = one_by_one(at.drives, at.usual, seconds, by_angle=bool(at.steering))
    what = f"Run on the {first} alone at {at.usual:g} rpm{then}: {spans}"
    return at.candidate("one_thruster_at_a_time", what, [leg for each in legs for leg in each])


def _named(name: str, drive: str) -> str:
    """A drive's name, with its kind where the name does not contain it."""
    words = name.replace("_", " ")
    return words if drive in words else f"{words} {drive}"


def _opposed(at: Shafts) -> CandidateManoeuvre:
    one, other = (f"{name}_angle_deg" for name in at.steering)
    legs = [Leg(rpm=at.usual, orders={one: a, other: -a}, at_most_s=75.0) for a in (20.0, -20.0, 35.0, -35.0)]
    drives = {1: f"the {at.drive}", 2: f"both {at.drive}s"}.get(len(at.drives), f"all {at.drive}s")
    what = (
        f"Hold {drives} at {at.usual:g} rpm with {at.steers}s opposed, 20 and 35 degrees inwards and outwards, "
        f"{at.span(75.0)} each, twice"
    )
    return at.candidate(f"{at.steers}s_opposed", what, legs)


def _uneven(at: Shafts) -> CandidateManoeuvre:
    one, other = at.drives
    legs = [
        leg
        for orders in (
            {f"{one}_rpm": at.usual, f"{other}_rpm": at.slow},
            {f"{one}_rpm": at.slow, f"{other}_rpm": at.usual},
        )
        for leg in (
            Leg(orders=orders, course_deg=0.0, at_most_s=90.0),
            *(Leg(orders=orders, helm_deg=angle, at_most_s=45.0) for angle in (10.0, -10.0)),
        )
    ]
    names = [name.replace("_", " ") for name in (one, other)]
    what = (
        f"Run with {names[0]} at {at.usual:g} and {names[1]} at {at.slow:g} rpm, then the other way round: "
        f"{at.span(90.0)} on a course, {at.span(45.0)} each at 10 degrees and at -10 degrees"
    )
    return at.candidate("uneven_thrusters", what, legs)


def _tunnel(at: Shafts) -> CandidateManoeuvre:
    def push(main: float, name: str, aside: float) -> Leg:
        return Leg(rpm=main, orders={f"{name}_rpm": aside}, at_most_s=60.0)

    ahead = 0.3 * at.usual
    subject = "the tunnel thruster" if len(at.tunnels) == 1 else "each tunnel thruster"
    sides = (at.tunnel, 0.0, -at.tunnel, 0.0)
    legs = [push(main, name, side) for name in at.tunnels for main in (0.0, ahead) for side in sides]
    what = (
        f"Run {subject} at {at.tunnel:g} rpm to either side, {at.span(60.0)} each and {at.span(60.0)} of rest "
        f"between, stopped and at {ahead:.0f} rpm ahead"
    )
    return at.candidate("tunnel_thruster", what, legs)


def _drifting(at: Shafts) -> CandidateManoeuvre:
    legs = (Leg(rpm=0.0, at_most_s=60.0 * MINUTES),)
    return at.candidate("drifting", "Lie stopped without any thrust and drift", legs)


_MAKERS: tuple[Callable[[Shafts], CandidateManoeuvre], ...] = (
    _reciprocal, _four_headings, _speed_runs,
    *(partial(_turns, helm_deg=helm, turn_deg=turn) for helm, turn in ((15.0, 360.0), (30.0, 720.0))),
    *(partial(_zigzag, helm_deg=helm, switch_deg=switch, slow=slow)
      for helm, switch, slow in ((10.0, 10.0, False), (20.0, 20.0, False), (20.0, 20.0, True), (30.0, 5.0, False))),
    _speed_changes, _coasting, _crash_stop, _one_drive, _uneven, _opposed, _tunnel, _drifting,
)  # fmt: skip


_STEPS = 4  # simulator steps in a quarter of a second, so that the autopilot's loop is as fast as a real one
_SEED = 20260903


def rehearse(
    legs: Manoeuvre, vessel: Vessel, plant: Plant, sea: SeaState, seconds: int, heading_deg: float = 0.0
) -> Log:
    """Simulate ``seconds`` of a manoeuvre with ``plant`` and the autopilot and drives of ``vessel``.

    Gusts are those of the ``sea``, always the same; waves and current are not, as they belong to the noise and
    to the plant. Raises :class:`ModelRangeError` if the ship leaves the range of her model.
    """
    per_second = STEPS_PER_SECOND * _STEPS
    streams = [np.random.default_rng(each) for each in np.random.SeedSequence(_SEED).spawn(2)]
    dt_s = 1.0 / per_second
    voyage = sail_through(
        vessel, plant, sea, legs, (seconds + 1) * per_second, dt_s, heading_deg, streams[0], streams[1]
    )
    seen = measure(voyage.states, plant, dt_s)[:-1:per_second][: seconds + 1]
    return _log(seen, _mean(voyage.controls, _STEPS), voyage.wind[::per_second], seconds + 1, vessel.actuators)


def _log(seen: Floats, controls: Floats, wind: Floats, rows: int, actuators: Actuators) -> Log:
    block = np.arange(rows, dtype=np.int64) * max(1, round(rows / BLOCK_S)) // rows
    weight = np.zeros((rows, 6, STEPS_PER_SECOND + 1))
    weight[:, :, STEPS_PER_SECOND // 2] = 1.0
    return Log(
        seen, weight, seen.copy(), controls[: rows * STEPS_PER_SECOND].reshape(rows, STEPS_PER_SECOND, -1),
        wind[:rows].copy(), np.arange(rows, dtype=np.int64), block, block // round(LEG_S / BLOCK_S),
        np.zeros(rows, dtype=np.int64), actuators,
    )  # fmt: skip


def _mean(series: Floats, number: int) -> Floats:
    """Means of ``number`` rows at a time."""
    whole = len(series) // number * number
    return np.asarray(series[:whole].reshape(-1, number, series.shape[1]).mean(axis=1))


def as_one_leg(log: Log) -> Log:
    """The same log as a single leg."""
    return replace(log, leg=np.zeros(len(log), dtype=np.int64))


def append_rehearsals(first: Log, others: Sequence[Log]) -> Log:
    """Several logs as one: each continues at the place of the one before and, after a break, at its time.

    Channels not measured in ``first`` are not measured in the others either.
    """
    parts = [first]
    missing = ~np.isfinite(first.measured).any(axis=0)
    for other in others:
        last = parts[-1]
        shift = np.zeros(6)
        shift[:2] = last.nominal[-1, :2] - other.nominal[0, :2]
        seen = other.measured + shift
        seen[:, missing] = np.nan
        parts.append(
            replace(
                other, measured=seen, nominal=other.nominal + shift,
                time_s=other.time_s - other.time_s[0] + last.time_s[-1] + BLOCK_S,
                block=other.block + last.block[-1] + 1, leg=other.leg + last.leg[-1] + 1,
                recording=np.full_like(other.recording, last.recording[-1]),
            )
        )  # fmt: skip
    arrays = [name for name in Log.__slots__ if isinstance(getattr(first, name), np.ndarray)]
    together: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    # A simulated log has a single input hold, and no log before it.
    return replace(first, held={}, cut_from=None, **together)
