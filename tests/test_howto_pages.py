"""How-to pages that need nothing but what they make, typed word by word."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.pages import page
from tests.test_tutorial import appears, environment, typed

__all__ = ["environment"]

pytestmark = [pytest.mark.pages]

NEEDS = {
    "co_simulation": ("fmpy", "casadi"),
    "ros_group": ("rosbags",),
    "autopilot_boat": ("pymavlink",),
    "measuring_company": ("asammdf",),
    "controller": ("casadi",),
}
"""The packages that a page needs, by its name."""


@pytest.mark.parametrize("name", NEEDS)
def test_page_runs_as_it_stands(name: str, tmp_path: Path, environment: dict[str, str]) -> None:
    """Every command and script succeeds, in order, in an empty folder, and prints the lines that the page shows."""
    for package in NEEDS[name]:
        pytest.importorskip(package, reason=f"{package} is not installed")
    if name == "co_simulation" and not (shutil.which("cc") or shutil.which("gcc")):
        pytest.skip("no C compiler here, with which an FMU is made")
    printed = ""
    for block in page(f"howto/{name}.md").blocks:
        if block.language == "text":
            for line in block.text.splitlines():
                assert line == "..." or appears(line, printed), f"not printed: {line}\n{printed}"
        elif block.language == "python":
            (tmp_path / "block.py").write_text(block.text, encoding="utf-8")
            printed = typed("python block.py", tmp_path, environment)
        else:
            printed = typed(block.text, tmp_path, environment)
