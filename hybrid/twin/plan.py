"""A file of planned orders that a person may write, change and delete while the twin runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from acquisition.core.actuators import Actuators
from acquisition.core.errors import InputError
from hybrid.prediction.planned_commands import read_commands


class PlanFile:
    """The orders of a plan file, read again whenever it changes; ``notify`` is told each time, level and text.

    Without the file what is ordered now goes on. A file that cannot be read is told, and the plan before it is
    followed until it can.
    """

    def __init__(self, path: Path, actuators: Actuators, notify: Callable[[str, str], None]) -> None:
        self.path = path
        self._actuators, self._notify = actuators, notify
        self._orders: pd.DataFrame | None = None
        self._seen: tuple[int, ...] | None = ()  # as no file is

    def orders(self) -> pd.DataFrame | None:
        """The orders as :func:`.read_commands` gives them; None without a plan."""
        seen = _version_of(self.path)
        if seen != self._seen:
            self._seen = seen
            self._read()
        return self._orders

    def _read(self) -> None:
        if self._seen is None:
            self._orders = None
            self._notify("warning", f"no plan at {self.path}: what is ordered now goes on")
            return
        try:
            self._orders = read_commands(self.path, self._actuators)
        except InputError as error:
            before = "what is ordered now goes on" if self._orders is None else "the plan before goes on"
            self._notify("warning", f"no new plan, {before}: {error}")
            return
        self._notify("info", plan_text(self._orders))


def _version_of(path: Path) -> tuple[int, ...] | None:
    """What changes when a file does; None without one."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def plan_text(orders: pd.DataFrame) -> str:
    """A plan in one line: what it orders, and from when to when.

    >>> plan_text(pd.DataFrame({"rudder_angle_deg": [0.0, -20.0]}, index=pd.Index([0.0, 5.0], name="second")))
    'plan of rudder_angle_deg: 2 orders, 0 to 5 s after the start of each prediction'
    """
    first, last = orders.index[[0, -1]]
    when = (
        f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"
        if isinstance(first, pd.Timestamp)
        else f"{first:g} to {last:g} s after the start of each prediction"
    )
    number = "1 order" if len(orders) == 1 else f"{len(orders)} orders"
    return f"plan of {', '.join(map(str, orders.columns))}: {number}, {when}"
