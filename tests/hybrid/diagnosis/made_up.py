"""Diagnoses that nobody made: every verdict, with values that a page can be searched for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seatrial.acquisition.core.result import to_json
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.result import (
    FORCES,
    CalibratorComparison,
    Diagnosis,
    Estimate,
    Gap,
    GapCell,
    Map,
    NamedEffect,
    NextTrial,
    RankedEffect,
    Ratio,
    Replication,
    Rival,
    Tracks,
    UnknownCause,
)
from seatrial.hybrid.prediction.baselines import Interval

CURRENT = NamedEffect(
    "ocean_current", "environment", "physics",
    0.6, 1e-9, "The ship drifts with a current of 0.350 m/s towards 205 deg (0.340-0.360; 203-207).",
    {"speed_mps": Estimate(0.35, 0.34, 0.36, "m/s"), "direction_deg": Estimate(205.0, 203.0, 207.0, "deg")},
    Replication(4, 4), 812.0,
)  # fmt: skip
BIAS = NamedEffect(
    "heading_bias", "sensor", "sensor", 0.3, 2e-4, "The compass reads 1.50 deg too little (-1.70 to -1.30).",
    {"angle_deg": Estimate(-1.5, -1.7, -1.3, "deg")}, Replication(4, 3), 31.0,
)  # fmt: skip
SUSPECTS = (
    RankedEffect("ocean_current", "environment", 800.0, 1e-9, 0.01, "m/s"),
    RankedEffect("wave_drift", "environment", 90.0, 1e-7, 450.0, "N"),
    RankedEffect("heading_bias", "sensor", 12.0, 1e-3, 0.15, "deg"),
    RankedEffect("trim", "hull", -3.5, 1.0, float("nan"), "m"),
)


def tracks(windows: int = 6, horizon_s: int = 15) -> Tracks:
    """Turns of several rates: the model before errs aside by a share of the time, after by a tenth of that, at the
    floor by a twentieth."""
    seconds = np.arange(horizon_s + 1.0)
    rate = np.linspace(-0.03, 0.03, windows)[:, None]
    heading = 0.5 + rate * seconds
    measured = np.stack([4.0 * seconds * np.cos(heading), 4.0 * seconds * np.sin(heading), heading], axis=2)
    aside = (0.02 * (1.0 + np.arange(windows)))[:, None] * seconds
    before, after, floor, still = (measured.copy() for _ in range(4))
    before[:, :, 1] += aside
    after[:, :, 1] += 0.1 * aside
    floor[:, :, 1] += 0.05 * aside
    still[:, :, 0] -= 2.0 * aside
    steady = np.ones_like(heading)
    controls = {"propeller_rpm": 120.0 * steady, "rudder_angle_deg": np.degrees(-2.0 * rate) * steady}
    when = np.arange(windows) // 2, 15 * np.arange(windows)
    return Tracks(measured, before, after, floor, still, *when, controls)


NOISE = DisturbanceNoise(
    position_m=0.031, waves=(0.2, 0.1, 0.01), wave_towards_rad=-1.0, wave_drift_n=2e3, length_m=29.0
)


def named() -> Diagnosis:
    """A current and a heading bias, with one far rival."""
    return Diagnosis(
        verdict="named",
        tolerance=0.01,
        effects=(CURRENT, BIAS),
        rivals=(Rival("ocean_current", "wave_drift", 11.0),),
        indistinguishable=(),
        unknown=None,
        where=(GapCell("sway_force_n", {"heading_deg": (67.5, 112.5)}, 210, 5800.0, 14.2),),
        gap=Gap(1.4, 0.19, 0.06, 0.9, 110, 15),
        next_manoeuvre=None,
        ranking=SUSPECTS,
        tracks=tracks(),
        remarks=("71 outliers were rejected",),
        provenance={
            "files": ["/data/trial <7>.mcap"], "vessel": "gunnerus_short", "catalogue_version": "2",
            "force_range": {"surge_n": 70e3, "sway_n": 98e3, "yaw_nm": 1.3e6}, "noise": to_json(NOISE),
        },
    )  # fmt: skip


def of_verdict(verdict: str) -> Diagnosis:
    """The same with another verdict, nothing in it but what that takes."""
    bare = replace(named(), ranking=(), tracks=None, where=(), rivals=(), provenance={}, remarks=())
    if verdict == "nothing_missing":
        return replace(bare, verdict="nothing_missing", effects=(), gap=Gap(0.06, 0.06, 0.06, 0.9, 110, 15))
    if verdict == "unknown":
        unknown = UnknownCause(
            0.4, ("heading", "place"), "a yaw moment of some 4000 N m that varies with the heading"
        )
        return replace(bare, verdict="unknown", effects=(CURRENT,), unknown=unknown)
    return replace(
        bare,
        verdict="indistinguishable",
        effects=(CURRENT,),
        rivals=(Rival("ocean_current", "wave_drift", 1.2), Rival("ocean_current", "sway_asymmetry", 9.0)),
        indistinguishable=(("ocean_current", "wave_drift"),),
        next_manoeuvre=NextTrial(
            "12 minutes of straight runs on reciprocal headings", ("ocean_current", "wave_drift"), 25.0, 12.0
        ),
    )


def a_ladder(both: tuple[float, float, float] = (0.7, 0.6, 0.8)) -> CalibratorComparison:
    """All five rungs; ``both`` is the ratio of the calibrator on the named model to that on the reference."""
    sizes = {"constant_velocity": 0.9, "reference": 1.2, "named": 0.3, "reference_calibrated": 0.4}
    sizes["named_calibrated"] = 0.4 * both[0]
    return CalibratorComparison(
        15, "adaptive", 93, 32,
        {name: Interval(size, 0.8 * size, 1.3 * size) for name, size in sizes.items()},
        (
            Ratio("named", "reference", 0.25, 0.2, 0.3),
            Ratio("reference_calibrated", "reference", 1 / 3, 0.3, 0.4),
            Ratio("named_calibrated", "named", 4 / 3 * both[0], 0.7, 1.1),
            Ratio("named_calibrated", "reference_calibrated", *both),
        ),
    )  # fmt: skip


def a_map() -> Map:
    """A sway force that goes with the heading, none elsewhere."""
    random = np.random.default_rng(1)
    heading, speed = random.uniform(0.0, 360.0, 400), random.uniform(2.0, 5.0, 400)
    force = np.column_stack([np.zeros(400), 5e3 * np.sin(np.deg2rad(heading)), np.zeros(400)])
    cells: list[tuple[str, float, float]] = [("heading_deg", 45.0 * n - 22.5, 45.0 * n + 22.5) for n in range(8)]
    cells += [("speed_mps", each, each + 1.0) for each in (2.0, 3.0, 4.0)]
    places = []
    for name, low, high in cells:
        sway = 5e3 * np.sin(np.deg2rad(0.5 * (low + high))) if name == "heading_deg" else 10.0
        sizes = dict(zip(FORCES, (20.0, sway, 30.0), strict=True))
        places += [GapCell(channel, {name: (low, high)}, 50, size, size / 300.0) for channel, size in sizes.items()]
    return Map(tuple(places), force, {"heading_deg": heading, "speed_mps": speed})
