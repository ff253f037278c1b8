"""Logs made straight from the simulator: the motion is the model's own, nothing is smoothed."""

from __future__ import annotations

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.log import STEPS_PER_SECOND, Log
from seatrial.hybrid.vessel.dynamics import simulate
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.sensors import measure

DT_S = 1.0 / STEPS_PER_SECOND
START_S = 1_800_000_000


START = (10.0, -20.0, 0.4, 4.5, 0.1, 0.0)


def a_log(
    plant: Plant,
    seconds: int = 90,
    edges: tuple[int, ...] = (),
    breaks: tuple[int, ...] = (),
    controls: Floats | None = None,
    start: tuple[float, ...] = START,
    wind_mps: float = 9.0,
) -> Log:
    """What perfect sensors of the plant report of a run through ramps and swings of the thrusters, in some wind.

    ``edges`` are seconds at which blocks begin, ``breaks`` those of them before which time jumps; ``controls``
    [4 seconds, controls] are other orders than R/V Gunnerus'.
    """
    controls = orders(seconds) if controls is None else controls
    wind = np.tile([0.8, wind_mps], (seconds * STEPS_PER_SECOND, 1))
    states = simulate(plant, start, controls, wind, DT_S)
    seen = measure(states, plant, DT_S)
    weight = np.random.default_rng(5).dirichlet(np.ones(5), (seconds, 6))
    padded = np.concatenate([np.repeat(seen[:1], 2, axis=0), seen, np.repeat(seen[-1:], 2, axis=0)])
    around = np.stack([padded[q : q + 4 * seconds : 4] for q in range(5)], axis=1)
    block = np.searchsorted(edges, np.arange(seconds), side="right")
    jumps = 100 * np.searchsorted(breaks, np.arange(seconds), side="right")
    return Log(
        measured=np.einsum("tcq,tqc->tc", weight, around),
        weight=weight,
        nominal=seen[:-1:STEPS_PER_SECOND].copy(),
        controls=controls.reshape(seconds, STEPS_PER_SECOND, -1),
        wind=wind[::STEPS_PER_SECOND].copy(),
        time_s=(START_S + np.arange(seconds) + jumps).astype(np.int64),
        block=block.astype(np.int64),
        leg=block.astype(np.int64),
        recording=np.zeros(seconds, dtype=np.int64),
        actuators=plant.layout,
    )


def orders(seconds: int) -> Floats:
    """Thruster settings [4 seconds, 5], a little different in each quarter."""
    t = np.arange(seconds * STEPS_PER_SECOND) * DT_S
    return np.column_stack([
        2.5 + 0.3 * np.sin(t / 9.0), 0.25 * np.sin(t / 7.0), 2.4 + 0.2 * np.cos(t / 11.0), 0.2 * np.sin(t / 5.0),
        200.0 * np.sin(t / 13.0),
    ])  # fmt: skip
