"""The MCAP recording: what goes in comes out, others can open it, a cut file is read as far as it goes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from google.protobuf import descriptor_pb2
from google.protobuf.unknown_fields import UnknownFieldSet
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap_protobuf.decoder import DecoderFactory

from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.acquisition.core.ship import BY_NAME, NAMES
from seatrial.acquisition.core.trial import Frame, FrameFlag, Quality, Sample, Trial
from seatrial.acquisition.logger.health import SourceHealth
from seatrial.acquisition.recording.messages import (
    Topic,
    decode,
    decode_frame,
    encode,
    encode_raw,
    encode_sample,
    message_kind_of_topic,
)
from seatrial.acquisition.recording.reader import MessageStream, describe_recording, read_recording
from seatrial.acquisition.recording.writer import RecordingWriter, write_table
from tests.acquisition.conftest import write_voyage

FULL_TRIAL = Trial(
    "a trial", "gunnerus_long", "Trondheimsfjord", 63.44, 10.4, 120.0, 2.7, "calm; coffee", -0.1, "half fuel", "2"
)


def test_table_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=20.0)
    recording = read_recording(tmp_path / "voyage.mcap")
    assert recording.closed
    assert recording.messages == table.size
    for name in NAMES:
        assert np.array_equal(recording.series[name].value, table[name].to_numpy())
        assert np.array_equal(recording.series[name].measured_ns, pd.DatetimeIndex(table.index).asi8)


@given(trial=st.builds(Trial, *(st.text(max_size=20) for _ in range(3)), *(st.none() | st.floats(-90, 90),) * 4))
def test_trial_survives_its_metadata(trial: Trial) -> None:
    assert Trial.from_metadata(trial.as_metadata()) == trial


def test_missing_values_are_not_written(tmp_path: Path) -> None:
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=2.0)
    table.loc[table.index[3:7], "sway_mps"] = math.nan
    assert write_table(table, tmp_path / "holes.mcap", FULL_TRIAL) == table.size - 4
    recording = read_recording(tmp_path / "holes.mcap")
    assert recording.series["sway_mps"].value.size == len(table) - 4
    assert recording.trial == FULL_TRIAL


TOPICS = {
    "/channel/heading_deg", "/raw/can/bus", "/raw/nmea0183/gyro", "/raw/mavlink/pilot", "/position", "/event",
    "/health", "/prediction", "/prediction/track",
}  # fmt: skip


def decoded(path: Path) -> dict[str, tuple[Schema, Channel, Message, Any]]:
    """The last message of each topic as the library's own reader of protobuf has it, by the schema in the file."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = {}
        for schema, channel, message, body in reader.iter_decoded_messages():
            assert schema is not None
            found[channel.topic] = schema, channel, message, body
    return found


def test_a_plain_reader_opens_it_with_schemas_and_topics(tmp_path: Path) -> None:
    """Viewers skip a topic without a schema, so every topic has one, and nothing is known that it does not say."""
    path = tmp_path / "all.mcap"
    with RecordingWriter(path, FULL_TRIAL, {"configuration.toml": b"[trial]"}) as writer:
        writer.write_sample(Sample("heading_deg", 12.5, "gyro/HE:HDT", 5, 1, 4, 3_500_000_000, "gps", Quality.GOOD))
        writer.write_raw(Frame("bus", "can", b"\x01\xff", 6, 2, 0x09F11223, FrameFlag.NONE))
        writer.write_raw(Frame("gyro", "nmea0183", b"$HEHDT,\xff", 6, 2))
        writer.write_raw(Frame("pilot", "mavlink", b"\xfd\x00", 6, 2))
        writer.write_position(63.4, 10.4, 7, 7_000_000_001)
        writer.write_event("start 20/20", 8)
        writer.write_health(SourceHealth("gyro", last_ns=1_000_000_000).as_message(3_500_000_000), 9)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert {record.name for record in reader.iter_metadata()} == {"trial"}
        assert [attachment.data for attachment in reader.iter_attachments()] == [b"[trial]"]
    found = decoded(path)
    assert found.keys() == TOPICS - {"/prediction", "/prediction/track"}
    for schema, channel, _, body in found.values():
        assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
        assert not len(UnknownFieldSet(body))
    _, channel, message, heading = found["/channel/heading_deg"]
    assert (message.log_time, message.publish_time) == (5, 4)
    assert (heading.value, heading.quality, heading.monotonic_ns) == (12.5, Quality.GOOD, 1)
    assert (heading.source, heading.source_time, heading.source_clock) == ("gyro/HE:HDT", 3.5, "gps")
    assert channel.metadata["unit"] == "deg"
    assert found["/raw/can/bus"][3].data == b"\x01\xff"
    assert found["/raw/nmea0183/gyro"][3].sentence == "$HEHDT,ÿ"
    assert (found["/position"][0].name, found["/event"][0].name) == ("foxglove.LocationFix", "foxglove.Log")
    assert (found["/position"][3].latitude, found["/position"][3].timestamp.nanos) == (63.4, 1)
    assert (found["/event"][3].level, found["/event"][3].message) == (2, "start 20/20")
    assert (found["/health"][3].source, found["/health"][3].age_s) == ("gyro", 2.5)


@pytest.mark.parametrize("name", ["LocationFix", "Log", "GeoJson"])
def test_well_known_messages_have_the_published_fields(name: str) -> None:
    """Number, type and multiplicity of every field that is used, against the package of those who publish them."""
    messages = pytest.importorskip("foxglove.messages")
    published = getattr(messages, name).get_schema()
    files = descriptor_pb2.FileDescriptorSet.FromString(published.data)
    (theirs,) = [
        each for file in files.file for each in file.message_type if each.name == published.name.split(".")[1]
    ]
    (kind,) = [kind for kind in map(message_kind_of_topic, TOPICS) if kind.title == published.name]
    ours = descriptor_pb2.DescriptorProto()
    kind.message.DESCRIPTOR.CopyToProto(ours)
    known = {field.name: (field.number, field.type, field.label, field.type_name) for field in theirs.field}
    for field in ours.field:
        assert known[field.name] == (field.number, field.type, field.label, field.type_name)
    assert list(ours.enum_type) == list(theirs.enum_type)


@given(
    value=st.floats(), source_ns=st.none() | st.integers(0, 2**62), monotonic_ns=st.integers(-(2**63), 2**63 - 1),
    quality=st.sampled_from(list(Quality)), source=st.text(max_size=20), clock=st.text(max_size=20),
)  # fmt: skip
def test_a_sample_is_laid_out_as_documented(
    value: float, source_ns: int | None, monotonic_ns: int, quality: Quality, source: str, clock: str
) -> None:
    """The numbers are found at fixed places without a parser, and a parser finds the same."""
    data = encode_sample(Sample("roll_deg", value, source, 0, monotonic_ns, 0, source_ns, clock, quality))
    places = {"value": ("<f8", 1), "source_time": ("<f8", 10), "monotonic_ns": ("<i8", 19), "quality": ("<u4", 28)}
    parsed = decode(Topic("/channel/roll_deg"), data)
    for name, (kind, place) in places.items():
        found = np.frombuffer(data, kind, 1, place)[0]
        assert found == parsed[name] or (math.isnan(found) and math.isnan(parsed[name]))
    assert parsed["value"] == value or math.isnan(value)
    assert math.isnan(parsed["source_time"]) == (source_ns is None)
    assert (parsed["source"], parsed["source_clock"], parsed["quality"]) == (source, clock, quality)
    assert encode("/channel/roll_deg", parsed) == data


@given(
    payload=st.binary(max_size=300), identifier=st.integers(0, 2**32 - 1), flags=st.integers(0, 31),
    monotonic_ns=st.integers(-(2**63), 2**63 - 1), sender=st.text(max_size=10),
)  # fmt: skip
def test_a_frame_comes_back_from_its_message(
    payload: bytes, identifier: int, flags: int, monotonic_ns: int, sender: str
) -> None:
    frame = Frame("bus", "can", payload, 6, monotonic_ns, identifier, FrameFlag(flags), sender=sender)
    topic = "/raw/can/bus"
    data = encode_raw(topic, frame)
    assert decode_frame(Topic(topic), data, 6, 6) == frame
    assert decode(Topic(topic), data) == decode(Topic(topic), encode(topic, decode(Topic(topic), data)))


def test_channels_say_their_units(tmp_path: Path) -> None:
    write_voyage(tmp_path / "voyage.mcap", duration_s=1.0)
    found = decoded(tmp_path / "voyage.mcap")
    for name in NAMES:
        schema, channel, _, _ = found[f"/channel/{name}"]
        assert schema.name == "seatrial.Sample"
        assert channel.metadata["unit"] == BY_NAME[name].unit
        assert channel.metadata["meaning"] == BY_NAME[name].meaning


def test_what_was_flushed_survives_a_kill(tmp_path: Path) -> None:
    """Without close, everything up to the last flush is there and the file says that it was not closed."""
    writer = RecordingWriter(tmp_path / "killed.mcap", Trial())
    for number in range(100):
        writer.write_sample(Sample("surge_mps", float(number), "s", number, number, number))
        if number == 79:
            writer.flush()
    copy = tmp_path / "copy.mcap"
    copy.write_bytes((tmp_path / "killed.mcap").read_bytes())
    recording = read_recording(copy)
    assert not recording.closed
    assert recording.series["surge_mps"].value.tolist() == [float(number) for number in range(80)]
    writer.close()
    assert read_recording(tmp_path / "killed.mcap").closed


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0.0, 1.0, exclude_max=True))
@example(share=0.9999)  # within the last magic bytes
def test_any_prefix_is_read_without_a_crash(tmp_path_factory: pytest.TempPathFactory, share: float) -> None:
    folder = tmp_path_factory.mktemp("prefix")
    write_voyage(folder / "whole.mcap", duration_s=5.0)
    whole = (folder / "whole.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: int(share * len(whole))])
    if int(share * len(whole)) < 8:
        with pytest.raises(InputError):
            read_recording(folder / "cut.mcap")
    else:
        assert not read_recording(folder / "cut.mcap").closed


@settings(max_examples=60, deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_never_changes_a_value(
    tmp_path_factory: pytest.TempPathFactory, place: float, bit: int
) -> None:
    """Either the damage is reported, or it lies where no value is; never a wrong value without a word."""
    folder = tmp_path_factory.mktemp("flip")
    table = write_voyage(folder / "voyage.mcap", duration_s=5.0)
    damaged = bytearray((folder / "voyage.mcap").read_bytes())
    damaged[int(place * len(damaged))] ^= 1 << bit
    (folder / "damaged.mcap").write_bytes(damaged)
    try:
        series = read_recording(folder / "damaged.mcap").series
    except InputError:
        return
    for name, each in series.items():
        assert np.array_equal(each.value, table[name].to_numpy()[: each.value.size])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"time,north_m\n1,2\n" * 20, "is not an MCAP recording"),
        (b"x", "is not an MCAP"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "fake.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        describe_recording(read_recording(path))


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        describe_recording(read_recording(tmp_path / "nowhere.mcap"))
    with pytest.raises(InputError, match="is a folder"):
        describe_recording(read_recording(tmp_path))


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="cannot be created"):
        RecordingWriter(tmp_path / "file" / "x.mcap", Trial())


def test_info_counts_rates_and_gaps(tmp_path: Path) -> None:
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=10.0)
    table.loc[table.index[20:40], "port_rpm"] = math.nan
    write_table(table, tmp_path / "gap.mcap", FULL_TRIAL, source="logger")
    found = describe_recording(read_recording(tmp_path / "gap.mcap"))
    assert found["closed"]
    assert found["trial"]["trial"] == "a trial"
    assert found["duration_s"] == pytest.approx(9.9)
    port = found["channels"]["port_rpm"]
    assert port["count"] == 80
    assert port["longest_gap_s"] == pytest.approx(2.1)
    assert port["sources"] == ["logger"]
    assert found["channels"]["heading_deg"]["rate_hz"] == pytest.approx(10.0)


def test_a_stream_hands_over_the_configuration(tmp_path: Path) -> None:
    RecordingWriter(tmp_path / "x.mcap", Trial(), {"configuration.toml": "[trial]\nname = 'ø'\n".encode()}).close()
    stream = MessageStream(tmp_path / "x.mcap")
    assert list(stream) == []
    assert stream.attachments["configuration.toml"].decode() == "[trial]\nname = 'ø'\n"


def info_at(columns: int, path: Path) -> str:
    """What ``seatrial info`` prints on a terminal of so many columns."""
    from typer.testing import CliRunner

    from seatrial import app

    result = CliRunner().invoke(app, ["info", str(path)], env={"COLUMNS": str(columns)})
    assert result.exit_code == 0
    return result.stdout


def test_info_loses_nothing_at_80_columns(tmp_path: Path) -> None:
    """Every source is there to its last letter, though some need a second line."""
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=2.0)
    source = "backbone/33:StarboardAzimuth derived from far away"
    write_table(table, tmp_path / "long.mcap", FULL_TRIAL, source=source)
    shown = info_at(80, tmp_path / "long.mcap")
    assert "…" not in shown
    assert all(len(line) <= 80 for line in shown.splitlines() if line.startswith(NAMES))
    assert all(word in shown for word in source.split())
    assert "closed properly" in shown


def test_info_of_a_recording_without_a_message_names_no_time(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "empty.mcap", FULL_TRIAL)
    writer.flush()
    shown = info_at(80, tmp_path / "empty.mcap")
    writer.close()
    assert "NOT CLOSED" in shown
    assert "0 messages" in shown
    assert "1970" not in shown


def test_a_stranger_s_metadata_command_no_terminal(tmp_path: Path) -> None:
    """Escapes in names, notes, sources, metadata and events are shown, not obeyed; JSON has them as escapes."""
    evil = "\x1b[2J\x9b31m\u202e\a"
    path = tmp_path / "evil.mcap"
    with RecordingWriter(path, Trial(f"name {evil}", vessel=evil, crew_notes=f"calm {evil}")) as writer:
        writer.write_metadata("part", {"number": evil, "follows": evil, "reason": evil})
        writer.write_sample(Sample("heading_deg", 12.5, f"gyro{evil}", 5, 1, 4))
        writer.write_raw(Frame(f"line{evil}", "nmea0183", evil.encode(), 6, 2))
        writer.write_event(evil, 8)
        writer.write_health({"source": evil, "state": evil, "reasons": {evil: 1}}, 9)
    from typer.testing import CliRunner

    from seatrial import app

    for arguments in (["info", str(path)], ["info", str(path), "--json"], ["check", str(path)]):
        shown = CliRunner().invoke(app, arguments).output
        assert "name" in shown or arguments[0] == "check"
        assert not set(shown) & set(evil.replace("[2J", "").replace("31m", "")), arguments
    recording = read_recording(path)
    assert recording.trial.crew_notes == r"calm \x1b[2J\x9b31m\u202e\x07"
    texts = str((recording.trial, recording.metadata, recording.events, recording.health, recording.raw))
    assert not set(texts) & set("\x1b\x9b\u202e\a")
    assert "\x1b" not in str(InputError("cannot", where=evil))


def test_foreign_topics_of_our_names_are_one_clear_error(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "foreign.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("other", "jsonschema", b"{}")
        topic = writer.register_channel("/channel/heading_deg", "json", schema)
        writer.add_message(topic, 1, b'{"degrees": 5}', 1)
        writer.finish()
    with pytest.raises(InputError, match="topic /channel/heading_deg holds a message that is no sample of ours"):
        read_recording(tmp_path / "foreign.mcap")
