"""The sections of a trial's TOML file as frozen objects, one class for each kind of source.

Each source lists the channels it provides; where several provide one, their order in the file is the order of
preference. ``clock = "source"`` stamps a source's samples with the time reported by the source; the default
stamps them with the time of reception and stores the source's time as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import field, fields, replace
from difflib import get_close_matches
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    StringConstraints,
    ValidationInfo,
    model_validator,
)
from pydantic.dataclasses import dataclass

from seatrial.acquisition.config import declarations, run_sheet
from seatrial.acquisition.core import errors, files, named_code, quantities, ship, times

_MOST_LETTERS = 10  # in the name of a MAVLink named value
_ONE_TOPIC = r"^[^+#\x00]+$"
_TOPICS = r"^(?:(?:\+|[^+#/\x00]*)/)*(?:\+|#|[^+#/\x00]*)$"
"""Topics that may have wildcards: ``+`` stands for one level, ``#`` for all further ones."""

Model = TypeVar("Model")


def _actuators_of_file(info: ValidationInfo) -> ship.Actuators:
    """The actuators listed in the file being read, else R/V Gunnerus'."""
    actuators: ship.Actuators = (info.context or {}).get("actuators", ship.DEFAULT)
    return actuators


def check_channel(name: str, actuators: ship.Actuators = ship.DEFAULT, declared: ship.Declared = ()) -> str:
    """Check the name of a ship's or a declared channel. Raises :class:`ValueError` that suggests similar names."""
    names = ship.channel_names(actuators, declared)
    if name not in names:
        suggestions = get_close_matches(name, names, n=1, cutoff=0.4) or ship.trial_channel_names(actuators)
        raise ValueError(f"is no channel; did you mean {' '.join(suggestions)}?")
    return name


def _check_shaft_of_ship(name: str, info: ValidationInfo) -> str:
    ship_shafts = ship.shafts(_actuators_of_file(info))
    if name not in ship_shafts:
        raise ValueError(f"is not a shaft of the ship; its shafts are {', '.join(ship_shafts) or 'none'}")
    return name


def _check_rotor_of_ship(name: str, info: ValidationInfo) -> str:
    rotors = [actuator.name for actuator in _actuators_of_file(info) if actuator.channels[0].unit == "rpm"]
    if name not in rotors:
        raise ValueError(f"is not an actuator with rpm; those are {', '.join(rotors) or 'nothing'}")
    return name


def _absolute_path(path: Path, info: ValidationInfo) -> Path:
    """A path relative to the file being read; for a DBC file that a recording's configuration names, its copy."""
    context = info.context or {"folder": Path(), "dbc_files": None}
    attached: Mapping[str, Path] | None = context["dbc_files"]
    if info.field_name != "dbc" or attached is None:
        return Path(context["folder"] / path)
    name = str(info.data.get("name"))
    if name not in attached:
        raise ValueError(
            f"the recording has no attachment {name}.dbc, and no other file is read; {declarations.GIVE_CONFIG}"
        )
    return attached[name]


ChannelName = Annotated[
    str,
    AfterValidator(
        lambda name, info: check_channel(name, _actuators_of_file(info), (info.context or {}).get("declared", ()))
    ),
]
AbsolutePath = Annotated[Path, AfterValidator(_absolute_path)]
Clock = Literal["receiver", "source"]
Form = Literal[
    "nmea0183", "candump", "savvycan", "python_can", "canboat", "yacht_devices", "n2k_ascii", "ikonvert",
    "seasmart", "mxpgn", "garmin", "opencpn", "actisense", "ebl", "ydvr", "yd_can", "pcap", "pcapng", "asc",
]  # fmt: skip
"""The formats of gateways and log files, by the names in ``acquisition/sources``."""
Port = Annotated[int, Field(ge=1, le=65_535)]
PageOrigin = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9+.-]*://[^\s/@]*$")]
"""Where a page in a browser comes from, as the browser states it: scheme, host and port."""
FinitePositive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
ReductionRatios = dict[Annotated[str, AfterValidator(_check_shaft_of_ship)], FinitePositive]
"""Engine turns for one turn of the shaft, by actuator."""
RatedSpeeds = dict[Annotated[str, AfterValidator(_check_rotor_of_ship)], FinitePositive]
"""The rpm at 100 %, by actuator."""
Angle = Annotated[float, Field(ge=-180, le=360)]
IsoName = Annotated[str, StringConstraints(pattern=r"^[0-9a-fA-F]{16}$", to_lower=True)]


@dataclass(frozen=True, config=declarations.STRICT)
class ActuatorSection:
    """One of the ship's actuators, as in a vessel file: name and kind."""

    name: str
    kind: str


@dataclass(frozen=True, config=ConfigDict(extra="ignore"))
class _Named:
    vessel: object = ""


@dataclass(frozen=True, config=ConfigDict(extra="ignore"))
class _Ship:
    actuator: tuple[ActuatorSection, ...] = ()
    channel: tuple[declarations.ChannelSection, ...] = ()
    pack: tuple[declarations.PackSection, ...] = ()
    trial: _Named = field(default_factory=_Named)


class DeclaredShip(NamedTuple):
    """The ship of a file: its actuators, whether the file states them, the channels that it declares, its packs."""

    actuators: ship.Actuators
    is_known: bool
    declared: declarations.Declarations
    packs: tuple[declarations.PackFile, ...]


@dataclass(frozen=True)
class CarriedFiles:
    """What a recording carries besides its configuration: DBC files by source, packs by name, the actuators, and
    whether it states that these are its ship's.

    Nothing else that its configuration names is opened: the recording may be from an untrusted source.
    """

    dbc_files: Mapping[str, Path] = field(default_factory=dict)
    packs: Mapping[str, str] = field(default_factory=dict)
    actuators: ship.Actuators | None = None
    ship_is_known: bool = True


def parse_with_declarations(
    text: str, path: Path | str, model: type[Model], carried: CarriedFiles | None = None
) -> tuple[Model, DeclaredShip]:
    """A TOML text as ``model``, with the channels of the ship that it lists as ``[[actuator]]`` or declares.

    Without such a list the actuators are those ``carried`` by a recording, as are the DBC files and packs that it
    names; else those of the ship named in ``[trial]``, else R/V Gunnerus'. Paths are relative to the file's folder.
    Raises :class:`ConfigurationError` naming the line.
    """
    raw, folder = files.parse_toml(text, path), Path(path).resolve().parent
    ship_file = files.validate_toml(
        {section.name: raw[section.name] for section in fields(_Ship) if section.name in raw}, text, path, _Ship
    )
    try:
        listed = [ship.Actuator(section.name, section.kind) for section in ship_file.actuator]
        in_file = ship.check_actuators(listed) if listed else ()
    except errors.ConfigurationError as error:
        raise error.at(f"{path}, line {files.line_of_toml_key(text, ['actuator'])}") from error
    in_recording = None if carried is None else carried.actuators
    actuators = in_file or in_recording or declarations.actuators_of_ship(str(ship_file.trial.vessel), folder)
    is_known = bool(actuators) if carried is None or in_file else carried.ship_is_known
    actuators = actuators or ship.DEFAULT
    packs = declarations.read_packs(ship_file.pack, folder, None if carried is None else carried.packs, text, path)
    ship_channels = {name: ship.BY_NAME[name] for name in ship.channel_names(actuators)}
    declared = declarations.merge_declarations(ship_file.channel, packs, ship_channels, text, path)
    context = {
        "actuators": actuators,
        "declared": tuple(
            declaration.channel for declaration in declared if declaration.channel.name not in ship_channels
        ),
        "folder": folder,
        "dbc_files": None if carried is None else carried.dbc_files,
    }
    return files.validate_toml(raw, text, path, model, context), DeclaredShip(actuators, is_known, declared, packs)


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class Signal(declarations.Conversion):
    """A signal of a DBC file that carries a channel; the unit is that of the signal's physical value."""

    message: str
    signal: str
    unit: str


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class NamedValue(declarations.Conversion):
    """A MAVLink NAMED_VALUE_FLOAT that carries a channel; its name has at most ten letters."""

    name: Annotated[str, Field(pattern=rf"^[\x21-\x7e]{{1,{_MOST_LETTERS}}}$")]
    unit: str


class Thrusters(BaseModel):
    """The numbers of the actuators in TRD and TRC sentences, by name; by default odd at the bow, even aft.

    ``channels_from = "demand"`` fills the thruster channels from TRC, the orders, on vessels that send no
    responses; by default the channels are the responses, and orders have channels of their own.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, int] = Field(init=False)

    channels_from: Literal["response", "demand"] = "response"

    @property
    def numbers(self) -> dict[str, int]:
        return self.__pydantic_extra__

    @model_validator(mode="before")
    @classmethod
    def _fill_in_default_numbers(cls, raw: Any, info: ValidationInfo) -> Any:
        if not isinstance(raw, dict):
            return raw
        defaults = ship.thruster_numbers(_actuators_of_file(info))
        unknown = raw.keys() - defaults.keys() - {"channels_from"}
        if unknown:
            names = ", ".join(defaults) or "none"
            raise ValueError(f"there is no thruster {', '.join(sorted(unknown))}; the thrusters are {names}")
        return {**defaults, **raw}

    @model_validator(mode="after")
    def _check_numbers(self) -> Thrusters:
        if len(set(self.numbers.values())) < len(self.numbers):
            raise ValueError("two thrusters have the same number")
        return self


@dataclass(frozen=True, config=declarations.STRICT)
class Mounting:
    """The mounting of a source's sensors; angles are added to the reported values.

    ``heading_deg`` to compass headings, ``wind_angle_deg`` to wind angles relative to the bow; ``forward_m``
    and ``starboard_m`` are the place, from the reference point, at which positions and speeds are measured.
    """

    heading_deg: Angle = 0.0
    wind_angle_deg: Angle = 0.0
    forward_m: declarations.Finite = 0.0
    starboard_m: declarations.Finite = 0.0


@dataclass(frozen=True, config=declarations.STRICT)
class Device:
    """A device on an NMEA 2000 bus, identified by its 64-bit NAME (16 hexadecimal digits) or by its address.

    The order of a source's devices is the order of preference; ``channels`` limits what a device may provide.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    iso_name: IsoName | None = None
    address: Annotated[int, Field(ge=0, le=253)] | None = None
    channels: tuple[ChannelName, ...] | None = None

    def __post_init__(self) -> None:
        if (self.iso_name is None) == (self.address is None):
            raise ValueError("give either the iso_name or the address of a device")


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Source:
    """The settings of every source: name, the channels it provides, the clock that stamps them, mounting.

    ``rates_hz`` are the expected rates of channels, by which the display grades them. ``budget_kb_s`` limits how
    much of a live source is stored in the long run [kB/s]; by default four full CAN buses of 500 kbit/s.
    """

    name: str
    channels: tuple[ChannelName, ...]
    clock: Clock = "receiver"
    mounting: Mounting = field(default_factory=Mounting)
    rates_hz: dict[ChannelName, FinitePositive] = field(default_factory=dict)
    budget_kb_s: FinitePositive = 1000.0


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Engines(_Source):
    """A source of engine speeds, which with ``reduction_ratios`` give those of their shafts."""

    reduction_ratios: ReductionRatios = field(default_factory=dict)


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _CanFrames(_Engines):
    """The settings of every stream of CAN frames: its devices, and the vessel's frames by a DBC file.

    ``addresses`` are the accepted source addresses on the bus, by default all.
    """

    devices: tuple[Device, ...] = ()
    addresses: tuple[Annotated[int, Field(ge=0, le=255)], ...] = ()
    dbc: AbsolutePath | None = None
    signals: dict[ChannelName, Signal] = field(default_factory=dict)


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class CanSource(_CanFrames):
    """A CAN bus by python-can: NMEA 2000, and with a DBC file the vessel's frames.

    ``options`` are passed to python-can's interface unchanged (bitrate, port, hop_limit ...).
    """

    type: Literal["can"]
    interface: str
    channel: str
    options: dict[str, str | int | float | bool] = field(default_factory=dict)


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Port(_Source):
    """A UDP or TCP port: one of this computer that receives datagrams, or a remote one that we connect to.

    ``senders`` are the accepted addresses or networks, by default all.
    """

    port: Port
    address: str = "127.0.0.1"
    senders: tuple[IPv4Network | IPv6Network, ...] = ()


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Sentences(_Engines):
    """The settings of every source of NMEA 0183; by ``rated_rpm`` percentages in TRD, TRC and PRC become rpm.

    ``theoretical_wind`` is the reference of MWV's "T" on this vessel, which the sentence does not state. With an
    ``optional`` checksum sentences that come without one are decoded, too; those with a wrong one never are.
    """

    thrusters: Thrusters = Field(default_factory=dict, validate_default=True)
    rated_rpm: RatedSpeeds = field(default_factory=dict)
    theoretical_wind: Literal["ground", "water"] = "ground"
    checksum: Literal["required", "optional"] = "required"


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Lines(_Sentences, _CanFrames):
    """The settings of every line: of NMEA 0183, of a gateway that sends NMEA 2000, or of both.

    ``form`` is the format of a gateway or log, needed where it cannot be recognised.
    """

    form: Form | Literal[""] = ""


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class SerialSource(_Lines):
    """NMEA 0183, or a gateway's NMEA 2000, on a serial line."""

    type: Literal["serial"]
    device: str
    baud_rate: PositiveInt = 4800


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class UdpSource(_Port, _Lines):
    """NMEA 0183 in UDP datagrams that are sent to this address and port."""

    type: Literal["udp"]


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class TcpSource(_Port, _Lines):
    """NMEA 0183 from a TCP server, a multiplexer or gateway, that we connect to."""

    type: Literal["tcp"]


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class FileSource(_Lines):
    """A log of sentences, CAN frames or whole messages, recognised by its content, read once to its end.

    ``can_file`` is an older name of one with CAN frames. ``date_order`` says what comes first in the dates before
    its sentences, where the log leaves that open.
    """

    type: Literal["file", "can_file"]
    path: AbsolutePath
    date_order: times.Order | None = None


_ABBREVIATIONS = (
    ("starboard", "stbd"), ("_angle_deg", "_ang"), ("_pitch_percent", "_pitch"), ("propeller", "prop"),
    ("rudder", "rud"), ("thruster", "thr"), ("_", ""),
)  # fmt: skip
"""Abbreviations that shorten channel names until they fit MAVLink."""


def _default_named_values(raw: Any, info: ValidationInfo) -> Any:
    """By default, the channels that MAVLink's RPM cannot carry, by short names: ``port_ang``, ``stbd_ang``."""
    if raw is not None:
        return raw
    actuators = _actuators_of_file(info)
    carried = {f"{name}_rpm" for name in ship.shafts(actuators)[:2]}
    units = {
        channel.name: channel.unit for channel in ship.control_channels(actuators) if channel.name not in carried
    }
    short_names = {}
    for name in units:
        short_name = name
        for number, (word, abbreviation) in enumerate(_ABBREVIATIONS):
            if number < 3 or len(short_name) > _MOST_LETTERS:
                short_name = short_name.replace(word, abbreviation)
        short_names[name] = short_name
    counts = Counter(short_name for short_name in short_names.values() if len(short_name) <= _MOST_LETTERS)
    return {
        name: {"name": short_name, "unit": units[name]}
        for name, short_name in short_names.items()
        if counts[short_name] == 1
    }


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Mavlink(_Source):
    """The settings of every MAVLink link: the system to listen to. ``messages`` limits the messages decoded."""

    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    component_id: Annotated[int, Field(ge=1, le=255)] | None = None
    messages: tuple[str, ...] | None = None
    named_values: Annotated[dict[ChannelName, NamedValue], BeforeValidator(_default_named_values)] = Field(
        default=None, validate_default=True
    )


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MavlinkSource(_Port, _Mavlink):
    """MAVLink in UDP datagrams that are sent to this address and port, from one system."""

    type: Literal["mavlink"]


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MavlinkTcpSource(_Port, _Mavlink):
    """MAVLink from a TCP server that we connect to."""

    type: Literal["mavlink_tcp"]


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MavlinkSerialSource(_Mavlink):
    """MAVLink on a serial line."""

    type: Literal["mavlink_serial"]
    device: str
    baud_rate: PositiveInt = 57_600


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MavlinkFileSource(_Mavlink):
    """MAVLink from a telemetry log (.tlog): packets, each after its time."""

    type: Literal["mavlink_file"]
    path: AbsolutePath


def topic_pattern_covers(pattern: str, topics: str) -> bool:
    """Whether a pattern matches a topic, or all topics of another pattern: ``+`` is one level, ``#`` all further.

    >>> topic_pattern_covers("ship/NMEA/#", "ship/NMEA/GPGGA"), topic_pattern_covers("ship/+/x", "ship/#")
    (True, False)
    >>> topic_pattern_covers("#", "$SYS/uptime")
    False
    """
    levels, topic_levels = pattern.split("/"), topics.split("/")
    for number, level in enumerate(levels):
        if level == "#":
            return number > 0 or not topics.startswith("$")
        if number >= len(topic_levels) or topic_levels[number] == "#" or level not in ("+", topic_levels[number]):
            return False
    return len(topic_levels) == len(levels)


def topic_patterns_overlap(pattern: str, other_pattern: str) -> bool:
    """Whether some topic matches both patterns.

    >>> topic_patterns_overlap("ship/+/Heading", "ship/MRU/+"), topic_patterns_overlap("ship/Roll", "ship/Pitch")
    (True, False)
    """
    shorter, longer = sorted((pattern.split("/"), other_pattern.split("/")), key=len)
    for level, other_level in zip(shorter, longer, strict=False):
        if "#" in (level, other_level):
            return True
        if "+" not in (level, other_level) and level != other_level:
            return False
    return len(shorter) == len(longer) or longer[len(shorter)] == "#"


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class TopicValue(declarations.Conversion):
    """An MQTT topic that carries a channel; ``unit`` ``ddmm`` means degrees and minutes in one number.

    A message is a number, ``value,time,...``, either after a time and a space, or a JSON object: then ``field``
    names its value and ``time_field`` its time, in nested objects as ``nav.heading``.
    """

    topic: Annotated[str, StringConstraints(pattern=_ONE_TOPIC)]
    unit: str
    field: str | None = None
    time_field: str = "time"

    def conversion_to_channel(self, channel: ship.Channel, default_unit: str | None = None) -> quantities.Linear:
        if self.unit == quantities.DEGREES_AND_MINUTES and channel.unit == "deg":
            return replace(self, unit="deg").conversion_to_channel(channel)
        return super().conversion_to_channel(channel, default_unit)


PAIRS: dict[tuple[str, str], tuple[str, ...]] = {
    ("latitude_deg", "longitude_deg"): ("north_m", "east_m"),
    ("course_over_ground_deg", "speed_over_ground_mps"): ("surge_mps", "sway_mps"),
    ("apparent_wind_angle_deg", "apparent_wind_speed_mps"): ("wind_direction_deg", "wind_speed_mps"),
}
"""Pairs of values from which others are derived, with the derived ones."""


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class _Mqtt(_Sentences):
    """The settings of every source of MQTT messages: ``topics`` with sentences, ``values`` with a topic each.

    ``topics`` may have wildcards. Messages are stamped with the time that they contain, by default.
    """

    topics: tuple[Annotated[str, StringConstraints(pattern=_TOPICS, min_length=1)], ...] = ()
    values: dict[ChannelName, TopicValue] = field(default_factory=dict)
    clock: Clock = "source"


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class BrokerAccess:
    """How to reach an MQTT broker; encrypted with ``tls``, or a ``ca_file`` of the broker's authority.

    The password of ``user`` is the first line of ``password_file``, or the environment variable
    ``password_variable``: a configuration is stored in its recording and must not contain it.
    """

    role: ClassVar[str] = "source"
    name: str
    address: str = "127.0.0.1"
    tls: bool = False
    ca_file: AbsolutePath | None = None
    port: Port | None = None
    client_id: str = ""
    user: str = ""
    password_file: AbsolutePath | None = None
    password_variable: str = ""

    @property
    def encrypted(self) -> bool:
        """Whether the connection to the broker uses TLS."""
        return self.tls or self.ca_file is not None

    @property
    def endpoint(self) -> tuple[str, int]:
        """The broker's address and port; by default the usual port."""
        return self.address, self.port or (8883 if self.encrypted else 1883)


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MqttSource(_Mqtt, BrokerAccess):
    """Messages from an MQTT broker."""

    type: Literal["mqtt"]

    def __post_init__(self) -> None:
        if not self.topics and not self.values:
            raise ValueError("has no input: give it topics or values")
        for number, topic in enumerate(self.topics):
            for earlier in self.topics[:number]:
                if (
                    topic_patterns_overlap(topic, earlier)
                    and not topic_pattern_covers(topic, earlier)
                    and not topic_pattern_covers(earlier, topic)
                ):
                    raise ValueError(
                        f"topics {topic} and {earlier} overlap: some brokers deliver common messages twice"
                    )

    @property
    def subscriptions(self) -> list[str]:
        """The topics to subscribe to, none of them covered by another."""
        topics = list(dict.fromkeys([*self.topics, *(entry.topic for entry in self.values.values())]))
        return [
            topic
            for topic in topics
            if not any(topic_pattern_covers(wider, topic) for wider in topics if wider != topic)
        ]


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class MqttFileSource(_Mqtt):
    """MQTT messages from an SQLite log, by default of all topics."""

    type: Literal["mqtt_file"]
    path: AbsolutePath


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class TopicFileSource(_Mqtt):
    """A log of several topics, such as a bag of ROS or a measurement: ``values`` name a topic and a ``field`` each.

    Its messages are kept as those of a broker would be, with the numbers in their frames and signs as the import
    has them (``seatrial info`` shows topics and fields).
    """

    type: Literal["topic_file"]
    path: AbsolutePath

    def __post_init__(self) -> None:
        if self.topics or not self.values:
            raise ValueError("needs values, a topic and a field each, and has no topics of sentences")

    @property
    def wanted_fields(self) -> list[tuple[str, str]]:
        """The topics and the fields in them that carry a channel."""
        return [(entry.topic, entry.field or "value") for entry in self.values.values()]


def _topic_values_of_user_code(raw: object, info: ValidationInfo) -> dict[str, dict[str, str]]:
    """The channels that a user's code may provide, each under a separate topic, in the channel's unit."""
    if raw:
        raise ValueError("is not for a source of your own, which returns channels by name, in their units")
    declared = (info.context or {}).get("declared", ())
    channels, names = ship.channels_with_declared(declared), ship.channel_names(_actuators_of_file(info), declared)
    return {name: {"topic": f"own/{name}", "unit": channels[name].unit} for name in names}


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class OwnSource(_Mqtt):
    """A user-defined source: ``class`` is ``FILE.py:CLASS``, or an entry point of ``seatrial.sources``.

    ``options`` are passed to the class. Its values are stored like MQTT messages, one topic for each channel.
    """

    type: Literal["own"]
    code: Annotated[
        str,
        Field(alias="class"),
        AfterValidator(
            lambda name, info: named_code.absolute_code_reference(name, (info.context or {}).get("folder"))
        ),
    ]
    options: dict[str, Any] = field(default_factory=dict)
    values: Annotated[dict[ChannelName, TopicValue], BeforeValidator(_topic_values_of_user_code)] = Field(
        default_factory=dict, validate_default=True
    )


LineSource = SerialSource | UdpSource | TcpSource | FileSource
CanFrames = CanSource | LineSource
MavlinkLinks = MavlinkSource | MavlinkTcpSource | MavlinkSerialSource | MavlinkFileSource
MqttLinks = MqttSource | MqttFileSource | TopicFileSource | OwnSource
AnySource = CanFrames | MavlinkLinks | MqttLinks
FILE_SOURCES = (FileSource, MavlinkFileSource, MqttFileSource, TopicFileSource)


@dataclass(frozen=True, config=declarations.STRICT)
class RecordingSection:
    """How often received data are handed to the system (flush) and forced to the disk (sync).

    ``queue_frames`` is the number of frames of each source that may wait for the disk. A new part begins after
    ``split_minutes`` or ``split_mb``. Writing stops, with the file properly closed, when less than
    ``reserve_mb`` is free on the disk (by default a twentieth of the disk, at most 200 MB).
    """

    flush_s: FinitePositive = 0.2
    sync_s: FinitePositive = 0.5
    queue_frames: PositiveInt = 50_000
    split_minutes: FinitePositive | None = 60.0
    split_mb: FinitePositive | None = None
    reserve_mb: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None


@dataclass(frozen=True, config=declarations.STRICT)
class CopiesSection:
    """The existing folder that finished parts are copied to: on another disk, below its mount point.

    Beyond ``keep_gb``, if given, the oldest parts are deleted where they were recorded once a copy is verified.
    """

    folder: AbsolutePath
    keep_gb: FinitePositive | None = None


@dataclass(frozen=True, config=declarations.STRICT)
class LiveSection:
    """The live view for Foxglove and Lichtblick: the address it listens on, by default this computer only.

    ``origins`` names the pages that may show it in a browser, like ``https://app.foxglove.dev``; programs that send
    no origin need none.
    """

    port: Port = 8765
    address: str = "127.0.0.1"
    origins: tuple[PageOrigin, ...] = ()


@dataclass(frozen=True, config=declarations.STRICT)
class StatusSection:
    """The status page, for browsers and programs on this computer only."""

    port: Port = 8088


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class AlarmSection:
    """An alarm: one of the recorder's figures is ``above`` or ``below`` a limit for a number of seconds.

    ``command`` is run when the alarm is raised and when it ends, with the text on its standard input.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)]
    figure: str
    above: declarations.Finite | None = None
    below: declarations.Finite | None = None
    for_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 2.0
    command: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.above is None and self.below is None:
            raise ValueError("an alarm needs a limit: above, below, or both")


MarkKeys = dict[Annotated[str, Field(min_length=1, max_length=1)], Annotated[str, Field(min_length=1)]]
"""Keys of the display, and the event mark that each sets."""


@dataclass(frozen=True, config=declarations.STRICT, kw_only=True)
class TrialSection(run_sheet.RunSheet):
    """The run sheet of a trial to record, which needs a name. Without an origin the first fix becomes it.

    ``magnetic_variation_deg`` (east positive) serves a magnetic compass until a device reports the variation.
    """

    name: Annotated[str, Field(min_length=1, max_length=100)]
    magnetic_variation_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
