"""What is in a folder says which report it gets; what cannot be told is one clear error."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

import seatrial
from seatrial.acquisition.core.errors import InputError, SeatrialError, StorageError
from seatrial.hybrid.report.folder import (
    Choices,
    batch_options,
    kind_of_folder,
    recordings_in_folder,
    write_reports,
)


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("diagnosis.json", "diagnosis"),
        ("table3.json", "reproduction"),
        ("figure_04_tracks.png", "reproduction"),
        ("index.parquet", "batch"),
        ("trial.mcap", "trial"),
        ("recordings/trial.mcap", "trial"),
    ],
)
def test_a_folder_is_known_by_what_lies_in_it(file: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    path.write_text("")
    assert kind_of_folder(tmp_path) == kind


def test_recordings_of_their_own_folder_come_before_what_lies_about(tmp_path: Path) -> None:
    """A voyage that was played, in the folder itself, is not what was recorded."""
    (tmp_path / "recordings").mkdir()
    for name in ("voyage.mcap", "recordings/b.mcap", "recordings/a.mcap", "recordings/.part.mcap"):
        (tmp_path / name).write_text("")
    assert [path.name for path in recordings_in_folder(tmp_path)] == ["a.mcap", "b.mcap"]


def test_a_folder_with_nothing_to_tell_says_what_it_would_take(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"contains nothing to report on.*diagnosis\.json"):
        write_reports(tmp_path, Choices())
    with pytest.raises(InputError, match="does not exist"):
        write_reports(tmp_path / "x", Choices())
    (tmp_path / "index.parquet").write_text("")
    with pytest.raises(InputError, match="--recordings"):
        write_reports(tmp_path, Choices())


def test_the_command_says_in_one_line_what_is_wrong(tmp_path: Path) -> None:
    result = CliRunner().invoke(seatrial.app, ["report", str(tmp_path)])
    assert isinstance(result.exception, InputError)
    assert "\n" not in str(result.exception)


def test_a_file_that_is_no_recording_and_a_name_that_is_taken_are_clear_errors(tmp_path: Path) -> None:
    (tmp_path / "trial.csv").write_text("time")
    with pytest.raises(InputError, match=r"is not a recording.*seatrial import"):
        write_reports(tmp_path / "trial.csv", Choices())
    (tmp_path / "trial.mcap").write_text("")
    (tmp_path / "trial").write_text("")
    with pytest.raises(StorageError, match="is a file"):
        write_reports(tmp_path / "trial.mcap", Choices())


def test_a_diagnosis_that_is_damaged_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text("{")
    with pytest.raises(InputError, match=r"diagnosis\.json"):
        write_reports(tmp_path, Choices())


def test_options_of_a_batch_are_those_of_its_results(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "summary.json").write_text("{}")  # somebody else's
    with pytest.raises(SeatrialError, match="options"):
        batch_options(tmp_path)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "summary.json").write_text(json.dumps({"provenance": {"options": {"horizon_s": 30}}}))
    assert batch_options(tmp_path).horizon_s == 30


@pytest.mark.pages
def test_a_batch_leads_to_the_report_of_each_recording(unseen: Path, tmp_path: Path) -> None:
    """The links are there after the reports, and again when the batch is run anew."""
    from seatrial.analysis.batch import run_batch
    from seatrial.analysis.products import Options

    batch_folder, out = tmp_path / "batch_folder", tmp_path / "out"
    batch_folder.mkdir()
    shutil.copy(unseen, batch_folder / "trial.mcap")
    run_batch(batch_folder, out, workers=1, options=Options(smooth=False, pictures=False))
    assert "report.html" not in (out / "index.html").read_text()
    index, page = write_reports(out, Choices(interactive=False), batch_folder)
    assert (index, page) == (out.resolve() / "index.html", out / "trial" / "report.html")
    assert 'href="trial/report.html"' in index.read_text()
    assert run_batch(batch_folder, out, workers=1, options=Options(smooth=False, pictures=False)).reused == 1
    assert 'href="trial/report.html"' in index.read_text()
