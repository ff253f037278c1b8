"""Copies of finished parts: the same byte for byte, and nothing is deleted that has none."""

from __future__ import annotations

import os
import shutil
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from seatrial.acquisition.config.sources import CopiesSection
from seatrial.acquisition.config.trial_file import parse_config
from seatrial.acquisition.core.errors import ConfigurationError, StorageError
from seatrial.acquisition.logger import maintenance as copies_module
from seatrial.acquisition.logger.maintenance import Copies, copy_part_verified, have_same_content
from seatrial.acquisition.logger.record import record
from seatrial.acquisition.recording import writer
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import read_recording
from tests.acquisition.conftest import PATIENCE_S, config_text, free_port

NAMES = [
    "trial_20260517T120000Z.mcap", "trial_20260517T120000Z_part00002.mcap", "trial_20260517T120000Z_part00003.mcap",
]  # fmt: skip
SIZE = 3_000_000


class Aboard:
    """Three parts of a recording, the last still being written, a stranger's file, and a folder for copies."""

    def __init__(self, folder: Path, keep_gb: float | None) -> None:
        self.here, self.there = folder / "here", folder / "there"
        self.told: list[str] = []
        for each in (self.here, self.there):
            each.mkdir()
        for number, name in enumerate(NAMES):
            (self.here / name).write_bytes(bytes([number]) * SIZE)
        (self.here / "other_20260101T000000Z.mcap").write_bytes(b"x" * SIZE)
        written = SimpleNamespace(
            paused=False,
            path=self.here / NAMES[-1],
            paths=[self.here / NAMES[-1]],
            tell=lambda level, text: self.told.append(f"{level}: {text}"),
        )
        self.copies = Copies(CopiesSection(self.there, keep_gb), self.here, "trial", cast(RecordingParts, written))
        self.copies.copy_new_parts()  # the first look sees how long they are

    def names(self, folder: Path) -> list[str]:
        return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def aboard(tmp_path: Path) -> Aboard:
    return Aboard(tmp_path, SIZE * 1.5 / 1e9)


def test_a_copy_that_hangs_does_not_keep_the_recorder_from_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("_LONGEST_FINISH_S", "_LONGEST_STOP_S", "_LOOK_EVERY_S"):
        monkeypatch.setattr(copies_module, name, 0.05)
    hanging, release = threading.Event(), threading.Event()

    def hang(path: Path, folder: Path, rest: object) -> None:
        hanging.set()
        release.wait(PATIENCE_S)

    monkeypatch.setattr(copies_module, "copy_part_verified", hang)
    aboard = Aboard(tmp_path, None)
    assert aboard.copies.start()
    assert hanging.wait(PATIENCE_S)
    aboard.copies.stop()
    release.set()


def test_what_is_finished_is_copied_and_what_grows_is_not(tmp_path: Path) -> None:
    aboard = Aboard(tmp_path, None)
    with (aboard.here / NAMES[1]).open("ab") as growing:
        growing.write(b"more")
    aboard.copies.copy_new_parts()
    assert aboard.names(aboard.there) == NAMES[:1]
    aboard.copies.copy_new_parts()
    assert aboard.names(aboard.there) == NAMES[:2]
    assert all((aboard.here / name).read_bytes() == (aboard.there / name).read_bytes() for name in NAMES[:2])
    assert len(aboard.names(aboard.here)) == 4
    assert not aboard.told
    assert aboard.copies.state.waiting == 0


def test_the_oldest_make_room_and_strangers_stay(aboard: Aboard) -> None:
    aboard.copies.copy_new_parts()
    assert aboard.names(aboard.here) == ["other_20260101T000000Z.mcap", NAMES[2]]
    assert aboard.names(aboard.there) == NAMES[:2]
    assert [text.split()[1] for text in aboard.told] == NAMES[:2]
    assert all("verified" in text for text in aboard.told)


def test_a_spoilt_copy_is_made_anew_before_anything_is_deleted(aboard: Aboard) -> None:
    """Of the same length, with one bit turned: only reading it tells."""
    original = (aboard.here / NAMES[0]).read_bytes()
    (aboard.there / NAMES[0]).write_bytes(original[:-1] + bytes([original[-1] ^ 1]))
    aboard.copies.copy_new_parts()
    assert not (aboard.here / NAMES[0]).exists()
    assert (aboard.there / NAMES[0]).read_bytes() == original
    assert any("other" in name for name in aboard.names(aboard.there))  # what was there is moved aside


def test_a_disk_that_does_not_keep_what_it_is_given_costs_no_part(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil = shutil.copystat

    def copystat(source: Path, target: Path) -> None:
        spoil(source, target)
        with Path(target).open("r+b") as stream:
            stream.write(b"\xff")

    monkeypatch.setattr(copies_module.shutil, "copystat", copystat)
    for _ in range(3):
        aboard.copies.copy_new_parts()
    assert len(aboard.names(aboard.here)) == 4
    assert not aboard.names(aboard.there)
    assert len(aboard.told) == 1
    assert "reads back differently" in aboard.told[0]
    assert aboard.copies.state.waiting == 2
    monkeypatch.undo()
    aboard.copies.copy_new_parts()
    assert sum("go on" in text for text in aboard.told) == 1
    assert aboard.names(aboard.there) == NAMES[:2]


def test_a_folder_that_is_away_is_told_once_and_not_made(aboard: Aboard) -> None:
    aboard.there.rmdir()
    for _ in range(3):
        aboard.copies.copy_new_parts()
    assert len(aboard.told) == 1
    assert "does not exist" in aboard.copies.state.trouble
    assert not aboard.there.exists()
    assert len(aboard.names(aboard.here)) == 4


def test_a_disk_that_is_full_is_not_filled_further(aboard: Aboard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "free_and_total_bytes", lambda folder: (SIZE - 1, 10 * SIZE))
    aboard.copies.copy_new_parts()
    assert "is full" in aboard.told[0]
    assert not aboard.names(aboard.there)
    assert len(aboard.names(aboard.here)) == 4


@pytest.mark.parametrize("link", [os.link, os.symlink])
def test_another_name_of_a_file_is_no_copy(aboard: Aboard, link: object) -> None:
    original = (aboard.here / NAMES[0]).read_bytes()
    link(aboard.here / NAMES[0], aboard.there / NAMES[0])  # type: ignore[operator]
    assert not have_same_content(aboard.here / NAMES[0], aboard.there / NAMES[0])
    aboard.copies.copy_new_parts()
    assert not (aboard.here / NAMES[0]).exists()
    assert (aboard.there / NAMES[0]).read_bytes() == original


def test_a_copy_that_cannot_be_made_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(StorageError):
        copy_part_verified(tmp_path / "gone.mcap", tmp_path / "there")
    assert not list((tmp_path / "there").iterdir())


def test_every_part_of_a_recording_is_copied_when_it_ends(tmp_path: Path) -> None:
    (tmp_path / "copies").mkdir()
    text = config_text(f'type = "udp"\nport = {free_port()}\n') + '\n[copies]\nfolder = "copies"\n'
    paths, _ = record(parse_config(text, tmp_path / "trial.toml"), tmp_path / "here", duration_s=0.2)
    assert [(tmp_path / "copies" / path.name).read_bytes() for path in paths] == [
        each.read_bytes() for each in paths
    ]
    assert paths[0].parent == tmp_path / "here"
    made_room, _ = record(
        parse_config(f"{text}keep_gb = 1e-9\n", tmp_path / "trial.toml"), tmp_path / "here", duration_s=0.2
    )
    assert [path.parent for path in made_room] == [tmp_path / "copies"]
    assert read_recording(made_room[0]).closed
    with pytest.raises(ConfigurationError, match="is the folder of the recordings"):
        record(parse_config(text, tmp_path / "trial.toml"), tmp_path / "copies", duration_s=0.2)
