"""What a manoeuvre is said to be: its kind, settings and indices with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd


@dataclass(frozen=True, slots=True)
class Index:
    """One figure with the 95 % interval ``low`` to ``high``; NaN where the interval is not known.

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
        """The index with the keys of the contract; what is not known is null."""
        return {
            "value": _number(self.value),
            "low": _number(self.low),
            "high": _number(self.high),
            "unit": self.unit,
            "lengths": self.lengths,
            "limit": self.limit,
        }


@dataclass(frozen=True, slots=True)
class Current:
    """The drift of a steady circle: current and what the wind does, each with half of its 95 % interval [m/s]."""

    north_mps: float
    east_mps: float
    north_within_mps: float
    east_within_mps: float

    def as_json(self) -> dict[str, float]:
        """Components, speed and the direction it goes to [deg]."""
        return {
            "north_mps": self.north_mps,
            "east_mps": self.east_mps,
            "north_within_mps": self.north_within_mps,
            "east_within_mps": self.east_within_mps,
            "speed_mps": float(np.hypot(self.north_mps, self.east_mps)),
            "direction_deg": float(np.rad2deg(np.arctan2(self.east_mps, self.north_mps)) % 360.0),
        }


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


def as_json(manoeuvres: Iterable[Manoeuvre]) -> list[dict[str, Any]]:
    """Manoeuvres as plain values for JSON, in order of time."""
    return [each.as_json() for each in manoeuvres]


UNITS = {"_deg": "deg", "_dps": "deg/s", "_mps2": "m/s2", "_mps": "m/s", "_rpm": "rpm", "_m": "m", "_s": "s"}


def unit_of(name: str) -> str:
    """The unit that a name ends in; "" for a ratio.

    >>> unit_of("advance_m_current_removed"), unit_of("speed_loss")
    ('m', '')
    """
    plain = name.removesuffix("_current_removed")
    return next((unit for suffix, unit in UNITS.items() if plain.endswith(suffix)), "")


def nominal_deg(angle_deg: float, share: float = 0.12) -> float:
    """The angle a test was meant to have: five degrees' steps where one is within ``share`` of it.

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


def with_limits(indices: Mapping[str, Index], limits: Mapping[str, float | None]) -> dict[str, Index]:
    """The indices with limits beside those that have one, as measured and with the current removed."""
    return {
        name: replace(index, limit=limits.get(name.removesuffix("_current_removed")))
        for name, index in indices.items()
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
