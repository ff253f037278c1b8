"""How a target is run: ``python -m tests.fuzz.NAME -max_total_time=600 -rss_limit_mb=300``, where atheris is."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import atheris


def fuzz(one_input: Callable[[bytes], None], seeds: Iterable[bytes], longest_bytes: int) -> None:
    """Run it from a folder with the seeds, where libFuzzer keeps what reached new code, for the next run."""
    folder = Path(tempfile.gettempdir()) / Path(sys.argv[0]).stem
    folder.mkdir(exist_ok=True)
    for number, seed in enumerate(seeds):
        (folder / f"seed_{number}").write_bytes(seed)
    atheris.Setup([*sys.argv, f"-max_len={longest_bytes}", str(folder)], one_input)
    atheris.Fuzz()
