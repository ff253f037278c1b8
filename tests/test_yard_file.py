"""A yard's file, imported as it is: a ship of 180 m with a slow rudder in a current, by a model that is not ours.

The ship is Nomoto's first order with a cubic damping, drift and loss of speed in proportion to the rate of turn.
The file has semicolons, decimal commas, knots, date and time in columns of their own, and German heads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from tests.conftest import Command

LENGTH_M, APPROACH_MPS, STEP_S = 180.0, 7.72, 0.1
GAIN_PER_S, LAG_S, STEADY_RADPS = 0.05, 40.0, math.radians(0.75)
CUBIC = (GAIN_PER_S * math.radians(35.0) - STEADY_RADPS) / STEADY_RADPS**3
RUDDER_DPS, NORTH_MPS, EAST_MPS = 2.5, 0.25, -0.35


@dataclass
class Yard:
    """The ship on trial; each row: north, east [m], heading [deg], speeds to north, east [m/s], rudder [deg].

    All over ground, ``water`` is where she is through the water.
    """

    heading: float = math.radians(40.0)
    rate: float = 0.0
    speed: float = APPROACH_MPS
    rudder_deg: float = 0.0
    water: tuple[float, float] = (0.0, 0.0)
    rows: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def heading_deg(self) -> float:
        return math.degrees(self.heading)

    def step(self, order_deg: float) -> None:
        most = RUDDER_DPS * STEP_S
        self.rudder_deg += min(most, max(-most, order_deg - self.rudder_deg))
        moment = GAIN_PER_S * math.radians(self.rudder_deg) - self.rate - CUBIC * self.rate**3
        self.rate += moment / LAG_S * STEP_S
        self.heading += self.rate * STEP_S
        wanted = APPROACH_MPS * (1.0 - 0.5 * min(1.0, abs(self.rate) / STEADY_RADPS))
        self.speed += (wanted - self.speed) / 60.0 * STEP_S
        aside = -0.45 * LENGTH_M * self.rate
        north = self.speed * math.cos(self.heading) - aside * math.sin(self.heading)
        east = self.speed * math.sin(self.heading) + aside * math.cos(self.heading)
        self.water = (self.water[0] + north * STEP_S, self.water[1] + east * STEP_S)
        seconds = (len(self.rows) + 1) * STEP_S
        over_ground = (self.water[0] + NORTH_MPS * seconds, self.water[1] + EAST_MPS * seconds)
        speeds = (north + NORTH_MPS, east + EAST_MPS)
        self.rows.append((*over_ground, self.heading_deg, *speeds, self.rudder_deg))

    def keep(self, heading_deg: float, seconds: float) -> None:
        """An autopilot's straight run."""
        for _ in range(round(seconds / STEP_S)):
            off = (heading_deg - self.heading_deg + 180.0) % 360.0 - 180.0
            self.step(min(10.0, max(-10.0, off - 25.0 * math.degrees(self.rate))))

    def zigzag(self, degrees: float, swings: int) -> list[float]:
        """A zigzag, and its overshoots beyond the heading at which the rudder was ordered over [deg]."""
        start, side, found = self.heading_deg, 1.0, []
        while side * (self.heading_deg - start) < degrees:
            self.step(side * degrees)
        for _ in range(swings):
            most = 0.0
            while -side * (self.heading_deg - start) < degrees:
                self.step(-side * degrees)
                most = max(most, side * (self.heading_deg - start))
            found.append(most - degrees)
            side = -side
        return found

    def circle(self, order_deg: float, degrees: float) -> float:
        """A turning circle; its tactical diameter through the water from where the rudder was ordered [m]."""
        start, course, (north, east) = self.heading_deg, self.heading, self.water
        diameter = math.nan
        while self.heading_deg - start < degrees:
            self.step(order_deg)
            if math.isnan(diameter) and self.heading_deg - start >= 180.0:
                moved = (self.water[0] - north, self.water[1] - east)
                diameter = moved[1] * math.cos(course) - moved[0] * math.sin(course)
        return diameter


def write_table(rows: np.ndarray, path: Path) -> None:
    """The rows once a second as the yard's logger writes them, with its noise."""
    chance = np.random.default_rng(5)
    north, east, heading, north_mps, east_mps, rudder = rows[:: round(1.0 / STEP_S)].T
    latitude = 54.32 + (north + chance.normal(0.0, 0.6, north.size)) / 111_312.6
    middle = np.deg2rad(latitude)
    a_degree = 111_412.88 * np.cos(middle) - 93.5 * np.cos(3.0 * middle) + 0.118 * np.cos(5.0 * middle)
    time = pd.Timestamp("2026-03-14 09:12:00") + pd.to_timedelta(np.arange(north.size), unit="s")
    columns = {
        "Datum": time.strftime("%d.%m.%Y"),
        "Uhrzeit (UTC)": time.strftime("%H:%M:%S"),
        "Breite [°]": latitude.round(6),
        "Länge [°]": (10.65 + (east + chance.normal(0.0, 0.6, north.size)) / a_degree).round(6),
        "Kurs rw [°]": ((heading + chance.normal(0.0, 0.08, north.size)) % 360.0).round(1),
        "FüG [kn]": (np.hypot(north_mps, east_mps) / 0.514444).round(1),
        "KüG [°]": (np.rad2deg(np.arctan2(east_mps, north_mps)) % 360.0).round(1),
        "Ruderlage [°]": (rudder + chance.normal(0.0, 0.1, north.size)).round(1),
        "Drehzahl [1/min]": (92.0 + chance.normal(0.0, 0.3, north.size)).round(1),
    }
    pd.DataFrame(columns).to_csv(path, sep=";", decimal=",", index=False, encoding="latin-1")


def test_a_yards_file_gives_circle_zigzags_overshoots_and_limits(tmp_path: Path, command: Command) -> None:
    yard = Yard()
    yard.keep(40.0, 180.0)
    tactical_m = yard.circle(35.0, 560.0)
    yard.keep(220.0, 500.0)
    overshoots = {"10/10": yard.zigzag(10.0, 4)}
    yard.keep(220.0, 400.0)
    overshoots["20/20"] = yard.zigzag(20.0, 4)
    yard.keep(220.0, 100.0)
    write_table(np.array(yard.rows), tmp_path / "probefahrt.csv")

    recording = tmp_path / "trial.mcap"
    for _ in range(2):  # the map that it writes for next time is in nobody's way
        recording.unlink(missing_ok=True)
        done = command("import", tmp_path / "probefahrt.csv", "-o", recording, "--yes")
        assert done.code == 0, done.err
    found = st.manoeuvres(recording, LENGTH_M)
    turns = found[found["kind"].isin(["turning_circle", "zigzag"])].set_index("index")
    assert list(turns["manoeuvre"].unique()) == ["turning circle 35 deg", "zigzag 10/10", "zigzag 20/20"]
    assert set(turns["side"]) == {"starboard"}

    circle = turns[turns["kind"] == "turning_circle"]
    assert circle.loc["tactical_diameter_m_current_removed", "value"] == pytest.approx(tactical_m, rel=0.005)
    assert circle.loc["tactical_diameter_m", "limit"] == pytest.approx(5.0 * LENGTH_M)
    assert circle.loc["advance_m", "limit"] == pytest.approx(4.5 * LENGTH_M)

    rounding_deg = 0.15  # a tenth of a degree in the table, and a helm whose order is known to a tenth of a second
    for name, told in overshoots.items():
        zigzag = turns[turns["manoeuvre"] == f"zigzag {name}"]
        for number, overshoot in enumerate(told[:2], 1):
            index = zigzag.loc[f"overshoot_{number}_from_order_deg"]
            assert index["low"] - rounding_deg <= overshoot <= index["high"] + rounding_deg
    seconds = LENGTH_M / APPROACH_MPS  # IMO MSC.137(76), 5.3.3, between 10 and 30 s
    limits = {"10/10": 5.0 + 0.5 * seconds, "20/20": 25.0}
    for name, limit in limits.items():
        zigzag = turns[turns["manoeuvre"] == f"zigzag {name}"]
        assert zigzag.loc["overshoot_1_from_order_deg", "limit"] == pytest.approx(limit, rel=0.01)
