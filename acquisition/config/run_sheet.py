"""A trial as its crew describes it: run sheet, conditions, context, instruments, and the ship's particulars.

They are the tables ``[trial]``, ``[conditions]``, ``[context]``, ``[instruments]`` and ``[particulars]`` of a
configuration and of a column map, and of the file ``conditions.toml`` that states afterwards what a recording does
not.
"""

from __future__ import annotations

import dataclasses
import json
import logging
from dataclasses import field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import Field
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config.declarations import STRICT, Finite
from seatrial.acquisition.core.errors import escape_control_characters
from seatrial.acquisition.core.files import parse_toml, read_text, type_adapter, validate_toml
from seatrial.acquisition.core.trial import Trial

LOG = logging.getLogger("seatrial")
Content = TypeVar("Content")

CONDITIONS_FILE = "conditions.toml"
"""The file beside recordings that states what they do not."""
REFERENCE_DENSITY_KGPM3, REFERENCE_TEMPERATURE_DEGC = 1026.0, 15.0
"""The water that results are stated for, ISO 15016:2015."""

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
WindType = Literal[
    "tanker_loaded", "tanker_ballast", "gas_carrier_prismatic", "container_loaded", "general_cargo"
]  # fmt: skip
"""Ships with typical coefficients of wind resistance: :mod:`seatrial.analysis.speed_power.formulas`."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """A ship as it ran its trial, and the sea and the air of that day; None is not known.

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
    that of the ship at 85 % of the maximum output of its engines. IMO's standards for ship manoeuvrability are for
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

    def unknown_names(self, *names: str) -> list[str]:
        """Which of these are not known."""
        return [name for name in names if getattr(self, name) in (None, ())]

    def as_text(self) -> str:
        """What is known of these, as a recording carries it: JSON, empty where nothing is."""
        return _json_or_empty(non_default_values(self))

    def completed_from(self, fallback: Conditions) -> Conditions:
        """These, with what they do not state taken from ``fallback``."""
        return replace(fallback, **non_default_values(self))


Conditions.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


_Count = Annotated[int, Field(ge=1, le=20)]


@dataclass(frozen=True, config=STRICT)
class Origin:
    """The origin of the trial's tangent plane, WGS 84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]


SurveyKind = Literal["position", "heading", "speed", "yaw_rate", "wind", "clock", "all"]
"""What can have been surveyed: the sensors of a quantity, the clocks of all, or everything."""

_ABSENT = ("still_water", "no_waves", "no_wind")
SURVEYED_KINDS: tuple[SurveyKind, ...] = tuple(kind for kind in get_args(SurveyKind) if kind != "all")


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Context:
    """What is known of a trial beforehand, so that no diagnosis looks for it and no identification fits it.

    ``still_water`` is water without current and waves, as in a towing tank; ``surveyed`` are the sensors that were
    surveyed or calibrated for the trial. ``known`` has parameters of effects whose sizes are known, as
    ``{"wake_both": {"fraction": 0.3}}``: they belong to the model.
    """

    still_water: bool = False
    no_waves: bool = False
    no_wind: bool = False
    surveyed: tuple[SurveyKind, ...] = ()
    known: dict[str, dict[str, Finite]] = field(default_factory=dict)

    @property
    def declarations(self) -> tuple[str, ...]:
        """What is declared absent or surveyed: ``still water``, ``heading surveyed``."""
        absent = [name.replace("_", " ") for name in _ABSENT if getattr(self, name)]
        return (*absent, *(f"{kind.replace('_', ' ')} surveyed" for kind in self.surveyed_kinds))

    @property
    def surveyed_kinds(self) -> tuple[SurveyKind, ...]:
        """What was surveyed, each kind by itself."""
        return SURVEYED_KINDS if "all" in self.surveyed else self.surveyed

    def as_text(self) -> str:
        """What is declared, as a recording carries it: JSON, empty where nothing is."""
        return _json_or_empty(non_default_values(self))

    def joined_with(self, other: Context) -> Context:
        """What either declares; the ``other`` prevails in the size of an effect."""
        absent = {name: getattr(self, name) or getattr(other, name) for name in _ABSENT}
        surveyed = tuple(dict.fromkeys((*self.surveyed, *other.surveyed)))
        return Context(**absent, surveyed=surveyed, known={**self.known, **other.known})

    def shared_with(self, other: Context) -> Context:
        """What both declare."""
        absent = {name: getattr(self, name) and getattr(other, name) for name in _ABSENT}
        surveyed = tuple(kind for kind in self.surveyed_kinds if kind in other.surveyed_kinds)
        known = {name: values for name, values in self.known.items() if other.known.get(name) == values}
        return Context(**absent, surveyed=surveyed, known=known)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class InstrumentsSection:
    """The place, from midship, of the antenna whose positions are recorded, and the standard errors of channels as
    their makers state them, in the unit of each channel."""

    antenna_forward_m: Finite | None = None
    antenna_starboard_m: Finite | None = None
    accuracy: dict[str, Positive] = field(default_factory=dict)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Particulars:
    """What a report states of a ship besides the dimensions and the loading in its :class:`Conditions`.

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
        return non_default_values(self)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class RunSheet:
    """The description of a trial in a configuration or a column map.

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

    def as_trial(
        self, conditions: Conditions, context: Context, instruments: InstrumentsSection, particulars: Particulars
    ) -> Trial:
        """The run sheet in the form that a recording stores."""
        values: dict[str, Any] = {entry.name: getattr(self, entry.name) for entry in fields(RunSheet)}
        origin = values.pop("origin")
        return Trial(
            **values, origin_latitude_deg=None if origin is None else origin.latitude_deg,
            origin_longitude_deg=None if origin is None else origin.longitude_deg,
            conditions=conditions.as_text(), context=context.as_text(),
            antenna_forward_m=instruments.antenna_forward_m, antenna_starboard_m=instruments.antenna_starboard_m,
            accuracy=_json_or_empty(instruments.accuracy), particulars=_json_or_empty(particulars.stated()),
        )  # fmt: skip


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Statement:
    """What a user states of trials that are recorded already; it takes precedence over what a recording holds."""

    trial: RunSheet = field(default_factory=RunSheet)
    conditions: Conditions = field(default_factory=Conditions)
    context: Context = field(default_factory=Context)
    instruments: InstrumentsSection = field(default_factory=InstrumentsSection)
    particulars: Particulars = field(default_factory=Particulars)

    def apply_to_trial(self, trial: Trial) -> Trial:
        """A recording's trial with all that is stated here."""
        statement = self.trial.as_trial(self.conditions, self.context, self.instruments, self.particulars)
        values = {entry.name: getattr(statement, entry.name) for entry in fields(Trial)}
        stated = {name: value for name, value in values.items() if value not in ("", None)}
        merged = {
            "conditions": self.conditions.completed_from(conditions_in_trial(trial)).as_text(),
            "context": context_in_trial(trial).joined_with(self.context).as_text(),
            "accuracy": _json_or_empty({**standard_errors_in_trial(trial), **self.instruments.accuracy}),
            "particulars": _json_or_empty({**particulars_in_trial(trial).stated(), **self.particulars.stated()}),
        }
        return replace(trial, **{**stated, **merged})

    def as_text(self) -> str:
        """The statement as JSON, of which :func:`statement_from_text` is the inverse."""
        return str(type_adapter(Statement).dump_json(self, exclude_defaults=True).decode())


def statement_from_text(text: str) -> Statement:
    """The statement in a text; nothing is stated in an empty one. Raises ValueError."""
    return type_adapter(Statement).validate_json(text) if text else Statement()


def load_statement(path: Path | str) -> Statement:
    """A statement from a TOML file: the tables ``[conditions]``, ``[context]``, ``[particulars]``,
    ``[instruments]`` and ``[trial]``, or the conditions alone by their names. Raises :class:`ConfigurationError`.
    """
    text = read_text(path)
    tree = parse_toml(text, path)
    if any(isinstance(value, dict) for value in tree.values()) or not tree:
        return validate_toml(tree, text, path, Statement)
    return Statement(conditions=validate_toml(tree, text, path, Conditions))


def find_statement_file(path: Path | None, *search_folders: Path) -> Path | None:
    """The file that states what recordings do not: the one given, else the first :data:`CONDITIONS_FILE` in a
    folder or beside a recording of these places; None where there is none."""
    folders = (place if place.is_dir() else place.parent for place in search_folders)
    files = (folder / CONDITIONS_FILE for folder in folders)
    return path or next((file for file in files if file.is_file()), None)


def read_statement_text(path: Path | None, *folders: Path) -> str:
    """The statement of :func:`find_statement_file` as text, empty where there is none.

    Raises :class:`ConfigurationError`.
    """
    file = find_statement_file(path, *folders)
    return "" if file is None else load_statement(file).as_text()


def conditions_in_trial(trial: Trial) -> Conditions:
    """The conditions that a recording carries; what cannot be read is warned of and left out."""
    return _parse_or_warn(Conditions, trial.conditions, trial) or Conditions()


def context_in_trial(trial: Trial) -> Context:
    """The context that a recording carries; what cannot be read is warned of and left out."""
    return _parse_or_warn(Context, trial.context, trial) or Context()


def particulars_in_trial(trial: Trial) -> Particulars:
    """The particulars that a recording carries; what cannot be read is warned of and left out."""
    return _parse_or_warn(Particulars, trial.particulars, trial) or Particulars()


def standard_errors_in_trial(trial: Trial) -> dict[str, float]:
    """The standard errors by channel that a recording carries; what cannot be read is warned of and left out."""
    return _parse_or_warn(dict[str, Positive], trial.accuracy, trial) or {}


def _parse_or_warn(kind: type[Content], text: str, trial: Trial) -> Content | None:
    if not text:
        return None
    try:
        return type_adapter(kind).validate_json(text)
    except ValueError:
        LOG.warning(
            "%s: its metadata %s cannot be read and are left out",
            escape_control_characters(trial.name),
            escape_control_characters(text[:40]),
        )
        return None


def non_default_values(section: Any) -> dict[str, Any]:
    """What is stated in a table, a dataclass: all that is not its default."""
    defaults = {
        entry.name: entry.default if entry.default_factory is dataclasses.MISSING else entry.default_factory()
        for entry in fields(section)
    }
    values = {name: getattr(section, name) for name in defaults}
    return {name: value for name, value in values.items() if value != defaults[name]}


def _json_or_empty(values: dict[str, Any]) -> str:
    return json.dumps(values) if values else ""
