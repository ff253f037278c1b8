"""MQTT messages from an SQLite log, as mqtt-logger and the logging tools of R/V Gunnerus write it.

Its table ``LOG`` has a row a message: ID, RUN_ID, UNIX_TIME (when it came), TOPIC, MESSAGE.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from typing import Any, BinaryIO

from acquisition.core.frames import Frame
from acquisition.core.topics import covers
from acquisition.decoders.clock import is_possible
from acquisition.sources import LogReader
from acquisition.sources.looks import SQLITE, looks_like

_ROWS = "SELECT UNIX_TIME, TOPIC, MESSAGE FROM LOG ORDER BY ID"
_MOST_AT_ONCE = 300
_HEAD_BYTES = 4096


class MqttLog(LogReader):
    """One log; ``unreadable`` counts rows without a topic or a time, ``damage`` is what ended its reading."""

    def _begin(self, file: BinaryIO) -> None:
        self.unreadable, self.damage = 0, ""
        self._monotonic_ns, self._topics = 0, dict[str, bool]()
        head = file.read(_HEAD_BYTES)
        if not head.startswith(SQLITE):
            raise ValueError(f"it is no SQLite database; it looks like {looks_like(head)}")
        try:
            self._log = sqlite3.connect(f"{self._config.path.resolve().as_uri()}?mode=ro", uri=True)
            self._rows = self._log.execute(_ROWS)
        except sqlite3.Error as error:
            raise ValueError(f"it is no log of MQTT messages: {error}") from error

    def _next(self, file: BinaryIO) -> list[Frame] | None:
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
            elif self._wanted(topic):
                text = message.encode() if isinstance(message, str) else message
                self._monotonic_ns = max(self._monotonic_ns, time_ns)
                payload = topic.encode("utf-8", "replace") + b"\0" + text
                yield Frame(self.name, "mqtt", payload, time_ns, self._monotonic_ns, stamped_ns=time_ns)

    def _wanted(self, topic: str) -> bool:
        if topic not in self._topics:
            wanted = [*self._config.topics, *(each.topic for each in self._config.values.values())]
            self._topics[topic] = not self._config.topics or any(covers(each, topic) for each in wanted)
        return self._topics[topic]

    def close(self) -> None:
        if self._link is not None and hasattr(self, "_log"):
            self._log.close()
        super().close()
