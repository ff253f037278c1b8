"""Ashore nothing of Seatrial needs modules that only POSIX systems have."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WITHOUT_POSIX = """
import builtins, os, signal, sys

missing = {"fcntl", "termios", "pty", "tty", "resource", "grp", "pwd", "syslog", "posix"}
original = builtins.__import__

def portable(name, globals=None, *rest, **options):
    if name in missing and (globals or {}).get("__name__", "").partition(".")[0] == "seatrial":
        raise ImportError(f"no module named {name!r}")
    return original(name, globals, *rest, **options)

builtins.__import__ = portable
for module, names in ((os, ("O_CLOEXEC", "O_NONBLOCK", "O_NOFOLLOW", "O_DIRECTORY", "pread", "pwrite", "nice")),
                      (signal, ("SIGHUP",))):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
import seatrial
seatrial.main()
"""
QUICK = (
    "info trial.mcap",
    "check trial.mcap -o quality --repair repaired.mcap",
    "export trial.mcap -o trial.csv --rate 1",
    "import trial.csv -o again.mcap --vessel gunnerus_long",
    "windows trial.mcap -o windows.parquet",
    "manoeuvres trial.mcap -o manoeuvres",
    "smooth trial.mcap -o smooth.parquet",
    "validate trial.mcap",
    "report trial.mcap --no-pdf",
)
LONG = ("train trial.mcap -o calibrator", "diagnose trial.mcap -o diagnosis", "batch . -o results --workers 1")


def run(words: str, folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_POSIX, *words.split()],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{words}: {done.stderr[-2000:]}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("portable")
    run("simulate -o trial.mcap --vessel gunnerus_long --manoeuvre paper --duration 600 --rate 2", folder)
    return folder


@pytest.mark.parametrize("words", QUICK)
def test_command_ashore_runs_without_posix(words: str, folder: Path) -> None:
    run(words, folder)


@pytest.mark.slow
@pytest.mark.parametrize("words", LONG)
def test_long_command_ashore_runs_without_posix(words: str, folder: Path) -> None:
    run(words, folder)
