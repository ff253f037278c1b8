"""Real captures with bits flipped, bytes cut out, doubled and swapped: what each decoder makes of them.

Run in a process of its own for long, ``python -m tests.attacks.mutations PROTOCOL COUNT SEED``.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import cycle
from pathlib import Path

from seatrial.acquisition.config.sources import FileSource, MavlinkFileSource
from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.ship import channels_by_name_of
from seatrial.acquisition.core.trial import Frame, Protocol, Sample
from seatrial.acquisition.logger.survey import Survey
from seatrial.acquisition.protocols import Decoder, decoders_by_protocol
from seatrial.acquisition.protocols.nmea2000 import (
    ADDRESS_CLAIM,
    LONGEST_BYTES,
    SHORTEST_BYTES,
    split_can_identifier,
)
from seatrial.acquisition.sources.lines import LineAssembler
from seatrial.acquisition.sources.log_file import LogFile, TelemetryLog

START_NS = 1_798_718_400_000_000_000
CAPTURES = Path(os.environ.get("SEATRIAL_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
CHANNELS = (
    "north_m", "east_m", "heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps",
    "wind_direction_deg", "wind_speed_mps",
)  # fmt: skip
FOLDERS: dict[Protocol, str] = {"nmea0183": "nmea0183", "can": "nmea2000", "mavlink": "mavlink", "mqtt": "nmea0183"}
SECTIONS: dict[Protocol, str] = {
    "nmea0183": 'type = "udp"\nport = 1\n',
    "can": 'type = "can"\ninterface = "virtual"\nchannel = "x"\n',
    "mavlink": 'type = "mavlink"\nport = 1\n',
    "mqtt": 'type = "mqtt"\nport = 1\ntopics = ["#"]\n',
}


def mutated(data: bytes, chance: random.Random) -> bytes:
    """The bytes with one to four faults in them."""
    for _ in range(chance.randrange(1, 5)):
        at, length = chance.randrange(len(data) + 1), chance.randrange(1, 12)
        match chance.randrange(6):
            case 0:
                data = data[:at] + data[at + length :]
            case 1:
                data = data[: at + length] + data[at:]
            case 2:
                data = data[:at] + chance.randbytes(length) + data[at:]
            case 3:
                data = data[:at] + data[at : at + length][::-1] + data[at + length :]
            case _ if data:
                at %= len(data)
                data = data[:at] + bytes([data[at] ^ 1 << chance.randrange(8)]) + data[at + 1 :]
    return data


def read(source: LogFile | TelemetryLog) -> list[Frame]:
    source.open()
    frames: list[Frame] = []
    while (block := source.read(0.0)) is not None:
        frames += block
    source.close()
    return frames


def captured(protocol: Protocol) -> list[Frame]:
    """The frames of the captures of a protocol."""
    folder, frames = CAPTURES / FOLDERS[protocol], list[Frame]()
    if protocol == "mavlink":
        for path in sorted(folder.glob("*.tlog")):
            frames += read(
                TelemetryLog(MavlinkFileSource(name="line", type="mavlink_file", path=path, channels=()))
            )
        return frames
    kind = "can_file" if protocol == "can" else "file"
    for path in sorted([*folder.glob("*.log"), *folder.glob("*.txt"), *folder.glob("*.raw")]):
        frames += read(LogFile(FileSource(name="line", type=kind, path=path, channels=())))[:20_000]
    wanted = "nmea0183" if protocol == "mqtt" else protocol
    return [frame for frame in frames if frame.protocol == wanted]


class Watched(Survey):
    """A survey of which every sample is held to its channel's limits."""

    def __init__(self, config: TrialConfig) -> None:
        super().__init__(config)
        self._limits = channels_by_name_of(config.trial)

    def _record_samples(self, samples: list[Sample], frame: Frame) -> None:
        for sample in samples:
            channel = self._limits.get(sample.quantity)
            assert channel is None or channel.is_possible_value(sample.value), sample
        super()._record_samples(samples, frame)


def values(decoders: Sequence[Decoder], frame: Frame) -> list[tuple[str, float]]:
    groups = [group for decoder in decoders for group in decoder.decode(frame)]
    return [(sample.quantity, sample.value) for group in groups for sample in group]


def faults_of(protocol: Protocol, frame: Frame, chance: random.Random) -> Iterator[Frame]:
    """Mutations of a frame, as its transport would pass them on."""
    for _ in range(chance.randrange(1, 4)):
        if protocol == "can":
            identifier = frame.identifier ^ (1 << chance.randrange(29) if chance.random() < 0.5 else 0)
            longest = LONGEST_BYTES if len(frame.payload) > 8 else 8
            yield frame._replace(identifier=identifier, payload=mutated(frame.payload, chance)[:longest])
        elif protocol == "nmea0183":
            yield from LineAssembler("line").push(mutated(frame.payload, chance) + b"\r\n", (frame.received_ns, 0))
        elif protocol == "mqtt":
            yield frame._replace(payload=mutated(frame.payload, chance))
        else:
            yield frame._replace(payload=mutated(frame.payload, chance))


def is_stateless(frame: Frame) -> bool:
    """Whether what a frame says hangs on no other: parts of messages, and who has which address, do."""
    group = split_can_identifier(frame.identifier)[0]
    return frame.protocol != "can" or (group not in SHORTEST_BYTES and group != ADDRESS_CLAIM)


def attack(protocol: Protocol, count: int, seed: int) -> dict[str, int]:
    """Intact frames of the captures between mutated ones; how many frames and values there were.

    Raises :class:`AssertionError` where a decoder fails, a value is outside its channel's limits, or an intact
    frame says other values than without the mutated ones.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.toml"
        listed = f'[[source]]\nname = "line"\nchannels = {list(CHANNELS)}\n{SECTIONS[protocol]}'
        path.write_text(f'[trial]\nname = "mutations"\n{listed}')
        config = load_config(path)
    watched, chance = Watched(config), random.Random(seed)
    clean, disturbed = (decoders_by_protocol(config.sources[0])[protocol] for _ in range(2))
    frames = captured(protocol)
    if protocol != "can":  # whose messages come in parts
        chance.shuffle(frames)
    compared = total = 0
    for number, captured_frame in zip(range(count), cycle(frames), strict=False):
        at_ns = number * 20_000_000
        frame = captured_frame._replace(
            origin="line", protocol=protocol, received_ns=START_NS + at_ns, monotonic_ns=at_ns, stamped_ns=None
        )
        if protocol == "mqtt":
            frame = frame._replace(payload=b"ship/nmea\0" + frame.payload)
        for faulty in faults_of(protocol, frame, chance):
            watched.process(faulty._replace(received_ns=frame.received_ns, monotonic_ns=at_ns))
            values(disturbed, faulty._replace(received_ns=frame.received_ns, monotonic_ns=at_ns))
        watched.process(frame)
        if is_stateless(frame):
            expected, read_values = values(clean, frame), values(disturbed, frame)
            # A packet that is whole in a mutated datagram may come out with this one.
            assert read_values[len(read_values) - len(expected) :] == expected, (frame, read_values, expected)
            compared, total = compared + 1, total + len(read_values)
    failures = {
        reason: n for reason, n in watched.health.sources["line"].rejection_counts.items() if "failed" in reason
    }
    assert not failures, failures
    return {"frames": compared, "values": total}


if __name__ == "__main__":
    protocol, count, seed = sys.argv[1:]
    sys.stdout.write(f"{attack(protocol, int(count), int(seed))}\n")  # type: ignore[arg-type]
