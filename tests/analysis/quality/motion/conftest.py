"""A real recording whose findings several tests are about."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.quality.findings import Finding
from seatrial.analysis.quality.motion.findings import check_motion
from seatrial.analysis.tables.table import read_table

MAPS = Path(__file__).parents[4] / "trials" / "columns"


@pytest.fixture(scope="session")
def findings_of_2022(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Finding, ...]:
    """Of R/V Gunnerus' trials of October 2022."""
    name, path = "gunnerus_2022_trials", tmp_path_factory.mktemp("trials") / "trials.mcap"
    import_table(shared_data / name / "trials_2022-10-27_part1.csv", path, MAPS / f"{name}.toml")
    return check_motion(read_table(path)).findings
