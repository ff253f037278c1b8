"""Ashore nothing of Seatrial needs modules that only POSIX systems have."""

from __future__ import annotations

import json
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
os.supports_dir_fd.clear()  # before shutil asks
for module, names in ((os, ("O_CLOEXEC", "O_NONBLOCK", "O_NOFOLLOW", "O_DIRECTORY", "pread", "pwrite", "nice")),
                      (signal, ("SIGHUP",))):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
import json, seatrial
commands, codes = sys.argv[1:], {}
for words in commands:
    sys.argv[:] = ["seatrial", *words.split()]
    try:
        seatrial.main()
        codes[words] = 0
    except SystemExit as end:
        codes[words] = end.code or 0
print(json.dumps(codes), flush=True)
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
    "report trial.mcap --no-pdf --no-interactive",
)
LONG = (
    "report trial.mcap --no-pdf",
    "train trial.mcap -o calibrator",
    "diagnose trial.mcap -o diagnosis",
    "batch . -o results --workers 1",
)


def run(commands: tuple[str, ...], folder: Path) -> dict[str, int]:
    """The exit codes of commands in one process."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_POSIX, *commands],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    codes: dict[str, int] = json.loads(done.stdout.splitlines()[-1])
    assert not any(codes.values()), f"{codes}: {done.stderr[-2000:]}"
    return codes


SIMULATE = "simulate -o trial.mcap --vessel gunnerus_long --manoeuvre paper --duration 240 --rate 1"


def test_commands_ashore_run_without_posix(tmp_path: Path) -> None:
    assert list(run((SIMULATE, *QUICK), tmp_path)) == [SIMULATE, *QUICK]


@pytest.mark.slow
def test_long_commands_ashore_run_without_posix(tmp_path: Path) -> None:
    assert list(run((SIMULATE, *LONG), tmp_path)) == [SIMULATE, *LONG]
