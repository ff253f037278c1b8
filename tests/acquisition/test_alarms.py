"""Alarms by rule: raised and over after the time that is asked for, told everywhere, and a command is run."""

from __future__ import annotations

import math
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import AlarmSection
from seatrial.acquisition.config.trial_file import parse_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.logger.health import Alarm, Alarms, Health, SourceHealth, read_host_clock
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import config_text, free_port, wait_for


def rule(**more: object) -> AlarmSection:
    return AlarmSection(**{"name": "wind", "figure": "wind_speed_mps", "above": 20.0, **more})  # type: ignore[arg-type]


@given(st.lists(st.floats(0, 40) | st.just(math.nan), max_size=60), st.integers(0, 5))
def test_an_alarm_stands_for_what_has_lasted(values: list[float], for_s: int) -> None:
    """Looked at once a second: its state is that of the last values that agreed for so long, unknown ones aside."""
    alarm, told, lasting = Alarm(rule(for_s=float(for_s))), [], list[bool]()
    for second, value in enumerate(values):
        told.append(alarm.update(value, float(second)))
        lasting = [] if math.isnan(value) else [*lasting, value > 20.0]
        recent = lasting[-(for_s + 1) :]
        if len(recent) == for_s + 1 and len(set(recent)) == 1:
            assert alarm.raised == recent[0]
        if told[-1]:
            assert set(recent) == {alarm.raised}
    changes = sum(told)
    assert alarm.raised == bool(changes % 2)


def test_what_is_told() -> None:
    told, health = list[str](), Health({"gps": SourceHealth("gps")})
    alarms = Alarms([rule(for_s=0.0, below=2.0)], health, lambda level, text: told.append(f"{level}: {text}"))
    for second, value in enumerate((10.0, 25.0, 26.0, 10.0, 1.0)):
        alarms.check({"wind_speed_mps": value}, float(second))
    assert told == [
        "error: ALARM wind: wind_speed_mps is 25, above 20 or below 2",
        "warning: alarm over: wind: wind_speed_mps is 10, no more above 20 or below 2",
        "error: ALARM wind: wind_speed_mps is 1, above 20 or below 2",
    ]
    assert list(health.alarms) == ["wind"]


def script(folder: Path, text: str) -> tuple[str, ...]:
    (folder / "command.py").write_text(text)
    return sys.executable, str(folder / "command.py")


def test_a_command_gets_the_text_and_one_that_fails_is_told(tmp_path: Path) -> None:
    said, told = tmp_path / "said.txt", list[str]()
    words = "os.environ['SEATRIAL_ALARM'] + os.environ['SEATRIAL_STATE'] + input()"
    fails = script(tmp_path, f"import os, sys\nopen({str(said)!r}, 'w').write({words})\nsys.exit(3)")
    rules = [
        rule(figure="source.gps.age_s", above=-1.0, for_s=0.0, command=fails),
        rule(name="nobody", figure="source.gps.failed", below=1.0, for_s=0.0, command=("/nowhere/to/be/found",)),
    ]
    with Alarms(rules, Health({"gps": SourceHealth("gps")}), lambda level, text: told.append(text)):
        wait_for(lambda: any("ended with" in text for text in told))
    assert said.read_text().startswith("windraisedwind: source.gps.age_s is")
    assert "alarm wind: its command ended with 3" in told
    assert "alarm nobody: its command cannot be run: No such file or directory" in told


def test_a_command_that_outlasts_the_recording_ends_by_itself(tmp_path: Path) -> None:
    began, go_on, over = tmp_path / "began", tmp_path / "go_on", tmp_path / "over"
    lasting = script(
        tmp_path,
        f"import pathlib, time\npathlib.Path({str(began)!r}).touch()\n"
        f"while not pathlib.Path({str(go_on)!r}).exists():\n    time.sleep(0.05)\n"
        f"pathlib.Path({str(over)!r}).touch()",
    )
    rules = [rule(figure="source.gps.age_s", above=-1.0, for_s=0.0, command=lasting)]
    with Alarms(rules, Health({"gps": SourceHealth("gps")}), lambda *_: None):
        wait_for(began.exists)
    go_on.touch()
    wait_for(over.exists)
    for thread in threading.enumerate():
        if thread.name == "alarm command":  # no process is left whose end nobody has seen
            thread.join()


def test_the_recording_has_its_alarms_and_the_state_of_the_clock(tmp_path: Path) -> None:
    """A source that says nothing: half a second of silence is too much."""
    sign, stop = tmp_path / "sign", threading.Event()
    text = (
        config_text(f'type = "udp"\nport = {free_port()}\n')
        + f"""
[[alarm]]
name = "mute"
figure = "source.line.age_s"
above = 0.5
for_s = 0
command = ["touch", "{sign}"]
"""
    )

    def stop_at_the_sign() -> None:
        wait_for(sign.exists)
        stop.set()

    threading.Thread(target=stop_at_the_sign).start()
    paths, health = record(parse_config(text, tmp_path / "trial.toml"), tmp_path / "out", stop=stop)
    assert list(health.alarms) == ["mute"]
    recording = read_recording(paths[0])
    assert any("ALARM mute: source.line.age_s is" in text for _, text in recording.events)
    assert recording.health["host clock"]["state"] == read_host_clock().state


@pytest.mark.parametrize(("section", "said"), [
    ('name = "a"\nfigure = "heading_deg"', "needs a limit"),
    ('name = "a"\nfigure = "heading_deg"\nabove = "x"', "above"),
    ('name = "a"\nfigure = "heading_deg"\nabove = inf', "above"),
])  # fmt: skip
def test_a_rule_that_says_nothing_is_refused(section: str, said: str) -> None:
    text = config_text(f'type = "udp"\nport = {free_port()}\n') + f"\n[[alarm]]\n{section}\n"
    with pytest.raises(ConfigurationError, match=said):
        parse_config(text, "trial.toml")


@pytest.mark.parametrize(
    ("figure", "said"), [("heading_deg.age", "say heading_deg.age_s"), ("yaw", "say yaw_rate_dps")]
)
def test_a_figure_that_there_is_not_is_told_before_anything_is_written(
    tmp_path: Path, figure: str, said: str
) -> None:
    text = config_text(f'type = "udp"\nport = {free_port()}\n')
    text += f'\n[[alarm]]\nname = "a"\nfigure = "{figure}"\nabove = 1\n'
    with pytest.raises(ConfigurationError, match=said):
        record(parse_config(text, tmp_path / "trial.toml"), tmp_path / "out", duration_s=1.0)
    assert not (tmp_path / "out").exists()
