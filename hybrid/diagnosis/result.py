"""What a diagnosis comes to, as plain values: the contract's JSON, and what its report shows beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any, Literal, cast

from acquisition.core.arrays import Floats, Ints
from analysis.estimation.likelihood import correlated_pairs
from hybrid.prediction.scores import Interval

if TYPE_CHECKING:
    from hybrid.diagnosis.map import Map

Verdict = Literal["named", "nothing_missing", "unknown", "indistinguishable"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter's value with its 95 % interval, in its unit."""

    value: float
    low: float
    high: float
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit}


@dataclass(frozen=True, slots=True)
class Suspect:
    """One effect of the catalogue as the ranking shows it.

    ``evidence`` is the log odds by which the model is better with it alone, ``p_value`` is corrected for the size
    of the catalogue. ``limit`` is the size of the first parameter that would be found in 9 of 10 such trials.
    """

    name: str
    family: str
    evidence: float
    p_value: float
    limit: float
    unit: str


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """An effect that was named, with its share of the gap on windows that took no part."""

    name: str
    family: str
    kind: str
    parameters: Mapping[str, Estimate]
    share_of_gap: float
    p_value: float
    evidence: float
    sentence: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        keys = ("name", "family", "kind", "share_of_gap", "p_value", "sentence")
        plain = {key: getattr(self, key) for key in keys}
        return {**plain, "parameters": {name: each.as_dict() for name, each in self.parameters.items()}}


@dataclass(frozen=True, slots=True)
class Rival:
    """An effect that would explain almost as much ``instead_of`` a named one: ``evidence`` it lacks, log odds."""

    instead_of: str
    name: str
    evidence: float


@dataclass(frozen=True, slots=True)
class UnknownCause:
    """What no effect of the catalogue explains: its share of the gap, on what it depends, what it looks like."""

    share_of_gap: float
    where: tuple[str, ...]
    looks_like: str


@dataclass(frozen=True, slots=True)
class Place:
    """One cell of the map of where model and trial disagree: mean ``error`` of a channel there, and its z."""

    channel: str
    cell: Mapping[str, tuple[float, float]]
    windows: int
    error: float
    z: float


@dataclass(frozen=True, slots=True)
class Gap:
    """Mean distance of predicted from measured tracks [m], over windows that took no part in naming or fitting."""

    before_m: float
    after_m: float
    floor_m: float
    held_out_windows: int
    horizon_s: int

    @property
    def closed(self) -> float:
        """The share of what could be closed that is."""
        could = self.before_m - self.floor_m
        return (self.before_m - self.after_m) / could if could > 0.0 else 1.0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        plain = {key: getattr(self, key) for key in ("before_m", "after_m", "floor_m", "held_out_windows")}
        return {**plain, "closed": self.closed}


@dataclass(frozen=True, slots=True)
class Tracks:
    """Windows of H seconds [N]: measured and predicted tracks [N, H+1, 3] (north, east [m], heading [rad]).

    ``before`` is the reference model's, ``after`` that of the model with what other legs named, ``floor`` with what
    all legs together give; ``constant_velocity`` keeps the first speed. ``leg`` and ``start_s`` [N] say where and
    when.
    """

    measured: Floats
    before: Floats
    after: Floats
    floor: Floats
    constant_velocity: Floats
    leg: Ints
    start_s: Ints


@dataclass(frozen=True, slots=True)
class Ladder:
    """What a calibrator adds: mean distances [m] by rung, with 95 % intervals by legs, on held windows of legs that
    took no part.

    ``rungs`` are constant_velocity, reference, named, reference_calibrated and named_calibrated, those of the named
    model only where something was named. ``ratios`` are paired, of the first rung's mean distance to the second's.
    Without rungs ``why_not`` says why there are none.
    """

    horizon_s: int
    method: str
    windows: int = 0
    legs: int = 0
    rungs: Mapping[str, Interval] = field(default_factory=dict)
    ratios: Mapping[tuple[str, str], Interval] = field(default_factory=dict)
    why_not: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "horizon_s": self.horizon_s,
            "method": self.method,
            "windows": self.windows,
            "legs": self.legs,
            "mean_distance_m": {name: each.as_dict() for name, each in self.rungs.items()},
            "ratios": [{"of": one, "to": other, **each.as_dict()} for (one, other), each in self.ratios.items()],
            "why_not": self.why_not or None,
        }


@dataclass(frozen=True, slots=True)
class Correlation:
    """How the estimates of the named effects hang together: a name for each free coordinate, and the matrix [P,
    P]."""

    names: tuple[str, ...]
    matrix: Floats

    def entangled(self) -> list[tuple[str, str, float]]:
        """Pairs that these data cannot tell apart in size, and their correlation."""
        return correlated_pairs(self.names, self.matrix)


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """The trial to make next: what it is, which effects it separates, and the evidence expected from it."""

    what: str
    separates: tuple[str, str]
    expected_evidence: float
    minutes: float


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The whole of it."""

    verdict: Verdict
    tolerance: float
    effects: tuple[NamedEffect, ...]
    rivals: tuple[Rival, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    unknown: UnknownCause | None
    where: tuple[Place, ...]
    gap: Gap
    next_manoeuvre: Manoeuvre | None
    suspects: tuple[Suspect, ...] = ()
    tracks: Tracks | None = None
    remarks: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON object; numbers that are not finite become null."""
        return cast(dict[str, Any], finite(self._plain()))

    def _plain(self) -> dict[str, Any]:
        unknown, after = self.unknown, self.next_manoeuvre
        return {
            "verdict": self.verdict,
            "tolerance": self.tolerance,
            "effects": [each.as_dict() for each in self.effects],
            "rivals": [
                {"instead_of": each.instead_of, "name": each.name, "evidence": each.evidence}
                for each in self.rivals
            ],
            "indistinguishable": [list(group) for group in self.indistinguishable],
            "unknown": None
            if unknown is None
            else {
                "share_of_gap": unknown.share_of_gap,
                "where": list(unknown.where),
                "looks_like": unknown.looks_like,
            },
            "where": [
                {
                    "channel": each.channel,
                    "cell": {name: list(span) for name, span in each.cell.items()},
                    "windows": each.windows,
                    "error": each.error,
                    "z": each.z,
                }
                for each in self.where
            ],
            "gap": self.gap.as_dict(),
            "next_manoeuvre": None
            if after is None
            else {
                "what": after.what,
                "separates": list(after.separates),
                "expected_evidence": after.expected_evidence,
            },
            "remarks": list(self.remarks),
            "provenance": dict(self.provenance),
        }


@dataclass(frozen=True, slots=True)
class Consistency:
    """One contradiction: the sensor effect that explains it best, and its size.

    ``free`` and ``standard_errors`` are of its free coordinates, in the units of its parameters; ``p_value`` is
    corrected for the number of effects tested. ``alike`` are effects that without a ship model look the same.
    """

    effect: str
    free: tuple[float, ...]
    standard_errors: tuple[float, ...]
    p_value: float
    alike: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True)
class Extras:
    """What the page shows beside the diagnosis: the map of the reference model and of the repaired one, the
    sensors' contradictions, how the estimates are correlated, and what a calibrator adds (None where nobody
    looked)."""

    map: Map | None = None
    map_after: Map | None = None
    consistency: Sequence[Consistency] | None = None
    ladder: Ladder | None = None
    correlation: Correlation | None = None


def finite(value: Any) -> Any:
    """``value`` with everything in it that JSON knows."""
    if isinstance(value, dict):
        return {str(key): finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    return value
