"""The terminal's picture of a recording in progress: the 13 channels, the sources, the last events."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from acquisition.channels import BY_NAME, NAMES
from acquisition.health import ChannelHealth, Health

_FRESH_S, _STALE_S = 1.5, 5.0
_UNIT_FROM_COLUMNS = 78  # the names end with the unit anyhow
_STATE_STYLES = {"open": "green", "silent": "yellow", "failed": "bold red", "ended": "dim"}


@dataclass(frozen=True, slots=True)
class Picture:
    """Everything worth seeing, drawn anew each time; ``expected`` are the channels that some source provides.

    What does not fit goes in this order: words from the right, the unit column, events from the oldest.
    """

    health: Health
    path: Path
    expected: frozenset[str]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        now_ns = time.monotonic_ns()
        yield _header(self.health, self.path, now_ns)
        yield _channel_table(self.health, self.expected, now_ns, options.max_width)
        yield _source_table(self.health, now_ns)
        taken = 1 + 1 + len(NAMES) + 1 + len(self.health.sources)
        rows = (options.height or console.height) - taken - 1  # the cursor wants a line of its own
        yield from _events(self.health, rows)


def _one_line(*parts: str | tuple[str, str]) -> Text:
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis")


def _header(health: Health, path: Path, now_ns: int) -> Text:
    return _one_line(
        ("● REC ", "bold red"),
        (_clock(now_ns - health.started_ns), "bold"),
        f"  {health.samples:,} samples  ",
        f"{path.name}  ",
        ("Ctrl-C ends it", "dim"),
    )


def _clock(elapsed_ns: int) -> str:
    seconds = elapsed_ns // 1_000_000_000
    return f"{seconds // 3600:d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def _channel_table(health: Health, expected: frozenset[str], now_ns: int, width: int) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    with_unit = width >= _UNIT_FROM_COLUMNS
    table.add_column("channel", no_wrap=True)
    table.add_column("value", justify="right", min_width=9, no_wrap=True)
    if with_unit:
        table.add_column("unit", no_wrap=True)
    for title in ("rate Hz", "age s"):
        table.add_column(title, justify="right", min_width=7, no_wrap=True)
    table.add_column("source")
    for name in NAMES:
        value, *rest = _channel_row(health.channels[name], name in expected, now_ns)
        table.add_row(name, value, *([BY_NAME[name].unit] if with_unit else []), *rest)
    return table


def _channel_row(channel: ChannelHealth, is_expected: bool, now_ns: int) -> tuple[str | Text, ...]:
    """Value, rate, age and source."""
    if channel.count == 0:
        text, style = ("waiting", "yellow") if is_expected else ("no source configured", "dim")
        return "–", "–", "–", _one_line((text, style))
    age_s = channel.age_s(now_ns)
    age = Text(f"{age_s:.1f}", _age_style(age_s))
    return f"{channel.value:.3f}", f"{channel.rate_hz(now_ns):.1f}", age, _one_line(channel.source)


def _age_style(age_s: float) -> str:
    return "green" if age_s < _FRESH_S else "yellow" if age_s < _STALE_S else "bold red"


def _source_table(health: Health, now_ns: int) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("line", min_width=len("starboard_angle_deg"), no_wrap=True, overflow="ellipsis")
    table.add_column("state", min_width=9, no_wrap=True)
    for title in ("frames", "refused", "dropped"):
        table.add_column(title, justify="right", min_width=8, no_wrap=True)
    for source in health.sources.values():
        state = source.as_message(now_ns)["state"]
        dropped = Text(f"{source.dropped:,}", "bold red" if source.dropped else "")
        counts = f"{source.frames:,}", f"{source.rejected:,}"
        table.add_row(source.name, Text(state, _STATE_STYLES[state]), *counts, dropped)
    return table


def _events(health: Health, rows: int) -> Iterator[Text]:
    for time_ns, text in tuple(health.events)[-rows:] if rows > 0 else ():
        yield _one_line((f"{datetime.fromtimestamp(time_ns // 10**9, UTC):%H:%M:%SZ} {text}", "dim"))


def summary(health: Health, path: Path) -> str:
    """One line for the end of a recording, or for a log without a terminal."""
    seen = sum(channel.count > 0 for name, channel in health.channels.items() if name in NAMES)
    dropped = sum(source.dropped for source in health.sources.values())
    frames = sum(source.frames for source in health.sources.values())
    return (
        f"{path.name}: {_clock(time.monotonic_ns() - health.started_ns)}, {frames:,} frames, "
        f"{health.samples:,} samples, {seen} of 13 channels, {dropped:,} dropped"
    )


def missing(channels: dict[str, ChannelHealth], expected: frozenset[str]) -> list[str]:
    """Channels that a source was to provide and of which nothing came."""
    return [name for name in NAMES if name in expected and channels[name].count == 0]
