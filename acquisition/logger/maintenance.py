"""Does what a recording needs by the clock: flush, sync, health of the sources, checks of clock and disk, copies.

A recording's time is UTC that never steps, whatever is done to the computer's clock: the wall clock is taken once
and carried on by the monotonic clock, so that order and durations stay right. Small differences (a clock that is
kept by NTP) are followed slowly; a step is reported, and the next part of the recording takes the new time.

Finished parts are copied to a second folder at a lower priority, read back and compared; older parts make room once
their copies are verified. Nothing is deleted whose copy has not just been read back and is the same, byte for byte.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from seatrial.acquisition.config.sources import CopiesSection, RecordingSection
from seatrial.acquisition.core import process
from seatrial.acquisition.core.errors import ConfigurationError, StorageError, storage_error
from seatrial.acquisition.core.trial import Frame, wall_and_monotonic_ns
from seatrial.acquisition.logger.health import LOG, SILENT_NS, CopyState, Health, kernel_clock_state
from seatrial.acquisition.recording import reader, writer
from seatrial.acquisition.recording.parts import RecordingParts, Tell, recording_parts_in_folder

STEP_NS = 100_000_000  # what NTP corrects without a step is less; so is what a busy computer can feign
_SLEW_FRACTION = 500e-6  # the fastest that a kernel's clock is slewed
_TOLERANCE_NS = 1_000_000
TICK_S = 0.05
"""How late the recorder may check the clock; flush and sync come so much earlier."""
_HEALTH_EVERY_S = 1.0
_GROWTH_FRACTION = 0.1  # of the newest second in the mean rate of growth

_LOOK_EVERY_S, _TRY_AGAIN_S = 5.0, 60.0
_LONGEST_FINISH_S = 20.0  # less than the patience of a supervisor that stops us
_LONGEST_STOP_S = 5.0
_PIECE_BYTES = 1024 * 1024
_PAUSE_S = 0.005  # after each piece: at most 200 MB/s, so that the recording's disk has time for it
_PRIORITY = 10
_GIGA = 1e9

Pause = Callable[[], None]
"""What is done between two pieces; it may raise, to end the work."""


class Timescale:
    """UTC from the monotonic clock, ``utc = monotonic + offset_ns``, beginning with the wall clock as given."""

    def __init__(self, wall_ns: int, monotonic_ns: int) -> None:
        self.offset_ns = wall_ns - monotonic_ns
        self._wall_offset_ns = self.offset_ns
        self._followed_ns = monotonic_ns

    def utc_ns(self, monotonic_ns: int) -> int:
        """The recording's UTC at a moment of the monotonic clock [ns]."""
        return monotonic_ns + self.offset_ns

    def restamp_frame(self, frame: Frame) -> Frame:
        """The frame with its time of reception on this time scale; the same frame if it is there already."""
        received_ns = frame.monotonic_ns + self.offset_ns
        if -_TOLERANCE_NS < frame.received_ns - received_ns < _TOLERANCE_NS:
            return frame
        return frame._replace(received_ns=received_ns)

    def follow_wall_clock(self, wall_ns: int, monotonic_ns: int) -> int:
        """Read the wall clock, and follow it slowly. Returns its step since the last reading [ns], 0 for none."""
        wall_offset_ns = wall_ns - monotonic_ns
        step_ns = wall_offset_ns - self._wall_offset_ns
        self._wall_offset_ns = wall_offset_ns
        limit_ns = int((monotonic_ns - self._followed_ns) * _SLEW_FRACTION)
        self._followed_ns = monotonic_ns
        behind_ns = wall_offset_ns - self.offset_ns
        if abs(behind_ns) < reader.NEW_PART_NS:
            self.offset_ns += max(-limit_ns, min(limit_ns, behind_ns))
        return step_ns if abs(step_ns) >= STEP_NS else 0

    @property
    def is_beyond_following(self) -> bool:
        """Whether the wall clock has moved too far to be followed slowly."""
        return abs(self._wall_offset_ns - self.offset_ns) >= reader.NEW_PART_NS

    def adopt_wall_clock(self) -> None:
        """Take the wall clock's time from now on."""
        self.offset_ns = self._wall_offset_ns


def clock_metadata(scale: Timescale) -> dict[str, str]:
    """Which clock a part's times come from, and what relates them to those of a part by another one.

    The latter are the boot since which the monotonic clock counts, and how long it stood as the computer slept
    [ns], where the system states both.
    """
    metadata = {
        "times": "host clock when the part began, carried on by the monotonic clock",
        "host_clock": kernel_clock_state(),
        "utc_minus_monotonic_ns": str(scale.offset_ns),
    }
    with suppress(OSError, AttributeError):
        slept_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        metadata |= {"boot": boot, "slept_ns": str(max(slept_ns, 0))}
    return metadata


class Maintenance:
    """What one recording does by the clock; :meth:`run_periodic_tasks` is called about every :data:`TICK_S`."""

    def __init__(
        self, settings: RecordingSection, parts: RecordingParts, health: Health, scale: Timescale, note: Tell
    ) -> None:
        self._settings, self._parts, self._health, self._scale, self._note = settings, parts, health, scale, note
        self._flushed_s = self._synced_s = self._reported_s = time.monotonic()
        self._silent: dict[str, int] = {}
        self._written_bytes = 0

    def run_periodic_tasks(self) -> None:
        now_s = time.monotonic()
        self._check_clock()
        self._parts.check_limits(now_s)
        if now_s - self._reported_s >= _HEALTH_EVERY_S:
            self._report_silence(time.monotonic_ns())
            health, parts = self._health, self._parts
            rate = (parts.written_bytes - self._written_bytes) / max(now_s - self._reported_s, 1e-3)
            self._written_bytes = parts.written_bytes
            health.bytes_per_s += _GROWTH_FRACTION * (rate - health.bytes_per_s) if health.bytes_per_s else rate
            health.free_bytes, health.trouble, health.part = parts.room_bytes, parts.trouble, parts.path.name
            self._reported_s = now_s
            self.report_sources()
        if now_s - self._flushed_s >= self._settings.flush_s - TICK_S:
            self._parts.flush()
            self._flushed_s = now_s
        # A disk that is still busy with the last sync is asked again as soon as it is not.
        if now_s - self._synced_s >= self._settings.sync_s - TICK_S and self._parts.sync_in_background():
            self._synced_s = now_s

    def _check_clock(self) -> None:
        step_ns = self._scale.follow_wall_clock(*wall_and_monotonic_ns())
        if not step_ns:
            return
        text = f"the computer's clock was set by {step_ns / 1e9:+.3f} s"
        if not self._scale.is_beyond_following:
            self._note("warning", f"{text}; the times in this recording follow it slowly")
            return
        name = self._parts.path.name
        self._note("warning", f"{text}; times in {name} keep the old time, the next part has the new")
        self._scale.adopt_wall_clock()
        self._parts.set_clock(clock_metadata(self._scale), "the computer's clock was set")
        self._note("warning", f"{text}; times in {self._parts.path.name} are by the new time")

    def report_sources(self) -> None:
        """Record the state of each source and sink and of the computer's clock."""
        if self._parts.paused:
            return
        now = time.monotonic_ns()
        states = [source.as_message(now) for source in self._health.sources.values()]
        states += [sink.as_message(now) for sink in self._health.sinks.values()]
        if self._health.clock.state != "unknown":
            states.append(self._health.clock.as_message())
        for state in states:
            self._parts.write_health(state, self._scale.utc_ns(now))

    def _report_silence(self, now: int) -> None:
        """Report when sources fall silent and when they send again, of several at once in one event.

        One that has failed is not reported until it is back.
        """
        fallen_silent, never_sent, gaps_s = list[str](), list[str](), dict[str, float]()
        for source in self._health.sources.values():
            silent = source.is_silent(now) and now - self._health.started_ns > SILENT_NS
            if silent and source.name not in self._silent and source.failed_ns is None:
                self._silent[source.name] = source.last_ns or self._health.started_ns
                (fallen_silent if source.frames else never_sent).append(source.name)
            elif not silent and source.state == "open" and source.name in self._silent:
                gaps_s[source.name] = ((source.last_ns or now) - self._silent.pop(source.name)) / 1e9
        self._note_silent_sources(never_sent, "has said nothing yet", "have said nothing yet")
        self._note_silent_sources(fallen_silent, "has fallen silent", "have fallen silent")
        gap = f"{max(gaps_s.values(), default=0.0):.1f} s"
        self._note_silent_sources(list(gaps_s), f"is heard again after {gap}", f"are heard again after up to {gap}")

    def _note_silent_sources(self, names: list[str], verb: str, verb_of_several: str) -> None:
        if len(names) == 1:
            self._note("warning", f"source {names[0]!r} {verb}")
        elif names:
            self._note("warning", f"{len(names)} sources {verb_of_several}: {', '.join(names)}")


def copy_part_verified(path: Path, folder: Path, pause: Pause = lambda: None) -> Path:
    """Copy a finished part to ``folder``, under the same name once it has been read back and is the same.

    Another file of that name is moved aside. Raises :class:`StorageError` where the folder is not there, the disk
    fails, or the copy is not the same.
    """
    copy, partial = folder / path.name, folder / f".{path.name}.part"
    if not folder.is_dir():
        raise StorageError("does not exist", where=str(folder), fix="mount the disk and make the folder")
    if path.exists() and writer.free_and_total_bytes(folder)[0] < path.stat().st_size:
        raise StorageError("cannot be written: the disk is full", where=str(copy), fix="make room on that disk")
    try:
        with path.open("rb") as source, partial.open("wb") as target:
            while piece := source.read(_PIECE_BYTES):
                target.write(piece)
                pause()
            target.flush()
            os.fsync(target.fileno())
        shutil.copystat(path, partial)
        is_same = have_same_content(path, partial, pause)
        if is_same and copy.exists():
            copy.rename(writer.new_mcap_file(folder, f"{copy.stem}_other"))
        if is_same:
            partial.replace(copy)
            writer.sync_folder(folder)
    except OSError as error:
        raise storage_error(copy, error) from error
    finally:
        partial.unlink(missing_ok=True)
    if not is_same:
        raise StorageError("reads back differently from what was written", where=str(copy), fix="check the disk")
    return copy


def have_same_content(path_a: Path, path_b: Path, pause: Pause = lambda: None) -> bool:
    """Whether two files, not one under two names, have the same content on disk; False if one does not exist."""
    try:
        may_be_same = path_a.stat().st_size == path_b.stat().st_size and not path_a.samefile(path_b)
        return may_be_same and _content_digest(path_a, pause) == _content_digest(path_b, pause)
    except OSError:
        return False


def _content_digest(path: Path, pause: Pause) -> bytes:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        os.fsync(stream.fileno())
        os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)  # from the disk, not from memory
        while piece := stream.read(_PIECE_BYTES):
            digest.update(piece)
            pause()
    return digest.digest()


def require_separate_folder(settings: CopiesSection, folder: Path) -> None:
    """Raise :class:`ConfigurationError` where the copies would be the recordings themselves."""
    if settings.folder.resolve() == folder.resolve():
        section, fix = f"[copies] {settings.folder}", "name a folder on another disk"
        raise ConfigurationError("is the folder of the recordings", where=section, fix=fix)


class _EndedError(Exception):
    """The recording is over, and so is the time for copies."""


class Copies:
    """The copies of one trial's recordings in ``folder``, kept up while ``parts`` are written.

    A fault is reported once, and copying tried again.
    """

    def __init__(self, settings: CopiesSection, folder: Path, trial: str, parts: RecordingParts) -> None:
        self._target, self._keep_gb = settings.folder, settings.keep_gb
        self._folder, self._trial, self._parts = folder, trial, parts
        self.state = CopyState()
        self._sizes: dict[Path, int] = {}
        self._mount = writer.mount_point(settings.folder)
        self._ending, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._copy_until_ended, name="copies", daemon=True)

    def start(self) -> bool:
        """Begin in a thread of its own; False where the system gives none."""
        return process.start_thread_if_possible(self._thread)

    def stop(self) -> None:
        """Copy what the recording has ended with, as far as that can be done soon; the next recording goes on."""
        self._parts.tell = lambda level, text: getattr(LOG, level)(text)  # the recording is closed
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join(_LONGEST_FINISH_S)
            self._ended.set()
            self._thread.join(_LONGEST_STOP_S)  # no longer: a disk that hangs must not block the end

    def _copy_until_ended(self) -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _PRIORITY)
        with suppress(_EndedError):
            while not self._ending.wait(_TRY_AGAIN_S if self.state.trouble else _LOOK_EVERY_S):
                self.copy_new_parts()
            self.copy_new_parts(everything=True)

    def _pause_between_blocks(self) -> None:
        if self._ended.wait(_PAUSE_S):
            raise _EndedError

    def copy_new_parts(self, *, everything: bool = False) -> None:
        """Copy what has not grown since the last call (``everything``: that too), and make room."""
        current = None if self._parts.paused else self._parts.path
        try:
            writer.require_still_mounted(self._mount)
            named = recording_parts_in_folder(self._folder, self._trial)
            # and those that a file system gave another name
            recorded = [*named, *(path for path in self._parts.paths if path not in named and path.exists())]
            sizes = {path: path.stat().st_size for path in recorded}
            finished = [path for path, size in sizes.items()
                        if path != current and (everything or self._sizes.get(path) == size)]  # fmt: skip
            self._sizes = sizes
            missing = []
            for path in finished:
                copy = self._target / path.name
                if not copy.exists() or copy.stat().st_size != path.stat().st_size or copy.samefile(path):
                    missing.append(path)
            self.state.waiting = len(missing)
            for path in missing:
                copy_part_verified(path, self._target, self._pause_between_blocks)
                self.state.waiting -= 1
            self._delete_oldest_copies(finished, sum(sizes.values()))
        except _EndedError:
            raise
        except Exception as error:  # nothing that happens to a copy ends the copying
            if not self.state.trouble:
                self._parts.tell("error", f"no copies for now: {error}")
            self.state.trouble = str(error)
            return
        if self.state.trouble:
            self.state.trouble = ""
            self._parts.tell("warning", f"copies to {self._target} go on; nothing is missing there")

    def _delete_oldest_copies(self, finished: list[Path], size: int) -> None:
        """Delete the oldest parts beyond what is to be kept, each once its copy has been read again."""
        for path in finished:
            if self._keep_gb is None or size <= self._keep_gb * _GIGA:
                return
            if not have_same_content(path, self._target / path.name, self._pause_between_blocks):
                copy_part_verified(path, self._target, self._pause_between_blocks)
            size -= path.stat().st_size
            path.unlink()
            self._parts.tell("info", f"{path.name} is deleted here; its copy in {self._target} is verified")
