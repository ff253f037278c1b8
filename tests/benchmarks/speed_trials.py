"""Speed trials of ships of their own: does the 95 % interval of the speed at a power hold the truth?

    python -m tests.benchmarks.speed_trials --programmes 200 [--first 1000]

Nothing of ``seatrial.analysis.speed_power`` makes the trials. A ship is a resistance (friction line, form factor,
waves by a power of the Froude number) and a propeller with wake and thrust deduction that runs at a constant shaft
speed, so that its power differs between the courses; wind presses by Blendermann's curve, waves by Kreitner's
formula with a scatter, shallow water adds to the viscous resistance. The current is a tide with overtides and a
daily part, a constant and an irregular part, each programme with its own. What the crew writes down is the average
of each run with the errors of its instruments: a torque meter with a constant error of up to 1 %, an anemometer
that the ship disturbs, observed waves. The truth is the speed in still, deep water at the power that is reported. A
programme has 1 to 3 power settings with 1 to 3 double runs each; in 3 of 10 nobody observed the waves, 2 of 10 are
in shallow water. Half a minute for 200 programmes on one core.

The uncertainties of the analysis were set with programmes 0 to 299; those from 1000 on are for judging it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.speed_power.analysis import SpeedPower, speed_power_of_runs
from seatrial.analysis.speed_power.runs import runs_in_table

_RHO, _RHO_AIR, _G, _NU, _KNOT = 1026.0, 1.225, 9.81, 1.19e-6, 1852.0 / 3600.0
_MOON_S = 44_714.0


@dataclass
class Ship:
    """A ship by chance: dimensions, resistance and propeller."""

    random: np.random.Generator
    length_m: float = field(init=False)

    def __post_init__(self) -> None:
        draw = self.random.uniform
        self.length_m = draw(100.0, 330.0)
        self.beam_m = self.length_m / draw(5.6, 7.0)
        self.draught_m = self.beam_m / draw(2.4, 3.6)
        self.block = draw(0.58, 0.84)
        self.froude = 0.27 - 0.15 * self.block + draw(-0.01, 0.01) + 0.01
        self.volume_m3 = self.length_m * self.beam_m * self.draught_m * self.block
        self.wetted_m2 = 1.7 * self.length_m * self.draught_m + self.volume_m3 / self.draught_m
        self.form = draw(1.12, 1.30)
        self.steep = draw(3.5, 5.0)
        self.wave_share = draw(0.08, 0.3)
        self.wake, self.deduction = draw(0.2, 0.38), draw(0.15, 0.22)
        self.diameter_m = 0.68 * self.draught_m
        self.frontal_m2 = draw(0.5, 0.9) * self.beam_m**2
        self.head_drag, self.beam_drag, self.skew = draw(0.5, 0.95), draw(0.8, 1.0), draw(0.3, 0.7)

    @property
    def service_mps(self) -> float:
        return float(self.froude * np.sqrt(_G * self.length_m))

    def viscous_n(self, speed: float) -> float:
        friction = 0.075 / (np.log10(speed * self.length_m / _NU) - 2.0) ** 2 + 2e-4
        return float(0.5 * _RHO * self.wetted_m2 * speed**2 * self.form * friction)

    def resistance_n(self, speed: float) -> float:
        making = (
            self.wave_share * self.viscous_n(self.service_mps) * (speed / self.service_mps) ** (2.0 + self.steep)
        )
        return float(self.viscous_n(speed) + making)

    def thrust_n(self, rps: float, speed: float) -> float:
        ratio = (1.0 - self.wake) * speed / (rps * self.diameter_m)
        return float(_RHO * rps**2 * self.diameter_m**4 * (0.2931 - 0.2753 * ratio - 0.1385 * ratio**2))

    def shaft_kw(self, rps: float, speed: float) -> float:
        ratio = (1.0 - self.wake) * speed / (rps * self.diameter_m)
        torque = _RHO * rps**2 * self.diameter_m**5 * (0.0346 - 0.0279 * ratio - 0.0113 * ratio**2)
        return float(2e-3 * np.pi * rps * torque / 0.99)

    def rps_at(self, speed: float, added_n: float = 0.0) -> float:
        """The shaft speed that keeps a speed."""
        needed = (self.resistance_n(speed) + added_n) / (1.0 - self.deduction)
        least = (1.0 - self.wake) * speed / self.diameter_m / 0.9
        return float(brentq(lambda rps: self.thrust_n(rps, speed) - needed, least, 20.0 * least))

    def still_kw(self, speed: float) -> float:
        """The power in still, deep water."""
        return self.shaft_kw(self.rps_at(speed), speed)

    def still_mps(self, power_kw: float) -> float:
        """The speed in still, deep water."""
        service = self.service_mps
        return float(brentq(lambda speed: self.still_kw(speed) - power_kw, 0.3 * service, 1.5 * service))

    def speed_mps(self, rps: float, added_n: Callable[[float], float]) -> float:
        """The speed through the water at a shaft speed."""

        def spare(speed: float) -> float:
            return (1.0 - self.deduction) * self.thrust_n(rps, speed) - self.resistance_n(speed) - added_n(speed)

        return float(brentq(spare, 0.3 * self.service_mps, 1.5 * self.service_mps))

    def drag(self, angle: float) -> float:
        """Blendermann's coefficient of the longitudinal force, positive where the air brakes."""
        part = 1.0 - 0.5 * self.skew * self.head_drag / self.beam_drag * np.sin(2.0 * angle) ** 2
        return float(self.head_drag * np.cos(angle) / part)


def irregular(random: np.random.Generator, time_s: Floats, deviation: float, scale_s: float) -> Floats:
    """A Gauss-Markov process at times in order."""
    value, last, out = random.standard_normal(), time_s[0], []
    for now in time_s:
        kept = np.exp(-(now - last) / scale_s)
        value, last = kept * value + np.sqrt(1.0 - kept**2) * random.standard_normal(), now
        out.append(deviation * value)
    return np.array(out)


@dataclass
class Programme:
    """A programme of double runs: the table that the crew writes, what they know besides, and the truth."""

    seed: int

    def __post_init__(self) -> None:
        self.random = random = np.random.default_rng(self.seed)
        self.ship = ship = Ship(random)
        self.settings = int(random.integers(1, 4))
        self.double_runs = int(random.integers(1, 4))
        pairs = self.settings * self.double_runs
        shares = {1: [1.0], 2: [0.85, 1.0], 3: [0.75, 0.88, 1.0]}[self.settings]
        self.rps = np.repeat([ship.rps_at(share * ship.service_mps) for share in shares], 2 * self.double_runs)
        self.minutes = float(random.integers(10, 16))
        gaps = random.uniform(20.0, 40.0, 2 * pairs) + self.minutes
        self.time_s = 60.0 * np.concatenate([[0.0], np.cumsum(gaps)[:-1]])
        self.heading = (random.uniform(0.0, 360.0) + 180.0 * (np.arange(2 * pairs) % 2)) % 360.0
        self._make_sea()
        self._run()

    def _make_sea(self) -> None:
        random, ship, middle = self.random, self.ship, self.time_s + 30.0 * self.minutes
        omega = 2.0 * np.pi / _MOON_S
        tide = random.uniform(0.0, 0.8)
        phases = random.uniform(0.0, 2.0 * np.pi, 3)
        along = random.uniform(-0.3, 0.3) + tide * (
            np.cos(omega * middle + phases[0]) + random.uniform(0.0, 0.2) * np.cos(2.0 * omega * middle + phases[1])
            + random.uniform(0.0, 0.3) * np.cos(0.5 * omega * middle + phases[2])
        )  # fmt: skip
        along += irregular(random, middle, random.uniform(0.01, 0.06), random.uniform(1800.0, 7200.0))
        self.current = along * np.cos(np.deg2rad(self.heading - self.heading[0]))
        mean = random.uniform(0.0, 10.0)
        self.wind = mean * np.exp(irregular(random, middle, 0.12, 3600.0))
        self.wind_from = random.uniform(0.0, 360.0) + irregular(random, middle, 8.0, 3600.0)
        self.wave_m = 0.21 * mean**2 / _G * random.uniform(0.3, 1.0)
        self.period_s = max(2.5, 3.9 * np.sqrt(self.wave_m) * random.uniform(0.95, 1.3))
        self.wave_from = self.wind_from[0] + 15.0 * random.standard_normal()
        self.wave_factor = 0.75 * np.exp(0.25 * random.standard_normal())
        wide = np.sqrt(ship.beam_m * ship.draught_m)
        self.depth_m = (
            random.uniform(2.3, 3.0) * wide if random.random() < 0.2 else random.uniform(6.0, 15.0) * wide
        )
        self.shallow = 0.5 * np.exp(0.3 * random.standard_normal()) * (ship.draught_m / self.depth_m) ** 1.75

    def _added_n(self, run: int) -> Callable[[float], float]:
        """What wind, waves and the bottom add to the resistance of a run at a speed through the water."""
        ship, off = self.ship, np.deg2rad(self.wind_from[run] - self.heading[run])
        wave_off = np.deg2rad(self.wave_from - self.heading[run])
        ahead = max(float(np.cos(wave_off)), 0.0)
        waves = 0.64 * self.wave_m**2 * ship.beam_m**2 * ship.block * _RHO * _G / ship.length_m
        waves *= self.wave_factor * ahead

        def added(speed: float) -> float:
            relative = speed + self.current[run] + self.wind[run] * np.exp(1j * off)
            pressure = 0.5 * _RHO_AIR * ship.frontal_m2
            wind = ship.drag(float(np.angle(relative))) * abs(relative) ** 2
            still = ship.head_drag * speed**2
            return float(pressure * (wind - still) + waves + self.shallow * ship.viscous_n(speed))

        return added

    def _run(self) -> None:
        random, ship, count = self.random, self.ship, self.heading.size
        speed = np.array([ship.speed_mps(rps, self._added_n(run)) for run, rps in enumerate(self.rps)])
        power = np.array([ship.shaft_kw(*each) for each in zip(self.rps, speed, strict=True)])
        self.torque_error = random.uniform(-0.01, 0.01)
        over_ground = speed + self.current + 0.015 * random.standard_normal(count)
        measured = power * (1.0 + self.torque_error) * (1.0 + 0.004 * random.standard_normal(count))
        height = random.uniform(20.0, 45.0)
        aloft = self.wind * (height / 10.0) ** random.uniform(0.08, 0.16)
        head = np.exp(1j * np.deg2rad(self.heading))
        relative = aloft * np.exp(1j * np.deg2rad(self.wind_from)) + (speed + self.current) * head
        off = np.angle(relative / head)
        disturbed = 1.0 + 0.04 * random.standard_normal() + 0.06 * random.standard_normal() * np.cos(off)
        vane = np.rad2deg(off) + 3.0 * random.standard_normal()
        start = pd.Timestamp("2026-05-01 06:00", tz="UTC") + pd.to_timedelta(self.time_s.round(), unit="s")
        self.table = pd.DataFrame({
            "start": start.strftime("%Y-%m-%d %H:%M:%S"), "duration [min]": self.minutes,
            "heading [deg]": self.heading.round(1), "speed over ground [kn]": (over_ground / _KNOT).round(2),
            "shaft power [kW]": measured.round(), "shaft speed [rpm]": (60.0 * self.rps).round(2),
            "relative wind speed [m/s]": (np.abs(relative) * disturbed).round(1),
            "relative wind direction [deg]": (vane % 360.0).round(),
            "water depth [m]": round(self.depth_m),
        })  # fmt: skip
        self._make_conditions(height)

    def _make_conditions(self, anemometer_m: float) -> None:
        """What is known: the curve of a wind tunnel and the efficiency of a model test, each with its error."""
        random, ship = self.random, self.ship
        service = ship.service_mps
        scale, skew = 1.0 + 0.1 * random.standard_normal(), 0.05 * random.standard_normal()
        curve = [scale * ship.drag(angle) + skew * np.sin(angle) ** 2 for angle in np.linspace(0.0, np.pi, 19)]
        efficiency = 1e-3 * ship.resistance_n(0.93 * service) * 0.93 * service / ship.still_kw(0.93 * service)
        if random.random() < 0.7:
            self.table["wave height [m]"] = np.round(self.wave_m * (1.0 + 0.15 * random.standard_normal()), 1)
            self.table["wave direction [deg]"] = round((self.wave_from + 10.0 * random.standard_normal()) % 360.0)
            if random.random() < 0.5:
                self.table["wave period [s]"] = np.round(self.period_s * (1.0 + 0.1 * random.standard_normal()), 1)
        self.conditions = Conditions(
            length_m=ship.length_m, beam_m=ship.beam_m, draught_m=ship.draught_m, displacement_m3=ship.volume_m3,
            midship_section_m2=0.98 * ship.beam_m * ship.draught_m, frontal_area_m2=ship.frontal_m2,
            wind_resistance=tuple(map(float, curve)), anemometer_height_m=anemometer_m,
            bow_length_m=ship.length_m * (0.28 - 0.2 * (ship.block - 0.58)),
            propulsive_efficiency=efficiency * (1.0 + 0.02 * random.standard_normal()),
            load_variation=-0.1 if random.random() < 0.5 else 0.0,
        )  # fmt: skip

    def result(self) -> SpeedPower:
        read = runs_in_table(self.table)
        return speed_power_of_runs(read.runs, self.conditions.completed_from(read.conditions))


@dataclass(frozen=True)
class Row:
    """One setting of a programme by one method: error and half width [kn], whether the interval holds the truth."""

    programme: Programme
    method: str
    error_kn: float
    half_kn: float
    holds: bool
    is_highest: bool


def rows_of(programme: Programme) -> Iterator[Row]:
    settings = programme.result().settings
    for setting in settings:
        for method in ("iterative", "mean_of_means"):
            speed = getattr(setting, method)
            true = programme.ship.still_mps(speed.power_kw)
            yield Row(
                programme, method, (speed.speed_mps - true) / _KNOT,
                0.5 * (speed.high_mps - speed.low_mps) / _KNOT, bool(speed.low_mps <= true <= speed.high_mps),
                setting is settings[-1],
            )  # fmt: skip


def show(title: str, rows: list[Row]) -> None:
    error = np.array([row.error_kn for row in rows])
    half = np.array([row.half_kn for row in rows])
    stated = np.isfinite(half)
    inside = np.mean([row.holds for row in rows if np.isfinite(row.half_kn)])
    print(f"{title:34s} {stated.sum():5d} {inside:7.1%} {np.median(half[stated]):9.3f}"
          f" {np.sqrt(np.mean(error**2)):9.3f} {error.mean():+8.3f}")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programmes", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000, help="the first seed")
    asked = parser.parse_args()
    rows = [row for seed in range(asked.first, asked.first + asked.programmes) for row in rows_of(Programme(seed))]
    print(f"{'':34s} {'n':>5s} {'inside':>7s} {'half [kn]':>9s} {'rms [kn]':>9s} {'mean':>8s}")
    missing = {row.programme.seed for row in rows if not np.isfinite(row.half_kn)}
    print(f"programmes without an interval: {len(missing)}")
    for method in ("iterative", "mean_of_means"):
        every = [row for row in rows if row.method == method]
        show(method, every)
        show("  highest setting", [r for r in every if r.is_highest])
        for count in (1, 2, 3):
            show(f"  {count} double runs a setting", [r for r in every if r.programme.double_runs == count])
        for count in (1, 2, 3):
            show(f"  {count} settings", [r for r in every if r.programme.settings == count])
        show("  waves known", [r for r in every if "wave height [m]" in r.programme.table])
        show("  waves unknown", [r for r in every if "wave height [m]" not in r.programme.table])


if __name__ == "__main__":
    main()
