"""What the folder that ``seatrial reproduce`` wrote holds for the report on the paper's results."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from acquisition.core.errors import InputError
from hybrid.reproduction.figures import FIGURES
from hybrid.reproduction.table3 import Table3, read_table3

TABLE = "table3.json"


@dataclass(frozen=True, slots=True)
class Reproduced:
    """A folder of results: the table, if it was made, and where the pictures are."""

    folder: Path
    table: Table3 | None


def is_reproduced(folder: Path) -> bool:
    """Whether a folder holds any of it."""
    return (folder / TABLE).is_file() or any((folder / f"{name}.png").is_file() for name in FIGURES)


def load_reproduced(folder: Path | str) -> Reproduced:
    """What a folder holds. Raises :class:`InputError` where it is nothing of the reproduction."""
    folder = Path(folder)
    path = folder / TABLE
    if not is_reproduced(folder):
        raise InputError("holds neither Table III nor its figures", where=str(folder),
                         fix="run `seatrial reproduce table3 -o` that folder")  # fmt: skip
    if not path.is_file():
        return Reproduced(folder, None)
    try:
        return Reproduced(folder, read_table3(json.loads(path.read_text(encoding="utf-8"))))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("is not what this version writes", where=str(path), why=f"{type(error).__name__} {error}",
                         fix="run `seatrial reproduce table3` again") from error  # fmt: skip
