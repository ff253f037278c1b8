"""A ship as she ran her trial, and the sea and the air of that day: the ``[conditions]`` of a trial."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from typing import Annotated, Literal

from pydantic import Field

from seatrial.acquisition.config.declarations import Finite

REFERENCE_DENSITY_KGPM3, REFERENCE_TEMPERATURE_DEGC = 1026.0, 15.0
"""The water that results are stated for, ISO 15016:2015."""

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
WindType = Literal[
    "tanker_loaded", "tanker_ballast", "gas_carrier_prismatic", "container_loaded", "general_cargo"
]  # fmt: skip
"""Ships with typical coefficients of wind resistance: :mod:`seatrial.analysis.speed_power.corrections`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """A ship as she ran her trial, and the sea and the air of that day; None is not known.

    ``displacement_m3`` is that of the trial and ``stated_displacement_m3`` the one that results are wanted for.
    ``midship_section_m2`` is the area of the largest section under water, ``bow_length_m`` how far abaft the stem
    the waterline has 95 % of its largest beam, ``frontal_area_m2`` what the wind sees from ahead.
    ``wind_resistance`` are C_AA at equal steps of the angle off the bow, 0 to 180 deg, positive where the air
    brakes, for a wind at ``wind_reference_height_m``; ``anemometer_height_m`` is where it was measured. Without
    them ``wind_resistance_type`` takes those that are typical of a kind of ship.
    ``propulsive_efficiency`` is towing power by the power that is measured at the shafts, and ``load_variation``
    (xi_P) its change by the relative change of resistance. ``form_factor`` is 1 + k. ``wave_from_deg`` is the
    true direction that the waves come from, ``wave_height_m`` their significant height, ``wave_period_s`` the mean
    period (T01); ``pitch_gyradius_m`` is the radius of gyration of pitch. ``power_error_percent`` is the accuracy
    of the power measurement. ``trim_m`` is positive by the stern, ``gm_m`` the metacentric height,
    ``full_load_draught_m`` that of the summer load line; ``beaufort`` and ``sea_state`` (0 to 9) are the force of
    the wind and the state of the sea, ``current_mps`` the speed of the current. ``speed_at_85_percent_mcr_mps`` is
    that of the ship at 85 % of the maximum output of her engines. IMO's standards for ship manoeuvrability are for
    a ``chemical_or_gas_tanker`` of any length.
    """

    length_m: Positive | None = None
    beam_m: Positive | None = None
    draught_m: Positive | None = None
    displacement_m3: Positive | None = None
    stated_displacement_m3: Positive | None = None
    midship_section_m2: Positive | None = None
    wetted_area_m2: Positive | None = None
    waterplane_area_m2: Positive | None = None
    form_factor: Positive | None = None
    bow_length_m: Positive | None = None
    frontal_area_m2: Positive | None = None
    wind_resistance: tuple[Finite, ...] = ()
    wind_resistance_type: WindType | None = None
    wind_reference_height_m: Positive = 10.0
    anemometer_height_m: Positive | None = None
    propulsive_efficiency: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    load_variation: Finite = 0.0
    wave_height_m: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    wave_from_deg: Finite | None = None
    wave_period_s: Positive | None = None
    pitch_gyradius_m: Positive | None = None
    power_error_percent: Annotated[float, Field(ge=0.0, le=20.0)] = 1.0
    trim_m: Finite | None = None
    gm_m: Finite | None = None
    full_load_draught_m: Positive | None = None
    speed_at_85_percent_mcr_mps: Positive | None = None
    chemical_or_gas_tanker: bool = False
    current_mps: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    beaufort: Annotated[int, Field(ge=0, le=12)] | None = None
    sea_state: Annotated[int, Field(ge=0, le=9)] | None = None
    water_depth_m: Positive | None = None
    water_temperature_degc: Annotated[float, Field(ge=-2.0, le=40.0)] | None = None
    water_density_kgpm3: Annotated[float, Field(ge=950.0, le=1100.0)] = REFERENCE_DENSITY_KGPM3
    air_density_kgpm3: Annotated[float, Field(ge=1.0, le=1.5)] = 1.225

    def number(self, name: str) -> float:
        """One of these, NaN where it is not known."""
        value = getattr(self, name)
        return float("nan") if value is None else float(value)

    def lacks(self, *names: str) -> list[str]:
        """Which of these are not known."""
        return [name for name in names if getattr(self, name) in (None, ())]

    def as_text(self) -> str:
        """What is known of these, as a recording carries it: JSON, empty where nothing is."""
        default = Conditions()
        known = {field.name: value for field in fields(self)
                 if (value := getattr(self, field.name)) != getattr(default, field.name)}  # fmt: skip
        return json.dumps(known) if known else ""

    def with_known(self, other: Conditions) -> Conditions:
        """These with what they do not say taken from others."""
        default, own = Conditions(), {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(other, **{name: value for name, value in own.items() if value != getattr(default, name)})


Conditions.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]
