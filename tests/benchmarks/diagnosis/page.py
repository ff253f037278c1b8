"""The page of results: scores beside what is asked for, where they differ, and what went wrong by case."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from math import isnan
from pathlib import Path

import numpy as np

from seatrial.acquisition.core.trial import software_version
from seatrial.hybrid.effects import CATALOGUE, VERSION
from tests.benchmarks.diagnosis.cases import Size, cases_of
from tests.benchmarks.diagnosis.pictures import draw_confusion, draw_power
from tests.benchmarks.diagnosis.scoring import (
    STRONG,
    Result,
    Share,
    Test,
    against_tolerance,
    axis_right,
    covered,
    detected,
    error_quartiles,
    exact,
    fades,
    fading_named,
    gap_closed,
    in_set,
    mean_set_size,
    named_alone,
    named_for_unknown,
    names,
    names_something,
    of_group,
    place_right,
    resolved,
    right_family,
    says_unknown,
    share,
    silently_wrong,
    undecided_rightly,
    wrong_in_doubt,
)
from tests.benchmarks.diagnosis.text import ABOUT, GROUPS_ARE, HEAD

Row = tuple[str, str, str]


def write_page(results: Sequence[Result], none: Mapping[str, str], size: Size, path: Path | None) -> str:
    """The page as Markdown; with a ``path`` it is written there, its pictures in ``pictures`` beside it."""
    singles = of_group(results, "singles")
    strong = named_alone(singles)
    parts = [
        HEAD.format(
            size=size,
            cases=len(results),
            whole=len(cases_of(size)),
            version=software_version(),
            catalogue=VERSION,
            effects=len(CATALOGUE),
        ),
        _table(("score", "result", "target"), _scores(results)),
        ABOUT,
    ]
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if singles:
            draw_power(singles, path.parent / "pictures" / "diagnosis_power.png")
            parts.append("![Power against size in units of the predicted limit](pictures/diagnosis_power.png)")
        if strong:
            draw_confusion(strong, path.parent / "pictures" / "diagnosis_confusion.png")
            parts.append("![Hidden effects against reported ones](pictures/diagnosis_confusion.png)")
    parts += [GROUPS_ARE, _by_kind(results), _wrong(results), _left_out(results, none)]
    text = "\n\n".join(part for part in parts if part) + "\n"
    if path is not None:
        path.write_text(text, encoding="utf-8")
    return text


def _scores(results: Sequence[Result]) -> list[Row]:
    groups = {name: of_group(results, name) for name in ("nothing", "singles", "pairs", "triples")}
    strong = named_alone(groups["singles"])
    alike = [each for each in groups["singles"] if each["multiple"] >= STRONG and each["rivals"]]
    weak = [each for each in groups["singles"] if each["multiple"] < STRONG]
    off = [
        against_tolerance(each, each["truth"]["model_error"]["error_rms"])
        for each in groups["nothing"]
        if each["model_error_percent"] > 0.0
    ]
    hidden = [*groups["singles"], *groups["pairs"], *groups["triples"]]
    return [
        ("nothing hidden: an effect named", str(share(groups["nothing"], names_something)), "at most 3 %"),
        ("nothing hidden: `unknown`", str(share(groups["nothing"], says_unknown)), ""),
        ("nothing hidden: model error, rms, median of those that have one", _tolerances(off), ""),
        ("singles at 1.2 times the limit: something missing", str(share(weak, detected)), "90 %"),
        ("singles at 2 times and more: named, nothing else", str(share(strong, exact)), "95 %"),
        ("singles at 2 times and more: right family", str(share(strong, right_family)), "98 %"),
        ("singles at 2 times and more: in the reported set", str(share(strong, in_set)), "97 %"),
        ("singles at 2 times and more: mean size of the set", _set_size(strong), "at most 1.5"),
        ("singles that another effect imitates: in the reported set", str(share(alike, in_set)), ""),
        ("pairs: all named, none added", str(share(groups["pairs"], exact)), "90 %"),
        ("pairs: all in the reported sets", str(share(groups["pairs"], in_set)), ""),
        ("triples: all named, none added", str(share(groups["triples"], exact)), "80 %"),
        ("triples: all in the reported sets", str(share(groups["triples"], in_set)), ""),
        *_outside_scores(results),
        *_design_scores(results),
        *_parameter_scores(hidden),
        *_off_scores(results),
        _seconds(results),
    ]


def _outside_scores(results: Sequence[Result]) -> list[Row]:
    every, without = of_group(results, "outside"), of_group(results, "without")
    fading = [each for each in every if fades(each)]
    outside = [each for each in every if not fades(each)]
    size = _tolerances([against_tolerance(each, each["truth"]["outside_rms"]) for each in outside])
    unknown = [each for each in outside if says_unknown(each)]
    return [
        ("outside the catalogue: `unknown`", str(share(outside, says_unknown)), "90 %"),
        ("outside the catalogue: an effect named without `unknown`", str(share(outside, named_for_unknown)), ""),
        ("outside the catalogue: any effect named", str(share(outside, names_something)), "at most 5 %"),
        ("outside the catalogue, `unknown`: on what it depends right", str(share(unknown, place_right)), ""),
        ("outside the catalogue, `unknown`: axis right", str(share(unknown, axis_right)), ""),
        ("outside the catalogue: its forces, rms, median", size, ""),
        ("thrust that fades: a loss of thrust named that drifts", str(share(fading, fading_named)), ""),
        ("taken out of the catalogue: silently misnamed", str(share(without, silently_wrong)), "at most 10 %"),
        ("taken out of the catalogue: misnamed, `indistinguishable`", str(share(without, wrong_in_doubt)), ""),
        ("taken out of the catalogue: `unknown`", str(share(without, says_unknown)), ""),
        ("taken out of the catalogue: named in the right family", str(share(without, right_family)), ""),
        ("taken out of the catalogue: nothing said", str(share(without, lambda each: not detected(each))), ""),
    ]


def _set_size(results: Sequence[Result]) -> str:
    mean = mean_set_size(results)
    return "no case" if isnan(mean) else f"{mean:.2f}"


def _tolerances(ratios: Sequence[float]) -> str:
    return f"{np.median(ratios):.2g} times the tolerance (at most {max(ratios):.2g})" if ratios else "no case"


def _design_scores(results: Sequence[Result]) -> list[Row]:
    cannot = of_group(results, "cannot_tell")
    again = [each for each in cannot if "after_next_manoeuvre" in each]
    return [
        ("cannot tell: `indistinguishable`, truth in the group", str(share(cannot, undecided_rightly)), "90 %"),
        ("cannot tell: truth in the reported set", str(share(cannot, in_set)), ""),
        ("cannot tell: a manoeuvre proposed", str(Share(len(again), len(cannot))), ""),
        ("cannot tell: resolved by the manoeuvre proposed", str(share(again, resolved)), "90 %"),
    ]


def _parameter_scores(hidden: Sequence[Result]) -> list[Row]:
    low, middle, high, rms, count = error_quartiles(hidden)
    rightly = [each for each in hidden if each["said"]["verdict"] == "named" and exact(each)]
    closed = [gap_closed(each) for each in rightly]
    median = f"{np.median(closed):.3f}" if closed else "no case"
    errors = f"{middle:.2f} ({low:.2f} to {high:.2f}; {rms:.2f}) of {count}" if count else "no case"
    return [
        ("parameters: median error over the bound (quartiles; rms)", errors, "at most 1.2"),
        ("parameters: 95 % intervals that hold the truth", str(covered(hidden)), "93-97 %"),
        ("gap closed in rightly `named` cases: at least 0.95", str(share(rightly, _closes)), ""),
        ("gap closed in rightly `named` cases: median", median, "at least 0.95"),
    ]


def _off_scores(results: Sequence[Result]) -> list[Row]:
    """Where the model is off by about what it is granted: there the intervals are as wide as they have to be."""
    off = of_group(results, "model_off")
    low, middle, high, rms, count = error_quartiles(off)
    errors = f"{middle:.2f} ({low:.2f} to {high:.2f}; {rms:.2f}) of {count}" if count else "no case"
    error = _tolerances([against_tolerance(each, each["truth"]["model_error"]["error_rms"]) for each in off])
    return [
        ("singles, the model off: named, nothing else", str(share(named_alone(off), exact)), ""),
        ("singles, the model off: in the reported set", str(share(off, in_set)), ""),
        ("singles, the model off: median error over the bound (quartiles; rms)", errors, ""),
        ("singles, the model off: 95 % intervals that hold the truth", str(covered(off)), ""),
        ("singles, the model off: model error, rms, median", error, ""),
    ]


def _closes(result: Result) -> bool:
    return gap_closed(result) >= 0.95


def _seconds(results: Sequence[Result]) -> Row:
    took = [each["diagnosis_s"] for each in results if "said" in each]
    spans = f"{np.median(took):.0f} s (slowest {max(took):.0f} s)" if took else "no case"
    return "a diagnosis on one core: median", spans, ""


def _by_kind(results: Sequence[Result]) -> str:
    """False alarms and names by sea, programme, simulator and effect."""
    nothing = of_group(results, "nothing")
    strong = named_alone(of_group(results, "singles"))
    keys: list[tuple[str, Callable[[Result], str]]] = [
        ("sea", lambda each: str(each["sea"])),
        ("programme", lambda each: str(each["programme"])),
        ("model error", lambda each: f"{each['model_error_percent']:g} %"),
        ("simulator", lambda each: str(each["simulator"])),
    ]
    alarms = [row for name, key in keys[:3] for row in _split(nothing, name, key, names_something, says_unknown)]
    rows = [row for name, key in keys if name != "model error" for row in _split(strong, name, key, exact, in_set)]
    effects = _split(strong, "effect", lambda each: ", ".join(each["hidden"]), exact, in_set)
    outside = _split(
        of_group(results, "outside"), "effect", lambda each: ", ".join(each["outside"]), says_unknown, place_right
    )
    return "\n\n".join(
        f"### {title}\n\n{_table(heads, some)}"
        for title, heads, some in (
            ("Nothing hidden", ("trials", "an effect named", "`unknown`"), alarms),
            ("Singles at twice the limit and more", ("trials", "named, nothing else", "in the set"), rows),
            ("The same by effect", ("hidden", "named, nothing else", "in the set"), effects),
            ("Outside the catalogue", ("hidden", "`unknown`", "on what it depends right"), outside),
        )
        if some
    )


def _split(results: Sequence[Result], name: str, key: Callable[[Result], str], *tests: Test) -> list[Row]:
    values = dict.fromkeys(key(each) for each in results)
    parts = {value: [each for each in results if key(each) == value] for value in values}
    return [
        (f"{name} {value}", str(share(some, tests[0])), str(share(some, tests[1]))) for value, some in parts.items()
    ]


def _wrong(results: Sequence[Result]) -> str:
    """One line for every case in which a name was wrong or lacking where it had to be right."""
    wrong = [
        *(each for each in of_group(results, "nothing") if detected(each)),
        *(
            each
            for group in ("singles", "pairs", "triples")
            for each in of_group(results, group)
            if each["multiple"] >= STRONG and not exact(each)
        ),
        *(each for each in of_group(results, "outside") if not says_unknown(each)),
    ]
    rows = [(each["key"], _truth(each), f"`{each['said']['verdict']}`: {_said(each)}") for each in wrong]
    return f"## Cases that went wrong\n\n{_table(('case', 'hidden', 'said'), rows)}" if rows else ""


def _truth(result: Result) -> str:
    every = {**result["hidden"], **{name: {"size": size} for name, size in result["outside"].items()}}
    texts = [f"{name} {', '.join(f'{value:.3g}' for value in values.values())}" for name, values in every.items()]
    return "; ".join(texts) or "nothing"


def _said(result: Result) -> str:
    unknown = result["said"]["unknown"]
    groups = "; alike: " + "; ".join(", ".join(each) for each in result["said"]["indistinguishable"])
    return (
        (", ".join(names(result)) or "nothing named")
        + (groups if result["said"]["indistinguishable"] else "")
        + (f"; {unknown['looks_like']}" if unknown else "")
    )


def _left_out(results: Sequence[Result], none: Mapping[str, str]) -> str:
    counts = Counter((key.split("/")[0], why) for key, why in none.items())
    rows = [(group, why, str(count)) for (group, why), count in sorted(counts.items())]
    for word, why in (("refused", "the ship left the range of her model"), ("crashed", "the diagnosis failed")):
        some = Counter(each["key"].split("/")[0] for each in results if word in each)
        rows += [(group, why, str(count)) for group, count in sorted(some.items())]
    return f"## Cases that are none\n\n{_table(('group', 'why', 'cases'), rows)}" if rows else ""


def _table(heads: Sequence[str], rows: Sequence[Row]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
