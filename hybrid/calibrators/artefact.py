"""A trained calibrator on disk: weights as safetensors, all else in a JSON file that people can read."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.torch
from safetensors import SafetensorError
from torch import Tensor, isfinite, isnan

from acquisition.core.arrays import Floats
from acquisition.core.channels import trial_names
from acquisition.core.errors import ConfigurationError, InputError, SeatrialError, storage_error
from analysis.tables.files import make_folder
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.calibrator import Calibrator, PredictedTracks, predict_with_fallback
from hybrid.calibrators.sidecar import (
    FORMAT,
    SIDECAR,
    Model,
    Sidecar,
    StoredFallback,
    damaged,
    model_of,
    read_bytes,
    read_sidecar,
    reference_of,
    text_of,
    versions,
)
from hybrid.effects.catalogue import vessel_plant
from hybrid.prediction.baselines import Fallback
from hybrid.prediction.dataset import Source
from hybrid.prediction.prediction_windows import PAST_S, PredictionWindows
from hybrid.vessel.files import load_vessel
from hybrid.vessel.fingerprint import plant_hash
from hybrid.vessel.plant import Plant

Tensors = dict[str, Tensor]
PARTS = ("calibrator", "data_driven")
"""The tensors of an artefact, one file each."""


@dataclass(frozen=True, slots=True)
class TrainedCalibrator:
    """A calibrator as it is trained, saved and used for predictions.

    ``calibrator`` corrects the reference model, which is called ``vessel`` and is ``plant``; ``data_driven`` was
    trained on the same windows without a model. ``band_m`` [H] is the radius of the 95 % region by second for a
    relative uncertainty of one, from legs kept out of the training; ``fallback`` predicts outside the domain of
    applicability.
    """

    calibrator: Calibrator
    data_driven: Calibrator
    horizon_s: int
    vessel: str
    plant: Plant
    band_m: Floats
    fallback: Fallback
    sources: tuple[Source, ...]
    metrics: dict[str, Any]
    trained_at: datetime = field(default_factory=lambda: datetime.now(UTC).replace(microsecond=0))
    versions: dict[str, str] = field(default_factory=versions)


def predict_tracks(trained: TrainedCalibrator, windows: PredictionWindows, reference: Floats) -> PredictedTracks:
    """Tracks and regions by a trained calibrator, by the fallback outside its domain of applicability.

    ``reference`` [N, H+1, 3] are the reference model's tracks on the windows.
    """
    return predict_with_fallback(
        trained.calibrator, trained.plant, trained.band_m, trained.fallback, windows, reference
    )


def save(trained: TrainedCalibrator, folder: Path) -> Path:
    """Write the artefact into ``folder`` and return the sidecar's path.

    All files are written in full before the first takes its place, the sidecar last and the old one out of
    the way: whatever happens, the folder holds the old artefact, the new one or none. Raises
    :class:`StorageError`, and :class:`InputError` for weights that are no numbers.
    """
    tensors = {name: _on_disk(getattr(trained, name).state_dict()) for name in PARTS}
    for name in PARTS:
        _refuse_not_numbers(tensors[name], folder / _file(name))
    contents = {_file(name): safetensors.torch.save(each) for name, each in tensors.items()}
    sidecar = _sidecar(trained, tensors, {name: _digest(each) for name, each in contents.items()})
    make_folder(folder)
    _write_together(folder, contents | {SIDECAR: text_of(sidecar).encode()})
    return folder / SIDECAR


def _write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files that go together, the sidecar the last of them. Raises :class:`StorageError`."""
    partial = {name: folder / f".{name}.part" for name in contents}
    try:
        for name, content in contents.items():
            partial[name].write_bytes(content)
        (folder / SIDECAR).unlink(missing_ok=True)
        for name, path in partial.items():
            path.replace(folder / name)
    except OSError as error:
        raise storage_error(folder / SIDECAR, error) from error
    finally:
        for path in partial.values():
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _sidecar(trained: TrainedCalibrator, tensors: dict[str, Tensors], digests: dict[str, str]) -> Sidecar:
    return Sidecar(
        format=FORMAT,
        trained_at=trained.trained_at,
        versions=trained.versions,
        horizon_s=trained.horizon_s,
        past_s=PAST_S,
        channels=trial_names(trained.plant.layout),
        vessel=reference_of(trained.vessel, trained.plant),
        calibrator=model_of(trained.calibrator, tensors["calibrator"]),
        data_driven=model_of(trained.data_driven, tensors["data_driven"]),
        files=digests,
        band_m=tuple(map(float, trained.band_m)),
        reserve=_stored_fallback(trained.fallback),
        data=trained.sources,
        metrics=trained.metrics,
    )


def load(folder: Path) -> TrainedCalibrator:
    """Read an artefact. Raises :class:`InputError` naming what is missing or not what it should be."""
    sidecar, plant = read_sidecar(folder)
    tensors = {name: _tensors(folder / _file(name), sidecar.files) for name in PARTS}
    return TrainedCalibrator(
        calibrator=_restored(sidecar.calibrator, plant, tensors["calibrator"], folder),
        data_driven=_restored(sidecar.data_driven, plant, tensors["data_driven"], folder),
        horizon_s=sidecar.horizon_s,
        vessel=sidecar.vessel.name,
        plant=plant,
        band_m=np.array(sidecar.band_m),
        fallback=_fallback_from(sidecar.reserve),
        sources=sidecar.data,
        metrics=sidecar.metrics,
        trained_at=sidecar.trained_at,
        versions=sidecar.versions,
    )


def _stored_fallback(fallback: Fallback) -> StoredFallback:
    (reference, constant_velocity) = zip(
        fallback.training_error_m.tolist(), fallback.hindcast_error_m.tolist(), strict=True
    )
    return StoredFallback(reference, constant_velocity, tuple(map(float, fallback.radius)))


def _fallback_from(stored: StoredFallback) -> Fallback:
    training_m, hindcast_m = np.array([stored.reference_m, stored.constant_velocity_m]).T
    return Fallback(training_m, hindcast_m, np.array(stored.band))


def _restored(model: Model, plant: Plant, tensors: Tensors, folder: Path) -> Calibrator:
    """The calibrator that ``model`` describes, with its weights, if one goes with the other."""
    calibrator = make_calibrator(model.method, model.seed, plant)
    names = tuple(each.name for each in model.inputs)
    if calibrator.inputs != names:
        differing = sorted(set(calibrator.inputs) ^ set(names))
        raise InputError(f"was trained on other inputs than this version gives to {model.method}",
                         where=str(folder / SIDECAR), why=", ".join(differing)[:120], fix="train anew")  # fmt: skip
    try:
        calibrator.load_state_dict(tensors)
        described = model_of(calibrator, tensors)
    except (SeatrialError, KeyError, ValueError, TypeError, IndexError, RuntimeError) as error:
        raise damaged(folder, f"the weights are not those of {model.method}: {_reason(error)}") from error
    if described != model:
        raise damaged(
            folder / SIDECAR, f"the inputs and outputs of {model.method} are not scaled as its weights are"
        )
    return calibrator


def _file(name: str) -> str:
    return f"{name}.safetensors"


def _on_disk(tensors: Tensors) -> Tensors:
    """Tensors in main memory, each with memory of its own, as the format wants them."""
    return {name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()}


def _tensors(path: Path, digests: dict[str, str]) -> Tensors:
    """The tensors of one file, if it is the one that the sidecar was written with."""
    content = read_bytes(path)
    if digests.get(path.name) != _digest(content):
        raise InputError(
            "is not the file that its sidecar was written with",
            where=str(path),
            why="their hashes differ: it is cut short, damaged, or of another calibrator",
            fix="take a sound copy of the folder, or train anew",
        )
    try:
        tensors = safetensors.torch.load(content)
    except (SafetensorError, ValueError, KeyError, RuntimeError) as error:
        raise damaged(path, _reason(error)) from error
    _refuse_not_numbers(tensors, path)
    return tensors


def _refuse_not_numbers(tensors: Tensors, path: Path) -> None:
    """Raise :class:`InputError` for weights that predict nothing; a deviation may be endless, for a constant."""
    for name, value in tensors.items():
        if bool(isnan(value).any() if name.endswith("deviation") else not isfinite(value).all()):
            raise InputError(f"has a {name} that is no number", where=str(path),
                             why="the training failed or the file was changed", fix="train anew")  # fmt: skip


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _reason(error: Exception) -> str:
    """The first lines of what a library says; torch lists every tensor."""
    if isinstance(error, SeatrialError):
        return error.what
    text = f"{error} is missing" if isinstance(error, KeyError) else str(error)
    return " ".join(text.splitlines()[:2])[:160]


def refuse_horizon(horizon_s: int, trained: TrainedCalibrator) -> None:
    """Raise :class:`InputError` when a calibrator was trained for another horizon."""
    if trained.horizon_s != horizon_s:
        raise InputError(
            f"the calibrator predicts {trained.horizon_s} s, not {horizon_s} s",
            fix=f"say --horizon {trained.horizon_s}, or train anew",
        )


def plant_for(trained: TrainedCalibrator, vessel: str | None) -> Plant:
    """The reference model that a calibrator was trained on; ``vessel`` may name it but not another.

    Raises :class:`ConfigurationError` when the named model differs in any number from that of the training.
    """
    if vessel is not None and plant_hash(vessel_plant(load_vessel(vessel))) != plant_hash(trained.plant):
        raise ConfigurationError(
            f"vessel {vessel!r} is not the model that the calibrator was trained on",
            why=f"it was trained on {trained.vessel!r}, and the numbers differ",
            fix="leave --vessel out, give that vessel, or train anew",
        )
    return trained.plant
