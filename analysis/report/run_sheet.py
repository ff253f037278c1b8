"""The run sheet of a trial: the ship with her loading, the conditions, the file; and what nobody recorded.

Fields as in the form of MSC/Circ.1053, appendix 6. What people state comes from the recording's metadata, wind and
times from its channels.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from seatrial.acquisition.config.conditions import REFERENCE_DENSITY_KGPM3, Conditions
from seatrial.acquisition.config.run_sheet import Particulars, particulars_of
from seatrial.acquisition.core.quantities import KNOT_MPS, mean_wind
from seatrial.acquisition.core.ship import from_text
from seatrial.acquisition.core.trial import Trial, software_version
from seatrial.analysis.conditions import beaufort, recorded_conditions
from seatrial.analysis.manoeuvres.criteria import mean_of
from seatrial.analysis.manoeuvres.indices import index_of
from seatrial.analysis.manoeuvres.turning_circle import shows_current
from seatrial.analysis.quality.samples import ASSUMED
from seatrial.analysis.tables.table import sha256_of

if TYPE_CHECKING:
    from pathlib import Path

    from seatrial.acquisition.recording.reader import Recording
    from seatrial.analysis.manoeuvres import Manoeuvre

UNKNOWN = "not recorded"


@dataclass(frozen=True, slots=True)
class ShipDimensions:
    """Main dimensions [m], from a vessel file or a person; a person may know the length only.

    ``title`` is what people call her, empty where only the file's ``name`` is known.
    """

    name: str
    over_all_m: float
    between_perpendiculars_m: float
    beam_m: float | None = None
    draught_m: float | None = None
    title: str = ""


Rows = list[tuple[str, str]]


def run_sheet(
    recording: Recording,
    one_hz: pd.DataFrame,
    manoeuvres: Iterable[Manoeuvre] = (),
    ship: ShipDimensions | None = None,
) -> Rows:
    """What and its value as text, in the order of a run sheet; what is not known says so.

    ``one_hz`` is the recording once a second. ``manoeuvres`` whose turns show a current give it.
    """
    runs = tuple(manoeuvres)
    conditions = condition_rows(recording, one_hz, runs, ship)
    return [*ship_rows(recording.trial, one_hz, runs, ship), *conditions, *file_rows(recording)]


def ship_rows(
    trial: Trial, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre], ship: ShipDimensions | None
) -> Rows:
    """The ship's particulars and her loading."""
    stated, particulars = recorded_conditions(trial, pd.DataFrame()), particulars_of(trial)
    return [
        ("ship", (ship.title if ship else "") or trial.vessel or UNKNOWN),
        ("ship type", particulars.ship_type or UNKNOWN),
        ("IMO number", particulars.imo_number or UNKNOWN),
        ("hull number, builder", _joined(particulars.hull_number, particulars.builder)),
        ("owner", particulars.owner or UNKNOWN),
        ("classification", particulars.classification or UNKNOWN),
        *_dimensions(ship, stated, one_hz, manoeuvres),
        ("loading", trial.loading or UNKNOWN),
        ("draughts fore, aft", _draughts(stated)),
        ("full load draught", _metres(stated.full_load_draught_m)),
        ("trim by the stern", _metres(stated.trim_m)),
        ("displacement", _quantity(stated.displacement_m3, "m\u00b3")),
        ("block coefficient", _block_coefficient(particulars, stated, ship)),
        ("metacentric height GM", _metres(stated.gm_m)),
        ("rudders", _rudders(particulars, stated, ship)),
        ("propellers", _joined(
            _counted(particulars.propellers, particulars.propeller_type),
            f"diameter {particulars.propeller_diameter_m:g} m" if particulars.propeller_diameter_m else "")),
        ("engines", _joined(_counted(particulars.engines, particulars.engine_type), _rating(particulars))),
        ("speed at 85 % of the maximum output", _speed_text(stated.speed_at_85_percent_mcr_mps)),
        *_actuators(trial.actuators),
    ]  # fmt: skip


def condition_rows(
    recording: Recording, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre], ship: ShipDimensions | None
) -> Rows:
    """Time, place, water and weather of a trial, and where its antenna is."""
    trial = recording.trial
    stated = recorded_conditions(trial, pd.DataFrame())
    state_of_sea = UNKNOWN if stated.sea_state is None else f"state {stated.sea_state}"
    draught_m = stated.draught_m or (ship.draught_m if ship else None)
    density = stated.water_density_kgpm3
    return [
        ("trial", trial.name or UNKNOWN),
        *_when(one_hz),
        ("place", trial.place or UNKNOWN),
        ("origin of north and east", _origin_text(trial.origin)),
        ("water depth", _depth(stated.water_depth_m, draught_m)),
        ("water temperature, density", _joined(
            "" if stated.water_temperature_degc is None else f"{stated.water_temperature_degc:g} \u00b0C",
            f"{density:g} kg/m\u00b3" if density != REFERENCE_DENSITY_KGPM3 else "")),
        ("wind", _wind(recording, one_hz, stated.beaufort)),
        ("sea state", trial.sea_state or state_of_sea),
        ("significant wave height", _waves(stated)),
        ("current", _current(manoeuvres, stated.current_mps)),
        ("antenna from midship", _place_text(trial)),
        ("crew notes", trial.crew_notes or UNKNOWN),
    ]  # fmt: skip


def _joined(*parts: str) -> str:
    return ", ".join(filter(None, parts)) or UNKNOWN


def _counted(number: int | None, what: str) -> str:
    return " ".join(filter(None, (str(number or ""), what)))


def _quantity(value: float | None, unit: str) -> str:
    return UNKNOWN if value is None else f"{value:,.5g} {unit}" if value < 1e4 else f"{value:,.0f} {unit}"


def _draughts(stated: Conditions) -> str:
    if stated.draught_m is None:
        return UNKNOWN
    if stated.trim_m is None:
        return f"mean {stated.draught_m:g} m"
    half = 0.5 * stated.trim_m
    fore_m, aft_m = stated.draught_m - half, stated.draught_m + half
    return f"{fore_m:g} m, {aft_m:g} m, from the mean of {stated.draught_m:g} m and the trim"


def _block_coefficient(particulars: Particulars, stated: Conditions, ship: ShipDimensions | None) -> str:
    """As stated, else by the displacement, length, beam and draught of the trial."""
    if particulars.block_coefficient is not None:
        return f"{particulars.block_coefficient:g}"
    sizes = (ship.between_perpendiculars_m, ship.beam_m, stated.draught_m) if ship else (None,)
    if stated.displacement_m3 is None or None in sizes:
        return UNKNOWN
    return f"{stated.displacement_m3 / np.prod(np.array(sizes, dtype=float)):.3f}, from the displacement"


def _rudders(particulars: Particulars, stated: Conditions, ship: ShipDimensions | None) -> str:
    area, draught_m = particulars.rudder_area_m2, stated.full_load_draught_m or (ship.draught_m if ship else None)
    ratio = (
        f" (1/{ship.between_perpendiculars_m * draught_m / area:.0f} of LT)" if area and ship and draught_m else ""
    )
    return _joined(
        _counted(particulars.rudders, particulars.rudder_type),
        f"area {area:g} m\u00b2{ratio}" if area else "",
        f"{particulars.rudder_rate_dps:g} deg/s" if particulars.rudder_rate_dps else "",
    )


def _rating(particulars: Particulars) -> str:
    at = f" at {particulars.mcr_rpm:g} rpm" if particulars.mcr_rpm else ""
    return f"MCR {particulars.mcr_kw:,.0f} kW{at}" if particulars.mcr_kw else ""


def _waves(stated: Conditions) -> str:
    if stated.wave_height_m is None:
        return UNKNOWN
    direction = "" if stated.wave_from_deg is None else f" from {stated.wave_from_deg:.0f}\u00b0"
    return f"{stated.wave_height_m:g} m{direction}"


def file_rows(recording: Recording) -> list[tuple[str, str]]:
    """The file behind a run sheet, and the software."""
    return [
        ("recording", _files_text(recording.paths)),
        ("SHA-256", sha256_of(*recording.paths) or UNKNOWN),
        ("closed properly", "yes" if recording.closed else "no: read as far as it goes"),
        *([("clock", recording.clock)] if recording.clock else []),
        ("this page by", software_version()),
    ]


def _files_text(paths: Sequence[Path]) -> str:
    more = f" and {len(paths) - 1} later part{'s' * (len(paths) > 2)}" if len(paths) > 1 else ""
    return f"{paths[0].name}{more}, {sum(path.stat().st_size for path in paths):,} bytes"


def _actuators(said: str) -> list[tuple[str, str]]:
    """What drives and steers a ship, each with its kind where the name does not say it; nothing for the list that
    recordings do not say."""
    if not said:
        return []
    named = ((each.name.replace("_", " "), each.kind.replace("_", " ")) for each in from_text(said))
    return [("actuators", ", ".join(name if kind in name else f"{name} ({kind})" for name, kind in named))]


def _when(one_hz: pd.DataFrame) -> list[tuple[str, str]]:
    first, last = one_hz.index[0], one_hz.index[-1]
    minutes = (last - first).total_seconds() / 60.0
    if not has_date(first):
        return [("date", UNKNOWN), ("duration", f"{minutes:.1f} min")]
    until = f"{last:%H:%M:%S}" if last.date() == first.date() else f"{last:%Y-%m-%d %H:%M:%S}"
    return [("date", f"{first:%Y-%m-%d}"), ("time, UTC", f"{first:%H:%M:%S} to {until}, {minutes:.1f} min")]


def has_date(time: pd.Timestamp) -> bool:
    """Whether a time has a date: those of an unknown start count from 1970."""
    return time.year > _UNKNOWN_YEAR


_UNKNOWN_YEAR = 1970


def _origin_text(origin: tuple[float, float] | None) -> str:
    if origin is None:
        return UNKNOWN
    latitude, longitude = origin
    return (
        f"{abs(latitude):.5f}\u00b0 {'N' if latitude >= 0 else 'S'}, "
        f"{abs(longitude):.5f}\u00b0 {'E' if longitude >= 0 else 'W'}"
    )


def _metres(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:g} m"


def _depth(depth_m: float | None, draught_m: float | None) -> str:
    if depth_m is None or not draught_m:
        return _metres(depth_m)
    return f"{depth_m:g} m, {depth_m / draught_m:.1f} draughts"


def _speed_text(speed_mps: float | None) -> str:
    return UNKNOWN if speed_mps is None else f"{speed_mps:.2f} m/s ({speed_mps / KNOT_MPS:.1f} kn)"


def _place_text(trial: Trial) -> str:
    if trial.antenna_forward_m is None:
        return UNKNOWN
    return f"{trial.antenna_forward_m:g} m forward, {trial.antenna_starboard_m or 0.0:g} m to starboard"


def _wind(recording: Recording, one_hz: pd.DataFrame, stated_beaufort: int | None) -> str:
    """The wind as it was measured; one that an import assumed is none. Else its force as it was stated."""
    series = recording.series.get("wind_speed_mps")
    if stated_beaufort is not None and series is None:
        return f"Beaufort {stated_beaufort}, as stated"
    return f"{UNKNOWN}, calm assumed" if series and series.sources == (ASSUMED,) else wind_words(one_hz)


def wind_words(table: pd.DataFrame) -> str:
    """The mean wind, where it comes from, how it gusts, and its force."""
    air = table.reindex(columns=["wind_speed_mps", "wind_direction_deg"]).dropna()
    if air.empty:
        return UNKNOWN
    speed_mps, from_deg = mean_wind(air)
    gust = float(np.quantile(air["wind_speed_mps"], 0.99))
    return f"{speed_mps:.1f} m/s from {from_deg:.0f}\u00b0, gusts {gust:.1f} m/s, Beaufort {beaufort(speed_mps)}"


def _current(manoeuvres: Iterable[Manoeuvre], stated_mps: float | None) -> str:
    """The mean of what turns of more than one and a half circles show, with its 95 % interval along itself,
    of two turns half of their range.
    """
    found = [run.current for run in manoeuvres if run.current is not None and shows_current(run)]
    if not found:
        return (
            "unknown: no turn of one and a half circles" if stated_mps is None else f"{stated_mps:g} m/s, as stated"
        )
    north, east = (
        mean_of([index_of("", getattr(each, f"{name}_mps"), getattr(each, f"{name}_within_mps")) for each in found])
        for name in ("north", "east")
    )  # fmt: skip
    speed = float(np.hypot(north.index.value, east.index.value))
    towards = np.arctan2(east.index.value, north.index.value)
    within = np.hypot(np.cos(towards) * north.half, np.sin(towards) * east.half)
    turns = f"{len(found)} turn{'' if len(found) == 1 else 's'}"
    interval = "the range of both" if len(found) == 2 else "95 % interval"
    return (
        f"{speed:.2f} \u00b1 {within:.2f} m/s towards {np.rad2deg(towards) % 360.0:.0f}\u00b0 ({interval}), "
        f"from {turns}, wind drift included"
    )


def _dimensions(
    ship: ShipDimensions | None, stated: Conditions, one_hz: pd.DataFrame, manoeuvres: Iterable[Manoeuvre]
) -> Rows:
    """Dimensions and the ratios that the IMO's form asks for; the speed is that of the fastest approach, or without
    manoeuvres the median of what the ship made good."""
    if ship is None:
        return [("dimensions", "unknown: no vessel file for the ship that the recording names")]
    both = one_hz.reindex(columns=["surge_mps", "sway_mps"]).dropna()
    speed = float(np.median(np.hypot(both["surge_mps"], both["sway_mps"]))) if len(both) else 0.0
    approaches = [each.settings["approach_mps"] for each in manoeuvres if "approach_mps" in each.settings]
    speed, whose = (max(approaches), "fastest approach") if approaches else (speed, "median speed")
    length_m, beam_m, draught_m = ship.between_perpendiculars_m, ship.beam_m, stated.draught_m or ship.draught_m
    ratios = [
        f"L/B {length_m / beam_m:.2f}" if beam_m else "",
        f"B/T {beam_m / draught_m:.2f}" if beam_m and draught_m else "",
        f"L/V {length_m / speed:.1f} s at the {whose}, {speed:.2f} m/s over ground" if speed > _SLOWEST_MPS else "",
    ]
    overall = f"{ship.over_all_m:g} m overall, " if ship.over_all_m != length_m else ""
    size = f"{overall}{length_m:g} m between perpendiculars (L)"
    size += f", beam {beam_m:g} m" if beam_m else ""
    size += f", draught {ship.draught_m:g} m" if ship.draught_m else ""
    return [("dimensions", size), ("ratios", _joined(*ratios))]


_SLOWEST_MPS = 0.1  # a ship that lies still has no L/V
