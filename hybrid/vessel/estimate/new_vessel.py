"""A vessel file from main dimensions, block coefficient and a list of propulsors: the estimates put together.

Every number of the file is given, assumed or estimated, and its comment says which. The usual relative error of
each estimate, one standard deviation, stands in ``[estimated]``, so that an identification knows what to trust.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from seatrial.acquisition.core import errors, files
from seatrial.acquisition.core.ship import Actuator, check_actuators
from seatrial.hybrid.vessel.estimate import devices
from seatrial.hybrid.vessel.estimate import hull as estimates
from seatrial.hybrid.vessel.estimate.hull import MainParticulars, SourcedValue, Table

HullName = Literal["mmg", "cross_flow"]
OUTLINES = "mean of Esso Osaka and R/V Gunnerus"
ESSO_OSAKA = "as of Esso Osaka"
AREA_ERROR = 0.4


@dataclass(frozen=True, slots=True)
class NewVessel:
    """A vessel file that is estimated: its ``text``, what to know of it, and what follows from the numbers.

    ``warnings`` are sentences; ``service_rpm`` is each shaft's speed that drives it at service speed;
    ``course_stable`` whether the bare hull holds its course, by the linear derivatives.
    """

    text: str
    warnings: tuple[str, ...]
    service_rpm: dict[str, float]
    course_stable: bool

    def save(self, path: str | Path) -> Path:
        """Write the vessel file. Raises :class:`StorageError`."""
        return files.write_text(path, self.text)


def new_vessel(
    output: str | Path | None = None,
    *,
    name: str,
    length_m: float,
    beam_m: float,
    draught_m: float,
    block: float,
    service_speed_mps: float,
    propellers: Sequence[devices.Propeller | str] = (),
    rudders: Sequence[devices.Rudder | str] = (),
    azimuths: Sequence[devices.Azimuth | str] = (),
    tunnels: Sequence[devices.Tunnel | str] = (),
    hull: HullName = "mmg",
    length_overall_m: float | None = None,
    centre_of_gravity_m: float | None = None,
    frontal_area_m2: float | None = None,
    lateral_area_m2: float | None = None,
    water_density_kgpm3: float = estimates.SEA_WATER_KGPM3,
    demihull_beam_m: float | None = None,
) -> NewVessel:
    """Estimate a ship's model from what its owner knows, and write it to ``output`` if that is named.

    A catamaran has a ``demihull_beam_m``, the beam of one of its two hulls, which draught and block coefficient are
    of then; ``beam_m`` is that over both. Lengths in metres, the length between perpendiculars; places of
    propulsors from midship, forward and to starboard. Propulsors are objects of :mod:`.devices` or texts
    ``"NAME,KEY=NUMBER,..."``. The regressions and their sources are in docs/theory/estimates.md. Raises
    :class:`InputError` for dimensions that no displacement ship has and for propulsors that cannot be,
    :class:`StorageError`.
    """
    shafts, pods = (
        devices.named_devices(devices.Propeller, propellers),
        devices.named_devices(devices.Azimuth, azimuths),
    )
    if not shafts and not pods:
        raise errors.InputError(
            "the ship has no propulsor", fix="name a propeller or an azimuth thruster with its diameter"
        )
    hulls = 1 if demihull_beam_m is None else 2
    if demihull_beam_m is not None and not 0.0 < demihull_beam_m <= 0.5 * beam_m:
        raise errors.InputError(
            f"a hull of a catamaran is {demihull_beam_m:g} m wide, and both together {beam_m:g} m",
            fix="give the beam over both hulls as --beam, and that of one as --demihull-beam",
        )
    ship = MainParticulars(
        length_m=length_m, beam_m=demihull_beam_m or beam_m, draught_m=draught_m, block=block,
        service_speed_mps=service_speed_mps, centre_of_gravity_m=centre_of_gravity_m,
        water_density_kgpm3=water_density_kgpm3, screws=-(-(len(shafts) + len(pods)) // hulls),
        spacing_m=0.0 if demihull_beam_m is None else beam_m - demihull_beam_m,
    )  # fmt: skip
    units = devices.make_propulsors(ship, shafts, pods)
    actuators = [
        *(unit.table for unit in units),
        *devices.rudder_tables(ship, devices.named_devices(devices.Rudder, rudders), units),
        *(devices.tunnel_table(ship, thruster) for thruster in devices.named_devices(devices.Tunnel, tunnels)),
    ]
    check_actuators(Actuator(table.label, str(table.rows["kind"])) for table in actuators)
    outline_numbers = wind_outline(ship, frontal_area_m2, lateral_area_m2)
    tables = [*_ship_tables(ship, length_overall_m or length_m, hull, outline_numbers), *actuators]
    warnings = (*estimates.describe_extrapolation(ship), *(warning for unit in units for warning in unit.warnings))
    rpm = {unit.screw.name: unit.rpm for unit in units}
    vessel = NewVessel(_vessel_file_text(name, ship, tables, warnings, rpm), warnings, rpm, is_course_stable(ship))
    if output is not None:
        vessel.save(output)
    return vessel


def is_course_stable(ship: MainParticulars) -> bool:
    """Whether the bare hull holds its course: Y_v (N_r - m x_G) > N_v (Y_r - m - m_x)."""
    ship = replace(ship, spacing_m=0.0)  # one hull of a catamaran: both have the same ratios
    d, inertia = estimates.linear_derivatives(ship), estimates.estimate_inertia(ship)
    m, m_x, x_G = (inertia[key].value for key in ("m", "m_x", "x_G"))
    return d["Y_v"].value * (d["N_r"].value - m * x_G) > d["N_v"].value * (d["Y_r"].value - m - m_x)


def _ship_tables(
    ship: MainParticulars, length_overall_m: float, hull: HullName, outline_numbers: estimates.Estimates
) -> list[Table]:
    """All tables of the file but those of the actuators."""
    U, by_speed, one = ship.service_speed_mps, "by the service speed", replace(ship, spacing_m=0.0)
    R_0 = estimates.resistance_coefficient(one)
    one_hull = (
        estimates.mmg_coefficients(one, R_0) if hull == "mmg" else estimates.cross_flow_coefficients(one, R_0)
    )
    hull_numbers = estimates.coefficients_of_all_hulls(ship, one_hull)
    dimensions: dict[str, estimates.Cell] = {
        "length_overall_m": length_overall_m,
        "length_between_perpendiculars_m": ship.length_m,
        "beam_m": ship.overall_beam_m,
        "draught_m": ship.draught_m,
    }
    validity: dict[str, estimates.Cell] = {
        "surge_low_mps": SourcedValue(-0.6 * U, source=by_speed),
        "surge_high_mps": SourcedValue(1.3 * U, source=by_speed),
        "sway_mps": SourcedValue(0.8 * U, source=by_speed),
        "yaw_rate_radps": SourcedValue(2.0 * U / ship.length_m, source="r' = 2 at service speed"),
    }
    return [
        Table("[dimensions]", "dimensions", dimensions),
        Table("[validity]", "validity", validity),
        Table("[inertia]", "inertia", {"model": "primed", **estimates.estimate_inertia(ship)}),
        Table("[hull]", "hull", {"model": hull, **hull_numbers}),
        Table("[wind]", "wind", {"model": "fujiwara", "air_density_kgpm3": 1.225, **outline_numbers}),
    ]


def _vessel_file_text(
    name: str,
    ship: MainParticulars,
    tables: Sequence[Table],
    warnings: Sequence[str],
    rpm: dict[str, float],
) -> str:
    head = [
        "# Estimated from main dimensions by published regressions; +- is the usual error, one standard deviation.",
        "# Body axes at midship, x forward, y to starboard. Measured numbers are better: write them in.",
        *(f"# Note: {warning}." for warning in warnings),
    ]
    plain = Table("", "", {
        "name": name,
        "description": f"{name.replace('_', ' ')}, estimated from main dimensions",
        "water_density_kgpm3": ship.water_density_kgpm3,
    })  # fmt: skip
    provenance = Table("[provenance]", "provenance", {
        "source": "seatrial vessel new",
        "block_coefficient": ship.block,
        "service_speed_mps": ship.service_speed_mps,
        **({"demihull_beam_m": ship.beam_m} if ship.hull_count > 1 else {}),
        **{f"service_rpm_{shaft}": value for shaft, value in rpm.items()},
    })  # fmt: skip
    estimated = [
        f'"{table.label}.{key}" = {estimates.number_text(round(cell.error, 3))}'
        for table in tables
        for key, cell in table.rows.items()
        if isinstance(cell, SourcedValue) and cell.error > 0.0
    ]
    parts = [
        "\n".join(head),
        *map(estimates.table_as_toml, [plain, provenance, *tables]),
        "\n".join(["[estimated]", *estimated]),
    ]
    return "\n".join(parts) + "\n"


def wind_outline(ship: MainParticulars, frontal_m2: float | None, lateral_m2: float | None) -> estimates.Estimates:
    """Areas, centres and heights above water for Fujiwara's regression; with the areas that are known.

    The ratios are the geometric means of two published outlines, Esso Osaka's and R/V Gunnerus'; where only Esso
    Osaka's is published, that one. Ships differ by half as much again: measured areas are worth having.
    """
    L, B = ship.length_m, ship.overall_beam_m
    frontal = SourcedValue(0.70 * B * B, AREA_ERROR, f"0.70 B^2, {OUTLINES}")
    lateral = SourcedValue(0.45 * L * B, AREA_ERROR, f"0.45 L B, {OUTLINES}")
    frontal = frontal if frontal_m2 is None else SourcedValue(frontal_m2)
    lateral = lateral if lateral_m2 is None else SourcedValue(lateral_m2)
    A_T, A_L = frontal.value, lateral.value
    return {
        "frontal_area_m2": frontal,
        "lateral_area_m2": lateral,
        "superstructure_area_m2": SourcedValue(0.27 * A_L, 0.5, f"0.27 of the lateral area, {ESSO_OSAKA}"),
        "lateral_centre_m": SourcedValue(-0.0043 * L, 5.0, ESSO_OSAKA),
        "lateral_centre_height_m": SourcedValue(0.60 * A_L / L, 0.2, f"0.60 A_L / L, {ESSO_OSAKA}"),
        "bridge_centre_m": SourcedValue(-0.021 * L, 5.0, ESSO_OSAKA),
        "bridge_height_m": SourcedValue(1.06 * A_T / B, 0.3, f"1.06 A_T / B, {ESSO_OSAKA}"),
    }
