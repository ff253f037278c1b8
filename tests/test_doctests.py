"""The examples in docstrings give what they say; those of the public functions can be copied into a script."""

from __future__ import annotations

import doctest
import gzip
import shutil
import sys
from collections.abc import Iterable
from contextlib import chdir
from importlib import import_module
from pathlib import Path

import pytest

import seatrial as st
from tests.conftest import nightly

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    ".".join(("seatrial", *path.relative_to(ROOT).with_suffix("").parts))
    for package in ("acquisition", "analysis", "hybrid")
    for path in (ROOT / package).rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)
PUBLIC = {place.replace(":", ".") for place in st._PLACES.values()}


def failures(examples: Iterable[doctest.DocTest], flags: int = 0) -> int:
    """How many examples give something else than they say."""
    runner = doctest.DocTestRunner(optionflags=flags)
    return sum(runner.run(example).failed for example in examples)


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_a_module(name: str) -> None:
    examples = doctest.DocTestFinder(exclude_empty=True).find(import_module(name))
    assert any(example.examples for example in examples)
    assert failures(example for example in examples if example.name not in PUBLIC) == 0


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the examples start from, as their page makes them."""
    folder = tmp_path_factory.mktemp("examples")
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    script = page.partition("## Functions")[2].partition("```python\n")[2].partition("```")[0]
    with chdir(folder):
        exec(compile(script, "docs/reference/python.md", "exec"), {})
    old = ROOT / "tests" / "acquisition" / "recorded_as_json.mcap.gz"
    (folder / "old.mcap").write_bytes(gzip.decompress(old.read_bytes()))
    return folder


@pytest.fixture(scope="session")
def calibrator(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrator") / "calibrator"
    st.train(recordings / "earlier.mcap", stride_s=10, output=folder)
    return folder


LONG = ("batch", "diagnose", "identify", "load_diagnosis", "plan", "report")
"""Whose examples take seconds; what they call is tried every day."""


@pytest.mark.parametrize("name", [*(name for name in st.__all__ if name not in LONG), *nightly(*LONG)])
def test_examples_of_a_public_function(
    name: str,
    recordings: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    """They import what they use, and find nothing but the files that their page names."""
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(st, name), name, globs={})
    assert example.examples
    shutil.copytree(recordings, tmp_path, dirs_exist_ok=True)
    if '"calibrator"' in (example.docstring or ""):
        shutil.copytree(request.getfixturevalue("calibrator"), tmp_path / "calibrator")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", sys.argv)
    assert failures([example], doctest.ELLIPSIS) == 0
