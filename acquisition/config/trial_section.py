"""What a person says of a trial, in a configuration or a column map, as checked sections of TOML."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from acquisition.config.sections import STRICT, FiniteFloat
from acquisition.core.trial import Trial


@dataclass(frozen=True, config=STRICT)
class Origin:
    """The origin of the trial's tangent plane, WGS 84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class RunSheet:
    """What a person says of a trial, in a configuration or in a column map."""

    name: str = ""
    vessel: str = ""
    place: str = ""
    origin: Origin | None = None
    water_depth_m: FiniteFloat | None = None
    draught_m: FiniteFloat | None = None
    trim_m: FiniteFloat | None = None
    loading: str = ""
    sea_state: str = ""
    crew_notes: str = ""

    def as_trial(self) -> Trial:
        """The run sheet as a recording carries it."""
        return Trial(
            name=self.name,
            vessel=self.vessel,
            place=self.place,
            origin_latitude_deg=self.origin.latitude_deg if self.origin else None,
            origin_longitude_deg=self.origin.longitude_deg if self.origin else None,
            water_depth_m=self.water_depth_m,
            draught_m=self.draught_m,
            trim_m=self.trim_m,
            loading=self.loading,
            sea_state=self.sea_state,
            crew_notes=self.crew_notes,
        )


@dataclass(frozen=True, config=STRICT, kw_only=True)
class TrialSection(RunSheet):
    """The run sheet of a trial to record, which needs a name. Without an origin the first fix becomes it.

    ``magnetic_variation_deg`` (east positive) serves a magnetic compass until a device tells the variation.
    """

    name: Annotated[str, Field(min_length=1, max_length=100)]
    magnetic_variation_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
