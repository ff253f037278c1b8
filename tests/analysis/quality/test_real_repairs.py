"""What is repaired unasked of recordings of real ships: only what is known to be wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial import app
from seatrial.analysis.quality.repairs import repair_table
from seatrial.analysis.tables.table import read_table

pytestmark = [pytest.mark.shared, pytest.mark.slow]

MAPS = Path(__file__).parents[3] / "trials" / "columns"
ANSWERS = {"hakusan": ["unit.yaw rate=deg/s"]}
FAULTS = {
    "esso_osaka": {"channel_delay", "yaw_rate_scale"},
    "gunnerus_2022_trials": {"heading_wrap_interpolated", "speed_scale", "order_interpolated"},
}
"""What is wrong on the whole with a folder's recordings: heading and speeds of a filter that lags by nearly a
second, a yaw rate 1.5 % low; a table that was interpolated, through north too, speeds 2 % low."""
SINGLE_VALUES = {"spike", "stuck", "out_of_range", "duplicate"}
FOLDERS = (
    "esso_osaka", "gunnerus_2019_docking", "gunnerus_2022_trials", "gunnerus_vico_short_turn", "hakusan",
    "kvlcc2_hsva", "milliampere", "otter", "usv_rudder",
)  # fmt: skip


@pytest.mark.parametrize("folder", FOLDERS)
def test_only_known_faults_are_repaired_unasked(shared_data: Path, tmp_path: Path, folder: str) -> None:
    from seatrial.analysis.quality.check import check_table

    sources = sorted((shared_data / folder).rglob("*.csv*"))
    if not sources:
        pytest.skip(f"no recordings in {shared_data / folder}")
    columns = MAPS / f"{folder}.toml"
    options = ["--columns", str(columns)] if columns.is_file() else ["--yes"]
    answers = [part for answer in ANSWERS.get(folder, []) for part in ("--answer", answer)]
    for number, source in enumerate(sources):
        output = tmp_path / f"{number}.mcap"
        result = CliRunner().invoke(app, ["import", str(source), "-o", str(output), *options, *answers])
        assert result.exit_code == 0, result.output
        table = read_table(output)
        quality = check_table(table)
        repairs = repair_table(table, quality.findings).repairs
        assert {each.code for each in repairs} - SINGLE_VALUES <= FAULTS.get(folder, set()), source.name
