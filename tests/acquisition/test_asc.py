"""Vector's ASC: what stamps count from, what a line holds, and that nothing is passed over without a word."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path

import can
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Frame, FrameFlag
from seatrial.acquisition.sources.log_file import LogFile
from seatrial.acquisition.tables.table_files import read_raw_table
from tests.acquisition.test_can_file import can_file, read_text

DATE = "date Sun May 17 12:00:00.000 pm 2026"
BASE = "base hex  timestamps absolute"
FRAME = "09F11204x       Rx   d 8 00 11 27 FF 7F FF 7F FC"
DATA = bytes.fromhex("001127FF7FFF7FFC")


@pytest.fixture(autouse=True)
def _here_is_utc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()


def seconds(frames: list[Frame], since: datetime = datetime(2026, 5, 17, 12, tzinfo=UTC)) -> list[float]:
    """Times of frames [s] since a date."""
    began_ns = int(since.timestamp()) * 10**9
    return [(frame.received_ns - began_ns) / 1e9 for frame in frames]


def opened(path: Path, *lines: str) -> tuple[LogFile, list[Frame]]:
    path.write_text("\n".join(lines) + "\n")
    source = can_file(path)
    source.open()
    frames = list[Frame]()
    while (some := source.read(0.0)) is not None:
        frames += some
    source.close()
    return source, frames


@pytest.mark.parametrize(
    "head",
    [
        [DATE, BASE, "internal events logged"],
        [DATE, BASE, "no internal events logged", "// version 8.1.0"],
        [DATE, BASE],
        [DATE, "base hex"],
        ["base hex  timestamps absolute", DATE],
        [DATE, BASE, "internal events logged", "Begin Triggerblock Sun May 17 12:00:00.000 pm 2026"],
        ["date Son Mai 17 12:00:00.000 2026", BASE],
        ["date 17.05.2026 12:00:00.000", BASE],
        ["date 2026-05-17 12:00:00", BASE],
    ],
)
def test_every_frame_comes_whatever_the_header_leaves_out(head: list[str], tmp_path: Path) -> None:
    frames = read_text(tmp_path / "a", *head, *(f"   {at}.100000 1  {FRAME}" for at in range(4)))
    assert [frame.payload for frame in frames] == [DATA] * 4
    assert seconds(frames) == pytest.approx([0.1, 1.1, 2.1, 3.1])


@pytest.mark.parametrize("steps", [[0.5, 0.5, 0.5], [0.0, 1.0, 0.25], [100.0, 3.0, 7200.0]])
def test_relative_stamps_count_from_the_line_before(steps: list[float], tmp_path: Path) -> None:
    """An event between two frames is a line, too."""
    lines = [f"   {step:.6f} 1  {FRAME}" for step in steps]
    head = [DATE, "base hex  timestamps relative", "no internal events logged"]
    event = "   0.250000 1  Statistic: D 2 R 0 XD 0 XR 0 E 0 O 0 B 3.46%"
    frames = read_text(tmp_path / "a", *head, lines[0], event, *lines[1:])
    expected = [steps[0]] + [steps[0] + 0.25 + sum(steps[1 : number + 1]) for number in range(1, len(steps))]
    assert seconds(frames) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("date", "first", "began"),
    [
        ("date Mon Dec 6 11:21:13 am 2021", 40_874.8082, 40_874.8082),
        ("date Mon Dec 6 11:21:13 pm 2021", 84_073.5, 84_073.5),
        ("date Mon Dec 6 11:58:00 pm 2021", 10.0, 86_290.0),  # 10 s after the header
        ("date Mon Dec 6 11:21:13 am 2021", 7_200.0, 48_073.0),  # two hours after it: a trigger
    ],
)
def test_times_of_day_are_told_from_times_since_the_header(
    date: str, first: float, began: float, tmp_path: Path
) -> None:
    source, frames = opened(tmp_path / "a", date, "base hex  no internal events logged", f"{first:.4f} 1 {FRAME}")
    assert seconds(frames, datetime(2021, 12, 6, tzinfo=UTC)) == pytest.approx([began])
    assert ("times of day" in source.remark) == (first == began)


def test_times_of_day_go_on_behind_midnight(tmp_path: Path) -> None:
    """Whether they begin again there or count on."""
    for after in (1, 86_401):
        lines = [f"   {at}.100000 1  {FRAME}" for at in (86_391, 86_399, after)]
        source, frames = opened(tmp_path / "a", "date Sun May 17 11:59:50 pm 2026", BASE, *lines)
        assert seconds(frames, datetime(2026, 5, 17, tzinfo=UTC)) == pytest.approx([86_391.1, 86_399.1, 86_401.1])
        assert "go back" not in source.remark


def test_zone_of_the_header_is_told_as_it_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """This machine's, unless the header names one."""
    monkeypatch.setenv("TZ", "Europe/Oslo")
    time.tzset()
    source, frames = opened(tmp_path / "a", DATE, BASE, f"   0.100000 1  {FRAME}")
    assert seconds(frames) == pytest.approx([0.1 - 7200.0])
    assert "this machine's local time" in source.remark
    assert "UTC" not in source.remark
    assert "comes twice" not in source.remark
    source, _ = opened(tmp_path / "b", "date Sun Oct 26 02:30:00.000 am 2025", BASE, f"   0.100000 1  {FRAME}")
    assert "comes twice" in source.remark


@pytest.mark.parametrize("counts_on", [True, False])
def test_stamps_of_a_later_block_count_from_its_date_or_from_the_header(counts_on: bool, tmp_path: Path) -> None:
    """Ten minutes after the first block: 600 s where the measurement went on, 0 where it began again."""
    block, since = "Begin Triggerblock Sun May 17 12:{:02d}:00.000 pm 2026", 600 if counts_on else 0
    lines = [DATE, BASE, block.format(0), f"   0.100000 1  {FRAME}", "End TriggerBlock", block.format(10)]
    frames = read_text(tmp_path / "a", *lines, *(f"   {since + at}.100000 1  {FRAME}" for at in range(2)))
    assert seconds(frames) == pytest.approx([0.1, 600.1, 601.1])


def test_what_is_no_frame_is_counted_unless_it_is_known_to_be_none(tmp_path: Path) -> None:
    lines = [
        "   0.100000 1  " + FRAME,
        "   0.200000 1  Statistic: D 2 R 0 XD 0 XR 0 E 0 O 0 B 3.46%",
        "   0.300000 CAN 1 Status:chip status error active",
        "   0.400000 1  J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6 60 3B D1 40 1F DE 80 45 B1",
        "   0.500000 1  18EEFF01x Rx d zz 05",
        "rubbish",
        "  -0.500000 1  " + FRAME,
        "   0.600000 2  " + FRAME,
        "End TriggerBlock",
    ]
    source, frames = opened(tmp_path / "a", DATE, BASE, *lines)
    assert seconds(frames) == pytest.approx([0.1, -0.5, 0.6])
    assert source.unreadable == 3
    assert source.damage == ""


def test_classical_flexible_remote_and_error_frames(tmp_path: Path) -> None:
    frames = read_text(
        tmp_path / "a",
        DATE,
        BASE,
        "0.1 1  123             Rx   d 2 01 02  Length = 0 BitCount = 64 ID = 291",
        "0.2 1  1F000123x       Tx   r",
        "0.3 CANFD   1 Rx        18EEFF01x                                   1 0 a 16 "
        "00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f   102203  133   303000 e0006659 46500250 4b140250",
        "0.4 1  ErrorFrame",
    )
    assert [(frame.identifier, frame.payload, frame.flags) for frame in frames] == [
        (0x123, b"\x01\x02", FrameFlag.STANDARD_ID),
        (0x1F000123, b"", FrameFlag.REMOTE),
        (0x18EEFF01, bytes(range(16)), FrameFlag.NONE),
        (0, b"", FrameFlag.STANDARD_ID | FrameFlag.ERROR),
    ]


def test_decimal_numbers(tmp_path: Path) -> None:
    frames = read_text(tmp_path / "a", DATE, "base dec timestamps absolute", "0.1 1 166793732x Rx d 3 0 255 17")
    assert [(frame.identifier, frame.payload) for frame in frames] == [(166_793_732, b"\x00\xff\x11")]


def test_python_can_reads_the_same_of_what_it_writes(tmp_path: Path) -> None:
    path = tmp_path / "frames.asc"
    with can.ASCWriter(path) as log:
        for number in range(300):
            extended = bool(number % 3)
            identifier = 0x18EEFF00 + number % 200 if extended else number
            data = bytes([number % 256] * (number % 9))
            log(can.Message(timestamp=1.8e9 + number / 100, arbitration_id=identifier, is_extended_id=extended,
                            data=data, channel=number % 2))  # fmt: skip
    theirs = list(can.ASCReader(path, relative_timestamp=False))
    _, ours = opened(tmp_path / "copy", path.read_text())
    assert [(f.identifier, f.payload) for f in ours] == [(m.arbitration_id, bytes(m.data)) for m in theirs]
    assert [f.received_ns / 1e9 for f in ours] == pytest.approx([m.timestamp for m in theirs], abs=1e-6)


@pytest.mark.parametrize("head", [[DATE, BASE], [BASE, DATE]])
def test_import_names_the_command_that_takes_frames(head: list[str], tmp_path: Path) -> None:
    (tmp_path / "bus.asc").write_text("\n".join([*head, f"   0.1 1  {FRAME}", ""]))
    with pytest.raises(InputError, match=r"holds frames of a CAN bus.*seatrial record"):
        read_raw_table(tmp_path / "bus.asc")
