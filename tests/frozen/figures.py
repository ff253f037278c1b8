"""Compute the frozen figures: ``python -m tests.frozen.figures -o tests/frozen/figures.json [--part NAME]...``.

Only the parts that are named are computed anew, all without any; the rest of the file stays.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.frozen.parts import PARTS, recorded_data

FIGURES = Path(__file__).with_name("figures.json")


def compute(name: str, folder: Path) -> dict[str, Any]:
    """The figures of one part, computed in ``folder``, as JSON has them."""
    with chdir(folder):
        said: dict[str, Any] = json.loads(json.dumps(PARTS[name].compute()))
    return said


def read(file: Path = FIGURES) -> dict[str, Any]:
    """All parts that a file holds."""
    parts: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return parts


def write(file: Path, parts: dict[str, Any]) -> None:
    """One line a part, so that a change shows which it was."""
    lines = [f"{json.dumps(name)}: {json.dumps(parts[name])}" for name in PARTS if name in parts]
    file.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--part", action="append", choices=list(PARTS))
    given = parser.parse_args()
    for name in given.part or PARTS:
        if PARTS[name].real and not recorded_data().is_dir():
            print(f"{name}: passed over, no recorded data at {recorded_data()}", file=sys.stderr)  # noqa: T201
            continue
        began, busy = time.perf_counter(), time.process_time()
        with TemporaryDirectory() as folder:
            said = compute(name, Path(folder))
        write(given.output, read(given.output) | {name: said})
        spent = f"{time.perf_counter() - began:.1f} s, {time.process_time() - busy:.1f} s of CPU"
        print(f"{name}: {spent}", file=sys.stderr)  # noqa: T201 - a long command says how far it is


if __name__ == "__main__":
    main()
