"""A plan as people read it in a terminal of 80 columns."""

from __future__ import annotations

from math import isfinite

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from hybrid.effects import Effect
from hybrid.planning.plan import Plan, Programme

_MOST_PAIRS = 12


def plan_tables(plan: Plan) -> RenderableType:
    """Both programmes, the size from which each effect is seen, and what could not be told apart."""
    return Group(
        _parts("Your programme", plan.asked),
        _parts("A better one", plan.better),
        Text(f"\n{heading_of(plan)}\n"),
        _limits(plan),
        _alike("Your programme", plan.asked),
        _alike("The better one", plan.better),
    )


def heading_of(plan: Plan) -> str:
    """What the limits are limits of."""
    return (
        f"Seen in nine of ten trials from this departure on ({plan.vessel}, {plan.sea.name or 'own'} sea, the "
        f"model granted {100.0 * plan.tolerance:g} % of the force range):"
    )


def limit_text(effect: Effect, limit: float) -> str:
    """A limit with three figures at most; a dash where no possible size is seen."""
    if not isfinite(limit) or limit <= 0.0:
        return "-"
    text = f"{limit:.0f}" if limit >= 100.0 else f"{limit:.2g}" if limit < 10.0 else f"{limit:.3g}"
    return f"<{text}" if effect.chart == "inverse_square" else text


def ordinary_text(effect: Effect) -> str:
    """Its ordinary departure from neutral."""
    first = effect.parameters[0]
    size = first.typical if effect.chart == "inverse_square" else abs(first.typical - first.neutral)
    return limit_text(effect, size).removeprefix("<")


def _parts(title: str, programme: Programme) -> RenderableType:
    table = Table(box=None, show_header=False)
    table.add_column(justify="right", no_wrap=True)
    table.add_column()
    for part in programme.parts:
        table.add_row(f"{part.minutes:.3g} min", part.what)
    return Group(Text(f"{title}, {programme.minutes:.3g} minutes", style="bold"), table)


def _limits(plan: Plan) -> Table:
    table = Table(box=None, header_style="dim", pad_edge=False)
    table.add_column("effect", no_wrap=True)
    for title in ("yours", "better", "ordinary"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for name, effect in plan.catalogue.items():
        first = effect.parameters[0]
        unit = "" if first.unit == "1" else first.unit
        limits = [limit_text(effect, each.limits[name]) for each in (plan.asked, plan.better)]
        table.add_row(name, *limits, ordinary_text(effect), unit)
    return table


def _alike(title: str, programme: Programme) -> Text:
    pairs = programme.alike()
    if not pairs:
        return Text(f"\n{title} tells all effects of ordinary size apart.")
    listed = [f"  {name} and {rival}" for name, rival in pairs[:_MOST_PAIRS]]
    more = [f"  and {len(pairs) - _MOST_PAIRS} pairs more"] if len(pairs) > _MOST_PAIRS else []
    return Text("\n".join([f"\n{title} does not tell apart, at ordinary size:", *listed, *more]))
