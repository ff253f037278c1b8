"""The JSON beside a calibrator's weights: inputs, scaling, reference model, regions, data and metrics.

Types are checked by pydantic, in strict mode; what types cannot say is checked here, value by value. What has
to agree with the weights is checked in ``artefact.py``, which has them.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, FiniteFloat, JsonValue, NonNegativeInt, PositiveInt, TypeAdapter, ValidationError

from acquisition.core.channels import actuators_of, trial_names
from acquisition.core.errors import InputError
from acquisition.core.trial import software_version
from hybrid.calibrators import METHODS
from hybrid.calibrators.calibrator import Calibrator
from hybrid.prediction.dataset import Source
from hybrid.prediction.prediction_windows import PAST_S
from hybrid.vessel.fingerprint import layout_of, plant_hash, plant_numbers, plant_of
from hybrid.vessel.plant import Plant

if TYPE_CHECKING:
    from torch import Tensor

SIDECAR = "calibrator.json"
FORMAT = 5
UNITS = {
    "m": "m", "mps": "m/s", "mps2": "m/s2", "rad": "rad", "radps": "rad/s", "radps2": "rad/s2",
    "rps": "rev/s", "rpm": "rev/min", "n": "N", "nm": "N m", "s": "s", "second": "s",
}  # fmt: skip
"""Units by the last word of a name; names without one are pure numbers."""

Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Radius = Annotated[FiniteFloat, Field(ge=0.0)]
Error = Annotated[FiniteFloat, Field(gt=0.0)]


@dataclass(frozen=True, slots=True)
class Quantity:
    """One input or output: unit, scaling and range of the training; no deviation where it was constant."""

    name: str
    unit: str
    mean: FiniteFloat | None = None
    deviation: FiniteFloat | None = None
    low: FiniteFloat | None = None
    high: FiniteFloat | None = None


@dataclass(frozen=True, slots=True)
class Model:
    """One calibrator: its method and seed, what goes in and what comes out."""

    method: str
    seed: NonNegativeInt
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference model in full, so that a vessel file which has changed or moved is not missed."""

    name: str
    sha256: Digest
    numbers: dict[str, FiniteFloat | tuple[FiniteFloat, ...]]


@dataclass(frozen=True, slots=True)
class StoredFallback:
    """The fallback: mean errors in the training of its baselines over the horizon and over the hindcast [m], and
    the radius of its 95 % region by second, per metre of expected error.
    """

    reference_m: tuple[Error, Error]
    constant_velocity_m: tuple[Error, Error]
    band: tuple[Radius, ...]


@dataclass(frozen=True, slots=True)
class Sidecar:
    """Everything about an artefact but the weights; ``files`` has their hashes."""

    format: int
    trained_at: datetime
    versions: dict[str, str]
    horizon_s: PositiveInt
    past_s: NonNegativeInt
    channels: tuple[str, ...]
    vessel: Reference
    calibrator: Model
    data_driven: Model
    files: dict[str, Digest]
    band_m: tuple[Radius, ...]
    reserve: StoredFallback
    data: tuple[Source, ...]
    metrics: dict[str, JsonValue]


@dataclass(frozen=True, slots=True)
class _Head:
    format: JsonValue


_SIDECAR, _HEAD = TypeAdapter(Sidecar), TypeAdapter(_Head)


def versions() -> dict[str, str]:
    """The software that a calibrator is made with."""
    libraries = {name: version(name) for name in ("torch", "numpy")}
    return {
        "seatrial": software_version().removeprefix("seatrial "),
        "python": platform.python_version(),
    } | libraries


def model_of(calibrator: Calibrator, tensors: Mapping[str, Tensor]) -> Model:
    """A calibrator in words and numbers; the scaling from its ``tensors``, where they hold one."""
    return Model(
        calibrator.method,
        calibrator.seed,
        _quantities("input", calibrator.inputs, tensors),
        _quantities("output", calibrator.outputs, tensors),
    )


def _quantities(side: str, names: tuple[str, ...], tensors: Mapping[str, Tensor]) -> tuple[Quantity, ...]:
    rows = {key: tensors.get(f"{side}.{key}") for key in ("mean", "deviation")}
    low_high = tensors.get(f"{side}.range")
    rows |= dict(zip(("low", "high"), (None, None) if low_high is None else low_high, strict=True))
    columns = {key: row.tolist() for key, row in rows.items() if row is not None and row.shape == (len(names),)}
    return tuple(
        Quantity(name, unit_of(name), **{key: _finite(column[i]) for key, column in columns.items()})
        for i, name in enumerate(names)
    )


def _finite(value: float) -> float | None:
    """The number, or nothing for the endless deviation by which a constant column is scaled to zero."""
    return None if abs(value) == float("inf") else value


def unit_of(name: str) -> str:
    """The unit that a name ends in.

    >>> unit_of("surge_mps"), unit_of("heading_sin")
    ('m/s', '1')
    """
    return UNITS.get(name.rsplit("_", 1)[-1], "1")


def reference_of(name: str, plant: Plant) -> Reference:
    """The reference model as it is stored. Raises :class:`ConfigurationError` where numbers do not say it all."""
    return Reference(name, plant_hash(plant), plant_numbers(plant))


def text_of(sidecar: Sidecar) -> str:
    """The file's text."""
    return _SIDECAR.dump_json(sidecar, indent=2).decode() + "\n"


def read_sidecar(folder: Path) -> tuple[Sidecar, Plant]:
    """The sidecar of an artefact and its reference model, checked as far as that goes without the weights.

    Raises :class:`InputError` naming the key that is missing or not what it should be.
    """
    path = folder / SIDECAR
    raw = read_bytes(path)
    try:
        found = _HEAD.validate_json(raw).format
        if found != FORMAT:
            raise InputError(f"is of format {_short(found)}, and this version reads {FORMAT}",
                             where=str(path), fix="train anew")  # fmt: skip
        sidecar = _SIDECAR.validate_json(raw, strict=True)
    except ValidationError as error:
        raise damaged(path, _explain(error)) from error
    _check(sidecar, path)
    return sidecar, _plant(sidecar, path)


def read_bytes(path: Path) -> bytes:
    """A file of an artefact. Raises :class:`InputError`."""
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError("is no trained calibrator", where=str(path.parent), why=f"{path.name} is missing",
                         fix="make one with `seatrial train`") from error  # fmt: skip
    except OSError as error:
        raise InputError("cannot be read", where=str(path), why=error.strerror or str(error),
                         fix="make it readable, or train anew") from error  # fmt: skip


def damaged(path: Path, why: str) -> InputError:
    """The error for what no version of Seatrial wrote like this."""
    return InputError("is damaged or was edited", where=str(path), why=why, fix="take a sound copy, or train anew")


def _check(sidecar: Sidecar, path: Path) -> None:
    """What the types cannot say. Raises :class:`InputError`."""
    names = trial_names(actuators_of(sidecar.channels))
    if sidecar.channels != names:
        differing = ", ".join(sorted(set(sidecar.channels) ^ set(names))) or "their order differs"
        raise InputError("was trained on other channels than this version gives",
                         where=str(path), why=_short(differing), fix="train anew")  # fmt: skip
    if sidecar.past_s != PAST_S:
        raise InputError(f"was trained on windows that know {sidecar.past_s} s before their start, not {PAST_S} s",
                         where=str(path), fix="train anew")  # fmt: skip
    for name, band in (("band_m", sidecar.band_m), ("reserve.band", sidecar.reserve.band)):
        if len(band) != sidecar.horizon_s:
            raise damaged(path, f"{name} has {len(band)} values for {sidecar.horizon_s} s")
    if not all(0.0 <= each.part[0] < each.part[1] <= 100.0 for each in sidecar.data):
        raise damaged(path, "a part of a recording's time is not within 0..100 percent")
    for model in (sidecar.calibrator, sidecar.data_driven):
        if model.method not in METHODS:
            raise InputError(f"is of the method {_short(model.method)}, which this version does not have",
                             where=str(path), fix=f"train anew with one of {', '.join(METHODS)}")  # fmt: skip


def _plant(sidecar: Sidecar, path: Path) -> Plant:
    stored = sidecar.vessel
    try:
        plant = plant_of(stored.numbers, layout_of(sidecar.channels, stored.numbers))
    except ValueError as error:
        raise damaged(path, f"vessel.numbers: {error}"[:160]) from error
    if plant_hash(plant) != stored.sha256:
        raise damaged(path, "the vessel's numbers are not those of its hash")
    return plant


def _explain(error: ValidationError) -> str:
    """The first complaint: the key and what is wrong with it."""
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    return _short(": ".join(filter(None, (".".join(map(str, first["loc"])), first["msg"]))))


def _short(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 120 else f"{text[:120]}..."
