"""Channels that a user declares: from any protocol into the recording, and through all that is done with one."""

from __future__ import annotations

import gzip
import json
import re
import struct
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pynmeagps
import pytest
from hypothesis import given, settings, strategies
from matplotlib.figure import Figure
from nmea2000 import backend
from pymavlink.dialects.v20 import ardupilotmega as dialect
from scipy.io import loadmat, netcdf_file

import seatrial as st
from seatrial.acquisition.config.trial_file import TrialConfig, load_config, parse_config
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.acquisition.core.quantities import name_ending_of_unit, unit_conversion
from seatrial.acquisition.core.ship import (
    actuators_of_table,
    channels_by_name_of,
    channels_of_trial,
    declare,
    declared_channels_as_json,
    parse_declared_channels,
)
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols import Moment, decoders_by_protocol, make_decoders, make_encoder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.protocols.nmea2000 import canboat_fields
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.sources.log_file import LogFile
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.check import check_recording
from seatrial.analysis.tables.export import export_table
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import read_table
from tests.acquisition.can_frames import FIELDS, can_frame, identifier_of
from tests.acquisition.conftest import DBC
from tests.conftest import Command, nightly

SECOND = 1_000_000_000
START_NS = 1_779_019_200 * SECOND
PACKS = """
[[pack]]
name = "survey"
[[pack]]
name = "engine_room"
each = ["port", "starboard"]
[[pack]]
name = "waterline"
"""
WINCH = """
[[channel]]
name = "winch_tension_n"
unit = "N"
range = [0, 200_000]
meaning = "Tension of the tow line"
from = [{ sentence = "PWNC", field = 2, unit = "kN", when = { 3 = "A" } }]
[[channel]]
name = "crane_slew_deg"
unit = "deg"
range = [0, 360]
from = [{ transducer = "SLEW" }]
[[channel]]
name = "winch_mode"
unit = "1"
range = [0, 9]
state = true
from = [{ sentence = "PWNC", field = 4 }]
"""


def config_of(source: str, channels: list[str], declared: str = PACKS, path: str = "trial.toml") -> TrialConfig:
    section = f'[[source]]\nname = "x"\nchannels = {json.dumps(channels)}\n{source}'
    return parse_config(f'[trial]\nname = "declared"\n{declared}\n{section}', path)


def decoded(config: TrialConfig, frames: list[Frame]) -> list[dict[str, float]]:
    """What the first decoder of the only source makes of each frame."""
    (source,) = config.sources
    decoder = make_decoders(source, config.actuators, config.declared)[0]
    return [
        {sample.quantity: sample.value for group in decoder.decode(frame) for sample in group} for frame in frames
    ]


def line(body: str | bytes, at_s: float = 0.0) -> Frame:
    text = frame_sentence(body).strip() if isinstance(body, str) else body
    return Frame("x", "nmea0183", text, round(at_s * SECOND), round(at_s * SECOND))


SERIAL = 'type = "serial"\ndevice = "/dev/null"\n'
CAN = 'type = "can"\ninterface = "virtual"\nchannel = "x"\n'
MAVLINK = 'type = "mavlink"\nport = 14550\n'


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("PSXN,23,1.28,1.93,104.68,-0.24",
         {"heading_deg": 104.68, "roll_deg": 1.28, "pitch_deg": 1.93, "heave_m": -0.24}),
        ("PSXN,20,0,0,0,0", {}),
        ("PASHR,204132.000,010.51,T,+00.39,-00.79,-00.84,0.151,0.075,0.555,1,0",
         {"heading_deg": 10.51, "roll_deg": 0.39, "pitch_deg": -0.79, "heave_m": -0.84}),
        ("PASHR,POS,0,10,1,2,3,4,5", {}),
        ("PRDID,-1.31,7.81,47.31", {"pitch_deg": -1.31, "roll_deg": 7.81, "heading_deg": 47.31}),
        ("PSAT,HPR,235410.50,89.58,3.35,,N", {"heading_deg": 89.58, "pitch_deg": 3.35}),
        ("PSAT,GBS,034524.00,13.0,14.0,15.0,11,2.5,3.5", {}),
        ("APXDR,A,3.861,D,ROLL", {"roll_deg": 3.861}),
        ("IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO", {"roll_deg": -1.0}),
        ("SDDPT,5.3,0.4,", {"depth_below_transducer_m": 5.3}),
        ("SDDBT,18.0,f,5.4,M,3.0,F", {"depth_below_transducer_m": 5.4}),
        ("GPGGA,085118.40,5327.60,N,01002.89,E,0,00,99.9,,M,,M,,", {"gnss_fix": 0.0}),
        ("VMVDR,45.0,T,43.0,M,3.6,N", {"current_direction_deg": 45.0, "current_speed_mps": 3.6 * 1852 / 3600}),
        ("VMVDR,,T,43.0,M,,N", {}),
    ],
)  # fmt: skip
def test_the_survey_pack_reads_what_the_manuals_say(body: str, expected: dict[str, float]) -> None:
    channels = ["heading_deg", "roll_deg", "pitch_deg", "heave_m", "depth_below_transducer_m", "gnss_fix",
                "current_speed_mps", "current_direction_deg"]  # fmt: skip
    (found,) = decoded(config_of(SERIAL, channels), [line(body)])
    assert found == pytest.approx(expected)


@pytest.mark.parametrize(("reference", "expected"), [(0, {"current_direction_deg": 57.29578}), (1, {})])
def test_set_and_drift_are_the_current(reference: int, expected: dict[str, float]) -> None:
    """129291: a set from magnetic north is no direction of the current."""
    data = struct.pack("<BBHHH", 0xFF, 0xFC | reference, 10_000, 123, 0xFFFF)
    frame = can_frame(identifier_of(129291), data.hex())
    config = config_of(CAN, ["current_speed_mps", "current_direction_deg"])
    assert decoded(config, [frame])[0] == pytest.approx({"current_speed_mps": 1.23} | expected)


def test_a_field_has_a_unit_a_condition_and_a_code() -> None:
    config = config_of(SERIAL, ["winch_tension_n", "winch_mode", "crane_slew_deg"], WINCH)
    found = decoded(config, [line("PWNC,1,12.5,A,3"), line("PWNC,1,12.5,V,3"), line("YXXDR,A,3.5,R,SLEW")])
    assert found[:2] == [{"winch_tension_n": 12_500.0, "winch_mode": 3.0}, {"winch_mode": 3.0}]
    assert found[2]["crane_slew_deg"] == pytest.approx(np.degrees(3.5))


def test_a_transducer_is_read_in_the_unit_that_its_sentence_tells() -> None:
    """Bars for pascals; what measures something else, or has a letter that nobody knows, is counted."""
    declared = """
[[channel]]
name = "baro_pa"
unit = "Pa"
range = [0, 200_000]
from = [{ transducer = "BARO" }]
"""
    config = config_of(SERIAL, ["baro_pa"], declared)
    (decoder, *_) = make_decoders(config.sources[0], config.actuators, config.declared)
    told = [f"IIXDR,{kind},1.5,{letter},BARO" for kind, letter in ("PB", "PP", ("P", ""), "CC", "PX")]
    found = [[sample.value for group in decoder.decode(line(body)) for sample in group] for body in told]
    assert found == [[150_000.0], [1.5], [1.5], [], []]
    assert decoder.refused == {"unit unknown": 2}


@pytest.mark.shared
def test_sentences_of_real_logs_equal_what_pynmeagps_reads(shared_data: Path) -> None:
    """Fix quality, HDOP, satellites, altitude, depth, and the transducers, in every sound sentence of four logs."""
    ours = {"gnss_fix": "quality", "gnss_hdop": "HDOP", "gnss_satellites": "numSV", "gnss_altitude_m": "alt"}
    depth = {"depth_below_transducer_m": "depth", "depth_offset_m": "offset"}
    config = config_of(SERIAL, [*ours, *depth])
    compared = 0
    for path in sorted((shared_data / "nmea0183").glob("*.log")):
        for raw in path.read_bytes().splitlines():
            kind = raw[3:6]
            if not raw.startswith(b"$") or kind not in (b"GGA", b"DPT"):
                continue
            theirs = pynmeagps.NMEAReader.parse(raw, validate=pynmeagps.VALCKSUM)
            (mine,) = decoded(config, [line(raw.strip())])
            for name, attribute in (ours if kind == b"GGA" else depth).items():
                expected = getattr(theirs, attribute)
                assert mine.get(name) == (None if expected == "" else float(expected)), raw
                compared += expected != ""
    assert compared > 900


@pytest.mark.shared
def test_attitude_of_a_real_log_is_what_its_text_says(shared_data: Path) -> None:
    """The OxTS log against its own columns, cut by commas."""
    config = config_of(SERIAL, ["roll_deg", "pitch_deg", "heave_m"])
    rows = [
        each for each in (shared_data / "nmea0183" / "rst39.log").read_bytes().splitlines() if b"$PASHR" in each
    ]
    columns = [list(map(float, row.split(b",")[4:7])) for row in rows]
    found = decoded(config, [line(row) for row in rows])
    assert [[each["roll_deg"], each["pitch_deg"], each["heave_m"]] for each in found] == columns
    assert len(rows) == 100


CANBOAT = {
    "gnss_fix": (129029, "Method", 1.0, 0.0),
    "gnss_hdop": (129539, "HDOP", 1.0, 0.0),
    "gnss_satellites": (129029, "Number of SVs", 1.0, 0.0),
    "heave_m": (127252, "Heave", 1.0, 0.0),
    "depth_below_transducer_m": (128267, "Depth", 1.0, 0.0),
    "depth_offset_m": (128267, "Offset", 1.0, 0.0),
    "gnss_ellipsoid_height_m": (129029, "Altitude", 1.0, 0.0),
    "water_temperature_degc": (130316, "Temperature", 1.0, -273.15),
}
"""By channel canboat's printed field, and the step from its unit."""


@pytest.mark.shared
@pytest.mark.parametrize(
    "name", ["candumpSample1.txt", "scx20.raw",
             *nightly("furuno-130842-figure8-fast.raw", "furuno-fap7011c-autopilot-maneuvers.raw")]
)  # fmt: skip
def test_the_survey_pack_on_real_captures_equals_canboat(shared_data: Path, name: str) -> None:
    """Value by value, in order, every message of the group: none too few, none too many."""
    path = shared_data / "nmea2000" / name
    with gzip.open(path.with_name(f"{path.name}.si.jsonl.gz"), "rt") as stream:
        messages = [json.loads(text) for text in list(stream)[1:]]
    config = config_of(f'type = "file"\npath = "{path}"\n', list(CANBOAT))
    (section,) = config.sources
    (decoder,) = decoders_by_protocol(section, config.actuators, config.declared)["can"]
    source: Any = LogFile(section)
    source.open()
    found: dict[tuple[str, str], list[float]] = {}
    while (frames := source.read(0.0)) is not None:
        for frame in frames:
            for sample in (sample for group in decoder.decode(frame) for sample in group):
                found.setdefault((sample.quantity, sample.source.rpartition(":")[2]), []).append(sample.value)
    source.close()
    compared = 0
    for channel, (group, field, scale, offset) in CANBOAT.items():
        theirs = [_printed(each, field) for each in messages if each["pgn"] == group and _about_water(each)]
        expected = [scale * value + offset for value in theirs if value is not None]
        assert found.get((channel, str(group)), []) == pytest.approx(expected, abs=1e-6), channel
        compared += len(expected)
    assert compared > 90


def _printed(message: dict[str, Any], field: str) -> float | None:
    value = message.get("fields", {}).get(field)
    return value["value"] if isinstance(value, dict) else value


def _about_water(message: dict[str, Any]) -> bool:
    return message["pgn"] != 130316 or message["fields"]["Source"]["value"] == 0


ENGINE_FIELDS = {
    "engine_load_percent": ("engineLoad", 100.0, 0.0),
    "engine_torque_percent": ("engineTorque", 100.0, 0.0),
    "fuel_rate_lph": ("fuelRate", 3.6e6, 0.0),
    "coolant_degc": ("temperature", 1.0, -273.15),
    "oil_pressure_pa": ("oilPressure", 1.0, 0.0),
}


@given(strategies.binary(min_size=26, max_size=26), strategies.integers(0, 2))
@settings(max_examples=200)
def test_an_engine_says_what_the_nmea2000_library_reads(noise: bytes, instance: int) -> None:
    """Any bytes at all, as 127489 of the port, the starboard and a third engine."""
    payload = bytes([instance]) + noise[1:]
    config = config_of(CAN, [f"{side}_{name}" for side in ("port", "starboard") for name in ENGINE_FIELDS])
    (mine,) = decoded(config, [can_frame(identifier_of(127489), payload, flags=FrameFlag.WHOLE)])
    theirs = {each.id: each.value for each in backend.decode(127489, payload, units="si").fields}
    side = ("port", "starboard", "")[instance]
    expected = {
        f"{side}_{name}": scale * theirs[field] + offset
        for name, (field, scale, offset) in ENGINE_FIELDS.items()
        if side and theirs[field] is not None
    }
    assert mine == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_a_gearbox_and_an_engine_by_the_librarys_encoder() -> None:
    config = config_of(CAN, ["starboard_gear", "starboard_gearbox_oil_degc", "starboard_engine_rpm"])
    frames = []
    for group, name, fields in (
        (127493, "transmissionParametersDynamic", {"instance": 1, "transmissionGear": 2, "oilTemperature": 350.0}),
        (127488, "engineParametersRapidUpdate", {"instance": 1, "speed": 1500.0 / 60.0}),
    ):
        payload = backend.DATABASE.encode(name, fields)
        frames.append(can_frame(identifier_of(group), payload))
    gear, engine = decoded(config, frames)
    assert gear == {"starboard_gear": 2.0, "starboard_gearbox_oil_degc": pytest.approx(76.85)}
    assert engine == {"starboard_engine_rpm": 1500.0}


@pytest.mark.parametrize(
    ("group", "data", "expected"),
    [
        # values by the formulas of SAE J1939-71: SPN 190 (0.125 rpm), 513 (1 %, from -125), 92, 183 (0.05 l/h), 110
        (61444, "FF FF C8 80 25 FF FF FF", {"engine_rpm": 1200.0, "engine_torque_percent": 75.0}),
        (61443, "FF FF 50 FF FF FF FF FF", {"engine_load_percent": 80.0}),
        (65266, "20 03 FF FF FF FF FF FF", {"fuel_rate_lph": 40.0}),
        (65262, "7D FF FF FF FF FF FF FF", {"coolant_degc": 85.0}),
        (65263, "FF FF FF 64 FF FF FF FF", {"oil_pressure_pa": 400_000.0}),
        (65263, "FF FF FF FB FF FF FF FF", {}),  # from 0xFB on no values
        (61444, "FF FF FE 00 FB FF FF FF", {}),
        (61444, "FF FF FA FF FA FF FF FF", {"engine_rpm": 8031.875, "engine_torque_percent": 125.0}),
    ],
)
def test_engines_on_j1939_are_told_apart_by_their_addresses(
    group: int, data: str, expected: dict[str, float]
) -> None:
    names = [f"{side}_{name}" for side in ("port", "starboard") for name in ("engine_rpm", *ENGINE_FIELDS)]
    config = config_of(CAN, names)
    identifier = 6 << 26 | group << 8
    found = decoded(config, [can_frame(identifier | address, data.replace(" ", "")) for address in (0, 1, 2)])
    assert found == [
        {f"port_{name}": value for name, value in expected.items()},
        {f"starboard_{name}": value for name, value in expected.items()},
        {},
    ]


def test_the_places_of_fields_that_canboats_database_gives_are_those_of_the_standard() -> None:
    """Each of the fields that are read on every ship, with step and sign, which the library does not say."""
    for group, fields in FIELDS.items():
        for name, field in fields.items():
            known = canboat_fields(group)[name]
            assert (known.start, known.bits, known.signed) == (field.start, field.bits, field.signed)
            if field.step is not None:
                assert known.step in (pytest.approx(field.step), pytest.approx(field.step / 60.0))


def test_a_field_by_its_place_in_a_makers_own_messages() -> None:
    """A single frame and a fast packet, of one maker by the code that every such message begins with."""
    declared = """
[[channel]]
name = "boom_angle_deg"
unit = "deg"
range = [-180, 180]
from = [{ group = 65300, field = "16:16", step = 1e-4, signed = true, unit = "rad", where = { "0:11" = 300 } }]
[[channel]]
name = "boom_load_kn"
unit = "kN"
range = [0, 500]
from = [{ group = 130900, field = "64:16", step = 0.1, where = { "0:11" = 300 } }]
"""
    config = config_of(CAN, ["boom_angle_deg", "boom_load_kn"], declared)
    head = struct.pack("<H", 300 | 0x9800)
    single = head + struct.pack("<hI", -7854, 0xFFFFFFFF)
    whole = head + bytes(6) + struct.pack("<H", 1234)
    first, second = b"\x40\x0a" + whole[:6], b"\x41" + whole[6:] + b"\xff\xff\xff"
    other = struct.pack("<H", 301 | 0x9800) + single[2:]
    frames = [
        can_frame(identifier_of(group), data)
        for group, data in ((65300, single), (65300, other), (130900, first), (130900, second))
    ]
    found = decoded(config, frames)
    assert found[0]["boom_angle_deg"] == pytest.approx(-45.0, abs=0.01)
    assert found[1:3] == [{}, {}]
    assert found[3] == {"boom_load_kn": pytest.approx(123.4)}


def test_a_field_of_a_mavlink_message() -> None:
    declared = """
[[channel]]
name = "hull_temperature_degc"
unit = "degC"
range = [-40, 90]
from = [{ message = "SCALED_PRESSURE2", field = "temperature" }]
[[channel]]
name = "cell_voltage_v"
unit = "V"
range = [0, 60]
from = [{ message = "BATTERY_STATUS", field = "voltages", index = 1, where = { id = 2 } }]
"""
    config = config_of(MAVLINK, ["hull_temperature_degc", "cell_voltage_v"], declared)
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = []
    for message in (
        link.scaled_pressure2_encode(1000, 1013.0, 0.0, 1850),
        link.battery_status_encode(2, 0, 0, 2000, [4000, 4123] + [65535] * 8, 0, 0, 0, 0),
        link.battery_status_encode(1, 0, 0, 2000, [4000, 4123] + [65535] * 8, 0, 0, 0, 0),
        link.battery_status_encode(2, 0, 0, 2000, [4000, 65535] + [65535] * 8, 0, 0, 0, 0),
    ):
        frames.append(Frame("x", "mavlink", message.pack(link), 0, 0))
    found = decoded(config, frames)
    assert found == [{"hull_temperature_degc": 18.5}, {"cell_voltage_v": pytest.approx(4.123)}, {}, {}]


RATED = "rated_rpm = { port = 200, tunnel = 600 }\n"


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("RCTRD,2,40.0,P,,V,90.8", {"port_rpm": 80.0, "port_angle_deg": 90.8}),
        ("RCTRD,1,-50,P,,V,", {"tunnel_rpm": -300.0}),
        ("RCTRD,2,81.5,R,,V,90.8", {"port_rpm": 81.5, "port_angle_deg": 90.8}),
        ("RCTRD,4,40.0,P,,V,90.8", {"starboard_angle_deg": 90.8}),
        ("RCTRD,2,40.0,V,,V,90.8", {"port_angle_deg": 90.8}),
        ("RCTRC,2,25,P,,V,90.8,B,C", {"port_order_rpm": 50.0, "port_order_angle_deg": 90.8}),
    ],
)
def test_a_thruster_in_percent_turns_so_much_of_its_rated_speed(body: str, expected: dict[str, float]) -> None:
    config = config_of(SERIAL + RATED, ["port_rpm"])
    assert decoded(config, [line(body)]) == [expected]


def test_who_has_no_speed_is_rated_none() -> None:
    with pytest.raises(ConfigurationError, match="those are port, starboard, tunnel"):
        config_of(SERIAL + "rated_rpm = { bow = 200 }\n", ["port_rpm"])


def test_a_rudder_in_percent_and_an_inclinometer_the_wrong_way_round() -> None:
    """An origin that is declared takes the place of what the same message is read as otherwise."""
    declared = """
[[channel]]
name = "rudder_angle_deg"
from = [{ sentence = "RSA", field = 1, when = { 2 = "A" }, full_scale = 35 }]
[[channel]]
name = "roll_deg"
from = [{ group = 127257, field = "roll", scale = -1 }]
[[channel]]
name = "heading_deg"
from = [{ message = "ATTITUDE", field = "yaw", unit = "rad", offset = 90 }]
"""
    assert decoded(config_of(SERIAL, ["rudder_angle_deg"], declared), [line("IIRSA,-40.0,A,,V")]) == [
        {"rudder_angle_deg": -14.0}
    ]
    attitude = backend.DATABASE.encode("attitude", {"roll": 0.1, "pitch": 0.2})
    (found,) = decoded(config_of(CAN, ["roll_deg"], declared), [can_frame(identifier_of(127257), attitude)])
    assert found == {"roll_deg": pytest.approx(-np.degrees(0.1)), "pitch_deg": pytest.approx(np.degrees(0.2))}
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    yaw = link.attitude_encode(0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0).pack(link)
    (found,) = decoded(config_of(MAVLINK, ["heading_deg"], declared), [Frame("x", "mavlink", yaw, 0, 0)])
    assert found["heading_deg"] == pytest.approx(np.degrees(1.0) + 90.0, abs=1e-5)


def test_a_tunnel_thruster_by_128006_has_a_side() -> None:
    origins = ", ".join(
        f'{{ group = 128006, field = "speedControl", where = {{ identifier = 3, directionControl = {side} }},'
        f" full_scale = {full} }}"
        for side, full in ((3, 600), (2, -600))
    )
    config = config_of(CAN, ["tunnel_rpm"], f'[[channel]]\nname = "tunnel_rpm"\nfrom = [{origins}]\n')
    frames = [
        can_frame(identifier_of(128006), backend.DATABASE.encode("thrusterControlStatus", fields))
        for fields in (
            {"identifier": 3, "directionControl": 3, "speedControl": 0.5},
            {"identifier": 3, "directionControl": 2, "speedControl": 0.25},
            {"identifier": 4, "directionControl": 2, "speedControl": 0.25},
            {"identifier": 3, "directionControl": 2},
        )
    ]
    found = [each.get("tunnel_rpm") for each in decoded(config, frames)]
    assert found == [pytest.approx(300.0), pytest.approx(-150.0), None, None]


def write_log(folder: Path, seconds: int = 120) -> None:
    """A winch and a crane beside a compass, 2 Hz; the tension has a spike and an impossible value."""
    rows = []
    for number in range(2 * seconds):
        time_ns = START_NS + number * SECOND // 2
        tension = 20.0 + 3.0 * np.sin(0.1 * number) + 0.02 * np.cos(2.7 * number)
        tension = {100: 90.0, 150: 900.0}.get(number, tension)
        slew = (3.0 * number) % 360.0
        for body in (
            f"PWNC,1,{tension:.3f},A,{number // 60}",
            f"YXXDR,A,{slew:.2f},D,SLEW",
            f"HEHDT,{slew:.2f},T",
        ):
            tag = frame_sentence(f"c:{time_ns // 1_000_000}").strip()[1:]
            rows.append(b"\\" + tag + b"\\" + frame_sentence(body))
    (folder / "winch.log").write_bytes(b"".join(rows))
    channels = '["heading_deg", "winch_tension_n", "crane_slew_deg", "winch_mode", "depth_below_transducer_m"]'
    (folder / "trial.toml").write_text(
        f'[trial]\nname = "winch"\n{WINCH}\n[[pack]]\nname = "survey"\n'
        f'[[source]]\nname = "deck"\ntype = "file"\npath = "winch.log"\nchannels = {channels}\n'
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("declared")
    write_log(folder)
    (path,), _ = record(load_config(folder / "trial.toml"), folder / "out")
    return path


def test_a_recording_carries_what_its_channels_are(recorded: Path) -> None:
    recording = read_recording(recorded)
    known = channels_of_trial(recording.trial)
    assert (known["winch_tension_n"].unit, known["winch_tension_n"].high) == ("N", 200_000)
    assert (known["crane_slew_deg"].circular, known["winch_mode"].state) == (True, True)
    assert recording.series["winch_tension_n"].value.size == 239  # 900 kN is impossible, and left out
    assert actuators_of_table(recording.series, {"trial": {"channels": recording.trial.channels}}) == ()


def test_it_is_checked_like_the_rest(recorded: Path) -> None:
    quality = check_recording(read_recording(recorded))
    assert quality.channels["winch_tension_n"].spikes == 1
    assert quality.channels["winch_mode"].stuck == ()
    (text,) = (each.text for each in quality.findings if each.code == "spike")
    assert text.startswith("winch_tension_n")
    assert "N at" in text


def test_levels_are_interpolated_angles_turned_and_states_held(recorded: Path) -> None:
    table = resample(read_table(recorded), 4.0)
    slew, mode = table["crane_slew_deg"].dropna(), table["winch_mode"].dropna()
    turned = np.diff(np.unwrap(slew.to_numpy(), period=360.0))
    assert turned == pytest.approx(1.5, abs=1e-6)
    assert slew.between(0.0, 360.0, inclusive="left").all()
    assert set(mode) == {0.0, 1.0, 2.0, 3.0}
    assert table["winch_tension_n"].iloc[3] == pytest.approx(table["winch_tension_n"].iloc[[2, 4]].mean())


def test_a_state_is_not_held_across_a_gap() -> None:
    stamps = pd.to_datetime([0.0, 1.0, 2.0, 30.0, 31.0], unit="s", utc=True)
    channel = declare("winch_mode", "1", 0, 9, state=True)
    table = pd.DataFrame({"winch_mode": [1.0, 1.0, 2.0, 3.0, 3.0]}, index=stamps.rename("time"))
    table.attrs = {"trial": {"channels": declared_channels_as_json([channel])}}
    found = resample(table)["winch_mode"]
    assert found.iloc[:4].tolist() == [1.0, 1.0, 2.0, 2.0]
    assert found.iloc[8:29].isna().all()
    assert found.iloc[30:].tolist() == [3.0, 3.0]


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "nc"])
def test_an_export_has_its_unit_and_comes_back(recorded: Path, tmp_path: Path, kind: str) -> None:
    table = resample(read_table(recorded))
    path, *beside = export_table(table, tmp_path / f"t.{kind}")
    if kind == "csv":
        units = json.loads(beside[0].read_text())["units"]
    elif kind == "nc":
        with netcdf_file(path, mmap=False) as file:
            units = {name: getattr(each, "units", b"").decode() for name, each in file.variables.items()}
        assert units.pop("crane_slew_deg") == "degree"
        units["crane_slew_deg"] = "deg"
    elif kind == "mat":
        units = loadmat(path, simplify_cells=True)["units"]
    else:
        import pyarrow.parquet as pq

        schema = pq.read_schema(path)
        units = {name: (schema.field(name).metadata or {}).get(b"unit", b"").decode() for name in schema.names}
    assert (units["winch_tension_n"], units["crane_slew_deg"], units["winch_mode"]) == ("N", "deg", "1")
    import_table(path, tmp_path / "again.mcap", allow_missing=True)
    again = read_recording(tmp_path / "again.mcap")
    assert again.trial.channels == read_recording(recorded).trial.channels
    present = table["winch_tension_n"].dropna().to_numpy()
    assert again.series["winch_tension_n"].value == pytest.approx(present)


def test_info_lists_it_and_what_never_came_is_said(tmp_path: Path, command: Command) -> None:
    write_log(tmp_path, seconds=5)
    done = command("record", tmp_path / "trial.toml", "-o", tmp_path / "out")
    assert "nothing came of depth_below_transducer_m" in done.err
    (path,) = (tmp_path / "out").glob("*.mcap")
    shown = command("info", path).out
    assert re.search(r"winch_tension_n +N +10 ", shown)
    assert '"low"' not in shown
    assert set(command("info", path, "--json").json["channels"]) >= {"winch_tension_n", "winch_mode"}


def test_redecoding_takes_the_packs_that_the_recording_carries(recorded: Path, tmp_path: Path) -> None:
    redecode([recorded], tmp_path / "again.mcap")
    before, after = read_recording(recorded).series, read_recording(tmp_path / "again.mcap").series
    assert before.keys() == after.keys()
    for name in before:
        assert before[name].value.tolist() == after[name].value.tolist()


def test_what_was_not_declared_at_sea_can_be_afterwards(recorded: Path, tmp_path: Path) -> None:
    """All that came is in the raw input."""
    drum = '[[channel]]\nname = "drum"\nunit = "1"\nrange = [0, 9]\nstate = true\n'
    drum += 'from = [{ sentence = "PWNC", field = 1 }]\n'
    text = f'[trial]\nname = "later"\n{drum}[[source]]\nname = "deck"\nchannels = ["heading_deg", "drum"]\n'
    redecode([recorded], tmp_path / "later.mcap", parse_config(f'{text}type = "file"\npath = "winch.log"\n', "x"))
    assert set(read_recording(tmp_path / "later.mcap").series["drum"].value) == {1.0}


def test_a_pack_of_the_users_own_is_carried_too(tmp_path: Path) -> None:
    write_log(tmp_path, seconds=5)
    (tmp_path / "deck.toml").write_text(WINCH)
    text = (tmp_path / "trial.toml").read_text().replace(WINCH, '[[pack]]\nname = "deck.toml"\n')
    (tmp_path / "trial.toml").write_text(text)
    (path,), _ = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    (tmp_path / "deck.toml").unlink()
    redecode([path], tmp_path / "again.mcap")
    assert read_recording(tmp_path / "again.mcap").series["winch_tension_n"].value.size == 10


def test_a_table_declares_its_channels_in_the_map(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t,load,fuel,spm\n0,50,1.5,90\n1,75,2.0,95\n")
    (tmp_path / "map.toml").write_text(
        '[time]\ncolumn = "t"\nformat = "seconds"\n[[pack]]\nname = "engine_room"\n'
        '[[channel]]\nname = "towing_force_n"\nunit = "N"\nrange = [0, 1e6]\n'
        '[channels]\ntowing_force_n = { column = "load", unit = "percent", full_scale = 20_000 }\n'
        'main_fuel_rate_lph = { column = "fuel", unit = "l/min" }\n'
        'main_coolant_degc = { column = "spm", unit = "degF" }\n'
    )
    import_table(tmp_path / "t.csv", tmp_path / "t.mcap", tmp_path / "map.toml", allow_missing=True)
    recording = read_recording(tmp_path / "t.mcap")
    found = {name: series.value.tolist() for name, series in recording.series.items()}
    assert found["towing_force_n"] == [10_000.0, 15_000.0]
    assert found["main_fuel_rate_lph"] == pytest.approx([90.0, 120.0])
    assert found["main_coolant_degc"] == pytest.approx([(90 - 32) / 1.8, (95 - 32) / 1.8])
    assert channels_by_name_of(recording.trial)["towing_force_n"].unit == "N"


@pytest.mark.parametrize(
    ("declared", "channels", "says"),
    [
        ('[[channel]]\nname = "x_lph"\nunit = "kg"\nrange = [0, 1]\n', [], "in kg; let its name end in _kg"),
        ('[[channel]]\nname = "x_kg"\nrange = [0, 1]\n', [], "has no unit"),
        ('[[channel]]\nname = "x_kg"\nunit = "kg"\nrange = [1, 1]\n', [], "holds nothing"),
        ('[[channel]]\nname = "X y_kg"\nunit = "kg"\nrange = [0, 1]\n', [], "is not valid in a topic"),
        ('[[channel]]\nname = "heave_m"\nunit = "m"\nrange = [0, 1]\n', [], "is already a channel of the ship"),
        ('[[channel]]\nname = "x_kg"\nunit = "kg"\nrange = [0, 1]\nfrom = [{ field = 1 }]\n', [], "says none of"),
        ('[[channel]]\nname = "x_kg"\nunit = "kg"\nrange = [0, 1]\nfrom = [{ transducer = "a", unit = "m" }]\n', [],
         "does not measure a quantity in kg"),
        ('[[channel]]\nname = "x_kg"\nunit = "kg"\nrange = [0, 1]\n', ["x_kg"], "no message on source 'x' carries"),
        ('[[pack]]\nname = "no_such"\n', [], "pack 'no_such' does not exist"),
        (PACKS, ["port_fuel_rate_lph"], "no message on source 'x' carries"),
        (PACKS, ["depth_m"], "did you mean"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_with_its_line(declared: str, channels: list[str], says: str) -> None:
    with pytest.raises(ConfigurationError, match=says) as error:
        config_of(SERIAL, channels, declared)
    assert "trial.toml, line" in str(error.value)


@pytest.mark.parametrize(
    ("source", "origin", "says"),
    [
        (CAN, '{ group = 127489, field = "fuelrate" }', "group 127489 has no field 'fuelrate': it has instance,"),
        (CAN, '{ group = 127489, field = "oilPressure" }', "unit 'Pa' does not measure"),
        (MAVLINK, '{ message = "ATITUDE", field = "roll" }', "MAVLink has no message ATITUDE; write one such as"),
        (MAVLINK, '{ message = "ATTITUDE", field = "heel" }', "ATTITUDE has no field 'heel'; write one of"),
        (MAVLINK, '{ message = "BATTERY_STATUS", field = "current_battery", index = 1 }', "leave out `index`"),
    ],
)
def test_what_only_a_decoder_can_find_wrong_is_said(source: str, origin: str, says: str) -> None:
    declared = f'[[channel]]\nname = "x_lph"\nunit = "l/h"\nrange = [0, 1]\nfrom = [{origin}]\n'
    config = config_of(source, ["x_lph"], declared)
    with pytest.raises(ConfigurationError, match=says):
        decoded(config, [])


def test_the_files_own_origins_go_before_a_packs() -> None:
    own = '[[channel]]\nname = "heave_m"\nfrom = [{ sentence = "PSXN", field = 5, scale = -1 }]\n'
    (found,) = decoded(config_of(SERIAL, ["heave_m"], own + PACKS), [line("PSXN,23,1.28,1.93,104.68,-0.24")])
    assert found == {"heave_m": 0.24}


@given(
    strategies.builds(
        declare,
        name=strategies.from_regex(r"[a-z]{1,9}(_[a-z0-9]{1,9}){0,2}_kw", fullmatch=True),
        unit=strategies.just("kW"),
        low=strategies.floats(-1e9, -1e-3),
        high=strategies.floats(0, 1e9),
        meaning=strategies.text(max_size=20),
        state=strategies.booleans(),
    )
)
def test_what_a_recording_says_of_a_channel_reads_back(channel: Any) -> None:
    (again,) = parse_declared_channels(declared_channels_as_json([channel]))
    assert again == channel


def test_a_strangers_metadata_declare_nothing_that_a_terminal_would_obey() -> None:
    said = {"name": "x_n31m", "unit": "N\x1b[31m", "low": 0.0, "high": 1.0, "meaning": "", "state": False}
    for text in (
        json.dumps([said]),
        json.dumps([said | {"unit": "N", "name": "x_n", "high": "1"}]),
        "[1]",
        "{",
        "[{}]",
    ):
        assert parse_declared_channels(text) == ()


@pytest.mark.parametrize(
    ("unit", "ending"),
    [("l/h", "_lph"), ("%", "_percent"), ("deg/s", "_dps"), ("1", ""), ("degC", "_degc"), ("kg/m3", "_kgpm3")],
)
def test_a_name_ends_in_its_unit(unit: str, ending: str) -> None:
    assert name_ending_of_unit(unit) == ending


def test_units_have_zeros_and_sizes() -> None:
    assert unit_conversion("degC", "degF").apply(212.0) == pytest.approx(100.0)
    assert unit_conversion("hPa", "bar").apply(1.013) == pytest.approx(1013.0)
    assert unit_conversion("l/h", "m3/s").invert(3600.0) == pytest.approx(0.001)
    assert unit_conversion("mg/l", "mg/l").apply(nan) is not None


def test_the_example_names_only_what_its_sources_can_carry() -> None:
    config = load_config(Path(__file__).parents[2] / "trials" / "survey_and_engines.toml")
    for section in config.sources:
        assert decoders_by_protocol(section, config.actuators, config.declared)
    assert set(config.watched_channels) <= config.expected_channels


def test_an_example_is_drawn_with_its_unit(recorded: Path) -> None:
    """Beside the motion, what belongs together in one picture, and states as steps."""
    from seatrial.analysis.report.interactive import page_data
    from seatrial.analysis.report.plots import declared_groups, draw_series

    table = resample(read_table(recorded))
    assert [*declared_groups(table)] == ["winch tension [N]", "crane slew [deg]", "winch mode"]
    page = page_data(table)
    assert page["channels"]["winch_mode"][70] == 2
    assert max(filter(None, page["drawn"]["crane_slew_deg"])) > 360.0
    axes = Figure().subplots()
    draw_series(axes, table, ["winch_mode"])
    assert axes.get_lines()[0].get_drawstyle() == "steps-post"


def test_a_script_declares_what_it_writes(tmp_path: Path) -> None:
    index = pd.date_range("2026-06-01", periods=20, freq="1s", tz="UTC", name="time")
    table = pd.DataFrame({"surge_mps": 2.0, "engine_kw": np.linspace(0.0, 500.0, 20)}, index=index)
    path = st.write(table, tmp_path / "a.mcap", declared=[st.declare("engine_kw", "kW", 0, 900)])
    again = st.read(st.write(st.read(path), tmp_path / "b.mcap"))
    assert again["engine_kw"].tolist() == table["engine_kw"].tolist()
    with pytest.raises(InputError, match="engine_kw are no channels"):
        st.write(table, tmp_path / "c.mcap")


def test_an_mqtt_topic_and_a_sentence_under_one_carry_declared_channels() -> None:
    fuel = '[source.values]\nport_fuel_rate_lph = { topic = "ship/fuel", unit = "l/min" }\n'
    config = config_of(f'type = "mqtt"\ntopics = ["ship/NMEA/#"]\n{fuel}', ["port_fuel_rate_lph", "heave_m"])
    told = (
        b"ship/fuel\0" + b"1.5,2026-05-17T12:00:00Z",
        b"ship/NMEA/mru\0" + frame_sentence("PSXN,23,1,2,3,-0.24").strip(),
    )
    found = decoded(config, [Frame("x", "mqtt", payload, START_NS, 0) for payload in told])
    assert found == [{"port_fuel_rate_lph": pytest.approx(90.0)}, {"heave_m": -0.24}]


def test_dbc_signals_and_named_values_carry_declared_channels() -> None:
    """There and back by the encoders that the emulator has."""
    declared = """
[[channel]]
name = "oil_degc"
unit = "degC"
range = [-40, 200]
[[channel]]
name = "load_percent"
unit = "%"
range = [0, 150]
"""
    signal = '{ message = "PortAzimuth", signal = "Angle", unit = "degF" }'
    values = {"oil_degc": 20.5, "load_percent": 61.0}
    for source, name in (
        (f'{CAN}dbc = "{DBC}"\n[source.signals]\noil_degc = {signal}\n', "oil_degc"),
        (f'{MAVLINK}[source.named_values]\nload_percent = {{ name = "load", unit = "ratio" }}\n', "load_percent"),
    ):
        config = config_of(source, [name], declared)
        section, protocol = config.sources[0], "mavlink" if "mavlink" in source else "can"
        packets = make_encoder(section, config.actuators, config.known_channels).encode(Moment(START_NS, values))
        decoder = decoders_by_protocol(section, config.actuators, config.declared)[protocol][-1]  # type: ignore[index]
        frames = [Frame("x", protocol, each.payload, 0, 0, each.identifier) for each in packets]  # type: ignore[arg-type]
        found = {each.quantity: each.value for frame in frames for group in decoder.decode(frame) for each in group}
        assert found == {name: pytest.approx(values[name], abs=0.06)}


def test_the_fields_of_every_group_are_numbers_and_codes_with_a_place() -> None:
    """Also of groups that the library does not decode from a payload of ones, as 130900."""
    for group in range(59_392, 131_072):
        fields = canboat_fields(group)
        assert all(field.start >= 0 and field.bits > 0 for field in fields.values())
