"""A run from its approach to its verdict: a step from one instant to the next, and the judgement at its end.

:func:`advance` is pure: a state and an instant give the next state and what is to be called. Its clock is that of
the stamps in the data. What is called has the moment by which it is due: the heading at which a helm is reversed
lies between two instants, and is met by the rate of turn. :func:`judge_run` is the judgement ashore,
:func:`seatrial.analysis.manoeuvres.find.find_manoeuvres`, of the run's part of the recording.

An approach is steady where, averaged over the time of a ship length, the heading stays within 2 deg and the speed
within 5 % for the whole of the steady time, and the helm within 5 deg: stricter than the criteria of `seatrial
manoeuvres` (MSC/Circ.1053), which judge the last ten seconds.
"""

from __future__ import annotations

from bisect import bisect_left
from cmath import phase
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import atan2, copysign, cos, degrees, hypot, inf, isfinite, nan, radians, sin, sqrt
from operator import attrgetter
from statistics import fmean
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core import result, ship
from seatrial.acquisition.core.quantities import Bools, Floats, water_depth_m
from seatrial.analysis.conduct.programme import STEERED, PlannedRun, TrialProgramme
from seatrial.analysis.manoeuvres import conducted, criteria, find, indices, motion
from seatrial.analysis.quality.wind import beaufort_number
from seatrial.analysis.tables.table import NANO, times_ns

Phase = Literal["approach", "sailing", "ended"]

STEADY_HEADING_DEG, STEADY_SPEED_SHARE, STEADY_HELM_DEG = 2.0, 0.05, 5.0
_LEAST_SPEED_SHARE = 0.92  # of the planned speed: 0.9 of that at 85 % of the output, and a margin
_ON_HEADING_DEG = 10.0
_ARMED_DEG, _ARMED_LENGTH_DEG, _ARMED_S = 6.0, 6.0, 60.0  # of an order before the approach was steady
_OVER_SHARE, _OVER_S = 0.6, 3.0  # of the helm, and for how long, that an order is recognised by
_LEAST_HELM_DEG = 2.5
_STOPPED_SHARE = 0.3  # of the thrust of the approach
_RUNNING_RPM, _ASIDE_MPS = 10.0, 0.15
_RELEASED_SHARE, _RELEASED_S = 0.3, 10.0
_HELM_SHARE, _SWITCH_SHARE = 0.1, 0.1  # as criteria of MSC.137(76) take a helm and a switching angle for their own
_SETTLED_S, _AVERAGED_S = 20.0, 10.0
_MOVED_SHARE, _MOVED_DEG, _MOVED_LENGTHS, _MOVED_S = 0.25, 3.0, 0.2, 2.0  # of the helm, in L / V and at least
_UNMEASURED_S = 3.0  # of the helm, in which a reversal has no moment of its own
_REACHED_SHARE, _FEWEST_SWINGS = 0.85, 3
_LEAST_HEADINGS = 0.9  # of a run, as of what is found ashore
_TIME = attrgetter("time_ns")
DECISIVE = ("the helm was moved",)
"""The first words of faults that make a run invalid, whatever is found of it."""
_SHALLOW = "the water was less than {:g} m deep: {:.1f} m"
LONGEST_GAP_S = 60.0  # of the heading: a recording is broken there
_WIND_S = 60.0
_FITTED_S = 5.0  # of the heading: a large ship turns by less than its noise in a second
_BASE_S = 10.0  # of the approach, that its heading is the mean of
_DECELERATED_S = 5.0
_PULL_TURN_DEG, _PULL_STEADY_SHARE, _PULL_LENGTHS = 120.0, 0.1, 25.0
_RUN_HEADING_DEG, _RUN_SPEED_SHARE = 3.0, 0.04  # as a speed run is found by
_LEAD_S = 60.0
_LEAST_APPROACH_SHARE, _FULL_CIRCLE_DEG = 0.9, 360.0


@dataclass(frozen=True, slots=True)
class Instant:
    """What a run is followed by, at one time.

    ``helm_deg`` turns the ship to starboard where it is positive, whatever steers it; ``thrust_rpm`` is the shaft
    speed of equal drives with the same thrust along the bow; those of orders are NaN where they are not recorded.
    ``shafts_rpm`` are those of single actuators. What was not measured is NaN.
    """

    time_ns: int
    heading_deg: float
    yaw_rate_dps: float
    surge_mps: float
    sway_mps: float
    helm_deg: float
    thrust_rpm: float
    helm_order_deg: float = nan
    thrust_order_rpm: float = nan
    wind_mps: float = nan
    wind_from_deg: float = nan
    depth_m: float = nan
    shafts_rpm: Mapping[str, float] = field(default_factory=dict)

    @property
    def speed_mps(self) -> float:
        """The speed over ground, without a sway that was not measured [m/s]."""
        return hypot(self.surge_mps, self.sway_mps if isfinite(self.sway_mps) else 0.0)

    @property
    def ordered_helm_deg(self) -> float:
        """The helm as ordered, where that is recorded, else as it is."""
        return self.helm_order_deg if isfinite(self.helm_order_deg) else self.helm_deg

    @property
    def ordered_thrust_rpm(self) -> float:
        """The thrust as ordered, where that is recorded, else as it is."""
        return self.thrust_order_rpm if isfinite(self.thrust_order_rpm) else self.thrust_rpm


class _Drive(NamedTuple):
    """The channels of an actuator that drives, empty where it has none."""

    shaft: str
    pitch: str
    angle: str


class _Steering(NamedTuple):
    """How a ship is steered: the channels of its rudders, or by the thrust of its drives, with the sign of their
    angles, or by the difference of its propellers, by their places among the drives."""

    drives: tuple[_Drive, ...]
    rudders: tuple[str, ...] = ()
    turns: float = 0.0
    sides: tuple[tuple[int, ...], ...] = ()
    controls: tuple[str, ...] = ()
    shafts: tuple[tuple[str, str], ...] = ()


@lru_cache(maxsize=16)
def _steering_of(actuators: ship.Actuators) -> _Steering:
    steering, driving = motion.steering_actuators(actuators), tuple(entry for entry in actuators if entry.drives)
    drives = []
    for actuator in driving:
        names = {channel.unit: channel.name for channel in actuator.channels}
        drives.append(_Drive(names["rpm"], names.get("%", ""), names.get("deg", "")))
    shafts = tuple((actuator.name, actuator.channels[0].name) for actuator in actuators)
    common = _Steering(tuple(drives), controls=ship.control_names(actuators), shafts=shafts)
    if steering and not steering[0].drives:
        return common._replace(rudders=tuple(actuator.angle.name for actuator in steering if actuator.angle))
    if steering:
        return common._replace(turns=ship.KINDS[steering[0].kind].turns)
    sides = motion.drives_by_side(driving)
    return common._replace(sides=tuple(tuple(driving.index(drive) for drive in side) for side in sides))


def instant_of(time_ns: int, values: Mapping[str, float], actuators: ship.Actuators) -> Instant:
    """An instant from the values of channels, by the ship's actuators."""
    steering = _steering_of(actuators)
    ordered = {name: values.get(ship.order_channel_name(name), nan) for name in steering.controls}
    helm, thrust = helm_and_thrust(values, actuators)
    helm_order = thrust_order = nan
    if any(map(isfinite, ordered.values())):
        orders = {name: value if isfinite(value) else values.get(name, nan) for name, value in ordered.items()}
        by_angle = any(isfinite(value) for name, value in ordered.items() if name.endswith("_angle_deg"))
        by_shaft = any(isfinite(value) for name, value in ordered.items() if not name.endswith("_angle_deg"))
        order = helm_and_thrust(orders, actuators)
        helm_order = order[0] if (by_shaft if steering.sides else by_angle) else nan
        thrust_order = order[1] if by_shaft else nan
    names = ("heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "wind_speed_mps", "wind_direction_deg")
    heading, rate, surge, sway, wind, wind_from = (values.get(name, nan) for name in names)
    shafts = {name: values.get(channel, nan) for name, channel in steering.shafts}
    return Instant(
        time_ns, heading, rate, surge, sway, helm, thrust, helm_order, thrust_order, wind, wind_from,
        float(water_depth_m(values)), shafts,
    )  # fmt: skip


def helm_and_thrust(values: Mapping[str, float], actuators: ship.Actuators) -> tuple[float, float]:
    """The helm, positive to starboard [deg], and the shaft speed of equal drives with the same thrust along the bow
    [rpm], as :mod:`seatrial.analysis.manoeuvres.motion` has them; thrusters that steer are taken to be astern. NaN
    is what nothing is measured of."""
    steering, pushes = _steering_of(actuators), list[complex]()
    for drive in steering.drives:
        rpm = values.get(drive.shaft, nan)
        pitch = values.get(drive.pitch, nan) / 100.0 if drive.pitch else 1.0
        angle = radians(values.get(drive.angle, nan)) if drive.angle else 0.0
        push = rpm * abs(rpm) * pitch * complex(cos(angle), sin(angle))
        pushes.append(push)
    unmeasured = all(push != push for push in pushes)
    pushes = [push if push == push else 0j for push in pushes]
    total = complex(nan, nan) if unmeasured else sum(pushes, 0j)
    along = total.real / max(len(pushes), 1)
    thrust = copysign(sqrt(abs(along)), along)
    if steering.rudders:
        return fmean(values.get(name, nan) for name in steering.rudders), thrust
    if steering.turns:
        return (steering.turns * degrees(phase(total)) if total else 0.0), thrust
    if steering.sides and not unmeasured:
        port, starboard = (sum(pushes[place].real for place in side) for side in steering.sides)
        return degrees(atan2(port - starboard, port + starboard)), thrust
    return (nan if steering.sides else 0.0), thrust


class Call(NamedTuple):
    """What is called to the bridge, and when it is due [ns]: ``ready``, ``reverse``, ``amidships``, ``end``, or a
    ``warning``; ``text`` is what is said."""

    kind: str
    text: str
    due_ns: int


@dataclass(frozen=True, slots=True)
class Steadiness:
    """How much of the steady time has passed since each was last not steady, 0 to 1."""

    speed: float = 0.0
    heading: float = 0.0
    yaw_rate: float = 0.0
    helm: float = 0.0

    @property
    def is_steady(self) -> bool:
        """Whether the run may begin."""
        return min(self.speed, self.heading, self.yaw_rate, self.helm) >= 1.0


@dataclass(frozen=True, slots=True)
class RunState:
    """A run at an instant.

    ``recent`` are the instants of the last minutes, one a second, their heading running on beyond 360 deg and,
    where it is not measured, by the rate of turn. ``base_deg`` is the heading of the approach, ``side`` 1 where the
    first helm went to starboard; ``orders_ns`` when each order was seen, ``calls_ns`` the moments by which it was
    due. ``ready_ns`` is when the approach was last steady. ``unmeasured_ns`` is since when the heading is not
    measured, ``released_ns`` since when the helm is amidships. What was before ``earliest_ns`` belongs to another
    run. No order counts before ``approach_seen``, which is not so at the first instant, and where nothing came for
    a minute: a manoeuvre may have begun before, as ``is_unled`` then says. Nor does one while the ship is
    ``swinging`` in a run that was given up or broken: not before an approach was steady.
    """

    phase: Phase = "approach"
    steadiness: Steadiness = Steadiness()
    recent: tuple[Instant, ...] = ()
    base_deg: float = nan
    side: float = 0.0
    orders_ns: tuple[int, ...] = ()
    calls_ns: tuple[int, ...] = ()
    ready_ns: int = 0
    warned_ready: bool = False
    ended_ns: int = 0
    due_s: float = nan
    unmeasured_ns: int = 0
    released_ns: int = 0
    earliest_ns: int = 0
    faults: tuple[str, ...] = ()
    approach_seen: bool = True
    is_unled: bool = False
    swinging: bool = False

    @property
    def executed_ns(self) -> int:
        """When the first order was seen [ns], 0 before."""
        return self.orders_ns[0] if self.orders_ns else 0

    @property
    def newest(self) -> Instant | None:
        """The newest instant."""
        return self.recent[-1] if self.recent else None

    def as_json(self) -> dict[str, Any]:
        """What a restart needs of it: of the recent instants the newest alone, others come from the recording."""
        newest = tuple(replace(entry, shafts_rpm={}) for entry in self.recent[-1:])
        return dict(result.to_json(replace(self, recent=newest)))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> RunState:
        """The inverse of :meth:`as_json`."""
        values: dict[str, Any] = {name: nan if value is None else value for name, value in content.items()}
        values["steadiness"] = Steadiness(**content["steadiness"])
        values |= {name: tuple(content[name]) for name in ("orders_ns", "calls_ns", "faults")}
        recent: list[dict[str, Any]] = [
            {name: nan if value is None else value for name, value in entry.items()} for entry in content["recent"]
        ]
        values["recent"] = tuple(Instant(**entry) for entry in recent)
        return cls(**values)


def helm_words(helm_deg: float) -> str:
    """A helm order, as it is given.

    >>> helm_words(20.0), helm_words(-35.0), helm_words(0.0)
    ('starboard 20', 'port 35', 'midships')
    """
    if not helm_deg:
        return "midships"
    return f"{'starboard' if helm_deg > 0.0 else 'port'} {abs(helm_deg):g}"


def execute_words(run: PlannedRun) -> str:
    """The order that a run begins with."""
    if run.kind in STEERED:
        return helm_words(run.sign * (run.helm_deg or 0.0))
    stop = "full astern" if run.astern else "stop engine"
    return {"stopping": stop, "speed_run": "hold course and power", "crabbing": f"crab to {run.side}",
            "thruster_test": f"{run.thruster} alone"}[run.kind]  # fmt: skip


def next_words(state: RunState, run: PlannedRun) -> str:
    """The order that comes next while a run is sailed."""
    calls = len(state.calls_ns)
    if run.kind == "zigzag" and calls < run.swings - 1:
        return helm_words(-state.side * (-1.0) ** calls * (run.helm_deg or 0.0))
    if run.kind in STEERED:
        return helm_words(0.0) if run.kind != "pull_out" or not calls else "carry on"
    return "stop engine" if run.kind == "stopping" and run.astern else "carry on"


def advance(
    state: RunState, instant: Instant, run: PlannedRun, programme: TrialProgramme
) -> tuple[RunState, tuple[Call, ...]]:
    """The state at the next instant, and what is called. An instant that is not later changes nothing."""
    last = state.newest
    if state.phase == "ended" or (last is not None and instant.time_ns <= last.time_ns):
        return state, ()
    if state.phase == "sailing" and last is not None and instant.time_ns - last.time_ns > LONGEST_GAP_S * NANO:
        reason = f"nothing was received: for {(instant.time_ns - last.time_ns) / NANO:.0f} s"
        return break_off(state, reason), (Call("end", "the run is broken", instant.time_ns),)
    if last is None or instant.time_ns - last.time_ns > LONGEST_GAP_S * NANO:
        state = state_since(state, instant.time_ns)
    state = _with_instant(state, instant, programme)
    if state.phase == "approach":
        return _approach(state, run, programme)
    state = _watch_helm(_watch_execution(state, run, programme), run, programme)
    return _SAILING[run.kind](state, run, programme)


def state_since(state: RunState, at_ns: int) -> RunState:
    """The state of an approach that is followed from a time on: what was before it is not known."""
    return RunState(recent=state.recent, earliest_ns=at_ns, approach_seen=False, swinging=state.swinging)


def state_for_next_run(state: RunState) -> RunState:
    """The state of the approach to the next run, of that of a run that is over or was given up."""
    return RunState(
        recent=state.recent, earliest_ns=state.ended_ns or state.earliest_ns, approach_seen=state.approach_seen,
        is_unled=state.is_unled, swinging=state.swinging,
    )  # fmt: skip


def unmeasured_of_run(instant: Instant, run: PlannedRun) -> list[str]:
    """What a run is followed by and an instant does not have."""
    needed = {"the heading": instant.heading_deg, "the speed": instant.surge_mps}
    if run.kind not in ("thruster_test", "crabbing"):
        needed["the helm"] = instant.ordered_helm_deg
    if run.kind == "stopping":
        needed["the shaft speed"] = instant.ordered_thrust_rpm
    if run.kind == "thruster_test":
        needed[f"the thruster {run.thruster}"] = instant.shafts_rpm.get(run.thruster, nan)
    return [name for name, value in needed.items() if not isfinite(value)]


def _with_instant(state: RunState, instant: Instant, programme: TrialProgramme) -> RunState:
    """The state with an instant, its heading made continuous, among the recent ones."""
    last, unmeasured_ns = state.newest, 0
    if last is not None:
        elapsed_s = (instant.time_ns - last.time_ns) / NANO
        turned = np.nan_to_num(instant.yaw_rate_dps) * elapsed_s
        expected = last.heading_deg + turned
        if isfinite(instant.heading_deg) and isfinite(expected):
            measured = float(expected + ship.angle_difference(instant.heading_deg, expected))
            instant = replace(instant, heading_deg=measured)
        elif isfinite(expected):
            instant, unmeasured_ns = replace(instant, heading_deg=expected), state.unmeasured_ns or instant.time_ns
    kept_s = max(2.0 * programme.steady_s, 3.0 * programme.length_s, _WIND_S) + _BASE_S
    recent = (*_instants_since(state, instant.time_ns - round(kept_s * NANO)), instant)
    return replace(state, recent=recent, unmeasured_ns=unmeasured_ns)


def _instants_since(state: RunState, time_ns: int) -> tuple[Instant, ...]:
    """The recent instants from a time on; they are in order of time."""
    return state.recent[bisect_left(state.recent, time_ns, key=_TIME) :]


def _recent_instants(state: RunState, seconds: float) -> tuple[Instant, ...]:
    """The instants of the last seconds."""
    return _instants_since(state, state.recent[-1].time_ns - round(seconds * NANO))


def _of_this_run(state: RunState) -> tuple[Instant, ...]:
    """The recent instants since the run before was over, or was aborted."""
    return _instants_since(state, state.earliest_ns)


def _column(instants: Iterable[Instant], name: str) -> Floats:
    return np.fromiter(map(attrgetter(name), instants), dtype=float)


def steadiness_of(recent: Sequence[Instant], run: PlannedRun, programme: TrialProgramme) -> Steadiness:
    """How steady an approach is, by its recent instants.

    Tests of thrusters and of crabbing ask for the rate of turn alone.
    """
    if len(recent) < 2:
        return Steadiness()
    time_s = (_column(recent, "time_ns") - recent[-1].time_ns) / NANO
    length_s = programme.programme.length_m / programme.speed_mps(run)
    width = max(1, int(np.searchsorted(-time_s[::-1], max(length_s, 5.0))))
    kernel = np.ones(min(width, len(recent))) / min(width, len(recent))

    def averaged(values: Floats) -> Floats:
        padded = np.concatenate([np.full(kernel.size - 1, values[0]), values])
        return np.convolve(padded, kernel, "valid")

    heading, speed = averaged(_column(recent, "heading_deg")), averaged(_column(recent, "speed_mps"))
    rate_dps = np.gradient(heading, time_s) if np.all(np.diff(time_s) > 0.0) else np.zeros(heading.size)
    planned, wanted_mps = run.heading_deg, programme.speed_mps(run)
    on_heading = planned is None or abs(float(ship.angle_difference(heading[-1], planned))) <= _ON_HEADING_DEG

    def fraction(steady: Bools) -> float:
        """How long it has been steady, of the steady time."""
        unsteady = np.flatnonzero(~steady)
        if unsteady.size and unsteady[-1] == steady.size - 1:
            return 0.0
        since_s = -time_s[unsteady[-1] + 1 if unsteady.size else 0]
        return float(min(1.0, since_s / programme.steady_s))

    def stays_within(values: Floats, band: float) -> Bools:
        """The rows from which on the values stay within a band."""
        high, low = (limit.accumulate(values[::-1])[::-1] for limit in (np.maximum, np.minimum))
        return np.asarray(high - low <= band)

    slow = fraction((np.abs(rate_dps) * length_s <= STEADY_HEADING_DEG) & on_heading)
    if run.kind in ("thruster_test", "crabbing"):
        return Steadiness(1.0, 1.0, slow, 1.0)
    fast = speed >= _LEAST_SPEED_SHARE * wanted_mps
    return Steadiness(
        fraction(stays_within(speed, STEADY_SPEED_SHARE * wanted_mps) & fast),
        fraction(stays_within(heading, STEADY_HEADING_DEG) & on_heading),
        slow,
        fraction(stays_within(averaged(_column(recent, "helm_deg")), STEADY_HELM_DEG)),
    )


def _approach(state: RunState, run: PlannedRun, programme: TrialProgramme) -> tuple[RunState, tuple[Call, ...]]:
    """Wait for a steady approach, and for the order."""
    state = state if state.approach_seen else _look_for_approach(state, run, programme)
    executed_ns, side = _order_seen(state, run, programme)
    if executed_ns:
        return _begun_state(state, run, programme, executed_ns, side), ()
    steadiness, now_ns = steadiness_of(_of_this_run(state), run, programme), state.recent[-1].time_ns
    state = replace(state, steadiness=steadiness)
    if not steadiness.is_steady:
        lost = state.warned_ready and now_ns - state.ready_ns > 10 * NANO
        return replace(state, warned_ready=state.warned_ready and not lost), ()
    call = () if state.warned_ready else (Call("ready", execute_words(run), now_ns),)
    state = replace(state, ready_ns=now_ns, warned_ready=True, swinging=False)
    if run.kind == "speed_run":  # it needs no order
        return _begun_state(state, run, programme, now_ns - round(programme.steady_s * NANO), 0.0), call
    return state, call


def _look_for_approach(state: RunState, run: PlannedRun, programme: TrialProgramme) -> RunState:
    """The state with whether the ship has gone straight for ten seconds without what a run is ordered by, or is in
    a manoeuvre that was begun before."""
    last = [entry for entry in _recent_instants(state, _BASE_S) if entry.time_ns >= state.earliest_ns]
    seconds = (last[-1].time_ns - last[0].time_ns) / NANO
    if seconds < 0.5 * _BASE_S:
        return state
    turned_deg = float(np.ptp(_column(last, "heading_deg")))
    straight = turned_deg * programme.programme.length_m <= _ARMED_LENGTH_DEG * seconds * programme.speed_mps(run)
    ordered = [_shows_order(entry, run) for entry in last]
    seen = straight and not any(ordered) and seconds >= 0.75 * _BASE_S
    is_unled = not seen and isfinite(turned_deg) and (state.is_unled or all(ordered))
    return replace(state, approach_seen=seen, is_unled=is_unled)


def _shows_order(instant: Instant, run: PlannedRun) -> bool:
    """Whether a ship that is steered, or a thruster, or a way sideways, is as after the order of a run."""
    if run.kind == "thruster_test":
        return abs(instant.shafts_rpm.get(run.thruster, 0.0)) > _RUNNING_RPM
    if run.kind == "crabbing":
        return abs(instant.sway_mps) > max(abs(instant.surge_mps), _ASIDE_MPS)
    return run.kind in STEERED and abs(instant.ordered_helm_deg) >= _least_helm_deg(run)


def _least_helm_deg(run: PlannedRun) -> float:
    """The helm from which on an order is recognised."""
    return max(_OVER_SHARE * (run.helm_deg or 0.0), _LEAST_HELM_DEG)


def _order_seen(state: RunState, run: PlannedRun, programme: TrialProgramme) -> tuple[int, float]:
    """When the order of a run was given, as its helm or shaft shows it, and the side; 0 where it was not."""
    newest = state.recent[-1]
    if run.kind == "speed_run" or not state.approach_seen or not _is_armed(state, run, programme):
        return 0, 0.0
    if run.kind == "stopping":
        return _stop_seen(state), 0.0
    if run.kind == "thruster_test":
        return newest.time_ns * _shows_order(newest, run), 0.0
    if run.kind == "crabbing":
        return newest.time_ns * _shows_order(newest, run), copysign(1.0, newest.sway_mps)
    over = _recent_instants(state, _OVER_S)
    least = _least_helm_deg(run)
    helms = _column(over, "ordered_helm_deg")
    covered = over[-1].time_ns - over[0].time_ns >= 0.6 * _OVER_S * NANO
    if not covered or not (np.all(helms >= least) or np.all(helms <= -least)):
        return 0, 0.0
    side = float(np.sign(helms[-1]))
    if np.all(side * _column(_of_this_run(state), "ordered_helm_deg") >= least):  # over since the run before
        return 0, 0.0
    return _departure_ns(state, side), side


def _is_armed(state: RunState, run: PlannedRun, programme: TrialProgramme) -> bool:
    """Whether an order may be that of the run: the approach was steady a moment ago, or nearly."""
    if state.swinging:
        return False
    newest = state.recent[-1]
    if state.ready_ns and newest.time_ns - state.ready_ns <= _ARMED_S * NANO:
        return True
    before = [
        entry
        for entry in _recent_instants(state, 2.0 * _BASE_S)
        if entry.time_ns <= newest.time_ns - round(_OVER_S * NANO)
    ]
    if len(before) < 3:
        return False
    headings = _column(before, "heading_deg")
    planned = headings[-1] if run.heading_deg is None else run.heading_deg
    off_deg = abs(float(ship.angle_difference(headings[-1], planned)))
    rate_dps = abs(headings[-1] - headings[0]) / max((before[-1].time_ns - before[0].time_ns) / NANO, 1.0)
    fast = before[-1].speed_mps >= 0.8 * programme.speed_mps(run)
    length_s = programme.programme.length_m / programme.speed_mps(run)
    return bool(off_deg <= _ARMED_DEG and rate_dps * length_s <= _ARMED_LENGTH_DEG and fast)


def _departure_ns(state: RunState, side: float) -> int:
    """When the helm left its level towards a side: between the last instant at that level and the next.

    The level is that of the seconds before: in a turn, or while a helmsman steers, the approach has no level.
    """
    recent = [entry for entry in state.recent if isfinite(entry.ordered_helm_deg)]
    values, times = side * _column(recent, "ordered_helm_deg"), [entry.time_ns for entry in recent]
    threshold, row, before = 0.5 * values[-1], len(values) - 1, -1
    while row != before:  # back along the travel of the gear to where it began
        before = row
        below = np.flatnonzero(values[: row + 1] <= threshold)
        row = int(below[-1]) if below.size else 0
        first = int(np.searchsorted(times, times[row] - round(_FITTED_S * NANO)))
        level = float(np.median(values[first : row + 1]))
        threshold = level + max(0.1 * (values[-1] - level), 1.0)
    if row + 1 >= len(times):
        return times[-1]
    if any(isfinite(entry.helm_order_deg) for entry in recent):
        return (times[row] + times[row + 1]) // 2  # an order is a step between two instants
    slope = values[row + 1] - values[row]
    share = (threshold - values[row]) / slope if slope > 0.0 else 0.0
    return int(times[row] + share * (times[row + 1] - times[row]))


def _stop_seen(state: RunState) -> int:
    """When the thrust was taken off; 0 where it was not."""
    mine = _of_this_run(state)
    thrusts, times = np.array([entry.ordered_thrust_rpm for entry in mine]), [entry.time_ns for entry in mine]
    before = thrusts[:-3]
    if np.isfinite(before).sum() < 3 or not np.nanmedian(before) > 0.0:
        return 0
    level = float(np.nanmedian(before))
    if not np.all(thrusts[-2:] < _STOPPED_SHARE * level):
        return 0
    running = np.flatnonzero(thrusts >= 0.97 * level)
    row = int(running[-1])
    return (times[row] + times[min(row + 1, len(times) - 1)]) // 2


def _begun_state(state: RunState, run: PlannedRun, programme: TrialProgramme, at_ns: int, side: float) -> RunState:
    """The state after the first order, with what was wrong with it."""
    before = [entry for entry in state.recent if entry.time_ns <= at_ns] or list(state.recent[:1])
    last = [entry for entry in before if entry.time_ns >= at_ns - round(_BASE_S * NANO)] or before[-1:]
    steady = state.ready_ns and at_ns - state.ready_ns <= _BASE_S * NANO
    faults = list(state.faults)
    if not steady:
        faults.append("the order was given before the approach was steady")
    if side and side != run.sign and run.side:
        faults.append(f"the order was to {'starboard' if side > 0.0 else 'port'}, not to {run.side}")
    return replace(
        state, phase="sailing", orders_ns=(at_ns,), calls_ns=(), side=side, faults=tuple(faults),
        base_deg=float(np.mean(_column(last, "heading_deg"))),
    )  # fmt: skip


def _with_fault(state: RunState, text: str) -> RunState:
    """The state with a fault, named once by its first words."""
    head = text.partition(":")[0]
    return state if any(fault.startswith(head) for fault in state.faults) else replace(
        state, faults=(*state.faults, text))  # fmt: skip


def _watch_execution(state: RunState, run: PlannedRun, programme: TrialProgramme) -> RunState:
    """The state with what is wrong in how it is sailed: wind, depth, a heading that is missing, another helm."""
    newest, least_m = state.recent[-1], programme.programme.least_depth_m
    depths = _column(_recent_instants(state, _AVERAGED_S), "depth_m")
    if least_m and np.isfinite(depths).sum() > 2 and (depth_m := float(np.nanmedian(depths))) < least_m:
        state = _with_fault(state, _SHALLOW.format(least_m, depth_m))
    winds = _column(_recent_instants(state, _WIND_S), "wind_mps")
    if np.isfinite(winds).sum() > 10 and (force := beaufort_number(float(np.nanmean(winds)))) > run.most_beaufort:
        state = _with_fault(
            state, f"the wind was above force {run.most_beaufort}: force {force} in a minute's mean"
        )
    if state.unmeasured_ns and newest.time_ns - state.unmeasured_ns > LONGEST_GAP_S * NANO:
        state = _with_fault(state, f"the heading was missing: for more than {LONGEST_GAP_S:.0f} s")
    last_ns = max((*state.orders_ns, *state.calls_ns))
    if run.kind in STEERED and newest.time_ns - last_ns > _SETTLED_S * NANO and not state.released_ns:
        helms, wanted = _column(_recent_instants(state, _AVERAGED_S), "helm_deg"), run.helm_deg or 0.0
        helm = abs(float(np.mean(helms)))
        share = 0.5 * _HELM_SHARE if run.kind == "turning_circle" else _HELM_SHARE
        amidships = run.kind == "pull_out" and len(state.calls_ns) > 0
        on_its_way = np.ptp(helms) > share * wanted  # a slow gear takes half a minute from side to side
        is_other = helm > _RELEASED_SHARE * wanted and abs(helm / wanted - 1.0) > share
        if is_other and not amidships and not on_its_way:
            state = _with_fault(state, f"the helm was not {wanted:g} deg: {helm:.1f} deg")
    return state


def _watch_helm(state: RunState, run: PlannedRun, programme: TrialProgramme) -> RunState:
    """The state with a fault where the helm left its angle while no order was due, for longer than a hand slips.

    A helm that has not reached its angle is another matter, as is one that is moved near the heading of the next
    order, or when all that the run has to show has been sailed.
    """
    swing = len(state.orders_ns) - 1
    if run.kind not in ("zigzag", "turning_circle") or len(state.calls_ns) != swing or swing >= _FEWEST_SWINGS:
        return state
    towards, wanted = state.side * (-1.0) ** swing, run.helm_deg or 0.0
    least_deg = min(run.turn_deg, _FULL_CIRCLE_DEG) - 10.0
    due_deg = (1.0 - _SWITCH_SHARE) * (run.switch_deg or 0.0) if run.kind == "zigzag" else least_deg
    since = [entry for entry in state.recent if entry.time_ns >= state.orders_ns[-1]]
    last = _recent_instants(state, max(_MOVED_LENGTHS * programme.length_s, _MOVED_S))
    if towards * (state.recent[-1].heading_deg - state.base_deg) >= due_deg or not 2 <= len(last) < len(since):
        return state
    helms, lately = (towards * _column(entries, "ordered_helm_deg") for entries in (since, last))
    away = np.abs(lately - wanted) > max(_MOVED_SHARE * wanted, _MOVED_DEG)
    if not away.all() or not np.any(helms >= _REACHED_SHARE * wanted):
        return state
    words = helm_words(float(round(towards * lately[-1])))
    return _with_fault(state, f"the helm was moved when no order was due: to {words}")


def _rates_dps(instants: Sequence[Instant]) -> Floats:
    """The rates of turn, by the headings where one is not measured."""
    rates = _column(instants, "yaw_rate_dps")
    if np.isfinite(rates).all():
        return rates
    time_s = (_column(instants, "time_ns") - instants[-1].time_ns) / NANO
    return np.gradient(_column(instants, "heading_deg"), time_s) if len(instants) > 1 else np.zeros(1)


def _seconds_to_crossing(state: RunState, towards: float, level_deg: float) -> float:
    """In how many seconds the heading, counted to a side from the base, passes a level by its rate of turn;
    negative where it has, infinite where it turns away."""
    fit = _recent_instants(state, _FITTED_S)
    rates, headings = _rates_dps(fit), _column(fit, "heading_deg")
    time_s = (_column(fit, "time_ns") - fit[-1].time_ns) / NANO
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(time_s))])
    heading = float(np.mean(headings + turned[-1] - turned))  # each instant's, carried on to the last by the rates
    turned_deg, rate = towards * (heading - state.base_deg), towards * float(np.mean(rates[-3:]))
    return (level_deg - turned_deg) / rate if rate > 1e-3 else (0.0 if turned_deg >= level_deg else inf)


def _due_call(
    state: RunState, kind: str, text: str, towards: float, level_deg: float
) -> tuple[RunState, Call | None]:
    """The state with the time to a call, and the call where it is due before the next instant."""
    wait_s = _seconds_to_crossing(state, towards, level_deg)
    state = replace(state, due_s=wait_s)
    times = _column(state.recent[-8:], "time_ns")
    usual_step_s = float(np.median(np.diff(times))) / NANO if times.size > 1 else 1.0
    if wait_s > usual_step_s:
        return state, None
    return state, Call(kind, text, state.recent[-1].time_ns + round(max(wait_s, -1.0) * NANO))


def _sail_zigzag(state: RunState, run: PlannedRun, programme: TrialProgramme) -> tuple[RunState, tuple[Call, ...]]:
    """Call the reversals; the last swing ends on the heading of the approach."""
    state = _see_reversal(state, run)
    swing = len(state.calls_ns)
    towards = state.side * (-1.0) ** swing
    if swing >= run.swings - 1:
        state, call = _due_call(state, "end", helm_words(0.0), towards, 0.0)
        # the ship answers first: it has to come back from the other side
        if call is None or state.recent[-1].time_ns - state.calls_ns[-1] < 5 * NANO:
            return _end_if_released(state, run)
        return _ended_state(state, call.due_ns), (call,)
    words = helm_words(-towards * (run.helm_deg or 0.0))
    state, call = _due_call(state, "reverse", words, towards, run.switch_deg or 0.0)
    if call is None:
        return _end_if_released(state, run)
    return replace(state, calls_ns=(*state.calls_ns, call.due_ns)), (call,)


def _see_reversal(state: RunState, run: PlannedRun) -> RunState:
    """The state with the order of a reversal, once the helm goes to the other side; a fault where it was far from
    the heading that it was due at."""
    swing = len(state.orders_ns)
    wanted = state.side * (-1.0) ** swing
    newest = state.recent[-1]
    if swing >= run.swings or not wanted * newest.ordered_helm_deg >= 0.2 * (run.helm_deg or 0.0):
        return state  # also where the helm is not measured
    recent = [entry for entry in state.recent if isfinite(entry.ordered_helm_deg)]
    values, times = wanted * _column(recent, "ordered_helm_deg"), [entry.time_ns for entry in recent]
    over = -0.6 * (run.helm_deg or 0.0)
    rows = np.flatnonzero(values <= over)
    row = int(rows[-1]) if rows.size else len(times) - 1
    at_ns = (times[row] + times[min(row + 1, len(times) - 1)]) // 2
    if not isfinite(newest.helm_order_deg) and row + 1 < len(times):  # back to where the helm left its stop
        before = np.flatnonzero(values[: row + 1] <= -0.95 * (run.helm_deg or 0.0))
        at_ns = times[int(before[-1])] if before.size else at_ns
    if row + 1 < len(times) and times[row + 1] - times[row] > _UNMEASURED_S * NANO:  # as it was due, if it can be
        due_ns = state.calls_ns[swing - 1] if len(state.calls_ns) >= swing else times[row + 1]
        at_ns = min(max(due_ns, times[row]), times[row + 1])
    instants_ns = [entry.time_ns for entry in state.recent]
    heading = float(np.interp(at_ns, instants_ns, _column(state.recent, "heading_deg")))
    turned_deg, switch = -wanted * (heading - state.base_deg), run.switch_deg or 0.0
    state = replace(state, orders_ns=(*state.orders_ns, at_ns))
    if len(state.calls_ns) < swing or at_ns < state.calls_ns[swing - 1] - NANO:
        if abs(turned_deg / switch - 1.0) > _SWITCH_SHARE:
            state = _with_fault(state, f"the helm was reversed early: at {turned_deg:.1f} deg of {switch:g} deg")
        if len(state.calls_ns) < swing:
            state = replace(state, calls_ns=(*state.calls_ns, at_ns))
    elif turned_deg > (1.0 + 2.0 * _SWITCH_SHARE) * switch:
        state = _with_fault(state, f"the helm was reversed late: at {turned_deg:.1f} deg of {switch:g} deg")
    return state


def _sail_circle(state: RunState, run: PlannedRun, programme: TrialProgramme) -> tuple[RunState, tuple[Call, ...]]:
    """End a circle where it is sailed."""
    state, call = _due_call(state, "end", helm_words(0.0), state.side, run.turn_deg)
    return _end_if_released(state, run) if call is None else (_ended_state(state, call.due_ns), (call,))


def _sail_pull_out(
    state: RunState, run: PlannedRun, programme: TrialProgramme
) -> tuple[RunState, tuple[Call, ...]]:
    """Call the helm amidships where the rate of turn is steady, and end when it has settled again."""
    newest, length_s = state.recent[-1], programme.length_s
    if state.calls_ns:
        over_s = (newest.time_ns - state.calls_ns[0]) / NANO
        if over_s < _PULL_LENGTHS * length_s:
            return replace(state, due_s=_PULL_LENGTHS * length_s - over_s), ()
        return _ended_state(state, newest.time_ns), (Call("end", "carry on", newest.time_ns),)
    rates = np.abs(_rates_dps(_recent_instants(state, 2.0 * length_s)))
    turned = state.side * (newest.heading_deg - state.base_deg)
    half = rates.size // 2
    if (
        turned < _PULL_TURN_DEG
        or half < 2
        or not abs(rates[half:].mean() / rates[:half].mean() - 1.0) <= _PULL_STEADY_SHARE
    ):
        return _end_if_released(state, run)
    call = Call("amidships", helm_words(0.0), newest.time_ns)
    return replace(state, calls_ns=(call.due_ns,)), (call,)


def _sail_stop(state: RunState, run: PlannedRun, programme: TrialProgramme) -> tuple[RunState, tuple[Call, ...]]:
    """End a stop where the ship has stopped."""
    surge = _column(_recent_instants(state, _DECELERATED_S), "surge_mps")
    surge = surge[np.isfinite(surge)]
    if surge.size < 2 or surge.mean() > (0.0 if run.astern else 0.08 * programme.speed_mps(run)):
        return state, ()
    call = Call("end", "stop engine" if run.astern else "carry on", state.recent[-1].time_ns)
    return _ended_state(state, call.due_ns), (call,)


def _sail_for_time(
    state: RunState, run: PlannedRun, programme: TrialProgramme
) -> tuple[RunState, tuple[Call, ...]]:
    """End a run that is held for a time; a speed run has to keep heading and speed."""
    newest = state.recent[-1]
    left_s = run.duration_s - (newest.time_ns - state.executed_ns) / NANO
    if run.kind == "speed_run":
        now = _recent_instants(state, _AVERAGED_S)
        if abs(float(np.mean(_column(now, "heading_deg"))) - state.base_deg) > _RUN_HEADING_DEG:
            state = _with_fault(state, f"the heading was not held within {_RUN_HEADING_DEG:g} deg")
    state = replace(state, due_s=left_s)
    if left_s > 0.0:
        return state, ()
    return _ended_state(state, newest.time_ns), (Call("end", "carry on", newest.time_ns),)


_SAILING = {
    "zigzag": _sail_zigzag, "turning_circle": _sail_circle, "pull_out": _sail_pull_out, "stopping": _sail_stop,
    "speed_run": _sail_for_time, "crabbing": _sail_for_time, "thruster_test": _sail_for_time,
}  # fmt: skip


def _end_if_released(state: RunState, run: PlannedRun) -> tuple[RunState, tuple[Call, ...]]:
    """End a run whose helm was put amidships before it was over."""
    newest = state.recent[-1]
    is_free = abs(newest.helm_deg) < _RELEASED_SHARE * (run.helm_deg or 0.0)
    released_ns = (state.released_ns or newest.time_ns) if is_free else 0
    state = replace(state, released_ns=released_ns)
    if (
        not released_ns
        or newest.time_ns - released_ns < _RELEASED_S * NANO
        or newest.time_ns - state.executed_ns < 2 * _RELEASED_S * NANO
    ):
        return state, ()
    state = _with_fault(state, "the helm was released before the run was over")
    return _ended_state(state, released_ns), (Call("end", "the helm was released", newest.time_ns),)


def _ended_state(state: RunState, at_ns: int) -> RunState:
    return replace(state, phase="ended", ended_ns=at_ns, due_s=nan)


def break_off(state: RunState, reason: str) -> RunState:
    """The state of a run that is being sailed and of which nothing more comes; that of another as it is."""
    if state.phase != "sailing" or state.newest is None:
        return state
    return replace(_ended_state(_with_fault(state, reason), state.newest.time_ns), swinging=True)


def abort(state: RunState, reason: str = "aborted") -> RunState:
    """The state of a run that was given up."""
    at_ns = state.newest.time_ns if state.newest else 0
    swinging = state.swinging or state.executed_ns > 0
    return replace(_ended_state(state, at_ns), faults=(*state.faults, reason), swinging=swinging)


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """What a run is worth: valid or not with the reasons, what a repeat does not change (``remarks``), and the
    manoeuvre that was found with its indices, None where there is none."""

    valid: bool
    reasons: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    manoeuvre: indices.Manoeuvre | None = None

    def as_json(self) -> dict[str, Any]:
        """As plain values."""
        run = self.manoeuvre
        return {"valid": self.valid, "reasons": list(self.reasons), "remarks": list(self.remarks),
                "manoeuvre": run.as_json() if run else None}  # fmt: skip

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> RunVerdict:
        """The inverse of :meth:`as_json`."""
        run = content["manoeuvre"]
        return cls(content["valid"], tuple(content["reasons"]), tuple(content["remarks"]),
                   indices.Manoeuvre.from_json(run) if run else None)  # fmt: skip


def judge_run(
    table: pd.DataFrame,
    state: RunState,
    run: PlannedRun,
    programme: TrialProgramme,
    stated: Conditions | None = None,
) -> RunVerdict:
    """The verdict on an ended run from a table of samples that contains it.

    The judgement is that of `seatrial manoeuvres` on the run with its approach. A run is valid where that finds it
    as it was planned, with nothing that a repeat would cure; what no repeat changes, as the loading, is a remark.
    """
    if not state.executed_ns:
        return RunVerdict(False, state.faults or ("no order was seen",))
    part = judged_span(state, run, programme).rows_of(table)
    if len(part) < 2:
        return RunVerdict(False, (*state.faults, "nothing was recorded of it"))
    length_m = programme.programme.length_m
    start, end = (pd.Timestamp(time_ns, unit="ns", tz="UTC") for time_ns in (state.executed_ns, state.ended_ns))
    during = conducted.JudgedSpan(run.kind, start, end).rows_of(part)
    conditions = find.conditions_of_table(during if len(during) else part, length_m, stated)
    manoeuvres, left_out = find.find_manoeuvres_and_left_out(part, length_m, conditions=stated)
    alike = [manoeuvre for manoeuvre in manoeuvres if manoeuvre.kind == run.kind]
    nearest = min(alike, key=lambda manoeuvre: abs(manoeuvre.start - start), default=None)
    if nearest is None or (
        run.kind not in ("speed_run", "pull_out")
        and abs((nearest.start - start).total_seconds()) > conducted.SAME_START_S
    ):
        why = [
            candidate.why for candidate in left_out if candidate.kind in (run.kind, "course_change", "manoeuvre")
        ]
        return RunVerdict(False, (*state.faults, *why[:1], f"no {run.name} is in the recording"))
    reasons, remarks = shortfalls_of_run(nearest, run, programme, conditions)
    steps_s = np.diff([state.executed_ns, *times_ns(during[["heading_deg"]].dropna()), state.ended_ns]) / NANO
    gaps_s = steps_s[steps_s > max(3.0 * float(np.median(steps_s)), 2.0)]  # longer than three usual steps, and 2 s
    missing = float(gaps_s.sum() / max(steps_s.sum(), 1.0))
    if missing > 1.0 - _LEAST_HEADINGS:
        reasons.append(f"the heading was missing in {missing:.0%} of it")
    reasons = [*(fault for fault in state.faults if fault.startswith(DECISIVE)), *reasons]
    if programme.programme.least_depth_m and "water_depth_m" not in nearest.settings:
        remarks.append("the depth of the water is not recorded")
    return RunVerdict(not reasons, tuple(reasons), tuple(remarks), nearest)


def judged_span(state: RunState, run: PlannedRun, programme: TrialProgramme) -> conducted.JudgedSpan:
    """The part of the recording that a run is judged by: it, its approach, and what the smoothing reaches."""
    lead_s = max(programme.steady_s, _LEAD_S)
    start_ns = max(state.executed_ns - round(lead_s * NANO), state.earliest_ns)
    end_ns = state.ended_ns + round(conducted.MARGIN_S * NANO)
    return conducted.JudgedSpan(
        run.kind, *(pd.Timestamp(time_ns, unit="ns", tz="UTC") for time_ns in (start_ns, end_ns))
    )


def shortfalls_of_run(
    manoeuvre: indices.Manoeuvre, run: PlannedRun, programme: TrialProgramme, conditions: Conditions
) -> tuple[list[str], list[str]]:
    """Why a manoeuvre is not the run as it was planned and would count if it were repeated; and what keeps it from
    showing a criterion whatever is repeated."""
    reasons = []
    if run.side and manoeuvre.side != run.side:
        reasons.append(f"it went to {manoeuvre.side}, not to {run.side}")
    share = 0.5 * _HELM_SHARE if run.kind == "turning_circle" else _HELM_SHARE
    angles = {"helm": (manoeuvre.helm_deg, run.helm_deg, share),
              "switching angle": (manoeuvre.settings.get("switch_deg"), run.switch_deg, _SWITCH_SHARE)}  # fmt: skip
    for name, (angle, wanted, tolerance) in angles.items():
        if wanted and angle is not None and abs(abs(angle) / wanted - 1.0) > tolerance:
            reasons.append(f"the {name} was {abs(angle):.1f} deg, not {wanted:g} deg")
    if run.kind == "zigzag" and manoeuvre.settings["swings"] < min(run.swings, _FEWEST_SWINGS):
        reasons.append(f"it has {manoeuvre.settings['swings']:.0f} swings of {run.swings}")
    turned_deg, least_deg = manoeuvre.settings.get("turned_deg", inf), min(run.turn_deg, _FULL_CIRCLE_DEG) - 10.0
    if run.kind == "turning_circle" and turned_deg < least_deg:
        reasons.append(f"the ship turned by {turned_deg:.0f} deg, not by {run.turn_deg:g} deg")
    if run.kind in ("turning_circle", "zigzag", "stopping"):  # a pull-out begins in a turn
        approach = criteria.approach_shortfall(manoeuvre, programme.programme.length_m)
        wanted_mps = _LEAST_APPROACH_SHARE * programme.speed_mps(run)
        made_mps = manoeuvre.settings.get("approach_mps", nan) + (conditions.current_mps or 0.0)
        reasons += [approach] * bool(approach)
        if made_mps < wanted_mps:
            reasons.append(f"the approach was at {made_mps:.2f} m/s, not {programme.speed_mps(run):.2f} m/s")
    if conditions.beaufort is not None and conditions.beaufort > run.most_beaufort:
        reasons.append(f"the wind was of force {conditions.beaufort}, above {run.most_beaufort}")
    least_m, depth_m = programme.programme.least_depth_m, manoeuvre.settings.get("water_depth_m", inf)
    if least_m and depth_m < least_m:
        reasons.append(_SHALLOW.format(least_m, depth_m))
    missing = dict.fromkeys(reason for index in manoeuvre.indices.values() for reason in index.missing)
    return reasons, [reason for reason in missing if reason not in reasons]
