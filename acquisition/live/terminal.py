"""The terminal's picture of a recording in progress: the 13 channels, the sources, the last events."""

from __future__ import annotations

import time
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from acquisition.channels import BY_NAME, NAMES
from acquisition.health import ChannelHealth, Health

_FRESH_S, _STALE_S = 1.5, 5.0


def picture(health: Health, path: Path, expected: frozenset[str]) -> RenderableType:
    """Everything worth seeing at this moment; ``expected`` are the channels that some source provides."""
    now_ns = time.monotonic_ns()
    header = Text.assemble(
        ("● REC ", "bold red"),
        f"{path.name}   ",
        (_clock(now_ns - health.started_ns), "bold"),
        f"   {health.samples:,} samples",
    )
    return Group(header, _channel_table(health, expected, now_ns), _source_table(health, now_ns), _events(health))


def _clock(elapsed_ns: int) -> str:
    seconds = elapsed_ns // 1_000_000_000
    return f"{seconds // 3600:d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def _channel_table(health: Health, expected: frozenset[str], now_ns: int) -> Table:
    table = Table(box=None, padding=(0, 1), header_style="dim")
    table.add_column("channel")
    table.add_column("value", justify="right", min_width=11)
    table.add_column("unit")
    for title in ("rate Hz", "age s"):
        table.add_column(title, justify="right", min_width=7)
    table.add_column("source", no_wrap=True)
    for name in NAMES:
        channel = health.channels[name]
        if channel.count == 0:
            text = "waiting" if name in expected else "no source configured"
            table.add_row(
                name, "–", BY_NAME[name].unit, "–", "–", Text(text, "yellow" if name in expected else "dim")
            )
            continue
        age_s = channel.age_s(now_ns)
        table.add_row(
            name,
            f"{channel.value:.3f}",
            BY_NAME[name].unit,
            f"{channel.rate_hz(now_ns):.1f}",
            Text(f"{age_s:.1f}", _age_style(age_s)),
            channel.source,
        )
    return table


def _age_style(age_s: float) -> str:
    return "green" if age_s < _FRESH_S else "yellow" if age_s < _STALE_S else "bold red"


def _source_table(health: Health, now_ns: int) -> Table:
    table = Table(box=None, padding=(0, 1), header_style="dim")
    table.add_column("line")
    table.add_column("state")
    for title in ("frames", "refused", "dropped"):
        table.add_column(title, justify="right", min_width=8)
    styles = {"open": "green", "silent": "yellow", "failed": "bold red", "ended": "dim"}
    for source in health.sources.values():
        state = source.as_message(now_ns)["state"]
        dropped = Text(f"{source.dropped:,}", "bold red" if source.dropped else "")
        table.add_row(source.name, Text(state, styles[state]), f"{source.frames:,}", f"{source.refused:,}", dropped)
    return table


def _events(health: Health) -> Text:
    return Text("\n".join(tuple(health.events)), "dim")


def summary(health: Health, path: Path) -> str:
    """One line for the end of a recording, or for a log without a terminal."""
    seen = sum(channel.count > 0 for name, channel in health.channels.items() if name in NAMES)
    dropped = sum(source.dropped for source in health.sources.values())
    frames = sum(source.frames for source in health.sources.values())
    return (
        f"{path}: {_clock(time.monotonic_ns() - health.started_ns)}, {frames:,} frames, "
        f"{health.samples:,} samples, {seen} of 13 channels, {dropped:,} frames dropped"
    )


def missing(channels: dict[str, ChannelHealth], expected: frozenset[str]) -> list[str]:
    """Channels that a source was to provide and of which nothing came."""
    return [name for name in NAMES if name in expected and channels[name].count == 0]
