"""Floods of strangers: frames of every protocol, each under a name of its own, and what the recorder makes of them.

Run in a process of its own, ``python -m tests.attacks.live_floods NAME``: it prints how many values of the one
intact device, which speaks now and then, were decoded, and how often it has spoken.
"""

from __future__ import annotations

import random
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.logger.survey import Survey
from seatrial.acquisition.protocols.nmea0183 import frame_sentence, xor_checksum
from seatrial.acquisition.protocols.nmea2000 import READERS, SHORTEST_BYTES
from tests.acquisition.can_frames import identifier_of

START_NS = 1_798_718_400_000_000_000
COUNT = 60_000
CHANNELS = ("north_m", "east_m", "heading_deg", "yaw_rate_dps", "surge_mps")
SECTIONS = {
    "can": f'type = "can"\ninterface = "virtual"\nchannel = "x"\nchannels = {list(CHANNELS)}\n'
    'devices = [{ name = "gyro", iso_name = "c0788c00e7e04312" }]',
    "nmea0183": f'type = "udp"\nport = 1\nchannels = {list(CHANNELS)}',
    "mavlink": f'type = "mavlink"\nport = 1\nchannels = {list(CHANNELS)}',
    "mqtt": f'type = "mqtt"\nport = 1\ntopics = ["#"]\nchannels = {list(CHANNELS)}\n[source.values]\n'
    'yaw_rate_dps = { topic = "ship/rate", unit = "deg/s" }',
}
GYRO_NAME = bytes.fromhex("c0788c00e7e04312")[::-1]
FIX = "GGA,120000.00,6326.4,N,01024.0,E,4,12,0.6,0.0,M,0.0,M,,"

Payload = tuple[bytes, int, FrameFlag]


def plain(payload: bytes, identifier: int = 0, flags: FrameFlag = FrameFlag.NONE) -> Payload:
    return payload, identifier, flags


def tagged(items: bytes, line: bytes) -> bytes:
    return b"\\%s*%02X\\%s" % (items, xor_checksum(items), line)


def talkers(chance: random.Random) -> Iterator[Payload]:
    for number in range(COUNT):
        yield plain(frame_sentence(f"{number:012X}{FIX}").strip())


def tag_sources(chance: random.Random) -> Iterator[Payload]:
    for number in range(COUNT):
        yield plain(tagged(b"s:%0190d" % number, frame_sentence(f"GP{FIX}").strip()))


def variations(chance: random.Random) -> Iterator[Payload]:
    for number in range(COUNT):
        yield plain(tagged(b"s:%0190d" % number, frame_sentence(f"HCHDG,1.0,,,{number % 30}.0,E").strip()))


def absurd_times(chance: random.Random) -> Iterator[Payload]:
    for number in range(COUNT):
        time = (b"%d" % chance.randrange(10**10), b"9" * 13, b"0", b"-1", b"1e9", b"9" * 400)[number % 6]
        yield plain(tagged(b"c:" + time, frame_sentence("GPZDA,250000,99,99,9999,99,99").strip()))


def sentence_kinds(chance: random.Random) -> Iterator[Payload]:
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
    for _ in range(COUNT):
        yield plain(frame_sentence("".join(chance.choices(letters, k=chance.randrange(3, 40))) + ",1").strip())


def claims(chance: random.Random) -> Iterator[Payload]:
    """Every address but the gyro's, each claimed again and again under another NAME."""
    for number in range(COUNT):
        yield plain(chance.randbytes(8), 0x18EEFF00 | number % 35)


def contending_claims(chance: random.Random) -> Iterator[Payload]:
    """Three hundred NAMEs that fight for all addresses but the gyro's."""
    for _ in range(COUNT):
        yield plain(chance.randrange(300).to_bytes(8, "little"), 0x18EEFF00 | chance.randrange(36, 254))


def fast_packets(chance: random.Random) -> Iterator[Payload]:
    """Parts of messages that never become whole: of every address, group and number."""
    for number in range(4 * COUNT):
        group, address = sorted(SHORTEST_BYTES)[number % len(SHORTEST_BYTES)], number % 34
        part = bytes([number // 3 % 8 << 5 | chance.randrange(32)]) + chance.randbytes(7)
        yield plain(part, identifier_of(group, address))


def frames_of_every_kind(chance: random.Random) -> Iterator[Payload]:
    """Any identifier and priority, 11 and 29 bits, remote and error frames, up to 64 bytes, lengths that lie."""
    kinds = [FrameFlag.NONE, FrameFlag.STANDARD_ID, FrameFlag.REMOTE, FrameFlag.ERROR, FrameFlag.WHOLE]
    for number in range(COUNT):
        identifier = chance.getrandbits(29)
        if number % 2:
            identifier = identifier_of(chance.choice(sorted(READERS)), chance.randrange(36, 254))
        yield plain(chance.randbytes(chance.choice((0, 1, 7, 8, 8, 8, 64))), identifier, kinds[number % 5])


def systems(chance: random.Random) -> Iterator[Payload]:
    """255 systems with 255 components, both versions, known and unknown messages, cut and garbled."""
    for number in range(COUNT // 4):
        link = dialect.MAVLink(None, srcSystem=2 + number % 254, srcComponent=number // 254 % 256)
        message = link.attitude_encode(number, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1)
        packet = bytearray(message.pack(link, force_mavlink1=bool(number % 2)))
        if number % 3 == 1:
            packet[chance.randrange(len(packet))] ^= chance.randrange(1, 256)
        elif number % 3 == 2:
            packet = packet[: chance.randrange(1, len(packet))]
        yield plain(bytes(packet))


def unknown_messages(chance: random.Random) -> Iterator[Payload]:
    for _ in range(COUNT // 4):
        body = chance.randbytes(chance.randrange(256))
        head = struct.pack("<BBBBBBB3s", 0xFD, len(body), 0, 0, 0, 1, 1, chance.randbytes(3))
        yield plain(head + body + chance.randbytes(2))


def topics_of_sentences(chance: random.Random) -> Iterator[Payload]:
    for number in range(COUNT // 6):
        yield plain(b"%060000d\0" % number + frame_sentence(f"GP{FIX}").strip())


def messages_of_any_kind(chance: random.Random) -> Iterator[Payload]:
    """On the topic of a value: text, JSON of any depth, odd characters, times of every century."""
    texts = [
        "", "NaN", "1,2,3,4", "{", "[" * 500, '{"value":' * 900, '{"value":{"a":1}}', "\0", "\xff\xfe", "1e999",
        "9999-99-99T99:99:99Z 1", "1,99999999999999999999", '{"value":1,"time":1e300}', "$HEHDT,1.0,T*", "\x1b[2J",
    ]  # fmt: skip
    for number in range(COUNT):
        text = chance.choice(texts) + "".join(chr(chance.randrange(1, 256)) for _ in range(number % 9))
        yield plain(b"ship/rate\0" + text.encode("latin-1"))


def own_gyro(number: int) -> dict[str, list[Payload]]:
    """What the one intact device says, by protocol."""
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    attitude = link.attitude_encode(number, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1)
    heading = bytes.fromhex("ff7b2cff7fff7ffc")
    return {
        "can": [plain(GYRO_NAME, 0x18EEFF23), plain(heading, identifier_of(127250, 35))],
        "nmea0183": [plain(frame_sentence("HEHDT,12.0,T").strip())],
        "mavlink": [plain(bytes(attitude.pack(link)))],
        "mqtt": [plain(b"ship/heading\0" + frame_sentence("HEHDT,12.0,T").strip())],
    }


FLOODS: dict[str, tuple[str, Callable[[random.Random], Iterator[Payload]]]] = {
    "talkers": ("nmea0183", talkers),
    "sources in TAG blocks": ("nmea0183", tag_sources),
    "variations": ("nmea0183", variations),
    "absurd times": ("nmea0183", absurd_times),
    "kinds of sentences": ("nmea0183", sentence_kinds),
    "claims": ("can", claims),
    "contending claims": ("can", contending_claims),
    "fast packets": ("can", fast_packets),
    "frames of every kind": ("can", frames_of_every_kind),
    "systems": ("mavlink", systems),
    "unknown messages": ("mavlink", unknown_messages),
    "topics of 60 kB": ("mqtt", topics_of_sentences),
    "messages of any kind": ("mqtt", messages_of_any_kind),
}
GYRO_EVERY = 2_000


def decoded(name: str, count: int | None = None, seed: int = 1) -> tuple[int, int, dict[str, int]]:
    """How often the gyro's heading was decoded and sent while a flood came, and what was refused by reason."""
    protocol, flood = FLOODS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.toml"
        path.write_text(f'[trial]\nname = "flood"\n[[source]]\nname = "line"\n{SECTIONS[protocol]}\n')
        survey = Survey(load_config(path))
    sent, number = 0, 0
    for number, payload in enumerate(islice(flood(random.Random(seed)), count)):
        payloads = [payload]
        if number % GYRO_EVERY == GYRO_EVERY - 1:
            sent += 1
            payloads = own_gyro(number)[protocol] + payloads
        for data, identifier, flags in payloads:
            at_ns = number * 1_000_000
            survey.process(Frame("line", protocol, data, START_NS + at_ns, at_ns, identifier, flags))  # type: ignore[arg-type]
    labels = survey.quantities.get("heading_deg", {})
    gyro = {"can": "line/gyro:127250", "mavlink": "line/1:ATTITUDE"}.get(protocol, "line/HE:HDT")
    return labels[gyro].count if gyro in labels else 0, sent, survey.health.sources["line"].rejection_counts


if __name__ == "__main__":
    sys.stdout.write(f"{decoded(sys.argv[1])[:2]}\n")
