"""Calibrators of users, and trained calibrators on disk.

A user's class with ``fit`` and ``predict`` is wrapped in the interface of all calibrators. It gets
:class:`WindowInputs`, what is known of windows at their start, and never later data. Its regions are made by split
conformal prediction on held-out legs, like those of all calibrators. On disk a calibrator is weights as safetensors
and everything else in a readable JSON file, the sidecar: inputs, scaling, reference model, regions, data and
metrics. Pydantic checks types in strict mode; further conditions on values, and their agreement with the weights,
are checked here.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, Self

import numpy as np
import pandas as pd
import safetensors.numpy
from pydantic import Field, FiniteFloat, JsonValue, NonNegativeInt, PositiveInt, TypeAdapter, ValidationError

from seatrial.acquisition.core import files, named_code, process, ship
from seatrial.acquisition.core.errors import ConfigurationError, InputError, Progress, SeatrialError, printable_path
from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.tables.table import LARGEST_VALUE
from seatrial.hybrid import calibrators
from seatrial.hybrid.calibrators import adaptive, networks
from seatrial.hybrid.effects.simulators import simulator_of
from seatrial.hybrid.prediction import baselines, dataset
from seatrial.hybrid.prediction.window_sets import PAST_S, PredictionWindows
from seatrial.hybrid.vessel.actuators import angle_columns, control_labels
from seatrial.hybrid.vessel.black_box import BlackBox, MotionModel, model_digest
from seatrial.hybrid.vessel.plant import plant_from_numbers, plant_hash, plant_numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray


STATE = ("north_m", "east_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps")
WIND = ("wind_direction_rad", "wind_speed_mps")
SIDECAR = "calibrator.json"
FORMAT = 8
PARTS = ("calibrator", "data_driven")
"""The tensor files of an artefact; the second only if there is such a network."""
UNITS = {
    "m": "m", "mps": "m/s", "mps2": "m/s2", "rad": "rad", "radps": "rad/s", "radps2": "rad/s2",
    "rps": "rev/s", "rpm": "rev/min", "n": "N", "nm": "N m", "s": "s", "second": "s",
}  # fmt: skip
"""Units by the last word of a name; others are dimensionless."""
Tensors = dict[str, Floats]


@dataclass(frozen=True, slots=True)
class WindowInputs:
    """What is known of N windows of H seconds at their start, in SI units and radians.

    ``start`` [N, C]: one row a window, columns by name: ``north_m``, ``east_m``, ``heading_rad``, ``surge_mps``,
    ``sway_mps``, ``yaw_rate_radps``, ``wind_direction_rad`` (it comes from), ``wind_speed_mps``, then the controls,
    such as ``propeller_rps`` and ``rudder_angle_rad``. ``reference`` [N, H+1, 3]: the reference model's track,
    north, east [m] and heading [rad] at seconds 0 to H. ``past`` [N, P+1, C]: the columns of ``start`` at second 0
    and at each of the P seconds before, newest first; NaN where nothing was measured. ``commands``
    [N, H, controls]: the controls over each second of the horizon; those of ``start`` where they are held.
    ``leg`` [N]: which windows belong together, for a validation of one's own: they overlap.
    """

    start: pd.DataFrame
    reference: Floats
    past: Floats
    commands: Floats
    leg: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.start)


class OwnMethod(Protocol):
    """The interface of a user's class, which is made without arguments or with a ``seed``.

    Attributes that are arrays, numbers, texts or lists of them are saved with it. For others it needs
    ``__getstate__``, which returns a dict of such, and ``__setstate__``, which restores it.
    """

    def fit(self, windows: WindowInputs, track: Floats) -> object:
        """Learn from windows and the tracks that were measured in them [N, H+1, 3], as ``reference`` is."""

    def predict(self, windows: WindowInputs) -> Floats:
        """The tracks [N, H+1, 3], or north and east alone [N, H+1, 2] with the reference's heading."""


def user_calibrator(factory: Any, name: str, seed: int, plant: MotionModel | None) -> calibrators.Calibrator:
    """A user's class as a calibrator. Raises :class:`ConfigurationError` for one that cannot be one."""
    if not isinstance(factory, type):
        raise ConfigurationError("is not a class", where=name, fix="write a class with fit and predict")
    if issubclass(factory, calibrators.Calibrator):
        calibrator: calibrators.Calibrator = factory(seed, plant)
    else:
        calibrator = OwnCalibrator(factory, name, seed, plant)
    calibrator.method = name
    return calibrator


def window_inputs(windows: PredictionWindows, reference: Floats) -> WindowInputs:
    """The windows in the form that a user's class gets; the arrays are copies."""
    labels, angles = control_labels(windows.actuators), angle_columns(windows.actuators)
    controls = [f"{name}_rad" if column in angles else name for column, name in enumerate(labels)]
    start = np.column_stack([windows.start, windows.wind, windows.control])
    return WindowInputs(
        pd.DataFrame(start, columns=[*STATE, *WIND, *controls]),
        reference.copy(), windows.past.copy(), windows.acting_controls.copy(), windows.leg.copy(),
    )  # fmt: skip


class OwnCalibrator(calibrators.Calibrator):
    """Wraps a user's class: its output is checked, and its errors name its own line."""

    method = "own"

    def __init__(self, factory: type, name: str, seed: int = 0, plant: MotionModel | None = None) -> None:
        super().__init__(seed, plant)
        named_code.require_signature(factory, name, "windows", "track", method="fit")
        named_code.require_signature(factory, name, "windows", method="predict")
        self._name, self._file = name, named_code.defining_file(factory)
        takes_seed = "seed" in inspect.signature(factory).parameters
        with named_code.report_user_code_errors(name, self._file):
            self.own: OwnMethod = factory(seed=seed) if takes_seed else factory()

    def input_names_for(self, actuators: ship.Actuators) -> tuple[str, ...]:
        return adaptive.start_quantity_names(actuators)

    def fit(
        self,
        training: calibrators.Examples,
        stopping: calibrators.Examples,
        progress: Progress = lambda share: None,
    ) -> Self:
        windows, reference = training
        self.actuators, self.any_commands = windows.actuators, windows.commands is not None
        self.range_ = adaptive.start_range(windows)
        complete = windows.is_complete
        complete_windows = window_inputs(windows.subset(complete), reference[complete])
        with named_code.report_user_code_errors(f"{self._name}.fit", self._file):
            self.own.fit(complete_windows, windows.track[complete].copy())
        progress(1.0)
        return self

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        with named_code.report_user_code_errors(f"{self._name}.predict", self._file):
            tracks = np.asarray(self.own.predict(window_inputs(windows, reference)), dtype=np.float64)
        count, seconds, _ = reference.shape
        if tracks.shape not in ((count, seconds, 2), (count, seconds, 3)):
            raise named_code.UserCodeError(
                f"predict returned an array of {tracks.shape}", where=self._name,
                fix=f"return {(count, seconds, 3)}: windows, seconds 0 to {seconds - 1}, north, east, heading",
            )  # fmt: skip
        return np.concatenate([tracks, reference[..., tracks.shape[2] :]], axis=2)

    def domain(self, windows: PredictionWindows, reference: Floats) -> calibrators.DomainOfApplicability:
        return adaptive.domain_of_starts(windows, self.range_, networks.DOMAIN_MARGIN)

    def state_dict(self) -> dict[str, Floats]:
        user_method = self.own
        with named_code.report_user_code_errors(f"{self._name}.__getstate__", self._file):
            state: Any = user_method.__getstate__() if hasattr(user_method, "__setstate__") else vars(user_method)
        arrays = {
            name: value for name, value in state.items()
            if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "fiub"
        }  # fmt: skip
        plain = {name: value for name, value in state.items() if name not in arrays}
        for name, value in plain.items():
            try:
                json.dumps(value)
            except (TypeError, ValueError) as error:
                raise ConfigurationError(
                    f"keeps a {type(value).__name__} in {name}, which is not saved", where=self._name,
                    why="arrays, numbers, texts and lists of them are",
                    fix="keep those, or write __getstate__ that returns a dict of them, and __setstate__ that takes"
                    " it",
                ) from error  # fmt: skip
        text = np.frombuffer(json.dumps(plain).encode(), np.uint8)
        tensors = {"range": self.range_, "others": text} | {f"own.{name}": array for name, array in arrays.items()}
        return {name: np.array(value) for name, value in tensors.items()}

    def load_state_dict(self, tensors: dict[str, Floats]) -> Self:
        arrays = dict(tensors)
        self.range_, plain = arrays.pop("range"), files.parse_json(arrays.pop("others").tobytes())
        state = {name.removeprefix("own."): value for name, value in arrays.items()} | plain
        with named_code.report_user_code_errors(f"{self._name}.__setstate__", self._file):
            if hasattr(self.own, "__setstate__"):
                self.own.__setstate__(state)
            else:
                vars(self.own).update(state)
        return self


Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_FARTHEST_M = 4e7  # around the Earth
SemiAxis = Annotated[FiniteFloat, Field(ge=0.0, le=_FARTHEST_M)]
SemiAxes = tuple[SemiAxis, SemiAxis]
Error = Annotated[FiniteFloat, Field(gt=0.0, le=_FARTHEST_M)]


@dataclass(frozen=True, slots=True)
class ScaledQuantity:
    """An input or output: unit, scaling and range in training; no deviation if it was constant."""

    name: str
    unit: str
    mean: FiniteFloat | None = None
    deviation: FiniteFloat | None = None
    low: FiniteFloat | None = None
    high: FiniteFloat | None = None


@dataclass(frozen=True, slots=True)
class CalibratorDescription:
    """A calibrator: its method and seed, inputs and outputs; for a user-defined one the hash of its file."""

    method: str
    seed: NonNegativeInt
    inputs: tuple[ScaledQuantity, ...]
    outputs: tuple[ScaledQuantity, ...]
    code_sha256: Digest | Literal[""] = ""


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference model in full, so that the vessel file is not needed later; a simulator of another make is
    ``simulator``, its file, and has no numbers."""

    name: str
    sha256: Digest
    numbers: dict[str, FiniteFloat | tuple[FiniteFloat, ...]]
    simulator: str = ""

    @classmethod
    def to_model(cls, name: str, model: MotionModel) -> Reference:
        """The reference to a model whose vessel is of this name."""
        if isinstance(model, BlackBox):
            return cls(model.name, model_digest(model), {}, printable_path(model.file))
        return cls(printable_path(name), plant_hash(model), plant_numbers(model))


@dataclass(frozen=True, slots=True)
class StoredFallback:
    """The fallback: mean training errors of its baselines over the horizon and over the hindcast [m], and the
    semi-axes of its 95 % region by second, per metre of expected error."""

    reference_m: tuple[Error, Error]
    constant_velocity_m: tuple[Error, Error]
    region: tuple[SemiAxes, ...]


@dataclass(frozen=True, slots=True)
class Sidecar:
    """Everything about an artefact except the weights; ``files`` has their hashes.

    ``data_driven`` is left out if no network could be trained. ``any_commands`` is written only if true.
    ``actuators`` are the ship's as in recordings, empty for the default list.
    """

    format: int
    trained_at: datetime
    versions: dict[str, str]
    horizon_s: PositiveInt
    past_s: NonNegativeInt
    channels: tuple[str, ...]
    vessel: Reference
    calibrator: CalibratorDescription
    files: dict[str, Digest]
    region_m: tuple[SemiAxes, ...]
    reserve: StoredFallback
    data: tuple[dataset.WindowSource, ...]
    metrics: dict[str, JsonValue]
    data_driven: CalibratorDescription | None = None
    any_commands: bool = False
    actuators: str = ""


@dataclass(frozen=True, slots=True)
class _Head:
    format: JsonValue


_SIDECAR, _HEAD = TypeAdapter(Sidecar), TypeAdapter(_Head)


def describe_calibrator(calibrator: calibrators.Calibrator, tensors: Mapping[str, Floats]) -> CalibratorDescription:
    """A calibrator's description; the scaling comes from its ``tensors`` if they contain one."""
    method = named_code.absolute_code_reference(calibrator.method)
    return CalibratorDescription(
        method,
        calibrator.seed,
        _scaled_quantities("input", calibrator.input_names, tensors),
        _scaled_quantities("output", calibrator.outputs, tensors),
        "" if method in calibrators.METHODS else named_code.sha256_of_code(method, "calibrators"),
    )


def _scaled_quantities(
    side: str, names: tuple[str, ...], tensors: Mapping[str, Floats]
) -> tuple[ScaledQuantity, ...]:
    rows = {key: tensors.get(f"{side}.{key}") for key in ("mean", "deviation")}
    low_high = tensors.get(f"{side}.range")
    rows |= dict(zip(("low", "high"), (None, None) if low_high is None else low_high, strict=True))
    columns = {  # None for an infinite deviation, by which a constant column is scaled to zero
        key: [None if abs(value) == inf else value for value in row.tolist()]
        for key, row in rows.items()
        if row is not None and row.shape == (len(names),)
    }
    return tuple(
        ScaledQuantity(name, unit_in_name(name), **{key: column[i] for key, column in columns.items()})
        for i, name in enumerate(names)
    )


def unit_in_name(name: str) -> str:
    """The unit at the end of a name.

    >>> unit_in_name("surge_mps"), unit_in_name("heading_sin")
    ('m/s', '1')
    """
    return UNITS.get(name.rsplit("_", 1)[-1], "1")


def read_sidecar(
    folder: Path, method: str | None = None, vessel: calibrators.VesselChoice | None = None
) -> tuple[Sidecar, MotionModel]:
    """Read the sidecar of an artefact and its reference model, checked as far as possible without the weights.

    ``method`` is the code that the user names for it, ``vessel`` the simulator that is its reference model: a file
    named in the sidecar alone is not executed, as a calibrator from elsewhere could otherwise run what it brings
    along. Raises :class:`InputError` naming the key that is missing or wrong, and for a file that no user named.
    """
    path = folder / SIDECAR
    raw = read_bytes_or_refuse(path)
    try:
        version = _HEAD.validate_json(raw).format
        if version != FORMAT:
            raise InputError(f"is of format {_shorten_text(version)}, and this version reads {FORMAT}",
                             where=str(path), fix="train again")  # fmt: skip
        sidecar = _SIDECAR.validate_json(raw, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        why = ": ".join(filter(None, (".".join(map(str, first["loc"])), first["msg"])))
        raise damage_error(path, _shorten_text(why)) from error
    model, stored = sidecar.calibrator, sidecar.vessel
    if method is None and named_code.split_code_reference(model.method) is not None:
        raise InputError(
            "needs code of your own, which runs only if you name it", where=str(path),
            why=f"it was trained with {_shorten_text(model.method)}",
            fix="if you trust that file, give it with --method FILE.py:CLASS, in Python with"
            " load_calibrator(FOLDER, method=...)",
        )  # fmt: skip
    if method is not None:
        if not model.code_sha256 and method != model.method:
            raise InputError(f"is of the method {_shorten_text(model.method)}, not {method}", where=str(path),
                             fix="leave --method out, or give the folder of that calibrator")  # fmt: skip
        sidecar = replace(sidecar, calibrator=replace(model, method=named_code.absolute_code_reference(method)))
    _check_sidecar(sidecar, path)
    if stored.simulator:
        return sidecar, _simulator_of_sidecar(sidecar, path, vessel)
    try:
        plant = plant_from_numbers(stored.numbers, ship.parse_actuators(sidecar.actuators))
    except ValueError as error:
        raise damage_error(path, f"vessel.numbers: {error}"[:160]) from error
    if plant_hash(plant) != stored.sha256:
        raise damage_error(path, "the vessel's numbers are not those of its hash")
    return sidecar, plant


def _simulator_of_sidecar(sidecar: Sidecar, path: Path, vessel: calibrators.VesselChoice | None) -> BlackBox:
    """The simulator that a calibrator was trained on, as the user names it. Raises :class:`InputError` for none and
    for another."""
    simulator, name = simulator_of(vessel), _shorten_text(sidecar.vessel.simulator)
    if simulator is None:
        raise InputError(
            "needs the simulator that it was trained on, which runs only if you name it", where=str(path),
            why=f"that was {name}", fix="if you trust that file, give it with --vessel, in Python with vessel=",
        )  # fmt: skip
    if model_digest(simulator) != sidecar.vessel.sha256:
        raise InputError(
            "was trained on another simulator", where=str(path),
            why=f"it was {name}, and {simulator.file} or its map differs from that",
            fix="restore that version, or train again",
        )  # fmt: skip
    return simulator


def read_bytes_or_refuse(path: Path) -> bytes:
    """Read a file of an artefact. Raises :class:`InputError`."""
    try:
        return files.read_regular_file(path, process.CALIBRATOR_BYTES)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError("is not a trained calibrator", where=str(path.parent), why=f"{path.name} is missing",
                         fix="make one with `seatrial train`") from error  # fmt: skip
    except OSError as error:
        raise InputError("cannot be read", where=str(path), why=error.strerror or str(error),
                         fix="make it readable, or train again") from error  # fmt: skip


def damage_error(path: Path, why: str) -> InputError:
    """The error for content that no version of Seatrial writes."""
    return InputError(
        "is damaged or was edited", where=str(path), why=why, fix="use an intact copy, or train again"
    )


def _check_sidecar(sidecar: Sidecar, path: Path) -> None:
    """Check what types cannot express. Raises :class:`InputError`."""
    names = ship.trial_channel_names(ship.parse_actuators(sidecar.actuators))
    if sidecar.channels != names:
        differing = ", ".join(sorted(set(sidecar.channels) ^ set(names))) or "their order differs"
        raise InputError("was trained on other channels than those of this version",
                         where=str(path), why=_shorten_text(differing), fix="train again")  # fmt: skip
    if sidecar.past_s != PAST_S:
        raise InputError(f"was trained on windows with {sidecar.past_s} s before their start, not {PAST_S} s",
                         where=str(path), fix="train again")  # fmt: skip
    for name, region in (("region_m", sidecar.region_m), ("reserve.region", sidecar.reserve.region)):
        if len(region) != sidecar.horizon_s:
            raise damage_error(path, f"{name} has {len(region)} values for {sidecar.horizon_s} s")
    if not all(0.0 <= source.part[0] < source.part[1] <= 100.0 for source in sidecar.data):
        raise damage_error(path, "a part of a recording's time is not within 0..100 percent")
    model = sidecar.calibrator
    if not model.code_sha256 and model.method not in calibrators.METHODS:
        raise InputError(
            f"is of the method {_shorten_text(model.method)}, which this version does not have",
            where=str(path),
            fix=f"train again with one of {', '.join(calibrators.METHODS)}",
        )
    digest = named_code.sha256_of_code(model.method, "calibrators") if model.code_sha256 else ""
    if model.code_sha256 and not digest:
        raise InputError("was made by code that no longer exists", where=str(path),
                         why=f"there is no {model.method}",
                         fix="restore it, or give its new path with --method FILE.py:CLASS")  # fmt: skip
    if digest != model.code_sha256:
        raise InputError("was made by another version of its code", where=str(path),
                         why=f"{model.method} has changed: it was the file of SHA-256 {model.code_sha256}",
                         fix="restore that version, or train again")  # fmt: skip
    if sidecar.data_driven is not None and sidecar.data_driven.method != PARTS[1]:
        raise damage_error(
            path, f"data_driven.method is {_shorten_text(sidecar.data_driven.method)}, not {PARTS[1]}"
        )


def _shorten_text(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 120 else f"{text[:120]}..."


def save(trained: calibrators.TrainedCalibrator, folder: str | Path) -> Path:
    """Write the artefact into ``folder`` and return the sidecar's path.

    All files are complete before the first is moved into place, the sidecar last and the old one out of the
    way: at any time the folder holds the old artefact, the new one or none.

    Parameters
    ----------
    trained
        The calibrator that :func:`seatrial.train` returned.
    folder
        The folder to write; it is made if it is missing.

    Returns
    -------
    pathlib.Path
        The JSON file in it that describes the calibrator.

    Raises
    ------
    StorageError
        Where it cannot be written.
    InputError
        For weights that are not finite.

    Examples
    --------
    >>> import seatrial as st
    >>> calibrator = st.load_calibrator("calibrator")
    >>> path = st.save_calibrator(calibrator, "copy")
    >>> st.load_calibrator("copy").trained_at == calibrator.trained_at
    True
    """
    folder = Path(folder)
    parts: dict[str, calibrators.Calibrator | None] = {name: getattr(trained, name) for name in PARTS}
    tensors = {name: part.state_dict() for name, part in parts.items() if part is not None}
    for name, arrays in tensors.items():
        _refuse_not_numbers(arrays, folder / _weights_file_name(name))
    contents = {_weights_file_name(name): safetensors.numpy.save(arrays) for name, arrays in tensors.items()}
    fallback = trained.fallback
    reference_m, constant_velocity_m = zip(
        fallback.training_error_m.tolist(), fallback.hindcast_error_m.tolist(), strict=True
    )
    sidecar = Sidecar(
        format=FORMAT,
        trained_at=trained.trained_at,
        versions=trained.versions,
        horizon_s=trained.horizon_s,
        past_s=PAST_S,
        channels=ship.trial_channel_names(trained.plant.layout),
        vessel=Reference.to_model(trained.vessel, trained.plant),
        calibrator=describe_calibrator(trained.calibrator, tensors["calibrator"]),
        data_driven=describe_calibrator(trained.data_driven, tensors["data_driven"])
        if trained.data_driven
        else None,
        files={name: hashlib.sha256(content).hexdigest() for name, content in contents.items()},
        region_m=_semi_axes(trained.region_m),
        reserve=StoredFallback(reference_m, constant_velocity_m, _semi_axes(fallback.region)),
        data=tuple(replace(source, path=Path(printable_path(source.path))) for source in trained.sources),
        metrics=trained.metrics,
        any_commands=trained.calibrator.any_commands,
        actuators=ship.actuators_as_text(trained.plant.layout),
    )
    omitted = {name for name in ("data_driven", "any_commands", "actuators") if not getattr(sidecar, name)}
    unneeded: dict[str, Any] = dict.fromkeys(omitted, True)
    if not sidecar.vessel.simulator:
        unneeded["vessel"] = {"simulator": True}
    text = _SIDECAR.dump_json(sidecar, indent=2, exclude=unneeded) + b"\n"
    files.make_folder(folder)
    with files.written_together(folder / SIDECAR):
        for name, content in (contents | {SIDECAR: text}).items():
            files.write_bytes(folder / name, content)
    return folder / SIDECAR


def load(
    folder: str | Path, method: str | None = None, vessel: calibrators.VesselChoice | None = None
) -> calibrators.TrainedCalibrator:
    """Read an artefact; ``method`` is a user's own code that made it, ``FILE.py:CLASS``, which is executed.

    Parameters
    ----------
    folder
        The folder that ``seatrial train`` or :func:`seatrial.save_calibrator` wrote.
    method
        ``FILE.py:CLASS``: the code of a calibrator of your own, which runs only if it is given here.
    vessel
        ``FILE.fmu`` or ``FILE.py:CLASS``: the simulator that it was trained on, if it was on one; it, too, runs
        only if it is given here.

    Returns
    -------
    TrainedCalibrator
        As :func:`seatrial.train` returned it.

    Raises
    ------
    InputError
        Naming what is missing or wrong, and for code of a user's own without ``method``.

    Examples
    --------
    >>> import seatrial as st
    >>> calibrator = st.load_calibrator("calibrator")
    >>> st.predict("trial.mcap", at="+60", calibrator=calibrator).track.shape
    (16, 3)
    """
    folder = Path(folder)
    sidecar, plant = read_sidecar(folder, method, vessel)
    data_driven, stored = sidecar.data_driven, sidecar.reserve
    training_m, hindcast_m = np.array([stored.reference_m, stored.constant_velocity_m]).T
    return calibrators.TrainedCalibrator(
        calibrator=_restore_calibrator(sidecar, sidecar.calibrator, "calibrator", plant, folder),
        data_driven=_restore_calibrator(sidecar, data_driven, "data_driven", plant, folder)
        if data_driven
        else None,
        horizon_s=sidecar.horizon_s,
        vessel=sidecar.vessel.name,
        plant=plant,
        region_m=np.array(sidecar.region_m),
        fallback=baselines.Fallback(training_m, hindcast_m, np.array(stored.region)),
        sources=sidecar.data,
        metrics=sidecar.metrics,
        trained_at=sidecar.trained_at,
        versions=sidecar.versions,
    )


def _semi_axes(region_m: Floats) -> tuple[SemiAxes, ...]:
    return tuple((float(along), float(across)) for along, across in region_m)


def _restore_calibrator(
    sidecar: Sidecar, model: CalibratorDescription, part: str, plant: MotionModel, folder: Path
) -> calibrators.Calibrator:
    """The calibrator described by a ``part`` of the sidecar, with its weights, if they match: their file is the one
    that the sidecar was written with."""
    path = folder / _weights_file_name(part)
    content = read_bytes_or_refuse(path)
    if sidecar.files.get(path.name) != hashlib.sha256(content).hexdigest():
        raise InputError(
            "does not belong to its JSON file",
            where=str(path),
            why="their hashes differ: it is truncated, damaged, or of another calibrator",
            fix="use an intact copy of the folder, or train again",
        )
    try:
        tensors: Tensors = safetensors.numpy.load(content)
    except Exception as error:  # the library fails in every possible way
        raise damage_error(path, _first_lines_of_error(error)) from error
    _refuse_not_numbers(tensors, path)
    calibrator = calibrators.make_calibrator(model.method, model.seed, plant)
    calibrator.any_commands = sidecar.any_commands
    names = tuple(feature.name for feature in model.inputs)
    if calibrator.input_names != names:
        differing = sorted(set(calibrator.input_names) ^ set(names))
        raise InputError(f"was trained on other inputs than this version has for {model.method}",
                         where=str(folder / SIDECAR),
                         why=", ".join(differing)[:120], fix="train again")  # fmt: skip
    try:
        if "region" in tensors:
            calibrators.require_tensor_shapes(tensors, {"region": (sidecar.horizon_s, 2)})
        calibrator.load_state_dict(tensors)
        described = describe_calibrator(calibrator, tensors)
    except Exception as error:  # foreign weights may fail in every possible way
        raise damage_error(
            folder, f"the weights are not those of {model.method}: {_first_lines_of_error(error)}"
        ) from error
    if described != model:
        raise damage_error(
            folder / SIDECAR, f"the inputs and outputs of {model.method} are not scaled as its weights are"
        )
    return calibrator


def _weights_file_name(name: str) -> str:
    return f"{name}.safetensors"


def _refuse_not_numbers(tensors: Tensors, path: Path) -> None:
    """Raise :class:`InputError` for weights that are not finite, or so large that products of them are not; the
    deviation of a constant may be infinite."""
    for name, value in tensors.items():
        is_small = np.abs(value.astype(float)) < LARGEST_VALUE
        if bool(np.isnan(value).any() if name.endswith("deviation") else not is_small.all()):
            raise InputError(f"has a {name} that is not a number", where=str(path),
                             why="the training failed or the file was changed", fix="train again")  # fmt: skip


def _first_lines_of_error(error: Exception) -> str:
    """The first lines of a library's error message."""
    if isinstance(error, SeatrialError):
        return error.what
    text = f"{error} is missing" if isinstance(error, KeyError) else str(error)
    return " ".join(text.splitlines()[:2])[:160]
