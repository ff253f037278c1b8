"""Two sources of one talker on one line, whose sentences have neither time nor position, are told apart once their
values take turns; a source alone never is."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.protocols.clock import InterleavedSources
from seatrial.acquisition.protocols.nmea0183 import Nmea0183Decoder, frame_sentence
from seatrial.acquisition.recording.reader import read_recording
from seatrial.hybrid.simulation.trial import simulate_trial
from tests.acquisition.conftest import config_text
from tests.conftest import Command, nightly

NAMES = ("heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "wind_direction_deg", "wind_speed_mps", "port_rpm")


def sources_of(values: Floats, quantity: str, seconds: Floats) -> list[int]:
    notices: deque[tuple[str, str]] = deque()
    sources = InterleavedSources(notices)
    times = np.rint(seconds * 1e9).astype(int).tolist()
    numbers = [
        sources.source_number("line/HE:HDT", quantity, value, time)
        for value, time in zip(values.tolist(), times, strict=True)
    ]
    assert len(notices) == (max(numbers) > 1)
    return numbers


def merged(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> tuple[Floats, Floats, list[int]]:
    """Two series of seconds and values as they come on one line, and of which of them each value is."""
    seconds, values = np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])
    owner = np.repeat([1, 2], [first[0].size, second[0].size])
    order = np.argsort(seconds, kind="stable")
    return seconds[order], values[order], owner[order].tolist()


def assert_same_owner(numbers: list[int], owner: list[int]) -> None:
    """From where there are two sources each has a number of its own, whichever it is."""
    first = numbers.index(2)
    assert numbers[first:] in (owner[first:], [3 - number for number in owner[first:]])


@pytest.mark.parametrize("every_s", [(1.0, 1.0), (0.1, 0.1), (1.0, 0.5), (0.2, 1.0)])
@pytest.mark.parametrize("offset_deg", [20.0, 62.7, 180.0])
def test_two_compasses_are_told_apart_through_turns_and_north(
    every_s: tuple[float, float], offset_deg: float
) -> None:
    def compass(every: float, lead_s: float, offset: float, seed: int) -> tuple[Floats, Floats]:
        seconds = lead_s + np.arange(0.0, 240.0, every)
        noise = np.random.default_rng(seed).normal(0.0, 0.2, seconds.size)
        return seconds, (350.0 + offset + 40.0 * np.sin(2.0 * np.pi * seconds / 90.0) + noise) % 360.0

    pair = compass(every_s[0], 0.0, 0.0, 1), compass(every_s[1], 0.04, offset_deg, 2)
    seconds, values, owner = merged(*pair)
    numbers = sources_of(values, "heading_deg", seconds)
    assert numbers.index(2) <= 65
    assert_same_owner(numbers, owner)


def test_a_compass_that_falls_silent_leaves_the_other_its_name() -> None:
    seconds = np.arange(0.0, 200.0)
    steady, silent = (seconds, 40.0 + 0.7 * seconds), (seconds[:60] + 0.5, 100.0 + 0.7 * seconds[:60])
    times, values, _ = merged(steady, silent)
    numbers = np.array(sources_of(values, "heading_deg", times))
    assert (numbers[times > 64.0] == 1).all()  # it comes past the other's last value


@pytest.mark.parametrize("every_s", [1.0, 0.3, 0.1])
def test_compasses_that_meet_are_told_apart_by_when_they_are_due(every_s: float) -> None:
    seconds, others = np.arange(0.0, 200.0), np.arange(0.05, 200.0, every_s)
    times, values, owner = merged((seconds, 100.0 + 0.0 * seconds), (others, 130.0 - 0.25 * others))
    assert_same_owner(sources_of(values, "heading_deg", times), owner)


@pytest.mark.parametrize("vessel", ["gunnerus_long", *nightly("otter_2m", "esso_osaka_3m")])
@pytest.mark.parametrize("manoeuvre", ["zigzag_20_20", "stopping", "tunnel_test"])
def test_no_channel_of_a_simulated_ship_is_of_two_sources(vessel: str, manoeuvre: str) -> None:
    for rate_hz in (1.0, 10.0):
        trial, _ = simulate_trial(vessel, "moderate", manoeuvre, 300.0, rate_hz, 5)
        seconds = np.arange(len(trial)) / rate_hz
        for name in set(NAMES) & set(trial):
            assert set(sources_of(trial[name].to_numpy(), name, seconds)) == {1}, name


@given(
    st.lists(st.tuples(st.floats(-35.0, 35.0), st.integers(3, 20)), min_size=5, max_size=40),
    st.floats(0.0, 3.0),
    st.integers(0, 2**32 - 1),
)
def test_a_rudder_that_is_thrown_over_and_back_is_one(
    orders: list[tuple[float, int]], noise_deg: float, seed: int
) -> None:
    values = np.concatenate([np.full(count, angle) for angle, count in orders])
    values = values + np.random.default_rng(seed).normal(0.0, noise_deg, values.size)
    assert set(sources_of(values, "rudder_angle_deg", np.arange(values.size))) == {1}


@given(st.floats(0.0, 100.0), st.integers(0, 2**32 - 1))
def test_noise_is_of_one_source(scale: float, seed: int) -> None:
    values = np.random.default_rng(seed).normal(0.0, scale, 300)
    assert set(sources_of(values, "wind_speed_mps", np.arange(values.size))) == {1}


def test_the_engines_of_a_pair_are_no_two_sources() -> None:
    decoder = Nmea0183Decoder()
    for number in range(100):
        line = frame_sentence(f"IIRPM,S,{1 + number % 2},{100 + 80 * (number % 2)},,A").strip()
        decoder.decode(Frame("line", "nmea0183", line, 0, number * 10**9))
    assert not [text for _, text in decoder.notices if "alternates" in text]


def test_one_of_two_compasses_on_a_line_has_the_channel(tmp_path: Path, command: Command) -> None:
    lines = [
        f"2026-05-17T12:00:{second:02d}.{part}Z {frame_sentence(f'HEHDT,{heading},T').decode().strip()}"
        for second in range(60)
        for part, heading in ((0, 57.3), (5, 120.0))
    ]
    (tmp_path / "in.log").write_text("\n".join(lines) + "\n")
    config = tmp_path / "trial.toml"
    config.write_text(config_text('type = "file"\npath = "in.log"\n', ("heading_deg",)))
    done = command("record", config, "-o", tmp_path / "out")
    assert "two sources under one talker" in done.err
    (path,) = (tmp_path / "out").glob("*.mcap")
    series = read_recording(path).series["heading_deg"]
    assert series.value[16:].tolist() == [57.3] * (series.value.size - 16)
    assert series.value.size > 60
