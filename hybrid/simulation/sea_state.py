"""Sea states: wind, waves and current of a simulated trial, read from ``trials/sea_states.toml``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from acquisition.config.toml_file import load_toml
from acquisition.core.errors import ConfigurationError

SEA_STATES = Path(__file__).parents[2] / "trials" / "sea_states.toml"


@dataclass(frozen=True, slots=True)
class SeaState:
    """Wind, waves and current from one direction.

    Significant wave height and peak period describe a JONSWAP spectrum. ``drift_n_per_m2`` is the mean
    second-order force in beam sea over the square of the wave height; slow drift follows the wave groups with
    ``group_s``. Gusts have a standard deviation of ``gust_intensity`` of the mean wind, along and across it,
    and a length scale. Numbers that have a value here are assumptions: the paper's Table II states none of them.
    """

    wind_mps: float
    wave_height_m: float
    wave_period_s: float
    current_mps: float
    direction_from_deg: float = 30.0
    drift_n_per_m2: float = 1000.0
    group_s: float = 25.0
    gust_intensity: float = 0.1
    gust_length_m: float = 100.0
    name: str = ""

    @property
    def direction_to_deg(self) -> float:
        """Where wind, waves and current go to [deg]."""
        return (self.direction_from_deg + 180.0) % 360.0

    @property
    def drift_n(self) -> float:
        """Mean wave drift force in beam sea [N]."""
        return self.drift_n_per_m2 * self.wave_height_m**2

    def effects(self) -> dict[str, dict[str, float]]:
        """The sea state's steady parts as effects of the catalogue."""
        current = {"speed_mps": self.current_mps, "direction_deg": self.direction_to_deg}
        drift = {"force_n": self.drift_n, "direction_deg": self.direction_to_deg}
        return {"ocean_current": current, "wave_drift": drift}


SeaState.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


def sea_states(path: str | Path = SEA_STATES) -> dict[str, SeaState]:
    """All sea states of a file by name. Raises :class:`ConfigurationError` naming file, line and key."""
    states = load_toml(path, dict[str, SeaState])
    return {name: replace(state, name=name) for name, state in states.items()}


def sea_state_named(name: str) -> SeaState:
    """One of the sea states that come with Seatrial."""
    known = sea_states()
    if name not in known:
        raise ConfigurationError(f"no sea state {name!r}", fix=f"use one of {', '.join(known)}")
    return known[name]
