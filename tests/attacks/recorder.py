"""A recorder in a process of its own on a line that loses nothing, and faults of what it depends on."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import pytest

from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.messages import RAW_PREFIX
from seatrial.acquisition.recording.reader import MessageStream
from tests.attacks.commands import PATIENCE_S, start

HOOKS = Path(__file__).parent / "hooks"
_BATCH_S = 0.01


class NumberedLine(threading.Thread):
    """Numbered headings over TCP to whoever connects: what is sent waits for a recorder that is busy."""

    def __init__(self, rate_hz: float) -> None:
        super().__init__(daemon=True)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.section = f'type = "tcp"\nport = {self._listener.getsockname()[1]}\n'
        self.sent = 0
        self._rate_hz, self._ending, self.drained = rate_hz, threading.Event(), threading.Event()

    def run(self) -> None:
        link, _ = self._listener.accept()
        began_s = time.monotonic()
        with link:
            while not self._ending.wait(_BATCH_S):
                due = int((time.monotonic() - began_s) * self._rate_hz)
                link.sendall(b"".join(map(numbered, range(self.sent, due))))
                self.sent = due
        again, _ = self._listener.accept()  # the recorder has read to the end, and tries again
        self.drained.set()
        again.close()

    def end(self) -> None:
        """Send nothing more, and wait until all has been read."""
        self._ending.set()
        assert self.drained.wait(PATIENCE_S), "the recorder does not read its line to the end"
        self._listener.close()


def numbered(number: int) -> bytes:
    """A sentence that carries its number."""
    return frame_sentence(f"HEHDT,{number % 360}.{number:08d},T")


def numbers_in(paths: Iterable[Path]) -> list[int]:
    """The numbers of the raw sentences in a recording's parts, in the order in which they stand there."""
    return [
        int(entry.decode_frame().payload.split(b".", 1)[1][:8])
        for path in paths
        for entry in MessageStream(path)
        if entry.topic.startswith(RAW_PREFIX)
    ]


class AttackedRecorder:
    """``seatrial record`` at work in ``folder``; ``prefix`` is a program that starts it under other conditions."""

    def __init__(
        self,
        place: Path,
        folder: Path,
        rate_hz: float = 200.0,
        settings: str = "",
        prefix: Sequence[str] = (),
        sections: str = "",
    ) -> None:
        self.folder, self.line = folder, NumberedLine(rate_hz)
        self.switch = place / "switch"
        configuration = place / "trial.toml"
        configuration.write_text(
            '[trial]\nname = "attacked"\n'
            f'[[source]]\nname = "line"\nchannels = ["heading_deg"]\n{self.line.section}\n'
            f"[recording]\nreserve_mb = 0\n{settings}\n{sections}\n"
        )
        self._log = (place / "log").open("w+b")
        self.process = start(
            [*prefix, sys.executable, "-m", "seatrial", "record", configuration, "-o", folder],
            environment={
                "PYTHONPATH": f"{HOOKS}{os.pathsep}{Path(__file__).parents[2]}",
                "ATTACK_SWITCH": str(self.switch),
                "SEATRIAL_RUNTIME": str(place / "run"),
            },
            err=self._log.fileno(),
        )
        self.line.start()
        try:
            self.wait_for(lambda: "recording to" in self.log)
        except BaseException:
            self.kill()
            raise

    @property
    def log(self) -> str:
        return Path(self._log.name).read_text(errors="backslashreplace")

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Wait until something has come true, as long as the recorder runs."""
        until_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.process.poll() is None, f"the recorder has ended: {self.log[-3000:]}"
            assert time.monotonic() < until_s, f"it never came true: {self.log[-3000:]}"
            time.sleep(0.02)

    def record(self, seconds: float) -> None:
        """Let it record so long, and as many sentences as belong to that."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            assert self.process.poll() is None, f"the recorder has ended: {self.log[-3000:]}"
            time.sleep(0.05)

    def end(self) -> list[Path]:
        """End it as a user does; its exit code must be 0, its log without a traceback. Returns the parts."""
        self.line.end()
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(PATIENCE_S)
        assert code == 0, self.log[-3000:]
        assert "Traceback" not in self.log, self.log[-3000:]
        return sorted(self.folder.glob("*.mcap"))

    def assert_complete(self) -> list[Path]:
        """End it; every sentence stands in the recording once, and in order."""
        paths = self.end()
        numbers = numbers_in(paths)
        assert len(numbers) == self.line.sent, f"{self.line.sent} sent, {len(numbers)} recorded: {self.log[-3000:]}"
        assert numbers == list(range(self.line.sent))
        return paths

    def kill(self) -> None:
        """Leave nothing running."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._log.close()

    def fail(self, error: int, *calls: str, folder: Path | None = None) -> None:
        """From now on let these functions of ``os`` fail on paths in ``folder`` (without: on any)."""
        content = {"error": error, "calls": calls, "folder": str(folder or "")}
        partial = self.switch.with_suffix(".new")
        partial.write_text(json.dumps(content))
        partial.rename(self.switch)

    def work(self) -> None:
        """Let nothing fail any more."""
        self.switch.unlink(missing_ok=True)


@contextmanager
def attacked(*arguments: object, **options: object) -> Iterator[AttackedRecorder]:
    """An :class:`AttackedRecorder` that is gone after the block, whatever happens in it."""
    recorder = AttackedRecorder(*arguments, **options)  # type: ignore[arg-type]
    try:
        yield recorder
    finally:
        recorder.kill()


def require(*programs: str) -> None:
    """Skip the test where it cannot mount, or a program for that is missing."""
    missing = [program for program in programs if shutil.which(program) is None]
    if missing or os.geteuid() != 0:
        pytest.skip(f"needs root and {' and '.join(programs)}")


def call(*command: str | Path) -> None:
    """Run a program of the system; the test is skipped where it is not allowed to."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"{command[0]}: {done.stderr.strip()}")


@contextmanager
def mounted(point: Path, *options: str) -> Iterator[Path]:
    """A file system of its own at ``point``."""
    require("mount", "umount")
    point.mkdir(parents=True, exist_ok=True)
    call("mount", *options, point)
    try:
        yield point
    finally:
        subprocess.run(["umount", "-l", point], capture_output=True, check=False)


def descriptors_of(process: int) -> int:
    """The highest descriptor of a process and one more."""
    return max(int(entry.name) for entry in Path(f"/proc/{process}/fd").iterdir()) + 1


@contextmanager
def no_descriptors(process: int) -> Iterator[None]:
    """Let a process open nothing more."""
    before = resource.prlimit(process, resource.RLIMIT_NOFILE)
    resource.prlimit(process, resource.RLIMIT_NOFILE, (descriptors_of(process), before[1]))
    try:
        yield
    finally:
        resource.prlimit(process, resource.RLIMIT_NOFILE, before)


@contextmanager
def control_group(kind: str) -> Iterator[Path]:
    """A control group of the system, to limit processes in it (``kind``: pids or memory)."""
    require("mount")
    parent = Path("/sys/fs/cgroup") / kind
    for number in count():
        group = parent / f"seatrial-attack-{os.getpid()}-{number}"
        try:
            group.mkdir()
        except FileExistsError:
            continue
        except OSError as error:
            pytest.skip(f"no control group of {kind}: {error}")
        break
    try:
        yield group
    finally:
        for _ in range(100):
            with suppress(OSError):
                group.rmdir()
                break
            time.sleep(0.05)
