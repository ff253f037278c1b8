"""Small files that expand, and damage that must not pass unnoticed: recordings, tables, logs, descriptions."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap import records as mcap

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Frame, Sample, Trial
from seatrial.acquisition.recording.messages import message_kind_of_topic
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.recording.recover import recover
from seatrial.acquisition.recording.writer import RecordingWriter, serialise_record
from tests.attacks.bombs import (
    CHUNK_BYTES,
    LOG_BOMBS,
    MCAP_BOMBS,
    SAMPLE_DATA,
    START_NS,
    TABLE_BOMBS,
    TEXT_BOMBS,
    chunk,
    chunk_of,
    defined,
    link_to_another,
    message,
    text_field,
    write_bomb,
    write_hdf5,
    write_mcap,
)
from tests.attacks.commands import run_seatrial
from tests.conftest import Command, Done

SECTOR_BYTES, BLOCK_BYTES = 512, 4096


# Damage


def write_sampled(path: Path, chunks: int, samples: int) -> Path:
    """A recording with each kind of record that the recorder writes: metadata, attachment, chunks, definitions."""
    with RecordingWriter(
        path, Trial("flips", vessel="gunnerus", draught_m=2.7), {"trial.toml": b"a = 1"}
    ) as writer:
        writer.write_metadata("part", {"number": "1", "follows": "", "reason": "recording started"})
        writer.write_metadata("clock", {"utc_minus_monotonic_ns": "1234567890"})
        for number in range(chunks * samples):
            time_ns = START_NS + number * 50_000_000
            channel = ("surge_mps", "sway_mps" if number < samples else "wind_speed_mps")[number % 2]
            writer.write_sample(Sample(channel, number / 7, "a line", time_ns, number, time_ns - 5, time_ns))
            frame = Frame("line", "nmea0183", b"$GPHDT,%d,T*00" % number, time_ns, number)
            writer.write_raw(frame)
            if number % samples == samples - 1:
                writer.write_event(f"mark {number}", time_ns)
                writer.flush()
        writer.write_trial(Trial("flips", vessel="gunnerus", draught_m=2.8))
    return path


def unclosed(data: bytes) -> bytes:
    """The recording as a killed recorder leaves it: cut before the end of its data."""
    end_of_data = b"\x0f" + (4).to_bytes(8, "little")
    return data[: data.rindex(end_of_data)]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small recording, closed."""
    return write_sampled(tmp_path_factory.mktemp("small") / "small.mcap", chunks=3, samples=4).read_bytes()


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording of some twenty blocks of the disk, closed."""
    return write_sampled(tmp_path_factory.mktemp("blocks") / "blocks.mcap", chunks=40, samples=20).read_bytes()


def content(recording: Recording) -> dict[str, Any]:
    """What a recording says, as values that can be compared."""
    said = {field.name: getattr(recording, field.name) for field in fields(recording) if field.name != "path"}
    said["series"] = {name: rows(recording, name) for name in recording.series}
    return said


def rows(recording: Recording, channel: str) -> list[tuple[Any, ...]]:
    """The samples of a channel, each as one tuple."""
    series = recording.series[channel]
    columns = (series.measured_ns, series.received_ns, series.value, series.quality, series.source_index)
    return [(*row, series.sources) for row in zip(*(column.tolist() for column in columns), strict=True)]


def is_beginning(damaged: Recording, original: Recording) -> bool:
    """Whether a file that says that it is cut holds nothing but the first part of the original."""
    said, expected = content(damaged), content(original)
    kept = all(rows(original, channel)[: len(samples)] == samples for channel, samples in said["series"].items())
    return (
        kept
        and expected["events"][: len(said["events"])] == said["events"]
        and said["metadata"].items() <= expected["metadata"].items()
        and damaged.messages <= original.messages
        and damaged.trial in (original.trial, Trial("flips", vessel="gunnerus", draught_m=2.7), Trial())
    )


def unnoticed_by_readers(path: Path, original: Recording) -> str:
    """What a reader takes for true that the original does not say, without a word; empty if nothing."""
    try:
        damaged = read_recording(path)
    except InputError:
        return ""
    if not damaged.closed and is_beginning(damaged, original):
        return ""
    said, expected = content(damaged), content(original)
    return ", ".join(key for key in said if said[key] != expected[key])


def unnoticed_by_recovery(path: Path, original: Recording) -> str:
    """The same of what ``recover`` saves."""
    saved = path.with_suffix(".saved.mcap")
    saved.unlink(missing_ok=True)
    try:
        summary = recover(path, saved)
    except InputError:
        return ""
    if summary.refused or (not summary.closed and is_beginning(read_recording(saved), original)):
        return ""
    said, expected = content(read_recording(saved)), content(original)
    return ", ".join(key for key in said if said[key] != expected[key] and key != "closed")


def flip(data: bytes, place: int, bit: int) -> bytes:
    """The data with one bit changed."""
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


def unnoticed_flips(
    data: bytes, folder: Path, places: Iterator[int] | range, judge: Callable[[Path, Recording], str]
) -> list[str]:
    """At which of these places a flipped bit goes unnoticed, and what it changes."""
    path = folder / "damaged.mcap"
    path.write_bytes(data)
    original, generator, unnoticed = read_recording(path), random.Random(1), []
    for place in places:
        bit = generator.randrange(8)
        path.write_bytes(flip(data, place, bit))
        if changed := judge(path, original):
            unnoticed.append(f"byte {place}, bit {bit}: {changed}")
    return unnoticed


def unnoticed(damaged: Iterable[bytes], data: bytes, folder: Path) -> list[str]:
    """Which of several damaged copies are read without a word, and what is changed in them."""
    path = folder / "damaged.mcap"
    path.write_bytes(data)
    original, changes = read_recording(path), []
    for number, copy in enumerate(damaged):
        path.write_bytes(copy)
        if changed := unnoticed_by_readers(path, original):
            changes.append(f"number {number}: {changed}")
    return changes


@pytest.fixture(autouse=True)
def no_sync(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of files are written here; that none of them is kept by the disk is all right."""
    monkeypatch.setattr("os.fsync", lambda descriptor: None)
    monkeypatch.setattr("os.fdatasync", lambda descriptor: None)


CLOSED = pytest.mark.parametrize("form", [bytes, unclosed], ids=["closed", "unclosed"])


@CLOSED
def test_flipped_bit_is_noticed_by_readers_in_a_sample_of_places(
    small: bytes, tmp_path: Path, form: Callable[[bytes], bytes]
) -> None:
    data = form(small)
    assert unnoticed_flips(data, tmp_path, range(0, len(data), 41), unnoticed_by_readers) == []


@CLOSED
def test_flipped_bit_is_noticed_by_recover_in_a_sample_of_places(
    small: bytes, tmp_path: Path, form: Callable[[bytes], bytes]
) -> None:
    data = form(small)
    assert unnoticed_flips(data, tmp_path, range(0, len(data), 251), unnoticed_by_recovery) == []


@pytest.mark.attack
@CLOSED
@pytest.mark.parametrize("judge", [unnoticed_by_readers, unnoticed_by_recovery], ids=["readers", "recover"])
def test_flipped_bit_is_noticed_at_every_byte(
    small: bytes, tmp_path: Path, form: Callable[[bytes], bytes], judge: Callable[[Path, Recording], str]
) -> None:
    data = form(small)
    assert unnoticed_flips(data, tmp_path, range(len(data)), judge) == []


@pytest.mark.attack
@CLOSED
def test_zeroed_sector_is_noticed(blocks: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data = form(blocks)
    starts = range(0, len(data), SECTOR_BYTES)
    zeroed = (data[:start] + bytes(SECTOR_BYTES) + data[start + SECTOR_BYTES :] for start in starts)
    assert unnoticed(zeroed, data, tmp_path) == []


@pytest.mark.attack
@CLOSED
def test_swapped_blocks_are_noticed(blocks: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data = form(blocks)
    pieces = [data[start : start + BLOCK_BYTES] for start in range(0, len(data), BLOCK_BYTES)]
    pairs = [(first, second) for second in range(len(pieces)) for first in range(second)]

    def swapped(first: int, second: int) -> bytes:
        order = [*pieces]
        order[first], order[second] = pieces[second], pieces[first]
        return b"".join(order)

    assert unnoticed((swapped(*pair) for pair in pairs), data, tmp_path) == []


@pytest.mark.attack
@CLOSED
def test_changed_bytes_are_noticed(blocks: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data, generator = form(blocks), random.Random(2)

    def changed() -> bytes:
        place, length = generator.randrange(len(data)), generator.randrange(1, 64)
        return data[:place] + generator.randbytes(length) + data[place + length :]

    assert unnoticed((changed() for _ in range(300)), data, tmp_path) == []


@pytest.mark.attack
@CLOSED
def test_truncation_at_every_byte_is_reported(small: bytes, tmp_path: Path, form: Callable[[bytes], bytes]) -> None:
    data, path = form(small), tmp_path / "damaged.mcap"
    path.write_bytes(small)
    original = read_recording(path)
    for length in range(1, len(data)):
        path.write_bytes(data[:length])
        try:
            damaged = read_recording(path)
        except InputError:
            continue
        assert not damaged.closed, f"at byte {length}"
        assert is_beginning(damaged, original), f"at byte {length}"


# Recordings that expand

MEMORY_MB = 1000.0
COMMANDS: dict[str, Callable[[Path, Path], list[str | Path]]] = {
    "info": lambda path, folder: ["info", path],
    "check": lambda path, folder: ["check", path],
    "recover": lambda path, folder: ["recover", path, "-o", folder / "saved.mcap"],
}


@pytest.fixture(scope="module")
def mcap_bomb(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of the recordings that expand, made once."""
    path = write_bomb(f"recording: {request.param}", tmp_path_factory.mktemp("bomb") / "bomb.mcap")
    assert path.stat().st_size < 6_000_000
    return path


@pytest.mark.attack
@pytest.mark.parametrize("action", COMMANDS)
@pytest.mark.parametrize("mcap_bomb", MCAP_BOMBS, indirect=True)
def test_small_recording_never_takes_the_memory(tmp_path: Path, mcap_bomb: Path, action: str) -> None:
    outcome = run_seatrial(*COMMANDS[action](mcap_bomb, tmp_path)).survived()
    assert outcome.peak_mb < MEMORY_MB
    if outcome.code:
        outcome.refused()


def assert_survives(done: Done) -> Done:
    """A command in this process ended well, or was refused with one line that a person can act on."""
    assert "Traceback" not in done.out + done.err
    assert done.code in (0, 1), done.err
    lines = [line for line in done.err.splitlines() if line.startswith("seatrial: ")]
    assert len(lines) == done.code, done.err
    return done


def deep_schema(depth: int) -> bytes:
    """A schema in which a message holds a message, and so on."""
    nested = b""
    for _ in range(depth):
        nested = text_field(1, b"M") + text_field(3, nested)
    return text_field(
        1, text_field(1, b"deep.proto") + text_field(4, text_field(1, b"Sample") + text_field(3, nested))
    )


def stranger(
    topic: str, schema: bytes, data: bytes, name: str = "seatrial.Sample", encoding: str = "protobuf"
) -> bytes:
    """A topic of ours as another program has it, with a message."""
    definitions = serialise_record(mcap.Schema(1, schema, "protobuf", name)) + serialise_record(
        mcap.Channel(1, topic, encoding, {}, 1)
    )
    return definitions + chunk(message(1, data))


LOG = "foxglove.Log"
SAMPLE_TOPIC, SAMPLE_SCHEMA = "/channel/surge_mps", message_kind_of_topic("/channel/x").descriptors
LIARS: dict[str, tuple[bytes, ...]] = {
    "zstd that expands beyond its size": (chunk(bytes(CHUNK_BYTES), 10),),
    "zstd without a size that expands": (
        chunk_of(zstandard.ZstdCompressor(write_content_size=False).compress(bytes(CHUNK_BYTES)), 10, "zstd"),
    ),
    "zstd of a window of 2 GB": (chunk_of(bytes.fromhex("28b52ffd00a8") + bytes(40), 1000, "zstd"),),
    "zstd shorter than its size": (chunk(bytes(10), CHUNK_BYTES),),
    "lz4 that expands beyond its size": (chunk(bytes(CHUNK_BYTES), 10, "lz4"),),
    "lz4 shorter than its size": (chunk(bytes(10), CHUNK_BYTES, "lz4"),),
    "chunk of 2^63 bytes": (chunk(bytes(10), 2**63),),
    "record beyond the file": (b"\x0c" + (2**40).to_bytes(8, "little") + b"x",),
    "record of 2^64 bytes": (b"\x06" + b"\xff" * 8,),
    "message cut in a chunk": (defined(SAMPLE_TOPIC), chunk(message(1, SAMPLE_DATA)[:-5])),
    "message longer than its chunk": (
        defined(SAMPLE_TOPIC),
        chunk(b"\x05" + (2**63).to_bytes(8, "little") + bytes(40)),
    ),
    "chunk in a chunk": (chunk(chunk(chunk(message(1, SAMPLE_DATA)))),),
    "message of no topic": (chunk(message(7, SAMPLE_DATA)),),
    "topic of a schema that is missing": (
        serialise_record(mcap.Channel(1, SAMPLE_TOPIC, "protobuf", {}, 9)) + chunk(message(1, SAMPLE_DATA)),
    ),
    "index of a chunk that is the index itself": (
        serialise_record(mcap.DataEnd(0)),
        serialise_record(mcap.ChunkIndex(9, 60, "zstd", 9, 2, 0, {1: 60}, 1, 9)) * 3,
    ),
    "metadata of 10,000 keys": (serialise_record(mcap.Metadata("part", {str(key): "x" for key in range(10_000)})),),
    "attachment of 8 MB": (serialise_record(mcap.Attachment(0, 0, "a.bin", "x/y", bytes(8_000_000))),),
    "schema nested deeply": (stranger(SAMPLE_TOPIC, deep_schema(2000), SAMPLE_DATA),),
    "schema nested as deeply as protobuf allows": (stranger(SAMPLE_TOPIC, deep_schema(40), SAMPLE_DATA),),
    "schema of random bytes": (stranger(SAMPLE_TOPIC, random.Random(3).randbytes(900), SAMPLE_DATA),),
    "schema of another message": (
        stranger(SAMPLE_TOPIC, message_kind_of_topic("/event").descriptors, SAMPLE_DATA, LOG),
    ),
    "schema of our name, fields of another": (
        stranger(
            SAMPLE_TOPIC,
            message_kind_of_topic("/event").descriptors.replace(b"foxglove", b"seatrial").replace(b"Log", b"Sam"),
            b"",
        ),
    ),
    "JSON nested deeply": (stranger(SAMPLE_TOPIC, b"", b"[" * 5000, encoding="json"),),
    "JSON of another shape": (
        stranger(SAMPLE_TOPIC, b"", b'{"value": {"a": []}, "quality": [], "source": 3}', encoding="json"),
    ),
    "health of another shape": (stranger("/health", b"", b'{"source": ["x"], "state": 3}', encoding="json"),),
    "health without a source": (stranger("/health", b"", b'{"state": "open"}', encoding="json"),),
    "event of another shape": (stranger("/event", b"", b'{"message": {"a": 1}, "timestamp": 3}', encoding="json"),),
    "position of another shape": (stranger("/position", b"", b'{"latitude": "x"}', encoding="json"),),
    "channel of no name": (stranger("/channel/", SAMPLE_SCHEMA, SAMPLE_DATA),),
    "raw topic of no protocol": (stranger("/raw/", SAMPLE_SCHEMA, SAMPLE_DATA),),
    "raw topic of a strange protocol": (stranger("/raw/x/y", SAMPLE_SCHEMA, SAMPLE_DATA),),
    "unknown encoding": (stranger(SAMPLE_TOPIC, SAMPLE_SCHEMA, SAMPLE_DATA, encoding="cdr"),),
    "no finite value": (stranger(SAMPLE_TOPIC, SAMPLE_SCHEMA, SAMPLE_DATA[:1] + b"\xff" * 8 + SAMPLE_DATA[9:]),),
    "run sheet of infinite numbers": (
        serialise_record(
            mcap.Metadata("trial", {"origin_latitude_deg": "inf", "draught_m": "nan", "water_depth_m": "1e999"})
        ),
        stranger(SAMPLE_TOPIC, SAMPLE_SCHEMA, SAMPLE_DATA),
    ),
    "run sheet whose lists are no lists": (
        serialise_record(mcap.Metadata("trial", {"channels": "[" * 5000, "actuators": "{" * 5000})),
        stranger(SAMPLE_TOPIC, SAMPLE_SCHEMA, SAMPLE_DATA),
    ),
}
ACTIONS: dict[str, Callable[[Path, Path], list[str | Path]]] = {
    **COMMANDS,
    "export": lambda path, folder: ["export", path, "-o", folder / "table.csv"],
    "redecode": lambda path, folder: ["redecode", path, "-o", folder / "redecoded.mcap"],
    "migrate": lambda path, folder: ["migrate", path, "-o", folder / "migrated.mcap"],
}  # fmt: skip


@pytest.mark.parametrize("liar", LIARS)
def test_recording_that_lies_is_read_or_refused_in_one_line(command: Command, tmp_path: Path, liar: str) -> None:
    path = write_mcap(tmp_path / "liar.mcap", *LIARS[liar])
    for action, arguments in ACTIONS.items():
        (tmp_path / action).mkdir()
        assert_survives(command(*arguments(path, tmp_path / action)))
    assert_survives(command("info", path, "--json"))


@pytest.mark.parametrize("order", ["same", "another", "cut"])
def test_recording_with_another_behind_it_is_not_taken_for_one(
    command: Command, tmp_path: Path, small: bytes, blocks: bytes, order: str
) -> None:
    joined = {"same": small + small, "another": small + blocks, "cut": unclosed(small) + blocks}[order]
    path = tmp_path / "joined.mcap"
    path.write_bytes(joined)
    assert assert_survives(command("info", path)).code == 1
    recovered = assert_survives(command("recover", path, "-o", tmp_path / "saved.mcap", "--json"))
    assert recovered.json["recovered"] > 0


def test_part_of_another_recording_inside_is_noticed(
    command: Command, tmp_path: Path, small: bytes, blocks: bytes
) -> None:
    start = small.index(b"\x06", 400)
    path = tmp_path / "mixed.mcap"
    path.write_bytes(small[:start] + blocks[BLOCK_BYTES : 3 * BLOCK_BYTES] + small[start:])
    assert assert_survives(command("info", path)).code == 1


def test_densest_honest_recording_is_read(command: Command, tmp_path: Path) -> None:
    """Constant values, by the plain library, without indexes of messages, compressed by zstd."""
    messages = [message(1, SAMPLE_DATA, START_NS + number * 50_000_000) for number in range(150_000)]
    chunks = [
        chunk(b"".join(messages[start : start + 50_000]), level=3) for start in range(0, len(messages), 50_000)
    ]
    path = write_mcap(tmp_path / "dense.mcap", defined(SAMPLE_TOPIC), *chunks)
    assert command("info", path, "--json").json["messages"] == 150_000


def test_budget_is_raised_by_the_environment(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = MCAP_BOMBS["samples of one time"](tmp_path / "bomb.mcap")
    refused = command("info", path)
    assert refused.code == 1
    assert "SEATRIAL_BUDGET=10" in refused.err
    monkeypatch.setenv("SEATRIAL_BUDGET", "10")
    assert command("info", path, "--json").json["messages"] == 300_000


@pytest.mark.parametrize("factor", ["0", "-1", "nan", "inf", "much"])
def test_budget_that_is_no_factor_is_an_error(
    command: Command, tmp_path: Path, small: bytes, monkeypatch: pytest.MonkeyPatch, factor: str
) -> None:
    (tmp_path / "small.mcap").write_bytes(small)
    monkeypatch.setenv("SEATRIAL_BUDGET", factor)
    assert "SEATRIAL_BUDGET" in assert_survives(command("info", tmp_path / "small.mcap")).err


# Tables, logs and descriptions that expand


@pytest.mark.attack
@pytest.mark.parametrize("bomb", TABLE_BOMBS)
def test_small_table_never_takes_the_memory(tmp_path: Path, bomb: str) -> None:
    path = write_bomb(f"table: {bomb}", tmp_path / f"table{TABLE_BOMBS[bomb][0]}")
    outcome = run_seatrial("import", path, "-o", tmp_path / "out.mcap", "--yes").survived()
    path.unlink()
    assert outcome.peak_mb < MEMORY_MB
    if outcome.code:
        outcome.refused()


MQTT_VALUES = 'topics = ["a/#"]\nvalues.heading_deg = { topic = "a/b" }'
LOG_SOURCES = {".tlog": ("mavlink_file", ""), ".db": ("mqtt_file", MQTT_VALUES)}


def write_configuration(folder: Path, source: str) -> Path:
    """A configuration of one source."""
    trial = '[trial]\nname = "bomb"\nvessel = "gunnerus"\n'
    line = '[[source]]\nname = "line"\nchannels = ["heading_deg"]\n'
    (folder / "trial.toml").write_text(f"{trial}{line}{source}")
    return folder / "trial.toml"


@pytest.mark.attack
@pytest.mark.parametrize("bomb", LOG_BOMBS)
def test_small_log_never_takes_the_memory(tmp_path: Path, bomb: str) -> None:
    suffix = LOG_BOMBS[bomb][0]
    path = write_bomb(f"log: {bomb}", tmp_path / f"log{suffix}")
    kind, more = LOG_SOURCES.get(suffix, ("file", ""))
    configuration = write_configuration(tmp_path, f'type = "{kind}"\npath = "{path}"\n{more}\n')
    for arguments in (["record", configuration, "-o", tmp_path / "out"], ["discover", path]):
        outcome = run_seatrial(*arguments).survived()
        assert outcome.peak_mb < MEMORY_MB
    path.unlink()


@pytest.mark.attack
@pytest.mark.parametrize("bomb", TEXT_BOMBS)
def test_small_description_never_takes_the_memory(tmp_path: Path, bomb: str) -> None:
    """A DBC file in a configuration, or a TOML file as a configuration, a vessel and a column map."""
    suffix = TEXT_BOMBS[bomb][0]
    path = write_bomb(f"text: {bomb}", tmp_path / f"text{suffix}")
    commands: list[list[str | Path]] = [["record", path, "-o", tmp_path / "out", "--check"]]
    if suffix == ".dbc":
        signals = 'signals.heading_deg = { message = "M", signal = "S", unit = "deg" }\n'
        (tmp_path / "bus.log").write_text("(1780000000.0) can0 064#0102030405060708\n")
        source = f'type = "can_file"\npath = "{tmp_path / "bus.log"}"\ndbc = "{path}"\n{signals}'
        commands = [
            ["record", write_configuration(tmp_path, source), "-o", tmp_path / "out"],
            ["discover", "--dbc", path],
        ]
    else:
        (tmp_path / "table.csv").write_text("time,a\n1,2\n")
        commands += [
            ["vessel", "check", path],
            ["import", tmp_path / "table.csv", "-o", tmp_path / "out.mcap", "--columns", path],
        ]
    for arguments in commands:
        outcome = run_seatrial(*arguments).survived()
        assert outcome.peak_mb < MEMORY_MB


@pytest.mark.parametrize("kind", ["link", "storage", "virtual"])
@pytest.mark.parametrize("name", ["t.nc", "t.mat"])
def test_file_that_refers_to_another_is_refused(command: Command, tmp_path: Path, name: str, kind: str) -> None:
    write_hdf5(tmp_path / name, lambda file: link_to_another(file, kind))
    done = assert_survives(command("import", tmp_path / name, "-o", tmp_path / "out.mcap", "--yes"))
    assert "another file" in done.err
