"""The page on a rudder ship, typed word by word beside her published trials."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from tests.pages import ROOT, Block, page
from tests.test_tutorial import appears, environment, typed

__all__ = ["environment"]

pytestmark = [pytest.mark.pages, pytest.mark.slow, pytest.mark.shared]

_BLOCKS = page("howto/rudder_ship.md").blocks
_STEPS = [each for each in _BLOCKS if each.language == "sh"]
_SHOWN = {one.line: two.text for one, two in pairwise(_BLOCKS) if (one.language, two.language) == ("sh", "text")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, shared_data: Path) -> Path:
    """The reader's folder, with the published files and the project's maps and vessels."""
    made = tmp_path_factory.mktemp("rudder_ship")
    (made / "esso_osaka").symlink_to(shared_data / "esso_osaka")
    (made / "trials").symlink_to(ROOT / "trials")
    return made


@pytest.mark.parametrize("step", _STEPS, ids=lambda step: step.heading)
def test_a_step(step: Block, folder: Path, environment: dict[str, str]) -> None:
    """Every command succeeds, and the lines that the page shows are printed."""
    printed = typed(step.text, folder, environment)
    for line in _SHOWN.get(step.line, "").splitlines():
        assert appears(line, printed), f"not printed: {line}\n{printed}"
