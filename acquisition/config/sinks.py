"""The sinks of a trial's TOML file: where decoded channels go live, besides into the recording.

A configuration is stored in its recording: tokens and passwords come from the environment or from files.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal
from urllib.parse import SplitResult, urlsplit

from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config import declarations, sources

_SCHEMES = ("http", "https", "tcp", "udp")


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Sink:
    """The settings of every sink: its name, the ``channels`` that it gets, by default all.

    Of each channel at most ``rate_hz`` values a second are passed on. While the sink does not take them, up to
    ``queue_values`` wait; then the oldest are dropped, and counted.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    channels: tuple[sources.ChannelName, ...] = ()
    rate_hz: sources.FinitePositive = 1.0
    queue_values: Annotated[PositiveInt, Field(le=1_000_000)] = 10_000


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class InfluxSink(_Sink):
    """InfluxDB's line protocol, written over HTTP to a ``bucket`` (of ``org``) or a ``database``, or sent by TCP or
    UDP to Telegraf and whatever else takes it.

    Each value is a line ``measurement,trial=NAME channel=value`` with its time in ns. The token is the first line
    of ``token_file``, or the environment variable ``token_variable``.
    """

    type: Literal["influx"]
    url: str
    bucket: str = ""
    org: str = ""
    database: str = ""
    measurement: Annotated[str, Field(min_length=1, max_length=100)] = "seatrial"
    token_file: sources.AbsolutePath | None = None
    token_variable: str = ""
    ca_file: sources.AbsolutePath | None = None

    def __post_init__(self) -> None:  # whose errors do not show the value: a user may have put a password into it
        try:
            place = self.place
            is_known = place.scheme in _SCHEMES and bool(place.hostname) and place.port != 0
        except ValueError:
            is_known = False
        if not is_known:
            raise ValueError(f"the url of an Influx sink begins with {', '.join(_SCHEMES)}, like http://host:8086")
        if "@" in place.netloc or place.query or place.fragment:
            raise ValueError("a url has no user, password or query here: say token_variable, bucket, org, database")
        if self.over_http and bool(self.bucket) == bool(self.database):
            raise ValueError("a url of http needs a bucket (InfluxDB 2 and 3) or a database (InfluxDB 1)")
        if not self.over_http and place.port is None:
            raise ValueError(f"a url of {place.scheme} needs a port, like {place.scheme}://127.0.0.1:8094")

    @property
    def place(self) -> SplitResult:
        """The parts of the url."""
        return urlsplit(self.url)

    @property
    def over_http(self) -> bool:
        """Whether it is written over HTTP, so that the server says what it has taken."""
        return self.place.scheme in ("http", "https")


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MqttSink(_Sink, sources.BrokerAccess):
    """Messages to an MQTT broker, one topic a channel below ``topic``.

    A message is a JSON object of value, unit, time and source, or with ``form = "value"`` the text
    ``value,time,unit``; with ``retain`` the broker keeps the last one of each channel.
    """

    role: ClassVar[str] = "sink"
    type: Literal["mqtt"]
    topic: Annotated[str, Field(pattern=r"^[^+#\x00/]+(?:/[^+#\x00/]+)*$")] = "seatrial"
    form: Literal["json", "value"] = "json"
    retain: bool = False


AnySink = InfluxSink | MqttSink
