"""A trial's TOML file as frozen objects: the trial, its sources and how they are recorded.

Each source says which of the 13 channels it provides; where several provide one, the order in the file is
the order of preference. ``clock = "source"`` stamps a source's samples with the time that the source itself
tells; the default stamps them with the time of reception and keeps the source's own beside it.
"""

from __future__ import annotations

from dataclasses import field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass

from acquisition.channels import BY_NAME, NAMES
from acquisition.errors import ConfigurationError
from acquisition.toml_file import line_of, load_toml, read_text
from acquisition.trial import Trial
from acquisition.units import scale_to

_STRICT = ConfigDict(extra="forbid", str_strip_whitespace=True)


def _known_channel(name: str) -> str:
    if name not in BY_NAME:
        near = get_close_matches(name, BY_NAME, n=1, cutoff=0.4) or list(NAMES)
        raise ValueError(f"is no channel; did you mean {' '.join(near)}?")
    return name


ChannelName = Annotated[str, AfterValidator(_known_channel)]
Clock = Literal["receiver", "source"]
Port = Annotated[int, Field(ge=1, le=65_535)]
FiniteFloat = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, config=_STRICT)
class Signal:
    """One signal of a DBC file that carries a channel; the unit is that of the file's physical value."""

    message: str
    signal: str
    unit: str


@dataclass(frozen=True, config=_STRICT)
class NamedValue:
    """One MAVLink NAMED_VALUE_FLOAT that carries a channel; MAVLink has room for ten letters."""

    name: Annotated[str, Field(pattern=r"^[\x21-\x7e]{1,10}$")]
    unit: str


@dataclass(frozen=True, config=_STRICT)
class Thrusters:
    """The numbers that TRD sentences give the thrusters: odd at the bow, even at the stern."""

    port: int = 2
    starboard: int = 4
    tunnel: int = 1

    def __post_init__(self) -> None:
        if len({self.port, self.starboard, self.tunnel}) < 3:
            raise ValueError("two thrusters have the same number")


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class _Source:
    """What every source says: its name, the channels it provides, and whose clock stamps them."""

    name: str
    channels: tuple[ChannelName, ...]
    clock: Clock = "receiver"


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class CanSource(_Source):
    """A CAN bus by python-can: NMEA 2000, and with a DBC file the vessel's own frames.

    ``options`` go to python-can's interface as they are (bitrate, port, hop_limit ...).
    """

    type: Literal["can"]
    interface: str
    channel: str
    options: dict[str, str | int | float | bool] = field(default_factory=dict)
    dbc: Path | None = None
    signals: dict[ChannelName, Signal] = field(default_factory=dict)


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class _SentenceSource(_Source):
    """What every line of NMEA 0183 says."""

    thrusters: Thrusters = field(default_factory=Thrusters)


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class SerialSource(_SentenceSource):
    """NMEA 0183 on a serial line."""

    type: Literal["serial"]
    device: str
    baud_rate: PositiveInt = 4800


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class UdpSource(_SentenceSource):
    """NMEA 0183 in UDP datagrams that are sent to this address and port."""

    type: Literal["udp"]
    port: Port
    address: str = "127.0.0.1"


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class TcpSource(_SentenceSource):
    """NMEA 0183 from a TCP server, a multiplexer or gateway, that we connect to."""

    type: Literal["tcp"]
    port: Port
    address: str = "127.0.0.1"


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class FileSource(_SentenceSource):
    """NMEA 0183 sentences from a text file, read once from beginning to end."""

    type: Literal["file"]
    path: Path


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class MavlinkSource(_Source):
    """MAVLink in UDP datagrams that are sent to this address and port, from one system."""

    type: Literal["mavlink"]
    port: Port
    address: str = "127.0.0.1"
    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    named_values: dict[ChannelName, NamedValue] = field(
        default_factory=lambda: {
            "port_angle_deg": NamedValue(name="port_ang", unit="deg"),
            "starboard_angle_deg": NamedValue(name="stbd_ang", unit="deg"),
            "tunnel_rpm": NamedValue(name="tunnel_rpm", unit="rpm"),
        }
    )


LineSource = SerialSource | UdpSource | TcpSource | FileSource
AnySource = CanSource | LineSource | MavlinkSource


@dataclass(frozen=True, config=_STRICT)
class Origin:
    """The origin of the trial's tangent plane, WGS 84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class RunSheet:
    """What a person says of a trial, in a configuration or in a column map."""

    name: str = ""
    vessel: str = ""
    place: str = ""
    origin: Origin | None = None
    water_depth_m: FiniteFloat | None = None
    draught_m: FiniteFloat | None = None
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
            crew_notes=self.crew_notes,
        )


@dataclass(frozen=True, config=_STRICT, kw_only=True)
class TrialSection(RunSheet):
    """The run sheet of a trial to record, which needs a name. Without an origin the first fix becomes it."""

    name: Annotated[str, Field(min_length=1, max_length=100)]


@dataclass(frozen=True, config=_STRICT)
class RecordingSection:
    """How often what was received is handed to the system (flush) and forced onto the disk (sync)."""

    flush_s: Annotated[PositiveFloat, Field(allow_inf_nan=False)] = 0.2
    sync_s: Annotated[PositiveFloat, Field(allow_inf_nan=False)] = 0.5
    queue_frames: PositiveInt = 50_000


@dataclass(frozen=True, config=_STRICT)
class _File:
    trial: TrialSection
    source: tuple[Annotated[AnySource, Discriminator("type")], ...]
    recording: RecordingSection = field(default_factory=RecordingSection)


@dataclass(frozen=True)
class TrialConfig:
    """A validated trial configuration and the text it came from, which goes into the recording."""

    trial: Trial
    sources: tuple[AnySource, ...]
    recording: RecordingSection
    text: str
    path: Path

    @property
    def missing_channels(self) -> tuple[str, ...]:
        """Those of the 13 channels that no source provides."""
        provided = {name for source in self.sources for name in source.channels}
        return tuple(name for name in NAMES if name not in provided)


def load_config(path: Path | str) -> TrialConfig:
    """Read and check a trial's configuration.

    Relative paths in it are relative to the file itself. Raises :class:`ConfigurationError` naming the line.
    """
    file = load_toml(path, _File)
    if not file.source:
        raise ConfigurationError("names no source", where=str(path), fix="add a [[source]] section")
    text = read_text(path)
    _check_names(file.source, path)
    _check_units(file.source, text, path)
    _check_channels(file.source, text, path)
    folder = Path(path).resolve().parent
    return TrialConfig(
        trial=file.trial.as_trial(),
        sources=tuple(_resolved(source, folder, path) for source in file.source),
        recording=file.recording,
        text=text,
        path=Path(path),
    )


def _check_names(sources: tuple[AnySource, ...], path: Path | str) -> None:
    names = [source.name for source in sources]
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(
                f"two sources are called {name!r}", where=str(path), fix="give each its own name"
            )
        if not name.replace("_", "").replace("-", "").isalnum():
            raise ConfigurationError(
                f"source name {name!r} cannot be part of a topic",
                where=str(path),
                fix="use letters, digits, - and _",
            )


def _check_units(sources: tuple[AnySource, ...], text: str, path: Path | str) -> None:
    for number, source in enumerate(sources):
        if not isinstance(source, CanSource | MavlinkSource):
            continue
        key = "signals" if isinstance(source, CanSource) else "named_values"
        mapped: dict[str, Any] = getattr(source, key)
        for channel, entry in mapped.items():
            try:
                scale_to(BY_NAME[channel].unit, entry.unit)
            except ConfigurationError as error:
                line = line_of(text, ["source", number, key, channel, "unit"])
                raise ConfigurationError(f"{channel}: {error}", where=f"{path}, line {line}") from error


def _check_channels(sources: tuple[AnySource, ...], text: str, path: Path | str) -> None:
    """Refuse a channel that no message of the source can carry: it would stay silent all day."""
    for number, source in enumerate(sources):
        possible = carried_channels(source)
        for channel in source.channels:
            if channel not in possible:
                raise ConfigurationError(
                    f"no message on source {source.name!r} carries {channel}",
                    where=f"{path}, line {line_of(text, ['source', number, 'channels'])}",
                    fix=_MAPPING_HINT.get(source.type, "take it off the source's channels"),
                )


_MAPPING_HINT = {
    "can": "say which DBC signal does in [source.signals], or take it off the source's channels",
    "mavlink": "say which named value does in [source.named_values], or take it off the source's channels",
}
_MOTION = frozenset(NAMES[:8]) | {"latitude_deg", "longitude_deg"}


def carried_channels(source: AnySource) -> frozenset[str]:
    """The channels that a source's protocol and its mapping can carry."""
    if isinstance(source, CanSource):
        return _MOTION | {"speed_through_water_mps", "roll_deg", "pitch_deg", *source.signals}
    if isinstance(source, MavlinkSource):
        return _MOTION | {"port_rpm", "starboard_rpm", "roll_deg", "pitch_deg", *source.named_values}
    return _MOTION | set(NAMES)


def _resolved(source: AnySource, folder: Path, path: Path | str) -> AnySource:
    """The source with its file paths made absolute and checked."""
    if isinstance(source, FileSource):
        return replace(source, path=folder / source.path)
    if isinstance(source, CanSource) and source.dbc is not None:
        dbc = folder / source.dbc
        if not dbc.exists():
            raise ConfigurationError(f"DBC file {dbc} does not exist", where=f"{path}, source {source.name!r}")
        return replace(source, dbc=dbc)
    if isinstance(source, CanSource) and source.signals:
        raise ConfigurationError(
            "has signals but no dbc file", where=f"{path}, source {source.name!r}", fix="add dbc = FILE"
        )
    return source
