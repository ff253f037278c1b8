"""Effects that are not the same in all of a trial: their parts, their signatures, and what is named of two days."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seatrial.hybrid.diagnosis import acceptance
from seatrial.hybrid.diagnosis.acceptance import Acceptance, LackOfFit
from seatrial.hybrid.diagnosis.gap import unseen_windows
from seatrial.hybrid.diagnosis.linearise import (
    ModelWithEffects,
    TimeProfile,
    TimeVaryingEffect,
    base_names,
    linear_model,
    linearise,
    signatures,
    time_varying,
    with_recordings,
)
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.diagnosis.map import recorded_s
from seatrial.hybrid.diagnosis.regression import Evidence, evidence_of, normal_equations
from seatrial.hybrid.diagnosis.verdict import likeliest_change, may_change
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.workflows import diagnose_tables, vessel_with_effects
from tests.benchmarks.other_ship.trial import make_trial
from tests.hybrid.diagnosis.log_by_hand import a_log
from tests.hybrid.diagnosis.noisy_log import QUIET

DAY_S = 80
DAYS = ((0.3, 0.1), (-0.2, 0.15))
"""The current to the north and east on each of two days [m/s]."""


def two_days(plant: Plant, currents: tuple[tuple[float, float], ...] = DAYS) -> Log:
    """A run of the ship on each of two days, each in two blocks, each day with its current."""
    plants = [plant.shifted(current_north_mps=north, current_east_mps=east) for north, east in currents]
    joined = behind([a_log(each, DAY_S, (DAY_S // 2,)) for each in plants], 86400)
    return replace(joined, names=("monday", "thursday"), recording=(np.arange(2 * DAY_S) >= DAY_S).astype(np.int64))


def behind(logs: Sequence[Log], every_s: int) -> Log:
    """Logs of two blocks each, one behind the other, each so much later than the one before."""
    parts = [
        replace(
            log, time_s=log.time_s + number * every_s, block=log.block + 2 * number, leg=log.leg + 2 * number
        )
        for number, log in enumerate(logs)
    ]  # fmt: skip
    arrays = [name for name in Log.__slots__ if isinstance(getattr(parts[0], name), np.ndarray)]
    together: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    return replace(parts[0], **together)


def evidence_in(log: Log, model: ModelWithEffects, seed: int = 1) -> Evidence:
    """What the log says with the noise of ordinary sensors in it."""
    noise = np.random.default_rng(seed).standard_normal(log.measured.shape) * QUIET.as_array()[:6]
    log = replace(log, measured=log.measured + noise)
    return evidence_of(normal_equations(linearise(log, model, 0.01), QUIET, number=10))


@pytest.fixture(scope="module")
def log(plant: Plant) -> Log:
    """Two days with two currents."""
    return two_days(plant)


def profiles_of(log: Log) -> list[TimeProfile]:
    """One of each shape that covers the whole trial."""
    ends = float(log.time_s[0]), float(log.time_s[-1])
    return [TimeProfile("recordings", (0, 1)), TimeProfile("step", (ends[0] + 50.0,)), TimeProfile("drift", ends)]


def test_the_parts_of_a_trial_add_up_to_it(log: Log) -> None:
    """Second by second; where the equations are made linear, the same throughout a block."""
    for profile in profiles_of(log):
        shares, levels = profile.weights_of_pieces(log), profile.rounded_weights(log)
        assert shares.shape == (len(log), profile.piece_count)
        for each in (shares, levels):
            np.testing.assert_allclose(each.sum(axis=1), 1.0)
        for block in range(4):
            assert np.ptp(levels[log.block == block], axis=0).max() < 1e-12


def test_the_map_counts_the_time_that_was_recorded(log: Log) -> None:
    """Days that lie between two recordings are in no cell; within one the clock goes on as it is."""
    np.testing.assert_array_equal(recorded_s(log), np.arange(len(log)))
    one = log.subset(log.recording == 1)
    late = replace(one, time_s=one.time_s + 30 * (np.arange(len(one)) > 9))
    np.testing.assert_array_equal(recorded_s(late), late.time_s - late.time_s[0])


def test_until_and_since_are_the_two_parts_of_a_step(log: Log) -> None:
    time_s = (float(log.time_s[DAY_S]),)
    parts = [TimeProfile(shape, time_s).weights_of_pieces(log) for shape in ("until", "since")]
    np.testing.assert_array_equal(np.hstack(parts), TimeProfile("step", time_s).weights_of_pieces(log))


@pytest.mark.parametrize("name", ["ocean_current", "heading_bias", "hull_fouling"])
def test_the_signatures_of_the_parts_add_up_to_that_of_the_whole(plant: Plant, log: Log, name: str) -> None:
    for profile in profiles_of(log):
        changing = time_varying(CATALOGUE[name], profile)
        model = ModelWithEffects(plant, {**CATALOGUE, changing.name: changing})
        known = signatures(log, model, log.nominal, [name, changing.name])
        width = len(CATALOGUE[name].free_scale)
        whole, parts = known[:width], known[width:]
        assert len(parts) == width * profile.piece_count
        for coordinate, each in enumerate(whole):
            np.testing.assert_allclose(sum(part.D for part in parts[coordinate::width]), each.D, atol=1e-15)
            np.testing.assert_allclose(sum(part.E for part in parts[coordinate::width]), each.E, atol=1e-15)


def test_a_model_with_a_current_of_each_day_leaves_nothing(plant: Plant, log: Log) -> None:
    """Linear about both currents, each day's equations are those of a ship in that day's current alone."""
    catalogue = with_recordings({"ocean_current": CATALOGUE["ocean_current"]}, log)
    name = next(each for each in catalogue if each not in CATALOGUE)
    model = ModelWithEffects(plant, catalogue, at={name: (*DAYS[0], *DAYS[1])})
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


def test_recordings_too_short_to_be_judged_have_no_size_of_their_own(log: Log) -> None:
    """Of one leg each: nothing of such a recording can predict the rest of it."""
    assert with_recordings(CATALOGUE, replace(log, leg=log.recording)) is CATALOGUE


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
        log, names = two_days(plant, currents), ["ocean_current"]
        few = {name: CATALOGUE[name] for name in names}
        evidence = evidence_in(log, ModelWithEffects(plant, with_recordings(few, log)))
        both = next(name for name in evidence.effect_names if name not in few)
        odds.append(evidence.log_odds([both]) - evidence.log_odds(names))
        assert not evidence.are_possible([both, *names])
    assert odds[0] > 10.0
    assert odds[1] < 0.0


FEW = {name: CATALOGUE[name] for name in ("towed_load", "hull_fouling", "thrust_loss_both", "ocean_current")}


def changed(plant: Plant, later: Plant) -> TimeVaryingEffect | None:
    """What is found to have changed where a ship is another in the second half of a trial."""
    log = behind([a_log(each, 160, (80,)) for each in (plant, plant, later, later)], 160)
    return likeliest_change(Acceptance((), {}, evidence_in(log, ModelWithEffects(plant, FEW))))


def test_a_tow_that_is_dropped_is_found_with_its_time(plant: Plant) -> None:
    """The ship that the model knows has the tow off: until half-way something holds her back, then nothing."""
    log = behind([a_log(each, 160, (80,)) for each in (plant.shifted(constant_X_n=-5e3),) * 2 + (plant,) * 2], 160)
    change = likeliest_change(Acceptance((), {}, evidence_in(log, ModelWithEffects(plant, FEW))))
    assert change is not None
    assert (change.base, change.profile.shape) == ("towed_load", "until")
    true_s = float(log.time_s[320])
    low, high = change.profile.interval_s or (0.0, 0.0)
    assert low <= true_s <= high
    assert high - low < 80.0


def test_a_current_that_sets_in_is_found(plant: Plant) -> None:
    change = changed(plant, plant.shifted(current_north_mps=0.3))
    assert change is not None
    assert (change.base, change.profile.shape) == ("ocean_current", "since")


def test_what_changed_once_is_not_looked_for_again_in_the_same_way(plant: Plant) -> None:
    """A catalogue that has a tow until one time already is no error, and gets no second."""
    log = behind([a_log(each, 160, (80,)) for each in (plant.shifted(constant_X_n=-5e3),) * 2 + (plant,) * 2], 160)
    known = time_varying(CATALOGUE["towed_load"], TimeProfile("until", (float(log.time_s[300]),)))
    change = likeliest_change(
        Acceptance((), {}, evidence_in(log, ModelWithEffects(plant, {**FEW, known.name: known})))
    )
    assert change is None or change.name != known.name


def test_nothing_has_changed_where_nothing_has(plant: Plant) -> None:
    assert changed(plant, plant) is None


def test_a_steady_trial_is_not_searched_for_changes(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only where what is left may go with time, be it not significant by itself."""
    left = LackOfFit("heading", "yaw", 1e-9, 50.0, 4e3, matters=True)
    by_chance = replace(left, depends="time", p_value=0.2)
    found = [left, by_chance]
    monkeypatch.setattr(acceptance, "lack_of_fit", lambda evidence, names: found)
    steady = Acceptance((), {}, evidence_in(a_log(plant, 160, (80,)), ModelWithEffects(plant, FEW)))
    assert not may_change(steady)
    assert not may_change(replace(steady, lack_of_fit=(left,)))
    assert may_change(replace(steady, lack_of_fit=(left, replace(left, depends="time"))))
    found.append(replace(by_chance, p_value=0.01))
    assert may_change(steady)


@pytest.mark.parametrize("beside", ["nothing", "a current that drifts", "an effect of the file"])
def test_a_jump_of_the_compass_is_timed_to_the_second(plant: Plant, beside: str) -> None:
    """At a time some seconds off, the leg around the jump would deny it."""
    log = a_log(plant, 240, (60, 120, 180))
    jump = int(log.time_s[97])
    measured = log.measured.copy()
    measured[log.time_s >= jump, 2] += np.deg2rad(1.5)
    catalogue = {**FEW, "heading_bias": CATALOGUE["heading_bias"]}
    model, names = ModelWithEffects(plant, catalogue), tuple[str, ...]()
    if beside == "a current that drifts":
        drift = time_varying(CATALOGUE["ocean_current"], TimeProfile("drift", (0.0, float(log.time_s[-1]))))
        model, names = replace(model, catalogue={**catalogue, drift.name: drift}), (drift.name,)
    elif beside == "an effect of the file":
        model = replace(model, file_effects={"hull_fouling": (0.0,)})
    accepted = Acceptance(names, {}, evidence_in(replace(log, measured=measured), model))
    change = likeliest_change(accepted)
    assert change is not None
    assert (change.base, change.profile.times_s) == ("heading_bias", (float(jump),))


def test_a_drift_is_followed_between_the_levels_about_which_it_is_linear(plant: Plant) -> None:
    """What a current that grows evenly does is what its signature says; steps would be 12 % off."""
    log = behind([a_log(plant, 160, (80,))] * 2, 160)
    ends = float(log.time_s[0]), float(log.time_s[-1])
    drift = time_varying(CATALOGUE["ocean_current"], TimeProfile("drift", ends))
    model = ModelWithEffects(plant, {**FEW, drift.name: drift})
    moved = replace(model, at={drift.name: (0.0, 0.0, 0.1, 0.05)})
    whole, none = linearise(log, moved, 0.01), linearise(log, model, 0.01)
    own = [each for each in none.effects if each.effect == "ocean_current"]
    share = drift.profile.weights_of_pieces(log)[:, 1]
    expected = none.linear.defect + share[:, None] * (0.1 * own[0].D + 0.05 * own[1].D)
    inside = np.append(np.diff(log.block) == 0, False)
    effect = np.abs(expected - none.linear.defect)[inside].max(axis=0)
    off = np.abs(whole.linear.defect - expected)[inside].max(axis=0)
    assert (off[:2] < 0.05 * effect[:2]).all()


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
    windows = unseen_windows(log, ModelWithEffects(plant, catalogue))
    at = {name: tuple(each for day in DAYS for each in day)}
    monday = log.recording[windows.starts] == 0
    np.testing.assert_array_equal(windows.predict_tracks(at, monday), windows.predict_tracks(at)[monday])
