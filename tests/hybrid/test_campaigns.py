"""Campaigns: what is planned, what stands on the disk, what is not made twice, and the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.errors import ConfigurationError, InputError
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.simulation.trial import (
    Campaign,
    CampaignResult,
    load_campaign,
    planned_trials,
    run_campaign,
    simulate_trial,
)
from seatrial.hybrid.vessel.files import load_vessel, save_vessel

EXAMPLE = Path(__file__).parents[2] / "trials" / "campaign.toml"
SMALL = Campaign(
    ("gunnerus_short", "gunnerus_long"),
    ("gentle",),
    ("zigzag_10_20",),
    seeds=(1, 2),
    duration_s=20.0,
    rate_hz=2.0,
    hidden={"hull_fouling": {"resistance_factor": 1.3}},
)


def written(folder: Path) -> dict[str, bytes]:
    """Recordings and truths by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def made(folder: Path) -> CampaignResult:
    """The small campaign, made in this process."""
    return run_campaign(SMALL, folder, workers=1)


@settings(max_examples=12, deadline=None)
@given(
    vessels=st.sets(st.sampled_from(["gunnerus_short", "gunnerus_long"]), min_size=1),
    seas=st.sets(st.sampled_from(["calm", "gentle", "moderate"]), min_size=1),
    seeds=st.sets(st.integers(0, 10**6), min_size=1, max_size=5),
)
def test_every_combination_is_planned_once(vessels: set[str], seas: set[str], seeds: set[int]) -> None:
    """As many trials as there are combinations, each with a name of its own."""
    trials = planned_trials(Campaign(tuple(vessels), tuple(seas), ("voyage", "zigzag"), tuple(seeds)))
    planned = {(trial.vessel, trial.sea_state, trial.manoeuvre, trial.seed) for trial in trials}
    assert (
        len(trials)
        == len(planned)
        == len({trial.name for trial in trials})
        == 2 * len(vessels) * len(seas) * len(seeds)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vessels": ("titanic",)}, "titanic"),
        ({"sea_states": ("stormy",)}, "stormy"),
        ({"manoeuvres": ("loop",)}, "loop"),
        ({"hidden": {"barnacles": {"count": 3.0}}}, "barnacles"),
        ({"seeds": (1, 1)}, "gentle-zigzag_10_20-001 twice"),
        ({"seeds": ()}, "has no trial"),
    ],
)
def test_what_cannot_be_made_is_said_before_anything_is(change: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        planned_trials(replace(SMALL, **change))


def test_what_is_written_is_the_trial(folder: Path, made: CampaignResult) -> None:
    """A recording holds the table of its own vessel, sea and seed; the truth tells what was hidden, the
    recording and the table of all trials do not."""
    for trial in planned_trials(SMALL):
        table, _ = simulate_trial(trial.vessel, "gentle", "zigzag_10_20", 20.0, 2.0, trial.seed, SMALL.hidden)
        read = read_table(folder / f"{trial.name}.mcap")
        for name in table.columns:
            assert read[name].to_numpy() == pytest.approx(table[name].to_numpy(), abs=1e-9), name
        truth = json.loads((folder / f"{trial.name}.truth.json").read_text())
        assert truth["hidden"] == SMALL.hidden
    assert all(b"fouling" not in data for name, data in written(folder).items() if "truth" not in name)


def test_the_table_lists_every_trial(folder: Path, made: CampaignResult) -> None:
    index = pd.read_csv(made.index)
    assert index["name"].tolist() == [trial.name for trial in planned_trials(SMALL)]
    assert (index["status"] == "done").all()
    assert all((folder / name).is_file() for name in index["recording"])
    assert index["sha256"].nunique() == 4
    assert (made.reused, made.failed) == (0, [])


def test_what_is_complete_is_not_made_again(folder: Path, made: CampaignResult) -> None:
    """A second call writes no recording; a truth that is cut off, or one of another plan, is made anew."""
    before, names = written(folder), [trial.name for trial in planned_trials(SMALL)]
    times = {name: (folder / f"{name}.mcap").stat().st_mtime_ns for name in names}
    (folder / f"{names[1]}.truth.json").write_text('{"plan": "')
    (folder / f"{names[2]}.mcap").unlink()
    again = run_campaign(SMALL, folder, workers=1)
    assert again.reused == 2
    remade = [(folder / f"{name}.mcap").stat().st_mtime_ns != times[name] for name in names]
    assert remade == [False, True, True, False]
    assert written(folder) == before


def test_another_plan_of_the_same_name_is_made_anew(tmp_path: Path) -> None:
    """A longer trial, another noise, or a ship whose file has changed: each replaces what was there."""
    ship = load_vessel("gunnerus_short")
    file = tmp_path / "mine.toml"
    save_vessel(ship, file)
    one = replace(SMALL, vessels=(str(file),), seeds=(1,), hidden={})
    run_campaign(one, tmp_path / "out", workers=1)
    assert run_campaign(one, tmp_path / "out", workers=1).reused == 1
    for changed in (replace(one, duration_s=21.0), replace(one, noise=one.noise.scaled(2.0))):
        assert run_campaign(changed, tmp_path / "out", workers=1).reused == 0
    run_campaign(one, tmp_path / "out", workers=1)
    save_vessel(replace(ship, inertia=replace(ship.inertia, mass_kg=1.1 * ship.inertia.mass_kg)), file)
    assert run_campaign(one, tmp_path / "out", workers=1).reused == 0


@pytest.mark.slow
def test_the_bytes_do_not_depend_on_the_workers(folder: Path, made: CampaignResult, tmp_path: Path) -> None:
    """Two processes write what one does, and say how far they are."""
    shares: list[float] = []
    run_campaign(SMALL, tmp_path, workers=2, progress=shares.append)
    assert written(tmp_path) == written(folder)
    assert shares == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_a_trial_that_fails_is_a_row(tmp_path: Path) -> None:
    """A ship that leaves the range of her model: the others are made, the cause is in the table."""
    ship = load_vessel("gunnerus_short")
    narrow = replace(ship, name="narrow", validity=replace(ship.validity, yaw_rate_radps=1e-6))
    save_vessel(narrow, tmp_path / "narrow.toml")
    both = replace(SMALL, vessels=(str(tmp_path / "narrow.toml"), "gunnerus_short"), seeds=(1,))
    made = run_campaign(both, tmp_path / "out", workers=1)
    assert [row["status"] for row in made.rows] == ["failed", "done"]
    assert "range of the model" in pd.read_csv(made.index)["cause"][0]
    assert not (tmp_path / "out" / "narrow-gentle-zigzag_10_20-001.mcap").exists()


def test_the_example_is_a_campaign(tmp_path: Path) -> None:
    """The file that comes with Seatrial plans two ships in three seas; a misspelt key is named."""
    campaign = load_campaign(EXAMPLE)
    assert len(planned_trials(campaign)) == 24
    assert campaign.noise.position_m == 0.05
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(EXAMPLE.read_text().replace("rate_hz", "rate_khz"))
    with pytest.raises(ConfigurationError, match="rate_khz"):
        load_campaign(wrong)


def test_the_command_makes_and_resumes(tmp_path: Path) -> None:
    app = seatrial.app
    file = tmp_path / "two.toml"
    file.write_text(
        'vessels = ["gunnerus_short"]\nsea_states = ["calm"]\nmanoeuvres = ["zigzag"]\nseeds = [1, 2]\n'
        "duration_s = 10.0\nrate_hz = 1.0\n"
    )
    options = ["campaign", str(file), "-o", str(tmp_path / "out"), "--workers", "1", "--json"]
    first, second = (CliRunner().invoke(app, options) for _ in range(2))
    assert first.exit_code == second.exit_code == 0, first.output
    said = [json.loads(each.stdout) for each in (first, second)]
    assert [(each["done"], each["reused"]) for each in said] == [(2, 0), (2, 2)]
    assert np.all(pd.read_csv(said[0]["index"])["status"] == "done")


def test_an_address_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not the address"):
        run_campaign(SMALL, tmp_path, scheduler="the big one")
