"""Who says it, where one name stands for two: buses of one log, receivers of one talker."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import get_args, get_type_hints

import can
import pytest

from seatrial.acquisition.config.sources import AnySource
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.trial import line_and_device
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.logger.survey import redecode
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.sources import INPUTS
from seatrial.acquisition.sources.log_formats import FILE_FORMS, LINE_FORMS
from tests.acquisition.bus_logs import block
from tests.acquisition.conftest import config_text
from tests.acquisition.test_nmea0183 import line, sound

BEGAN_S = 1_779_000_000
HEADING = 0x09F11204  # of the device with address 4
FIRST_DEG, SECOND_DEG = 57.3, 120.0
Frames = list[tuple[float, str, bytes]]


def heading_data(degrees: float) -> bytes:
    return bytes([0]) + round(degrees * 31415.926535 / 180.0).to_bytes(2, "little") + b"\xff\x7f\xff\x7f\xfc"


def two_buses(seconds: int = 4) -> Frames:
    """A compass on each of two buses, each with the address 4: time [s], bus, data."""
    return [
        (second + offset_s, bus, heading_data(degrees))
        for second in range(seconds)
        for offset_s, bus, degrees in ((0.0, "can0", FIRST_DEG), (0.3, "can1", SECOND_DEG))
    ]


def candump(frames: Frames) -> bytes:
    return b"".join(
        f"({BEGAN_S + at_s:.6f}) {bus} {HEADING:08X}#{data.hex().upper()}\n".encode() for at_s, bus, data in frames
    )


def candump_console(frames: Frames) -> bytes:
    return b"".join(
        f" ({BEGAN_S + at_s:.6f})  {bus}  {HEADING:08X}   [8]  {data.hex(' ').upper()}\n".encode()
        for at_s, bus, data in frames
    )


def asc(frames: Frames) -> bytes:
    head = "date Sun May 17 06:40:00.000 am 2026\nbase hex  timestamps absolute\ninternal events logged\n"
    return (head + "".join(
        f"   {at_s:.6f} {int(bus[-1]) + 1}  {HEADING:08X}x       Rx   d 8 {data.hex(' ').upper()}\n"
        for at_s, bus, data in frames
    )).encode()  # fmt: skip


def pcapng(frames: Frames, *, named: bool = True) -> bytes:
    log = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    for name in (b"can0", b"can1"):
        options = struct.pack("<HH", 2, 4) + name + struct.pack("<HH", 0, 0) if named else b""
        log += block(1, struct.pack("<HHI", 227, 0, 0) + options)
    for at_s, bus, data in frames:
        packet = struct.pack(">IB3x", HEADING | 0x80000000, len(data)) + data
        high, low = divmod(round((BEGAN_S + at_s) * 1e6), 2**32)
        log += block(6, struct.pack("<IIIII", int(bus[-1]), high, low, len(packet), len(packet)) + packet)
    return log


def from_log(folder: Path, content: bytes, more: str = "") -> tuple[Path, Recording]:
    (folder / "in.log").write_bytes(content)
    text = config_text(f'type = "can_file"\npath = "{folder / "in.log"}"\n{more}', ("heading_deg",))
    (folder / "trial.toml").write_text(text)
    (path,), _ = record(load_config(folder / "trial.toml"), folder / "out")
    return path, read_recording(path)


@pytest.mark.parametrize(
    ("write", "first"),
    [
        (candump, "can0"),
        (candump_console, "can0"),
        (asc, "channel1"),
        (pcapng, "can0"),
        (lambda frames: pcapng(frames, named=False), "interface0"),
    ],
)
def test_two_buses_with_one_address_are_two_compasses(
    write: Callable[[Frames], bytes], first: str, tmp_path: Path
) -> None:
    """One of them has the channel, by its name; the other is neither mixed in nor lost: it is in the raw input."""
    path, recording = from_log(tmp_path, write(two_buses()))
    heading = recording.series["heading_deg"]
    assert heading.sources == (f"line/4@{first}:127250",)
    assert heading.value == pytest.approx([FIRST_DEG] * 4, abs=0.01)
    assert recording.raw["/raw/can/line"] == 8
    assert any("several buses" in text for _, text in recording.events)
    redecode([path], tmp_path / "again.mcap")
    again = read_recording(tmp_path / "again.mcap").series["heading_deg"]
    assert again.sources == heading.sources
    assert again.value.tolist() == heading.value.tolist()


def test_two_channels_of_a_binary_log_are_two_compasses(tmp_path: Path) -> None:
    with can.BLFWriter(tmp_path / "frames.blf") as log:
        for at_s, bus, data in two_buses():
            log(can.Message(timestamp=BEGAN_S + at_s, channel=int(bus[-1]), arbitration_id=HEADING, data=data))
    _, recording = from_log(tmp_path, (tmp_path / "frames.blf").read_bytes())
    assert recording.series["heading_deg"].sources == ("line/4@channel1:127250",)
    assert recording.series["heading_deg"].value == pytest.approx([FIRST_DEG] * 4, abs=0.01)


def test_a_bus_that_falls_silent_hands_its_channels_to_the_other(tmp_path: Path) -> None:
    frames = [each for each in two_buses(20) if each[1] == "can1" or each[0] < 5]
    _, recording = from_log(tmp_path, candump(frames))
    heading = recording.series["heading_deg"]
    assert heading.sources == ("line/4@can0:127250", "line/4@can1:127250")
    changes = sum(a != b for a, b in zip(heading.source_index, heading.source_index[1:], strict=False))
    assert changes == 1
    assert any("from line/4@can0:127250 to line/4@can1:127250" in text for _, text in recording.events)


def test_a_log_of_one_bus_has_plain_labels(tmp_path: Path) -> None:
    _, recording = from_log(tmp_path, candump([each for each in two_buses() if each[1] == "can1"]))
    assert recording.series["heading_deg"].sources == ("line/4:127250",)
    assert not any("several buses" in text for _, text in recording.events)


def test_a_listed_device_is_recognised_on_either_bus(tmp_path: Path) -> None:
    """Listed first, it has the channel, although another device on another bus came before it."""
    gyro = f"({BEGAN_S - 0.1:.6f}) can1 09F11205#{heading_data(200.0).hex()}\n".encode()
    device = 'devices = [{ name = "compass", address = 4 }]\n'
    _, recording = from_log(tmp_path, gyro + candump(two_buses()), device)
    heading = recording.series["heading_deg"]
    assert heading.sources[-1] == "line/compass@can0:127250"
    assert heading.value[1:] == pytest.approx([FIRST_DEG] * 4, abs=0.01)


def test_parts_of_messages_of_two_buses_are_not_mixed(tmp_path: Path) -> None:
    """129029 in several frames from each of two buses, interleaved: two positions, or none that nobody sent."""
    from tests.acquisition.can_frames import fast_parts, gnss

    lines, at_s = list[str](), float(BEGAN_S)
    one, other = (fast_parts(gnss(1, latitude_deg)) for latitude_deg in (63.4, 64.5))
    for a, b in zip(one, other, strict=True):
        lines += [f"({at_s:.6f}) can0 0DF80503#{a.hex()}", f"({at_s + 1e-4:.6f}) can1 0DF80503#{b.hex()}"]
        at_s += 1e-3
    (tmp_path / "in.log").write_text("\n".join(lines) + "\n")
    text = config_text(f'type = "can_file"\npath = "{tmp_path / "in.log"}"\n', ("latitude_deg",))
    (tmp_path / "trial.toml").write_text(text)
    (path,), _ = record(load_config(tmp_path / "trial.toml"), tmp_path / "out")
    latitude = read_recording(path).series["latitude_deg"]
    assert latitude.sources == ("line/3@can0:129029",)
    assert latitude.value == pytest.approx([63.4])


# --- receivers of one talker

METRE_MIN = 1.0 / 1852.0  # minutes of latitude


def fixes(said: list[tuple[str, float, float]]) -> tuple[list[str], Nmea0183Decoder]:
    """The sensors of sentences that state a time (hhmmss.ss), at a second, so many metres north."""
    decoder, sensors = Nmea0183Decoder(), []
    for body, at_s, north_m in said:
        place = f"63{26.0 + north_m * METRE_MIN:010.7f},N,01024.0000,E"
        (group, *_) = decoder.decode(line(sound(body.format(place=place)), at_s))
        sensors.append(line_and_device(group[0].source))
    return sensors, decoder


def gga(second: float) -> str:
    return f"GPGGA,1200{second:05.2f}," + "{place},1,10,0.9,5.0,M,40.0,M,,"


def rmc(second: float) -> str:
    return f"GPRMC,1200{second:05.2f},A," + "{place},0.0,0.0,170526,,,A"


@pytest.mark.parametrize("apart_m", [40.0, 185.0, 5000.0])
@pytest.mark.parametrize("speed_mps", [0.0, 5.0, 15.0])
def test_two_receivers_of_one_talker_are_kept_apart(apart_m: float, speed_mps: float) -> None:
    said = [
        (gga(second), second + late_s, speed_mps * second + shift_m)
        for second in range(20)
        for late_s, shift_m in ((0.0, 0.0), (0.2, apart_m))
    ]
    sensors, decoder = fixes(said)
    assert sensors == ["line/GN", "line/GN@receiver2"] * 20
    assert sum("two receivers" in text for _, text in decoder.notices) == 1


def test_their_order_may_change_and_either_may_pause() -> None:
    ways = {0: 0.0, 1: 100.0}
    orders = [(0, 1), (1, 0), (1,), (0,), (1, 0), (0, 1)]
    said = [
        (gga(second), second + 0.1 * place, 4.0 * second + ways[each])
        for second, order in enumerate(orders)
        for place, each in enumerate(order)
    ]
    names = {0: "line/GN", 1: "line/GN@receiver2"}
    assert fixes(said)[0] == [names[each] for order in orders for each in order]


def test_sentences_of_one_moment_belong_to_the_receiver_that_is_nearest() -> None:
    said = [
        (kind(second), second, shift_m)
        for second in range(10)
        for kind, shift_m in ((gga, 0.0), (gga, 60.0), (rmc, 0.0), (rmc, 60.0))
    ]
    assert fixes(said)[0] == ["line/GN", "line/GN@receiver2"] * 20


@pytest.mark.parametrize("speed_mps", [0.0, 7.0, 12.0])
def test_one_receiver_that_repeats_itself_or_states_whole_seconds_stays_one(speed_mps: float) -> None:
    """Five fixes a second with the time cut to whole seconds; each twice, as over two ways."""
    said = [(gga(number // 5), number / 5.0, speed_mps * number / 5.0) for number in range(100) for _ in range(2)]
    sensors, decoder = fixes(said)
    assert set(sensors) == {"line/GN"}
    assert not decoder.notices or not any("receivers" in text for _, text in decoder.notices)


def test_a_jump_of_one_receiver_is_no_second_receiver() -> None:
    said = [(kind(second), second, 0.0 if second < 5 else 900.0) for second in range(10) for kind in (gga, rmc)]
    assert set(fixes(said)[0]) == {"line/GN"}


@pytest.mark.parametrize("speed_mps", [0.0, 10.0, 40.0])
def test_a_receiver_whose_clock_stands_still_is_one(speed_mps: float) -> None:
    """It states the same time again and again, for hours: that is no moment."""
    said = [(gga(0.0), 1.0 * number, speed_mps * number) for number in range(200)]
    sensors, decoder = fixes(said)
    assert set(sensors) == {"line/GN"}
    assert not any("receivers" in text for _, text in decoder.notices)


def test_a_flood_of_talkers_does_not_mix_two_receivers() -> None:
    """What is known of two receivers holds when no more talkers are taken up."""
    flood = [(f"{a}{b}GGA{gga(0.0)[5:]}", 0.0, 0.0) for a in "ABCDEFGHIJK" for b in "ABCDEFGHIJK"]
    said = [(gga(second), second, shift_m) for second in range(10) for shift_m in (0.0, 150.0)]
    sensors, _ = fixes([*said[:4], *flood, *said[4:]])
    assert sensors[:4] + sensors[4 + len(flood) :] == ["line/GN", "line/GN@receiver2"] * 10


def test_noise_names_no_receivers_without_end() -> None:
    said = [(gga(0.0), 0.01 * number, 100.0 * number) for number in range(500)]
    assert len(set(fixes(said)[0])) <= 4


def savvycan(frames: Frames) -> bytes:
    head = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8,\n"
    return (head + "".join(
        f"{round((BEGAN_S + at_s) * 1e6)},{HEADING:08X},true,Rx,{bus[-1]},8,{data.hex(',').upper()},\n"
        for at_s, bus, data in frames
    )).encode()  # fmt: skip


def test_two_buses_of_a_table_are_two_compasses(tmp_path: Path) -> None:
    _, recording = from_log(tmp_path, savvycan(two_buses()))
    assert recording.series["heading_deg"].sources == ("line/4@channel0:127250",)
    assert recording.series["heading_deg"].value == pytest.approx([FIRST_DEG] * 4, abs=0.01)


def test_every_form_and_type_of_input_has_its_rules() -> None:
    """Listed for the documentation, each with who is a source in it and what its times are."""
    types = {name for source in get_args(AnySource) for name in get_args(get_type_hints(source)["type"])}
    forms = {*LINE_FORMS, *FILE_FORMS, "nmea0183", "actisense", "blf", "trc", "mf4"}
    lines = {"serial", "udp", "tcp", "file", "can_file", "own", "mavlink_tcp", "mavlink_serial"}  # of several forms
    assert {*INPUTS} == forms | (types - lines)
    assert all(each.identity and each.times for each in INPUTS.values())
