"""Out as an FMU and in again: the export is mapped without a question and gives the figures of the vessel."""

from __future__ import annotations

import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.evaluation.validate import Validation
from seatrial.hybrid.export.equations import equations_of
from seatrial.hybrid.export.fmu import build_fmu
from seatrial.hybrid.vessel.files import load_vessel
from tests.conftest import few_epochs, nightly

VESSEL = "gunnerus_short"
BY_DAY = ["kvlcc2_7m", "gunnerus_long"]
pytestmark = pytest.mark.skipif(shutil.which("cc") is None and shutil.which("gcc") is None,
                                reason="no C compiler here, with which an FMU is made")  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("fmpy", reason="FMPy, which runs FMUs, is not installed")
    pytest.importorskip("casadi", reason="CasADi, which writes the C code of FMUs, is not installed")
    return tmp_path_factory.mktemp("round_trip")


@pytest.fixture(scope="module", params=[3, *nightly(2)], ids=["FMI 3.0", "FMI 2.0"])
def fmu(request: pytest.FixtureRequest, folder: Path) -> Path:
    """The vessel as an FMU, with the map beside it that is proposed."""
    file = folder / f"fmi_{request.param}.fmu"
    st.export_vessel(VESSEL, file, fmi=request.param)
    st.vessel_map(file, file.with_suffix(".toml"))
    return file


@pytest.mark.parametrize("vessel", [*BY_DAY, *nightly(*(name for name in st.vessels() if name not in BY_DAY))])
def test_exported_ship_is_mapped_without_a_question(vessel: str, folder: Path) -> None:
    """Its actuators, its lengths and all conventions are in what the FMU says of its variables."""
    file, ship = folder / f"{vessel}.fmu", load_vessel(vessel)
    plant = vessel_plant(ship)
    build_fmu(ship, equations_of(ship, plant)).write(file, [])
    assert not st.vessel_map(file, file.with_suffix(".toml")).questions
    mapped = st.load_simulator(file)
    assert mapped.layout == ship.actuators
    assert mapped.length_between_perpendiculars_m == plant.length_between_perpendiculars_m
    assert mapped.length_overall_m == plant.length_overall_m
    assert mapped.name == ship.name
    for actuator, entry in zip(mapped.actuator, ship.actuator, strict=True):
        for field in fields(actuator):
            if hasattr(entry, field.name) and field.name != "x_m":  # a propeller's makes no difference
                expected = getattr(entry, field.name)
                assert getattr(actuator, field.name) == (
                    expected if isinstance(expected, str) else pytest.approx(expected, rel=1e-9)
                )


@pytest.fixture(scope="module")
def by_vessel(unseen: Path) -> Validation:
    """The vessel by its own file."""
    return st.validate(unseen, vessel=VESSEL, stride_s=20)


def test_figures_are_those_of_the_vessel(fmu: Path, by_vessel: Validation, unseen: Path) -> None:
    """Start states, every predicted position, and the mean error."""
    by_fmu = st.validate(unseen, vessel=fmu, stride_s=20)
    assert len(by_fmu.windows) > 20
    np.testing.assert_allclose(by_fmu.windows.start, by_vessel.windows.start, atol=1e-9)
    np.testing.assert_allclose(by_fmu.tracks["reference"], by_vessel.tracks["reference"], atol=1e-6)
    errors = [one.scores["reference"].mean_distance_m for one in (by_fmu, by_vessel)]
    assert errors[0] == pytest.approx(errors[1], abs=1e-6)
    assert errors[0] > 0.1


@pytest.mark.parametrize("fmu", [3, *nightly(2)], ids=lambda version: f"FMI {version}.0", indirect=True)
def test_calibrator_learns_the_same_beside_an_fmu(
    fmu: Path, earlier: list[Path], unseen: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the model lacks is the same, so the network is."""
    monkeypatch.setattr("seatrial.hybrid.calibrators.make_calibrator", few_epochs)
    trained = (st.train(earlier[:2], vessel, "additive", stride_s=20) for vessel in (VESSEL, fmu))
    scores = [st.validate(unseen, calibrator, stride_s=20).scores for calibrator in trained]
    means = [one["hybrid"].mean_distance_m for one in scores]
    assert means[0] == pytest.approx(means[1], abs=1e-6)
    assert means[0] < scores[0]["reference"].mean_distance_m
