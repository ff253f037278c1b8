"""Writes a recording in parts: the next begins after a time or a size, after a disk fault, or a clock's step.

Every part is a complete recording of its own. What the disk has not confirmed yet is kept, and goes into the next
part when this one cannot be written any more, so that a disk fault costs nothing that memory can hold.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from errno import EILSEQ, EINVAL, ENAMETOOLONG
from hashlib import sha256
from pathlib import Path

from seatrial.acquisition.config.sources import RecordingSection
from seatrial.acquisition.core.errors import SeatrialError, StorageError, storage_error
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording import messages, writer

_MEGA = 1_000_000
_CHECK_PERIOD_S = 1.0
_MOST_UNSURE = 100_000  # messages that wait for the disk; about 30 MB
_NAME_REFUSED = {EILSEQ, EINVAL, ENAMETOOLONG}  # by a file system that takes other letters, or fewer
_TIME_FORMAT = "%Y%m%dT%H%M%SZ"
_TIME = r"\d{8}T\d{6}Z"
_MOST_LETTERS = 40  # of a trial's name in that of a file: with all that follows, some 100, of 255 bytes
_DIGEST_LETTERS = 7

Message = tuple[str, bytes, int, int]
Tell = Callable[[str, str], None]
"""Takes reports of what happens to the recording: level, text."""
Listener = Callable[[str, bytes, int], None]
"""Takes every message as well: topic, JSON, time of reception; must be quick and raise nothing."""


class RecordingParts(messages.MessageSink):
    """One recording as one or more files in ``folder``. For one thread only.

    The first file is created at once; raises :class:`StorageError` if that cannot be done. Whatever fails later
    pauses the recording (``trouble`` says why) and is tried again every second.
    """

    def __init__(
        self,
        folder: Path,
        trial: Trial,
        attachments: Mapping[str, bytes],
        settings: RecordingSection,
        clock: Mapping[str, str] | None = None,
        tell: Tell = lambda level, text: None,
    ) -> None:
        self.paths: list[Path] = []
        self.trouble = ""
        self.listeners: list[Listener] = []
        self.sample_listeners: list[Callable[[Sample], None]] = []  # must be quick and raise nothing
        self._reported_deleted = False
        self.lost = 0  # messages that no disk and no memory could hold
        self._folder, self._trial, self._attachments, self._settings = folder, trial, dict(attachments), settings
        self._clock = dict(clock or {})
        self.tell = tell
        self._stem = _file_stem_for_start(folder, trial.name, datetime.now(UTC))
        self._thread, self._thread_missing = writer.SyncThread(), False
        self._not_ended: list[writer.RecordingWriter] = []  # parts that the disk did not even let us end
        self._unsure: list[Message] = []
        self._unkept = 0  # as unsure, but too many to be kept
        self._requested = 0, 0  # of both, how many the disk was asked to keep
        self._closed_bytes = 0  # in the parts before
        self._checked_s = self._began_s = time.monotonic()
        self._part: writer.RecordingWriter | None = None
        self._mount: Path | None = None
        try:
            writer.require_disk_space(folder, settings)
            self._open_part("recording started")
            self._mount = writer.mount_point(folder)
        except OSError as error:
            place = folder / f"{self._stem}.mcap"
            raise error if isinstance(error, StorageError) else storage_error(place, error) from error

    @property
    def path(self) -> Path:
        """The part that is being written, or was last."""
        return self.paths[-1]

    @property
    def paused(self) -> bool:
        """Whether nothing is written at the moment; ``trouble`` says why."""
        return self._part is None

    @property
    def written_bytes(self) -> int:
        """How much was written, in all parts [bytes]."""
        return self._closed_bytes + (0 if self._part is None else self._part.size_bytes)

    @property
    def room_bytes(self) -> int | None:
        """What may still be written to this disk [bytes]; None if the disk cannot be asked."""
        return writer.remaining_bytes(self._folder, self._settings)

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Record a message; while the recording is paused it waits in memory, as long as there is room."""
        if len(self._unsure) < _MOST_UNSURE:
            self._unsure.append((topic, data, log_ns, publish_ns))
        else:
            self._unkept += 1
        if self._part is not None:
            self._part.write(topic, data, log_ns, publish_ns)
        if self.listeners:
            self._notify_listeners(topic, data, log_ns)

    def write_sample(self, sample: Sample) -> None:
        super().write_sample(sample)
        for listener in self.sample_listeners:
            listener(sample)

    def _notify_listeners(self, topic: str, data: bytes, log_ns: int) -> None:
        for listener in tuple(self.listeners):
            try:
                listener(topic, data, log_ns)
            except Exception as error:  # a viewer's server must not cost the recording
                self.listeners.remove(listener)
                text = f"a listener to the recording failed and gets nothing more: {_error_type_and_message(error)}"
                self.tell("error", text)

    def write_trial(self, trial: Trial) -> None:
        self._trial = trial
        if self._part is not None:
            self._part.write_trial(trial)

    def set_clock(self, clock: Mapping[str, str], reason: str) -> None:
        """Begin a new part, whose times are by another clock; its name goes on, so that parts sort as they came."""
        self._clock = dict(clock)
        self.begin_next_part(reason)

    def flush(self) -> None:
        """Hand what there is to the system."""
        if self._part is not None:
            self._try_disk_action(self._part.flush)

    def sync(self) -> None:
        """Make the disk keep what there is."""
        if self._part is not None and self._try_disk_action(self._part.sync):
            self._set_everything_synced()

    def sync_in_background(self) -> bool:
        """Let the disk keep what there is while the recording goes on; False while it is still busy."""
        requested = self._requested
        if self._part is not None:
            self._try_disk_action(self._begin_sync)
        return self._requested is not requested

    def _begin_sync(self) -> None:
        unsure = len(self._unsure), self._unkept
        if self._part is not None and self._part.begin_sync():
            confirmed, confirmed_unkept = self._requested  # what was asked for the last time is on the disk
            del self._unsure[:confirmed]
            self._unkept -= confirmed_unkept
            self._requested = unsure[0] - confirmed, unsure[1] - confirmed_unkept

    def check_limits(self, now_s: float) -> None:
        """Once a second: the size and age of the part, room on the disk, and whether a pause can end."""
        if now_s - self._checked_s < _CHECK_PERIOD_S:
            return
        self._checked_s = now_s
        missing, before = self._thread.refused, self._thread_missing
        self._thread_missing = missing
        if missing and not before:
            self.tell("warning", "the system gives no thread for the disk: a slow disk holds up the recorder")
        elif before and not missing:
            self.tell("info", "the disk has a thread again")
        if self._part is None:
            self.resume_if_possible()
        elif not self._try_disk_action(lambda: writer.require_still_mounted(self._mount)):
            return
        elif self._has_vanished():
            self._rewrite_deleted_part()
        elif (reason := writer.why_disk_is_full(self._folder, self._settings)) and self._close_part():
            self._pause(reason, "the file is closed well")
        elif self._part is not None and self._part_is_full(now_s):
            self.begin_next_part("the part is full")

    def begin_next_part(self, reason: str) -> None:
        """Close this part and open the next; nothing that is written gets lost between them."""
        if self._part is not None and self._close_part():
            self._try_to_open_part(reason)

    def resume_if_possible(self) -> None:
        """End a pause, if its cause is gone."""
        reason = self.trouble
        if self._part is not None or writer.why_disk_is_full(self._folder, self._settings, writer.RESUME_RATIO):
            return
        self._try_to_open_part(f"after a pause: {reason}")
        if self._part is not None:
            self.tell("warning", f"recording goes on in {self.path.name}, after: {reason}")

    def delete_everything_written(self) -> None:
        """Leave nothing behind: the recording never began."""
        if self._part is not None:
            _abandon_part(self._part)
            self._part = None
        for path in self.paths:
            _remove_file_if_possible(path)
        self._thread.stop()

    def close(self) -> None:
        """Close the last part. Raises :class:`StorageError` when messages could not be written."""
        if self._part is None and (self._unsure or self.lost):
            self.resume_if_possible()
        if self._part is not None and self._has_vanished():
            self._rewrite_deleted_part()
            if self._part is not None and self._part.has_vanished:
                self.lost += self._part.messages
        if self._part is not None:
            self._close_part()
        self._thread.stop()
        if unwritten := len(self._unsure) + self._unkept + self.lost:
            what = f"{unwritten:,} messages could not be written"
            fix = "earlier data are safe; free space or mount the disk before the next recording"
            raise StorageError(what, where=str(self.path), why=self.trouble, fix=fix)

    def _open_part(self, reason: str) -> None:
        path = self._new_part_path()
        try:
            part = writer.RecordingWriter(path, self._trial, self._attachments, self._thread)
        except Exception:
            _remove_file_if_possible(path)
            raise
        try:
            before = self.paths[-1].name if self.paths else ""
            number = str(len(self.paths) + 1)
            part.write_metadata("part", {"number": number, "follows": before, "reason": reason})
            if self._clock:
                part.write_metadata("clock", self._clock)
            for message in self._unsure:
                part.write(*message)
            part.sync()
        except Exception:
            _abandon_part(part)
            _remove_file_if_possible(path)
            raise
        self.lost += self._unkept
        self._set_everything_synced()
        self._part = part
        self.paths.append(path)
        self.trouble = ""
        self._began_s = time.monotonic()
        for unended in self._not_ended:  # what a failing disk had not confirmed of them is in this one
            with suppress(OSError):
                unended.end_abandoned_file()
        self._not_ended.clear()

    def _new_part_path(self) -> Path:
        part = f"_part{len(self.paths) + 1:05d}" if self.paths else ""
        try:
            return self._new_file(self._stem + part)
        except OSError as error:
            if error.errno not in _NAME_REFUSED:
                raise
        self._stem = f"recording_{datetime.now(UTC):{_TIME_FORMAT}}"
        return self._new_file(self._stem + part)

    def _new_file(self, stem: str) -> Path:
        writer.require_still_mounted(self._mount)
        return writer.new_mcap_file(self._folder, stem)

    def _part_is_full(self, now_s: float) -> bool:
        minutes, size_mb = self._settings.split_minutes, self._settings.split_mb
        too_old = minutes is not None and now_s - self._began_s >= 60.0 * minutes
        return too_old or (
            size_mb is not None and self._part is not None and self._part.size_bytes >= size_mb * _MEGA
        )

    def _try_disk_action(self, action: Callable[[], None]) -> bool:
        """Do something with the disk; whatever it raises ends the part and pauses the recording."""
        try:
            action()
        except Exception as error:  # nothing but the user ends a recording
            ended = True
            if self._part is not None and not _abandon_part(self._part):
                ended = False
                self._not_ended.append(self._part)
            self._part, self._requested = None, (0, 0)
            outcome = "the file is ended well" if ended else "the file is readable as far as it goes"
            self._pause(_error_type_and_message(error), outcome)
            return False
        return True

    def _close_part(self) -> bool:
        if self._part is None or not self._try_disk_action(self._part.close):
            return False
        self._closed_bytes += self._part.size_bytes
        self._set_everything_synced()
        self._part = None
        return True

    def _set_everything_synced(self) -> None:
        """The disk has everything that was written."""
        self._unsure.clear()
        self._unkept, self._requested = 0, (0, 0)

    def _has_vanished(self) -> bool:
        vanished = False

        def check_deleted() -> None:
            nonlocal vanished
            vanished = self._part is not None and self._part.has_vanished

        return self._try_disk_action(check_deleted) and vanished

    def _rewrite_deleted_part(self) -> None:
        """The file was deleted: its content is still there, and is written once more.

        Where there is no room for that, the deleted file goes on being written, and it is tried again.
        """
        if self._part is None:
            return
        name = self._part.path.stem
        try:
            path = self._new_file(name)
            self._part.rewrite_deleted_file(path)
        except OSError as error:
            if not self._reported_deleted:
                text = f"{name}.mcap was deleted while it was written and cannot be put back yet: {error}"
                self.tell("error", text)
            self._reported_deleted = True
            return
        self.tell("error", f"{name}.mcap was deleted while it was written; it is put back as {path.name}")
        self.paths[-1] = path
        self._closed_bytes += self._part.size_bytes
        self._reported_deleted, self._part = False, None
        self._set_everything_synced()
        self._try_to_open_part("the part before was deleted")

    def _pause(self, reason: str, outcome: str) -> None:
        self.trouble = reason
        self.tell("error", f"RECORDING PAUSED: {reason}; {outcome}; it goes on as soon as it can")

    def _try_to_open_part(self, reason: str) -> None:
        try:
            self._open_part(reason)
        except Exception as error:  # nothing but the user ends a recording
            if not self.trouble:
                self._pause(_error_type_and_message(error), "nothing of it is lost while memory holds it")


def _error_type_and_message(error: Exception) -> str:
    if isinstance(error, SeatrialError):
        return str(error)
    if isinstance(error, OSError):
        return str(error.strerror or error)
    return f"{type(error).__name__} {error}"


def _abandon_part(part: writer.RecordingWriter) -> bool:
    """Give up on a part; returns whether it could be ended well."""
    try:
        return part.abandon()
    except Exception:  # such as no memory: the disk is not all that can fail
        return False


def _remove_file_if_possible(path: Path) -> None:
    with suppress(OSError):
        path.unlink(missing_ok=True)


def safe_file_name(name: str) -> str:
    """A trial's name, fit for that of a file; what makes it too long is replaced by its digest."""
    letters = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)
    if len(letters) <= _MOST_LETTERS:
        return letters
    digest = sha256(name.encode(errors="surrogatepass")).hexdigest()[:_DIGEST_LETTERS]
    return f"{letters[: _MOST_LETTERS - _DIGEST_LETTERS - 1]}_{digest}"


def recording_parts_in_folder(folder: Path, name: str) -> dict[Path, str]:
    """The files of a trial's recordings in a folder, in the order of their names, and the stem of each's parts."""
    stem = rf"{re.escape(safe_file_name(name))}_{_TIME}(?:_then_{_TIME})*(?:_run\d+_{_TIME})?"  # _then_: until 2026
    pattern = re.compile(rf"({stem})(?:_part\d+)?(?:_\d+)?\.mcap")
    matches = ((path, pattern.fullmatch(path.name)) for path in sorted(folder.glob("*.mcap")))
    return {path: match[1] for path, match in matches if match}


def _file_stem_for_start(folder: Path, name: str, started: datetime) -> str:
    """The trial's name and the UTC time of the recording's start: names sort as the recordings came.

    Where the clock is behind a recording in the folder, as without a battery after each boot, the name is that
    recording's with a number that counts the starts since, and the time.
    """
    time_text = f"{started:{_TIME_FORMAT}}"
    stem = f"{safe_file_name(name)}_{time_text}"
    try:
        stems = recording_parts_in_folder(folder, name).values()
    except OSError:  # a folder that cannot be listed may still be written to
        return stem
    latest = max(stems, default="")
    if stem > latest:
        return stem
    match = re.match(rf".*?_{_TIME}", latest)
    base = match[0] if match else latest
    runs = (re.match(rf"{re.escape(base)}_run(\d+)_", existing) for existing in stems)
    number = 1 + max((int(run[1]) for run in runs if run), default=0)
    return f"{base}_run{number:05d}_{time_text}"
