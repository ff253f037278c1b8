"""The blind benchmark in short: a few trials with something hidden, and what draws and scores them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.hybrid.diagnosis.planning import Shafts, candidates_of_ship
from seatrial.hybrid.effects import CATALOGUE
from tests.benchmarks.diagnosis.cases import GROUPS, Case, cases_of
from tests.benchmarks.diagnosis.design import MORE_PROGRAMMES, Design
from tests.benchmarks.diagnosis.page import write_page
from tests.benchmarks.diagnosis.plan import planned, preparations
from tests.benchmarks.diagnosis.scoring import (
    Share,
    covered,
    exact,
    in_set,
    names,
    place_right,
    says_unknown,
    silently_wrong,
    undecided_rightly,
    wrong_in_doubt,
)
from tests.benchmarks.diagnosis.second_trial import orders_of
from tests.benchmarks.diagnosis.sound import placed
from tests.benchmarks.diagnosis.store import stored
from tests.benchmarks.diagnosis.work import Planned, judged
from tests.benchmarks.other_ship.programmes import PROGRAMMES, STEER, TURN, ZIGZAG

SHORT_S, RATE_HZ = 1200.0, 5.0


def outcome(
    seed: int,
    hidden: dict[str, dict[str, float]],
    *,
    outside: dict[str, float] | None = None,
    sea: str = "gentle",
    programme: str = "zigzags",
) -> dict[str, Any]:
    case = Case("singles", Design(seed, sea, programme, SHORT_S, rate_hz=RATE_HZ), tuple(hidden), len(hidden), 3.0)
    return judged(Planned(case, hidden, outside or {}))


@pytest.mark.slow
def test_a_sound_trial_lacks_nothing() -> None:
    assert outcome(1, {})["said"]["verdict"] == "nothing_missing"


@pytest.mark.slow
def test_one_hidden_effect_is_named_and_sized() -> None:
    result = outcome(2, {"ocean_current": {"speed_mps": 0.2, "direction_deg": 75.0}})
    assert result["said"]["verdict"] == "named"
    assert exact(result)
    assert max(abs(each) for each in result["errors"]) < 4.0
    assert result["said"]["gap"]["closed"] > 0.9


@pytest.mark.slow
def test_two_hidden_effects_of_two_families_are_both_named() -> None:
    current = {"speed_mps": 0.15, "direction_deg": 200.0}
    result = outcome(3, {"ocean_current": current, "hull_fouling": {"resistance_factor": 1.25}})
    assert exact(result)


@pytest.mark.slow
def test_what_no_catalogue_holds_is_said_to_be_unknown() -> None:
    result = outcome(4, {}, outside={"yaw_moment_4psi": 60_000.0}, programme="programme")
    assert says_unknown(result)
    assert place_right(result)


@pytest.mark.slow
def test_effects_that_a_straight_course_cannot_tell_apart_are_kept_together() -> None:
    result = outcome(5, {"loading": {"mass_factor": 1.15}}, sea="calm", programme="one_heading")
    assert undecided_rightly(result)
    assert "surge_added_mass" in {name for group in result["said"]["indistinguishable"] for name in group}


@pytest.mark.parametrize("size", ["small", "designed", "full"])
def test_every_case_has_a_key_of_its_own_and_every_group_cases(size: Any) -> None:
    cases = cases_of(size)
    assert len({case.key for case in cases}) == len(cases)
    assert {case.group for case in cases} == set(GROUPS)
    assert {case.design.programme for case in cases} <= {*PROGRAMMES, *MORE_PROGRAMMES}


def test_the_full_benchmark_hides_every_effect_in_every_kind_of_trial() -> None:
    singles = [case for case in cases_of("full") if case.group == "singles"]
    for name in CATALOGUE:
        mine = [case for case in singles if case.effects == (name,)]
        assert {case.multiple for case in mine} == {1.2, 2.0, 4.0}
        assert {case.design.sea for case in mine} == {"calm", "gentle", "moderate"}
    own = sum(case.design.simulator == "own" for case in singles)
    assert own == pytest.approx(len(singles) / 10, abs=1)


def sound_trial(columns: int = 2) -> dict[str, Any]:
    """Information in which every effect stands alone, each with a limit below its ordinary size."""
    places, scales = {}, list[float]()
    for name, effect in CATALOGUE.items():
        places[name] = [len(scales) + each for each in range(len(effect.free_scale))]
        scales += [20.0 / max(effect.smallest_free[0], 0.3 * effect.free_scale[0])] * len(effect.free_scale)
    return {"matrix": np.diag(np.square(scales)).tolist(), "columns": places}


def test_hidden_effects_are_drawn_alike_in_every_run_and_have_the_size_asked_for() -> None:
    cases = [case for case in cases_of("small") if case.group in ("singles", "pairs", "triples")]
    results = {job.key: sound_trial() for job in preparations(cases) if isinstance(job, Design)}
    first, again = planned(cases, results), planned(cases, results)
    assert first == again
    assert {len(each.hidden) for each in first.cases} == {1, 2, 3}
    for each in first.cases:
        assert len({CATALOGUE[name].family for name in each.hidden}) == len(each.hidden)
        for name, values in each.hidden.items():
            single = np.linalg.norm(CATALOGUE[name].free_coordinates(values)) / each.case.multiple
            others = [p for p in first.cases if name in p.hidden]
            sizes = [
                np.linalg.norm(CATALOGUE[name].free_coordinates(p.hidden[name])) / p.case.multiple for p in others
            ]
            assert sizes == pytest.approx([single] * len(sizes))


def test_an_effect_that_a_trial_says_nothing_of_is_no_case() -> None:
    cases = [case for case in cases_of("small") if case.group == "singles"]
    plain = sound_trial()
    nothing = {**plain, "matrix": (1e-9 * np.array(plain["matrix"])).tolist()}
    plan = planned(cases, {job.key: nothing for job in preparations(cases) if isinstance(job, Design)})
    assert not plan.cases
    assert set(plan.none) == {case.key for case in cases}


def test_a_size_is_placed_on_the_side_that_the_bounds_allow() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        assert placed(CATALOGUE["thruster_lag"], 2.0, random) == {"time_constant_s": 2.0}
    assert placed(CATALOGUE["heading_bias"], 50.0, random) is None
    current = placed(CATALOGUE["ocean_current"], 0.3, random)
    assert current is not None
    assert current["speed_mps"] == pytest.approx(0.3)


PODS = ("port", "starboard")


def test_manoeuvres_asked_for_are_orders_of_the_other_ship() -> None:
    made = {
        each.name: orders_of(each.legs)
        for each in candidates_of_ship(Shafts(170.0, 85.0, 120.0, 195.0, 200.0, PODS, PODS, ("tunnel",)))
    }
    zigzag = [order for order in made["zigzags_20_20"] if order.kind == ZIGZAG]
    assert [order.switches for order in zigzag] == [10.0, 10.0]
    assert [order.course_deg for order in zigzag] == [0.0, 180.0]
    assert {order.kind for order in made["reciprocal_headings"]} == {STEER}
    assert [order.turn_deg for order in made["turns_30"] if order.kind == TURN] == [720.0, 720.0]


def test_shares_have_exact_intervals() -> None:
    low, high = Share(0, 300).interval
    assert low == 0.0
    assert (1.0 - high) ** 300 == pytest.approx(0.025)
    low, high = Share(12, 12).interval
    assert high == 1.0
    assert low**12 == pytest.approx(0.025)


def said(verdict: str, *names: str, alike: tuple[tuple[str, ...], ...] = ()) -> dict[str, Any]:
    estimate = {"value": 10.0, "low": 5.0, "high": 15.0}
    effects = [{"name": name, "parameters": {"direction_deg": estimate}} for name in names]
    return {
        "verdict": verdict, "effects": effects, "indistinguishable": alike, "force_range": [1e5, 1e5, 1e6],
        "unknown": {"where": ["heading"], "looks_like": "a yaw moment"} if verdict == "unknown" else None,
        "gap": {"closed": 0.99}, "next_manoeuvre": None,
    }  # fmt: skip


def result(group: str, says: dict[str, Any], *hidden: str, multiple: float = 2.0) -> dict[str, Any]:
    return {
        "key": f"{group}/{hidden}", "group": group, "said": says, "sea": "calm", "programme": "zigzags",
        "simulator": "other", "model_error_percent": 0.0, "multiple": multiple, "tolerance": 0.01, "outside": {},
        "hidden": {name: {"direction_deg": 368.0} for name in hidden}, "rivals": [], "errors": [0.5, -1.0],
        "diagnosis_s": 10.0, "truth": {"outside_rms": [0.0, 500.0, 2e4]},
    }  # fmt: skip


def test_a_rival_counts_for_the_set_and_not_for_the_name() -> None:
    alike = said("indistinguishable", "trim", alike=(("trim", "skeg"),))
    assert in_set(result("singles", alike, "skeg"))
    assert not exact(result("singles", alike, "skeg"))
    assert not in_set(result("singles", alike, "loading"))
    assert names(result("singles", said("unknown"), "skeg")) == []


def test_a_wrong_name_is_silent_only_where_nothing_is_said_of_another() -> None:
    alike = said("indistinguishable", "trim", alike=(("trim", "skeg"),))
    for says, silent, doubt in ((said("named", "trim"), True, False), (alike, False, True)):
        case = result("without", says, "loading")
        assert (silently_wrong(case), wrong_in_doubt(case)) == (silent, doubt)
    assert not silently_wrong(result("without", said("unknown", "trim"), "loading"))
    assert not silently_wrong(result("without", said("named", "trim"), "trim"))


def test_directions_are_compared_around_the_circle() -> None:
    assert covered([result("singles", said("named", "ocean_current"), "ocean_current")]) == Share(1, 1)


def test_the_page_has_the_scores_and_the_cases_that_went_wrong(tmp_path: Path) -> None:
    right = result("singles", said("named", "skeg"), "skeg")
    wrong = result("singles", said("named", "trim"), "loading")
    alarm = result("nothing", said("named", "trim"))
    outside = {**result("outside", said("unknown")), "outside": {"yaw_moment_4psi": 5000.0}}
    text = write_page([right, wrong, alarm, outside], {"singles/a": "no"}, "small", tmp_path / "page.md")
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == text
    assert "| singles at 2 times and more: named, nothing else | 50.0 % (1 of 2; 1.3 to 98.7) | 95 % |" in text
    assert "| nothing hidden: an effect named | 100.0 % (1 of 1;" in text
    assert "| outside the catalogue, `unknown`: axis right | 100.0 % (1 of 1;" in text
    assert wrong["key"] in text.split("went wrong")[1]
    assert right["key"] not in text.split("went wrong")[1]
    for picture in ("diagnosis_power.png", "diagnosis_confusion.png"):
        assert (tmp_path / "pictures" / picture).stat().st_size > 1000


def test_results_that_crashed_or_were_cut_off_are_tried_again(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    lines = [json.dumps({"key": "a", "size": 1.0}), json.dumps({"key": "b", "crashed": "no"}), '{"key": "c", "si']
    file.write_text("\n".join(lines), encoding="utf-8")
    assert set(stored(file)) == {"a"}
