"""The conditions of a trial as its recording has them: stated, or measured by the ship's sensors."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import replace
from math import isfinite

import pandas as pd

from seatrial.acquisition.config.run_sheet import Conditions, conditions_of
from seatrial.acquisition.core.quantities import mean_wind
from seatrial.acquisition.core.trial import Trial
from seatrial.analysis.series import is_assumed

BEAUFORT_MPS = (0.3, 1.6, 3.4, 5.5, 8.0, 10.8, 13.9, 17.2, 20.8, 24.5, 28.5, 32.7)
"""The mean speeds from which the force of the wind is one more, by the World Meteorological Organization."""

_WIND = ["wind_speed_mps", "wind_direction_deg"]
_SEA_WORDS = {
    "glassy": 0, "rippled": 1, "smooth": 2, "slight": 3, "moderate": 4, "rough": 5, "very rough": 6, "high": 7,
    "very high": 8, "phenomenal": 9,
}  # fmt: skip
"""The words of the state of the sea (World Meteorological Organization, code table 3700)."""


def beaufort(speed_mps: float) -> int:
    """The wind's force from its mean speed [m/s].

    >>> beaufort(0.2), beaufort(8.0), beaufort(40.0)
    (0, 5, 12)
    """
    return bisect_right(BEAUFORT_MPS, speed_mps)


def sea_state_of(words: str) -> int | None:
    """The state of the sea that the crew's words name, by its number or its word; None where they name none or two.

    >>> sea_state_of("sea state 3"), sea_state_of("very rough"), sea_state_of("2 to 3"), sea_state_of("swell 2 m")
    (3, 6, None, None)
    """
    number = re.fullmatch(r"(?:sea\s*state\s*|ss\s*|douglas\s*)?(\d)", words.strip(), re.I)
    if number:
        return int(number[1])
    plain = re.sub(r"\bseas?\b", "", words.lower()).strip()
    return _SEA_WORDS.get(plain)


def recorded_conditions(trial: Trial, table: pd.DataFrame) -> Conditions:
    """The conditions in a recording: its ``[conditions]`` and run sheet, the mean wind, the water's temperature."""
    temperature_degc = (
        float(table["water_temperature_degc"].mean()) if "water_temperature_degc" in table else float("nan")
    )
    air = table.reindex(columns=_WIND).dropna().iloc[: 0 if is_assumed(table, _WIND[0]) else None]
    measured = Conditions(
        water_depth_m=trial.water_depth_m, draught_m=trial.draught_m, trim_m=trial.trim_m,
        sea_state=sea_state_of(trial.sea_state), beaufort=beaufort(mean_wind(air)[0]) if len(air) else None,
        water_temperature_degc=temperature_degc if isfinite(temperature_degc) else None,
    )  # fmt: skip
    return with_stronger_wind(conditions_of(trial).with_known(measured), measured)


def with_stronger_wind(stated: Conditions, measured: Conditions) -> Conditions:
    """Stated conditions, with the wind that was measured where that was stronger."""
    forces = [force for force in (stated.beaufort, measured.beaufort) if force is not None]
    return replace(stated, beaufort=max(forces, default=None))
