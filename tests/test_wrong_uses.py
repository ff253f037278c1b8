"""Wrong uses: each is answered with a line that says what to do, the contract's exit code and no traceback."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from seatrial.acquisition.core.ship import DEFAULT, actuators_as_text, trial_channel_names
from seatrial.hybrid.vessel.files import load_vessel
from tests.conftest import Command

SOURCE = '[trial]\nname = "x"\n\n[[source]]\nname = "bridge"\nchannels = ["heading_deg"]\n'
NO_MODEL = "class Mine:\n    def fit(self, windows, track): ...\n"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what people confuse."""
    folder = tmp_path_factory.mktemp("wrong")
    st.write(steady(120, trial_channel_names(DEFAULT)), folder / "ship.mcap", "gunnerus_short")
    st.write(steady(8, trial_channel_names(DEFAULT)), folder / "short.mcap", "gunnerus_short")
    osaka = load_vessel("esso_osaka_3m").actuators
    st.write(
        steady(120, trial_channel_names(osaka)),
        folder / "other.mcap",
        "esso_osaka_3m",
        actuators=actuators_as_text(osaka),
    )
    whole = (folder / "ship.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.csv").write_bytes(b"")
    (folder / "prose.mcap").write_text("This is no recording.", encoding="utf-8")
    (folder / "bad.toml").write_text("[trial\n", encoding="utf-8")
    (folder / "typo.toml").write_text(f'{SOURCE}type = "udp"\nprot = 41034\n', encoding="utf-8")
    (folder / "serial.toml").write_text(f'{SOURCE}type = "serial"\ndevice = "/dev/no_such"\n', encoding="utf-8")
    (folder / "mine.py").write_text(NO_MODEL, encoding="utf-8")
    yard_table(folder)
    return folder


def steady(seconds: int, names: Sequence[str]) -> pd.DataFrame:
    """A ship that goes straight on to the north, every other channel at rest."""
    time = pd.date_range("2026-03-14", periods=seconds, freq="s", tz="UTC", name="time")
    table = pd.DataFrame(0.0, time, list(names))
    table["surge_mps"], table["north_m"] = 2.0, 2.0 * np.arange(seconds)
    return table


def yard_table(folder: Path) -> None:
    """Tables of a ship on a bend: sound but for the rudder, with exchanged positions, in knots called m/s, without
    times.
    """
    seconds = np.arange(600.0)
    heading = np.deg2rad(0.3 * seconds)
    north_m, east_m = np.cumsum(7.0 * np.cos(heading)), np.cumsum(7.0 * np.sin(heading))
    columns = {
        "time": pd.Timestamp("2026-03-14T09:00Z") + pd.to_timedelta(seconds, unit="s"),
        "latitude [deg]": 54.0 + north_m / 111_300.0,
        "longitude [deg]": 10.0 + east_m / 65_500.0,
        "heading [deg]": np.rad2deg(heading) % 360.0,
        "SOG [kn]": 7.0 / 0.5144 + 0.01 * np.sin(seconds),
        "propeller [rpm]": 90.0 + np.sin(seconds),
    }
    table = pd.DataFrame(columns)
    exchanged = {"latitude [deg]": "longitude [deg]", "longitude [deg]": "latitude [deg]"}
    table.to_csv(folder / "yard.csv", index=False)
    table.rename(columns=exchanged).to_csv(folder / "exchanged.csv", index=False)
    table.rename(columns={"SOG [kn]": "SOG [m/s]"}).to_csv(folder / "knots.csv", index=False)
    table.drop(columns="time").to_csv(folder / "timeless.csv", index=False)


@pytest.fixture
def busy_port(place: Path) -> Iterator[None]:
    """The port of a configuration is another program's."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        (place / "busy.toml").write_text(f'{SOURCE}type = "udp"\nport = {port}\n', encoding="utf-8")
        yield


WRONG: dict[str, tuple[int, str]] = {
    # files
    "import ship.mcap -o x.mcap": (1, "ship.mcap: is a recording already; use it as it is"),
    "import empty.csv -o x.mcap": (1, "empty.csv: is empty; give a table"),
    "import . -o x.mcap": (1, "is no file; check the path"),
    "import timeless.csv -o x.mcap --yes": (1, "no time column"),
    "import yard.csv -o yard.xlsx --yes": (1, "yard.xlsx: cannot write .xlsx; name it .mcap"),
    "import yard.csv -o ship.mcap --yes": (1, "ship.mcap: already exists; name another file, or use --force"),
    "import yard.csv -o x.mcap --columns bad.toml": (1, "bad.toml: is not valid TOML"),
    "info prose.mcap": (1, "is not an MCAP recording; give a .mcap file"),
    "info .": (1, "is a folder, not a recording; name a .mcap file in it"),
    "check cut.mcap": (0, "cut.mcap was not closed: its end may be missing; `seatrial recover` mends it"),
    "check yard.csv": (1, "convert a table or log with `seatrial import`"),
    # swapped units and columns are imported as they are called, with a warning
    "import knots.csv -o knots.mcap --yes": (0, "is off from the positions by a factor 0.515: knots?"),
    "import exchanged.csv -o exchanged.mcap --yes": (0, "axes exchanged: latitude for longitude?"),
    # commands and options
    "manoeuvre ship.mcap": (2, "Did you mean 'manoeuvres'?"),
    "manoeuvres ship.mcap --lenght 30": (2, "Possible options: --length"),
    "predict ship.mcap --at +10 --horizon soon": (2, "'--horizon': Input should be a valid integer"),
    "record busy.toml -o out --duration -5": (2, "'--duration': Input should be greater than or equal to 0"),
    "predict ship.mcap --at -60": (1, "is outside the recording; choose from"),
    "train ship.mcap -o x --vessel gunerus": (1, "no vessel 'gunerus': it is neither a file nor one of"),
    # configurations and ports
    "record bad.toml -o out": (1, "bad.toml: is not valid TOML"),
    "record typo.toml -o out": (1, "line 8: source 1 (bridge): prot: is not a known key here; did you mean port?"),
    "record ship.mcap -o out": (1, "ship.mcap: cannot be read: it is no text; give a TOML file"),
    "record busy.toml -o out --duration 1": (1, "stop the program that uses it, or correct `address` and `port`"),
    "record serial.toml -o out --duration 1": (1, "/dev/no_such cannot be opened: No such file or directory"),
    "record busy.toml -o prose.mcap --duration 1": (1, "prose.mcap is a file, not a folder; choose another folder"),
    # too little in them
    "train short.mcap -o x": (1, "shorter than the horizon; lower --horizon"),
    "manoeuvres short.mcap --json": (0, "the recording is shorter than 20 s"),
    # another ship's model
    "validate other.mcap --vessel gunnerus_short": (1, "the recording is of a ship with propeller (propeller)"),
    "validate other.mcap --calibrator .": (1, "is not a trained calibrator: calibrator.json is missing"),
    # code of one's own
    "train ship.mcap -o x --method mine.py:Yours": (1, "defines no Yours: it defines Mine; write mine.py:Mine"),
    "train ship.mcap -o x --method mine.py:Mine": (1, "has no predict; define predict(self, windows)"),
    "train ship.mcap -o x --method ship.mcap": (1, "no calibrator is called 'ship.mcap'; use one of"),
    "validate ship.mcap --method mine.py:Mine": (2, "give its folder with --calibrator"),
}  # fmt: skip


@pytest.mark.usefixtures("busy_port")
@pytest.mark.parametrize("line", WRONG)
def test_a_wrong_use_is_answered(line: str, place: Path, command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    code, words = WRONG[line]
    done = command(*line.split())
    said = " ".join((done.err + done.out).replace("│", " ").split())
    assert (done.code, words in said) == (code, True), said
    assert "Traceback" not in said
    if code == 1:
        assert done.err.strip().splitlines()[-1].startswith("seatrial: ")


def test_a_table_without_a_rudder_says_why_there_is_no_turn(
    place: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    assert command("import", "yard.csv", "-o", "yard.mcap", "--yes").code == 0
    (recording,) = command("manoeuvres", "yard.mcap", "--json").json["recordings"]
    assert "no helm was recorded" in recording["left_out"][0]["why"]


@pytest.mark.parametrize("reason", [(28, "No space left on device"), (13, "Permission denied")])
def test_a_disk_that_refuses_is_named(
    place: Path, command: Command, monkeypatch: pytest.MonkeyPatch, reason: tuple[int, str]
) -> None:
    """Full, or not ours to write to; nothing is left behind."""
    from seatrial.acquisition.recording import writer

    def refused(*_: object) -> None:
        raise OSError(*reason)

    monkeypatch.chdir(place)
    monkeypatch.setattr(writer, "_write_table_rows", refused)
    done = command("import", "yard.csv", "-o", "full.mcap", "--yes")
    assert done.code == 1
    assert f"full.mcap: cannot be written: {reason[1]}; " in done.err
    assert not list(place.glob("*full*"))
