"""Whether the motion channels tell of one motion at all, before anything fine is fitted to them.

Positions and the path by heading and speeds are compared as complex moves (north + i east) over windows of ten
seconds: their ratio is a scale and an angle, free from minus to plus infinity, and so is the ratio of turns.
Signs and units that nothing fine could mend (a mirrored chart, sway to port, a heading in radians) are tried in
turn: the one that takes most of what is left away is named. Lever arms, delays and heel in turns are left room,
lest they pass for one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from seatrial.acquisition.core.conventions import AXES, HEADINGS
from seatrial.acquisition.core.quantities import KNOT_MPS, Complexes, Floats, Ints, integrate
from seatrial.acquisition.core.ship import difference
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.series import (
    GROUPS,
    STEP_S,
    CleanMotion,
    block_starts,
    group_samples,
    outliers,
)
from seatrial.analysis.tables.table import require, span_of

_WINDOW_S = 10.0
_LONG_S = 60.0
_FEWEST_WINDOWS = 12
_FEWEST_LONG = 6
_ROUNDS = 15
_KEPT = 0.8  # of the windows: the rest may hold jumps
_AGREES = 0.5  # of the moves may be left over where a ratio is believed
_FAR = 0.25  # from which a ratio or an angle [rad] is beyond what the fine fit starts from
_REMOVED = 0.5  # of what is left that a sign or unit must take away to be named
_LIKELIER = 10.0  # logarithm of the ratio of likelihoods
_LEAST_LEFT = 0.01
_CONTRADICTED = 0.2
_LEAST_MOVE_M = 10.0  # in a minute: positions of a ship that lies still wander by less
_BEYOND_NOISE = 6.0
_NEAR_ONE = 0.05
_NEAR_DEG = 30.0  # between two conventions there are 90
_UNEXPLAINED = "no sign and no unit that was tried explains it"
_SPEED_UNITS = {"knots": KNOT_MPS, "km/h": 1.0 / 3.6}
_FULL_TURN_RAD_IN_DEG = np.deg2rad(2.0 * np.pi) * 1.001


@dataclass(frozen=True, slots=True)
class Coarse:
    """Start of the fine fit: ``speed_factor`` and ``yaw_rate_factor`` to multiply by, ``heading_offset_rad``
    to subtract; the contradiction in words, its channel, and the share ``unexplained`` of the moves [-]."""

    speed_factor: float = 1.0
    heading_offset_rad: float = 0.0
    yaw_rate_factor: float = 1.0
    contradiction: str = ""
    channel: str = ""
    unexplained: float = 0.0

    @property
    def is_explained(self) -> bool:
        """Whether a sign or a unit removes the contradiction."""
        return bool(self.contradiction) and self.contradiction != _UNEXPLAINED

    @property
    def neutral(self) -> bool:
        return (self.speed_factor, self.heading_offset_rad, self.yaw_rate_factor) == (1.0, 0.0, 1.0)


def coarse_fit(table: pd.DataFrame) -> Coarse:
    """Compare the motion channels of a table of raw samples.

    Raises :class:`InputError` where a motion channel is missing and :class:`DataShortageError` for less than 8
    samples of one. Too few windows to say anything give a neutral answer.
    """
    require(table, tuple(name for names in GROUPS.values() for name in names))
    position, heading, speed, yaw_rate = (group_samples(table, channels) for channels in GROUPS.values())
    speed, yaw_rate = (group.without(outliers(group.levels)) for group in (speed, yaw_rate))
    step_s = max(STEP_S, min(group.interval_s for group in (position, heading, speed, yaw_rate)))
    motion = CleanMotion(position, heading, speed, yaw_rate, step_s)
    moves = _Moves.of(motion, _WINDOW_S)
    if moves.count < _FEWEST_WINDOWS:
        return Coarse()
    yaw_rate_factor = moves.yaw_rate_factor()
    named = _sign_or_unit(moves)
    if named is not None:
        return Coarse(1.0, 0.0, yaw_rate_factor, *named)
    unexplained = _unexplained_fraction(_Moves.of(motion, _LONG_S), motion)
    if unexplained > _CONTRADICTED:
        return Coarse(1.0, 0.0, yaw_rate_factor, _UNEXPLAINED, "north_m", unexplained)
    return Coarse(*_scale_and_angle(moves), yaw_rate_factor)


def contradiction_finding(table: pd.DataFrame, coarse: Coarse) -> Finding:
    """The contradiction that a coarse fit found; ``estimate`` has the share of the moves left unexplained."""
    text = f"Positions, heading and speeds tell of no one motion: {coarse.unexplained:.0%} of the way is left over;"
    return Finding(
        "motion_contradiction", coarse.channel, *span_of(table), f"{text} {coarse.contradiction}",
        "Mend signs and units where the channels are recorded; nothing else can be told of them until then.",
        {"left": coarse.unexplained},
    )  # fmt: skip


def _scale_and_angle(moves: _Moves) -> tuple[float, float]:
    """Factor of the speeds and offset of the heading [rad]; half a turn is the heading's, unless the ship would go
    astern on the whole: then both speeds have the wrong sign."""
    ratio = moves.ratio()
    if abs(np.log(abs(ratio))) < _FAR and abs(np.angle(ratio)) < _FAR:
        return 1.0, 0.0
    if abs(np.angle(-ratio)) < _FAR and moves.body.real.mean() < 0.0:
        return -float(abs(ratio)), float(-np.angle(-ratio))
    angle = float(-np.angle(ratio))
    return float(abs(ratio)), angle + 2.0 * np.pi if angle < _FAR - np.pi else angle


@dataclass(frozen=True, slots=True)
class _Regression:
    """A regression of moves: their ratio to the model's, the residual [m], and that with arm, delay and heel."""

    ratio: complex
    plainly_m: float
    left_m: float

    def removes(self, rival: _Regression) -> bool:
        return self.left_m < _REMOVED * rival.left_m

    def clearer(self, rival: _Regression, windows: int) -> bool:
        """Whether it is far likelier than another by what is left."""
        return bool(_KEPT * windows * np.log(rival.left_m / max(self.left_m, 1e-9)) > _LIKELIER)

    def likelier(self, rival: _Regression, windows: int) -> bool:
        """Whether its residual is much smaller and it stays likelier with lever arm, delay and heel in the model:
        sway with the wrong sign, or in another unit than surge, looks much like a lever arm."""
        is_smaller = self.plainly_m < _REMOVED * rival.plainly_m
        return is_smaller and self.clearer(rival, windows)


@dataclass(frozen=True, slots=True)
class _Moves:
    """Positions as complex moves over windows [n], and grid values of what should explain them."""

    grid_s: Floats
    starts: Ints
    length: int
    moved: Complexes
    heading: Floats
    body: Complexes
    yaw_rate: Floats

    @classmethod
    def of(cls, motion: CleanMotion, window_s: float) -> _Moves:
        begin = max(group.time_s[0] for group in motion.groups)
        end = min(group.time_s[-1] for group in motion.groups)
        grid_s = np.arange(begin, max(end, begin) + 1e-6, motion.step_s)
        length = max(2, round(window_s / motion.step_s))
        starts = block_starts(motion, grid_s, length + 1) if grid_s.size > length else np.empty(0, np.int64)
        north, east, ahead, aside, rate = (
            np.interp(grid_s, group.time_s, column)
            for group in (motion.position, motion.speed, motion.yaw_rate)
            for column in group.levels.T
        )
        heading = np.interp(grid_s, motion.heading.time_s, np.unwrap(motion.heading.levels[:, 0]))
        moved = np.asarray(_changes_over(north + 1j * east, starts, length))
        return cls(grid_s, starts, length, moved, heading, ahead + 1j * aside, rate)

    @property
    def count(self) -> int:
        return int(self.starts.size)

    def travelled(self, heading: Floats, body: Complexes) -> Complexes:
        """The moves by heading and speeds."""
        velocity = body * np.exp(1j * heading)
        step = self.grid_s[1] - self.grid_s[0]
        return _changes_over(integrate(velocity, step), self.starts, self.length)

    def explained(self, moved: Complexes, heading: Floats, body: Complexes) -> _Regression:
        """Moves by those that heading and speeds make."""
        travelled, ahead = self.travelled(heading, body), np.exp(1j * heading)
        turning = np.gradient(heading, self.grid_s[1] - self.grid_s[0])
        arm, delay, heeled = (
            _changes_over(term * ahead, self.starts, self.length)
            for term in (np.ones_like(heading), body, 1j * turning * body.real)
        )
        values, plainly = _regress(moved, travelled[:, np.newaxis])
        residual = _regress(moved, np.column_stack([travelled, arm, delay, heeled]))[1]
        return _Regression(complex(values[0]), _trimmed_rms(plainly), _trimmed_rms(residual))

    def ratio(self) -> complex:
        """The complex ratio of the positions' moves to those by heading and speeds; 1 where none explains them."""
        regression = self.explained(self.moved, self.heading, self.body)
        return (
            regression.ratio
            if regression.left_m < _AGREES * _trimmed_rms(self.moved) and abs(regression.ratio) > 0.0
            else 1.0 + 0.0j
        )

    def yaw_rate_factor(self) -> float:
        """The factor from yaw rate to rate of heading where it is far from 1 and well determined, else 1."""
        step = self.grid_s[1] - self.grid_s[0]
        turned = _changes_over(integrate(self.yaw_rate, step), self.starts, self.length)
        headed = _changes_over(self.heading, self.starts, self.length)
        values, residual = _regress(headed, np.column_stack([turned, np.ones(turned.size)]))
        factor, about = float(values[0].real), np.abs(headed - np.median(headed))
        is_clear = _trimmed_rms(residual) < _AGREES * _trimmed_rms(about) and factor != 0.0
        return factor if is_clear and abs(factor - 1.0) > _FAR else 1.0


def _sign_or_unit(moves: _Moves) -> tuple[str, str, float] | None:
    """The sign or unit error that removes the contradiction: in words, its channel, the share left without it."""
    path, plain = _trimmed_rms(moves.moved), moves.explained(moves.moved, moves.heading, moves.body)
    if not max(plain.left_m, plain.plainly_m) > _LEAST_LEFT * path:
        return None
    tried = {
        "chart": moves.explained(moves.moved.conj(), moves.heading, moves.body),
        "body": moves.explained(moves.moved, moves.heading, moves.body.conj()),
        "heading": moves.explained(moves.moved, -moves.heading, moves.body),
    }
    for axes, velocity in (("north_east", moves.body), ("east_north", 1j * moves.body.conj())):
        fit = moves.explained(moves.moved, np.zeros_like(moves.heading), velocity)
        if abs(fit.ratio - 1.0) < _NEAR_ONE:
            tried[axes] = fit
    if np.ptp(np.angle(np.exp(1j * moves.heading))) < _FULL_TURN_RAD_IN_DEG:
        tried["radians"] = moves.explained(moves.moved, np.rad2deg(moves.heading), moves.body)
    ahead, aside = moves.body.real, moves.body.imag
    for unit, factor in _SPEED_UNITS.items():
        in_turn = {"surge": factor * ahead + 1j * aside, "sway": ahead + 1j * factor * aside}
        for name, body in in_turn.items():
            fit = moves.explained(moves.moved, moves.heading, body)
            if abs(abs(fit.ratio) - 1.0) < _NEAR_ONE:  # else the other is too small, or both are in other units
                tried[f"{name} alone is in {unit}"] = fit
    kind = min(tried, key=lambda candidate: tried[candidate].left_m)
    like_an_arm = kind == "body" or kind.startswith("surge alone")
    removes = tried[kind].removes(plain) or (like_an_arm and tried[kind].likelier(plain, moves.count))
    if not removes:
        return None
    wordings = {
        name: _words(name, float(np.rad2deg(np.angle(regression.ratio)))) for name, regression in tried.items()
    }
    rivals = [
        wordings[name][0]
        for name, regression in tried.items()
        if name != kind and regression.removes(plain) and not tried[kind].clearer(regression, moves.count)
    ]
    words, channel = wordings[kind]
    return " or as well if ".join([f"they agree if {words}", *rivals]), channel, plain.plainly_m / path


def _words(kind: str, angle_deg: float) -> tuple[str, str]:
    if kind == "radians":
        return "the heading is in radians, not degrees", "heading_deg"
    if kind == "heading":
        deviations_deg = {
            convention.words: abs(float(difference(angle_deg, convention.offset_deg)))
            for convention in HEADINGS[1:]
        }
        words = min(deviations_deg, key=deviations_deg.__getitem__)
        return (
            f"the heading counts {words if deviations_deg[words] < _NEAR_DEG else 'anticlockwise'}",
            "heading_deg",
        )
    if kind in AXES:
        return f"surge and sway are speeds {AXES[kind]}", "surge_mps"
    if "alone" in kind:
        return f"{kind}, not m/s", f"{kind.partition(' ')[0]}_mps"
    contradictions = {
        ("chart", 0): ("east counts to the west", "east_m"),
        ("chart", 2): ("north counts to the south", "north_m"),
        ("chart", 3): ("north and east are exchanged", "north_m"),
        ("body", 0): ("sway counts to port", "sway_mps"),
        ("body", 1): ("surge and sway are exchanged", "surge_mps"),
        ("body", 2): ("surge counts astern", "surge_mps"),
    }
    fallback = {"chart": ("the chart is mirrored", "north_m"),
             "body": ("one of surge and sway has the wrong sign", "surge_mps")}  # fmt: skip
    return contradictions.get((kind, round(angle_deg / 90.0) % 4), fallback[kind])


def _unexplained_fraction(moves: _Moves, motion: CleanMotion) -> float:
    """The unexplained share of the moves over a minute; 0 within noise or for a ship that hardly moved."""
    if moves.count < _FEWEST_LONG:
        return 0.0
    path, residual = _trimmed_rms(moves.moved), moves.explained(moves.moved, moves.heading, moves.body).left_m
    rough = np.abs(np.diff(motion.position.levels, n=2, axis=0))
    noise = float(np.median(rough)) / (0.6745 * np.sqrt(6.0))
    return residual / path if path > _LEAST_MOVE_M and residual > _BEYOND_NOISE * noise else 0.0


def _changes_over(values: NDArray[Any], starts: Ints, length: int) -> NDArray[Any]:
    """The change of values on the grid over each window."""
    return np.asarray(values[starts + length] - values[starts])


def _regress(moved: Complexes | Floats, slopes: Complexes | Floats) -> tuple[Complexes, Complexes]:
    """Complex least squares with Cauchy's weights: the values [p] and what is left [n]."""
    size = np.sqrt(np.mean(np.abs(slopes) ** 2, axis=0)) + 1e-12
    scaled = (slopes / size).astype(np.complex128)
    weights = np.ones(moved.size)
    for _ in range(_ROUNDS):
        matrix = (scaled.conj() * weights[:, np.newaxis]).T @ scaled / weights.sum() + 1e-6 * np.eye(size.size)
        values = np.linalg.solve(matrix, (scaled.conj() * weights[:, np.newaxis]).T @ moved / weights.sum())
        residual = moved - scaled @ values
        scale = 2.0 * float(np.median(np.abs(residual))) + 1e-9
        weights = 1.0 / (1.0 + (np.abs(residual) / scale) ** 2)
    return np.asarray(values / size), np.asarray(residual)


def _trimmed_rms(values: Complexes | Floats) -> float:
    """The root mean square of all but the largest fifth."""
    squares = np.sort(np.abs(values) ** 2)
    return float(np.sqrt(squares[: max(1, int(_KEPT * squares.size))].mean()))
