"""Alarms by rule: once a second the recorder's figures against their limits, in a thread of its own.

An alarm is an event of the recording, a line of the log, red on the terminal with its bell, and a command of the
user's. The thread also looks, now and then, at who keeps the computer's clock.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches

from seatrial.acquisition.config.sections import AlarmSection
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.logger.health import Health
from seatrial.acquisition.logger.host_clock import host_clock
from seatrial.acquisition.logger.supervision import LOG
from seatrial.acquisition.recording.parts import Tell

_LOOK_EVERY_S = 1.0
_CLOCK_EVERY_S = 30.0
_LONGEST_COMMAND_S = 60.0
_MOST_COMMANDS = 8


def check_alarms(rules: Iterable[AlarmSection], health: Health) -> None:
    """Raise :class:`ConfigurationError` for a rule whose figure there is not."""
    figures = list(health.figures(time.monotonic_ns()))
    for rule in rules:
        if rule.figure not in figures:
            near = get_close_matches(rule.figure, figures, n=3) or [
                figure for figure in figures if rule.figure in figure
            ]
            near = near[:3] or figures[:8]
            raise ConfigurationError(
                f"unknown figure {rule.figure!r}", where=f"alarm {rule.name!r}", fix=f"say {' or '.join(near)}"
            )


@dataclass(slots=True)
class Alarm:
    """One rule, and since when what it says has been otherwise than what was told [s]."""

    rule: AlarmSection
    raised: bool = False
    since_s: float | None = None

    def look(self, value: float, now_s: float) -> bool:
        """Whether the alarm is raised, or over, by this value; one that is not known changes nothing."""
        rule = self.rule
        outside = (rule.above is not None and value > rule.above) or (rule.below is not None and value < rule.below)
        if math.isnan(value) or outside == self.raised:
            self.since_s = None
            return False
        if self.since_s is None:
            self.since_s = now_s
        if now_s - self.since_s < rule.for_s:
            return False
        self.raised, self.since_s = outside, None
        return True

    def text(self, value: float) -> str:
        """What there is to say, for people."""
        rule = self.rule
        limits = {"above": rule.above, "below": rule.below}
        bounds = " or ".join(f"{word} {limit:g}" for word, limit in limits.items() if limit is not None)
        return f"{rule.name}: {rule.figure} is {value:.4g}, {'' if self.raised else 'no more '}{bounds}"


class Alarms:
    """The alarms of one recording in progress; a context manager."""

    def __init__(self, rules: Iterable[AlarmSection], health: Health, tell: Tell) -> None:
        self._alarms = [Alarm(rule) for rule in rules]
        self._health, self._tell = health, tell
        self._commands: list[tuple[str, float, subprocess.Popen[bytes]]] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="alarms", daemon=True)

    def __enter__(self) -> Alarms:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()

    def _work(self) -> None:
        clock_s = -math.inf
        while not self._stopping.wait(_LOOK_EVERY_S):
            now_s = time.monotonic()
            try:
                if now_s - clock_s >= _CLOCK_EVERY_S:
                    clock_s = now_s
                    self._health.clock = host_clock()
                if self._alarms:
                    self.look(self._health.figures(time.monotonic_ns()), now_s)
                self._reap(now_s)
            except (OSError, RuntimeError) as error:  # no descriptor, no thread: the next look is in a second
                LOG.warning("the alarms could not be looked at: %s", error)
        self._reap(time.monotonic())
        self._leave()

    def look(self, figures: Mapping[str, float], now_s: float) -> None:
        for alarm in self._alarms:
            value = figures.get(alarm.rule.figure, math.nan)
            if alarm.look(value, now_s):
                self._change(alarm, alarm.text(value), now_s)

    def _change(self, alarm: Alarm, text: str, now_s: float) -> None:
        name = alarm.rule.name
        if alarm.raised:
            self._health.alarms[name] = text
            self._tell("error", f"ALARM {text}")
            _ring()
        else:
            self._health.alarms.pop(name, None)
            self._tell("warning", f"alarm over: {text}")
        if alarm.rule.command:
            self._run(alarm, text, now_s)

    def _run(self, alarm: Alarm, text: str, now_s: float) -> None:
        name, state = alarm.rule.name, "raised" if alarm.raised else "over"
        if len(self._commands) >= _MOST_COMMANDS:
            self._tell("error", f"alarm {name}: its command is not run, {_MOST_COMMANDS} others have not ended")
            return
        variables = {"SEATRIAL_ALARM": name, "SEATRIAL_STATE": state, "SEATRIAL_TEXT": text}
        try:
            process = subprocess.Popen(
                alarm.rule.command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                env={**os.environ, **variables}, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._tell("error", f"alarm {name}: its command cannot be run: {error.strerror}")
            return
        with suppress(OSError):
            if process.stdin is not None:
                process.stdin.write(f"{text}\n".encode())  # less than a pipe holds
                process.stdin.close()
        self._commands.append((name, now_s, process))

    def _reap(self, now_s: float) -> None:
        """Tell of commands that have failed, and end those that do not end."""
        running = []
        for name, began_s, process in self._commands:
            if process.poll() is None and now_s - began_s > _LONGEST_COMMAND_S:
                process.kill()
                self._tell("error", f"alarm {name}: its command has not ended in {_LONGEST_COMMAND_S:g} s")
            elif process.returncode is None:
                running.append((name, began_s, process))
            elif process.returncode:
                self._tell("error", f"alarm {name}: its command ended with {process.returncode}")
        self._commands = running

    def _leave(self) -> None:
        """Leave the commands that still run to end by themselves, each with a thread that takes its exit status."""
        for _, _, process in self._commands:
            with suppress(RuntimeError):  # no thread: the system takes the status once the recorder has ended
                threading.Thread(target=process.wait, name="alarm command", daemon=True).start()
        self._commands = []


def _ring() -> None:
    """The bell of the terminal, if there is one."""
    if sys.stderr.isatty():
        with suppress(OSError):
            sys.stderr.write("\a")
            sys.stderr.flush()
