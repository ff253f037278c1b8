"""Sound recordings of ships in waves, whose antennas and speed sensors stand somewhere on board: what is repaired?

Nothing may be. Ships of 25 to 200 m keep station, make way or manoeuvre in wind sea and swell from anywhere; they
surge, sway, yaw, roll and pitch, and heel in turns. The antenna stands high up and off the reference point, so
that rolling, pitching and heeling move it; speeds are those of the reference point or of another, as they are or
with the waves filtered out of them as a DP system does, and late by as much as the filter makes them. Prints each
trial in which anything is found but a lever arm, at the end how many a repair has changed that is not right:
``make benchmark-quality``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import bilinear, butter, lfilter, sosfilt

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seatrial.acquisition.core.quantities import GRAVITY_MPS2, Floats, to_earth
from seatrial.analysis.quality.check import check_table
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.repairs import repair_table
from seatrial.hybrid.simulation.trial import jonswap_spectrum, ornstein_uhlenbeck, simulate_trial

STEP_S = 0.1
_GUNNERUS_M = 31.25
_LEAD_S = 100.0
"""Before the recording begins, for filters to settle."""


@dataclass(frozen=True, slots=True)
class Board:
    """Where things are on board, forward, to starboard and up of the reference point [m]; the speeds' filter."""

    length_m: float
    antenna_m: Floats
    speed_sensor_m: Floats
    filter_hz: float | None
    """Below which speeds pass; None for all of them."""

    @property
    def late_s(self) -> float:
        """By how much the filter makes slow speeds late: a second-order Butterworth's group delay at 0 Hz."""
        return np.sqrt(2.0) / (2.0 * np.pi * self.filter_hz) if self.filter_hz else 0.0


@dataclass(frozen=True, slots=True)
class Waves:
    """Long-crested waves as components: amplitudes [m], frequencies [rad/s], phases [rad]; where they go [rad]."""

    amplitude_m: Floats
    frequency_radps: Floats
    phase_rad: Floats
    to_rad: float


def drawn_waves(generator: np.random.Generator, height_m: float, period_s: float) -> Waves:
    """A sea of that significant height and peak period, from anywhere, that does not repeat itself."""
    peak = 2.0 * np.pi / period_s
    even = np.linspace(0.6 * peak, 2.6 * peak, 60)
    spacing = float(even[1] - even[0])
    amplitude = np.sqrt(2.0 * jonswap_spectrum(even, height_m, period_s) * spacing)
    frequency = even + spacing * generator.uniform(-0.5, 0.5, even.size)
    return Waves(
        amplitude, frequency, generator.uniform(0.0, 2.0 * np.pi, even.size), generator.uniform(0, 2 * np.pi)
    )


def wave_motion(waves: Waves, board: Board, roll_s: float, pose: Floats, time_s: Floats) -> Floats:
    """Surge, sway [m], yaw, roll (starboard down) and pitch (bow up) [rad] by waves: [rows, 5].

    The ship follows the orbital motion averaged over her length, and the slope of the waves in roll as an
    oscillator of the natural period ``roll_s`` and a tenth of critical damping.
    """
    number = waves.frequency_radps**2 / GRAVITY_MPS2
    along = pose[:, 0] * np.cos(waves.to_rad) + pose[:, 1] * np.sin(waves.to_rad)
    angle = waves.to_rad - pose[:, 2]
    phase = np.outer(along, number) - np.outer(time_s, waves.frequency_radps) + waves.phase_rad
    averaged = np.sinc(0.5 * board.length_m * np.outer(np.cos(angle), number) / np.pi)
    orbit = -(np.sin(phase) * averaged) @ waves.amplitude_m
    ratio = waves.frequency_radps * roll_s / (2.0 * np.pi)
    answer = 1.0 / (1.0 - ratio**2 - 0.2j * ratio)
    slope = waves.amplitude_m * number
    rolled = ((-np.sin(phase) * answer.real - np.cos(phase) * answer.imag) * averaged) @ slope
    pitched = -(np.sin(phase) * averaged) @ slope
    yawed = (np.cos(phase) * averaged) @ slope
    return np.column_stack([
        orbit * np.cos(angle), orbit * np.sin(angle), 0.3 * yawed * np.sin(2.0 * angle),
        rolled * np.sin(angle), pitched * np.cos(angle),
    ])  # fmt: skip


def heel(pose: Floats, roll_s: float, leverage: float) -> Floats:
    """The angle of heel by turning (starboard down) [rad]: outward by ``leverage`` times the centripetal
    acceleration over gravity, as an oscillator of the natural period ``roll_s`` follows it.

    The leverage of a displacement ship is the height of her mass over the middle of her draught, divided by GM.
    """
    velocity = np.gradient(pose[:, :2], STEP_S, axis=0)
    ahead, _ = to_earth(*velocity.T, -pose[:, 2])
    outward = -leverage * ahead * np.gradient(pose[:, 2], STEP_S) / GRAVITY_MPS2
    natural = 2.0 * np.pi / roll_s
    answer = bilinear([natural**2], [1.0, 0.6 * natural, natural**2], fs=1.0 / STEP_S)
    return np.asarray(lfilter(*answer, outward))


def slow(generator: np.random.Generator, rows: int, size: float, seconds: float) -> Floats:
    """A smooth random motion of that standard deviation and time constant: [rows]."""
    rough = ornstein_uhlenbeck(generator, rows, STEP_S, seconds)
    smooth = np.asarray(sosfilt(butter(2, 2.0 / seconds, fs=1.0 / STEP_S, output="sos"), rough))
    return size * smooth / smooth.std()


def keeping_station(generator: np.random.Generator, rows: int, length_m: float) -> Floats:
    """A ship held at a place, or moved by some metres now and then: pose [rows, 3]."""
    sizes, seconds = generator.uniform([0.2, 0.2, 0.005], [1.5, 1.5, 0.03]), generator.uniform(25.0, 60.0)
    pose = np.column_stack([slow(generator, rows, size, seconds) for size in sizes])
    for column, largest in enumerate((20.0, 20.0, 0.5) if generator.random() < 0.5 else ()):
        moves = generator.uniform(-largest, largest, rows // 6000 + 1)
        pose[:, column] += sosfilt(butter(2, 0.01, fs=1.0 / STEP_S, output="sos"), np.repeat(moves, 6000)[:rows])
    pose[:, 2] += generator.uniform(0.0, 2.0 * np.pi)
    return pose


def making_way(generator: np.random.Generator, rows: int, length_m: float) -> Floats:
    """A passage at an even speed with alterations of course: pose [rows, 3]."""
    heading = generator.uniform(0.0, 2.0 * np.pi) + slow(generator, rows, generator.uniform(0.02, 0.6), 60.0)
    ahead = generator.uniform(2.0, 7.0) + slow(generator, rows, generator.uniform(0.05, 0.5), 60.0)
    aside = slow(generator, rows, 0.1, 60.0)
    path = [STEP_S * np.cumsum(each) for each in to_earth(ahead, aside, heading)]
    return np.column_stack([*path, heading])


def manoeuvring(generator: np.random.Generator, rows: int, length_m: float) -> Floats:
    """The model of R/V Gunnerus in a manoeuvre on flat water, scaled to the length by Froude: pose [rows, 3]."""
    name = str(generator.choice(["zigzag_20_20", "zigzag_10_10", "turning_circle_20", "voyage"]))
    scale = length_m / _GUNNERUS_M
    step_s = STEP_S / np.sqrt(scale)
    seed = int(generator.integers(99))
    _, truth = simulate_trial("gunnerus_short", "calm", name, rows * step_s, 1.0 / step_s, seed)
    return np.asarray(truth["states"])[:rows, :3] * [scale, scale, 1.0]


Sailing = Callable[[np.random.Generator, int, float], Floats]
SAILING: tuple[Sailing, ...] = (keeping_station, making_way, manoeuvring)


def drawn_board(generator: np.random.Generator, length_m: float, *, filtered: bool) -> Board:
    """Antenna and speed sensor anywhere on a ship of that length."""
    antenna = length_m * generator.uniform([-0.4, -0.05, 0.1], [0.4, 0.05, 0.4])
    sensor = np.zeros(3) if generator.random() < 0.5 else length_m * generator.uniform(
        [-0.4, -0.05, -0.05], [0.4, 0.05, 0.2]
    )  # fmt: skip
    return Board(length_m, antenna, sensor, float(generator.uniform(0.05, 0.15)) if filtered else None)


def recorded(
    generator: np.random.Generator, board: Board, pose: Floats, waves: tuple[Waves, ...], rate_hz: float
) -> pd.DataFrame:
    """What is recorded of a slow motion ``pose`` [rows, 3] in waves, after the lead, as a table with noise."""
    time_s = STEP_S * np.arange(len(pose))
    roll_s = 2.0 * np.sqrt(board.length_m) * generator.uniform(0.5, 0.8)  # 6 to 9 s at 40 m, 11 to 17 s at 150 m
    moved = np.sum([wave_motion(each, board, roll_s, pose, time_s) for each in waves], axis=0)
    ahead, aside, yawed, rolled, pitched = moved.T
    rolled = rolled + heel(pose, roll_s, generator.uniform(0.5, 4.0))
    heading = pose[:, 2] + yawed
    point = pose[:, :2] + np.column_stack(to_earth(ahead, aside, heading))

    def place(arm: Floats) -> Floats:
        arms = arm[0] - arm[2] * pitched, arm[1] + arm[2] * rolled
        return np.asarray(point + np.column_stack(to_earth(*arms, heading)))

    velocity = np.gradient(place(board.speed_sensor_m), STEP_S, axis=0)
    body = np.column_stack(to_earth(*velocity.T, -heading))
    if board.filter_hz is not None:
        body = np.asarray(sosfilt(butter(2, board.filter_hz, fs=1.0 / STEP_S, output="sos"), body, axis=0))
    values = np.column_stack(
        [place(board.antenna_m), np.rad2deg(heading), body, np.rad2deg(np.gradient(heading, STEP_S))]
    )
    rows = slice(round(_LEAD_S / STEP_S), None, round(1.0 / (rate_hz * STEP_S)))
    noise = np.array([0.05, 0.05, 0.1, 0.03, 0.03, 0.05]) * float(
        np.exp(generator.uniform(np.log(0.3), np.log(2.0)))
    )
    values = values[rows] + noise * generator.standard_normal(values[rows].shape)
    values[:, 2] %= 360.0
    names = ["north_m", "east_m", "heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps"]
    index = pd.date_range("2026-06-01", periods=len(values), freq=pd.Timedelta(seconds=1.0 / rate_hz), tz="UTC")
    return pd.DataFrame(values, columns=names, index=index.rename("time"))


def drawn(number: int) -> tuple[pd.DataFrame, Board, str]:
    """A sound recording in waves with everything about it drawn by chance, the ship and what it is."""
    generator = np.random.default_rng((number, 3))
    sails = SAILING[number % len(SAILING)]
    filtered = sails is keeping_station and generator.random() < 0.5
    board = drawn_board(generator, float(np.exp(generator.uniform(np.log(25.0), np.log(200.0)))), filtered=filtered)
    seas = [(generator.uniform(0.5, 3.0), generator.uniform(5.0, 9.0))]
    if generator.random() < 0.5:
        seas.append((generator.uniform(0.5, 2.5), generator.uniform(10.0, 16.0)))
    duration_s, rate_hz = generator.uniform(900.0, 2400.0), float(generator.choice([1.0, 2.0, 5.0, 10.0]))
    pose = sails(generator, round((duration_s + _LEAD_S) / STEP_S), board.length_m)
    waves = tuple(drawn_waves(generator, *sea) for sea in seas)
    words = ", ".join(f"{height:.1f} m {period:.0f} s" for height, period in seas)
    what = (
        f"{number} {sails.__name__} {board.length_m:.0f} m, {words}, {rate_hz:g} Hz {duration_s:.0f} s"
        f", antenna {np.round(board.antenna_m, 1)}, speeds {np.round(board.speed_sensor_m, 1)}"
        f"{'' if board.filter_hz is None else f' filtered {board.filter_hz:.2f} Hz'}"
    )
    return recorded(generator, board, pose, waves, rate_hz), board, what


def is_due(finding: Finding, board: Board) -> bool:
    """Whether a finding tells of the ship as she is: a lever arm, or the delay of filtered speeds, to a quarter."""
    if finding.code != "channel_delay":
        return finding.code == "position_offset"
    late_s = finding.estimate["seconds"] * {"surge_mps": 1.0, "north_m": -1.0}.get(finding.channel, 0.0)
    return abs(late_s - board.late_s) < 0.25 * board.late_s


def judged(number: int) -> tuple[str, list[str], list[str]]:
    """What a trial is, what was found in it that is not there, and what was repaired of that."""
    table, board, what = drawn(number)
    quality = check_table(table)
    wrong = [each for each in quality.findings if not is_due(each, board)]
    repairs = repair_table(table, wrong, quality.flags).repairs
    return what, [each.text for each in wrong], [f"{each.code}: {each.text}" for each in repairs]


def main(trials: int) -> None:
    with ProcessPoolExecutor(2) as pool:
        results = list(pool.map(judged, range(trials)))
    for what, findings, repairs in results:
        if findings:
            print(what, *(f"    {each}" for each in findings), *(f"  * {each}" for each in repairs), sep="\n")
    repaired, found = (sum(bool(each[which]) for each in results) for which in (2, 1))
    print(f"sound trials in waves: {len(results)}, with a false finding {found}, with a false repair {repaired}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
