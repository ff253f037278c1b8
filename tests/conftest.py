"""What all tests share: where the recorded data lie, if they are here."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data; the test is skipped, saying so, where it is missing."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("SEATRIAL_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no recorded data at {folder}; set SEATRIAL_DATA to the folder that holds them")
    return folder
