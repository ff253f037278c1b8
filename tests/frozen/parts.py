"""The parts of the frozen figures: what some commands say of trials that are made in an empty folder."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from tests.frozen.command import ROOT, answer, figures_of, seatrial, simulate, table_digest, topics

VESSEL = ("--vessel", "gunnerus_short")
REAL = {
    "2019": ("gunnerus_2019_docking", "docking_2019-11-09_part1.csv"),
    "2022": ("gunnerus_2022_trials", "trials_2022-10-27_part1.csv"),
}


@dataclass(frozen=True, slots=True)
class Part:
    """One part: ``compute`` runs in an empty working directory; ``relative`` is how much its numbers may differ."""

    compute: Callable[[], dict[str, Any]]
    quick: bool = False
    real: bool = False
    relative: float = 1e-6


PARTS: dict[str, Part] = {}


def _part(name: str, **how: Any) -> Callable[[Callable[[], dict[str, Any]]], Callable[[], dict[str, Any]]]:
    def register(compute: Callable[[], dict[str, Any]]) -> Callable[[], dict[str, Any]]:
        PARTS[name] = Part(compute, **how)
        return compute

    return register


def recorded_data() -> Path:
    """The folder of real recordings, which may not be there."""
    return Path(os.environ.get("SEATRIAL_DATA", ROOT.parent / "shared" / "data"))


def _own_effect() -> Path:
    (file,) = (ROOT / "trials").rglob("drogue.py")
    return file


# What a recording is.


@_part("channels", quick=True)
def channels() -> dict[str, Any]:
    """The channels' names, units, topics and schemas."""
    file = simulate("trial", "voyage", 60.0)
    seatrial("export", file, "-o", "trial.csv")
    beside = json.loads(Path("trial.csv.json").read_text(encoding="utf-8"))
    return {
        "info": answer("info", file),
        "columns": list(pd.read_csv("trial.csv").columns),
        "units": beside["units"],
        "trial": beside["trial"],
        "topics": topics(file),
    }


@_part("effects", quick=True)
def effects() -> dict[str, Any]:
    """The catalogue, and with an effect of one's own."""
    said = {"catalogue": answer("effects"), "with_own": answer("effects", "--effects", _own_effect())}
    return {name: {each["name"]: each for each in listed["effects"]} for name, listed in said.items()}


@_part("simulate", quick=True, relative=1e-9)
def simulated() -> dict[str, Any]:
    """Trials of both ships in three seas, at 1 and 10 Hz, with and without what is hidden."""
    hidden = ("--hide", "ocean_current:speed_mps=0.3,direction_deg=60", "--hide", "thrust_loss_port:fraction=0.2")
    sensors = ("--hide", "heading_bias:angle_deg=2", "--hide", "position_delay:seconds=0.7")
    trials = (
        ("calm", "programme", 1800.0, "calm", "--seed", 1, *VESSEL),
        ("gentle", "paper", 900.0, "gentle", "--seed", 2, "--vessel", "gunnerus_long"),
        ("moderate", "voyage", 300.0, "moderate", "--seed", 3, "--rate", 10, *VESSEL, *hidden),
        ("sensors", "zigzag_20_20", 300.0, "gentle", "--seed", 4, *VESSEL, *sensors),
    )
    said = {}
    for name, *how in trials:
        file = simulate(name, *how)
        seatrial("export", file, "-o", f"{name}.parquet")
        truth = json.loads(Path(f"{name}.truth.json").read_text(encoding="utf-8"))
        said[name] = {"table": table_digest(f"{name}.parquet"), "truth": figures_of(truth)}
    return said


# From a recording to windows and manoeuvres.


def _voyage(name: str = "voyage", *more: object) -> str:
    return simulate(name, "voyage", 1200.0, "gentle", "--rate", 2, "--seed", 5, *VESSEL, *more)


def _spoilt() -> str:
    """A voyage with a fault of every kind that a table can be given by hand."""
    seatrial("export", _voyage("sound"), "-o", "sound.csv")
    table = pd.read_csv("sound.csv")
    heading = table["heading_deg"]
    wraps = heading.diff().abs() > 300.0
    table.loc[wraps, "heading_deg"] = 0.5 * (heading + heading.shift())[wraps]
    table[["surge_mps", "sway_mps"]] *= 0.97
    table["yaw_rate_dps"] = table["yaw_rate_dps"].shift(3, fill_value=0.0)
    table.loc[500:620, "wind_speed_mps"] = table.loc[500, "wind_speed_mps"]
    table.loc[[700, 901, 1403], "north_m"] += 80.0
    table.loc[[1000, 1001], "port_rpm"] = 5000.0
    table["tunnel_rpm"] = (table["tunnel_rpm"] / 20.0).round() * 20.0
    table.drop(index=range(1600, 1660)).to_csv("spoilt.csv", index=False)
    seatrial("import", "spoilt.csv", "-o", "spoilt.mcap")
    return "spoilt.mcap"


def _prepared(file: str, *options: object) -> dict[str, Any]:
    seatrial("export", file, "-o", "prepared.parquet", *options)
    return table_digest("prepared.parquet")


def _windows(*arguments: object) -> dict[str, Any]:
    counts = answer("windows", *arguments, "-o", "windows.parquet")
    tables = {file.name: table_digest(file) for file in sorted(Path().glob("windows*.parquet"))}
    for file in tables:
        Path(file).unlink()
    return {"counts": counts, "tables": tables}


@_part("check", quick=True)
def check() -> dict[str, Any]:
    """A sound and a spoilt recording; what repairing, removing delays and smoothing make of them."""
    sound, spoilt = _voyage(), _spoilt()
    fully = ("--repair", "--remove-delays", "--smooth", "--flags")
    return {
        "sound": answer("check", sound),
        "spoilt": answer("check", spoilt),
        "repaired": _prepared(spoilt, "--repair", "--rate", 1),
        "smoothed": _prepared(sound, "--smooth"),
        "spoilt_smoothed": _prepared(spoilt, *fully),
    }


@_part("windows", quick=True)
def windows() -> dict[str, Any]:
    """Held windows with their start states, and windows in which thrusters moved."""
    file, other = _voyage(), simulate("paper", "paper", 900.0, "gentle", "--seed", 6, *VESSEL)
    moving = ("--horizon", 10, "--stride", 30, "--keep-moving", "--no-starts")
    return {
        "held": _windows(file, other),
        "spoilt": _windows(_spoilt(), "--repair"),
        "moving": _windows(file, *moving),
    }


@_part("manoeuvres", quick=True)
def manoeuvres() -> dict[str, Any]:
    """Zigzags, turning circles, stops and speed runs with their indices."""
    trials = {"voyage": 1200.0, "turning_circle_20": 700.0, "stopping": 600.0, "speed_runs": 600.0}
    return {
        name: answer("manoeuvres", simulate(name, name, seconds, "gentle", "--seed", 7, *VESSEL), "--length", 28.9)
        for name, seconds in trials.items()
    }


# Predictions.


@_part("validate", quick=True)
def validate() -> dict[str, Any]:
    """The baselines at two horizons, of the right and of the wrong ship."""
    file = _voyage()
    return {
        "short": answer("validate", file, *VESSEL),
        "long": answer("validate", file, "--vessel", "gunnerus_long", "--horizon", 30),
        "predict": answer("predict", file, "--at", "+400", *VESSEL),
    }


def _fouled(seed: int) -> str:
    hidden = ("--hide", "hull_fouling:resistance_factor=1.4", *VESSEL)
    return simulate(f"fouled_{seed}", "paper", 900.0, "gentle", "--seed", seed, *hidden)


@_part("calibrator", quick=True)
def calibrator() -> dict[str, Any]:
    """The adaptive calibrator, trained on one trial and judged on another."""
    train, test = _fouled(6), _fouled(7)
    trained = answer("train", train, "-o", "calibrator", *VESSEL)
    use = ("--calibrator", "calibrator")
    instants = {at: answer("predict", test, "--at", f"+{at}", *use) for at in (200, 400, 600)}
    return {"train": trained, "validate": answer("validate", test, *use), "predict": instants}


# The diagnosis.


@dataclass(frozen=True, slots=True)
class Case:
    """A simulated trial, what is hidden in it, and how it is diagnosed."""

    manoeuvre: str
    duration_s: float
    sea_state: str = "calm"
    hide: tuple[str, ...] = ()
    options: tuple[object, ...] = ()
    effects: bool = False
    """Whether trial and diagnosis know the effect that the tree gives as an example of one's own."""

    def diagnose(self) -> dict[str, Any]:
        """Simulate, diagnose."""
        hidden = [word for each in self.hide for word in ("--hide", each)]
        how = (self.manoeuvre, self.duration_s, self.sea_state, "--seed", 11, *VESSEL)
        own = ("--effects", _own_effect()) if self.effects else ()
        return _diagnosis(simulate("trial", *how, *hidden, *own), *self.options, *own)


def _diagnosis(*arguments: object) -> dict[str, Any]:
    said = answer("diagnose", *arguments, *VESSEL, "-o", "diagnosis")
    return {"diagnosis": said, "map": table_digest("diagnosis/map.parquet")}


QUICK_CASES = {
    "current": Case("turning_circle_20", 420.0, hide=("ocean_current:speed_mps=0.3,direction_deg=205",)),
    "nothing": Case("turning_circle_20", 420.0),
}
_NO_OFFSETS = ("azimuth_offset_port", "azimuth_offset_starboard", "azimuth_offset_both", "yaw_asymmetry")
LONG_CASES = {
    "heading_bias": Case("turning_circle_20", 420.0, hide=("heading_bias:angle_deg=1.5",)),
    "fouling": Case("stopping", 420.0, hide=("hull_fouling:resistance_factor=1.4",)),
    "thrust_loss": Case("one_thruster", 420.0, hide=("thrust_loss_port:fraction=0.15",)),
    "gentle": Case("turning_circle_20", 420.0, "gentle"),
    "towed": Case("reciprocal", 200.0, hide=("towed_load:force_n=4000",)),
    "pair": Case(
        "turning_circle_20",
        500.0,
        hide=("ocean_current:speed_mps=0.3,direction_deg=60", "heading_bias:angle_deg=1.5"),
    ),
    "without": Case(
        "turning_circle_20",
        420.0,
        hide=("azimuth_offset_port:angle_deg=4",),
        options=tuple(word for name in _NO_OFFSETS for word in ("--without", name)),
    ),
    "own": Case("stopping", 420.0, hide=("drogue:drag_nps2=200",), effects=True),
    "lag": Case("zigzag_20_20", 420.0, hide=("thruster_lag:time_constant_s=2",)),
    "delay": Case("zigzag_20_20", 420.0, hide=("position_delay:seconds=0.6",)),
}
PARTS |= {f"diagnose-{name}": Part(case.diagnose, quick=True) for name, case in QUICK_CASES.items()}
PARTS |= {f"diagnose-{name}": Part(case.diagnose) for name, case in LONG_CASES.items()}


# The real recordings, where they are.


def _imported(year: str) -> str:
    name, table = REAL[year]
    (columns,) = (ROOT / "trials").rglob(f"{name}.toml")
    seatrial("import", recorded_data() / name / table, "-o", f"{name}.mcap", "--columns", columns)
    return f"{name}.mcap"


def _recorded(year: str) -> dict[str, Any]:
    """All that is asked of a recording before a diagnosis."""
    file = _imported(year)
    return {
        "check": answer("check", file),
        "windows": _windows(file, "--repair"),
        "manoeuvres": answer("manoeuvres", file),
        "validate": answer("validate", file, "--repair", *VESSEL),
        "prepared": _prepared(file, "--smooth", "--repair", "--remove-delays", "--flags"),
    }


def _diagnosed(year: str) -> dict[str, Any]:
    return _diagnosis(_imported(year), "--repair")


PARTS |= {f"recorded-{year}": Part(partial(_recorded, year), real=True) for year in REAL}
PARTS |= {f"diagnose-{year}": Part(partial(_diagnosed, year), real=True) for year in REAL}


# What goes through worker processes.


@_part("evaluate")
def evaluate() -> dict[str, Any]:
    """The adaptive calibrator on two trials, split by leg and by recording."""
    how = ("--split", "leg", "--split", "recording", "--draws", 1, "--method", "adaptive", *VESSEL)
    return {"adaptive": answer("evaluate", _fouled(6), _fouled(7), *how)}


@_part("batch")
def batch() -> dict[str, Any]:
    """Ten recordings in one index: manoeuvres of five kinds in two seas."""
    Path("season").mkdir()
    kinds = ("voyage", "zigzag_20_20", "turning_circle_30", "stopping", "speed_runs")
    for seed, (kind, sea_state) in enumerate(product(kinds, ("calm", "moderate"))):
        simulate(f"season/{kind}_{sea_state}", kind, 400.0, sea_state, "--seed", seed, *VESSEL)
    summary = answer("batch", "season", "-o", "out", "--workers", 1, "--no-pictures", "--length", 28.9)
    index = pd.read_parquet("out/index.parquet").sort_values("name")
    summary.pop("index")  # an absolute path
    of_the_run = ["sha256", "software", "options", "bytes"]
    rows = json.loads(index.drop(columns=of_the_run).to_json(orient="records", double_precision=15))
    return {"summary": summary, "index": {row["name"]: row for row in rows}}
