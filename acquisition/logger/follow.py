"""What a recorder writes, followed from outside: through all parts, and from one recording to the next."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

from seatrial.acquisition.core.arrays import Series
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.logger.requests import RecorderState, running_recorders
from seatrial.acquisition.recording.grouping import PartClock
from seatrial.acquisition.recording.parts import Tell
from seatrial.acquisition.recording.tail import Tail

_QUIET_S = 1.0  # after so long without anything new the recorder is asked what it writes
_ASK_EVERY_S, _ASK_SOON_S = 1.0, 0.1  # the latter where a part has just come to its end


@dataclass(frozen=True, slots=True)
class NewSamples:
    """The samples that are new, by channel, in pieces as they were written.

    ``anew`` says that nothing before them belongs to them: another recording, or another clock. ``again`` says
    that part of them may have been there before, as the recorder had to give a file up.
    """

    samples: list[dict[str, Series]] = field(default_factory=list)
    anew: bool = False
    again: bool = False


def choose_recorder(
    recorders: list[tuple[Path, RecorderState]], trial: str, configuration: Path
) -> tuple[Path, RecorderState] | None:
    """The recorder of a trial: of several the one with the same configuration file, then the one begun last."""
    fitting = [recorder for recorder in recorders if recorder[1].trial == trial]
    same_configuration = [recorder for recorder in fitting if Path(recorder[1].configuration) == configuration]
    return max(
        same_configuration or fitting,
        key=lambda recorder: recorder[0].stem.rpartition("-")[2].zfill(16),
        default=None,
    )


def no_recorder_text(recorders: list[tuple[Path, RecorderState]], trial: str) -> str:
    """Why there is nobody to follow, in words."""
    running = ", ".join(f"{state.trial!r} ({state.configuration})" for _, state in recorders)
    remark = f"; what runs is the recorder of {running}" if running else ""
    return f"no recorder of the trial {trial!r} runs here{remark}; waiting for one"


class Follower:
    """Follows the recorder of one trial; to be closed. Nothing it does can hold up the recorder.

    ``recent_s`` is how much of a recording is wanted of what was there before. ``recorder`` is whom it follows, and
    the socket it can be spoken to by; ``trial`` and ``clock`` are those of the part that is read.
    """

    def __init__(
        self, trial: str, configuration: Path, recent_s: float, tell: Tell, folder: Path | None = None
    ) -> None:
        self.recorder: tuple[Path, RecorderState] | None = None
        self.trial = Trial()
        self._name, self._configuration, self._recent_s = trial, configuration.absolute(), recent_s
        self._tell, self._folder = tell, folder
        self._tail: Tail | None = None
        self._last_text = ""
        self._asked_s = self._heard_s = -_QUIET_S

    @property
    def utc_ns(self) -> int:
        """This moment by the clock of the recording [ns]: the host's clock as the part's beginning found it."""
        offset_ns = None if self._tail is None else PartClock.of(self._tail.metadata).offset_ns
        return time.time_ns() if offset_ns is None else time.monotonic_ns() + offset_ns

    @property
    def path(self) -> Path | None:
        """The part that is read."""
        return None if self._tail is None else self._tail.path

    def news(self) -> NewSamples:
        """What has come since the last time."""
        pieces, now_s = self._read(), time.monotonic()
        if pieces:
            self._heard_s = now_s
            return NewSamples(pieces)
        over = self._tail is not None and (self._tail.ended or self._tail.cut)
        quiet = now_s - self._heard_s >= _QUIET_S
        if (over or quiet) and now_s - self._asked_s >= (_ASK_EVERY_S if quiet else _ASK_SOON_S):
            self._asked_s = now_s
            return self._go_on()
        return NewSamples()

    def close(self) -> None:
        if self._tail is not None:
            self._tail.close()

    def _read(self) -> list[dict[str, Series]]:
        if self._tail is None:
            return []
        try:
            samples = self._tail.read()
        except InputError as error:
            self._say("warning", str(error))
            return []
        self.trial = self._tail.trial
        return [samples] if samples else []

    def _go_on(self) -> NewSamples:
        recorders = running_recorders(self._folder)
        self.recorder = choose_recorder(recorders, self._name, self._configuration)
        if self.recorder is None:
            self._say("info", no_recorder_text(recorders, self._name))
            return NewSamples(self._read())
        running = self.recorder[1]
        path = Path(running.recording)
        if self.path == path:
            if running.paused:
                self._say("warning", f"the recorder writes nothing at the moment to {path.name}")
            return NewSamples(self._read())
        return self._change_to(path)

    def _change_to(self, path: Path) -> NewSamples:
        """Read the rest of this part and go over to the next, or to another recording."""
        remaining, before = self._read(), self._tail
        try:
            self._tail = Tail(path, self._recent_s)
        except InputError as error:  # deleted, or not there yet
            self._say("warning", str(error))
            return NewSamples(remaining)
        first = self._read()
        follows = before is not None and _follows(self._tail, before)
        again = before is not None and before.cut
        if before is not None:
            before.close()
        self._say("info", f"following {path.name}{'' if follows else ', from its last minutes on'}")
        self._heard_s = time.monotonic()
        return NewSamples(remaining + first, again=again) if follows else NewSamples(first, anew=True)

    def _say(self, level: str, text: str) -> None:
        """Tell what is new, once."""
        if text != self._last_text:
            self._last_text = text
            self._tell(level, text)


def _follows(part: Tail, before: Tail) -> bool:
    """Whether a part goes on where another ended: the same recording and, as far as they tell, the same clock."""
    if part.metadata.get("part", {}).get("follows") != before.path.name:
        return False
    return not PartClock.of(part.metadata).is_another_than(PartClock.of(before.metadata))
