"""What was found, as tables for a terminal, and in words where nothing was."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table

from acquisition.core.channels import channel_unit
from acquisition.discovery.discover import Discovery
from acquisition.discovery.places import KNOWN_FORMS
from acquisition.logger.missing import by_reason

_MOST_EVENTS = 12
_MOST_VALUES = 4  # of a message, in its row


def tables(found: Discovery) -> Iterator[RenderableType]:
    """Places, devices, messages, channels and what is missing, each as a table that has a row at least."""
    told = found.as_json()
    yield _table(
        ("listened at", "source", "frames", ""),
        [(each["place"], each["source"], f"{each['frames']:,}", _said(each)) for each in told["places"]],
    )
    if told["devices"]:
        shown = ("manufacturer", "model", "function", "iso_name")
        rows = [
            (each["source"], str(each["address"]), *(str(each.get(key, "")) for key in shown))
            for each in told["devices"]
        ]
        yield _table(("device on", "address", *shown[:-1], "NAME"), rows)
    if told["messages"]:
        yield _table(
            ("message of", "device", "message", "rate Hz", "latest", "refused"),
            [
                (each["source"], each["device"], f"{each['message']} {each['name']}".strip(),
                 f"{each['rate_hz']:.2f}" if each["rate_hz"] else f"{each['count']} x",
                 _values(each["values"]), _counts(each["refused"]))
                for each in told["messages"]
            ],
        )  # fmt: skip
    if found.readings:
        yield _table(
            ("values of", "message or topic", "signal or field", "value", "channel"),
            [
                (each.source, each.entry.get("message") or each.entry["topic"],
                 each.entry.get("signal") or each.entry.get("field", ""), each.text, each.channel)
                for each in found.readings
            ],
        )  # fmt: skip
    if told["channels"]:
        yield _table(("channel", "value", "unit", "rate Hz", "sources"), list(_channel_rows(told["channels"])))
    if told["events"]:
        yield _table(("event",), [(each,) for each in told["events"][:_MOST_EVENTS]])
    if told["missing"]:
        yield _table(("missing", "why"), list(by_reason(found.missing).items()))


def _channel_rows(channels: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for name, each in channels.items():
        value, rate_hz = f"{each['value']:.6g}", f"{each['rate_hz']:.2f}"
        yield name, value, channel_unit(name), rate_hz, ", ".join(each["sources"])


def nothing_found(found: Discovery) -> str:
    """Where was listened in vain, and what to do."""
    places: dict[str, list[str]] = {}
    for each in found.heard:
        places.setdefault(each.problem, []).append(each.place.text or each.place.name)
    where = "; ".join(f"{', '.join(names)}: {problem}" for problem, names in places.items())
    if not any(each.place.expected for each in found.heard):
        kinds = {"can": "CAN interface", "serial": "serial line"}.items()
        there = {each.place.type for each in found.heard}
        where += "".join(f"; this computer shows no {words}" for kind, words in kinds if kind not in there)
    live = any(each.place.type != "file" for each in found.heard)
    advice = (
        "switch the instruments on, check cables and firewall, listen longer with --duration, or " if live else ""
    )
    return f"nothing was found ({where or 'there is nowhere to listen'}); {advice}name {KNOWN_FORMS}"


def _said(place: dict[str, Any]) -> str:
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
