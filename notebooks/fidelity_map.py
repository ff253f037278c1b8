# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # How bad may the reference be, and how much data does it save?
#
# The reference is degraded step by step and given to a calibrator with ever more windows to learn from. On windows
# never seen, the degraded reference alone, the hybrid on it, the data alone and constant velocity are compared. A
# reference's quality is always its own mean distance on these windows, so that the user of another model finds his
# place on the map. `seatrial reproduce fidelity` runs this notebook.

# %%
from __future__ import annotations

# %% tags=["parameters"]
folder = "."  # where the map's JSON and figures go
sea_state = "gentle"
method = "paper"
seed, seeds = 0, 2
workers = None  # processes; one a core without a number

# %%
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby, product
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from seatrial.acquisition.core.errors import DataShortageError, Progress, join_words
from seatrial.acquisition.core.files import write_text
from seatrial.acquisition.core.quantities import Bools, Floats
from seatrial.analysis.batch import map_calls
from seatrial.analysis.report.pages import Page, embed_picture, fill_figure, png_of, render, write_figure
from seatrial.analysis.report.plots import INK
from seatrial.hybrid.calibrators import make_calibrator
from seatrial.hybrid.effects import vessel_plant
from seatrial.hybrid.prediction.baselines import constant_velocity, distances, simulate_reference
from seatrial.hybrid.prediction.window_sets import PredictionWindows, concatenate_windows
from seatrial.hybrid.report.plots import COLOUR, label_ticks_in_plain_numbers
from seatrial.hybrid.vessel.files import load_vessel
from seatrial.hybrid.vessel.plant import Plant
from seatrial.notebooks.wang2021.campaign import MODEL, TRUTH, paper_campaign

# %% [markdown]
# ## Degraded references
#
# The main axis goes from the truth to the reference, all numbers in step, and from there on to an ever livelier
# ship: its hull's coefficients divided and its thrust multiplied by one factor. The other axes change one thing of
# the truth only.

# %%
OVERALL, COEFFICIENTS, THRUST, MISSING = "overall", "hull coefficients", "thrust", "missing effects"
THRUST_NUMBERS = ("thrust_nn", "thrust_nu", "thrust_uu", "side_nv", "side_uv", "side_vv")
ENVIRONMENT = ("current_north_mps", "current_east_mps", "drift_force_n", "drift_north", "drift_east")

SHARES = (0.0, 0.15, 0.3, 0.6, 1.0)
FACTORS = (1.25, 1.6, 2.5, 5.0)
SINGLE_FACTORS = (0.5, 0.8, 1.25, 2.0)


@dataclass(frozen=True, slots=True)
class Degradation:
    """A reference model that is worse than the truth: along which axis, how far, and its plant."""

    axis: str
    label: str
    plant: Plant


def degradations(
    truth: Plant, reference: Plant, shares: Sequence[float] = SHARES, factors: Sequence[float] = FACTORS
) -> tuple[Degradation, ...]:
    """The main axis in order: ``shares`` of the way from truth to reference, then ``factors`` beyond it."""
    on_the_way = [
        Degradation(OVERALL, f"{share:.0%} of the way to the reference", blended(truth, reference, share))
        for share in shares
    ]
    beyond = [
        Degradation(OVERALL, f"the reference, hull / {factor:g}, thrust x {factor:g}", livelier(reference, factor))
        for factor in factors
    ]
    return (*on_the_way, *beyond)


def single_degradations(
    truth: Plant, reference: Plant, factors: Sequence[float] = SINGLE_FACTORS
) -> tuple[Degradation, ...]:
    """The truth with one thing wrong: its hull, its thrust, or an effect that the reference does not know."""
    weather = {name: getattr(reference, name) for name in ENVIRONMENT}
    other_weather = {name: getattr(truth, name) for name in ENVIRONMENT}
    return (
        *(
            Degradation(COEFFICIENTS, f"hull x {factor:g}", truth.scaled(factor, *truth.hull_model.numbers))
            for factor in factors
        ),
        *(Degradation(THRUST, f"thrust x {factor:g}", truth.scaled(factor, *THRUST_NUMBERS)) for factor in factors),
        Degradation(MISSING, "without current and wave drift", truth.replaced(**weather)),
        Degradation(MISSING, "without what changed the ship", reference.replaced(**other_weather)),
    )


def blended(truth: Plant, reference: Plant, share: float) -> Plant:
    """Every number of the truth moved by ``share`` of the way to the reference's; the truth's extra forces stay."""
    numbers: dict[str, Any] = {}
    reference_numbers = reference.numbers()
    for name, truth_number in truth.numbers().items():
        ours, theirs = np.asarray(truth_number), np.asarray(reference_numbers[name])
        value = (1.0 - share) * ours + share * theirs
        numbers[name] = tuple(value.tolist()) if value.ndim else float(value)
    return truth.replaced(**numbers)


def livelier(reference: Plant, factor: float) -> Plant:
    """The hull's coefficients divided, the thrust multiplied: a ship that answers ever more than it should."""
    return reference.scaled(1.0 / factor, *reference.hull_model.numbers).scaled(factor, *THRUST_NUMBERS)


# %% [markdown]
# ## The map
#
# `FidelityMap` holds the errors of every method at every point; the thresholds are where one method stops to be the
# better one.

# %%
SAME = 0.05
"""Two methods whose errors differ by a smaller share than this count as equally good: another seed moves a small
network by as much."""
LEAST_M = 1e-3
"""Errors below a millimetre count as one."""


@dataclass(frozen=True, slots=True)
class FidelityMap:
    """Mean distances [m] on unseen windows: D references, W amounts of data.

    ``reference_m`` [D] is each degraded reference alone, ``hybrid_m`` [D, W] the calibrator ``method`` on it,
    ``data_driven_m`` [W] the data alone; ``axis`` and ``label`` [D] say what was degraded.
    """

    method: str
    axis: tuple[str, ...]
    label: tuple[str, ...]
    windows: tuple[int, ...]
    reference_m: Floats
    hybrid_m: Floats
    data_driven_m: Floats
    constant_velocity_m: float
    unseen_windows: int
    seeds: tuple[int, ...]

    @property
    def rivals(self) -> tuple[str, ...]:
        """The methods compared, in the order of :meth:`errors_m`."""
        return "reference", "constant_velocity", "data_driven", self.method

    def errors_m(self) -> Floats:
        """Mean distance of every rival at every point of the map [4, D, W]."""
        shape = self.hybrid_m.shape
        alone = np.broadcast_to(self.reference_m[:, None], shape)
        data = np.broadcast_to(self.data_driven_m[None, :], shape)
        return np.stack([alone, np.full(shape, self.constant_velocity_m), data, self.hybrid_m])

    def overall(self) -> FidelityMap:
        """The main axis alone, the best reference first."""
        rows = [number for number, axis in enumerate(self.axis) if axis == OVERALL]
        rows.sort(key=lambda row: float(self.reference_m[row]))
        return replace(
            self,
            axis=tuple(self.axis[row] for row in rows),
            label=tuple(self.label[row] for row in rows),
            reference_m=self.reference_m[rows],
            hybrid_m=self.hybrid_m[rows],
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON, with the thresholds; none where there is no limit."""
        plain = {name: value.tolist() if isinstance(value, np.ndarray) else value
                 for name, value in asdict(self).items()}  # fmt: skip
        limits = [None if np.isinf(limit_m) else float(limit_m) for limit_m in useful_up_to_m(self)]
        return {**plain, "useful_up_to_m": limits}


def useful_up_to_m(fidelity: FidelityMap) -> Floats:
    """The reference's own error up to which the hybrid is better than the data alone, per amount of data [W].

    Better is by more than :data:`SAME`. Zero where not even the best reference helps, infinite where the worst
    still does; between two references it is interpolated on the logarithm of their errors.
    """
    main = fidelity.overall()
    gain = np.asarray(1.0 - main.hybrid_m / main.data_driven_m - SAME)
    log_errors = np.log(np.maximum(main.reference_m, LEAST_M))
    return np.array([_falls_below_zero(log_errors, column) for column in gain.T])


def _falls_below_zero(log_errors: Floats, gain: Floats) -> float:
    useless = np.flatnonzero(gain <= 0.0)
    if not useless.size:
        return float("inf")
    first = int(useless[0])
    if first == 0:
        return 0.0
    share = gain[first - 1] / (gain[first - 1] - gain[first])
    return float(np.exp(log_errors[first - 1] + share * (log_errors[first] - log_errors[first - 1])))


def enough_alone_m(fidelity: FidelityMap) -> Floats:
    """Up to which of the references tried no other method beats the reference by more than :data:`SAME` [W].

    Zero where the best of them is beaten.
    """
    main = fidelity.overall()
    others_m = main.errors_m()[1:].min(axis=0)
    enough = np.logical_and.accumulate(main.reference_m[:, None] * (1.0 - SAME) <= others_m, axis=0)
    return np.asarray(np.where(enough, main.reference_m[:, None], 0.0).max(axis=0))


def hybrid_wins(fidelity: FidelityMap) -> Bools:
    """Where on the main axis the hybrid beats all others, constant velocity included [D, W]."""
    return edge(fidelity.overall()) < 1.0 - SAME


def edge(fidelity: FidelityMap) -> Floats:
    """The hybrid's error over that of the best of all other methods [D, W]."""
    return np.asarray(fidelity.hybrid_m / np.maximum(fidelity.errors_m()[:-1].min(axis=0), LEAST_M))


# %%
AMOUNTS = (10, 20, 50, 100, 200, 400, 600)
LARGEST_CAMPAIGN = 150  # sequences simulated in one go
STOPPING_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class Sequences:
    """Windows to learn from and windows to be judged by, of one ship in one sea."""

    pool: PredictionWindows
    unseen: PredictionWindows


def papers_map(
    sea_state: str = "gentle",
    method: str = "paper",
    seed: int = 0,
    seeds: int = 2,
    workers: int | None = None,
    progress: Progress = lambda share: None,
) -> FidelityMap:
    """The map of the paper's ship and reference in one sea state, every axis of degradation."""
    at_work = workers or os.cpu_count() or 1
    sequences, truth = campaign_sequences(
        sea_state, seed, workers=at_work, progress=lambda share: progress(0.1 * share)
    )
    model = vessel_plant(load_vessel(MODEL))
    steps = (*degradations(truth, model), *single_degradations(truth, model))
    drawn = range(seed, seed + seeds)
    return fidelity_map(
        sequences, steps, method, seeds=drawn, workers=at_work, progress=lambda share: progress(0.1 + 0.9 * share)
    )


def campaign_sequences(
    sea_state: str = "gentle",
    seed: int = 0,
    pool: int = max(AMOUNTS),
    unseen: int = 120,
    workers: int = 2,
    progress: Progress = lambda share: None,
) -> tuple[Sequences, Plant]:
    """Sequences of the paper's campaign and the truth's plant; the unseen ones are from a sea of their own."""
    sizes = [unseen, *([LARGEST_CAMPAIGN] * (pool // LARGEST_CAMPAIGN))]
    if pool % LARGEST_CAMPAIGN:
        sizes.append(pool % LARGEST_CAMPAIGN)
    asked = [(paper_campaign, sea_state, 1000 * seed + number, TRUTH, size) for number, size in enumerate(sizes)]
    judged, *learned = map_calls(asked, workers, progress)
    return Sequences(concatenate_windows([campaign.windows for campaign in learned]), judged.windows), judged.truth


def fidelity_map(
    sequences: Sequences,
    steps: Sequence[Degradation],
    method: str = "paper",
    amounts: Sequence[int] = AMOUNTS,
    seeds: Sequence[int] = (0, 1, 2),
    workers: int = 2,
    progress: Progress = lambda share: None,
) -> FidelityMap:
    """Train ``method`` on every degraded reference with every amount of data, means over ``seeds``.

    Every seed draws its own windows to learn from. Windows in which a reference leaves the range of its model are
    left out for all. Raises :class:`DataShortageError` when that leaves fewer than the largest of ``amounts``.
    """
    usable = within_range(sequences, [step.plant for step in steps])
    if len(usable.pool) < max(amounts) or not len(usable.unseen):
        raise DataShortageError(
            f"{len(usable.pool)} windows to learn from and {len(usable.unseen)} to be judged by are too few",
            fix=f"simulate more, or learn from fewer than {max(amounts)}",
        )
    asked = [
        (learned_errors_m, usable, method, seed, step, tuple(amounts))
        for step, seed in product((None, *steps), seeds)
    ]
    means = np.array(map_calls(asked, workers, progress))
    by_step = means.reshape(len(steps) + 1, len(seeds), len(amounts)).mean(axis=1)
    unseen = usable.unseen
    return FidelityMap(
        method=method,
        axis=tuple(step.axis for step in steps),
        label=tuple(step.label for step in steps),
        windows=tuple(amounts),
        reference_m=np.array([_mean_m(simulate_reference(unseen, step.plant), unseen) for step in steps]),
        hybrid_m=by_step[1:],
        data_driven_m=by_step[0],
        constant_velocity_m=_mean_m(constant_velocity(unseen), unseen),
        unseen_windows=len(unseen),
        seeds=tuple(seeds),
    )


def within_range(sequences: Sequences, plants: Sequence[Plant]) -> Sequences:
    """The windows in which every one of ``plants`` stays in the range of its model."""

    def inside(windows: PredictionWindows) -> Bools:
        finite = [np.isfinite(simulate_reference(windows, plant)).all(axis=(1, 2)) for plant in plants]
        return np.asarray(np.all(finite, axis=0))

    pool, unseen = sequences.pool, sequences.unseen
    return Sequences(pool.subset(inside(pool)), unseen.subset(inside(unseen)))


def learned_errors_m(
    sequences: Sequences, method: str, seed: int, step: Degradation | None, amounts: Sequence[int]
) -> Floats:
    """Mean distance on the unseen windows after learning from each of ``amounts`` windows [W].

    Without a degraded reference it is the data alone that is learned from.
    """
    order = np.random.default_rng(seed).permutation(len(sequences.pool))
    plant = None if step is None else step.plant
    name = "data_driven" if step is None else method
    tracks = [
        constant_velocity(windows) if plant is None else simulate_reference(windows, plant)
        for windows in (sequences.pool, sequences.unseen)
    ]
    errors = []
    for amount in amounts:
        stopping, training = np.split(order[:amount], [max(2, round(STOPPING_SHARE * amount))])
        calibrator = make_calibrator(name, seed, plant).fit(
            (sequences.pool.subset(training), tracks[0][training]),
            (sequences.pool.subset(stopping), tracks[0][stopping]),
        )
        errors.append(_mean_m(calibrator.predict(sequences.unseen, tracks[1]), sequences.unseen))
    return np.array(errors)


def _mean_m(predicted: Floats, windows: PredictionWindows) -> float:
    return float(distances(predicted, windows.track).mean())


# %% [markdown]
# ## In words
#
# Three sentences, every word of which follows from the numbers.

# %%
_NAMED = {"reference": "the reference", "constant_velocity": "constant velocity", "data_driven": "the data alone"}


def with_reading(fidelity: FidelityMap) -> dict[str, Any]:
    """The map for JSON, with its reading."""
    return {**fidelity.as_dict(), "reading": list(reading(fidelity))}


def reading(fidelity: FidelityMap) -> tuple[str, str, str]:
    """How bad a reference may be; where the hybrid is the best choice and where it is not needed; what it gains."""
    main = fidelity.overall()
    return _how_bad(main), _best_choice(main), _gain(main)


def _how_bad(main: FidelityMap) -> str:
    """Up to which error of the reference the hybrid beats the data, for each amount of data."""
    verdicts = {
        0.0: f"even the best reference, {main.reference_m[0]:.2f} m off, is not good enough",
        np.inf: f"even the worst tried, {main.reference_m[-1]:.2f} m off, is good enough",
    }
    parts = [
        f"with {amounts} windows {verdicts.get(limit_m, f'one less than {limit_m:.2f} m off is good enough')}"
        for limit_m, amounts in _by_amount(main, useful_up_to_m(main))
    ]
    return (
        f"For a hybrid ({main.method}) to beat the data alone by more than {100.0 * SAME:.0f} % after learning "
        f"from as much: {'; '.join(parts)} (constant velocity is {main.constant_velocity_m:.2f} m off)."
    )


def _best_choice(main: FidelityMap) -> str:
    """On how many references the hybrid beats all others, and which need no calibrator, by amount of data."""
    won = [
        f"{int(count) or 'none'} with {amounts}"
        for count, amounts in _by_amount(main, hybrid_wins(main).sum(axis=0).astype(float))
    ]
    enough = [
        f"{f'up to {limit_m:.2f} m off' if limit_m else 'nowhere'} with {amounts}"
        for limit_m, amounts in _by_amount(main, enough_alone_m(main))
    ]
    return (
        f"It beats all other methods, constant velocity and the reference alone included, on so many of the "
        f"{len(main.reference_m)} references: {', '.join(won)} windows; the reference needs no calibrator "
        f"{', '.join(enough)}."
    )


def _gain(main: FidelityMap) -> str:
    """Where the hybrid gains most on the best of the others, and what a better reference is worth to it."""
    row, column = np.unravel_index(int(np.argmin(edge(main))), main.hybrid_m.shape)
    others_m = main.errors_m()[:-1, row, column]
    gains = "gains most" if hybrid_wins(main).any() else "gains nowhere, and comes nearest to the others,"
    return (
        f"It {gains} with {main.windows[column]} windows on the reference that is {main.reference_m[row]:.2f} m "
        f"off: {main.hybrid_m[row, column]:.2f} m against {others_m.min():.2f} m of "
        f"{_NAMED[main.rivals[int(others_m.argmin())]]}; with {main.windows[-1]} it leaves "
        f"{main.hybrid_m[0, -1]:.2f} m on the best reference and {main.hybrid_m[-1, -1]:.2f} m on the worst, the "
        f"data alone {main.data_driven_m[-1]:.2f} m."
    )


def _by_amount(main: FidelityMap, values: Floats) -> Iterator[tuple[float, str]]:
    """Each of ``values`` [W] with the amounts of data that it is said of, neighbours of one value together."""
    for value, group in groupby(zip(values, main.windows, strict=True), key=itemgetter(0)):
        yield float(value), join_words([str(amount) for _, amount in group])


# %% [markdown]
# ## As a picture

# %%
PALEST, FULL_MARGIN = 0.25, 0.5
"""How much colour a cell has whose winner leads by nothing, and the lead from which it has all of it."""
NAME = "fidelity_map"


def fidelity_cells(axes: Axes, fidelity: FidelityMap) -> list[Artist]:
    """A cell for each reference and amount of data: coloured by who wins, stronger the further ahead; its error.

    Rows are the references of the main axis, the best at the bottom, labelled by their own error [m] and that over
    constant velocity's. Above the lines the hybrid is not better than the data alone.
    """
    main = fidelity.overall()
    errors_m = main.errors_m()
    ranked = np.sort(errors_m, axis=0)
    winner, lead = errors_m.argmin(axis=0), 1.0 - ranked[0] / ranked[1]
    artists: list[Artist] = []
    for row, column in np.ndindex(winner.shape):
        strength = PALEST + (1.0 - PALEST) * min(1.0, float(lead[row, column]) / FULL_MARGIN)
        colour = _paler(_colour(main, int(winner[row, column])), strength)
        background = _luminance(colour) + 0.05  # the ink stands out from it by the contrast ratio of WCAG 2.1
        inks = {text: abs(np.log((_luminance(to_rgb(text)) + 0.05) / background)) for text in (INK, "white")}
        ink = max(inks, key=inks.__getitem__)
        artists.append(axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1.0, 1.0, color=colour, linewidth=0)))
        axes.text(
            column,
            row,
            f"{ranked[0, row, column]:.2f}",
            ha="center",
            va="center",
            fontsize=8,
            color=ink,
        )
    columns, limits_m = np.arange(len(main.windows)), useful_up_to_m(main)
    limit, error = (np.log(np.maximum(values, LEAST_M)) for values in (limits_m, main.reference_m))
    heights = np.interp(limit, error, np.arange(len(main.reference_m)))
    heights = np.where(limits_m == 0.0, -0.5, heights)
    heights[np.isinf(limits_m)] = np.nan  # the hybrid is better on all of them
    limits = axes.hlines(heights, columns - 0.5, columns + 0.5, color=INK, linewidth=3.0, clip_on=False)
    artists.append(limits)
    _label_cells(axes, main)
    return artists


def _label_cells(axes: Axes, main: FidelityMap) -> None:
    references = [f"{error_m:.2f} m ({error_m / main.constant_velocity_m:.1f})" for error_m in main.reference_m]
    axes.set_xticks(range(len(main.windows)), [str(amount) for amount in main.windows])
    axes.set_yticks(range(len(references)), references)
    axes.set_xlim(-0.5, len(main.windows) - 0.5)
    axes.set_ylim(-0.5, len(references) - 0.5)
    axes.grid(visible=False)
    axes.set_xlabel("windows to learn from")
    axes.set_ylabel("the reference's own error [m] (times constant velocity's)")


def legend_handles(fidelity: FidelityMap) -> list[Patch | Line2D]:
    """What the colours and the line say; the numbers in the cells are the winner's error."""
    names = ["reference alone", "constant velocity", "data alone", f"hybrid ({fidelity.method})"]
    patches = [Patch(facecolor=_colour(fidelity, number), label=name) for number, name in enumerate(names)]
    if np.isinf(useful_up_to_m(fidelity)).all():
        return list(patches)
    return [*patches, Line2D([], [], color=INK, linewidth=2.0, label="above it no better than data alone")]


def _colour(fidelity: FidelityMap, number: int) -> str:
    """The colour of a rival; the calibrator has the hybrid's, whichever it is."""
    return COLOUR["hybrid"] if number == len(fidelity.rivals) - 1 else COLOUR[fidelity.rivals[number]]


def _luminance(colour: tuple[float, float, float]) -> float:
    """The relative luminance of an sRGB colour, its gamma taken as 2.2."""
    return float(np.dot(np.power(colour, 2.2), (0.2126, 0.7152, 0.0722)))


def _paler(colour: str, strength: float) -> tuple[float, float, float]:
    red, green, blue = (1.0 - strength * (1.0 - part) for part in to_rgb(colour))
    return red, green, blue


def draw_map(figure: Figure, fidelity: FidelityMap) -> None:
    """The map with its legend."""
    axes = figure.subplots()
    fidelity_cells(axes, fidelity)
    axes.set_title("Who predicts best, and the mean error that the best leaves [m]", loc="left")
    figure.legend(handles=legend_handles(fidelity), loc="outside lower center", ncols=3)


def draw_axes(figure: Figure, fidelity: FidelityMap) -> None:
    """The hybrid's error against the reference's own, whatever was degraded, for few and many windows."""
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    ends = [fidelity.reference_m.min(), fidelity.reference_m.max()]
    axes.plot(ends, ends, ":", color=INK, linewidth=1.0)
    for column, shade in _shades(fidelity).items():
        axes.axhline(fidelity.data_driven_m[column], color=_paler(COLOUR["data_driven"], shade), linewidth=1.0)
        for kind, marker in _markers(fidelity).items():
            rows = [number for number, axis in enumerate(fidelity.axis) if axis == kind]
            colour = _paler(COLOUR["hybrid"], shade)
            axes.plot(
                fidelity.reference_m[rows], fidelity.hybrid_m[rows, column], marker, color=colour, markersize=5
            )
    for axis in (axes.xaxis, axes.yaxis):
        label_ticks_in_plain_numbers(axis)
    axes.set_title("What the hybrid leaves, whatever is wrong with its reference", loc="left")
    axes.set_xlabel("the reference's own error [m]")
    axes.set_ylabel("the hybrid's error [m]")
    figure.legend(handles=_axes_handles(fidelity), loc="outside lower center", ncols=3)


def _axes_handles(fidelity: FidelityMap) -> list[Line2D]:
    called = {OVERALL: "all, step by step"}
    return [
        *(
            Line2D([], [], color=INK, marker=marker, linestyle="none", label=called.get(kind, kind))
            for kind, marker in _markers(fidelity).items()
        ),
        *(
            Line2D(
                [],
                [],
                color=_paler(COLOUR["hybrid"], shade),
                linewidth=4,
                label=f"{fidelity.windows[column]} windows",
            )
            for column, shade in _shades(fidelity).items()
        ),
        Line2D([], [], color=COLOUR["data_driven"], linewidth=1.0, label="data alone, as many windows"),
        Line2D([], [], color=INK, linewidth=1.0, linestyle=":", label="the reference alone"),
    ]


def _markers(fidelity: FidelityMap) -> dict[str, str]:
    return dict(zip(dict.fromkeys(fidelity.axis), "osD^", strict=False))


def _shades(fidelity: FidelityMap) -> dict[int, float]:
    """The columns shown, few windows, some and many, and how much of its colour each has."""
    columns = sorted({0, len(fidelity.windows) // 2, len(fidelity.windows) - 1})
    return dict(zip(columns, (0.35, 0.65, 1.0), strict=False))


def write_map(fidelity: FidelityMap, folder: Path) -> list[Path]:
    """The map as PNG, SVG and PDF, its numbers and its reading as JSON. Raises :class:`StorageError`."""
    path = folder / f"{NAME}.json"
    write_text(path, json.dumps(with_reading(fidelity), indent=2) + "\n")
    paths = [path]
    for name, (draw, size_inch, _) in zip((NAME, f"{NAME}_axes"), DRAWN, strict=True):
        figure = _filled(draw, fidelity, size_inch)
        paths += write_figure(figure, folder, name, ("png", "svg", "pdf"))
    return paths


Draw = Callable[[Figure, FidelityMap], None]


def _filled(draw: Draw, fidelity: FidelityMap, size_inch: tuple[float, float]) -> Figure:
    return fill_figure(lambda figure: draw(figure, fidelity), size_inch)


DRAWN: tuple[tuple[Draw, tuple[float, float], str], ...] = (
    (
        draw_map,
        (8.5, 5.6),
        "The method that errs least, by the quality of the reference and the number of windows.",
    ),
    (draw_axes, (8.5, 5.2), "The same with one thing of the model wrong at a time."),
)
"""The map's pictures: how each is drawn, its size and its caption."""


# %% [markdown]
# ## Results


# %%
def page_of(fidelity: FidelityMap, subtitle: str = "") -> Page:
    """What the map says and its pictures, as a page."""
    pictures = [
        embed_picture(png_of(_filled(draw, fidelity, size_inch)), words) for draw, size_inch, words in DRAWN
    ]
    sentences = [Markup("<p>{}</p>").format(sentence) for sentence in reading(fidelity)]
    title = "How bad may the reference be, and how much data does it save?"
    return render("base.html", title=title, subtitle=subtitle, body=Markup("").join([*sentences, *pictures]))


# %%
if __name__ == "__main__":  # in a notebook; `seatrial reproduce fidelity` calls the functions
    from IPython.display import display

    fidelity = papers_map(sea_state, method, seed, seeds, workers)
    write_map(fidelity, Path(folder))
    display(page_of(fidelity))
