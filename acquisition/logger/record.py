"""Makes one recording from start to end (``seatrial record``): live, with display and marks, or from log files.

Log files are read without threads, as fast as the disk allows, in the order of their own times. A recording in
progress is shown on the terminal, with its keys and summary, in a live view and on a status page.

The live view serves Foxglove and Lichtblick over a WebSocket. It gets every message after the recorder has written
it and passes it to the server's own threads; what a viewer that is too slow loses is counted (:mod:`.viewers`). Raw
input is not served: nobody looks at it, and it is most of the load. The package's server answers any client, so it
listens where only :class:`WebFront` finds it, which passes on those that are entitled.

The status page is what the terminal shows, as a page that refreshes itself and as JSON. It is read-only: GET of two
paths, bound to 127.0.0.1, and not for requests under another name (a page elsewhere could have its name point
here).
"""

from __future__ import annotations

import heapq
import html
import io
import itertools
import os
import secrets
import socket
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from http import HTTPStatus
from ipaddress import IPv4Address
from operator import attrgetter
from pathlib import Path
from typing import Any

import orjson
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from seatrial.acquisition.config.sources import FILE_SOURCES, LiveSection, StatusSection
from seatrial.acquisition.config.trial_file import TrialConfig
from seatrial.acquisition.core import errors, process, result, ship
from seatrial.acquisition.core.trial import NANO, Frame, Trial, iso_utc, wall_and_monotonic_ns
from seatrial.acquisition.logger import health as monitoring
from seatrial.acquisition.logger import maintenance, pipeline, requests, sinks, survey, viewers
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.protocols import BAD_DATA
from seatrial.acquisition.recording.messages import ENCODING, RAW_PREFIX, channel_metadata, message_kind_of_topic
from seatrial.acquisition.recording.parts import RecordingParts, Tell
from seatrial.acquisition.sources import Source, make_source

_UNIT_FROM_COLUMNS = 86  # the names end with the unit anyhow
_STATE_STYLES = {
    "opening": "yellow", "open": "green", "silent": "yellow", "failed": "bold red", "hanging": "bold red",
    "ended": "dim",
}  # fmt: skip
_GRADE_STYLES = {"good": "green", "slow": "yellow", "silent": "bold red", "none": "yellow"}
_LEVEL_STYLES = {"info": "dim", "warning": "yellow", "error": "bold red"}
_SHORT_TIME_S = 3600.0
COUNTED_KEYS = (" ", "m")

_BACKLOG = 4096  # messages that may wait in the package's server, which is read at once
_COLUMNS, _ROWS = 120, 60
_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="2"><title>{title}</title>
<style>body {{ color: #000; background: #fff }} pre {{ font-family: monospace; font-size: 14px }}</style></head>
<body><pre>{body}</pre></body></html>
"""
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'",
    "X-Content-Type-Options": "nosniff",
}


@dataclass(frozen=True, slots=True)
class Picture:
    """Everything worth seeing, drawn again each time; ``expected`` are the channels that a source provides.

    What does not fit is dropped in this order: words from the right, the unit column, events from the oldest.
    ``marks`` are the keys that set marks; None where there is no keyboard.
    """

    health: monitoring.Health
    expected: frozenset[str]
    marks: Mapping[str, str] | None

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        health, now_ns = self.health, time.monotonic_ns()
        paused = ("■ PAUSED, NOTHING IS WRITTEN ", "bold white on red")
        elapsed = (_elapsed_time_text((now_ns - health.started_ns) // NANO), "bold")
        state = paused if health.trouble else ("● REC ", "bold red")
        yield _one_line_text(state, elapsed, f"  {health.samples:,} samples  {health.part}")
        yield _status_line(health, self.marks)
        clock = "yellow" if health.clock.state == "free-running" else "dim"
        parts = [] if health.clock.state == "unknown" else [(f"clock {health.clock}", clock)]
        if health.copies.trouble:
            parts.append((f"  no copies: {health.copies.trouble}", "bold red"))
        elif health.copies.waiting:
            parts.append((f"  {health.copies.waiting} parts to copy", "dim"))
        remarks = [_one_line_text(*parts)] if parts else []
        remarks += [
            _one_line_text((f"ALARM {text}", "bold white on red")) for text in tuple(health.alarms.values())
        ]
        yield from remarks
        yield _channel_table(health, self.expected, now_ns, options.max_width)
        yield _source_table(health, now_ns)
        used_rows = 2 + len(remarks) + 1 + len(health.names) + 1 + len(health.sources) + len(health.sinks)
        free_rows = (options.height or console.height) - used_rows - 1  # the cursor needs a line of its own
        for time_ns, level, text in health.events.newest(free_rows):
            moment, line = datetime.fromtimestamp(time_ns // 10**9, UTC), text.replace("\n", r"\n")
            yield _one_line_text((f"{moment:%H:%M:%SZ} {line}", _LEVEL_STYLES.get(level, "")))


def _one_line_text(*parts: str | tuple[str, str]) -> Text:
    return Text.assemble(*errors.escape_control_characters(parts), no_wrap=True, overflow="ellipsis")


def _status_line(health: monitoring.Health, marks: Mapping[str, str] | None) -> Text:
    if health.trouble:
        return _one_line_text((health.trouble, "bold red"))
    disk, style, remaining_s = "disk ?", "yellow", health.seconds_left
    if health.free_bytes is not None:
        disk, style = f"disk {health.free_bytes / 1e9:.1f} GB left", "green"
    if remaining_s is not None:
        disk += f", {_duration_text(remaining_s)} at {health.bytes_per_s / 1e3:.0f} kB/s"
        style = "bold red" if remaining_s < _SHORT_TIME_S else "green"
    keys = ", ".join([*(f"{key} {text}" for key, text in (marks or {}).items()), "m a mark"])
    return _one_line_text(
        (disk, style),
        ("" if marks is None else f"  Ctrl-C ends; {keys}", "dim"),
        (f"  {health.marks} mark{'' if health.marks == 1 else 's'}", "dim"),
    )


def _duration_text(seconds: float) -> str:
    """A duration in its two largest units.

    >>> _duration_text(200_000.0)
    '2 d 7 h'
    """
    if seconds >= 365 * 86_400:
        return "over a year"
    days, hours, minutes = int(seconds // 86_400), int(seconds // 3600 % 24), int(seconds // 60 % 60)
    return f"{days} d {hours} h" if days else f"{hours} h {minutes} min"


def _elapsed_time_text(seconds: int) -> str:
    return f"{seconds // 3600:d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def _channel_table(health: monitoring.Health, expected: frozenset[str], now_ns: int, width: int) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    with_unit = width >= _UNIT_FROM_COLUMNS
    table.add_column("channel", no_wrap=True)
    table.add_column("value", justify="right", min_width=9, no_wrap=True)
    if with_unit:
        table.add_column("unit", no_wrap=True)
    for title, min_width in (("rate/expected", 13), ("age s", 6)):
        table.add_column(title, justify="right", min_width=min_width, no_wrap=True)
    table.add_column("grade", min_width=6, no_wrap=True)
    table.add_column("source")
    for name in health.names:
        channel, unit = health.channels[name], [health.known_channels[name].unit] if with_unit else []
        if channel.count == 0:
            text, style = ("waiting", "yellow") if name in expected else ("no source configured", "dim")
            table.add_row(name, "–", *unit, "–", "–", "–", _one_line_text((text, style)))
            continue
        grade, wanted_hz = channel.grade(now_ns), channel.reference_hz
        rates = f"{channel.rate_hz(now_ns):.1f}{f'/{wanted_hz:.1f}' if wanted_hz else ''} Hz"
        cells = (
            rates,
            f"{channel.age_s(now_ns):.1f}",
            Text(grade, _GRADE_STYLES[grade]),
            _one_line_text(channel.source),
        )
        table.add_row(name, f"{channel.value:.3f}", *unit, *cells)
    return table


def _source_table(health: monitoring.Health, now_ns: int) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("line", min_width=max(map(len, health.names)), no_wrap=True, overflow="ellipsis")
    table.add_column("state", min_width=9, no_wrap=True)
    for title in ("frames", "refused", "dropped"):
        table.add_column(title, justify="right", min_width=8, no_wrap=True)
    for source in health.sources.values():
        state = source.as_message(now_ns)["state"]
        dropped = Text(f"{source.dropped:,}", "bold red" if source.dropped else "")
        counts = f"{source.frames:,}", f"{source.rejected:,}"
        table.add_row(source.name, Text(state, _STATE_STYLES[state]), *counts, dropped)
    for sink in health.sinks.values():
        state, dropped = sink.state_at(now_ns), Text(f"{sink.dropped:,}", "yellow" if sink.dropped else "")
        table.add_row(f"to {sink.name}", Text(state, _STATE_STYLES[state]), f"{sink.sent:,}", "", dropped)
    return table


def status_text(health: monitoring.Health) -> str:
    """A few words for a supervisor's status line."""
    if health.trouble:
        return f"PAUSED: {health.trouble}"
    good = sum(health.channels[name].grade(time.monotonic_ns()) == "good" for name in health.names)
    return f"recording {health.part}: {good} of {len(health.names)} channels good, {health.samples:,} samples"


def summary_text(health: monitoring.Health, paths: Sequence[Path]) -> str:
    """One line for the end of a recording."""
    received = sum(health.channels[name].count > 0 for name in health.names)
    dropped = sum(source.dropped for source in health.sources.values())
    frames = sum(source.frames for source in health.sources.values())
    name = paths[0].name if len(paths) == 1 else f"{paths[0].name} and {len(paths) - 1} more parts"
    ended_ns = time.monotonic_ns() if health.ended_ns is None else health.ended_ns
    passed_on = [f"; {sink.name}: {sink.sent:,} sent, {sink.dropped:,} dropped"
                 f"{f' ({sink.error})' if sink.error else ''}" for sink in health.sinks.values()]  # fmt: skip
    return (
        f"{name}: {_elapsed_time_text((ended_ns - health.started_ns) // NANO)}, {frames:,} frames, "
        f"{health.samples:,} samples, {received} of {len(health.names)} channels, {dropped:,} dropped"
        + "".join(passed_on)
    )


def preflight_table(report: survey.PreflightReport) -> Group:
    """The channels and what is wrong with them; events while listening, the sinks, and the room on the disk."""
    rows = []
    for channel in report.channels:
        good = Text("✗", "bold red") if channel.problem else Text("✓", "green")
        rate, value = ("–", "–") if channel.value is None else (f"{channel.rate_hz:.1f}", f"{channel.value:.3f}")
        source = Text(channel.problem, "red") if channel.problem else Text(channel.source, "dim")
        rows.append((good, channel.name, rate, value, channel.unit, source))
    columns = ("", "channel", "rate Hz", "value", "unit", "source, or what is wrong")
    table = result.terminal_table(None, columns, rows, left_aligned=(0, 1, 4, 5), padding=(0, 1, 0, 0))
    lines = [Text(text, "yellow") for text in report.events]
    for name, answer in report.sinks.items():
        is_good = not answer or answer.startswith("(")
        lines.append(Text(f"{'✓' if is_good else '✗'} sink {name} {answer}", "green" if is_good else "bold red"))
    if report.disk_problem:
        lines.append(Text(f"✗ {report.disk_problem}", "bold red"))
    elif report.free_bytes is not None:
        lines.append(Text(f"{report.free_bytes / 1e9:.1f} GB free where the recording goes", "dim"))
    return Group(table, *lines)


@contextmanager
def set_marks_on_keys(mark: requests.Mark, texts: Mapping[str, str]) -> Iterator[None]:
    """Read keys on standard input, if that is a terminal: those of ``texts`` set that mark, m a number."""
    count = itertools.count(1)

    def take(key: str) -> None:
        if key in texts:
            mark(texts[key], time.monotonic_ns())
        elif key in COUNTED_KEYS:
            mark(f"mark {next(count)}", time.monotonic_ns())

    with process.keys_taken(take):
        yield


class LiveView:
    """A server for viewers while a recording runs; a context manager, and a listener to the recording.

    Raises :class:`ConfigurationError` without the package ``foxglove-sdk``, :class:`SourceError` without the port.
    """

    def __init__(
        self, settings: LiveSection, trial: Trial, tell: Tell = lambda level, text: None,
        health: monitoring.SinkHealth | None = None,
    ) -> None:  # fmt: skip
        self._settings, self._name, self._tell = settings, trial.name, tell
        self.health = health or monitoring.SinkHealth(monitoring.LIVE_VIEW)
        self._counts = viewers.ViewerCounts(self.health)
        self._trial_channels = ship.channels_by_name_of(trial)
        self._channels: dict[str, Any] = {}
        self._sdk: Any = None

    def __enter__(self) -> LiveView:
        try:
            import foxglove
        except ImportError as error:
            fix = "pip install 'seatrial[live]'"
            self.health.state, self.health.error = "failed", "foxglove-sdk is not installed"
            raise errors.ConfigurationError("the live view needs the package foxglove-sdk", fix=fix) from error
        self._sdk, self._context = foxglove, foxglove.Context()
        address, port = self._settings.address, self._settings.port
        # An address of this computer alone that no page can guess: one of 16 million, with a port of 28,000. Only
        # Linux has all of 127.0.0.0/8; elsewhere the port alone is unknown.
        self._hidden = requests.LOOPBACK
        if sys.platform == "linux":
            self._hidden = str(IPv4Address((127 << 24) + 2 + secrets.randbelow((1 << 24) - 4)))
        try:
            with ExitStack() as stack:
                self._server = foxglove.start_server(
                    name=self._name, host=self._hidden, port=0, context=self._context, message_backlog_size=_BACKLOG
                )
                stack.callback(self._server.stop)
                front = requests.WebFront("live view", address, port, self._relay_viewer, self._settings.origins)
                stack.enter_context(front)
                self._closing = stack.pop_all()
        except Exception as error:  # the package promises no kind of error
            problem = f"the live view cannot be served on {address}:{port}"
            reason = getattr(error, "strerror", "") or str(error)
            fix = "stop the program that uses the port, or give another in [live]"
            self.health.state, self.health.error = "failed", reason
            raise errors.SourceError(problem, why=reason, fix=fix) from error
        self.health.state = "open"
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    @property
    def address(self) -> str:
        address = self._settings.address
        return f"ws://{f'[{address}]' if ':' in address else address}:{self._settings.port}"

    def _relay_viewer(self, viewer: socket.socket, request: requests.Request) -> None:
        """Pass a viewer's request on to the package's server, and then what both send."""
        with socket.create_connection((self._hidden, self._server.port), timeout=requests.PATIENCE_S) as server:
            server.sendall(request.raw)
            viewers.relay_viewer(viewer, server, self._counts, self._tell)

    def publish(self, topic: str, data: bytes, log_ns: int) -> None:
        """Pass a message on to the viewers."""
        if topic.startswith(RAW_PREFIX):
            return
        if topic not in self._channels:
            kind, metadata = message_kind_of_topic(topic), channel_metadata(topic, self._trial_channels)
            schema = self._sdk.Schema(name=kind.title, encoding=ENCODING, data=kind.descriptors)
            self._channels[topic] = self._sdk.Channel(
                topic, schema=schema, message_encoding=ENCODING, metadata=metadata, context=self._context
            )
        self._channels[topic].log(data, log_time=max(log_ns, 0))


def status_page_html(picture: Picture, title: str) -> str:
    """What the terminal shows, as a page."""
    console = errors.Terminal(record=True, file=io.StringIO(), width=_COLUMNS, height=_ROWS, force_terminal=True)
    console.print(picture)
    body = console.export_html(inline_styles=True, code_format="{code}")
    return _PAGE.format(title=html.escape(title), body=body)


def health_as_json(health: monitoring.Health) -> bytes:
    """The same as an object: state, figures by name, sources, the alarms that are raised, the last events."""
    now_ns = time.monotonic_ns()
    events = [{"time": iso_utc(at_ns), "level": level, "text": text} for at_ns, level, text in tuple(health.events)]
    state = {
        "recording": health.part,
        "trouble": health.trouble,
        "clock": str(health.clock),
        "copies": health.copies.trouble,
        "alarms": dict(health.alarms),
        "figures": health.figures(now_ns),
        "sources": [source.as_message(now_ns) for source in health.sources.values()],
        "sinks": [sink.as_message(now_ns) for sink in health.sinks.values()],
        "events": events,
    }
    return orjson.dumps(state)


class StatusPage:
    """A server of the page while a recording runs; a context manager.

    Raises :class:`SourceError` when the port cannot be had.
    """

    def __init__(self, settings: StatusSection, picture: Picture, title: str) -> None:
        self._settings, self._picture, self._title = settings, picture, title
        self._front = requests.WebFront("status page", requests.LOOPBACK, settings.port, self._answer_request)

    @property
    def address(self) -> str:
        return f"http://{requests.LOOPBACK}:{self._settings.port}/"

    def __enter__(self) -> StatusPage:
        try:
            self._front.__enter__()
        except OSError as error:
            problem = f"the status page cannot be served on {requests.LOOPBACK}:{self._settings.port}"
            fix = "stop the program that uses the port, or give another in [status]"
            raise errors.SourceError(problem, why=str(error.strerror), fix=fix) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._front.__exit__()

    def _answer_request(self, client: socket.socket, request: requests.Request) -> None:
        if request.method != "GET":
            raise requests.RefusalError(HTTPStatus.NOT_IMPLEMENTED)
        if request.path == "/":
            kind, body = "text/html; charset=utf-8", status_page_html(self._picture, self._title).encode()
        elif request.path == "/status.json":
            kind, body = "application/json", health_as_json(self._picture.health)
        else:
            raise requests.RefusalError(HTTPStatus.NOT_FOUND)
        client.sendall(requests.http_response(HTTPStatus.OK, body, kind, **_HEADERS))


_LOOK_S = 0.05
_REDRAW_PER_S = 4.0
_WATCHDOG_PERIOD_S = 1.0
_FRAMES_PER_TICK = 2_000  # frames; as seldom as the files' times allow, as often as memory wants
_PROGRESS_PERIOD_S = 5.0
_POLL_S = 0.2
_MOST_NAMED = 20  # messages that carry no channel: a bus has some dozens of kinds
_WITHOUT_TIMES = (
    "the log has no times of its own; its samples are stamped with the time of reading, unless it tells the time "
    'and clock = "source"'
)


def record(
    config: TrialConfig,
    folder: Path,
    duration_s: float | None = None,
    stop: threading.Event | None = None,
    log_format: monitoring.LogFormat = "text",
    live: bool = False,
) -> tuple[list[Path], monitoring.Health]:
    """Record until ``stop`` is set, ``duration_s`` is over, or every source has ended.

    Returns the recording's parts and its health. Raises :class:`SourceError` when no source at all can be
    opened, :class:`ConfigurationError` for what only a decoder can find wrong (no file remains then),
    :class:`StorageError` when the disk fails and messages are lost.
    """
    stop = stop or threading.Event()
    from_files = all(isinstance(source, FILE_SOURCES) for source in config.sources)
    with nullcontext() if sys.stderr.isatty() and not from_files else monitoring.log_to(sys.stderr, log_format):
        if from_files:
            return _record_files(config, folder, duration_s, stop)
        return _record_from_sources(config, folder, duration_s, stop, live)


def _record_from_sources(
    config: TrialConfig, folder: Path, duration_s: float | None, stop: threading.Event, live: bool
) -> tuple[list[Path], monitoring.Health]:
    if config.copies is not None:
        maintenance.require_separate_folder(config.copies, folder)
    if live and config.live is None:
        config = replace(config, live=LiveSection())
    monitoring.check_alarms(config.alarms, pipeline.initial_health(config))
    scale = maintenance.Timescale(*wall_and_monotonic_ns())
    clock = maintenance.clock_metadata(scale)
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording, clock)
    copies = None if config.copies is None else maintenance.Copies(config.copies, folder, config.trial.name, parts)
    passing_on = sinks.Sinks(config)
    with ExitStack() as stack:
        if copies is not None:
            stack.callback(copies.stop)  # last of all: the last part is copied too
        stack.callback(passing_on.stop)  # once the recording is closed, which waits for nobody
        stack.callback(parts.close)
        try:
            recorder = pipeline.Recorder(config, parts, scale)
            parts.sample_listeners += passing_on.start(recorder.health.sinks, recorder.submit_event)
            recorder.start()  # from now on values come, and none is before those who listen
        except (errors.ConfigurationError, errors.SourceError):
            stack.pop_all()
            passing_on.stop()
            parts.delete_everything_written()
            raise
        stack.callback(recorder.stop)  # whatever becomes of the display, the recorder ends before its files
        if copies is not None:
            recorder.health.copies = copies.state
            if not copies.start():
                recorder.submit_event("error", f"no copies: {pipeline.NO_THREAD}; the next recording makes them")
        if config.missing_channels:
            monitoring.LOG.warning("no source provides %s", ", ".join(config.missing_channels))
        state = partial(_recorder_state, config, recorder.health, parts)
        _enter_optional_context(stack, requests.RequestServer(recorder.mark, state, recorder.predictions), recorder)
        if config.live is not None:
            of_view = recorder.health.sinks[monitoring.LIVE_VIEW]
            view = LiveView(config.live, config.trial, recorder.submit_event, of_view)
            if _enter_optional_context(stack, view, recorder):
                parts.listeners.append(view.publish)
                monitoring.LOG.info("live view at %s", view.address)
        picture = Picture(recorder.health, config.expected_channels, config.marks)
        if config.status is not None:
            shown = StatusPage(config.status, replace(picture, marks=None), config.trial.name)
            if _enter_optional_context(stack, shown, recorder):
                monitoring.LOG.info("status page at %s", shown.address)
        _enter_optional_context(
            stack,
            monitoring.Alarms(config.alarms, recorder.health, partial(recorder.submit_event, name="alarm")),
            recorder,
        )
        _enter_optional_context(stack, _show_on_terminal(picture, recorder), recorder)
        monitoring.LOG.info("recording to %s", parts.path)
        monitoring.notify_systemd("READY=1")
        _wait_for_end(recorder, stop, duration_s)
        monitoring.notify_systemd("STOPPING=1")
    if config.copies is None:
        return parts.paths, recorder.health
    target = config.copies.folder  # where what was deleted here has a copy
    return [path if os.path.lexists(path) else target / path.name for path in parts.paths], recorder.health


def _recorder_state(
    config: TrialConfig, health: monitoring.Health, parts: RecordingParts
) -> requests.RecorderState:
    return requests.RecorderState(
        trial=config.trial.name,
        configuration=str(config.path.absolute()),
        recording=str(parts.path.absolute()),
        paused=parts.paused,
        process=os.getpid(),
        predictions=health.predictions,
        predictions_refused=health.predictions_refused + health.predictions_dropped,
    )


def _record_files(
    config: TrialConfig, folder: Path, duration_s: float | None, stop: threading.Event
) -> tuple[list[Path], monitoring.Health]:
    """Record everything in the configuration's log files, merged by time, until their end.

    ``duration_s`` counts in the files' own time. Raises :class:`SourceError` for a file that cannot be read.
    """
    if config.sinks:
        monitoring.LOG.warning("sinks get nothing: the values of log files are not of now")
    config = replace(config, sinks=(), live=None)
    health = pipeline.initial_health(config)
    clock = {"times": "of the log files"}
    parts = RecordingParts(folder, config.trial, config.attachments, config.recording, clock)
    with ExitStack() as stack:
        stack.callback(parts.close)
        try:
            monitoring.LOG.info("recording to %s", parts.path)
            with ExitStack() as open_sources:
                sources = [make_source(section) for section in config.sources]
                for source in sources:
                    source.open()
                    open_sources.callback(source.close)
                reading = _LogReading(FrameProcessor(config, parts, health), parts, health, stop)
                frames = heapq.merge(*map(reading.iterate_frames, sources), key=attrgetter("received_ns"))
                reading.process_frames(frames, float("inf") if duration_s is None else duration_s * 1e9)
                for source in sources:
                    _report_reading_faults(source, health.sources[source.name], reading)
                reading.report_sources()
                reading.note_event("info", "recording stopped")
        except (errors.ConfigurationError, errors.SourceError):
            if not any(source.frames for source in health.sources.values()):
                stack.pop_all()
                parts.delete_everything_written()
            raise
    return parts.paths, health


def _wait_for_end(recorder: pipeline.Recorder, stop: threading.Event, duration_s: float | None) -> None:
    until_s = float("inf") if duration_s is None else time.monotonic() + duration_s
    notified_s = 0.0
    while not recorder.ended and time.monotonic() < until_s:
        if time.monotonic() - notified_s > _WATCHDOG_PERIOD_S and recorder.alive:
            monitoring.notify_systemd(f"WATCHDOG=1\nSTATUS={status_text(recorder.health)}")
            notified_s = time.monotonic()
        if stop.wait(_LOOK_S):
            return


def _enter_optional_context(
    stack: ExitStack, extra: AbstractContextManager[object], recorder: pipeline.Recorder
) -> bool:
    """Enter what a recording can do without; where it is unavailable, report it and record all the same."""
    try:
        stack.enter_context(extra)
    except (errors.SeatrialError, OSError, RuntimeError) as error:  # the last: no thread
        recorder.submit_event("warning", str(error))
        return False
    return True


@contextmanager
def _show_on_terminal(picture: Picture, recorder: pipeline.Recorder) -> Iterator[None]:
    if not sys.stderr.isatty():
        yield
        return
    # screen: a window that is resized leaves no debris, and the terminal is restored
    live = Live(picture, console=errors.Terminal(stderr=True), refresh_per_second=_REDRAW_PER_S, screen=True)
    with set_marks_on_keys(recorder.mark, picture.marks or {}), live:
        yield


def _report_reading_faults(source: Source, health: monitoring.SourceHealth, reading: _LogReading) -> None:
    if remark := getattr(source, "remark", ""):
        reading.note_event("warning", f"{source.name}: {remark}")
    if unreadable := getattr(source, "unreadable", 0):
        lines = "line" if unreadable == 1 else "lines"
        reading.note_event("warning", f"{source.name}: {unreadable:,} {lines} of the log could not be read")
    if bad := health.rejection_counts.get(BAD_DATA):
        places = "place" if bad == 1 else "places"
        reading.note_event("warning", f"{source.name}: no packet that can be read at {bad:,} {places} of the log")
    refusals = sorted(health.rejection_counts.items(), key=lambda item: -item[1])
    refused = [f"{reason} ({count:,})" for reason, count in refusals if reason != BAD_DATA]
    if refused:
        reading.note_event("info", f"{source.name}: not used, but recorded raw: {', '.join(refused)}")
    if unknown := sorted(health.unknown_message_counts.items(), key=lambda item: -item[1]):
        named = ", ".join(f"{name} ({count:,})" for name, count in unknown[:_MOST_NAMED])
        further = f" and {len(unknown) - _MOST_NAMED} more" if len(unknown) > _MOST_NAMED else ""
        reading.note_event("info", f"{source.name}: carries no channel, but recorded raw: {named}{further}")
    if damage := getattr(source, "damage", ""):
        reading.note_event("error", f"{source.name}: {damage}")


class _LogReading:
    """Frames of logs on their way into a recording; ``now_ns`` is how far the logs have come."""

    def __init__(
        self, processing: FrameProcessor, parts: RecordingParts, health: monitoring.Health, stop: threading.Event
    ) -> None:
        self._processing, self._parts, self._health, self._stop = processing, parts, health, stop
        self._reported_ns = 0  # when by the logs' time the state of the sources was last reported
        self.now_ns = time.time_ns()  # until a log states another
        self._reported_s = time.monotonic()
        self._untimed: list[str] = []  # sources whose logs have no times, not reported yet
        parts.tell = self.note_event

    def note_event(self, level: str, text: str) -> None:
        """Put an event into the recording, at the time that the logs have come to."""
        self._processing.note(text, self.now_ns, level)

    def process_frames(self, frames: Iterator[Frame], duration_ns: float) -> None:
        """Process the frames until their end, the duration's, or until ``stop`` is set."""
        until_ns = float("inf")
        for number, frame in enumerate(frames):
            self.now_ns = frame.received_ns
            if number == 0:
                until_ns = self.now_ns + duration_ns
                self._health.started_ns = self.now_ns
                self.note_event("info", "recording started, from log files")
                for name in self._untimed:
                    self.note_event("warning", f"{name}: {_WITHOUT_TIMES}")
            if self.now_ns > until_ns or self._stop.is_set():
                break
            self._health.ended_ns = max(self.now_ns, self._health.started_ns)
            self._processing.process(frame)
            if abs(self.now_ns - self._reported_ns) >= NANO:
                self.report_sources()
            if number % _FRAMES_PER_TICK == _FRAMES_PER_TICK - 1:
                self._parts.sync()
                self._parts.check_limits(time.monotonic())
                while self._parts.paused and not self._stop.wait(_POLL_S):  # a file can wait for the disk
                    self._parts.check_limits(time.monotonic())
                if time.monotonic() - self._reported_s >= _PROGRESS_PERIOD_S:
                    monitoring.LOG.info("%s frames, up to %s", f"{number + 1:,}", iso_utc(self.now_ns))
                    self._reported_s = time.monotonic()
        self._processing.report_handovers()

    def report_sources(self) -> None:
        """Record the state of each source, at the time that the logs have come to."""
        self._reported_ns = self.now_ns
        for source in self._health.sources.values():
            self._parts.write_health(source.as_message(max(self.now_ns, source.last_ns or 0)), self.now_ns)

    def iterate_frames(self, source: Source) -> Iterator[Frame]:
        """A log's frames, as fast as they are taken; at the first it shows whether the log has times."""
        health = self._health.sources[source.name]
        while (block := source.read(0.0)) is not None:
            if block:
                # Times since its beginning bear no stamp, but keep the frames' distances.
                timed = any(member.stamped_ns is not None for member in block) or getattr(source, "timed", False)
                if not health.frames and not timed:
                    self._untimed.append(source.name)
                    self._processing.mute_clock_reports(source.name)
                for frame in block:
                    health.add_frames(1, frame.monotonic_ns)
                    yield frame
        health.state = "ended"
