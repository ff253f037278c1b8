"""The page of what was said of measured data with something hidden in them."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

import numpy as np

from tests.benchmarks.diagnosis.scoring import Share, names, reported_set
from tests.benchmarks.measured.kinds import KINDS
from tests.benchmarks.measured.scoring import Result, against_good, alone_right, by_part, closed, outcome, tells

Row = tuple[str, ...]

_SHOWN = 5  # of the names that are said to be alike


def scores(results: Sequence[Result]) -> list[Row]:
    """What counts: score, result, asked for."""
    usual = by_part(results)
    told = [each for each in results if tells(each)]
    said = [outcome(each, usual.get(each["part"])) for each in told]
    alone = sum(alone_right(each, usual.get(each["part"])) for each in told)
    every = [closed(each) for each, what in zip(told, said, strict=True) if what == "right"]
    shares = [each for each in every if not isnan(each)]
    none = list(usual.values())
    better = [not names(each) or each["others"]["found"] < each["others"]["before"] for each in none]
    ships = [each for each in results if not KINDS[each["kind"]].names and each["kind"] != "nothing"]
    good = [against_good(each) <= 1.2 for each in ships]
    return [
        ("the right name, or a group with it", str(Share(said.count("right"), len(said))), "85 %"),
        (
            "the right name, and no other beyond those always named",
            str(Share(alone, len(said))),
            "",
        ),
        ("a wrong name", str(Share(said.count("wrong"), len(said))), "at most 5 %"),
        ("rightly named: share of the gap, median", f"{np.median(shares):.2f}" if shares else "-", "0.8"),
        (
            "rightly named: at least 0.8 of the gap",
            str(Share(sum(each >= 0.8 for each in shares), len(shares))),
            "",
        ),
        (
            "nothing removed: nothing named, or it improves the other parts",
            str(Share(sum(better), len(none))),
            "11 of 13",
        ),
        ("another ship's hull: at most 1.2 of the good model's error", str(Share(sum(good), len(ships))), ""),
    ]


def cases(results: Sequence[Result]) -> list[Row]:
    """One row a case: hidden, part, verdict and names, outcome, and distances on the other recordings [m]."""
    usual = by_part(results)
    rows = []
    for each in sorted(results, key=lambda one: (list(KINDS).index(one["kind"]), one["part"])):
        others = each["others"]
        told = outcome(each, usual.get(each["part"])) if tells(each) else "-"
        share = f"{closed(each):.2f}" if tells(each) and not isnan(closed(each)) else "-"
        rows.append((
            each["kind"], each["part"], f"`{each['said']['verdict']}`: {_named(each)}", told,
            *(f"{others[name]:.3f}" for name in ("before", "own", "found")), share,
        ))  # fmt: skip
    return rows


def _named(result: Result) -> str:
    sizes = [
        (each["name"], " / ".join(f"{parameter['value']:.2g}" for parameter in each["parameters"].values()))
        for each in result["said"]["effects"]
    ]
    tied = sorted(reported_set(result) - set(names(result)))
    more = f" and {len(tied) - _SHOWN} more" if len(tied) > _SHOWN else ""
    beside = f"; alike: {', '.join(tied[:_SHOWN])}{more}" if tied else ""
    return (", ".join(f"{name} {size}" for name, size in sizes) or "-") + beside


def table(head: Row, rows: Sequence[Row]) -> str:
    """A table in Markdown."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def page(results: Sequence[Result]) -> str:
    """Scores and cases as they stand on the page."""
    columns = ("hidden", "recordings", "diagnosis", "", "altered", "restored", "as diagnosed", "closed")
    return f"{table(('score', 'result', 'target'), scores(results))}\n\n{table(columns, cases(results))}\n"
