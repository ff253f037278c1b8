"""Ships with rudders and propellers: what sentences and groups say of them, and what none can say."""

from __future__ import annotations

import struct
from math import degrees, isfinite
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.ship import (
    MOTION,
    Actuator,
    Actuators,
    actuators_of_table,
    channel_names,
    parse_actuators,
    shaft_numbers,
    shaft_of_number,
    shafts_in_rpm_sentences,
    trial_channel_names,
)
from seatrial.acquisition.emulator import emulate
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, frame_sentence
from seatrial.acquisition.protocols.nmea2000 import Nmea2000Decoder
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.tables.import_table import import_table
from tests.acquisition.can_frames import can_frame, identifier_of, values
from tests.acquisition.conftest import SINGLE_SCREW, TWIN_SCREW, actuator_text, config_text, write_ship_voyage
from tests.acquisition.test_nmea0183 import line
from tests.conftest import Command

ROOT = Path(__file__).parents[2]
TRIPLE_SCREW = tuple(Actuator(name, "propeller") for name in ("port", "centre", "starboard"))
MIXED = (Actuator("port", "azimuth"), Actuator("starboard", "azimuth"), Actuator("centre", "propeller"))
JETS = (Actuator("port", "waterjet"), Actuator("starboard", "waterjet"))
RATIOS = {"main": 4.0, "port": 2.0, "starboard": 5.0}


def said(ship: Actuators, body: str) -> tuple[dict[str, float], dict[str, int]]:
    """What a sentence says on a ship, and what is counted as refused."""
    decoder = Nmea0183Decoder(actuators=ship, reduction_ratios=RATIOS)
    return values(decoder.decode(line(frame_sentence(body).strip()))), dict(decoder.refused)


@pytest.mark.parametrize(
    ("ship", "body", "expected"),
    [
        (TWIN_SCREW, "ERRSA,-5.0,A,7.0,A", {"starboard_rudder_angle_deg": -5.0, "port_rudder_angle_deg": 7.0}),
        (TWIN_SCREW, "ERRSA,-5.0,V,7.0,A", {"port_rudder_angle_deg": 7.0}),
        (SINGLE_SCREW, "ERRSA,-5.0,A,,V", {"rudder_angle_deg": -5.0}),
        (SINGLE_SCREW, "ERRSA,,V,7.0,A", {"rudder_angle_deg": 7.0}),
        (TWIN_SCREW, "AGROR,10.0,A,12.0,A,B", {
            "starboard_rudder_order_angle_deg": 10.0, "port_rudder_order_angle_deg": 12.0,
        }),
        (SINGLE_SCREW, "AGROR,-35.0,A,,V,B", {"rudder_order_angle_deg": -35.0}),
        (SINGLE_SCREW, "AGHTD,V,12.5,L,S,N,35.0,,,,90.0,,,T,A,,,91.0", {"rudder_order_angle_deg": -12.5}),
        (SINGLE_SCREW, "AGHTD,V,12.5,R,S,N,35.0,,,,90.0,,,T,A,,,91.0", {"rudder_order_angle_deg": 12.5}),
        (SINGLE_SCREW, "AGHTD,V,,,S,N,35.0,,,,90.0,,,T,A,,,91.0", {}),
        (TWIN_SCREW, "ERRPM,S,1,-120.0,90.0,A", {"starboard_rpm": -120.0}),
        (TWIN_SCREW, "ERRPM,S,2,120.0,,A", {"port_rpm": 120.0}),
        (TWIN_SCREW, "ERRPM,E,1,600.0,,A", {"starboard_rpm": 120.0}),
        (TWIN_SCREW, "ERRPM,E,2,600.0,,A", {"port_rpm": 300.0}),
        (SINGLE_SCREW, "ERRPM,S,0,120.0,-40.5,A", {"main_rpm": 120.0, "main_pitch_percent": -40.5}),
        (SINGLE_SCREW, "ERRPM,S,1,120.0,80.0,A", {"main_rpm": 120.0, "main_pitch_percent": 80.0}),
        (SINGLE_SCREW, "ERRPM,E,0,480.0,80.0,A", {"main_rpm": 120.0, "main_pitch_percent": 80.0}),
        (SINGLE_SCREW, "ERRPM,S,0,,80.0,A", {"main_pitch_percent": 80.0}),
        (SINGLE_SCREW, "RCPRC,50.0,A,130.0,R,75.0,P,B,0", {
            "main_order_rpm": 130.0, "main_order_pitch_percent": 75.0,
        }),
        (SINGLE_SCREW, "RCPRC,50.0,A,60.0,P,12.0,D,B,0", {}),
        (TWIN_SCREW, "RCPRC,,V,-90.0,R,,V,B,2", {"port_order_rpm": -90.0}),
        (SINGLE_SCREW, "RCTRD,1,-17.8,R,,V,", {"bow_rpm": -17.8}),
        (TRIPLE_SCREW, "ERRPM,S,0,60.0,,A", {"centre_rpm": 60.0}),
        (MIXED, "ERRPM,S,0,60.0,,A", {"centre_rpm": 60.0}),
        (JETS, "ERRPM,S,1,600.0,,A", {"starboard_rpm": 600.0}),
    ],
)  # fmt: skip
def test_what_a_sentence_says_of_a_ship(ship: Actuators, body: str, expected: dict[str, float]) -> None:
    assert said(ship, body)[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("ship", "body", "reason"),
    [
        (TWIN_SCREW, "ERRSA,-5.0,V,7.0,V", "not marked valid"),
        (tuple(Actuator(name, "rudder") for name in "abc"), "ERRSA,-5.0,A,7.0,A", "more than two rudders"),
        (TWIN_SCREW, "AGHTD,V,12.5,R,S", "one order to several rudders"),
        (TWIN_SCREW, "ERRPM,S,0,1.0,,A", "rpm of a single or unknown shaft"),
        (SINGLE_SCREW, "ERRPM,S,2,1.0,,A", "rpm of a single or unknown shaft"),
        (MIXED[2:], "ERRPM,E,0,1.0,,A", "engine rpm"),
        (TWIN_SCREW, "RCPRC,,V,-90.0,R,,V,B,0", "order to an unknown shaft"),
    ],
)
def test_what_a_sentence_cannot_say_is_counted(ship: Actuators, body: str, reason: str) -> None:
    assert said(ship, body) == ({}, {reason: 1})


@pytest.mark.parametrize("ship", [TWIN_SCREW, SINGLE_SCREW, TRIPLE_SCREW, MIXED, JETS])
def test_the_number_of_a_shaft_is_that_shafts(ship: Actuators) -> None:
    """IEC 61162-1: from the centre line odd to starboard, even to port, 0 on it."""
    shafts = shafts_in_rpm_sentences(ship)
    numbers = shaft_numbers(shafts)
    assert [shaft_of_number(numbers[each.name], shafts) for each in shafts] == list(shafts)
    assert all(number % 2 == 1 for name, number in numbers.items() if name == "starboard")
    assert all(number % 2 == 0 for name, number in numbers.items() if name in ("port", "centre"))


def rudder(instance: int, position_rad: float | None, order_rad: float | None = None) -> bytes:
    raw = [0x7FFF if each is None else round(each * 1e4) for each in (order_rad, position_rad)]
    return struct.pack("<BBhhH", instance, 0xF8, *raw, 0xFFFF)


def engine(instance: int, rpm: float) -> bytes:
    return struct.pack("<BHHbH", instance, round(rpm * 4), 0xFFFF, 0x7F, 0xFFFF)


def gear(instance: int, code: int) -> bytes:
    return struct.pack("<BBHHBB", instance, 0xFC | code, 0xFFFF, 0xFFFF, 0xFF, 0xFF)


def heard(ship: Actuators, *frames: tuple[int, bytes]) -> tuple[dict[str, float], dict[str, int]]:
    """What groups say on a ship, the last value of each channel, and what is counted as refused."""
    decoder, found = Nmea2000Decoder(actuators=ship, reduction_ratios=RATIOS), {}
    for place, (group, data) in enumerate(frames):
        found |= values(decoder.decode(can_frame(identifier_of(group), data, 0.1 * place)))
    return found, dict(decoder.refused)


@pytest.mark.parametrize(
    ("ship", "frames", "expected"),
    [
        (TWIN_SCREW, [(127245, rudder(0, 0.1, 0.2)), (127245, rudder(1, -0.3))], {
            "port_rudder_angle_deg": degrees(0.1), "port_rudder_order_angle_deg": degrees(0.2),
            "starboard_rudder_angle_deg": degrees(-0.3),
        }),
        (SINGLE_SCREW, [(127245, rudder(1, 0.1))], {"rudder_angle_deg": degrees(0.1)}),
        (SINGLE_SCREW, [(127245, rudder(0, None, -0.5))], {"rudder_order_angle_deg": degrees(-0.5)}),
        (SINGLE_SCREW, [(127488, engine(0, 480.0))], {"main_rpm": 120.0}),
        (TWIN_SCREW, [(127488, engine(0, 480.0)), (127488, engine(1, 600.0))], {
            "port_rpm": 240.0, "starboard_rpm": 120.0,
        }),
        (TWIN_SCREW, [(127493, gear(1, 2)), (127488, engine(1, 600.0)), (127488, engine(0, 480.0))], {
            "port_rpm": 240.0, "starboard_rpm": -120.0,
        }),
        (TWIN_SCREW, [(127493, gear(1, 2)), (127493, gear(1, 0)), (127488, engine(1, 600.0))], {
            "starboard_rpm": 120.0,
        }),
    ],
)  # fmt: skip
def test_what_a_group_says_of_a_ship(
    ship: Actuators, frames: list[tuple[int, bytes]], expected: dict[str, float]
) -> None:
    assert heard(ship, *frames) == (pytest.approx(expected), {})


@pytest.mark.parametrize(
    ("ship", "frames", "reason"),
    [
        (TWIN_SCREW, [(127245, rudder(2, 0.1))], "another instance"),
        (TWIN_SCREW, [(127488, engine(2, 600.0))], "engine without a reduction ratio"),
        (TWIN_SCREW, [(127493, gear(0, 1)), (127488, engine(0, 600.0))], "gearbox in neutral"),
        (SINGLE_SCREW, [(127488, struct.pack("<BHHbH", 0, 0xFFFF, 0xFFFF, 0x7F, 0xFFFF))], "not available"),
    ],
)
def test_what_a_group_cannot_say_is_counted(ship: Actuators, frames: list[tuple[int, bytes]], reason: str) -> None:
    assert heard(ship, *frames) == ({}, {reason: 1})


def config_of(folder: Path, ship: Actuators, section: str, *channels: str) -> TrialConfig:
    (folder / "ship.toml").write_text(actuator_text(ship) + config_text(section, channels, "receiver"))
    return load_config(folder / "ship.toml")


CAN = 'type = "can"\ninterface = "virtual"\nchannel = "x"\n'
LINE = 'type = "udp"\nport = 1\n'


@pytest.mark.parametrize(
    ("ship", "section", "channel", "way_out"),
    [
        (JETS, LINE, "port_angle_deg", "not of waterjets' nozzles"),
        (tuple(Actuator(name, "propeller") for name in "abcd"), LINE, "a_rpm", r"three shafts \(RPM, PRC\)"),
        (tuple(Actuator(name, "rudder") for name in "abc"), LINE, "a_angle_deg", "two rudders"),
        (SINGLE_SCREW, CAN, "main_rpm", "reduction_ratios"),
        (SINGLE_SCREW, CAN, "main_pitch_percent", r"\[source.signals\]"),
        (SINGLE_SCREW, CAN + "reduction_ratios = { main = 4.0 }\n", "main_pitch_percent", r"\[source.signals\]"),
        (SINGLE_SCREW, 'type = "mavlink"\nport = 1\n', "rudder_order_angle_deg", r"\[source.named_values\]"),
    ],
)
def test_what_nothing_carries_is_refused_with_a_way_out(
    ship: Actuators, section: str, channel: str, way_out: str, tmp_path: Path
) -> None:
    with pytest.raises(
        ConfigurationError, match=rf"line \d+: no message on source 'line' carries {channel}.*{way_out}"
    ):
        config_of(tmp_path, ship, section, channel)


@pytest.mark.parametrize(
    ("ship", "section", "message"),
    [
        (
            SINGLE_SCREW,
            LINE + "reduction_ratios = { rudder = 2.0 }\n",
            "is not a shaft of the ship; its shafts are main",
        ),
        (SINGLE_SCREW, CAN + "reduction_ratios = { main = 0.0 }\n", "greater than 0"),
        (SINGLE_SCREW, LINE + "thrusters = { main = 2 }\n", "there is no thruster main; the thrusters are bow"),
        (TWIN_SCREW, LINE + "thrusters = { port = 2 }\n", "there is no thruster port; the thrusters are none"),
    ],
)
def test_settings_of_the_wrong_actuator_name_their_line(
    ship: Actuators, section: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=rf"line \d+: .*{message}"):
        config_of(tmp_path, ship, section, "heading_deg")


def test_a_listed_rudder_is_no_auxiliary_channel() -> None:
    """Each name once; a ship without rudders in her list may still record one beside it."""
    assert len(set(channel_names(SINGLE_SCREW))) == len(channel_names(SINGLE_SCREW))
    assert "rudder_angle_deg" not in channel_names(TWIN_SCREW)
    assert "rudder_angle_deg" in channel_names(MIXED)


def test_a_table_with_a_rudder_is_of_a_ship_with_one() -> None:
    """But beside thrusters that steer, such as R/V Gunnerus', it is an auxiliary channel."""
    twin = (Actuator("port", "propeller"), Actuator("starboard", "propeller"), Actuator("rudder", "rudder"))
    for ship in (SINGLE_SCREW, TWIN_SCREW, twin):
        assert trial_channel_names(actuators_of_table(trial_channel_names(ship))) == trial_channel_names(ship)
    beside = (*MOTION, "port_rpm", "port_angle_deg", "rudder_angle_deg")
    assert "rudder_angle_deg" not in trial_channel_names(actuators_of_table(beside))


def test_a_shaft_is_preferred_to_its_engine(tmp_path: Path) -> None:
    """Where a line sends both, the shaft's own speed is recorded."""
    both = [frame_sentence(f"ERRPM,{source},,A") for source in ("E,0,400.0", "S,0,101.0", "E,0,404.0", "S,0,102.0")]
    (tmp_path / "bridge.log").write_bytes(b"".join(both))
    section = 'type = "file"\npath = "bridge.log"\nreduction_ratios = { main = 4.0 }\n'
    (path, *_), _ = record(config_of(tmp_path, SINGLE_SCREW, section, "main_rpm"), tmp_path / "out")
    assert read_recording(path).series["main_rpm"].value.tolist() == [100.0, 101.0, 102.0]


@pytest.mark.shared
def test_a_tanker_models_zigzag_goes_through_sentences(tmp_path: Path, shared_data: Path) -> None:
    """Esso Osaka's propeller and rudder as they were measured, through RPM and RSA and back."""
    measured = sorted((shared_data / "esso_osaka" / "zigzag").glob("*.csv*"))[0]
    import_table(measured, tmp_path / "measured.mcap", ROOT / "trials" / "columns" / "esso_osaka.toml")
    sent = read_recording(tmp_path / "measured.mcap")
    ship = parse_actuators(sent.trial.actuators)
    config = config_of(tmp_path, ship, 'type = "file"\npath = "pond.log"\n', *trial_channel_names(ship))
    emulate(tmp_path / "measured.mcap", config, speed=1e4)
    (path, *_), _ = record(config, tmp_path / "out")
    got = read_recording(path).series
    assert np.ptp(sent.series["rudder_angle_deg"].value) > 15.0
    for name in ("propeller_rpm", "rudder_angle_deg", "yaw_rate_dps", "surge_mps"):
        np.testing.assert_allclose(got[name].value, sent.series[name].value, atol=1e-3, err_msg=name)


def test_emulate_and_record_a_single_screw_ship(tmp_path: Path, command: Command) -> None:
    """From the command line: her voyage becomes sentences in a file, and the recording of these is her voyage."""
    table = write_ship_voyage(tmp_path / "voyage.mcap", SINGLE_SCREW)
    section = 'type = "file"\npath = "bridge.log"\n'
    config_of(tmp_path, SINGLE_SCREW, section, *table.columns)
    assert command("emulate", tmp_path / "voyage.mcap", tmp_path / "ship.toml", "--speed", "200").code == 0
    path = Path(command("record", tmp_path / "ship.toml", "-o", tmp_path / "out").out.strip())
    told = command("info", path, "--json").json
    assert told["trial"]["actuators"] == "main:controllable_propeller, rudder:rudder, bow:tunnel"
    assert {name: each["count"] for name, each in told["channels"].items() if name in table} == {
        name: len(table) for name in table.columns
    }
    series = read_recording(path).series
    for name in trial_channel_names(SINGLE_SCREW)[len(MOTION) :]:
        assert np.abs(series[name].value - table[name].to_numpy()).max() < 1e-3, name


FIELD = st.sampled_from([*"SEAVRPDB", "", "0", "1", "2", "3", "-1", "1.5", "1e400", "nan"]) | st.floats(
    -400, 400
).map("{:.2f}".format)
SHIPS = st.sampled_from([TWIN_SCREW, SINGLE_SCREW, TRIPLE_SCREW, MIXED, JETS])


@given(SHIPS, st.sampled_from(["RSA", "ROR", "HTD", "RPM", "PRC", "TRD", "TRC"]), st.lists(FIELD, max_size=9))
def test_no_sentence_raises_or_tells_of_another_ship(ship: Actuators, kind: str, fields: list[str]) -> None:
    found, refused = said(ship, ",".join((f"ER{kind}", *fields)))
    assert found.keys() <= set(channel_names(ship))
    assert all(map(isfinite, found.values()))
    assert found or refused or kind in ("ROR", "HTD", "PRC")


@given(SHIPS, st.lists(st.tuples(st.sampled_from([127245, 127488, 127493]), st.binary(min_size=8, max_size=8))))
def test_no_group_raises_or_tells_of_another_ship(ship: Actuators, frames: list[tuple[int, bytes]]) -> None:
    found, _ = heard(ship, *frames)
    assert found.keys() <= set(channel_names(ship))
    assert all(map(isfinite, found.values()))
