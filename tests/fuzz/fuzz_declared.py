"""Coverage-guided fuzzing of declared channels: sentences, parameter groups and MAVLink messages, by all the packs.

The first byte chooses the protocol, the second the group or the message. Sentences get sound checksums, frames are
whole messages as a gateway hands them on, MAVLink payloads get a sound header and checksum. Nothing may raise,
every value must be finite, and every channel sample must be one that its channel can hold.
"""

from __future__ import annotations

import json
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.config.declarations import (
        GroupField,
        MavlinkField,
        SentenceField,
        Transducer,
        origins_of_kind,
    )
    from seatrial.acquisition.config.trial_file import TrialConfig, parse_config
    from seatrial.acquisition.core.ship import channels_by_name_of
    from seatrial.acquisition.core.trial import Frame, FrameFlag
    from seatrial.acquisition.logger.processing import Derivation
    from seatrial.acquisition.protocols import decoders_by_protocol
    from seatrial.acquisition.protocols.mavlink import dialect
    from seatrial.acquisition.protocols.nmea0183 import xor_checksum
    from tests.acquisition.can_frames import identifier_of
    from tests.fuzz.decoding import check_frame
    from tests.fuzz.running import fuzz

TRIAL = Path(__file__).parents[2] / "trials" / "survey_and_engines.toml"
HEAD = TRIAL.read_text(encoding="utf-8").partition("[[source]]")[0]
SOURCES = {
    'type = "serial"\ndevice = "x"\n': (SentenceField, Transducer),
    'type = "can"\ninterface = "x"\nchannel = "x"\n': (GroupField,),
    'type = "mavlink"\nport = 1\n': (MavlinkField,),
}


def config_of(source: str, channels: list[str]) -> TrialConfig:
    return parse_config(f'{HEAD}[[source]]\nname = "x"\nchannels = {json.dumps(channels)}\n{source}', TRIAL)


DECLARED = config_of(next(iter(SOURCES)), []).declared
NAMES = [each.channel.name for each in DECLARED]
CONFIGS = [
    config_of(source, [name for name in NAMES if origins_of_kind(DECLARED, [name], kinds)])
    for source, kinds in SOURCES.items()
]
CARRIED = origins_of_kind(DECLARED, NAMES, (GroupField, MavlinkField))
GROUPS = sorted({origin.group for _, origin in CARRIED if isinstance(origin, GroupField)})
MESSAGES = sorted({origin.message for _, origin in CARRIED if isinstance(origin, MavlinkField)})
KINDS = {each.msgname: each for each in dialect.mavlink_map.values()}
SEEDS = (
    b"\0\0$PSXN,23,1.28,1.93,104.68,-0.24\n$PASHR,204132.000,010.51,T,+00.39,-00.79,-00.84,0.151,0.075,0.5,1,0",
    b"\0\0$GPGGA,085118.40,5327.60,N,01002.89,E,1,07,1.1,7.2,M,4.6,M,,\n$SDDPT,5.3,0.4,\n$SDDBT,18,f,5.4,M,3.0,F",
    b"\0\0$IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO\n$PWNC,1,12.5,A,3\n$SDMTW,12.5,C",
    *(bytes([1, number]) + bytes(26) for number in range(len(GROUPS))),
    *(bytes([2, number]) + bytes(64) for number in range(len(MESSAGES))),
)  # fmt: skip


def mavlink_packet(kind: type, payload: bytes) -> bytes:
    """A packet of version 2 with a sound checksum; the payload is cut or filled to the message's length."""
    body = payload[: kind.unpacker.size].ljust(kind.unpacker.size, b"\0")  # type: ignore[attr-defined]
    head = bytes([len(body), 0, 0, 0, 1, 1]) + kind.id.to_bytes(3, "little")  # type: ignore[attr-defined]
    crc = dialect.x25crc(head + body)
    crc.accumulate(bytes([kind.crc_extra]))  # type: ignore[attr-defined]
    return b"\xfd" + head + body + crc.crc.to_bytes(2, "little")


def frames_of(protocol: int, choice: int, data: bytes) -> list[Frame]:
    if protocol == 0:
        lines = [text + b"*%02X" % xor_checksum(text[1:]) for text in data.split(b"\n")]
        return [Frame("x", "nmea0183", text, number, number) for number, text in enumerate(lines)]
    if protocol == 1:
        identifier, whole = identifier_of(GROUPS[choice % len(GROUPS)], choice % 3), FrameFlag.WHOLE
        parts = (data, whole), (data[:8], FrameFlag.NONE)
        return [Frame("x", "can", part, 0, 0, identifier, flags) for part, flags in parts]
    return [Frame("x", "mavlink", mavlink_packet(KINDS[MESSAGES[choice % len(MESSAGES)]], data), 0, 0)]


def one_input(data: bytes) -> None:
    protocol, choice, body = (data[0] % 3, data[1], data[2:]) if len(data) > 2 else (0, 0, data)
    config = CONFIGS[protocol]
    decoder = next(iter(decoders_by_protocol(config.sources[0], config.actuators, config.declared).values()))[0]
    derivation = Derivation(config.trial, frozenset({"x"}))
    for frame in frames_of(protocol, choice, body):
        check_frame(decoder, derivation, frame, channels_by_name_of(config.trial))


if __name__ == "__main__":
    fuzz(one_input, SEEDS, 400)
