"""Everything that comes is accounted for: decoded, refused with a reason, or named as carrying no channel."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.config.declarations import Transducer
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.ship import declare
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.logger.survey import missing_reasons_by_raw_input
from seatrial.acquisition.protocols.nmea0183 import NO_CHECKSUM, Nmea0183Decoder
from seatrial.acquisition.protocols.nmea2000 import Nmea2000Decoder
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.can_frames import can_frame, identifier_of
from tests.acquisition.conftest import config_text
from tests.acquisition.test_nmea0183 import line, sound

BARE = ("$HEHDT,57.3,T", "$GPGGA,120000,6326.4000,N,01024.0000,E,1,10,0.9,5.0,M,40.0,M,,", "!AIVDM,1,1,,A,13,0")


@pytest.mark.parametrize("text", BARE)
def test_a_sentence_without_a_checksum_is_refused_by_that_name(text: str) -> None:
    decoder = Nmea0183Decoder()
    assert decoder.decode(line(text.encode())) == []
    assert decoder.refused == {NO_CHECKSUM: 1}


@pytest.mark.parametrize(
    "text", ["$HEHDT,57.3,T*00", "$HEHDT,57.3,T*1", "$HEHDT,57.3,T*", "$noise", "$,,", "$HEHDT"]
)
def test_what_is_disturbed_is_not_taken_for_one_without_a_checksum(text: str) -> None:
    """Where checksums are optional a wrong or cut one is still wrong, and noise is no sentence."""
    for unchecked in (False, True):
        decoder = Nmea0183Decoder(unchecked=unchecked)
        assert decoder.decode(line(text.encode())) == []
        assert decoder.refused == {"no sound checksum": 1}


def test_a_cut_sentence_before_another_is_no_sentence_without_a_checksum() -> None:
    """`$HEHDT,12` and then a whole one: the 12 may have been 123."""
    decoder = Nmea0183Decoder(unchecked=True)
    ((only,),) = decoder.decode(line(b"$HEHDT,12" + sound("HEHDT,123.4,T")))
    assert only.value == 123.4
    assert decoder.refused == {"no sound checksum": 1}


def test_optional_checksums_decode_the_same_values() -> None:
    given, bare = (Nmea0183Decoder(unchecked=unchecked) for unchecked in (False, True))
    for text in BARE:
        with_sum = given.decode(line(sound(text[1:])))
        without = bare.decode(line(text.encode()))
        assert without == with_sum
    assert bare.refused == given.refused


@pytest.mark.parametrize("optional", [False, True])
def test_a_log_without_checksums(tmp_path: Path, optional: bool) -> None:
    """By default it is refused with what reads it; with that its values are in the recording."""
    times = [f"2026-05-17T12:00:{second:02d}Z" for second in range(5)]
    (tmp_path / "in.log").write_text("".join(f"{time} $HEHDT,{57.3},T\n" for time in times))
    option = 'checksum = "optional"\n' if optional else ""
    text = config_text(f'type = "file"\npath = "{tmp_path / "in.log"}"\n{option}', ("heading_deg",))
    (tmp_path / "trial.toml").write_text(text)
    if not optional:
        with pytest.raises(Exception, match='checksum = "optional" reads'):
            record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
        return
    (path,), _ = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    assert read_recording(path).series["heading_deg"].value.tolist() == [57.3] * 5


def test_of_what_comes_it_is_never_said_that_nothing_does(tmp_path: Path) -> None:
    said = [sound("HEHDT,,T"), b"$HEHDT,57.3,T", sound("GPGSV,1,1,00")]
    lines = [b"2026-05-17T12:00:0%dZ %s\n" % (number, each) for number, each in enumerate(said)]
    (tmp_path / "in.log").write_bytes(b"".join(lines))
    text = config_text(f'type = "file"\npath = "{tmp_path / "in.log"}"\n', ("heading_deg", "yaw_rate_dps"))
    (tmp_path / "trial.toml").write_text(text)
    (path,), health = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    reasons = missing_reasons_by_raw_input(path, ())
    assert reasons["heading_deg"].startswith("HDT comes, but ")
    assert reasons["yaw_rate_dps"].startswith("nothing that comes carries it")
    assert health.sources["line"].unknown_message_counts == {"GPGSV": 1}
    assert any("carries no channel, but recorded raw: GPGSV (1)" in text for _, text in read_recording(path).events)


@pytest.mark.parametrize(("body", "name"), [
    ("PSAT,HPR,120001.00,57.4,0.1,0.2,N", "PSAT"),
    ("RATTM,01,0.2,190.8,T,12.1,109.7,T,0.1,0.5,N,TGT01,T,,100021,A", "RATTM"),
    ("GPGSV,1,1,00", "GPGSV"),
    ("PSTT10,1,2", "PSTT10"),
])  # fmt: skip
def test_sound_sentences_that_carry_no_channel_are_named(body: str, name: str) -> None:
    decoder = Nmea0183Decoder()
    for _ in range(3):
        decoder.decode(line(sound(body)))
    assert decoder.unknown == {name: 3}
    assert not decoder.refused


def test_transducers_that_carry_no_channel_are_named_beside_those_that_do() -> None:
    helm = declare("helm_deg", "deg", -90.0, 90.0)
    decoder = Nmea0183Decoder(declared=[(helm, Transducer(transducer="HELM"))])
    decoder.decode(line(sound("YXXDR,A,5.0,D,HELM,A,2.5,D,RUDDER")))
    assert decoder.unknown == {"YXXDR RUDDER": 1}


def test_groups_and_messages_that_carry_no_channel_are_named() -> None:
    bus = Nmea2000Decoder()
    bus.decode(can_frame(identifier_of(127508), bytes(8)))
    bus.decode(can_frame(identifier_of(127250), "FFFFFFFFFFFFFFFC"))
    assert bus.unknown == {"127508": 1}


def test_noise_names_no_messages_without_end() -> None:
    decoder = Nmea0183Decoder()
    for number in range(2000):
        decoder.decode(line(sound(f"PX{number},1")))
    assert len(decoder.unknown) <= 500
