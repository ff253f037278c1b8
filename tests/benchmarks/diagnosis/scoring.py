"""From what was said and what was true to scores: shares with exact intervals, and quartiles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import beta

from seatrial.hybrid.effects import CATALOGUE

Result = Mapping[str, Any]
Test = Callable[[Result], bool]

STRONG = 2.0
"""Times its limit, from which on an effect has to be named."""

LOOKS: dict[str, tuple[str, tuple[str, ...]]] = {
    "yaw_moment_4psi": ("heading", ("yaw moment",)),
    "sheared_current": ("place", ("ocean current",)),
    "bank_suction": ("place", ("sway force", "yaw moment")),
    "fading_thrust": ("time", ("thrust loss", "surge force")),
    "one_sided_stall": ("azimuth", ("sway force", "yaw moment")),
}
"""What lies outside the catalogue: on what it depends, and words for what it acts on."""


@dataclass(frozen=True, slots=True)
class Share:
    """``count`` of ``total``, with the exact 95 % interval (Clopper and Pearson 1934)."""

    count: int
    total: int

    @property
    def value(self) -> float:
        """The share, NaN of nothing."""
        return self.count / self.total if self.total else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Its ends."""
        count, total = self.count, self.total
        low = float(beta.ppf(0.025, count, total - count + 1)) if count else 0.0
        high = float(beta.ppf(0.975, count + 1, total - count)) if count < total else 1.0
        return low, high

    def __str__(self) -> str:
        if not self.total:
            return "no case"
        low, high = (f"{100.0 * each:.1f}".removesuffix(".0") for each in self.interval)
        return f"{100.0 * self.value:.1f} % ({self.count} of {self.total}; {low} to {high})"


def share(results: Iterable[Result], test: Test) -> Share:
    """Of how many of the results the test is true."""
    answers = [bool(test(each)) for each in results]
    return Share(sum(answers), len(answers))


def of_group(results: Iterable[Result], group: str) -> list[Result]:
    """The results of a group that came to a verdict."""
    return [each for each in results if "said" in each and each["group"] == group]


def named_alone(results: Iterable[Result]) -> list[Result]:
    """Those with hidden effects large enough to be named, and that no other imitates."""
    return [each for each in results if each["multiple"] >= STRONG and not each["rivals"]]


def names(result: Result) -> list[str]:
    """The effects named."""
    return [each["name"] for each in result["said"]["effects"]]


def reported_set(result: Result) -> set[str]:
    """The effects named and all that are said to be indistinguishable from one of them."""
    named = set(names(result))
    return named.union(*(group for group in result["said"]["indistinguishable"] if named & set(group)))


def truths(result: Result) -> set[str]:
    """The effects hidden."""
    return set(result["hidden"])


def names_something(result: Result) -> bool:
    """Whether any effect is named."""
    return bool(names(result))


def fades(result: Result) -> bool:
    """Whether a thrust that fades is hidden: in no catalogue, but a loss of thrust that drifts is like it."""
    return "fading_thrust" in result["outside"]


def fading_named(result: Result) -> bool:
    """Whether a loss of thrust is named that is another at the end."""
    return any(each["name"].startswith("thrust_loss") and each["drift"] for each in result["said"]["effects"])


def says_unknown(result: Result) -> bool:
    """Whether something is said to be missing that no effect explains."""
    return bool(result["said"]["verdict"] == "unknown")


def detected(result: Result) -> bool:
    """Whether anything is said to be missing."""
    return bool(result["said"]["verdict"] != "nothing_missing")


def exact(result: Result) -> bool:
    """Whether all that is hidden is named and nothing else."""
    return set(names(result)) == truths(result)


def right_family(result: Result) -> bool:
    """Whether something is named, and all that is named is of the families of what is hidden."""
    families = {CATALOGUE[name].family for name in truths(result)}
    return names_something(result) and {CATALOGUE[name].family for name in names(result)} == families


def in_set(result: Result) -> bool:
    """Whether all that is hidden is in the reported set."""
    return truths(result) <= reported_set(result)


def silently_wrong(result: Result) -> bool:
    """Whether an effect that is not there is named without a doubt: neither `unknown` nor `indistinguishable`."""
    return bool(set(names(result)) - truths(result)) and result["said"]["verdict"] == "named"


def wrong_in_doubt(result: Result) -> bool:
    """Whether an effect that is not there is listed, and said to be one of several possible causes."""
    return bool(set(names(result)) - truths(result)) and result["said"]["verdict"] == "indistinguishable"


def named_for_unknown(result: Result) -> bool:
    """Whether an effect is named and nothing said of the unknown."""
    return names_something(result) and not says_unknown(result)


def place_right(result: Result) -> bool:
    """Whether what is outside the catalogue is said to depend on what it depends on."""
    unknown = result["said"]["unknown"]
    return unknown is not None and all(LOOKS[name][0] in unknown["where"] for name in result["outside"])


def axis_right(result: Result) -> bool:
    """Whether the words for it have the axis or the kind of what it is."""
    unknown = result["said"]["unknown"]
    return unknown is not None and all(
        any(word in unknown["looks_like"] for word in LOOKS[name][1]) for name in result["outside"]
    )


def undecided_rightly(result: Result) -> bool:
    """Whether the verdict is that several effects are possible, the hidden one among them."""
    return result["said"]["verdict"] == "indistinguishable" and in_set(result)


def resolved(result: Result) -> bool:
    """Whether the proposed manoeuvre has the hidden effect named, without any that looks the same."""
    after = {"said": result["after_next_manoeuvre"], "hidden": result["hidden"]}
    return exact(after) and reported_set(after) == truths(after)


def mean_set_size(results: Sequence[Result]) -> float:
    """How many effects the reported set has for each hidden one, where anything is named."""
    sizes = [len(reported_set(each)) / len(truths(each)) for each in results if names_something(each)]
    return float(np.mean(sizes)) if sizes else float("nan")


def covered(results: Iterable[Result]) -> Share:
    """How many 95 % intervals of parameters of rightly named effects hold the truth."""
    held: list[bool] = []
    for result in results:
        for effect in result["said"]["effects"]:
            true = result["hidden"].get(effect["name"], {})
            for name, value in true.items():
                held.append(holds(name, effect["parameters"][name], value))
    return Share(sum(held), len(held))


def holds(name: str, estimate: Mapping[str, float], true: float) -> bool:
    """Whether the interval of a parameter holds the true value."""
    if name == "direction_deg":  # the true direction may be a turn away from the estimate's
        true = estimate["value"] + (true - estimate["value"] + 180.0) % 360.0 - 180.0
    return estimate["low"] <= true <= estimate["high"]


def error_quartiles(results: Iterable[Result]) -> tuple[float, float, float, float, int]:
    """Quartiles of the absolute error over the bound, its root mean square, and the count.

    For errors that are normal and as small as can be the quartiles are 0.32, 0.67 and 1.15.
    """
    errors = np.abs([error for each in results for error in each["errors"]])
    if not errors.size:
        return (float("nan"),) * 4 + (0,)  # type: ignore[return-value]
    low, middle, high = np.quantile(errors, [0.25, 0.5, 0.75])
    return float(low), float(middle), float(high), float(np.sqrt((errors**2).mean())), len(errors)


def gap_closed(result: Result) -> float:
    """The share of what could be closed that is, on windows that took no part."""
    return float(result["said"]["gap"]["closed"])


def against_tolerance(result: Result, rms: Sequence[float]) -> float:
    """How large forces [N, N, N m] were in units of the tolerance, on the axis on which they were largest."""
    ratio = np.array(rms) / np.array(result["said"]["force_range"])
    return float(ratio.max()) / float(result["tolerance"])
