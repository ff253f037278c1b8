"""Days of trials sailed by the conductor's calls: what it recognises, when it calls, and what it shows.

    python -m tests.benchmarks.conducted_days [--days 20] [--first 0] [--ships tanker gunnerus twin_screw]

Three ships, a tanker of 200 m, R/V Gunnerus and a twin-screw vessel of 40 m, sail IMO's tests on the simulator, by
a helmsman with delays and a hand that is not steady, in gusts and a tide that turns. Every third run has a fault:
an order before the approach is steady, to the wrong side, with another helm, reversals given late, a helm that is
let go, a gust above force 5, or a gyro that is lost for two minutes. The truth is read off the noise-free track by
the definitions; runs within a tenth of a tolerance of its limit, or a switching angle within what the ship turns in
half a sample, do not count. Printed are misses of the conductor, invalid runs that it calls valid and the other way
round, the times of its calls against the moments of the definition, and its indices against those of `seatrial
manoeuvres` on the whole day. No sockets: the samples are handed over as they would be received.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field, fields
from pathlib import Path
from tempfile import gettempdir

import numpy as np
import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core import ship as ships
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.conduct.conductor import Conductor, SailedRun
from seatrial.analysis.conduct.programme import PlannedRun, programme_from_template
from seatrial.analysis.conduct.run import Call, instant_of
from seatrial.analysis.manoeuvres.find import find_manoeuvres
from seatrial.analysis.manoeuvres.motion import runs_of_true
from seatrial.analysis.quality.wind import beaufort_number
from seatrial.analysis.tables.table import NANO
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.simulation import manoeuvres
from seatrial.hybrid.simulation.trial import ornstein_uhlenbeck, usual_noise
from seatrial.hybrid.vessel import dynamics
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.estimate.new_vessel import new_vessel
from seatrial.hybrid.vessel.files import Vessel, load_vessel

START = pd.Timestamp("2026-06-01T06:00:00Z")
STEP_S = 0.25
ROWS_PER_S = {"twin_screw": 4}
"""Samples a second: of a ship that turns by 5 deg/s an order is not known to a degree at 2."""
FAULTS = ("early order", "wrong side", "other helm", "late reversals", "released", "gust", "gyro lost")
FAULT_SHARE = 1.0 / 3.0
SLACK = 0.1
"""Of a tolerance: a run so near to its limit is valid or not by the noise, and does not count."""
UNSEEN_S = 60.0
LONGEST_S = 12 * 3600.0
CONDITIONS = Conditions(
    draught_m=10.0, full_load_draught_m=10.0, trim_m=0.0, water_depth_m=200.0, sea_state=2,
    chemical_or_gas_tanker=True,
)  # fmt: skip


def vessel_of(name: str) -> Vessel:
    """The ship of a name."""
    if name == "gunnerus":
        return load_vessel("gunnerus_short")
    path = Path(gettempdir()) / f"conducted_{name}.toml"
    if name == "tanker":
        new_vessel(path, name=name, length_m=200.0, beam_m=32.0, draught_m=12.0, block=0.8, service_speed_mps=7.7,
                   propellers=["propeller,diameter=6.5"], rudders=["rudder,area=48"])  # fmt: skip
    else:
        new_vessel(
            path,
            name=name,
            length_m=40.0,
            beam_m=9.0,
            draught_m=2.8,
            block=0.55,
            service_speed_mps=6.0,
            propellers=["port,diameter=1.6,y=-2", "starboard,diameter=1.6,y=2"],
            rudders=["port_rudder,area=1.8,behind=port", "starboard_rudder,area=1.8,behind=starboard"],
        )
    return load_vessel(path)


@dataclass
class Bridge:
    """The helmsman and the engine: what is ordered, by what is called."""

    random: np.random.Generator
    length_s: float
    course_deg: float = 0.0
    share: float = 1.0
    helm_deg: float | None = None
    pending: list[tuple[float, float | None, float]] = field(default_factory=list)
    fault: str = ""
    steered_deg: float = 0.0
    noted_s: float = -1.0
    bias_deg: float = 0.0

    def order(self, at_s: float, helm_deg: float | None, share: float = 1.0) -> None:
        """Order a helm, None to steer the course, at a time."""
        self.pending.append((at_s, helm_deg, share))

    def helm_at(self, now_s: float, heading_deg: float, rate_dps: float) -> tuple[float, float]:
        """The helm [deg] and the share of the shaft speed that are ordered."""
        for entry in sorted(entry for entry in self.pending if entry[0] <= now_s):
            self.pending.remove(entry)
            self.helm_deg, self.share = entry[1], entry[2]
            self.bias_deg = float(self.random.normal(0.0, 0.15))
        if self.helm_deg is not None:
            return self.helm_deg + self.bias_deg * (self.helm_deg != 0.0), self.share
        if now_s - self.noted_s >= 1.0:  # a hand on the wheel, once a second, in half degrees
            self.noted_s = now_s
            off = float(ships.angle_difference(self.course_deg, heading_deg)) + self.random.normal(0.0, 0.1)
            limit = 20.0 if abs(off) > 15.0 else 8.0
            wanted = np.clip(off - 1.2 * self.length_s * rate_dps, -limit, limit)
            self.steered_deg = float(np.round(2.0 * wanted) / 2.0)
        return self.steered_deg, self.share


@dataclass
class TrueRun:
    """What was done of a run in truth: its orders [s], those that were due, its fault."""

    planned: PlannedRun
    fault: str
    number: int
    orders_s: list[float] = field(default_factory=list)
    calls: list[Call] = field(default_factory=list)
    called_s: list[float] = field(default_factory=list)
    aborted: bool = False


def _step_after(time_s: float) -> float:
    """When an order of a time acts [s]."""
    return float(np.ceil(time_s / STEP_S) * STEP_S)


class Day:
    """A ship's day of trials, from the first approach to the last verdict."""

    def __init__(
        self,
        name: str,
        seed: int,
        faults: bool = True,
        template: str = "imo",
        path: Path | None = None,
        ship: Vessel | None = None,
    ) -> None:
        self.random, self.rows_per_s = np.random.default_rng([seed, len(name)]), ROWS_PER_S.get(name, 2)
        self.vessel, self.faults = ship or vessel_of(name), faults
        self.plant = vessel_plant(self.vessel)
        self.handling, self.drives = manoeuvres.handling_of(self.vessel), manoeuvres.drives_of(self.vessel)
        self.rpm = 0.85 ** (1.0 / 3.0) * manoeuvres.shaft_limit_rpm(self.vessel)
        self.units = control_units(self.vessel.actuators)
        speed_mps = manoeuvres.steady_speed_mps(self.plant, self.handling.orders(self.rpm, 0.0) * self.units)
        length_m = self.plant.length_between_perpendiculars_m
        self.wind_from_deg = float(self.random.uniform(0.0, 360.0))
        self.programme = programme_from_template(
            template, length_m, speed_mps, name, wind_from_deg=float(round(self.wind_from_deg) % 360),
            largest_helm_deg=35.0,
        )  # fmt: skip
        self.conductor = Conductor(self.programme, path)
        self.records_orders = bool(seed % 2)
        self.wind_mps = float(self.random.uniform(1.0, 6.0))
        self.tide_mps = float(self.random.uniform(0.0, 0.05)) * speed_mps
        self.tide_deg = float(self.random.uniform(0.0, 360.0))
        self.bridge = Bridge(self.random, self.programme.length_s)
        self.runs: list[TrueRun] = []
        self.events: list[tuple[int, str]] = []
        self.unseen = 0
        self.gust = self.gyro = (np.inf, np.inf)
        self._simulate()

    # the ship

    def _wind(self, steps: int) -> Floats:
        along, across = (
            0.12 * self.wind_mps * ornstein_uhlenbeck(self.random, steps, STEP_S, 60.0) for _ in range(2)
        )
        direction = np.deg2rad(self.wind_from_deg) + np.arctan2(across, self.wind_mps + along)
        return np.column_stack([direction, np.hypot(self.wind_mps + along, across)])

    def _simulate(self) -> None:
        steps = round(LONGEST_S / STEP_S)
        wind, noise = self._wind(steps), usual_noise(self.plant.length_between_perpendiculars_m)
        stride = round(1.0 / self.rows_per_s / STEP_S)
        state = np.array(
            [0.0, 0.0, np.deg2rad(self.wind_from_deg + 40.0), self.programme.programme.speed_mps, 0.0, 0.0]
        )
        feedback = self.handling.orders(self.rpm, 0.0) * self.units
        lag = 1.0 - np.exp(-STEP_S / np.maximum(self.drives.lag_s, 1e-6))
        states, controls, orders, air = [], [], [], []
        rows: list[dict[str, float]] = []
        self.times_ns: list[int] = []
        self.rows, plant = rows, self.plant
        self.sailing: TrueRun | None = None
        self.waited_s = 0.0
        for step in range(steps):
            now_s = step * STEP_S
            if step % round(60.0 / STEP_S) == 0:
                phase = 2.0 * np.pi * now_s / (12.42 * 3600.0)
                course = np.deg2rad(self.tide_deg)
                speed = self.tide_mps * np.cos(phase)
                plant = self.plant.replaced(
                    current_north_mps=speed * np.cos(course), current_east_mps=speed * np.sin(course)
                )
            gusty = wind[step].copy()
            if self.gust[0] <= now_s < self.gust[1]:
                gusty[1] += 14.0
            heading, rate = np.rad2deg(state[2]), np.rad2deg(state[5])
            helm, share = self.bridge.helm_at(now_s, heading, rate)
            order = self.handling.orders(self.rpm * share, -helm) * self.units
            move = lag * (np.clip(order, -self.drives.limit, self.drives.limit) - feedback)
            feedback = feedback + np.clip(move, -self.drives.rate * STEP_S, self.drives.rate * STEP_S)
            states.append(state)
            controls.append(feedback)
            orders.append((helm, share))
            air.append(gusty)
            if step % stride == 0:
                self._record_row(now_s, state, feedback, order, gusty, noise)
                if self._conduct(now_s, state) is False:
                    break
            state = dynamics.simulate(plant, state, feedback[None], gusty[None], STEP_S)[-1]
        self.states, self.controls = np.array(states), np.array(controls)
        self.orders, self.air = np.array(orders), np.array(air)

    def _record_row(
        self, now_s: float, state: Floats, feedback: Floats, order: Floats, wind: Floats, noise: object
    ) -> None:
        n, random = noise, self.random
        sigma = np.array([n.position_m, n.position_m, np.deg2rad(n.heading_deg), n.speed_mps, n.speed_mps,
                          np.deg2rad(n.yaw_rate_dps)])  # fmt: skip
        measured = state + sigma * random.standard_normal(6)
        is_angle = np.array([channel.unit == "deg" for channel in ships.control_channels(self.vessel.actuators)])
        acting = feedback + np.where(is_angle, n.azimuth_deg, n.shaft_rpm) * self.units * random.standard_normal(
            feedback.size
        )
        heard = wind + np.array([np.deg2rad(3.0), 0.2]) * random.standard_normal(2)
        # in the units of the channels
        values = dict(zip(ships.control_names(self.vessel.actuators), acting / self.units, strict=True))
        if self.records_orders:
            values |= {ships.order_channel_name(name): value for name, value in zip(
                ships.control_names(self.vessel.actuators), order / self.units, strict=True)}  # fmt: skip
        values |= {
            "north_m": measured[0],
            "east_m": measured[1],
            "heading_deg": float(ships.wrap_360(np.rad2deg(measured[2]))),
            "surge_mps": measured[3],
            "sway_mps": measured[4],
            "yaw_rate_dps": float(np.rad2deg(measured[5])),
            "wind_direction_deg": float(ships.wrap_360(np.rad2deg(heard[0]))),
            "wind_speed_mps": abs(heard[1]),
        }
        if self.gyro[0] <= now_s < self.gyro[1]:
            values["heading_deg"] = np.nan
        self.rows.append(values)
        self.times_ns.append(START.value + round(now_s * NANO))

    def table(self, first: int = 0) -> pd.DataFrame:
        """The samples from a row on."""
        index = pd.DatetimeIndex(np.array(self.times_ns[first:]), tz="UTC", name="time")
        table = pd.DataFrame(self.rows[first:], index=index)
        actuators = ships.actuators_as_text(self.vessel.actuators)
        table.attrs["trial"] = {"vessel": self.vessel.name, **({"actuators": actuators} if actuators else {}),
                                "antenna_forward_m": 0.0, "antenna_starboard_m": 0.0}  # fmt: skip
        return table

    # the conductor and those on the bridge

    def _conduct(self, now_s: float, state: Floats) -> bool:
        """Hand the newest row to the conductor and do what it says; False where the programme is over."""
        conductor = self.conductor
        self.events += [(self.times_ns[-1], text) for text in conductor.marks]
        conductor.marks.clear()
        if conductor.run is None:
            return False
        before = conductor.state.phase
        if self.sailing is None:
            self._take_up(now_s)
        run = self.sailing
        assert run is not None
        instant = instant_of(self.times_ns[-1], self.rows[-1], self.vessel.actuators)
        for call in conductor.advance(instant):
            run.calls.append(call)
            run.called_s.append(now_s)
            self._answer(call, run, now_s)
        self._misbehave(run, now_s, state)
        if run.orders_s and conductor.state.phase == "approach" and now_s - run.orders_s[0] > UNSEEN_S:
            self.unseen += 1  # the conductor still waits for a steady approach: they begin it again
            run.orders_s, run.fault, self.bridge.pending = [], "", []
            self.bridge.order(now_s, None)
        if conductor.state.phase == "ended" and before != "ended":
            self.bridge.order(now_s + 3.0 if run.planned.kind != "pull_out" else now_s, None)
        if conductor.verdict_is_due(self.times_ns[-1]):
            first = max(0, len(self.rows) - round(LONGEST_S * self.rows_per_s))
            conductor.judge(self.table(first), CONDITIONS)
            self._stand_down(now_s)
            self._consider()
        elif now_s - self.waited_s > 7200.0 or (run.orders_s and now_s - run.orders_s[0] > 5400.0):
            conductor.abort("it took too long")
            run.aborted = True
            self._stand_down(now_s)
        return True

    def _consider(self) -> None:
        """What those on the bridge do between two runs beside what the conductor says: nothing."""

    def _take_up(self, now_s: float) -> None:
        """Take up the next run, with a fault or without."""
        planned = self.conductor.run
        assert planned is not None
        fault = ""
        if self.faults and self.random.random() < FAULT_SHARE:
            possible = [name for name in FAULTS if planned.kind == "zigzag" or name not in ("late reversals",)]
            if planned.kind == "stopping":
                possible = ["early order", "gust", "gyro lost"]
            fault = str(self.random.choice(possible))
        self.sailing = TrueRun(planned, fault, self.conductor.number)
        self.runs.append(self.sailing)
        self.waited_s = now_s
        self.bridge.course_deg = planned.heading_deg or 0.0
        self.share = self.programme.speed_mps(planned) / self.programme.programme.speed_mps
        self.bridge.order(now_s, None, self.share)

    def _stand_down(self, now_s: float) -> None:
        self.bridge.order(now_s, None)
        self.gust = self.gyro = (np.inf, np.inf)
        self.sailing = None

    def _delay_s(self) -> float:
        return float(self.random.uniform(0.0, 0.8))

    def _answer(self, call: Call, run: TrueRun, now_s: float) -> None:
        """Do what is called, after the delay of a person."""
        planned, due_s = run.planned, (call.due_ns - START.value) / NANO
        helm = planned.helm_deg or 0.0
        if call.kind == "ready" and not run.orders_s:
            self._execute(run, now_s + float(self.random.uniform(1.0, 6.0)))
        elif call.kind in ("reverse", "amidships"):
            late_s = (
                float(self.random.uniform(0.25, 0.5)) * self.programme.length_s * 1.2
                if run.fault == "late reversals"
                else 0.0
            )
            at_s = max(due_s, now_s) + self._delay_s() * min(1.0, self.programme.length_s / 10.0) + late_s
            side = planned.sign * (-1.0 if run.fault == "wrong side" else 1.0)
            angle = helm * (0.75 if run.fault == "other helm" else 1.0)
            angle *= side * (-1.0) ** len(run.orders_s) * (call.kind == "reverse")
            run.orders_s.append(_step_after(at_s))
            self.bridge.order(at_s, angle, self.share)
        elif call.kind == "end":
            self.bridge.order(
                now_s + self._delay_s(),
                0.0 if planned.kind != "stopping" else None,
                0.0 if planned.kind == "stopping" else 1.0,
            )

    def _execute(self, run: TrueRun, at_s: float) -> None:
        planned = run.planned
        side = planned.sign * (-1.0 if run.fault == "wrong side" else 1.0)
        angle = (planned.helm_deg or 0.0) * (0.75 if run.fault == "other helm" else 1.0) * side
        run.orders_s.append(_step_after(at_s))
        if planned.kind == "stopping":
            self.bridge.order(at_s, 0.0, -0.7)
        else:
            self.bridge.order(at_s, angle if planned.helm_deg else None, self.share)
        total_s = 60.0 * self.programme.minutes_of(planned)
        if run.fault == "released":
            self.bridge.order(at_s + 0.25 * total_s, 0.0)
        if run.fault == "gust":
            self.gust = (at_s - 20.0, at_s + 1.3 * total_s)
        if run.fault == "gyro lost":
            begin = at_s + float(self.random.uniform(0.1, 0.5)) * total_s
            self.gyro = (begin, begin + 120.0)

    def _misbehave(self, run: TrueRun, now_s: float, state: Floats) -> None:
        """The order before the approach is steady: while the ship still turns, or gathers way."""
        if run.fault != "early order" or run.orders_s:
            return
        off = abs(float(ships.angle_difference(np.rad2deg(state[2]), run.planned.heading_deg or 0.0)))
        rate = abs(np.rad2deg(state[5])) * self.programme.length_s
        if off < 6.0 and rate > 2.5 and now_s - self.waited_s > 30.0:
            self._execute(run, now_s + 1.0)


# the truth


def true_shortfalls(day: Day, run: TrueRun, entry: SailedRun, factor: float = 1.0) -> list[str]:
    """What is wrong with a run by the definitions, off the noise-free track, with a factor on the tolerances."""
    if not run.orders_s:
        return ["no order"]
    planned, programme = run.planned, day.programme
    at, end = (round(moment / STEP_S) for moment in (run.orders_s[0], (entry.ended_ns - START.value) / NANO))
    ten = round(10.0 / STEP_S)
    heading, speed = np.rad2deg(day.states[:, 2]), np.hypot(day.states[:, 3], day.states[:, 4])
    time_s = STEP_S * np.arange(heading.size)
    before = slice(max(0, at - ten), at)
    length_s = programme.programme.length_m / speed[before].mean()
    turned = abs(np.polyfit(time_s[before], heading[before], 1)[0]) * length_s
    gained = abs(np.polyfit(time_s[before], speed[before], 1)[0]) * length_s / speed[before].mean()
    wrong = []
    if turned > 2.0 * factor or gained > 0.05 * factor:
        wrong.append(f"approach not steady: {turned:.2f} deg, {gained:.1%}")
    if speed[before].mean() < (1.0 - 0.1 * factor) * programme.speed_mps(planned):
        wrong.append("approach slow")
    missing = np.isnan(
        [
            row.get("heading_deg", np.nan)
            for row in day.rows[round(at * STEP_S * day.rows_per_s) : round(end * STEP_S * day.rows_per_s)]
        ]
    )
    if missing.sum() > 60 * day.rows_per_s or missing.mean() > 0.1:
        wrong.append(f"heading missing in {missing.mean():.0%}")
    wind = beaufort_number(float(day.air[at:end, 1].mean()))
    if wind > planned.most_beaufort:
        wrong.append(f"force {wind}")
    if planned.kind not in ("zigzag", "turning_circle"):
        return wrong
    helms = day.orders[at + 1 : end, 0]
    if np.sign(helms[0]) != planned.sign:
        wrong.append("wrong side")
    last = max(1, (round(run.orders_s[-1] / STEP_S) if planned.kind == "zigzag" else end) - at)
    over = np.abs(helms[:last]) > 0.5 * (planned.helm_deg or 0.0)
    let_go_s = STEP_S * max((stop - first for first, stop in runs_of_true(~over)), default=0)
    if over.mean() < 0.85 or (planned.kind == "zigzag" and let_go_s > factor * max(2.0, 0.2 * length_s)):
        wrong.append(f"helm let go for {let_go_s:.1f} s")
    held = np.abs(helms[np.abs(helms) > 0.5 * (planned.helm_deg or 0.0)])
    share = factor * (0.05 if planned.kind == "turning_circle" else 0.1)
    if abs(np.median(held) / (planned.helm_deg or 1.0) - 1.0) > share:
        wrong.append(f"helm {np.median(held):.1f}")
    if planned.kind == "turning_circle":
        turn = abs(heading[min(end, heading.size - 1)] - heading[at])
        if turn < 350.0:
            wrong.append(f"turned {turn:.0f}")
        return wrong
    reversals = [round(moment / STEP_S) for moment in run.orders_s[1:] if moment / STEP_S < heading.size]
    changes = np.abs(np.diff(heading[[at, *reversals]]))
    if len(reversals) < 2:
        return [*wrong, "fewer than three swings"]
    switch = float(np.median(changes[1:])) / 2.0 if changes.size > 1 else float(changes[0])
    wanted_deg = planned.switch_deg or 1.0
    half_sample_deg = 0.5 / day.rows_per_s * float(np.abs(np.rad2deg(day.states[at:end, 5])).max())
    if abs(switch - wanted_deg) > 0.1 * factor * wanted_deg + np.sign(factor - 1.0) * half_sample_deg:
        wrong.append(f"switch {switch:.1f}")
    return wrong


def call_errors_s(day: Day, run: TrueRun) -> list[tuple[str, float]]:
    """How late each reversal and end was due against the moment at which the true heading was there."""
    if not run.orders_s or run.planned.kind not in ("zigzag", "turning_circle"):
        return []
    heading = np.rad2deg(day.states[:, 2])
    time_s = STEP_S * np.arange(heading.size)
    order_s = run.orders_s[0]
    base = float(heading[(time_s >= order_s - 10.0) & (time_s < order_s)].mean())
    side = np.sign(np.interp(order_s + 2.0, time_s, day.orders[:, 0]))
    errors, last_s, swing = [], order_s, 0
    for call in run.calls:
        if call.kind not in ("reverse", "end"):
            continue
        towards = side * (-1.0) ** swing
        level = (
            run.planned.turn_deg
            if run.planned.kind == "turning_circle"
            else (run.planned.switch_deg if call.kind == "reverse" else 0.0)
        )
        due_s = (call.due_ns - START.value) / NANO
        if call.text == "the helm was released":
            break
        after = np.flatnonzero((time_s > max(last_s, due_s - 30.0)) & (towards * (heading - base) >= level))
        if after.size:
            row = int(after[0])
            errors.append(
                (
                    call.kind,
                    due_s
                    - float(
                        np.interp(level, towards * (heading[row - 1 : row + 1] - base), time_s[row - 1 : row + 1])
                    ),
                )
            )
        last_s, swing = due_s, swing + 1
    return errors


def index_differences(day: Day) -> list[tuple[str, float]]:
    """By index, how far what was shown aboard lies from what the whole day gives, in half intervals."""
    ashore = find_manoeuvres(day.table(), day.programme.programme.length_m, day.events, conditions=CONDITIONS)
    differences = []
    for entry in day.conductor.sailed:
        run = entry.manoeuvre
        if run is None:
            continue
        same = [
            other
            for other in ashore
            if other.kind == run.kind and abs((other.start - run.start).total_seconds()) < 5.0
        ]
        if not same:
            differences.append(("not found ashore", np.inf))
            continue
        for name, index in run.indices.items():
            other = same[0].indices.get(name)
            half = max(0.5 * (index.high - index.low), 1e-9)
            differences.append((name, abs(other.value - index.value) / half if other else np.inf))
    return differences


@dataclass
class Score:
    """What became of all runs."""

    runs: int = 0
    on_limit: int = 0
    unseen: int = 0
    invalid: int = 0
    recognised: int = 0
    valid: int = 0
    refused: int = 0
    calls_s: list[float] = field(default_factory=list)
    differences: list[tuple[str, float]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def add(self, day: Day, name: str) -> None:
        """Add a day."""
        for run in day.runs:
            entry = next((sailed for sailed in day.conductor.sailed if sailed.number == run.number), None)
            if entry is None:
                continue
            self.runs += 1
            errors = call_errors_s(day, run)
            self.calls_s += [error for _, error in errors]
            label = f"{name} run {run.number} {run.planned.sided_name}, {run.fault or 'no fault'}"
            self.lines += [f"{label}: {kind} called {error:+.2f} s" for kind, error in errors if abs(error) > 1.0]
            wrong = ["given up"] if run.aborted else true_shortfalls(day, run, entry)
            if not run.aborted and bool(true_shortfalls(day, run, entry, 1.0 - SLACK)) != bool(
                true_shortfalls(day, run, entry, 1.0 + SLACK)
            ):
                self.on_limit += 1
                continue
            if wrong:
                self.invalid += 1
                self.recognised += entry.outcome != "valid"
            else:
                self.valid += 1
                self.refused += entry.outcome != "valid"
            if bool(wrong) != (entry.outcome != "valid"):
                self.lines.append(f"{label}: {entry.outcome} {entry.reasons}, truth {wrong}")
        self.differences += index_differences(day)
        self.unseen += day.unseen

    def __add__(self, other: Score) -> Score:
        """Both together."""
        return Score(*(getattr(self, entry.name) + getattr(other, entry.name) for entry in fields(Score)))

    def __str__(self) -> str:
        calls = np.abs(self.calls_s) if self.calls_s else np.array([np.nan])
        apart = np.array([difference for _, difference in self.differences])
        return (
            f"{self.runs} runs, {self.on_limit} of them within a tenth of a tolerance of its limit, "
            f"{self.unseen} orders given while the approach was not accepted; "
            f"{self.recognised} of {self.invalid} invalid recognised before the next, "
            f"{self.refused} of {self.valid} valid called invalid; {calls.size} calls, "
            f"{np.mean(calls <= 1.0):.1%} within 1 s, largest {calls.max():.2f} s; {apart.size} indices, "
            f"{np.mean(apart < 1e-6):.1%} equal ashore"
        )


def main() -> None:
    """Sail the days and print what was missed."""
    parser = argparse.ArgumentParser(prog="conducted_days", description=__doc__)
    parser.add_argument("--days", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--ships", nargs="*", default=["tanker", "gunnerus", "twin_screw"])
    options, total = parser.parse_args(), Score()
    for name in options.ships:
        score = Score()
        for seed in range(options.first, options.first + options.days):
            began_s = time.perf_counter()
            day = Day(name, seed)
            score.add(day, f"{name} {seed}")
            hours, took_s = day.states.shape[0] * STEP_S / 3600.0, time.perf_counter() - began_s
            print(
                f"{name} {seed}: {hours:.1f} h in {took_s:.0f} s; so far {score}",
                *score.lines,
                sep="\n    ",
                flush=True,
            )
        total += score
    print(f"all: {total}")


if __name__ == "__main__":
    main()
