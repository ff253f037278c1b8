"""Sources on the network: nothing beyond this computer unless asked for, and the system's own drops are counted."""

from __future__ import annotations

import socket
from contextlib import closing

import pytest

from acquisition.config.sections import LiveSection, MavlinkSource, MavlinkTcpSource, TcpSource, UdpSource
from acquisition.core.errors import SourceError
from acquisition.encoders.nmea0183 import sentence
from acquisition.sources import streams
from acquisition.sources.streams import UdpPort
from tests.acquisition.conftest import free_port


def test_nothing_listens_beyond_this_computer_unless_asked() -> None:
    for kind in (UdpSource, TcpSource, MavlinkSource, MavlinkTcpSource, LiveSection):
        address = next(field.default for name, field in kind.__dataclass_fields__.items() if name == "address")
        assert getattr(address, "default", address) == "127.0.0.1"


def test_what_the_system_drops_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that was sent was either read or counted, once a datagram has come through that tells the count."""
    monkeypatch.setattr(streams, "_BUFFER_BYTES", 4096)
    port = free_port()
    source = UdpPort(UdpSource(name="line", type="udp", port=port, channels=()))
    source.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(1000):
            sender.sendto(sentence(f"HEHDT,{number % 360},T"), ("127.0.0.1", port))
        read = 0
        while frames := source.read(0.1):
            read += len(frames)
        sender.sendto(sentence("HEHDT,1,T"), ("127.0.0.1", port))
        read += len(source.read(0.5) or [])
    source.close()
    assert 0 < read < 1000
    assert read + source.lost == 1001


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
                sender.sendto(b"UdPbC\0" + sentence("HEHDT,17.0,T"), (GROUP, port))
            except OSError as error:
                pytest.skip(f"multicast has no route here: {error}")
            sender.sendto(sentence("HEHDT,99.0,T"), ("127.0.0.1", port))  # not to the group: not ours
        received = [[frame.payload for frame in source.read(1.0) or []] for source in (first, second)]
    assert received == [[b"UdPbC\0" + sentence("HEHDT,17.0,T").strip()]] * 2


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
