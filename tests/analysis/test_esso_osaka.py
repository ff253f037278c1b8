"""A second real ship, with one propeller and one rudder: the recordings of the 3 m model of Esso Osaka."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from scipy.signal import lfilter

from seatrial.acquisition.core.ship import angle_difference
from seatrial.acquisition.tables.import_table import import_table
from seatrial.analysis.tables.table import seconds_of
from tests.conftest import nightly

COLUMNS = Path(__file__).parents[2] / "trials" / "columns" / "esso_osaka.toml"
TRIALS = [
    *(f"berthing/berthing_12-Nov-2020_{time}" for time in ("11_07_23", "11_14_47")),
    *(f"random/random_31-Jul-2020_{time}" for time in ("12_29_58", "12_48_39", "14_52_18")),
    *(f"turning/turn_14-Sep-2020_{time}" for time in ("13_39_32", "13_51_45", "14_16_04", "14_50_41")),
    *(f"zigzag/zigzag_31-Jul-2020_{time}" for time in ("13_04_24", "13_14_21", "13_22_52", "13_29_19")),
]


@pytest.fixture(scope="session")
def esso_osaka(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Path]]:
    """The published table of each trial and the recording that is made of it."""
    folder = tmp_path_factory.mktemp("esso_osaka")
    tables = {name: shared_data / "esso_osaka" / f"{name}.csv.gz" for name in TRIALS}
    if not all(path.is_file() for path in tables.values()):
        pytest.skip(f"no recordings of Esso Osaka in {shared_data}")
    return {name: (path, folder / f"{Path(name).name}.mcap") for name, path in tables.items()}


@pytest.mark.parametrize("name", [*TRIALS[::3], *nightly(*(name for name in TRIALS if name not in TRIALS[::3]))])
def test_every_table_becomes_a_recording_with_its_own_numbers(
    esso_osaka: dict[str, tuple[Path, Path]], name: str
) -> None:
    from seatrial.acquisition.recording.reader import read_recording

    table, output = esso_osaka[name]
    summary = import_table(table, output, COLUMNS)
    recording, source = read_recording(output), pd.read_csv(table)
    assert (summary.rows, summary.missing, summary.passed_over) == (len(source), (), ())
    assert (summary.out_of_range, summary.times_backwards) == ({}, 0)
    assert recording.trial.actuators == "propeller:propeller, rudder:rudder"
    for row in np.linspace(0, len(source) - 1, 5).astype(int):
        cells = source.iloc[row]
        value = {name: float(series.value[row]) for name, series in recording.series.items()}
        assert value["north_m"] == cells["x_position_mid [m]"]
        assert value["propeller_rpm"] == pytest.approx(60.0 * cells["n_prop [rps]"])
        assert value["rudder_angle_deg"] == pytest.approx(np.rad2deg(cells["delta_rudder [rad]"]))
        for angle, of in {
            "heading_deg": "psi_hat [rad]", "wind_direction_deg": "wind_dir_true [rad]",
            "apparent_wind_angle_deg": "wind_dir_relative_mid [rad]",
        }.items():  # fmt: skip
            assert 0.0 <= value[angle] < 360.0
            assert float(angle_difference(value[angle], np.rad2deg(cells[of]))) == pytest.approx(0.0, abs=1e-9)
    measured = recording.series["north_m"].measured_ns
    assert np.ptp(measured) == pytest.approx(1e9 * np.ptp(source["t [s]"]))
    ends = pd.to_datetime(name.split("_", 1)[1], format="%d-%b-%Y_%H_%M_%S").tz_localize("Asia/Tokyo")
    assert pd.Timestamp(measured[-1], tz="UTC") == ends


def test_no_two_trials_of_a_day_overlap(esso_osaka: dict[str, tuple[Path, Path]]) -> None:
    """What says that the time in a file's name is that of its last row."""
    days = defaultdict(list)
    for name, (table, _) in esso_osaka.items():
        ends = pd.to_datetime(name.split("_", 1)[1], format="%d-%b-%Y_%H_%M_%S")
        days[ends.date()].append((ends - pd.Timedelta(seconds=float(pd.read_csv(table)["t [s]"].max())), ends))
    for spans in days.values():
        assert all(one[1] <= other[0] for one, other in zip(sorted(spans), sorted(spans)[1:], strict=False))


FINDINGS = {"channel_delay", "yaw_rate_scale", "yaw_rate_bias", "stuck", "spike", "quantised"}
"""What is wrong with these recordings, as looked at by hand: heading and speeds of a filter that lags by nearly a
second, a yaw rate 1.5 % low and in the berthing trials a second late, positions that a receiver repeated once or
for a second, orders of a byte."""
QUARTERS_S = 400.0
"""A recording shorter than this has no quarters that could be fitted each by itself."""
MANOEUVRED_THROUGHOUT = ("random/random_31-Jul-2020_12_29_58", "random/random_31-Jul-2020_12_48_39")
"""Trials of which every quarter has manoeuvres enough to confirm a delay."""


@pytest.mark.slow
@pytest.mark.parametrize("name", TRIALS)
def test_nothing_is_found_in_them_that_is_not_there(esso_osaka: dict[str, tuple[Path, Path]], name: str) -> None:
    from seatrial.acquisition.tables.import_table import read_table_file
    from seatrial.analysis.quality.check import check_table

    path, _ = esso_osaka[name]
    file = read_table_file(path, COLUMNS)
    file.table.attrs["trial"] = file.trial.as_metadata()
    quality = check_table(file.table)
    assert {each.code for each in quality.findings} <= FINDINGS
    assert all(channel.grade != "bad" for channel in quality.channels.values())
    assert sum(channel.spikes for channel in quality.channels.values()) < 0.005 * len(file.table)
    turned = file.table.assign(rudder_angle_deg=-file.table["rudder_angle_deg"])
    if name.startswith(("turning", "zigzag")):
        assert "helm_sign" in {each.code for each in check_table(turned).findings}
    late = {each.channel: each for each in quality.findings if each.code == "channel_delay"}
    assert late["north_m"].estimate["seconds"] == pytest.approx(-lag_of_speeds_s(pd.read_csv(path)), abs=0.1)
    assert late["north_m"].certain or name not in MANOEUVRED_THROUGHOUT
    assert not late["north_m"].certain or np.ptp(seconds_of(file.table)) > QUARTERS_S
    assert late.keys() <= {"north_m", "yaw_rate_dps"} if name.startswith("berthing") else {"north_m"}


def lag_of_speeds_s(source: pd.DataFrame) -> float:
    """The delay of heading and speeds in slow motion: the mean of the lag of first order through which the
    positions give their path best, by trying.

    It is a lag and no delay: its effect on the positions is four times nearer to the path than that of any delay.
    Such a lag delays slow motion by its time constant and faster motion by less.
    """
    north, ahead, east, aside, psi = source.iloc[:, 1:6].to_numpy().T
    path = 0.1 * np.cumsum((ahead + 1j * aside) * np.exp(1j * np.unwrap(psi)))
    position = (north - north[0]) + 1j * (east - east[0])
    shifts, constants = np.arange(20), np.arange(0.5, 1.6, 0.05)
    weights = 1.0 - np.exp(-0.1 / constants)
    by_delay = [_wandering(position[: len(position) - shift] - path[shift:]) for shift in shifts]
    by_lag = [_wandering(lfilter([weight], [1.0, weight - 1.0], position) - path) for weight in weights]
    assert min(by_lag) < 0.4 * min(by_delay)
    best = weights[int(np.argmin(by_lag))]
    return 0.1 * float((1.0 - best) / best)


def _wandering(misfit: npt.NDArray[np.complex128]) -> float:
    """Standard deviation of a misfit at 10 Hz about its mean over 40 s, without the ends."""
    return float(np.abs(misfit - np.convolve(misfit, np.ones(401) / 401.0, "same"))[250:-200].std())
