"""Tests of single drives, and going sideways: the tunnel thruster, one shaft alone, crabbing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acquisition.core.arrays import Floats
from analysis.manoeuvres.indices import Manoeuvre, indices_of
from analysis.manoeuvres.measures import along_and_across, bootstrap_indices, half_width_s
from analysis.manoeuvres.motion import Motion, noise_of, stretches

_RUNNING_SHARE, _IDLE_SHARE = 0.2, 0.08
_NOISE_SIGMAS = 10.0
_LEAST_RUNNING = 5.0
_LEAST_S, _BRIDGE_S = 15.0, 5.0
_CRAB_SHARE, _CRAB_LEAST_MPS, _CRAB_LEAST_S = 1.5, 0.15, 20.0
_CRAB_TURN_DEG = 15.0
_UNSURE_ROWS = 1.5  # a threshold, not a fitted step, says when a drive began to run


def _running(values: Floats, largest: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where a drive runs and where it stands, against the largest that any of its kind did."""
    floor = max(_NOISE_SIGMAS * noise_of(values), _LEAST_RUNNING)
    return np.abs(values) > max(_RUNNING_SHARE * largest, floor), np.abs(values) < max(_IDLE_SHARE * largest, floor)


def _bridge(true: NDArray[np.bool_], rows: int) -> NDArray[np.bool_]:
    """``true`` with breaks of no more than ``rows`` closed."""
    result = true.copy()
    for first, end in stretches(~true):
        if first > 0 and end < true.size and end - first <= rows:
            result[first:end] = True
    return result


def find_thruster_tests(
    motion: Motion, smooth: Motion, free: NDArray[np.bool_], length_m: float | None
) -> list[Manoeuvre]:
    """One shaft alone for a quarter of a minute and more, and every run of the tunnel thruster."""
    largest = max(float(np.percentile(np.abs(each), 99)) for each in (motion.port_rpm, motion.starboard_rpm))
    port, port_idle = _running(motion.port_rpm, largest)
    starboard, starboard_idle = _running(motion.starboard_rpm, largest)
    tunnel, tunnel_idle = _running(motion.tunnel_rpm, float(np.percentile(np.abs(motion.tunnel_rpm), 99.5)))
    both = port & starboard
    cases = {
        "port thruster alone": port & starboard_idle & tunnel_idle,
        "starboard thruster alone": starboard & port_idle & tunnel_idle,
        "tunnel thruster to starboard": tunnel & (motion.tunnel_rpm > 0) & (both | (port_idle & starboard_idle)),
        "tunnel thruster to port": tunnel & (motion.tunnel_rpm < 0) & (both | (port_idle & starboard_idle)),
    }
    crab = _crabbing_rows(smooth, port | starboard | tunnel)
    found = _tests_of(motion, "crabbing", "crabbing", _bridge(crab & free, round(_BRIDGE_S / motion.step_s)),
                      _CRAB_LEAST_S, length_m)  # fmt: skip
    found = [each for each in found if abs(each.indices["heading_change_deg"].value) < _CRAB_TURN_DEG]
    for name, true in cases.items():
        rows = _bridge(true & free & ~crab, round(_BRIDGE_S / motion.step_s))
        found += _tests_of(motion, "thruster_test", name, rows, _LEAST_S, length_m)
    return found


def _crabbing_rows(smooth: Motion, driven: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the ship is driven and goes more to the side than ahead."""
    sideways = np.abs(smooth.sway_mps)
    return np.asarray(driven & (sideways > _CRAB_SHARE * np.abs(smooth.surge_mps)) & (sideways > _CRAB_LEAST_MPS))


def _tests_of(
    motion: Motion, kind: str, name: str, rows: NDArray[np.bool_], least_s: float, length_m: float | None
) -> list[Manoeuvre]:
    return [_test(motion, kind, name, first, end, length_m)
            for first, end in stretches(rows, max(2, round(least_s / motion.step_s)))]  # fmt: skip


def _test(motion: Motion, kind: str, name: str, first: int, end: int, length_m: float | None) -> Manoeuvre:
    span = np.array([motion.time_s[first], motion.time_s[end - 1]])
    part = motion.around(span[0], span[1], 10.0)
    inside = motion.rows(first, end)
    width = half_width_s(part, (span[1] - span[0]) / 2.0)
    found = bootstrap_indices(part, span, width, drift_indices, _UNSURE_ROWS)
    turned, aside = found["heading_change_deg"][0], found["sway_mps"][0]
    sideways = aside if kind == "crabbing" else turned
    return Manoeuvre(
        kind=kind,
        name=f"{name} to {'starboard' if aside > 0 else 'port'}" if kind == "crabbing" else name,
        start=motion.utc(span[0]),
        end=motion.utc(span[1]),
        side="starboard" if sideways > 0 else "port",
        settings={each: float(getattr(inside, each).mean()) for each in
                  ("port_rpm", "starboard_rpm", "tunnel_rpm")} | {"duration_s": float(span[1] - span[0])},
        indices=indices_of(found, length_m),
    )  # fmt: skip


def drift_indices(motion: Motion, executes: Floats) -> dict[str, float]:
    """Mean motion between two times [s], the rate of turn in the last third, and the way made good."""
    start, end = float(executes[0]), float(executes[1])
    inside = motion.between(start, end)
    ahead, aside = along_and_across(motion, start, end, motion.at("heading_deg", start))
    rates = inside.yaw_rate_dps
    return {
        "surge_mps": float(inside.surge_mps.mean()),
        "sway_mps": float(inside.sway_mps.mean()),
        "heading_change_deg": float(inside.heading_deg[-1] - inside.heading_deg[0]),
        "last_yaw_rate_dps": float(rates[-max(1, rates.size // 3) :].mean()),
        "way_ahead_m": ahead,
        "way_to_starboard_m": aside,
    }
