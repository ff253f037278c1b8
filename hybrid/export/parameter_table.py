"""The numbers of a vessel's model as a table: name, value, unit, where it is from, and its interval."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

from seatrial.acquisition.core.files import write_text
from seatrial.hybrid.export.equations import Equations, flat_parameters
from seatrial.hybrid.export.fmu import unit_of_number
from seatrial.hybrid.vessel.files import Vessel
from seatrial.hybrid.vessel.plant import Plant

COLUMNS = ("name", "value", "unit", "group", "source", "low", "high")
_TWO_SIDED = 1.96  # standard deviations: 95 %


def write_table(path: Path, vessel: Vessel, plant: Plant, equations: Equations, remarks: Sequence[str]) -> Path:
    """Write the table, with the remarks as comments before it.

    An interval of 95 % is there for a number whose standard deviation the vessel file has in ``[estimated]``.
    """
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    hull = set(plant.hull_model.numbers)
    for name, value in flat_parameters(equations).items():
        group = _group_of(name, vessel, hull)
        keys = f"{group}.{name.removeprefix(f'{group}_')}", f"{group}.{name}"  # both may be in [estimated]
        share = next((vessel.estimated[key] for key in keys if key in vessel.estimated), None)
        spread = None if share is None else _TWO_SIDED * share * abs(value)
        interval = ("", "") if spread is None else (repr(value - spread), repr(value + spread))
        writer.writerow([name, repr(value), unit_of_number(name), group, _source_of(group, vessel), *interval])
    comments = "".join(f"# {remark}\n" for remark in remarks)
    return write_text(path, comments + text.getvalue())


def _group_of(name: str, vessel: Vessel, hull: set[str]) -> str:
    """The part of the ship that a number is of: its hull, an actuator, the wind, else the ship."""
    if name in hull:
        return "hull"
    actuators = [actuator.name for actuator in vessel.actuators if name.startswith(f"{actuator.name}_")]
    if actuators:
        return max(actuators, key=len)
    wind = ("CX_", "CY_", "CN_", "wind_", "air_", "frontal_", "lateral_")
    inertia = ("mass_kg", "yaw_inertia", "Xud", "Yvd", "Yrd", "Nrd", "centre_of")
    return "wind" if name.startswith(wind) else "inertia" if name.startswith(inertia) else "ship"


def _source_of(group: str, vessel: Vessel) -> str:
    """What the vessel file says of where a part is from, by its name or that of its kind."""
    kinds = {actuator.name: actuator.kind for actuator in vessel.actuators}
    kind = kinds.get(group, group)
    names = (group, kind, f"{kind}s", f"{group}s", *(("thrusters",) if group in kinds else ()))
    return str(next((vessel.provenance[name] for name in names if name in vessel.provenance), ""))
