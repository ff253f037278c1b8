"""What an owner says of propellers, rudders and thrusters: as objects, and as texts of the form
``name,diameter=5.2,pitch_ratio=0.8``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, TypeVar

from acquisition.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class _Screw:
    """A screw: diameter, blades, place from midship [m]; ``rpm`` at service speed if known."""

    diameter: float
    name: str = ""
    pitch_ratio: float | None = None
    blades: int = 4
    area_ratio: float = 0.55
    rpm: float | None = None
    x: float | None = None
    y: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Propeller(_Screw):
    """A propeller on a shaft."""

    controllable: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Azimuth(_Screw):
    """A pod or a steerable thruster, like a propeller; ``rate`` is its rate of turn [deg/s]."""

    rate: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rudder:
    """A rudder: area [m2], height [m], place from midship [m]; ``behind`` names the propeller before it."""

    name: str = ""
    area: float | None = None
    span: float | None = None
    behind: str | None = None
    x: float | None = None
    y: float | None = None
    limit: float | None = None
    rate: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Tunnel:
    """A tunnel thruster: full side force [N], or diameter [m] and power [kW]; full rpm; place from midship [m]."""

    name: str = ""
    force: float | None = None
    diameter: float | None = None
    power: float | None = None
    rpm: float = 300.0
    x: float | None = None


Device = TypeVar("Device", Propeller, Azimuth, Rudder, Tunnel)


def device(kind: type[Device], said: str | Device) -> Device:
    """A device as an object, from an object or a text. Raises :class:`InputError` for what it cannot be."""
    if isinstance(said, kind):
        return said
    text = str(said)
    try:
        made = kind(**_pairs(kind, text))
    except TypeError as error:
        raise _cannot(kind, text, "its diameter is missing") from error
    return _checked(made, text)


def _pairs(kind: type[Any], text: str) -> dict[str, Any]:
    types = {field.name: str(field.type) for field in fields(kind)}
    pairs: dict[str, Any] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        key, equals, value = (each.strip() for each in part.partition("="))
        if not equals:
            key, value = "name", key
        if key not in types or key in pairs:
            raise _cannot(kind, text, f"{key!r} is {'said twice' if key in pairs else 'not known'}")
        try:
            pairs[key] = _value(types[key], value)
        except ValueError as error:
            raise _cannot(kind, text, f"{key} is {value!r}, which is no {types[key].split()[0]}") from error
    return pairs


def _value(kind: str, text: str) -> Any:
    if kind.startswith("bool"):
        return {"true": True, "false": False, "yes": True, "no": False}.get(text.lower()) or text.lower() == "true"
    if kind.startswith("int"):
        return int(text)
    return float(text) if kind.startswith("float") else text


def _checked(made: Device, text: str) -> Device:
    for field in fields(made):
        value = getattr(made, field.name)
        is_place = field.name in ("x", "y")
        if isinstance(value, float) and not is_place and not 0.0 < value < 1e9:
            raise _cannot(type(made), text, f"{field.name} is {value:g}")
    return made


def _cannot(kind: type[Any], text: str, why: str) -> InputError:
    keys = ", ".join(field.name for field in fields(kind) if field.name != "name")
    return InputError(
        f"no {kind.__name__.lower()} {text!r}", why=why, fix=f"write NAME,KEY=NUMBER,... with keys of {keys}"
    )
