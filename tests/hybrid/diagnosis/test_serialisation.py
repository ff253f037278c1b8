"""What a diagnosis shows comes back from its files as it was, for every verdict."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from seatrial.acquisition.core.errors import InputError
from seatrial.hybrid.diagnosis.result import (
    DIAGNOSIS,
    LADDER,
    MAP,
    SHOWN,
    TRACKS,
    Correlation,
    Diagnosis,
    EffectDrift,
    Extras,
    Remainder,
    SensorContradiction,
    Tracks,
    When,
    read_diagnosis,
    write_figure_data,
)
from seatrial.hybrid.report.diagnosis import page_of
from tests.conftest import nightly
from tests.hybrid.diagnosis.made_up import CURRENT, a_ladder, a_map, named, of_verdict

SENSORS = SensorContradiction("heading_bias", (-1.5,), (0.1,), 1e-6, ("speed_sensor_rotation",), "They disagree.")
CORRELATION = Correlation(("ocean current, 1", "heading bias"), np.array([[1.0, -0.97], [-0.97, 1.0]]))
ALL = Extras(a_map(), a_map(), (SENSORS,), a_ladder(), CORRELATION)


def back(diagnosis: Diagnosis, extras: Extras, folder: Path) -> tuple[Diagnosis, Extras]:
    """Through the files, as ``seatrial diagnose`` writes them."""
    write_figure_data(diagnosis, extras, folder)
    return read_diagnosis(folder)


REMAINDER = Remainder(0.04, 0.2, ("yaw_rate",), "a yaw moment of some 2 kN m that varies with the yaw rate")


@pytest.mark.parametrize(
    "diagnosis",
    [
        replace(named(), remainder=REMAINDER),
        *nightly(named(), *map(of_verdict, ("indistinguishable", "unknown", "nothing_missing"))),
    ],
)
def test_the_page_of_what_comes_back_is_the_page_of_what_went_in(diagnosis: Diagnosis, tmp_path: Path) -> None:
    again = back(diagnosis, ALL, tmp_path)
    before, after = page_of(diagnosis, ALL), page_of(*again)
    assert again[0].remainder == diagnosis.remainder
    assert after.title == before.title
    assert after.html == before.html  # pictures and all


def test_tracks_and_maps_are_the_same_to_the_bit(tmp_path: Path) -> None:
    diagnosis, extras = back(named(), ALL, tmp_path)
    tracks, wanted = diagnosis.tracks, named().tracks
    assert tracks is not None
    assert wanted is not None
    for field in fields(Tracks):
        back_again, said = getattr(tracks, field.name), getattr(wanted, field.name)
        np.testing.assert_equal(back_again, said)
    assert extras.map is not None
    assert ALL.map is not None
    np.testing.assert_array_equal(extras.map.force, ALL.map.force)
    assert extras.map.places == ALL.map.places


def test_what_is_not_there_is_none_and_an_older_file_of_it_goes(tmp_path: Path) -> None:
    back(named(), ALL, tmp_path)
    (tmp_path / LADDER).unlink()
    diagnosis, extras = back(replace(named(), tracks=None), Extras(), tmp_path)
    assert diagnosis.tracks is None
    assert (extras.map, extras.consistency, extras.comparison, extras.correlation) == (None, None, None, None)
    assert not (tmp_path / MAP).exists()
    assert not (tmp_path / TRACKS).exists()


def test_the_json_has_the_contracts_keys_in_their_order(tmp_path: Path) -> None:
    diagnosis = replace(of_verdict("indistinguishable"), gap=replace(named().gap, after_m=float("nan")))
    back(diagnosis, ALL, tmp_path)
    said = json.loads((tmp_path / DIAGNOSIS).read_text())
    assert list(said) == [
        "verdict", "tolerance", "effects", "rivals", "indistinguishable", "unknown", "where", "gap",
        "next_manoeuvre", "remarks", "remainder", "regimes", "suspects", "context", "identified", "indices",
        "provenance",
    ]  # fmt: skip
    assert list(said["effects"][0]) == [
        "name", "family", "kind", "share_of_gap", "p_value", "sentence", "parameters", "replicated",
        "scope", "when", "drift", "in_vessel",
    ]  # fmt: skip
    assert said["effects"][0]["parameters"]["speed_mps"] == {
        "value": 0.35,
        "low": 0.34,
        "high": 0.36,
        "unit": "m/s",
    }
    assert said["gap"] == {
        "before_m": 1.4,
        "after_m": None,
        "floor_m": 0.06,
        "constant_velocity_m": 0.9,
        "held_out_windows": 110,
        "closed": None,
    }
    assert list(said["next_manoeuvre"]) == ["what", "separates", "expected_evidence"]
    ladder = json.loads((tmp_path / LADDER).read_text())
    assert list(ladder) == [
        "horizon_s", "method", "windows", "legs", "mean_distance_m", "ratios", "why_not",
    ]  # fmt: skip
    assert ladder["ratios"][0] == {"of": "named", "to": "reference", "value": 0.25, "low": 0.2, "high": 0.3}


def test_estimates_that_cannot_be_told_apart_are_said_to_be(tmp_path: Path) -> None:
    diagnosis, loose = replace(named(), tracks=None), Correlation(CORRELATION.names, np.eye(2))
    assert "cannot be separated" in page_of(diagnosis, Extras(correlation=CORRELATION)).html
    assert "cannot be separated" not in page_of(diagnosis, Extras(correlation=loose)).html


def test_a_folder_without_a_diagnosis_or_of_another_version_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_diagnosis(tmp_path)
    back(named(), ALL, tmp_path)
    shown = json.loads((tmp_path / SHOWN).read_text())
    del shown["evidence"]
    (tmp_path / SHOWN).write_text(json.dumps(shown))
    with pytest.raises(InputError, match=r"not written by this version.*evidence"):
        read_diagnosis(tmp_path)


def test_the_parts_of_a_trial_come_back_and_stand_on_the_page(tmp_path: Path) -> None:
    """A current of its own in each recording, one that stopped and one that drifted."""
    parts = (
        replace(CURRENT, scope="day", when=When(recording="monday.mcap"), in_vessel=False),
        replace(CURRENT, when=When(until="2026-09-01T12:10:00Z"), in_vessel=False),
        replace(CURRENT, drift=EffectDrift("2026-09-01T12:00:00Z", "2026-09-01T13:00:00Z", CURRENT.parameters)),
    )
    diagnosis = replace(named(), effects=parts)
    again, extras = back(diagnosis, Extras(), tmp_path)
    assert again.effects == parts
    html = page_of(again, extras).html
    for words in (
        "ocean current, in monday.mcap",
        "ocean current, until 12:10 on 1 Sep UTC",
        "the ocean current at the end of the trial",
    ):
        assert words in html
    assert html.count("<h1>The model lacks ocean current</h1>") == 1
    assert "ocean_current in monday.mcap" in str(again)
