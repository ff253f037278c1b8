"""Examinations with columns drawn at random and data whose truth is known: the statistics without a ship."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.disturbance_model import DisturbanceNoise
from seatrial.hybrid.diagnosis.linearise import ModelWithEffects
from seatrial.hybrid.diagnosis.regression import ColumnLayout, NormalEquations
from seatrial.hybrid.effects import CATALOGUE
from seatrial.hybrid.vessel.plant import Plant

SMALL_CATALOGUE = {
    name: CATALOGUE[name]
    for name in (
        "ocean_current", "heading_bias", "yaw_inertia", "hull_fouling", "thrust_loss_port", "sway_bias",
        "wind_load", "yaw_rate_bias",
    )
}  # fmt: skip
NEEDLESS: Any = None
"""For the fields of an examination that its statistics do not look at."""


@dataclass(frozen=True, slots=True)
class Design:
    """Whitened columns of some legs [L, rows, C], the data's, column 0, still empty; their products by leg."""

    columns: Floats
    layout: ColumnLayout
    nuisance: NDArray[np.int64]
    scale: Floats
    plant: Plant
    gram: Floats

    def data(self, random: np.random.Generator, effects: Mapping[str, tuple[float, ...]] | None = None) -> Floats:
        """Data [L, rows] with these effects, what is tolerated and noise, all as the statistics assume."""
        z = random.standard_normal(self.columns.shape[:2])
        z += self.columns[:, :, self.nuisance] @ (self.scale * random.standard_normal(len(self.scale)))
        for name, free in (effects or {}).items():
            z += self.columns[:, :, self.layout.columns_of(name)] @ np.array(free)
        return z

    def equations(self, data: Floats) -> NormalEquations:
        """As if a filter had given these columns."""
        legs = self.gram.copy()
        legs[:, 0, 1:] = legs[:, 1:, 0] = np.einsum("lrc,lr->lc", self.columns, data)[:, 1:]
        legs[:, 0, 0] = (data**2).sum(axis=1)
        return NormalEquations(
            log=NEEDLESS, model=ModelWithEffects(self.plant, SMALL_CATALOGUE), linear=NEEDLESS, effects=(),
            force_range=np.array([1e5, 1e5, 1e6]), tolerance=0.01, noise=DisturbanceNoise(), layout=self.layout,
            gram=legs, nuisance=self.nuisance, nuisance_scale=self.scale,
        )  # fmt: skip


def a_design(plant: Plant, legs: int, seed: int, sigmas: float = 20.0, rows: int = 60) -> Design:
    """Columns in which an effect of ordinary size stands out by so many standard deviations."""
    effect = tuple(name for name, each in SMALL_CATALOGUE.items() for _ in each.free_scale)
    prior = np.array([size for each in SMALL_CATALOGUE.values() for size in each.free_scale])
    varying = ("heading_bias*time",) * 2
    layout = ColumnLayout(
        effect=effect, prior=prior, tolerated=np.zeros(len(prior)), wind=1, features=4, varying=varying,
        varying_prior=np.full(2, prior[2]), varying_tolerated=np.full(2, 0.02),
        depends=("heading",) * 3 + ("time",) * 2,
    )  # fmt: skip
    count = layout.first_feature + 3 * (layout.features + len(layout.depends))
    columns = np.random.default_rng(seed).standard_normal((legs, rows, count)) / np.sqrt(legs * rows)
    columns[:, :, 0] = 0.0
    columns[:, :, 1 : 1 + len(prior)] *= sigmas / prior
    columns[:, :, layout.first_varying : layout.first_feature] *= sigmas / layout.varying_prior
    nuisance = np.arange(layout.first_wind, count)
    scale = np.full(len(nuisance), 2.0)
    scale[layout.first_varying - layout.first_wind : layout.first_feature - layout.first_wind] = (
        layout.varying_tolerated
    )
    return Design(columns, layout, nuisance, scale, plant, gram_matrices(columns))


def gram_matrices(columns: Floats) -> Floats:
    """Leg by leg [L, C, C]."""
    return np.asarray(columns.transpose(0, 2, 1) @ columns)


def with_columns(design: Design, columns: Floats) -> Design:
    """The same design with other columns."""
    return replace(design, columns=columns, gram=gram_matrices(columns))


def in_other_units(design: Design, name: str, factor: float) -> Design:
    """The same columns when an effect's free coordinates are counted in units so many times as large."""
    columns, prior = design.columns.copy(), design.layout.prior.copy()
    for column in design.layout.columns_of(name):
        columns[:, :, column] *= factor
        prior[column - 1] /= factor
    return replace(with_columns(design, columns), layout=replace(design.layout, prior=prior))
