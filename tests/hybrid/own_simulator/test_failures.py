"""What goes wrong with a simulator of another make: maps, runs, and questions that it cannot answer."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError, InputError, SourceError
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.vessel.black_box import names_of_windows, simulate_black_box
from seatrial.hybrid.vessel.simulator_process import _Worker
from tests.conftest import Command, nightly
from tests.hybrid.own_simulator import fmus
from tests.hybrid.own_simulator.conftest import Sailed

FAST = 3  # the run that exceeds 20 kn, at which some ships of these tests fail
NO_STEP = "class Ship:\n    length_m = 9.0\n"
STEP = "    def step(self, state, controls, wind, dt_s): ...\n"


@pytest.fixture(scope="session")
def runs() -> tuple[Floats, Floats, Floats]:
    """Eight runs of ten seconds, one of them too fast from the start."""
    start = np.tile([0.0, 0.0, 1.0, 4.0, 0.0, 0.0], (8, 1))
    start[:, 0] = np.arange(8.0)
    start[FAST, 3] = 11.0
    return start, np.tile([2.0, 0.2], (8, 10, 1)), np.tile([0.5, 5.0], (8, 10, 1))


@pytest.mark.parametrize(
    ("ship", "words"),
    [
        ("ReturningNothing", "returned no number after 1 s"),
        ("Hanging", "did not come back from step 1 within 0.5 s"),
        ("Dying", "ended its process in step 1, with code -6"),
        ("FMI 2.0 raises", "could not step (FMI status error)"),
        *nightly(
            ("Failing", "raised ZeroDivisionError: too fast (sailer.py, line "),
            ("FMI 3.0 raises", "could not step (FMI status error)"),
            ("FMI 2.0 hangs", "did not come back from step 1 within 1 s"),
            ("FMI 3.0 dies", "ended its process in step 1, with code -6"),
        ),
    ],
)
def test_failed_window_is_named_and_the_others_are_predicted(
    ship: str, words: str, shipyard: Path, runs: tuple[Floats, Floats, Floats], caplog: pytest.LogCaptureFixture
) -> None:
    """Whether it raises, returns no number, hangs or takes its process along; nothing else is lost."""
    name: str | Path = f"{shipyard}/sailer.py:{ship}"
    if ship.startswith("FMI"):
        _, version, mode = ship.split()
        name = fmus.build_fmu(shipyard, int(version[0]), name=f"{mode}{version[0]}", mode=mode)
    model, sound = st.load_simulator(name), st.load_simulator(f"{shipyard}/sailer.py:Sailer")
    times = pd.date_range("2026-06-01T08:00", periods=8, freq="s", tz="UTC")
    with caplog.at_level(logging.WARNING, "seatrial.own"):
        states = simulate_black_box(model, *runs, 1.0, names_of_windows(np.array(["trial"] * 8), times))
    assert words in caplog.text
    assert "left out the window of trial from 2026-06-01 08:00:03Z:" in caplog.text
    assert caplog.text.count("left out") == 1
    assert np.isnan(states[FAST, 1:]).all()
    others = np.arange(8) != FAST
    np.testing.assert_allclose(states[others], simulate_black_box(sound, *runs, 1.0)[others], atol=1e-9)


def test_failed_runs_without_names_are_counted(
    shipyard: Path, runs: tuple[Floats, Floats, Floats], caplog: pytest.LogCaptureFixture
) -> None:
    """Those of a derivative are no windows."""
    with caplog.at_level(logging.WARNING, "seatrial.own"):
        simulate_black_box(st.load_simulator(f"{shipyard}/sailer.py:Failing"), *runs, 1.0)
    assert "left out 1 of 8 runs: the simulator raised ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("busy", [False, True])
def test_process_that_is_no_longer_wanted_ends_in_silence(
    busy: bool, shipyard: Path, runs: tuple[Floats, Floats, Floats], capfd: pytest.CaptureFixture[str]
) -> None:
    """Whether it waits for a call or has an answer on its way."""
    worker = _Worker(st.load_simulator(f"{shipyard}/sailer.py:Sailer").spec)
    worker.send("load")
    if busy:
        worker.send("run", *runs, 1.0)
    else:
        worker.receive(120.0)
    worker._connection.close()
    assert worker._process.wait(120.0) == 0
    assert capfd.readouterr().err == ""


def test_simulator_that_always_fails_is_an_error(shipyard: Path, runs: tuple[Floats, Floats, Floats]) -> None:
    """Not a validation of nothing."""
    start, controls, wind = runs
    model = st.load_simulator(f"{shipyard}/sailer.py:Failing")
    with pytest.raises(SourceError, match=r"sailer.py:Failing: failed in all 8 runs: it raised ZeroDivisionError"):
        simulate_black_box(model, start + np.array([0, 0, 0, 20, 0, 0]), controls, wind, 1.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"u", unit = "kn"', '"u", unit = "deg"',
         "state.surge.unit is 'deg', which does not measure it; use one of m/s"),
        ('"u", unit = "kn"', '"u", unit = "m/s"',
         "state.surge.unit is 'm/s': the FMU states knots for u; write knots"),
        ('variable = "n"', 'variable = "x"',
         "control.propeller_rpm.variable is 'x', which is an output of the FMU; name an input or a tunable"),
        ('variable = "yaw"', 'variable = "delta"',
         "state.heading.variable is 'delta', which is an input of the FMU; name an output"),
        ('north = { variable = "y", unit = "m", start = "y0" }', "", "state lacks north; write north = "),
        ('variable = "v"', 'variable = "vv"',
         "state.sway.variable is 'vv', which the FMU does not have; write one of v"),
        ('start = "r0"', 'start = "r"',
         "state.yaw_rate.start is 'r', which is an output of the FMU, and its start cannot be set.*run_in"),
        ('start = "u0"', 'start = "v0"', "starts with surge at 5 where it was given 7.77.*start of surge"),
        ('"port", start = "v0"', '"left", start = "v0"', "state.sway.positive is 'left'; write starboard or port"),
        ("rudder_angle_deg =", "rudder_deg =", "control.rudder_deg is not a signal of it; write propeller_rpm"),
        ("[control]", "[controls]", "controls: is not a known key here"),
        ("length_m = 30.0", "", "ship.length_m: is missing"),
        ("[wind]", '[solver]\nstart = "set"\n\n[wind]', "state.north.start is 'y0', which is a parameter.*is set"),
    ],
)  # fmt: skip
def test_wrong_entry_of_a_map_is_one_clear_error(
    old: str, new: str, words: str, tmp_path: Path, runs: tuple[Floats, Floats, Floats]
) -> None:
    """With file, line and key, what is wrong, and what to write."""
    file = fmus.build_fmu(tmp_path, 2)
    text = fmus.SHIP + fmus.MAP
    assert old in text
    file.with_suffix(".toml").write_text(text.replace(old, new))
    with pytest.raises(ConfigurationError, match=words) as raised:
        simulate_black_box(st.load_simulator(file), *runs, 1.0)
    assert str(tmp_path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_fmu_without_a_map_says_how_to_make_one(tmp_path: Path) -> None:
    """Nothing is guessed."""
    file = fmus.build_fmu(tmp_path, 3)
    file.with_suffix(".toml").unlink()
    with pytest.raises(ConfigurationError, match=r"has no map.*`seatrial vessel map sailer.fmu` proposes one"):
        st.load_simulator(file)
    (tmp_path / "broken.fmu").write_bytes(b"no zip")
    with pytest.raises(InputError, match="is not a readable FMU"):
        st.load_simulator(tmp_path / "broken.fmu")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (NO_STEP, "has no step"),
        (f"{NO_STEP}    def step(self, state): ...\n", "takes other arguments"),
        (f"class Ship:\n{STEP}", "states no length_m"),
        (f"{NO_STEP}{STEP}", "states no actuators"),
        (f'{NO_STEP}    actuators = {{"sail": "sail"}}\n{STEP}', "actuator sail: no kind 'sail'"),
        ("Ship = 1\n", "is not a class"),
        ("Ship = 1 / 0\n", "ZeroDivisionError"),
    ],
)
def test_class_that_is_no_simulator_says_what_it_lacks(code: str, words: str, tmp_path: Path) -> None:
    """Before anything is simulated."""
    (tmp_path / "ship.py").write_text(code)
    with pytest.raises(ConfigurationError, match=words):
        st.load_simulator(f"{tmp_path}/ship.py:Ship")


@pytest.mark.parametrize(
    "arguments",
    [
        ("diagnose", "{file}", "-o", "{folder}/out", "--vessel", "{ship}", "--identify"),
        ("identify", "{file}", "-o", "{folder}/out.toml", "--vessel", "{ship}"),
        ("vessel", "check", "{ship}"),
        ("plan", "--vessel", "{ship}"),
        ("effects", "--vessel", "{ship}"),
    ],
)
def test_question_about_the_inside_is_refused_with_a_way_on(
    arguments: tuple[str, ...], shipyard: Path, sailed: Sailed, command: Command, tmp_path: Path
) -> None:
    """One sentence, exit code 1."""
    names = {"file": sailed("Sailer"), "folder": tmp_path, "ship": f"{shipyard}/sailer.py:Sailer"}
    done = command(*(argument.format(**names) for argument in arguments))
    assert done.code == 1
    last = " ".join(done.err.split())
    assert "is a simulator, whose equations cannot be looked into" in last
    assert "`seatrial vessel new`" in last
