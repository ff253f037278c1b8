"""The quality of a recording for a person at a terminal: a line a channel, then the findings in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquisition.core.channels import NAMES
from analysis.quality.summary import ALL

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from analysis.quality.channel_quality import ChannelQuality
    from analysis.quality.check import DataQuality
    from analysis.quality.findings import Finding

_STYLES = {"good": "green", "suspect": "yellow", "bad": "bold red"}
_COLUMNS = ("channel", "grade", "count", "rate Hz", "gaps", "stuck", "spikes", "range", "twice", "back")


def print_quality(console: Console, quality: DataQuality) -> None:
    """Print the table of channels and each finding with its remedy."""
    console.print(channel_table(quality))
    if missing := missing_text(quality):
        console.print(missing, style="yellow", highlight=False)
    console.print()
    if not quality.findings:
        console.print("Nothing found.", style="green")
    for finding in quality.findings:
        where = "all channels" if finding.channel == ALL else finding.channel
        console.print(f"{finding.code}  {where}", style="bold", highlight=False, markup=False)
        span = f"{finding.start:%Y-%m-%d %H:%M:%S} to {finding.end:%H:%M:%S}"
        console.print(f"  {span}", style="dim", highlight=False)
        console.print(f"  {finding_text(finding)}", highlight=False, markup=False)


def missing_text(quality: DataQuality) -> str:
    """Which of the 13 channels the recording lacks altogether, which no check can judge; empty if it has all."""
    missing = [name for name in NAMES if name not in quality.channels]
    return f"not in the recording: {', '.join(missing)}" if missing else ""


def finding_text(finding: Finding) -> str:
    """A finding and its remedy as sentences with one full stop each."""
    return f"{finding.as_json()['text'].rstrip('.')}."


def channel_table(quality: DataQuality) -> Table:
    """A line a channel: its grade and the counts of its own faults; nothing stands for none."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for number, title in enumerate(_COLUMNS):
        table.add_column(title, justify="left" if number < 2 else "right", no_wrap=True)
    for name, channel in quality.channels.items():
        table.add_row(name, Text(channel.grade, _STYLES[channel.grade]), *counts_of(channel))
    return table


def counts_of(channel: ChannelQuality) -> list[str]:
    """The counts of a channel as text, empty where nothing was found."""
    faults = (len(channel.gaps), len(channel.stuck), channel.spikes, channel.out_of_range, channel.duplicates,
              channel.time_backwards)  # fmt: skip
    return [f"{channel.count:,}", f"{channel.rate_hz:.2f}", *(f"{each:,}" if each else "" for each in faults)]
