"""The model's response on every segment, and its derivatives with respect to each unknown.

Unknown for all segments are the coefficients; for a recording its current and the errors of its wind and motion
sensors; for a segment its start and the forces that the model lacks, one over the whole segment and one in each
part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.hybrid.effects.catalogue import vessel_plant
from seatrial.hybrid.identification.coefficients import Coefficient, values_at, with_values
from seatrial.hybrid.identification.segments import Segments
from seatrial.hybrid.vessel.parameters import Vessel
from seatrial.hybrid.vessel.plant import Plant, angles_in, pack
from seatrial.hybrid.vessel.sensors import acting_controls, measure
from seatrial.hybrid.vessel.simulate import simulate_batch

PARTS = 5
"""The number of parts of a segment, each with its own missing force."""

FORCES = ("constant_X_n", "constant_Y_n", "constant_N_nm")
CURRENT_SHARE, WIND_SHARE, WIND_RAD = 0.05, 0.15, 0.15
HEADING_RAD, SPEED_SHARE, SWAY_SHARE, ANTENNA_LENGTHS, DELAY_S = 0.01, 0.01, 0.01, 0.02, 0.5
"""Prior widths: the current as a share of the ship's speed, the wind sensor's factor and direction, the heading
bias, the speed factor, the sway bias as a share of the speed, the antenna position in ship lengths, and the
delays of controls and positions, which do not scale with the ship. As in the catalogue of effects."""

Variant = tuple[Plant, Floats, Floats]
"""A plant, the surroundings of each recording, the starts."""

_DIFFERENCE = 1e-3
_WIDER = 2.0


@dataclass(frozen=True, slots=True)
class Surrounding:
    """An unknown of a recording: the plant's parameter, its value at zero and its width."""

    name: str
    neutral: float
    width: float


def surroundings_of(plant: Plant, speed_mps: float) -> tuple[Surrounding, ...]:
    """The unknowns of every recording of a ship at her usual speed; those of the sensors come last."""
    length_m = plant.length_between_perpendiculars_m
    widths = {
        "current_north_mps": CURRENT_SHARE * speed_mps, "current_east_mps": CURRENT_SHARE * speed_mps,
        "wind_speed_factor": WIND_SHARE, "wind_direction_bias_rad": WIND_RAD, "command_delay_s": DELAY_S,
        "heading_bias_rad": HEADING_RAD, "position_delay_s": DELAY_S,
        "speed_scale": SPEED_SHARE, "sway_bias_mps": SWAY_SHARE * speed_mps,
        "antenna_forward_m": ANTENNA_LENGTHS * length_m, "antenna_starboard_m": ANTENNA_LENGTHS * length_m,
    }  # fmt: skip
    return tuple(Surrounding(name, float(getattr(plant, name)), width) for name, width in widths.items())


SIMULATED = 5
"""The number of surroundings that act in the simulation; the others act on its sensor readings."""


@dataclass(frozen=True, slots=True)
class ResponseModel:
    """A vessel whose ``coefficients`` are unknown, on ``segments``.

    The unknowns are a vector z [coefficients + recordings x surroundings], each in units of its prior's width.
    """

    vessel: Vessel
    coefficients: tuple[Coefficient, ...]
    segments: Segments
    surroundings: tuple[Surrounding, ...]
    sensors: Plant

    @property
    def size(self) -> int:
        """The number of unknowns in z."""
        return len(self.coefficients) + len(self.segments.names) * len(self.surroundings)

    @property
    def own_unknowns(self) -> Ints:
        """The unknowns that each segment depends on [S, coefficients + surroundings]."""
        kept, count = len(self.coefficients), len(self.surroundings)
        around = kept + self.segments.recording[:, None] * count + np.arange(count)
        return np.concatenate([np.tile(np.arange(kept), (len(around), 1)), around], axis=1)

    def vessel_at(self, z: Floats) -> Vessel:
        """The vessel with the coefficients of ``z``."""
        return with_values(self.vessel, values_at(self.coefficients, z[: len(self.coefficients)]))

    def on_segments(self, segments: Segments, z: Floats) -> tuple[ResponseModel, Floats]:
        """The same coefficients on other segments, and ``z`` there, with unknown surroundings."""
        model, kept = model_of(self.vessel, self.coefficients, segments), len(self.coefficients)
        return model, np.concatenate([z[:kept], np.zeros(model.size - kept)])

    def plant(self, z: Floats) -> Plant:
        """The plant at the coefficients of ``z``, with a wider range, as a search needs."""
        plant = vessel_plant(self.vessel_at(z))
        high = _WIDER * max(plant.surge_high_mps, -plant.surge_low_mps)
        return plant.replaced(
            surge_low_mps=-high, surge_high_mps=high, sway_limit_mps=high,
            yaw_rate_limit_radps=_WIDER * 2.0 * plant.yaw_rate_limit_radps,
        )  # fmt: skip

    def around(self, z: Floats) -> Floats:
        """The surroundings [recordings, surroundings] of ``z``."""
        deviations = z[len(self.coefficients) :].reshape(len(self.segments.names), len(self.surroundings))
        widths = np.array([surrounding.width for surrounding in self.surroundings])
        return np.asarray([surrounding.neutral for surrounding in self.surroundings] + deviations * widths)

    def reported(self, z: Floats, start: Floats) -> Floats:
        """What the sensors report of the segments [S, T, 6], from ``start`` [S, 6]."""
        around = self.around(z)
        return self._seen(self._run([(self.plant(z), around, start)])[0], around)

    def slopes(self, z: Floats, start: Floats) -> Floats:
        """The derivative of the readings with respect to each coefficient and each surrounding of the segment's
        recording, [S, T, 6, coefficients + surroundings]."""
        plant, around = self.plant(z), self.around(z)
        moved = [z + _DIFFERENCE * row for row in np.eye(len(z))[: len(self.coefficients)]]
        shifted = [
            around + _DIFFERENCE * row for row in np.diag([surrounding.width for surrounding in self.surroundings])
        ]
        variants = [(plant, around, start), *((self.plant(row), around, start) for row in moved)]
        still, *states = self._run(
            [*variants, *((plant, surroundings, start) for surroundings in shifted[:SIMULATED])]
        )
        states += [still] * (len(shifted) - SIMULATED)
        seen = self._seen(still, around)
        settings = [around] * len(moved) + shifted
        columns = [
            (self._seen(state, surroundings) - seen) / _DIFFERENCE
            for state, surroundings in zip(states, settings, strict=True)
        ]
        return np.stack(columns, axis=-1)

    def own_slopes(self, z: Floats, start: Floats) -> tuple[Floats, Floats]:
        """The readings [S, T, 6], and their derivatives with respect to a segment's own unknowns: [S, T, 6, 6 +
        3 + 3 PARTS].

        The start in units of :attr:`start_scale`; the forces over the whole segment and in each part in units
        of mass times speed squared over length, moments of that times length.
        """
        plant, around = self.plant(z), self.around(z)
        starts = [start + _DIFFERENCE * row for row in np.diag(self.start_scale)]
        still, *moved = self._run([(plant, around, begin) for begin in (start, *starts)])
        seen = self._seen(still, around)
        by_start = [(self._seen(state, around) - seen) / _DIFFERENCE for state in moved]
        pulses = self._pulses(plant, around, still)
        parts = pulses.reshape(*pulses.shape[:3], -1)
        return seen, np.concatenate([np.stack(by_start, axis=-1), pulses.sum(axis=-1), parts], axis=-1)

    def _pulses(self, plant: Plant, around: Floats, still: Floats) -> Floats:
        """The derivative of states with respect to a force that acts in one part: [S, T, 6, 3 axes, parts]."""
        length_m, steps = plant.length_between_perpendiculars_m, self.segments.controls.shape[1]
        sizes = np.array([1.0, 1.0, length_m]) * plant.mass_kg * self.segments.speed_mps**2 / length_m
        pushed = [
            plant.shifted(**{name: _DIFFERENCE * size}) for name, size in zip(FORCES, sizes.tolist(), strict=True)
        ]
        onset = np.zeros((*still.shape, 3, PARTS + 1))
        for part in range(PARTS):
            first = part * steps // PARTS
            moved = self._run([(variant, around, still[:, first]) for variant in pushed], first)
            onset[:, first:, :, :, part] = (np.moveaxis(moved, 0, -1) - still[:, first:, :, None]) / _DIFFERENCE
        return np.asarray((onset[..., :-1] - onset[..., 1:])[:, : -1 : self.segments.every])

    @property
    def start_scale(self) -> Floats:
        """The units of a start's deviation [6]: a length, a radian, the speed, a turn."""
        speed = self.segments.speed_mps
        length_m = self.vessel.dimensions.length_between_perpendiculars_m
        return np.array([length_m, length_m, 1.0, speed, speed, speed / length_m])

    def _run(self, variants: Sequence[Variant], first: int = 0) -> Floats:
        """True states [variants, S, K+1, 6] of all variants at once, from step ``first`` on."""
        segments = self.segments
        plants = np.concatenate([np.repeat(pack(plant), len(segments)) for plant, _, _ in variants])
        surroundings = np.concatenate([around[segments.recording] for _, around, _ in variants])
        for number, surrounding in enumerate(self.surroundings[:SIMULATED]):
            plants[surrounding.name] = surroundings[:, number]
        start = np.concatenate([begin for _, _, begin in variants])
        again = (len(variants), 1, 1)
        # what acts is drawn up from whole segments: a delay reaches back over the step that a run begins at
        controls = acting_controls(
            np.tile(segments.controls, again), plants["command_delay_s"], segments.dt_s, angles_in(plants)
        )[:, first:]
        plants["command_delay_s"] = 0.0
        wind = np.tile(segments.wind[:, first:], again)
        # steps are a small share of a ship length: one step of the integration each
        states = simulate_batch(plants, start, controls, wind, segments.dt_s, substeps=1).states
        return states.reshape(len(variants), len(segments), *states.shape[1:])

    def _seen(self, states: Floats, around: Floats) -> Floats:
        """The readings of states [S, K+1, 6] at the times of comparison [S, T, 6]."""
        sparse = states[:, : -1 : self.segments.every]
        seen = np.empty_like(sparse)
        names = [surrounding.name for surrounding in self.surroundings[SIMULATED:]]
        for number, values in enumerate(around):
            mine = self.segments.recording == number
            sensors = self.sensors.replaced(**dict(zip(names, values[SIMULATED:].tolist(), strict=True)))
            seen[mine] = measure(sparse[mine], sensors, self.segments.every * self.segments.dt_s)
        return seen


def model_of(vessel: Vessel, coefficients: Sequence[Coefficient], segments: Segments) -> ResponseModel:
    """The model of a vessel on segments, its surroundings at their usual widths."""
    plant = vessel_plant(vessel)
    return ResponseModel(vessel, tuple(coefficients), segments, surroundings_of(plant, segments.speed_mps), plant)
