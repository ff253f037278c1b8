"""Few causes that replicate: what a model lacks that errs by far more than the tolerance.

Such a model, as with a sister ship's coefficients, lacks many things at once, and by evidence alone effects would
be named without end, each with a narrow interval. So another question is asked: which few effects bring
predictions of unseen legs closest to the measured tracks, in metres? Effects are added one at a time. The sizes of
all are fitted together to the tracks of windows, by least squares with a pseudo-Huber loss (Hartley and Zisserman,
Multiple View Geometry, 2nd ed., 2004, appendix 6.8) and the priors and bounds of the catalogue. The effect that
brings held-out legs closest is added while its gain exceeds its own standard error over legs (Breiman et al.,
Classification and Regression Trees, 1984: the one-standard-error rule) and a share of the distance. After each
addition the weakest of the others may leave, or be exchanged.

Replication is the test, by complementary pairs of halves (Shah and Samworth 2013, J. R. Statist. Soc. B 75, 55).
The search is repeated from its beginning on each half that four quarters of the trial make, stretches of a
recording or groups of recordings. A cause is named if four of the six choose it, so that both of a pair do; if,
beside the others and in each pair, predictions of either half with the sizes fitted to the other are worth it; and
if its intervals meet in all pairs, unless it is of the sea, which changes. What falls short of that is a suspect.
One pair of halves alone would not do: a manoeuvre that shows a cause may fall into one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from seatrial.acquisition.core.errors import Progress, subtask_progress
from seatrial.acquisition.core.quantities import Bools, Floats, Ints
from seatrial.hybrid.diagnosis import gap
from seatrial.hybrid.diagnosis.acceptance import HELD_OUT_LEVEL, Coordinates, chance_of_gains
from seatrial.hybrid.diagnosis.witnesses import Witness, witnesses_of
from seatrial.hybrid.prediction.baselines import distances

MOST_CAUSES = 5
"""The most causes of one model: on measured trials of three ships none beyond the fourth replicated."""

WORTH = 0.03
"""The share of the mean distance on held-out legs by which a cause has to reduce it."""

FEWEST_UNITS = 4
"""The fewest legs, or blocks of a short trial, that a search can be held out on."""

WHOLE = "the whole"
"""The name of the whole trial among the parts in which an effect was found."""

QUARTERS = 4
_QUARTERS = ("first", "second", "third", "fourth")

MOST_HALVES = 0.6
"""The share of the halves that have to choose a cause: four of six, so that both halves of a pair do. What is in
one quarter only is in three. Without such a limit the halves of R/V Gunnerus' trial of 2019 would name four effects
each that predict the other, two of them others."""

_CONTRADICTION = 9.0  # in units of the variance of a meter: three standard deviations
_TRIED = 6  # effects that are simulated in a step, by the linear gain
_EXCHANGES, _REFINED, _ALTERNATIVES = 3, 2, 3
_AT_BOUND = 1e-3  # of a typical size
_FAR = (-4.0, -2.0, 2.0, 4.0)  # typical sizes at which each effect is simulated, where slopes say little
_LOOSE = 2.0  # on the typical sizes: a sister ship's coefficients differ by more than one ship's do in time
_STEP = 0.05  # of an effect's typical size: a prediction has no noise
_ROUNDS, _SHORTEST, _ENOUGH = 4, 1.0 / 8.0, 3e-3
_LEAST_MEASURED = 0.5  # of the seconds of a window
_FEW_LEGS = 8  # below this, blocks are held out: a standard error over fewer means little


@dataclass(frozen=True, slots=True)
class CauseFit:
    """Causes with their sizes: free coordinates ``at``, their ``covariance`` [K, K] in the order of the names.

    The covariance is that of the scatter over legs (White 1980), widened by Student's factor for their number, so
    that 1.96 of its standard errors hold 95 %. ``off_m`` [units] is the mean distance on each held-out leg,
    ``fold`` [N] that of each window and ``without`` the sizes fitted without each fold.
    """

    names: tuple[str, ...]
    at: Coordinates
    covariance: Floats
    off_m: Floats
    fold: Ints
    without: Mapping[int, Coordinates]

    def mean_m(self) -> float:
        """The mean distance over held-out units [m]."""
        return float(self.off_m.mean())

    def rows_of(self, name: str) -> list[int]:
        """The rows of the covariance of one of the causes."""
        sizes = [len(self.at[cause]) for cause in self.names]
        first = sum(sizes[: self.names.index(name)])
        return list(range(first, first + len(self.at[name])))

    def agrees_with(self, other: CauseFit, name: str) -> bool:
        """Whether the 95 % intervals of a cause meet those of another fit in each coordinate."""
        reach = sum(1.96 * np.sqrt(np.diag(fit.covariance)[fit.rows_of(name)]) for fit in (self, other))
        return bool((np.abs(np.subtract(self.at[name], other.at[name])) <= reach).all())


@dataclass(frozen=True, slots=True)
class FewCauses:
    """The causes that replicate, and where others were found.

    ``fit`` has those that are named, ``chosen`` what the whole chooses; ``found_in`` the halves in which each
    effect was chosen, of ``halves``; ``p_values`` the chance of each named one's gain; ``rivals`` the effects that
    predict as well in a cause's place, with the mean distance [m].
    """

    fit: CauseFit
    chosen: CauseFit
    halves: tuple[str, ...]
    found_in: Mapping[str, tuple[str, ...]]
    p_values: Mapping[str, float]
    rivals: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class TrackEquations:
    """Errors of the tracks of windows as normal equations by unit, linear about effects ``at`` some sizes.

    ``effect`` [K] is that of each column, ``prior`` [K] the standard deviation of each coordinate; ``gram`` [units,
    1 + K, 1 + K] holds the inner products of the error without any effect, and of its derivatives by the
    coordinates, weighted by the loss and in units of the error's mean square. ``witness`` [1 + K, 1 + K] holds
    those of what meters say besides (:mod:`.witnesses`).
    """

    windows: gap.UnseenWindows
    at: Coordinates
    effect: tuple[str, ...]
    prior: Floats
    gram: Floats
    witness: Floats

    @cached_property
    def summed_gram(self) -> Floats:
        """The sum over all units."""
        return np.asarray(self.gram.sum(axis=0))

    def columns_of(self, names: Sequence[str]) -> Ints:
        """The columns of ``names``, in their order."""
        return np.array([1 + k for name in names for k, own in enumerate(self.effect) if own == name], dtype=int)

    def most_likely_sizes(self, names: Sequence[str], gram: Floats | None = None) -> Coordinates:
        """The most likely sizes within bounds, by some of the units' ``gram``; by default by all."""
        columns = self.columns_of(names)
        form = (self.summed_gram if gram is None else gram) + self.witness
        values = iter(
            -np.linalg.solve(form[np.ix_(columns, columns)] + self._prior_information(columns), form[columns, 0])
        )
        widths = {name: self.effect.count(name) for name in names}
        return self.windows.model.nearest_within_bounds(
            {name: tuple(float(next(values)) for _ in range(width)) for name, width in widths.items()}
        )

    def remaining_squares(self, names: Sequence[str]) -> float:
        """The sum of weighted squares that is left with ``names`` at their most likely sizes, and their prior."""
        columns, form = self.columns_of(names), self.summed_gram + self.witness
        right = form[columns, 0]
        information = form[np.ix_(columns, columns)] + self._prior_information(columns)
        return float(form[0, 0] - right @ np.linalg.solve(information, right))

    def _prior_information(self, columns: Ints) -> Floats:
        """The information of the priors of some columns."""
        return np.diag(self.prior[columns - 1] ** -2.0)

    def covariance(self, names: Sequence[str], at: Coordinates) -> Floats:
        """The covariance of the sizes ``at`` by the scatter of the scores over units, widened as Student's t."""
        columns = self.columns_of(names)
        values = np.concatenate([at[name] for name in names])
        penalty = self._prior_information(columns) + self.witness[np.ix_(columns, columns)]
        inverse = np.linalg.inv(self.summed_gram[np.ix_(columns, columns)] + penalty)
        products = self.gram[:, columns[:, None], columns]
        scores = self.gram[:, columns, 0] + products @ values
        count = len(scores)
        scatter = scores.T @ scores * count / max(count - 1, 1)
        # a coordinate that shows in few units has so many degrees of freedom (Satterthwaite 1946)
        share = np.diagonal(products, axis1=1, axis2=2)
        freedom = np.maximum(share.sum(axis=0) ** 2 / np.maximum((share**2).sum(axis=0), 1e-300) - 1.0, 1.0)
        factor = student.ppf(0.975, freedom) / 1.96
        return np.asarray(np.outer(factor, factor) * (inverse @ (scatter + penalty) @ inverse))


@dataclass(frozen=True)
class CauseSearch:
    """The search for few causes over some windows of a trial.

    ``unit`` [N] numbers the legs, or blocks, that windows are judged by; ``fold`` [N] is the fold each is held out
    with; ``compatible`` tells whether effects can be present together. A part of a trial is searched with
    ``whole``, the search of all its windows, and the mask of its own among them: both begin with the same
    simulations.
    """

    windows: gap.UnseenWindows
    unit: Ints
    fold: Ints
    compatible: Callable[[Sequence[str]], bool]
    whole: tuple[CauseSearch, Bools] | None = None
    _errors: dict[tuple[tuple[str, tuple[float, ...]], ...], Floats] = field(default_factory=dict, repr=False)

    def search(self, preferred: Sequence[str] = (), progress: Progress = lambda share: None) -> CauseFit:
        """The causes that predict held-out units best.

        A ``preferred`` effect is taken unless another predicts better by more than the error.
        """
        best = self.fit_of((), {})
        for number in range(MOST_CAUSES):
            progress(number / MOST_CAUSES)
            equations = self.linear_equations(best.at, self.effect_names)
            best = self._drop_or_exchange_cause(best, equations, preferred)
            tried = self._fits_with_another_cause(best, equations, preferred)
            if not tried:
                return best
            closest = min(tried, key=CauseFit.mean_m)
            wanted = [fit for fit in tried if fit.names[-1] in preferred]
            alike = [fit for fit in wanted if not exceeds_error(fit.off_m, closest.off_m)]
            extended = min(alike, key=CauseFit.mean_m, default=closest)
            if not is_worth(best.off_m, extended.off_m):
                return best
            best = extended
        return self._drop_or_exchange_cause(best, self.linear_equations(best.at, self.effect_names), preferred)

    def without_needless(self, fit: CauseFit) -> tuple[CauseFit, dict[str, CauseFit]]:
        """The causes of a fit that are worth their place beside the others and whose gain is hardly chance, the
        least missed taken out in turn; and by cause the fit that lacks it alone."""
        while True:
            lacking = {name: self.fit_of(_without_name(fit.names, name), fit.at) for name in fit.names}
            needless = [fewer for fewer in lacking.values() if not is_surely_worth(fewer.off_m, fit.off_m)]
            if not needless:
                return fit, lacking
            fit = min(needless, key=CauseFit.mean_m)

    @property
    def effect_names(self) -> tuple[str, ...]:
        """The names of all effects."""
        return tuple(self.windows.model.catalogue)

    @cached_property
    def has_position(self) -> Bools:
        """Mask [N, H] of the seconds with a position, of windows in which half of them have one: outliers that were
        rejected leave gaps, most of them where the ship manoeuvres."""
        measured = np.isfinite(self.windows.measured[:, 1:, :2]).all(axis=2)
        return np.asarray(measured & (measured.mean(axis=1) >= _LEAST_MEASURED)[:, None])

    def fit_of(self, names: tuple[str, ...], start: Coordinates) -> CauseFit:
        """Causes with their sizes, and the distances on held-out units with the sizes of the others."""
        at = self._most_likely(names, start)
        return self._cross_validated(names, self.linear_equations(at, names), at)

    def best_fits(self, sets: Sequence[tuple[str, ...]], at: Coordinates, number: int) -> list[CauseFit]:
        """The fits of those of some sets that predict best by the sizes linear about ``at``, the best first."""
        equations = self.linear_equations(at, tuple(dict.fromkeys(name for names in sets for name in names)))
        linear = self._by_linear_sizes(equations, sets)[:number]
        return sorted((self.fit_of(fit.names, fit.at) for fit in linear), key=CauseFit.mean_m)

    def _by_linear_sizes(self, equations: TrackEquations, sets: Sequence[tuple[str, ...]]) -> list[CauseFit]:
        """Sets of causes with their sizes linear about those of the equations, the best first."""
        linear = (self._cross_validated(names, equations, equations.most_likely_sizes(names)) for names in sets)
        return sorted(linear, key=CauseFit.mean_m)

    def _cross_validated(self, names: tuple[str, ...], equations: TrackEquations, at: Coordinates) -> CauseFit:
        """The same about any linearisation: each fold is predicted with the sizes that the others' have there."""
        without = dict[int, Coordinates]()
        if not names:
            return CauseFit((), {}, np.zeros((0, 0)), self.by_unit(self.off_m()), self.fold, {})
        for fold in np.unique(self.fold).tolist():
            others = ~np.isin(np.arange(len(equations.gram)), self.unit[self.fold == fold])
            without[fold] = equations.most_likely_sizes(names, equations.gram[others].sum(axis=0))
        off_m = self.off_m([(self.fold == fold, sizes) for fold, sizes in without.items()])
        return CauseFit(names, at, equations.covariance(names, at), self.by_unit(off_m), self.fold, without)

    def off_m(self, sizes: Sequence[tuple[Bools, Coordinates]] = ()) -> Floats:
        """The mean distance of each window [N] with the sizes given for some, or of the model as it is."""
        windows = self.windows
        off_m = self._mean_over_seconds(distances(windows.before, windows.measured))
        for mine, at in sizes:
            predicted_m = self._mean_over_seconds(
                distances(windows.predict_tracks(at, mine), windows.measured[mine]), mine
            )
            off_m[mine] = np.where(np.isfinite(predicted_m), predicted_m, off_m[mine])
        return off_m

    def _mean_over_seconds(self, values: Floats, mine: Bools | slice = slice(None)) -> Floats:
        """The mean over the measured seconds of windows [N, H]; NaN where there are too few."""
        measured = self.has_position[mine]
        count = measured.sum(axis=1)
        total = np.where(measured, values, 0.0).sum(axis=1)
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))

    def rivals_by_cause(self, fit: CauseFit, lacking: Mapping[str, CauseFit]) -> dict[str, dict[str, float]]:
        """By cause, the effects that predict as well in its place, with the mean distance [m]; ``lacking`` are the
        fits without each."""
        equations, rivals = self.linear_equations(fit.at, self.effect_names), dict[str, dict[str, float]]()
        for name, fewer in lacking.items():
            sets = [(*fewer.names, other) for other in self._effects_outside(fit.names)]
            rivals[name] = {
                swapped.names[-1]: swapped.mean_m()
                for swapped in self._fit_best_sets(equations, self._sets_by_misfit(equations, sets)[:_TRIED])
                if is_worth(fewer.off_m, swapped.off_m)
                and not exceeds_error(swapped.off_m, fit.off_m)
                and not self._contradicts_meters(swapped.at, fit.at)
            }
        return rivals

    def linear_equations(self, at: Coordinates, names: Sequence[str]) -> TrackEquations:
        """The errors with effects ``at`` some sizes, and their derivatives by the coordinates of ``names``."""
        windows, catalogue = self.windows, self.windows.model.catalogue
        error = self._position_errors_m(at)
        widths = {name: len(catalogue[name].free_scale) for name in names}
        columns = np.stack(self._error_and_slopes(at, widths, error, self._position_errors_m), axis=-1)
        square = self._mean_over_seconds((error**2).sum(axis=2))
        usable = np.isfinite(square) & np.isfinite(columns).all(axis=(1, 2, 3))
        weight = pseudo_huber_weight(square)
        mean_square = (weight * square)[usable].sum() / weight[usable].sum()
        gram = np.zeros((int(self.unit.max()) + 1, columns.shape[-1], columns.shape[-1]))
        for unit in range(len(gram)):
            chosen = usable & (self.unit == unit)
            mine = (columns[chosen] * np.sqrt(weight[chosen])[:, None, None, None]).reshape(-1, columns.shape[-1])
            gram[unit] = 2.0 * mine.T @ mine / (gap.HORIZON_S * mean_square)
        prior = np.array([_LOOSE * scale for name in names for scale in catalogue[name].free_scale])
        effect = tuple(name for name, width in widths.items() for _ in range(width))
        witness = np.zeros(gram.shape[1:])
        for meter in self.witnesses:
            witness += meter.inner_products(
                self._error_and_slopes(at, widths, meter.standardised_error(at), meter.standardised_error)
            )
        return TrackEquations(windows, at, effect, prior, gram, witness)

    def _error_and_slopes(
        self,
        at: Coordinates,
        widths: Mapping[str, int],
        error: Floats,
        error_at: Callable[[Coordinates], Floats],
    ) -> list[Floats]:
        """The error that ``error_at`` gives without any effect, to first order, and its derivatives by each of
        ``widths`` coordinates of the effects; ``error`` is that at the sizes ``at``."""
        slopes = [
            self._error_derivative(at, error, name, number, error_at)
            for name, width in widths.items()
            for number in range(width)
        ]
        sizes = [size for name, width in widths.items() for size in at.get(name, (0.0,) * width)]
        bare = error - sum((size * slope for size, slope in zip(sizes, slopes, strict=True)), np.zeros_like(error))
        return [bare, *slopes]

    @cached_property
    def witnesses(self) -> tuple[Witness, ...]:
        """What meters say over these windows."""
        windows = self.windows
        return witnesses_of(windows.log, windows.model, windows.starts[:, None] + np.arange(gap.HORIZON_S))

    def _position_errors_m(self, at: Coordinates) -> Floats:
        """Predicted less measured positions [N, H, 2], 0 where none was measured."""
        key = tuple(at.items())
        if self.whole is not None and key in self.whole[0]._errors:
            return self.whole[0]._errors[key][self.whole[1]]
        error = (self.windows.predict_tracks(at) - self.windows.measured)[:, 1:, :2]
        error = np.where(self.has_position[..., None], error, 0.0)
        if self.whole is None and len(at) <= 1:
            self._errors[key] = error
        return error

    def _error_derivative(
        self,
        at: Coordinates,
        error: Floats,
        name: str,
        number: int,
        error_at: Callable[[Coordinates], Floats],
    ) -> Floats:
        """The derivative of what ``error_at`` gives by a coordinate, about ``error``, to the side within bounds."""
        model = self.windows.model
        typical = model.catalogue[name].free_scale
        free = at.get(name, (0.0,) * len(typical))
        for side in (1.0, -1.0):
            moved = tuple(size + side * _STEP * typical[number] * (k == number) for k, size in enumerate(free))
            moved_at = model.nearest_within_bounds({**at, name: moved})
            apart = moved_at[name][number] - free[number]
            if abs(apart) > 0.5 * _STEP * typical[number]:
                return (error_at(moved_at) - error) / apart
        return np.zeros_like(error)

    def _most_likely(self, names: tuple[str, ...], start: Coordinates) -> Coordinates:
        """The sizes of least loss and prior, by damped Gauss-Newton steps from ``start``.

        The loss is in squares of the median distance about the sizes of each step: with that of the start, the
        prior would weigh the more the further that is.
        """
        catalogue, model = self.windows.model.catalogue, self.windows.model
        at = model.nearest_within_bounds(
            {name: start.get(name, (0.0,) * len(catalogue[name].free_scale)) for name in names}
        )
        for _ in range(_ROUNDS):
            scale = float(np.nanmedian(self._mean_squares_m2(at)))
            cost = self._cost(at, scale)
            target, share = self.linear_equations(at, names).most_likely_sizes(names), 1.0
            while share >= _SHORTEST:
                between = {
                    name: tuple((1.0 - share) * a + share * b for a, b in zip(at[name], target[name], strict=True))
                    for name in names
                }
                lower = self._cost(model.nearest_within_bounds(between), scale)
                if lower < cost:
                    break
                share *= 0.5
            else:
                break
            at = model.nearest_within_bounds(between)
            if cost - lower < _ENOUGH * cost:
                break
        return at

    def _mean_squares_m2(self, at: Coordinates) -> Floats:
        """The mean square distance of each window, that of the model without effects where one leaves its range."""
        square = self._mean_over_seconds((self._position_errors_m(at) ** 2).sum(axis=2))
        usual = self._mean_over_seconds(((self.windows.before - self.windows.measured)[:, 1:, :2] ** 2).sum(axis=2))
        return np.asarray(np.where(np.isfinite(square), square, 4.0 * usual))

    def _cost(self, at: Coordinates, scale: float) -> float:
        """The pseudo-Huber loss of the windows and the prior of the sizes, in squares of the scale."""
        loss = 2.0 * (np.sqrt(1.0 + self._mean_squares_m2(at) / scale) - 1.0)
        catalogue = self.windows.model.catalogue
        prior = sum(
            float(np.square(np.divide(free, catalogue[name].free_scale)).sum()) for name, free in at.items()
        )
        return float(np.nansum(loss)) + prior + self._chi_squared_of_witnesses(at)

    def _chi_squared_of_witnesses(self, at: Coordinates) -> float:
        """The squares by which meters differ from the model, in units of their variance."""
        return sum(float(meter.inner_products([meter.standardised_error(at)])[0, 0]) for meter in self.witnesses)

    def _contradicts_meters(self, at: Coordinates, than: Coordinates) -> bool:
        """Whether a meter speaks against some sizes by three standard deviations more than against others."""
        return self._chi_squared_of_witnesses(at) > self._chi_squared_of_witnesses(than) + _CONTRADICTION

    def by_unit(self, off_m: Floats) -> Floats:
        """The mean over the windows of each unit that has any."""
        finite = np.isfinite(off_m)
        count = np.bincount(self.unit[finite])
        return np.asarray(np.bincount(self.unit[finite], off_m[finite])[count > 0] / count[count > 0])

    def _effects_outside(self, names: Sequence[str]) -> Iterator[str]:
        return (name for name in self.windows.model.catalogue if name not in names)

    def _sets_by_misfit(self, equations: TrackEquations, sets: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
        """The sets of effects that can be present together, the least linear misfit first."""
        return sorted(filter(self.compatible, sets), key=equations.remaining_squares)

    def _fits_with_another_cause(
        self, best: CauseFit, equations: TrackEquations, preferred: Sequence[str]
    ) -> list[CauseFit]:
        """The causes with one more, fitted: the likeliest by the linear misfit, and the ``preferred``."""
        sets = self._sets_by_misfit(equations, [(*best.names, name) for name in self._effects_outside(best.names)])
        wanted = [names for names in sets[_TRIED:] if names[-1] in preferred]
        fits = self._fit_best_sets(equations, [*sets[:_TRIED], *wanted], preferred)
        if not best.names:  # where errors are large, the slope at zero says little of an effect far from it
            far, scale = list(self._far_starts(sets)), float(np.nanmedian(self._mean_squares_m2({})))
            fits.append(self.fit_of(*min(far, key=lambda start: self._cost(start[1], scale))))
        return [fit for fit in fits if not self.is_impossible(fit.at, best.at)]

    def is_impossible(self, at: Coordinates, than: Coordinates) -> bool:
        """Whether a size is at the end of its range, or a meter speaks more against it than against
        others."""
        return self._at_a_bound(at) or self._contradicts_meters(at, than)

    def _fit_best_sets(
        self, equations: TrackEquations, cause_sets: Sequence[tuple[str, ...]], preferred: Sequence[str] = ()
    ) -> list[CauseFit]:
        """Fits of those of some sets of causes that predict best by the linear sizes, and of those whose last cause
        is ``preferred``."""
        refined = list[CauseFit]()
        for fit in self._by_linear_sizes(equations, cause_sets):
            if len(refined) < _REFINED or fit.names[-1] in preferred:
                closer = self.fit_of(fit.names, fit.at)
                refined += [] if self._at_a_bound(closer.at) else [closer]
        return refined

    def _at_a_bound(self, at: Coordinates) -> bool:
        """Whether a size has reached the end of its range: it is not the size of a cause, then."""
        catalogue, model = self.windows.model.catalogue, self.windows.model
        for name, free in at.items():
            for number, typical in enumerate(catalogue[name].free_scale):
                step = np.copysign(_AT_BOUND * typical, free[number])
                beyond = tuple(size + step * (k == number) for k, size in enumerate(free))
                if abs(model.nearest_within_bounds({name: beyond})[name][number] - free[number]) < 0.5 * abs(step):
                    return True
        return False

    def _far_starts(self, sets: Sequence[tuple[str, ...]]) -> Iterator[tuple[tuple[str, ...], Coordinates]]:
        """Each single effect at sizes far from none."""
        for (name,) in sets:
            typical = self.windows.model.catalogue[name].free_scale
            for number in range(len(typical)):
                for times in _FAR:
                    free = tuple(times * size * (k == number) for k, size in enumerate(typical))
                    yield (name,), self.windows.model.nearest_within_bounds({name: free})

    def _drop_or_exchange_cause(
        self, fit: CauseFit, equations: TrackEquations, preferred: Sequence[str]
    ) -> CauseFit:
        """The causes without one that the last has made needless, or with one exchanged for a better one."""
        earlier = [name for name in fit.names[:-1] if name not in preferred]
        if not earlier:
            return fit
        fewer = [_without_name(fit.names, name) for name in earlier]
        lacking = self.fit_of(self._sets_by_misfit(equations, fewer)[0], fit.at)
        if not is_worth(lacking.off_m, fit.off_m):
            return lacking
        swaps = [
            tuple(other if cause == name else cause for cause in fit.names)
            for name in earlier
            for other in self._effects_outside(fit.names)
        ]
        tried = self._fit_best_sets(equations, self._sets_by_misfit(equations, swaps)[:_EXCHANGES])
        tried = [swapped for swapped in tried if not self._contradicts_meters(swapped.at, fit.at)]
        closest = min(tried, key=CauseFit.mean_m, default=fit)
        return closest if exceeds_error(fit.off_m, closest.off_m) else fit


def _without_name(names: Sequence[str], name: str) -> tuple[str, ...]:
    return tuple(other for other in names if other != name)


def chance_of_closer(without_m: Floats, with_m: Floats) -> float:
    """The chance of such distances by unit if the second are not really smaller.

    The test is of their ratios: what a unit gains or loses by chance grows with its distance, and differences would
    be dominated by the unit with the largest error (Box and Cox 1964, J. R. Statist. Soc. B 26, 211: the logarithm
    stabilises the variance of errors in proportion to the value).
    """
    return chance_of_gains(np.log(without_m / with_m))


def pseudo_huber_weight(square: Floats) -> Floats:
    """The weight of each window [N] by its mean square distance: half at some 1.7 times the median's root."""
    return np.asarray(1.0 / np.sqrt(1.0 + square / np.nanmedian(square)))


def is_worth(without_m: Floats, with_m: Floats) -> bool:
    """Whether a cause reduces the distance by more than its standard error over units, and by enough."""
    gain_m = float((without_m - with_m).mean())
    return exceeds_error(without_m, with_m) and gain_m > WORTH * float(without_m.mean())


def is_surely_worth(without_m: Floats, with_m: Floats) -> bool:
    """Whether a cause is worth its place, and its gain on held-out units is hardly chance."""
    return is_worth(without_m, with_m) and chance_of_closer(without_m, with_m) < HELD_OUT_LEVEL


def exceeds_error(without_m: Floats, with_m: Floats) -> bool:
    """Whether the second of two distances by unit is smaller by more than the standard error of the difference."""
    gains_m = without_m - with_m
    return bool(gains_m.mean() > gains_m.std(ddof=1) / np.sqrt(len(gains_m)))


def find_few_causes(
    windows: gap.UnseenWindows,
    compatible: Callable[[Sequence[str]], bool],
    progress: Progress = lambda share: None,
) -> FewCauses:
    """The causes that the whole trial and most of its halves choose, with sizes from the whole.

    A trial too short to be parted names none.
    """
    search, halves = search_of(windows, compatible), halves_of(windows)
    chosen = search.search(progress=subtask_progress(progress, 0, 1 + len(halves)))
    parts = [replace(search_of(windows.subset(mine), compatible), whole=(search, mine)) for mine in halves.values()]
    choices = [
        part.search(chosen.names, subtask_progress(progress, number, 1 + len(parts)))
        for number, part in enumerate(parts, 1)
    ]
    counts = {name: sum(name in choice.names for choice in choices) for name in chosen.names}
    names = tuple(name for name in chosen.names if counts[name] >= MOST_HALVES * len(choices) > 0)
    everything = dict.fromkeys(name for choice in (chosen, *choices) for name in choice.names)
    pairs = list(zip(parts, halves.values(), strict=True))
    names = replicating_causes(search, pairs, names, chosen.at)
    names = with_alternatives(search, pairs, choices, names, chosen.at)
    fit, lacking = search.without_needless(search.fit_of(names, chosen.at))
    return FewCauses(
        fit, chosen, tuple(halves),
        {name: tuple(label for label, choice in zip(halves, choices, strict=True) if name in choice.names)
         for name in everything},
        {name: chance_of_closer(fewer.off_m, fit.off_m) for name, fewer in lacking.items()},
        search.rivals_by_cause(fit, lacking),
    )  # fmt: skip


def with_alternatives(
    search: CauseSearch,
    halves: Sequence[tuple[CauseSearch, Bools]],
    choices: Sequence[CauseFit],
    names: tuple[str, ...],
    start: Coordinates,
) -> tuple[str, ...]:
    """The named causes, and those of which most halves chose one or another that predicts alike.

    Alternatives are effects that bring the whole equally close beside the named causes. A half speaks for one of
    them where it chose one or another, and is predicted by this one as well as by any; which of them it is, the
    rivals say.
    """
    found = dict.fromkeys(name for choice in choices for name in choice.names)
    while len(names) < MOST_CAUSES:
        best = search.fit_of(names, start)
        sets = [(*names, name) for name in found if name not in names and search.compatible((*names, name))]
        worth = [
            fit
            for fit in search.best_fits(sets, best.at, _ALTERNATIVES)
            if is_surely_worth(best.off_m, fit.off_m) and not search.is_impossible(fit.at, best.at)
        ]
        alike = [fit for fit in worth if not exceeds_error(fit.off_m, worth[0].off_m)]
        speaking = dict.fromkeys((fit.names for fit in alike), 0)
        for (part, _), choice in zip(halves, choices, strict=True):
            if not any(fit.names[-1] in choice.names for fit in alike):
                continue
            own = [part.fit_of(fit.names, fit.at) for fit in alike]
            closest = min(own, key=CauseFit.mean_m)
            for fit in own:
                speaking[fit.names] += not exceeds_error(fit.off_m, closest.off_m)
        for fit in alike:
            enough = speaking[fit.names] >= MOST_HALVES * len(halves)
            if enough and replicating_causes(search, halves, fit.names, fit.at) == fit.names:
                names = fit.names
                break
        else:
            return names
    return names


def replicating_causes(
    search: CauseSearch, halves: Sequence[tuple[CauseSearch, Bools]], names: tuple[str, ...], start: Coordinates
) -> tuple[str, ...]:
    """The causes with which, in each pair of halves, either is predicted closer by the sizes fitted to the other,
    and whose intervals meet, all beside the others.

    ``halves`` are searches with the windows of each [N], complementary ones in turn.
    """
    pairs = list(zip(halves[::2], halves[1::2], strict=True))

    def fits_of(names: tuple[str, ...]) -> list[tuple[CauseFit, CauseFit]]:
        return [(one.fit_of(names, start), other.fit_of(names, start)) for (one, _), (other, _) in pairs]

    def crossed_m(fits: Sequence[tuple[CauseFit, CauseFit]]) -> list[Floats]:
        return [
            search.by_unit(search.off_m([(rows, of_others.at), (other_rows, fit.at)]))
            for (fit, of_others), ((_, rows), (_, other_rows)) in zip(fits, pairs, strict=True)
        ]

    if not names:
        return ()
    catalogue, fits = search.windows.model.catalogue, fits_of(names)
    with_all_m, replicating = crossed_m(fits), list[str]()
    for name in names:
        lacking_m = crossed_m(fits_of(_without_name(names, name)))
        is_worth_all = all(is_worth(fewer, all_) for fewer, all_ in zip(lacking_m, with_all_m, strict=True))
        may_vary = catalogue[name].scope == "day"  # as a tidal current and a sea do
        if is_worth_all and (may_vary or all(fit.agrees_with(other, name) for fit, other in fits)):
            replicating.append(name)
    return tuple(replicating)


def search_of(windows: gap.UnseenWindows, compatible: Callable[[Sequence[str]], bool]) -> CauseSearch:
    """The search over legs, or over blocks where there are few legs, in four folds of consecutive ones."""
    log, first = windows.log, windows.starts
    leg, block = (np.unique(number[first], return_inverse=True)[1] for number in (log.leg, log.block))
    unit = leg if leg.max() + 1 >= _FEW_LEGS else block
    return CauseSearch(windows, unit, unit * FEWEST_UNITS // (int(unit.max()) + 1), compatible)


def halves_of(windows: gap.UnseenWindows) -> dict[str, Bools]:
    """Masks [N] of the halves that four quarters make, by name, complementary ones in turn; none of short trials.

    The quarters are stretches of a recording, or with four recordings and more every fourth of them.
    """
    log, recordings = windows.log, windows.log.recording[windows.starts]
    number = np.unique(recordings, return_inverse=True)[1]
    block = np.unique(log.block[windows.starts], return_inverse=True)[1]
    several = int(number.max()) + 1 >= QUARTERS
    quarter = number % QUARTERS if several else block * QUARTERS // (int(block.max()) + 1)
    halves = dict[str, Bools]()
    for first in ((0, 1), (0, 2), (0, 3)):
        for members in (first, tuple(sorted(set(range(QUARTERS)) - set(first)))):
            mine = np.isin(quarter, members)
            words = [
                ", ".join(Path(log.names[index]).name for index in np.unique(recordings[quarter == member]))
                if several else _QUARTERS[member]
                for member in members
            ]  # fmt: skip
            halves[", ".join(words) if several else f"the {' and '.join(words)} quarter"] = mine
    counts = [np.unique(block[mine]).size for mine in halves.values()]
    return halves if min(counts) >= FEWEST_UNITS else {}
