"""Exports: the same values come back from every kind, and every product says where it comes from."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from openpyxl import load_workbook
from pymap3d import ned2geodetic
from scipy.io import loadmat, netcdf_file
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.errors import DataShortageError, InputError, StorageError
from seatrial.acquisition.core.ship import BY_NAME, NAMES
from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.acquisition.tables.import_table import import_table
from seatrial.acquisition.tables.table_files import read_raw_table
from seatrial.analysis.quality.findings import CheckResult
from seatrial.analysis.quality.repairs import Preparation, prepare_table
from seatrial.analysis.tables.export import add_flags, export_table, matlab_name
from seatrial.analysis.tables.resample import resample
from seatrial.analysis.tables.table import add_step, history_of, provenance_of, read_table
from tests.analysis.conftest import steady_table, table_at
from tests.conftest import nightly

KINDS = [".csv", ".parquet", ".mat", ".nc"]
TRIAL = Trial(name="voyage", vessel="gunnerus_long", origin_latitude_deg=63.4, origin_longitude_deg=10.4)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes under way at 5 Hz, with a stretch of headings missing."""
    from seatrial.hybrid.simulation.trial import simulate_trial

    table, _ = simulate_trial("gunnerus_short", "calm", "zigzag_20_20", 120.0, 5.0, 3)
    table.iloc[100:110, 2] = np.nan
    path = tmp_path_factory.mktemp("export") / "voyage.mcap"
    write_table(table, path, TRIAL)
    return path


def about(path: Path) -> dict[str, Any]:
    """The metadata of a product, whichever kind it is."""
    if path.suffix == ".parquet":
        texts = pq.read_schema(path).metadata
        return {key: json.loads(texts[f"seatrial.{key}".encode()]) for key in ("units", "trial", "provenance")}
    if path.suffix == ".csv":
        return dict(json.loads(path.with_name(f"{path.name}.json").read_text(encoding="utf-8")))
    if path.suffix == ".nc":
        with netcdf_file(path, mmap=False) as file:
            units = {name: getattr(each, "units", b"").decode() for name, each in file.variables.items()}
            said = {key: json.loads(getattr(file, key)) for key in ("trial", "provenance")}
        ours = {"degree": "deg", "degree s-1": "deg/s", "m s-1": "m/s", "m s-2": "m/s2"}
        return {"units": {name: ours.get(unit, unit) for name, unit in units.items()}, **said}
    loaded = loadmat(path, simplify_cells=True)
    provenance = {**loaded["provenance"]}
    provenance["options"], provenance["history"] = (json.loads(provenance[key]) for key in ("options", "history"))
    return {"units": loaded["units"], "trial": loaded["trial"], "provenance": provenance}


@settings(max_examples=12, deadline=None)
@given(
    values=st.lists(st.floats(-1e6, 1e6) | st.just(np.nan), min_size=1, max_size=20).filter(
        lambda values: bool(np.isfinite(values).any())
    ),
    start_us=st.integers(0, 10**12),
    suffix=st.sampled_from(KINDS),
)
@example(values=[1.0], start_us=65, suffix=".nc")
def test_any_number_comes_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, values: list[float], start_us: int, suffix: str
) -> None:
    """Times to the microsecond, which is what seconds since 1970 in a .mat can tell."""
    folder = tmp_path_factory.mktemp("any")
    table = table_at(np.arange(len(values)), {"north_m": values})
    table.index += pd.Timedelta(microseconds=start_us)
    export_table(table, folder / f"any{suffix}")
    import_table(folder / f"any{suffix}", folder / "any.mcap", allow_missing=True)
    pd.testing.assert_frame_equal(read_table(folder / "any.mcap"), table.dropna(), check_exact=True)


def test_a_track_is_where_the_ship_was(tmp_path: Path) -> None:
    """Two stretches with a hole between, in KML and GPX; a GPX is imported again."""
    table = steady_table(400).drop(index=steady_table(400).index[100:200])
    table.attrs["trial"] = {"name": "a <b> & c", "origin_latitude_deg": 63.4, "origin_longitude_deg": 10.4}
    for kind in ("kml", "gpx"):
        export_table(table, tmp_path / f"track.{kind}")
    lat, lon, _ = ned2geodetic(table["north_m"].to_numpy(), table["east_m"].to_numpy(), 0.0, 63.4, 10.4, 0.0)
    gpx = ElementTree.parse(tmp_path / "track.gpx").getroot()
    spaces = {"g": "http://www.topografix.com/GPX/1/1", "k": "http://www.opengis.net/kml/2.2"}
    assert [len(each) for each in gpx.findall(".//g:trkseg", spaces)] == [100, 200]
    assert gpx.findtext(".//g:name", "", spaces) == "a <b> & c"
    points = gpx.findall(".//g:trkpt", spaces)
    assert [float(each.attrib["lat"]) for each in points] == pytest.approx(lat, abs=1e-8)
    assert [float(each.attrib["lon"]) for each in points] == pytest.approx(lon, abs=1e-8)
    times = [pd.Timestamp(each.findtext("g:time", "", spaces)) for each in points]
    assert times == list(table.index.round("ms"))
    kml = ElementTree.parse(tmp_path / "track.kml").getroot()
    drawn = " ".join(each.text or "" for each in kml.findall(".//k:coordinates", spaces)).split()
    assert drawn == [f"{point.attrib['lon']},{point.attrib['lat']}" for point in points]


def test_a_track_without_an_origin_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataShortageError, match=r"no latitude and longitude.*origin"):
        export_table(steady_table(60), tmp_path / "track.kml")


def test_a_workbook_holds_the_table_and_text_is_no_formula(tmp_path: Path) -> None:
    table = steady_table(60)
    table.attrs["trial"] = {"name": "=1+1", "vessel": "ship"}
    for name in ("first", "second"):
        export_table(table, tmp_path / f"{name}.xlsx")
    assert (tmp_path / "first.xlsx").read_bytes() == (tmp_path / "second.xlsx").read_bytes()
    book = load_workbook(tmp_path / "first.xlsx")
    data = book["data"]
    assert [cell.value for cell in data[1]] == ["time [UTC]", *table.columns]
    assert data.cell(2, 1).value == table.index[0].tz_localize(None).to_pydatetime()
    assert {cell.data_type for row in book["about"].iter_rows() for cell in row} <= {"s", "n"}
    values = [[cell.value for cell in row[1:]] for row in data.iter_rows(min_row=2)]
    assert np.array(values, dtype=float) == pytest.approx(table.to_numpy(), rel=1e-12)


def test_a_workbook_of_ours_is_imported_by_its_names(tmp_path: Path) -> None:
    table = steady_table(60)
    table.attrs["trial"] = {"name": "=1+1", "vessel": "ship", "water_depth_m": "12.5"}
    export_table(table, tmp_path / "trial.xlsx")
    import_table(tmp_path / "trial.xlsx", tmp_path / "back.mcap")
    back = read_table(tmp_path / "back.mcap")
    pd.testing.assert_frame_equal(back[list(table)], table, check_freq=False, check_names=False, rtol=1e-12)
    trial = read_recording(tmp_path / "back.mcap").trial
    assert (trial.name, trial.vessel, trial.water_depth_m) == ("=1+1", "ship", 12.5)


def test_a_short_workbook_of_ours_that_people_changed_is_imported(tmp_path: Path) -> None:
    export_table(steady_table(60).iloc[:10], tmp_path / "trial.xlsx")
    book = load_workbook(tmp_path / "trial.xlsx")
    for row in range(2, 5):
        cell = book["data"].cell(row, 1)
        cell.value = f"{cell.value:%Y-%m-%dT%H:%M:%S}Z"
    book.save(tmp_path / "trial.xlsx")
    import_table(tmp_path / "trial.xlsx", tmp_path / "back.mcap")
    assert len(read_table(tmp_path / "back.mcap")) == 10
    del book["about"]
    book.create_sheet("about")
    book.save(tmp_path / "other.xlsx")
    assert "time [UTC]" in read_raw_table(tmp_path / "other.xlsx").columns


@pytest.mark.parametrize("suffix", KINDS)
def test_every_product_says_where_it_comes_from(recording: Path, tmp_path: Path, suffix: str) -> None:
    table = resample(add_step(read_table(recording), "repair", text="put right"), 2.0)
    written = export_table(table, tmp_path / f"voyage{suffix}", {"rate_hz": 2.0, "repair": True})
    assert all(path.exists() for path in written)
    said = about(tmp_path / f"voyage{suffix}")
    assert {name: said["units"][name] for name in NAMES} == {name: BY_NAME[name].unit for name in NAMES}
    assert said["trial"]["vessel"] == "gunnerus_long"
    provenance = said["provenance"]
    assert provenance["recording"] == "voyage.mcap"
    assert provenance["recording_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert provenance["software_version"].startswith("seatrial")
    assert provenance["options"] == {"rate_hz": 2.0, "repair": True}
    assert [step["step"] for step in provenance["history"]] == ["repair", "resample"]


def test_the_same_table_gives_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    for name in ("first", "second"):
        for suffix in (".csv", ".parquet"):
            export_table(read_table(recording), tmp_path / name / f"table{suffix}")
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes()


def test_a_csv_opens_without_options(recording: Path, tmp_path: Path) -> None:
    export_table(read_table(recording), tmp_path / "voyage.csv")
    frame = pd.read_csv(tmp_path / "voyage.csv")
    assert list(frame.columns) == ["time", *NAMES]
    assert frame["north_m"].dtype == float
    assert pd.to_datetime(frame["time"]).dt.tz is not None


def test_names_are_such_that_matlab_takes_them(tmp_path: Path) -> None:
    assert matlab_name("port_rpm") == "port_rpm"
    assert matlab_name("2nd speed (m/s)") == "x2nd_speed__m_s_"
    assert len(matlab_name("a" * 80)) == 63
    table = table_at([0, 1], {"starboard_order_angle_deg": [1.0, 2.0]}).assign(starboard_order_angle_deg_sigma=0.1)
    export_table(table, tmp_path / "long.mat")
    loaded = loadmat(tmp_path / "long.mat", simplify_cells=True)
    assert loaded["starboard_order_angle_deg_sigma"].tolist() == [0.1, 0.1]
    assert loaded["units"]["starboard_order_angle_deg_sigma"] == "deg"


def test_a_recording_that_is_gone_has_no_hash(tmp_path: Path) -> None:
    table = steady_table(3)
    assert provenance_of(table)["recording_sha256"] is None
    table.attrs["recording"] = str(tmp_path / "gone.mcap")
    assert provenance_of(table)["recording"] == "gone.mcap"
    assert provenance_of(table)["recording_sha256"] is None


@pytest.mark.parametrize("suffix", KINDS)
def test_a_product_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"table{suffix}").mkdir()
    with pytest.raises(StorageError, match="cannot be written"):
        export_table(steady_table(3), tmp_path / f"table{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"table{suffix}"]
    with pytest.raises(InputError, match="parquet"):
        export_table(steady_table(3), tmp_path / "table.docx")


def test_a_row_gets_the_gravest_flag_of_the_samples_it_stands_for() -> None:
    raw = table_at(np.arange(0.0, 4.1, 0.25), {"surge_mps": np.ones(17), "north_m": np.full(17, np.nan)})
    flags = pd.DataFrame({"surge_mps": np.ones(17, np.uint8), "north_m": np.full(17, 9, np.uint8)}, index=raw.index)
    flags.loc[raw.index[7], "surge_mps"] = 4  # at 1.75 s: of the second at 2
    flags.loc[raw.index[12], "surge_mps"] = 3  # at 3 s
    result = add_flags(resample(raw), flags)
    assert result["surge_mps_flag"].tolist() == [1, 1, 4, 3, 1]
    assert result["north_m_flag"].tolist() == [9] * 5
    late = add_flags(resample(raw, delays={"surge_mps": 1.0}), flags, {"surge_mps": 1.0})
    assert late["surge_mps_flag"].tolist() == [1, 1, 4, 3, 1]
    assert late.index[0] == raw.index[0] - pd.Timedelta(seconds=1)
    pd.testing.assert_series_equal(add_flags(raw, flags)["surge_mps_flag"], flags["surge_mps"], check_names=False)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["export", *arguments])


@pytest.fixture(scope="module")
def everything(recording: Path) -> pd.DataFrame:
    """Uncertainties, flags, repairs and delays in one table."""
    how = Preparation(smooth=True, flags=True, repair=True, remove_delays=True)
    return prepare_table(read_recording(recording), how)


@pytest.mark.parametrize("suffix", KINDS)
def test_a_product_with_everything_in_it_imports_again(
    everything: pd.DataFrame, tmp_path: Path, suffix: str
) -> None:
    """Columns that say something of a channel are passed over, and the channels have their values."""
    export_table(everything, tmp_path / f"all{suffix}")
    said = about(tmp_path / f"all{suffix}")
    assert said["provenance"]["history"][-1]["step"] == "smooth"
    assert (said["units"]["north_m_sigma"], said["units"]["surge_mps2"]) == ("m", "m/s2")
    import_table(tmp_path / f"all{suffix}", tmp_path / "again.mcap")
    again = read_table(tmp_path / "again.mcap")
    pd.testing.assert_frame_equal(again, everything[list(NAMES)].loc[again.index], check_freq=False)
    assert everything[list(NAMES)].drop(again.index).isna().all(axis=None)


def test_a_smoothed_table_has_its_uncertainties_and_its_flags(everything: pd.DataFrame, recording: Path) -> None:
    motion = everything.dropna(subset="north_m")
    assert len(motion) > 100
    assert (motion[[f"{name}_sigma" for name in NAMES[:6]]] > 0).all(axis=None)
    assert set(everything["heading_deg_flag"].unique()) <= {1, 2, 3, 4, 9}
    plain = resample(read_table(recording))
    assert (everything["port_rpm"] - plain["port_rpm"]).abs().max() < 1e-9
    assert (motion["heading_deg_sigma"] < 1.0).all()


def test_the_command_writes_what_was_asked_for(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "voyage.csv"
    done = run(str(recording), "-o", str(path), "--remove-delays", "--rate", "2")
    assert done.exit_code == 0, done.output
    assert done.stdout.strip() == str(path)
    assert "voyage.csv.json" in done.stderr
    options = {"rate_hz": 2.0, "repair": False, "remove_delays": True, "smooth": False, "flags": False}
    assert about(path)["provenance"]["options"] == options
    assert len(pd.read_csv(path)) == pytest.approx(240, abs=2)


def test_raw_export_with_flags_keeps_every_row(recording: Path, tmp_path: Path) -> None:
    assert run(str(recording), "-o", str(tmp_path / "raw.parquet"), "--flags").exit_code == 0
    frame, table = pd.read_parquet(tmp_path / "raw.parquet"), read_table(recording)
    pd.testing.assert_frame_equal(frame[list(NAMES)], table, check_exact=True, check_freq=False)
    assert (frame["heading_deg_flag"][table["heading_deg"].isna()] == 9).all()
    assert not history_of(table)


@pytest.mark.parametrize("rate_hz", [1.0, *nightly(None)])
def test_flags_beside_repaired_values_are_those_after_the_repair(
    recording: Path, tmp_path: Path, rate_hz: float | None
) -> None:
    """What a spike left is a gap, and the second it was in is judged by its other samples."""
    spoilt = read_table(recording)
    spoilt.loc[spoilt.index[[100, 200, 300]], "north_m"] += 500.0
    spoilt.loc[spoilt.index[400], "surge_mps"] = 99.0
    write_table(spoilt, tmp_path / "spoilt.mcap", Trial())
    before, after = (
        prepare_table(read_recording(tmp_path / "spoilt.mcap"), Preparation(rate_hz, repair=each, flags=True))
        for each in (False, True)
    )
    assert (before["north_m_flag"] == 4).sum() == 3
    for name in ("north_m", "surge_mps"):
        assert not (after[f"{name}_flag"] == 4).any()
        assert (after[f"{name}_flag"][after[name].isna()] == 9).all()
    assert after["north_m"].max() < spoilt["north_m"].max() - 200.0


def test_delays_are_those_of_the_check_which_leaves_impossible_values_out(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One look at the motion serves repairs, flags and delays."""
    from seatrial.analysis.quality import check

    looks = []

    def motion(table: pd.DataFrame) -> CheckResult:
        looks.append(float(table["surge_mps"].max()))
        return CheckResult(pd.DataFrame(index=table.index))

    monkeypatch.setattr(check, "CHECKS", (motion,))
    prepare_table(read_recording(recording), Preparation(1.0, repair=True, remove_delays=True, flags=True))
    assert len(looks) == 1
    assert looks[0] < 30.0
