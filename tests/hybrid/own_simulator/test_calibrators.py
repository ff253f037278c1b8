"""The paper's method on a simulator of another make: a calibrator learns what it lacks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import seatrial as st
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.hybrid.calibrators import TrainedCalibrator, refuse_untrainable
from tests.conftest import Command, few_epochs
from tests.hybrid.own_simulator.conftest import Sailed

RATIO = """
class Ratio:
    def fit(self, windows, track):
        start = track[:, :1, :2]
        ways = track[:, 1:, :2] - start, windows.reference[:, 1:, :2] - start
        self.ratio = float((ways[0] * ways[1]).sum() / (ways[1] ** 2).sum())

    def predict(self, windows):
        start = windows.reference[:, :1, :2]
        return start + self.ratio * (windows.reference[..., :2] - start)
"""


@pytest.fixture(scope="module")
def trained(shipyard: Path, sailed: Sailed) -> TrainedCalibrator:
    """The additive network on the simulator, trained for seconds on recordings of a ship with more drag."""
    earlier = [sailed("Draggy", seed, 600.0) for seed in range(2)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.hybrid.calibrators.make_calibrator", few_epochs)
        return st.train(earlier, f"{shipyard}/sailer.py:Sailer", "additive")


@pytest.mark.slow
def test_calibrator_takes_much_of_the_error_of_a_simulator(trained: TrainedCalibrator, sailed: Sailed) -> None:
    """On a voyage that neither has seen, of a ship that the simulator is not quite the model of."""
    recording = sailed("Draggy", 7, 600.0)
    validation = st.validate(recording, trained)
    assert validation.reduction is not None
    assert validation.reduction > 0.3
    assert validation.model is not None
    assert validation.model.name == "Sailer (sailer.py:Sailer)"
    prediction = st.predict(recording, "+200", trained)
    assert prediction.region_m is not None
    assert prediction.measured is not None


def test_saved_calibrator_runs_its_simulator_only_if_that_is_named(
    trained: TrainedCalibrator, shipyard: Path, sailed: Sailed, tmp_path: Path, command: Command
) -> None:
    """And only the one that it was trained on."""
    name, recording = f"{shipyard}/sailer.py:Sailer", sailed("Draggy", 7, 600.0)
    folder = tmp_path / "calibrator"
    st.save_calibrator(trained, folder)
    with pytest.raises(InputError, match=r"needs the simulator that it was trained on.*sailer.py:Sailer.*--vessel"):
        st.load_calibrator(folder)
    with pytest.raises(InputError, match="was trained on another simulator"):
        st.load_calibrator(folder, vessel=_changed(tmp_path, shipyard))
    before = st.predict(recording, "+200", trained)
    arguments = ("predict", recording, "--at", "+200", "--calibrator", folder, "--json")
    done = command(*arguments, "--vessel", name)
    assert done.code == 0, done.err
    assert [row["north_m"] for row in done.json["track"]] == pytest.approx(before.track[:, 0].tolist())
    assert command(*arguments).code == 1
    with pytest.raises(ConfigurationError, match="is not the model that the calibrator was trained on"):
        st.validate(recording, trained, "gunnerus_short")
    assert json.loads((folder / "calibrator.json").read_text())["vessel"]["simulator"] == name


def _changed(folder: Path, shipyard: Path) -> str:
    (folder / "sailer.py").write_text((shipyard / "sailer.py").read_text() + "# changed\n")
    (folder / "sailer.toml").write_text((shipyard / "sailer.toml").read_text())
    return f"{folder}/sailer.py:Sailer"


def test_method_that_sets_states_is_refused_where_none_can_be_set(shipyard: Path) -> None:
    """With the names of methods that need none."""
    model = st.load_simulator(f"{shipyard}/sailer.py:Sailer")
    refuse_untrainable("adaptive", model)
    with pytest.raises(ConfigurationError, match=r"cannot start from one.*use --method additive or paper"):
        refuse_untrainable("adaptive", replace(model, run_in_s=120.0))


def test_comparison_of_methods_has_the_simulator_as_reference(
    shipyard: Path, sailed: Sailed, tmp_path: Path
) -> None:
    """A calibrator of a user's own beside it, which takes some of its error."""
    (tmp_path / "ratio.py").write_text(RATIO)
    evaluation = st.evaluate(
        sailed("Draggy", 0, 600.0), f"{shipyard}/sailer.py:Sailer", methods=[f"{tmp_path}/ratio.py:Ratio"],
        splits=["leg"], draws=2,
    )  # fmt: skip
    errors = {
        name: row["mean_distance_m"]["value"]
        for name, row in evaluation.as_dict()["splits"]["leg"]["methods"].items()
    }
    assert errors[f"{tmp_path}/ratio.py:Ratio"] < errors["reference"] < errors["constant_velocity"]
