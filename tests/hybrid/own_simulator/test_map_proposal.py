"""The map of an FMU as it is proposed: what is certain, what is asked, and that answers make a map that works."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.acquisition.core.errors import UsageError
from seatrial.hybrid.vessel.dynamics import simulate_batch
from tests.conftest import Command
from tests.hybrid.own_simulator import fmus

ANSWERS = {
    "ship.length_m": "30.0", "axes": "enu", "state.north": "y", "state.east": "x",
    "control.rudder_angle_deg.positive": "port", "wind.direction.convention": "from",
    "wind.direction.zero": "east", "wind.direction.positive": "port", "wind.direction.frame": "true",
}  # fmt: skip


@pytest.mark.parametrize("version", [2, 3])
def test_answered_questions_make_the_map_written_by_hand(version: int, tmp_path: Path) -> None:
    """Every question that is asked is needed, and no other; predictions by both maps are the same numbers."""
    file = fmus.build_fmu(tmp_path, version)
    by_hand = st.load_simulator(file)
    proposal = st.vessel_map(file)
    assert {question.key for question in proposal.questions} == set(ANSWERS)
    assert "state.surge is the output u [kn]" in proposal.reasons
    proposal = st.vessel_map(file, file.with_suffix(".toml"), answer=ANSWERS)
    assert not proposal.questions
    proposed = st.load_simulator(file)
    run = (
        np.array([[1.0, 2.0, 3.0, 4.0, 0.1, 0.02]]),
        np.tile([2.0, 0.1], (1, 20, 1)),
        np.tile([0.5, 9.0], (1, 20, 1)),
    )
    states = [simulate_batch(model, *run, 1.0).states for model in (by_hand, proposed)]
    np.testing.assert_array_equal(states[0], states[1])


def test_unstated_units_are_asked(tmp_path: Path) -> None:
    """A number without a unit may be anything."""
    file = fmus.build_fmu(tmp_path, 2, units=False)
    keys = {question.key for question in st.vessel_map(file).questions}
    assert {"state.heading.unit", "state.surge.unit", "wind.speed.unit"} <= keys


def test_open_question_leaves_no_map(tmp_path: Path, command: Command) -> None:
    """They are printed with their keys; an answer to none of them is an error."""
    file, output = fmus.build_fmu(tmp_path, 2), tmp_path / "map.toml"
    done = command("vessel", "map", file, "-o", output, "--answer", "axes=enu")
    assert done.code == 1
    assert not output.exists()
    assert "unclear: wind.direction.convention: from or to" in done.err
    assert "8 questions open" in done.err
    arguments = [word for key, value in ANSWERS.items() for word in ("--answer", f"{key}={value}")]
    done = command("vessel", "map", file, "-o", output, *arguments)
    assert done.code == 0, done.err
    assert output.read_text().startswith("[ship]")
    with pytest.raises(UsageError, match="axis answers no question"):
        st.vessel_map(file, answer={**ANSWERS, "axis": "ned"})
