"""Sources on the network: nothing beyond this computer unless asked for, and the system's own drops are counted."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import closing
from itertools import pairwise

import can
import pytest

from seatrial.acquisition.config.sources import (
    CanSource,
    LiveSection,
    MavlinkSource,
    MavlinkTcpSource,
    TcpSource,
    UdpSource,
)
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.trial import Frame, FrameFlag, Quality, wall_and_monotonic_ns
from seatrial.acquisition.logger.health import SourceHealth
from seatrial.acquisition.logger.pipeline import Inbox, Receiver
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, frame_sentence
from seatrial.acquisition.protocols.nmea2000 import Nmea2000Decoder
from seatrial.acquisition.sources import lines
from seatrial.acquisition.sources.lines import CanBus, UdpPort
from tests.acquisition.can_frames import can_frame
from tests.acquisition.conftest import free_port


def test_nothing_listens_beyond_this_computer_unless_asked() -> None:
    for kind in (UdpSource, TcpSource, MavlinkSource, MavlinkTcpSource, LiveSection):
        address = next(field.default for name, field in kind.__dataclass_fields__.items() if name == "address")
        assert getattr(address, "default", address) == "127.0.0.1"


def test_what_the_system_drops_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that was sent was either read or counted."""
    monkeypatch.setattr(lines, "_BUFFER_BYTES", 4096)
    port = free_port()
    source = UdpPort(UdpSource(name="line", type="udp", port=port, channels=()))
    source.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(1000):
            sender.sendto(frame_sentence(f"HEHDT,{number % 360},T"), ("127.0.0.1", port))
        read = 0
        while frames := source.read(0.1):
            read += len(frames)
    source.close()
    assert 0 < read < 1000
    assert read + source.lost == 1000


def can_by_multicast(port: int) -> CanBus:
    options: dict[str, str | int | float | bool] = {"port": port}
    return CanBus(
        CanSource(
            name="bus", type="can", interface="udp_multicast", channel="239.0.0.1", options=options, channels=()
        )
    )


def test_frames_that_the_system_drops_are_counted_and_the_others_stamped_when_they_came(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a bus behind a socket, which nobody reads for a while."""
    monkeypatch.setattr(lines, "_BUS_BUFFER_BYTES", 8192)
    port = free_port()
    source = can_by_multicast(port)
    source.open()
    with can.Bus(interface="udp_multicast", channel="239.0.0.1", port=port) as sender:
        for number in range(300):
            sender.send(can.Message(arbitration_id=number, data=bytes(8)))
        time.sleep(0.3)
        read_ns = time.monotonic_ns()
        frames: list[Frame] = []
        while some := source.read(0.1):
            assert source.exact
            frames += some
    source.close()
    assert 0 < len(frames) < 300
    assert len(frames) + source.lost == 300
    assert all(frame.monotonic_ns < read_ns for frame in frames)
    assert all(before.monotonic_ns <= after.monotonic_ns for before, after in pairwise(frames))


def test_a_datagram_is_stamped_when_it_came() -> None:
    port = free_port()
    with closing(UdpPort(UdpSource(name="line", type="udp", port=port, channels=()))) as source:
        source.open()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            before_ns = time.monotonic_ns()
            sender.sendto(frame_sentence("HEHDT,1,T"), ("127.0.0.1", port))
        time.sleep(0.2)
        read_ns = time.monotonic_ns()
        (frame,) = source.read(0.1) or []
        assert source.exact
    wall_ns, monotonic_ns = wall_and_monotonic_ns()
    assert before_ns - 1_000_000 < frame.monotonic_ns < read_ns
    assert abs(frame.received_ns - (wall_ns - monotonic_ns + frame.monotonic_ns)) < 1_000_000


def frames_of(count: int) -> list[Frame]:
    return [
        Frame("line", "nmea0183", frame_sentence(f"HEHDT,{number}.0,T").strip(), 0, 0) for number in range(count)
    ]


@pytest.mark.parametrize(("exact", "marked"), [(False, [0, 8, 7, 6, 5, 0]), (True, [0] * 6)])
def test_what_waited_while_the_recorder_stood_still_is_marked(exact: bool, marked: list[int]) -> None:
    """Until nothing waits any more and the recorder has caught up; what has a stamp of its own needs no mark."""
    source, told = can_by_multicast(free_port()), list[str]()
    source.exact = exact
    health = SourceHealth("line")
    receiver = Receiver(
        source, health, Inbox(["line"], 9), threading.Event(), lambda level, text: told.append(text)
    )
    receiver._ended_s = 0.0
    counts = []
    reads = [(9, 0.1, False), (8, 1.2, True), (7, 1.21, False), (6, 1.31, False), (5, 1.41, False), (4, 1.5, False)]
    for (count, ended_s, behind), (_, began_s, _) in zip(reads, [(0, 0.0, False), *reads], strict=False):
        source.behind = behind
        frames = receiver._mark_delayed_frames(frames_of(count), began_s, ended_s)
        counts.append(sum(bool(frame.flags & FrameFlag.LATE) for frame in frames))
        assert len(frames) == count
    assert counts == marked
    (text,) = told
    assert text.startswith("line: the recorder stood still for 1.00 s")
    assert ("26 frames are stamped up to so much late" in text) is not exact


def test_values_of_marked_frames_are_suspect_unless_the_source_tells_the_time() -> None:
    frame = frames_of(1)[0]._replace(flags=FrameFlag.LATE)
    ((late,),) = Nmea0183Decoder().decode(frame)
    assert late.quality is Quality.SUSPECT
    told = Nmea0183Decoder(stamps="source")
    told.decode(frame._replace(payload=frame_sentence("GPZDA,120000.00,31,12,2026,00,00").strip()))
    ((stamped,),) = told.decode(frame)
    assert (stamped.quality, stamped.clock) == (Quality.NOT_EVALUATED, "nmea0183 ZDA, RMC or TAG")
    ((rate,),) = Nmea2000Decoder().decode(can_frame(0x09F11323, "00 00 00 00 00 FF FF FF", 0.0, FrameFlag.LATE))
    assert rate.quality is Quality.SUSPECT


GROUP = "239.192.0.1"


def test_a_multicast_group_is_joined_and_shared() -> None:
    """As IEC 61162-450 sends; the group's other listeners are not in our way, nor we in theirs."""
    port = free_port()
    sections = [UdpSource(name=name, type="udp", address=GROUP, port=port, channels=()) for name in ("one", "two")]
    with closing(UdpPort(sections[0])) as first, closing(UdpPort(sections[1])) as second:
        first.open()
        second.open()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            try:
                sender.sendto(b"UdPbC\0" + frame_sentence("HEHDT,17.0,T"), (GROUP, port))
            except OSError as error:
                pytest.skip(f"multicast has no route here: {error}")
            sender.sendto(frame_sentence("HEHDT,99.0,T"), ("127.0.0.1", port))  # not to the group: not ours
        received = [[frame.payload for frame in source.read(1.0) or []] for source in (first, second)]
    assert received == [[b"UdPbC\0" + frame_sentence("HEHDT,17.0,T").strip()]] * 2


def test_a_group_that_no_interface_can_join_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "if_nameindex", lambda: [(999_999, "gone")])
    source = UdpPort(UdpSource(name="line", type="udp", address=GROUP, port=free_port(), channels=()))
    with pytest.raises(SourceError, match=GROUP):
        source.open()


def test_one_address_of_this_computer_is_for_one_program() -> None:
    """Two recorders on one port would each get half of what comes."""
    section = UdpSource(name="line", type="udp", port=free_port(), channels=())
    with closing(UdpPort(section)) as first:
        first.open()
        with pytest.raises(SourceError, match=str(section.port)):
            UdpPort(section).open()


def test_datagrams_of_several_lines_and_of_half_a_line() -> None:
    port = free_port()
    source = UdpPort(UdpSource(name="line", type="udp", port=port, channels=()))
    source.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for payload in (b"$A\r\n$B\r\n$C", b"$D", b"", b"\r\n", b"$E\r\n"):
            sender.sendto(payload, ("127.0.0.1", port))
        payloads = [frame.payload for frame in source.read(0.5) or []]
    source.close()
    assert payloads == [b"$A", b"$B", b"$C", b"$D", b"$E"]
