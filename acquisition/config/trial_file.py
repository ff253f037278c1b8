"""Reading and checking a trial's TOML file; every error names the line and how to correct it.

Besides into the recording, decoded channels may go live to sinks. A configuration is stored in its recording: their
tokens and passwords come from the environment or from files.
"""

from __future__ import annotations

import os
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal
from urllib.parse import SplitResult, urlsplit

from pydantic import ConfigDict, Discriminator, Field, PositiveInt
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config import declarations, run_sheet
from seatrial.acquisition.config import sources as sections
from seatrial.acquisition.core import ship as ships
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import line_of_toml_key, read_text
from seatrial.acquisition.core.trial import Trial

CONFIGURATION = "configuration.toml"
"""The name of the configuration among a recording's attachments."""

PACK_ENDING = ".pack"
"""The ending of the name of a pack's attachment."""
_MAPS = {sections.CanFrames: "signals", sections.MavlinkLinks: "named_values", sections.MqttLinks: "values"}
"""The key under which each kind of source maps messages to channels."""
_LISTENING = (sections.UdpSource, sections.MavlinkSource)
_SERIAL = (sections.SerialSource, sections.MavlinkSerialSource)
_LOCAL = {"localhost": "127.0.0.1", "0.0.0.0": ""}
"""Other names of addresses; the empty one means all of this computer's."""
_MAPPING_HINT = {
    "can": "say which DBC signal does in [source.signals], or for a shaft its engine's turns for one of its own in"
    " reduction_ratios, or take it off the source's channels",
    "mqtt": "say which topic does in [source.values], give the topics of the sentences that do, or take it off the"
    " source's channels",
    "mavlink": "say which named value does in [source.named_values], or take it off the source's channels",
}
_DECLARATION_HINT = (
    "say in a [[channel]] of this name, under `from`, which message of the source carries it, or take it off the"
    " source's channels"
)
_SENTENCES_HINT = (
    "take it off the source's channels: NMEA 0183 tells of two rudders (RSA, ROR), three shafts (RPM, PRC), azimuth"
    " and tunnel thrusters (TRD, TRC), not of waterjets' nozzles; the maker's CAN frames may, or NMEA 2000 by a"
    " gateway, whose `form` is to be given"
)
_MOTION = frozenset(ships.MOTION) | {
    "latitude_deg", "longitude_deg", "speed_over_ground_mps", "course_over_ground_deg",
}  # fmt: skip
_ATTITUDE = frozenset({"roll_deg", "pitch_deg"})
_NAUTICAL = (
    frozenset(channel.name for channel in ships.AUXILIARY if not ships.is_held_setting(channel))
    - _ATTITUDE
    - {"heave_m"}
)
"""What both NMEA protocols are read for besides the motion: every auxiliary channel but these."""
_SCHEMES = ("http", "https", "tcp", "udp")
"""Of the urls of sinks."""


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Sink:
    """The settings of every sink: its name, the ``channels`` that it gets, by default all.

    Of each channel at most ``rate_hz`` values a second are passed on. While the sink does not take them, up to
    ``queue_values`` wait; then the oldest are dropped, and counted.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    channels: tuple[sections.ChannelName, ...] = ()
    rate_hz: sections.FinitePositive = 1.0
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
    measurement: Annotated[str, Field(max_length=100, pattern="^[^#]")] = (
        "seatrial"  # a line from # on is a comment
    )
    token_file: sections.AbsolutePath | None = None
    token_variable: str = ""
    ca_file: sections.AbsolutePath | None = None

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
class MqttSink(_Sink, sections.BrokerAccess):
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


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class _File:
    trial: sections.TrialSection
    source: tuple[Annotated[sections.AnySource, Discriminator("type")], ...]
    actuator: tuple[sections.ActuatorSection, ...] = ()
    channel: tuple[declarations.ChannelSection, ...] = ()
    pack: tuple[declarations.PackSection, ...] = ()
    recording: sections.RecordingSection = field(default_factory=sections.RecordingSection)
    live: sections.LiveSection | None = None
    copies: sections.CopiesSection | None = None
    status: sections.StatusSection | None = None
    alarm: tuple[sections.AlarmSection, ...] = ()
    sink: tuple[Annotated[AnySink, Discriminator("type")], ...] = ()
    marks: sections.MarkKeys = field(default_factory=dict)
    conditions: run_sheet.Conditions = field(default_factory=run_sheet.Conditions)
    context: run_sheet.Context = field(default_factory=run_sheet.Context)
    instruments: run_sheet.InstrumentsSection = field(default_factory=run_sheet.InstrumentsSection)
    particulars: run_sheet.Particulars = field(default_factory=run_sheet.Particulars)


@dataclass(frozen=True)
class TrialConfig:
    """A validated trial configuration and the text it came from, which goes into the recording."""

    trial: Trial
    sources: tuple[sections.AnySource, ...]
    recording: sections.RecordingSection
    text: str
    path: Path
    live: sections.LiveSection | None = None
    copies: sections.CopiesSection | None = None
    status: sections.StatusSection | None = None
    alarms: tuple[sections.AlarmSection, ...] = ()
    sinks: tuple[AnySink, ...] = ()
    marks: sections.MarkKeys = field(default_factory=dict)
    magnetic_variation_deg: float | None = None
    declared: declarations.Declarations = ()
    packs: tuple[declarations.PackFile, ...] = ()

    @property
    def attachments(self) -> dict[str, bytes]:
        """The attachments needed to decode a recording again: this configuration, its DBC files and packs."""
        dbc = {
            f"{source.name}.dbc": source.dbc.read_bytes()
            for source in self.sources
            if isinstance(source, sections.CanFrames) and source.dbc is not None
        }
        packs = {f"{pack.name}{PACK_ENDING}": pack.text.encode() for pack in self.packs}
        return {CONFIGURATION: self.text.encode(), **dbc, **packs}

    @property
    def actuators(self) -> ships.Actuators:
        return ships.parse_actuators(self.trial.actuators)

    @property
    def ship_is_known(self) -> bool:
        """Whether the file lists the ship's actuators, or names a vessel whose file does."""
        return ships.is_ship_known(self.trial.vessel, self.trial.actuators)

    @property
    def known_channels(self) -> ships.ChannelsByName:
        """The channels by name, including declared ones."""
        return ships.channels_with_declared(tuple(declaration.channel for declaration in self.declared))

    @property
    def expected_channels(self) -> frozenset[str]:
        """The channels that some source provides."""
        return frozenset(name for source in self.sources for name in source.channels)

    @property
    def required_channels(self) -> tuple[str, ...]:
        """The channels that the trial has to have; controls of a ship that is not known only as listed."""
        return ships.required_channel_names(
            self.actuators, self.expected_channels, ship_is_known=self.ship_is_known
        )

    @property
    def watched_channels(self) -> tuple[str, ...]:
        """The channels watched for gaps: the trial's, and declared ones listed for a source."""
        required = self.required_channels
        declared = (declaration.channel.name for declaration in self.declared)
        return (*required, *(name for name in declared if name in self.expected_channels and name not in required))

    @property
    def missing_channels(self) -> tuple[str, ...]:
        """Those of the trial's channels that no source provides."""
        return tuple(name for name in self.required_channels if name not in self.expected_channels)


def load_config(path: Path | str) -> TrialConfig:
    """Read and check a trial's configuration.

    Relative paths in it are relative to the file itself. Raises :class:`ConfigurationError` naming the line.
    """
    return parse_config(read_text(path), path)


def parse_config(text: str, path: Path | str, carried: sections.CarriedFiles | None = None) -> TrialConfig:
    """Check a configuration's text; files that a recording has ``carried`` replace those that it names.

    Raises :class:`ConfigurationError` naming the line.
    """
    file, ship = sections.parse_with_declarations(text, path, _File, carried)
    if not file.source:
        raise ConfigurationError("has no source", where=str(path), fix="add a [[source]] section")
    channels_by_name = ships.channels_with_declared(tuple(declaration.channel for declaration in ship.declared))
    _check_sources(file.source, ship, channels_by_name, text, path)
    _check_inputs(file.source, text, path)
    _check_sinks(file, text, path)
    listed = {name for source in file.source for name in source.channels}
    declared = [declaration.channel for declaration in ship.declared if declaration.channel.group == "declared"]
    channels = ships.declared_channels_as_json(channel for channel in declared if channel.name in listed)
    trial = file.trial.as_trial(file.conditions, file.context, file.instruments, file.particulars)
    actuators = ships.actuators_as_text(
        ship.actuators, omit_default=not ship.is_known or trial.vessel in ships.SHIPPED
    )
    return TrialConfig(
        trial=replace(trial, actuators=actuators, channels=channels),
        sources=file.source,
        recording=file.recording,
        text=text,
        path=Path(path),
        live=file.live,
        copies=file.copies,
        status=file.status,
        alarms=file.alarm,
        sinks=file.sink,
        marks=file.marks,
        magnetic_variation_deg=file.trial.magnetic_variation_deg,
        declared=ship.declared,
        packs=ship.packs,
    )


def _check_sources(
    sources: tuple[sections.AnySource, ...],
    ship: sections.DeclaredShip,
    channels_by_name: ships.ChannelsByName,
    text: str,
    path: Path | str,
) -> None:
    """Refuse names that cannot be part of a topic, units of another quantity, and channels that no message of a
    source can carry: they would never have a value."""
    names, where = [source.name for source in sources], str(path)
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"two sources are called {name!r}", where=where, fix="give each its own name")
        if not name.replace("_", "").replace("-", "").isalnum():
            fix = "use letters, digits, - and _"
            raise ConfigurationError(f"source name {name!r} is not valid in a topic", where=where, fix=fix)
    for number, source in enumerate(sources):
        key = next(key for kind, key in _MAPS.items() if isinstance(source, kind))
        for channel, entry in getattr(source, key).items():
            try:
                entry.conversion_to_channel(channels_by_name[channel])
            except ConfigurationError as error:
                line = line_of_toml_key(text, ["source", number, key, channel, "unit"])
                raise ConfigurationError(f"{channel}: {error}", where=f"{path}, line {line}") from error
    for number, source in enumerate(sources):
        possible = possible_channels_of_source(source, ship.actuators, ship.declared)
        for channel in source.channels:
            if channel not in possible:
                default_hint = (
                    _SENTENCES_HINT if ships.is_held_setting(channels_by_name[channel]) else _DECLARATION_HINT
                )
                fix = _MAPPING_HINT.get(source.type.partition("_")[0], default_hint)
                where = f"{path}, line {line_of_toml_key(text, ['source', number, 'channels'])}"
                what = f"no message on source {source.name!r} carries {channel}"
                raise ConfigurationError(what, where=where, fix=fix)


def _check_inputs(sources: tuple[sections.AnySource, ...], text: str, path: Path | str) -> None:
    """Refuse log files beside live sources, as their times belong to another day, two sources that would read the
    same port or serial line, and DBC files that are missing."""
    files = [source.name for source in sources if isinstance(source, sections.FILE_SOURCES)]
    if files and len(files) < len(sources):
        what = f"{', '.join(files)} are log files, but other sources are live"
        fix = "use separate configurations for live sources and log files"
        raise ConfigurationError(what, where=str(path), fix=fix)
    for number, source in enumerate(sources):
        for earlier in sources[:number]:
            key = ""
            if isinstance(source, _LISTENING) and isinstance(earlier, _LISTENING) and source.port == earlier.port:
                addresses = {_LOCAL.get(listener.address, listener.address) for listener in (source, earlier)}
                key = "port" if len(addresses) == 1 or "" in addresses else ""
            if isinstance(source, _SERIAL) and isinstance(earlier, _SERIAL):  # whose device may have several names
                is_shared = os.path.realpath(source.device) == os.path.realpath(earlier.device)
                key = "device" if is_shared else ""
            if key:
                what = f"source {source.name!r} has the same {key} as {earlier.name!r}"
                where = f"{path}, line {line_of_toml_key(text, ['source', number, key])}"
                why, fix = "only one source can read it", f"correct `{key}`, or merge the two sources"
                raise ConfigurationError(what, where=where, why=why, fix=fix)
    for source in sources:
        if isinstance(source, sections.CanFrames):
            where = f"{path}, source {source.name!r}"
            if source.dbc is not None and not source.dbc.is_file():
                what = "is not a file" if source.dbc.exists() else "does not exist"
                raise ConfigurationError(f"DBC file {source.dbc} {what}", where=where)
            if source.dbc is None and source.signals:
                raise ConfigurationError("has signals but no dbc file", where=where, fix="add dbc = FILE")


def _check_sinks(file: _File, text: str, path: Path | str) -> None:
    """Refuse sinks of one name, and topics that would come back as input."""
    names = [sink.name for sink in file.sink]
    for number, sink in enumerate(file.sink):
        if sink.name in names[:number]:
            raise ConfigurationError(
                f"two sinks are called {sink.name!r}", where=str(path), fix="give each its own name"
            )
        for source in file.source:
            if not isinstance(sink, MqttSink) or not isinstance(source, sections.MqttSource):
                continue
            is_same_broker = (
                sink.endpoint[1] == source.endpoint[1]
                and len({_LOCAL.get(place.address, place.address) for place in (sink, source)}) == 1
            )
            for topic in source.subscriptions if is_same_broker else ():
                if sections.topic_patterns_overlap(topic, f"{sink.topic}/+"):
                    raise ConfigurationError(
                        f"source {source.name!r} subscribes to {topic}, under which sink {sink.name!r} publishes",
                        where=f"{path}, line {line_of_toml_key(text, ['sink', number])}",
                        why="what is recorded would come back as input",
                        fix="give the sink a `topic` that no source subscribes to",
                    )


def possible_channels_of_source(
    source: sections.AnySource, actuators: ships.Actuators, declared: declarations.Declarations = ()
) -> frozenset[str]:
    """The channels that a source's protocol and mapping can carry, including ``declared`` ones."""
    # any line may be a gateway's to NMEA 2000, but most are not
    has_groups = isinstance(source, sections.CanFrames) and (
        isinstance(source, sections.CanSource | sections.FileSource)
        or bool(source.form or source.devices or source.dbc)
    )
    kinds: list[type] = [declarations.MavlinkField] if isinstance(source, sections.MavlinkLinks) else []
    kinds += (
        [declarations.SentenceField, declarations.Transducer]
        if isinstance(source, sections.LineSource | sections.MqttLinks)
        else []
    )
    kinds += [declarations.GroupField] if has_groups else []
    return _standard_channels_of_source(source, actuators, has_groups=has_groups) | {
        declaration.channel.name
        for declaration in declared
        if any(type(origin) in kinds for origin in declaration.origins)
    }


def _standard_channels_of_source(
    source: sections.AnySource, actuators: ships.Actuators, *, has_groups: bool
) -> frozenset[str]:
    """The channels in the standard messages of a source, and in those that it maps."""
    if isinstance(source, sections.MavlinkLinks):
        return (
            _MOTION
            | _ATTITUDE
            | {f"{name}_rpm" for name in ships.shafts(actuators)[:2]}
            | source.named_values.keys()
        )
    if isinstance(source, sections.MqttSource | sections.TopicFileSource) and not source.topics:
        derived = [channels for pair, channels in sections.PAIRS.items() if set(pair) <= source.values.keys()]
        return frozenset(source.values.keys()).union(*derived)
    steering = ships.rudder_names(actuators)
    nautical = _MOTION | _NAUTICAL | set(() if steering else ships.rudder_channels(actuators))
    if not isinstance(source, sections.CanSource):
        # in RSA and ROR, RPM and PRC, TRD and TRC: shafts by number, whose angles no sentence carries
        complete = {*ships.thruster_numbers(actuators), *(steering if len(steering) <= 2 else ())}
        numbered = ships.shaft_numbers(ships.shafts_in_rpm_sentences(actuators))
        nautical |= {
            channel.name
            for actuator in actuators
            for channel in (*actuator.channels, *actuator.orders)
            if actuator.name in complete or (actuator.name in numbered and channel.unit != "deg")
        }
    if isinstance(source, sections.MqttLinks):
        return nautical | source.values.keys()
    if not has_groups:
        return nautical
    # what parameter groups carry: rudders and their orders, shafts by their engines
    rudder_actuators = [actuator for actuator in actuators if actuator.name in steering]
    angles = {channel.name for rudder in rudder_actuators for channel in (*rudder.channels, *rudder.orders)}
    turns = {f"{name}_rpm" for name in source.reduction_ratios}
    return nautical | _ATTITUDE | angles | turns | source.signals.keys()
