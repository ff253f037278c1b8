"""Reads MQTT messages, a frame each with its topic, from a broker or from an SQLite log of them.

The connection asks for quality of service 0 and a clean session. Between a broker and its subscriber TCP loses
nothing, and what waits while the recorder stands still is in a large receive buffer: with quality 1 a broker holds
back no more than some 1,000 messages and drops further ones. What is published while the connection is down is lost
either way, unless the broker keeps it for us: then the age of a message without a time would be unknown.
"""

from __future__ import annotations

import os
import sqlite3
import ssl
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, BinaryIO

from seatrial.acquisition.config.sources import MqttSource, covers
from seatrial.acquisition.core.errors import SourceError, system_reason
from seatrial.acquisition.core.process import TEXT_BYTES
from seatrial.acquisition.core.trial import Frame, FrameFlag, now_ns
from seatrial.acquisition.protocols.clock import is_possible
from seatrial.acquisition.sources import SQLITE, LogReader, Source, enlarge, looks_like, source_error

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

_BUFFER_BYTES = 4 * 1024 * 1024
_KEEP_ALIVE_S = 10  # a broker that is cut off without a word is found out after one and a half of it
_TIMEOUT_S = 3.0  # to connect, and for the broker's answer
_POLL_S = 0.1
_MOST_AT_ONCE, _MOST_BYTES_AT_ONCE = 300, 1_000_000
_COMPUTED = "SELECT 1 FROM sqlite_master WHERE upper(name) = 'LOG' AND sql NOT LIKE 'CREATE TABLE%'"
_ROWS = "SELECT UNIX_TIME, TOPIC, MESSAGE FROM LOG ORDER BY ID"
_HEAD_BYTES = 4096
_NOT_ALLOWED = (134, 135)  # MQTT's reasons: bad user name or password, not authorized


def failure(config: MqttSource, what: str, why: str = "", fix: str = "") -> SourceError:
    """An error of the connection to a broker, which is named; users and passwords are not."""
    address, port = config.endpoint
    return source_error(config, f"MQTT broker {address}:{port} {what}", why, fix)


def connect(config: MqttSource, keep_alive_s: int = _KEEP_ALIVE_S) -> Client:
    """Connect to a broker, which has answered then. Raises :class:`SourceError`."""
    client = _make_client(config)
    answers: list[Any] = []
    client.on_connect = lambda *arguments: answers.append(arguments[3])
    try:
        client.connect(*config.endpoint, keepalive=keep_alive_s)
    except (OSError, ValueError) as error:
        wrong = "`port`, `tls` and `ca_file`" if isinstance(error, ssl.SSLError) else "`address` and `port`"
        raise failure(config, "does not answer", _reason(error), f"start it, or correct {wrong}") from error
    answer = _await_answer(config, client, answers)
    if answer.is_failure:
        fix = "correct `user` and its password" if answer.value in _NOT_ALLOWED else ""
        raise failure(config, "refuses the connection", str(answer), fix)
    return client


def _reason(error: Exception) -> str:
    """Why there is no connection, in words that do not depend on the library."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate cannot be trusted: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        return "it is no certificate, or nothing there speaks TLS"
    return system_reason(error) or "no answer in time"


def _make_client(config: MqttSource) -> Client:
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    client = Client(CallbackAPIVersion.VERSION2, config.client_id or None, clean_session=True)
    client.connect_timeout = _TIMEOUT_S
    client.on_socket_open = lambda client, _, opened: enlarge(opened, _BUFFER_BYTES)  # type: ignore[arg-type]
    if config.user:
        client.username_pw_set(config.user, _password(config))
    if config.encrypted:
        try:
            client.tls_set_context(ssl.create_default_context(cafile=config.ca_file))
        except OSError as error:
            reason = f"{config.ca_file}: {_reason(error)}"
            raise failure(config, "cannot be checked", reason, "correct `ca_file`") from error
    return client


def _password(config: MqttSource) -> str | None:
    if config.password_variable:
        password = os.environ.get(config.password_variable)
        if password is None:
            name = config.password_variable
            raise failure(config, "has no password", f"the environment has no {name}", f"set {name}")
        return password
    if config.password_file is None:
        return None
    try:
        return next(iter(config.password_file.read_text(encoding="utf-8").splitlines()), "")
    except (OSError, UnicodeDecodeError) as error:
        reason = f"{config.password_file}: {getattr(error, 'strerror', None) or 'it is no text'}"
        raise failure(config, "has no password", reason, "correct `password_file`") from error


def _await_answer(config: MqttSource, client: Client, answers: list[Any]) -> Any:
    """What the broker answers. Raises :class:`SourceError` if it does not in time."""
    until_s = time.monotonic() + _TIMEOUT_S
    while not answers:
        try:
            pump(config, client, _POLL_S)
        except SourceError:  # a broker that says no hangs up
            if not answers:
                raise
        if time.monotonic() > until_s:
            raise failure(config, "does not answer", "something else may listen there", "correct `port` and `tls`")
    return answers[0]


def pump(config: MqttSource, client: Client, timeout_s: float) -> None:
    """Take what has come, at most one message, or wait for it. Raises :class:`SourceError` of a lost connection."""
    from paho.mqtt.client import error_string
    from paho.mqtt.enums import MQTTErrorCode

    try:
        code = client.loop(timeout_s)
    except Exception as error:  # what paho makes of packets that break the protocol
        raise failure(config, "is lost", system_reason(error) or "it breaks the protocol of MQTT") from error
    if code != MQTTErrorCode.MQTT_ERR_SUCCESS:
        raise failure(config, "is lost", error_string(code).rstrip("."))


class MqttConnection(Source):
    """One connection to one broker; ``remark`` names what the broker did not let us subscribe to."""

    remark = ""

    def __init__(self, config: MqttSource) -> None:
        super().__init__(config)
        self._frames: list[Frame] = []
        self._size = 0  # of these [bytes]
        self._lost: SourceError | None = None

    def _connect(self) -> Client:
        config: MqttSource = self._config
        self._frames, self._size, self._lost = [], 0, None
        client = connect(config)
        client.on_message = self._on_message
        answers: list[Any] = []
        client.on_subscribe = lambda *arguments: answers.append(arguments[3])
        client.subscribe([(topic, 0) for topic in config.subscriptions])
        codes = _await_answer(config, client, answers)
        refused = [topic for topic, code in zip(config.subscriptions, codes, strict=False) if code.is_failure]
        if len(refused) == len(config.subscriptions):
            fix = "correct `topics`, or ask for the right to them"
            raise failure(config, f"refuses {', '.join(refused)}", fix=fix)
        self.remark = f"the broker refuses {', '.join(refused)}" if refused else ""
        return client

    def _on_message(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        flags = FrameFlag.RETAINED if message.retain else FrameFlag.NONE
        try:
            topic = message.topic.encode()
        except UnicodeDecodeError:  # some brokers pass on what is no text
            topic = message._topic
        payload = topic + b"\0" + bytes(message.payload)
        self._frames.append(Frame(self.name, "mqtt", payload, *now_ns(), flags=flags))
        self._size += len(payload)

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        before = -1
        try:
            while self._lost is None and before < len(self._frames) < _MOST_AT_ONCE and not self._is_full:
                before = len(self._frames)
                pump(self._config, self._link, 0.0 if before else timeout_s)
        except SourceError as error:  # told once what came before is passed on
            self._lost = error
        self.behind = len(self._frames) >= _MOST_AT_ONCE or self._is_full
        frames, self._frames, self._size = self._frames, [], 0
        if self._lost is not None and not frames:
            raise self._lost
        return frames

    @property
    def _is_full(self) -> bool:
        return self._size >= _MOST_BYTES_AT_ONCE

    def close(self) -> None:
        if self._link is not None:
            self._link.disconnect()
            self._link = None


class MqttLog(LogReader):
    """An SQLite log, as mqtt-logger and the logging tools of R/V Gunnerus write it.

    Its table ``LOG`` has a row a message: ID, RUN_ID, UNIX_TIME (when it came), TOPIC, MESSAGE. ``unreadable``
    counts rows without a topic or a time, ``damage`` is what ended its reading.
    """

    def _read_beginning(self, file: BinaryIO) -> None:
        self.unreadable, self.damage = 0, ""
        self._monotonic_ns, self._topics = 0, dict[str, bool]()
        head = file.read(_HEAD_BYTES)
        if not head.startswith(SQLITE):
            raise ValueError(f"it is not an SQLite database; it looks like {looks_like(head)}")
        try:
            self._log = sqlite3.connect(f"{self._config.path.resolve().as_uri()}?mode=ro", uri=True)
            self._log.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, TEXT_BYTES.allowance(0))
            self._log.execute("PRAGMA trusted_schema = OFF")
            if self._log.execute(_COMPUTED).fetchall():
                raise ValueError("it is not a log of MQTT messages: its LOG is computed, perhaps without end")
            self._rows = self._log.execute(_ROWS)
        except sqlite3.Error as error:
            raise ValueError(f"it is not a log of MQTT messages: {error}") from error

    def _next_frames(self, file: BinaryIO) -> list[Frame] | None:
        try:
            rows = self._rows.fetchmany(_MOST_AT_ONCE)
        except sqlite3.Error as error:
            self.damage = f"the log is damaged ({error}); reading ended there"
            return None
        return list(self._frames(rows)) if rows else None

    def _frames(self, rows: list[tuple[Any, Any, Any]]) -> Iterable[Frame]:
        for seconds, topic, message in rows:
            time_ns = round(seconds * 1e6) * 1000 if isinstance(seconds, int | float) else 0
            if not isinstance(topic, str) or not isinstance(message, str | bytes) or not is_possible(time_ns):
                self.unreadable += 1
            elif self._is_subscribed(topic):
                text = message.encode() if isinstance(message, str) else message
                self._monotonic_ns = max(self._monotonic_ns, time_ns)
                payload = topic.encode("utf-8", "replace") + b"\0" + text
                yield Frame(self.name, "mqtt", payload, time_ns, self._monotonic_ns, stamped_ns=time_ns)

    def _is_subscribed(self, topic: str) -> bool:
        if topic not in self._topics:
            patterns = [*self._config.topics, *(entry.topic for entry in self._config.values.values())]
            self._topics[topic] = not self._config.topics or any(covers(pattern, topic) for pattern in patterns)
        return self._topics[topic]

    def close(self) -> None:
        if self._link is not None and hasattr(self, "_log"):
            self._log.close()
        super().close()
