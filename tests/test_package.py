"""Seatrial as it is installed: one package, which a user's own folders and files beside a script do not disturb."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = """
import seatrial as st
assert st.check.__module__.startswith("seatrial.")
print(st.__file__, st.load_vessel("gunnerus_long").name)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what a wheel installs."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


def run(*arguments: str, folder: Path, packages: Path) -> str:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(packages)}, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip


def test_wheel_installs_one_package(installed: Path) -> None:
    assert sorted(path.name.partition("-")[0] for path in installed.iterdir()) == ["seatrial", "seatrial"]
    assert not list(installed.rglob("__pycache__"))


def test_installed_package_runs_as_a_module_and_from_a_script(installed: Path, tmp_path: Path) -> None:
    assert run("-m", "seatrial", "--version", folder=tmp_path, packages=installed).startswith("seatrial ")
    (tmp_path / "script.py").write_text(SCRIPT)
    assert str(installed) in run("script.py", folder=tmp_path, packages=installed)


@pytest.mark.parametrize("checkout", [True, False], ids=["checkout", "wheel"])
def test_folders_and_files_of_a_user_do_not_hide_the_packages(
    checkout: bool, installed: Path, tmp_path: Path
) -> None:
    for name in ("acquisition", "analysis", "hybrid", "notebooks"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('a folder of the user')")
    (tmp_path / "trials.py").write_text("raise RuntimeError('a file of the user')")
    (tmp_path / "script.py").write_text(SCRIPT)
    packages = ROOT if checkout else installed
    assert "gunnerus_long" in run("script.py", folder=tmp_path, packages=packages)
