"""The catalogue as people read it in a terminal: one table a family."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from hybrid.effects.catalogue import VERSION, Catalogue
from hybrid.vessel.effect import FAMILIES, Effect, Parameter

WIDTH = 112
"""The fewest columns in which the tables can be read."""


def catalogue_tables(catalogue: Catalogue) -> RenderableType:
    """Every effect by family: kind, what it does, its parameters and their sizes, rivals, source."""
    own = dict.fromkeys(effect.family for effect in catalogue.values() if effect.family not in FAMILIES)
    tables = [_family(name, catalogue) for name in (*FAMILIES, *own)]
    heading = Text(
        f"{len(catalogue)} effects, catalogue version {VERSION}. Ordinary: the size to expect where it is there; "
        "smallest: of interest,\nin brackets the error that every such sensor or drive has anyway."
    )
    return Group(heading, *(Padding(table, (1, 0, 0, 0)) for table in tables if table.row_count))


def _family(name: str, catalogue: Catalogue) -> Table:
    table = Table(title=name, title_justify="left", title_style="bold", box=None, header_style="dim", leading=1)
    table.add_column("effect", no_wrap=True)
    table.add_column("what it does", ratio=1)
    for title in ("parameter", "neutral, bounds", "ordinary", "smallest"):
        table.add_column(title, no_wrap=True)
    for effect in catalogue.values():
        if effect.family == name:
            columns = zip(*(_sizes(each) for each in effect.parameters), strict=True)
            table.add_row(_name(effect), _described(effect), *("\n".join(column) for column in columns))
    return table


def _name(effect: Effect) -> Text:
    return Text.assemble(effect.name, "\n", (effect.kind, "dim"))


def _described(effect: Effect) -> Text:
    text = Text(effect.what)
    for line in _remarks(effect):
        text.append(f"\n{line}", style="dim")
    return text


def _remarks(effect: Effect) -> Iterator[str]:
    if effect.confused_with:
        yield f"like: {', '.join(effect.confused_with)}"
    yield f"source: {effect.source}"


def _sizes(each: Parameter) -> tuple[str, str, str, str]:
    """Name and unit; neutral and bounds; ordinary size; smallest size of interest, tolerance beside it."""
    unit = "" if each.unit == "1" else f" [{each.unit}]"
    smallest = f"{each.smallest:g}" + (f" ({each.tolerance:g})" if each.tolerance else "")
    bounds = f"{each.neutral:g}, {each.low:g} to {each.high:g}"
    return each.name + unit, bounds, f"{each.typical:g}", smallest
