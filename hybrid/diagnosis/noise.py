"""What nobody can predict: sensors' noise, gusts, slow forces and the swing in waves, with levels from the data."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from acquisition.core.arrays import Floats

if TYPE_CHECKING:
    from hybrid.diagnosis.linearise import Linearisation

FORCE_UNITS = np.array([1e3, 1e3, 1e4])
"""The filter reckons forces in kN and moments in 10 kN m, so that its numbers are of one size."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations, SI.

    Of a second's mean of each sensor; of the force that changes from second to second (``gust``) and of one that
    lasts ``slow_s`` (``slow``), along, across [N] and in yaw [N m]; of the swing in waves, north, east [m] (and the
    correlation of the two) and in yaw [rad], with the frequency that a
    buoy would see, its damping, and where the waves go: the ship meets them at another frequency, and swings in yaw
    when they come from the side. ``drift`` is what the sensors err slowly, by position [m], heading [rad], surge,
    sway [m/s] and yaw rate [rad/s]: an error that lasts ``drift_s``, where a second's noise is forgotten at once.
    """

    position_m: float = 0.03
    heading_rad: float = 0.001
    surge_mps: float = 0.02
    sway_mps: float = 0.02
    yaw_rate_radps: float = 0.0005
    gust: tuple[float, float, float] = (300.0, 300.0, 3000.0)
    slow: tuple[float, float, float] = (300.0, 300.0, 3000.0)
    slow_s: float = 20.0
    waves: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wave_correlation: float = 0.0
    wave_frequency_radps: float = 1.2
    wave_damping: float = 0.2
    wave_towards_rad: float = 0.0
    drift: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    drift_s: float = 10.0

    @property
    def has_waves(self) -> bool:
        """Whether there is a swing in waves at all."""
        return any(each > 0.0 for each in self.waves)

    @property
    def has_drift(self) -> bool:
        """Whether any sensor errs slowly."""
        return any(each > 0.0 for each in self.drift)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    def as_array(self) -> Floats:
        """For the filter: sensors 6, gusts 3, slow forces 3, their time; of the waves correlation, 3 levels,
        frequency, damping, direction; slow errors of the sensors 6, their time."""
        sensors = [self.position_m] * 2 + [self.heading_rad, self.surge_mps, self.sway_mps, self.yaw_rate_radps]
        gust, slow = (np.array(each) / FORCE_UNITS for each in (self.gust, self.slow))
        swing = [
            self.wave_correlation,
            *self.waves,
            self.wave_frequency_radps,
            self.wave_damping,
            self.wave_towards_rad,
        ]
        drift = [self.drift[0], *self.drift, self.drift_s]
        return np.array([*sensors, *gust, *slow, self.slow_s, *swing, *drift])


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """The second stage's result: the equations about a better motion, and what nobody can predict in them.

    ``linearisation`` is about the motion that the model with its disturbances makes out [T, 6]; ``noise`` are the
    likeliest standard deviations (SI) of sensors, gusts, slow forces and waves.
    """

    linearisation: Linearisation
    noise: Noise
