"""A manoeuvre's kind, settings and indices with 95 % intervals, and the IMO limits.

The limits are those of IMO resolution MSC.137(76), Standards for ship manoeuvrability, section 5.3. They apply
to ships of 100 m and more and to chemical and gas tankers; for other ships, and for ships steered by their
propulsors, they are given for information only. Each belongs to one test: advance and tactical diameter to the
turning test with 35 deg or the largest helm, the distance to 10 deg of turn to a helm of 10 deg, overshoots to
the 10/10 and 20/20 zigzags.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd

_BOUNDS = ("value", "low", "high")


@dataclass(frozen=True, slots=True)
class Index:
    """One index with the 95 % interval ``low`` to ``high``; NaN where the interval is unknown.

    ``lengths`` is the value in ship lengths, ``limit`` the IMO limit in ``unit``, "for information".
    """

    value: float
    low: float
    high: float
    unit: str
    lengths: float | None = None
    limit: float | None = None

    @property
    def limit_lengths(self) -> float | None:
        """The limit in ship lengths, None where there is no limit or the index has no lengths."""
        return self.limit * self.lengths / self.value if self.limit and self.lengths else None

    def as_json(self) -> dict[str, Any]:
        """The index with the contract's keys; unknown values are null."""
        bounds = {name: _number(getattr(self, name)) for name in _BOUNDS}
        return {**bounds, "unit": self.unit, "lengths": self.lengths, "limit": self.limit}


@dataclass(frozen=True, slots=True)
class Current:
    """The drift of a steady circle, from current and wind, each component with half of its 95 % interval [m/s]."""

    north_mps: float
    east_mps: float
    north_within_mps: float
    east_within_mps: float

    def as_json(self) -> dict[str, float]:
        """Components, speed and the direction it goes to [deg]."""
        return {
            **asdict(self),
            "speed_mps": float(np.hypot(self.north_mps, self.east_mps)),
            "direction_deg": float(np.rad2deg(np.arctan2(self.east_mps, self.north_mps)) % 360.0),
        }


HELMS = ("azimuth_deg", "rudder_deg", "nozzle_deg")
"""The settings of a helm, by what steers the ship."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """One manoeuvre: ``start`` is its execute, the first change of the command.

    ``side`` is the one the ship turned or moved to first ("port", "starboard", or "" for a straight one).
    ``settings`` are its commands and the state of the approach. ``executes`` are the further changes of
    command. ``current`` is what was removed for the indices that end in ``_current_removed``.
    """

    kind: str
    name: str
    start: pd.Timestamp
    end: pd.Timestamp
    side: str
    settings: Mapping[str, float]
    indices: Mapping[str, Index]
    current: Current | None = None
    executes: tuple[pd.Timestamp, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @classmethod
    def from_json(cls, said: Mapping[str, Any]) -> Manoeuvre:
        """The inverse of :meth:`as_json`. Raises KeyError, TypeError or ValueError for what is none."""
        indices = {name: Index(**{**each, **_with_nan(each, *_BOUNDS)}) for name, each in said["indices"].items()}
        drift = {name: said["current"][name] for name in Current.__slots__} if said["current"] else None
        return cls(
            kind=said["kind"], name=said["name"], start=pd.Timestamp(said["start"]), end=pd.Timestamp(said["end"]),
            side=said["side"], settings=_with_nan(said["settings"], *said["settings"]), indices=indices,
            current=Current(**drift) if drift else None,
            executes=tuple(map(pd.Timestamp, said["executes"])), notes=tuple(said["notes"]),
        )  # fmt: skip

    @property
    def sided_name(self) -> str:
        return f"{self.name} to {self.side}" if self.side and self.side not in self.name else self.name

    @property
    def helm_deg(self) -> float | None:
        """The helm held, in the sign convention of its actuators; None for a manoeuvre without helm."""
        return next((self.settings[name] for name in HELMS if name in self.settings), None)

    @property
    def sign(self) -> float:
        """1 for one to starboard, else -1."""
        return 1.0 if self.side == side_of(1.0) else -1.0

    def as_json(self) -> dict[str, Any]:
        """The manoeuvre with the keys of the contract."""
        return {
            "kind": self.kind,
            "name": self.name,
            "start": self.start.isoformat(),
            "end": self.end.isoformat(),
            "side": self.side,
            "settings": {name: _number(value) for name, value in self.settings.items()},
            "indices": {name: index.as_json() for name, index in self.indices.items()},
            "current": self.current.as_json() if self.current else {},
            "executes": [time.isoformat() for time in self.executes],
            "notes": list(self.notes),
        }


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A candidate rejected as a manoeuvre, which has no indices, and the reason."""

    kind: str
    start: datetime
    end: datetime
    why: str

    def as_json(self) -> dict[str, str]:
        """With the keys of the contract."""
        return {**asdict(self), "start": self.start.isoformat(), "end": self.end.isoformat()}


def side_of(positive_to_starboard: float) -> str:
    """The side of a turn or movement, from its sign."""
    return "starboard" if positive_to_starboard > 0 else "port"


def as_json(manoeuvres: Iterable[Manoeuvre]) -> list[dict[str, Any]]:
    """Manoeuvres as plain values for JSON, in order of time."""
    return [each.as_json() for each in manoeuvres]


UNITS = {"_deg": "deg", "_dps": "deg/s", "_mps2": "m/s2", "_mps": "m/s", "_rpm": "rpm", "_m": "m", "_s": "s"}


def unit_of(name: str) -> str:
    """The unit at the end of a name; "" for a ratio.

    >>> unit_of("advance_m_current_removed"), unit_of("speed_loss")
    ('m', '')
    """
    plain = name.removesuffix("_current_removed")
    return next((unit for suffix, unit in UNITS.items() if plain.endswith(suffix)), "")


def nominal_deg(angle_deg: float, share: float = 0.12) -> float:
    """The nominal angle of a test: a multiple of five degrees if one is within ``share`` of it.

    >>> nominal_deg(18.1), nominal_deg(7.6), nominal_deg(-9.4)
    (20.0, 8.0, 10.0)
    """
    angle = abs(angle_deg)
    near = 5.0 * max(1.0, round(angle / 5.0))
    return near if abs(angle - near) <= share * near else float(round(angle))


def index_of(
    name: str, value: float, within: float, length_m: float | None = None, limit: float | None = None
) -> Index:
    """An index from its value and half of its interval; distances also in lengths."""
    unit = unit_of(name)
    lengths = value / length_m if length_m and unit == "m" else None
    return Index(value, value - within, value + within, unit, lengths, limit)


def indices_of(values: Mapping[str, tuple[float, float]], length_m: float | None) -> dict[str, Index]:
    """Indices by name from values and halves of intervals; those not reached are left out."""
    return {name: index_of(name, *pair, length_m) for name, pair in values.items() if np.isfinite(pair[0])}


def with_limits(indices: Mapping[str, Index], limits: Mapping[str, float | None]) -> dict[str, Index]:
    """The indices with their limits, both as measured and with the current removed."""
    return {
        name: replace(index, limit=limits.get(name.removesuffix("_current_removed")))
        for name, index in indices.items()
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _with_nan(said: Mapping[str, Any], *names: str) -> dict[str, float]:
    """Numbers by name, NaN for null: the inverse of :func:`_number`."""
    return {name: np.nan if said[name] is None else float(said[name]) for name in names}


ADVANCE_LENGTHS = 4.5
TACTICAL_DIAMETER_LENGTHS = 5.0
INITIAL_TURNING_LENGTHS = 2.5
TRACK_REACH_LENGTHS = 15.0
FIRST_OVERSHOOT_20_20_DEG = 25.0
TURNING_HELM_DEG, INITIAL_TURNING_HELM_DEG, ZIGZAG_HELM_DEG = 35.0, 10.0, 20.0
_NEAR_SHARE, _SAME_HELM_SHARE = 0.2, 0.1


def first_overshoot_10_10_deg(length_per_speed_s: float) -> float:
    """10 below L/V = 10 s, 20 from 30 s, 5 + L/V / 2 between."""
    return float(np.clip(5.0 + 0.5 * length_per_speed_s, 10.0, 20.0))


def second_overshoot_10_10_deg(length_per_speed_s: float) -> float:
    """25 below L/V = 10 s, 40 from 30 s, 17.5 + 0.75 L/V between."""
    return float(np.clip(17.5 + 0.75 * length_per_speed_s, 25.0, 40.0))


def overshoot_limit_deg(
    number: int, angle_deg: float, switch_deg: float, length_m: float | None, speed_mps: float
) -> float | None:
    """The limit of overshoot 1 or 2 of a zigzag, None where there is none.

    A test run within a fifth of its nominal 10/10 or 20/20 counts as such. ``length_m`` is the ship's length
    L, ``speed_mps`` the test speed V; without a length there is no limit for the 10/10 test.
    """

    def near(nominal: float) -> bool:
        return max(abs(angle_deg / nominal - 1.0), abs(switch_deg / nominal - 1.0)) <= _NEAR_SHARE

    if near(20.0) and number == 1:
        return FIRST_OVERSHOOT_20_20_DEG
    if near(10.0) and number in (1, 2) and length_m and speed_mps > 0.0:
        formula = first_overshoot_10_10_deg if number == 1 else second_overshoot_10_10_deg
        return formula(length_m / speed_mps)
    return None


def overshoot_limits(
    angle_deg: float, switch_deg: float, length_m: float | None, speed_mps: float, names: Collection[str]
) -> dict[str, float | None]:
    """The limits of the first two overshoots of a zigzag with indices of these ``names``, by index."""
    limits: dict[str, float | None] = {}
    for number in (1, 2):
        name = as_imo_counts(number, names)
        limits[name] = overshoot_limit_deg(number, angle_deg, switch_deg, length_m, speed_mps)
    return limits


def from_order(number: int) -> str:
    """The name of an overshoot counted from the moment when the helm began to move."""
    return f"overshoot_{number}_from_order_deg"


def as_imo_counts(number: int, names: Collection[str]) -> str:
    """The name of an overshoot among these: from the order, as IMO counts, or where that is none of them from half
    of the command."""
    return from_order(number) if from_order(number) in names else f"overshoot_{number}_deg"


def add_limits(manoeuvres: Iterable[Manoeuvre], length_m: float | None) -> tuple[Manoeuvre, ...]:
    """The manoeuvres of one recording with limits on the indices that have them, and notes with the reasons.

    The largest helm is that of all zigzags and turns of the recording.
    """
    every = tuple(manoeuvres)
    largest = max((abs(each.helm_deg or 0.0) for each in every), default=0.0)
    return tuple(_add_limits(each, length_m, largest) for each in every)


def is_turning_test(helm_deg: float, largest_deg: float) -> bool:
    """Whether a circle is the turning test: with 35 deg of helm, or the largest helm of its recording.

    The helms of the other tests, 10 and 20 deg, are no ship's largest: a recording with nothing more has no
    turning test.
    """
    at_35 = abs(abs(helm_deg) / TURNING_HELM_DEG - 1.0) <= _SAME_HELM_SHARE
    at_largest = abs(helm_deg) >= (1.0 - _SAME_HELM_SHARE) * largest_deg
    return (at_35 or at_largest) and abs(helm_deg) > (1.0 + _SAME_HELM_SHARE) * ZIGZAG_HELM_DEG


def _add_limits(each: Manoeuvre, length_m: float | None, largest_deg: float) -> Manoeuvre:
    if each.kind not in ("zigzag", "turning_circle", "course_change"):
        return each
    helm_deg, limits, notes = abs(each.helm_deg or 0.0), dict[str, float | None](), list[str]()
    if each.kind == "zigzag":
        test = (helm_deg, each.settings["switch_deg"], length_m, each.settings["approach_mps"])
        limits |= overshoot_limits(*test, each.indices)
    if length_m and abs(helm_deg / INITIAL_TURNING_HELM_DEG - 1.0) <= _NEAR_SHARE:
        limits["initial_turning_m"] = INITIAL_TURNING_LENGTHS * length_m
    if length_m and each.kind == "turning_circle":
        shown = "no limits: advance and diameter have them"
        if is_test := is_turning_test(helm_deg, largest_deg):
            limits["advance_m"] = ADVANCE_LENGTHS * length_m
            limits["tactical_diameter_m"] = TACTICAL_DIAMETER_LENGTHS * length_m
            shown = "limits are"
        if not is_test or abs(helm_deg / TURNING_HELM_DEG - 1.0) > _SAME_HELM_SHARE:
            notes.append(
                f"{shown} for {TURNING_HELM_DEG:.0f} deg or the largest helm, "
                f"and this was {helm_deg:.0f} deg, the largest of this recording {largest_deg:.0f} deg"
            )
    return replace(each, indices=with_limits(each.indices, limits), notes=(*each.notes, *notes))
