"""What a file may take of memory and time, by its size on disk, and how a person raises it.

A small file can unpack to more than a machine holds. What an honest file unpacks to is in proportion to its bytes:
each budget is an allowance for a file of any size and a multiple of its bytes, several times what the densest
honest files were measured to need. ``SEATRIAL_BUDGET`` multiplies all of them.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

from seatrial.acquisition.core.errors import ConfigurationError, InputError, SeatrialError

VARIABLE = "SEATRIAL_BUDGET"
_MEGA = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class FileBudget:
    """So much of ``what`` (a plural) a file may hold: ``least``, and ``per_byte`` for each byte on disk."""

    what: str
    least: int
    per_byte: float = 0.0

    def allowance(self, file_bytes: int) -> int:
        """What a file of this size may hold. Raises :class:`ConfigurationError` for a malformed factor."""
        return int(budget_factor() * (self.least + self.per_byte * file_bytes))

    def require(
        self, amount: int, path: Path | str, file_bytes: int, kind: type[SeatrialError] = InputError
    ) -> None:
        """Raise an error of this ``kind`` for a file that holds more than its allowance."""
        allowance = self.allowance(file_bytes)
        if amount > allowance:
            raise kind(
                f"has at least {amount:,} {self.what}", where=str(path),
                why=f"the budget of a file of {file_bytes:,} bytes is {allowance:,}", fix=how_to_raise(),
            )  # fmt: skip


EXPANDED_BYTES = FileBudget("unpacked bytes", 256 * _MEGA, 200.0)
"""Of compressed chunks. A recording of constant values by this recorder unpacks to 2.6 times its size, one by the
mcap library without indexes of messages to 35 times; zstd at its worst to 30,000 times."""

MESSAGES = FileBudget("messages", 100_000, 1.0)
"""The recorder takes 30 bytes a message, the mcap library, without indexes of messages, 2.3 of constant values."""

DEFINITIONS = FileBudget("definitions of topics", 150_000, 0.1)
"""There are 65,535 topics and as many schemas at most; the recorder repeats some 30 every 300 chunks."""

DESCRIPTION_BYTES = FileBudget("bytes of definitions, metadata, attachments, events and states", 64 * _MEGA, 2.0)
"""They are kept in memory. The recorder writes 20 kB, and the configuration with its DBC files."""

RECORDING_CELLS = FileBudget("cells", 50_000_000, 20.0)
"""Rows by columns, 8 bytes each. The densest recording (2.3 bytes a message) of 13 channels, none of which has its
times in common with another, has 6 a byte."""

TABLE_CELLS = FileBudget("cells", 5_000_000, 40.0)
"""Of foreign tables. Constant values beside a time: 0.4 a byte in .xlsx, 2 in Parquet, 7 in CSV by gzip, 11 in
.mat, 17 in HDF5, 21 in CSV by bzip2."""

TABLE_COLUMNS = FileBudget("columns", 2_000)
"""The widest table that we know has 300; to recognise 20,000 by their names takes a minute."""

TABLE_TEXT_BYTES = FileBudget("unpacked bytes of text", 32 * _MEGA, 200.0)
"""Constant values beside a time: gzip 37, bzip2 112, xz 360 times their size."""

LOG_BYTES = FileBudget("unpacked bytes of a log", 8 * _MEGA, 60.0)
"""CAN frames and sentences of constant values by gzip 20 to 28 times their size, containers of BLF less."""

MEMORY_BYTES = FileBudget("bytes of memory", 500 * _MEGA, 300.0)
"""Of a library that reads a table: 100 MB by itself, and twice the arrays, which are 88 times a .mat file of
constant values, 132 times one of HDF5."""

CPU_SECONDS = FileBudget("seconds of processor", 30, 2e-5)
"""Of the same: a spreadsheet takes 0.3 s a megabyte."""

XML_DEPTH = FileBudget("elements within each other", 100)
"""A point of a GPX track is the fourth, what extensions say of it the sixth."""

CONFIGURATION_BYTES = FileBudget("bytes", 4 * _MEGA)
"""Of a TOML file, or a table of commands: a hundred times the longest of ours."""

JSON_BYTES = FileBudget("bytes", 256 * _MEGA)
"""Of a JSON file: ours have kilobytes, the largest, what a diagnosis shows, some megabytes."""

CALIBRATOR_BYTES = FileBudget("bytes", 1024 * _MEGA)
"""Of a file of a calibrator: ours have up to 4 MB; one of a user's own may keep its training data."""

DBC_BITS = FileBudget("bits in one signal or bytes in one message", 15_000)
"""The longest message of J1939 has 1,785 bytes, 14,280 bits; cantools takes time by the square."""

DBC_BYTES, DBC_TEXT_BYTES = FileBudget("bytes", 8 * _MEGA), FileBudget("letters in one text", 100_000)
"""Of a DBC file (those of whole trucks are 5 MB), and of a comment in it, of which cantools takes 240 bytes a
letter."""

NAME_BYTES = FileBudget("bytes in a name or a sample", 10_000)
"""A sample has some 70, of JSON 300; no topic is named in more than a line."""

TEXT_BYTES = FileBudget("bytes in one text, cell or line", _MEGA)
"""The longest text that people write is a trial's list of declared channels, some 100 kB."""


def how_to_raise() -> str:
    """What a user does who wants such a file to be read."""
    return f"if you trust the file, raise all budgets tenfold with {VARIABLE}={10 * budget_factor():g}"


def budget_factor() -> float:
    """What the user multiplies all budgets by, 1 unless ``SEATRIAL_BUDGET`` says otherwise.

    Raises :class:`ConfigurationError` unless it is a positive number.
    """
    text = os.environ.get(VARIABLE, "").strip() or "1"
    try:
        factor = float(text)
    except ValueError:
        factor = -1.0
    if not (isfinite(factor) and factor > 0.0):
        raise ConfigurationError(f"{VARIABLE}={text!r} is no factor", fix=f"set a number such as {VARIABLE}=10")
    return factor


@dataclass(slots=True)
class Meter:
    """What the reading of one file has taken so far, held against its budgets."""

    path: Path | str
    file_bytes: int
    _totals: dict[FileBudget, int] = field(default_factory=dict)
    _allowances: dict[FileBudget, int] = field(default_factory=dict)  # worked out once: a day has 400,000 chunks

    def grow(self, file_bytes: int) -> None:
        """Take note that the file is longer than it was."""
        self.file_bytes = file_bytes
        self._allowances.clear()

    def check(self, budget: FileBudget, amount: int) -> None:
        """Raise :class:`InputError` for an amount by itself beyond the budget."""
        if budget not in self._allowances:
            self._allowances[budget] = budget.allowance(self.file_bytes)
        if amount > self._allowances[budget]:
            budget.require(amount, self.path, self.file_bytes)

    def add(self, budget: FileBudget, amount: int) -> None:
        """Count ``amount`` more. Raises :class:`InputError` beyond the budget."""
        self._totals[budget] = total = self._totals.get(budget, 0) + amount
        self.check(budget, total)
