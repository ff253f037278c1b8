"""The state, controls and wind of a simulator of another make, in its units and conventions and in ours.

Ours are SI units and radians: north, east [m], heading from north clockwise [rad], surge, sway to starboard [m/s],
yaw rate to starboard [rad/s]; wind by the direction it comes from and its speed over ground. Each signal of a
simulator is one affine step from that; only the wind may depend on the ship's motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from seatrial.acquisition.core.quantities import Floats, rotate_earth_to_ship, to_earth

HEADING, SURGE, SWAY, YAW_RATE = 2, 3, 4, 5
STATES = {"north": "m", "east": "m", "heading": "deg", "surge": "m/s", "sway": "m/s", "yaw_rate": "deg/s"}
"""The state's quantities in their order, and the units that ours are known by."""
_TURN = 2.0 * np.pi

WindForm = Literal["direction", "components", "none"]
Frame = Literal["true", "relative", "apparent"]
"""A wind direction from north; the same from the bow; that of the wind felt on the moving ship, from the bow."""


@dataclass(frozen=True, slots=True)
class AffineSignals:
    """``ours = scale * theirs + offset`` of each column."""

    scale: tuple[float, ...]
    offset: tuple[float, ...]

    def to_theirs(self, values: Floats) -> Floats:
        """Our values [..., columns] in the simulator's units and conventions."""
        return np.asarray((values - np.array(self.offset)) / np.array(self.scale))

    def to_ours(self, values: Floats) -> Floats:
        """The simulator's values [..., columns] in ours."""
        return np.asarray(values * np.array(self.scale) + np.array(self.offset))

    @property
    def is_identity(self) -> bool:
        """Whether the simulator's values are ours."""
        return set(self.scale) <= {1.0} and set(self.offset) <= {0.0}


def identity(columns: int) -> AffineSignals:
    """The signals of a simulator with our units and conventions."""
    return AffineSignals((1.0,) * columns, (0.0,) * columns)


@dataclass(frozen=True, slots=True)
class WindSignals:
    """The wind as a simulator takes it: direction and speed, or the air's velocity to north and east, or none."""

    form: WindForm = "direction"
    frame: Frame = "true"
    signals: AffineSignals = field(default_factory=lambda: identity(2))

    @property
    def is_of_motion(self) -> bool:
        """Whether the wind as the simulator takes it depends on the ship's motion."""
        return self.form == "direction" and self.frame != "true"

    def to_theirs(self, wind: Floats, states: Floats) -> Floats:
        """Our wind [N, 2], direction from [rad] and speed [m/s], on ships in ``states`` [N, 6]; [N, 0] for none."""
        if self.form == "none":
            return np.empty((len(states), 0))
        direction, speed = wind[:, 0], wind[:, 1]
        if self.form == "components":
            air = -speed[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
            return self.signals.to_theirs(air)
        if self.frame == "true":
            if self.signals.is_identity:
                return wind
            angle = direction
        elif self.frame == "relative":
            angle = direction - states[:, HEADING]
        else:  # the wind felt comes from where the air comes from, and from ahead as the ship moves
            ahead, starboard = rotate_earth_to_ship(
                speed * np.cos(direction), speed * np.sin(direction), states[:, HEADING]
            )
            ahead, starboard = ahead + states[:, SURGE], starboard + states[:, SWAY]
            angle, speed = np.arctan2(starboard, ahead), np.hypot(ahead, starboard)
        theirs = self.signals.to_theirs(np.column_stack([angle, speed]))
        turn = abs(_TURN / self.signals.scale[0])
        theirs[:, 0] %= turn
        if self.frame != "true":
            theirs[:, 0] -= turn * (theirs[:, 0] > 0.5 * turn)
        return theirs


@dataclass(frozen=True, slots=True)
class Signals:
    """All signals of a simulator. With an ``origin_deg``, its latitude and longitude [deg] stand for north and
    east from there."""

    state: AffineSignals
    control: AffineSignals
    wind: WindSignals = field(default_factory=WindSignals)
    origin_deg: tuple[float, float] | None = None

    def state_to_theirs(self, states: Floats) -> Floats:
        """Our states [N, 6] as the simulator's."""
        if self.origin_deg is None:
            return states.copy() if self.state.is_identity else self.state.to_theirs(states)
        from pymap3d import ned2geodetic

        geodetic = states.copy()
        geodetic[:, 0], geodetic[:, 1], _ = ned2geodetic(states[:, 0], states[:, 1], 0.0, *self.origin_deg, 0.0)
        return self.state.to_theirs(geodetic)

    def state_to_ours(self, values: Floats, previous: Floats) -> Floats:
        """The simulator's states [N, 6] as ours, with headings that go on from the ``previous`` ones [N, 6]."""
        states = values.copy() if self.state.is_identity else self.state.to_ours(values)
        if self.origin_deg is not None:
            from pymap3d import geodetic2ned

            states[:, 0], states[:, 1], _ = geodetic2ned(states[:, 0], states[:, 1], 0.0, *self.origin_deg, 0.0)
        turn = states[:, HEADING] - previous[:, HEADING]
        states[:, HEADING] -= _TURN * np.round(turn / _TURN)
        return states


@dataclass(frozen=True, slots=True)
class BodyPush:
    """What pushes a ship beside its simulator, per mass: a ``constant`` ahead, to starboard [m/s2] and in yaw
    [rad/s2], and ``drag`` [1/m] of the squared surge, of sway and of yaw rate times the speed; arrays [N, 3] of N
    ships."""

    constant: tuple[float, ...] | Floats
    drag: tuple[float, ...] | Floats

    def accelerations(self, states: Floats) -> Floats:
        """The push [N, 3] on ships in ``states`` [N, 6] over water."""
        speeds = states[:, SURGE:]
        speed = np.abs(np.column_stack([speeds[:, 0], *[np.hypot(speeds[:, 0], speeds[:, 1])] * 2]))
        return np.asarray(np.array(self.constant) - np.array(self.drag) * speed * speeds)


NO_PUSH = BodyPush((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


_PLAUSIBLE = {"surge": (0.6, 1.6), "sway": (0.4, 2.5), "yaw_rate": (0.6, 1.6)}
"""What the poses of a sound simulator may change by, in what its speeds say: a rough method of integration and a
current of its own change that by some tenths. Mistaken knots, degrees, sides and axes are beyond."""
_LEAST = {"surge": 0.2, "sway": 0.1, "yaw_rate": 0.005}
"""Root mean squares of speeds [m/s, m/s, rad/s] below which nothing is said."""


def contradictions(states: Floats, dt_s: float) -> list[str]:
    """Which speeds of a simulator are not those at which its poses change, over states [N, K+1, 6] that are
    ``dt_s`` apart: a sentence each. Where a variable, unit or side is mistaken, they differ by a factor."""
    change, mean = np.diff(states, axis=1), 0.5 * (states[:, 1:] + states[:, :-1])
    valid = np.isfinite(change).all(axis=2)
    change, mean = change[valid], mean[valid]
    moved = (*rotate_earth_to_ship(change[:, 0], change[:, 1], mean[:, HEADING]), change[:, HEADING])
    sentences = []
    for (name, (low, high)), moves, speed in zip(_PLAUSIBLE.items(), moved, mean[:, SURGE:].T, strict=True):
        power = float(speed @ speed)
        factor = float(moves @ speed) / (power * dt_s) if power > len(speed) * _LEAST[name] ** 2 else 1.0
        if not low < factor < high:
            sentences.append(f"its {'heading turns' if name == 'yaw_rate' else 'position moves'} by {factor:.2g} "
                             f"times what its {name.replace('_', ' ')} says")  # fmt: skip
    return sentences


def wind_over_water(wind: Floats, current: tuple[float, float]) -> Floats:
    """The wind [..., 2] over ground as it is over water that moves north and east [m/s]."""
    if not any(current):
        return wind
    direction, speed = wind[..., 0], wind[..., 1]
    north, east = speed * np.cos(direction) + current[0], speed * np.sin(direction) + current[1]
    return np.stack([np.arctan2(east, north), np.hypot(north, east)], axis=-1)


def states_over_water(states: Floats, current: tuple[float, float] | Floats, elapsed_s: Floats | float) -> Floats:
    """States [..., 6] over ground as they are over water that has moved for ``elapsed_s``; the inverse with the
    opposite current, which may be one of each ship [2, N]."""
    moved = states.copy()
    moved[..., 0] -= current[0] * elapsed_s
    moved[..., 1] -= current[1] * elapsed_s
    ahead, starboard = rotate_earth_to_ship(current[0], current[1], states[..., HEADING])
    moved[..., SURGE] -= ahead
    moved[..., SWAY] -= starboard
    return moved


def align_tracks(states: Floats, start: Floats, at: int) -> Floats:
    """States [N, K, 6] moved and turned as a whole, so that their poses of row ``at`` are those of ``start``
    [N, 6]."""
    turn = (start[:, HEADING] - states[:, at, HEADING])[:, None]
    way = states[..., :2] - states[:, at : at + 1, :2]
    north, east = to_earth(way[..., 0], way[..., 1], turn)
    aligned = states.copy()
    aligned[..., 0], aligned[..., 1] = start[:, :1] + north, start[:, 1:2] + east
    aligned[..., HEADING] += turn
    return aligned
