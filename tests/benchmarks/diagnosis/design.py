"""A trial to be simulated, apart from what is hidden in it, by either of two simulators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from seatrial.hybrid.simulation.trial import SeaState, SimulationNoise, simulate_trial
from tests.benchmarks.other_ship.programmes import Order, steer
from tests.benchmarks.other_ship.sea import SEAS
from tests.benchmarks.other_ship.trial import make_trial

VESSEL = "gunnerus_short"
Hidden = Mapping[str, Mapping[str, float]]
MORE_PROGRAMMES = {"straight": (steer(0.0, 165.0, 600.0),)}
"""Beside those of the other simulator: one heading and one speed."""

_OWN_MANOEUVRES = {"programme": "programme", "zigzags": "zigzag"}


@dataclass(frozen=True, slots=True)
class Design:
    """Everything of a trial but the hidden; ``simulator`` ``own`` is the one that the diagnosis fits with."""

    seed: int
    sea: str
    programme: str
    duration_s: float
    simulator: Literal["other", "own"] = "other"
    rate_hz: float = 10.0
    noise: float = 1.0
    model_error_percent: float = 0.0
    model_error_form: str = "coefficients"
    outliers: float = 0.0
    gaps: float = 0.0
    correlated: bool = False

    @property
    def key(self) -> str:
        """The design in one word; what is as usual is left out."""
        usual = Design(0, "", "", 0.0)
        first = f"{self.simulator}-{self.programme}-{self.sea}-{self.duration_s:g}s-{self.seed}"
        rest = [
            f"{name}={value}"
            for name, value in asdict(self).items()
            if name not in ("seed", "sea", "programme", "duration_s", "simulator") and value != getattr(usual, name)
        ]
        return "-".join([first, *rest])


def simulated(
    design: Design,
    hidden: Hidden,
    outside: Mapping[str, float] | None = None,
    orders: tuple[Order, ...] | None = None,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The recorded table and, as plain values, what the simulator says of the hidden.

    ``orders`` take the programme's place. Raises :class:`ModelRangeError` where the ship leaves the range of her
    model.
    """
    if design.simulator == "own":
        return _own(design, hidden), {}
    chosen = asdict(design)
    del chosen["simulator"]
    chosen["programme"] = orders or MORE_PROGRAMMES.get(design.programme, design.programme)
    table, truth = make_trial(hidden=hidden, outside=outside, vessel=VESSEL, **chosen)
    return table, {"outside_rms": truth["outside_rms"], "model_error": truth["model_error"]}


def _own(design: Design, hidden: Hidden) -> pd.DataFrame:
    """By the project's own simulator: wind and waves, but no current and no mean drift, unless hidden."""
    sea = SEAS[design.sea]
    heading_deg, wind_deg = np.random.default_rng(design.seed).uniform(0.0, 360.0, 2)
    weather = SeaState(sea.wind_mps, sea.wave_height_m, sea.wave_period_s, 0.0, float(wind_deg), drift_n_per_m2=0.0)
    return simulate_trial(
        VESSEL, weather, _OWN_MANOEUVRES[design.programme], design.duration_s, design.rate_hz, design.seed, hidden,
        noise=SimulationNoise().scaled(design.noise), heading_deg=float(heading_deg),
    )[0]  # fmt: skip
