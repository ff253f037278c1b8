"""The reproduction while it runs: how long it will take, what is finished, and the table of that."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path

from seatrial.hybrid.reproduction.campaign import SEA_STATES, SeaResults
from seatrial.hybrid.reproduction.page import write_table3
from seatrial.hybrid.reproduction.table3 import table3

CAMPAIGN_S = 60.0
"""What a campaign takes on one core [s], four methods trained under either split; measured on a server of 2026."""


@dataclass(slots=True)
class RunningTable:
    """The campaigns finished so far, of ``total``; after each their table goes to ``folder``, if there is one.

    ``say`` takes a line for the user, ``clock`` tells the time [s].
    """

    total: int
    workers: int | None
    folder: Path | None
    say: Callable[[str], None]
    clock: Callable[[], float] = time.monotonic
    seas: list[SeaResults] = field(default_factory=list)
    began_s: float = 0.0

    def announce(self) -> None:
        """Say before the first campaign how many there are and about how long they take."""
        self.began_s = self.clock()
        workers = min(self.workers or os.cpu_count() or 1, self.total)
        about_s = CAMPAIGN_S * ceil(self.total / workers)
        kept = f"; what is finished is in {self.folder} after each" if self.folder else ""
        self.say(
            f"{counted(self.total)} of some {duration_text(CAMPAIGN_S)} each on one core, {workers} at a time: "
            f"about {duration_text(about_s)}{kept}"
        )

    def add(self, sea: SeaResults) -> None:
        """Keep a campaign that is finished, write the table of all that are, and say how long the rest may take."""
        self.seas.append(sea)
        done, passed_s = len(self.seas), self.clock() - self.began_s
        if self.folder is not None and done < self.total:
            write_table3(
                table3(sorted(self.seas, key=lambda each: (SEA_STATES.index(each.job.sea_state), each.job.seed))),
                self.folder,
            )
        left = f"about {duration_text(passed_s / done * (self.total - done))} left" if done < self.total else "done"
        self.say(
            f"{done} of {counted(self.total)} after {duration_text(passed_s)}: {sea.job.sea_state} sea, seed "
            f"{sea.job.seed}; {left}"
        )


def counted(campaigns: int) -> str:
    """A number of campaigns.

    >>> counted(1), counted(15)
    ('1 campaign', '15 campaigns')
    """
    return f"{campaigns} campaign{'s' * (campaigns != 1)}"


def duration_text(seconds: float) -> str:
    """A time for people, in seconds or minutes.

    >>> duration_text(42.3), duration_text(100.0), duration_text(5400.0)
    ('42 s', '2 min', '90 min')
    """
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
