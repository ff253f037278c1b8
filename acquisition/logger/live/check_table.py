"""The answer of ``seatrial record --check`` for a person."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from acquisition.core.channels import BY_NAME
from acquisition.logger.preflight import ChannelReport, PreflightReport


def preflight_table(found: PreflightReport) -> Group:
    """The 13 channels and what is wrong with them; then what was told while listening, and the room on the disk."""
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    for title, justify in (("", "left"), ("channel", "left"), ("rate Hz", "right"), ("value", "right"),
                           ("unit", "left"), ("source, or what is wrong", "left")):  # fmt: skip
        table.add_column(title, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for each in found.channels:
        table.add_row(*_row(each))
    lines = [Text(text, "yellow") for text in found.events]
    if found.disk_problem:
        lines.append(Text(f"✗ {found.disk_problem}", "bold red"))
    elif found.free_bytes is not None:
        lines.append(Text(f"{found.free_bytes / 1e9:.1f} GB free where the recording goes", "dim"))
    return Group(table, *lines)


def _row(channel: ChannelReport) -> tuple[str | Text, ...]:
    good = not channel.problem
    return (
        Text("✓", "green") if good else Text("✗", "bold red"),
        channel.name,
        f"{channel.rate_hz:.1f}" if channel.value is not None else "–",
        f"{channel.value:.3f}" if channel.value is not None else "–",
        BY_NAME[channel.name].unit,
        Text(channel.source, "dim") if good else Text(channel.problem, "red"),
    )
