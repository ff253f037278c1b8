"""Trials of the other ship as at sea: days with currents of their own, a tide, a tow, fouling that grows; much at
once, no record of the wind, a record every two seconds; play, feedback that is dead, coefficients that are off;
feedback in steps, a long delay, a trim that changes during a break, a compass that jumps, a stretch at the quay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, radians, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import (
    DEFAULT,
    ENVIRONMENT,
    POSE_AND_VELOCITY,
    VELOCITY,
    control_names,
    order_channel_name,
)
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recordings
from seatrial.acquisition.recording.writer import write_table
from seatrial.hybrid.diagnosis.verdict import TOLERANCE
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.vessel.actuators import control_units
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.workflows import checked_tables, diagnose_tables
from tests.benchmarks.diagnosis.design import VESSEL, Hidden
from tests.benchmarks.diagnosis.scoring import holds
from tests.benchmarks.diagnosis.sound import placed
from tests.benchmarks.other_ship.model_error import EACH
from tests.benchmarks.other_ship.sensors import SIGMAS
from tests.benchmarks.other_ship.trial import make_trial

KINDS = (
    "two days", "turning tide", "tow dropped", "growing fouling", "nothing",
    "several", "no wind", "half a hertz", "backlash", "dead feedback channel", "coefficients off",
    "quantised feedback", "long delay", "trim change", "compass step", "moored stretch",
)  # fmt: skip
_SEED, _ANOTHER_SEED = 700_000, 50_000_000
_DAY_S, _TRIAL_S, _RATE_HZ = 1200.0, 2400.0, 2.0
_SEVERAL = (
    "ocean_current", "hull_fouling", "thrust_loss_both", "wind_load", "hull_lengthening", "yaw_inertia",
    "heading_bias", "position_delay", "wind_direction_bias", "azimuth_offset_both", "yaw_rate_scale",
)  # fmt: skip
"""What four to six are drawn from: of several families, none of them the image of another."""

_FEEDBACK = ("port_rpm", "port_angle_deg", "starboard_rpm", "starboard_angle_deg")
_COEFFICIENTS = ("inertia", "hull", "propulsion")
"""The families of a ship's own coefficients: where these are off, such a name is neither right nor wrong."""

_ON_TOP = tuple(name for name in _SEVERAL if CATALOGUE[name].family not in _COEFFICIENTS)
_OFF_PERCENT = 15.0
_DAYS = {"two days": 2, "nothing": 2, "growing fouling": 3}
_STEPS = {"rpm": 10.0, "deg": 2.0}  # of the feedback, in the unit that a channel's name ends with
_BREAK_S, _MOORED_S = 120, 1800

Values = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class SeaCase:
    """A trial of one of :data:`KINDS`, in one recording or in several of a day each."""

    kind: str
    number: int

    @property
    def key(self) -> str:
        """The case in one word."""
        return f"at sea/{self.kind}/{self.number}"


@dataclass(frozen=True, slots=True)
class SeaTruth:
    """What is hidden on each day and what changes within it; by effect its size in each part of the trial."""

    days: tuple[Hidden, ...]
    outside: Mapping[str, float]
    sizes: Mapping[str, tuple[Values, ...]]


def cases_at_sea(number: int) -> list[SeaCase]:
    """So many of each kind."""
    return [SeaCase(kind, each) for kind in KINDS for each in range(number)]


def truth_of(case: SeaCase) -> SeaTruth:
    """Sizes drawn by the case's kind and number."""
    random = np.random.default_rng([_SEED, KINDS.index(case.kind), case.number])

    def current() -> dict[str, float]:
        return {"speed_mps": float(random.uniform(0.15, 0.4)), "direction_deg": float(random.uniform(0.0, 360.0))}

    if case.kind == "two days":
        fouling = {"resistance_factor": float(random.uniform(1.2, 1.5))}
        currents = (current(), current())
        days = tuple({"hull_fouling": fouling, "ocean_current": each} for each in currents)
        return SeaTruth(days, {}, {"hull_fouling": (fouling,), "ocean_current": currents})
    if case.kind == "turning tide":
        first, turn, towards = current(), random.uniform(0.3, 0.6), random.uniform(0.0, 2.0 * np.pi)
        north, east = float(turn * np.cos(towards)), float(turn * np.sin(towards))
        change = {"tide_north_mps": north, "tide_east_mps": east}
        return SeaTruth(
            ({"ocean_current": first},), change, {"ocean_current": (first, _turned(first, north, east))}
        )
    if case.kind == "tow dropped":
        change = {"tow_n": float(random.uniform(3e3, 8e3)), "tow_share": float(random.uniform(0.3, 0.7))}
        return SeaTruth(({},), change, {"towed_load": ({"force_n": change["tow_n"]},)})
    if case.kind == "growing fouling":
        least, growth = random.uniform(1.1, 1.25), random.uniform(0.1, 0.2)
        sizes = tuple({"resistance_factor": float(least + day * growth)} for day in range(3))
        return SeaTruth(tuple({"hull_fouling": each} for each in sizes), {}, {"hull_fouling": sizes})
    if case.kind == "several":
        names = random.choice(_SEVERAL, int(random.integers(4, 7)), replace=False).tolist()
        drawn = {name: _ordinary(name, random) for name in names}
        return SeaTruth((drawn,), {}, {name: (size,) for name, size in drawn.items()})
    if case.kind == "backlash":
        name = str(random.choice(["backlash_port", "backlash_starboard", "backlash_both"]))
        width = {"width_deg": float(random.uniform(3.0, 8.0))}
        return SeaTruth(({name: width},), {}, {name: (width,)})
    if case.kind == "coefficients off":
        name = str(random.choice(_ON_TOP))
        drawn = {name: _ordinary(name, random)}
        return SeaTruth((drawn,), {}, {name: (drawn[name],)})
    if case.kind == "long delay":
        late = {"seconds": float(random.uniform(0.3, 1.0))}
        fouling = {"resistance_factor": float(random.uniform(1.2, 1.5))}
        return SeaTruth(
            ({"position_delay": late, "hull_fouling": fouling},), {},
            {"position_delay": (late,), "hull_fouling": (fouling,)},
        )  # fmt: skip
    if case.kind in ("trim change", "compass step"):
        before = {"hull_fouling": {"resistance_factor": float(random.uniform(1.2, 1.5))}}
        name = "trim" if case.kind == "trim change" else "heading_bias"
        size = _ordinary(name, random)
        days = (before, {**before, name: size}) if name == "trim" else (before,)
        return SeaTruth(days, {}, {name: (size,), "hull_fouling": (before["hull_fouling"],)})
    if case.kind in ("no wind", "half a hertz", "dead feedback channel", "quantised feedback", "moored stretch"):
        drawn = {"hull_fouling": {"resistance_factor": float(random.uniform(1.2, 1.5))}, "ocean_current": current()}
        return SeaTruth((drawn,), {}, {name: (size,) for name, size in drawn.items()})
    return SeaTruth(({}, {}), {}, {})


def _ordinary(name: str, random: np.random.Generator) -> dict[str, float]:
    """An effect of ordinary size or half as much more; its sign or direction drawn."""
    effect = CATALOGUE[name]
    values = placed(effect, random.uniform(1.0, 1.5) * effect.free_scale[0], random)
    if values is None:
        raise ConfigurationError(f"{name} of ordinary size is out of its bounds")
    return values


def _turned(current: Values, north_mps: float, east_mps: float) -> dict[str, float]:
    towards = radians(current["direction_deg"])
    north, east = current["speed_mps"] * cos(towards) + north_mps, current["speed_mps"] * sin(towards) + east_mps
    return {"speed_mps": hypot(north, east), "direction_deg": degrees(atan2(east, north)) % 360.0}


def tables_of(case: SeaCase) -> list[pd.DataFrame]:
    """What was recorded, a table a day."""
    truth, found = truth_of(case), []
    first = _SEED + 1000 * KINDS.index(case.kind) + case.number
    for day, hidden in enumerate(truth.days):
        seed = first if case.kind == "trim change" else first + day * _ANOTHER_SEED
        table, told = make_trial(
            seed, hidden, truth.outside, sea=("calm", "gentle")[case.number % 2],
            duration_s=_DAY_S if case.kind in (*_DAYS, "trim change") else _TRIAL_S,
            rate_hz=0.5 if case.kind == "half a hertz" else _RATE_HZ, vessel=VESSEL,
            model_error_percent=_OFF_PERCENT if case.kind == "coefficients off" else 0.0, model_error_form=EACH,
        )  # fmt: skip
        if case.kind == "dead feedback channel":
            table = _with_dead_feedback(table, told["ordered"], case)
        if case.kind == "no wind":
            table = table.drop(columns=list(ENVIRONMENT))
        if case.kind == "compass step":
            table = _after_a_step(table, truth.sizes["heading_bias"][0]["angle_deg"], case)
        if case.kind == "quantised feedback":
            table = _in_steps(table)
        if case.kind == "moored stretch":
            return _checked(_and_moored(table, case))
        table = table.set_axis(table.index + pd.Timedelta(days=day))
        table.attrs["recording"] = f"day {day + 1}"
        found.append(table)
    if case.kind == "trim change":  # the same sea, a break, and the voyage goes on with the change
        breaks_off = found[0].index[-1] - found[1].index[0] + pd.Timedelta(seconds=_BREAK_S)
        return [pd.concat([found[0], found[1].set_axis(found[1].index + breaks_off)])]
    return found


def _after_a_step(table: pd.DataFrame, angle_deg: float, case: SeaCase) -> pd.DataFrame:
    """The compass reads so much more from a moment on."""
    share = np.random.default_rng([_SEED, case.number]).uniform(0.3, 0.7)
    since = np.arange(len(table)) >= share * len(table)
    return table.assign(heading_deg=(table["heading_deg"] + angle_deg * since) % 360.0)


def _checked(table: pd.DataFrame) -> list[pd.DataFrame]:
    """The table as a recording whose check says what of it can be used."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trial.mcap"
        write_table(table, path, Trial())
        return [part for recording in read_recordings([path]) for part in checked_tables(recording).tables]


def _in_steps(table: pd.DataFrame) -> pd.DataFrame:
    """The feedback rounded to steps as displays and converters make."""
    steps = {name: _STEPS[name.rsplit("_", 1)[1]] for name in control_names(DEFAULT)}
    return table.assign(**{name: (table[name] / step).round() * step for name, step in steps.items()})


def _and_moored(table: pd.DataFrame, case: SeaCase) -> pd.DataFrame:
    """The voyage and half an hour at the quay, thrusters idle: the last place and heading, noise as before."""
    random, rows = np.random.default_rng([_SEED, case.number]), round(_MOORED_S * _RATE_HZ)
    rest = table.iloc[np.full(rows, -1)].copy()
    rest.index = table.index[-1] + pd.to_timedelta(np.arange(1, rows + 1) / _RATE_HZ, unit="s")
    rest.index.name = table.index.name
    for name in POSE_AND_VELOCITY:
        still = 0.0 if name in VELOCITY else table[name].iloc[-1]
        rest[name] = still + SIGMAS[name] * random.standard_normal(rows)
    rest["heading_deg"] %= 360.0
    rest[list(control_names(DEFAULT))] = 0.0
    return pd.concat([table, rest])


def _with_dead_feedback(table: pd.DataFrame, ordered: Floats, case: SeaCase) -> pd.DataFrame:
    """One channel of feedback without values, or at its first one for good; the orders beside."""
    orders = pd.DataFrame(
        ordered / control_units(DEFAULT), table.index, map(order_channel_name, control_names(DEFAULT))
    )
    name = _FEEDBACK[case.number // 2 % len(_FEEDBACK)]
    return table.assign(**{name: table[name].iloc[0] if case.number % 2 else np.nan}).join(orders)


def judged(case: SeaCase) -> dict[str, Any]:
    """What was hidden, and what was said, as :mod:`.scoring` reads them."""
    truth = truth_of(case)
    plain = diagnose_tables(tables_of(case), load_vessel(VESSEL), TOLERANCE).diagnosis.as_dict()
    kept = ("verdict", "effects", "indistinguishable", "unknown", "gap", "remarks")
    said = {name: plain[name] for name in kept}
    # A wind does blow there, whose size the truth does not have: naming it is neither right nor wrong.
    said["effects"] = [each for each in said["effects"] if each["name"] != STEADY_WIND.name]
    if case.kind == "coefficients off":
        said["effects"] = [each for each in said["effects"] if each["family"] not in _COEFFICIENTS]
    return {
        "group": f"at sea, {case.kind}",
        "hidden": {name: list(sizes) for name, sizes in truth.sizes.items()},
        "outside": dict(truth.outside),
        "said": said,
        "held": held(said["effects"], truth),
    }


def held(effects: list[dict[str, Any]], truth: SeaTruth) -> list[bool]:
    """Whether each interval of what is named rightly, in as many parts as there are, holds the truth."""
    found = []
    for name, sizes in truth.sizes.items():
        mine = [each for each in effects if each["name"] == name]
        parts = [
            part
            for each in mine
            for part in ([each["drift"]["parameters"]] if each["drift"] else []) + [each["parameters"]]
        ]
        if mine and mine[0]["drift"]:
            sizes = (sizes[0], sizes[-1])
        if len(parts) == len(sizes):
            pairs = zip(parts, sizes, strict=True)
            found += [holds(key, part[key], value) for part, size in pairs for key, value in size.items()]
    return found
