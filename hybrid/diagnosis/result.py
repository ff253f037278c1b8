"""Results of a diagnosis, which print and are written to and read from JSON
(:mod:`seatrial.acquisition.core.result`).

The serialised fields, in their order, are ``diagnosis.json`` and ``ladder.json``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field, computed_field

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.result import Number, to_json
from seatrial.analysis.estimation.likelihood import correlated_pairs
from seatrial.hybrid.prediction.scores import Interval

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
    """One effect of the catalogue in the ranking.

    ``evidence`` is the log odds by which the model is better with it alone, ``p_value`` is corrected for the
    size of the catalogue. ``limit`` is the size of the first parameter that would be found in 9 of 10 such
    trials.
    """

    name: str
    family: str
    evidence: Number
    p_value: Number
    limit: Number
    unit: str


@dataclass(frozen=True, slots=True)
class Replication:
    """In how many disjoint ``parts`` of a trial an effect is ``found`` with its sign in the whole."""

    parts: int
    found: int


@dataclass(frozen=True, slots=True)
class When:
    """The part of a trial in which an effect has the given size: a recording, until or since a time (UTC).

    ``low`` and ``high`` are the ends of the 95 % interval of that time.
    """

    recording: str | None = None
    since: str | None = None
    until: str | None = None
    low: str | None = None
    high: str | None = None


@dataclass(frozen=True, slots=True)
class EffectDrift:
    """The size from which an effect drifted linearly to its own, ``since`` one time ``until`` another (UTC)."""

    since: str
    until: str
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """A named effect, with its share of the gap on windows not used for fitting.

    ``scope`` is the ship, the day or a recording. An effect that varies over the trial has one entry for each
    part, each with its ``when``; the share of the gap, the p-value and the replication are those of the whole.
    ``in_vessel`` says whether it is still present at the end and belongs to the ship, and so is written to the
    vessel file.
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
    drift: EffectDrift | None = None
    in_vessel: bool = True

    @property
    def part(self) -> str:
        """The part of the trial of these sizes, for a table; empty if all of it."""
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
    """What no effect of the catalogue explains: its share of the gap, what it depends on, what it resembles."""

    share_of_gap: Number
    where: tuple[str, ...]
    looks_like: str


@dataclass(frozen=True, slots=True)
class Remainder:
    """What remains unexplained beside the named effects: its share of the force range and of the gap, what it
    depends on, what it resembles."""

    share_of_range: Number
    share_of_gap: Number
    where: tuple[str, ...]
    looks_like: Annotated[str, Field(exclude=True)] = ""


@dataclass(frozen=True, slots=True)
class RegimeEffect:
    """A force that the model lacks in an operating regime, written as an effect
    (:mod:`seatrial.hybrid.effects.regime`).

    ``within`` has the ends of each quantity's span, None if open; ``parameters`` its size; ``share_of_force``
    its share of the missing force of its axis, ``after_m`` the mean distance on held-out legs with it and those
    before it [m].
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
class GapCell:
    """One cell of the map of where model and trial disagree: mean ``error`` of a channel there, and its z."""

    channel: str
    cell: Mapping[str, tuple[float, float]]
    windows: int
    error: Number
    z: Number


@dataclass(frozen=True, slots=True)
class Gap:
    """Mean distance of predicted from measured tracks [m], over windows not used for naming or fitting.

    ``constant_velocity_m`` is that of keeping surge, sway and yaw rate of a window's start.
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
        """The share closed of the gap that could be closed."""
        could = self.before_m - self.floor_m
        return (self.before_m - self.after_m) / could if could > 0.0 else 1.0

    def distances(self, named: bool) -> str:
        """The distances in words, for a terminal; before and after only where effects were named."""
        if not named:
            return f"{self.before_m:.3f} m" + (f", {self.floor_m:.3f} m at best" * (self.floor_m < self.before_m))
        return f"{self.before_m:.3f} m before, {self.after_m:.3f} m after, {self.floor_m:.3f} m at best"


@dataclass(frozen=True, slots=True)
class Tracks:
    """Windows of H seconds [N]: measured and predicted tracks [N, H+1, 3] (north, east [m], heading [rad]).

    ``before`` is the reference model's, ``after`` that with the effects from other legs, ``floor`` that with
    the effects from all legs; ``constant_velocity`` keeps the initial speeds. ``leg`` and ``start_s`` [N]
    locate the windows, ``controls`` has the actuator channels [N, H+1].
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
    """The gain of a calibrator: mean distances [m] by rung, with 95 % intervals over legs, on held windows of
    held-out legs.

    The rungs are constant_velocity, reference, named, reference_calibrated and named_calibrated, those of the
    named model only if something was named. Without rungs ``why_not`` gives the reason.
    """

    horizon_s: int
    method: str
    windows: int = 0
    legs: int = 0
    mean_distance_m: Mapping[str, Interval] = field(default_factory=dict)
    ratios: tuple[Ratio, ...] = ()
    why_not: str | None = None

    def ratio(self, of: str, to: str) -> Ratio:
        """The ratio of two rungs. Raises :class:`StopIteration` if it is none of :attr:`ratios`."""
        return next(ratio for ratio in self.ratios if (ratio.of, ratio.to) == (of, to))


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlations of the estimates of the named effects: ``names`` of free coordinates, ``matrix`` [P, P]."""

    names: tuple[str, ...]
    matrix: Floats

    def correlated_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs whose sizes these data cannot separate, with their correlation."""
        return correlated_pairs(self.names, self.matrix)


@dataclass(frozen=True, slots=True)
class NextTrial:
    """The next trial: the manoeuvre, the effects it separates, and the evidence expected from it."""

    what: str
    separates: tuple[str, str]
    expected_evidence: Number
    minutes: Annotated[float, Field(exclude=True)]


@dataclass(frozen=True, slots=True)
class IdentifiedCorrection:
    """A refit of the model's coefficients that a diagnosis starts from, and how much the model structure can
    close.

    ``before_m`` and ``after_m`` are mean distances over windows of held-out legs, of the model as it was and
    with the coefficients fitted to the other legs; ``applied`` says whether the diagnosis starts from the
    refit, which it does if it improves these. ``forces`` are the changes of the forces by the refit to all
    legs, root mean square along the trial as shares of the force range; ``coefficients`` are its values and
    ``start`` the ones before; ``known`` are those that the data determine.
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
    """The named effects, how certain they are, and how they change predictions: ``diagnosis.json``."""

    verdict: Verdict
    tolerance: float
    effects: tuple[NamedEffect, ...]
    rivals: tuple[Rival, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    unknown: UnknownCause | None
    where: tuple[GapCell, ...]
    gap: Gap
    next_manoeuvre: NextTrial | None
    suspects: Annotated[tuple[Suspect, ...], Field(exclude=True)] = ()
    tracks: Annotated[Tracks | None, Field(exclude=True)] = None
    remarks: tuple[str, ...] = ()
    remainder: Remainder | None = None
    regimes: tuple[RegimeEffect, ...] = ()
    identified: IdentifiedCorrection | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The JSON object; numbers that are not finite are None."""
        return dict(to_json(self))

    def __str__(self) -> str:
        """The verdict, the effects with their 95 % intervals and the gap, as a short table."""
        lines = [f"{self.verdict.replace('_', ' ')}, {100.0 * self.tolerance:g} % of the force range tolerated"]
        rows = [
            (
                f"{effect.name}{effect.part}",
                name,
                f"{size.value:.4g}",
                f"{size.low:.4g} to {size.high:.4g}",
                size.unit,
            )
            for effect in self.effects
            for name, size in effect.parameters.items()
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        if self.unknown is not None:
            lines.append(f"unknown: {self.unknown.looks_like}")
        if self.remainder is not None:
            lines.append(f"remains: {self.remainder.looks_like}")
        gap = self.gap
        windows = f"({gap.held_out_windows} held-out windows)"
        lines.append(f"mean distance over {gap.horizon_s} s: {gap.distances(bool(self.effects))} {windows}")
        return "\n".join(lines)


FORCES = ("surge_force_n", "sway_force_n", "yaw_moment_nm")
"""The forces of a map: surge, sway and yaw."""


@dataclass(frozen=True, slots=True)
class Map:
    """Where model and trial disagree: all cells, and the missing force second by second.

    ``force`` [T, 3] is the reconstructed slow force [N, N, N m], ``quantities`` [T] are those of the cells.
    """

    places: tuple[GapCell, ...]
    force: Floats
    quantities: dict[str, Floats]


@dataclass(frozen=True, slots=True)
class SensorContradiction:
    """A contradiction between sensors: the sensor fault that explains it best, and its size.

    ``free`` and ``standard_errors`` are of its free coordinates, in the units of its parameters; ``p_value`` is
    corrected for the number of effects tested. ``alike`` are effects that are indistinguishable without a ship
    model.
    """

    effect: str
    free: tuple[Number, ...]
    standard_errors: tuple[Number, ...]
    p_value: Number
    alike: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True)
class Extras:
    """What the page shows besides the diagnosis: the maps of the reference model and of the repaired one,
    contradictions between sensors, correlations of the estimates, and the gain of a calibrator (None if not
    computed)."""

    map: Map | None = None
    map_after: Map | None = None
    consistency: tuple[SensorContradiction, ...] | None = None
    ladder: Ladder | None = None
    correlation: Correlation | None = None

    @property
    def maps(self) -> dict[str, Map | None]:
        """Both maps, before and after."""
        return {"before": self.map, "after": self.map_after}
