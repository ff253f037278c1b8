"""Who may send: networks at a port, source addresses on a bus; the others are counted and told, not believed."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from ipaddress import ip_network
from pathlib import Path

import pytest

from seatrial.acquisition.config.trial_file import parse_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Frame, wall_and_monotonic_ns
from seatrial.acquisition.logger.pipeline import initial_health
from seatrial.acquisition.logger.processing import FrameProcessor
from seatrial.acquisition.protocols import Decoder, FurtherSenders
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, frame_sentence, xor_checksum
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.sources import Senders
from tests.acquisition.can_frames import can_frame
from tests.acquisition.conftest import config_text, free_port, wait_for
from tests.acquisition.test_faults import recording, udp
from tests.acquisition.test_mavlink import attitude, decoder, frame, packed

RATE = 0x09F11300  # 127251, of the address that is added


def say_from(address: str, port: int, text: str) -> None:
    """A datagram from another address of this computer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind((address, 0))
        line.sendto(frame_sentence(text), ("127.0.0.1", port))


def test_two_senders_of_one_talker_are_two_sources(tmp_path: Path) -> None:
    """A mean of two compasses that send to one port points where neither does; one of them has the channel."""
    port = free_port()
    with recording(tmp_path, udp("line", port, "heading_deg")) as running:
        for _ in range(10):
            say_from("127.0.0.2", port, "HEHDT,57.3,T")
            say_from("127.0.0.3", port, "HEHDT,120.0,T")
        running.wait_for_frames("line", 20)
    assert running.recording.series["heading_deg"].value.tolist() == [57.3] * 10
    assert running.told(r"127\.0\.0\.3 sends, too: its values are kept apart") == 1


def labels_of(decoder: Decoder, frames: list[Frame]) -> list[str]:
    return [group[0].source for frame in frames for group in decoder.decode(frame)]


def test_senders_to_one_port_stand_in_the_labels() -> None:
    addresses = ("10.0.0.7", "10.0.0.8", "fe80::1%eth0", "10.0.0.7", "")
    lines = [
        Frame("line", "nmea0183", frame_sentence("HEHDT,57.3,T").strip(), 0, 0, sender=each) for each in addresses
    ]
    assert labels_of(Nmea0183Decoder(), lines) == [
        "line/HE:HDT", "line/HE@10.0.0.8:HDT", "line/HE@fe80__1_eth0:HDT", "line/HE:HDT", "line/HE:HDT",
    ]  # fmt: skip
    tagged = rb"\s:GN01*%02X\$HEHDT,12.3,T*1F" % xor_checksum(b"s:GN01")
    lines = [Frame("line", "nmea0183", tagged, 0, 0, sender=each) for each in addresses[:2]]
    assert labels_of(Nmea0183Decoder(), lines) == ["line/HE@GN01:HDT", "line/HE@GN01.10.0.0.8:HDT"]


def test_two_vehicles_of_one_number_at_one_port_keep_their_times_and_origins_apart() -> None:
    vehicles = decoder()
    sounds = []
    for boot_ms in range(0, 2000, 500):
        for address, lead_ms in (("10.0.0.7", 0), ("10.0.0.8", 900_000)):
            heard = frame(packed(attitude(1.0, boot_ms + lead_ms)), boot_ms / 1000.0)._replace(sender=address)
            sounds += vehicles.decode(heard)
    assert {group[0].source for group in sounds} == {"link/1:ATTITUDE", "link/1@10.0.0.8:ATTITUDE"}
    assert not [text for _, text in vehicles.notices if "restarted" in text]


def test_senders_to_decode_are_not_remembered_without_end() -> None:
    labels = [
        FurtherSenders.label(each, f"10.0.{number // 250}.{number % 250}")
        for each in [FurtherSenders()]
        for number in range(300)
    ]
    assert labels[:2] == ["", "10.0.0.1"]
    assert set(labels[100:]) == {"further"}


def test_an_unknown_sender_is_counted_told_and_not_recorded(tmp_path: Path) -> None:
    port = free_port()
    with recording(
        tmp_path, udp("line", port, "yaw_rate_dps") + 'senders = ["127.0.0.2", "10.0.0.0/8"]\n'
    ) as running:
        for number in range(5):
            say_from("127.0.0.3", port, "TIROT,3000,A")
            say_from("127.0.0.2", port, f"TIROT,{60 * number},A")
        running.wait_for_frames("line", 5)
        wait_for(lambda: running.sources["line"].rejected == 5)
    assert running.recording.series["yaw_rate_dps"].value.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert running.sources["line"].rejection_counts == {"sender that is not allowed": 5}
    assert len(running.raw("line")) == 5
    assert running.told(r"line: 127\.0\.0\.3 sends and may not") == 1
    assert running.told(r"127\.0\.0\.2") == 0


def test_without_a_list_everybody_may_send_and_is_recorded_by_address(tmp_path: Path) -> None:
    port = free_port()
    with recording(tmp_path, udp("line", port, "yaw_rate_dps")) as running:
        for number, last in enumerate((4, 5, 4), 1):  # one by one: datagrams of two senders may overtake each other
            say_from(f"127.0.0.{last}", port, "TIROT,60,A")
            running.wait_for_frames("line", number)
    assert [each.sender for each in running.raw("line")] == ["127.0.0.4", "127.0.0.5", "127.0.0.4"]
    assert running.sources["line"].rejected == 0
    assert running.told("sends, too") == running.told(r"line: 127\.0\.0\.5 sends, too") == 1


ALLOWED = [("", True), ('senders = ["127.0.0.1"]', True), ('senders = ["::1"]', False)]


@pytest.mark.parametrize(("senders", "may"), ALLOWED)
def test_a_server_that_answers_has_to_be_allowed(tmp_path: Path, senders: str, may: bool) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def serve() -> None:
            client, _ = server.accept()
            with client, suppress(OSError):  # one that may not answer is hung up on
                client.sendall(frame_sentence("TIROT,60,A"))
                client.recv(1)  # until the recorder closes

        serving = threading.Thread(target=serve)
        serving.start()
        text = f'[[source]]\nname = "line"\ntype = "tcp"\nport = {port}\nchannels = ["yaw_rate_dps"]\n{senders}\n'
        with recording(tmp_path, text + udp("other", free_port())) as running:
            wait_for(lambda: bool(running.sources["line"].frames) or running.sources["line"].state == "failed")
        serving.join()
    assert ("yaw_rate_dps" in running.recording.series) is may
    assert [each.sender for each in running.raw("line")] == ["127.0.0.1"] * may
    assert running.told("127.0.0.1 answers, which may not") == (not may)


def test_addresses_on_a_bus_that_are_not_allowed_are_kept_raw_and_not_believed(tmp_path: Path) -> None:
    text = config_text(
        'type = "can"\ninterface = "virtual"\nchannel = "x"\naddresses = [3, 35]\n', ("yaw_rate_dps",)
    )
    config = parse_config(text, tmp_path / "trial.toml")
    health, parts = initial_health(config), RecordingParts(tmp_path, config.trial, {}, config.recording)
    processing = FrameProcessor(config, parts, health)
    for address in (3, 35, 36, 3):
        frame = can_frame(RATE + address, "00 00 00 00 00 FF FF FF", wall_and_monotonic_ns()[1] / 1e9)
        processing.process(frame._replace(origin="line"))
    parts.close()
    assert health.channels["yaw_rate_dps"].count >= 2
    assert health.channels["yaw_rate_dps"].source.startswith("line/3")
    assert health.sources["line"].rejection_counts == {"address that is not allowed": 1}


def test_senders_without_end_are_not_all_remembered() -> None:
    """Addresses of datagrams can be forged."""
    senders = Senders([ip_network("10.0.0.0/8")])
    admitted = sum(senders.admits(f"{first}.{second}.0.1") for first in range(8, 13) for second in range(200))
    assert admitted == 200
    assert senders.refused.total() == 800
    assert len(senders.news) == 100  # the first hundred, all of networks that may not
    assert senders.admits("fe80::1%eth0") is False


WRONG = ['senders = ["ship"]', 'senders = ["10.0.0.5/8"]', "addresses = [256]", "addresses = [-1]"]


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_no_address_is_told(wrong: str) -> None:
    with pytest.raises(ConfigurationError, match=wrong.partition(" ")[0]):
        parse_config(config_text(f'type = "udp"\nport = 1\n{wrong}\n'), "trial.toml")
