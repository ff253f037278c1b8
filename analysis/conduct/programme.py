"""A programme of trials: its runs by kind, side, speed and helm, what each is for, and their order.

A programme is a TOML file, the table ``[programme]`` and one ``[[run]]`` each. What it leaves open is proposed: a
heading into the wind (both ways for speed runs), the nearest one to it with room in the water that is deep enough,
and of the runs with the first priority the order with the least time between them.

Times are multiples of L / V, the time in which the ship sails its length, by which those of tests go (Nomoto et al.
1957).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace
from itertools import combinations, pairwise, permutations
from math import inf, nan
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pymap3d
from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config import declarations, run_sheet
from seatrial.acquisition.core import errors, files, result, ship
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.manoeuvres import criteria

Kind = Literal["turning_circle", "zigzag", "stopping", "pull_out", "speed_run", "crabbing", "thruster_test"]
Side = Literal["port", "starboard", ""]
Template = Literal["imo", "imo_speed_trials", "identification", "dp_acceptance"]


def _between(low: float, high: float, words: str) -> AfterValidator:
    """Refuse a number out of a range, in words that say what it can be."""

    def check(value: float) -> float:
        if not low <= value <= high:
            raise ValueError(f"it can be {low:g} to {high:g} {words}")
        return value

    return AfterValidator(check)


def _printable(text: str) -> str:
    """Refuse what a line of a terminal or a page does not show."""
    if not text.isprintable():
        raise ValueError("it has characters that are not shown, as line breaks or control characters")
    return text


Speed = Annotated[float, _between(0.05, 35.0, "m/s: a speed in knots times 0.5144")]
Compass = Annotated[float, _between(0.0, 360.0, "deg, clockwise from true north")]
Area = tuple[tuple[declarations.Finite, declarations.Finite], ...]
Minutes = Annotated[float, _between(0.1, 20_160.0, "minutes, at most two weeks")]

SIDED = ("turning_circle", "zigzag", "pull_out", "crabbing")
STEERED = ("turning_circle", "zigzag", "pull_out")
SIDES: tuple[Side, Side] = ("starboard", "port")
_LENGTHS_OF_RUN = {"turning_circle": 0.05, "zigzag": 7.0, "stopping": 30.0, "pull_out": 25.0, "crabbing": 10.0}
"""How long a run takes in L / V: a circle for each degree, a zigzag for each swing."""
_LENGTHS_AHEAD = {"turning_circle": 8.0, "zigzag": 30.0, "stopping": 20.0, "pull_out": 8.0, "crabbing": 5.0}
"""The room that a run takes ahead, in ship lengths, besides that of its approach."""
_REGAINED_LENGTHS = {"turning_circle": 10.0, "pull_out": 10.0, "stopping": 40.0, "crabbing": 20.0}
"""How long the ship takes to its speed again, in L / V."""
_TURN_LENGTHS = 12.0  # of a turn by 180 deg, in L / V
_STEADY_LENGTHS, _LEAST_STEADY_S = 2.0, 30.0
_MOST_PERMUTED = 7  # runs whose order is chosen among all orders
_HEADING_STEP_DEG = 10
_SPEED_RUN_S = 600.0  # ISO 15016:2015: ten minutes at least, over one mile
_LEAST_ACROSS_LENGTHS, _WIDEST_AREA_M = 5.0, 500_000.0
_THRUSTER_S, _CRAB_S, _SLOW_MPS = 60.0, 120.0, 0.5


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class PlannedRun:
    """A run of a programme.

    ``helm_deg`` is the angle of what steers the ship, without sign; ``switch_deg`` the heading at which a zigzag's
    helm is reversed, ``swings`` how often the helm is over; ``turn_deg`` ends a circle. ``speed_mps`` is the speed
    of the approach, by default the programme's; ``heading_deg`` its heading, by default proposed. ``astern`` is
    whether a stop is made with thrust astern. ``held_s`` is how long a speed run, a crabbing or a thruster test
    lasts, ``thruster`` the one tested. Of the ``priority`` 1 is sailed first. ``purpose`` names criteria and
    coefficients. ``most_beaufort`` is the wind it may have.
    """

    kind: Kind
    side: Side = ""
    helm_deg: Annotated[float, Field(gt=0.0, le=90.0)] | None = None
    switch_deg: Annotated[float, Field(gt=0.0, le=90.0)] | None = None
    swings: Annotated[int, Field(ge=3, le=20)] = 4
    turn_deg: Annotated[float, Field(ge=180.0, le=1800.0)] = 540.0
    speed_mps: Speed | None = None
    heading_deg: Compass | None = None
    astern: bool = True
    held_s: Annotated[float, _between(5.0, 86_400.0, "s, at most a day")] | None = None
    thruster: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{0,40}$")] = ""
    repeats: Annotated[int, Field(ge=1, le=20)] = 1
    priority: Annotated[int, Field(ge=1, le=9)] = 5
    purpose: tuple[Annotated[str, AfterValidator(_printable)], ...] = ()
    most_beaufort: Annotated[int, Field(ge=0, le=12)] = 5
    minutes: Minutes | None = None

    @model_validator(mode="after")
    def _check_completeness(self) -> PlannedRun:
        if (self.kind in STEERED) != (self.helm_deg is not None):
            raise ValueError(f"a {self.kind} {'needs' if self.kind in STEERED else 'has no'} helm_deg")
        if self.kind == "zigzag" and self.switch_deg is None:
            raise ValueError("a zigzag needs switch_deg")
        if (self.kind in SIDED) != bool(self.side):
            raise ValueError(f"a {self.kind} {'needs a' if self.kind in SIDED else 'has no'} side")
        if self.kind == "thruster_test" and not self.thruster:
            raise ValueError("a thruster_test needs the name of its thruster")
        return self

    @property
    def name(self) -> str:
        """What the run is called, as `seatrial manoeuvres` does."""
        helm = f"{self.helm_deg or 0.0:g}"
        return {
            "turning_circle": f"turning circle {helm} deg",
            "zigzag": f"zigzag {helm}/{self.switch_deg or 0.0:g}",
            "stopping": criteria.FULL_ASTERN if self.astern else "stopping without thrust",
            "pull_out": f"pull-out from {helm} deg",
            "speed_run": "speed run",
            "crabbing": "crabbing",
            "thruster_test": f"thruster test {self.thruster}",
        }[self.kind]

    @property
    def sided_name(self) -> str:
        """The name with the side."""
        return f"{self.name} to {self.side}" if self.side else self.name

    @property
    def sign(self) -> float:
        """1 to starboard, else -1."""
        return 1.0 if self.side == "starboard" else -1.0

    @property
    def duration_s(self) -> float:
        """How long it is held, where time ends it [s]."""
        default = {"speed_run": _SPEED_RUN_S, "thruster_test": _THRUSTER_S, "crabbing": _CRAB_S}
        return self.held_s or default.get(self.kind, inf)


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class ProgrammeSection:
    """What all runs of a programme have in common.

    ``speed_mps`` is the test speed. ``vessel`` is the ship's file, relative to the programme's, or a vessel that
    comes with Seatrial: its model predicts the runs that remain. ``steady_s`` is how long speed, heading, rate of
    turn and helm have to be steady before an execute, by default the time of two ship lengths and at least half a
    minute. ``wind_from_deg`` and ``current_to_deg`` are those expected. ``area`` are corners (latitude, longitude)
    of the water that is deep enough, ``least_depth_m`` how deep that is: less is a fault of a run, where depths are
    recorded. ``minutes`` is the time that there is.

    """

    name: Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]
    length_m: Annotated[float, _between(0.5, 600.0, "m, between perpendiculars")]
    speed_mps: Speed
    vessel: str = ""
    steady_s: Annotated[float, _between(5.0, 3600.0, "s: without it, the time of two ship lengths")] | None = None
    wind_from_deg: Compass | None = None
    current_to_deg: Compass | None = None
    area: Area = ()
    least_depth_m: Annotated[float, _between(0.1, 11_000.0, "m")] | None = None
    minutes: Minutes | None = None

    @field_validator("area")
    @classmethod
    def _check_area(cls, area: Area, section: ValidationInfo) -> Area:
        if not area:
            return area
        if len(area) < 3:
            raise ValueError("an area has three corners or more")
        for number, (latitude_deg, longitude_deg) in enumerate(area, 1):
            if abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
                raise ValueError(
                    f"corner {number}, {latitude_deg:g} and {longitude_deg:g}, is not on the earth: a corner is "
                    "latitude (-90 to 90), then longitude (-180 to 180), in degrees"
                )
        across_m, least_m = distance_across_m(area), _LEAST_ACROSS_LENGTHS * section.data.get("length_m", 0.0)
        if across_m < least_m:
            raise ValueError(
                f"it is {across_m:,.0f} m across, less than {_LEAST_ACROSS_LENGTHS:g} ship lengths: no run has "
                "room in it; correct the corners, or leave the area out"
            )
        if across_m > _WIDEST_AREA_M:
            raise ValueError(
                f"it is {across_m / 1000.0:,.0f} km across, more than {_WIDEST_AREA_M / 1000.0:g} km: correct the "
                "corner that is far off, or the order of latitude and longitude"
            )
        if sides_cross(area):
            raise ValueError("its sides cross: give the corners in their order along the edge")
        return area


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class TrialProgramme(result.Result):
    """A programme: what is common to its runs, and the runs in their order."""

    programme: ProgrammeSection
    run: tuple[PlannedRun, ...]
    view = "seatrial.analysis.conduct.programme:programme_view"
    drawing = "seatrial.analysis.conduct.programme:draw_programme"
    frame = "run"

    @model_validator(mode="after")
    def _check_runs(self) -> TrialProgramme:
        if not self.run:
            raise ValueError("a programme has one run or more")
        return self

    @property
    def into_deg(self) -> float | None:
        """The heading into the wind that is expected, without one into the current; None where neither is."""
        common = self.programme
        if common.wind_from_deg is None and common.current_to_deg is not None:
            return float(ship.wrap_360(common.current_to_deg + 180.0))
        return common.wind_from_deg

    @property
    def length_s(self) -> float:
        """L / V, the time in which the ship sails its length [s]."""
        return self.programme.length_m / self.programme.speed_mps

    @property
    def steady_s(self) -> float:
        """How long an approach has to be steady [s]."""
        return self.programme.steady_s or max(_STEADY_LENGTHS * self.length_s, _LEAST_STEADY_S)

    def vessel_beside(self, path: Path) -> str | Path:
        """The vessel of the programme at a path: its file beside that, else the name; empty without one."""
        beside = path.parent / self.programme.vessel
        return beside if self.programme.vessel and beside.is_file() else self.programme.vessel

    def speed_mps(self, run: PlannedRun) -> float:
        """The speed of a run's approach."""
        return run.speed_mps or self.programme.speed_mps

    def minutes_of(self, run: PlannedRun) -> float:
        """How long a run takes from its execute on [min]."""
        if run.minutes:
            return run.minutes
        factor = {"turning_circle": run.turn_deg, "zigzag": float(run.swings)}.get(run.kind, 1.0)
        lengths_s = _LENGTHS_OF_RUN.get(run.kind, 0.0) * factor * self.programme.length_m / self.speed_mps(run)
        return min(max(lengths_s, 20.0), run.duration_s) / 60.0 if lengths_s else run.duration_s / 60.0

    def minutes_between(self, last: PlannedRun | None, following: PlannedRun) -> float:
        """The time from the end of a run to the execute of the next [min]: the turn to its heading, the speed
        regained, and a steady approach."""
        if last is None:
            return self.steady_s / 60.0
        turn_deg = 90.0
        if last.heading_deg is not None and following.heading_deg is not None:
            circled_deg = last.sign * last.turn_deg if last.kind == "turning_circle" else 0.0
            turn_deg = abs(float(ship.angle_difference(last.heading_deg + circled_deg, following.heading_deg)))
        lengths = _TURN_LENGTHS * turn_deg / 180.0 + _REGAINED_LENGTHS.get(last.kind, 5.0)
        return (lengths * self.length_s + self.steady_s) / 60.0

    def minutes_before_each(self, last: PlannedRun | None, runs: Sequence[PlannedRun]) -> float:
        """The time before each of the runs [min], the first after the ``last`` one."""
        return sum(self.minutes_between(before, run) for before, run in pairwise([last, *runs]) if run)

    @property
    def total_minutes(self) -> float:
        """How long all runs and the times between them take [min]."""
        runs = [run for run in self.run for _ in range(run.repeats)]
        return self.minutes_before_each(None, runs) + sum(map(self.minutes_of, runs))

    def as_dict(self) -> dict[str, Any]:
        """The tables of the file, with the minutes of each run."""
        runs = [
            {"name": run.sided_name, **non_default_values_of_run(run), "minutes": round(self.minutes_of(run), 1)}
            for run in self.run
        ]
        return {
            "programme": _non_empty_values(self.programme),
            "total_minutes": round(self.total_minutes, 1),
            "run": runs,
        }

    def save(self, path: Path | str) -> Path:
        """Write the TOML file. One that is there is not replaced, unless it holds this programme to the byte, as
        people edit programmes. Raises :class:`StorageError`."""
        text = programme_text(self)
        if Path(path).is_file() and Path(path).read_bytes() != text.encode():
            raise errors.StorageError(
                "already exists", where=str(path), why="it is not what would be written: it may have been edited",
                fix="choose another file, or delete it",
            )  # fmt: skip
        return files.write_text(path, text)


def _non_empty_values(section: Any) -> dict[str, Any]:
    """What a section states besides its required fields' order."""
    return {entry.name: getattr(section, entry.name) for entry in fields(section)
            if getattr(section, entry.name) not in (None, "", ())}  # fmt: skip


def non_default_values_of_run(run: PlannedRun) -> dict[str, Any]:
    """What a run states."""
    values = {**run_sheet.non_default_values(run), "kind": run.kind}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def load_programme(path: Path | str) -> TrialProgramme:
    """A programme from its TOML file. Raises :class:`ConfigurationError`, naming the line."""
    return files.load_toml(path, TrialProgramme)


_COMMENTS = {
    "length_m": "between perpendiculars",
    "speed_mps": "of the approach, through the water",
    "vessel": "its model predicts the runs that remain",
    "steady_s": "how long speed, heading, rate and helm are steady before an execute",
    "wind_from_deg": "headings are proposed into it, unless a run states its own",
    "area": "corners (latitude, longitude) of the water that is deep enough",
    "least_depth_m": "four draughts, as IMO MSC.137(76) and MSC/Circ.1053 ask: a run in less is invalid",
    "minutes": "the time that there is",
}  # fmt: skip


def programme_text(programme: TrialProgramme) -> str:
    """The TOML file of a programme."""
    lines = [
        "# A programme of trials: `seatrial conduct` says what comes next. Every run may also state speed_mps,",
        "# heading_deg, repeats, priority (1 is sailed first), most_beaufort and minutes.",
        "",
        "[programme]",
    ]
    for name, value in _non_empty_values(programme.programme).items():
        comment = f"{' ' * 4}# {_COMMENTS[name]}" if name in _COMMENTS else ""
        lines.append(f"{_toml_line(name, value)}{comment}")
    for run in programme.run:
        lines += [
            "",
            "[[run]]",
            *(_toml_line(name, value) for name, value in non_default_values_of_run(run).items()),
        ]
    return "\n".join(lines) + "\n"


def _toml_line(name: str, value: Any) -> str:
    """A key with its value, whole numbers without a point, as people write them."""
    return f"{name} = {files.toml_value(int(value) if isinstance(value, float) and value.is_integer() else value)}"


def _imo_runs() -> list[PlannedRun]:
    """The tests of MSC.137(76), 5.3, to both sides, the full astern stop last: it takes longest to regain speed."""
    ways = {10.0: ("first overshoot of 10/10", "second overshoot of 10/10", "initial turning"),
            20.0: ("first overshoot of 20/20",)}  # fmt: skip
    circles = [PlannedRun(kind="turning_circle", side=side, helm_deg=criteria.TURNING_HELM_DEG, priority=1,
                          purpose=("advance", "tactical diameter")) for side in SIDES]  # fmt: skip
    zigzags = [PlannedRun(kind="zigzag", side=side, helm_deg=angle, switch_deg=angle, priority=1, purpose=purpose)
               for angle, purpose in ways.items() for side in SIDES]  # fmt: skip
    return [*zigzags, *circles, PlannedRun(kind="stopping", priority=2, purpose=("track reach",))]


def _speed_trial_runs(speed_mps: float) -> list[PlannedRun]:
    """Four double runs at three powers, two of them at that of the tests (ISO 15016:2015): the speeds are those
    that 65, 85 and 100 % of the power give, by the cube."""
    return [PlannedRun(kind="speed_run", speed_mps=round(speed_mps * (power / 0.85) ** (1.0 / 3.0), 2),
                       repeats=repeats, priority=3, purpose=("speed at a power",))
            for power, repeats in ((0.65, 2), (0.85, 4), (1.0, 2))]  # fmt: skip


def _identification_runs(speed_mps: float) -> list[PlannedRun]:
    """Zigzags and circles of small and large helms at two speeds, pull-outs and a stop: drift and rate of turn
    apart and together (ITTC 7.5-04-02-01 names them for system identification).

    Those come first that tell most for their time, the other side after: of a tanker, R/V Gunnerus and a twin-screw
    vessel they tell within the first half of the time nine tenths of what the whole programme tells of the
    coefficients (tests/benchmarks/programme_information.py).
    """
    full_mps, slow_mps = round(speed_mps, 2), round(0.6 * speed_mps, 2)

    def to_both_sides(priority: int, *purpose: str, **stated: Any) -> list[PlannedRun]:
        return [PlannedRun(side=side, priority=priority + later, purpose=purpose, **stated)
                for later, side in enumerate(SIDES)]  # fmt: skip

    def zigzags(priority: int, angle_deg: float, run_mps: float) -> list[PlannedRun]:
        angles = {"helm_deg": angle_deg, "switch_deg": angle_deg, "swings": 6}
        return to_both_sides(priority, "yaw damping", "rudder force", kind="zigzag", speed_mps=run_mps, **angles)

    circles = [to_both_sides(priority, "cross-flow drag", "drift and turning", kind="turning_circle", helm_deg=helm)
               for priority, helm in ((1, 35.0), (3, 20.0))]  # fmt: skip
    runs = [PlannedRun(kind="speed_run", speed_mps=run_mps, repeats=2, held_s=180.0, priority=2,
                       purpose=("resistance", "thrust")) for run_mps in (slow_mps, full_mps)]  # fmt: skip
    return [
        *to_both_sides(1, "course stability", kind="pull_out", helm_deg=20.0),
        *circles[0],
        *zigzags(1, 20.0, full_mps),
        PlannedRun(kind="stopping", priority=1, purpose=("thrust astern",)),
        *runs,
        *zigzags(2, 20.0, slow_mps),
        *zigzags(3, 10.0, full_mps),
        *circles[1],
    ]


def _dp_runs(thrusters: Sequence[str]) -> list[PlannedRun]:
    """Each thruster alone, crabbing to both sides, and a stop: what of the acceptance of a DP ship `seatrial
    manoeuvres` knows; keeping a position with failures is not among it."""
    tests = [PlannedRun(kind="thruster_test", thruster=name, speed_mps=_SLOW_MPS, priority=1,
                        purpose=("thruster acceptance",)) for name in thrusters]  # fmt: skip
    crabs = [PlannedRun(kind="crabbing", side=side, speed_mps=_SLOW_MPS, priority=2, purpose=("sideways thrust",))
             for side in SIDES]  # fmt: skip
    return [*tests, *crabs, PlannedRun(kind="stopping", priority=3, purpose=("stopping",))]


TEMPLATES: dict[str, Callable[[float, Sequence[str]], list[PlannedRun]]] = {
    "imo": lambda speed_mps, thrusters: _imo_runs(),
    "imo_speed_trials": lambda speed_mps, thrusters: [*_imo_runs(), *_speed_trial_runs(speed_mps)],
    "identification": lambda speed_mps, thrusters: _identification_runs(speed_mps),
    "dp_acceptance": lambda speed_mps, thrusters: _dp_runs(thrusters),
}
"""The runs of a template, by the test speed [m/s] and the names of the ship's thrusters."""


def programme_from_template(
    template: str, length_m: float, speed_mps: float, vessel: str = "", thrusters: Sequence[str] = (),
    largest_helm_deg: float = criteria.TURNING_HELM_DEG, **section: Any,
) -> TrialProgramme:  # fmt: skip
    """A template's programme for a ship, with headings and order proposed.

    ``section`` are further values of :class:`ProgrammeSection`. A circle's helm is at most the ship's largest.
    Raises :class:`ConfigurationError` for an unknown template, and where a ship has nothing to test.

    """
    if template not in TEMPLATES:
        raise errors.ConfigurationError(f"no template {template!r}", fix=f"use one of {', '.join(TEMPLATES)}")
    if template == "dp_acceptance" and not thrusters:
        raise errors.ConfigurationError("the ship has no thruster", where=template, fix="use another template")
    runs = tuple(replace(run, helm_deg=min(run.helm_deg, largest_helm_deg)) if run.helm_deg else run
                 for run in TEMPLATES[template](round(speed_mps, 2), thrusters))  # fmt: skip
    common = ProgrammeSection(
        name=template, vessel=vessel, length_m=round(length_m, 2), speed_mps=round(speed_mps, 2), **section
    )
    programme = TrialProgramme(programme=common, run=runs)
    if programme.into_deg is None:
        return programme
    headings = propose_headings(programme, programme.into_deg)
    return replace(programme, run=tuple(propose_order(programme, headings)))


def propose_headings(programme: TrialProgramme, into_deg: float) -> list[PlannedRun]:
    """The runs with headings, those that state none with :func:`proposed_heading`."""
    return [
        replace(run, heading_deg=proposed_heading(programme, run, into_deg)) if run.heading_deg is None else run
        for run in programme.run
    ]


def proposed_heading(programme: TrialProgramme, run: PlannedRun, into_deg: float) -> float:
    """The heading of a run: into the wind, which then drifts the ship least, where the middle of the area has room;
    else the nearest one that has, and into the wind where none has."""
    area = programme.programme.area
    heading = heading_with_room(programme, run, middle_of_area(area) if area else (nan, nan), into_deg)
    return into_deg if heading is None else heading


def heading_with_room(
    programme: TrialProgramme, run: PlannedRun, position: tuple[float, float], heading_deg: float
) -> float | None:
    """The heading nearest to a wanted one on which a run has room from a position (latitude, longitude), None
    where there is none."""
    needed_m = way_ahead_m(programme, run)
    turns = sorted(range(0, 360, _HEADING_STEP_DEG), key=lambda turn: min(turn, 360 - turn))
    headings = (float(ship.wrap_360(heading_deg + turn)) for turn in turns)
    return next((heading for heading in headings
                 if room_ahead_m(programme.programme.area, position, heading) >= needed_m), None)  # fmt: skip


def way_ahead_m(programme: TrialProgramme, run: PlannedRun) -> float:
    """The room that a run takes ahead, with its steady approach [m]."""
    speed_mps = programme.speed_mps(run)
    held_m = run.duration_s * speed_mps if run.kind == "speed_run" else 0.0
    return (
        programme.steady_s * speed_mps + _LENGTHS_AHEAD.get(run.kind, 3.0) * programme.programme.length_m + held_m
    )


def middle_of_area(area: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The mean of the corners, latitude and longitude, also across the date line."""
    (_, origin_deg), corners = area[0], np.array(area)
    eastwards = ship.angle_difference(corners[:, 1], origin_deg)
    return float(corners[:, 0].mean()), float(ship.wrap_180(origin_deg + eastwards.mean()))


def _corners_m(area: Sequence[tuple[float, float]], position: tuple[float, float]) -> tuple[Floats, Floats]:
    """How far north and east of a position the corners of an area are [m]."""
    corners = np.array(area)
    north, east, _ = pymap3d.geodetic2ned(corners[:, 0], corners[:, 1], np.zeros(len(corners)), *position, 0.0)
    return north, east


def distance_across_m(area: Sequence[tuple[float, float]]) -> float:
    """The largest distance between two corners of an area, as the crow flies [m].

    >>> round(distance_across_m([(0.0, 179.95), (0.0, -179.95), (0.05, 180.0)]), -2)
    11100.0
    """
    places = np.array(pymap3d.geodetic2ecef(*np.array(area).T, np.zeros(len(area))))
    return float(np.linalg.norm(places[:, :, np.newaxis] - places[:, np.newaxis, :], axis=0).max())


def sides_cross(area: Sequence[tuple[float, float]]) -> bool:
    """Whether two sides of an area cross.

    >>> square = [(0.0, 0.0), (0.0, 0.1), (0.1, 0.1), (0.1, 0.0)]
    >>> sides_cross(square), sides_cross([square[place] for place in (0, 2, 1, 3)])
    (False, True)
    """
    places = np.array(_corners_m(area, area[0])).T
    sides = [(places[number], places[(number + 1) % len(places)]) for number in range(len(places))]

    def is_left(point: Floats, side: tuple[Floats, Floats]) -> bool:
        along, towards = side[1] - side[0], point - side[0]
        return bool(along[0] * towards[1] > along[1] * towards[0])

    return any(
        is_left(side[0], rival) != is_left(side[1], rival) and is_left(rival[0], side) != is_left(rival[1], side)
        for side, rival in combinations(sides, 2)
        if not any(np.array_equal(first, second) for first in side for second in rival)
    )


def room_ahead_m(area: Sequence[tuple[float, float]], position: tuple[float, float], heading_deg: float) -> float:
    """How far it is from a position to the edge of an area on a heading [m]; infinite without an area, 0 outside.

    >>> square = [(0.0, 0.0), (0.0, 0.1), (0.1, 0.1), (0.1, 0.0)]
    >>> [round(room_ahead_m(square, (0.05, 0.05), heading), -2) for heading in (0.0, 90.0)]
    [5500.0, 5600.0]

    """
    if not area:
        return inf
    north, east = _corners_m(area, position)
    course = np.deg2rad(heading_deg)
    along = north * np.cos(course) + east * np.sin(course)
    across = east * np.cos(course) - north * np.sin(course)
    crossings = []
    for first, second in pairwise([*range(len(area)), 0]):
        if (across[first] > 0.0) != (across[second] > 0.0):
            share = across[first] / (across[first] - across[second])
            crossings.append(float(along[first] + share * (along[second] - along[first])))
    ahead = [way for way in crossings if way > 0.0]
    return min(ahead) if len(ahead) % 2 else 0.0


def propose_order(programme: TrialProgramme, runs: Iterable[PlannedRun]) -> list[PlannedRun]:
    """The runs by priority, those of one priority in the order with the least time between them."""
    waiting, ordered = list(runs), list[PlannedRun]()
    for priority in sorted({run.priority for run in waiting}):
        group = [run for run in waiting if run.priority == priority]
        last = ordered[-1] if ordered else None
        if len(group) <= _MOST_PERMUTED:
            ordered += min(permutations(group), key=lambda order: programme.minutes_before_each(last, tuple(order)))
            continue
        while group:  # of many the nearest each time
            last = min(group, key=lambda run: programme.minutes_between(last, run))
            group.remove(last)
            ordered.append(last)
    return ordered


def programme_view(programme: TrialProgramme) -> Any:
    """The runs as a table for the terminal."""
    rows = [[str(number), run.sided_name, f"{programme.speed_mps(run):.2f}",
             "into the wind" if run.heading_deg is None else f"{run.heading_deg:03.0f}", str(run.repeats),
             f"{programme.minutes_of(run):.0f}", ", ".join(run.purpose)]
            for number, run in enumerate(programme.run, 1)]  # fmt: skip
    title = (
        f"{programme.programme.name}: {len(rows)} runs, {programme.total_minutes:.0f} minutes with the ways between"
    )
    return result.terminal_table(
        title, ("", "run", "m/s", "heading", "times", "min", "for"), rows, left_aligned=(1, 3, 6)
    )


def draw_programme(figure: Any, programme: TrialProgramme) -> None:
    """When each run would be sailed, in minutes from the first approach."""
    axes, now, last = figure.subplots(), 0.0, None
    for run in [planned for planned in programme.run for _ in range(planned.repeats)]:
        now += programme.minutes_between(last, run)
        axes.barh(run.sided_name, programme.minutes_of(run), left=now, color="#1f77b4")
        now, last = now + programme.minutes_of(run), run
    axes.invert_yaxis()
    axes.set_xlabel("time [min]")
