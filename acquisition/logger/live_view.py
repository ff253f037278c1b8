"""The live view: what is being recorded, for Foxglove and Lichtblick, over a WebSocket.

It hears every message after the recorder has written it and hands it to the server's own threads, which drop
the oldest for a viewer that is too slow. Raw input is not served: nobody looks at it, and it is most of the load.
"""

from __future__ import annotations

from typing import Any

from acquisition.config.sections import LiveSection
from acquisition.core.channels import channels_known_to
from acquisition.core.errors import ConfigurationError, SourceError
from acquisition.core.trial import Trial
from acquisition.recording.messages import ENCODING
from acquisition.recording.schemas import RAW_PREFIX, channel_metadata, kind_of

_BACKLOG = 256  # messages a viewer may lag behind: some seconds


class LiveView:
    """A server for viewers while a recording runs; a context manager, and a listener to the recording.

    Raises :class:`ConfigurationError` without the ``foxglove-sdk`` package, :class:`SourceError` when the port
    cannot be had.
    """

    def __init__(self, settings: LiveSection, trial: Trial) -> None:
        self._settings, self._name = settings, trial.name
        self._known = channels_known_to(trial)
        self._channels: dict[str, Any] = {}
        self._sdk: Any = None

    def __enter__(self) -> LiveView:
        try:
            import foxglove
        except ImportError as error:
            fix = "pip install 'seatrial[live]'"
            raise ConfigurationError("the live view needs the package foxglove-sdk", fix=fix) from error
        self._sdk, self._context = foxglove, foxglove.Context()
        address, port = self._settings.address, self._settings.port
        try:
            self._server = foxglove.start_server(
                name=self._name, host=address, port=port, context=self._context, message_backlog_size=_BACKLOG
            )
        except Exception as error:  # the package promises no kind of error
            what = f"the live view cannot be served on {address}:{port}"
            fix = "stop the program that uses the port, or give another in [live]"
            raise SourceError(what, why=str(error), fix=fix) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()

    @property
    def address(self) -> str:
        """Where a viewer connects to."""
        return f"ws://{self._settings.address}:{self._server.port}"

    def publish(self, topic: str, data: bytes, log_ns: int) -> None:
        """Pass a message on to whoever looks."""
        if topic.startswith(RAW_PREFIX):
            return
        channel = self._channels.get(topic) or self._open(topic)
        channel.log(data, log_time=max(log_ns, 0))

    def _open(self, topic: str) -> Any:
        kind = kind_of(topic)
        schema = self._sdk.Schema(name=kind.title, encoding=ENCODING, data=kind.descriptors)
        metadata = channel_metadata(topic, self._known)
        self._channels[topic] = self._sdk.Channel(
            topic, schema=schema, message_encoding=ENCODING, metadata=metadata, context=self._context
        )
        return self._channels[topic]
