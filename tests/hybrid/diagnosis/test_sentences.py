"""Named effects in plain words: every one has its own, signs become words, ends have the unit of the size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.ship import KINDS, Actuator, Actuators
from seatrial.hybrid.diagnosis.linearise import TimeProfile, time_varying
from seatrial.hybrid.diagnosis.result import EffectDrift, Estimate, NamedEffect, Replication, When
from seatrial.hybrid.effects import CATALOGUE, catalogue_of_actuators, vessel_plant
from seatrial.hybrid.effects.environment import STEADY_WIND
from seatrial.hybrid.report.diagnosis import effects_by_part, remark_on_calm, sentence
from seatrial.hybrid.vessel.files import load_vessel
from tests.hybrid.diagnosis.log_by_hand import a_log


def said(name: str, *ranges: tuple[float, float, float], share: float = 0.83) -> str:
    parameters = {
        each.name: Estimate(value, low, high, each.unit)
        for each, (value, low, high) in zip(CATALOGUE[name].parameters, ranges, strict=True)
    }
    return sentence(CATALOGUE[name], parameters, share)


@pytest.mark.parametrize(
    ("name", "ranges", "words"),
    [
        (
            "ocean_current",
            [(0.35, 0.34, 0.36), (205.0, 203.0, 207.0)],
            "The ship drifts with a current of 0.35 m/s towards 205 deg (0.34-0.36; 203-207); it explains 83 % of",
        ),
        ("position_delay", [(-0.87, -1.179, -0.561)], "Positions are stamped 0.87 s too early (0.561-1.18)"),
        ("position_delay", [(0.5, 0.4, 0.6)], "Positions are stamped 0.5 s too late (0.4-0.6)"),
        ("thrust_loss_port", [(0.123, 0.094, 0.152)], "The port thruster lacks 12.3 % of its thrust (9.4-15.2)"),
        ("thrust_loss_both", [(-0.05, -0.1, 0.01)], "Both thrusters have 5 % more thrust than the model's (−1"),
        ("surge_added_mass", [(1.43, 1.4, 1.47)], "The added mass in surge is 43 % more than the model's (40"),
        ("wind_load", [(0.45, 0.4, 0.5)], "The wind loads are 55 % less than the tables say (50-60)"),
        ("heading_bias", [(-1.5, -1.6, -1.4)], "The compass reads 1.5 deg too little (1.4-1.6)"),
        ("azimuth_offset_port", [(-2.0, -2.5, -1.5)], "The true angle of the port azimuth is the reported"),
        ("speed_scale", [(0.97, 0.96, 0.98)], "Reported speeds are 0.97 times the true ones (0.96-0.98)"),
        (
            "position_antenna_offset",
            [(-5.22, -6.3, -4.14), (0.5, -0.66, 1.65)],
            "The recorded position is that of a point 5.22 m astern and 0.5 m to starboard of the reference point "
            "(4.14-6.3; \u22120.66 to 1.65)",
        ),
        (
            "low_speed_damping",
            [(0.02, 0.018, 0.022), (-0.001, -0.003, 0.001), (0.1, 0.08, 0.12)],
            "At low speed the water damps otherwise than in the model, by 2 % a second in surge, −0.1 % in sway, "
            "10 % in yaw, negative being less (1.8-2.2; −0.3 to 0.1; 8-12)",
        ),
        ("shallow_water", [(8.0, 7.0, 9.5)], "The water is about 8 m deep, which affects the hull forces (7-9.5)"),
    ],
)  # fmt: skip
def test_sizes_in_words(name: str, ranges: list[tuple[float, float, float]], words: str) -> None:
    assert said(name, *ranges).startswith(words)


TWIN = (Actuator("port", "propeller"), Actuator("starboard", "propeller"), Actuator("port_rudder", "rudder"),
        Actuator("starboard_rudder", "rudder"))  # fmt: skip
SINGLE = (Actuator("main", "controllable_propeller"), Actuator("rudder", "rudder"), Actuator("bow", "tunnel"))
JETS = (Actuator("port", "waterjet"), Actuator("starboard", "waterjet"))


@pytest.mark.parametrize(
    ("actuators", "name", "ends", "words"),
    [
        (
            SINGLE,
            "rudder_offset_rudder",
            (2.0, 1.5, 2.5),
            "The rudder is truly 2 deg to starboard of the reported angle",
        ),
        (
            SINGLE,
            "rudder_offset_rudder",
            (-2.0, -2.5, -1.5),
            "The rudder is truly 2 deg to port of the reported angle",
        ),
        (
            TWIN,
            "rudder_offset_both",
            (2.0, 1.5, 2.5),
            "Both rudders are truly 2 deg to starboard of the reported angles",
        ),
        (TWIN, "rudder_loss_port_rudder", (0.1, 0.05, 0.15), "The port rudder lacks 10 % of its force (5-15)"),
        (TWIN, "thrust_loss_port", (0.1, 0.05, 0.15), "The port propeller lacks 10 % of its thrust (5-15)"),
        (TWIN, "thrust_loss_both", (0.1, 0.05, 0.15), "Both propellers lack 10 % of their thrust (5-15)"),
        (SINGLE, "thrust_loss_bow", (0.1, 0.05, 0.15), "The bow thruster lacks 10 % of its side force (5-15)"),
        (SINGLE, "wake_main", (-0.1, -0.15, -0.05), "The water at the main propeller is 10 % faster than the mod"),
        (SINGLE, "astern_thrust_main", (0.8, 0.7, 0.9), "The main propeller gives 20 % less thrust astern than"),
        (
            SINGLE,
            "thrust_deduction_main",
            (-0.1, -0.15, -0.05),
            "The main propeller loses 10 % less of its thru",
        ),
        (TWIN, "rudder_interaction_both", (0.2, 0.1, 0.3), "Both rudders draw 20 % more of their side force from"),
        (SINGLE, "flow_straightening_rudder", (1.4, 1.2, 1.6), "The rudder meets 40 % more of the drift at the st"),
        (
            SINGLE,
            "lag_rudder",
            (1.2, 1.0, 1.4),
            "The rudder follows the recorded settings with a lag of 1.2 s (1-1.4)",
        ),
        (
            TWIN,
            "lag_both_propellers",
            (1.2, 1.0, 1.4),
            "Both propellers follow the recorded settings with a lag of 1.2",
        ),
        (
            JETS,
            "nozzle_offset_both",
            (2.0, 1.5, 2.5),
            "The true angles of both nozzles are the reported angles plus 2 deg",
        ),
        (
            JETS,
            "nozzle_offset_port",
            (2.0, 1.5, 2.5),
            "The true angle of the port nozzle is the reported angle plus 2 deg",
        ),
    ],
)
def test_actuators_of_other_ships_in_words(
    actuators: Actuators, name: str, ends: tuple[float, float, float], words: str
) -> None:
    effect = catalogue_of_actuators(actuators)[name]
    (parameter,) = effect.parameters
    text = sentence(effect, {parameter.name: Estimate(*ends, parameter.unit)}, 0.5, actuators)
    assert text.startswith(words)


PAIRS = [(Actuator("port", kind), Actuator("starboard", kind)) for kind in KINDS]


@pytest.mark.parametrize("actuators", [TWIN, SINGLE, *PAIRS])
def test_every_effect_of_another_ship_has_a_sentence(actuators: Actuators) -> None:
    for effect in catalogue_of_actuators(actuators).values():
        parameters = {each.name: Estimate(each.typical, each.typical, each.typical, each.unit)
                      for each in effect.parameters}  # fmt: skip
        text = sentence(effect, parameters, 0.5, actuators)
        assert "The model lacks" not in text
        assert "{" not in text


@given(st.sampled_from(sorted(CATALOGUE)), st.floats(-1.0, 1.0))
def test_every_effect_has_a_sentence_of_its_own(name: str, share: float) -> None:
    """With its share, and in other words than those for what nobody knows."""
    effect = CATALOGUE[name]
    value = np.float64(share)  # as fits give them
    ranges = [(0.5 * max(each.low, -9.0) + value, -9.0, 9.0) for each in effect.parameters]
    text = said(name, *ranges, share=abs(share))
    assert "The model lacks" not in text
    assert "{" not in text
    assert f"explains {100.0 * abs(share):.0f} % of the gap" in text


def test_an_effect_of_the_users_own_is_said_by_its_name() -> None:
    own = replace(CATALOGUE["towed_load"], name="drogue")
    text = sentence(own, {"force_n": Estimate(800.0, 700.0, 900.0, "N")}, 0.5)
    assert text.startswith("The model lacks drogue: force 800 N (700-900)")


def parts_of(
    name: str, profile: TimeProfile, *sizes: dict[str, Estimate], in_vessel: bool = True
) -> list[NamedEffect]:
    """An effect with these sizes in the parts of a trial that began at noon."""
    log = replace(
        a_log(vessel_plant(load_vessel("gunnerus_short")), 20), names=("/a/monday.mcap", "/a/thursday.mcap")
    )
    log = replace(log, time_s=np.arange(20) + NOON_S, recording=np.repeat([0, 1], 10))
    changed = time_varying(CATALOGUE[name], profile)
    whole = NamedEffect(
        name, changed.family, changed.kind, 0.5, 1e-9, "", sizes[-1], Replication(4, 4), 90.0, changed.scope,
        in_vessel=in_vessel,
    )  # fmt: skip
    return effects_by_part(whole, changed, sizes, log)


NOON_S = 1_788_264_000  # 1 September 2026
FORCE = {"force_n": Estimate(3800.0, 3400.0, 4100.0, "N")}
SLOW, FAST = (
    {
        "speed_mps": Estimate(size, 0.9 * size, 1.1 * size, "m/s"),
        "direction_deg": Estimate(90.0, 80.0, 100.0, "deg"),
    }
    for size in (0.1, 0.4)
)


def test_a_recorded_calm_is_not_a_wind_that_was_not_recorded() -> None:
    assert "no wind was recorded" in remark_on_calm({**CATALOGUE, STEADY_WIND.name: STEADY_WIND})
    assert "nil throughout" in remark_on_calm(CATALOGUE)


def test_what_stops_is_said_with_its_time() -> None:
    profile = TimeProfile("until", (NOON_S + 600.0,), (NOON_S + 540.0, NOON_S + 660.0))
    (said,) = parts_of("towed_load", profile, FORCE)
    assert said.sentence.startswith(
        "Until 12:10 on 1 Sep UTC (12:09 to 12:11): something holds the ship back with a steady 3,800 N (3,400-"
    )
    assert said.when == When(until="2026-09-01T12:10:00Z", low="2026-09-01T12:09:00Z", high="2026-09-01T12:11:00Z")
    assert not said.in_vessel


def test_a_step_has_a_size_before_and_one_after_and_the_last_stays() -> None:
    before, after = parts_of("ocean_current", TimeProfile("step", (NOON_S + 600.0,)), SLOW, FAST)
    assert before.when is not None
    assert after.when is not None
    assert before.when.until == after.when.since
    assert (before.in_vessel, after.in_vessel) == (False, True)


@pytest.mark.parametrize(
    "profile", [TimeProfile("step", (NOON_S + 600.0,)), TimeProfile("drift", (NOON_S, NOON_S + 3600.0))]
)
def test_no_part_of_what_only_imitates_is_written_to_the_vessel_file(profile: TimeProfile) -> None:
    assert not any(part.in_vessel for part in parts_of("ocean_current", profile, SLOW, FAST, in_vessel=False))


def test_a_drift_is_said_from_when_to_when() -> None:
    (said,) = parts_of("ocean_current", TimeProfile("drift", (NOON_S, NOON_S + 3600.0)), SLOW, FAST)
    assert "At 12:00 on 1 Sep UTC: the ship drifts with a current of 0.1 m/s" in said.sentence
    assert "changing linearly; at 13:00 on 1 Sep UTC: the ship drifts with a current of 0.4 m/s" in said.sentence
    assert said.drift == EffectDrift("2026-09-01T12:00:00Z", "2026-09-01T13:00:00Z", SLOW)
    assert said.parameters == FAST
    assert said.in_vessel


@pytest.mark.parametrize(("name", "kept"), [("ocean_current", [False, False]), ("hull_fouling", [False, True])])
def test_what_differs_between_recordings_stays_with_them_unless_it_is_the_ships(
    name: str, kept: list[bool]
) -> None:
    """Of the ship's own the last is hers."""
    sizes = (SLOW, FAST) if name == "ocean_current" else ({"resistance_factor": Estimate(1.2, 1.1, 1.3, "1")},) * 2
    said = parts_of(name, TimeProfile("recordings", (0, 1)), *sizes)
    assert [each.in_vessel for each in said] == kept
    assert [each.when and each.when.recording for each in said] == ["monday.mcap", "thursday.mcap"]
    assert said[0].sentence.startswith("In monday.mcap: the ")
