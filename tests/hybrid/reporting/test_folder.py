"""What is in a folder says which report it gets; what cannot be told is one clear error."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

import seatrial
from acquisition.core.errors import InputError, SeatrialError, StorageError
from hybrid.report.folder import Choices, batch_options, kind_of, recordings_in, report
from hybrid.report.notebook import SOURCES, body_of, executed_notebook, title_of


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("diagnosis.json", "missing_effect"),
        ("table3.json", "paper_reproduction"),
        ("figure_04_tracks.png", "paper_reproduction"),
        ("index.parquet", "batch"),
        ("trial.mcap", "trial_validation"),
        ("recordings/trial.mcap", "trial_validation"),
    ],
)
def test_a_folder_is_known_by_what_lies_in_it(file: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    path.write_text("")
    assert kind_of(tmp_path) == kind


def test_recordings_of_their_own_folder_come_before_what_lies_about(tmp_path: Path) -> None:
    """A voyage that was played, in the folder itself, is not what was recorded."""
    (tmp_path / "recordings").mkdir()
    for name in ("voyage.mcap", "recordings/b.mcap", "recordings/a.mcap", "recordings/.part.mcap"):
        (tmp_path / name).write_text("")
    assert [path.name for path in recordings_in(tmp_path)] == ["a.mcap", "b.mcap"]


def test_a_folder_with_nothing_to_tell_says_what_it_would_take(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds nothing to report on.*diagnosis\.json"):
        report(tmp_path, Choices())
    with pytest.raises(InputError, match="does not exist"):
        report(tmp_path / "x", Choices())
    (tmp_path / "index.parquet").write_text("")
    with pytest.raises(InputError, match="--recordings"):
        report(tmp_path, Choices())


def test_the_command_says_in_one_line_what_is_wrong(tmp_path: Path) -> None:
    result = CliRunner().invoke(seatrial.app, ["report", str(tmp_path)])
    assert isinstance(result.exception, InputError)
    assert "\n" not in str(result.exception)


def test_a_file_that_is_no_recording_and_a_name_that_is_taken_are_clear_errors(tmp_path: Path) -> None:
    (tmp_path / "trial.csv").write_text("time")
    with pytest.raises(InputError, match=r"is not a recording.*seatrial import"):
        report(tmp_path / "trial.csv", Choices())
    (tmp_path / "trial.mcap").write_text("")
    (tmp_path / "trial").write_text("")
    with pytest.raises(StorageError, match="is a file"):
        report(tmp_path / "trial.mcap", Choices())


def test_a_diagnosis_that_is_damaged_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text("{")
    with pytest.raises(InputError, match=r"diagnosis\.json"):
        report(tmp_path, Choices())


def test_options_of_a_batch_are_those_of_its_results(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "summary.json").write_text("{}")  # somebody else's
    with pytest.raises(SeatrialError, match="options"):
        batch_options(tmp_path)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "summary.json").write_text(json.dumps({"provenance": {"options": {"horizon_s": 30}}}))
    assert batch_options(tmp_path).horizon_s == 30


@pytest.mark.parametrize("name", ["trial_validation", "paper_reproduction", "missing_effect"])
def test_every_notebook_has_one_cell_of_parameters_and_little_code(name: str) -> None:
    import jupytext

    notebook = jupytext.read(SOURCES / f"{name}.py")
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.metadata.get("tags") for cell in code].count(["parameters"]) == 1
    assert code[0].metadata["tags"] == ["parameters"]
    assert max(len(cell.source.splitlines()) for cell in code) <= 12
    assert title_of(notebook) != "Report"


SMALL = """# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A title
#
# Text with *stress*.

# %% tags=["parameters"]
x = 1

# %%
print(x, "<b>")

# %%
{last}
"""


@pytest.mark.pages
def test_what_a_notebook_prints_is_text_and_what_it_shows_is_markup(tmp_path: Path) -> None:
    source = tmp_path / "small.py"
    source.write_text(SMALL.format(last="from hybrid.report.notebook import Page\nPage('<i>kept</i>')"))
    notebook = executed_notebook(source, {"x": 7}, tmp_path / "small.ipynb")
    body = body_of(notebook)
    assert "7 &lt;b&gt;" in body
    assert "<i>kept</i>" in body
    assert "<em>stress</em>" in body
    assert "A title" not in body  # it is the page's
    assert json.loads((tmp_path / "small.ipynb").read_text())["cells"]


@pytest.mark.pages
def test_python_files_beside_a_recording_are_not_imported(tmp_path: Path) -> None:
    """A folder that somebody sent may hold a pandas.py of its own."""
    (tmp_path / "pandas.py").write_text("raise SystemExit('imported')")
    source = tmp_path / "small.py"
    source.write_text(SMALL.format(last="import pandas\nprint(pandas.__name__, hasattr(pandas, 'DataFrame'))"))
    notebook = executed_notebook(source, {}, tmp_path / "small.ipynb")
    assert "pandas True" in body_of(notebook)


@pytest.mark.pages
def test_a_cell_that_fails_is_one_clear_error_and_the_notebook_stays(tmp_path: Path) -> None:
    source = tmp_path / "small.py"
    source.write_text(SMALL.format(last="raise ValueError('no such thing')"))
    with pytest.raises(
        SeatrialError, match=r"cell \d+ of the notebook failed.*ValueError: no such thing"
    ) as caught:
        executed_notebook(source, {}, tmp_path / "small.ipynb")
    assert "\n" not in str(caught.value)
    assert "ValueError" in (tmp_path / "small.ipynb").read_text()


@pytest.mark.pages
def test_a_batch_leads_to_the_report_of_each_recording(unseen: Path, tmp_path: Path) -> None:
    """The links are there after the reports, and again when the batch is run anew."""
    from analysis.batch.batch import run_batch
    from analysis.products import Options

    batch_folder, out = tmp_path / "batch_folder", tmp_path / "out"
    batch_folder.mkdir()
    shutil.copy(unseen, batch_folder / "trial.mcap")
    run_batch(batch_folder, out, workers=1, options=Options(smooth=False, pictures=False))
    assert "report.html" not in (out / "index.html").read_text()
    index, page = report(out, Choices(interactive=False), batch_folder)
    assert (index, page) == (out.resolve() / "index.html", out / "trial" / "report.html")
    assert 'href="trial/report.html"' in index.read_text()
    assert run_batch(batch_folder, out, workers=1, options=Options(smooth=False, pictures=False)).reused == 1
    assert 'href="trial/report.html"' in index.read_text()
