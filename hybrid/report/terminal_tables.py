"""Results as tables for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from hybrid.effects.catalogue import VERSION, Catalogue
from hybrid.vessel.effect import FAMILIES, Effect, Parameter

if TYPE_CHECKING:
    from hybrid.calibrators.predict import Prediction
    from hybrid.evaluation.validate import Validation

_UNTRAINED = "the start lies beyond what the calibrator was trained on: a baseline speaks in its place"
_COLUMNS = ("mean distance m", "at the end m", "north m", "east m", "heading deg")


def validation_table(validation: Validation) -> Table:
    """One row a method, the best mean distance in bold."""
    horizon_s = validation.windows.horizon_s
    table = Table(title=f"{len(validation.windows)} held windows of {horizon_s} s", title_justify="left",
                  box=None, header_style="dim", caption=_caption(validation), caption_justify="left")  # fmt: skip
    table.add_column("method")
    for title in _COLUMNS:
        table.add_column(title, justify="right")
    best = min(each.mean_distance_m for each in validation.scores.values())
    for name, each in validation.scores.items():
        numbers = (each.mean_distance_m, each.end_distance_m, each.mae_north_m, each.mae_east_m)
        cells = [f"{number:.3f}" for number in numbers] + [f"{each.heading_error_deg:.2f}"]
        table.add_row(name, *cells, style="bold" if each.mean_distance_m == best else "")
    return table


def _caption(validation: Validation) -> str:
    parts = []
    if validation.reduction is not None and validation.coverage_95 is not None:
        less = f"{validation.reduction:.1%} less than the reference's"
        more = f"{1 - validation.reduction:.1f} times the reference's"
        parts.append(f"hybrid's mean distance is {less if validation.reduction >= 0 else more}")
        parts.append(f"the 95 % band holds {validation.coverage_95:.1%} of the positions")
    if validation.outside_domain is not None and validation.outside_domain.any():
        parts.append(
            f"{validation.outside_domain.sum()} windows start beyond what the calibrator was trained on: there the "
            "better of reference and constant velocity speaks in its place, or both"
        )
    if validation.outside:
        parts.append(f"{validation.outside} windows left out: the reference leaves its range in them")
    return "; ".join(parts)


def prediction_table(prediction: Prediction) -> Table:
    """One row every few seconds."""
    rows = prediction.as_dict()["track"]
    step = max(1, (len(rows) - 1) // 10)
    table = Table(title=f"{prediction.method} from {prediction.at.isoformat()}", title_justify="left", box=None,
                  header_style="dim", caption=_UNTRAINED if prediction.outside_domain else None)  # fmt: skip
    for title in (
        "second",
        "north m",
        "east m",
        "heading deg",
        "95 % band m",
        "measured north m",
        "measured east m",
    ):
        table.add_column(title, justify="right")
    for row in rows:
        if row["second"] % step and row["second"] != len(rows) - 1:
            continue
        numbers = [row.get(key) for key in ("north_m", "east_m", "heading_deg", "band_m",
                                            "measured_north_m", "measured_east_m")]  # fmt: skip
        table.add_row(str(row["second"]), *("–" if each is None else f"{each:.2f}" for each in numbers))
    return table


CATALOGUE_WIDTH = 112
"""The fewest columns in which the tables of effects can be read."""


def catalogue_tables(catalogue: Catalogue) -> RenderableType:
    """Every effect by family: kind, what it does, its parameters and their sizes, rivals, source."""
    own = dict.fromkeys(effect.family for effect in catalogue.values() if effect.family not in FAMILIES)
    tables = [_family_table(name, catalogue) for name in (*FAMILIES, *own)]
    heading = Text(
        f"{len(catalogue)} effects, catalogue version {VERSION}. Ordinary: the size to expect where it is there; "
        "smallest: of interest,\nin brackets the error that every such sensor or drive has anyway."
    )
    return Group(heading, *(Padding(table, (1, 0, 0, 0)) for table in tables if table.row_count))


def _family_table(name: str, catalogue: Catalogue) -> Table:
    table = Table(title=name, title_justify="left", title_style="bold", box=None, header_style="dim", leading=1)
    table.add_column("effect", no_wrap=True)
    table.add_column("what it does", ratio=1)
    for title in ("parameter", "neutral, bounds", "ordinary", "smallest"):
        table.add_column(title, no_wrap=True)
    for effect in catalogue.values():
        if effect.family == name:
            columns = zip(*(_sizes(each) for each in effect.parameters), strict=True)
            table.add_row(_effect_name(effect), _effect_text(effect), *("\n".join(column) for column in columns))
    return table


def _effect_name(effect: Effect) -> Text:
    return Text.assemble(effect.name, "\n", (effect.kind, "dim"))


def _effect_text(effect: Effect) -> Text:
    text = Text(effect.what)
    if effect.confused_with:
        text.append(f"\nlike: {', '.join(effect.confused_with)}", style="dim")
    return text.append(f"\nsource: {effect.source}", style="dim")


def _sizes(each: Parameter) -> tuple[str, str, str, str]:
    """Name and unit; neutral and bounds; ordinary size; smallest size of interest, tolerance beside it."""
    unit = "" if each.unit == "1" else f" [{each.unit}]"
    smallest = f"{each.smallest:g}" + (f" ({each.tolerance:g})" if each.tolerance else "")
    bounds = f"{each.neutral:g}, {each.low:g} to {each.high:g}"
    return each.name + unit, bounds, f"{each.typical:g}", smallest
