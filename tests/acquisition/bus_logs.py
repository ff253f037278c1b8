"""One bus, written down as each gateway and logger does: writers made from the makers' public descriptions.

They share nothing with the readers. The bus runs through a midnight, two full minutes and a turn of 16-bit clocks.
"""

from __future__ import annotations

import base64
import datetime as dt
import struct
from collections.abc import Callable
from functools import reduce
from math import radians
from operator import xor
from typing import NamedTuple

from tests.acquisition.can_frames import fast_parts, gnss, identifier_of

SECOND, MILLISECOND = 1_000_000_000, 1_000_000
START_NS = int(dt.datetime(2026, 8, 7, 23, 58, 31, 250_000, dt.UTC).timestamp() * 1000) * MILLISECOND
DURATION_S = 150


class Message(NamedTuple):
    """A whole message; ``time_ns`` is when its last frame came."""

    time_ns: int
    priority: int
    group: int
    source: int
    payload: bytes

    @property
    def identifier(self) -> int:
        return identifier_of(self.group, self.source, self.priority)


class BusFrame(NamedTuple):
    time_ns: int
    identifier: int
    payload: bytes


def angle(degrees: float) -> int:
    return round(radians(degrees % 360) * 1e4)


def bus() -> tuple[list[BusFrame], list[Message]]:
    """Heading, rate of turn, positions of both kinds, wind and the time, once a second and never at once."""
    messages, frames = [], []
    for second in range(DURATION_S):
        now_ns = START_NS + second * SECOND
        days, of_day_ns = divmod(now_ns, 86_400 * SECOND)
        said = [
            (3, 126992, 5, struct.pack("<BBHI", second, 0xF0, days, of_day_ns // 100_000)),
            (2, 127250, 35, struct.pack("<BHhhB", second, angle(3.0 * second), 0x7FFF, 0x7FFF, 0xFC)),
            (2, 127251, 35, struct.pack("<BiBH", second, round(radians(0.01 * second) / 3.125e-8), 0xFF, 0xFFFF)),
            (2, 129025, 3, struct.pack("<ii", 634_000_000 + 100 * second, 104_000_000)),
            (3, 129029, 3, gnss(1, 63.4 + 1e-5 * second)),
            (2, 130306, 8, struct.pack("<BHHBH", second, 500 + second, angle(90.0 + second), 0xFA, 0xFFFF)),
        ]
        for place, (priority, group, source, payload) in enumerate(said):
            at_ns = now_ns + place * 16 * MILLISECOND
            parts = [payload] if len(payload) == 8 else fast_parts(payload, second % 8)
            identifier = identifier_of(group, source, priority)
            frames += [BusFrame(at_ns + n * MILLISECOND, identifier, part) for n, part in enumerate(parts)]
            messages.append(Message(frames[-1].time_ns, priority, group, source, payload))
    return frames, messages


FRAMES, MESSAGES = bus()


def when(time_ns: int, digits: int = 3) -> tuple[str, str]:
    """Date and time of day in UTC, with so many digits behind the seconds."""
    seconds, rest = divmod(time_ns, SECOND)
    moment = dt.datetime.fromtimestamp(seconds, dt.UTC)
    return f"{moment:%Y-%m-%d}", f"{moment:%H:%M:%S}.{rest:09d}"[: 9 + digits]


def spaced(payload: bytes) -> str:
    return payload.hex(" ").upper()


def summed(body: str) -> str:
    return f"{body}*{reduce(xor, body[1:].encode()):02X}"


def text(lines: list[str], end: str = "\r\n") -> bytes:
    return "".join(line + end for line in lines).encode()


def candump_log() -> bytes:
    return text(
        [f"({f.time_ns / 1e9:.6f}) can0 {f.identifier:08X}#{f.payload.hex().upper()}" for f in FRAMES], "\n"
    )


def savvycan() -> bytes:
    head = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"
    lines = [
        f"{f.time_ns // 1000},{f.identifier:08X},true,Rx,0,{len(f.payload)},{spaced(f.payload).replace(' ', ',')},"
        for f in FRAMES
    ]
    return text([head, *lines], "\n")


def python_can_table() -> bytes:
    lines = [
        f"{f.time_ns / 1e9:.6f},0x{f.identifier:x},1,0,0,{len(f.payload)},{base64.b64encode(f.payload).decode()}"
        for f in FRAMES
    ]
    return text(["timestamp,arbitration_id,extended,remote,error,dlc,data", *lines], "\n")


def candump_console() -> bytes:
    lines = [f" ({f.time_ns / 1e9:.6f})  can0  {f.identifier:08X}   [8]  {spaced(f.payload)}" for f in FRAMES]
    return text(lines, "\n")


def candump_differences() -> bytes:
    """``candump -td -x -a``."""
    lines, before_ns = [], FRAMES[0].time_ns
    for f in FRAMES:
        since = (f.time_ns - before_ns) / 1e9
        lines.append(f" ({since:010.6f})  can0  RX - -  {f.identifier:08X}   [8]  {spaced(f.payload)}   '........'")
        before_ns = f.time_ns
    return text(lines, "\n")


def candump_swapped() -> bytes:
    """``candump -ta -S``: the last byte first."""
    backwards = [f.payload[::-1].hex("`").upper() for f in FRAMES]
    lines = [
        f" ({f.time_ns / 1e9:.6f})  can0  {f.identifier:08X}   [8]  {data}"
        for f, data in zip(FRAMES, backwards, strict=True)
    ]
    return text(lines, "\n")


def canboat(zone: str = "Z", digits: int = 3, shift_h: float = 0.0) -> bytes:
    lines = []
    for m in MESSAGES:
        date, clock = when(m.time_ns + round(shift_h * 3600) * SECOND, digits)
        data = m.payload.hex(",")
        lines.append(f"{date}T{clock}{zone},{m.priority},{m.group},{m.source},255,{len(m.payload)},{data}")
    return text(lines, "\n")


def yacht_devices() -> bytes:
    return text([f"{when(f.time_ns)[1]} R {f.identifier:08X} {spaced(f.payload)}" for f in FRAMES])


def n2k_ascii() -> bytes:
    lines = []
    for m in MESSAGES:
        clock = when(m.time_ns)[1].replace(":", "")
        lines.append(f"A{clock} {m.source:02X}FF{m.priority} {m.group:05X} {m.payload.hex().upper()}")
    return text(lines)


def ikonvert() -> bytes:
    lines = ["$PDGY,000000,4,,5,482,1,0", "$PDGY,TEXT,Digital_Yacht_iKonvert_v2.07"]
    for m in MESSAGES:
        since = (m.time_ns - MESSAGES[0].time_ns) / 1e9 + 7.5
        data = base64.b64encode(m.payload).decode()
        lines.append(f"!PDGY,{m.group},{m.priority},{m.source},255,{since:.3f},{data}")
    return text(lines)


def seasmart(base_32: bool = False) -> bytes:
    lines = []
    for m in MESSAGES:
        uptime_ms = (m.time_ns - START_NS) // MILLISECOND + 4_000_000
        ticks = (m.time_ns - 1_262_304_000 * SECOND) * 1024 // SECOND
        digits = "".join("0123456789ABCDEFGHIJKLMNOPQRSTUV"[ticks >> 5 * n & 31] for n in reversed(range(8)))
        time = digits if base_32 else f"{uptime_ms:08X}"
        lines.append(summed(f"$PCDIN,{m.group:06X},{time},{m.source:02X},{m.payload.hex().upper()}"))
    return text(lines)


def mxpgn() -> bytes:
    """Frames, no times, the last byte first."""
    lines = []
    for f in FRAMES:
        group, attribute = f.identifier >> 8 & 0x1FFFF, (f.identifier >> 26) << 12 | 8 << 8 | f.identifier & 0xFF
        lines.append(summed(f"$MXPGN,{group:06X},{attribute:04X},{f.payload[::-1].hex().upper()}"))
    return text(lines)


def garmin(absolute: bool = False) -> bytes:
    lines = [
        "Sequence #,Timestamp,PGN,Name,Manufacturer,Remote Address,Local Address,Priority,Single Frame,Size,Packet"
    ]
    for n, m in enumerate(MESSAGES):
        date, clock = when(m.time_ns)
        year, month, day = date.split("-")
        stamp = str((m.time_ns - START_NS) // MILLISECOND + 486_942)
        if absolute:
            stamp = "_".join((month, day, year, *clock.replace(".", ":").split(":")))
        single = int(len(m.payload) == 8)
        lines.append(
            f"{n},{stamp},{m.group},A group, of some,Garmin,{m.source},255,{m.priority},{single},{len(m.payload)},"
            f"0x{m.payload.hex().upper()}"
        )
    return text(lines)


def signal_k() -> bytes:
    """The server's log of all its inputs, one of them its own deltas."""
    lines = []
    for m, line in zip(MESSAGES, canboat().decode().splitlines(), strict=True):
        lines.append(f"{m.time_ns // MILLISECOND};A;{line}")
        lines.append(f'{m.time_ns // MILLISECOND};I;{{"updates":[{{"values":[]}}]}}')
    return text(lines, "\n")


def stored(m: Message) -> bytes:
    """Actisense's message 93, without its checksum."""
    group = m.group.to_bytes(3, "little")
    uptime_ms = (m.time_ns - START_NS) // MILLISECOND + 2**32 - 60_000  # its clock comes round after a minute
    head = bytes([0x93, len(m.payload) + 11, m.priority, *group, 255, m.source])
    return head + (uptime_ms % 2**32).to_bytes(4, "little") + bytes([len(m.payload)]) + m.payload


def stored_d0(m: Message) -> bytes:
    group, uptime_ms = m.group, (m.time_ns - START_NS) // MILLISECOND + 5_000
    head = bytes([0xD0]) + (13 + len(m.payload)).to_bytes(2, "little")
    head += bytes([255, m.source, group & 0xFF, group >> 8 & 0xFF, m.priority << 2 | group >> 16, 1])
    return head + uptime_ms.to_bytes(4, "little") + m.payload


def stored_95(f: BusFrame) -> bytes:
    ticks = (f.time_ns - START_NS) // MILLISECOND + 65_000
    low, middle, high = f.identifier >> 8 & 0xFF, f.identifier >> 16 & 0xFF, f.identifier >> 24 & 3
    head = bytes([0x95, 6 + len(f.payload)]) + (ticks % 2**16).to_bytes(2, "little")
    return head + bytes([f.identifier & 0xFF, low, middle, (f.identifier >> 26) << 2 | high]) + f.payload


def framed(body: bytes) -> bytes:
    """Between Actisense's marks, with the checksum."""
    whole = body + bytes([-sum(body) & 0xFF])
    return b"\x10\x02" + whole.replace(b"\x10", b"\x10\x10") + b"\x10\x03"


def actisense() -> bytes:
    return b"".join(framed(stored(m)) for m in MESSAGES)


def actisense_d0() -> bytes:
    return b"".join(framed(stored_d0(m)) for m in MESSAGES)


def actisense_95() -> bytes:
    return b"".join(framed(stored_95(f)) for f in FRAMES)


def tag(kind: int, data: bytes) -> bytes:
    return b"\x1b\x01" + (bytes([kind]) + data).replace(b"\x1b", b"\x1b\x1b") + b"\x1b\n"


def filetime(time_ns: int) -> bytes:
    return (time_ns // 100 + 116_444_736_000_000_000).to_bytes(8, "little")


def ebl(raw: bool = False) -> bytes:
    log = tag(3, filetime(START_NS)) + tag(1, (1002).to_bytes(4, "little")) + tag(2, b"a trial")
    for m in MESSAGES:
        body = stored(m)
        log += tag(3, filetime(m.time_ns)) + (tag(5, b"\0") if raw else b"")
        log += tag(7, body + bytes([-sum(body) & 0xFF])) if raw else framed(body).replace(b"\x1b", b"\x1b\x1b")
    return log


def ydvr() -> bytes:
    log = struct.pack("<HI8s", 31_250, 0xFFFFFFFF, b"YDVR v04")
    for m in MESSAGES:
        log += struct.pack("<HI", m.time_ns // MILLISECOND % 60_000, m.identifier)
        log += m.payload if len(m.payload) == 8 else bytes([0x20, len(m.payload)]) + m.payload
    return log


def yd_can() -> bytes:
    records = [struct.pack("<HHI8s", 7 << 11 | 1000, 31_250, 0xFFFFFFFF, b"YDVR v05")]
    for f in FRAMES:
        minutes, milliseconds = divmod(f.time_ns // MILLISECOND - START_NS // MILLISECOND + 61_400_000, 60_000)
        records.append(struct.pack("<HHI8s", 7 << 11 | minutes % 1024, milliseconds, f.identifier, f.payload))
    return b"".join(records)


def captured(f: BusFrame) -> bytes:
    return struct.pack(">IB3x", f.identifier | 0x80000000, len(f.payload)) + f.payload


def pcap(order: str = "<", nano: bool = False, cooked: bool = False) -> bytes:
    magic = 0xA1B23C4D if nano else 0xA1B2C3D4
    log = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65_535, 113 if cooked else 227)
    for f in FRAMES:
        packet = (bytes(14) + b"\0\x0c" if cooked else b"") + captured(f)
        seconds, rest = divmod(f.time_ns, SECOND)
        log += (
            struct.pack(f"{order}IIII", seconds, rest if nano else rest // 1000, len(packet), len(packet)) + packet
        )
    return log


def block(kind: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    return struct.pack("<II", kind, len(body) + 12) + body + struct.pack("<I", len(body) + 12)


def pcapng() -> bytes:
    """Wireshark's, with an interface that is no bus and a clock of nanoseconds."""
    log = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    log += block(1, struct.pack("<HHI", 1, 0, 0))
    log += block(1, struct.pack("<HHIHHBxxxHH", 227, 0, 0, 9, 1, 9, 0, 0))
    for f in FRAMES:
        packet = captured(f)
        high, low = divmod(f.time_ns, 2**32)
        log += block(6, struct.pack("<IIIII", 1, high, low, len(packet), len(packet)) + packet)
    return log


def opencpn(header: str = "timestamp,type,id,message") -> bytes:
    lines = ["# a voyage", header]
    for m in MESSAGES:
        between = f"{m.group}" if header.startswith("timestamp") else f'{m.group},"can0/N2K"'
        lines.append(f"{'T'.join(when(m.time_ns))}Z,NMEA2000,{between},{stored(m).hex().upper()}")
    return text(lines)


class Form(NamedTuple):
    """How a log is written; whether it holds whole messages; how exact its own times are [ns], if it has any."""

    write: Callable[[], bytes]
    whole: bool
    exact_ns: int | None = MILLISECOND


FORMS = {
    "candump -L": Form(candump_log, False, 1000),
    "SavvyCAN": Form(savvycan, False, 1000),
    "python-can": Form(python_can_table, False, 1000),
    "candump -ta": Form(candump_console, False, 1000),
    "candump -td": Form(candump_differences, False, MILLISECOND),
    "candump -S": Form(candump_swapped, False, 1000),
    "canboat": Form(canboat, True),
    "canboat ns +02:00": Form(lambda: canboat("+02:00", 9, 2.0), True, 1),
    "canboat us -0330": Form(lambda: canboat("-0330", 6, -3.5), True, 1000),
    "Yacht Devices RAW": Form(yacht_devices, False),
    "N2K ASCII": Form(n2k_ascii, True),
    "iKonvert": Form(ikonvert, True),
    "SeaSmart uptime": Form(seasmart, True),
    "SeaSmart since 2010": Form(lambda: seasmart(base_32=True), True),
    "MXPGN": Form(mxpgn, False, None),
    "Garmin": Form(garmin, True),
    "Garmin dated": Form(lambda: garmin(absolute=True), True),
    "Signal K": Form(signal_k, True),
    "Actisense 93": Form(actisense, True),
    "Actisense D0": Form(actisense_d0, True),
    "Actisense 95": Form(actisense_95, False),
    "EBL": Form(ebl, True, 100),
    "EBL of messages": Form(lambda: ebl(raw=True), True, 100),
    "YDVR": Form(ydvr, True),
    "YD CAN": Form(yd_can, False),
    "pcap": Form(pcap, False, 1000),
    "pcap big-endian ns": Form(lambda: pcap(">", nano=True), False, 1),
    "pcap cooked": Form(lambda: pcap(cooked=True), False, 1000),
    "pcapng": Form(pcapng, False, 1),
    "OpenCPN": Form(opencpn, True),
    "OpenCPN new": Form(lambda: opencpn("received_at,protocol,msg_type,source,raw_data"), True),
}
