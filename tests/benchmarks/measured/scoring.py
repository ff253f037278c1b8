"""What was said of measured data with something hidden in them: right or wrong, and how far it closes the gap."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

from tests.benchmarks.diagnosis.scoring import names, reported_set
from tests.benchmarks.measured.kinds import KINDS

Result = Mapping[str, Any]
Outcome = Literal["right", "not named", "wrong"]

TELLS = 0.05
"""A term that brings predictions of the same recordings closer by less does not show in them."""


def by_part(results: Iterable[Result], kind: str = "nothing") -> dict[str, Result]:
    """The results of one kind by the part of the recordings."""
    return {each["part"]: each for each in results if each["kind"] == kind}


def tells(result: Result) -> bool:
    """Whether the recordings show what is hidden: an error of the record, or a term that they miss."""
    here, kind = result["here"], KINDS[result["kind"]]
    return bool(kind.names) and (kind.in_record or here["before"] - here["own"] >= TELLS * here["before"])


def outcome(result: Result, usual: Result | None = None) -> Outcome:
    """Whether a right name is said, alone or in a group, or a wrong one; not one that is always said."""
    if KINDS[result["kind"]].names & reported_set(result):
        return "right"
    return "wrong" if set(names(result)) - (set(names(usual)) if usual else set()) else "not named"


def alone_right(result: Result, usual: Result | None = None) -> bool:
    """Whether what is named is right names, or in a pair or group with one, or named with nothing hidden, too."""
    right, always = KINDS[result["kind"]].names, set(names(usual)) if usual else set()
    tied = [set(group) for group in result["said"]["indistinguishable"] if right & set(group)]
    own = {name for name in names(result) if name in right or any(name in group for group in tied)}
    return bool(own) and set(names(result)) <= own | always


def closed(result: Result) -> float:
    """The gap that is closed on the other recordings, as a share of what the term's own return closes.

    NaN where that is next to nothing: what a sensor reads wrong need not make predictions worse.
    """
    others = result["others"]
    whole = others["before"] - others["own"]
    if whole < TELLS * others["before"]:
        return float("nan")
    return float((others["before"] - others["found"]) / whole)


def against_good(result: Result) -> float:
    """The error on the other recordings with what was named, over that of the good model."""
    return float(result["others"]["found"] / result["others"]["own"])
