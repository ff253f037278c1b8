"""Progress of long work: a bar on stderr if that is a terminal, else nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[float], None]
"""A callback for the share of work done, 0 to 1."""


def part_of(progress: Progress, done: int, total: int) -> Progress:
    """The progress callback of one of ``total`` pieces of work, ``done`` of which are finished.

    >>> part_of(print, 1, 4)(0.5)
    0.375
    """
    return lambda share: progress((done + share) / total)


@contextmanager
def bar(what: str) -> Iterator[Progress]:
    """A function that takes the share done, 0 to 1."""
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.progress import Progress as Bars

    from seatrial.acquisition.core.terminal import Terminal

    with Bars(console=Terminal(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=1.0)
        yield lambda share: progress.update(task, completed=share)
