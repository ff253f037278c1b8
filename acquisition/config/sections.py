"""The sections of a trial's TOML file as frozen objects, one class a kind of source.

Each source says which channels it provides; where several provide one, the order in the file is the order of
preference. ``clock = "source"`` stamps a source's samples with the time that the source itself tells; the
default stamps them with the time of reception and keeps the source's own beside it.
"""

from __future__ import annotations

from dataclasses import field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Field, PositiveFloat, PositiveInt, StringConstraints
from pydantic.dataclasses import dataclass

from acquisition.core.channels import BY_NAME, NAMES
from acquisition.core.trial import Trial

STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)


def check_channel(name: str) -> str:
    """A channel's name as it is; :class:`ValueError` with what may be meant for another."""
    if name not in BY_NAME:
        near = get_close_matches(name, BY_NAME, n=1, cutoff=0.4) or list(NAMES)
        raise ValueError(f"is no channel; did you mean {' '.join(near)}?")
    return name


ChannelName = Annotated[str, AfterValidator(check_channel)]
Clock = Literal["receiver", "source"]
Port = Annotated[int, Field(ge=1, le=65_535)]
FiniteFloat = Annotated[float, Field(allow_inf_nan=False)]
FinitePositive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-180, le=360)]
IsoName = Annotated[str, StringConstraints(pattern=r"^[0-9a-fA-F]{16}$", to_lower=True)]


@dataclass(frozen=True, config=STRICT)
class Signal:
    """One signal of a DBC file that carries a channel; the unit is that of the file's physical value."""

    message: str
    signal: str
    unit: str


@dataclass(frozen=True, config=STRICT)
class NamedValue:
    """One MAVLink NAMED_VALUE_FLOAT that carries a channel; MAVLink has room for ten letters."""

    name: Annotated[str, Field(pattern=r"^[\x21-\x7e]{1,10}$")]
    unit: str


@dataclass(frozen=True, config=STRICT)
class Thrusters:
    """The numbers that TRD and TRC sentences give the thrusters: odd at the bow, even at the stern.

    ``channels_from = "demand"`` fills the thruster channels from TRC, the orders, where a vessel sends no
    responses; the default takes the responses and keeps orders in channels of their own.
    """

    port: int = 2
    starboard: int = 4
    tunnel: int = 1
    channels_from: Literal["response", "demand"] = "response"

    def __post_init__(self) -> None:
        if len({self.port, self.starboard, self.tunnel}) < 3:
            raise ValueError("two thrusters have the same number")


@dataclass(frozen=True, config=STRICT)
class Mounting:
    """How a source's sensors are mounted; every angle is added to what the sensor says.

    ``heading_deg`` to compass and course-independent headings, ``wind_angle_deg`` to bow-relative wind angles;
    ``forward_m`` and ``starboard_m`` say where positions and speeds are measured, from the reference point.
    """

    heading_deg: Angle = 0.0
    wind_angle_deg: Angle = 0.0
    forward_m: FiniteFloat = 0.0
    starboard_m: FiniteFloat = 0.0


@dataclass(frozen=True, config=STRICT)
class Device:
    """One device on an NMEA 2000 bus, known by its 64-bit NAME (16 hexadecimal digits) or by its address.

    The order of a source's devices is the order of preference; ``channels`` limits what it may provide.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,40}$")]
    iso_name: IsoName | None = None
    address: Annotated[int, Field(ge=0, le=253)] | None = None
    channels: tuple[ChannelName, ...] | None = None

    def __post_init__(self) -> None:
        if (self.iso_name is None) == (self.address is None):
            raise ValueError("a device is known by its iso_name or by its address: give one of the two")


@dataclass(frozen=True, config=STRICT, kw_only=True)
class _Source:
    """What every source says: its name, the channels it provides, whose clock stamps them, how it is mounted.

    ``rates_hz`` is how often a channel is expected to come; the display grades it by that.
    """

    name: str
    channels: tuple[ChannelName, ...]
    clock: Clock = "receiver"
    mounting: Mounting = field(default_factory=Mounting)
    rates_hz: dict[ChannelName, FinitePositive] = field(default_factory=dict)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class _CanFrames(_Source):
    """What every stream of CAN frames says: its devices, and the vessel's own frames by a DBC file."""

    devices: tuple[Device, ...] = ()
    dbc: Path | None = None
    signals: dict[ChannelName, Signal] = field(default_factory=dict)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class CanSource(_CanFrames):
    """A CAN bus by python-can: NMEA 2000, and with a DBC file the vessel's own frames.

    ``options`` go to python-can's interface as they are (bitrate, port, hop_limit ...).
    """

    type: Literal["can"]
    interface: str
    channel: str
    options: dict[str, str | int | float | bool] = field(default_factory=dict)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class CanFileSource(_CanFrames):
    """CAN frames from a log file: candump, BLF, ASC, TRC or canboat's text, told apart by what is in it."""

    type: Literal["can_file"]
    path: Path


@dataclass(frozen=True, config=STRICT, kw_only=True)
class _Sentences(_Source):
    """What every line of NMEA 0183 says.

    ``theoretical_wind`` is what MWV's "T" refers to on this vessel: instruments differ, and the sentence does
    not tell.
    """

    thrusters: Thrusters = field(default_factory=Thrusters)
    theoretical_wind: Literal["ground", "water"] = "ground"


@dataclass(frozen=True, config=STRICT, kw_only=True)
class SerialSource(_Sentences):
    """NMEA 0183 on a serial line."""

    type: Literal["serial"]
    device: str
    baud_rate: PositiveInt = 4800


@dataclass(frozen=True, config=STRICT, kw_only=True)
class UdpSource(_Sentences):
    """NMEA 0183 in UDP datagrams that are sent to this address and port."""

    type: Literal["udp"]
    port: Port
    address: str = "127.0.0.1"


@dataclass(frozen=True, config=STRICT, kw_only=True)
class TcpSource(_Sentences):
    """NMEA 0183 from a TCP server, a multiplexer or gateway, that we connect to."""

    type: Literal["tcp"]
    port: Port
    address: str = "127.0.0.1"


@dataclass(frozen=True, config=STRICT, kw_only=True)
class FileSource(_Sentences):
    """NMEA 0183 sentences from a text file, read once from beginning to end."""

    type: Literal["file"]
    path: Path


def _usual_named_values() -> dict[str, NamedValue]:
    return {
        "port_angle_deg": NamedValue(name="port_ang", unit="deg"),
        "starboard_angle_deg": NamedValue(name="stbd_ang", unit="deg"),
        "tunnel_rpm": NamedValue(name="tunnel_rpm", unit="rpm"),
    }


@dataclass(frozen=True, config=STRICT, kw_only=True)
class _Mavlink(_Source):
    """What every MAVLink link says: whom we listen to. ``messages`` narrows the messages that are decoded."""

    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    component_id: Annotated[int, Field(ge=1, le=255)] | None = None
    messages: tuple[str, ...] | None = None
    named_values: dict[ChannelName, NamedValue] = field(default_factory=_usual_named_values)


@dataclass(frozen=True, config=STRICT, kw_only=True)
class MavlinkSource(_Mavlink):
    """MAVLink in UDP datagrams that are sent to this address and port, from one system."""

    type: Literal["mavlink"]
    port: Port
    address: str = "127.0.0.1"


@dataclass(frozen=True, config=STRICT, kw_only=True)
class MavlinkTcpSource(_Mavlink):
    """MAVLink from a TCP server that we connect to."""

    type: Literal["mavlink_tcp"]
    port: Port
    address: str = "127.0.0.1"


@dataclass(frozen=True, config=STRICT, kw_only=True)
class MavlinkSerialSource(_Mavlink):
    """MAVLink on a serial line."""

    type: Literal["mavlink_serial"]
    device: str
    baud_rate: PositiveInt = 57_600


@dataclass(frozen=True, config=STRICT, kw_only=True)
class MavlinkFileSource(_Mavlink):
    """MAVLink from a telemetry log (.tlog): packets, each after its time."""

    type: Literal["mavlink_file"]
    path: Path


CanFrames = CanSource | CanFileSource
LineSource = SerialSource | UdpSource | TcpSource | FileSource
MavlinkLinks = MavlinkSource | MavlinkTcpSource | MavlinkSerialSource | MavlinkFileSource
AnySource = CanFrames | LineSource | MavlinkLinks
FILE_SOURCES = (CanFileSource, FileSource, MavlinkFileSource)


@dataclass(frozen=True, config=STRICT)
class RecordingSection:
    """How often what was received is handed to the system (flush) and forced onto the disk (sync).

    ``queue_frames`` is how many frames of each source may wait for the disk. A new part begins after
    ``split_minutes`` or ``split_mb``. Writing stops, with the file closed well, when less than ``reserve_mb`` is
    free on the disk (unless given: a twentieth of the disk, at most 200 MB).
    """

    flush_s: FinitePositive = 0.2
    sync_s: FinitePositive = 0.5
    queue_frames: PositiveInt = 50_000
    split_minutes: FinitePositive | None = 60.0
    split_mb: FinitePositive | None = None
    reserve_mb: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None


@dataclass(frozen=True, config=STRICT)
class LiveSection:
    """The live view for Foxglove and Lichtblick: where it can be connected to, this machine only by default."""

    port: Port = 8765
    address: str = "127.0.0.1"


MarkKeys = dict[Annotated[str, Field(min_length=1, max_length=1)], Annotated[str, Field(min_length=1)]]
"""Keys of the display, and the text of the event mark that each sets."""


@dataclass(frozen=True, config=STRICT)
class Origin:
    """The origin of the trial's tangent plane, WGS 84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class RunSheet:
    """What a person says of a trial, in a configuration or in a column map."""

    name: str = ""
    vessel: str = ""
    place: str = ""
    origin: Origin | None = None
    water_depth_m: FiniteFloat | None = None
    draught_m: FiniteFloat | None = None
    trim_m: FiniteFloat | None = None
    loading: str = ""
    sea_state: str = ""
    crew_notes: str = ""

    def as_trial(self) -> Trial:
        """The run sheet as a recording carries it."""
        return Trial(
            name=self.name,
            vessel=self.vessel,
            place=self.place,
            origin_latitude_deg=self.origin.latitude_deg if self.origin else None,
            origin_longitude_deg=self.origin.longitude_deg if self.origin else None,
            water_depth_m=self.water_depth_m,
            draught_m=self.draught_m,
            trim_m=self.trim_m,
            loading=self.loading,
            sea_state=self.sea_state,
            crew_notes=self.crew_notes,
        )


@dataclass(frozen=True, config=STRICT, kw_only=True)
class TrialSection(RunSheet):
    """The run sheet of a trial to record, which needs a name. Without an origin the first fix becomes it.

    ``magnetic_variation_deg`` (east positive) serves a magnetic compass until a device tells the variation.
    """

    name: Annotated[str, Field(min_length=1, max_length=100)]
    magnetic_variation_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
