"""A manoeuvre's kind, settings and indices with 95 % intervals, and from which moment each index counts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd

_BOUNDS = ("value", "low", "high")
ORDER, HALF_HELM = "order", "half_helm"
"""The moments from which an index counts: that of the order, and that at which the helm was half over."""
_UNCOUNTED = ("speed_run", "crabbing", "thruster_test", "spiral", "reverse_spiral")
HELMS = ("azimuth_deg", "rudder_deg", "nozzle_deg")
"""The settings of a helm, by what steers the ship."""
UNITS = {"_deg": "deg", "_dps": "deg/s", "_mps2": "m/s2", "_mps": "m/s", "_rpm": "rpm", "_m": "m", "_s": "s"}


@dataclass(frozen=True, slots=True)
class Index:
    """One index with the 95 % interval ``low`` to ``high``; NaN where the interval is unknown.

    ``lengths`` is the value in ship lengths. ``counted_from`` is :data:`ORDER` or :data:`HALF_HELM`, empty for what
    does not count from a moment. ``limit`` is that of the standard (:mod:`seatrial.analysis.manoeuvres.criteria`)
    in ``unit``, ``result`` the value's against it, and ``missing`` what is missing to show it.
    """

    value: float
    low: float
    high: float
    unit: str
    lengths: float | None = None
    limit: float | None = None
    counted_from: str = ""
    result: str = ""
    missing: tuple[str, ...] = ()

    @property
    def limit_lengths(self) -> float | None:
        """The limit in ship lengths, None where there is no limit or the index has no lengths."""
        return self.limit * self.lengths / self.value if self.limit and self.lengths else None

    def as_json(self) -> dict[str, Any]:
        """The index with the contract's keys; unknown values are null."""
        bounds = {name: _null_for_nan(getattr(self, name)) for name in _BOUNDS}
        return {**asdict(self), **bounds, "missing": list(self.missing)}


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


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """One manoeuvre: ``start`` is its execute, the moment of the order.

    ``side`` is the one the ship turned or moved to first ("port", "starboard", or "" for a straight one).
    ``settings`` are its commands and the state of the approach. ``executes`` are the further changes of
    command. ``current`` is what was removed for the indices that end in ``_current_removed``. ``shortfalls`` are
    what in its execution keeps it from showing a criterion: an approach that was not steady, orders that contradict
    the helm. ``not_counted`` is why it shows no criterion at all though it was found: what a programme of trials
    that was conducted says of it.
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
    shortfalls: tuple[str, ...] = ()
    not_counted: str = ""

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Manoeuvre:
        """The inverse of :meth:`as_json`. Raises KeyError, TypeError or ValueError for what is none."""
        indices = {}
        for name, values in content["indices"].items():
            missing = tuple(values.get("missing", ()))
            indices[name] = Index(**{**values, **_nan_for_null(values, *_BOUNDS), "missing": missing})
        drift = {name: content["current"][name] for name in Current.__slots__} if content["current"] else None
        return cls(
            kind=content["kind"], name=content["name"], side=content["side"],
            start=pd.Timestamp(content["start"]), end=pd.Timestamp(content["end"]),
            settings=_nan_for_null(content["settings"], *content["settings"]), indices=indices,
            current=Current(**drift) if drift else None,
            executes=tuple(map(pd.Timestamp, content["executes"])), notes=tuple(content["notes"]),
            shortfalls=tuple(content.get("shortfalls", ())), not_counted=content.get("not_counted", ""),
        )  # fmt: skip

    @property
    def sided_name(self) -> str:
        return f"{self.name} to {self.side}" if self.side and self.side not in self.name else self.name

    @property
    def helm_deg(self) -> float | None:
        """The helm held, in the sign convention of its actuators; None for a manoeuvre without helm."""
        return next((self.settings[name] for name in HELMS if name in self.settings), None)

    @property
    def is_astern(self) -> bool:
        """Whether the ship went astern when it began."""
        return "approach_surge_mps" in self.settings

    @property
    def sign(self) -> float:
        """1 for one to starboard, else -1."""
        return 1.0 if self.side == side_of_sign(1.0) else -1.0

    def as_json(self) -> dict[str, Any]:
        """The manoeuvre with the keys of the contract."""
        return {
            "kind": self.kind,
            "name": self.name,
            "start": self.start.isoformat(),
            "end": self.end.isoformat(),
            "side": self.side,
            "settings": {name: _null_for_nan(value) for name, value in self.settings.items()},
            "indices": {name: index.as_json() for name, index in self.indices.items()},
            "current": self.current.as_json() if self.current else {},
            "executes": [time.isoformat() for time in self.executes],
            "notes": list(self.notes),
            "shortfalls": list(self.shortfalls),
            "not_counted": self.not_counted,
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


def side_of_sign(positive_to_starboard: float) -> str:
    """The side of a turn or movement, from its sign."""
    return "starboard" if positive_to_starboard > 0 else "port"


def unit_in_name(name: str) -> str:
    """The unit at the end of a name; "" for a ratio.

    >>> unit_in_name("advance_m_current_removed"), unit_in_name("speed_loss")
    ('m', '')
    """
    plain = name.removesuffix("_current_removed")
    return next((unit for suffix, unit in UNITS.items() if plain.endswith(suffix)), "")


def nominal_angle_deg(angle_deg: float, share: float = 0.12) -> float:
    """The nominal angle of a test: a multiple of five degrees if one is within ``share`` of it.

    >>> nominal_angle_deg(18.1), nominal_angle_deg(7.6), nominal_angle_deg(-9.4)
    (20.0, 8.0, 10.0)
    """
    angle = abs(angle_deg)
    near = 5.0 * max(1.0, round(angle / 5.0))
    return near if abs(angle - near) <= share * near else float(round(angle))


def index_from_value(
    name: str, value: float, within: float, length_m: float | None = None, kind: str = ""
) -> Index:
    """An index of a ``kind`` of manoeuvre from its value and half of its interval; distances also in lengths.

    >>> index_from_value("overshoot_1_deg", 9.0, 1.0, kind="zigzag").counted_from
    'half_helm'
    """
    unit, counted_from = unit_in_name(name), ""
    if kind and kind not in _UNCOUNTED:
        counted_from = HALF_HELM if re.fullmatch(r"overshoot_\d+_deg", name) else ORDER
    lengths = value / length_m if length_m and unit == "m" else None
    return Index(value, value - within, value + within, unit, lengths, counted_from=counted_from)


def overshoot_from_order_name(number: int) -> str:
    """The name of an overshoot counted from the order."""
    return f"overshoot_{number}_from_order_deg"


def _null_for_nan(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _nan_for_null(content: Mapping[str, Any], *names: str) -> dict[str, float]:
    """Numbers by name, NaN for null: the inverse of :func:`_null_for_nan`."""
    return {name: np.nan if content[name] is None else float(content[name]) for name in names}
