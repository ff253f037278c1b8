"""``seatrial reproduce``: the paper's results from scratch. It parses, calls and prints; nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from acquisition.cli import PREDICTIONS, AsJson
from hybrid.cli.options import SeaStateOption, WorkersOption

Folder = Annotated[Path | None, typer.Option("-o", "--output", help="A folder for the results.")]
Seed = Annotated[int, typer.Option(min=0, help="The same seed gives the same figures.")]


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line."""
    reproduce = typer.Typer(no_args_is_help=True)
    reproduce.command("table3", help="Table III on sequences never seen, beside the random split.")(table3)
    reproduce.command("figures", help="The figures of the paper, in our own style.")(figures)
    reproduce.command("fidelity", help="How bad may the reference be before it stops helping?")(fidelity)
    app.add_typer(
        reproduce, name="reproduce", help="The paper's results, from scratch.", rich_help_panel=PREDICTIONS
    )


def table3(
    output: Folder = None,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="So many campaigns in each sea state.")] = 5,
    workers: WorkersOption = None,
    as_json: AsJson = False,
) -> None:
    """Compare all methods in the paper's three sea states."""
    from acquisition.core.progress import bar
    from analysis.tables.files import make_folder
    from hybrid.reproduction.campaign import seas_of
    from hybrid.reproduction.page import terminal_tables, write_table3
    from hybrid.reproduction.table3 import papers_jobs
    from hybrid.reproduction.table3 import table3 as table_of

    if output is not None:
        make_folder(output)
    with bar("campaigns") as progress:
        seas = seas_of(papers_jobs(seed, seeds), workers, progress)
    table = table_of([each for sea in seas for each in sea.errors])
    if output is not None:
        from hybrid.reproduction.figures import shown_of, write_drawn
        from hybrid.reproduction.page import write_page

        shown = shown_of([sea for sea in seas if sea.job.seed == seed])
        write_drawn(shown, output)
        for path in (*write_table3(table, output), write_page(table, output, shown)):
            typer.echo(path, err=True)
    if as_json:
        typer.echo(json.dumps(table.as_dict()))
        return
    from rich.console import Console

    Console().print(*terminal_tables(table), sep="\n")


def figures(
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder that the figures go into.")] = Path(
        "reproduction"
    ),
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Draw the figures."""
    from acquisition.core.progress import bar
    from analysis.tables.files import make_folder
    from hybrid.reproduction.figures import write_figures

    make_folder(output)
    with bar("figures") as progress:
        paths = write_figures(output, seed, progress)
    if as_json:
        typer.echo(json.dumps({"figures": [str(path) for path in paths]}))
        return
    for path in paths:
        typer.echo(path)


def fidelity(
    output: Folder = None,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Means over so many draws of the windows learned from.")] = 2,
    sea_state: SeaStateOption = "gentle",
    method: Annotated[str, typer.Option(help="The calibrator that is put on every reference.")] = "paper",
    workers: WorkersOption = None,
    as_json: AsJson = False,
) -> None:
    """Degrade the reference step by step and learn from ever more windows: runs the notebook ``fidelity_map``."""
    from tempfile import TemporaryDirectory

    from acquisition.core.progress import bar
    from hybrid.calibrators import refuse_unknown
    from hybrid.report.notebook import run_notebook
    from hybrid.simulation.sea_state import sea_state_named

    refuse_unknown(method)
    sea_state_named(sea_state)
    with TemporaryDirectory() as temporary, bar("fidelity") as progress:
        folder = Path(temporary) if output is None else output.resolve()
        asked = {"sea_state": sea_state, "method": method, "seed": seed, "seeds": seeds, "workers": workers}
        page = folder / "fidelity_map.html"
        run_notebook("fidelity_map", {**asked, "folder": str(folder)}, page, f"{method}, {sea_state} sea", progress)
        found = json.loads((folder / "fidelity_map.json").read_text(encoding="utf-8"))
    if output is not None:
        for path in sorted(output.glob("fidelity_map*")):
            typer.echo(path, err=True)
    if as_json:
        typer.echo(json.dumps(found))
        return
    for sentence in found["reading"]:
        typer.echo(sentence)
