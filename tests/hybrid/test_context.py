"""What is known of a trial beforehand: declared anywhere, it is neither searched nor named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import seatrial
from seatrial.acquisition.config.run_sheet import SURVEYED_KINDS, Context, context_in_trial, load_statement
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Trial
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.effects.context import (
    PossibleDeclaration,
    context_of,
    declared_context,
    excluding_declarations,
    option_of,
    searched_effects,
    with_known_effects,
)
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.vessel.files import Vessel, load_vessel, save_vessel

KNOWN = {"ocean_current": {"speed_mps": 0.4, "direction_deg": 90.0}, "hull_fouling": {"resistance_factor": 1.2}}
EFFECTS = {**CATALOGUE, STEADY_WIND.name: STEADY_WIND}
CONTEXTS = st.builds(
    Context, still_water=st.booleans(), no_waves=st.booleans(), no_wind=st.booleans(),
    surveyed=st.lists(st.sampled_from([*SURVEYED_KINDS, "all"]), unique=True).map(tuple),
    known=st.dictionaries(st.sampled_from(list(KNOWN)), st.just({"speed_mps": 0.4}), max_size=2),
)  # fmt: skip


@pytest.fixture(scope="module")
def ship() -> Vessel:
    """The default ship."""
    return load_vessel()


@given(CONTEXTS)
def test_a_recording_carries_it(context: Context) -> None:
    carried = Trial.from_metadata(Trial("t", context=context.as_text()).as_metadata())
    assert context_in_trial(carried) == context
    assert (context.as_text() == "") == (context == Context())


def test_a_vessel_file_carries_it(ship: Vessel, tmp_path: Path) -> None:
    context = Context(still_water=True, surveyed=("heading",), known=KNOWN)
    save_vessel(replace(ship, name="tank", context=context), tmp_path / "tank.toml")
    assert load_vessel(tmp_path / "tank.toml").context == context


@pytest.mark.parametrize(
    ("options", "excluded"),
    [
        ({"still_water": True}, {"ocean_current", "wave_drift"}),
        ({"no_waves": True}, {"wave_drift"}),
        ({"surveyed": ["heading"]}, {"heading_bias", "heading_delay"}),
        ({"surveyed": ["wind"]}, {"wind_direction_bias", "wind_speed_scale"}),
        ({"surveyed": ["yaw_rate"]}, {"yaw_rate_bias", "yaw_rate_scale"}),
        ({"surveyed": ["clock"]}, {"position_delay", "heading_delay", "speed_delay", "command_delay"}),
    ],
)
def test_what_cannot_be_is_not_searched_and_all_else_is(options: dict[str, bool], excluded: set[str]) -> None:
    searched = searched_effects(EFFECTS, declared_context(EFFECTS, **options))  # type: ignore[arg-type]
    assert set(EFFECTS) - set(searched) == excluded


def test_without_wind_nothing_of_the_wind_is_searched_and_with_all_surveyed_no_sensor() -> None:
    calm = searched_effects(EFFECTS, Context(no_wind=True))
    assert not any("wind" in name for name in calm)
    surveyed = searched_effects(EFFECTS, Context(surveyed=("all",)))
    assert not any(effect.kind == "sensor" for effect in surveyed.values())
    assert all(effect.kind == "sensor" or effect.family == "clock"
               for name, effect in EFFECTS.items() if name not in surveyed)  # fmt: skip


def test_what_is_known_is_in_the_model_and_is_not_searched(ship: Vessel) -> None:
    context = declared_context(CATALOGUE, known=["hull_fouling:resistance_factor=1.2"])
    assert with_known_effects(ship, context, CATALOGUE).effects == {"hull_fouling": {"resistance_factor": 1.2}}
    assert set(CATALOGUE) - set(searched_effects(CATALOGUE, context)) == {"hull_fouling"}


def test_an_effect_that_no_ship_has_is_refused_with_its_place(ship: Vessel) -> None:
    with pytest.raises(ConfigurationError, match=r"context\.known.*wake_pod"):
        with_known_effects(ship, Context(known={"wake_pod": {"fraction": 0.1}}), CATALOGUE)


def test_only_what_every_recording_declares_holds_for_all(ship: Vessel) -> None:
    tank = Trial("tank", context=Context(still_water=True, surveyed=("all",), known=KNOWN).as_text())
    sea = Trial("sea", context=Context(no_wind=True, surveyed=("heading",), known=KNOWN).as_text())
    assert context_of([tank, sea], ship, Context()) == Context(known=KNOWN, surveyed=("heading",))
    assert context_of([sea, tank], ship, Context()) == Context(known=KNOWN, surveyed=("heading",))
    assert context_of([tank], ship, Context(no_waves=True)).no_waves
    assert context_of([], replace(ship, context=Context(no_wind=True)), Context()).no_wind


def test_a_statement_beside_recordings_completes_what_they_carry(tmp_path: Path) -> None:
    (tmp_path / "conditions.toml").write_text('[context]\nstill_water = true\nsurveyed = ["clock"]\n')
    statement = load_statement(tmp_path / "conditions.toml")
    trial = statement.apply_to_trial(Trial("t", context=Context(no_wind=True).as_text()))
    assert context_in_trial(trial) == Context(still_water=True, no_wind=True, surveyed=("clock",))


def test_what_may_be_declared_is_proposed_with_its_option() -> None:
    effects = [CATALOGUE["heading_bias"], CATALOGUE["ocean_current"], CATALOGUE["hull_fouling"]]
    proposed = excluding_declarations(effects, Context(surveyed=("heading",)))
    assert proposed == (PossibleDeclaration("still water", ("ocean_current",)),)
    wind = [CATALOGUE["wind_load"], CATALOGUE["wind_direction_bias"]]
    assert [each.declaration for each in excluding_declarations(wind, Context(), refuted=["no wind"])] == [
        "wind surveyed"
    ]  # a calm cannot be declared where a wind was recorded
    assert [option_of(name) for name in ("still water", "yaw rate surveyed")] == [
        "--still-water", "--surveyed yaw_rate",
    ]  # fmt: skip


@pytest.mark.parametrize("options", [
    {"surveyed": ["compass"]}, {"known": ["current:speed_mps=1"]}, {"known": ["ocean_current:speed=1"]},
    {"known": ["ocean_current"]},
])  # fmt: skip
def test_what_can_be_neither_surveyed_nor_known_is_refused(options: dict[str, list[str]]) -> None:
    with pytest.raises(ConfigurationError):
        declared_context(CATALOGUE, **options)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_diagnosis_names_nothing_that_was_ruled_out_and_says_what_was(ship: Vessel, tmp_path: Path) -> None:
    """A hidden current is not named in declared still water; a known one leaves nothing to name."""
    hidden = {"ocean_current": {"speed_mps": 0.5, "direction_deg": 120.0}}
    seatrial.simulate(tmp_path / "trial.mcap", vessel=ship, duration_s=300.0, rate_hz=2.0, hide=hidden)
    (tmp_path / "conditions.toml").write_text("[context]\nno_waves = true\n")
    still = seatrial.diagnose(tmp_path / "trial.mcap", vessel=ship, still_water=True, identify=False).diagnosis
    assert not {"ocean_current", "wave_drift"} & {effect.name for effect in still.effects}
    assert still.as_dict()["context"]["excluded"] == ["ocean_current", "wave_drift"]
    run = seatrial.diagnose(tmp_path / "trial.mcap", vessel=ship, known=hidden, output=tmp_path / "out")
    assert run.diagnosis.verdict == "nothing_missing"
    assert load_vessel(tmp_path / "out" / "vessel.toml").effects == hidden
    assert "known ocean current" in (tmp_path / "out" / "report.html").read_text()


def test_what_is_known_beforehand_is_not_fitted_either(ship: Vessel, tmp_path: Path) -> None:
    """Of an identification of a trial in still water with a surveyed compass; all else is free as ever."""
    seatrial.simulate(tmp_path / "trial.mcap", vessel=ship, duration_s=240.0, rate_hz=1.0)
    options = {"surveyed": ["heading"], "known": ["ocean_current:speed_mps=0.2,direction_deg=90"]}
    done = seatrial.identify(tmp_path / "trial.mcap", vessel=ship, validation=False, **options)
    (surroundings,) = done.surroundings.values()
    assert surroundings["current_east_mps"] == pytest.approx(0.2)
    assert (surroundings["current_north_mps"], surroundings["heading_bias_rad"]) == (pytest.approx(0.0), 0.0)
    assert surroundings["sway_bias_mps"] != 0.0
    assert done.vessel.effects["ocean_current"] == {"speed_mps": 0.2, "direction_deg": 90.0}
    assert done.as_dict()["context"]["declared"] == ["heading surveyed"]
    assert "Declared beforehand: heading surveyed and known ocean current" in str(done)
