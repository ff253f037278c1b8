"""The recorder as a process: signals, faults of its lines, and what a kill leaves behind."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.emulator import NullModem, emulate
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import (
    PATIENCE_S,
    config_text,
    free_port,
    open_sources,
    recorded_count,
    wait_for,
    write_voyage,
)
from tests.conftest import nightly

ROOT = Path(__file__).parents[2]
UDP_CHANNELS = ("heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps")


def start_recorder(config: Path, folder: Path) -> subprocess.Popen[str]:
    """``seatrial record`` as its own process, returned when it has said that it records."""
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "seatrial.py"), "record", str(config), "-o", str(folder)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("recording to"):
            return process
    raise AssertionError(f"the recorder did not start: {process.wait()}")


def config_file(tmp_path: Path, section: str) -> Path:
    path = tmp_path / "trial.toml"
    path.write_text(config_text(section, UDP_CHANNELS))
    return path


@pytest.mark.parametrize("number", [signal.SIGHUP, *nightly(signal.SIGINT, signal.SIGTERM)])
def test_signals_end_a_recording_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    config = config_file(tmp_path, f'type = "udp"\nport = {free_port()}\n')
    table = write_voyage(tmp_path / "voyage.mcap", duration_s=3.0)
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored under nohup, and what is started inherits that
    process = start_recorder(config, tmp_path / "out")
    signal.signal(signal.SIGHUP, before)
    emulate(tmp_path / "voyage.mcap", load_config(config), speed=3.0)
    wait_for(lambda: recorded_count(tmp_path / "out") == len(table))
    process.send_signal(number)
    stdout, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    recording = read_recording(stdout.strip())
    assert recording.closed
    assert recording.series["heading_deg"].value.size == len(table)
    assert recording.raw["/raw/nmea0183/line"] > len(table)


def test_a_terminal_is_left_as_it_was(tmp_path: Path) -> None:
    """On a terminal: the table on a screen of its own; after Ctrl-C that screen is gone and the cursor is back."""
    near, far = pty.openpty()
    config = config_file(tmp_path, f'type = "udp"\nport = {free_port()}\n')
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "seatrial.py"), "record", str(config), "-o", str(tmp_path / "out")],
        stdin=far, stdout=subprocess.PIPE, stderr=far, text=True, cwd=ROOT, env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    os.close(far)
    shown = _read_until(near, b"waiting")
    process.send_signal(signal.SIGINT)
    stdout, _ = process.communicate(timeout=PATIENCE_S)
    shown += _read_until(near, b"the end")
    os.close(near)
    assert process.returncode == 0
    assert read_recording(stdout.strip()).closed
    assert b"\x1b[?1049h" in shown
    after = shown[shown.rindex(b"\x1b[?1049l") :]
    assert b"\x1b[?25h" in shown[shown.rindex(b"\x1b[?25l") :]
    assert b"0 of 8 channels, 0 dropped" in after
    assert b"warning: nothing came of heading_deg" in after


def _read_until(descriptor: int, wanted: bytes) -> bytes:
    """What a terminal shows, up to ``wanted`` or its end."""
    shown, until_s = b"", time.monotonic() + PATIENCE_S
    while wanted not in shown and time.monotonic() < until_s:
        readable, _, _ = select.select([descriptor], [], [], 0.5)
        try:
            shown += os.read(descriptor, 65_536) if readable else b""
        except OSError:  # the other end has closed
            break
    return shown


def test_a_kill_loses_no_more_than_what_was_not_yet_flushed(tmp_path: Path) -> None:
    config = config_file(tmp_path, f'type = "udp"\nport = {free_port()}\n')
    write_voyage(tmp_path / "voyage.mcap", duration_s=2.0, rate_hz=20.0)
    process = start_recorder(config, tmp_path / "out")
    emulate(tmp_path / "voyage.mcap", load_config(config), speed=1.0)
    wait_for(lambda: recorded_count(tmp_path / "out") >= 40 - 20 * 0.5)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    (path,) = (tmp_path / "out").glob("*.mcap")
    recording = read_recording(path)
    assert not recording.closed
    assert recording.series["heading_deg"].value.size >= 40 - 20 * 0.5


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ('type = "serial"\ndevice = "/dev/nowhere"\n', "serial line /dev/nowhere cannot be opened"),
        (
            'type = "can"\ninterface = "socketcan"\nchannel = "can99"\n',
            "CAN bus socketcan:can99 cannot be opened",
        ),
        ('type = "can"\ninterface = "telepathy"\nchannel = "0"\n', "CAN bus telepathy:0 cannot be opened"),
        ('type = "file"\npath = "nowhere.log"\n', "cannot be opened"),
        ('type = "tcp"\nport = 1\n', "does not answer"),
    ],
)
def test_a_line_that_does_not_exist_is_one_clear_error(tmp_path: Path, section: str, message: str) -> None:
    config = load_config(config_file(tmp_path, section))
    with pytest.raises(SourceError, match=message):
        record(config, tmp_path / "out", duration_s=1.0)
    assert list((tmp_path / "out").iterdir()) == []


def test_a_port_in_use(tmp_path: Path) -> None:
    port = free_port()
    config = load_config(config_file(tmp_path, f'type = "udp"\nport = {port}\n'))
    stop = threading.Event()
    first = threading.Thread(target=record, args=(config, tmp_path / "a", PATIENCE_S, stop))
    first.start()
    wait_for(lambda: open_sources(tmp_path / "a") == {"line"})
    with pytest.raises(SourceError, match="cannot be listened on"):
        record(config, tmp_path / "b", duration_s=1.0)
    stop.set()
    first.join()


def test_a_file_source_ends_the_recording_by_itself(tmp_path: Path) -> None:
    (tmp_path / "sentences.log").write_bytes(b"# a comment\r\n$RCTRD,2,400.5,R,,V,90.8*55\r\n$HEHDT,12.3,T*00")
    text = config_text('type = "file"\npath = "sentences.log"\n', ("port_rpm",), clock="receiver")
    (tmp_path / "trial.toml").write_text(text)
    (path,), health = record(load_config(tmp_path / "trial.toml"), tmp_path / "out", duration_s=20.0)
    recording = read_recording(path)
    assert recording.series["port_rpm"].value.tolist() == [400.5]
    assert recording.raw["/raw/nmea0183/line"] == 2
    assert health.sources["line"].refused == 1


def told(folder: Path) -> str:
    """The events in the file of a recorder that is still at work."""
    (path,) = folder.glob("*.mcap")
    return " | ".join(text for _, text in read_recording(path).events)


def test_a_serial_line_that_fails_does_not_stop_the_others(tmp_path: Path) -> None:
    """The line is pulled while it records; the other line's samples and the event are in the file."""
    port = free_port()
    with NullModem() as cable:
        text = config_text(f'type = "udp"\nport = {port}\n', UDP_CHANNELS, clock="receiver")
        text += f'[[source]]\nname = "pulled"\ntype = "serial"\ndevice = "{cable.logger_device}"\nchannels = []\n'
        (tmp_path / "trial.toml").write_text(text)
        config = load_config(tmp_path / "trial.toml")
        write_voyage(tmp_path / "voyage.mcap", duration_s=2.0)
        sender = tmp_path / "send.toml"
        sender.write_text(config_text(f'type = "udp"\nport = {port}\n', UDP_CHANNELS))
        stop = threading.Event()
        thread = threading.Thread(target=record, args=(config, tmp_path / "out", PATIENCE_S, stop))
        thread.start()
        wait_for(lambda: open_sources(tmp_path / "out") == {"line", "pulled"})
    emulate(tmp_path / "voyage.mcap", load_config(sender), speed=2.0)
    wait_for(lambda: recorded_count(tmp_path / "out") == 20 and "serial line failed" in told(tmp_path / "out"))
    stop.set()
    thread.join()
    (path,) = (tmp_path / "out").glob("*.mcap")
    recording = read_recording(path)
    assert recording.series["heading_deg"].value.size == 20
    assert any("serial line failed" in text for _, text in recording.events)
