"""Effects that are not the same in all of a trial: their parts, their signatures, and what is named of two days."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hybrid.diagnosis.course import Course, base_names, varied, with_recordings
from hybrid.diagnosis.evidence import evidence_of, normal_equations
from hybrid.diagnosis.gap import unseen_windows
from hybrid.diagnosis.linearise import Model, linear_model, linearise, signatures
from hybrid.diagnosis.log import Log
from hybrid.effects import CATALOGUE
from hybrid.vessel.effect import Effect
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant
from hybrid.workflows.diagnose import diagnose_tables, vessel_with_effects
from tests.benchmarks.other_ship.trial import make_trial
from tests.hybrid.diagnosis.log_by_hand import a_log
from tests.hybrid.diagnosis.noisy_log import QUIET

DAY_S = 80
DAYS = ((0.3, 0.1), (-0.2, 0.15))
"""The current to the north and east on each of two days [m/s]."""


def two_days(plant: Plant, currents: tuple[tuple[float, float], ...] = DAYS) -> Log:
    """A run of the ship on each of two days, each in two blocks, each day with its current."""
    found = []
    for number, (north, east) in enumerate(currents):
        log = a_log(plant.shifted(current_north_mps=north, current_east_mps=east), DAY_S, (DAY_S // 2,))
        found.append(
            replace(
                log,
                time_s=log.time_s + number * 86400,
                block=log.block + 2 * number,
                leg=log.leg + 2 * number,
                recording=log.recording + number,
            )
        )
    arrays = {
        name: np.concatenate([getattr(each, name) for each in found])
        for name in Log.__slots__
        if isinstance(getattr(found[0], name), np.ndarray)
    }
    return replace(found[0], names=("monday", "thursday"), **arrays)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def log(plant: Plant) -> Log:
    """Two days with two currents."""
    return two_days(plant)


def courses_of(log: Log) -> list[Course]:
    """One of each shape that covers the whole trial."""
    ends = float(log.time_s[0]), float(log.time_s[-1])
    return [Course("recordings", (0, 1)), Course("step", (ends[0] + 50.0,)), Course("drift", ends)]


def test_the_parts_of_a_trial_add_up_to_it(log: Log) -> None:
    """Second by second, and the same throughout a block."""
    for course in courses_of(log):
        shares = course.shares(log)
        assert shares.shape == (len(log), course.pieces)
        np.testing.assert_allclose(shares.sum(axis=1), 1.0)
        for block in range(4):
            assert np.ptp(shares[log.block == block], axis=0).max() < 1e-12


def test_until_and_since_are_the_two_parts_of_a_step(log: Log) -> None:
    time_s = (float(log.time_s[DAY_S]),)
    parts = [Course(shape, time_s).shares(log) for shape in ("until", "since")]
    np.testing.assert_array_equal(np.hstack(parts), Course("step", time_s).shares(log))


@pytest.mark.parametrize("name", ["ocean_current", "heading_bias", "hull_fouling"])
def test_the_signatures_of_the_parts_add_up_to_that_of_the_whole(plant: Plant, log: Log, name: str) -> None:
    for course in courses_of(log):
        changing = varied(CATALOGUE[name], course)
        model = Model(plant, {**CATALOGUE, changing.name: changing})
        known = signatures(log, model, log.nominal, [name, changing.name])
        width = len(CATALOGUE[name].free_scale)
        whole, parts = known[:width], known[width:]
        assert len(parts) == width * course.pieces
        for coordinate, each in enumerate(whole):
            np.testing.assert_allclose(sum(part.D for part in parts[coordinate::width]), each.D, atol=1e-15)
            np.testing.assert_allclose(sum(part.E for part in parts[coordinate::width]), each.E, atol=1e-15)


def test_a_model_with_a_current_of_each_day_leaves_nothing(plant: Plant, log: Log) -> None:
    """Linear about both currents, each day's equations are those of a ship in that day's current alone."""
    catalogue = with_recordings({"ocean_current": CATALOGUE["ocean_current"]}, log)
    name = next(each for each in catalogue if each not in CATALOGUE)
    model = Model(plant, catalogue, at={name: (*DAYS[0], *DAYS[1])})
    found = linearise(log, model, 0.01).linear
    inside = np.append(np.diff(log.block) == 0, False)
    assert np.abs(found.defect[inside]).max() < 1e-6
    for number, (north, east) in enumerate(DAYS):
        mine = log.recording == number
        alone = linear_model(log.subset(mine), plant.shifted(current_north_mps=north, current_east_mps=east))
        np.testing.assert_allclose(found.A[mine], alone.A)


def test_one_recording_has_the_catalogue_as_it_is(log: Log) -> None:
    one = log.subset(log.recording == 0)
    assert with_recordings(CATALOGUE, one) is CATALOGUE


def test_only_what_is_the_days_or_the_recordings_may_differ_between_recordings(log: Log) -> None:
    catalogue = with_recordings(CATALOGUE, log)
    changing = {catalogue[name].base for name in catalogue if name not in CATALOGUE}
    assert changing == {name for name, effect in CATALOGUE.items() if effect.scope != "ship"}
    assert {"ocean_current", "heading_bias", "speed_delay"} <= changing
    assert not {"hull_fouling", "thrust_loss_port", "wind_load"} & changing
    assert base_names(catalogue, catalogue) == tuple(CATALOGUE)


def test_two_currents_are_likelier_than_one_where_there_are_two(plant: Plant) -> None:
    """And one is likelier than two where there is one."""
    odds = []
    for currents in (DAYS, (DAYS[0], DAYS[0])):
        log = two_days(plant, currents)
        noise = np.random.default_rng(1).standard_normal(log.measured.shape) * QUIET.as_array()[:6]
        log = replace(log, measured=log.measured + noise)
        names = ["ocean_current"]
        few: dict[str, Effect] = {name: CATALOGUE[name] for name in names}
        model = Model(plant, with_recordings(few, log))
        evidence = evidence_of(normal_equations(linearise(log, model, 0.01), QUIET, number=10))
        both = next(name for name in evidence.names if name not in few)
        odds.append(evidence.log_odds([both]) - evidence.log_odds(names))
        assert not evidence.possible([both, *names])
    assert odds[0] > 10.0
    assert odds[1] < 0.0


@pytest.mark.slow
def test_a_fouling_on_two_days_with_two_currents_is_named_with_both() -> None:
    """Each in its interval; the vessel's file has the fouling, the currents stay with their days."""
    currents = [{"speed_mps": 0.3, "direction_deg": 40.0}, {"speed_mps": 0.25, "direction_deg": 200.0}]
    tables = []
    for day, current in enumerate(currents):
        hidden = {"hull_fouling": {"resistance_factor": 1.3}, "ocean_current": current}
        table, _ = make_trial(1 + 1000 * day, hidden, sea="gentle", duration_s=1200.0, rate_hz=2.0)
        table = table.set_axis(table.index + pd.Timedelta(days=day))
        table.attrs["recording"] = f"/trials/day{day}.mcap"
        tables.append(table)
    vessel = load_vessel("gunnerus_short")
    said = diagnose_tables(tables, vessel).diagnosis
    assert said.verdict == "named"
    assert sorted(each.name for each in said.effects) == ["hull_fouling", "ocean_current", "ocean_current"]
    found = {each.when.recording: each for each in said.effects if each.when is not None}
    for day, current in enumerate(currents):
        for name, true in current.items():
            size = found[f"day{day}.mcap"].parameters[name]
            assert size.low <= true <= size.high
    assert set(vessel_with_effects(vessel, said).effects) == {"hull_fouling"}
    assert said.gap.closed > 0.9


def test_windows_of_one_day_are_predicted_where_each_day_has_a_size_of_its_own(plant: Plant, log: Log) -> None:
    """None of the other day's windows are asked for; what is predicted is what is predicted of both together."""
    catalogue = with_recordings(CATALOGUE, log)
    name = next(each for each in catalogue if catalogue[each].base == "ocean_current" != each)
    windows = unseen_windows(log, Model(plant, catalogue))
    at = {name: tuple(each for day in DAYS for each in day)}
    monday = log.recording[windows.starts] == 0
    np.testing.assert_array_equal(windows.predicted(at, monday), windows.predicted(at)[monday])
