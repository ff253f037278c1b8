"""A source of a user's own: a class that reads whatever device there is and tells channels by name.

    class Inclinometer:
        def __init__(self, device): ...        # the source's `options`; may be left out
        def read(self, timeout_s): ...         # {"roll_deg": 1.5, "pitch_deg": -0.2}, in the channels' units
        def close(self): ...                   # may be left out

``read`` waits so long at the most and returns what came: a dict of channels, in which ``time`` may say when it was
measured (UTC, s since 1970); a line of NMEA 0183; a list of those, empty where nothing came; None when nothing will
ever come again. The class is made when the source is opened: what it raises there, and in ``read``, counts as a
source that failed, is recorded as an event and tried again, while other sources go on.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from seatrial.acquisition.config.sections import OwnSource
from seatrial.acquisition.core.frames import Frame, now_ns
from seatrial.acquisition.core.named_code import file_of, load, own_code, require_call
from seatrial.acquisition.sources import Source

_LINES = "own/lines"


class OwnCode(Source):
    """One object of a user's class. Raises :class:`ConfigurationError` for what is no such class."""

    def __init__(self, config: OwnSource) -> None:
        super().__init__(config)
        self._class: Any = load(config.code, "sources")
        self._file = file_of(self._class)
        require_call(self._class, config.code, "timeout_s", method="read")

    def _connect(self) -> Any:
        with own_code(self._config.code, self._file):
            return self._class(**self._config.options)

    def _receive(self, timeout_s: float) -> list[Frame] | None:
        with own_code(f"{self._config.code}.read", self._file):
            received = self._link.read(timeout_s)
        if received is None:
            return None
        clocks = now_ns()
        payloads = [
            payload
            for reading in (received if isinstance(received, list) else [received])
            for payload in self._payloads(reading)
        ]
        return [Frame(self.name, "mqtt", payload, *clocks) for payload in payloads]

    def _payloads(self, reading: Any) -> Iterator[bytes]:
        if isinstance(reading, str | bytes):
            yield f"{_LINES}\0".encode() + (reading.encode() if isinstance(reading, str) else reading)
            return
        if not isinstance(reading, dict):
            raise self.failure(
                f"read returned a {type(reading).__name__}", fix="return a dict of channels, or a list"
            )
        time = reading.get("time")
        for name, value in reading.items():
            if name != "time":
                if name not in self._config.values:
                    raise self.failure(
                        f"tells {name!r}", "it is no channel", "declare it as [[channel]], or rename it"
                    )
                yield f"own/{name}\0{value}{'' if time is None else f',{time}'}".encode()

    def close(self) -> None:
        if self._link is not None and hasattr(self._link, "close"):
            with own_code(f"{self._config.code}.close", self._file):
                self._link.close()
        self._link = None
