"""Named effects in plain words: every one has its own, signs become words, ends have the unit of the size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hybrid.diagnosis.result import Estimate
from hybrid.effects import CATALOGUE
from hybrid.report.diagnosis_sentences import sentence


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
        ("surge_added_mass", [(1.43, 1.4, 1.47)], "The water's inertia ahead is 43 % more than the model's (40"),
        ("wind_load", [(0.45, 0.4, 0.5)], "The wind loads are 55 % less than the tables say (50-60)"),
        ("heading_bias", [(-1.5, -1.6, -1.4)], "The compass reads 1.5 deg too little (1.4-1.6)"),
        ("azimuth_offset_port", [(-2.0, -2.5, -1.5)], "The port azimuth truly stands −2 deg beyond"),
        ("speed_scale", [(0.97, 0.96, 0.98)], "Reported speeds are 0.97 times the true ones (0.96-0.98)"),
        ("shallow_water", [(8.0, 7.0, 9.5)], "The water is about 8 m deep, and the hull feels it (7-9.5)"),
    ],
)  # fmt: skip
def test_sizes_in_words(name: str, ranges: list[tuple[float, float, float]], words: str) -> None:
    assert said(name, *ranges).startswith(words)


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
