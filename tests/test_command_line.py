"""The command line as its users meet it: help, data and messages apart, exit codes, one line an error, JSON."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

import seatrial
from seatrial.acquisition.core.ship import NAMES
from seatrial.acquisition.recording.reader import read_recording
from tests.conftest import SMALL_HORIZON_S, Command, Done, Simulated, few_epochs, nightly

ROOT = Path(__file__).parents[1]
COMMANDS = (
    "demo", "discover", "record", "mark", "emulate", "import", "info", "recover", "redecode", "export", "windows",
    "simulate", "train", "validate", "predict", "diagnose", "plan",
)  # fmt: skip
HEAVY = (
    "torch",
    "pandas",
    "numba",
    "matplotlib",
    "scipy",
    "pyarrow",
    "can",
    "pymavlink",
    "nmea2000",
    "safetensors",
)


def as_process(*arguments: str | Path) -> Done:
    """``seatrial`` as its own process, with its output in pipes."""
    found = subprocess.run(
        [sys.executable, str(ROOT / "seatrial.py"), *map(str, arguments)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return Done(found.returncode, found.stdout, found.stderr)


def in_shell(line: str, argument: Path) -> Done:
    """``seatrial`` in bash, with ``line`` after it, redirections and all."""
    found = subprocess.run(
        ["bash", "-c", f'set -o pipefail; "$0" {ROOT / "seatrial.py"} {line}', sys.executable, str(argument)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return Done(found.returncode, found.stdout, found.stderr)


def test_help_lists_the_commands() -> None:
    done = as_process("--help")
    assert done.code == 0
    assert done.err == ""
    listed = re.findall(r"^\W*([a-z]+)  ", done.out, flags=re.MULTILINE)
    assert set(COMMANDS) <= set(listed)
    assert max(map(len, done.out.splitlines())) <= 80


def test_help_imports_nothing_heavy() -> None:
    """What makes it answer at once."""
    script = (
        "import sys, json\nsys.argv = ['seatrial', '--help']\nimport seatrial\n"
        "try:\n    seatrial.main()\nexcept SystemExit:\n    pass\n"
        "print('\\n' + json.dumps(sorted(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    loaded = json.loads(found.stdout.splitlines()[-1])
    assert "typer" in loaded
    assert not set(HEAVY) & set(loaded)


@pytest.mark.parametrize("name", [*COMMANDS, "effects"])
def test_every_command_explains_itself(name: str, command: Command) -> None:
    done = command(name, "--help")
    assert done.code == 0
    assert len(done.out.splitlines()) > 5


@pytest.mark.parametrize(
    "arguments",
    [
        ("nonsense",), ("info",), ("info", "a.mcap", "--nonsense"), ("simulate",), ("predict", "a.mcap"),
        ("simulate", "-o", "a.mcap", "--seed", "x"), ("simulate", "-o", "a.mcap", "--duration", "-3"),
        ("train", "a.mcap", "-o", "c", "--horizon", "1"), ("validate",),
    ],
)  # fmt: skip
def test_wrong_usage_is_exit_code_two(arguments: tuple[str, ...], command: Command) -> None:
    done = command(*arguments)
    assert done.code == 2
    assert done.out == ""
    assert "Error" in done.err


# Data on stdout, messages on stderr


def test_a_chain_of_commands_speaks_on_the_right_stream(unseen: Path, tmp_path: Path, command: Command) -> None:
    """What a script reads is on stdout and nothing else is; what a person reads is on stderr."""
    exported = command("export", unseen, "-o", tmp_path / "voyage.csv", "--rate", "1")
    imported = command("import", tmp_path / "voyage.csv", "-o", tmp_path / "voyage.mcap")
    cut = command("windows", unseen, "-o", tmp_path / "windows.parquet")
    told = command("info", tmp_path / "voyage.mcap")
    assert [done.code for done in (exported, imported, cut, told)] == [0, 0, 0, 0]
    assert exported.out == f"{tmp_path / 'voyage.csv'}\n"
    assert imported.out == f"{tmp_path / 'voyage.mcap'}\n"
    assert cut.out == f"{tmp_path / 'windows.parquet'}\n"
    assert "1,200 rows" in exported.err
    assert "1,200 rows" in imported.err
    assert "windows of 15 s held" in cut.err
    assert told.err == ""
    assert "closed properly" in told.out


def test_a_process_without_a_terminal_draws_no_bars(simulated: Simulated, tmp_path: Path) -> None:
    done = as_process("windows", simulated("calm", 1, 60.0), "-o", tmp_path / "windows.parquet", "--json")
    assert done.code == 0
    assert set(done.json) == {"recordings", "candidates", "kept", "dropped"}
    assert done.err == ""


def test_names_and_notes_are_no_markup(simulated: Simulated, tmp_path: Path, command: Command) -> None:
    """A file below a folder [ is shown by its name, and a long path is not broken."""
    path = tmp_path / ("deep" * 20) / "[" / "x].mcap"  # the end of a tag that never began
    path.parent.mkdir(parents=True)
    path.write_bytes(simulated("calm", 1, 60.0).read_bytes())
    done = command("info", path)
    assert done.code == 0
    assert str(path) in done.out


# JSON


def test_info_is_the_contracts_object(unseen: Path, command: Command) -> None:
    found = command("info", unseen, "--json").json
    keys = {"closed", "messages", "start", "end", "duration_s", "channels", "raw", "trial", "events"}
    assert set(found) == keys
    assert found["closed"] is True
    assert set(found["channels"]) == set(NAMES)
    for channel in found["channels"].values():
        assert set(channel) == {"count", "rate_hz", "first", "last", "sources", "longest_gap_s"}
    assert found["messages"] == sum(channel["count"] for channel in found["channels"].values())


def test_windows_account_for_every_candidate(unseen: Path, tmp_path: Path, command: Command) -> None:
    found = command("windows", unseen, "-o", tmp_path / "w.parquet", "--horizon", 20, "--json").json
    assert set(found) == {"recordings", "candidates", "kept", "dropped"}
    assert found["recordings"] == 1
    assert found["candidates"] == found["kept"] + sum(found["dropped"].values())


def test_train_validate_predict(
    earlier: list[Path], unseen: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The three in a row, each with one JSON object; the horizon of the calibrator is taken up unasked."""
    monkeypatch.setattr(
        "seatrial.hybrid.calibrators.make_calibrator",
        lambda method, seed, plant: few_epochs(method, seed, plant, 2),
    )
    folder = tmp_path / "calibrator"
    trained = command("train", *earlier[:2], "-o", folder, "--horizon", 20, "--method", "paper", "--json")
    assert trained.code == 0
    assert trained.json["calibrator"] == str(folder)
    assert {path.name for path in folder.iterdir()} == {
        "calibrator.json", "calibrator.safetensors", "data_driven.safetensors",
    }  # fmt: skip
    validated = command("validate", unseen, "--calibrator", folder, "--json").json
    assert set(validated) >= {"horizon_s", "windows", "methods", "reduction", "coverage_95"}
    assert validated["horizon_s"] == 20
    assert set(validated["methods"]) >= {"constant_velocity", "reference", "data_driven", "hybrid"}
    predicted = command("predict", unseen, "--at", "+600", "--calibrator", folder, "--json").json
    assert (predicted["method"], predicted["horizon_s"], len(predicted["track"])) == ("hybrid", 20, 21)


def test_the_tables_fit_eighty_columns(
    small_folder: Path, unseen: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A row a line, no word broken."""
    monkeypatch.setenv("COLUMNS", "80")
    validated = command("validate", unseen, "--calibrator", small_folder)
    predicted = command("predict", unseen, "--calibrator", small_folder, "--at", "+600")
    assert (validated.code, predicted.code) == (0, 0)
    for method in ("constant_velocity", "reference", "data_driven", "hybrid"):
        assert re.search(rf"^ {method} +causal( +\d+\.\d+){{5}}", validated.out, flags=re.MULTILINE), method
    rows = re.findall(r"^ +\d+( +-?\d+\.\d\d){6}", predicted.out, flags=re.MULTILINE)
    assert len(rows) >= 10
    for done in (validated, predicted):
        assert max(map(len, done.out.splitlines())) <= 80
        assert "…" not in done.out


def test_seen_recordings_are_validated_when_told(earlier: list[Path], small_folder: Path, command: Command) -> None:
    done = command("validate", earlier[0], "--calibrator", small_folder, "--allow-seen", "--json")
    assert done.code == 0
    assert done.json["reduction"] > 0.4


# What goes wrong


@dataclass(frozen=True, slots=True)
class Scene:
    """Where the faults are played: a folder with the files that the cases name."""

    folder: Path
    good: Path
    seen: Path
    calibrator: Path


@pytest.fixture(scope="module")
def scene(
    tmp_path_factory: pytest.TempPathFactory, simulated: Simulated, earlier: list[Path], small_folder: Path
) -> Scene:
    """A good table and its damaged likes, and what else a user may give by mistake."""
    from seatrial.analysis.tables.export import export_table
    from seatrial.analysis.tables.table import read_table

    folder, good = tmp_path_factory.mktemp("faults"), simulated("calm", 1, 60.0)
    export_table(read_table(good), folder / "good.csv")
    rows = list(csv.reader((folder / "good.csv").read_text().splitlines()))
    speed, wind = rows[0].index("surge_mps"), rows[0].index("wind_speed_mps")
    renamed = [["quantity_7" if name == "surge_mps" else name for name in rows[0]], *rows[1:]]
    words = [rows[0], *[[*row[:speed], "fast", *row[speed + 1 :]] for row in rows[1:]]]
    tables = {
        "unknown.csv": renamed,
        "missing.csv": [row[:wind] + row[wind + 1 :] for row in rows],
        "words.csv": words,
        "header.csv": rows[:1],
    }
    for name, content in tables.items():
        with (folder / name).open("w", newline="") as stream:
            csv.writer(stream).writerows(content)
    (folder / "empty.csv").write_text("")
    (folder / "empty.mcap").write_text("")
    (folder / "text.mcap").write_text("north_m,east_m\n1,2\n")
    (folder / "folder.mcap").mkdir()
    (folder / "file").write_text("")
    (folder / "damaged.mcap").write_bytes(_damaged(good.read_bytes()))
    _configurations(folder)
    return Scene(folder, good, earlier[0], small_folder)


def _damaged(data: bytes) -> bytes:
    """Zeros in the first chunk of messages; in an index they would cost nothing."""
    return data[:3000] + bytes(64) + data[3064:]


def _configurations(folder: Path) -> None:
    bus = (
        '[trial]\nname = "x"\n[[source]]\nname = "bus"\ntype = "can"\ninterface = "socketcan"\n'
        'channel = "can99"\nchannels = ["heading_deg"]\n'
    )
    (folder / "bus.toml").write_text(bus)
    (folder / "wrong_unit.toml").write_text(
        bus + '[source.signals]\nheading_deg = { message = "A", signal = "B", unit = "furlong" }\n'
    )
    (folder / "wrong_map.toml").write_text(
        '[time]\ncolumn = "time"\n[channels]\nsurge_mps = { column = "speed", unit = "furlong" }\n'
    )


FAULTS: dict[str, tuple[str, str]] = {
    "a table with an unknown column": ("import {d}/unknown.csv -o {d}/o.mcap", r"unknown\.csv: .*quantity_7.*name"),
    "a table without a channel": ("import {d}/missing.csv -o {d}/o.mcap", r"missing\.csv: has no wind_speed_mps"),
    "a table with words": ("import {d}/words.csv -o {d}/o.mcap", r"words\.csv: row 1 of column 'surge_mps'.*fast"),
    "a table without rows": ("import {d}/header.csv -o {d}/o.mcap", r"header\.csv: has no rows; give"),
    "an empty table": ("import {d}/empty.csv -o {d}/o.mcap", r"empty\.csv: is empty; give"),
    "a missing table": ("import {d}/nowhere.csv -o {d}/o.mcap", r"nowhere\.csv: is no file; check"),
    "a map with a wrong unit": (
        "import {d}/unknown.csv -o {d}/o.mcap --columns {d}/wrong_map.toml", r"wrong_map\.toml, line \d+.*furlong",
    ),
    "an empty recording": ("info {d}/empty.mcap", r"empty\.mcap: is empty; give"),
    "a text called .mcap": ("info {d}/text.mcap", r"text\.mcap: is not an MCAP recording; give"),
    "a text to validate": ("validate {d}/text.mcap", r"text\.mcap: is not an MCAP recording; give"),
    "a folder": ("windows {d}/folder.mcap -o {d}/w.parquet", r"folder\.mcap: is a folder"),
    "a missing recording": ("predict {d}/nowhere.mcap --at +1", r"nowhere\.mcap: does not exist; check"),
    "a damaged recording": ("export {d}/damaged.mcap -o {d}/o.csv", r"damaged\.mcap: is damaged near byte \d+"),
    "a missing configuration": ("record {d}/nowhere.toml -o {d}/r", r"nowhere\.toml: does not exist; check"),
    "a configuration with a wrong unit": ("record {d}/wrong_unit.toml -o {d}/r", r"wrong_unit\.toml, line \d+"),
    "a bus that does not exist": ("record {d}/bus.toml -o {d}/r --duration 1", r"CAN bus socketcan:can99.*connect"),
    "a bus to play onto": ("emulate {good} {d}/bus.toml", r"CAN bus socketcan:can99.*connect"),
    "an unknown vessel": ("simulate -o {d}/o.mcap --vessel titanic", r"no vessel 'titanic'.*gunnerus_short"),
    "an unknown vessel to train on": ("train {good} -o {d}/c --vessel titanic", r"no vessel 'titanic'"),
    "an unknown sea": ("simulate -o {d}/o.mcap --sea-state wild", r"no sea state 'wild'; use one of calm"),
    "an unknown manoeuvre": ("simulate -o {d}/o.mcap --manoeuvre loop", r"no manoeuvre 'loop'; use one of voyage"),
    "an unknown effect": ("simulate -o {d}/o.mcap --hide curent:x=1", r"no effect 'curent'"),
    "an unknown parameter": ("simulate -o {d}/o.mcap --hide loading:mass=2", r"loading has no parameter mass"),
    "a parameter out of bounds": ("simulate -o {d}/o.mcap --hide loading:mass_factor=99", r"give 0\.3 to 3$"),
    "an effect twice": (
        "simulate -o {d}/o.mcap --hide loading:mass_factor=1.1 --hide loading:mass_factor=1.2", r"is given twice",
    ),
    "an endless trial": ("simulate -o {d}/o.mcap --duration inf", r"duration inf s is out of bounds"),
    "a recording below a file": ("simulate -o {d}/file/o.mcap --duration 20", r"file/o\.mcap: .*is a file, not a"),
    "a recording in place of a folder": ("simulate -o {d}/folder.mcap --duration 20", r"it is a folder; name"),
    "an import below a file": ("import {d}/good.csv -o {d}/file/o.mcap", r"file/o\.mcap: .*is a file, not"),
    "an export below a file": ("export {good} -o {d}/file/o.parquet", r"file/o\.parquet: .*is a file, not"),
    "an export to CSV below a file": ("export {good} -o {d}/file/o.csv", r"file/o\.csv: .*is a file, not"),
    "an export to .mat below a file": ("export {good} -o {d}/file/o.mat", r"file/o\.mat: .*is a file, not"),
    "an export of no known kind": ("export {good} -o {d}/o.xls", r"cannot write \.xls; name it"),
    "an impossible rate": ("export {good} -o {d}/o.csv --rate 0", r"a rate of 0\.0 Hz is not possible; give"),
    "windows below a file": ("windows {good} -o {d}/file/w.parquet", r"file/w\.parquet: .*is a file, not"),
    "a calibrator below a file": ("train {seen} -o {d}/file/c", r"file/c.*is a file, not"),
    "a recording in a file": ("record {d}/bus.toml -o {d}/file", r"is a file, not"),
    "an unknown method": ("train {seen} -o {d}/c --method magic", r"no calibrator is called 'magic'; use one of"),
    "a part that is none": ("train {seen} -o {d}/c --part 70..10", r"part 70\.\.10 is empty"),
    "no held windows": (
        "windows {seen} -o {d}/w.parquet --horizon 500", r"none of \d+ candidates of 500 s.*lower --horizon",
    ),
    "no held windows to train on": ("train {seen} -o {d}/c --horizon 500", r"none of \d+ .*lower --horizon"),
    "seen recordings": ("validate {seen} --calibrator {cal}", r"took part in the training.*--allow-seen"),
    "a longer horizon": ("validate {good} --calibrator {cal} --horizon 60", r"at most 30 s, not 60 s; use"),
    "another vessel": (
        "validate {good} --calibrator {cal} --vessel gunnerus_long", r"'gunnerus_long' is not the model",
    ),
    "no calibrator": ("validate {good} --calibrator {d}/nowhere", r"nowhere: is not a trained.*make one"),
    "a file for a calibrator": ("predict {good} --at +1 --calibrator {d}/file", r"file: is not a trained"),
    "a time outside": ("predict {good} --at +9999", r"is outside the recording; choose from"),
    "a time that is none": ("predict {good} --at noon", r"'noon' is not a time; write it like"),
    "a time without zone": ("predict {good} --at 2026-06-01T08:00:10", r"has no time zone; write it like"),
    "one recording twice": ("validate {good} {good}", r"is given twice"),
    "one recording twice in windows": ("windows {good} {good} -o {d}/w.parquet", r"is given twice"),
}  # fmt: skip


def one_line(done: Done) -> str:
    """The one line on stderr of a command that could not be done."""
    assert done.code == 1, done.err
    assert done.out == ""
    assert "Traceback" not in done.err
    assert done.err.endswith("\n")
    (line,) = done.err.splitlines()
    assert line.startswith("seatrial: ")
    return line


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_one_line_that_helps(name: str, scene: Scene, command: Command) -> None:
    """What, where, why and what to do; exit code 1; nothing half-written left behind."""
    text, message = FAULTS[name]
    values = {"d": scene.folder, "good": scene.good, "seen": scene.seen, "cal": scene.calibrator}
    before = set(scene.folder.rglob("*"))
    line = one_line(command(*(part.format(**values) for part in text.split())))
    assert re.search(message, line), line
    left = {path for path in set(scene.folder.rglob("*")) - before if path.is_file()}
    assert not left


def test_a_fault_in_a_process_of_its_own(scene: Scene) -> None:
    line = one_line(as_process("info", scene.folder / "text.mcap"))
    assert "is not an MCAP recording" in line


@pytest.mark.parametrize("redirection", [">&-", "| head -c 1", *nightly("2>&1 | head -c 1", "2>&-", "2>/dev/full")])
def test_whoever_stops_reading_does_not_make_it_a_failure(scene: Scene, redirection: str) -> None:
    done = in_shell(f'info "$1" {redirection}', scene.good)
    assert (done.code, done.err) == (0, "")


def test_a_full_disk_behind_stdout_is_one_line(scene: Scene) -> None:
    line = one_line(in_shell('info "$1" --json >/dev/full', scene.good))
    assert line == "seatrial: standard output: cannot be written: No space left on device; send it elsewhere"


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (
            PermissionError(13, "Permission denied", "/x"),
            1,
            "seatrial: /x: the system refused: Permission denied\n",
        ),
        (OSError("what"), 1, "seatrial: the system refused: what\n"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_what_escapes_a_command_is_no_traceback(
    raised: BaseException, code: int, said: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise raised

    monkeypatch.setattr("seatrial.acquisition.recording.reader.read_recording", broken)
    done = command("info", "a.mcap")
    assert (done.code, done.out, done.err) == (code, "", said)


def test_an_interruption_while_the_commands_are_loaded(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(seatrial, "_app", interrupted)
    done = command("info")
    assert (done.code, done.err) == (130, "")


@pytest.mark.parametrize("channel", [NAMES[2], NAMES[4], NAMES[12]])
@pytest.mark.parametrize("name", ["windows", "train", "validate", "predict"])
def test_a_recording_without_a_channel(name: str, channel: str, without: Callable[[str], Path], tmp_path: Path,
                                       command: Command) -> None:  # fmt: skip
    """Each of the four says which channel it misses and in which file."""
    path = without(channel)
    options = {"windows": ["-o", tmp_path / "w"], "train": ["-o", tmp_path / "c"], "predict": ["--at", "+5"]}
    line = one_line(command(name, path, *options.get(name, [])))
    assert f"{path}: has no {channel}; record the channel" in line


@pytest.mark.parametrize("name", ["windows", "validate", "predict"])
def test_a_recording_without_wind_is_one_of_a_calm(
    name: str, without: Callable[[str], Path], tmp_path: Path, command: Command
) -> None:
    options = {"windows": ["-o", tmp_path / "w.parquet"], "predict": ["--at", "+5"]}
    done = command(name, without("wind_speed_mps"), *options.get(name, []))
    assert done.code == 0, done.err


@pytest.fixture(scope="module")
def without(simulated: Simulated, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A recording that lacks one channel."""
    from seatrial.acquisition.core.trial import Trial
    from seatrial.acquisition.recording.writer import write_table
    from seatrial.analysis.tables.table import read_table

    folder = tmp_path_factory.mktemp("without")

    def recording(channel: str) -> Path:
        path = folder / f"without_{channel}.mcap"
        if not path.exists():
            write_table(
                read_table(simulated("calm", 1, 60.0)).drop(columns=channel), path, Trial("t", "gunnerus_long")
            )
        return path

    return recording


# Simulation


def _everything_in(path: Path) -> Iterator[bytes]:
    """Every byte of a recording that anybody could read: messages, schemas, metadata, attachments, uncompressed."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages():
            yield message.data
            yield channel.topic.encode()
            yield schema.data if schema else b""
            yield json.dumps(dict(channel.metadata)).encode()
        for metadata in reader.iter_metadata():
            yield json.dumps([metadata.name, metadata.metadata]).encode()
        for attachment in reader.iter_attachments():
            yield attachment.name.encode() + attachment.data
        yield reader.get_header().library.encode()
    yield path.read_bytes()


def test_what_is_hidden_is_in_the_truth_and_nowhere_else(tmp_path: Path, command: Command) -> None:
    """Neither names nor values of hidden effects can be read from the recording or from what is printed."""
    path = tmp_path / "trial.mcap"
    hidden = ("ocean_current:speed_mps=0.3137,direction_deg=41.77", "heading_bias:angle_deg=2.713")
    options = [part for each in hidden for part in ("--hide", each)]
    done = command("simulate", "-o", path, "--duration", 30, "--rate", 2, "--seed", 3, *options)
    assert done.code == 0
    secrets = (
        b"ocean_current",
        b"heading_bias",
        b"0.3137",
        b"41.77",
        b"2.713",
        b"hidden",
        b"hide",
        b"truth",
        b"seed",
    )
    for blob in _everything_in(path):
        for secret in secrets:
            assert secret not in blob, secret
    assert not any(secret.decode() in done.out for secret in secrets[:5])
    assert {each.name for each in tmp_path.iterdir()} == {"trial.mcap", "trial.truth.json"}
    truth = json.loads((tmp_path / "trial.truth.json").read_text())
    assert truth["hidden"] == {
        "ocean_current": {"speed_mps": 0.3137, "direction_deg": 41.77},
        "heading_bias": {"angle_deg": 2.713},
    }
    assert truth["seed"] == 3


def _values(path: Path) -> dict[str, list[float]]:
    return {name: series.value.tolist() for name, series in sorted(read_recording(path).series.items())}


def test_a_seed_is_a_trial(tmp_path: Path, command: Command) -> None:
    """The same seed gives the same values, another seed others, in all 13 channels."""
    trials = []
    for number, seed in enumerate((5, 5, 6)):
        path = tmp_path / f"{number}.mcap"
        assert command("simulate", "-o", path, "--sea-state", "gentle", "--duration", 40, "--rate", 2,
                       "--seed", seed).code == 0  # fmt: skip
        trials.append(_values(path))
    assert trials[0] == trials[1]
    assert set(trials[0]) == set(NAMES)
    assert all(trials[0][name] != trials[2][name] for name in NAMES)


# Round trip


@pytest.mark.parametrize(("kind", "time_error_ns"), [("parquet", 0), ("csv", 0), ("mat", 1000)])
def test_export_and_import_come_back(kind: str, time_error_ns: int, simulated: Simulated, tmp_path: Path,
                                     command: Command) -> None:  # fmt: skip
    """Every value to the bit and every time as well as the format can say it; seconds since 1970 in a .mat are
    good to a microsecond.
    """
    original = simulated("calm", 1, 60.0)
    table, back = tmp_path / f"voyage.{kind}", tmp_path / "back.mcap"
    assert command("export", original, "-o", table).code == 0
    assert command("import", table, "-o", back).code == 0
    before, after = read_recording(original), read_recording(back)
    assert set(after.series) == set(NAMES)
    for name in NAMES:
        assert np.array_equal(before.series[name].value, after.series[name].value), name
        apart = np.abs(before.series[name].measured_ns - after.series[name].measured_ns)
        assert apart.max() <= time_error_ns
    if kind != "csv":
        assert (after.trial.name, after.trial.vessel) == (before.trial.name, before.trial.vessel)


def test_the_small_calibrator_is_what_the_faults_say(small_folder: Path) -> None:
    """The texts above name its horizon."""
    assert json.loads((small_folder / "calibrator.json").read_text())["horizon_s"] == SMALL_HORIZON_S == 30
