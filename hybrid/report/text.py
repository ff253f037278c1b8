"""Names, numbers and results in plain text: tables for a terminal of 80 columns of a validation, a prediction, an
evaluation and a plan, and of the catalogue of effects, which is wider.

Sections of reports: the blocks of a template, each of a result, shown on a page or in a notebook.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from seatrial.acquisition.core.errors import SeatrialError, join_words
from seatrial.acquisition.core.result import terminal_table
from seatrial.analysis.manoeuvres.indices import unit_in_name
from seatrial.analysis.quality.situations import left_out_notes
from seatrial.analysis.report.pages import Page, render, template_environment, write_figure
from seatrial.analysis.report.tables import error_reason_in_words, plain_name, readable_names
from seatrial.hybrid.effects import VERSION, Catalogue
from seatrial.hybrid.effects.context import DeclaredContext
from seatrial.hybrid.prediction.baselines import FEW_LEGS, TWO_SIDED, Interval, start_state_of_method
from seatrial.hybrid.simulation.index_table import IndexTable, PredictedIndex
from seatrial.hybrid.vessel.effect import FAMILIES, Effect

if TYPE_CHECKING:
    from seatrial.hybrid.calibrators import TrainedCalibrator
    from seatrial.hybrid.calibrators.predict import Prediction
    from seatrial.hybrid.diagnosis.result import Diagnosis
    from seatrial.hybrid.evaluation.study import Evaluation, MethodSummary, SplitSummary
    from seatrial.hybrid.evaluation.validate import ErrorsByTruth, Validation
    from seatrial.hybrid.planning import Plan, Programme


UNITS = {"mps": "m/s", "radps": "rad/s", "dps": "deg/s", "rps": "rev/s", "rpm": "rpm", "deg": "deg", "m": "m",
          "n": "N", "nm": "N m", "cos": "cosine", "sin": "sine"}  # fmt: skip
_SMALL_N = 100.0  # as "0" and "0.1" kN such forces would say nothing
_UNTRAINED = "the start is outside the calibrator's training range: a baseline predicts in its place"
_METHOD_COLUMNS = ("start", "mean m", "at end m", "north m", "east m", "heading deg")
_SPLIT_COLUMNS = ("start", "mean m", "ratio", "in 95 %")
_PREDICTION_COLUMNS = {
    "north m": "north_m", "east m": "east_m", "heading deg": "heading_deg", "95 % band m": "band_m",
    "measured\nnorth m": "measured_north_m", "measured\neast m": "measured_east_m",
}  # fmt: skip
MEANING = {
    "leg": "unseen legs",
    "time": "the last 30 % of the time",
    "recording": "unseen recordings",
    "random": "random windows of legs trained on: too optimistic",
}
_FEW = 0.005  # a share that is shown as 0 %
_MOST_PAIRS = 12

CATALOGUE_WIDTH = 112
"""The fewest columns in which the tables of effects can be read."""


def force_unit(largest_n: float) -> tuple[float, str]:
    """The unit in which forces up to so many newtons are legible, kN or for a model ship N: in N, and its name.

    >>> force_unit(2e4), force_unit(0.5)
    ((1000.0, 'kN'), (1.0, 'N'))
    """
    return (1e3, "kN") if largest_n >= _SMALL_N else (1.0, "N")


_PREDICTED_INDEX_COLUMNS = {
    "measured": "as recorded, with its 95 % interval, which covers any place of the antenna where none is stated",
    "before": "the same test by the model as it was",
    "model": "the same test by the model as it is",
    "95 % from": "by the errors of its numbers, and where runs show it by that of its form", "to": "",
    "replayed": "the recorded helm",
    "unseen": "by the fit without this recording, whose error widens the 95 %",
}  # fmt: skip
"""The columns of the table of predicted indices, and what they are."""


def index_table_of_diagnosis(diagnosis: Diagnosis) -> IndexTable:
    """The standard indices beside a diagnosis."""
    return IndexTable.from_json(diagnosis.indices)


def plain_number(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, without an exponent where it is large.

    >>> plain_number(0.012345), plain_number(12345.6), plain_number(1843.0, 2)
    ('0.0123', '12,346', '1,800')
    """
    if digits < 3:
        value = float(f"{value:.{digits}g}")
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.{digits}g}"


@dataclass(frozen=True, slots=True)
class PredictedIndexLines:
    """The table of predicted indices as text: its columns, its lines by test, and what the columns are."""

    columns: list[str]
    tests: list[tuple[str, list[list[str]]]]
    legend: str


def predicted_index_lines(table: IndexTable) -> PredictedIndexLines:
    """The table of predicted indices as text, without the columns in which nothing stands."""
    values = [
        (None if row.measured is None else row.measured.value, None if row.before == row.after else row.before,
         row.after, _bound(row, "low"), _bound(row, "high"), row.replayed, row.held_out)
        for row in table.rows
    ]  # fmt: skip
    shown = [number for number in range(len(_PREDICTED_INDEX_COLUMNS)) if any(row[number] for row in values)]
    tests: dict[str, list[list[str]]] = {}
    for row, cells in zip(table.rows, values, strict=True):
        time = "" if row.start is None else f"{row.start:%H:%M:%S} "
        title = f"{time}{row.test}{' to ' * bool(row.side)}{row.side}"
        name = f"{plain_name(row.name)} [{unit_in_name(row.name)}]{' (worse)' * row.is_worse}"
        numbers = ["" if (value := cells[number]) is None else plain_number(value) for number in shown]
        if shown[:1] == [0] and row.measured is not None and isfinite(row.measured.high - row.measured.low):
            numbers[0] += f" \u00b1 {plain_number(0.5 * (row.measured.high - row.measured.low), 2)}"
        tests.setdefault(title, []).append([name, *numbers])
    columns = [list(_PREDICTED_INDEX_COLUMNS)[number] for number in shown]
    legend = "; ".join(f"{name.removesuffix(' from')}: {what}" for name in columns
                       if (what := _PREDICTED_INDEX_COLUMNS[name]))  # fmt: skip
    return PredictedIndexLines(columns, list(tests.items()), legend)


def _bound(row: PredictedIndex, name: str) -> float | None:
    """A bound of a predicted index; None where it has none."""
    bound = nan if row.predicted is None else float(getattr(row.predicted, name))
    return bound if isfinite(bound) else None


def predicted_index_view(table: IndexTable) -> list[RenderableType]:
    """The table of predicted indices for a terminal; nothing of an empty one."""
    if not table.rows:
        return []
    lines = predicted_index_lines(table)
    view = terminal_table("Indices", ["", *lines.columns], (), pad_edge=False)
    for title, rows in lines.tests:
        view.add_row(title, style="bold")
        for row in rows:
            view.add_row(f"  {row[0]}", *row[1:])
    return [view, Text(f"{lines.legend}.", style="dim")]


def context_sentence(context: DeclaredContext) -> str:
    """What was declared of a trial beforehand, and what was left out for it; empty where nothing was."""
    sizes = [
        f"known {plain(name)}: {', '.join(f'{plain(key)} {value:g}' for key, value in values.items())}"
        for name, values in context.known.items()
    ]
    if not (context.declared or sizes):
        return ""
    left_out = join_words([plain(name) for name in context.excluded]) or "nothing"
    return f"Declared beforehand: {join_words([*context.declared, *sizes])}. Left out for that reason: {left_out}."


def plain(name: str) -> str:
    """A method's, an effect's or a channel's name for people.

    >>> plain("ocean_current")
    'ocean current'
    >>> plain("surge_force_rpm_below_0_surge_above_minus_0p5")
    'surge force rpm below 0 surge above \u22120.5'
    """
    return re.sub(r"(\d)p(\d)", r"\1.\2", name.replace("_", " ").replace("minus ", "\u2212"))


def prevent_line_breaks(text: str) -> str:
    """A text that is not broken over two lines."""
    return text.replace(" ", "\u00a0").replace("-", "\u2011")


def quantity_title(name: str) -> str:
    """A quantity's name with its unit in brackets.

    >>> quantity_title("yaw_rate_radps"), quantity_title("bow_angle_cos"), quantity_title("second")
    ('yaw rate [rad/s]', 'bow angle [cosine]', 'second')
    """
    quantity, _, suffix = name.rpartition("_")
    return (
        f"{quantity.replace('_', ' ')} [{UNITS[suffix]}]"
        if suffix in UNITS and quantity
        else name.replace("_", " ")
    )


def _short_method_name(method: str) -> str:
    """A method's name, of one of a user's own without its folders."""
    return method.rpartition("/")[2]


def _column_head(method: str) -> str:
    """A method at the head of a narrow column, a word a line.

    >>> _column_head("/home/me/mine.py:MeanMiss")
    'mine.py:\\nMeanMiss'
    """
    return _short_method_name(method).replace("_", "\n").replace(":", ":\n")


def validation_view(validation: Validation) -> RenderableType:
    """A row a method; below it a row a sensor, the errors by L/V, and a table a manoeuvre with its notes."""
    from seatrial.hybrid.report import trial_form

    shown: list[RenderableType] = [validation_table(validation)]
    if validation.truths:
        shown.append(truths_table(validation.truths))
    if validation.by_length:
        title, header, rows = trial_form.errors_after_lengths_table(
            validation.by_length, validation.windows.horizon_s
        )
        shown.append(terminal_table(title, header, rows, wrap=True))
    if validation.indices and (validation.indices.rows or validation.indices.left_out):
        shown += [
            terminal_table(title, trial_form.INDEX_HEADER, lines, title_style="bold")
            for title, lines in trial_form.index_tables(validation.indices)
        ]
        shown += [Text(note, style="dim") for note in trial_form.notes_on_index_tables(validation.indices)]
    return Group(*shown)


def truths_table(truths: ErrorsByTruth) -> Table:
    """A row a sensor that may judge: what a perfect prediction would err by, and what each method does."""
    names = list(next(iter(truths.by.values())).methods)
    return terminal_table(
        "judged by each sensor: mean distance m", ("", *map(_column_head, ("floor", *names))),
        truth_rows(truths), caption="floor: the error that a perfect prediction would show",
    )  # fmt: skip


def truth_rows(truths: ErrorsByTruth) -> list[list[str]]:
    """A row a sensor: its name, the floor, and the mean distance of each method [m]."""
    return [
        [
            name.replace("_", " "),
            *(f"{interval.value:.3f}" for interval in (sensor.floor_m, *sensor.methods.values())),
        ]
        for name, sensor in truths.by.items()
    ]


def validation_table(validation: Validation) -> Table:
    """One row a method, the best mean distance in bold."""
    notes = []
    if validation.reduction is not None and validation.coverage_95 is not None:
        reduced = f"{validation.reduction:.1%} less than the reference's"
        increased = f"{1 - validation.reduction:.1f} times the reference's"
        notes.append(f"hybrid's mean distance is {reduced if validation.reduction >= 0 else increased}")
        notes.append(f"the 95 % band holds {validation.coverage_95:.1%} of the positions")
    if validation.outside_domain is not None and validation.outside_domain.any():
        notes.append(
            f"{validation.outside_domain.sum()} windows start outside the calibrator's training range: there a "
            "weighted mean of reference and constant velocity replaces it"
        )
    if validation.outside:
        notes.append(f"{validation.outside} windows left out: the reference leaves its valid range in them")
    if validation.jumps:
        notes.append(f"{validation.jumps} windows left out: the positions jump in them")
    notes += left_out_notes(validation.not_free)
    windows = validation.windows
    kind = "held windows of {} s" if windows.commands is None else "windows of {} s under their commands"
    return terminal_table(
        f"{len(windows)} {kind.format(windows.horizon_s)}", ("method", *_METHOD_COLUMNS), *score_rows(validation),
        left_aligned=(0, 1), wrap=True, caption="; ".join(notes),
    )  # fmt: skip


def score_rows(validation: Validation) -> tuple[list[list[str]], int]:
    """A row a method: its name, what it starts from, distances and errors [m], heading error [deg]; and which is
    the best of those that look at nothing to come.
    """
    scores = list(validation.scores.values())
    rows = [
        [name.removesuffix(TWO_SIDED), start_state_of_method(name).replace("_", "-"),
         f"{errors.mean_distance_m:.3f}",
         f"{errors.end_distance_m:.3f}", f"{errors.mae_north_m:.3f}", f"{errors.mae_east_m:.3f}",
         f"{errors.heading_error_deg:.2f}"]
        for name, errors in (validation.scores | validation.two_sided).items()
    ]  # fmt: skip
    return rows, min(range(len(scores)), key=lambda row: scores[row].mean_distance_m)


def training_view(trained: TrainedCalibrator) -> Text:
    """What a calibrator was trained on, and what it is worth on the legs kept out."""
    metrics = trained.metrics
    shorter = f" and {metrics['shorter_windows']} shorter ones" if metrics["shorter_windows"] else ""
    return Text(
        f"trained on {metrics['training_windows']} windows{shorter}; on {metrics['held_out_windows']} windows of "
        f"legs kept out: reference {metrics['held_out_reference_m']:.2f} m, hybrid "
        f"{metrics['held_out_hybrid_m']:.2f} m"
    )


def prediction_table(prediction: Prediction) -> Table:
    """One row every few seconds."""
    track = prediction.as_dict()["track"]
    step = max(1, (len(track) - 1) // 10)
    rows = [
        [
            str(row["second"]),
            *("–" if row.get(key) is None else f"{row[key]:.2f}" for key in _PREDICTION_COLUMNS.values()),
        ]
        for row in track
        if row["second"] % step == 0 or row is track[-1]
    ]
    return terminal_table(
        f"{prediction.method} from {prediction.at.isoformat()}", ("second", *_PREDICTION_COLUMNS), rows,
        left_aligned=(),
        wrap=True, caption=_UNTRAINED if prediction.outside_domain else None,
    )  # fmt: skip


def evaluation_view(evaluation: Evaluation) -> Group:
    """A table of methods a split, the best in bold, then one of its breakdown by class.

    Of methods the mean distance and the ratio to the best baseline have their 95 % intervals; all others have
    theirs in the JSON and on the page.
    """
    tables = []
    for split in evaluation.splits.values():
        methods = [
            [_short_method_name(name), start, estimate_text(errors.mean_distance_m), estimate_text(errors.ratio),
             f"{errors.coverage_95.value:.1%}"]
            for start, summary in split.by_start.items()
            for name, errors in summary.methods.items()
        ]  # fmt: skip
        title = (
            f"{split.kind}: {MEANING[split.kind]}; {window_counts_text(split.causal)} of {evaluation.horizon_s} s"
        )
        best = list(split.causal.methods).index(split.causal.best)
        columns = ("", *_SPLIT_COLUMNS)
        tables.append(
            terminal_table(title, columns, methods, best, left_aligned=(0, 1), caption=split_caption(split))
        )
        if split.truths:
            tables.append(truths_table(split.truths))
        rows = list[list[str | Text]]()
        for name, summary in (entry for classes in split.dividing_classes.values() for entry in classes.items()):
            figures = [
                Text(f"{errors.mean_distance_m.value:.2f}", "bold" if method == summary.best else "")
                for method, errors in summary.methods.items()
            ]
            rows.append([name, f"{summary.windows}/{summary.legs}", *figures])
        if split.dividing_classes:
            title = f"{split.kind}: mean distance m by class, with windows/legs"
            tables.append(terminal_table(title, ("", "", *map(_column_head, split.causal.methods)), rows))
    if evaluation.leak:
        factors = [[name, estimate_text(factor)] for name, factor in evaluation.leak.items()]
        tables.append(terminal_table("error on unseen legs over random's", ("", "times"), factors))
    return Group(*tables)


def split_caption(split: SplitSummary) -> str:
    """What to know of a split's figures."""
    fitted = sorted({min(split.fitted), max(split.fitted)})
    draws = "1 draw" if len(split.fitted) == 1 else f"{len(split.fitted)} draws"
    parts = [f"{draws}, {' to '.join(map(str, fitted))} training windows",
             f"best baseline: {split.causal.best_baseline.replace('_', ' ')}"]  # fmt: skip
    if split.leaked:
        parts.append(f"{split.leaked:.0%} of the tested seconds were in the training data")
    beyond = [
        f"{name} {errors.outside_domain:.0%}"
        for name, errors in split.causal.methods.items()
        if errors.outside_domain >= _FEW
    ]
    if beyond:
        parts.append(f"windows that start outside the training range: {', '.join(beyond)}")
    if split.causal.legs < FEW_LEGS:
        parts.append("too few legs, so the intervals are too narrow")
    return "; ".join(parts)


def window_counts_text(summary: MethodSummary) -> str:
    """How many windows of how many legs, for people."""
    counts = {"window": summary.windows, "leg": summary.legs}
    return " of ".join(f"{count} {name}{'' if count == 1 else 's'}" for name, count in counts.items())


def estimate_text(interval: Interval) -> str:
    """A figure with its interval.

    >>> estimate_text(Interval(1.0, 0.5, 2.0))
    '1.00 (0.50-2.00)'
    """
    bounds = "" if interval.low != interval.low else f" ({interval.low:.2f}-{interval.high:.2f})"
    return f"{interval.value:.2f}{bounds}"


def plan_view(plan: Plan) -> RenderableType:
    """Both programmes, the size from which each effect is seen, and the pairs that cannot be distinguished."""
    programmes: list[RenderableType] = []
    pairs_left: list[RenderableType] = []
    for title, subject, programme in (
        ("Your programme", "Your programme", plan.asked), ("A better one", "The better one", plan.better)
    ):  # fmt: skip
        rows = [[f"{minutes} min", words] for minutes, words in programme_part_rows(programme)]
        programmes.append(Text(f"{title}, {programme.minutes:.3g} minutes", style="bold"))
        programmes.append(terminal_table(None, ("", ""), rows, left_aligned=(1,), show_header=False))
        pairs = programme.indistinguishable_pairs()
        listed = [f"  {name} and {rival}" for name, rival in pairs[:_MOST_PAIRS]]
        if len(pairs) > _MOST_PAIRS:
            listed.append(f"  and {len(pairs) - _MOST_PAIRS} pairs more")
        words = f"\n{subject} distinguishes all effects of ordinary size."
        if pairs:
            words = "\n".join([f"\n{subject} cannot distinguish, at ordinary size:", *listed])
        pairs_left.append(Text(words))
    limits = terminal_table("", ("effect", "yours", "better", "ordinary", ""), limit_rows(plan), pad_edge=False)
    return Group(*programmes, Text(f"\n{limits_heading(plan)}\n"), limits, *pairs_left)


def limits_heading(plan: Plan) -> str:
    """What the limits are limits of."""
    return (
        f"Found in nine of ten trials from this size on ({plan.vessel}, {plan.sea.name or 'own'} sea, the "
        f"tolerance {100.0 * plan.tolerance:g} % of the force range):"
    )


def limit_text(effect: Effect, limit: float) -> str:
    """A limit with three figures at most; a dash where no possible size is seen."""
    if not isfinite(limit) or limit <= 0.0:
        return "-"
    text = f"{limit:.0f}" if limit >= 100.0 else f"{limit:.2g}" if limit < 10.0 else f"{limit:.3g}"
    return f"<{text}" if effect.chart == "inverse_square" else text


def programme_part_rows(programme: Programme) -> list[list[str]]:
    """For how many minutes to do what."""
    return [[f"{part.minutes:.3g}", part.what] for part in programme.parts]


def limit_rows(plan: Plan) -> list[list[str]]:
    """The size from which each effect is seen, by either programme, its ordinary departure from neutral, and their
    unit."""
    rows = []
    for name, effect in plan.catalogue.items():
        first = effect.parameters[0]
        ordinary = first.typical if effect.chart == "inverse_square" else abs(first.typical - first.neutral)
        limits = [limit_text(effect, programme.limits[name]) for programme in (plan.asked, plan.better)]
        unit = first.unit.replace("1", "") or "factor"
        rows.append([name, *limits, limit_text(effect, ordinary).removeprefix("<"), unit])
    return rows


def catalogue_tables(catalogue: Catalogue) -> RenderableType:
    """Every effect by family: kind, what it does, its parameters and their sizes, rivals, source."""
    families: dict[str, list[Effect]] = {family: [] for family in FAMILIES}
    for effect in catalogue.values():
        families.setdefault(effect.family, []).append(effect)
    shown: list[RenderableType] = [
        Text(
            f"{len(catalogue)} effects, catalogue version {VERSION}. Ordinary: the usual size if present; "
            "smallest: of interest;\nin brackets: the usual error of every such sensor or drive."
        )
    ]
    for family, effects in families.items():
        table = Table(
            title=family, title_justify="left", title_style="bold", box=None, header_style="dim", leading=1
        )
        table.add_column("effect", no_wrap=True)
        table.add_column("what it does", ratio=1)
        for title in ("parameter", "neutral, bounds", "ordinary", "smallest"):
            table.add_column(title, no_wrap=True)
        for effect in effects:
            rows = []
            for parameter in effect.parameters:
                unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
                bounds = f"{parameter.neutral:g}, {parameter.low:g} to {parameter.high:g}"
                smallest = f"{parameter.smallest:g}"
                if parameter.tolerance:
                    smallest += f" ({parameter.tolerance:g})"
                rows.append((parameter.name + unit, bounds, f"{parameter.typical:g}", smallest))
            label = Text.assemble(effect.name, "\n", (f"{effect.kind}, {effect.scope}", "dim"))
            description = Text(effect.what)
            if effect.confused_with:
                description.append(f"\nlike: {', '.join(effect.confused_with)}", style="dim")
            description.append(f"\nsource: {effect.source}", style="dim")
            table.add_row(label, description, *("\n".join(column) for column in zip(*rows, strict=True)))
        if effects:
            shown.append(Padding(table, (1, 0, 0, 0)))
    return Group(*shown)


FAILED = "This section failed, which is a fault of Seatrial"
_LEVEL = 3  # of headings inside a section: that of the section is above


def sections(template: str, folder: Path | str | None = None, /, **context: Any) -> Callable[..., Page]:
    """A function that shows a template's blocks: ``show("gap", "map")``, with more ``context`` if need be.

    Parameters
    ----------
    template
        The page whose sections are shown: ``"trial.html"``, ``"diagnosis.html"``, ...
    folder
        Where their figures go as SVG, the numbers behind them as JSON.
    context
        What the page is made of: ``case`` for a trial (:func:`seatrial.load_case`), ``diagnosis`` and ``extras``
        for a diagnosis (:func:`seatrial.load_diagnosis`).

    Returns
    -------
    callable
        ``show(*blocks)`` returns a page with ``html`` and ``figures`` by name, which shows itself in a notebook. A
        section that these data do not allow says why in its place; the others stand.

    Examples
    --------
    >>> import seatrial as st
    >>> show = st.sections("trial.html", case=st.load_case(["trial.mcap"]), remark="", folder=None, links={})
    >>> list(show("cover").figures)
    ['track']
    """

    def show(*blocks: str, **block_context: Any) -> Page:
        values = {"level": _LEVEL, **context, **block_context}
        try:
            shown = [render(template, block, templates(), **values) for block in blocks]
        except SeatrialError as error:
            return _failure_note(f"This could not be made: {error_reason_in_words(str(error.at('')))}.")
        except Exception as error:  # one section that fails must not take the others with it
            traceback.print_exc()
            return _failure_note(f"{FAILED}: {type(error).__name__} {error}.")
        figures = {name: figure for section in shown for name, figure in section.figures.items()}
        for name, figure in figures.items() if folder is not None else ():
            write_figure(figure, Path(folder or ""), name, ("svg", "json"))
        return Page("".join(section.html for section in shown), figures)

    return show


def _failure_note(text: str) -> Page:
    return render("failure.html", templates=templates(), text=text)


@cache
def templates() -> Environment:
    """The templates of this package, with what they call."""
    from seatrial.analysis.manoeuvres.criteria import shortfalls_of_criteria
    from seatrial.analysis.speed_power import report as speed_power
    from seatrial.hybrid.diagnosis.result import read_diagnosis
    from seatrial.hybrid.report import diagnosis, pages, plots, text, trial, trial_form, trial_plots
    from seatrial.hybrid.report.prediction_errors import ENOUGH_S

    library = template_environment(Path(__file__).parent / "templates")
    library.filters |= {"percent": diagnosis.percent, "chance": diagnosis.chance, "cell_row": diagnosis.cell_row,
                     "readable_names": readable_names, "reason_of": error_reason_in_words,
                     "rows_in_words": lambda rows: [[readable_names(cell) for cell in row] for row in rows],
                     "sentence": lambda text: f"{text[:1].upper()}{text[1:]}."}  # fmt: skip
    library.globals |= {
        "trial": trial, "form": trial_form, "trial_plots": trial_plots, "diagnosis_words": diagnosis,
        "diagnosis_plots": plots, "pages": pages, "tables": text,
        "speed_power": speed_power, "read_diagnosis": read_diagnosis,
        "shortfalls_of": shortfalls_of_criteria, "FEW_LEGS": FEW_LEGS, "ENOUGH_S": ENOUGH_S,
    }  # fmt: skip
    return library
