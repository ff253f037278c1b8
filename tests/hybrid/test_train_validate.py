"""Training and judging: what is gained on voyages that were not seen, and that unseen means unseen."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import DataShortageError, InputError
from seatrial.hybrid.calibrators import TrainedCalibrator, train_calibrator
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.evaluation.validate import Validation, refuse_training_data, validate_predictions
from seatrial.hybrid.prediction.baselines import conformal_region, distances, relative_distances
from seatrial.hybrid.prediction.dataset import WindowSource, load_dataset, windows_within_model_range
from seatrial.hybrid.report.text import validation_table
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from tests.conftest import SMALL_HORIZON_S, Simulated, few_epochs
from tests.hybrid.windows_by_hand import random_windows

METHOD_KEYS = {
    "start",     "mean_distance_m", "end_distance_m", "mae_north_m", "mae_east_m", "heading_error_deg", "by_second",
}  # fmt: skip
CONTRACT = {"horizon_s", "windows", "methods", "reduction", "coverage_95"}


@pytest.fixture(scope="module")
def judged(small: TrainedCalibrator, unseen: Path, plant: Plant) -> Validation:
    """The small calibrator on a voyage it has not seen."""
    return validate_predictions(load_dataset([unseen], SMALL_HORIZON_S, 5), plant, small)


def test_a_calibrator_takes_much_of_the_error_on_an_unseen_voyage(judged: Validation) -> None:
    """Little data and a few seconds of training suffice; it beats every method without the model. From the state
    that
    is known afterwards it is half: what is not known of the start no calibrator takes off."""
    mean = {name: each.mean_distance_m for name, each in judged.scores.items()}
    assert judged.reduction is not None
    assert judged.reduction > 0.4
    ahead = {name: each.mean_distance_m for name, each in judged.two_sided.items()}
    assert ahead["hybrid_two_sided"] < 0.5 * ahead["reference_two_sided"]
    assert judged.reduction == pytest.approx(1.0 - mean["hybrid"] / mean["reference"])
    assert mean["hybrid"] < min(mean["constant_velocity"], mean["data_driven"])


def test_the_band_holds_what_it_says(judged: Validation) -> None:
    """Of the positions of an unseen voyage about 95 % lie in the band that was sized on other legs."""
    assert judged.coverage_95 is not None
    assert 0.85 <= judged.coverage_95 <= 1.0
    assert judged.region_m is not None
    relative = relative_distances(judged.tracks["hybrid"], judged.windows.track, judged.region_m)
    assert judged.coverage_95 == pytest.approx((relative <= 1.0).mean())
    gaps = distances(judged.tracks["hybrid"], judged.windows.track)
    assert (gaps <= judged.region_m.max(axis=-1)).mean() >= judged.coverage_95
    said = judged.as_dict()
    middle = np.median(judged.region_m, axis=0)
    assert np.transpose([said["band_along_m"], said["band_across_m"]]) == pytest.approx(middle)
    assert said["band_m"] == pytest.approx(middle.max(axis=1))


def test_json_is_the_contracts_object(judged: Validation) -> None:
    """The keys to the letter, every number finite, one value a second."""
    plain = json.loads(json.dumps(judged.as_dict(), allow_nan=False))
    assert set(plain) >= CONTRACT
    causal = ["straight_line", "constant_velocity", "reference", "data_driven", "hybrid"]
    assert list(plain["methods"]) == [*causal, *(f"{name}_two_sided" for name in causal)]
    for name, method in plain["methods"].items():
        assert set(method) == METHOD_KEYS
        assert method["start"] == ("causal" if name in causal else "two_sided")
        assert len(method["by_second"]) == plain["horizon_s"] == SMALL_HORIZON_S
    assert plain["windows"] == len(judged.windows)


def test_the_table_for_a_terminal_says_what_its_columns_are(judged: Validation) -> None:
    """Distances in three digits below their titles, the heading's error last; the best method's row is bold."""
    table = validation_table(judged)
    titles = [str(column.header) for column in table.columns]
    assert titles == ["method", "start", "mean m", "at end m", "north m", "east m", "heading deg"]
    assert list(table.columns[1].cells) == ["causal"] * 5 + ["two-sided"] * 5
    assert next(iter(table.columns[2].cells)) == f"{judged.scores['straight_line'].mean_distance_m:.3f}"
    assert sum(row.style == "bold" for row in table.rows) == 1


def test_without_a_calibrator_there_are_baselines(unseen: Path, plant: Plant) -> None:
    plain = validate_predictions(load_dataset([unseen], SMALL_HORIZON_S, 5), plant).as_dict()
    assert [name for name, each in plain["methods"].items() if each["start"] == "causal"] == [
        "straight_line", "constant_velocity", "reference",
    ]  # fmt: skip
    assert plain["reduction"] is None
    assert plain["coverage_95"] is None


def test_every_method_is_judged_on_the_same_windows(judged: Validation) -> None:
    shapes = {tracks.shape for tracks in judged.tracks.values()}
    assert shapes == {judged.windows.track.shape}
    assert all(np.isfinite(tracks).all() for tracks in judged.tracks.values())


def test_a_calibrator_judges_shorter_horizons_and_refuses_longer_ones(
    small: TrainedCalibrator, unseen: Path, plant: Plant
) -> None:
    judged = validate_predictions(load_dataset([unseen], 15, 5), plant, small)
    assert judged.region_m is not None
    whole = validate_predictions(load_dataset([unseen], 30, 5), plant, small)
    begun = replace(whole.windows, track=whole.windows.track[:, :16])
    found = small.predict_tracks(begun, whole.tracks["reference"][:, :16])
    assert whole.region_m is not None
    assert found.region_m == pytest.approx(whole.region_m[:, :15])
    assert found.tracks == pytest.approx(whole.tracks["hybrid"][:, :16])
    with pytest.raises(InputError, match="predicts at most 30 s, not 45 s; use --horizon 30"):
        validate_predictions(load_dataset([unseen], 45, 5), plant, small)


def test_what_it_was_trained_on_is_refused_under_any_name(
    small: TrainedCalibrator, earlier: list[Path], unseen: Path, tmp_path: Path
) -> None:
    """A copy is the same recording; another voyage is not; the message names the file."""
    copy = Path(shutil.copy(earlier[2], tmp_path / "innocent.mcap"))
    with pytest.raises(InputError, match=r"innocent\.mcap: took part in the training"):
        refuse_training_data(load_dataset([copy], SMALL_HORIZON_S, 5).sources, small)
    refuse_training_data(load_dataset([unseen], SMALL_HORIZON_S, 5).sources, small)


@pytest.mark.parametrize(
    ("trained_part", "validated_part", "refused"),
    [
        ((0.0, 70.0), (70.0, 100.0), False),
        ((0.0, 70.0), (0.0, 100.0), True),
        ((0.0, 70.0), (69.0, 100.0), True),
        ((0.0, 70.0), (10.0, 20.0), True),
        ((70.0, 100.0), (0.0, 70.0), False),
        ((30.0, 40.0), (0.0, 100.0), True),
    ],
)
def test_parts_of_one_recording(
    small: TrainedCalibrator, trained_part: tuple[float, float], validated_part: tuple[float, float], refused: bool
) -> None:
    """What was trained on the first 70 % may be judged on the rest, and on nothing that overlaps."""
    source = WindowSource(Path("voyage.mcap"), "ab" * 32, trained_part)
    trained = replace(small, sources=(source,))
    asked = (replace(source, part=validated_part),)
    if refused:
        with pytest.raises(InputError, match="took part in the training"):
            refuse_training_data(asked, trained)
    else:
        refuse_training_data(asked, trained)


def test_parts_that_meet_share_no_second(unseen: Path) -> None:
    """The windows of 0..70 end before those of 70..100 begin."""
    first, second = (load_dataset([unseen], 15, 5, part).windows for part in ((0.0, 70.0), (70.0, 100.0)))
    assert first.start_time.max().timestamp() + 15 < second.start_time.min().timestamp()


percent = st.floats(0.0, 100.0)


@given(a=st.tuples(percent, percent).map(sorted), b=st.tuples(percent, percent).map(sorted))
def test_overlap_is_mutual_and_needs_the_same_recording(a: list[float], b: list[float]) -> None:
    one, other = WindowSource(Path("a"), "x", (a[0], a[1])), WindowSource(Path("b"), "x", (b[0], b[1]))
    assert one.overlaps(other) == other.overlaps(one)
    assert not one.overlaps(replace(other, sha256="y"))


def test_a_recording_given_twice_is_refused(unseen: Path, tmp_path: Path) -> None:
    """Its legs would stand on both sides of every split, and its windows count twice."""
    copy = Path(shutil.copy(unseen, tmp_path / "copy.mcap"))
    with pytest.raises(InputError, match=r"copy\.mcap: is given twice"):
        load_dataset([unseen, copy], 15, 5)


def test_recordings_are_gathered_in_any_order(earlier: list[Path]) -> None:
    """Start states belong to their windows whatever the order of the files."""
    there, back = load_dataset(earlier[:2], 15, 5).windows, load_dataset(earlier[1::-1], 15, 5).windows
    order = [np.lexsort((each.start_time.asi8, each.trial)) for each in (there, back)]
    assert np.array_equal(there.start[order[0]], back.start[order[1]])
    assert np.array_equal(there.track[order[0]], back.track[order[1]])


def test_training_keeps_whole_legs_out_and_says_so(small: TrainedCalibrator, earlier: list[Path]) -> None:
    metrics = small.metrics
    assert metrics["training_windows"] + metrics["held_out_windows"] == metrics["windows"]
    assert 0.1 < metrics["held_out_windows"] / metrics["windows"] < 0.4
    assert metrics["held_out_hybrid_m"] < metrics["held_out_reference_m"]
    assert [each.path for each in small.sources] == [path.resolve() for path in earlier]


def test_training_repeats(earlier: list[Path], unseen: Path, plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    """One seed is one calibrator from the files on; another seed keeps other legs out."""

    def fewer(method: str, seed: int, plant: Plant) -> object:
        return few_epochs(method, seed, plant, epochs=2)

    monkeypatch.setattr("seatrial.hybrid.calibrators.make_calibrator", fewer)
    dataset = load_dataset(earlier[:2], 15, 5)
    first, again, other = (train_calibrator(dataset, "gunnerus_short", plant, "paper", seed) for seed in (1, 1, 2))
    assert np.array_equal(first.region_m, again.region_m)
    assert first.metrics == again.metrics
    assert first.metrics != other.metrics
    validations = [
        validate_predictions(load_dataset([unseen], 15, 5), plant, each).as_dict() for each in (first, again)
    ]
    assert validations[0] == validations[1]


def test_windows_out_of_the_models_range_are_left_out_and_counted(unseen: Path, plant: Plant) -> None:
    dataset = load_dataset([unseen], 15, 5)
    fast = dataset.windows.past.copy()
    fast[:3, 0, 3] = 25.0
    found = validate_predictions(replace(dataset, windows=replace(dataset.windows, past=fast)), plant)
    assert found.outside == 3
    assert len(found.windows) == len(dataset.windows) - 3
    fast[:, 0, 3] = 25.0
    with pytest.raises(DataShortageError, match="leaves its valid range in every window"):
        windows_within_model_range(replace(dataset.windows, past=fast), plant)


def test_one_leg_cannot_be_split(unseen: Path, plant: Plant) -> None:
    dataset = load_dataset([unseen], 15, 5)
    single = dataset.windows.subset(dataset.windows.leg == dataset.windows.leg[0])
    with pytest.raises(DataShortageError, match="only one leg"):
        train_calibrator(replace(dataset, windows=single), "gunnerus_short", plant)


@given(seed=st.integers(0, 500), count=st.integers(1, 60))
def test_the_band_is_never_too_small_for_what_sized_it(seed: int, count: int) -> None:
    """It holds 95 % of the windows it was sized on at every second, all of them when they are few, and it
    never falls.
    """
    windows = random_windows(count, 6, seed)
    off = windows.track + np.random.default_rng(seed).normal(0.0, 1.0, windows.track.shape)
    region_m = conformal_region(off, windows)
    inside = (relative_distances(off, windows.track, region_m) <= 1.0 + 1e-12).mean(axis=0)
    assert (inside >= 0.95).all()
    assert (np.diff(region_m, axis=0) >= 0.0).all()
    if count < 20:
        assert (inside == 1.0).all()


def test_the_band_covers_new_windows_of_the_same_kind() -> None:
    """Sized on 200 windows, it holds 95 % of others of the same kind on average over many draws."""
    random = np.random.default_rng(6)
    windows = random_windows(400, 3)
    inside = []
    for _ in range(60):
        off = windows.track + random.normal(0.0, 1.0, windows.track.shape)
        sized, others = windows.subset(np.arange(400) < 200), windows.subset(np.arange(400) >= 200)
        region_m = conformal_region(off[:200], sized)
        inside.append((relative_distances(off[200:], others.track, region_m)[:, 0] <= 1.0).mean())
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("sea_state", ["calm", "gentle", "moderate"])
def test_three_quarters_of_the_error_go(
    sea_state: str, simulated: Simulated, report_line: Callable[[str], None]
) -> None:
    """The lengthened ship, the model of the ship before, half a minute ahead, voyages that were not seen."""
    plant = vessel_plant(load_vessel("gunnerus_short"))
    training = [simulated(sea_state, seed, 1800.0, 2.0) for seed in range(12)]
    trained = train_calibrator(load_dataset(training, 30, 5), "gunnerus_short", plant)
    unseen = load_dataset([simulated(sea_state, seed, 1800.0, 2.0) for seed in (100, 101, 102)], 30, 5)
    found = validate_predictions(unseen, plant, trained)
    means = ", ".join(f"{name} {each.mean_distance_m:.3f} m" for name, each in found.scores.items())
    report_line(
        f"{sea_state}: {means}; {found.reduction:.1%} less, the band holds {found.coverage_95:.1%}, "
        f"{len(found.windows)} windows"
    )
    assert found.reduction is not None
    assert found.reduction >= 0.75
    assert found.scores["hybrid"].mean_distance_m < found.scores["data_driven"].mean_distance_m
    assert found.coverage_95 is not None
    assert found.coverage_95 >= 0.9


@pytest.mark.slow
def test_in_another_sea_nothing_is_lost(simulated: Simulated, report_line: Callable[[str], None]) -> None:
    """A calibrator of one sea state in the others is hardly worse than the best baseline, and says that it guesses
    or is right about how sure it is.
    """
    plant = vessel_plant(load_vessel("gunnerus_short"))
    voyages = {
        sea: load_dataset([simulated(sea, seed, 1800.0, 2.0) for seed in range(4)], 30, 5)
        for sea in ("calm", "gentle", "moderate")
    }
    for known, training in voyages.items():
        trained = train_calibrator(training, "gunnerus_short", plant)
        for unseen in voyages.keys() - {known}:
            found = validate_predictions(voyages[unseen], plant, trained)
            best_m = min(found.scores[name].mean_distance_m for name in ("constant_velocity", "reference"))
            ratio = found.scores["hybrid"].mean_distance_m / best_m
            assert found.outside_domain is not None
            assert found.coverage_95 is not None
            guessed = found.outside_domain.mean()
            report_line(
                f"{known} to {unseen}: {ratio:.2f}, the band holds {found.coverage_95:.1%}, {guessed:.0%} guessed"
            )
            assert ratio < 1.2
            assert guessed > 0.5 or found.coverage_95 > 0.9


@pytest.fixture
def report_line(capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    """Print a line whatever pytest captures: the figures are what the slow tests are read for."""

    def line(text: str) -> None:
        with capsys.disabled():
            print(f"\n{text}")  # noqa: T201

    return line
