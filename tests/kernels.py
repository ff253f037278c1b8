"""Compiles the kernels that tests of several files need, once and not in each of pytest's processes."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import seatrial as st
from seatrial.hybrid import workflows


def compile_kernels() -> None:
    """Diagnose and validate short voyages, for the sake of the compiled code that this leaves on the disk."""
    workflows.compile_diagnosis()
    with TemporaryDirectory() as folder:
        voyage = workflows.simulate_to(Path(folder) / "voyage.mcap", "voyage", 120.0, 0)
        st.validate(voyage, vessel="gunnerus_short", all_windows=True)


if __name__ == "__main__":
    compile_kernels()
