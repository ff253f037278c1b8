"""Planning a trial: what a programme would show, and that the better one is better."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.hybrid import planning as planning
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.planning import CandidateManoeuvre, Design
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.planning import (
    Aims,
    Plan,
    aims_shortfall,
    compose_programme,
    expected_noise_in_sea,
    make_plan,
    parse_programme,
)
from seatrial.hybrid.report.pages import plan_page
from seatrial.hybrid.simulation.trial import sea_state_named
from seatrial.hybrid.vessel.files import Vessel

SOME = (
    "hull_fouling", "azimuth_offset_port", "azimuth_offset_starboard", "ocean_current", "tunnel_thrust_loss",
    "shallow_water",
)  # fmt: skip


@pytest.fixture(scope="module")
def planned(vessel: Vessel) -> Plan:
    parts = parse_programme(["zigzag_20_20"], vessel, 20.0)
    catalogue = {name: CATALOGUE[name] for name in SOME}
    return make_plan(parts, vessel, sea_state_named("gentle"), DisturbanceNoise(), 0.01, catalogue)


def test_zigzags_leave_what_they_do_not_use(planned: Plan) -> None:
    assert planned.asked.limits["tunnel_thrust_loss"] == np.inf
    assert ("azimuth_offset_port", "azimuth_offset_starboard") in planned.asked.indistinguishable_pairs()


def test_the_better_programme_is_better_and_no_longer(planned: Plan) -> None:
    assert planned.better.minutes == planned.asked.minutes == 20.0
    assert len(planned.better.indistinguishable_pairs()) < len(planned.asked.indistinguishable_pairs())
    assert planned.better.limits["tunnel_thrust_loss"] < 0.3
    assert planned.better.limits["hull_fouling"] < planned.asked.limits["hull_fouling"]


def test_evidence_is_one_for_a_pair(planned: Plan) -> None:
    for programme in (planned.asked, planned.better):
        assert np.array_equal(programme.evidence, programme.evidence.T)
        assert np.isinf(np.diag(programme.evidence)).all()


def test_json_says_what_cannot_be_seen_as_none(planned: Plan) -> None:
    plain = json.loads(json.dumps(planned.as_dict(), allow_nan=False))
    by_name = {each["name"]: each for each in plain["effects"]}
    assert by_name["tunnel_thrust_loss"]["limit"] is None
    assert by_name["tunnel_thrust_loss"]["better_limit"] > 0.0
    assert sum(part["minutes"] for part in plain["better"]["parts"]) == plain["better"]["minutes"]


def test_the_tables_fit_a_terminal(planned: Plan) -> None:
    out = StringIO()
    Console(file=out, width=80).print(planned)
    assert "A better one" in str(planned)
    assert planned.plot().axes[0].patches
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.split()[:2] == ["tunnel_thrust_loss", "-"] for line in lines)
    assert any(line.startswith("shallow_water") and "<" in line for line in lines)


def test_the_page_shows_both_programmes(planned: Plan, tmp_path: Path) -> None:
    html = plan_page(planned).write(tmp_path / "plan.html").read_text(encoding="utf-8")
    assert html.count("<img") == 2
    for part in planned.better.parts:
        assert part.what in html


def design_by_hand(legs: int, seed: int) -> Design:
    """Legs that say much or little of this and that, and a nuisance that all share."""
    generator = np.random.default_rng(seed)
    roots = generator.standard_normal((legs, 6, 6)) * generator.lognormal(0.0, 1.5, (legs, 1, 6))
    names = ("hull_fouling", "thrust_loss_both", "heading_bias", "speed_scale")
    scale = np.array([1.0 / CATALOGUE[name].free_scale[0] for name in names] + [1.0, 1.0])
    gram = np.einsum("lik,ljk->lij", roots, roots) * np.outer(scale, scale)
    columns = {name: np.array([number]) for number, name in enumerate(names)}
    return Design(gram, columns, {name: CATALOGUE[name] for name in names})


@pytest.mark.parametrize("seed", range(5))
def test_no_exchange_and_no_other_programme_at_random_is_better(seed: int) -> None:
    design = design_by_hand(8, seed)
    aims = Aims(tuple(design.columns), (("hull_fouling", "thrust_loss_both"), ("heading_bias", "speed_scale")))
    chosen = compose_programme(design, range(8), 3, aims)
    least = aims_shortfall(design, chosen, aims)
    for place in range(3):
        for leg in range(8):
            other = [*chosen[:place], leg, *chosen[place + 1 :]]
            assert aims_shortfall(design, other, aims) >= least - 1e-9
    generator = np.random.default_rng(seed)
    assert all(
        aims_shortfall(design, generator.integers(0, 8, 3).tolist(), aims) >= 0.98 * least for _ in range(50)
    )


def test_parts_share_what_is_left_of_the_time(vessel: Vessel) -> None:
    parts = parse_programme(["zigzag_10_10=15", "coasting", "turning_circle_30"], vessel, 60.0)
    assert [part.minutes for part in parts] == [15.0, 22.5, 22.5]
    assert "coast without thrust" in parts[1].what


@pytest.mark.parametrize("text", ["somersault", "zigzag_20_20=0.1", "zig zag", "coasting=x"])
def test_what_is_no_manoeuvre_is_refused(vessel: Vessel, text: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_programme([text], vessel, 60.0)


def test_too_many_manoeuvres_for_the_time_are_refused(vessel: Vessel) -> None:
    with pytest.raises(ConfigurationError, match="too few"):
        parse_programme(["zigzag=9", "coasting", "drifting"], vessel, 10.0)


@pytest.mark.slow
def test_the_noise_of_a_calm_sea_is_that_of_the_sensors(vessel: Vessel) -> None:
    noise = expected_noise_in_sea(vessel, sea_state_named("calm"), 0.01, {name: CATALOGUE[name] for name in SOME})
    assert noise.position_m == pytest.approx(0.05, rel=0.3)
    assert not noise.has_waves or max(noise.waves[:2]) < 0.05


def test_the_command_prints_writes_and_says_where(
    planned: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float] = []

    def prepared(parts: tuple[CandidateManoeuvre, ...], *_: object) -> Plan:
        asked.extend(part.minutes for part in parts)
        return planned

    monkeypatch.setattr(planning, "expected_noise_in_sea", lambda *_: DisturbanceNoise())
    monkeypatch.setattr(planning, "make_plan", prepared)
    folder = tmp_path / "out"
    result = CliRunner().invoke(
        seatrial.app, ["plan", "zigzag", "coasting=10", "--duration", "30", "-o", str(folder), "--json"]
    )
    assert result.exit_code == 0, result.output
    assert asked == [20.0, 10.0]
    assert json.loads(result.stdout) == json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert (folder / "plan.html").is_file()
