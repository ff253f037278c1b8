"""From what was named and what remains to a verdict, in words and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, degrees, hypot

import numpy as np

from acquisition.core.arrays import Floats
from hybrid.diagnosis.acceptance import LackOfFit
from hybrid.diagnosis.nuisance_basis import AXES, INTERACTIONS, OPERATION
from hybrid.diagnosis.result import Correlation, Estimate, Rival, Unexplained, Verdict
from hybrid.diagnosis.select_effects import CLOSE, Naming, rivals_of
from hybrid.diagnosis.words import DEPENDS
from hybrid.effects import Effect
from hybrid.report.words import plain

WEAK = 9.0
"""A name stands whose rival lacks more than ``CLOSE``; below this another trial is worth its time."""

_WIDTH = 1.96
_CREDIBLE = 3  # effects at once; more are as a rule what imitates one that is missing in the catalogue


def estimates(naming: Naming, name: str) -> dict[str, Estimate]:
    """The parameters of a named effect with their 95 % intervals."""
    evidence, effect = naming.evidence, naming.evidence.equations.model.catalogue[name]
    fit = evidence.fit(naming.names, prior=True)
    places = evidence.places(fit, name)
    covariance = fit.covariance[np.ix_(places, places)] * naming.tests[name].spread
    given = naming.evidence.equations.model.given.get(name, (0.0,) * len(places))
    return intervals(effect, fit.values[places] + np.array(given), covariance)


def intervals(effect: Effect, free: Floats, covariance: Floats) -> dict[str, Estimate]:
    """Parameters and 95 % intervals from free coordinates and their covariance."""
    deviation = np.sqrt(np.diag(covariance))
    if effect.chart == "polar":
        return _polar(effect, free, covariance)
    result = {}
    values, low, high = (effect.values(list(free + side * _WIDTH * deviation)) for side in (0.0, -1.0, 1.0))
    for each in effect.parameters:
        ends = sorted((low[each.name], high[each.name]))
        bounded = [min(max(end, each.low), each.high) for end in ends]
        result[each.name] = Estimate(values[each.name], bounded[0], bounded[1], each.unit)
    return result


def _polar(effect: Effect, free: Floats, covariance: Floats) -> dict[str, Estimate]:
    """A size and a direction: deviations along and across the vector."""
    along, across = free
    size = max(hypot(along, across), 1e-12)
    ahead = np.array([along, across]) / size
    aside = np.array([-ahead[1], ahead[0]])
    length = float(np.sqrt(ahead @ covariance @ ahead)) * _WIDTH
    turn = degrees(float(np.sqrt(aside @ covariance @ aside)) / size) * _WIDTH
    towards = degrees(atan2(across, along)) % 360.0
    first, second = effect.parameters
    return {
        first.name: Estimate(size, max(size - length, 0.0), size + length, first.unit),
        second.name: Estimate(towards, towards - min(turn, 180.0), towards + min(turn, 180.0), second.unit),
    }


def close_rivals(naming: Naming) -> list[Rival]:
    """Effects that explain almost as much in the place of a named one, the closest first."""
    found = []
    for name in naming.names:
        for rival, less in rivals_of(naming.evidence, naming.names, name).items():
            less = min(less, naming.nearer.get((name, rival), less))
            if less < 3.0 * CLOSE:
                found.append(Rival(name, rival, float(less)))
    return sorted(found, key=lambda each: each.evidence)


def groups(names: Sequence[str], rivals: Sequence[Rival]) -> list[tuple[str, ...]]:
    """What these data cannot tell apart: each named effect with its close rivals."""
    result = []
    for name in names:
        tied = [each.name for each in rivals if each.instead_of == name and each.evidence < CLOSE]
        if tied:
            result.append((name, *tied))
    return result


def verdict_of(names: Sequence[str], tied: Sequence[tuple[str, ...]], unknown: Unexplained | None) -> Verdict:
    """One word for it."""
    if unknown:
        return "unknown"
    if not names:
        return "nothing_missing"
    return "indistinguishable" if tied else "named"


def unexplained(found: Sequence[LackOfFit], effects: Sequence[Effect], share_of_gap: float) -> Unexplained | None:
    """What remains, in words; or what so many named ``effects`` at once are likely to stand for."""
    if found:
        found = _told(found)
        where = tuple(dict.fromkeys(each.depends for each in found))
        return Unexplained(share_of_gap, where, "; ".join(dict.fromkeys(looks_like(each) for each in found[:3])))
    if len(effects) <= _CREDIBLE:
        return None
    families = " and ".join(dict.fromkeys(each.family for each in effects))
    words = (
        f"{len(effects)} effects at once ({families}): rather one that is not in the catalogue and like all of them"
    )
    return Unexplained(share_of_gap, (OPERATION,), words)


def _told(found: Sequence[LackOfFit]) -> list[LackOfFit]:
    """Without weaker signs that an effect has another form than it is named for."""
    first = {each.what: each for each in reversed(found) if each.depends in INTERACTIONS}
    return [each for each in found if each.depends not in INTERACTIONS or each is first[each.what]]


_UNIT = {"surge": "N", "sway": "N", "yaw": "N m"}


def looks_like(remainder: LackOfFit) -> str:
    """One family in words: its axis or effect, on what it depends, and its size."""
    if remainder.what == "force":
        return (
            f"forces that depend on speeds and thrusters, off by some {100.0 * remainder.size:.2g} % of their range"
        )
    if remainder.what in AXES:
        kind = "moment" if remainder.what == "yaw" else "force"
        size = f"{remainder.size:.2g} {_UNIT[remainder.what]}"
        return f"a {remainder.what} {kind} of some {size} that varies with {DEPENDS[remainder.depends]}"
    varies = f"{plain(remainder.what)} that varies with {DEPENDS[remainder.depends]}"
    return (
        f"{varies}: rather a relative that is not in the catalogue" if remainder.depends in INTERACTIONS else varies
    )


def correlation_of(naming: Naming) -> Correlation:
    """How the estimates of what was named are correlated, in its free coordinates."""
    fit = naming.evidence.fit(naming.names)
    deviation = np.sqrt(np.diag(fit.covariance))
    titles, order = list[str](), list[int]()
    for name in naming.names:
        places = naming.evidence.places(fit, name)
        titles += [
            f"{plain(name)}, {number}" if len(places) > 1 else plain(name) for number, _ in enumerate(places, 1)
        ]
        order += places
    matrix = fit.covariance / np.outer(deviation, deviation)
    return Correlation(tuple(titles), np.asarray(matrix[np.ix_(order, order)]))
