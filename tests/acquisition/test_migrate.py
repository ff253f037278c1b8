"""Recordings with JSON messages: every command reads them, and they migrate without a loss.

The file was written by the last version that wrote JSON: four seconds of a bus, a line and an autopilot, with what
a recorder and a twin say beside it.
"""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.errors import InputError, StorageError
from seatrial.acquisition.core.trial import NANO, Frame
from seatrial.acquisition.emulator import iterate_moments
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.recording.reader import MessageStream, Recording, Tail, describe_recording, read_recording
from seatrial.acquisition.recording.recover import migrate, recover
from seatrial.analysis.tables.table import read_table

OLD = Path(__file__).with_name("recorded_as_json.mcap.gz")
START_NS = 1_790_000_000 * NANO


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "old.mcap"
    path.write_bytes(gzip.decompress(OLD.read_bytes()))
    return path


def messages(path: Path) -> list[tuple[str, int, int, int]]:
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.publish_time, message.sequence)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def frames(path: Path) -> list[Frame]:
    return [entry.decode_frame() for entry in MessageStream(path) if entry.topic.startswith("/raw")]


def said(value: Any) -> Any:
    """What there is to say: a time that is not told, and what is empty or 0, may be left out."""
    if not isinstance(value, dict):
        return value
    return {key: said(each) for key, each in value.items() if each and each == each}


def bodies(path: Path) -> list[dict[str, Any]]:
    return [said(entry.decode_body()) for entry in MessageStream(path)]


def assert_equal(one: Recording, other: Recording) -> None:
    assert one.series.keys() == other.series.keys()
    for name, series in one.series.items():
        assert series.sources == other.series[name].sources
        for column in ("measured_ns", "received_ns", "value", "quality", "source_index"):
            assert np.array_equal(getattr(series, column), getattr(other.series[name], column))
    for field in ("trial", "raw", "events", "messages", "start_ns", "end_ns", "metadata", "predictions"):
        assert getattr(one, field) == getattr(other, field), field
    assert {name: each["reasons"] for name, each in one.health.items()} == {
        name: each["reasons"] for name, each in other.health.items()
    }


def test_a_recording_in_json_is_read_by_everything(old: Path, tmp_path: Path) -> None:
    recording = read_recording(old)
    assert recording.series["heading_deg"].value == pytest.approx([359.0, 0.0, 1.0, 2.0], abs=0.01)
    assert recording.series["port_rpm"].sources == ("line/RC:TRD",)
    assert recording.events[-1] == (START_NS + 4 * NANO, "start 20/20 æ")
    assert recording.health["link"]["reasons"] == {"not available": 4}
    assert recording.predictions == 1
    assert recording.raw == {"/raw/can/bus": 24, "/raw/nmea0183/line": 37, "/raw/mavlink/link": 4}
    raw = frames(old)
    assert raw[-1].payload == b"$HEHDT,\xff\xe6"
    assert [each.stamped_ns for each in raw if each.stamped_ns] == [START_NS + 2 * NANO - 3_000_000] * 16
    assert read_table(old)["heading_deg"].dropna().size == 4
    with Tail(old) as tail:
        assert tail.read_new_samples()["heading_deg"].value.size == 4
    assert len(list(iterate_moments(recording, ("heading_deg",), None))) == 4
    recover(old, tmp_path / "saved.mcap")
    assert_equal(read_recording(tmp_path / "saved.mcap"), recording)


def test_redecoding_a_recording_in_json_gives_the_same_channels_in_protobuf(old: Path, tmp_path: Path) -> None:
    redecode([old], tmp_path / "anew.mcap")
    before, after = read_recording(old), read_recording(tmp_path / "anew.mcap")
    assert {name: each.value.tolist() for name, each in before.series.items()} == {
        name: each.value.tolist() for name, each in after.series.items()
    }
    assert frames(tmp_path / "anew.mcap") == frames(old)
    assert {entry.described.encoding for entry in MessageStream(tmp_path / "anew.mcap")} == {"protobuf"}
    assert after.predictions == 1
    assert before.events[-1] in after.events


def test_a_migrated_recording_says_the_same(old: Path, tmp_path: Path) -> None:
    before, new = old.read_bytes(), tmp_path / "new.mcap"
    done = migrate(old, new)
    assert old.read_bytes() == before
    assert (done.converted.total(), done.unconverted) == (137, {})
    assert_equal(read_recording(new), read_recording(old))
    assert describe_recording(read_recording(new)) == describe_recording(read_recording(old))
    assert messages(new) == messages(old)
    assert frames(new) == frames(old)
    assert bodies(new) == bodies(old)
    streams = MessageStream(old), MessageStream(new)
    assert [len(list(each)) for each in streams] == [137, 137]
    assert streams[0].attachments == streams[1].attachments != {}
    with new.open("rb") as stream:  # as other programs see it
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = {channel.topic: body for _, channel, _, body in reader.iter_decoded_messages()}
    assert found["/event"].message == "start 20/20 æ"
    assert (found["/position"].latitude, found["/position"].timestamp.seconds) == (63.44003, 1_790_000_003)
    assert found["/channel/tunnel_rpm"].source == "line/RC:TRD"


def test_what_is_not_ours_and_what_fits_no_schema_is_kept_as_it_is(tmp_path: Path) -> None:
    source, target = tmp_path / "mixed.mcap", tmp_path / "new.mcap"
    theirs = {
        "/channel/north_m": [b'{"value": 2, "source": "a", "quality": 2}', b'{"value": 2, "more": 1}'],
        "/camera": [b'{"of": "another"}'],
        "/raw/semaphore/x": [b"{}"],
        "/health": [b'{"source": "a"}'],
    }
    with source.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="theirs")
        schema = writer.register_schema("other", "jsonschema", b"{}")
        for number, (topic, payloads) in enumerate(theirs.items()):
            channel = writer.register_channel(topic, "json", schema, {"kept": "too"})
            for payload in payloads:
                writer.add_message(channel, number, payload, number)
        writer.add_attachment(3, 4, "hull.stl", "model/stl", bytes(100))
        writer.finish()
    done = migrate(source, target)
    assert done.converted == {"/channel/north_m": 1, "/health": 1}
    assert done.unconverted == {"/channel/north_m": 1}
    found = {(entry.topic, entry.described.encoding): entry.data for entry in MessageStream(target)}
    assert found["/channel/north_m", "json"] == theirs["/channel/north_m"][1]
    assert (found["/camera", "json"], found["/raw/semaphore/x", "json"]) == (b'{"of": "another"}', b"{}")
    assert found.keys() >= {("/channel/north_m", "protobuf"), ("/health", "protobuf")}
    with target.open("rb") as stream:
        reader = make_reader(stream)
        (attachment,) = reader.iter_attachments()
        assert (attachment.create_time, attachment.log_time, attachment.data) == (3, 4, bytes(100))
        assert reader.get_header().profile == "theirs"


def test_migrate_refuses_what_it_cannot_do_whole(old: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.mcap"
    damaged = bytearray(old.read_bytes())
    damaged[damaged.index(b"zstd") + 60] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    with pytest.raises(InputError, match=r"is damaged.*first save what is intact with `seatrial recover`"):
        migrate(tmp_path / "damaged.mcap", new)
    assert not new.exists()
    migrate(old, new)
    with pytest.raises(StorageError, match="already exists"):
        migrate(old, new)
    with pytest.raises(InputError, match="has nothing to migrate: 137 messages, none of ours in JSON"):
        migrate(new, tmp_path / "again.mcap")


def test_the_command_says_what_it_did(old: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["migrate", str(old), "-o", str(tmp_path / "new.mcap")])
    assert result.exit_code == 0
    assert "137 of 137 messages converted" in result.stderr
    assert result.stdout.strip() == str(tmp_path / "new.mcap")
    result = CliRunner().invoke(app, ["migrate", str(old), "-o", str(tmp_path / "json.mcap"), "--json"])
    assert sum(json.loads(result.stdout)["converted"].values()) == 137
