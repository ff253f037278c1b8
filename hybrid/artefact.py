"""A trained calibrator on disk: weights as safetensors, all else in a JSON file that people can read."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from acquisition.errors import ConfigurationError, InputError, SeatrialError, storage_error
from acquisition.trial import software_version
from hybrid.calibrators import make_calibrator
from hybrid.calibrators.calibrator import Calibrator
from hybrid.effects.catalogue import vessel_plant
from hybrid.gather import Source
from hybrid.vessel.files import load_vessel
from hybrid.vessel.plant import Plant

SIDECAR = "calibrator.json"
FORMAT = 1
_WEIGHTS = {name: f"{name}.safetensors" for name in ("calibrator", "data_driven")}


@dataclass(frozen=True, slots=True)
class Trained:
    """What ``train`` makes and ``validate`` and ``predict`` use.

    ``calibrator`` corrects the reference; ``data_driven`` is its twin without a model; ``band_m`` [H] is the
    radius that held 95 % of the positions on legs kept out of the training, second by second.
    """

    calibrator: Calibrator
    data_driven: Calibrator
    horizon_s: int
    vessel: str
    vessel_sha256: str
    band_m: NDArray[np.float64]
    sources: tuple[Source, ...]
    metrics: dict[str, Any]


def plant_hash(plant: Plant) -> str:
    """A fingerprint of every number of a vessel model."""
    return hashlib.sha256(repr(plant).encode()).hexdigest()


def save(trained: Trained, folder: Path) -> Path:
    """Write the artefact into ``folder`` and return the sidecar's path. Raises :class:`StorageError`."""
    sidecar = {
        "format": FORMAT,
        "method": trained.calibrator.method,
        "inputs": list(trained.calibrator.inputs),
        "horizon_s": trained.horizon_s,
        "seed": trained.calibrator.seed,
        "vessel": trained.vessel,
        "vessel_sha256": trained.vessel_sha256,
        "band_m": [float(each) for each in trained.band_m],
        "trained_on": [{**asdict(each), "path": str(each.path)} for each in trained.sources],
        "metrics": trained.metrics,
        "software": software_version(),
    }
    make_folder(folder)
    try:
        for name, model in (("calibrator", trained.calibrator), ("data_driven", trained.data_driven)):
            save_file(model.state(), folder / _WEIGHTS[name])
        path = folder / SIDECAR
        path.write_text(json.dumps(sidecar, indent=2) + "\n")
    except OSError as error:
        raise storage_error(folder / SIDECAR, error) from error
    return path


def make_folder(folder: Path) -> None:
    """Make the folder of an artefact, before the long work rather than after. Raises :class:`StorageError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(folder / SIDECAR, error) from error


def load(folder: Path) -> Trained:
    """Read an artefact. Raises :class:`InputError` naming what is missing or not what it should be."""
    path = folder / SIDECAR
    gone = [name for name in (SIDECAR, *_WEIGHTS.values()) if not (folder / name).is_file()]
    if gone:
        raise InputError("is no trained calibrator", where=str(folder), why=f"{gone[0]} is missing",
                         fix="make one with `seatrial train`")  # fmt: skip
    try:
        sidecar = json.loads(path.read_text(encoding="utf-8"))
        if sidecar["format"] != FORMAT:
            raise InputError(f"is of format {sidecar['format']}, and this version reads {FORMAT}",
                             where=str(path), fix="train anew")  # fmt: skip
        tensors = {name: load_file(folder / file) for name, file in _WEIGHTS.items()}
        calibrator = make_calibrator(sidecar["method"], sidecar["seed"]).restore(tensors["calibrator"])
        data_driven = make_calibrator("data_driven", sidecar["seed"]).restore(tensors["data_driven"])
        if list(calibrator.inputs) != sidecar["inputs"]:
            raise InputError(
                "was trained on other inputs than this version gives", where=str(path), fix="train anew"
            )
        sources = tuple(
            Source(Path(each["path"]), each["sha256"], (each["part"][0], each["part"][1]))
            for each in sidecar["trained_on"]
        )
        return Trained(
            calibrator, data_driven, sidecar["horizon_s"], sidecar["vessel"], sidecar["vessel_sha256"],
            _band(sidecar), sources, sidecar["metrics"],
        )  # fmt: skip
    except SeatrialError:
        raise
    except (OSError, ValueError, KeyError, IndexError, TypeError, SafetensorError, RuntimeError) as error:
        raise InputError("is damaged or of another version", where=str(folder), why=_reason(error),
                         fix="train anew") from error  # fmt: skip


def _band(sidecar: dict[str, Any]) -> NDArray[np.float64]:
    band = np.array(sidecar["band_m"], dtype=float)
    if band.shape != (sidecar["horizon_s"],):
        raise ValueError(f"band_m has {band.size} values for {sidecar['horizon_s']} s")
    return band


def _reason(error: Exception) -> str:
    """The first lines of what a library says; torch lists every tensor."""
    text = f"{error} is missing" if isinstance(error, KeyError) else str(error)
    return " ".join(text.splitlines()[:2])


def refuse_horizon(horizon_s: int, trained: Trained) -> None:
    """Raise :class:`InputError` when a calibrator was trained for another horizon."""
    if trained.horizon_s != horizon_s:
        raise InputError(
            f"the calibrator predicts {trained.horizon_s} s, not {horizon_s} s",
            fix=f"say --horizon {trained.horizon_s}, or train anew",
        )


def plant_for(trained: Trained, vessel: str | None) -> Plant:
    """The vessel model that a calibrator was trained on; ``vessel`` may name it but not another.

    Raises :class:`ConfigurationError` when the model differs in any number from that of the training.
    """
    name = vessel or trained.vessel
    plant = vessel_plant(load_vessel(name))
    if plant_hash(plant) != trained.vessel_sha256:
        raise ConfigurationError(
            f"vessel {name!r} is not the model that the calibrator was trained on",
            why=f"it was trained on {trained.vessel!r}, and the numbers differ",
            fix="give that vessel, or train anew",
        )
    return plant
