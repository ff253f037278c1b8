"""A trial's configuration: what is right is read, what is wrong names its line and the way out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from seatrial.acquisition.config.sources import CanSource
from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import line_of_toml_key
from tests.acquisition.conftest import DBC, SIGNALS, config_text

TRIALS = Path(__file__).parents[2] / "trials"
SERIAL = 'type = "serial"\ndevice = "/dev/null"\n'
SECOND_LINE = "\n[[source]]\nname = 'line'\nchannels = []\n"
CAN = f'type = "can"\ninterface = "virtual"\nchannel = "x"\ndbc = "{DBC}"\n{SIGNALS}'


def two_sources(one: str, other: str) -> str:
    return config_text(one, ()) + '[[source]]\nname = "second"\nchannels = []\n' + other


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "trial.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", sorted(TRIALS.glob("*.toml")), ids=lambda path: path.name)
def test_every_configuration_that_we_ship_is_valid(path: Path) -> None:
    if "source" in path.read_text():
        assert load_config(path).missing_channels == ()


def test_a_configuration_becomes_frozen_objects(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, config_text(CAN, ("heading_deg",))))
    (source,) = config.sources
    assert isinstance(source, CanSource)
    assert source.signals["port_rpm"].unit == "rpm"
    assert config.trial.origin == (63.44, 10.4)
    assert "north_m" in config.missing_channels
    assert "heading_deg" not in config.missing_channels


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (config_text(CAN).replace('unit = "rpm"', 'unit = "knots"', 1), 14, "'knots' does not measure"),
        (config_text(SERIAL, ("heding_deg",)), 7, "did you mean heading_deg"),
        (config_text(SERIAL + "boud_rate = 9600\n"), 10, "boud_rate: is not a known key"),
        (config_text('type = "serial"\n'), 4, "device: is missing"),
        (config_text('type = "udp"\nprot = 1\n'), 9, "prot: is not a known key here; did you mean port?; 1 more"),
        (two_sources('type = "udp"\nport = 9\n', 'type = "mavlink"\nport = 9\n'), 14, "same port as 'line'"),
        (two_sources('type = "udp"\nport = 9\n', 'port = 9\ntype = "udp"\naddress = "0.0.0.0"\n'), 13, "same port"),
        (two_sources(SERIAL, SERIAL.replace("serial", "mavlink_serial")), 14, "same device as 'line'"),
        (two_sources(SERIAL, SERIAL.replace("/dev/", "/dev/../dev/")), 14, "same device as 'line'"),
        (config_text('type = "seriel"\n'), 8, "seriel"),
        (config_text(SERIAL, clock="sundial"), 6, "clock"),
        (config_text(SERIAL + 'baud_rate = "fast"\n'), 10, "baud_rate: 'fast'"),
        (config_text(SERIAL + "baud_rate = 0\n"), 10, "baud_rate: 0"),
        (config_text('type = "udp"\nport = 70000\n'), 9, "port: 70000"),
        (config_text('type = "mavlink"\nport = 1\nsystem_id = 256\n'), 10, "system_id: 256"),
        (config_text(SERIAL).replace("63.44", "634.4"), 3, "634.4"),
        (config_text(SERIAL).replace("63.44", "nan"), 3, "origin.latitude_deg"),
        (config_text(SERIAL).replace('"round trip"', '""'), 2, "trial.name"),
        (config_text(SERIAL) + "[recording]\nsync_s = inf\n", 11, "recording.sync_s"),
        (config_text(SERIAL) + "[recording]\nqueue_frames = 0\n", 11, "recording.queue_frames"),
        (config_text(SERIAL + "thrusters = { port = 4 }\n"), 10, "two thrusters have the same number"),
        (config_text(SERIAL, ("heave_m",)), 7, "carries heave_m; say in a [[channel]] of this name, under `from`"),
        (config_text(CAN.split("[source.signals]")[0]), 7, "carries port_rpm; say which DBC signal does"),
        (
            config_text('type = "mavlink"\nport = 1\n[source.named_values]\n', ("tunnel_rpm",)),
            7,
            "carries tunnel_rpm; say which named value does",
        ),
        (
            config_text('type = "mavlink"\nport = 1\n', ("heading_deg",))
            + '[source.named_values]\ntunnel_rpm = { name = "longer_than_ten", unit = "rpm" }\n',
            11,
            "longer_than_ten",
        ),
    ],
)
def test_what_is_wrong_names_its_line(tmp_path: Path, text: str, line: int, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_config(written(tmp_path, text))
    assert f"line {line}:" in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[trial\n", "is not valid TOML"),
        ('source = []\n[trial]\nname = "x"\n', "has no source"),
        (
            config_text(SERIAL) + "\n[[source]]\nname = 'line'\nchannels = []\n" + SERIAL,
            "two sources are called",
        ),
        (config_text(SERIAL).replace('name = "line"', 'name = "a/b"'), "is not valid in a topic"),
        (config_text(CAN.replace(str(DBC), "nowhere.dbc")), "nowhere.dbc does not exist"),
    ],
)
def test_what_cannot_be_used_says_why(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load_config(written(tmp_path, text))


def test_sources_beside_each_other_are_accepted(tmp_path: Path) -> None:
    """One port on two addresses, one port of two servers."""
    for kind, address in (("udp", "127.0.0.2"), ("tcp", "127.0.0.1")):
        section = f'type = "{kind}"\nport = 9\n'
        text = two_sources(section, section + f'address = "{address}"\n')
        assert len(load_config(written(tmp_path, text)).sources) == 2


def test_missing_file() -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere.toml: does not exist"):
        load_config("nowhere.toml")


def test_lines_in_nested_arrays_of_tables() -> None:
    text = "[[a]]\n[[a.b]]\nx = 1\n[[a]]\n[[a.b]]\n[[a.b]]\nx = 2\n"
    assert line_of_toml_key(text, ["a", 0, "b", 0, "x"]) == 3
    assert line_of_toml_key(text, ["a", 1, "b", 1, "x"]) == 7
    assert line_of_toml_key(text, ["a", 1, "b", 1, "missing"]) == 6
    assert line_of_toml_key(text, ["c"]) == 1


UDP = '[trial]\nname = "x"\n[[source]]\nname = "a"\ntype = "udp"\nport = 10110\nchannels = []\n'


@pytest.mark.parametrize(
    ("more", "hint"),
    [
        ("baud_rate = 4800\n", "it belongs to another table, or to another type of this one"),
        ("magnetic_variation_deg = 1.0\n", "it belongs to another table, or to another type of this one"),
        ("baudrate = 4800\n", None),  # a port has none
        ("thruster = {}\n", "did you mean thrusters?"),
        ("[source.mounting]\nheadin_deg = 1.0\n", "did you mean heading_deg?"),
        ('[[source.devices]]\nname = "a"\nadress = 3\n', "did you mean address?"),
        ('[[source.devices]]\nname = "a"\naddress = 3\nport = 1\n', "it belongs to another table"),
        (
            '[source.signals]\nheading_deg = { message = "a", signal = "b", unit = "deg", scal = 1 }\n',
            "mean scale?",
        ),
        ("[alarms]\n", "did you mean alarm?"),
        ("[recording]\nreserve_gb = 1\n", "did you mean reserve_mb?"),
        ("[port]\n", "it belongs to another table"),
        ("[zzz]\n", None),
    ],
)
def test_a_hint_for_an_unknown_key_is_another_key_of_its_own_table(
    tmp_path: Path, more: str, hint: str | None
) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_config(written(tmp_path, UDP + more))
    assert "is not a known key here" in caught.value.what
    assert (hint in caught.value.fix) if hint else not caught.value.fix
    named = re.search(r"did you mean (\w+)", caught.value.fix)
    assert named is None or named[1] != caught.value.what.split(":")[0].rpartition(".")[2]


@pytest.mark.parametrize("key", ["name", "channels", "clock", "port", "addres", "thrusters", "form", "dbc", "type"])
def test_no_key_is_proposed_in_its_own_place(tmp_path: Path, key: str) -> None:
    """Every key of a source, put where there is none of it."""
    with pytest.raises(ConfigurationError) as caught:
        load_config(written(tmp_path, UDP + f"[recording]\n{key} = 1\n"))
    assert f"did you mean {key}?" not in str(caught.value)
