"""A run from its approach to its verdict: steadiness, calls by the kinematics, faults, restarts, whole days."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import nan
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core import ship
from seatrial.acquisition.core.errors import InputError
from seatrial.analysis.conduct.conductor import Conductor, state_path
from seatrial.analysis.conduct.programme import PlannedRun, TrialProgramme, programme_from_template
from seatrial.analysis.conduct.run import (
    Call,
    Instant,
    RunState,
    advance,
    helm_and_thrust,
    instant_of,
    judge_run,
    steadiness_of,
)
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.conducted import conducted_runs
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.tables.table import NANO
from seatrial.hybrid.evaluation.manoeuvre_indices import keep_comparable_indices
from seatrial.hybrid.simulation.manoeuvres import helm_leg, steer
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.benchmarks.conducted_days import CONDITIONS, Day, Score
from tests.conftest import nightly

PROGRAMME = programme_from_template("imo", 200.0, 8.0, wind_from_deg=350.0)
ZIGZAG = next(run for run in PROGRAMME.run if run.kind == "zigzag" and run.helm_deg == 20.0 and run.side == "port")
SPEED_MPS = 8.0


def instants(
    seconds: float, helm: float = 0.0, rate_dps: float = 0.0, start: Instant | None = None, every_s: float = 1.0
) -> list[Instant]:
    """A ship that turns evenly."""
    first_ns = start.time_ns if start else 0
    heading = start.heading_deg if start else 350.0
    times = np.arange(1, round(seconds / every_s) + 1) * every_s
    return [
        Instant(
            first_ns + round(time_s * NANO),
            float(ship.wrap_360(heading + rate_dps * time_s)),
            rate_dps,
            SPEED_MPS,
            0.0,
            helm,
            100.0,
            wind_mps=4.0,
            wind_from_deg=350.0,
        )
        for time_s in times
    ]


def followed(state: RunState, sailed: list[Instant], run: PlannedRun = ZIGZAG) -> tuple[RunState, list[Call]]:
    calls: list[Call] = []
    for instant in sailed:
        state, called = advance(state, instant, run, PROGRAMME)
        calls += called
    return state, calls


def test_bars_fill_in_the_steady_time_and_a_turn_empties_them() -> None:
    state, calls = followed(RunState(), instants(0.5 * PROGRAMME.steady_s))
    assert state.steadiness.heading == pytest.approx(0.5, abs=0.05)
    assert not calls
    state, calls = followed(state, instants(PROGRAMME.steady_s, start=state.newest))
    assert [call.kind for call in calls] == ["ready"]
    assert calls[0].text == "port 20"
    state, _ = followed(state, instants(15.0, 0.0, 0.5, state.newest))
    assert state.steadiness.heading < 0.5
    assert not state.steadiness.is_steady


def test_what_was_sailed_before_a_run_was_aborted_is_none_of_the_next() -> None:
    """The helm is still over when the key is pressed: it is no order, and the approach before it was another's."""
    state, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s))
    state, _ = followed(state, instants(10.0, 20.0, 0.3, state.newest))  # to the wrong side
    assert state.phase == "sailing"
    assert state.newest is not None
    state = RunState(recent=state.recent, earliest_ns=state.newest.time_ns)
    state, calls = followed(state, instants(8.0, 20.0, 0.3, state.newest))
    state, steadied = followed(state, instants(0.8 * PROGRAMME.steady_s, start=state.newest))
    assert state.phase == "approach"
    assert not calls + steadied
    state, calls = followed(state, instants(PROGRAMME.steady_s, start=state.newest))
    assert [call.kind for call in calls] == ["ready"]
    state, _ = followed(state, instants(10.0, -20.0, -0.3, state.newest))
    assert (state.phase, state.faults) == ("sailing", ())


def swinging_ship(start: Instant, helms_deg: list[float]) -> Iterator[Instant]:
    """A ship that answers the helm of each second as Nomoto's first order model does (K' 1.2, T' 1.5)."""
    length_s, heading_deg, rate_dps = PROGRAMME.length_s, start.heading_deg, start.yaw_rate_dps
    for second, helm_deg in enumerate(helms_deg, 1):
        rate_dps += (1.2 * helm_deg / length_s - rate_dps) / (1.5 * length_s)
        heading_deg += rate_dps
        yield replace(start, time_ns=start.time_ns + second * NANO, heading_deg=float(ship.wrap_360(heading_deg)),
                      yaw_rate_dps=rate_dps, helm_deg=helm_deg)  # fmt: skip


@pytest.mark.parametrize("key", ["abort", "skip", "abort and repeat", "clock"])
@pytest.mark.parametrize("seed", [0, 1, *nightly(*range(2, 10))])
def test_no_helm_starts_a_run_until_the_ship_has_steadied_from_one_that_was_given_up(key: str, seed: int) -> None:
    """A zigzag given up at any moment, then whatever the helmsman does, also the rest of the zigzag, or nothing for
    a while near the heading of the approach: only after a steady approach is a helm an order."""
    chance = np.random.default_rng(seed)
    programme = replace(PROGRAMME, run=(ZIGZAG, replace(ZIGZAG, side="starboard"), replace(ZIGZAG, helm_deg=10.0)))
    conductor = Conductor(programme)
    for instant in instants(2.0 * PROGRAMME.steady_s):
        conductor.advance(instant)
    zigzag = [-20.0] * 40 + [20.0] * 70 + [-20.0] * 70 + [20.0] * 70
    given_up_s = int(chance.integers(10, 200))
    last = instant
    for instant in swinging_ship(last, zigzag[:given_up_s]):
        conductor.advance(instant)
    assert conductor.state.phase == "sailing"
    if key == "clock":
        conductor.break_off("the clock was set")
        conductor.leave_unjudged("the clock was set")
        conductor.set_clock(0)
        conductor.advance(replace(instant, time_ns=instant.time_ns + NANO))
    else:
        assert conductor.skip() if key == "skip" else conductor.abort()
        assert "repeat" not in key or conductor.repeat()
    helms = zigzag[given_up_s:] if chance.random() < 0.5 else []
    while len(helms) < 600:
        helms += [float(chance.choice((0.0, 0.0, 10.0, -10.0, 20.0, -20.0)))] * int(chance.integers(2, 30))
    given_up_ns, last = conductor.state.earliest_ns, replace(instant, time_ns=instant.time_ns + NANO)
    for instant in swinging_ship(last, helms):
        conductor.advance(instant)
        if conductor.state.ready_ns > given_up_ns:
            return
        assert conductor.state.phase == "approach"
    on_course = replace(instant, heading_deg=350.0, yaw_rate_dps=0.0, helm_deg=0.0)
    run, steady = conductor.run, instants(2.0 * PROGRAMME.steady_s + 60.0, start=on_course)
    assert run is not None
    for instant in [*steady, *swinging_ship(steady[-1], [run.sign * (run.helm_deg or 0.0)] * 10)]:
        conductor.advance(instant)
    assert (conductor.state.phase, conductor.state.faults) == ("sailing", ())


@pytest.mark.parametrize(
    ("period_s", "silent_s"),
    [(300.0, 90.0), *nightly((60.0, 0.0), (60.0, 90.0), (300.0, 0.0), (1e6, 0.0), (1e6, 90.0))],
)
def test_a_manoeuvre_that_began_before_it_was_followed_is_not_judged(period_s: float, silent_s: float) -> None:
    """A zigzag of 20 deg of helm, followed from any moment of its period, or a circle: no order until the ship has
    gone straight; then the next. So it is where nothing was received for a while."""
    for begin in np.array([0.0, 0.17, 0.42, 0.58, 0.92]) * min(period_s, 300.0):
        state = ready() if silent_s else RunState()
        first_ns = state.newest.time_ns + round(silent_s * NANO) if state.newest else 0
        for second in range(600):
            phase = 2.0 * np.pi * (begin + second + 0.1) / period_s
            helm, rate_dps = 20.0 * np.sign(np.sin(phase)), 0.5 * np.sin(phase - 0.5)
            heading = 350.0 + 0.5 * period_s / (2.0 * np.pi) * (np.cos(0.5) - np.cos(phase - 0.5))
            entry = replace(instants(1.0)[0], time_ns=first_ns + (second + 1) * NANO, helm_deg=float(helm),
                            yaw_rate_dps=float(rate_dps), heading_deg=float(ship.wrap_360(heading)))  # fmt: skip
            state, _ = advance(state, entry, ZIGZAG, PROGRAMME)
            assert state.phase == "approach"
        assert state.is_unled
        on_course = replace(state.newest or entry, heading_deg=350.0)
        state, _ = followed(state, instants(2.0 * PROGRAMME.steady_s, start=on_course))
        assert not state.is_unled
        state, _ = followed(state, instants(10.0, -20.0, -0.3, state.newest))
        assert (state.phase, state.faults) == ("sailing", ())


@pytest.mark.parametrize("rate_dps", [1.0, 2.3, 7.0])
def test_an_order_is_where_the_helm_began_to_move_however_slow_the_gear(rate_dps: float) -> None:
    """Out of a helmsman's own steering to the other side, as when he still turns."""
    steering = [replace(entry, helm_deg=8.0 - 0.25 * row) for row, entry in enumerate(instants(20.0))]
    state, _ = followed(RunState(ready_ns=1), [*instants(60.0), *[
        replace(entry, time_ns=entry.time_ns + 60 * NANO) for entry in steering
    ]])  # fmt: skip
    assert state.newest is not None
    begun_ns, last_deg = state.newest.time_ns, state.newest.helm_deg
    going = [replace(entry, helm_deg=max(last_deg - rate_dps * (row + 1), -20.0))
             for row, entry in enumerate(instants(60.0, start=state.newest))]  # fmt: skip
    state, _ = followed(replace(state, ready_ns=begun_ns), going)
    assert state.executed_ns == pytest.approx(begun_ns, abs=3 * NANO)


def test_a_slow_gear_on_its_way_is_no_other_helm() -> None:
    state, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s))
    way = np.concatenate([np.maximum(-1.0 * np.arange(1, 41), -20.0), np.minimum(-20.0 + np.arange(60), 20.0)])
    for row, helm in enumerate(way):
        state, _ = followed(state, instants(1.0, float(helm), -0.5 if row < 40 else 0.1, state.newest))
    assert len(state.orders_ns) == 2
    assert not [fault for fault in state.faults if "helm was not" in fault]


@pytest.mark.parametrize(
    ("change", "bar"),
    [({"surge_mps": 6.0}, "speed"), ({"heading_deg": 100.0}, "heading"), ({"helm_deg": 15.0}, "helm")],
)
def test_each_bar_is_of_its_own_quantity(change: dict[str, float], bar: str) -> None:
    steady = instants(3.0 * PROGRAMME.steady_s)
    recent = [replace(instant, **change) if instant.time_ns > 100 * NANO else instant for instant in steady]  # type: ignore[arg-type]
    bars = steadiness_of(recent, ZIGZAG, PROGRAMME)
    assert getattr(bars, bar) < 1.0
    assert steadiness_of(steady, ZIGZAG, PROGRAMME).is_steady


def zigzag_to_port(
    state: RunState,
    late_s: float = 0.0,
    helm: float = 20.0,
    eased: tuple[int, int] = (0, 0),
    *,
    restarts: bool = False,
    instants_to: list[Instant] | None = None,
) -> tuple[RunState, list[Call], list[float]]:
    """A ship that turns by 0.8 deg/s as soon as the helm is over, which follows each call after a second; the
    calls, and the true moments of 20 deg off, at one instant a second. The helm is ``eased`` between two seconds.
    With ``restarts`` the state goes through its file before every instant; the recent instants come from the
    recording."""
    calls: list[Call] = []
    side, due, now, begun_s, heading = -1.0, [], 0, None, 0.0
    base_ns = state.newest.time_ns if state.newest else 0
    order_s, towards = 0.0, -1.0
    while state.phase != "ended" and now < 900:
        now += 1
        if begun_s is not None and now >= begun_s:
            side, begun_s = -side, None
        before, heading = heading, heading + 0.8 * side
        level = 20.0 if len(due) < 3 else 0.0
        if towards * before < level <= towards * heading and now > order_s + 5:
            due.append(now - 1 + (level - towards * before) / 0.8)
            towards = -towards
        instant = replace(
            instants(1.0)[0],
            time_ns=base_ns + now * NANO,
            helm_deg=side * (helm if not eased[0] <= now < eased[1] else 12.0),
            yaw_rate_dps=0.8 * side,
            heading_deg=float(ship.wrap_360(350.0 + heading)),
        )
        if restarts:
            state = replace(RunState.from_json(json.loads(json.dumps(state.as_json()))), recent=state.recent)
        if instants_to is not None:
            instants_to.append(instant)
        state, called = advance(state, instant, ZIGZAG, PROGRAMME)
        for call in called:
            calls.append(call)
            if call.kind == "reverse":
                begun_s, order_s = now + 1 + late_s, now
    return state, calls, due


@cache
def ready() -> RunState:
    return followed(RunState(), instants(2.0 * PROGRAMME.steady_s))[0]


def test_reversals_are_called_when_the_heading_is_there() -> None:
    """Between instants a second apart, by the rate of turn."""
    begun = ready()
    base_ns = begun.newest.time_ns if begun.newest else 0
    state, calls, due = zigzag_to_port(begun)
    assert [call.kind for call in calls] == ["reverse"] * 3 + ["end"]
    assert [call.text for call in calls] == ["starboard 20", "port 20", "starboard 20", "midships"]
    assert np.array([call.due_ns - base_ns for call in calls]) / NANO == pytest.approx(due, abs=0.1)
    assert state.phase == "ended"
    assert state.faults == ()


def test_faults_are_named_while_they_happen() -> None:
    state, _, _ = zigzag_to_port(ready(), late_s=12.0)
    assert any(fault.startswith("the helm was reversed late") for fault in state.faults)
    state, _, _ = zigzag_to_port(ready(), helm=15.0)
    assert "the helm was not 20 deg: 15.0 deg" in state.faults
    hasty, _ = followed(RunState(), instants(0.6 * PROGRAMME.steady_s))
    state, _, _ = zigzag_to_port(hasty)
    assert "the order was given before the approach was steady" in state.faults
    wrong = [
        replace(instant, helm_deg=20.0, yaw_rate_dps=0.8) for instant in instants(10.0, 20.0, 0.8, ready().newest)
    ]
    assert "the order was to starboard, not to port" in followed(ready(), wrong)[0].faults


def test_heading_that_is_missing_is_carried_on_by_the_rate_of_turn() -> None:
    """A gyro lost for 40 s does not move a call; one lost for more than a minute is a fault."""
    circle = next(run for run in PROGRAMME.run if run.kind == "turning_circle" and run.side == "starboard")
    begun, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s), circle)
    for lost_s, faults in ((40, 0), (90, 1)):
        turning = instants(800.0, 35.0, 0.8, begun.newest)
        turning[200 : 200 + lost_s] = [replace(instant, heading_deg=nan) for instant in turning[200 : 200 + lost_s]]
        state, calls = followed(begun, turning, circle)
        (end,) = calls
        assert (end.due_ns - state.executed_ns) / NANO == pytest.approx(540.0 / 0.8, abs=1.0)
        assert len(state.faults) == faults


def circled(begun: RunState, helms: dict[tuple[int, int], float], **more: float) -> tuple[RunState, list[Call]]:
    """A circle to starboard at 0.8 deg/s, with other helms between some seconds after its order."""
    turning = instants(800.0, 35.0, 0.8, begun.newest)
    for (first, end), helm in helms.items():
        turning[first:end] = [replace(instant, helm_deg=helm) for instant in turning[first:end]]
    return followed(begun, [replace(instant, **more) for instant in turning], CIRCLE)


CIRCLE = next(run for run in PROGRAMME.run if run.kind == "turning_circle" and run.side == "starboard")
MOVED = "the helm was moved when no order was due"


@pytest.mark.parametrize(
    ("helms", "fault"),
    [
        ({}, ""), ({(100, 109): 20.0}, f"{MOVED}: to starboard 20"), ({(100, 109): -35.0}, f"{MOVED}: to port 35"),
        ({(100, 109): 0.0}, f"{MOVED}: to midships"),
        ({(100, 104): 20.0}, ""),  # a hand that slips: L / V is 25 s
        ({(100, 300): 32.0}, ""),  # another matter
        ({(480, 489): 20.0}, ""),  # after a full circle
    ],
)  # fmt: skip
def test_helm_that_is_moved_when_no_order_is_due_is_a_fault(
    helms: dict[tuple[int, int], float], fault: str
) -> None:
    begun, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s), CIRCLE)
    state, calls = circled(begun, helms)
    assert calls[-1].text == "midships"
    assert [text for text in state.faults if text.startswith(MOVED)] == [fault] * bool(fault)


def test_helm_between_the_reversals_of_a_zigzag_is_held() -> None:
    """Eased for six seconds in the second swing; that the helm goes over when it is called is no fault."""
    state, _, _ = zigzag_to_port(ready())
    assert state.faults == ()
    state, _, _ = zigzag_to_port(ready(), eased=(45, 51))
    assert f"{MOVED}: to starboard 12" in state.faults


@pytest.mark.parametrize(
    ("depths", "faults"),
    [
        ({"depth_m": 60.0}, ()), ({"depth_m": 30.0}, ("the water was less than 48 m deep: 30.0 m",)), ({}, ()),
        ({"depth_m": nan}, ()),
    ],
)  # fmt: skip
def test_run_in_water_that_is_not_deep_is_a_fault(depths: dict[str, float], faults: tuple[str, ...]) -> None:
    deep = replace(PROGRAMME, programme=replace(PROGRAMME.programme, least_depth_m=48.0))
    state, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s), CIRCLE)
    for instant in instants(800.0, 35.0, 0.8, state.newest):
        state, _ = advance(state, replace(instant, **depths), CIRCLE, deep)  # type: ignore[arg-type]
    assert state.faults == faults
    assert followed(RunState(), instants(60.0))[0].faults == ()


def test_run_in_shallow_water_or_without_its_heading_is_not_valid() -> None:
    """R/V Gunnerus' circle, sailed and found as it was planned, but over a bank; or its gyro gone for a fifth."""
    legs = (steer(0.0, 120.0), helm_leg(-20.0, at_most_s=400.0))
    table, _ = simulate_trial("gunnerus_short", "calm", legs, 420.0, 2.0)
    run = PlannedRun(kind="turning_circle", side="starboard", helm_deg=20.0)
    programme = replace(programme_from_template("imo", 28.9, 5.0, least_depth_m=11.0), run=(run,))
    reasons = []
    for depth_m, lost in ((40.0, 0.0), (9.5, 0.0), (40.0, 0.2)):
        state, sailed = RunState(), table.assign(depth_below_transducer_m=40.0)
        begin = sailed.index[sailed.index.size // 2]
        sailed.loc[begin : begin + pd.Timedelta(seconds=30.0), "depth_below_transducer_m"] = depth_m
        sailed.loc[begin : begin + pd.Timedelta(seconds=250.0 * lost), "heading_deg"] = nan
        for time, row in sailed.iterrows():
            instant = instant_of(pd.Timestamp(str(time)).value, row.to_dict(), ship.DEFAULT)
            state, _ = advance(state, instant, run, programme)
        assert state.phase == "ended"
        reasons.append(judge_run(sailed, state, run, programme).reasons)
    assert reasons[0] == ()
    assert reasons[1] == ("the water was less than 11 m deep: 9.5 m",)
    assert any("missing" in reason for reason in reasons[2])


@pytest.mark.parametrize("begin", [15, 35, 75, *nightly(5, 25, 45, 55, 65, 85, 95)])
@pytest.mark.parametrize("name", ["helm_deg", "yaw_rate_dps", "surge_mps", "thrust_rpm", "wind_mps"])
def test_sensor_that_is_lost_for_a_while_changes_no_call_and_is_no_order(name: str, begin: int) -> None:
    """A helm that is not measured was taken for one that had been reversed."""
    state, recorded = ready(), list[Instant]()
    base_ns = state.newest.time_ns if state.newest else 0
    unbroken, calls, _ = zigzag_to_port(state, instants_to=recorded)
    lost = [replace(entry, **{name: nan}) if begin <= (entry.time_ns - base_ns) / NANO < begin + 12 else entry
            for entry in recorded]  # type: ignore[arg-type]  # fmt: skip
    again, calls_again = followed(state, lost)
    assert [call.kind for call in calls_again] == [call.kind for call in calls]
    assert np.array([call.due_ns for call in calls_again]) / NANO == pytest.approx(
        np.array([call.due_ns for call in calls]) / NANO, abs=0.6
    )
    assert (again.phase, again.faults) == (unbroken.phase, unbroken.faults)


def test_lost_speed_ends_no_stop_and_a_pull_out_goes_by_the_heading() -> None:
    stop = next(run for run in PROGRAMME.run if run.kind == "stopping")
    state, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s), stop)
    astern = [replace(entry, thrust_rpm=-60.0, surge_mps=nan) for entry in instants(60.0, start=state.newest)]
    state, calls = followed(state, astern, stop)
    assert (state.phase, calls) == ("sailing", [])
    state, calls = followed(
        state, [replace(entry, surge_mps=-0.1) for entry in instants(3.0, start=state.newest)], stop
    )
    assert [call.kind for call in calls] == ["end"]

    pull_out = PlannedRun(kind="pull_out", side="starboard", helm_deg=20.0)
    for rate_known in (True, False):
        state, _ = followed(RunState(), instants(2.0 * PROGRAMME.steady_s), pull_out)
        turn = instants(300.0, 20.0, 0.8, state.newest)
        state, calls = followed(
            state, turn if rate_known else [replace(e, yaw_rate_dps=nan) for e in turn], pull_out
        )
        assert [call.kind for call in calls] == ["amidships"]
        assert (calls[0].due_ns - state.executed_ns) / NANO == pytest.approx(150.0, abs=10.0)


def test_restart_in_the_middle_of_a_run_changes_no_call() -> None:
    restarted, straight = (zigzag_to_port(ready(), restarts=restarts) for restarts in (True, False))
    assert repr(restarted) == repr(straight)  # with speeds that are not known


def test_state_file_of_another_programme_is_refused(tmp_path: Path) -> None:
    path = state_path(tmp_path / "day.toml")
    Conductor(PROGRAMME, path).save()
    assert Conductor(PROGRAMME, path).place == Conductor(PROGRAMME).place
    sailed = Conductor(PROGRAMME, path)
    sailed.skip()
    longer = replace(PROGRAMME, run=(*PROGRAMME.run, PROGRAMME.run[0]))
    assert set(Conductor(longer, path).remaining) == {*sailed.remaining, len(PROGRAMME.run)}
    edited = replace(PROGRAMME, run=(*PROGRAMME.run[1:], PROGRAMME.run[0]))  # the runs of the file are others'
    with pytest.raises(InputError, match=r"another programme.*add runs at the end"):
        Conductor(edited, path)
    other: TrialProgramme = replace(PROGRAMME, run=PROGRAMME.run[:2])
    with pytest.raises(InputError, match="another programme"):
        Conductor(other, path)
    path.write_text("{}")
    with pytest.raises(InputError, match="move it away"):
        Conductor(PROGRAMME, path)


def test_state_of_the_version_before_is_gone_on_with_and_another_says_what_to_do(tmp_path: Path) -> None:
    """Version 2 had no names of recordings; of one that is not known nothing is guessed."""
    path = tmp_path / "day.sailed.json"
    conductor = Conductor(PROGRAMME, path)
    conductor.note("tug alongside")
    conductor.abort("traffic")
    content = json.loads(path.read_text())
    del content["recordings"], content["sailed"][0]["recordings"], content["state"]["swinging"]
    path.write_text(json.dumps({**content, "version": 2}))
    again = Conductor(PROGRAMME, path)
    assert (again.sailed, again.place, again.marks) == (conductor.sailed, conductor.place, conductor.marks)
    for version in (1, 4, None):
        path.write_text(json.dumps({"version": version, "programme": "imo", "runs": []}))
        with pytest.raises(InputError, match=r"the Seatrial that began it, or move it away") as refusal:
            Conductor(PROGRAMME, path)
        assert refusal.value.what == "holds a state by another Seatrial"
    with pytest.raises(InputError, match="it is a folder"):
        Conductor(PROGRAMME, tmp_path)


def test_skip_abort_repeat_and_notes_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    conductor = Conductor(PROGRAMME, path)
    first = conductor.place
    conductor.note("a fishing boat")
    conductor.abort("traffic")
    assert conductor.place == first  # it stays wanted
    conductor.skip()
    assert conductor.place != first
    assert conductor.repeat()
    assert conductor.place == first
    again = Conductor(PROGRAMME, path)
    assert [(run.outcome, run.notes) for run in again.sailed] == [("aborted", ("a fishing boat",)), ("skipped", ())]
    assert (again.place, again.number) == (first, 3)


def test_helm_turns_to_starboard_where_it_is_positive_whatever_steers() -> None:
    rudders = ship.check_actuators([ship.Actuator("propeller", "propeller"), ship.Actuator("rudder", "rudder")])
    assert helm_and_thrust({"propeller_rpm": 90.0, "rudder_angle_deg": 10.0}, rudders) == pytest.approx(
        (10.0, 90.0)
    )
    pods = {"port_rpm": 100.0, "starboard_rpm": 100.0, "port_angle_deg": 10.0, "starboard_angle_deg": 10.0}
    helm, thrust = helm_and_thrust(pods, ship.DEFAULT)
    assert helm == pytest.approx(-10.0)
    assert thrust == pytest.approx(100.0 * np.cos(np.deg2rad(10.0)) ** 0.5)
    twin = ship.check_actuators([ship.Actuator("port", "propeller"), ship.Actuator("starboard", "propeller")])
    assert helm_and_thrust({"port_rpm": 100.0, "starboard_rpm": 0.0}, twin)[0] == pytest.approx(45.0)
    ordered = instant_of(
        0, {"propeller_rpm": 90.0, "rudder_angle_deg": 0.0, "rudder_order_angle_deg": 20.0}, rudders
    )
    assert (ordered.helm_deg, ordered.ordered_helm_deg) == (0.0, 20.0)


@pytest.mark.parametrize("seed", [1, *nightly(0)])
def test_a_day_is_judged_as_its_truth_and_as_ashore(seed: int) -> None:
    """R/V Gunnerus with a helmsman who errs, orders recorded (odd) or not."""
    day, score = Day("gunnerus", seed), Score()
    score.add(day, "")
    assert score.lines == []
    assert len(day.conductor.remaining) == 0
    assert np.abs(score.calls_s).max() <= 1.0
    assert max(difference for _, difference in score.differences) < 1e-9
    assert all(entry.outcome == "valid" or entry.reasons for entry in day.conductor.sailed)

    programme = conducted_runs(day.events)
    assert [(run.number, run.name, run.outcome, run.reasons) for run in programme] == [
        (entry.number, entry.name, entry.outcome, entry.reasons) for entry in day.conductor.sailed
    ]
    spans = {entry.number: day.conductor.judged_span_of(entry) for entry in day.conductor.sailed}
    assert all(run.judged == spans[run.number] for run in programme if run.judged)
    assert all(
        spans[after.number].start.value >= before.ended_ns for before, after in pairwise(day.conductor.sailed)
    )
    ashore = find_manoeuvres(day.table(), day.programme.programme.length_m, day.events, conditions=CONDITIONS)
    valid = next(run for run in programme if run.outcome == "valid" and run.judged)
    assert valid.judged is not None
    wider = valid.judged._replace(start=valid.judged.start - pd.Timedelta(seconds=20))
    other = replace(valid, number=90, outcome="invalid", judged=wider)  # as a second conductor left it, later
    with_other = find_manoeuvres(
        day.table(), day.programme.programme.length_m, [*day.events, (day.times_ns[-1], other.mark())],
        conditions=CONDITIONS,
    )  # fmt: skip
    same = [min(runs, key=lambda run: abs(run.start - valid.ordered)) for runs in (ashore, with_other)]
    assert same[0].indices == same[1].indices
    of_ashore, of_aboard = (
        {(result.criterion.name, result.side): result.mean for result in results}
        for results in (criteria.criterion_results(criteria.index_rows(map(keep_comparable_indices, ashore))),
                        day.conductor.criteria)
    )  # fmt: skip
    assert sum(mean is not None for mean in of_aboard.values()) == 13
    for name, mean in of_aboard.items():
        other = of_ashore[name]
        assert mean is not None
        assert other is not None
        assert (mean.runs, mean.index.value, mean.index.limit) == (other.runs, other.index.value, other.index.limit)
        # what is missing ashore was missing aboard; circles show the current of the day
        assert set(other.index.missing) <= set(mean.index.missing)
        if name[0] != "track reach":
            assert (mean.index.low, mean.index.high) == (other.index.low, other.index.high)


def test_tunnel_thruster_is_tested_and_found_as_ashore() -> None:
    table, _ = simulate_trial("gunnerus_short", "calm", "tunnel_test", 260.0, 2.0)
    run = PlannedRun(kind="thruster_test", thruster="tunnel", speed_mps=0.5, held_s=30.0)
    programme = replace(programme_from_template("imo", 28.9, 5.0), run=(run,))
    state = RunState()
    for time, row in table.iterrows():
        instant = instant_of(pd.Timestamp(str(time)).value, row.to_dict(), ship.DEFAULT)
        state, _ = advance(state, instant, run, programme)
    assert state.phase == "ended"
    verdict = judge_run(table, state, run, programme)
    assert verdict.valid, verdict.reasons
    assert verdict.manoeuvre is not None
    assert "last_yaw_rate_dps" in verdict.manoeuvre.indices


@pytest.mark.parametrize("side", ["starboard", "port"])
def test_pull_out_counts_from_the_helm_amidships(side: str) -> None:
    """R/V Gunnerus' helm amidships when the rate of turn is steady, as it is called."""
    turns = {"starboard": -20.0, "port": 20.0}[side]
    legs = (steer(0.0, 120.0), helm_leg(turns, at_most_s=80.0), helm_leg(0.0, at_most_s=200.0))
    table, _ = simulate_trial("gunnerus_short", "calm", legs, 400.0, 2.0)
    run = PlannedRun(kind="pull_out", side=side, helm_deg=20.0)  # type: ignore[arg-type]
    programme = replace(programme_from_template("imo", 28.9, 5.0), run=(run,))
    state, kinds = RunState(), list[str]()
    for time, row in table.iterrows():
        instant = instant_of(pd.Timestamp(str(time)).value, row.to_dict(), ship.DEFAULT)
        state, calls = advance(state, instant, run, programme)
        kinds += [call.kind for call in calls]
    assert kinds == ["ready", "amidships", "end"]
    verdict = judge_run(table, state, run, programme)
    assert verdict.valid, verdict.reasons
