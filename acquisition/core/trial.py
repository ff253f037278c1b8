"""The description of a trial: the ship, the place, the origin of the tangent plane, the crew's notes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version

SOFTWARE = "seatrial"
"""What the version of all files that Seatrial writes begins with."""


@cache
def software_version() -> str:
    """The installed version of Seatrial, which is written into every output."""
    try:
        return f"{SOFTWARE} {version(SOFTWARE)}"
    except PackageNotFoundError:
        return f"{SOFTWARE} (not installed)"


@dataclass(frozen=True, slots=True)
class Trial:
    """The run sheet of a recording. ``None`` and the empty string mean unknown.

    ``loading`` and ``sea_state`` are in the crew's words, ``trim_m`` is positive by the stern. The origin is
    that of the north-east-down tangent plane of ``north_m`` and ``east_m``. ``actuators`` lists the ship's as
    text (:func:`seatrial.acquisition.core.actuators.as_text`), empty for the default list; ``channels`` are those
    declared in its configuration, as text (:func:`seatrial.acquisition.core.declared.declared_text`),
    ``conditions`` those of its ``[conditions]`` (:func:`seatrial.acquisition.config.run_sheet.conditions_of`).
    ``antenna_forward_m`` and ``antenna_starboard_m`` are the place, from midship, of the point that the recorded
    positions are of; ``accuracy``, the standard errors of channels, and ``particulars``, the ship's, are JSON
    (:mod:`seatrial.acquisition.config.run_sheet`). The fields from ``summary`` on are those that data centres ask
    for, with their names in ACDD-1.3.
    """

    name: str = ""
    vessel: str = ""
    place: str = ""
    origin_latitude_deg: float | None = None
    origin_longitude_deg: float | None = None
    water_depth_m: float | None = None
    draught_m: float | None = None
    crew_notes: str = ""
    trim_m: float | None = None
    loading: str = ""
    sea_state: str = ""
    actuators: str = ""
    channels: str = ""
    conditions: str = ""
    antenna_forward_m: float | None = None
    antenna_starboard_m: float | None = None
    accuracy: str = ""
    particulars: str = ""
    summary: str = ""
    keywords: str = ""
    creator_name: str = ""
    creator_email: str = ""
    institution: str = ""
    project: str = ""
    license: str = ""

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the origin [deg], if both are known."""
        if self.origin_latitude_deg is None or self.origin_longitude_deg is None:
            return None
        return self.origin_latitude_deg, self.origin_longitude_deg

    def as_metadata(self) -> dict[str, str]:
        """The MCAP metadata record ``trial``, without unknown fields."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        texts = {key: _encodable(str(value)) for key, value in values.items() if value not in (None, "")}
        if "name" in texts:
            texts["trial"] = texts.pop("name")
        return {**texts, "software_version": software_version()}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> Trial:
        """The inverse of :meth:`as_metadata`; unknown keys are ignored."""
        texts = dict(metadata)
        texts["name"] = texts.pop("trial", "")
        values: dict[str, str | float] = {}
        for field in fields(cls):
            if texts.get(field.name):
                numeric = "float" in str(field.type)
                values[field.name] = float(texts[field.name]) if numeric else texts[field.name]
        return cls(**values)  # type: ignore[arg-type]


def _encodable(text: str) -> str:
    """A text as a file can hold it: bytes of a file name that are not UTF-8 are written as escapes."""
    return text.encode(errors="backslashreplace").decode()
