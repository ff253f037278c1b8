"""The documentation as a site: it is built without a warning, and a reader needs no network."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import DOCS, ROOT
from tests.test_documentation import EXTERNAL, commands

pytestmark = pytest.mark.pages


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it."""
    pytest.importorskip("myst_parser")
    folder = tmp_path_factory.mktemp("site")
    options = ["-b", "html", "-d", str(folder / "doctrees"), "-W", "--keep-going", "-n", "-q"]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, str(DOCS), str(folder / "html")],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    """No script, style, font or picture of another site; links lead to those on the list only."""
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert not re.findall(r'(?:src|srcset)="(?:https?:)?//[^"]*"', text), path
        assert not re.findall(r'<link[^>]*href="(?:https?:)?//[^"]*"', text), path
        assert {each.rstrip("/") for each in re.findall(r'href="(https?://[^"]*)"', text)} <= EXTERNAL, path
    for path in site.rglob("*.css"):
        assert not re.findall(r"url\(['\"]?(?:https?:)?//", path.read_text(encoding="utf-8")), path


def test_equations_are_mathml(site: Path) -> None:
    text = (site / "theory" / "manoeuvring_model.html").read_text(encoding="utf-8")
    assert text.count("<math ") > 20
    assert '<mtable class="matrix">' in text
    assert "\\dot" not in text


def test_every_command_and_option_is_in_the_reference(site: Path) -> None:
    text = (site / "reference" / "command_line.html").read_text(encoding="utf-8")
    for name, command in commands().items():
        section = text.partition(f'id="seatrial-{name.replace(" ", "-")}"')[2].partition("<section")[0]
        assert section, name
        flags = [
            flag for each in command.params for flag in each.opts if flag.startswith("--") and flag != "--help"
        ]
        assert not [flag for flag in flags if f">{flag}<" not in section], name


def test_functions_have_their_texts(site: Path) -> None:
    text = (site / "reference" / "python.html").read_text(encoding="utf-8")
    for name in (
        "seatrial.read",
        "seatrial.hybrid.calibrators.train_calibrator",
        "seatrial.hybrid.workflows.diagnose_files",
    ):
        assert f'id="{name}"' in text
    assert "The raw samples of all channels joined on their measured time." in text
