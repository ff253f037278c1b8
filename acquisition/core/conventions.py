"""In which units, senses and axes headings and speeds may be recorded, and which of these the track agrees with.

Import and check compare the same conventions, so that neither reports a channel without having compared the
others. A heading is compared by the drift angle that each convention gives, the direction of the moves from
instant to instant less the heading: the right convention leaves the drift of a ship, a wrong one an angle that
changes as the ship turns. Speeds are compared by the moves that they make in each pair of axes. A convention is
named where it explains most of the turns and the others much less; a ship that hardly moves or turns, or that
drifts with wind and current, gives no evidence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seatrial.acquisition.core.quantities import Complexes, Floats
from seatrial.acquisition.core.ship import angle_difference, circular_mean

ANGLE_UNITS = {"deg": "degrees", "rad": "radians", "ddeg": "tenths of a degree", "cdeg": "hundredths of a degree"}
"""The units that a heading or course may be in, in words."""


@dataclass(frozen=True, slots=True)
class HeadingConvention:
    """A zero and a sense of headings: ``heading_deg = scale * recorded + offset_deg``.

    ``mirrored`` states which fault of the positions would look the same.
    """

    name: str
    words: str
    scale: float = -1.0
    offset_deg: float = 0.0
    mirrored: str = ""


CLOCKWISE = HeadingConvention("clockwise", "clockwise from north", 1.0)
ANTICLOCKWISE = HeadingConvention(
    "anticlockwise",
    "anticlockwise from north",
    mirrored="their east counts to the west, as longitudes of the west without their sign do",
)
FROM_EAST = HeadingConvention(
    "from_east",
    "anticlockwise from east, as yaw in ENU axes (ROS)",
    offset_deg=90.0,
    mirrored="their north and east, or latitude and longitude, are exchanged",
)
FROM_SOUTH = HeadingConvention(
    "from_south",
    "anticlockwise from south",
    offset_deg=180.0,
    mirrored="their north counts to the south, as latitudes of the south without their sign do",
)
HEADINGS = (CLOCKWISE, ANTICLOCKWISE, FROM_EAST, FROM_SOUTH)
"""The conventions of headings that are compared, ours first."""

AXES = {
    "ship": "forward and to starboard",
    "north_east": "to north and to east",
    "east_north": "to east and to north",
    "east_south": "to east and, by the other sign, to north",  # x and y in ENU, with y taken for the port side
}
"""The axes in which two columns of speeds may be, in words, ours first."""

# Of 2,636 simulated valid motions (ships of 2 to 320 m in manoeuvres and seas, adrift, turning on the spot, astern,
# crabbing; records of 20 s and more, noise to 2 m) these limits name none; of 236 headings in each wrong convention
# they name two in three, the others being short of turns or hidden in noise, and none wrongly. A course that
# follows the heading with a delay, as every ship's does, reaches none of the ratios.
_FEWEST = 12
_LEAST_TURNED_DEG = 90.0
_FAR_DEG = 150.0  # a tidal stream turns as far in five hours
_LEAST_BACK_DEG = 45.0
_SWING_DEG = 10.0
_LEAST_COURSE = 0.004  # circular variance of the courses: a standard deviation of 5 degrees
_MOST_DRIFT = 0.1  # circular variance of the drift angle: a standard deviation of 26 degrees
_RIVAL_RATIO = 3.0  # times the variance, by all rival readings and by a constant heading
# A ship adrift that the noise of the fixes lets follow her heading by the other sense reaches 6.3 in 10,000 of
# them; half the headings that are recorded by that sense reach 60.
_OPPOSITE_RATIO = 10.0  # by a constant heading, where the sense is not the recorded one
_OTHER_SENSE_RATIO = 9.0
_MOST_OFF_DEG = 40.0  # the mean drift angle: of a ship that crabs
_FARTHEST = 3.0  # moves longer than this many medians are jumps, and count no more than that
_MOST_RESIDUAL = 0.02  # of the square of the moves, by speeds in their axes
_LEAST_RIVAL_RESIDUAL = 0.002  # by those in the rival axes: what a bow 3 degrees off them leaves
_FITTED_FRACTION = 0.8


@dataclass(frozen=True, slots=True)
class DriftAngleStatistics:
    """The drift angle by one reading of the heading: circular variance (0 to 1) and mean [deg]."""

    variance: float
    mean_deg: float

    @property
    def spread_deg(self) -> float:
        """The circular standard deviation [deg] (Mardia and Jupp, Directional Statistics, 2000, eq. 2.3.14)."""
        return float(np.rad2deg(np.sqrt(-2.0 * np.log(max(1.0 - self.variance, 1e-9)))))


def drift_angle_statistics(moves: Complexes, heading_deg: Floats) -> DriftAngleStatistics:
    """The drift angle of moves [n] to north + i east, weighed by their length, beside headings [n]."""
    length = np.abs(moves)
    moving = np.isfinite(length) & np.isfinite(heading_deg) & (length > 0.0)
    if not moving.any():
        return DriftAngleStatistics(1.0, 0.0)
    weight = np.minimum(length[moving], _FARTHEST * np.median(length[moving]))
    angles = np.angle(moves[moving]) - np.deg2rad(heading_deg[moving])
    resultant = np.sum(weight * np.exp(1j * angles)) / weight.sum()
    return DriftAngleStatistics(float(1.0 - abs(resultant)), float(np.rad2deg(np.angle(resultant))))


@dataclass(frozen=True, slots=True)
class HeadingVerdict:
    """What the track shows of a heading: its unit and convention, and the drift angles of the recorded and the best
    reading. Nothing is decided where ``unit`` is empty; where only ``convention`` is None, the heading turns as the
    track does, but its zero is none of the conventions'."""

    unit: str
    convention: HeadingConvention | None
    recorded: DriftAngleStatistics
    best: DriftAngleStatistics

    @property
    def evidence(self) -> str:
        """The two drift angles in words."""
        return (
            f"the drift angle then varies by {self.best.spread_deg:.0f} deg, as recorded by"
            f" {self.recorded.spread_deg:.0f} deg"
        )


def find_heading_convention(
    moves: Complexes, readings: Mapping[str, Floats], recorded: str = "deg"
) -> HeadingVerdict:
    """Which unit and convention of a heading the track agrees with.

    Parameters
    ----------
    moves
        The ship's moves from instant to instant [n, m], north + i east.
    readings
        The mean heading during each move [n, deg], not wrapped, by the unit that the recorded numbers may be in.
    recorded
        The unit that is taken without evidence.

    Returns
    -------
    HeadingVerdict
        Without a unit where the moves do not decide.
    """
    as_recorded = drift_angle_statistics(moves, readings[recorded])
    undecided = HeadingVerdict("", None, as_recorded, as_recorded)
    sensed = {
        (unit, sense): drift_angle_statistics(moves, sense * angles)
        for unit, angles in readings.items()
        for sense in (1.0, -1.0)
    }
    unit, sense = best = min(sensed, key=lambda candidate: sensed[candidate].variance)
    drift, constant = sensed[best], drift_angle_statistics(moves, np.zeros(moves.size))
    constant_ratio = _RIVAL_RATIO if sense > 0.0 else _OPPOSITE_RATIO
    rival_variances = [rival.variance for reading, rival in sensed.items() if reading != best]
    is_decided = (
        np.count_nonzero(np.abs(moves) > 0.0) >= _FEWEST
        and constant.variance > max(_LEAST_COURSE, constant_ratio * drift.variance)
        and drift.variance < _MOST_DRIFT
        and min(rival_variances) > _RIVAL_RATIO * drift.variance
        and sensed[unit, -sense].variance > _OTHER_SENSE_RATIO * drift.variance
    )
    if not is_decided:
        return undecided
    # A ship adrift and the stream that carries it may both turn slowly, as if one followed the other.
    turned, angles = total_turn_deg(readings[unit]), readings[unit][np.isfinite(readings[unit])]
    net = abs(float(angles[-1] - angles[0])) if angles.size else 0.0
    if turned < _LEAST_TURNED_DEG or (net < _FAR_DEG and turned - net < _LEAST_BACK_DEG):
        return undecided
    conventions = [convention for convention in HEADINGS if convention.scale == sense]
    off_deg = {
        convention: abs(float(angle_difference(drift.mean_deg, convention.offset_deg)))
        for convention in conventions
    }
    nearest = min(conventions, key=off_deg.__getitem__)
    return HeadingVerdict(unit, nearest if off_deg[nearest] < _MOST_OFF_DEG else None, as_recorded, drift)


def total_turn_deg(heading_deg: Floats) -> float:
    """How far a heading [n, deg], not wrapped, turned to both sides, in swings of 10 deg and more."""
    angles = heading_deg[np.isfinite(heading_deg)]
    turned, last = 0.0, float(angles[0]) if angles.size else 0.0
    for angle in angles.tolist():
        if abs(angle - last) >= _SWING_DEG:
            turned, last = turned + abs(angle - last), angle
    return turned


def heading_conventions_along_course(moves: Complexes, heading_deg: Floats) -> tuple[HeadingConvention, ...]:
    """The conventions by which a ship on a straight course moves along its heading, where it does not as recorded.

    A straight course does not show the sense; ours is not among them, and none is where the ship moves along it.
    """
    drift = drift_angle_statistics(moves, heading_deg)
    if drift.variance > _LEAST_COURSE or abs(drift.mean_deg) < _MOST_OFF_DEG:
        return ()
    mean = circular_mean(heading_deg)
    return tuple(
        convention
        for convention in HEADINGS[1:]
        if abs(
            drift_angle_statistics(
                moves, np.full(moves.size, convention.scale * mean + convention.offset_deg)
            ).mean_deg
        )
        < _SWING_DEG
    )


@dataclass(frozen=True, slots=True)
class AxesFit:
    """How moves follow from speeds in one pair of axes: the factor to multiply these by, and the fraction of the
    square of the moves that remains as residual."""

    factor: float
    residual: float


def find_velocity_axes(moves: Complexes, travelled: Mapping[str, Complexes]) -> tuple[str, dict[str, AxesFit]]:
    """In which of :data:`AXES` two speeds are; empty where the track does not decide.

    ``travelled`` are the moves [n, m] that the speeds make in each. The factors are those of least squares, of the
    moves without the fifth that fits worst: jumps of the positions.
    """
    fits = {}
    for axes, speed_moves in travelled.items():
        fits[axes] = AxesFit(0.0, 1.0)
        valid = np.isfinite(moves) & np.isfinite(speed_moves)
        measured, predicted = moves[valid], speed_moves[valid]
        if measured.size < _FEWEST or not measured.any() or not predicted.any():
            continue
        residual = np.abs(measured - _least_squares_factor(measured, predicted) * predicted)
        fitted = residual <= np.quantile(residual, _FITTED_FRACTION)
        measured, predicted = measured[fitted], predicted[fitted]
        if measured.any() and predicted.any():
            factor = _least_squares_factor(measured, predicted)
            squares = np.sum(np.abs(measured - factor * predicted) ** 2), np.sum(np.abs(measured) ** 2)
            fits[axes] = AxesFit(factor, float(squares[0] / squares[1]))
    best = min(fits, key=lambda axes: fits[axes].residual)
    next_best = min(fit.residual for axes, fit in fits.items() if axes != best)
    residual_of_best = fits[best].residual
    is_decided = residual_of_best < _MOST_RESIDUAL and next_best > max(
        _LEAST_RIVAL_RESIDUAL, _OTHER_SENSE_RATIO * residual_of_best
    )
    return (best if is_decided and fits[best].factor > 0.0 else ""), fits


def keeps_its_course(moves: Complexes) -> bool:
    """Whether moves [n] are so much in one direction that a constant velocity leaves as little of them as the right
    one may."""
    return drift_angle_statistics(moves, np.zeros(moves.size)).variance < 2.0 * _MOST_RESIDUAL


def _least_squares_factor(moves: Complexes, travelled: Complexes) -> float:
    return float(np.real(np.vdot(travelled, moves)) / np.real(np.vdot(travelled, travelled)))
