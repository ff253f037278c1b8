"""What a diagnosis comes to: results that print, and go to JSON and back (:mod:`acquisition.core.serialisation`).

The fields that are not left out, in their order, are ``diagnosis.json`` and ``ladder.json``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field, computed_field

from acquisition.core.arrays import Floats, Ints
from acquisition.core.serialisation import Number, to_json
from analysis.estimation.likelihood import correlated_pairs
from hybrid.prediction.scores import Interval

Verdict = Literal["named", "nothing_missing", "unknown", "indistinguishable"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter's value with its 95 % interval, in its unit."""

    value: Number
    low: Number
    high: Number
    unit: str


@dataclass(frozen=True, slots=True)
class Suspect:
    """One effect of the catalogue as the ranking shows it.

    ``evidence`` is the log odds by which the model is better with it alone, ``p_value`` is corrected for the size
    of the catalogue. ``limit`` is the size of the first parameter that would be found in 9 of 10 such trials.
    """

    name: str
    family: str
    evidence: Number
    p_value: Number
    limit: Number
    unit: str


@dataclass(frozen=True, slots=True)
class Replication:
    """In how many of so many disjoint parts of a trial an effect is found by itself, with its sign in the whole."""

    parts: int
    found: int


@dataclass(frozen=True, slots=True)
class When:
    """The part of a trial in which an effect has the size that is given: a recording, until or since a time (UTC).

    ``low`` and ``high`` are the ends of the 95 % interval of that time.
    """

    recording: str | None = None
    since: str | None = None
    until: str | None = None
    low: str | None = None
    high: str | None = None


@dataclass(frozen=True, slots=True)
class Drift:
    """What an effect drifted from, evenly ``since`` a time ``until`` another (UTC), to the size that is given."""

    since: str
    until: str
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """An effect that was named, with its share of the gap on windows that took no part.

    Its ``scope`` says whether it is the ship's, the day's or a recording's. Where it is not the same in all of the
    trial, there is one for each part, each with its ``when``; the share of the gap, the chance and the replication
    are those of the whole. ``in_vessel`` says whether it is still there at the end and the ship's to keep.
    """

    name: str
    family: str
    kind: str
    share_of_gap: Number
    p_value: Number
    sentence: str
    parameters: Mapping[str, Estimate]
    replicated: Replication
    evidence: Annotated[Number, Field(exclude=True)]
    scope: str = "ship"
    when: When | None = None
    drift: Drift | None = None
    in_vessel: bool = True

    @property
    def part(self) -> str:
        """The part of the trial that the sizes are of, for a table; nothing where it is all of it."""
        if self.when is None:
            return "" if self.drift is None else f" at {self.drift.until}"
        if self.when.recording is not None:
            return f" in {self.when.recording}"
        return f" until {self.when.until}" if self.when.until else f" since {self.when.since}"


@dataclass(frozen=True, slots=True)
class Rival:
    """An effect that would explain almost as much ``instead_of`` a named one: ``evidence`` it lacks, log odds."""

    instead_of: str
    name: str
    evidence: Number


@dataclass(frozen=True, slots=True)
class UnknownCause:
    """What no effect of the catalogue explains: its share of the gap, on what it depends, what it looks like."""

    share_of_gap: Number
    where: tuple[str, ...]
    looks_like: str


@dataclass(frozen=True, slots=True)
class Remainder:
    """What stays unexplained beside effects that are named: its share of the force range and of the gap, on what it
    depends, what it looks like."""

    share_of_range: Number
    share_of_gap: Number
    where: tuple[str, ...]
    looks_like: Annotated[str, Field(exclude=True)] = ""


@dataclass(frozen=True, slots=True)
class RegimeEffect:
    """A force that the model lacks in a regime of operation, written as an effect (:mod:`hybrid.effects.regime`).

    ``within`` has the ends of each quantity's span, None where it is open; ``parameters`` its size;
    ``share_of_force`` is that of its axis' force that was missing before, ``after_m`` the mean distance on legs
    left out with it and those before it [m].
    """

    name: str
    sentence: str
    axis: str
    within: Mapping[str, tuple[float | None, float | None]]
    grows_with: str | None
    at: Number
    parameters: Mapping[str, Estimate]
    share_of_force: Number
    replicated: Replication
    after_m: Number


@dataclass(frozen=True, slots=True)
class Place:
    """One cell of the map of where model and trial disagree: mean ``error`` of a channel there, and its z."""

    channel: str
    cell: Mapping[str, tuple[float, float]]
    windows: int
    error: Number
    z: Number


@dataclass(frozen=True, slots=True)
class Gap:
    """Mean distance of predicted from measured tracks [m], over windows that took no part in naming or fitting.

    ``constant_velocity_m`` is that of holding the surge, sway and yaw rate of a window's start.
    """

    before_m: Number
    after_m: Number
    floor_m: Number
    constant_velocity_m: Number
    held_out_windows: int
    horizon_s: Annotated[int, Field(exclude=True)]

    @computed_field  # type: ignore[prop-decorator]
    @property
    def closed(self) -> float:
        """The share of what could be closed that is."""
        could = self.before_m - self.floor_m
        return (self.before_m - self.after_m) / could if could > 0.0 else 1.0


@dataclass(frozen=True, slots=True)
class Tracks:
    """Windows of H seconds [N]: measured and predicted tracks [N, H+1, 3] (north, east [m], heading [rad]).

    ``before`` is the reference model's, ``after`` that of the model with what other legs named, ``floor`` with what
    all legs together give; ``constant_velocity`` keeps the first speed. ``leg`` and ``start_s`` [N] say where and
    when, ``controls`` what the actuators did, by channel [N, H+1].
    """

    measured: Floats
    before: Floats
    after: Floats
    floor: Floats
    constant_velocity: Floats
    leg: Ints
    start_s: Ints
    controls: Mapping[str, Floats]


@dataclass(frozen=True, slots=True)
class Ratio:
    """The mean distance ``of`` one rung over that of another, ``to``, paired, with its 95 % interval."""

    of: str
    to: str
    value: Number
    low: Number
    high: Number


@dataclass(frozen=True, slots=True)
class Ladder:
    """What a calibrator adds: mean distances [m] by rung, with 95 % intervals by legs, on held windows of legs that
    took no part.

    The rungs are constant_velocity, reference, named, reference_calibrated and named_calibrated, those of the named
    model only where something was named. Without rungs ``why_not`` says why there are none.
    """

    horizon_s: int
    method: str
    windows: int = 0
    legs: int = 0
    mean_distance_m: Mapping[str, Interval] = field(default_factory=dict)
    ratios: tuple[Ratio, ...] = ()
    why_not: str | None = None

    def ratio(self, of: str, to: str) -> Ratio:
        """The ratio of two rungs. Raises :class:`StopIteration` where it is none of :attr:`ratios`."""
        return next(each for each in self.ratios if (each.of, each.to) == (of, to))


@dataclass(frozen=True, slots=True)
class Correlation:
    """How the estimates of the named effects hang together: a name for each free coordinate, and the matrix [P,
    P]."""

    names: tuple[str, ...]
    matrix: Floats

    def correlated_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs that these data cannot tell apart in size, and their correlation."""
        return correlated_pairs(self.names, self.matrix)


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """The trial to make next: what it is, which effects it separates, and the evidence expected from it."""

    what: str
    separates: tuple[str, str]
    expected_evidence: Number
    minutes: Annotated[float, Field(exclude=True)]


@dataclass(frozen=True, slots=True)
class IdentifiedCorrection:
    """A refit of the model's coefficients that a diagnosis starts from, and what its structure can close.

    ``before_m`` and ``after_m`` are mean distances over windows of legs that took no part in the refit, of the
    model as it was and with the coefficients of the other legs; ``applied`` says whether the diagnosis starts from
    the refit, which it does where these legs come closer. ``forces`` are what the refit to all legs changes, root
    mean square along the trial as shares of the range of the forces; ``coefficients`` what it comes to and
    ``start`` what it came from; ``known`` are those that the data tell by themselves.
    """

    applied: bool
    constant_velocity_m: Number
    before_m: Number
    after_m: Number
    held_out_windows: int
    forces: Mapping[str, Number]
    coefficients: Mapping[str, Estimate]
    start: Mapping[str, Number]
    known: tuple[str, ...]
    name: str = "identified_correction"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The whole of it: what is named or not, how sure that is, and what it changes; ``diagnosis.json``."""

    verdict: Verdict
    tolerance: float
    effects: tuple[NamedEffect, ...]
    rivals: tuple[Rival, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    unknown: UnknownCause | None
    where: tuple[Place, ...]
    gap: Gap
    next_manoeuvre: Manoeuvre | None
    suspects: Annotated[tuple[Suspect, ...], Field(exclude=True)] = ()
    tracks: Annotated[Tracks | None, Field(exclude=True)] = None
    remarks: tuple[str, ...] = ()
    remainder: Remainder | None = None
    regimes: tuple[RegimeEffect, ...] = ()
    identified: IdentifiedCorrection | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The contract's JSON object; numbers that are not finite are None."""
        return dict(to_json(self))

    def __str__(self) -> str:
        """The verdict, the effects with their 95 % intervals and the gap, as a short table."""
        lines = [f"{self.verdict.replace('_', ' ')}, {100.0 * self.tolerance:g} % of the force range tolerated"]
        rows = [
            (f"{each.name}{each.part}", name, f"{size.value:.4g}", f"{size.low:.4g} to {size.high:.4g}", size.unit)
            for each in self.effects
            for name, size in each.parameters.items()
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        if self.unknown is not None:
            lines.append(f"unknown: {self.unknown.looks_like}")
        if self.remainder is not None:
            lines.append(f"remains: {self.remainder.looks_like}")
        gap = self.gap
        lines.append(
            f"mean distance over {gap.horizon_s} s: {gap.before_m:.3f} m before, {gap.after_m:.3f} m after, "
            f"{gap.floor_m:.3f} m at best ({gap.held_out_windows} windows that took no part)"
        )
        return "\n".join(lines)


FORCES = ("surge_force_n", "sway_force_n", "yaw_moment_nm")
"""The forces of a map, along the ship, across and in yaw."""


@dataclass(frozen=True, slots=True)
class Map:
    """Where model and trial disagree: all cells, and the force that the model lacks second by second.

    ``force`` [T, 3] is the reconstructed slow force [N, N, N m], ``quantities`` [T] what the cells are of.
    """

    places: tuple[Place, ...]
    force: Floats
    quantities: dict[str, Floats]


@dataclass(frozen=True, slots=True)
class Consistency:
    """One contradiction: the sensor effect that explains it best, and its size.

    ``free`` and ``standard_errors`` are of its free coordinates, in the units of its parameters; ``p_value`` is
    corrected for the number of effects tested. ``alike`` are effects that without a ship model look the same.
    """

    effect: str
    free: tuple[Number, ...]
    standard_errors: tuple[Number, ...]
    p_value: Number
    alike: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True)
class Extras:
    """What the page shows beside the diagnosis: the map of the reference model and of the repaired one, the
    sensors' contradictions, how the estimates are correlated, and what a calibrator adds (None where nobody
    looked)."""

    map: Map | None = None
    map_after: Map | None = None
    consistency: tuple[Consistency, ...] | None = None
    ladder: Ladder | None = None
    correlation: Correlation | None = None

    @property
    def maps(self) -> dict[str, Map | None]:
        """Both maps, before and after."""
        return {"before": self.map, "after": self.map_after}
