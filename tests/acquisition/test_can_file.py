"""CAN logs: what python-can's own writers wrote comes back, and so does every form of candump and canboat."""

from __future__ import annotations

import datetime as dt
import re
import time
from itertools import pairwise
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import FileSource
from seatrial.acquisition.core import process
from seatrial.acquisition.core.errors import InputError, SourceError
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.sources import make_source
from seatrial.acquisition.sources.log_file import LogFile
from seatrial.acquisition.sources.log_formats import LineReader
from seatrial.acquisition.tables.topics import log_format, read_log, read_table_or_log
from tests.conftest import nightly

START_NS = 1_779_062_280_249_713_000
MILLISECOND = 1_000_000


def can_file(path: Path) -> LogFile:
    source = make_source(FileSource(name="log", type="can_file", path=path, channels=()))
    assert isinstance(source, LogFile)
    return source


def read_all(path: Path) -> list[Frame]:
    """Every frame of a log, which must be wholly readable."""
    source = can_file(path)
    source.open()
    frames: list[Frame] = []
    while (some := source.read(0.0)) is not None:
        frames += some
    assert (source.unreadable, source.damage) == (0, "")
    source.close()
    return frames


def read_text(path: Path, *lines: str) -> list[Frame]:
    path.write_text("\n".join(lines) + "\n")
    return read_all(path)


def messages() -> list[can.Message]:
    """Frames of every kind that a classic bus has, 1 ms apart."""
    kinds = [
        {"arbitration_id": 0x18EEFF01, "data": bytes(range(8))},
        {"arbitration_id": 0x123, "data": b"\x01\x02", "is_extended_id": False},
        {"arbitration_id": 0x123, "data": b"", "is_extended_id": True},
        {"arbitration_id": 0x1F000123, "is_remote_frame": True},
    ] * 200
    return [
        can.Message(timestamp=(START_NS + n * MILLISECOND) / 1e9, channel=0, **kind) for n, kind in enumerate(kinds)
    ]


def flags_of(message: can.Message) -> FrameFlag:
    return FrameFlag(
        (not message.is_extended_id) * FrameFlag.STANDARD_ID + message.is_remote_frame * FrameFlag.REMOTE
    )


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc"])
def test_what_python_can_writes_comes_back(tmp_path: Path, suffix: str) -> None:
    """Under a name that says nothing, with times to the millisecond that the coarsest of them keeps."""
    with can.Logger(tmp_path / f"frames{suffix}") as write:
        for message in messages():
            write(message)
    path = (tmp_path / f"frames{suffix}").rename(tmp_path / "frames")
    frames = read_all(path)
    assert [(f.identifier, f.payload, f.flags) for f in frames] == [
        (m.arbitration_id, bytes(m.data), flags_of(m)) for m in messages()
    ]
    for number, frame in enumerate(frames):
        assert frame.stamped_ns == frame.received_ns == frame.monotonic_ns
        assert abs(frame.received_ns - (START_NS + number * MILLISECOND)) <= MILLISECOND


@pytest.mark.parametrize(("start", "is_said"), [(";$STARTTIME=46159.5", True), (";", False)])
def test_a_start_without_a_zone_is_said_to_be_taken_for_utc(start: str, is_said: bool, tmp_path: Path) -> None:
    """Programs write BLF and TRC in UTC or in local time, and neither form says which."""
    lines = [";$FILEVERSION=1.1", start, ";", "     1)      0.0  Rx     09F11204  8  00 11 27 FF 7F FF 7F FC"]
    (tmp_path / "a.trc").write_text("\n".join(lines) + "\n")
    source = can_file(tmp_path / "a.trc")
    source.open()
    assert source.read(0.0)
    assert ("no zone" in source.remark) == is_said
    assert ("no date" in source.remark) != is_said
    source.close()


def test_a_trace_of_pcan_comes_back(tmp_path: Path) -> None:
    """Its times start anew with the log, which python-can's writer does not date."""
    written = [message for message in messages() if not message.is_remote_frame]
    with can.TRCWriter(tmp_path / "frames.trc") as write:
        for message in written:
            write(message)
    frames = read_all(tmp_path / "frames.trc")
    assert [(f.identifier, f.payload, f.flags) for f in frames] == [
        (m.arbitration_id, bytes(m.data), flags_of(m)) for m in written
    ]
    took_s = written[-1].timestamp - written[0].timestamp
    assert frames[-1].received_ns - frames[0].received_ns == pytest.approx(took_s * 1e9, abs=2 * MILLISECOND)


CLAIM = "05 A0 BE 1C 00 A0 A0 C0"
DATA = bytes.fromhex(CLAIM)


@pytest.mark.parametrize(
    ("line", "identifier", "data", "flags"),
    [
        ("(1436509052.249713) can0 18EEFF01#05A0BE1C00A0A0C0", 0x18EEFF01, DATA, FrameFlag.NONE),
        ("(1436509052.249713) can0 123#05A0 R", 0x123, DATA[:2], FrameFlag.STANDARD_ID),
        ("(1436509052.249713) vcan_1 123#R8", 0x123, b"", FrameFlag.STANDARD_ID | FrameFlag.REMOTE),
        ("(1436509052.249713) can0 18EEFF01##105A0", 0x18EEFF01, DATA[:2], FrameFlag.NONE),
        ("(1436509052.249713) can0 20000004#0000000000000000", 4, bytes(8), FrameFlag.ERROR),
        (f"  can0  18EEFF01   [8]  {CLAIM}", 0x18EEFF01, DATA, FrameFlag.NONE),
        (
            f"(1436509052.249713)  can0  RX - -  18EEFF01   [8]  {CLAIM}   '........'",
            0x18EEFF01,
            DATA,
            FrameFlag.NONE,
        ),
        ("  can0  123   [2]  05 A0", 0x123, DATA[:2], FrameFlag.STANDARD_ID),
        ("  can0  123   [0]  remote request", 0x123, b"", FrameFlag.STANDARD_ID | FrameFlag.REMOTE),
        ("  can0  20000004   [8]  00 00 00 00 00 00 00 00   ERRORFRAME", 4, bytes(8), FrameFlag.ERROR),
        ("<0x18eeff01> [8] 05 a0 be 1c 00 a0 a0 c0 ", 0x18EEFF01, DATA, FrameFlag.NONE),
        ("2026-08-07T23:44:27.000Z,6,60928,1,255,8,05,a0,be,1c,00,a0,a0,c0", 0x18EEFF01, DATA, FrameFlag.NONE),
        ("2026-08-07-23:44:27.000,6,60928,1,35,8,05,a0,be,1c,00,a0,a0,c0", 0x18EE2301, DATA, FrameFlag.NONE),
        ("2026-08-07-23:44:27.000,2,127250,35,255,2,05,A0", 0x09F11223, DATA[:2], FrameFlag.NONE),
    ],
)
def test_every_form_of_a_line(tmp_path: Path, line: str, identifier: int, data: bytes, flags: FrameFlag) -> None:
    (frame,) = read_text(tmp_path / "log", "# a comment", "", line)
    assert (frame.identifier, frame.payload, frame.flags) == (identifier, data, flags)


@pytest.mark.parametrize(
    ("line", "stamped_ns"),
    [
        ("(1436509052.249713) can0 123#05A0", 1_436_509_052_249_713_000),
        ("(1436509052.249713) can0  123  [2]  05 A0", 1_436_509_052_249_713_000),
        ("(2015-07-10T06:17:32.249713Z) slcan0 123#05A0", 1_436_509_052_249_713_000),
        ("(2015-07-10 08:17:32.249713+02:00)  can0  123  [2]  05 A0", 1_436_509_052_249_713_000),
        ("2026-08-07T23:44:27.25Z,2,127250,35,255,2,05,A0", 1_786_146_267_250_000_000),
        ("2026-08-07-23:44:27,2,127250,35,255,2,05,A0", 1_786_146_267_000_000_000),
    ],
)
def test_the_time_of_a_log_is_the_frames(tmp_path: Path, line: str, stamped_ns: int) -> None:
    (frame,) = read_text(tmp_path / "log", line)
    assert frame.stamped_ns == frame.received_ns == frame.monotonic_ns == stamped_ns


@pytest.mark.parametrize(
    ("times", "expected_ms"),
    [
        (("0.1", "0.2", "0.5"), [0.0, 100.0, 400.0]),
        (("000.000000", "000.100000", "000.300000", "000.000001"), [0.0, 100.0, 400.0]),
        (("000.000000", "000.100000", "000.100000"), [0.0, 100.0, 200.0]),  # of frames as regular as a clock
    ],
)
def test_times_since_the_beginning_or_the_frame_before_keep_the_distances(
    tmp_path: Path, times: tuple[str, ...], expected_ms: list[float]
) -> None:
    frames = read_text(tmp_path / "log", *(f"({time}) can0 123#05" for time in times))
    assert {frame.stamped_ns for frame in frames} == {None}
    after_ms = [(frame.monotonic_ns - frames[0].monotonic_ns) / MILLISECOND for frame in frames]
    assert after_ms[:3] == pytest.approx(expected_ms, abs=1e-3)


def test_the_monotonic_time_never_falls(tmp_path: Path) -> None:
    """A log that was put together, or whose clock was set, tells its times all the same."""
    times = (1_436_509_052, 1_436_509_050, 1_436_509_053)
    frames = read_text(tmp_path / "log", *(f"({time}.0) can0 123#05" for time in times))
    assert [frame.received_ns // 10**9 for frame in frames] == list(times)
    assert [frame.monotonic_ns // 10**9 for frame in frames] == [times[0], times[0], times[2]]


def test_a_log_without_times_is_received_as_it_is_read(tmp_path: Path) -> None:
    frames = read_text(tmp_path / "log", *["  can0  123   [1]  05"] * 700)
    assert {frame.stamped_ns for frame in frames} == {None}
    assert all(later.monotonic_ns >= former.monotonic_ns for former, later in pairwise(frames))


def test_a_whole_message_stays_whole(tmp_path: Path) -> None:
    """What was put together already is told from a frame."""
    message = "2026-08-07T23:44:27.000Z,2,130578,{},255,12,ff,7f,ff,7f,a8,ff,bb,00,ff,7f,22,01"
    frames = read_text(tmp_path / "log", *(message.format(source) for source in (1, 2)))
    assert {frame.payload.hex() for frame in frames} == {"ff7fff7fa8ffbb00ff7f2201"}
    assert [frame.identifier for frame in frames] == [0x09FE1201, 0x09FE1202]
    assert {frame.flags for frame in frames} == {FrameFlag.WHOLE}


@pytest.mark.parametrize(
    "line",
    [
        "(1436509052.249713) can0 123#05A",
        "(14.36.5) can0 123#05A0",
        "(1436509052.249713) can0 1234#05A0",
        "  can0  123   [3]  05 A0",
        "2026-13-07T23:44:27.000Z,2,127250,35,255,2,05,A0",
        "2026-08-07T23:44:27.000Z,2,262400,35,255,2,05,A0",
        "2026-08-07T23:44:27.000Z,2,127250,35,255,3,05,A0",
        "2026-08-07T23:44:27.000Z,2,127250,35,256,2,05,A0",
        "2026-08-07T23:44:27.000Z,2,130323,35,255,1786" + ",05" * 1786,
        "rubbish",
    ],
)
def test_unreadable_lines_are_skipped_and_counted(tmp_path: Path, line: str) -> None:
    (tmp_path / "log").write_text(f"{line}\n(1436509052.249713) can0 123#05A0\n")
    source = can_file(tmp_path / "log")
    source.open()
    assert [frame.payload for frame in source.read(0.0) or []] == [DATA[:2]]
    assert source.read(0.0) is None
    assert source.unreadable == 1
    source.close()


def test_a_log_that_was_cut_off_gives_what_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "frames.blf"
    with can.Logger(path) as write:
        for message in messages() * 40:
            write(message)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    source, count = damaged(path)
    assert 0 < count < 32_000
    assert re.fullmatch(
        rf"the log is damaged \(it was [\d,]+ bytes long, [\d,]+ are left\); reading ended after {count:,} frames, "
        r"the last of 2026-05-1[\dT:.]+\+00:00",
        source.damage,
    )
    assert source.unreadable == 0


def damaged(path: Path) -> tuple[LogFile, int]:
    """A log that was read as far as it can be, and how many frames it gave."""
    source = can_file(path)
    source.open()
    count = 0
    while (frames := source.read(0.0)) is not None:
        count += len(frames)
    source.close()
    return source, count


def test_a_log_that_nobody_closed_says_when_its_end_is_missing(tmp_path: Path) -> None:
    """Its header tells no length then, but its last object has no end."""
    path = tmp_path / "frames.blf"
    with can.BLFWriter(path, compression_level=0) as write:
        for message in messages():
            write(message)
    written = bytearray(path.read_bytes()[:-1000])
    written[16:24] = bytes(8)  # the length, in the header
    path.write_bytes(written)
    source, count = damaged(path)
    assert 0 < count < 800
    assert source.damage.startswith("the log is damaged (its last object is cut off); reading ended after")


@pytest.mark.parametrize(
    "broken", ["9 9.0 DT 1 zz Rx - 2 00 00", "9 9.x DT 1 0123 Rx - 2 00 00", "9 9.0 DT 1 0123 Rx - 2 00 0"]
)
def test_a_broken_line_of_a_trace_costs_itself_alone(broken: str, tmp_path: Path) -> None:
    path = tmp_path / "frames.trc"
    with can.Logger(path) as write:
        for message in messages():
            if not message.is_remote_frame:
                write(message)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:400], f"{broken}\n", *lines[400:]]))
    source, count = damaged(path)
    assert (count, source.unreadable, source.damage) == (600, 1, "")
    path.write_text("".join([*lines, broken]))
    source, count = damaged(path)
    assert count == 600
    assert "its last line is cut off" in source.damage


# PEAK, "PCAN Trace Format", version 2.1: a line of each type; the last is of none that is there.
TRACE = """;$FILEVERSION=2.1
;$STARTTIME=46159.5000000000
;$COLUMNS=N,O,T,B,I,d,R,L,D
;   Start time: 17.05.2026 12:00:00.000.0
      1      1059.900 DT 1      0300 Rx -  7    00 00 00 00 04 00 00
      2      1298.945 ST 1           Rx -  4    00 00 00 08
      3      1299.945 ER 1      0004 Rx -  5    03 05 0F 01 04
      4      1323.201 EC 1           Rx -  2    02 02
      5      1334.416 FD 1  18EFC034 Rx -  9    01 02 03 04 05 06 07 08 09 0A 0B 0C
      6      1334.522 FB 2      0500 Rx -  8    01 02 03 04 05 06 07 08
      7      1334.531 RR 1      0100 Rx -  3
      8      1400.000 EV 1 User-defined event for bus 1
      9      1401.000 XX 1  09F11223 Tx -  8    01 02 03 04 05 06 07 08
"""


def test_trace_has_its_error_frames_and_counts_types_that_are_not_known(tmp_path: Path) -> None:
    (tmp_path / "frames.trc").write_text(TRACE)
    source = can_file(tmp_path / "frames.trc")
    source.open()
    frames = source.read(0.0) or []
    began_ns = 1_779_019_200 * 1_000_000_000
    assert [
        (frame.received_ns - began_ns, frame.identifier, frame.flags, len(frame.payload)) for frame in frames
    ] == [
        (1_059_900_000, 0x300, FrameFlag.STANDARD_ID, 7),
        (1_299_945_000, 0, FrameFlag.STANDARD_ID | FrameFlag.ERROR, 0),
        (1_334_416_000, 0x18EFC034, FrameFlag.NONE, 12),
        (1_334_522_000, 0x500, FrameFlag.STANDARD_ID, 8),
        (1_334_531_000, 0x100, FrameFlag.STANDARD_ID | FrameFlag.REMOTE, 0),
    ]
    assert source.unreadable == 1
    source.close()


def test_trace_of_a_version_that_is_not_known_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "frames.trc").write_text(TRACE.replace("=2.1", "=1.2"))
    with pytest.raises(SourceError, match=r"TRC of version 1\.2 is not read; save it as 2\.1"):
        can_file(tmp_path / "frames.trc").open()


@pytest.mark.parametrize(
    ("whole", "cut"),
    [
        ("(1779019200.100000) can0 09F11204#001127FF7FFF7FFC", "(1779019200.200000) can0 09F11204#001127FF"),
        ("17:33:21.107 R 09F11204 00 11 27 FF 7F FF 7F FC", "17:33:21.207 R 09F11204 00 11 27"),
    ],
)
def test_last_line_without_an_end_that_may_lack_bytes_is_told(whole: str, cut: str, tmp_path: Path) -> None:
    """Its form states no length: a frame of 4 bytes of 8 would look whole."""
    path = tmp_path / "frames.log"
    path.write_text(f"{whole}\n{cut}")
    source, count = damaged(path)
    assert count == 1
    assert "its last line is cut off" in source.damage
    path.write_text(f"{whole}\n{cut}\n")
    source, count = damaged(path)
    assert (count, source.damage) == (2, "")


def test_frames_before_a_clock_was_set_are_dated_by_the_moment_at_which_it_was(tmp_path: Path) -> None:
    """A computer without a battery begins in 1970."""
    times = [5.1, 6.1, 7.1, 1_779_019_200.1, 1_779_019_201.1]
    lines = [f"({time:017.6f}) can0 09F11204#001127FF7FFF7FFC" for time in times]
    (tmp_path / "frames.log").write_text("\n".join(lines) + "\n")
    source = can_file(tmp_path / "frames.log")
    source.open()
    ns = [frame.received_ns for frame in source.read(0.0) or []]
    assert np.diff(ns).tolist() == [10**9, 10**9, 0, 10**9]
    assert ns[-1] == 1_779_019_201_100_000_000
    assert "its clock was not set at first" in source.remark
    source.close()


def test_date_of_candump_without_a_zone_is_told_as_local(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Europe/Oslo")
    time.tzset()
    (tmp_path / "a.log").write_text(" (2026-05-17 14:00:00.100000)  can0  123   [2]  05 A0\n")
    source = can_file(tmp_path / "a.log")
    source.open()
    (frame,) = source.read(0.0) or []
    assert frame.received_ns == 1_779_019_200_100_000_000
    assert "this machine's local time" in source.remark
    source.close()
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(
    ("hours", "is_open"),
    [
        ("23:30:00 23:59:59 00:00:00 00:59:59 01:00:00 01:30:00", False),  # from before to after
        ("00:30:00 00:59:59 01:00:00 01:30:00", False),  # begins in the first of the two hours
        ("01:30:00 01:59:59 02:00:00 02:30:00", False),  # begins in the second
        ("00:30:00 00:45:00", True),
    ],
)
def test_hour_that_comes_twice_is_told_by_the_order_of_lines(
    hours: str, is_open: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In candump's local times; the second had been told as a clock that was set back, and dated an hour early."""
    monkeypatch.setenv("TZ", "Europe/Oslo")
    time.tzset()
    utc = [dt.datetime.fromisoformat(f"2025-10-25T{text}+00:00") for text in hours.split()]
    utc = [moment + dt.timedelta(days=moment.hour < 12) for moment in utc]
    local = [f" ({moment.astimezone():%Y-%m-%d %H:%M:%S}.000000)  can0  123   [2]  05 A0\n" for moment in utc]
    (tmp_path / "a.log").write_text("".join(local))
    source = can_file(tmp_path / "a.log")
    source.open()
    assert [frame.received_ns for frame in source.read(0.0) or []] == [
        int(moment.timestamp()) * 10**9 for moment in utc
    ]
    assert ("comes twice" in source.remark) == is_open
    assert "go back" not in source.remark
    source.close()
    monkeypatch.undo()
    time.tzset()


def test_a_line_that_is_cut_off_is_no_frame(tmp_path: Path) -> None:
    path = tmp_path / "frames.asc"
    with can.ASCWriter(path) as write:
        for message in messages()[:9]:
            write(message)
    lines = [line for line in path.read_text().splitlines() if " Rx " in line or not line.startswith("End")]
    while " 06 " not in lines[-1]:
        lines.pop()
    path.write_text("\n".join(lines)[: -len(lines[-1])] + lines[-1].split(" 03 ")[0])
    source, count = damaged(path)
    assert count == 8
    assert "its last line is cut off" in source.damage
    assert source.unreadable == 1


def test_broken_lines_of_a_trace_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "frames.trc"
    with can.TRCWriter(path) as write:
        for message in messages()[:3]:
            write(message)
    path.write_text(path.read_text() + "rubbish\n      9      9.000 DT 1 98EEFF01 Rx - 1 00\n")
    source = can_file(path)
    source.open()
    assert len(source.read(0.0) or []) == 3
    assert source.read(0.0) is None
    assert source.unreadable == 2
    source.close()


@pytest.mark.parametrize("kind", [can.TRCWriter, can.BLFWriter, can.ASCWriter])
def test_buses_are_called_as_in_the_file(tmp_path: Path, kind: type[can.Listener]) -> None:
    """python-can counts its channels from 0, the files theirs from 1."""
    path = tmp_path / f"frames.{kind.__name__[:3].lower()}"
    with kind(path) as write:
        for number, message in enumerate(messages()[:6]):
            message.channel = number % 2
            write(message)
    source = can_file(path)
    source.open()
    assert {frame.sender for frame in source.read(0.0) or []} == {"channel1", "channel2"}
    source.close()


def test_frames_in_a_measurement_are_those_of_the_bus(tmp_path: Path) -> None:
    """MF4, as CANedge writes it; `seatrial import` of it names the command that takes frames."""
    path, sent = tmp_path / "bus.mf4", messages()[:6]
    writer = process.import_mf4_with_asammdf().MF4Writer(path)
    for message in sent:
        writer(message)
    writer.stop()
    source = can_file(path)
    source.open()
    frames = source.read(0.0) or []
    assert [(frame.identifier, frame.payload) for frame in frames] == [
        (message.arbitration_id, bytes(message.data)) for message in sent
    ]
    assert [frame.received_ns for frame in frames] == pytest.approx(
        [round(message.timestamp * 1e9) for message in sent], abs=2_000
    )
    source.close()
    assert "this machine's local time" in source.remark
    with pytest.raises(InputError, match="frames of a bus, which `seatrial record` takes"):
        read_table_or_log(path)


@pytest.mark.parametrize("count", [12, *nightly(1)])
def test_signals_beside_the_frames_of_a_measurement_are_said(tmp_path: Path, count: int) -> None:
    """How many and which; and the command that is named brings them."""
    from asammdf import MDF, Signal

    frames, path = tmp_path / "frames.mf4", tmp_path / "both.mf4"
    writer = process.import_mf4_with_asammdf().MF4Writer(frames)
    for message in messages()[:6]:
        writer(message)
    writer.stop()
    times = np.arange(20.0)
    with MDF(frames) as measurement:
        measurement.append([Signal(times, times, name=f"shaft {number}", unit="rpm") for number in range(count)])
        measurement.save(path)
    source = can_file(path)
    source.open()
    assert len(source.read(0.0) or []) == 6
    source.close()
    assert f"{count} signal" in source.remark
    assert "shaft 0" in source.remark
    assert ("and 2 more" in source.remark) == (count > 10)
    assert "`seatrial import`" in source.remark
    kind = log_format(path)
    assert kind is not None
    names = {name for topic in read_log(path, kind).topics for name in topic.fields}
    assert names == {f"shaft {number}" for number in range(count)}


@pytest.mark.parametrize("content", [b"time,heading\n1,2\n", b"LOGGnonsense", b"\x00\xff" * 1000, b"\x89PNG"])
def test_what_is_no_log_says_so(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "log").write_bytes(content)
    with pytest.raises(SourceError, match=r"source 'log': file .* cannot be opened: .*; correct `path`"):
        can_file(tmp_path / "log").open()


def test_a_log_that_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="No such file"):
        can_file(tmp_path / "log").open()
    with pytest.raises(SourceError, match="not open"):
        can_file(tmp_path / "log").read(0.0)


def test_an_empty_log_ends(tmp_path: Path) -> None:
    (tmp_path / "log").touch()
    assert read_all(tmp_path / "log") == []


ALPHABET = st.sampled_from("()<>[]#,. :'-x0123456789abcdefABCDEFRTcan\u0661")


@given(st.text(ALPHABET, max_size=60) | st.text(max_size=60))
def test_no_line_raises(line: str) -> None:
    reader = LineReader()
    for prefix in ("", "(1436509052.249713) can0 ", "2026-08-07T23:44:27.000Z,2,"):
        entry = reader.entry((prefix + line).encode())
        assert entry is None or (entry.identifier < 2**29 and len(entry.payload) <= 512)


def test_times_that_go_back_are_told(tmp_path: Path) -> None:
    """A logger's clock that was set back, by an hour or five seconds; a late line is none."""
    for back_s, told in ((3600.0, True), (5.0, True), (0.5, False)):
        times = [1.779e9 + at for at in range(10)] + [1.779e9 + 10 - back_s + at for at in range(10)]
        path = tmp_path / f"back{back_s}"
        path.write_text("".join(f"({at:.6f}) can0 123#0102\n" for at in times))
        source, count = damaged(path)
        assert count == 20
        assert ("its times go back by" in source.remark) == told
