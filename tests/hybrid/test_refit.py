"""A model off in many coefficients: refitted before the diagnosis, which then names what no coefficient is."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import ModelRangeError, Progress
from seatrial.acquisition.core.result import from_json
from seatrial.hybrid import workflows
from seatrial.hybrid.diagnosis.gap import fold_of, unseen_windows
from seatrial.hybrid.diagnosis.linearise import model_of
from seatrial.hybrid.diagnosis.log import log_of
from seatrial.hybrid.diagnosis.regression import OPERATION
from seatrial.hybrid.diagnosis.result import (
    Diagnosis,
    Estimate,
    Extras,
    IdentifiedCorrection,
    Remainder,
    UnknownCause,
)
from seatrial.hybrid.identification.fit import coefficients_of, with_values
from seatrial.hybrid.report.diagnosis import (
    basis_rows,
    coefficient_rows,
    correction_sentence,
    page_of,
    structure_rows,
)
from seatrial.hybrid.simulation.trial import simulate_trial
from seatrial.hybrid.vessel.files import Vessel, load_vessel
from seatrial.hybrid.workflows import Checked, DiagnosisRun, diagnose_tables, vessel_with_effects
from tests.hybrid.diagnosis.made_up import named

SHIP = load_vessel("gunnerus_long")
NOTHING: Any = None  # in the place of a conclusion that is only passed on


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return simulate_trial(SHIP, "gentle", "programme", 900.0, 1.0, 3)[0]


def off_by(share: float, ship: Vessel, seed: int) -> Vessel:
    """The ship with each coefficient of hull and pods off by a share to either side."""
    generator = np.random.default_rng(seed)
    wrong = {}
    for each in coefficients_of(ship):
        if each.name.startswith(("hull", "port")):
            value = each.start * (1.0 + share * generator.choice([-1.0, 1.0]))
            wrong |= dict.fromkeys((each.name, *each.tied), value)
    return with_values(ship, wrong)


def test_forces_of_one_ship_do_not_move_and_those_of_a_heavier_one_do_all_round(table: pd.DataFrame) -> None:
    log = log_of([table])
    assert workflows.force_difference_by_component(log, SHIP, SHIP) == {"surge": 0.0, "sway": 0.0, "yaw": 0.0}
    weak = with_values(SHIP, {"port.thrust_nn": 0.7, "starboard.thrust_nn": 0.7})
    weaker = with_values(SHIP, {"port.thrust_nn": 0.6, "starboard.thrust_nn": 0.6})
    one, two = (workflows.force_difference_by_component(log, SHIP, each) for each in (weak, weaker))
    lost = 1.0 - 0.7 / 0.8218
    assert 0.2 * lost < one["surge"] < 3.0 * lost  # rms and extremes, bollard and under way
    assert two["surge"] / one["surge"] == pytest.approx((0.8218 - 0.6) / (0.8218 - 0.7), rel=0.05)


def test_the_seconds_of_a_fold_have_no_part_in_its_refit(table: pd.DataFrame) -> None:
    log = log_of([table])
    rest = workflows._tables_without_fold({"0": table}, log, 1)["0"]
    out = set(log.time_s[fold_of(log) == 1].tolist())
    assert out
    assert not out & set((rest.index.asi8 // 10**9).tolist())
    assert len(rest) == len(table) - len(out)


def test_what_is_determined_of_one_thruster_is_so_of_its_twin(table: pd.DataFrame) -> None:
    """They are one unknown with two names."""
    windows = unseen_windows(log_of([table]), model_of(SHIP, {}))
    levels = {"value": 0.9, "low": 0.8, "high": 1.0, "start": 1.0}
    found = SimpleNamespace(coefficients=(
        SimpleNamespace(name="port.thrust_nn", tied=("starboard.thrust_nn",), known=True, **levels),
        SimpleNamespace(name="hull.Yuv", tied=(), known=False, **levels),
    ))  # fmt: skip
    correction = workflows._identified_correction(windows, windows.before, found, {})
    assert set(correction.known) == {"port.thrust_nn", "starboard.thrust_nn"}
    assert set(correction.coefficients) == set(correction.start) == {*correction.known, "hull.Yuv"}


def a_correction(applied: bool) -> IdentifiedCorrection:
    sizes = {"hull.Yuv": Estimate(-6e3, -1e4, -2e3, ""), "port.x_m": Estimate(-13.0, -14.0, -12.0, "")}
    return IdentifiedCorrection(
        applied=applied, constant_velocity_m=0.5, before_m=0.4, after_m=0.2 if applied else 0.6,
        held_out_windows=70, forces={"surge": 0.02, "sway": 0.05, "yaw": 0.1}, coefficients=sizes,
        start={"hull.Yuv": -3.1e4, "port.x_m": -13.22}, known=("hull.Yuv",),
    )  # fmt: skip


def test_it_is_said_what_moved_what_that_did_and_what_the_structure_can_close() -> None:
    said = correction_sentence(a_correction(applied=True))
    assert "1 of 2 coefficients" in said
    assert "2 % of their range in surge, 5 % in sway and 10 % in yaw" in said
    assert "from 0.4 to 0.2 m" in said
    assert "left unchanged" in correction_sentence(a_correction(applied=False))
    rows = coefficient_rows(a_correction(applied=True))
    assert [row[0] for row in rows] == ["hull Yuv", "port x_m"]  # what moved most comes first
    assert [row[-1] for row in rows] == ["yes", "only with others"]
    assert len(structure_rows(a_correction(applied=True))) == 3


def test_the_page_says_it_first_and_it_comes_back_from_json() -> None:
    diagnosis = replace(named(), identified=a_correction(applied=True))
    html = page_of(diagnosis, Extras()).html
    first = html.index("The diagnosis starts from a refit")
    assert (
        first
        < html.index("coefficients of the other legs (the best of this structure)")
        < html.index("Effects named")
    )
    again = from_json(IdentifiedCorrection, json.loads(json.dumps(diagnosis.as_dict()["identified"])))
    assert again == diagnosis.identified


def test_what_was_done_to_a_file_is_in_words_beside_its_name() -> None:
    done = "a_b.mcap: surge_mps: surge and sway multiplied by 1.02; a_b.mcap: parted at 12:00:00"
    rows = dict(basis_rows(replace(named(), provenance={"repair": True, "repaired": done})))
    assert rows["repaired"] == done.replace("surge_mps", "surge")
    assert rows["repair"] == "yes"


def diagnosis_off_by(before_m: float, after_m: float, depends: str = OPERATION) -> Diagnosis:
    """A diagnosis with forces left beside what it names; constant velocity errs by 0.9 m, noise by 0.06 m."""
    gap = replace(named().gap, before_m=before_m, after_m=after_m)
    return replace(named(), gap=gap, remainder=Remainder(0.2, 0.3, (depends,)))


def test_a_model_is_off_in_many_things_where_it_is_worse_than_constant_velocity_and_names_do_not_do() -> None:
    off = diagnosis_off_by(1.7, 0.8)
    assert workflows.is_structurally_wrong(off)
    assert not workflows.is_structurally_wrong(diagnosis_off_by(0.8, 0.5))  # its effects are its own
    assert not workflows.is_structurally_wrong(diagnosis_off_by(1.7, 0.2))  # few causes do
    assert not workflows.is_structurally_wrong(replace(off, remainder=None))  # they explain all
    assert not workflows.is_structurally_wrong(diagnosis_off_by(1.7, 0.8, "time"))  # no coefficient does that
    nothing = replace(off, effects=(), verdict="unknown", remainder=None)
    unknown = UnknownCause(1.0, (OPERATION,), "forces of speeds and thrusters that are wrong")
    assert workflows.is_structurally_wrong(replace(nothing, unknown=unknown))


@pytest.mark.parametrize(
    ("identify", "after_m", "better", "diagnosed", "refitted"),
    [
        (None, 0.8, True, [(SHIP.name, False), ("refitted", True)], True),
        (None, 0.8, False, [(SHIP.name, False)], True),
        (None, 0.2, True, [(SHIP.name, False)], False),
        (False, 0.8, True, [(SHIP.name, False)], False),
        (True, 0.2, True, [("refitted", True)], True),
        (True, 0.2, False, [(SHIP.name, True)], True),
    ],
)
def test_coefficients_are_identified_where_asked_or_due_of_repaired_sensors_and_kept_where_better(
    monkeypatch: pytest.MonkeyPatch, table: pd.DataFrame, identify: bool | None, after_m: float, better: bool,
    diagnosed: list[tuple[str, bool]], refitted: bool,
) -> None:  # fmt: skip
    refit = workflows.Refit(replace(SHIP, name="refitted") if better else SHIP, a_correction(better))
    monkeypatch.setattr(workflows, "reidentify_model", lambda *given: refit)
    asked, shares = list[tuple[str, bool]](), list[float]()

    def of(record: Checked, vessel: Vessel, progress: Progress) -> DiagnosisRun:
        asked.append((vessel.name, record.repaired))
        progress(1.0)
        diagnosis = replace(diagnosis_off_by(1.7, after_m), provenance={"of": vessel.name})
        return DiagnosisRun(diagnosis, NOTHING, Extras(), ())

    def checked(repaired: bool) -> Checked:
        return Checked((table,), repaired=repaired)

    run, found = workflows.diagnose_with_refit(checked, of, SHIP, identify=identify, progress=shares.append)
    assert asked == diagnosed
    assert run.diagnosis.provenance["of"] == diagnosed[-1][0]
    assert found is (refit if refitted else None)
    assert shares == sorted(shares)
    said = run.diagnosis.remarks[0]
    assert (said[:9] == "The model") == (identify is None and refitted)
    if said[:9] == "The model":
        assert "(1.70 m against 0.90 m)" in said
        assert "ocean current, heading bias" in said
        assert ("re-identified" in said) == better


@pytest.mark.parametrize("identify", [None, True])
def test_a_fit_that_leaves_the_models_range_ends_only_a_diagnosis_that_asked_for_it(
    monkeypatch: pytest.MonkeyPatch, table: pd.DataFrame, identify: bool | None
) -> None:
    def leaves(*given: Any) -> workflows.Refit:
        raise ModelRangeError("the model does not follow the recordings")

    monkeypatch.setattr(workflows, "reidentify_model", leaves)
    run = DiagnosisRun(diagnosis_off_by(1.7, 0.8), NOTHING, Extras(), ())
    attempt = partial(
        workflows.diagnose_with_refit, lambda repaired: Checked((table,), (), (), repaired),
        lambda record, vessel, progress: run, SHIP, identify=identify,
    )  # fmt: skip
    if identify:
        with pytest.raises(ModelRangeError):
            attempt()
        return
    outcome, refit = attempt()
    assert refit is None
    assert outcome.diagnosis.effects == run.diagnosis.effects
    assert "could not be re-identified" in outcome.diagnosis.remarks[0]


@pytest.mark.slow
def test_what_no_coefficient_is_gets_its_name_after_the_refit_and_the_gap_closes(
    table: pd.DataFrame,
) -> None:
    """The gentle sea has a current; all coefficients are off by 15 %. Without the refit other things are named."""
    ship = off_by(0.15, SHIP, 1)
    found = workflows.reidentify_model([table], ship)
    said = found.correction
    assert said.applied
    assert said.after_m < 0.7 * said.before_m
    run = diagnose_tables([table], found.vessel)
    (current,) = [each for each in run.diagnosis.effects if each.name == "ocean_current"]
    assert current.parameters["speed_mps"].value == pytest.approx(0.2, abs=0.03)
    assert len(run.diagnosis.effects) == 1
    assert run.diagnosis.gap.after_m < 0.3 * said.before_m
    diagnosis = replace(run.diagnosis, identified=said)
    written = diagnosis.as_dict()["identified"]
    assert written["name"] == "identified_correction"
    assert written["after_m"] < written["before_m"]
    with_added = vessel_with_effects(found.vessel, diagnosis)
    assert "starts from a refit" in str(with_added.provenance["diagnosis_identified_correction"])
    assert with_added.description.endswith(
        "added identified coefficients; ocean_current (of the day of that trial)"
    )


@pytest.mark.slow
def test_a_model_that_is_right_does_not_get_worse() -> None:
    found = workflows.reidentify_model([simulate_trial(SHIP, "calm", "programme", 900.0, 1.0, 5)[0]], SHIP)
    said = found.correction
    assert (found.vessel is SHIP) == (not said.applied)
    assert not said.applied or said.after_m < said.before_m
    assert said.before_m < 0.3 * said.constant_velocity_m
