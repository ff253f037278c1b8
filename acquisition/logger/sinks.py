"""Passes decoded channels on while they are recorded: InfluxDB's line protocol by HTTP, TCP and UDP, and MQTT.

A sink never holds up the recorder, whose thread puts a value into a bounded queue, which drops the oldest, and
goes on. A thread of the sink's own connects, sends and waits; whatever a peer does, refuse, hang, close, accept and
never read, costs the values of this sink, which are counted. A name that is looked up, or a peer that answers byte
by byte, may keep that thread for ever: it is left behind when the recording ends.

What a peer did not take is sent again, the newest ``queue_values`` of it, when it is back. Over UDP and TCP nobody
says what was taken: sent is what the system took.
"""

from __future__ import annotations

import http.client
import re
import socket
import ssl
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from typing import Any
from urllib.parse import quote

import orjson

from seatrial.acquisition.config import trial_file
from seatrial.acquisition.core import errors, files, ship
from seatrial.acquisition.core.trial import NANO, Sample
from seatrial.acquisition.logger.health import SinkHealth
from seatrial.acquisition.protocols.mqtt import format_time
from seatrial.acquisition.recording.parts import Tell

_CONNECT_S, _ANSWER_S = 3.0, 5.0
_SHORTEST_BACK_OFF_S, _LONGEST_BACK_OFF_S = 0.2, 10.0
_LONGEST_END_S = 2.0  # for what still waits when the recording has been closed
_LONGEST_CHECK_S = 10.0
_MOST_AT_ONCE = 1000
_DATAGRAM_BYTES = 1400  # what no network on the way has to cut
_MOST_ANSWER_BYTES = 65_536
_MOST_LETTERS = 200
_TOKEN = re.compile(r"[\x21-\x7e]+(?: [\x21-\x7e]+)*")
_SPECIAL = re.compile(r"([,= ])")
_MALFORMED = (400, 413, 422)
"""A server's answers that would be the same to the same lines."""


class RejectedError(errors.SourceError):
    """A peer has read the values and will never take them."""


class SinkLink(ABC):
    """A connection to a peer; whatever it raises is a failure of the sink."""

    period_s = 1.0
    """How often what waits is sent."""

    @abstractmethod
    def open(self) -> None:
        """Connect. Raises :class:`OSError`, :class:`SeatrialError`."""

    @abstractmethod
    def send(self, samples: Sequence[Sample]) -> None:
        """Pass values on; :class:`RejectedError` if the peer has refused them for good."""

    def probe(self) -> str:
        """Find out whether an open connection is of use; a remark where that cannot be told."""
        return ""

    def keep_alive(self) -> None:
        """What the protocol wants while nothing is sent."""
        return

    def close(self) -> None:
        """Let go of the connection; harmless when there is none."""
        return


class InfluxLines:
    """Values as lines of InfluxDB's protocol."""

    def __init__(self, section: trial_file.InfluxSink, trial: str) -> None:
        measurement = _escape(section.measurement).replace(r"\=", "=")  # which need no escape there
        self._head = f"{measurement},trial={_escape(trial)}"

    def line(self, sample: Sample) -> bytes:
        """One value as a line with its end."""
        fields = f"{_escape(sample.quantity)}={float(sample.value)!r}"
        return f"{self._head} {fields} {sample.measured_ns}\n".encode()


def _escape(text: str) -> str:
    """A tag or a name as the line protocol has it. It knows no line ends; a backslash escapes what follows.

    >>> print(_escape("sea trial, 1"))
    sea\\ trial\\,\\ 1
    """
    plain = "".join(letter if letter.isprintable() and letter != "\\" else "_" for letter in text)
    return _SPECIAL.sub(r"\\\1", plain) or "_"


class InfluxServer(SinkLink):
    """A server of InfluxDB over HTTP; the connection is kept, and opened again where the server has closed it."""

    def __init__(self, section: trial_file.InfluxSink, trial: str) -> None:
        self._section, self._lines = section, InfluxLines(section, trial)
        self._http: http.client.HTTPConnection | None = None
        self._token = ""
        options = {"bucket": section.bucket, "org": section.org, "db": section.database, "precision": "ns"}
        query = "&".join(f"{key}={quote(value, safe='')}" for key, value in options.items() if value)
        kind = "write" if section.database else "api/v2/write"
        self._path = f"{quote(section.place.path.rstrip('/'))}/{kind}?{query}"

    def open(self) -> None:
        section, place = self._section, self._section.place
        self._token = (files.read_secret(section.token_variable, section.token_file) or "").strip()
        if self._token and not _TOKEN.fullmatch(self._token):
            raise errors.ConfigurationError("its token has letters that no header carries")
        assert place.hostname is not None
        if place.scheme == "https":
            context = ssl.create_default_context(cafile=section.ca_file)
            self._http = http.client.HTTPSConnection(
                place.hostname, place.port, timeout=_CONNECT_S, context=context
            )
        else:
            self._http = http.client.HTTPConnection(place.hostname, place.port, timeout=_CONNECT_S)
        self._connect()

    def _connect(self) -> None:
        assert self._http is not None
        self._http.close()
        self._http.connect()
        self._http.sock.settimeout(_ANSWER_S)

    def send(self, samples: Sequence[Sample]) -> None:
        self._post(b"".join(map(self._lines.line, samples)))

    def probe(self) -> str:
        with suppress(RejectedError):  # a comment is no value; who may not write is told before
            self._post(b"# a check before departure\n")
        return ""

    def _post(self, body: bytes) -> None:
        try:
            status, reason, text = self._exchange(body)
        except (http.client.BadStatusLine, BrokenPipeError, ConnectionResetError):
            self._connect()  # the server had closed an idle connection
            status, reason, text = self._exchange(body)
        if 200 <= status < 300:
            return
        kind = RejectedError if status in _MALFORMED else errors.SourceError
        raise kind(f"the server answers {status} {reason}", why=text)

    def _exchange(self, body: bytes) -> tuple[int, str, str]:
        """Post the body: the answer's status and reason, and what it says, in which no token stands."""
        assert self._http is not None
        headers = {"Content-Type": "text/plain; charset=utf-8"}
        if self._token:
            headers["Authorization"] = f"Token {self._token}"
        self._http.request("POST", self._path, body, headers)
        answer = self._http.getresponse()
        text = answer.read(_MOST_ANSWER_BYTES)
        if not answer.isclosed():  # an endless one
            self._http.close()
            self._connect()
        return answer.status, self._shown(answer.reason.encode()), self._shown(text)

    def _shown(self, text: bytes) -> str:
        with suppress(orjson.JSONDecodeError):
            content = orjson.loads(text)
            if isinstance(content, dict):
                text = str(content.get("message") or content.get("error") or "").encode()
        plain = text.decode("utf-8", "replace")
        return (plain.replace(self._token, "***") if self._token else plain)[:_MOST_LETTERS]

    def close(self) -> None:
        if self._http is not None:
            self._http.close()


class InfluxPort(SinkLink):
    """A TCP connection or a UDP port that takes lines, such as Telegraf's."""

    def __init__(self, section: trial_file.InfluxSink, trial: str) -> None:
        self._section, self._lines = section, InfluxLines(section, trial)
        self._socket: socket.socket | None = None

    def open(self) -> None:
        place = self._section.place
        kind = socket.SOCK_STREAM if place.scheme == "tcp" else socket.SOCK_DGRAM
        error: OSError = OSError("no address")
        for family, _, protocol, _, address in socket.getaddrinfo(place.hostname, place.port, type=kind):
            opened = socket.socket(family, kind, protocol)
            opened.settimeout(_CONNECT_S)
            try:
                opened.connect(address)
            except OSError as refusal:
                opened.close()
                error = refusal
                continue
            opened.settimeout(_ANSWER_S)
            self._socket = opened
            return
        raise error

    def send(self, samples: Sequence[Sample]) -> None:
        assert self._socket is not None
        lines = list(map(self._lines.line, samples))
        if self._section.place.scheme == "tcp":
            self._socket.sendall(b"".join(lines))
            return
        datagram = b""
        for line in chain(lines, [b""]):
            if datagram and (not line or len(datagram) + len(line) > _DATAGRAM_BYTES):
                self._socket.send(datagram)
                datagram = b""
            datagram += line

    def probe(self) -> str:
        """Nothing is sent: a connection is proof enough, and of a datagram there is none."""
        return (
            "" if self._section.place.scheme == "tcp" else "sent by UDP: whether anybody receives it is not known"
        )

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class BrokerTopics(SinkLink):
    """Topics of an MQTT broker, one for each channel."""

    period_s = 0.1

    def __init__(self, section: trial_file.MqttSink, channels: Mapping[str, ship.Channel]) -> None:
        import paho.mqtt.client  # noqa: F401 - in the sink's thread it would hold up the receivers for 0.4 s

        from seatrial.acquisition.sources import lines

        self._section, self._channels, self._lines = section, channels, lines
        self._client: Any = None

    def open(self) -> None:
        self._client = self._lines.connect_to_broker(self._section)

    def send(self, samples: Sequence[Sample]) -> None:
        for sample in samples:
            topic = f"{self._section.topic}/{sample.quantity}"
            self._client.publish(topic, self.payload(sample), retain=self._section.retain)
            until_s = time.monotonic() + _ANSWER_S
            while self._client.want_write():  # or what the broker does not take would wait in memory without end
                if time.monotonic() > until_s:
                    raise errors.SourceError("the broker takes nothing")
                self.keep_alive(0.1)
        self.keep_alive()

    def payload(self, sample: Sample) -> bytes:
        """The message of a value, in one of the forms that sources of MQTT read."""
        unit, time_text = self._channels[sample.quantity].unit, format_time(sample.measured_ns)
        if self._section.form == "value":
            return f"{float(sample.value)!r},{time_text},{unit}".encode()
        return orjson.dumps({"value": sample.value, "unit": unit, "time": time_text, "source": sample.source})

    def keep_alive(self, timeout_s: float = 0.0) -> None:
        self._lines.receive_one_message(self._section, self._client, timeout_s)

    def close(self) -> None:
        if self._client is not None:
            self._client.disconnect()
            self._client = None


def make_link(section: trial_file.AnySink, trial: str, channels: Mapping[str, ship.Channel]) -> SinkLink:
    """The connection of a sink, not yet open."""
    if isinstance(section, trial_file.MqttSink):
        return BrokerTopics(section, channels)
    return (InfluxServer if section.over_http else InfluxPort)(section, trial)


def failure_text(error: BaseException) -> str:
    """Why a sink failed, in a line."""
    if isinstance(error, errors.SeatrialError):
        return str(error.at("")) if error.where.startswith("sink ") else str(error)
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate cannot be trusted: {error.verify_message}"
    if isinstance(error, TimeoutError):
        return "it does not answer in time"
    if isinstance(error, http.client.HTTPException):  # whose text may be anything that the peer has sent
        return "what answers speaks no HTTP"
    return errors.system_reason(error) or f"{type(error).__name__} {error}"[:_MOST_LETTERS]


class LiveSink:
    """One sink at work: :meth:`offer` is for the recorder's thread, all else for the sink's own."""

    def __init__(self, section: trial_file.AnySink, link: SinkLink, health: SinkHealth, tell: Tell) -> None:
        self.health, self._link, self._tell = health, link, tell
        self._wanted = frozenset(section.channels)
        self._interval_ns = round(NANO / section.rate_hz)
        self._due_ns: dict[str, int] = {}
        self._ending, self._ended = threading.Event(), threading.Event()
        self._is_open = False
        self._failed_s: float | None = None
        self._back_off_s = _SHORTEST_BACK_OFF_S
        self._dropped_before = 0
        self._thread = threading.Thread(target=self._run, name=f"sink {section.name}", daemon=True)

    def start(self) -> None:
        """Raises RuntimeError where the system gives no thread."""
        self._thread.start()

    def offer(self, sample: Sample) -> None:
        """Let a value wait to be sent, if it is due; never waits."""
        name, now_ns = sample.quantity, sample.monotonic_ns
        if self._wanted and name not in self._wanted:
            return
        due_ns = self._due_ns.get(name, now_ns)
        if now_ns < due_ns:
            return
        self._due_ns[name] = max(due_ns + self._interval_ns, now_ns)
        self.health.queue.append(sample)  # and drops the oldest, if it is full
        self.health.offered += 1

    def end(self) -> None:
        """Send what waits, as far as that can be done now, and nothing more."""
        self._ending.set()

    def join(self, timeout_s: float) -> None:
        """Wait for the end; a thread that hangs is left behind."""
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        self._ended.set()

    def _run(self) -> None:
        batch: list[Sample] = []
        while not self._ended.is_set():
            is_ending = self._ending.is_set()  # asked before what waits is taken: nothing is offered after it
            batch = batch or self._take()
            is_last = is_ending and not batch
            try:
                if not is_last:
                    self._pass_on(batch)
                    batch = []
            except RejectedError as error:
                self._note_failure(error)
                self.health.in_hand, batch = 0, []
            except Exception as error:  # libraries raise what they like
                self._note_failure(error)
                self._close()
                if self._ending.is_set():
                    break
                self._ending.wait(self._back_off_s)
                self._back_off_s = min(2 * self._back_off_s, _LONGEST_BACK_OFF_S)
                continue
            finally:
                self.health.busy_s = float("inf")
            if is_last:
                break
            if len(self.health.queue) < _MOST_AT_ONCE:
                self._ending.wait(self._link.period_s)
        self.health.in_hand = 0
        self._close()

    def _take(self) -> list[Sample]:
        queue, batch = self.health.queue, list[Sample]()
        while queue and len(batch) < _MOST_AT_ONCE:
            self.health.in_hand += 1  # before it is taken, so that it never counts as dropped
            batch.append(queue.popleft())
        return batch

    def _pass_on(self, batch: list[Sample]) -> None:
        self.health.busy_s = time.monotonic()
        if not self._is_open:
            self._link.open()
            self._is_open = True
        if not batch:
            self._link.keep_alive()
            if self._failed_s is None:
                self.health.state = "open"
            return
        self._link.send(batch)
        self.health.sent += len(batch)
        self.health.in_hand, self._back_off_s = 0, _SHORTEST_BACK_OFF_S
        self.health.state, dropped = "open", self.health.dropped - self._dropped_before
        name = f"sink {self.health.name!r}"
        if self._failed_s is not None:
            gap_s = time.monotonic() - self._failed_s
            self._tell("warning", f"{name} works again after {gap_s:.1f} s; {dropped:,} values were dropped")
            self._failed_s, self._dropped_before = None, self.health.dropped
        elif dropped and not self._dropped_before:
            self._tell("warning", f"{name} is too slow: the oldest values are dropped")
            self._dropped_before = self.health.dropped

    def _note_failure(self, error: BaseException) -> None:
        self.health.error, self.health.state = failure_text(error), "failed"
        if self._failed_s is None:
            self._failed_s = time.monotonic()
            self._tell("warning", f"sink {self.health.name!r} fails: {self.health.error}; it is tried again")

    def _close(self) -> None:
        self._is_open = False
        with suppress(Exception):
            self._link.close()


class Sinks:
    """All sinks of a recording; made before it begins, as what they import takes a while."""

    def __init__(self, config: trial_file.TrialConfig) -> None:
        self._links = [(section, make_link(section, config.trial.name, config.known_channels))
                       for section in config.sinks]  # fmt: skip
        self._sinks: list[LiveSink] = []

    def start(self, states: Mapping[str, SinkHealth], tell: Tell) -> list[Callable[[Sample], None]]:
        """Begin, each in a thread of its own; returns what takes the samples. One without a thread is reported."""
        for section, link in self._links:
            sink = LiveSink(section, link, states[section.name], tell)
            try:
                sink.start()
            except RuntimeError:
                states[section.name].state, states[section.name].error = "failed", "the system gives no thread"
                tell("warning", f"sink {section.name!r} is left out: the system gives no thread")
                continue
            self._sinks.append(sink)
        return [sink.offer for sink in self._sinks]

    def stop(self) -> None:
        """Send what waits, as far as that can be done soon."""
        for sink in self._sinks:
            sink.end()
        until_s = time.monotonic() + _LONGEST_END_S
        for sink in self._sinks:
            sink.join(max(until_s - time.monotonic(), 0.0))


def check_sinks(config: trial_file.TrialConfig) -> dict[str, str]:
    """What is wrong with each sink, an empty text where it can be written to; nothing is written.

    A remark in brackets is no fault.
    """
    answers: dict[str, str] = {}

    def check(section: trial_file.AnySink) -> None:
        link = make_link(section, config.trial.name, config.known_channels)
        try:
            link.open()
            remark = link.probe()
            answers[section.name] = f"({remark})" if remark else ""
        except Exception as error:  # libraries raise what they like
            answers[section.name] = failure_text(error)
        with suppress(Exception):
            link.close()

    threads = [threading.Thread(target=check, args=(section,), daemon=True) for section in config.sinks]
    for thread in threads:
        thread.start()
    until_s = time.monotonic() + _LONGEST_CHECK_S
    for thread in threads:
        thread.join(max(until_s - time.monotonic(), 0.0))
    hanging = f"it does not answer in {_LONGEST_CHECK_S:g} s"
    return {section.name: answers.get(section.name, hanging) for section in config.sinks}
