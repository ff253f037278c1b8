"""What a recorder answers to other programs of this computer: marks, who it is, predictions of the ship.

A client says one JSON object: ``{"text", "monotonic_ns"}`` is a mark, ``{"ask": "recording"}`` asks which file is
being written and of which trial, ``{"prediction", "geojson"}`` goes into the recording. The answer is ``ok``, a
JSON object, or ``refused:`` and why; rubbish gets none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import orjson

from acquisition.logger.local_socket import LocalServer, ask, servers
from acquisition.logger.marks import Mark, parse_mark
from acquisition.logger.predictions import Predictions

_QUESTION = orjson.dumps({"ask": "recording"})
_REFUSED = b"refused: "


@dataclass(frozen=True, slots=True)
class RecorderState:
    """A recorder at work: the trial's name, its configuration's path, the part that it writes, and its process.

    ``paused`` says that nothing is written at the moment; ``predictions`` and ``predictions_refused`` count.
    """

    trial: str
    configuration: str
    recording: str
    paused: bool
    process: int
    predictions: int
    predictions_refused: int


Who = Callable[[], RecorderState]


class RequestServer(LocalServer):
    """Hears what others say to a recorder; a context manager. Raises :class:`StorageError` as its parent does."""

    def __init__(self, mark: Mark, who: Who, predictions: Predictions, folder: Path | None = None) -> None:
        super().__init__(self._answered, folder)
        self._mark, self._who, self._predictions = mark, who, predictions

    def _answered(self, said: bytes) -> bytes:
        message = json.loads(said)  # which reads what some programs write and orjson does not
        if "ask" in message:
            return orjson.dumps(asdict(self._who()))
        if "prediction" in message:
            refused = self._predictions.offer(message)
            return _REFUSED + refused.encode() if refused else b"ok"
        self._mark(*parse_mark(message))
        return b"ok"


def running_recorders(folder: Path | None = None, patience_s: float = 1.0) -> list[tuple[Path, RecorderState]]:
    """The recorders that run here, each with its socket; those that do not answer in time are left out."""
    found = []
    for path in servers(folder):
        running = _running(ask(path, _QUESTION, patience_s))
        if running is not None:
            found.append((path, running))
    return found


def _running(answer: bytes | None) -> RecorderState | None:
    try:
        return RecorderState(**orjson.loads(answer or b""))
    except (ValueError, TypeError):  # of another version, or none
        return None


def send_prediction(path: Path, body: Mapping[str, Any], geojson: str = "", patience_s: float = 1.0) -> str:
    """Give a prediction to the recorder at a socket. Returns why it did not take it, or nothing."""
    message = orjson.dumps({"prediction": dict(body), "geojson": geojson}, option=orjson.OPT_SERIALIZE_NUMPY)
    answer = ask(path, message, patience_s)
    if answer is None:
        return "the recorder does not answer"
    return "" if answer == b"ok" else answer.removeprefix(_REFUSED).decode(errors="replace")
