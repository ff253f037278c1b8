"""A small case: one voyage held against a model and a calibrator that was trained on little."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.hybrid.report.trial import TrialCase, load_case


@pytest.fixture(scope="session")
def case(unseen: Path, small_folder: Path) -> TrialCase:
    """With a calibrator."""
    return load_case([unseen], small_folder)


@pytest.fixture(scope="session")
def bare(unseen: Path) -> TrialCase:
    """Without one."""
    return load_case([unseen])
