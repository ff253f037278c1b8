"""The map of how good a reference must be: its numbers, its thresholds, its sentences, its picture."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import distances, simulate_reference
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.notebooks import fidelity_map
from tests.conftest import few_epochs
from tests.hybrid.windows_by_hand import windows_at

SHORT, LONG = (vessel_plant(load_vessel(name)) for name in ("gunnerus_short", "gunnerus_long"))
AMOUNTS = (10, 80)


def sailed(plant: Plant, count: int, seed: int) -> PredictionWindows:
    """Windows of 15 s in which ``plant`` does what it would, measured to a centimetre, under many helms."""
    random = np.random.default_rng(seed)
    start = random.uniform([0, 0, -np.pi, 2.0, -0.2, -0.02], [0, 0, np.pi, 4.0, 0.2, 0.02], (count, 6))
    windows = windows_at(start, 15)
    helm_rad = np.deg2rad(random.uniform(-30.0, 30.0, count))
    shaft_rps = random.uniform(1.5, 3.0, count)
    control = np.column_stack([shaft_rps, helm_rad, shaft_rps, helm_rad, np.zeros(count)])
    windows = replace(windows, control=control)
    track = simulate_reference(windows, plant)
    return replace(windows, track=track + random.normal(0.0, 0.01, track.shape) * [1.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def small() -> Any:
    """A map in a still sea, from the truth to a hopeless reference."""
    sequences = fidelity_map.Sequences(sailed(LONG, 80, seed=1), sailed(LONG, 30, seed=2))
    steps = fidelity_map.degradations(LONG, SHORT, shares=(0.0, 1.0), factors=(5.0,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fidelity_map, "make_calibrator", partial(few_epochs, epochs=30))
        return fidelity_map.fidelity_map(sequences, steps, "paper", AMOUNTS, seeds=(0,), workers=1)


def by_hand(reference_m: list[float], hybrid_m: list[list[float]], data_m: list[float]) -> Any:
    count = len(reference_m)
    return fidelity_map.FidelityMap(
        method="paper",
        axis=(fidelity_map.OVERALL,) * count,
        label=tuple(str(each) for each in reference_m),
        windows=tuple(10 * 2**number for number in range(len(data_m))),
        reference_m=np.array(reference_m),
        hybrid_m=np.array(hybrid_m),
        data_driven_m=np.array(data_m),
        constant_velocity_m=1.5,
        unseen_windows=20,
        seeds=(0,),
    )


def test_the_truth_as_reference_is_right_and_wins_with_few_data(small: Any) -> None:
    assert small.reference_m[0] < 0.02
    assert small.rivals[int(small.errors_m()[:, 0, 0].argmin())] == "reference"
    assert small.hybrid_m[0, 0] < small.data_driven_m[0]


def test_a_hopeless_reference_alone_does_not_beat_much_data(small: Any) -> None:
    errors_m = small.errors_m()[:, -1, -1]
    assert errors_m[small.rivals.index("reference")] > 3.0 * small.data_driven_m[-1]
    assert small.rivals[int(errors_m.argmin())] in ("data_driven", "paper")


def test_more_data_and_better_references_help(small: Any) -> None:
    assert small.data_driven_m[1] < small.data_driven_m[0]
    assert small.hybrid_m[0, 0] < small.hybrid_m[-1, 0]


def test_references_get_worse_along_the_main_axis() -> None:
    windows = sailed(LONG, 20, seed=3)
    steps = fidelity_map.degradations(LONG, SHORT)
    errors_m = [distances(simulate_reference(windows, each.plant), windows.track).mean() for each in steps]
    assert np.all(np.diff(errors_m) > 0.0)


def test_ends_of_the_blend_are_truth_and_reference() -> None:
    for share, plant in ((0.0, LONG), (1.0, SHORT)):
        mixed = fidelity_map.blended(LONG, SHORT, share)
        assert all(np.allclose(mixed.number(name), value, rtol=1e-12) for name, value in plant.numbers().items())
    assert fidelity_map.livelier(SHORT, 1.0) == SHORT


def test_single_axes_change_one_thing() -> None:
    truth = LONG.shifted(current_north_mps=0.2)
    names = {each.label: {n for n, value in truth.numbers().items() if each.plant.number(n) != value}
             for each in fidelity_map.single_degradations(truth, SHORT)}  # fmt: skip
    assert names["without current and wave drift"] == {"current_north_mps"}
    assert "mass_kg" in names["without what changed the ship"]
    assert "current_north_mps" not in names["without what changed the ship"]
    assert all(name.startswith(("thrust_", "side_")) for name in names["thrust x 2"])


@given(
    limit_m=st.floats(0.3, 8.0),
    data_m=st.floats(0.2, 5.0),
)
@settings(max_examples=50)
def test_the_threshold_is_found_where_it_was_put(limit_m: float, data_m: float) -> None:
    """The hybrid's gain falls with the logarithm of the reference's error and is 5 % at ``limit_m``."""
    reference_m = np.geomspace(0.1, 20.0, 9)
    gain = 0.05 - 0.2 * np.log(reference_m / limit_m)
    found = by_hand(reference_m.tolist(), (data_m * (1.0 - gain))[:, None].tolist(), [data_m])
    assert fidelity_map.useful_up_to_m(found)[0] == pytest.approx(limit_m, rel=1e-6)


def test_thresholds_beyond_the_ends() -> None:
    found = by_hand([0.1, 1.0, 10.0], [[0.5, 1.0], [0.5, 1.0], [0.5, 1.0]], [1.0, 1.0])
    assert fidelity_map.useful_up_to_m(found).tolist() == [np.inf, 0.0]
    assert found.as_dict()["useful_up_to_m"] == [None, 0.0]


def test_the_hybrid_is_best_only_where_nothing_else_is() -> None:
    found = by_hand([0.1, 1.0, 3.0, 10.0], [[0.3], [0.5], [0.9], [1.6]], [2.0])
    assert fidelity_map.hybrid_wins(found).ravel().tolist() == [False, True, True, False]
    assert "with 10 windows even the worst tried, 10.00 m off, is good enough" in fidelity_map.reading(found)[0]
    assert "on so many of the 4 references: 2 with 10 windows" in fidelity_map.reading(found)[1]


def test_a_reference_is_enough_alone_until_something_beats_it() -> None:
    found = by_hand([0.1, 1.0, 10.0], [[0.3], [0.5], [0.9]], [2.0])
    assert fidelity_map.enough_alone_m(found).tolist() == [0.1]


def test_a_reference_beaten_once_is_not_enough_beyond() -> None:
    """A worse reference on which the hybrid does badly by chance does not make the better one enough."""
    found = by_hand([0.1, 0.5, 1.0], [[0.3], [0.3], [2.0]], [2.0])
    assert fidelity_map.enough_alone_m(found).tolist() == [0.1]
    assert fidelity_map.enough_alone_m(by_hand([1.0, 2.0], [[0.5], [3.0]], [3.0])).tolist() == [0.0]


def test_the_reading_says_where_there_is_nothing_to_gain() -> None:
    """Data alone better everywhere: no threshold, no win, and the nearest miss is named."""
    found = by_hand([0.5, 4.0], [[1.0, 0.4], [2.0, 0.6]], [0.9, 0.3])
    how_bad, choice, gain = fidelity_map.reading(found)
    assert "with 10 and 20 windows even the best reference, 0.50 m off, is not good enough" in how_bad
    assert "of the 2 references: none with 10 and 20 windows" in choice
    assert "no calibrator up to 0.50 m off with 10, nowhere with 20" in choice
    assert "gains nowhere" in gain
    assert "20 windows on the reference that is 0.50 m off: 0.40 m against 0.30 m of the data alone" in gain


def test_amounts_of_which_the_same_is_said_are_named_together() -> None:
    found = by_hand([0.2, 2.0], [[0.5, 0.3, 0.1], [0.9, 0.3, 0.1]], [0.9, 0.9, 0.9])
    assert ": none with 10, 1 with 20, 2 with 40 windows" in fidelity_map.reading(found)[1]
    assert "up to 0.20 m off with 10 and 20, nowhere with 40" in fidelity_map.reading(found)[1]
    assert "with 10 windows one less than" in fidelity_map.reading(found)[0]
    assert "with 20 and 40 windows even the worst" in fidelity_map.reading(found)[0]


def test_the_gain_is_on_the_best_of_the_others_whichever_it_is() -> None:
    """The reference where that is better than the data, constant velocity where that is."""
    beside_reference = by_hand([1.0, 9.0], [[0.4], [1.9]], [2.0])
    beside_constant_velocity = by_hand([1.0, 9.0], [[0.9], [0.5]], [2.0])
    assert (
        "0.40 m against 1.00 m of the reference; with 10 it leaves 0.40 m on the best reference and 1.90 m"
        in fidelity_map.reading(beside_reference)[2]
    )
    assert "0.50 m against 1.50 m of constant velocity;" in fidelity_map.reading(beside_constant_velocity)[2]


def test_three_sentences_with_numbers_of_the_map(small: Any) -> None:
    sentences = fidelity_map.reading(small)
    assert len(sentences) == 3
    assert all(sentence.endswith(".") and ". " not in sentence[:-1] for sentence in sentences)
    main = small.overall()
    known = {
        f"{each:.2f}" for array in (main.reference_m, main.hybrid_m, main.data_driven_m) for each in np.ravel(array)
    }
    known |= {f"{main.constant_velocity_m:.2f}", "0.00"} | {
        f"{each:.2f}" for each in fidelity_map.useful_up_to_m(main)
    }
    assert set(re.findall(r"\d+\.\d\d", " ".join(sentences))) <= known
    for amount in AMOUNTS:
        assert re.search(rf"with (\d+(, | and ))*{amount}\b", sentences[0])


def test_too_few_windows_is_said(small: Any) -> None:
    few = fidelity_map.Sequences(sailed(LONG, 5, seed=1), sailed(LONG, 5, seed=2))
    with pytest.raises(DataShortageError, match="too few"):
        fidelity_map.fidelity_map(few, fidelity_map.degradations(LONG, SHORT), amounts=(10,), workers=1)


def test_the_picture_has_units_and_a_number_in_every_cell(small: Any) -> None:
    figure = Figure()
    fidelity_map.draw_map(figure, small)
    (axes,) = figure.axes
    assert "[m]" in axes.get_ylabel()
    assert axes.get_xlabel() == "windows to learn from"
    numbers = [float(text.get_text()) for text in axes.texts]
    assert np.allclose(numbers, small.overall().errors_m().min(axis=0).ravel(), atol=0.005)
    assert len(figure.legends[0].get_texts()) in (len(small.rivals), len(small.rivals) + 1)


def test_files_hold_the_map_and_its_reading(small: Any, tmp_path: Path) -> None:
    paths = fidelity_map.write_map(small, tmp_path)
    assert all(path.stat().st_size for path in paths)
    plain = json.loads((tmp_path / "fidelity_map.json").read_text())
    assert plain["hybrid_m"] == small.hybrid_m.tolist()
    assert plain["reading"] == list(fidelity_map.reading(small))
