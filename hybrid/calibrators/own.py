"""User-defined calibrators: a class with ``fit`` and ``predict``, behind the interface of all calibrators.

The class gets :class:`KnownWindows`, what is known of windows at their start, and never later data. Its regions
are made by split conformal prediction on held-out legs, like those of all calibrators.
"""

from __future__ import annotations

import inspect
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
import pandas as pd

from seatrial.acquisition.core.errors import ConfigurationError, Progress
from seatrial.acquisition.core.files import parse_json
from seatrial.acquisition.core.named_code import OwnCodeError, file_of, own_code, require_call
from seatrial.acquisition.core.quantities import Floats
from seatrial.acquisition.core.ship import Actuators
from seatrial.hybrid.calibrators import Calibrator, DomainOfApplicability, Examples
from seatrial.hybrid.calibrators.adaptive import start_domain, start_names, start_range
from seatrial.hybrid.calibrators.networks import DOMAIN_MARGIN
from seatrial.hybrid.prediction.windows import PredictionWindows
from seatrial.hybrid.vessel.actuators import angle_columns, control_labels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from seatrial.hybrid.vessel.plant import Plant

STATE = ("north_m", "east_m", "heading_rad", "surge_mps", "sway_mps", "yaw_rate_radps")
WIND = ("wind_direction_rad", "wind_speed_mps")


@dataclass(frozen=True, slots=True)
class KnownWindows:
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

    def fit(self, windows: KnownWindows, track: Floats) -> object:
        """Learn from windows and the tracks that were measured in them [N, H+1, 3], as ``reference`` is."""

    def predict(self, windows: KnownWindows) -> Floats:
        """The tracks [N, H+1, 3], or north and east alone [N, H+1, 2] with the reference's heading."""


def own_calibrator(factory: Any, name: str, seed: int, plant: Plant | None) -> Calibrator:
    """A user's class as a calibrator. Raises :class:`ConfigurationError` for one that cannot be one."""
    if not isinstance(factory, type):
        raise ConfigurationError("is not a class", where=name, fix="write a class with fit and predict")
    if issubclass(factory, Calibrator):
        calibrator: Calibrator = factory(seed, plant)
    else:
        calibrator = OwnCalibrator(factory, name, seed, plant)
    calibrator.method = name
    return calibrator


def known_windows(windows: PredictionWindows, reference: Floats) -> KnownWindows:
    """The windows in the form that a user's class gets; the arrays are copies."""
    labels, angles = control_labels(windows.actuators), angle_columns(windows.actuators)
    controls = [f"{name}_rad" if column in angles else name for column, name in enumerate(labels)]
    start = np.column_stack([windows.start, windows.wind, windows.control])
    return KnownWindows(
        pd.DataFrame(start, columns=[*STATE, *WIND, *controls]),
        reference.copy(), windows.past.copy(), windows.acting.copy(), windows.leg.copy(),
    )  # fmt: skip


class OwnCalibrator(Calibrator):
    """Wraps a user's class: its output is checked, and its errors name its own line."""

    method = "own"

    def __init__(self, factory: type, name: str, seed: int = 0, plant: Plant | None = None) -> None:
        super().__init__(seed, plant)
        require_call(factory, name, "windows", "track", method="fit")
        require_call(factory, name, "windows", method="predict")
        self._name, self._file = name, file_of(factory)
        takes_seed = "seed" in inspect.signature(factory).parameters
        with own_code(name, self._file):
            self.own: OwnMethod = factory(seed=seed) if takes_seed else factory()

    def labels(self, actuators: Actuators) -> tuple[str, ...]:
        return start_names(actuators)

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        windows, reference = training
        self.actuators, self.any_commands = windows.actuators, windows.commands is not None
        self.range_ = start_range(windows)
        complete = windows.whole
        complete_windows = known_windows(windows.subset(complete), reference[complete])
        with own_code(f"{self._name}.fit", self._file):
            self.own.fit(complete_windows, windows.track[complete].copy())
        progress(1.0)
        return self

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        with own_code(f"{self._name}.predict", self._file):
            tracks = np.asarray(self.own.predict(known_windows(windows, reference)), dtype=np.float64)
        count, seconds, _ = reference.shape
        if tracks.shape not in ((count, seconds, 2), (count, seconds, 3)):
            raise OwnCodeError(
                f"predict returned an array of {tracks.shape}", where=self._name,
                fix=f"return {(count, seconds, 3)}: windows, seconds 0 to {seconds - 1}, north, east, heading",
            )  # fmt: skip
        return np.concatenate([tracks, reference[..., tracks.shape[2] :]], axis=2)

    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        return start_domain(windows, self.range_, DOMAIN_MARGIN)

    def state_dict(self) -> dict[str, Floats]:
        user_method = self.own
        with own_code(f"{self._name}.__getstate__", self._file):
            state: Any = user_method.__getstate__() if hasattr(user_method, "__setstate__") else vars(user_method)
        arrays = {name: value for name, value in state.items() if _is_numeric(value)}
        plain = {name: value for name, value in state.items() if name not in arrays}
        for name, value in plain.items():
            self._refuse_unsaved(name, value)
        text = np.frombuffer(json.dumps(plain).encode(), np.uint8)
        tensors = {"range": self.range_, "others": text} | {f"own.{name}": array for name, array in arrays.items()}
        return {name: np.array(value) for name, value in tensors.items()}

    def _refuse_unsaved(self, name: str, value: Any) -> None:
        try:
            json.dumps(value)
        except (TypeError, ValueError) as error:
            raise ConfigurationError(
                f"keeps a {type(value).__name__} in {name}, which is not saved", where=self._name,
                why="arrays, numbers, texts and lists of them are",
                fix="keep those, or write __getstate__ that returns a dict of them, and __setstate__ that takes it",
            ) from error  # fmt: skip

    def load_state_dict(self, tensors: dict[str, Floats]) -> Self:
        arrays = dict(tensors)
        self.range_, plain = arrays.pop("range"), parse_json(arrays.pop("others").tobytes())
        state = {name.removeprefix("own."): value for name, value in arrays.items()} | plain
        with own_code(f"{self._name}.__setstate__", self._file):
            if hasattr(self.own, "__setstate__"):
                self.own.__setstate__(state)
            else:
                vars(self.own).update(state)
        return self


def _is_numeric(value: Any) -> bool:
    return isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "fiub"
