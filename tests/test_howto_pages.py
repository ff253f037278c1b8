"""How-to pages that need nothing but what they make, typed word by word."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.pages import page
from tests.test_tutorial import environment, typed

__all__ = ["environment"]

pytestmark = [pytest.mark.pages]


@pytest.mark.skipif(shutil.which("cc") is None and shutil.which("gcc") is None,
                    reason="no C compiler here, with which an FMU is made")  # fmt: skip
def test_co_simulation_page_runs(tmp_path: Path, environment: dict[str, str]) -> None:
    """Every command succeeds, in order, in an empty folder."""
    pytest.importorskip("fmpy", reason="FMPy, which runs FMUs, is not installed")
    pytest.importorskip("casadi", reason="CasADi, which writes the C code of FMUs, is not installed")
    for block in page("howto/co_simulation.md").blocks:
        typed(block.text, tmp_path, environment)
    assert (tmp_path / "ship.toml").exists()
