"""A notebook run with parameters, what its cells call, and what came of it as one page of HTML that needs no
network.

Sources are Python files in jupytext's percent format, one cell of each tagged ``parameters``. Papermill runs them;
what their cells show, sections of a report, is set in the look of all pages. The executed notebook stays beside the
page, to go on from.
"""

from __future__ import annotations

import html
import logging
import os
import re
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import quote

from jinja2 import Environment
from markupsafe import Markup

from acquisition.core import errors
from acquisition.core.errors import ConfigurationError, SeatrialError
from acquisition.core.files import atomic_file
from acquisition.core.progress import Progress
from analysis.report.figures import write_figure
from analysis.report.rendering import Page, environment, render
from analysis.tables.files import make_folder

if TYPE_CHECKING:
    from nbformat import NotebookNode
    from papermill.exceptions import PapermillExecutionError


FAILED = "This section failed, which is a fault of Seatrial"
_LEVEL = 3  # of headings inside a section: the notebook's own are above


def sections(template: str, folder: Path | str, /, **context: Any) -> Callable[..., Page]:
    """A function that shows a template's blocks: ``show("gap", "map")``, with more ``context`` if need be.

    Their figures go into ``folder`` as SVG and PDF, the numbers behind them as JSON. A section that these data do
    not allow says why in its place; the others stand.
    """

    def show(*blocks: str, **more: Any) -> Page:
        values = {"level": _LEVEL, **context, **more}
        try:
            shown = [render(template, block, templates(), **values) for block in blocks]
        except SeatrialError as error:
            return _note(f"This could not be made: {error}")
        except Exception as error:  # one section that fails must not take the others with it
            traceback.print_exc()  # into the executed notebook
            return _note(f"{FAILED}: {type(error).__name__} {error}. The executed notebook has the trace.")
        figures = {name: figure for section in shown for name, figure in section.figures.items()}
        for name, figure in figures.items():
            write_figure(figure, Path(folder), name)
        return Page("".join(section.html for section in shown), figures)

    return show


def _note(text: str) -> Page:
    return render("failure.html", templates=templates(), text=text)


@cache
def templates() -> Environment:
    """The templates of this package, with what they call."""
    from hybrid.diagnosis.serialisation import read_diagnosis
    from hybrid.report import (
        diagnosis_map_plots,
        diagnosis_plots,
        diagnosis_words,
        evaluation_page,
        trial_plots,
        trial_sections,
    )
    from hybrid.report.diagnosis_words import chance, percent

    made = environment(Path(__file__).parent / "templates")
    made.filters |= {"percent": percent, "chance": chance, "cell_row": diagnosis_words.cell_row}
    made.globals |= {
        "trial": trial_sections, "trial_plots": trial_plots, "diagnosis_words": diagnosis_words,
        "diagnosis_plots": diagnosis_plots, "map_plots": diagnosis_map_plots, "evaluation": evaluation_page,
        "read_diagnosis": read_diagnosis,
    }  # fmt: skip
    return made


def links(pages: Mapping[str, str | None]) -> Page:
    """Links to pages beside this one, by what they are; those that are None are left out, empty ones are no
    links."""
    known = {what: quote(where) for what, where in pages.items() if where is not None}
    return render("links.html", templates=templates(), links=known)


SOURCES = Path(__file__).resolve().parents[2] / "notebooks"
NAMES = ("trial_validation", "paper_reproduction", "missing_effect", "fidelity_map")
_TIMEOUT_S = 6 * 3600  # of a cell: the fidelity map takes its time on few cores
_SECTION = re.compile(r'<h2 id="([^"]+)">(.*?)</h2>')


def run_notebook(
    name: str,
    parameters: Mapping[str, Any],
    page: Path,
    subtitle: str,
    progress: Progress = lambda share: None,
) -> Path:
    """Run one of :data:`NAMES` and write ``page``, and the executed notebook beside it under the page's name.

    Raises :class:`SeatrialError` with the cell's own error where a cell fails, :class:`StorageError` where nothing
    can be written.
    """
    make_folder(page.parent)
    executed = page.with_suffix(".ipynb")
    notebook = executed_notebook(SOURCES / f"{name}.py", parameters, executed, progress)
    whole = render("base.html", title=title_of(notebook), subtitle=subtitle, body=Markup(body_of(notebook)))
    return whole.write(page)


def executed_notebook(
    source: Path, parameters: Mapping[str, Any], executed: Path, progress: Progress = lambda share: None
) -> NotebookNode:
    """The notebook of a source, run with ``parameters`` and written to ``executed``; errors as above."""
    import jupytext
    import papermill
    from papermill.exceptions import PapermillExecutionError

    if not source.is_file():
        raise ConfigurationError("the notebooks are not installed", where=str(source), fix="run from a checkout")
    logging.getLogger("papermill").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as place:
        unrun, running = Path(place) / f"{source.stem}.ipynb", Path(place) / "running.ipynb"
        cells = jupytext.read(source)
        jupytext.write(cells, unrun)

        def ran(cell_index: int, **_: Any) -> None:
            progress(cell_index / (len(cells.cells) + 1))

        try:
            with _importable():
                # in an empty folder: Python files beside a recording are nothing that a report may import
                notebook = papermill.execute_notebook(
                    unrun, running, dict(parameters), kernel_name="python3", progress_bar=False,
                    cwd=place, execution_timeout=_TIMEOUT_S, autosave_cell_every=0,
                    extra_arguments=["--log-level=CRITICAL"], on_cell_executed=ran,
                )  # fmt: skip
        except PapermillExecutionError as error:
            _keep(running, executed)
            raise _error_of(error, executed) from error
        _keep(running, executed)
    progress(1.0)
    return cast("NotebookNode", notebook)


def _keep(running: Path, executed: Path) -> None:
    """Put the notebook in its place; one that was interrupted is not kept, and the older stays."""
    with atomic_file(executed) as partial:
        shutil.copyfile(running, partial)


def _error_of(error: PapermillExecutionError, executed: Path) -> SeatrialError:
    """What went wrong in a cell: our own errors say it themselves."""
    if hasattr(errors, error.ename):
        return SeatrialError(str(error.evalue))
    return SeatrialError(
        f"cell {error.exec_count} of the notebook failed", where=str(executed),
        why=f"{error.ename}: {error.evalue}", fix="open the notebook: the cell is marked in it",
    )  # fmt: skip


@contextmanager
def _importable() -> Iterator[None]:
    """The notebook's process imports the packages that this one runs from, quietly."""
    before = dict(os.environ)
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(SOURCES.parent), before.get("PYTHONPATH")]))
    os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def title_of(notebook: NotebookNode) -> str:
    """The text of the first heading."""
    for cell in notebook.cells:
        found = re.search(r"^# (.+)$", cell.source, re.MULTILINE) if cell.cell_type == "markdown" else None
        if found:
            return found[1].strip()
    return "Report"


def body_of(notebook: NotebookNode) -> str:
    """What the cells say and show, without their code, as HTML, its sections listed before the first of them.

    The first heading is the page's title and left out.
    """
    from nbconvert.filters import markdown2html

    parts, first = [], True
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            text = re.sub(r"^# .+$", "", cell.source, count=1, flags=re.MULTILINE) if first else cell.source
            first = False
            parts.append(_without_anchors(markdown2html(text)))
        elif cell.cell_type == "code":
            parts += [_shown(output) for output in cell.get("outputs", [])]
    return _with_contents("\n".join(parts))


def _with_contents(body: str) -> str:
    """``body`` with links to its sections before the first of them."""
    found = _SECTION.findall(body)
    links = " · ".join(f'<a href="#{where}">{what}</a>' for where, what in found)
    return _SECTION.sub(lambda first: f"<nav>{links}</nav>{first[0]}", body, count=1) if len(found) > 2 else body


def _without_anchors(markup: str) -> str:
    return re.sub(r'<a class="anchor-link"[^>]*>.*?</a>', "", markup)


def _shown(output: Mapping[str, Any]) -> str:
    """One output: markup as it is, text as text; warnings on stderr are for the executed notebook."""
    if output["output_type"] == "stream":
        return f"<pre>{html.escape(output['text'])}</pre>" if output["name"] == "stdout" else ""
    data = output.get("data", {})
    if "text/html" in data:
        return str(data["text/html"])
    return f"<pre>{html.escape(str(data['text/plain']))}</pre>" if "text/plain" in data else ""
