"""Commands in processes of their own, under limits, and what must never come of them."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile

ROOT = Path(__file__).parents[2]
PATIENCE_S = 300.0
"""A hang: longer than any attacked command takes, even on a machine that is busy with other work."""
_ADDRESS_SPACE_BYTES = 16 * 1024**3  # protects the machine that runs the suite; peaks are asserted by the attacks
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command ended: exit code (negative: killed by that signal), output, peak memory."""

    code: int
    out: str
    err: str
    peak_mb: float
    seconds: float

    def survived(self) -> Outcome:
        """The outcome, if the command ended by itself, without a traceback or a raw control character."""
        assert self.code in (0, 1, 2, 130), f"exit code {self.code}: {self.err[-2000:]}"
        assert "Traceback" not in self.out + self.err, self.err[-4000:]
        raw = _CONTROL.search(self.out + self.err)
        assert raw is None, f"raw control character {raw[0]!r}: {self.out[-500:]}{self.err[-500:]}"
        return self

    def refused(self) -> Outcome:
        """The outcome, if the command was refused with one line that a person can act on."""
        self.survived()
        lines = [line for line in self.err.splitlines() if line.startswith("seatrial: ")]
        assert self.code == 1, f"exit code {self.code}: {self.out[-500:]}{self.err[-500:]}"
        assert len(lines) == 1, self.err[-2000:]
        return self

    def done(self) -> Outcome:
        """The outcome, if the command did its work."""
        self.survived()
        assert self.code == 0, self.err[-2000:]
        return self


def run_seatrial(
    *arguments: str | bytes | Path,
    cwd: Path | None = None,
    environment: Mapping[str, str] | None = None,
    patience_s: float = PATIENCE_S,
) -> Outcome:
    """Run ``seatrial`` to its end; a command that does not end within ``patience_s`` is a hang and fails."""
    return run([sys.executable, "-m", "seatrial", *arguments], cwd, environment, patience_s)


def run(
    command: Sequence[str | bytes | Path],
    cwd: Path | None = None,
    environment: Mapping[str, str] | None = None,
    patience_s: float = PATIENCE_S,
) -> Outcome:
    """As :func:`run_seatrial`, for any command."""
    with TemporaryFile() as out, TemporaryFile() as err:
        began_s = time.monotonic()
        process = start(command, cwd, environment, out.fileno(), err.fileno())
        code, peak_mb = _wait(process, began_s + patience_s)
        seconds = time.monotonic() - began_s
        out.seek(0)
        err.seek(0)
        texts = (stream.read().decode(errors="backslashreplace") for stream in (out, err))
        return Outcome(code, *texts, peak_mb=peak_mb, seconds=seconds)


def start(
    command: Sequence[str | bytes | Path],
    cwd: Path | None = None,
    environment: Mapping[str, str] | None = None,
    out: int = subprocess.DEVNULL,
    err: int = subprocess.DEVNULL,
) -> subprocess.Popen[bytes]:
    """Start a command in a process group of its own, with this checkout in front of any other that is installed."""
    merged = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    return subprocess.Popen(
        command, cwd=cwd, env=merged, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
        start_new_session=True, preexec_fn=_limit_memory,
    )  # fmt: skip


def _limit_memory() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE_BYTES, _ADDRESS_SPACE_BYTES))


def _peak_kb(pid: int) -> int:
    """The peak of a process's resident memory since it became what it is [kB]; 0 where it is not known."""
    try:
        found = re.search(r"^VmHWM:\s*(\d+) kB", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    except OSError:
        return 0
    return int(found[1]) if found else 0


def _wait(process: subprocess.Popen[bytes], until_s: float) -> tuple[int, float]:
    """The exit code and the peak of the resident memory [MB].

    The system counts what the process had before it became the command, a copy of this one: a peak below ours says
    nothing of the command, whose own is looked at as long as it runs.
    """
    ours_kb, own_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, 0
    while True:
        own_kb = max(own_kb, _peak_kb(process.pid))
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            is_its_own = usage.ru_maxrss > ours_kb or not own_kb
            return process.returncode, (usage.ru_maxrss if is_its_own else own_kb) / 1024.0
        if time.monotonic() > until_s:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise AssertionError(f"hangs: {process.args!r}")
        time.sleep(0.02)
