"""Many simulated trials in one call: every vessel in every sea state, manoeuvre and seed, on worker processes.

The workers, and what happens when one of them dies, are those of :mod:`seatrial.analysis.batch`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from seatrial.acquisition.config.toml_file import load_toml
from seatrial.acquisition.core.errors import ConfigurationError, Progress
from seatrial.acquisition.core.files import atomic_file, read_json
from seatrial.acquisition.core.trial import software_version
from seatrial.analysis.batch import BatchJob, Row, attempt, batch_folder, check_address, map_calls, run_jobs
from seatrial.analysis.products import Options
from seatrial.analysis.tables.table import sha256_of
from seatrial.hybrid.effects import apply_effects, vessel_plant
from seatrial.hybrid.simulation.manoeuvres import manoeuvre_named
from seatrial.hybrid.simulation.trial import SimulationNoise, record_trial, sea_state_named, simulate_trial
from seatrial.hybrid.vessel.files import load_vessel, locate_vessel

INDEX = "campaign.csv"


@dataclass(frozen=True, slots=True)
class Campaign:
    """Which trials to simulate: each vessel in each sea state, manoeuvre and seed.

    ``hidden`` are effects of the catalogue in all of the ships, and in no recording's metadata.
    """

    vessels: tuple[str, ...]
    sea_states: tuple[str, ...]
    manoeuvres: tuple[str, ...]
    seeds: tuple[int, ...] = (0,)
    duration_s: float = 1200.0
    rate_hz: float = 10.0
    heading_deg: float = 0.0
    hidden: dict[str, dict[str, float]] = field(default_factory=dict)
    noise: SimulationNoise = field(default_factory=SimulationNoise)


Campaign.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One trial of a campaign, by names; ``vessel`` may be the path of a vessel file."""

    name: str
    vessel: str
    sea_state: str
    manoeuvre: str
    seed: int
    duration_s: float
    rate_hz: float
    heading_deg: float
    hidden: dict[str, dict[str, float]]
    noise: SimulationNoise


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialJob(BatchJob):
    """A planned trial for a worker; ``path`` is the recording that it becomes."""

    trial: PlannedTrial


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """What a campaign came to: a row a trial, and the table of them. ``reused`` were there before."""

    rows: list[Row]
    reused: int
    index: Path

    @property
    def failed(self) -> list[Row]:
        """The rows of the trials that could not be simulated."""
        return [row for row in self.rows if row["status"] == "failed"]


def load_campaign(path: Path | str) -> Campaign:
    """A campaign from TOML. Raises :class:`ConfigurationError` naming file, line and key."""
    return load_toml(path, Campaign)


def trials_of(campaign: Campaign) -> tuple[PlannedTrial, ...]:
    """The trials of a campaign, the seeds changing fastest.

    Raises :class:`ConfigurationError` for a vessel, sea state, manoeuvre or effect that does not exist, and
    where two trials would have one name.
    """
    for sea, manoeuvre in product(campaign.sea_states, campaign.manoeuvres):
        sea_state_named(sea), manoeuvre_named(manoeuvre)
    for vessel in campaign.vessels:
        apply_effects(vessel_plant(load_vessel(vessel)), campaign.hidden)
    common = {name: getattr(campaign, name) for name in ("duration_s", "rate_hz", "heading_deg", "hidden", "noise")}
    every = product(campaign.vessels, campaign.sea_states, campaign.manoeuvres, campaign.seeds)
    trials = tuple(PlannedTrial(_name(*each), locate_vessel(each[0]), *each[1:], **common) for each in every)
    twice = {trial.name for trial in trials if sum(trial.name == other.name for other in trials) > 1}
    if twice or not trials:
        raise ConfigurationError(
            f"would make {sorted(twice)[0]} twice" if twice else "has no trial",
            where="campaign",
            fix="name every vessel, sea state, manoeuvre and seed once, and one of each at least",
        )
    return trials


def run_campaign(
    campaign: Campaign,
    out: Path | str,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = lambda share: None,
) -> CampaignResult:
    """Simulate a campaign into ``out``: NAME.mcap and NAME.truth.json a trial, and one table of them all.

    Trials that are there already, made by the same version from the same numbers, are not made again. With one
    worker everything happens in this process; ``workers`` and ``scheduler`` otherwise, and their errors, are
    those of :func:`seatrial.analysis.batch.run_batch`.
    """
    out = Path(out).resolve()
    check_address(scheduler)
    jobs = [
        TrialJob(trial.name, str(out / f"{trial.name}.mcap"), str(out), Options(), trial=trial)
        for trial in trials_of(campaign)
    ]
    with batch_folder(out):
        if workers == 1 and scheduler is None:
            rows = map_calls([(make, job) for job in jobs], 1, progress)
        else:
            rows = run_jobs(jobs, make, workers, scheduler, progress)
        index = out / INDEX
        reused = sum(row.pop("reused", False) for row in rows)
        planned = [{"name": job.name, **_public(job)} for job in jobs]
        with atomic_file(index) as partial:
            pd.DataFrame(planned).merge(pd.DataFrame(rows), on="name", how="left").to_csv(partial, index=False)
    return CampaignResult(rows, reused, index)


def make(job: BatchJob) -> Row:
    """What a worker does for one trial; a row comes back whatever happens."""
    return attempt(job, _made)


def fingerprint(trial: PlannedTrial) -> str:
    """A digest of everything that a trial depends on: the plan, the ship's and the sea's numbers, our version."""
    ship, sea = asdict(load_vessel(trial.vessel)), asdict(sea_state_named(trial.sea_state))
    plan = {**asdict(trial), "vessel": ship, "sea_state": sea, "software": software_version()}
    return sha256(json.dumps(plan, sort_keys=True, default=str).encode()).hexdigest()


def _made(job: BatchJob) -> Row:
    """Simulate and write one trial; the truth comes last and marks it as complete."""
    assert isinstance(job, TrialJob)
    trial, recording = job.trial, Path(job.path)
    truth_path, plan = recording.with_suffix(".truth.json"), fingerprint(trial)
    if recording.is_file() and _plan_of(truth_path) == plan:
        return {"status": "done", "cause": "", "sha256": sha256_of(recording), "reused": True}
    table, truth = simulate_trial(
        trial.vessel, trial.sea_state, trial.manoeuvre, trial.duration_s, trial.rate_hz, trial.seed, trial.hidden,
        noise=trial.noise, heading_deg=trial.heading_deg,
    )  # fmt: skip
    record_trial(table, truth, recording, plan=plan)
    return {"status": "done", "cause": "", "sha256": sha256_of(recording)}


def _name(vessel: str, sea_state: str, manoeuvre: str, seed: int) -> str:
    return f"{Path(vessel).stem}-{sea_state}-{manoeuvre}-{seed:03d}"


def _public(job: TrialJob) -> dict[str, Any]:
    """What the table says of a trial; what is hidden stays in the truth."""
    named = ("vessel", "sea_state", "manoeuvre", "seed", "duration_s", "rate_hz")
    return {name: getattr(job.trial, name) for name in named} | {"recording": Path(job.path).name}


def _plan_of(truth: Path) -> str | None:
    """The plan that a trial was made by, if it is complete."""
    try:
        plan = read_json(truth)["plan"]
    except (OSError, ValueError, LookupError, TypeError):
        return None
    return str(plan)
