"""Messages in JSON of two programs whose objects hold several quantities under one key: canboat and Signal K.

Without it two compasses would be one column, and a magnetic heading a true one. An object becomes messages of
topics, one for each sender and reference, with their units where the programs' documentation states them: canboat's
``analyzer -json`` has speeds in m/s and angles in degrees or, with ``-si``, radians; Signal K has SI units.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple


class TopicMessage(NamedTuple):
    """A message of a topic, and the time that it states, in whatever form."""

    topic: str
    content: dict[str, Any]
    moment: Any


Senders = dict[Any, Any]
"""The first sender of each group or path, which needs no name in its topic."""
_REFERENCED = {127250: "Heading", 129026: "COG"}
_WIND = 130306
_WINDS = {"Apparent": ("Apparent", "Angle"), "True (ground referenced to North)": ("True", "Direction")}
_NAMES = {
    127245: {"Position": "Rudder", "Angle Order": "Rudder order"},
    127251: {"Rate": "Rate of Turn"},
    127488: {"Speed": "Engine Speed [rpm]"},
    128259: {"Speed Water Referenced": "Speed through water [m/s]"},
    129026: {"SOG": "SOG [m/s]"},
}
"""Names that say what they are without their group."""


def canboat_message(entry: Mapping[str, Any], senders: Senders) -> TopicMessage | None:
    """A message that canboat's analyzer has decoded; None for other objects.

    Directions without a reference are left out.

    >>> fields = {"Heading": 90.0, "Deviation": 1.5, "Reference": {"value": 1, "name": "Magnetic"}}
    >>> canboat_message({"timestamp": "2026-05-17-12:00:00", "src": 4, "pgn": 127250, "fields": fields}, {})[:2]
    ('127250 magnetic', {'Heading': 91.5, 'Deviation': 1.5})
    """
    group, fields = entry.get("pgn"), entry.get("fields")
    if not isinstance(group, int) or not isinstance(fields, dict) or "src" not in entry:
        return None
    stated = next((value for name, value in fields.items() if name.endswith("Reference")), "")
    reference = str(stated.get("name", "") if isinstance(stated, dict) else stated)
    content = {name: value for name, value in fields.items() if not name.endswith("Reference")}
    angle, deviation = _REFERENCED.get(group, ""), content.get("Deviation")
    if angle and reference not in ("True", "Magnetic"):
        content.pop(angle, None)
    if reference == "Magnetic" and angle in content and isinstance(deviation, int | float):
        content[angle] += deviation
    names = _NAMES.get(group, {})
    if group == _WIND:  # the other references are to the bow, too, or magnetic
        kind, what = _WINDS.get(reference, ("True", "Angle"))
        names = {"Wind Angle": f"{kind} Wind {what}", "Wind Speed": f"{kind} Wind Speed [m/s]"}
    content = {names.get(name, name): value for name, value in content.items()}
    topic = f"{group} magnetic" if reference.startswith("Magnetic") else str(group)
    instance = content.get("Instance")
    instance = instance.get("value") if isinstance(instance, dict) else instance
    sender = entry["src"] if instance is None else f"{entry['src']}.{instance}"
    return TopicMessage(_sender_prefix(group, sender, senders) + topic, content, entry.get("timestamp"))


def _sender_prefix(what: Any, sender: Any, senders: Senders) -> str:
    return "" if senders.setdefault(what, sender) == sender else f"{sender}/"


_SIGNAL_K_UNITS = {
    "rateOfTurn": "rad/s", "speed": "m/s", "heading": "rad", "course": "rad", "angle": "rad", "direction": "rad",
    "rudderAngle": "rad", "magneticVariation": "rad", "roll": "rad", "pitch": "rad", "yaw": "rad",
}  # fmt: skip
"""By how the last part of a path begins (Signal K 1.7, keys reference)."""


def messages_of_program(entry: Mapping[str, Any], senders: Senders) -> Iterable[TopicMessage] | None:
    """The messages of an object of canboat or Signal K, those of a delta each of its path; None for other objects.

    >>> update = {"$source": "n2k.4", "timestamp": "2026-05-17T12:00:00Z",
    ...           "values": [{"path": "navigation.headingTrue", "value": 1.5}]}
    >>> [message.topic for message in messages_of_program({"updates": [update]}, {})]
    ['navigation/headingTrue [rad]']
    """
    if isinstance(entry.get("updates"), list):
        return _values_of_updates(entry["updates"], senders)
    message = canboat_message(entry, senders)
    return None if message is None else [message]


def _values_of_updates(updates: list[Any], senders: Senders) -> Iterator[TopicMessage]:
    for update in (update for update in updates if isinstance(update, dict)):
        source = update.get("$source") or str(update.get("source", ""))
        for item in update.get("values") or ():
            path, value = str(item.get("path", "")), item.get("value")
            prefix = _sender_prefix(path, source, senders)
            if path.startswith("propulsion") and path.endswith("revolutions"):
                path = path.removesuffix("revolutions") + "engine speed [rps]"  # not the shaft's
            *parents, last = path.replace("wind.", "wind ").split(".")
            content = value if isinstance(value, dict) else {"value": value}
            content = {_with_unit(name): number for name, number in content.items()}
            yield TopicMessage(prefix + "/".join((*parents, _with_unit(last))), content, update.get("timestamp"))


def _with_unit(name: str) -> str:
    unit = next((unit for word, unit in _SIGNAL_K_UNITS.items() if name.removeprefix("wind ").startswith(word)), "")
    return f"{name} [{unit}]" if unit else name
