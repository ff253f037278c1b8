"""Windows in legs as a recording gives them, and calibrators whose worth is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.acquisition.core.ship import Actuators
from seatrial.analysis.tables.table import NANO
from seatrial.hybrid.calibrators import Calibrator, DomainOfApplicability, Examples, Progress
from seatrial.hybrid.prediction.baselines import constant_velocity
from seatrial.hybrid.prediction.window_sets import PredictionWindows
from tests.hybrid.windows_by_hand import STARTED_NS, random_windows

SECONDS = 10
STRIDE_S = 5


def windows_of_legs(
    sizes: Sequence[int], trials: Sequence[str] = ("first",), gap_s: int = 60, seed: int = 0
) -> PredictionWindows:
    """Legs of so many windows each, one every five seconds, in each of the trials; the ships drift off course.

    What a leg's drift is nobody can know from the start of its windows: it is the same for the whole leg.
    """
    count = sum(sizes) * len(trials)
    windows = random_windows(count, SECONDS, seed)
    offsets, legs, now = [], [], 0
    for number, size in enumerate(sizes):
        offsets += [now + STRIDE_S * step for step in range(size)]
        legs += [f"{number:03d}"] * size
        now = offsets[-1] + SECONDS + gap_s
    leg = np.array([f"{trial}/{each}" for trial in trials for each in legs])
    drift_mps = dict(zip(np.unique(leg), np.random.default_rng(seed).normal(0.0, 0.3, len(set(leg))), strict=True))
    track = windows.track.copy()
    track[..., 0] += np.array([drift_mps[each] for each in leg])[:, None] * np.arange(SECONDS + 1)
    return replace(
        windows,
        track=track,
        trial=np.repeat(np.array(trials), sum(sizes)),
        leg=leg,
        start_ns=STARTED_NS + np.tile(offsets, len(trials)) * NANO,
    )


class Oracle(Calibrator):
    """Knows the measured track: no calibrator can be better."""

    method: ClassVar[str] = "oracle"

    def input_names_for(self, actuators: Actuators) -> tuple[str, ...]:
        return ()

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        progress(1.0)
        return self

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return windows.track

    def domain(self, windows: PredictionWindows, reference: Floats) -> DomainOfApplicability:
        raise NotImplementedError

    def outside_domain(self, windows: PredictionWindows, reference: Floats) -> Bools:
        return np.zeros(len(windows), dtype=bool)

    def state_dict(self) -> dict[str, Floats]:
        return {}

    def load_state_dict(self, tensors: dict[str, Floats]) -> Self:
        return self


class Holding(Oracle):
    """Learns nothing and holds the present motion, as one baseline does."""

    method: ClassVar[str] = "holding"

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        return constant_velocity(windows)


class Memory(Holding):
    """Knows the drift of the legs it was trained on and nothing else: what a leak rewards most."""

    method: ClassVar[str] = "memory"

    def fit(self, training: Examples, stopping: Examples, progress: Progress = lambda share: None) -> Self:
        known = training[0]
        gap = known.track - constant_velocity(known)
        self.drift_ = dict(zip(known.leg, gap[:, :, :2], strict=True))
        return self

    def predict(self, windows: PredictionWindows, reference: Floats) -> Floats:
        track = constant_velocity(windows)
        for window, leg in enumerate(windows.leg):
            track[window, :, :2] += self.drift_.get(leg, 0.0)
        return track


FAKES: dict[str, type[Calibrator]] = {each.method: each for each in (Oracle, Holding, Memory)}
