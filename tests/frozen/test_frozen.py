"""The program says of the same input what it said before: ``make frozen``, ``make frozen PART=quick``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.frozen.comparison import differences
from tests.frozen.figures import FIGURES, compute, read
from tests.frozen.parts import PARTS


@pytest.fixture(scope="module")
def frozen() -> dict[str, Any]:
    """The figures that were written down."""
    return read()


@pytest.mark.timeout(900)
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.frozen if part.quick else pytest.mark.frozen_long)
        for name, part in PARTS.items()
    ],
)
def test_figures_are_what_they_were(
    name: str, frozen: dict[str, Any], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Every number of a part, and every word but prose; all that differs is listed."""
    part = PARTS[name]
    if part.real:
        request.getfixturevalue("shared_data")
    found = differences(frozen[name], compute(name, tmp_path), part.relative)
    again = f"python -m tests.frozen.figures -o {FIGURES.relative_to(Path(__file__).parents[2])} --part {name}"
    assert not found, f"{name}: {len(found)} differ; to freeze anew: {again}\n" + "\n".join(found)


@pytest.mark.frozen
def test_differences_are_all_listed() -> None:
    """Numbers within the tolerance are the same; what is missing, new, or of another type is not."""
    before = {"a": 1.0, "b": [1.0, 2.0], "c": {"d": "x"}, "e": 0.0, "f": None, "h": True}
    after = {"a": 1.0 + 5e-7, "b": [1.0, 2.1, 3.0], "c": {}, "e": 1e-12, "f": 0.0, "h": 1}
    paths = [each.split(":")[0] for each in differences(before, after, 1e-6)]
    assert sorted(paths) == ["/b/1", "/b/2", "/c", "/c/d", "/f", "/h"]
