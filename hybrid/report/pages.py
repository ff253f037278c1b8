"""The pages of an evaluation, of a plan and of the standard manoeuvres of a vessel file.

An evaluation's has which method is worth what, where it is good, and what a random split would hide; a plan's has
two programmes on a time line, the sizes that they detect, and what they cannot distinguish. The standard manoeuvres
are a table, a picture and a page, IMO's limits beside them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import isfinite
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from rich.console import Group
from rich.table import Table
from rich.text import Text

from seatrial.acquisition.core import files, quantities
from seatrial.acquisition.core.errors import join_words
from seatrial.analysis.manoeuvres import criteria, indices, measures
from seatrial.analysis.report import pages, tables
from seatrial.analysis.report.plots import FAINT, INK, PALETTE, draw_ship_outlines
from seatrial.hybrid.diagnosis.planning import DISTINGUISHED
from seatrial.hybrid.evaluation.study import BASELINES, Evaluation, MethodSummary, SplitSummary
from seatrial.hybrid.planning import Plan
from seatrial.hybrid.report.plots import COLOUR, draw_interval_bar, interval_reach, label_rows, set_logarithmic_axis
from seatrial.hybrid.report.text import (
    MEANING,
    estimate_text,
    plain,
    plain_number,
    predicted_index_view,
    prevent_line_breaks,
    templates,
    window_counts_text,
)
from seatrial.hybrid.simulation.vessel_check import StandardTest, VesselCheck

_LABELS, _SHORTEST = 84, 10  # characters that fit below an axis side by side, and of one label at the least
EVALUATION_JSON, EVALUATION_PAGE = "evaluation.json", "evaluation.html"
METHOD_HEADER = ["method", "start", "mean distance [m]", "end [m]", "north, east [m]", "heading [deg]",
                 "ratio to best", "in the 95 % region"]  # fmt: skip


def colour_by_method(methods: Sequence[str]) -> dict[str, str]:
    """One colour a method, the same in every figure; methods that are not known take what is left."""
    colours = {method: COLOUR[method] for method in (*BASELINES, *methods) if method in COLOUR}
    unused = [colour for colour in (*PALETTE, INK) if colour not in colours.values()]
    uncoloured = [method for method in methods if method not in colours]
    return colours | {method: unused[number % len(unused)] for number, method in enumerate(uncoloured)}


def draw_leak(axes: Axes, splits: Mapping[str, SplitSummary]) -> None:
    """What the random split shows of each method beside what is found on legs never seen."""
    honest, leaky = splits["leg"].causal.methods, splits["random"].causal.methods
    for row, method in enumerate(honest):
        shown, unseen = leaky[method].mean_distance_m, honest[method].mean_distance_m
        axes.plot([shown.value, unseen.value], [row, row], color=FAINT, linewidth=2.0, zorder=1)
        draw_interval_bar(axes, shown, row - 0.12, PALETTE[1], "random windows" if row == 0 else "")
        draw_interval_bar(axes, unseen, row + 0.12, PALETTE[0], "unseen legs" if row == 0 else "")
    label_rows(axes, [plain(method) for method in honest])
    set_logarithmic_axis(
        axes, "x", [errors.mean_distance_m for part in (honest, leaky) for errors in part.values()]
    )
    axes.set_xlabel("mean distance [m]")
    axes.legend(loc="best")


def draw_errors_by_class(axes: Axes, summaries: Mapping[str, MethodSummary]) -> None:
    """The mean distance of every method in each class of windows, with its interval."""
    methods = list(next(iter(summaries.values())).methods)
    colours = colour_by_method(methods)
    for number, method in enumerate(methods):
        places = np.arange(len(summaries)) + (number - (len(methods) - 1) / 2) * 0.6 / len(methods)
        intervals = [summary.methods[method].mean_distance_m for summary in summaries.values()]
        values, ends = (
            [interval.value for interval in intervals],
            np.column_stack([*map(interval_reach, intervals)]),
        )
        axes.errorbar(places, values, ends, fmt="o", color=colours[method], capsize=2.5, label=plain(method))
    wide = max(_LABELS // len(summaries), _SHORTEST)
    labels = [
        f"{fill(name, wide)}\n{fill(window_counts_text(summary), wide)}" for name, summary in summaries.items()
    ]
    axes.set_xticks(range(len(summaries)), labels)
    axes.set_xlim(-0.5, len(summaries) - 0.5)
    set_logarithmic_axis(
        axes, "y", [errors.mean_distance_m for summary in summaries.values() for errors in summary.methods.values()]
    )
    axes.set_ylabel("mean distance [m]")
    axes.grid(visible=False, axis="x")


def draw_errors_by_second(figure: Figure, summary: MethodSummary) -> None:
    """By second of the prediction the mean distance of every method with its 95 % interval shaded, and the share
    of positions inside its 95 % region, 93 to 97 % shaded.

    Errors grow from centimetres to metres, and methods are tens of times apart: their axis is logarithmic.
    """
    error_axes, coverage_axes = figure.subplots(1, 2)
    colours = colour_by_method(list(summary.methods))
    coverage_axes.axhspan(93.0, 97.0, color=FAINT, alpha=0.4, linewidth=0)
    for method, errors in summary.methods.items():
        look: dict[str, Any] = {"color": colours[method], "label": plain(method)}
        times = np.arange(1, len(errors.by_second) + 1)
        value, low, high = np.array(
            [(interval.value, interval.low, interval.high) for interval in errors.by_second]
        ).T
        error_axes.plot(times, value, **look)
        error_axes.fill_between(times, low, high, color=colours[method], alpha=0.12, linewidth=0)
        shares = [100.0 * interval.value for interval in errors.coverage_by_second]
        coverage_axes.plot(np.arange(1, len(shares) + 1), shares, **look)
    intervals = [interval for errors in summary.methods.values() for interval in errors.by_second]
    set_logarithmic_axis(error_axes, "y", intervals)
    error_axes.set(xlim=(0, times[-1]), xlabel="prediction time [s]", ylabel="mean distance [m]")
    coverage_axes.set(xlim=(0, len(errors.by_second)), ylim=(min(coverage_axes.get_ylim()[0], 90.0), 100.5))
    coverage_axes.set(xlabel="prediction time [s]", ylabel="positions in the 95 % region [%]")
    figure.legend(*error_axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def draw_all_errors_by_class(figure: Figure, summaries: Mapping[str, MethodSummary]) -> None:
    """The error in each class, with the methods above."""
    axes = figure.subplots()
    draw_errors_by_class(axes, summaries)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=6)


def write_evaluation(evaluation: Evaluation, text: str, provenance: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the JSON ``text`` and the page into a folder and return their paths. Raises :class:`StorageError`."""
    with files.written_together(folder / EVALUATION_JSON):
        return [
            files.write_text(folder / EVALUATION_JSON, text + "\n"),
            evaluation_page(evaluation, provenance).write(folder / EVALUATION_PAGE),
        ]


def evaluation_page(evaluation: Evaluation, provenance: Mapping[str, Any]) -> pages.Page:
    """The page; ``provenance`` says what was evaluated: files, vessel, stride, seed."""
    names = ", ".join(Path(file).name for file in provenance["files"])
    windows = "windows with recorded commands" if provenance.get("any_commands") else "held windows"
    counts = f"{evaluation.windows} {windows} of {evaluation.legs} legs"
    return pages.render(
        "evaluation.html", templates=templates(), study=evaluation,
        title=f"Prediction methods compared over {evaluation.horizon_s} s",
        subtitle=f"{names}; vessel {provenance['vessel']}; {counts}",
    )  # fmt: skip


def evaluation_headline(evaluation: Evaluation) -> dict[str, str]:
    """How the best learned method stands to the best baseline, on each honest split."""
    figures = {}
    for kind, split in evaluation.splits.items():
        learned = {name: errors for name, errors in split.causal.methods.items() if name not in BASELINES}
        if kind != "random" and learned:
            best = min(learned, key=lambda name: learned[name].ratio.value)
            words = f"{plain(best)} over {plain(split.causal.best_baseline)}, {MEANING[kind]}"
            figures[words] = f"{learned[best].ratio.value:.2f} \u00d7"
    return figures


def method_rows(split: SplitSummary) -> tuple[list[list[str]], int]:
    """A row a method, and which is the best."""
    rows = []
    for start, summary in split.by_start.items():
        for name, errors in summary.methods.items():
            inside = errors.coverage_95
            bounds = "" if inside.low != inside.low else f" ({inside.low:.0%}-{inside.high:.0%})"
            rows.append([
                prevent_line_breaks(plain(name)), start, prevent_line_breaks(estimate_text(errors.mean_distance_m)),
                f"{errors.end_distance_m.value:.2f}",
                prevent_line_breaks(f"{errors.mae_north_m.value:.2f}, {errors.mae_east_m.value:.2f}"),
                f"{errors.heading_error_deg.value:.1f}", prevent_line_breaks(estimate_text(errors.ratio)),
                prevent_line_breaks(f"{inside.value:.1%}{bounds}"),
            ])  # fmt: skip
    return rows, list(split.causal.methods).index(split.causal.best)


def leak_rows(evaluation: Evaluation) -> list[list[str]]:
    """How much larger the error on legs never seen is than what a random split shows."""
    return [
        [prevent_line_breaks(plain(name)), prevent_line_breaks(estimate_text(factor))]
        for name, factor in evaluation.leak.items()
    ]


def draw_evaluation(figure: Figure, evaluation: Evaluation) -> None:
    """The ratio of every method's mean distance to the best baseline's, with its interval, a group a split."""
    axes, splits = figure.subplots(), evaluation.splits
    rows = [
        (kind, method, errors.ratio)
        for kind, split in splits.items()
        for method, errors in split.causal.methods.items()
        if method != split.causal.best_baseline
    ]
    colours = colour_by_method(list(next(iter(splits.values())).causal.methods))
    axes.axvline(1.0, color=INK, linewidth=1.0)
    for row, (_, method, ratio) in enumerate(rows):
        draw_interval_bar(axes, ratio, row, colours[method])
    label_rows(axes, [f"{plain(method)}, {kind}" for kind, method, _ in rows])
    kinds = [kind for kind, _, _ in rows]
    for row in range(1, len(rows)):
        if kinds[row] != kinds[row - 1]:
            axes.axhline(row - 0.5, color=FAINT, linewidth=0.8)
    set_logarithmic_axis(axes, "x", [ratio for _, _, ratio in rows])
    axes.set_xlabel("mean distance divided by that of the best baseline [1]")


PLAN_JSON, PLAN_PAGE = "plan.json", "plan.html"
_MOST = 100.0  # twice the log likelihood: more than this is plenty in any picture
_LEAST = 1.0
_MOST_SHOWN = 18  # effects in one picture


def write_plan(plan: Plan, folder: Path) -> list[Path]:
    """Write ``plan.json`` and the page into a folder and return their paths. Raises :class:`StorageError`."""
    text = json.dumps(plan.as_dict()) + "\n"
    with files.written_together(folder / PLAN_JSON):
        return [files.write_text(folder / PLAN_JSON, text), plan_page(plan).write(folder / PLAN_PAGE)]


def plan_page(plan: Plan) -> pages.Page:
    """The page."""
    sea = f"{plan.sea.name or 'own'} sea"
    return pages.render(
        "plan.html", templates=templates(), title="What a trial would reveal", plan=plan,
        subtitle=f"{plan.vessel}, {sea}, tolerance {100.0 * plan.tolerance:g} %",
    )  # fmt: skip


def plan_headline(plan: Plan) -> dict[str, str]:
    """How many effects of ordinary size are seen, and how many pairs are not distinguished, by either."""
    figures = {}
    for title, programme in (("yours", plan.asked), ("better", plan.better)):
        number = 0
        for name, effect in plan.catalogue.items():
            parameter, limit = effect.parameters[0], programme.limits[name]
            if effect.chart == "inverse_square":
                number += limit >= parameter.typical
            else:
                number += limit <= abs(parameter.typical - parameter.neutral)
        figures[f"effects of ordinary size found, {title}"] = f"{number} of {len(plan.catalogue)}"
        figures[f"pairs not distinguished, {title}"] = str(len(programme.indistinguishable_pairs()))
    return figures


def rows_in_plain_words(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Rows with their names in plain words."""
    return [[plain(cell) for cell in row] for row in rows]


def draw_evidence(figure: Figure, plan: Plan) -> None:
    """The evidence that distinguishes pairs of effects, by either programme: of those that are hardest to
    distinguish, in the catalogue's order, at most as many as can be read.
    """
    evidence = np.minimum(plan.asked.evidence, plan.better.evidence)
    least = np.min(np.where(np.isfinite(evidence), evidence, np.inf), axis=1)
    shown = sorted(np.argsort(least, kind="stable")[:_MOST_SHOWN].tolist())
    names = [plain(list(plan.asked.limits)[number]) for number in shown]
    both_axes = figure.subplots(1, 2)
    for axes, programme, title in zip(both_axes, (plan.asked, plan.better), ("yours", "better"), strict=True):
        pairs = programme.evidence[np.ix_(shown, shown)]
        pairs = np.where(np.isfinite(pairs), np.clip(pairs, _LEAST, _MOST), np.nan)
        image = axes.imshow(pairs, cmap="cividis", norm=LogNorm(_LEAST, _MOST))
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=8)
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.grid(visible=False)
        axes.set_title(title, loc="left")
    axes.set_yticklabels([])
    bar = figure.colorbar(image, ax=list(both_axes), shrink=0.6, label="twice the log likelihood ratio [1]")
    bar.ax.axhline(DISTINGUISHED, color="black", linewidth=1.0)


def draw_plan(figure: Figure, plan: Plan) -> None:
    """Both programmes on a time line."""
    axes = figure.subplots()
    names = list(dict.fromkeys(part.name for programme in (plan.asked, plan.better) for part in programme.parts))
    for row, programme in enumerate((plan.asked, plan.better)):
        begin = 0.0
        for part in programme.parts:
            colour = PALETTE[names.index(part.name) % len(PALETTE)]
            axes.barh(row, part.minutes, left=begin, color=colour, edgecolor="white", alpha=0.55)
            words = fill(plain(part.name), 12)
            axes.text(begin + part.minutes / 2.0, row, words, ha="center", va="center", fontsize=7)
            begin += part.minutes
    axes.set(yticks=[0, 1], yticklabels=["yours", "better"], xlabel="time [min]")
    axes.invert_yaxis()
    axes.grid(visible=False)


BLUE, ORANGE, GREEN, _, RED = PALETTE[:5]
CRITERIA_HEADER = ("", "value", "lengths", "IMO limit", "")
PICTURES = ("png", "svg", "pdf", "json")
_PULL_OUT_LENGTHS = 60.0


def vessel_check_view(check: VesselCheck) -> Group:
    """The ship in a line, each test with a row an index, and what could not be made."""
    table = Table(box=None, header_style="dim", pad_edge=False)
    for title, justify in zip(CRITERIA_HEADER, ("left", "right", "right", "right", "left"), strict=True):
        table.add_column(title, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for test in check.tests:
        table.add_row(test.name, style="bold")
        for row in index_rows_of_test(test):
            table.add_row(f"  {row[0]}", *row[1:])
    notes = "\n".join(f"{note[0].upper()}{note[1:]}." for note in vessel_check_notes(check))
    first = Text(f"{check.vessel}: {vessel_check_headline(check)}", style="bold")
    return Group(first, table, Text(notes), *predicted_index_view(check.indices))


def vessel_check_headline(check: VesselCheck) -> str:
    """The ship and the speed of the tests in a line."""
    froude = check.speed_mps / np.sqrt(quantities.GRAVITY_MPS2 * check.length_m)
    return (
        f"{check.length_m:g} m, {check.speed_mps:.2f} m/s at {check.rpm:.4g} rpm (Froude number {froude:.2f}, "
        f"L/V {check.length_m / check.speed_mps:.1f} s)"
    )


def index_rows_of_test(test: StandardTest) -> list[list[str]]:
    """One row an index: its name, value, in lengths, limit, and the result."""
    return [
        [
            tables.plain_name(name),
            index_value_text(index),
            index_lengths_text(index),
            _limit_text(index),
            plain(index.result),
        ]
        for name, index in test.indices.items()
    ]


def index_value_text(index: indices.Index) -> str:
    """A value and its unit; 0 for what rounding leaves of nothing."""
    return f"{plain_number(0.0 if abs(index.value) < 1e-6 else index.value)} {index.unit}".rstrip()


def index_lengths_text(index: indices.Index) -> str:
    """A distance in ship lengths; empty for what is none."""
    return "" if index.lengths is None else f"{index.lengths:.2f}".replace("-0.00", "0.00")


def _limit_text(index: indices.Index) -> str:
    if index.limit is None:
        return ""
    return f"{index.limit_lengths:.1f} L" if index.limit_lengths else f"{index.limit:.1f} {index.unit}"


def write_vessel_check(check: VesselCheck, path: Path) -> Path:
    """Write a picture (png, svg, pdf, or json with its numbers), or a page for any other ending.

    Raises :class:`StorageError`.
    """
    ending = path.suffix.removeprefix(".").lower()
    if ending in PICTURES:
        return pages.write_figure(check.plot(), path.parent, path.stem, (ending,))[0]
    return vessel_check_page(check).write(path)


def vessel_check_page(check: VesselCheck) -> pages.Page:
    """The page: picture and table."""
    return pages.render(
        "vessel_check.html",
        templates=templates(),
        title=check.vessel,
        check=check,
        subtitle=vessel_check_headline(check),
    )


def vessel_check_notes(check: VesselCheck) -> list[str]:
    """What is to be said under the table: whether the ship keeps straight by itself, the criteria, what is not
    made."""
    drift_dps = check.amidships_dps
    side = "starboard" if drift_dps > 0.0 else "port"
    stability = {
        None: "course stability is not known: no pull-out to either side was possible",
        True: "course stable: with the helm amidships the ship "
        + (f"comes to {abs(drift_dps):.2g} deg/s to {side} from either side: something turns it"
           if drift_dps else "stops turning, to either side"),
        False: "not course stable: with the helm amidships the ship keeps turning to the side that it turned to",
    }  # fmt: skip
    still = f"in still water: without the {join_words([plain(name) for name in check.of_day])} of the vessel file"
    by_reason: dict[str, list[str]] = {}
    for name, why in check.left_out.items():
        by_reason.setdefault(why, []).append(name)
    tested = {test.kind for test in check.tests} & {"turning_circle", "zigzag", "stopping"}
    assumed = "with the draught of the vessel file as that of full load, on even keel"
    headline_words = criteria.headline_of_criteria(check.criteria, "The model").rstrip(".")
    standards = [f"{headline_words} ({assumed})"] if tested else []
    shortfalls = [f"{reason}: {names}" for reason, names in criteria.shortfalls_of_criteria(check.criteria)]
    not_made = [f"{join_words(names)} not made: {why}" for why, names in by_reason.items()]
    return [*[still] * bool(check.of_day), stability[check.course_stable], *standards, *shortfalls, *not_made]


def draw_vessel_check(figure: Figure, check: VesselCheck) -> None:
    """Speeds, turning circles, zigzags, pull-outs and the crash stop, each with its figures and limits."""
    panels = figure.subplot_mosaic(
        [["circles", "10", "20"], ["circles", "10", "20"], ["speeds", "pull", "stop"], ["speeds", "pull", "stop"]]
    )
    _draw_circles(panels["circles"], check)
    for axes, angle in ((panels["10"], 10.0), (panels["20"], 20.0)):
        _draw_zigzag(axes, [test for test in check.of_kind("zigzag") if abs(test.helm_deg) == angle])
        axes.set_title(f"zigzag {angle:.0f}/{angle:.0f}", loc="left")

    axes = panels["speeds"]
    axes.set_title("steady speed", loc="left")
    rpm, speed = check.speeds.T
    axes.plot(rpm, speed, "o-", color=BLUE, markersize=3.5)
    if isfinite(check.speed_mps):
        axes.plot(check.rpm, check.speed_mps, "D", color=RED, markersize=6, label="speed of the tests")
        axes.legend(loc="upper left", fontsize=8)
    axes.set(xlabel="shaft speed [rpm]", ylabel="speed [m/s]", xlim=(0.0, None), ylim=(0.0, None))

    _draw_pull_outs(panels["pull"], check)

    axes = panels["stop"]
    axes.set_title("crash stop", loc="left")
    for test in check.of_kind("stopping"):
        shown = test.motion.between(float(test.executes_s[0]), float(test.executes_s[1]))
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(shown.north_m), np.diff(shown.east_m)))) / check.length_m
        axes.plot(way, shown.surge_mps, color=BLUE)
        names = ("track_reach_m", "head_reach_m", "lateral_deviation_m", "stopping_time_s")
        _write_indices(axes, test, names)
    axes.set(xlabel="way along the track [L]", ylabel="surge [m/s]")
    figure.suptitle(f"{check.vessel}: {vessel_check_headline(check)}", x=0.01, ha="left", fontsize=11)


def _draw_pull_outs(axes: Axes, check: VesselCheck) -> None:
    """Yaw rate from the order amidships on."""
    axes.set_title("pull-out: helm amidships out of a turn", loc="left")
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    for test, colour in zip(check.of_kind("pull_out"), (BLUE, ORANGE), strict=False):
        released = float(test.executes_s[1])
        length_s = check.length_m / check.speed_mps
        shown = test.motion.between(released - 3.0 * length_s, released + _PULL_OUT_LENGTHS * length_s)
        axes.plot(shown.time_s - released, shown.yaw_rate_dps, color=colour, label=f"from {_side_of_test(test)}")
    tests = check.of_kind("pull_out")
    if tests:
        texts = [
            f"{index_value_text(test.indices['residual_yaw_rate_dps'])} left from {_side_of_test(test)}"
            for test in tests
        ]
        axes.text(0.98, 0.02, "\n".join(texts), transform=axes.transAxes, fontsize=8, ha="right", va="bottom")
        axes.legend(loc="upper right", fontsize=8)
    words = {None: "", True: "course stable", False: "not course stable"}[check.course_stable]
    axes.set(xlabel=f"time since the order [s]{', ' * bool(words)}{words}", ylabel="yaw rate [deg/s]")


def _write_indices(axes: Axes, test: StandardTest, names: tuple[str, ...]) -> None:
    """The indices with their limits as a block of text at the lower left of the axes."""
    lines = []
    for name in names:
        if name in test.indices:
            index = test.indices[name]
            value = f"{index_lengths_text(index)} L" if index.lengths is not None else index_value_text(index)
            limit = f"  (IMO {_limit_text(index)}, {plain(index.result)})" if index.limit is not None else ""
            lines.append(f"{tables.plain_name(name)} {value}{limit}")
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    words = "\n".join(lines)
    axes.text(0.02, 0.02, words, transform=axes.transAxes, va="bottom", fontsize=8, color=INK, bbox=box, zorder=5)


def _draw_circles(axes: Axes, check: VesselCheck) -> None:
    """Both circles in lengths, the approach upwards, IMO's largest advance and diameter as lines."""
    axes.set_title("turning circles", loc="left")
    length_m = check.length_m
    for test, colour in zip(check.of_kind("turning_circle"), (BLUE, ORANGE), strict=False):
        motion, start_s = test.motion, float(test.executes_s[0])
        shown = motion.between(test.executes_s[0] - 2.0 * length_m / check.speed_mps, test.executes_s[-1])
        starboard = (shown.east_m - motion.at("east_m", start_s)) / length_m
        ahead = (shown.north_m - motion.at("north_m", start_s)) / length_m
        axes.plot(starboard, ahead, color=colour, label=f"{abs(test.helm_deg):.0f} deg to {_side_of_test(test)}")
        turning = slice(int(np.searchsorted(shown.time_s, test.executes_s[0])), None)
        draw_ship_outlines(axes, starboard[turning], ahead[turning], np.deg2rad(shown.heading_deg[turning]), 1.0)

        side = 1.0 if test.helm_deg > 0.0 else -1.0
        words = "_" if side < 0.0 else "IMO's largest advance and diameter"
        limits = [
            index.limit_lengths if (index := test.indices.get(name)) else None
            for name in ("advance_m", "tactical_diameter_m")
        ]
        look: dict[str, Any] = {"linestyle": "--", "color": RED, "linewidth": 0.9}
        if limits[0] is not None:
            axes.plot([0.0, side * 3.0], [limits[0]] * 2, label=words, **look)
        if limits[1] is not None:
            axes.plot([side * limits[1]] * 2, [-1.0, 2.0], **look)
    tests = check.of_kind("turning_circle")
    if tests:
        names = ("advance_m", "transfer_m", "tactical_diameter_m", "steady_diameter_m")
        _write_indices(axes, tests[0], names)
        axes.legend(loc="upper right", fontsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="to starboard of the approach [L]", ylabel="ahead of the order [L]")


def _side_of_test(test: StandardTest) -> str:
    return "starboard" if test.helm_deg > 0.0 else "port"


def _draw_zigzag(axes: Axes, tests: list[StandardTest]) -> None:
    """Heading off the approach and helm against time, overshoots marked, of the first of both sides."""
    for test in tests[:1]:
        start, motion = float(test.executes_s[0]), test.motion
        shown = motion.between(start - 0.1 * (motion.time_s[-1] - start), motion.time_s[-1])
        course_deg = motion.at("heading_deg", start)
        axes.plot(
            shown.time_s - start, shown.heading_deg - course_deg, color=BLUE, label="heading off the approach"
        )
        axes.plot(shown.time_s - start, -shown.helm_deg, color=ORANGE, label="helm, to starboard", linewidth=1.0)
        side = test.run.sign
        for execute, following in pairwise(test.executes_s[1:]):
            deviation = side * (motion.heading_deg - course_deg)
            time_s, top = measures.peak_time_and_height(motion.time_s, deviation, float(execute), float(following))
            axes.vlines(time_s - start, side * abs(test.helm_deg), side * top, color=RED, linewidth=2.4)
            side = -side
        _write_indices(
            axes,
            test,
            (indices.overshoot_from_order_name(1), indices.overshoot_from_order_name(2), "initial_turning_m"),
        )
        axes.margins(y=0.3)
        axes.legend(loc="upper right", ncols=2, fontsize=8)
    axes.set(xlabel="time since the order [s]", ylabel="[deg], starboard positive")
