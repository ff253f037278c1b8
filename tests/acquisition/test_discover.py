"""Discovery: the configuration that it writes records all that is there, and says why the rest is missing."""

from __future__ import annotations

import gzip
import json
import math
import sqlite3
import struct
import threading
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from seatrial.acquisition.config.sources import MqttSource
from seatrial.acquisition.config.trial_file import load_config, parse_config
from seatrial.acquisition.core.errors import SeatrialError, SourceError
from seatrial.acquisition.core.ship import MOTION, NAMES
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.discovery.discover import Discovery, discover, interpret_captures
from seatrial.acquisition.discovery.listen import (
    ListeningPlace,
    detect_gateway_format,
    find_baud_rate,
    interpret_frames,
    parse_places,
)
from seatrial.acquisition.emulator import NullModem, emulate
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.protocols.nmea0183 import frame_sentence, split_sentence
from tests.acquisition.can_frames import fast_parts, identifier_of
from tests.acquisition.conftest import DBC, SIGNALS, Broker, free_port, write_voyage
from tests.conftest import Command

VARIATION = "no variation: set magnetic_variation_deg or add a source of 127258"
CAPTURES = [
    "nmea0183/pypilot.log", "nmea0183/rst39.log", "nmea0183/saab-r4.log", "nmea2000/scx20.raw",
    "nmea2000/sleipner-slink-thruster.raw",
]  # fmt: skip
LONG_CAPTURES = [
    "nmea0183/bundg_zeus_9.log", "nmea2000/candumpSample1.txt",
    "nmea2000/furuno-130842-figure8-fast.raw", "nmea2000/furuno-fap7011c-autopilot-maneuvers.raw",
    "mavlink/ardusub_small.tlog",
]  # fmt: skip
GOLDEN = ("actisense-format", "dms-format", "mixed-format", "pcan-view", "pgn-test-actisense", "short-frame")
FIX = {"north_m", "east_m", "latitude_deg", "longitude_deg"}
COURSE = {"speed_over_ground_mps", "course_over_ground_deg"}
OF_GROUP = {
    127250: ("heading", {"heading_deg"}),
    127251: ("rate", {"yaw_rate_dps"}),
    127257: ("roll", {"roll_deg", "pitch_deg"}),
    127258: ("variation", {"magnetic_variation_deg"}),
    128259: ("speedWaterReferenced", {"speed_through_water_mps"}),
    129025: ("latitude", FIX),
    129026: ("sog", COURSE),
    130578: ("longitudinalSpeedGroundReferenced", {"surge_mps", "sway_mps"}),
}
"""By canboat's names, the field that tells whether a group says something, and the channels that it then makes."""
OF_SENTENCE = {
    "GGA": FIX, "HDT": {"heading_deg"}, "HDM": {"heading_magnetic_deg"}, "ROT": {"yaw_rate_dps"}, "VTG": COURSE,
    "VHW": {"speed_through_water_mps"}, "MWD": {"wind_direction_deg", "wind_speed_mps"},
}  # fmt: skip


def recorded(found: Discovery, folder: Path, duration_s: float | None = None) -> set[str]:
    """The channels that the configuration records, which was written for a recording that is made now."""
    (folder / "found.toml").write_text(found.configuration)
    _, health = record(load_config(folder / "found.toml"), folder / "recording", duration_s)
    return {name for name, channel in health.channels.items() if channel.count}


def channels_by_another_reader(path: Path) -> set[str]:
    """The channels that must be there: by canboat's decoding beside a capture, by the sentences in a log."""
    decoded = path.with_name(path.name + ".si.jsonl.gz")
    if decoded.exists():
        with gzip.open(decoded, "rt") as lines:
            messages = [json.loads(line) for line in lines]
        known = [
            (OF_GROUP[each["pgn"]], each["fields"])
            for each in messages
            if each.get("pgn") in OF_GROUP and "fields" in each
        ]
        return {name for (field, names), fields in known if fields.get(field) is not None for name in names}
    parts = [split_sentence(line.strip()) for line in path.read_bytes().splitlines()]
    told = {each[0][-3:] for each in parts if each is not None and all(each[1][:1])}
    return {name for kind in told for name in OF_SENTENCE.get(kind, ())}


@pytest.mark.shared
@pytest.mark.parametrize(
    "name",
    [
        *CAPTURES,
        *(f"nmea2000/golden_pairs/{each}.in" for each in GOLDEN),
        *(pytest.param(each, marks=pytest.mark.slow) for each in LONG_CAPTURES),
    ],
)
def test_of_every_capture_all_channels_are_recorded_at_first_try(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    found = discover(parse_places([str(shared_data / name)]), folder=tmp_path)
    assert recorded(found, tmp_path) == set(found.channels)
    if "golden" not in name and not name.endswith(".tlog"):
        assert channels_by_another_reader(shared_data / name) <= set(found.channels)
    assert set(found.missing) == set(MOTION) - set(found.channels)
    assert all(found.missing.values())
    if name in CAPTURES[-2:]:
        named = discover(parse_places([str(shared_data / name)]), vessel="gunnerus_short", folder=tmp_path)
        assert set(named.missing) == set(NAMES) - set(named.channels)
        assert all(named.missing.values())


BUSES = """
[trial]
name = "emulated"
origin = {{ latitude_deg = 63.44, longitude_deg = 10.4 }}
[[source]]
name = "backbone"
type = "can"
interface = "virtual"
channel = "discovered"
clock = "source"
channels = ["north_m", "east_m", "surge_mps", "sway_mps", "port_rpm", "port_angle_deg", "starboard_rpm",
            "starboard_angle_deg"]
dbc = "{dbc}"
{signals}
[[source]]
name = "bridge"
type = "serial"
device = "{device}"
clock = "source"
channels = ["heading_deg", "yaw_rate_dps", "tunnel_rpm"]
[[source]]
name = "autopilot"
type = "mavlink"
port = {port}
channels = ["wind_direction_deg", "wind_speed_mps"]
"""


@pytest.mark.slow
def test_on_the_emulators_three_buses_all_13_channels_are_recorded_at_first_try(tmp_path: Path) -> None:
    write_voyage(tmp_path / "voyage.mcap", 90.0)
    port, signals = free_port(), "\n".join(row for row in SIGNALS.splitlines() if "tunnel" not in row)
    with NullModem() as cable:
        text = BUSES.format(dbc=DBC, signals=signals, device=cable.emulator_device, port=port)
        buses = parse_config(text, tmp_path / "buses.toml")

        def play() -> None:
            with suppress(SourceError):  # nobody reads any more when the recorder has ended
                emulate(tmp_path / "voyage.mcap", buses, 5.0)

        player = threading.Thread(target=play)
        player.start()
        places = parse_places(["can:virtual:discovered", cable.logger_device, f"udp:127.0.0.1:{port}"])
        found = discover(places, 5.0, folder=tmp_path)
        assert found.missing == {}
        assert recorded(found, tmp_path, 4.0) >= set(NAMES)
        player.join()


MQTT = [
    ("ship/NMEA/gyro", lambda at: f"2026-05-17T12:00:{at:02d}Z {frame_sentence('HEHDT,12.3,T').decode()}"),
    (
        "ship/NMEA/gps",
        lambda at: f"2026-05-17T12:00:{at:02d}Z {frame_sentence('GPVTG,30.0,T,,M,5.6,N,10.4,K,A').decode()}",
    ),
    ("ship/mru/Heading", lambda at: f"12.5,2026-05-17T12:00:{at:02d}Z"),
]
"""Topics, and what is published on them each second."""


def test_a_log_of_mqtt_messages_is_recorded_and_topics_of_values_are_named(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "log.db")) as log, log:
        log.execute("CREATE TABLE LOG (ID INTEGER, RUN_ID INTEGER, UNIX_TIME REAL, TOPIC TEXT, MESSAGE BLOB)")
        for at in range(10):
            for topic, text in MQTT:
                log.execute("INSERT INTO LOG VALUES (?, 1, ?, ?, ?)", (at, 1_779_019_200.1 + at, topic, text(at)))
    found = discover(parse_places([str(tmp_path / "log.db")]), folder=tmp_path)
    assert recorded(found, tmp_path) == set(found.channels)
    assert {"heading_deg", "surge_mps", "sway_mps"} <= set(found.channels)
    assert '# channel = { topic = "ship/mru/Heading", unit = "" }' in found.configuration


@pytest.mark.parametrize(
    ("topic", "topics"), [("ship/", ["ship/"]), ("ship/ ", ["#"]), ("a\x1b[2J", ["#"]), ("", ["#"])]
)
def test_an_odd_topic_of_sentences_is_recorded(topic: str, topics: list[str], tmp_path: Path) -> None:
    """One that ends in a slash, or that a file cannot say."""
    line = frame_sentence("HEHDT,12.5,T").strip()
    frames = [Frame("broker", "mqtt", topic.encode() + b"\0" + line, at, at) for at in range(10**18, 10**18 + 10)]
    found = interpret_captures([interpret_frames(ListeningPlace("broker", "mqtt"), frames)], folder=tmp_path)
    assert list(found.channels) == ["heading_deg"]
    (section,) = parse_config(found.configuration, tmp_path / "found.toml").sources
    assert isinstance(section, MqttSource)
    assert list(section.topics) == topics


@pytest.mark.slow
def test_a_broker_is_listened_to_at_its_topics_of_sentences(tmp_path: Path, broker: Broker) -> None:
    ending = threading.Event()

    def publish() -> None:
        client = Client(CallbackAPIVersion.VERSION2)
        client.connect("127.0.0.1", broker.port)
        client.loop_start()
        number = 0
        while not ending.wait(0.1):
            number += 1
            for topic, text in MQTT:
                client.publish(topic, text(number % 60))
        client.disconnect()
        client.loop_stop()

    publisher = threading.Thread(target=publish)
    publisher.start()
    found = discover(parse_places([f"mqtt:127.0.0.1:{broker.port}"]), 3.0, folder=tmp_path)
    assert 'topics = ["ship/NMEA/gps", "ship/NMEA/gyro"]' in found.configuration
    assert recorded(found, tmp_path, 2.0) >= {"heading_deg", "surge_mps", "sway_mps"}
    ending.set()
    publisher.join()


Log = Callable[..., Discovery]


@pytest.fixture
def log(tmp_path: Path) -> Log:
    """What is discovered in a log of these sentences, ten seconds of each."""

    def discovered(*bodies: str, vessel: str = "") -> Discovery:
        lines = [
            f"2026-05-17T12:00:{second:02d}Z ".encode() + frame_sentence(body)
            for second in range(10)
            for body in bodies
        ]
        (tmp_path / "log.txt").write_bytes(b"".join(lines))
        return discover(parse_places([str(tmp_path / "log.txt")]), vessel=vessel, folder=tmp_path)

    return discovered


@pytest.mark.parametrize(
    ("bodies", "channel", "reason"),
    [
        (["HCHDM,100.0,M"], "heading_deg", f"HDM comes, but {VARIATION}"),
        (["GPVTG,230.5,T,229.1,M,5.6,N,10.4,K,A", "HCHDM,100.0,M"], "surge_mps",
         f"VTG comes, but no heading: HDM comes, but {VARIATION}"),
        (["WIMWV,57.5,R,13.0,N,A", "HEHDT,12.3,T"], "wind_speed_mps", "MWV comes, but no speed over ground: "),
        (["RCTRD,2,60.0,P,,V,90.8"], "port_rpm", "TRD 2 in percent: give rated_rpm"),
        (["RCTRD,7,60.0,R,,V,90.8"], "port_rpm", "TRD 7 of a number that no thruster has"),
        (["ERRPM,E,1,900.0,,A"], "starboard_rpm", "RPM tells the engine's speed: give reduction_ratios"),
        (["TIROT,-30.0,V"], "yaw_rate_dps", "ROT comes, but is marked as not valid: see to the sensor"),
        (["GPGGA,120000.00,,,,,0,,,,M,,M,,"], "north_m", "GGA comes, but is marked as not valid"),
        (["HEHDT,,T"], "heading_deg", "HDT comes, but its fields are empty: see to the sensor"),
        (["HEHDT,12.3,T"], "north_m", "nothing that comes carries it: GGA, GNS, RMC, GLL, 129025 or 129029 would"),
    ],
)  # fmt: skip
def test_each_missing_channel_has_one_reason(log: Log, bodies: list[str], channel: str, reason: str) -> None:
    found = log(*bodies, vessel="gunnerus_short")
    assert found.missing[channel].startswith(reason)
    assert found.missing[channel] in " ".join(found.configuration.replace("\n#   ", " ").split())


def test_a_thrusters_sentence_is_no_reason_of_anothers(log: Log) -> None:
    found = log("RCTRD,2,60.0,P,,V,90.8", vessel="gunnerus_short")
    assert "TRD 2" not in found.missing["starboard_rpm"]
    assert found.channels["port_angle_deg"] == ["log/RC:TRD"]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("rudder_angle_deg", "RSA comes, but is marked as not valid"),
        ("speed_through_water_mps", "VHW, VBW, "),
    ],
)
def test_a_listed_channel_that_no_ship_needs_is_missed_too(
    name: str, reason: str, tmp_path: Path, command: Command
) -> None:
    """The ship is not known, or a quantity is no channel of a trial: what is listed was expected."""
    (tmp_path / "log.txt").write_bytes(b"".join(10 * [frame_sentence("ERRSA,5.0,V,,V")]))
    text = (
        f'[trial]\nname = "x"\n[[source]]\nname = "log"\ntype = "file"\npath = "log.txt"\nchannels = ["{name}"]\n'
    )
    (tmp_path / "x.toml").write_text(text)
    done = command("record", tmp_path / "x.toml", "-o", tmp_path / "out")
    assert f"nothing came of {name}: " in done.err
    assert reason in done.err


def test_check_record_and_info_give_the_same_reasons(tmp_path: Path, command: Command) -> None:
    (tmp_path / "log.txt").write_bytes(
        b"".join(100 * [frame_sentence("HCHDM,100.0,M"), frame_sentence("RCTRD,2,60.0,P,,V,90.8")])
    )
    listed = 'channels = ["heading_deg", "heading_magnetic_deg", "port_rpm"]\n'
    text = f'[trial]\nname = "x"\n[[source]]\nname = "log"\ntype = "file"\npath = "log.txt"\n{listed}'
    (tmp_path / "x.toml").write_text(text)
    checked = command("record", tmp_path / "x.toml", "--check", "--duration", "0.5", "--json")
    problems = {each["name"]: each["problem"] for each in checked.json["channels"]}
    done = command("record", tmp_path / "x.toml", "-o", tmp_path / "out")
    shown = " ".join(command("info", done.out.strip()).out.split())
    for name, reason in (
        ("heading_deg", f"HDM comes, but {VARIATION}"),
        ("port_rpm", "TRD 2 in percent: give rated_rpm"),
    ):
        assert problems[name] == reason
        assert f"nothing came of {name}: {reason}" in done.err
        assert f"missing: {name}: {reason}" in shown


def test_the_numbers_that_are_asked_for_need_only_be_filled_in(tmp_path: Path, log: Log) -> None:
    found = log("HCHDM,100.0,M", "RCTRD,2,60.0,P,,V,90.8")
    filled = found.configuration.replace("# magnetic_variation_deg = 0.0", "magnetic_variation_deg = 2.0")
    filled = filled.replace("# rated_rpm = { port = 0 }", "rated_rpm = { port = 200 }")
    (tmp_path / "filled.toml").write_text(filled)
    _, health = record(load_config(tmp_path / "filled.toml"), tmp_path / "recording")
    assert health.channels["heading_deg"].value == pytest.approx(102.0)
    assert health.channels["port_rpm"].value == pytest.approx(120.0)


@pytest.mark.parametrize("rate", [4_800, 38_400, 115_200])
def test_the_baud_rate_is_that_at_which_sentences_are_sound(rate: int) -> None:
    garbled = bytes(range(128, 256)) * 2

    def read_at(tried: int) -> bytes:
        return frame_sentence("HEHDT,12.3,T") if tried == rate else garbled

    assert find_baud_rate(read_at) == rate
    with pytest.raises(SourceError, match="no sense at 4800"):
        find_baud_rate(lambda tried: garbled)
    assert find_baud_rate(lambda tried: b"") == 4_800


def chunks(*payloads: bytes) -> list[Frame]:
    return [Frame("line", "mavlink", each, number, number) for number, each in enumerate(payloads)]


def test_what_a_line_carries_shows_in_its_bytes() -> None:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None, srcSystem=7)
    packets = [bytes(link.attitude_encode(0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(link)) for _ in range(5)]
    place = ListeningPlace("line", "tcp", {"address": "10.0.0.1", "port": 4001})
    autopilot = interpret_frames(place, chunks(*packets))
    assert (autopilot.place.type, autopilot.place.settings["system_id"], autopilot.count) == ("mavlink_tcp", 7, 5)
    cut = b"".join(20 * [frame_sentence("HEHDT,12.3,T")])
    line = interpret_frames(place, chunks(cut[:31], cut[31:]))
    assert (line.place.type, line.count) == ("tcp", 20)
    gateway = interpret_frames(place, chunks(b"17:33:21.107 R 09F11223 01 2F 30 70 00 2F 30 FC\r\n"))
    assert gateway.place.settings["form"] == "yacht_devices"
    assert [each.protocol for each in gateway.frames()] == ["can"]
    assert "nothing known" in interpret_frames(place, chunks(b"\x00\x01\x02")).problem
    assert interpret_frames(place, []).problem == "nothing comes"


def test_the_form_of_a_gateway_shows_in_its_lines() -> None:
    late = 500 * frame_sentence("HEHDT,12.3,T") + b"A173321.107 23FF7 1F513 012F3070002F30709F\n"
    assert detect_gateway_format(late) == "n2k_ascii"
    assert detect_gateway_format(b"A173321.107 23FF7 1F513 012F3070002F30709F\n") == "n2k_ascii"
    assert detect_gateway_format(frame_sentence("HEHDT,12.3,T")) == ""


def test_devices_are_told_by_what_they_claim_and_those_that_compete_are_named(tmp_path: Path) -> None:
    heading = struct.pack("<BHhhB", 1, round(math.radians(30.0) * 1e4), 0x7FFF, 0x7FFF, 0xFC)
    name = (0xC0788C00E7E04312).to_bytes(8, "little")
    rows = []
    for tenth in range(50):
        for address, group, data in ((36, 127250, heading), (7, 127250, heading), (7, 60928, name)):
            rows.append(f"({1_779_019_200 + tenth / 10:.6f}) can0 {identifier_of(group, address):08X}#{data.hex()}")
    (tmp_path / "bus.log").write_text("\n".join(rows))
    found = discover(parse_places([str(tmp_path / "bus.log")]), folder=tmp_path)
    (device,) = found.as_json()["devices"]
    assert (device["address"], device["iso_name"], device["manufacturer"]) == (7, "c0788c00e7e04312", "Furuno")
    assert 'iso_name = "c0788c00e7e04312" }, { name = "device_36", address = 36 }]' in found.configuration
    ordered = found.configuration.replace("# devices = ", "devices = ")
    assert len(parse_config(ordered, tmp_path / "x.toml").sources[0].devices) == 2  # type: ignore[union-attr]
    rates = {each["device"]: each["rate_hz"] for each in found.as_json()["messages"] if each["message"] == "127250"}
    assert rates == pytest.approx({"7": 10.0, "36": 10.0}, rel=0.01)


@pytest.mark.parametrize("group", [129029, 126208, 130823, 130990])
def test_a_message_in_several_frames_counts_once(tmp_path: Path, group: int) -> None:
    """Whether canboat's database knows it or its number alone says that it comes so."""
    rows = [
        f"({1_779_019_200 + second:.6f}) can0 {identifier_of(group, 7):08X}#{part.hex()}"
        for second in range(12)
        for part in fast_parts(bytes(range(20)), second % 8)
    ]
    (tmp_path / "bus.log").write_text("\n".join(rows))
    found = discover(parse_places([str(tmp_path / "bus.log")]), folder=tmp_path).as_json()["messages"]
    assert [(each["message"], each["count"]) for each in found] == [(str(group), 12)]


def test_packs_are_taken_in_whose_channels_come_and_engines_are_counted(tmp_path: Path, log: Log) -> None:
    found = log("SDDPT,12.5,0.3", "HEHDT,12.3,T")
    assert found.channels["depth_below_transducer_m"] == ["log/SD:DPT"]
    assert '[[pack]]\nname = "survey"\n' in found.configuration
    assert "engine_room" not in found.configuration
    rows = [
        f"({1_779_019_200 + second:.6f}) can0 {identifier_of(127488, 7):08X}#{instance:02X}{900 * 4:04X}FFFFFFFFFF"
        for second in range(10)
        for instance in (0, 1)
    ]
    (tmp_path / "bus.log").write_text("\n".join(rows))
    found = discover(parse_places([str(tmp_path / "bus.log")]), folder=tmp_path)
    assert recorded(found, tmp_path) == {"port_engine_rpm", "starboard_engine_rpm"}
    assert "port_rpm" not in found.missing
    assert found.as_json()["places"][0]["remarks"] == ["127488 tells the engine's speed: give reduction_ratios"]


@pytest.mark.parametrize(
    ("bodies", "remarks"),
    [
        ([], []),
        (["RCTRD,2,60.0,P,,V,90.8"], ["TRD 2 in percent: give rated_rpm"]),
        (["RCTRD,7,60.0,R,,V,90.8"], ["TRD 7 of a number that no thruster has: say in `thrusters` whose it is"]),
        (["ERRPM,E,1,900.0,,A"], ["RPM tells the engine's speed: give reduction_ratios"]),
        (["ERRPM,S,0,120.0,,A"], ["RPM of a shaft that the ship has not: list its own as [[actuator]]"]),
        (["ERRSA,-5.0,A,,V"], []),
    ],
)
def test_of_a_ship_without_a_name_no_control_is_missing_and_what_comes_is_said(
    log: Log, bodies: list[str], remarks: list[str]
) -> None:
    found = log("HEHDT,12.3,T", *bodies)
    assert set(found.missing) == set(MOTION) - {"heading_deg"}
    assert found.as_json()["places"][0].get("remarks", []) == remarks
    text = " ".join(found.configuration.replace("\n# ", " ").split())
    assert all(remark in text for remark in remarks)
    assert not {"tunnel_rpm", "starboard_angle_deg"} & set(text.split("[[source]]")[0].replace(",", " ").split())


@pytest.mark.parametrize(
    ("text", "kind", "settings"),
    [
        ("can0", "can", {"interface": "socketcan", "channel": "can0"}),
        ("can:udp_multicast:239.74.163.2?port=43113&hop_limit=0", "can",
         {"interface": "udp_multicast", "channel": "239.74.163.2", "options": {"port": 43113, "hop_limit": 0}}),
        ("/dev/ttyUSB0@38400", "serial", {"device": "/dev/ttyUSB0", "baud_rate": 38400}),
        ("udp:10110", "udp", {"address": "0.0.0.0", "port": 10110}),
        ("udp:239.192.0.1:60001", "udp", {"address": "239.192.0.1", "port": 60001}),
        ("mqtt:10.0.0.7", "mqtt", {"address": "10.0.0.7", "port": 1883, "topics": ["#"]}),
        ("tcp:10.0.0.7:2000", "tcp", {"address": "10.0.0.7", "port": 2000}),
    ],
)  # fmt: skip
def test_places_are_named_as_people_say_them(text: str, kind: str, settings: dict[str, object]) -> None:
    (place,) = parse_places([text])
    assert (place.type, place.settings, place.text) == (kind, settings, text)


@pytest.mark.parametrize("text", ["nowhere.log", "tcp:10110", "udp:x", "udp:70000", "/dev/ttyUSB0@fast"])
def test_what_is_no_place_is_one_clear_error(text: str) -> None:
    with pytest.raises(SeatrialError, match=r"not an input|no address|not a port|not a baud rate"):
        parse_places([text])


def test_places_of_a_configuration_are_its_sources(tmp_path: Path) -> None:
    text = BUSES.format(dbc="thrusters.dbc", signals="", device="/dev/gyro", port=14551)
    (tmp_path / "buses.toml").write_text(text)
    places = parse_places([str(tmp_path / "buses.toml"), "udp:14551"])
    assert [(each.name, each.type) for each in places] == [
        ("backbone", "can"), ("bridge", "serial"), ("autopilot", "udp"), ("udp_14551", "udp"),
    ]  # fmt: skip
    assert places[0].settings["dbc"] == str(tmp_path / "thrusters.dbc")


def test_the_command_writes_what_records_and_says_where_it_listened_in_vain(
    tmp_path: Path, command: Command
) -> None:
    (tmp_path / "log.txt").write_bytes(b"".join(50 * [frame_sentence("HEHDT,12.3,T")]))
    done = command("discover", tmp_path / "log.txt", "-o", tmp_path / "found.toml", "--json")
    assert done.code == 0
    assert done.json["configuration"] == (tmp_path / "found.toml").read_text()
    assert list(done.json["channels"]) == ["heading_deg"]
    again = command("discover", tmp_path / "log.txt", "-o", tmp_path / "found.toml")
    assert (again.code, again.err.count("\n")) == (1, 1)
    assert "already exists" in again.err
    port = free_port()
    silent = command("discover", f"udp:127.0.0.1:{port}", "--duration", "0.2")
    assert silent.code == 1
    assert f"udp:127.0.0.1:{port}: nothing comes" in silent.err
    assert "--duration" in silent.err


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["udp:10110"], "is a log, but other places are live"),
        (["--vessel", "nosuch"], "no vessel 'nosuch'"),
        (["--dbc", "log.txt"], "is not a readable DBC file"),
    ],
)
def test_what_is_asked_for_in_vain_is_one_clear_error(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch, options: list[str], why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.txt").write_bytes(b"".join(20 * [frame_sentence("HEHDT,12.3,T")]))
    done = command("discover", "log.txt", *options)
    assert (done.code, done.out, done.err.count("\n")) == (1, "", 1)
    assert why in done.err


def test_another_ship_has_other_channels(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_bytes(
        b"".join(20 * [frame_sentence("ERRSA,-5.0,A,,V"), frame_sentence("ERRPM,S,0,120.0,,A")])
    )
    found = discover(parse_places([str(tmp_path / "log.txt")]), vessel="kvlcc2_7m", folder=tmp_path)
    assert recorded(found, tmp_path) == {"propeller_rpm", "rudder_angle_deg"}


def test_what_a_stranger_sends_does_not_reach_the_configuration(tmp_path: Path) -> None:
    """A log's name and a device's words may hold anything; the configuration stays one."""
    path = tmp_path / 'odd "name"\x1b[31m.txt'
    path.write_bytes(b"".join(20 * [frame_sentence("HEHDT,12.3,T")]))
    found = discover(parse_places([str(path)]), folder=tmp_path)
    assert recorded(found, tmp_path) == {"heading_deg"}
    assert "\x1b" not in found.configuration
