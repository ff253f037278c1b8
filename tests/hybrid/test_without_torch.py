"""Without PyTorch: all is imported, calibrators predict, and what must train a network says what to install."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from seatrial.hybrid.calibrators.adaptive import fit_parameter_vector
from tests.conftest import SMALL_HORIZON_S, Command

EVERY_MODULE = """
import sys
from importlib import import_module
from importlib.machinery import PathFinder

class NoTorch(PathFinder):
    @classmethod
    def find_spec(cls, name, *where):
        return None if name == "torch" else super().find_spec(name, *where)

sys.meta_path[sys.meta_path.index(PathFinder)] = NoTorch
from pkgutil import walk_packages
import seatrial.acquisition, seatrial.analysis, seatrial.hybrid
for package in (seatrial.acquisition, seatrial.analysis, seatrial.hybrid):
    for each in walk_packages(package.__path__, package.__name__ + "."):
        if each.name != "seatrial.hybrid.calibrators.network_training":
            import_module(each.name)
"""


def test_no_module_but_one_imports_torch() -> None:
    done = subprocess.run([sys.executable, "-c", EVERY_MODULE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]


@pytest.fixture
def without_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.hybrid.calibrators.find_spec", lambda name: None)
    monkeypatch.setitem(sys.modules, "seatrial.hybrid.calibrators.network_training", None)


@pytest.mark.usefixtures("without_torch")
def test_a_network_predicts_but_is_not_trained(
    command: Command, small_folder: Path, unseen: Path, tmp_path: Path
) -> None:
    predicted = command("predict", unseen, "--at", "+600", "--calibrator", small_folder, "--json")
    assert len(json.loads(predicted.out)["track"]) == SMALL_HORIZON_S + 1
    for method in ("paper", "data_driven"):
        refused = command("train", unseen, "-o", tmp_path / "new", "--method", method)
        assert refused.code == 1
        assert "pip install 'seatrial[networks]'" in refused.err
        assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("without_torch")
def test_the_adaptive_one_is_trained_and_judged(
    command: Command, earlier: list[Path], unseen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All is there but the network that would stand beside it."""
    monkeypatch.setattr(
        "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector", partial(fit_parameter_vector, steps=1)
    )
    few = "--horizon", str(SMALL_HORIZON_S), "--stride", "60"
    trained = command("train", *earlier[:2], "-o", tmp_path / "new", *few)
    assert trained.code == 0
    assert "seatrial[networks]" in trained.err
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "calibrator.json", "calibrator.safetensors",
    ]  # fmt: skip
    judged = command("validate", unseen, "--calibrator", tmp_path / "new", "--stride", "60", "--json")
    methods = json.loads(judged.out)["methods"]
    assert "hybrid" in methods
    assert "data_driven" not in methods
