"""Telemetry logs: pymavlink's own reader is the oracle; a log may be damaged and cut off anywhere."""

from __future__ import annotations

import os
import random
from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from seatrial.acquisition.config.sources import MavlinkFileSource
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.quantities import DEG_PER_RAD
from seatrial.acquisition.core.trial import Frame, Sample
from seatrial.acquisition.protocols import make_decoders
from seatrial.acquisition.protocols.mavlink import Fault, PacketCutter, has_valid_checksum, parse_header
from seatrial.acquisition.sources import make_source
from tests.acquisition.test_mavlink import UTC_US
from tests.acquisition.test_mavlink_packets import broken, stream
from tests.conftest import nightly

PACKETS = stream(200, 7)
TIMES_US = [UTC_US + 20_000 * number for number in range(len(PACKETS))]
ENTRIES = [time_us.to_bytes(8, "big") + packet for time_us, packet in zip(TIMES_US, PACKETS, strict=True)]


def section(path: Path) -> MavlinkFileSource:
    return MavlinkFileSource(name="log", type="mavlink_file", channels=(), path=path)


def frames_of(path: Path) -> list[Frame]:
    source = make_source(section(path))
    source.open()
    frames: list[Frame] = []
    while (more := source.read(0.0)) is not None:
        assert len(more) <= 300
        frames += more
    assert source.read(0.0) is None
    source.close()
    return frames


def sound_packets(frames: list[Frame]) -> list[bytes]:
    """What a decoder would take from the frames, and its count of the rest."""
    cutter = PacketCutter(complete=True)
    pieces = [piece for frame in frames for piece in cutter.push(frame.payload)]
    return [piece for piece in pieces if not isinstance(piece, Fault)]


def check_times(frames: list[Frame]) -> None:
    assert all(frame.received_ns == frame.stamped_ns for frame in frames)
    assert all(a.monotonic_ns <= b.monotonic_ns for a, b in pairwise(frames))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "x.tlog"


def test_each_packet_is_a_frame_with_the_times_of_the_log(log: Path) -> None:
    log.write_bytes(b"".join(ENTRIES))
    frames = frames_of(log)
    assert [frame.payload for frame in frames] == PACKETS
    assert [frame.stamped_ns for frame in frames] == [time_us * 1000 for time_us in TIMES_US]
    assert [frame.monotonic_ns for frame in frames] == [frame.received_ns for frame in frames]


def test_one_damaged_time_moves_one_packet_only(log: Path) -> None:
    """Years ahead, for one packet, is damage; its packet has the time of the one before."""
    damaged = [*ENTRIES[:100], (UTC_US + 2**50).to_bytes(8, "big") + PACKETS[100], *ENTRIES[101:]]
    log.write_bytes(b"".join(damaged))
    frames = frames_of(log)
    expected = [time_us * 1000 for time_us in [*TIMES_US[:100], TIMES_US[99], *TIMES_US[101:]]]
    assert [frame.received_ns for frame in frames] == expected


def test_a_clock_that_is_set_during_the_log_is_believed(log: Path) -> None:
    """Forwards by a year; and back again, which the monotonic clock does not follow."""
    year_us = 365 * 86_400 * 10**6
    shifted = [(time_us + year_us * (50 <= n < 100)).to_bytes(8, "big") for n, time_us in enumerate(TIMES_US)]
    log.write_bytes(b"".join(time + packet for time, packet in zip(shifted, PACKETS, strict=True)))
    frames = frames_of(log)
    assert [frame.received_ns for frame in frames] == [int.from_bytes(time, "big") * 1000 for time in shifted]
    check_times(frames)


@pytest.mark.parametrize("seed", range(10))
def test_damage_costs_no_more_than_itself_and_every_byte_is_kept(log: Path, seed: int) -> None:
    """Bits flipped, bytes lost and bytes added, also in the times and lengths."""
    generator = random.Random(seed)
    damaged = {generator.randrange(len(ENTRIES)) for _ in range(40)}
    entries = broken(ENTRIES, damaged, generator, 300)
    log.write_bytes(b"".join(entries))
    frames = frames_of(log)
    untouched = [each for n, each in enumerate(PACKETS) if n not in damaged and has_valid_checksum(each)]
    assert [each for each in sound_packets(frames) if each in set(untouched)] == untouched
    without_times = sum(map(len, entries)) - sum(len(frame.payload) for frame in frames)
    assert without_times % 8 == 0
    assert 0 <= without_times <= 8 * len(frames)
    check_times(frames)


@given(st.binary(max_size=400), st.integers(0, 5), st.binary(max_size=400))
@settings(max_examples=100)
def test_no_bytes_raise(tmp_path_factory: pytest.TempPathFactory, before: bytes, count: int, after: bytes) -> None:
    log = tmp_path_factory.mktemp("log") / "x.tlog"
    log.write_bytes(before + b"".join(ENTRIES[:count]) + after)
    frames = frames_of(log)
    check_times(frames)
    (decoder,) = make_decoders(section(log))
    for frame in frames:
        decoder.decode(frame)


def test_a_long_stretch_of_rubbish_is_kept_in_pieces(log: Path) -> None:
    rubbish = random.Random(1).randbytes(200_000)
    log.write_bytes(rubbish + b"".join(ENTRIES))
    frames = frames_of(log)
    assert [frame.payload for frame in frames[-200:]] == PACKETS
    assert b"".join(frame.payload for frame in frames[:-200]) == rubbish
    assert max(len(frame.payload) for frame in frames) < 70_000


def test_a_log_that_is_missing_or_closed_says_so(log: Path) -> None:
    source = make_source(section(log))
    with pytest.raises(SourceError, match=r"x\.tlog cannot be opened.*correct `path`"):
        source.open()
    with pytest.raises(SourceError, match="is not open"):
        source.read(0.0)


# ---- a real log of an underwater vehicle


UNSET_US = {"1970": 100_000_000, "2000": 946_684_800_000_000}


def system_time(unix_us: int) -> bytes:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    return bytes(dialect.MAVLink_system_time_message(unix_us, 1234).pack(link))


def heartbeat() -> bytes:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    return bytes(dialect.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3).pack(link))


def opened(path: Path, entries: list[tuple[int, bytes]], changed_s: float = 1.7e9) -> tuple[list[Frame], str]:
    """The frames of a log of times [us] and packets, and what is said of its times."""
    path.write_bytes(b"".join(time_us.to_bytes(8, "big") + packet for time_us, packet in entries))
    os.utime(path, (changed_s, changed_s))
    source = make_source(section(path))
    source.open()
    frames: list[Frame] = []
    while (more := source.read(0.0)) is not None:
        frames += more
    remark = str(getattr(source, "remark", ""))
    source.close()
    return frames, remark


@pytest.mark.parametrize("unset", list(UNSET_US))
@pytest.mark.parametrize("period_us", [20_000, 1_000_000])
def test_a_clock_that_was_not_set_keeps_the_distances(log: Path, unset: str, period_us: int) -> None:
    """The date is that of the file's last change, which is the log's end, and this is said."""
    times = [UNSET_US[unset] + period_us * number for number in range(50)]
    frames, remark = opened(log, [(time_us, heartbeat()) for time_us in times])
    assert [frame.received_ns for frame in frames] == [
        round(1.7e9) * 10**9 - (times[-1] - time_us) * 1000 for time_us in times
    ]
    assert all(frame.received_ns == frame.monotonic_ns for frame in frames)
    assert "clock of the log was not set" in remark
    assert "file's last change" in remark


@pytest.mark.parametrize("unset", list(UNSET_US))
@pytest.mark.parametrize("first", [0, 7])
def test_the_date_is_that_of_system_time_where_a_packet_states_it(log: Path, unset: str, first: int) -> None:
    """Before a receiver knows the time, an autopilot sends zero: that is no date."""
    entries = [(UNSET_US[unset] + 10**6 * number, heartbeat()) for number in range(20)]
    entries = [each for time_us, packet in entries for each in ((time_us, packet), (time_us, system_time(0)))]
    entries[2 * first + 1] = entries[2 * first][0], system_time(UTC_US)
    frames, remark = opened(log, entries)
    assert frames[2 * first].received_ns == UTC_US * 1000
    assert frames[-1].received_ns - frames[0].received_ns == 19 * 10**9
    assert "SYSTEM_TIME" in remark


def test_a_clock_that_is_set_later_dates_what_came_before(log: Path) -> None:
    before = [(UNSET_US["1970"] + 10**6 * number, heartbeat()) for number in range(10)]
    after = [(UTC_US + 10**6 * number, heartbeat()) for number in range(10)]
    frames, remark = opened(log, before + after)
    assert [frame.received_ns for frame in frames[10:]] == [time_us * 1000 for time_us, _ in after]
    assert frames[9].received_ns - frames[0].received_ns == 9 * 10**9
    assert frames[9].received_ns == frames[10].received_ns
    assert "was set later" in remark


@pytest.mark.parametrize("step_s", [-3600, 86_400, 90])
def test_a_step_of_a_clock_within_the_log_is_told(log: Path, step_s: int) -> None:
    steps_us = [step_s * 10**6 * (number >= 10) for number in range(20)]
    entries = [(UTC_US + 10**6 * number + steps_us[number], heartbeat()) for number in range(20)]
    _, remark = opened(log, entries)
    assert f"set by {step_s + 1:+,.0f} s" in remark
    assert opened(log, entries[:10])[1] == ""


@pytest.fixture(scope="module")
def real_log(shared_data: Path) -> Path:
    return shared_data / "mavlink" / "ardusub_small.tlog"


@pytest.fixture(scope="module")
def theirs(real_log: Path) -> list[Any]:
    """Every message and bad data by pymavlink's reader of logs."""
    reader, messages = mavutil.mavlogfile(os.fspath(real_log)), []
    while (message := reader.recv_msg()) is not None:
        messages.append(message)
    reader.close()
    return messages


@pytest.fixture(scope="module")
def ours(real_log: Path) -> list[Frame]:
    return frames_of(real_log)


@pytest.mark.shared
def test_the_same_packets_and_times_as_pymavlink(theirs: list[Any], ours: list[Frame]) -> None:
    assert [frame.payload for frame in ours] == [
        bytes(each.data if each.get_type() == "BAD_DATA" else each.get_msgbuf()) for each in theirs
    ]
    assert [frame.received_ns / 1e9 for frame in ours] == pytest.approx([each._timestamp for each in theirs])
    counts = Counter(each.get_msgId() for each in theirs if each.get_type() != "BAD_DATA")
    assert Counter(parse_header(packet).message_id for packet in sound_packets(ours)) == counts


@pytest.mark.shared
def test_the_same_values_as_pymavlink(real_log: Path, theirs: list[Any], ours: list[Frame]) -> None:
    """Every value of the vehicle's own messages, in order; bad data counted and none of it passed on."""
    (decoder,) = make_decoders(section(real_log))
    got: dict[tuple[str, str], list[float]] = defaultdict(list)
    for frame in ours:
        for group in decoder.decode(frame):
            for sample in group:
                got[sample.source.removeprefix("log/1:"), sample.quantity].append(sample.value)
    own = [each for each in theirs if each.get_srcSystem() == 1]
    expected: dict[tuple[str, str], list[float]] = defaultdict(list)
    for message in own:
        for quantity, value in _expected(message):
            expected[message.get_type(), quantity].append(value)
    assert len(expected) == 15
    assert {key: series for key, series in got.items() if key[0] != "GPS_GLOBAL_ORIGIN"} == {
        key: pytest.approx(series) for key, series in expected.items()
    }
    bad = sum(each.get_type() == "BAD_DATA" for each in theirs)
    assert (bad, decoder.refused["bad data"]) == (4, 4)
    assert decoder.refused["another system"] == sum(
        each.get_srcSystem() != 1 for each in theirs if each.get_type() != "BAD_DATA"
    )
    assert decoder.refused["no fix"] == sum(each.get_type() == "GPS_RAW_INT" and each.fix_type < 3 for each in own)


def _expected(message: Any) -> list[tuple[str, float]]:
    match message.get_type():
        case "ATTITUDE":
            names = {"heading_deg": "yaw", "yaw_rate_dps": "yawspeed", "roll_deg": "roll", "pitch_deg": "pitch"}
            return [(quantity, getattr(message, name) * DEG_PER_RAD) for quantity, name in names.items()]
        case "GLOBAL_POSITION_INT":
            moving = [("velocity_north_mps", message.vx / 100), ("velocity_east_mps", message.vy / 100)]
            fix = [("latitude_deg", message.lat / 1e7), ("longitude_deg", message.lon / 1e7)]
            return [*moving, ("heading_deg", message.hdg / 100), *(fix if message.lat or message.lon else [])]
        case "LOCAL_POSITION_NED":
            return [("velocity_north_mps", message.vx), ("velocity_east_mps", message.vy)]
        case "GPS_RAW_INT" if message.fix_type >= 3:
            fix = [("latitude_deg", message.lat / 1e7), ("longitude_deg", message.lon / 1e7)]
            return [
                *fix,
                ("speed_over_ground_mps", message.vel / 100),
                ("course_over_ground_deg", message.cog / 100),
            ]
    return []


@pytest.mark.shared
def test_local_and_global_positions_of_the_autopilot_agree(real_log: Path, ours: list[Frame]) -> None:
    """The same estimate told in metres from an origin and in degrees, within the step of 1e-7 degrees."""
    (decoder,) = make_decoders(section(real_log))
    last: dict[str, dict[str, Sample]] = {}
    differences = []
    for frame in ours:
        for group in decoder.decode(frame):
            label = group[0].source.rpartition(":")[2]
            last[label] = {sample.quantity: sample for sample in group}
            pair = [last.get(name, {}).get("latitude_deg") for name in ("GPS_GLOBAL_ORIGIN", "GLOBAL_POSITION_INT")]
            if label == "GPS_GLOBAL_ORIGIN" and None not in pair:
                local, world = (sample for sample in pair if sample is not None)
                differences.append(abs(local.value - world.value))
    assert len(differences) > 100
    assert max(differences) < 2e-6


@pytest.mark.shared
@pytest.mark.parametrize("places", [75, *nightly(300)])
def test_a_log_that_is_cut_off_anywhere_gives_what_was_before(
    log: Path, real_log: Path, ours: list[Frame], places: int
) -> None:
    """At places in the first 25 kB, where the bad data is; the packet that is cut is no packet."""
    data = real_log.read_bytes()[:25_000]
    generator = random.Random(1)
    ends, end = [], 0
    for frame in ours:
        end += 8 + len(frame.payload)
        ends.append(end)
    for _ in range(places):
        cut = generator.randrange(len(data))
        log.write_bytes(data[:cut])
        whole = sum(each <= cut for each in ends)
        frames = frames_of(log)
        assert [frame.payload for frame in frames[:whole]] == [frame.payload for frame in ours[:whole]]
        assert sound_packets(frames) == sound_packets(ours[:whole])
        assert frames[whole:] == [] or len(frames) == whole + 1


@pytest.mark.shared
def test_no_value_passes_500_flipped_bits(log: Path, real_log: Path, theirs: list[Any]) -> None:
    """What passes is what was sent: each checksum that holds belongs to a packet of the original."""
    generator, data = random.Random(1), bytearray(real_log.read_bytes()[:200_000])
    for _ in range(500):
        data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
    log.write_bytes(data)
    original = {bytes(each.get_msgbuf()) for each in theirs if each.get_type() != "BAD_DATA"}
    got = sound_packets(frames_of(log))
    assert len(got) > 3000
    assert all(packet in original for packet in got)
