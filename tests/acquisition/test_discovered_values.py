"""Discovery of values that no protocol names: signals of a DBC file, topics of MQTT, and lines anywhere."""

from __future__ import annotations

import json
import math
import os
import sqlite3
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import can
import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion
from serial.tools.list_ports_common import ListPortInfo

from seatrial.acquisition.config.sources import CanFrames, MqttSource
from seatrial.acquisition.config.trial_file import load_config, parse_config
from seatrial.acquisition.core.errors import InputError, SourceError, system_reason
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.discovery.discover import Discovery, discover
from seatrial.acquisition.discovery.listen import latest_topic_readings, parse_places, usual_places
from seatrial.acquisition.emulator import NullModem
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from tests.acquisition.conftest import Broker
from tests.conftest import Command

YARD = """VERSION ""
BU_: ECU
BO_ 256 MainEngine: 8 ECU
 SG_ ShaftSpeed : 0|16@1+ (0.1,0) [0|300] "RPM" ECU
 SG_ Mode : 16|8@1+ (1,0) [0|3] "" ECU
 SG_ OilTemperature : 24|16@1- (0.1,0) [0|0] "{degree}C" ECU
BO_ 257 Steering: 4 ECU
 SG_ RudderAngle : 0|16@1- (0.01,0) [-45|45] "{degree}" ECU
 SG_ RudderOrder : 16|16@1- (0.01,0) [-45|45] "{degree}" ECU
BO_ 258 Spare: 8 ECU
 SG_ Unused : 0|16@1- (1,0) [0|0] "" ECU
VAL_ 256 Mode 0 "Off" 1 "Auto" 2 "Not available" ;
""".format(degree="\N{DEGREE SIGN}")
SENT = {
    "MainEngine": {"ShaftSpeed": 123.4, "Mode": 1, "OilTemperature": 65.3},
    "Steering": {"RudderAngle": -12.5, "RudderOrder": -13.0},
}
"""What is on the bus, by message and signal."""
MULTIPLEXED = """VERSION ""
BU_: ECU
BO_ 768 Status: 8 ECU
 SG_ Page M : 0|8@1+ (1,0) [0|3] "" ECU
 SG_ Torque m0 : 8|16@1+ (0.1,0) [0|0] "kNm" ECU
 SG_ Pitch m1 : 8|16@1- (0.1,0) [0|0] "%" ECU
"""
J1939 = """VERSION ""
BU_: ECU
BO_ 2565865470 Winch: 8 ECU
 SG_ Tension : 0|16@1+ (0.1,0) [0|0] "kN" ECU
 SG_ Load : 16|16@1+ (0.1,0) [0|0] "%" ECU
"""
"""Group 0xF000 + 0x..FE, written with the address FE that stands for any sender."""


def bus_log(path: Path, *messages: tuple[cantools.database.Message, dict[str, Any], int | None]) -> Path:
    """Ten seconds of messages at 10 Hz as candump writes them; the identifier may be another than the file's."""
    rows = []
    for tenth in range(100):
        for message, values, identifier in messages:
            number = message.frame_id if identifier is None else identifier
            data = message.encode(values, padding=True).hex().upper()
            digits = 8 if message.is_extended_frame else 3
            rows.append(f"({1_779_019_200 + tenth / 10:.6f}) can0 {number:0{digits}X}#{data}")
    path.write_text("\n".join(rows) + "\n")
    return path


def yard_bus(folder: Path) -> Path:
    database = cantools.database.load_string(YARD, "dbc")
    full = {name: {each.name: 0 for each in database.get_message_by_name(name).signals} | sent
            for name, sent in SENT.items()}  # fmt: skip
    folder.mkdir(exist_ok=True)
    return bus_log(folder / "bus.log", *((database.get_message_by_name(name), full[name], None) for name in SENT))


def values_of(found: Discovery) -> dict[tuple[str, str], Any]:
    """The values listed, by message and signal."""
    return {(each["message"], each["signal"]): each["value"] for each in found.as_json()["values"]}


EXPECTED = {(message, signal): value for message, signals in SENT.items() for signal, value in signals.items()}


@pytest.mark.parametrize("place", ["configuration", "log", "trial file", "option", "utf-8", "windows"])
def test_signals_of_a_dbc_file_are_listed_with_their_values_wherever_it_stands(tmp_path: Path, place: str) -> None:
    log, output = yard_bus(tmp_path / "logs"), tmp_path / "here"
    output.mkdir()
    folder = {"log": tmp_path / "logs", "option": tmp_path, "trial file": tmp_path / "trial"}.get(place, output)
    folder.mkdir(exist_ok=True)
    (folder / "yard.dbc").write_bytes(YARD.encode("utf-8-sig" if place == "utf-8" else "cp1252"))
    inputs = [str(log)]
    if place == "trial file":
        text = f'[trial]\nname = "x"\n[[source]]\nname = "bus"\ntype = "file"\npath = "{log}"\nchannels = []\n'
        (folder / "trial.toml").write_text(text)
        inputs = [str(folder / "trial.toml")]
    dbc = folder / "yard.dbc" if place == "option" else None
    found = discover(parse_places(inputs), dbc=dbc, folder=output)
    assert values_of(found) == pytest.approx(EXPECTED)
    assert found.as_json()["places"][0]["remarks"] == ["yard.dbc: 2 of its 3 messages come"]
    (output / "found.toml").write_text(found.configuration)
    _, health = record(load_config(output / "found.toml"), output / "recording")
    assert health.channels["rudder_angle_deg"].value == pytest.approx(-12.5)


def filled_in(found: Discovery, channels: dict[str, str], vessel: str) -> str:
    """The configuration with channels before signals or topics, as its comments say."""
    text = found.configuration.replace('# vessel = "NAME"   #', f'vessel = "{vessel}"   #')
    rows = []
    for row in text.splitlines():
        for name, mark in channels.items():
            if row.startswith("# channel = ") and f'"{mark}"' in row:
                row = row.replace("# channel", name, 1)
        rows.append(row)
    listed = ", ".join(f'"{name}"' for name in channels)
    return "\n".join(rows).replace("channels = [", f"channels = [{listed}, ", 1)


def test_the_template_of_signals_is_filled_in_and_records(tmp_path: Path) -> None:
    log = yard_bus(tmp_path)
    (tmp_path / "yard.dbc").write_text(YARD, encoding="utf-8")
    ship = '[[actuator]]\nname = "main"\nkind = "propeller"\n[[actuator]]\nname = "rudder"\nkind = "rudder"\n'
    (tmp_path / "own.toml").write_text(f'name = "own"\n[dimensions]\n{ship}')
    found = discover(parse_places([str(log)]), folder=tmp_path)
    (tmp_path / "found.toml").write_text(filled_in(found, {"main_rpm": "ShaftSpeed"}, "own"))
    _, health = record(load_config(tmp_path / "found.toml"), tmp_path / "recording")
    assert health.channels["main_rpm"].value == pytest.approx(123.4)
    assert health.channels["rudder_angle_deg"].value == pytest.approx(-12.5)


def test_multiplexed_signals_are_all_listed(tmp_path: Path) -> None:
    database = cantools.database.load_string(MULTIPLEXED, "dbc")
    (message,) = database.messages
    pages = [(message, {"Page": 0, "Torque": 12.3}, None), (message, {"Page": 1, "Pitch": -45.6}, None)]
    (tmp_path / "status.dbc").write_text(MULTIPLEXED)
    found = discover(parse_places([str(bus_log(tmp_path / "bus.log", *pages))]), folder=tmp_path)
    told = values_of(found)
    assert (told["Status", "Torque"], told["Status", "Pitch"]) == pytest.approx((12.3, -45.6))


def test_a_29_bit_message_is_known_by_its_group_from_any_address(tmp_path: Path) -> None:
    database = cantools.database.load_string(J1939, "dbc")
    (message,) = database.messages
    (tmp_path / "winch.dbc").write_text(J1939)
    other = message.frame_id & ~0xFF | 0x21
    log = bus_log(tmp_path / "bus.log", (message, {"Tension": 250.0, "Load": 6553.5}, other))
    found = discover(parse_places([str(log)]), folder=tmp_path)
    assert values_of(found) == {("Winch", "Tension"): 250.0, ("Winch", "Load"): None}
    assert [each.get("note") for each in found.as_json()["values"]] == [None, "not available"]


def test_a_state_is_named_and_one_that_is_not_available_has_no_value(tmp_path: Path) -> None:
    database = cantools.database.load_string(YARD, "dbc")
    engine = database.get_message_by_name("MainEngine")
    (tmp_path / "yard.dbc").write_text(YARD, encoding="utf-8")
    for mode, value, note in ((1, 1.0, "Auto"), (2, None, "not available")):
        values = SENT["MainEngine"] | {"Mode": mode}
        steering = database.get_message_by_name("Steering"), SENT["Steering"], None
        log = bus_log(tmp_path / "bus.log", (engine, values, None), steering)
        found = discover(parse_places([str(log)]), folder=tmp_path)
        (state,) = [each for each in found.as_json()["values"] if each["signal"] == "Mode"]
        assert (state["value"], state["note"]) == (value, note)


@pytest.mark.parametrize(
    ("files", "remark", "is_taken"),
    [
        ({"yard.dbc": YARD}, "yard.dbc: 2 of its 3 messages come", True),
        ({"other.dbc": YARD.replace("256", "512").replace("257", "513")}, "", False),
        ({"one.dbc": YARD.replace("257", "513")}, "1 of its 3 messages comes; if one is of this bus", False),
        ({"a.dbc": YARD, "b.dbc": YARD}, "they fit alike: name one with --dbc", False),
        ({"a.dbc": YARD, "less.dbc": YARD.replace("257", "513")}, "a.dbc: 2 of its 3 messages come", True),
        ({"junk.dbc": "hello"}, "junk.dbc is not a readable DBC file: line 1, column 1 is not of a DBC", False),
        ({"junk.dbc": "", "yard.dbc": YARD}, "yard.dbc: 2 of its 3 messages come", True),
    ],
)
def test_a_dbc_file_is_taken_where_it_fits_and_else_is_said_why_not(
    tmp_path: Path, files: dict[str, str], remark: str, is_taken: bool
) -> None:
    log = yard_bus(tmp_path)
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    found = discover(parse_places([str(log)]), folder=tmp_path)
    assert bool(found.readings) == is_taken
    assert remark in "; ".join(found.as_json()["places"][0].get("remarks", []))
    (source,) = parse_config(found.configuration, tmp_path / "found.toml").sources
    assert isinstance(source, CanFrames)
    assert (source.dbc is not None) == is_taken


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("hello", "line 1, column 1 is not of a DBC file"),
        ("", "line 1, column 1 is not of a DBC file"),
        (YARD.replace("VAL_ 256", "VAL_ ???"), "line 12"),
        (YARD.replace("24|16", "8|16"), "The signals OilTemperature and ShaftSpeed are overlapping in message"),
        (YARD.replace("24|16", "60|16"), "The signal OilTemperature does not fit in message MainEngine"),
        (None, "No such file or directory"),
    ],
)
def test_a_given_dbc_file_at_fault_is_one_line_in_plain_words(
    tmp_path: Path, command: Command, text: str | None, why: str
) -> None:
    if text is not None:
        (tmp_path / "given.dbc").write_text(text, encoding="utf-8")
    done = command("discover", yard_bus(tmp_path), "--dbc", tmp_path / "given.dbc")
    assert (done.code, done.out, done.err.count("\n")) == (1, "", 1)
    assert why in done.err
    assert not any(word in done.err for word in (">>!<<", "Invalid syntax", "Error", "Traceback"))


def test_of_a_given_dbc_file_nothing_of_which_comes_is_said(tmp_path: Path) -> None:
    log = yard_bus(tmp_path / "logs")
    (tmp_path / "given.dbc").write_text(MULTIPLEXED)
    found = discover(parse_places([str(log)]), dbc=tmp_path / "given.dbc", folder=tmp_path)
    assert "given.dbc: none of its 1 messages comes" in found.as_json()["places"][0]["remarks"]
    assert "dbc =" not in found.configuration


@contextmanager
def repeating(send: Callable[[], None]) -> Iterator[None]:
    """Something that is sent ten times a second while the block runs."""
    ending = threading.Event()

    def run() -> None:
        while not ending.wait(0.1):
            send()

    sender = threading.Thread(target=run)
    sender.start()
    try:
        yield
    finally:
        ending.set()
        sender.join()


def test_signals_of_a_live_bus_are_listed_and_recorded(tmp_path: Path) -> None:
    (tmp_path / "yard.dbc").write_text(YARD, encoding="utf-8")
    database = cantools.database.load_string(YARD, "dbc")
    frames = [
        can.Message(
            arbitration_id=(message := database.get_message_by_name(name)).frame_id,
            data=message.encode(values, padding=True),
            is_extended_id=False,
        )
        for name, values in SENT.items()
    ]
    with (
        can.Bus(interface="virtual", channel="values") as bus,
        repeating(lambda: [bus.send(frame) for frame in frames] and None),
    ):
        found = discover(parse_places(["can:virtual:values"]), 1.5, folder=tmp_path)
        assert values_of(found) == pytest.approx(EXPECTED)
        (tmp_path / "found.toml").write_text(found.configuration)
        _, health = record(load_config(tmp_path / "found.toml"), tmp_path / "recording", 1.5)
    assert health.channels["rudder_angle_deg"].value == pytest.approx(-12.5)


TOPICS: list[tuple[str, str, dict[str, Any]]] = [
    ("ship/mru/Heading", "12.5", {"": 12.5}),
    ("ship/wind/Speed", "7.25,2026-05-17T12:00:00Z,m/s", {"": 7.25}),
    ("ship/engine", '{"rpm": 123, "nav": {"rudder": -4.5}}', {"rpm": 123.0, "nav.rudder": -4.5}),
    ("ship/tank", '2026-05-17T12:00:00Z {"level": "81.5"}', {"level": 81.5}),
    ("ship/mode", "AUTO", {"": "AUTO"}),
    ("ship/broken", '{"rpm": ', {"": '{"rpm":'}),
    ("ship/infinite", "1e999", {"": "1e999"}),
    ("ship/empty", "", {"": ""}),
]  # fmt: skip
"""Topics, a message on each, and the values that it has by field."""


def fields_of(found: Discovery) -> dict[str, dict[str, Any]]:
    topics: dict[str, dict[str, Any]] = {}
    for each in found.as_json()["values"]:
        topics.setdefault(each["topic"], {})[each.get("field", "")] = each["value"]
    return topics


def test_topics_of_a_log_are_listed_with_their_latest_values(tmp_path: Path, command: Command) -> None:
    with closing(sqlite3.connect(tmp_path / "log.db")) as log, log:
        log.execute("CREATE TABLE LOG (ID INTEGER, RUN_ID INTEGER, UNIX_TIME REAL, TOPIC TEXT, MESSAGE BLOB)")
        rows = [(topic, "99.0") for topic, *_ in TOPICS] + [(topic, text) for topic, text, _ in TOPICS]
        rows += [("ship/NMEA/gyro", frame_sentence("HEHDT,12.3,T").decode())]
        for at, (topic, text) in enumerate(rows):
            log.execute("INSERT INTO LOG VALUES (?, 1, ?, ?, ?)", (at, 1_779_019_200 + at, topic, text))
    found = discover(parse_places([str(tmp_path / "log.db")]), folder=tmp_path)
    assert fields_of(found) == {topic: values for topic, _, values in TOPICS}
    assert '{ topic = "ship/wind/Speed", unit = "m/s" }   # 7.25 m/s' in found.configuration
    assert '{ topic = "ship/engine", field = "nav.rudder", unit = "" }   # -4.5' in found.configuration
    shown = command("discover", tmp_path / "log.db").out
    assert "nav.rudder" in shown
    assert "-4.5" in shown


@pytest.mark.slow
def test_topics_of_a_broker_are_listed_with_values_and_their_template_records(
    tmp_path: Path, broker: Broker
) -> None:
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", broker.port)
    client.loop_start()
    client.publish("ship/draught", "5.25", retain=True).wait_for_publish()
    with repeating(lambda: [client.publish(topic, text) for topic, text, _ in TOPICS if text] and None):
        found = discover(parse_places([f"mqtt:127.0.0.1:{broker.port}"]), 2.5, folder=tmp_path)
        told = fields_of(found)
        assert told.pop("ship/draught") == {"": 5.25}
        assert told == {topic: values for topic, text, values in TOPICS if text}
        (retained,) = [each for each in found.readings if each.note]
        assert retained.entry["topic"] == "ship/draught"
        text = filled_in(
            found, {"heading_deg": "ship/mru/Heading", "wind_speed_mps": "ship/wind/Speed"}, "kvlcc2_7m"
        )
        text = text.replace('topic = "ship/mru/Heading", unit = ""', 'topic = "ship/mru/Heading", unit = "deg"')
        (source,) = parse_config(text, tmp_path / "found.toml").sources
        assert isinstance(source, MqttSource)
        (tmp_path / "found.toml").write_text(text)
        _, health = record(load_config(tmp_path / "found.toml"), tmp_path / "recording", 2.0)
    client.disconnect()
    client.loop_stop()
    assert health.channels["heading_deg"].value == pytest.approx(12.5)
    assert health.channels["wind_speed_mps"].value == pytest.approx(7.25)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(
    topic=st.text(min_size=1, max_size=30),
    message=st.binary(max_size=60) | JSON.map(lambda each: json.dumps(each).encode()),
)
def test_whatever_a_topic_says_is_a_value_that_json_and_a_comment_can_hold(topic: str, message: bytes) -> None:
    payload = topic.replace("\0", "").encode("utf-8", "replace") + b"\0" + message
    frames = [Frame("broker", "mqtt", payload, 1, 1, flags=FrameFlag.RETAINED)]
    for reading in latest_topic_readings("broker", frames):
        assert isinstance(reading.value, float | str)
        assert isinstance(reading.value, str) or math.isfinite(reading.value)
        assert reading.text.isprintable() or not reading.text
        json.dumps(reading.as_json(), allow_nan=False)


LINES = {
    "pseudo-terminal": lambda device, folder: device,
    "link": lambda device, folder: linked(folder / "gyro", device),
    "link to a link": lambda device, folder: linked(folder / "second", linked(folder / "first", device)),
    "by identity": lambda device, folder: linked(
        folder / "serial/by-id/usb-FTDI_FT232R_A50285BI-if00-port0", device
    ),
    "blank and @": lambda device, folder: linked(folder / "my gyro@bridge", device),
    "with a rate": lambda device, folder: linked(folder / "gyro", device) + "@38400",
    "with a word": lambda device, folder: "serial:" + linked(folder / "gyro", device),
    "relative": lambda device, folder: Path(linked(folder / "gyro", device)).name,
}
"""Ways in which a user names a serial line."""


def linked(path: Path, target: str) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to(os.path.relpath(target, path.parent) if "by-id" in str(path) else target)
    return str(path)


def heading_on_line(way: str, folder: Path) -> float:
    """What is recorded of a serial line by the configuration that listening to it writes."""
    with NullModem() as cable:
        named = LINES[way](cable.logger_device, folder)
        out = os.open(cable.emulator_device, os.O_WRONLY | os.O_NOCTTY)
        try:
            with repeating(lambda: os.write(out, frame_sentence("HEHDT,12.3,T")) and None):
                found = discover(parse_places([named]), 2.5, folder=folder)
                assert list(found.channels) == ["heading_deg"]
                (section,) = tomllib.loads(found.configuration)["source"]
                assert Path(section["device"]).is_absolute()
                assert os.path.realpath(section["device"]) == os.path.realpath(cable.logger_device)
                assert section["baud_rate"] == (38_400 if way == "with a rate" else 4_800)
                (folder / "found.toml").write_text(found.configuration)
                _, health = record(load_config(folder / "found.toml"), folder / "recording", 3.0)
        finally:
            os.close(out)
    return float(health.channels["heading_deg"].value or 0.0)


def test_a_serial_line_is_listened_to_wherever_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every way to a line of its own, all at once."""
    folders = [tmp_path / way for way in LINES]
    for folder in folders:
        folder.mkdir()
    monkeypatch.chdir(tmp_path / "relative")
    with ThreadPoolExecutor(len(LINES)) as pool:
        assert list(pool.map(heading_on_line, LINES, folders)) == pytest.approx([12.3] * len(LINES))


def test_a_line_that_is_found_is_written_by_its_lasting_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with NullModem() as cable:
        link = linked(tmp_path / "by-id" / "usb-FTDI_FT232R_A50285BI-if00-port0", cable.logger_device)
        linked(tmp_path / "by-id" / "usb-other", "/dev/null")
        found = [ListPortInfo(device) for device in (cable.logger_device, cable.emulator_device)]
        for port in found:
            port.hwid = "USB"
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
        monkeypatch.setattr("seatrial.acquisition.discovery.listen._BY_IDENTITY", tmp_path / "by-id")
        lines = [place for place in usual_places() if place.type == "serial"]
    assert [line.settings["device"] for line in lines] == [link, cable.emulator_device]
    assert [line.text for line in lines] == [cable.logger_device, cable.emulator_device]


def test_what_came_before_a_line_broke_is_understood(tmp_path: Path) -> None:
    cable = NullModem().__enter__()
    place = parse_places([f"{cable.logger_device}@4800"])

    def end() -> None:
        out = os.open(cable.emulator_device, os.O_WRONLY | os.O_NOCTTY)
        for _ in range(20):
            os.write(out, frame_sentence("HEHDT,12.3,T"))
            time.sleep(0.02)
        os.close(out)
        time.sleep(0.3)
        cable.__exit__()

    ending = threading.Timer(0.5, end)
    ending.start()
    found = discover(place, 4.0, folder=tmp_path)
    ending.join()
    assert list(found.channels) == ["heading_deg"]
    assert any("serial line failed" in each for each in found.as_json()["places"][0]["remarks"])


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("dangling", "it is a link to .*nowhere, and nothing is there"),
        ("pipe", "it is a pipe or socket"),
        ("folder", "it is a folder"),
        ("missing", "is not an input; name"),
        ("null@fast", "'fast' is not a baud rate"),
        ("null@0", "'0' is not a baud rate"),
    ],
)
def test_what_is_no_line_is_refused_with_the_reason(tmp_path: Path, name: str, why: str) -> None:
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match=why):
        parse_places([str(tmp_path / name)])


def test_a_line_named_twice_is_refused(tmp_path: Path) -> None:
    with NullModem() as cable:
        link = linked(tmp_path / "gyro", cable.logger_device)
        with pytest.raises(InputError, match="are the same serial line; name it once"):
            parse_places([link, cable.logger_device])


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("can:telepathy:0", "knows no interface 'telepathy'"),
        ("can:pcan:PCAN_USBBUS1", "driver is not installed"),
        ("can:kvaser:0", "driver is not installed"),
        ("can:slcan:/dev/null", "it is no serial line"),
        ("/dev/null", "it is no serial line"),
        ("/dev/no_such_tty", "No such file or directory"),
        ("tcp:127.0.0.1:1", "Connection refused"),
        ("tcp:no.such.host.invalid:1", "no computer of this name is known"),
        ("mqtt:127.0.0.1:1", "Connection refused"),
    ],
)
def test_a_place_that_cannot_be_opened_is_told_in_plain_words(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, place: str, why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("discover", place, "--duration", "0.2")
    assert (done.code, done.out) == (1, "")
    assert why in done.err
    assert not any(
        word in done.err for word in ("Errno", "Error", "not defined", "Could not", "library", "Traceback")
    )


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ConnectionRefusedError(111, "x"), "Connection refused"),
        (OSError("Could not configure port: (25, 'x')"), ""),
        (TimeoutError("timed out"), ""),
        (ValueError("x"), ""),
        (SourceError("x"), ""),
    ],
)
def test_the_systems_reason_is_told_by_its_number(error: Exception, reason: str) -> None:
    assert system_reason(error) == reason
    outer = RuntimeError("a library's words")
    outer.__cause__ = error
    assert system_reason(outer) == reason
