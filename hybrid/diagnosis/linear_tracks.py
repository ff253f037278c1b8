"""Predicted tracks that are linear in the sizes of effects: sets of effects judged on legs left out.

A simulation of a trial's windows takes a tenth of a second. About a model that predicts well already, what an
effect does to a predicted track is its size times a slope, and a set is judged in a thousandth.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquisition.core.arrays import Floats, Ints
from hybrid.diagnosis.evidence import Evidence, evidence_of
from hybrid.diagnosis.gap import UnseenWindows, fold_of
from hybrid.diagnosis.select_effects import Coordinates

DEALS = (2, 3, 4)
"""Into so many folds the legs are dealt, one deal after the other: one deal has a best set of its own."""

_STEP = 0.2  # of an effect's ordinary size
_FAR = 1e9  # beyond any bounds, in any unit


@dataclass(frozen=True, slots=True)
class _Fold:
    """n windows of some legs, and what the other legs say.

    ``inner`` [1+P, 1+P] are the products of :class:`.Evidence` of the other legs; ``off`` [n, 2, H] is the
    predicted track less the measured one about the sizes that it is linear about [m], ``slope`` [n, 2, H, P] how it
    changes with each free coordinate; ``leg`` [n] numbers the legs that have windows.
    """

    inner: Floats
    off: Floats
    slope: Floats
    leg: Ints

    def off_m(self, by: Floats) -> Floats:
        """The mean distance of each window [n] where the sizes are others ``by`` so much [P]."""
        track = self.off + self.slope @ by
        return np.asarray(np.hypot(track[:, 0], track[:, 1]).mean(axis=1))


@dataclass(frozen=True, slots=True)
class LinearTracks:
    """Sets of effects judged by tracks on legs left out, linear about the sizes ``at`` [P].

    ``low`` and ``high`` [P] are the bounds of the free coordinates; ``folds`` those of all :data:`DEALS`.
    """

    evidence: Evidence
    at: Floats
    low: Floats
    high: Floats
    folds: tuple[_Fold, ...]

    def by_leg_m(self, names: Sequence[str]) -> Floats:
        """The mean distance of what is predicted with ``names``, at the sizes that other legs give [legs]."""
        columns = np.array(self.evidence.columns(names), dtype=int)
        precision = np.diag(self.evidence.prior(names) ** -2.0)
        low, high = self.low[columns - 1], self.high[columns - 1]
        off_m, legs = [], np.concatenate([fold.leg for fold in self.folds])
        for fold in self.folds:
            by = -self.at
            information = fold.inner[np.ix_(columns, columns)] + precision
            by[columns - 1] += _within(information, fold.inner[columns, 0], low, high)
            off_m.append(fold.off_m(by))
        return np.bincount(legs, np.concatenate(off_m)) / np.bincount(legs)

    def best_set(self, names: tuple[str, ...], worth: float, most: int, barred: Collection[str]) -> tuple[str, ...]:
        """At most so many effects from which no step leads to less, each paying its ``worth`` [1] of the distance.

        A step drops one of ``names``, or adds one that is not ``barred``.
        """

        def price(some: tuple[str, ...]) -> float:
            return float(np.log(self.by_leg_m(some).mean())) + worth * len(some)

        best = price(names)
        while True:
            steps = [tuple(other for other in names if other != name) for name in names]
            if len(names) < most:
                more = [(*names, name) for name in self.evidence.names if name not in (*names, *barred)]
                steps += filter(self.evidence.compatible, more)
            found = min(((price(some), some) for some in steps), default=(np.inf, names))
            if found[0] >= best and len(names) <= most:
                return names
            best, names = found


def _within(information: Floats, right: Floats, low: Floats, high: Floats) -> Floats:
    """The likeliest sizes within bounds; beside those at their bounds the others are fitted anew."""
    sizes, free = np.zeros(len(right)), np.ones(len(right), dtype=np.bool_)
    while True:
        known = right[free] - information[np.ix_(free, ~free)] @ sizes[~free]
        sizes[free] = np.linalg.solve(information[np.ix_(free, free)], known)
        beyond = free & ((sizes < low) | (sizes > high))
        if not beyond.any():
            return sizes
        sizes = np.clip(sizes, low, high)
        free &= ~beyond


def linear_tracks(windows: UnseenWindows, evidence: Evidence) -> LinearTracks:
    """The tracks over ``windows`` about the sizes that ``evidence`` is linear about."""
    equations = evidence.equations
    model, layout = equations.model, equations.layout
    track, steps = windows.predicted(model.at), list(_coordinates(evidence))
    slope = np.stack([_slope(windows, evidence, *each) for each in steps], axis=-1)
    off = (track - windows.measured)[:, 1:, :2]
    known = np.asarray(np.isfinite(off).all(axis=(1, 2)) & np.isfinite(slope).all(axis=(1, 2, 3)))
    off, slope = np.swapaxes(off, 1, 2), np.swapaxes(slope, 1, 2)
    number = np.full(len(known), -1)
    number[known] = np.unique(windows.log.leg[windows.starts[known]], return_inverse=True)[1]
    at = np.zeros(len(layout.effect))
    for name, free in model.at.items():
        at[np.array(layout.of(name)) - 1] = free
    ends = [_moved(evidence, *each, side * _FAR)[each[0]][each[1]] for side in (-1.0, 1.0) for each in steps]
    low, high = np.sort(np.array(ends).reshape(2, -1), axis=0)

    def folds() -> Iterator[_Fold]:
        for fold in (fold_of(windows.log, deal) for deal in DEALS):
            for each in np.unique(fold):
                others = ~np.isin(np.arange(windows.log.legs), windows.log.leg[fold == each])
                inner = evidence_of(replace(equations, gram=equations.gram[others])).inner
                mine = known & (fold[windows.starts] == each)
                yield _Fold(inner, off[mine], np.ascontiguousarray(slope[mine]), number[mine])

    return LinearTracks(evidence, at, low, high, tuple(folds()))


def _coordinates(evidence: Evidence) -> Iterator[tuple[str, int]]:
    """Each free coordinate of each effect, in the order of the columns."""
    for name in evidence.names:
        yield from ((name, number) for number in range(len(evidence.columns([name]))))


def _moved(evidence: Evidence, name: str, number: int, by: float) -> Coordinates:
    """The sizes that the equations are linear about, one coordinate moved as far as its bounds allow."""
    model = evidence.equations.model
    free = list(model.at.get(name, (0.0,) * len(evidence.columns([name]))))
    free[number] += by
    return model.bounded({**model.at, name: tuple(free)})


def _slope(windows: UnseenWindows, evidence: Evidence, name: str, number: int) -> Floats:
    """How the tracks change with one free coordinate [N, H, 2]."""
    step = _STEP * float(evidence.equations.model.catalogue[name].free_scale[number])
    ends = [_moved(evidence, name, number, side * step) for side in (1.0, -1.0)]
    ahead, behind = (windows.predicted(at)[:, 1:, :2] for at in ends)
    return np.asarray((ahead - behind) / (ends[0][name][number] - ends[1][name][number]))
