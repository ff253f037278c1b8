"""The commands ashore: what they say of themselves, files they refuse to write, what is in those they do."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import typer
from rich.text import Text
from typer.testing import CliRunner

from seatrial import app
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.trial import Quality, Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.quality.check import check_recording, check_table
from seatrial.analysis.tables.export import read_parquet
from seatrial.analysis.tables.table import read_table
from seatrial.hybrid.simulation.trial import simulate_trial

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
              ("check", "{file}", "--repair", "{out}.csv"), ("export", "{file}", "-o", "{out}.docx")],
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


@pytest.fixture(scope="module")
def with_1970(recording: Path) -> Path:
    """The recording, its first row stamped by a clock that did not know the year yet."""
    table = read_table(recording)
    times = pd.DatetimeIndex(table.index).insert(0, pd.Timestamp(0, tz="UTC")).delete(1)
    path = recording.with_name("first_in_1970.mcap")
    write_table(table.set_axis(times.rename("time"), axis=0), path, Trial("voyage"))
    return path


@pytest.mark.parametrize(
    "words", [("export", "-o", "{out}/t.csv", "--rate", "1"), ("windows", "-o", "{out}/w.parquet"), ("manoeuvres",),
              ("smooth", "-o", "{out}/s.parquet")],
)  # fmt: skip
def test_a_stamp_of_1970_is_an_error_that_names_it_and_not_a_grid_of_56_years(
    words: tuple[str, ...], with_1970: Path, tmp_path: Path
) -> None:
    run = RUN.invoke(app, [words[0], str(with_1970), *(each.format(out=tmp_path) for each in words[1:])])
    assert isinstance(run.exception, InputError)
    for part in ("first_in_1970.mcap", "1970-01-01 00:00:00", "--repair"):
        assert part in str(run.exception)
    assert len(str(run.exception).splitlines()) == 1


def test_a_stamp_of_1970_is_found_flagged_and_mended(with_1970: Path, recording: Path, tmp_path: Path) -> None:
    quality = check_recording(read_recording(with_1970))
    assert [each.code for each in quality.findings] == ["time_outlier"]
    assert quality.findings[0].estimate["count"] == 13
    assert (quality.flags.iloc[0] == Quality.BAD).all()
    assert not (quality.flags.iloc[1:] == Quality.BAD).to_numpy().any()
    assert {each.count for each in quality.channels.values()} == {600}
    mended = tmp_path / "mended.mcap"
    run = RUN.invoke(app, ["check", str(with_1970), "-o", str(tmp_path), "--repair", str(mended)])
    assert run.exit_code == 0
    pd.testing.assert_frame_equal(read_table(mended), read_table(recording).iloc[1:])
    run = RUN.invoke(app, ["export", str(with_1970), "-o", str(tmp_path / "t.csv"), "--rate", "1", "--repair"])
    assert run.exit_code == 0


def test_half_a_recording_years_away_is_said_and_not_repaired(recording: Path) -> None:
    table = read_table(recording)
    late = pd.DatetimeIndex(table.index[300:]) + pd.Timedelta(days=900)
    quality = check_table(table.set_axis(table.index[:300].append(late), axis=0))
    outlier = next(each for each in quality.findings if each.code == "time_outlier")
    assert not outlier.certain
    assert "900 days" in outlier.text


def provenances(folder: Path) -> dict[str, Any]:
    """What each product in a folder says of where it comes from; of one trial where it goes by trials."""
    said = {}
    for path in sorted(folder.rglob("*.parquet")):
        said[path.name] = json.loads(read_parquet(path)[1]["provenance"])
    for path in sorted(folder.rglob("*.json")):
        content = json.loads(path.read_text(encoding="utf-8"))
        said[path.name] = content.get("recordings", [content])[0]["provenance"]
    return {name: each.get("voyage", each) for name, each in said.items()}


def test_every_product_says_where_it_comes_from(recording: Path, tmp_path: Path) -> None:
    digest = hashlib.sha256(recording.read_bytes()).hexdigest()
    for words in (
        ("windows", "-o", "w.parquet", "--horizon", "5", "--keep-moving", "--remove-delays"),
        ("smooth", "-o", "s.parquet"), ("check", "-o", "quality"), ("manoeuvres", "-o", "manoeuvres"),
    ):  # fmt: skip
        command, option, place, *more = words
        assert RUN.invoke(app, [command, str(recording), option, str(tmp_path / place), *more]).exit_code == 0
    said = provenances(tmp_path)
    assert len(said) == 6
    for name, each in said.items():
        assert (each["recording"], each["recording_sha256"]) == ("voyage.mcap", digest), name
        assert each["software_version"].startswith("seatrial")
        assert each["trial"]["name"] == "voyage"
        assert str(recording.parent) not in json.dumps(each)
    assert said["w.parquet"]["options"]["keep_moving"]
    assert said["w.parquet"] == said["w.starts.parquet"]
    assert "smooth" in [step["step"] for step in said["s.parquet"]["history"]]
    assert str(recording.parent) not in (tmp_path / "manoeuvres" / "manoeuvres.json").read_text(encoding="utf-8")


def test_smoothed_motion_has_the_standard_deviation_of_each_state_in_its_unit(
    recording: Path, tmp_path: Path
) -> None:
    assert RUN.invoke(app, ["smooth", str(recording), "-o", str(tmp_path / "s.parquet")]).exit_code == 0
    rows = read_parquet(tmp_path / "s.parquet")[0]
    variance = rows["cov_heading_deg_heading_deg"].to_numpy()
    np.testing.assert_allclose(np.deg2rad(rows["heading_deg_sigma"].to_numpy()) ** 2, variance, rtol=1e-9)
    np.testing.assert_allclose(rows["north_m_sigma"] ** 2, rows["cov_north_m_north_m"], rtol=1e-9)


def test_channels_that_are_not_recorded_are_named(recording: Path, tmp_path: Path) -> None:
    without = read_table(recording).drop(columns=["wind_speed_mps", "tunnel_rpm"])
    write_table(without, tmp_path / "few.mcap", Trial(vessel="gunnerus_short"))
    run = RUN.invoke(app, ["check", str(tmp_path / "few.mcap"), "-o", str(tmp_path)])
    assert "not in the recording: wind_speed_mps, tunnel_rpm" in run.stdout
    assert "not in the recording: wind_speed_mps" in (tmp_path / "quality.html").read_text(encoding="utf-8")
    assert "not in the recording" not in RUN.invoke(app, ["check", str(recording)]).stdout


@pytest.mark.parametrize(
    ("trial", "missing"),
    [
        (Trial(), []),
        (Trial(vessel="MV Unknown"), []),
        (Trial(vessel="kvlcc2_7m", actuators="propeller:propeller, rudder:rudder"), ["propeller_rpm"]),
        (Trial(vessel="gunnerus_long"), ["port_angle_deg", "starboard_rpm", "starboard_angle_deg", "tunnel_rpm"]),
        (Trial(vessel="trials/vessels/gunnerus_long.toml"), ["port_angle_deg"]),
        (Trial(actuators="port:azimuth"), ["port_angle_deg"]),
    ],
)
def test_controls_are_missing_of_a_ship_that_is_named_only(
    recording: Path, tmp_path: Path, trial: Trial, missing: list[str]
) -> None:
    kept = ["wind_direction_deg", "wind_speed_mps", "heading_deg", "north_m", "east_m", "surge_mps", "sway_mps"]
    table = read_table(recording)[[*kept, "yaw_rate_dps"]].iloc[:100]
    if "rudder" not in trial.actuators:
        table["port_rpm"] = 100.0
    else:
        table["rudder_angle_deg"] = 5.0
    write_table(table, tmp_path / "own.mcap", trial)
    shown = " ".join(RUN.invoke(app, ["check", str(tmp_path / "own.mcap")]).stdout.split())
    assert ("not in the recording" in shown) == bool(missing)
    assert all(name in shown for name in missing)


@pytest.fixture(scope="module")
def jittering(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pd.DataFrame]:
    """Positions stamped up to a second wrong, and the table before."""
    table = simulate_trial("gunnerus_short", "calm", "zigzag_20_20", 300.0, 2.0, seed=5)[0]
    shift = np.random.default_rng(5).integers(-2, 3, len(table))
    rows = np.clip(np.arange(len(table)) + shift, 0, len(table) - 1)
    late = table.assign(**{name: table[name].to_numpy()[rows] for name in ("north_m", "east_m")})
    path = tmp_path_factory.mktemp("jitter") / "voyage.mcap"
    write_table(late, path, Trial("voyage"))
    return path, table


def test_positions_are_rebuilt_on_request_and_only_then(
    jittering: tuple[Path, pd.DataFrame], tmp_path: Path
) -> None:
    path, truth = jittering

    def repaired(name: str, *more: str) -> pd.DataFrame:
        run = RUN.invoke(app, ["check", str(path), "--repair", str(tmp_path / name), *more])
        assert run.exit_code == 0, run.output
        return read_table(tmp_path / name)

    plain, rebuilt = repaired("plain.mcap"), repaired("rebuilt.mcap", "--rebuild-positions")
    pd.testing.assert_series_equal(plain["north_m"], read_table(path)["north_m"])
    off = [
        each[["north_m", "east_m"]].to_numpy() - truth[["north_m", "east_m"]].to_numpy()
        for each in (plain, rebuilt)
    ]
    step = [np.hypot(*np.diff(each, axis=0).T) for each in off]
    assert np.median(step[1]) < 0.2 * np.median(step[0])
    assert "rebuilt" in str(rebuilt.attrs["history"])


def test_windows_of_rebuilt_positions_say_so(jittering: tuple[Path, pd.DataFrame], tmp_path: Path) -> None:
    words = ["windows", str(jittering[0]), "-o", str(tmp_path / "w.parquet"), "--no-starts", "--keep-moving"]
    assert RUN.invoke(app, [*words, "--rebuild-positions"]).exit_code == 0
    said = json.loads(read_parquet(tmp_path / "w.parquet")[1]["provenance"])["voyage"]
    assert said["options"]["rebuild_positions"]
    assert "position_time_jitter" in [step["options"].get("code") for step in said["history"]]


def test_positions_are_not_rebuilt_without_repairs(recording: Path, tmp_path: Path) -> None:
    assert RUN.invoke(app, ["check", str(recording), "--rebuild-positions"]).exit_code == 2
    words = ["batch", str(tmp_path), "-o", str(tmp_path / "out"), "--rebuild-positions", "--no-repair"]
    assert RUN.invoke(app, words).exit_code == 2
