"""What was found, as tables for a terminal, and in words where nothing was."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table

from seatrial.acquisition.core.channels import channel_unit
from seatrial.acquisition.discovery.discover import Discovery
from seatrial.acquisition.discovery.places import KNOWN_FORMS
from seatrial.acquisition.logger.missing import by_reason

_MOST_EVENTS = 12
_MOST_VALUES = 4  # of a message, in its row


def tables(discovery: Discovery) -> Iterator[RenderableType]:
    """Places, devices, messages, channels and what is missing, each as a table that has a row at least."""
    content = discovery.as_json()
    yield _table(
        ("listened at", "source", "frames", ""),
        [(place["place"], place["source"], f"{place['frames']:,}", _remarks(place)) for place in content["places"]],
    )
    if content["devices"]:
        shown = ("manufacturer", "model", "function", "iso_name")
        rows = [
            (device["source"], str(device["address"]), *(str(device.get(key, "")) for key in shown))
            for device in content["devices"]
        ]
        yield _table(("device on", "address", *shown[:-1], "NAME"), rows)
    if content["messages"]:
        yield _table(
            ("message of", "device", "message", "rate Hz", "latest", "refused"),
            [
                (message["source"], message["device"], f"{message['message']} {message['name']}".strip(),
                 f"{message['rate_hz']:.2f}" if message["rate_hz"] else f"{message['count']} x",
                 _values(message["values"]), _counts(message["refused"]))
                for message in content["messages"]
            ],
        )  # fmt: skip
    if discovery.readings:
        yield _table(
            ("values of", "message or topic", "signal or field", "value", "channel"),
            [
                (reading.source, reading.entry.get("message") or reading.entry["topic"],
                 reading.entry.get("signal") or reading.entry.get("field", ""), reading.text, reading.channel)
                for reading in discovery.readings
            ],
        )  # fmt: skip
    if content["channels"]:
        yield _table(("channel", "value", "unit", "rate Hz", "sources"), list(_channel_rows(content["channels"])))
    if content["events"]:
        yield _table(("event",), [(event,) for event in content["events"][:_MOST_EVENTS]])
    if content["missing"]:
        yield _table(("missing", "why"), list(by_reason(discovery.missing).items()))


def _channel_rows(channels: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for name, channel in channels.items():
        value, rate_hz = f"{channel['value']:.6g}", f"{channel['rate_hz']:.2f}"
        yield name, value, channel_unit(name), rate_hz, ", ".join(channel["sources"])


def nothing_found(discovery: Discovery) -> str:
    """Where was listened in vain, and what to do."""
    places: dict[str, list[str]] = {}
    for capture in discovery.heard:
        places.setdefault(capture.problem, []).append(capture.place.text or capture.place.name)
    where = "; ".join(f"{', '.join(names)}: {problem}" for problem, names in places.items())
    if not any(entry.place.expected for entry in discovery.heard):
        kinds = {"can": "CAN interface", "serial": "serial line"}.items()
        kinds_present = {entry.place.type for entry in discovery.heard}
        where += "".join(f"; this computer shows no {words}" for kind, words in kinds if kind not in kinds_present)
    live = any(entry.place.type != "file" for entry in discovery.heard)
    advice = (
        "switch the instruments on, check cables and firewall, listen longer with --duration, or " if live else ""
    )
    return f"nothing was found ({where or 'there is nowhere to listen'}); {advice}name {KNOWN_FORMS}"


def _remarks(place: dict[str, Any]) -> str:
    """What was found out of a place besides: its rate and form, or why nothing was heard there."""
    rate = f"{place['baud_rate']} baud" if "baud_rate" in place else ""
    return "; ".join(filter(None, (rate, place.get("form"), place.get("problem"), *place.get("remarks", []))))


def _values(values: dict[str, float]) -> str:
    shown = [f"{name} {value:.6g}" for name, value in list(values.items())[:_MOST_VALUES]]
    return ", ".join(shown) + (" ..." if len(values) > _MOST_VALUES else "")


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{reason} {count:,}" for reason, count in counts.items())


def _table(titles: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for title in titles:
        right = title in ("frames", "rate Hz", "value")
        table.add_column(title, justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    table.add_section()
    return table
