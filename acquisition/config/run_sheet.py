"""A trial as people describe it: its run sheet, its conditions, the instruments, and the ship's particulars.

The tables ``[trial]``, ``[conditions]``, ``[instruments]`` and ``[particulars]`` of a configuration and of a column
map, and of the file ``conditions.toml`` that states afterwards what a recording does not.
"""

from __future__ import annotations

import json
import logging
from dataclasses import field, fields, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config.conditions import Conditions, Positive
from seatrial.acquisition.config.declarations import STRICT, Finite
from seatrial.acquisition.config.toml_file import parse_toml, read_text, validate
from seatrial.acquisition.core.errors import printable
from seatrial.acquisition.core.trial import Trial

LOG = logging.getLogger("seatrial")
Carried = TypeVar("Carried")

CONDITIONS_FILE = "conditions.toml"
"""The file beside recordings that states what they do not."""

_Count = Annotated[int, Field(ge=1, le=20)]


@dataclass(frozen=True, config=STRICT)
class Origin:
    """The origin of the trial's tangent plane, WGS 84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class InstrumentsSection:
    """The place, from midship, of the antenna whose positions are recorded, and the standard errors of channels as
    their makers state them, in the unit of each channel."""

    antenna_forward_m: Finite | None = None
    antenna_starboard_m: Finite | None = None
    accuracy: dict[str, Positive] = field(default_factory=dict)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Particulars:
    """What a report states of a ship besides the dimensions and the loading in her :class:`Conditions`.

    ``rudder_area_m2`` is that of all rudders; ``mcr_kw`` and ``mcr_rpm`` the maximum continuous rating of all
    engines and the shaft speed that belongs to it.
    """

    ship_type: str = ""
    imo_number: str = ""
    hull_number: str = ""
    builder: str = ""
    owner: str = ""
    classification: str = ""
    block_coefficient: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    rudder_type: str = ""
    rudders: _Count | None = None
    rudder_area_m2: Positive | None = None
    rudder_rate_dps: Positive | None = None
    propeller_type: str = ""
    propellers: _Count | None = None
    propeller_diameter_m: Positive | None = None
    engine_type: str = ""
    engines: _Count | None = None
    mcr_kw: Positive | None = None
    mcr_rpm: Positive | None = None

    def stated(self) -> dict[str, Any]:
        """What is stated of these."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(Particulars)}
        return {name: value for name, value in values.items() if value not in ("", None)}


@dataclass(frozen=True, config=STRICT, kw_only=True)
class RunSheet:
    """A person's description of a trial, in a configuration or a column map.

    The fields from ``summary`` on are those that data centres ask for, with their names in ACDD-1.3.
    """

    name: str = ""
    vessel: str = ""
    place: str = ""
    origin: Origin | None = None
    water_depth_m: Finite | None = None
    draught_m: Finite | None = None
    trim_m: Finite | None = None
    loading: str = ""
    sea_state: str = ""
    crew_notes: str = ""
    summary: str = ""
    keywords: str = ""
    creator_name: str = ""
    creator_email: str = ""
    institution: str = ""
    project: str = ""
    license: str = ""

    def as_trial(self, conditions: Conditions, instruments: InstrumentsSection, particulars: Particulars) -> Trial:
        """The run sheet in the form that a recording stores."""
        values: dict[str, Any] = {entry.name: getattr(self, entry.name) for entry in fields(RunSheet)}
        origin = values.pop("origin")
        place = (None, None) if origin is None else (origin.latitude_deg, origin.longitude_deg)
        return Trial(
            **values, origin_latitude_deg=place[0], origin_longitude_deg=place[1], conditions=conditions.as_text(),
            antenna_forward_m=instruments.antenna_forward_m, antenna_starboard_m=instruments.antenna_starboard_m,
            accuracy=_text(instruments.accuracy), particulars=_text(particulars.stated()),
        )  # fmt: skip


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Statement:
    """What a person states of trials that are recorded already; it counts for more than what a recording holds."""

    trial: RunSheet = field(default_factory=RunSheet)
    conditions: Conditions = field(default_factory=Conditions)
    instruments: InstrumentsSection = field(default_factory=InstrumentsSection)
    particulars: Particulars = field(default_factory=Particulars)

    def added_to(self, trial: Trial) -> Trial:
        """A recording's trial with all that is stated here."""
        statement = self.trial.as_trial(self.conditions, self.instruments, self.particulars)
        values = {entry.name: getattr(statement, entry.name) for entry in fields(Trial)}
        stated = {name: value for name, value in values.items() if value not in ("", None)}
        merged = {
            "conditions": self.conditions.with_known(conditions_of(trial)).as_text(),
            "accuracy": _text({**accuracy_of(trial), **self.instruments.accuracy}),
            "particulars": _text({**particulars_of(trial).stated(), **self.particulars.stated()}),
        }
        return replace(trial, **{**stated, **merged})

    def as_text(self) -> str:
        """The statement as JSON, of which :func:`statement_from_text` is the inverse."""
        return str(TypeAdapter(Statement).dump_json(self, exclude_defaults=True).decode())


def statement_from_text(text: str) -> Statement:
    """The statement in a text; nothing is stated in an empty one. Raises ValueError."""
    return TypeAdapter(Statement).validate_json(text) if text else Statement()


def load_statement(path: Path | str) -> Statement:
    """A statement from a TOML file: the tables ``[conditions]``, ``[particulars]``, ``[instruments]`` and
    ``[trial]``, or the conditions alone by their names. Raises :class:`ConfigurationError`.
    """
    text = read_text(path)
    tree = parse_toml(text, path)
    if any(isinstance(value, dict) for value in tree.values()) or not tree:
        return validate(tree, text, path, Statement)
    return Statement(conditions=validate(tree, text, path, Conditions))


def statement_file(path: Path | None, *places: Path) -> Path | None:
    """The file that states what recordings do not: the one given, else the first :data:`CONDITIONS_FILE` in a
    folder or beside a recording of these places; None where there is none."""
    folders = (place if place.is_dir() else place.parent for place in places)
    files = (folder / CONDITIONS_FILE for folder in folders)
    return path or next((file for file in files if file.is_file()), None)


def statement_text(path: Path | None, *places: Path) -> str:
    """The statement of :func:`statement_file` as text, empty where there is none.

    Raises :class:`ConfigurationError`.
    """
    file = statement_file(path, *places)
    return "" if file is None else load_statement(file).as_text()


def conditions_of(trial: Trial) -> Conditions:
    """The conditions that a recording carries; what cannot be read is warned of and left out."""
    return _carried(Conditions, trial.conditions, trial) or Conditions()


def particulars_of(trial: Trial) -> Particulars:
    """The particulars that a recording carries; what cannot be read is warned of and left out."""
    return _carried(Particulars, trial.particulars, trial) or Particulars()


def accuracy_of(trial: Trial) -> dict[str, float]:
    """The standard errors by channel that a recording carries; what cannot be read is warned of and left out."""
    return _carried(dict[str, Positive], trial.accuracy, trial) or {}


def _carried(kind: type[Carried], text: str, trial: Trial) -> Carried | None:
    if not text:
        return None
    try:
        return TypeAdapter(kind).validate_json(text)
    except ValueError:
        LOG.warning(
            "%s: its metadata %s cannot be read and are left out", printable(trial.name), printable(text[:40])
        )
        return None


def _text(values: dict[str, Any]) -> str:
    return json.dumps(values) if values else ""
