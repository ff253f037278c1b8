"""Artefacts: what comes back from the disk, what is checked, and what a crash or an editor can do to one."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from seatrial.acquisition.core.errors import ConfigurationError, InputError, SeatrialError, StorageError
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import DEFAULT, NAMES
from seatrial.hybrid.calibrators import METHODS, TrainedCalibrator, make_calibrator, plant_of_calibrator
from seatrial.hybrid.calibrators.adaptive import fit_parameter_vector
from seatrial.hybrid.calibrators.networks import REFERENCE_INPUTS, DataDrivenCalibrator, start_labels
from seatrial.hybrid.calibrators.own import FORMAT, SIDECAR, load, save
from seatrial.hybrid.prediction.baselines import Fallback
from seatrial.hybrid.vessel.files import add_effects, load_vessel, locate_vessel, save_vessel
from seatrial.hybrid.vessel.plant import Plant, bare_plant, plant_from_numbers, plant_hash, plant_numbers
from tests.hybrid.windows_by_hand import answers, random_windows

SECONDS = 6
FILES = ("calibrator.safetensors", "data_driven.safetensors", SIDECAR)
Json = dict[str, Any]


@pytest.fixture(scope="module")
def tiny(plant: Plant) -> Callable[..., TrainedCalibrator]:
    """A calibrator of any method, hardly trained on a few windows; another seed, another one."""

    def trained(method: str = "paper", seed: int = 0) -> TrainedCalibrator:
        training, stopping = (random_windows(count, SECONDS, seed + count) for count in (12, 4))
        fitted = [make_calibrator(each, seed, plant) for each in (method, "data_driven")]
        for calibrator in fitted:
            vars(calibrator).update(epochs=2, batch=32)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(
                    "seatrial.hybrid.calibrators.adaptive.fit_parameter_vector",
                    partial(fit_parameter_vector, steps=1),
                )
                calibrator.fit((training, training.track), (stopping, stopping.track))
        region_m = np.linspace((0.5, 0.4), (3.0, 2.0), SECONDS)
        fallback = Fallback(np.array([1.5, 0.5]), np.array([1.0, 0.3]), region_m)
        return TrainedCalibrator(
            fitted[0], fitted[1], SECONDS, "gunnerus_short", plant, region_m, fallback, (), {"windows": 16}
        )

    return trained


@pytest.fixture
def sound(tiny: Callable[..., TrainedCalibrator], tmp_path: Path) -> Path:
    """A sound artefact to do harm to."""
    return save(tiny(), tmp_path / "calibrator").parent


def loaded_or_error(folder: Path) -> tuple[TrainedCalibrator | None, str]:
    """What is loaded, or the text of the error; anything but an error of Seatrial's goes through."""
    try:
        return load(folder), ""
    except SeatrialError as error:
        return None, str(error)


def sidecar_of(folder: Path) -> Json:
    read: Json = json.loads((folder / SIDECAR).read_text())
    return read


def rewrite(folder: Path, sidecar: object) -> None:
    (folder / SIDECAR).write_text(json.dumps(sidecar))


def with_weights(folder: Path, change: Callable[[dict[str, Floats]], object]) -> None:
    """Change the calibrator's tensors, and its hash in the sidecar so that it agrees."""
    path = folder / FILES[0]
    tensors = {name: value.copy() for name, value in safetensors.numpy.load(path.read_bytes()).items()}
    change(tensors)
    path.write_bytes(safetensors.numpy.save(tensors))
    sidecar = sidecar_of(folder)
    sidecar["files"][FILES[0]] = hashlib.sha256(path.read_bytes()).hexdigest()
    rewrite(folder, sidecar)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_comes_back_to_the_bit(
    method: str, tiny: Callable[..., TrainedCalibrator], tmp_path: Path
) -> None:
    """Predictions, ignorance and spread of both calibrators, on windows like and unlike those of the training."""
    trained = tiny(method, seed=3)
    loaded = load(save(trained, tmp_path).parent)
    windows = random_windows(10, SECONDS, seed=9)
    unlike = replace(windows, start=windows.start * [1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
    for before, after in ((trained.calibrator, loaded.calibrator), (trained.data_driven, loaded.data_driven)):
        assert (after.method, after.seed, after.plant) == (before.method, before.seed, before.plant)
        for each in (windows, unlike):
            for then, now in zip(answers(before, each, each.track), answers(after, each, each.track), strict=True):
                assert np.array_equal(then, now)


def test_all_that_is_known_comes_back(small: TrainedCalibrator, small_folder: Path) -> None:
    """Band, sources with what each gave, metrics, vessel, date and versions come back as they were."""
    loaded = load(small_folder)
    assert np.array_equal(loaded.region_m, small.region_m)
    for name in ("sources", "metrics", "horizon_s", "vessel", "plant", "trained_at", "versions"):
        assert getattr(loaded, name) == getattr(small, name)
    again = save(loaded, small_folder.parent / "again").parent
    for name in FILES:
        assert (again / name).read_bytes() == (small_folder / name).read_bytes()


def test_the_sidecar_is_for_people_and_says_where_it_comes_from(
    small: TrainedCalibrator, small_folder: Path
) -> None:
    """Inputs with units and scaling, what each recording gave, the vessel in full, hashes, date and versions."""
    sidecar = sidecar_of(small_folder)
    inputs = {each["name"]: each for each in sidecar["calibrator"]["inputs"]}
    assert tuple(inputs) == (*start_labels(DEFAULT), *REFERENCE_INPUTS)
    assert [inputs[name]["unit"] for name in ("surge_mps", "yaw_rate_radps", "port_rps", "heading_sin")] == [
        "m/s", "rad/s", "rev/s", "1",
    ]  # fmt: skip
    assert inputs["second"]["mean"] == pytest.approx((small.horizon_s + 1) / 2)
    assert (inputs["second"]["low"], inputs["second"]["high"]) == (1.0, small.horizon_s)
    assert [each["name"] for each in sidecar["calibrator"]["outputs"]] == ["north_m", "east_m"]
    assert len(sidecar["region_m"]) == sidecar["horizon_s"]
    assert tuple(sidecar["channels"]) == NAMES
    assert sidecar["vessel"]["numbers"]["mass_kg"] == load_vessel("gunnerus_short").inertia.mass_kg
    assert sum(each["windows"] for each in sidecar["data"]) == small.metrics["windows"]
    assert sum(each["legs"] for each in sidecar["data"]) == small.metrics["legs"]
    for each in sidecar["data"]:
        assert hashlib.sha256(Path(each["path"]).read_bytes()).hexdigest() == each["sha256"]
        assert each["span"][0] < each["span"][1]
    for name, digest in sidecar["files"].items():
        assert hashlib.sha256((small_folder / name).read_bytes()).hexdigest() == digest
    assert set(sidecar["versions"]) == {"seatrial", "python", "torch", "numpy"}
    assert sidecar["trained_at"].endswith("Z")


def test_a_constant_input_is_strict_json(sound: Path) -> None:
    """The tunnel thruster never ran: its endless deviation is no number of JSON, and is left out."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    sidecar = json.loads((sound / SIDECAR).read_text(), parse_constant=refuse)
    tunnel = next(each for each in sidecar["calibrator"]["inputs"] if each["name"] == "tunnel_rpm")
    assert (tunnel["mean"], tunnel["deviation"]) == (0.0, None)


def _edit(*keys: str | int, to: object) -> Callable[[Path], None]:
    """Change one value of the sidecar."""

    def damage(folder: Path) -> None:
        sidecar: Any = sidecar_of(folder)
        inner = sidecar
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = to
        rewrite(folder, sidecar)

    return damage


def _truncate(folder: Path) -> None:
    weights = folder / FILES[0]
    weights.write_bytes(weights.read_bytes()[:-8])


def _swap(folder: Path) -> None:
    one, other = (folder / name for name in FILES[:2])
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)


def _swap_with_hashes(folder: Path) -> None:
    _swap(folder)
    sidecar = sidecar_of(folder)
    files = sidecar["files"]
    files[FILES[0]], files[FILES[1]] = files[FILES[1]], files[FILES[0]]
    rewrite(folder, sidecar)


def _make_folder(folder: Path) -> None:
    (folder / SIDECAR).unlink()
    (folder / SIDECAR).mkdir()


def _write(name: str, content: bytes) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(content)


def _weights(change: Callable[[dict[str, Floats]], object]) -> Callable[[Path], None]:
    return lambda folder: with_weights(folder, change)


DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no sidecar": (lambda folder: (folder / SIDECAR).unlink(), "calibrator.json is missing"),
    "no weights": (lambda folder: (folder / FILES[0]).unlink(), "calibrator.safetensors is missing"),
    "a folder as sidecar": (_make_folder, "cannot be read"),
    "empty sidecar": (_write(SIDECAR, b""), "is damaged"),
    "binary sidecar": (_write(SIDECAR, b"\xff\xfe\x00\x81"), "is damaged"),
    "half a sidecar": (_write(SIDECAR, b'{"format": 2, "horizon_s": '), "is damaged"),
    "a list": (_write(SIDECAR, b"[]"), "is damaged"),
    "a deep list": (_write(SIDECAR, b'{"format": ' + b"[" * 100_000), "is damaged"),
    "no format": (_write(SIDECAR, b"{}"), "format: "),
    "another format": (_edit("format", to=99), f"is of format 99, and this version reads {FORMAT}"),
    "the format before": (_write(SIDECAR, b'{"format": 1, "method": "paper"}'), "is of format 1"),
    "no band": (_edit("region_m", to=None), "region_m"),
    "a short band": (_edit("region_m", to=[[1.0, 2.0], [2.0, 3.0]]), "region_m has 2 values for 6 s"),
    "a band of words": (_edit("region_m", 3, 0, to="wide"), "region_m.3"),
    "a band below nothing": (_edit("region_m", 3, 1, to=-1.0), "region_m.3"),
    "an endless band": (_edit("region_m", 3, 0, to=float("inf")), "region_m.3"),
    "no reserve": (_edit("reserve", to=None), "reserve"),
    "a reserve that never errs": (
        _edit("reserve", "reference_m", 0, to=0.0),
        "reserve.reference_m.0",
    ),
    "a short reserve": (
        _edit("reserve", to={"reference_m": [1.0, 1.0], "constant_velocity_m": [1.0, 1.0], "region": [[1.0, 1.0]]}),
        "reserve.region has 1 values for 6 s",
    ),
    "another horizon": (_edit("horizon_s", to=7), "region_m has 6 values for 7 s"),
    "half a second": (_edit("horizon_s", to=6.5), "horizon_s"),
    "a horizon as text": (_edit("horizon_s", to="6"), "horizon_s"),
    "other channels": (_edit("channels", to=[*NAMES, "roll_deg"]), "other channels.*roll_deg"),
    "another past": (_edit("past_s", to=10), "with 10 s before their start"),
    "other inputs": (_edit("calibrator", "inputs", 0, "name", to="moon"), "other inputs"),
    "no inputs": (_edit("calibrator", "inputs", to=[]), "other inputs"),
    "another mean": (_edit("calibrator", "inputs", 2, "mean", to=1e3), "not scaled as its weights"),
    "another unit": (_edit("calibrator", "inputs", 2, "unit", to="kn"), "not scaled as its weights"),
    "another output": (_edit("calibrator", "outputs", 0, "deviation", to=1e3), "not scaled as its weights"),
    "unknown method": (_edit("calibrator", "method", to="oracle"), "method oracle.*paper"),
    "another method": (_edit("calibrator", "method", to="data_driven"), "other inputs"),
    "a seed below nothing": (_edit("data_driven", "seed", to=-1), "data_driven.seed"),
    "a heavier ship": (_edit("vessel", "numbers", "mass_kg", to=5e5), "not those of its hash"),
    "a ship without mass": (_edit("vessel", "numbers", to={}), "is missing"),
    "a ship with a table of masses": (_edit("vessel", "numbers", "mass_kg", to=[1.0]), "mass_kg has 1 columns"),
    "a ship with a moon": (_edit("vessel", "numbers", "moon_m", to=1.0), "moon_m is not a number of a plant"),
    "no hash of the ship": (_edit("vessel", "sha256", to="?"), "vessel.sha256"),
    "no hash of the weights": (_edit("files", to={}), "hashes differ"),
    "another hash": (_edit("files", FILES[1], to="0" * 64), "data_driven.safetensors.*hashes differ"),
    "no recordings": (_edit("data", to=[{}]), "data.0.path"),
    "a part beyond all": (_edit("data", to=[{"path": "a", "sha256": "b", "part": [50, 200]}]), "0..100"),
    "no date": (_edit("trained_at", to="yesterday"), "trained_at"),
    "cut weights": (_truncate, "hashes differ"),
    "swapped weights": (_swap, "hashes differ"),
    "swapped with their hashes": (_swap_with_hashes, "the weights are not those of paper"),
    "empty weights": (_write(FILES[0], b""), "hashes differ"),
    "weights that are no number": (
        _weights(lambda each: each["network.0.bias"].__setitem__(3, float("nan"))), "network.0.bias.*not a number"),
    "an endless weight": (
        _weights(lambda each: each["network.0.bias"].__setitem__(3, float("inf"))), "network.0.bias.*not a number"),
    "a layer too few": (_weights(lambda each: each.pop("network.0.bias")), "weights are not those of paper"),
    "a wrong layer": (
        _weights(lambda each: each.update({"network.0.bias": np.zeros(3)})), "weights are not those of paper"),
    "a scaling too short": (
        _weights(lambda each: each.update({"input.range": np.zeros((2, 3))})), r"input.range is float64 \(2, 3\)"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_artefact_is_one_clear_error(name: str, sound: Path) -> None:
    """Whatever is missing, broken or edited, the text is one line that names the folder and what to do."""
    damage, message = DAMAGES[name]
    damage(sound)
    with pytest.raises(InputError, match=message) as caught:
        load(sound)
    text = str(caught.value)
    assert str(sound) in text
    assert "\n" not in text
    assert "train" in caught.value.fix
    assert len(text.replace(str(sound), "")) < 300


def test_weights_that_are_no_safetensors(sound: Path) -> None:
    """A file with the right hash and the wrong content is found out all the same."""
    (sound / FILES[0]).write_bytes(b"\xff" * 100)
    sidecar = sidecar_of(sound)
    sidecar["files"][FILES[0]] = hashlib.sha256(b"\xff" * 100).hexdigest()
    rewrite(sound, sidecar)
    with pytest.raises(InputError, match=r"calibrator\.safetensors: is damaged"):
        load(sound)


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), value=anything, action=st.sampled_from(["replace", "remove", "rename", "double"]))
def test_no_edit_of_the_sidecar_is_a_traceback(
    sound: Path, original: Json, plant: Plant, data: st.DataObject, value: Any, action: str
) -> None:
    """Any value anywhere in the file, or a key gone: it is an error of Seatrial's, or predicts as before."""
    sidecar = deepcopy(original)
    inner: Any = sidecar
    while True:
        key = data.draw(st.sampled_from(sorted(inner) if isinstance(inner, dict) else range(len(inner))))
        if not isinstance(inner[key], dict | list) or not inner[key] or data.draw(st.booleans()):
            break
        inner = inner[key]
    if action == "replace":
        inner[key] = value
    elif action == "double" and isinstance(inner, list):
        inner.append(inner[key])
    else:
        moved = inner.pop(key)
        if action == "rename" and isinstance(inner, dict):
            inner[str(value)[:10]] = moved
    rewrite(sound, sidecar)
    loaded, error = loaded_or_error(sound)
    assert "\n" not in error
    if loaded is not None:
        windows = random_windows(2, SECONDS, seed=5)
        assert np.isfinite(loaded.calibrator.predict(windows, windows.track)).all()
        assert loaded.plant == plant
        assert loaded.region_m.shape == (SECONDS, 2)


@pytest.fixture(scope="module")
def original(tiny: Callable[..., TrainedCalibrator], tmp_path_factory: pytest.TempPathFactory) -> Json:
    return sidecar_of(save(tiny(), tmp_path_factory.mktemp("original")).parent)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(FILES), at=st.floats(0.0, 1.0), bit=st.integers(0, 7))
def test_one_flipped_bit_of_the_weights_is_found(sound: Path, name: str, at: float, bit: int) -> None:
    """Of the weights always; in the sidecar, where a bit may turn one letter of a remark into another, it is an
    error of Seatrial's or the predictions are what they were."""
    path = sound / name
    content = path.read_bytes()
    changed = bytearray(content)
    changed[int(at * (len(content) - 1))] ^= 1 << bit
    windows = random_windows(2, SECONDS, seed=5)
    before = load(sound).calibrator.predict(windows, windows.track)
    path.write_bytes(changed)
    loaded, error = loaded_or_error(sound)
    path.write_bytes(content)
    assert "\n" not in error
    if loaded is None:
        assert name == SIDECAR or "hashes differ" in error
    else:
        assert name == SIDECAR
        assert np.array_equal(loaded.calibrator.predict(windows, windows.track), before)


class Crash(BaseException):
    """The machine stops."""


def stop_after(steps: int, patch: pytest.MonkeyPatch) -> None:
    """Let so many steps on the disk be done, and no more."""
    left = iter(range(steps))

    def counted(step: Callable[..., Any]) -> Callable[..., Any]:
        def counting(*arguments: Any, **options: Any) -> Any:
            if next(left, None) is None:
                raise Crash
            return step(*arguments, **options)

        return counting

    for name in ("write_bytes", "replace", "unlink"):
        patch.setattr(Path, name, counted(getattr(Path, name)))


def test_a_crash_leaves_the_old_one_or_none(
    tiny: Callable[..., TrainedCalibrator], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever step of the writing is the last one, the folder holds the old artefact, the new one, or none."""
    old, new = tiny(seed=1), tiny(seed=2)
    outcomes = []
    for last in range(20):
        folder = save(old, tmp_path / str(last)).parent
        with monkeypatch.context() as patch, suppress(Crash):
            stop_after(last, patch)
            save(new, folder)
        loaded, error = loaded_or_error(folder)
        assert loaded or "calibrator.json is missing" in error
        outcomes.append(loaded.calibrator.seed if loaded else -1)
    assert (outcomes[0], outcomes[-1]) == (1, 2)
    order = [1, -1, 2]
    assert all(order.index(before) <= order.index(after) for before, after in pairwise(outcomes))


def test_a_full_disk_leaves_the_old_one(
    tiny: Callable[..., TrainedCalibrator], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error is one of storage, and nothing half-written is left lying about."""
    folder = save(tiny(seed=1), tmp_path).parent

    def full(path: Path, content: bytes) -> None:
        path.touch()
        raise OSError(28, "No space left on device")

    other = tiny(seed=2)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(StorageError, match=r"No space left.*make room"):
            save(other, folder)
    assert load(folder).calibrator.seed == 1
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)


def test_a_failed_training_is_not_saved(tiny: Callable[..., TrainedCalibrator], tmp_path: Path) -> None:
    trained = tiny()
    trained.calibrator.state_dict()["network.0.weight"][0, 0] = np.nan
    with pytest.raises(InputError, match=r"is not a number.*train again"):
        save(trained, tmp_path)
    assert not list(tmp_path.iterdir())


def test_no_folder_and_no_place_to_write(tiny: Callable[..., TrainedCalibrator], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a trained calibrator"):
        load(tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is not a trained calibrator"):
        load(tmp_path / "file")
    with pytest.raises(StorageError, match="is a file, not a folder"):
        save(tiny(), tmp_path / "file" / "calibrator")


def test_a_calibrator_goes_with_its_vessel_only(small: TrainedCalibrator, tmp_path: Path) -> None:
    """Another ship, and the same ship with one number changed, are refused; a copy under any name is not."""
    assert plant_of_calibrator(small, None) == plant_of_calibrator(small, "gunnerus_short") == small.plant
    with pytest.raises(ConfigurationError, match="not the model that the calibrator was trained on"):
        plant_of_calibrator(small, "gunnerus_long")
    ship = load_vessel("gunnerus_short")
    heavier = replace(ship, inertia=replace(ship.inertia, mass_kg=ship.inertia.mass_kg + 1.0))
    drifting = add_effects(ship, {"ocean_current": {"speed_mps": 0.3, "direction_deg": 40.0}})
    for vessel, name in ((ship, "copy.toml"), (heavier, "heavier.toml"), (drifting, "drifting.toml")):
        save_vessel(vessel, tmp_path / name)
    assert plant_of_calibrator(small, str(tmp_path / "copy.toml")) == small.plant
    for name in ("heavier.toml", "drifting.toml"):
        with pytest.raises(ConfigurationError, match=name):
            plant_of_calibrator(small, str(tmp_path / name))


def test_a_vessel_file_that_is_gone_is_not_missed(
    tiny: Callable[..., TrainedCalibrator], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The artefact has the whole model: it works in another folder, and when the file is changed or deleted; but
    the changed file is another vessel."""
    ship, mine = load_vessel("gunnerus_short"), tmp_path / "mine.toml"
    save_vessel(ship, mine)
    monkeypatch.chdir(tmp_path)
    folder = save(replace(tiny(), vessel=locate_vessel("mine.toml")), tmp_path / "calibrator").parent
    save_vessel(replace(ship, water_density_kgpm3=1000.0), mine)
    loaded = load(copytree(folder, tmp_path / "elsewhere" / "calibrator"))
    assert loaded.vessel == str(mine)
    assert plant_of_calibrator(loaded, None) == bare_plant(ship)
    with pytest.raises(ConfigurationError, match=r"mine\.toml"):
        plant_of_calibrator(loaded, loaded.vessel)
    mine.unlink()
    assert plant_of_calibrator(load(folder), None) == bare_plant(ship)


NUMBERS = [name for name in bare_plant(load_vessel()).numbers() if name not in ("CX", "CY", "CN")]


def with_number(plant: Plant, name: str, value: float) -> Plant:
    return plant.replaced(**{name: value})


@given(name=st.sampled_from(NUMBERS),
       value=st.floats(allow_nan=False, allow_infinity=False))  # fmt: skip
def test_numbers_are_the_whole_plant(plant: Plant, name: str, value: float) -> None:
    """Through JSON and back it is the same plant with the same hash; any other number is another hash."""
    changed = with_number(plant, name, value)
    read = {
        key: tuple(each) if isinstance(each, list) else each
        for key, each in json.loads(json.dumps(plant_numbers(changed))).items()
    }
    assert plant_from_numbers(read, plant.layout) == changed
    assert plant_hash(plant_from_numbers(read, plant.layout)) == plant_hash(changed)
    assert (plant_hash(changed) == plant_hash(plant)) == (repr(plant.number(name)) == repr(value))
    assert plant_hash(with_number(plant, name, np.float64(value))) == plant_hash(changed)


def test_forces_that_are_code_cannot_be_stored(
    tiny: Callable[..., TrainedCalibrator], plant: Plant, tmp_path: Path
) -> None:
    trained = replace(tiny(), plant=plant.with_force(lambda *_: (0.0, 0.0, 0.0), 1.0))
    with pytest.raises(ConfigurationError, match="are code, not numbers"):
        save(trained, tmp_path)


def test_a_twin_without_a_model_is_a_calibrator_like_any(
    tiny: Callable[..., TrainedCalibrator], tmp_path: Path
) -> None:
    """The method of either is that of the sidecar, not of its place."""
    trained = replace(tiny(), calibrator=tiny("data_driven").calibrator)
    assert isinstance(load(save(trained, tmp_path).parent).calibrator, DataDrivenCalibrator)
