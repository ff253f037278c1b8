"""A plan on a page: two programmes on a time line, the sizes that they detect, and what they cannot distinguish."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from seatrial.acquisition.core.files import write_text, written_together
from seatrial.analysis.report.plots import PALETTE
from seatrial.analysis.report.rendering import Page, render
from seatrial.hybrid.diagnosis.planning import DISTINGUISHED
from seatrial.hybrid.planning import Plan
from seatrial.hybrid.report.text import plain, templates

JSON_FILE, PAGE_FILE = "plan.json", "plan.html"
_MOST = 100.0  # twice the log likelihood: more than this is plenty in any picture
_LEAST = 1.0
_MOST_SHOWN = 18  # effects in one picture


def write_plan(plan: Plan, folder: Path) -> list[Path]:
    """Write ``plan.json`` and the page into a folder and return their paths. Raises :class:`StorageError`."""
    text = json.dumps(plan.as_dict()) + "\n"
    with written_together(folder / JSON_FILE):
        return [write_text(folder / JSON_FILE, text), page_of(plan).write(folder / PAGE_FILE)]


def page_of(plan: Plan) -> Page:
    """The page."""
    sea = f"{plan.sea.name or 'own'} sea"
    return render(
        "plan.html", templates=templates(), title="What a trial would reveal", plan=plan,
        subtitle=f"{plan.vessel}, {sea}, tolerance {100.0 * plan.tolerance:g} %",
    )  # fmt: skip


def headline_of(plan: Plan) -> dict[str, str]:
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


def plain_rows(rows: Sequence[Sequence[str]]) -> list[list[str]]:
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
