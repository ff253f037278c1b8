"""A ship with other actuators than R/V Gunnerus: her list stands in the configuration."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.config.trial_file import TrialConfig, load_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.logger.record import record, summary_text
from seatrial.acquisition.protocols import Moment, make_decoders, make_encoder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording.reader import read_recording

SHIP = """
[[actuator]]
name = "main"
kind = "azimuth"
[[actuator]]
name = "bow"
kind = "tunnel"
[trial]
name = "ferry"
"""
SOURCE = (
    '[[source]]\nname = "line"\nchannels = ["heading_deg", "main_rpm", "main_angle_deg", "bow_rpm"{more}]\n{kind}\n'
)
FILE = 'type = "file"\npath = "bridge.log"'
MAVLINK = 'type = "mavlink"\nport = 1'
START_NS = 1_779_019_200 * 10**9


def config_of(folder: Path, kind: str = FILE, more: str = "", ship: str = SHIP) -> TrialConfig:
    (folder / "ferry.toml").write_text(ship + SOURCE.format(kind=kind, more=more))
    return load_config(folder / "ferry.toml")


def test_her_channels_are_recorded_and_said(tmp_path: Path) -> None:
    """TRD numbers from her list: the tunnel thruster 1, the azimuth 2; the single shaft's RPM has number 0."""
    said = ["HEHDT,12.0,T", "RCTRD,2,100.0,R,,V,350.0", "RCTRD,1,-50.0,R,,V,", "IIRPM,S,0,101.0,,A"]
    (tmp_path / "bridge.log").write_bytes(b"".join(map(frame_sentence, said)))
    (path, *_), health = record(config_of(tmp_path), tmp_path / "out")
    recording = read_recording(path)
    values = {name: each.value.tolist() for name, each in recording.series.items()}
    assert values == {
        "heading_deg": [12.0], "main_rpm": [100.0], "main_angle_deg": [-10.0], "bow_rpm": [-50.0]
    }  # fmt: skip
    assert recording.trial.actuators == "main:azimuth, bow:tunnel"
    assert "4 of 11 channels" in summary_text(health, [path])


def test_values_that_her_channels_cannot_hold_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "bridge.log").write_bytes(
        frame_sentence("RCTRD,2,9000.0,R,,V,90.0") + frame_sentence("HEHDT,1.0,T")
    )
    (path, *_), health = record(config_of(tmp_path), tmp_path / "out")
    assert "main_rpm" not in read_recording(path).series
    assert health.sources["line"].impossible == 1


@pytest.mark.parametrize("kind", [FILE, MAVLINK])
def test_what_is_sent_comes_back(tmp_path: Path, kind: str) -> None:
    """MAVLink: the shaft's rpm in RPM, the rest by named values."""
    config = config_of(tmp_path, kind)
    (section,) = config.sources
    sent = {"main_rpm": 120.0, "main_angle_deg": -30.0, "bow_rpm": 200.0}
    found = {}
    (decoder,) = make_decoders(section, config.actuators)
    for packet in make_encoder(section, config.actuators).encode(Moment(START_NS, sent)):
        protocol = "mavlink" if kind == MAVLINK else "nmea0183"
        frame = Frame("line", protocol, packet.payload.rstrip(b"\r\n"), START_NS, START_NS)  # type: ignore[arg-type]
        found |= {each.quantity: each.value for group in decoder.decode(frame) for each in group}
    found["main_angle_deg"] = (found["main_angle_deg"] + 180.0) % 360.0 - 180.0
    assert found == pytest.approx(sent)


@pytest.mark.parametrize(
    ("kind", "more", "ship", "message"),
    [
        (FILE, ', "port_rpm"', SHIP, "did you mean"),
        (FILE, "", SHIP.replace("azimuth", "sail"), "no kind 'sail'"),
        (FILE, "", SHIP.replace('name = "bow"', 'name = "main"'), "two actuators are called 'main'"),
        (FILE, "", SHIP.replace('kind = "tunnel"', 'kind = "tunnel"\nx_m = 3'), "x_m: is not a known key"),
        (FILE + "\nthrusters = { port = 2 }", "", SHIP, "no thruster port; the thrusters are main, bow"),
        (FILE + "\nthrusters = { main = 1 }", "", SHIP, "two thrusters have the same number"),
    ],
)
def test_what_is_wrong_names_its_line(tmp_path: Path, kind: str, more: str, ship: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"ferry\.toml, line \d+: .*{message}"):
        config_of(tmp_path, kind, more, ship)
