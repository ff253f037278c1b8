"""The tables of propellers, pods, rudders and tunnel thrusters, and the shaft speed that drives the ship.

Thrust of a propeller by the Wageningen B-series, the shaft speed that drives the ship at service speed, and
thrusters with side force: a pod from the propeller on it, a tunnel thruster from its power.

Oosterveld and van Oossanen 1975, Further computer-analyzed data of the Wageningen B-screw series, Int. Shipbuilding
Progress 22, 251-262: 2 to 7 blades, area ratio 0.3 to 1.05, pitch ratio 0.5 to 1.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import sqrt
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from seatrial.acquisition.core import errors
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.vessel.actuators.rudder import normal_force_slope
from seatrial.hybrid.vessel.effect import USUAL_LENGTH_M
from seatrial.hybrid.vessel.estimate import hull
from seatrial.hybrid.vessel.estimate.hull import Cell, Estimates, MainParticulars, SourcedValue, Table

B_SERIES = "Wageningen B-series, Oosterveld and van Oossanen 1975"
_TERMS = np.array([
    (0.00880496, 0, 0, 0, 0), (-0.204554, 1, 0, 0, 0), (0.166351, 0, 1, 0, 0), (0.158114, 0, 2, 0, 0),
    (-0.147581, 2, 0, 1, 0), (-0.481497, 1, 1, 1, 0), (0.415437, 0, 2, 1, 0), (0.0144043, 0, 0, 0, 1),
    (-0.0530054, 2, 0, 0, 1), (0.0143481, 0, 1, 0, 1), (0.0606826, 1, 1, 0, 1), (-0.0125894, 0, 0, 1, 1),
    (0.0109689, 1, 0, 1, 1), (-0.133698, 0, 3, 0, 0), (0.00638407, 0, 6, 0, 0), (-0.00132718, 2, 6, 0, 0),
    (0.168496, 3, 0, 1, 0), (-0.0507214, 0, 0, 2, 0), (0.0854559, 2, 0, 2, 0), (-0.0504475, 3, 0, 2, 0),
    (0.010465, 1, 6, 2, 0), (-0.00648272, 2, 6, 2, 0), (-0.00841728, 0, 3, 0, 1), (0.0168424, 1, 3, 0, 1),
    (-0.00102296, 3, 3, 0, 1), (-0.0317791, 0, 3, 1, 1), (0.018604, 1, 0, 2, 1), (-0.00410798, 0, 2, 2, 1),
    (-0.000606848, 0, 0, 0, 2), (-0.0049819, 1, 0, 0, 2), (0.0025983, 2, 0, 0, 2), (-0.000560528, 3, 0, 0, 2),
    (-0.00163652, 1, 2, 0, 2), (-0.000328787, 1, 6, 0, 2), (0.000116502, 2, 6, 0, 2), (0.000690904, 0, 0, 1, 2),
    (0.00421749, 0, 3, 1, 2), (0.0000565229, 3, 6, 1, 2), (-0.00146564, 0, 3, 2, 2),
])  # fmt: skip
"""K_T as a sum of c J^s (P/D)^t (A_E/A_0)^u Z^v, a row a term: c, s, t, u, v; for a Reynolds number of 2e6."""

_RANGES = (("pitch ratio", 0.5, 1.4), ("area ratio", 0.3, 1.05), ("number of blades", 2, 7))


def thrust_coefficient(J: Floats, pitch_ratio: float, area_ratio: float, blades: int) -> Floats:
    """K_T of a B-series propeller at the advance ratios ``J``.

    Raises :class:`InputError` for a propeller outside the series.
    """
    for (name, low, high), value in zip(_RANGES, (pitch_ratio, area_ratio, blades), strict=True):
        if not low <= value <= high:
            raise errors.InputError(
                f"a propeller's {name} is {value:g}",
                why=f"the Wageningen B-series has {low:g} to {high:g}",
                fix="give one within, or write K_T as k_0, k_1, k_2 into the vessel file yourself",
            )
    c, s, t, u, v = _TERMS.T
    J = np.asarray(J, dtype=float)
    thrust: Floats = (c * J[..., None] ** s * pitch_ratio**t * area_ratio**u * float(blades) ** v).sum(axis=-1)
    return thrust


def fit_thrust_quadratic(pitch_ratio: float, area_ratio: float, blades: int) -> tuple[float, float, float]:
    """``k_0, k_1, k_2`` of K_T = k_0 + k_1 J + k_2 J^2, fitted where the propeller thrusts ahead."""
    J = np.linspace(0.0, 1.6, 161)
    thrust = thrust_coefficient(J, pitch_ratio, area_ratio, blades)
    ahead = np.cumprod(thrust >= 0.0).astype(bool)
    k_2, k_1, k_0 = np.polyfit(J[ahead], thrust[ahead], 2)
    return float(k_0), float(k_1), float(k_2)


def open_water_coefficients(pitch_ratio: float, area_ratio: float, blades: int, error_factor: float) -> Estimates:
    """``k_0 k_1 k_2`` with their usual errors: a stock propeller is within 5 % of the series at zero speed.

    ``error_factor`` multiplies the errors: 1 for a propeller whose particulars are known, more for a typical one.
    """
    k_0, k_1, k_2 = fit_thrust_quadratic(pitch_ratio, area_ratio, blades)
    numbers = {"k_0": (k_0, 0.05), "k_1": (k_1, 0.10), "k_2": (k_2, 0.25)}
    return {name: SourcedValue(value, error * error_factor, B_SERIES) for name, (value, error) in numbers.items()}


def service_rps(
    thrust_n: float, speed_mps: float, diameter_m: float, k: tuple[float, float, float], density_kgpm3: float
) -> float:
    """Revolutions a second at which a propeller gives a thrust [N] in an inflow [m/s].

    The root of rho D^4 (k_0 n^2 + k_1 n V/D + k_2 V^2/D^2) = T.
    """
    k_0, k_1, k_2 = k
    V = speed_mps / diameter_m
    half = 0.5 * k_1 * V / k_0
    return -half + sqrt(half * half - (k_2 * V * V - thrust_n / (density_kgpm3 * diameter_m**4)) / k_0)


def pitch_ratio_of_thrust(K_T: float, J: float, area_ratio: float, blades: int) -> float:
    """The pitch ratio of a B-series propeller that has a K_T at ``J``; the end of the series if none has."""
    ratios = np.linspace(0.5, 1.4, 181)
    thrusts = [float(thrust_coefficient(np.array(J), ratio, area_ratio, blades)) for ratio in ratios]
    return float(ratios[int(np.argmin(np.abs(np.array(thrusts) - K_T)))])


def astern_coefficients(k_0: float) -> Estimates:
    """``astern_0 .. astern_3``, thrust with the shaft astern, in proportion to that ahead at zero speed.

    The shares are those of Esso Osaka (Miyauchi et al. 2022); other propellers scatter by a third.
    """
    source = "share of k_0 as of Esso Osaka, Miyauchi et al. 2022"
    shares = {"astern_0": -0.711, "astern_1": -0.766, "astern_2": -0.534}
    thrust = {name: SourcedValue(share * k_0, 0.3, source) for name, share in shares.items()}
    return {**thrust, "astern_3": SourcedValue(0.330, 0.3, "as of Esso Osaka, Miyauchi et al. 2022")}


POD_SIDE = "as of R/V Gunnerus' pods, from their maker's forces"
LOSS = 0.9
"""What is left at a hull of a thruster's force in open water."""


def tunnel_force(diameter_m: float, power_kw: float) -> SourcedValue:
    """Side force [N] of a tunnel thruster at full power, from diameter and power.

    The rule of bollard pull without a nozzle, 0.9 (D P)^(2/3) in kN, m and kW (Waertsilae, Encyclopedia of Marine
    Technology).
    """
    return SourcedValue(
        1e3 * LOSS * (diameter_m * power_kw) ** (2.0 / 3.0), 0.2, "0.9 (D P)^(2/3), rule of bollard pull"
    )


def pod_coefficients(
    pitch_ratio: float,
    area_ratio: float,
    blades: int,
    error_factor: float,
    wake: SourcedValue,
    deduction: SourcedValue,
) -> Estimates:
    """Thrust and side force coefficients of a pod with an open propeller.

    Along the pod K_T of the B-series, in the inflow (1 - w) u and with what the hull takes, (1 - t); across it the
    coefficients fitted to the forces that the maker of R/V Gunnerus' pods states.
    """
    k = open_water_coefficients(pitch_ratio, area_ratio, blades, error_factor)
    inflow, delivered = 1.0 - wake.value, 1.0 - deduction.value
    factors = {
        "thrust_nn": ("k_0", delivered),
        "thrust_nu": ("k_1", delivered * inflow),
        "thrust_uu": ("k_2", delivered * inflow**2),
    }
    along = {
        name: SourcedValue(k[key].value * factor, (k[key].error ** 2 + 0.07**2) ** 0.5, k[key].source)
        for name, (key, factor) in factors.items()
    }
    side = {"side_nv": -0.9901, "side_uv": -0.7595, "side_vv": 0.3170}
    return {**along, **{name: SourcedValue(value, 0.5, POD_SIDE) for name, value in side.items()}}


RESERVE = 1.15
"""The limit of a shaft by its speed at service speed."""
USUAL_PITCH_RATIO = 0.8
TYPICAL = 2.5
"""How much wider the errors of a propeller of unknown pitch are."""
FITTED = 1.5
"""The same where the pitch follows from the shaft speed that drives the ship."""
HIRANO = "usual, Hirano 1980"
MATSUMOTO = "Matsumoto and Suemitsu 1980"
ODD_SHARE = 0.1
"""A given shaft speed that differs by more from the estimated one is mentioned."""
USUAL_ASPECT_RATIO = 1.6
_WAKES = (0.2, 0.5)
"""The wake fractions of single-screw ships that eps was fitted to."""

Size = Annotated[float, Field(gt=0.0, lt=1e9)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Screw:
    """A screw: diameter, blades, place from midship [m]; ``rpm`` at service speed if known."""

    diameter: Size
    name: str = ""
    pitch_ratio: Size | None = None
    blades: int = 4
    area_ratio: Size = 0.55
    rpm: Size | None = None
    x: float | None = None
    y: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Propeller(_Screw):
    """A propeller on a shaft."""

    controllable: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Azimuth(_Screw):
    """A pod or a steerable thruster, like a propeller; ``rate`` is its rate of turn [deg/s]."""

    rate: Size | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rudder:
    """A rudder: area [m2], height [m], place from midship [m]; ``behind`` names the propeller before it."""

    name: str = ""
    area: Size | None = None
    span: Size | None = None
    behind: str | None = None
    x: float | None = None
    y: float | None = None
    limit: Size | None = None
    rate: Size | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Tunnel:
    """A tunnel thruster: full side force [N], or diameter [m] and power [kW]; full rpm; place from midship [m]."""

    name: str = ""
    force: Size | None = None
    diameter: Size | None = None
    power: Size | None = None
    rpm: Size = 300.0
    x: float | None = None


Device = TypeVar("Device", Propeller, Azimuth, Rudder, Tunnel)


def parse_device(kind: type[Device], source: str | Device) -> Device:
    """A device as an object, from an object or a text. Raises :class:`InputError` for what it cannot be."""
    if isinstance(source, kind):
        return source
    text, pairs = str(source), dict[str, str]()
    names = {field.name for field in fields(kind)}
    for part in filter(None, (part.strip() for part in text.split(","))):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            key, value = "name", key
        if key not in names or key in pairs:
            raise _device_error(kind, text, f"{key!r} is {'said twice' if key in pairs else 'not known'}")
        pairs[key] = value
    try:
        return TypeAdapter(kind).validate_python(pairs)
    except ValidationError as error:
        first = error.errors()[0]
        wrong, stated, (expected, _, problem) = first["loc"][0], first["input"], first["type"].partition("_")
        if expected == "missing":
            why = f"its {wrong} is missing"
        elif problem == "parsing":
            why = f"{wrong} is {stated!r}, which is no {expected}"
        else:
            why = f"{wrong} is {float(stated):g}"
        raise _device_error(kind, text, why) from error


def _device_error(kind: type[Any], text: str, why: str) -> errors.InputError:
    keys = ", ".join(field.name for field in fields(kind) if field.name != "name")
    return errors.InputError(
        f"no {kind.__name__.lower()} {text!r}", why=why, fix=f"write NAME,KEY=NUMBER,... with keys of {keys}"
    )


@dataclass(frozen=True, slots=True)
class Propulsor:
    """A propulsor of the file: its table, the screw as given, its place, and its shaft at service speed."""

    table: Table
    screw: Propeller | Azimuth
    x_m: float
    y_m: float
    wake: float
    rpm: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about it, a sentence each."""
        rpm = self.screw.rpm
        if rpm is None or abs(rpm / self.rpm - 1.0) < ODD_SHARE:
            return ()
        return (
            f"{self.screw.name} is said to turn {rpm:g} rpm at service speed, the estimates need {self.rpm:.4g}",
        )


def named_devices(kind: type[Device], sources: Sequence[str | Device]) -> list[Device]:
    """The devices of a kind; those without a name get that of their kind, with the side of a pair, or a number."""
    word, devices = kind.__name__.lower(), [parse_device(kind, source) for source in sources]
    usual = [f"{word}_{number + 1}" for number in range(len(devices))]
    if kind is Tunnel:
        usual[:2] = ["bow", "stern"]
    elif len(devices) <= 2:
        usual = [word] if len(devices) == 1 else [f"port_{word}", f"starboard_{word}"]
    return [replace(entry, name=entry.name or name) for entry, name in zip(devices, usual, strict=False)]


def make_propulsors(
    ship: MainParticulars, propellers: Sequence[Propeller], azimuths: Sequence[Azimuth]
) -> list[Propulsor]:
    """The propulsors; each has its share of the resistance, by the area of its disc. Pods are at the stern, of four
    or more the first half at the bow. The pitch ratio is the given one, or fits the given shaft speed, or is usual.
    """
    screws: list[Propeller | Azimuth] = [*propellers, *azimuths]
    shafts = _positions_abeam(ship, len(propellers), -0.48 * ship.length_m)
    forward = len(azimuths) // 2 if len(azimuths) >= 4 else 0  # at the bow
    pods_x_m = 0.42 * ship.length_m
    pods = [*_positions_abeam(ship, forward, pods_x_m), *_positions_abeam(ship, len(azimuths) - forward, -pods_x_m)]
    places = [*shafts, *pods]
    share = hull.resistance_n(ship) / sum(screw.diameter**2 for screw in screws)
    result = []
    for screw, place in zip(screws, places, strict=True):
        x_m, y_m = screw.x if screw.x is not None else place[0], screw.y if screw.y is not None else place[1]
        wake = hull.wake_fraction(ship, screw.diameter)
        deduction = hull.thrust_deduction(ship, screw.diameter)
        inflow = (1.0 - wake.value) * ship.service_speed_mps
        thrust_n = share * screw.diameter**2 / (1.0 - deduction.value)
        pitch_ratio, error_factor = USUAL_PITCH_RATIO, TYPICAL
        if screw.pitch_ratio is not None:
            pitch_ratio, error_factor = screw.pitch_ratio, 1.0
        elif screw.rpm is not None:
            n, D = screw.rpm / 60.0, screw.diameter
            K_T = thrust_n / (ship.water_density_kgpm3 * n**2 * D**4)
            pitch_ratio = pitch_ratio_of_thrust(K_T, inflow / (n * D), screw.area_ratio, screw.blades)
            error_factor = FITTED
        k = fit_thrust_quadratic(pitch_ratio, screw.area_ratio, screw.blades)
        rps = service_rps(thrust_n, inflow, screw.diameter, k, ship.water_density_kgpm3)
        rpm = 60.0 * rps
        shaft_kind = "azimuth" if isinstance(screw, Azimuth) else "propeller"
        kind = "controllable_propeller" if isinstance(screw, Propeller) and screw.controllable else shaft_kind
        rows: dict[str, Cell] = {
            "name": screw.name,
            "kind": kind,
            "x_m": x_m,
            "y_m": y_m,
            **_propeller_rows(ship, screw, pitch_ratio, error_factor, wake, deduction),
            "limit_rpm": SourcedValue(RESERVE * rpm, source=f"{rpm:.4g} rpm at service speed, and a reserve"),
            "shaft_lag_s": _lag_time_constant(ship, 1.0),
        }
        table = Table("[[actuator]]", screw.name, rows)
        result.append(Propulsor(table, screw, x_m, y_m, wake.value, rpm))
    return result


def _propeller_rows(
    ship: MainParticulars,
    screw: Propeller | Azimuth,
    pitch: float,
    error_factor: float,
    wake: SourcedValue,
    deduction: SourcedValue,
) -> dict[str, Cell]:
    """The rows of a propeller, or of a pod, that say what it thrusts; ``pitch`` by diameter."""
    if isinstance(screw, Azimuth):
        return {
            "propeller_diameter_m": screw.diameter,
            **pod_coefficients(pitch, screw.area_ratio, screw.blades, error_factor, wake, deduction),
            "azimuth_rate_limit_dps": screw.rate or SourcedValue(12.0, source="two turns a minute, usual"),
            "azimuth_lag_s": _lag_time_constant(ship, 1.0),
        }
    k = open_water_coefficients(pitch, screw.area_ratio, screw.blades, error_factor)
    return {
        "diameter_m": screw.diameter,
        "pitch_m": pitch * screw.diameter,
        **k,
        "thrust_deduction": deduction,
        "wake_0": wake,
        "wake_decay": SourcedValue(4.0, 0.3, HIRANO),
        "wake_x_m": SourcedValue(-0.5 * ship.length_m, 0.3, HIRANO),
        **astern_coefficients(k["k_0"].value),
        **({"pitch_lag_s": _lag_time_constant(ship, 3.0)} if screw.controllable else {}),
    }


def _lag_time_constant(ship: MainParticulars, seconds: float) -> SourcedValue:
    """A drive's time constant [s], that of a ship of 30 m, by Froude's law."""
    return SourcedValue(seconds * sqrt(ship.length_m / USUAL_LENGTH_M), source=f"assumed, {seconds:g} s at 30 m")


def _positions_abeam(ship: MainParticulars, count: int, x_m: float) -> list[tuple[float, float]]:
    """Usual places beside each other, from port to starboard."""
    if count == 1:
        return [(x_m, 0.0)]
    width_m = ship.spacing_m or 0.44 * ship.beam_m  # a catamaran's are in its hulls
    return [(x_m, width_m * (number / (count - 1) - 0.5)) for number in range(count)]


def rudder_tables(ship: MainParticulars, devices: Sequence[Rudder], propellers: Sequence[Propulsor]) -> list[Table]:
    """The rudders, each behind the propeller it names or the one it is nearest to."""
    shafts = [unit for unit in propellers if isinstance(unit.screw, Propeller)]
    tables, L = [], ship.length_m
    rate_dps = SourcedValue(  # of SOLAS II-1/29 at 100 m, by Froude's law below
        65.0 / 28.0 * max(1.0, sqrt(100.0 / L)), source="65 degrees in 28 s at 100 m, SOLAS"
    )
    for number, rudder in enumerate(devices):
        propeller = _propeller_before(rudder, shafts, number, len(devices))
        usual_y_m = propeller.y_m if propeller else _positions_abeam(ship, len(devices), 0.0)[number][1]
        area_m2 = (
            SourcedValue(rudder.area) if rudder.area else usual_rudder_area(ship).scaled_by(1.0 / len(devices))
        )
        span = rudder.span or min(sqrt(USUAL_ASPECT_RATIO * area_m2.value), 0.9 * ship.draught_m)
        numbers = rudder_interaction_coefficients(ship, propeller.wake if propeller else 0.0)
        in_race = {name: numbers[name] for name in ("eps", "kappa")}
        rows: dict[str, Cell] = {
            "name": rudder.name,
            "kind": "rudder",
            "x_m": rudder.x if rudder.x is not None else -0.5 * L,
            "y_m": rudder.y if rudder.y is not None else usual_y_m,
            **({"behind": propeller.screw.name} if propeller else {}),
            "area_m2": area_m2,
            "span_m": rudder.span or SourcedValue(span, source="aspect ratio 1.6, within the draught"),
            "t_R": numbers["t_R"],
            "a_H": numbers["a_H"],
            "x_H_m": numbers["x_H"].scaled_by(L),
            "flow_straightening_minus": numbers["flow_straightening"],
            "flow_straightening_plus": numbers["flow_straightening"],
            "l_R_m": numbers["l_R"].scaled_by(L),
            "lift_slope": SourcedValue(normal_force_slope(span**2 / area_m2.value), 0.1, "Fujii and Tsuda 1961"),
            **(in_race if propeller else {"inflow_factor": SourcedValue(0.8, source="assumed")}),
            "limit_deg": rudder.limit or SourcedValue(35.0, source="usual"),
            "rate_limit_dps": rudder.rate or rate_dps,
            "lag_s": _lag_time_constant(ship, 0.5),
        }
        tables.append(Table("[[actuator]]", rudder.name, rows))
    return tables


def _propeller_before(rudder: Rudder, shafts: Sequence[Propulsor], number: int, count: int) -> Propulsor | None:
    """The propeller in whose race a rudder is; None for one that is in no race."""
    if rudder.behind is None:
        if len(shafts) == count:
            return shafts[number]
        return shafts[len(shafts) // 2] if count == 1 and len(shafts) % 2 == 1 else None
    if not rudder.behind:
        return None
    names = [unit.screw.name for unit in shafts]
    if rudder.behind not in names:
        raise errors.InputError(
            f"rudder {rudder.name!r} is behind {rudder.behind!r}",
            why=f"the propellers are called {', '.join(names) or 'nothing: there are none'}",
            fix="name one of these",
        )
    return shafts[names.index(rudder.behind)]


def tunnel_table(ship: MainParticulars, thruster: Tunnel) -> Table:
    """A tunnel thruster, at its usual place by its name; its force goes with the square of its shaft."""
    x = (-0.42 if "stern" in thruster.name or "aft" in thruster.name else 0.42) * ship.length_m
    if thruster.force is not None:
        force = SourcedValue(thruster.force, 0.1, "full force given, with the shaft squared")
    elif thruster.diameter is None or thruster.power is None:
        raise errors.InputError(
            f"of tunnel thruster {thruster.name!r} the force is not known",
            why="it follows from the force at full rpm, or from diameter and power",
            fix=f"write {thruster.name},force=N or {thruster.name},diameter=M,power=KW",
        )
    else:
        force = tunnel_force(thruster.diameter, thruster.power)
    return Table("[[actuator]]", thruster.name, {
        "name": thruster.name,
        "kind": "tunnel",
        "x_m": thruster.x if thruster.x is not None else x,
        "cubic_n": 0.0,
        "quadratic_n": force.scaled_by(thruster.rpm**-2),
        "linear_n": 0.0,
        "limit_rpm": thruster.rpm,
        "shaft_lag_s": _lag_time_constant(ship, 1.0),
    })  # fmt: skip


def usual_rudder_area(ship: MainParticulars) -> SourcedValue:
    """Area of all rudders together [m2] that a classification society asks for (Det Norske Veritas, Rules)."""
    area = 0.01 * ship.length_m * ship.draught_m * (1.0 + 25.0 * (ship.beam_m / ship.length_m) ** 2)
    return SourcedValue(area, 0.2, "least area of Det Norske Veritas' rules")


def rudder_interaction_coefficients(ship: MainParticulars, wake: float) -> Estimates:
    """``t_R a_H x_H flow_straightening l_R eps kappa`` of a rudder; ``x_H``, ``l_R`` by length.

    ``wake`` is the wake fraction of the propeller before it. Behind the screws of a twin-screw ship, and without a
    propeller, the wake at the rudder is that at the propeller: eps = 1. The usual errors are those against the
    published models of KVLCC2 and Esso Osaka, rounded up.
    """
    fullness, behind_stern = ship.fullness, ship.screws == 1
    w = min(max(wake, _WAKES[0]), _WAKES[1])
    eps = (
        hull.value_with_scatter(2.26 - 1.82 * (1.0 - w), 0.15, hull.YOSHIMURA)
        if behind_stern
        else SourcedValue(1.0, 0.15, "the wake at the propeller")
    )
    return {
        "t_R": hull.value_with_scatter(0.45 - 0.28 * ship.block, 0.08, MATSUMOTO),
        "a_H": hull.value_with_scatter(max(0.627 * ship.block - 0.153, 0.05), 0.08, hull.KIJIMA),
        "x_H": hull.value_with_scatter(-0.45, 0.05, "usual, Yasukawa and Yoshimura 2015"),
        "flow_straightening": hull.value_with_scatter(2.06 * fullness + 0.14, 0.12, hull.YOSHIMURA),
        "l_R": hull.value_with_scatter(-0.9, 0.2, hull.YOSHIMURA),
        "eps": eps,
        "kappa": hull.value_with_scatter(0.55 - 0.8 * fullness, 0.2, hull.KIJIMA),
    }
