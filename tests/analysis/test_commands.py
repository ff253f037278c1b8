"""The commands ashore: what they say of themselves, files they refuse to write, what is in those they do."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from rich.text import Text
from typer.testing import CliRunner

from acquisition.errors import InputError
from acquisition.recording.tables import write_table
from acquisition.trial import Trial
from hybrid.truth.trial import simulate_trial
from seatrial import app

RUN = CliRunner()


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few minutes at sea."""
    path = tmp_path_factory.mktemp("commands") / "voyage.mcap"
    write_table(simulate_trial("gunnerus_short", "gentle", "voyage", 300.0, 2.0, seed=2)[0], path, Trial("voyage"))
    return path


def command_parameters() -> list[tuple[str, str]]:
    commands: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    return [
        (f"{name} {parameter.name}", parameter.help or "")
        for name, command in commands.items()
        for parameter in command.params
    ]


def test_no_help_text_loses_its_units() -> None:
    """What stands in brackets would be taken for a style and vanish from the screen."""
    for where, text in command_parameters():
        shown = Text.from_markup(text).plain
        assert shown == text, where
        assert not re.search(r" [.,;]( |$)", shown), where


@pytest.mark.parametrize(
    "words", [("smooth", "{file}", "-o", "{out}.csv"), ("windows", "{file}", "-o", "{out}.csv"),
              ("check", "{file}", "--repair", "{out}.csv"), ("export", "{file}", "-o", "{out}.xlsx")],
)  # fmt: skip
def test_no_file_is_written_under_the_suffix_of_another_kind(
    words: tuple[str, ...], recording: Path, tmp_path: Path
) -> None:
    run = RUN.invoke(app, [each.format(file=recording, out=tmp_path / "out") for each in words])
    assert isinstance(run.exception, InputError)
    assert "name it ." in str(run.exception)
    assert not list(tmp_path.iterdir())


def test_a_window_of_one_second_is_refused_by_the_parser(recording: Path, tmp_path: Path) -> None:
    run = RUN.invoke(app, ["windows", str(recording), "-o", str(tmp_path / "w.parquet"), "--horizon", "1"])
    assert run.exit_code == 2


def test_the_same_recording_gives_the_same_bytes_in_every_format(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for suffix in (".parquet", ".csv", ".mat"):
        first, second = tmp_path / "first" / f"table{suffix}", tmp_path / "second" / f"table{suffix}"
        for path, day in ((first, "Mon Jan  1 00:00:00 2001"), (second, "Tue Jan  2 00:00:00 2029")):
            monkeypatch.setattr("time.asctime", lambda *_, day=day: day)
            assert RUN.invoke(app, ["export", str(recording), "-o", str(path)]).exit_code == 0
        assert first.read_bytes() == second.read_bytes()
