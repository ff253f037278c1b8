"""Products on disk, before they are there."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.core.errors import StorageError
from seatrial.acquisition.core.files import make_folder


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")

    with pytest.raises(StorageError) as error:
        make_folder(tmp_path / "taken")

    assert error.value.where == str(tmp_path / "taken")
