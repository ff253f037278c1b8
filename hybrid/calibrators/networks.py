"""Small neural networks as calibrators: the paper's, one without a model, one for the reference's error.

All are perceptrons with three hidden layers of ten in double precision, on standardised inputs: one row for
each window and second, angles as points on the unit circle; the output is the displacement from the start. The
paper's (Wang, Li et al. 2021) has the reference's displacement among its inputs and learns the ship's;
``data_driven`` has no model; ``additive``, which the paper argues against, learns the difference between the
two.

With any commands each second's row has two means of every control up to then: the plain mean, like the speed
gained from a proportional force, and one weighted by the remaining time, like the distance gained from that
speed. For held controls both equal the control.

Training is by least squares (``network_training.py``, the only part that needs PyTorch) with early stopping;
``paper_adam`` is the paper's network trained as published, by Adam (Kingma and Ba 2015).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from seatrial.acquisition.core import errors, ship
from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid import calibrators
from seatrial.hybrid.prediction import baselines, kalman_filter
from seatrial.hybrid.prediction.window_sets import PredictionWindows, hindcast_windows
from seatrial.hybrid.vessel.actuators import angle_columns, control_labels
from seatrial.hybrid.vessel.sensors import HEADING, SURGE

if TYPE_CHECKING:
    from seatrial.hybrid.vessel.black_box import MotionModel


Rows = tuple[Floats, Floats]
"""Inputs [rows, C] and target outputs [rows, K], both scaled."""
Layers = tuple[tuple[Floats, Floats], ...]
"""The matrix [above, below] and the offset [above] of each layer."""

HIDDEN = (10, 10, 10)
DOMAIN_MARGIN = 0.1
"""The margin by which an input inside the domain may exceed the training range, as a share of it."""
_PLACE = 2
"""The step between layer numbers on disk: a ReLU lies between two layers, as in PyTorch's sequences."""
REFERENCE_INPUTS = ("reference_north_m", "reference_east_m")


def start_labels(actuators: ship.Actuators) -> tuple[str, ...]:
    """The names of the columns of :func:`start_inputs`, for a ship with these actuators."""
    return (
        "heading_sin", "heading_cos", "surge_mps", "sway_mps", "yaw_rate_radps",
        "wind_direction_sin", "wind_direction_cos", "wind_speed_mps", *_control_names(actuators), "second",
    )  # fmt: skip


def command_inputs(windows: PredictionWindows) -> Floats:
    """The means of the commands until each second [N, H, columns], plain and weighted by the remaining time; a
    column for each of :func:`_control_names`, plain means first."""
    columns = _control_columns(windows.acting_controls, angle_columns(windows.actuators))
    total = np.cumsum(np.stack(columns, axis=-1), axis=1)
    second = np.arange(1.0, windows.horizon_s + 1)[:, None]
    return np.concatenate([total / second, np.cumsum(total, axis=1) / (0.5 * second * (second + 1.0))], axis=-1)


def _control_columns(values: Floats, angles: list[int]) -> list[Floats]:
    """Controls [..., controls] one by one, an angle as its sine and cosine."""
    return [
        part
        for column, control in enumerate(np.moveaxis(values, -1, 0))
        for part in ((np.sin(control), np.cos(control)) if column in angles else (control,))
    ]


def _control_names(actuators: ship.Actuators) -> list[str]:
    """The names of :func:`_control_columns`."""
    angles = angle_columns(actuators)
    return [
        part
        for column, name in enumerate(control_labels(actuators))
        for part in ((f"{name}_sin", f"{name}_cos") if column in angles else (name,))
    ]


def start_inputs(windows: PredictionWindows) -> Floats:
    """The window's start and the predicted second [N, H, columns], columns as :func:`start_labels`.

    Positions are left out: the displacement does not depend on them.
    """
    heading, (direction, speed) = windows.start[:, HEADING], windows.wind.T
    controls = _control_columns(windows.control, angle_columns(windows.actuators))
    start = np.column_stack(
        [
            np.sin(heading), np.cos(heading), windows.start[:, SURGE:],
            np.sin(direction), np.cos(direction), speed, *controls,
        ]
    )  # fmt: skip
    count, seconds = len(windows), windows.horizon_s
    repeated = np.repeat(start[:, None, :], seconds, axis=1)
    second = np.broadcast_to(np.arange(1.0, seconds + 1)[None, :, None], (count, seconds, 1))
    return np.concatenate([repeated, second], axis=-1)


def displacement_from_start(track: Floats, start: Floats) -> Floats:
    """North and east from the start at seconds 1 to H [N, H, 2] of a track [N, H+1, 2 or 3]."""
    return track[:, 1:, :2] - start[:, None, :2]


@dataclass(frozen=True, slots=True)
class Standardisation:
    """Standardisation of columns: zero mean and unit deviation; constant columns become zero."""

    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, columns: Floats) -> Standardisation:
        """The scaling of columns [rows, C]."""
        mean, deviation = columns.mean(axis=0), columns.std(axis=0)
        return cls(mean, np.where(deviation <= 1e-9 * (1.0 + np.abs(mean)), np.inf, deviation))

    def standardise(self, columns: Floats) -> Floats:
        """Columns [*, C] in units of their deviation."""
        return (columns - self.mean) / self.deviation

    def restore_scale(self, columns: Floats) -> Floats:
        """The inverse of :meth:`standardise`; constant columns come back as their mean."""
        return columns * np.where(np.isinf(self.deviation), 0.0, self.deviation) + self.mean


def perceptron_outputs(layers: Layers, inputs: Floats) -> Floats:
    """The outputs [*, K] of a perceptron with ReLU between its layers, for inputs [*, C]."""
    *hidden, (matrix, offset) = layers
    for weights, shift in hidden:
        inputs = np.maximum(inputs @ weights.T + shift, 0.0)
    return np.asarray(inputs @ matrix.T + offset)


class NetworkCalibrator(calibrators.Calibrator):
    """A network from features of a window and second to the displacement at that second.

    ``fit`` takes at most ``epochs`` least-squares steps on ``batch`` rows each. It stops early on held-out
    windows, after ``patience`` steps without gain, and keeps the best weights. Its errors on these windows, and
    on hindcasts of the seconds before them, give its weight beside the baselines.
    """

    needs_reference: ClassVar[bool] = True
    by_adam: ClassVar[bool] = False

    def __init__(
        self,
        seed: int = 0,
        plant: MotionModel | None = None,
        epochs: int = 200,
        batch: int = 1000,
        patience: int = 30,
    ) -> None:
        super().__init__(seed, plant)
        self.epochs, self.batch, self.patience = epochs, batch, patience

    def input_names_for(self, actuators: ship.Actuators) -> tuple[str, ...]:
        reference = REFERENCE_INPUTS if self.needs_reference else ()
        means = ("mean", "early") if self.any_commands else ()
        commands = [f"{mean}_{name}" for mean in means for name in _control_names(actuators)]
        return (*start_labels(actuators), *reference, *commands)

    def features(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The network's inputs [N, H, C], columns as ``inputs``."""
        parts = [start_inputs(windows)]
        if self.needs_reference:
            parts.append(displacement_from_start(reference, windows.start))
        if self.any_commands:
            parts.append(command_inputs(windows))
        return np.concatenate(parts, axis=-1)

    def fit(
        self,
        training: calibrators.Examples,
        stopping: calibrators.Examples,
        progress: errors.Progress = lambda share: None,
    ) -> Self:
        """Train on windows and their reference tracks; ``stopping`` are windows of other legs."""
        calibrators.refuse_untrainable(self.method)
        from seatrial.hybrid.calibrators.network_training import StoppingRule, train_network

        self.actuators, self.any_commands = training[0].actuators, training[0].commands is not None
        rows = inputs, targets = self._training_rows(*training)
        self.input_scaling_, self.output_scaling_ = Standardisation.of(inputs), Standardisation.of(targets)
        self.input_range_ = np.stack([inputs.min(axis=0), inputs.max(axis=0)])
        stopping_rule = StoppingRule(self.epochs, self.batch, self.patience)
        windows = None if self.by_adam else len(training[0])
        scaled, held_out = self._standardised_rows(rows), self._standardised_rows(self._training_rows(*stopping))
        self.layers_ = train_network(scaled, held_out, stopping_rule, windows, self.seed, progress)
        errors_m = (
            baselines.mean_track_distances(self.predict(*stopping), stopping[0].track),
            self._hindcast_m(stopping[0]),
        )
        self.usual_error_m_ = np.array([baselines.mean_finite_error(error_m) for error_m in errors_m])
        return self

    def _hindcast_m(self, windows: PredictionWindows) -> Floats:
        """The mean errors [N] over the seconds before second 0, at most the training horizon; NaN without data."""
        if self.plant is None:
            return np.full(len(windows), np.nan)
        trained_s = int(self.input_range_[1, self.input_names.index("second")])
        hindcast_inputs = kalman_filter.filtered_starts(
            hindcast_windows(windows, min(baselines.HINDCAST_S, trained_s)), self.plant
        )
        return baselines.mean_track_distances(
            self.predict(hindcast_inputs, baselines.simulate_reference(hindcast_inputs, self.plant)),
            hindcast_inputs.track,
        )

    def fallback_candidate(
        self, windows: PredictionWindows, tracks: Floats
    ) -> baselines.CandidatePrediction | None:
        return (
            baselines.CandidatePrediction(tracks, self._hindcast_m(windows), self.usual_error_m_)
            if self.plant
            else None
        )

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The predicted track [N, H+1, 3]; the heading, which is not learned, is the reference's or
        turns at a constant rate."""
        features = self.input_scaling_.standardise(self.features(windows, reference))
        learned = self.output_scaling_.restore_scale(perceptron_outputs(self.layers_, features))
        moved = self.base_displacement(windows, reference) + learned
        position = windows.start[:, None, :2] + np.concatenate([np.zeros((len(moved), 1, 2)), moved], axis=1)
        heading = (reference if self.needs_reference else baselines.constant_velocity(windows))[..., 2:]
        return np.concatenate([position, heading], axis=-1)

    def domain(self, windows: PredictionWindows, reference: Floats) -> calibrators.DomainOfApplicability:
        """The network's inputs at every second, and the range of each in the training."""
        low, high = self.input_range_
        return calibrators.DomainOfApplicability(
            self.input_names, self.features(windows, reference), low, high, DOMAIN_MARGIN * (high - low) + 1e-6
        )

    def base_displacement(self, windows: PredictionWindows, reference: Floats) -> Floats:
        """The displacement [N, H, 2] that the network's output is added to: zero here."""
        return np.zeros((len(windows), windows.horizon_s, 2))

    def state_dict(self) -> dict[str, Floats]:
        scalings = {"input": self.input_scaling_, "output": self.output_scaling_}
        tensors = {
            f"network.{_PLACE * number}.{name}": value
            for number, layer in enumerate(self.layers_)
            for name, value in zip(("weight", "bias"), layer, strict=True)
        }
        for name, scaling in scalings.items():
            tensors[f"{name}.mean"], tensors[f"{name}.deviation"] = scaling.mean, scaling.deviation
        tensors["input.range"] = self.input_range_
        tensors["usual_error_m"] = self.usual_error_m_
        return tensors

    def load_state_dict(self, tensors: dict[str, Floats]) -> Self:
        """The inverse of :meth:`state_dict`. Raises :class:`InputError` for a network with other inputs."""
        if tensors["input.mean"].size != len(self.input_names):
            raise errors.InputError("was trained on other inputs than those of this version", fix="train again")
        inputs, outputs = len(self.input_names), len(self.outputs)
        calibrators.require_tensor_shapes(tensors, {
            "input.mean": (inputs,), "input.deviation": (inputs,), "input.range": (2, inputs),
            "output.mean": (outputs,), "output.deviation": (outputs,), "usual_error_m": (2,),
        })  # fmt: skip
        if min(tensors["input.deviation"].min(), tensors["output.deviation"].min()) <= 0.0:
            raise ValueError("a deviation is not above zero")
        self.input_scaling_ = Standardisation(tensors["input.mean"], tensors["input.deviation"])
        self.output_scaling_ = Standardisation(tensors["output.mean"], tensors["output.deviation"])
        self.input_range_ = tensors["input.range"]
        self.usual_error_m_ = tensors["usual_error_m"]
        widths = (inputs, *HIDDEN, outputs)
        names = [f"network.{_PLACE * number}." for number in range(len(widths) - 1)]
        for name, (width, next_width) in zip(names, pairwise(widths), strict=True):
            calibrators.require_tensor_shapes(
                tensors, {f"{name}weight": (next_width, width), f"{name}bias": (next_width,)}
            )
        self.layers_ = tuple((tensors[f"{name}weight"], tensors[f"{name}bias"]) for name in names)
        return self

    def _training_rows(self, windows: PredictionWindows, reference: Floats) -> Rows:
        """Inputs [rows, C] and targets [rows, 2] of the seconds with a measured position."""
        features = self.features(windows, reference)
        targets = displacement_from_start(windows.track, windows.start) - self.base_displacement(windows, reference)
        measured = np.isfinite(targets).all(axis=-1)
        return features[measured], targets[measured]

    def _standardised_rows(self, rows: Rows) -> Rows:
        inputs, targets = rows
        return self.input_scaling_.standardise(inputs), self.output_scaling_.standardise(targets)


class PaperCalibrator(NetworkCalibrator):
    """Three hidden layers of ten with ReLU on the start and the reference's displacement."""

    method = "paper"


class PublishedPaperCalibrator(PaperCalibrator):
    """The paper's calibrator trained by Adam, as published; epochs, batch size and patience are ours."""

    method = "paper_adam"
    by_adam: ClassVar[bool] = True

    def __init__(
        self,
        seed: int = 0,
        plant: MotionModel | None = None,
        epochs: int = 1000,
        batch: int = 100,
        patience: int = 100,
    ) -> None:
        super().__init__(seed, plant, epochs, batch, patience)


class AdditiveCalibrator(PaperCalibrator):
    """Measured minus reference displacement from the start and the reference's displacement."""

    method = "additive"

    def base_displacement(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return displacement_from_start(reference, windows.start)


class DataDrivenCalibrator(NetworkCalibrator):
    """Three hidden layers of ten with ReLU on the start of the window."""

    method = "data_driven"
    needs_reference: ClassVar[bool] = False
