"""Which columns are of which actuator: kinds and sides by the words of their names, or the ship's own list."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from seatrial.acquisition.core.actuators import DEFAULT, KINDS, Actuator, Actuators, name_of_order
from seatrial.acquisition.tables.column_names import (
    BOW,
    ORDER,
    PORT,
    QUANTITIES,
    STARBOARD,
    STERN,
    TUNNEL,
    headed,
    units_called,
    words_of,
)
from seatrial.acquisition.tables.draft import ColumnCandidate, Draft, measures

_KIND_OF = {"rudder": "rudder", "azimuth": "azimuth", "shaft": "propeller", "propeller_pitch": "propeller"}
_ENDING = {"rudder": "_angle_deg", "azimuth": "_angle_deg", "shaft": "_rpm", "propeller_pitch": "_pitch_percent"}
_LIKE = {
    "propeller": ("propeller", "controllable_propeller", "waterjet", "azimuth"),
    "azimuth": ("azimuth", "waterjet"),
    "rudder": ("rudder",),
    "tunnel": ("tunnel",),
}
"""The kinds of a known ship's actuators that a column of a kind may be of, the likeliest first."""
_QUANTITY_OF = {"rpm": "shaft", "deg": "azimuth", "%": "propeller_pitch"}
_NUMBERED = re.compile(r"[a-z]{1,2}\d")
_SIDES = {"port": PORT, "starboard": STARBOARD, "bow": BOW, "stern": STERN}
_AZIMUTH_WORDS = frozenset({"az", "azi", "azimuth", "azimut", "asimut", "pod"})


@dataclass(frozen=True, slots=True)
class Found:
    """A column that tells of an actuator: its control channel, or the channel of the orders to it."""

    candidate: ColumnCandidate
    channel: str
    kind: str
    why: str


@dataclass(frozen=True, slots=True)
class _Part:
    candidate: ColumnCandidate
    kind: str
    side: str
    is_order: bool


def find_actuators(draft: Draft, ship: Actuators = ()) -> tuple[Actuators, list[Found]]:
    """The actuators that columns tell of, or a known ``ship``'s, and the columns with the channels they become."""
    exact = _by_name(draft, ship or _named(draft))
    used_columns = {column.candidate.column for column in exact}
    parts = [_part(candidate) for candidate in draft.of(*_KIND_OF) if candidate.column not in used_columns]
    azimuths = {control.side for control in parts if control.kind == "azimuth"}
    parts = [  # a shaft at the side of an azimuth thruster is the thruster's
        replace(control, kind="azimuth") if control.kind == "propeller" and control.side in azimuths else control
        for control in parts
    ]
    columns = {column.channel: column for column in exact}
    kinds = {device.name: device.kind for device in _named(draft)}
    pitched = {control.side for control in parts if control.candidate.quantity.name == "propeller_pitch"}
    for part in sorted(parts, key=lambda control: control.is_order):
        matched = _actuators_of_part(part, ship) if ship else [_new_actuator(part, parts, pitched)]
        if len(matched) > 1:
            names = " and ".join(device.name for device in matched)
            draft.warnings.append(f"{part.candidate.column!r} names no side: it is taken for {names} alike")
        for actuator in matched:
            stem = actuator.name + _ENDING[part.candidate.quantity.name]
            if stem not in {channel.name for channel in actuator.channels}:
                continue
            channel = name_of_order(stem) if part.is_order and stem in columns else stem
            if channel in columns:
                rival = columns[channel].candidate.column
                draft.note(part.candidate.column, "-", "", f"not used: {rival!r} is taken for it")
                continue
            why = f"{actuator.name}: {actuator.kind.replace('_', ' ')}"
            columns[channel] = Found(
                part.candidate, channel, actuator.kind, why + (", its order" if part.is_order else "")
            )
            kinds[actuator.name] = actuator.kind
    actuators = tuple(Actuator(name, kind) for name, kind in kinds.items())
    if set(actuators) <= set(DEFAULT) and actuators:
        actuators = DEFAULT
    return ship or actuators, list(columns.values())


def _named(draft: Draft) -> Actuators:
    """The usual ship's actuators where columns have the names of their angles, as shafts alone may be another's;
    else thrusters whose shaft and angle have one short name of their own."""
    names = list(map(str, draft.raw.columns.columns))
    angles = {channel.name for actuator in DEFAULT for channel in actuator.channels if channel.unit == "deg"}
    if angles & set(names):
        return DEFAULT
    heads = {name.lower().replace(" ", "_"): units for name, units, _ in map(headed, names)}
    return tuple(  # t1 rpm beside t1 angle [deg]: a number of a maker's own
        Actuator(name, "azimuth")
        for name, units in heads.items()
        if _NUMBERED.fullmatch(name) and "rpm" in units and f"{name}_angle" in heads
    )


def _by_name(draft: Draft, ship: Actuators) -> list[Found]:
    """The columns that are called as a ship's own channels, with a blank for a line or their unit in brackets."""
    channels = {channel.name: (actuator, channel.unit) for actuator in ship for channel in actuator.channels}
    orders = {name_of_order(name): owner for name, owner in channels.items()}
    columns: dict[str, Found] = {}
    for column in map(str, draft.raw.columns.columns):
        head = headed(column)
        stems = {re.sub(r"\W+", "_", name.strip().lower()) for name in (column, head.name)}
        for channel, (actuator, unit) in (channels | orders).items():
            is_called = channel in stems or (channel.rpartition("_")[0] in stems and bool(head.units))
            if is_called and channel not in columns and (not head.units or _fits(unit, head.units)):
                quantity = next(entry for entry in QUANTITIES if entry.name == _QUANTITY_OF[unit])
                units = head.units or units_called(draft.raw.units.get(column, ""))
                candidate = ColumnCandidate(column, quantity, 1.0, units, frozenset(words_of(column)))
                columns[channel] = Found(candidate, channel, actuator.kind, f"{actuator.name}: by its name")
    return list(columns.values())


def _fits(unit: str, stated: tuple[str, ...]) -> bool:
    quantity = next(entry for entry in QUANTITIES if entry.name == _QUANTITY_OF[unit])
    return any(measures(quantity, spelling) for spelling in stated)


def _part(candidate: ColumnCandidate) -> _Part:
    words = candidate.words
    kind = _KIND_OF[candidate.quantity.name]
    if candidate.quantity.name == "shaft" and words & (TUNNEL | (BOW | STERN) - {"forward", "aft", "fwd"}):
        kind = "tunnel"
    if candidate.quantity.name == "shaft" and words & _AZIMUTH_WORDS:
        kind = "azimuth"
    side = next((name for name, markers in _SIDES.items() if words & markers), "")
    number = next((word for word in sorted(words) if word.isdigit() and len(word) == 1), "")
    return _Part(candidate, kind, side or number, bool(words & ORDER))


def _actuators_of_part(part: _Part, ship: Actuators) -> list[Actuator]:
    """The ship's actuators that a column tells of; without a side all of a kind, as of one order to a pair."""
    words = _SIDES.get(part.side, {part.side})
    for kind in _LIKE[part.kind]:
        of_kind = [actuator for actuator in ship if actuator.kind == kind]
        at_side = [actuator for actuator in of_kind if not words.isdisjoint(actuator.name.split("_"))]
        if of_kind and (at_side or not part.side or len(of_kind) == 1):
            return at_side or of_kind
    return []


def _new_actuator(part: _Part, parts: Iterable[_Part], pitched: set[str]) -> Actuator:
    """An actuator of a ship that nothing else is known of."""
    if part.kind == "azimuth":
        return Actuator(
            _name(part.side, "azimuth") if part.side.isdigit() or not part.side else part.side, "azimuth"
        )
    if part.kind == "tunnel":
        sides = {control.side for control in parts if control.kind == "tunnel"}
        return Actuator(
            "tunnel" if len(sides) == 1 and part.side != "stern" else _name(part.side, "tunnel"), "tunnel"
        )
    kind = "controllable_propeller" if part.kind == "propeller" and part.side in pitched else part.kind
    assert kind in KINDS
    return Actuator(_name(part.side, part.kind), kind)


def _name(side: str, kind: str) -> str:
    return f"{kind}_{side}" if side.isdigit() else f"{side}_{kind}" if side else kind
