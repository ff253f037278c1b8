"""Files from strangers: none runs code, opens what it names, writes to the terminal, or ends in a traceback."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import load_file
from safetensors.numpy import save as save_tensors

import seatrial as st
from seatrial.acquisition.core.errors import InputError, SeatrialError, unexpected_error
from tests.attacks.commands import run, run_seatrial
from tests.conftest import Command, Done, Simulated, nightly


@pytest.fixture(scope="session")
def voyage(simulated: Simulated) -> Path:
    """A sound recording of ten minutes."""
    return simulated("gentle", 100, 600.0)


def refused(done: Done) -> str:
    """The one line with which a command was refused."""
    lines = done.err.splitlines()
    assert done.code == 1, done.out + done.err
    assert "Traceback" not in done.err
    assert sum(line.startswith("seatrial: ") for line in lines) == 1, done.err
    return lines[-1]


# What nobody foresaw


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ValueError("no such thing"), "ValueError: no such thing"),
        (KeyError("speed"), "KeyError: 'speed'"),
        (ZeroDivisionError(), "ZeroDivisionError"),
        (RecursionError("maximum recursion depth exceeded"), "RecursionError"),
        (np.linalg.LinAlgError("singular\x1b[2J matrix"), r"singular\x1b[2J matrix"),
        (MemoryError(), "not enough memory"),
        (OSError(5, "Input/output error", "disk.mcap"), "disk.mcap: the system refused: Input/output error"),
        (AssertionError("\n".join(["quoted input"] * 9_000)), "AssertionError"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_any_exception_is_one_line(
    error: Exception, words: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path) -> None:
        raise error

    monkeypatch.setattr("seatrial.acquisition.recording.reader.read_as_one_recording", fail)
    line = refused(command("info", "trial.mcap"))
    assert words in line
    assert len(line) < 600


def test_debug_variable_shows_the_traceback(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.acquisition.recording.reader.read_as_one_recording", lambda paths: 1 // 0)
    monkeypatch.setenv("SEATRIAL_DEBUG", "1")
    done = command("info", "trial.mcap")
    assert done.code == 1
    assert "Traceback (most recent call last)" in done.err
    assert done.err.splitlines()[-1].startswith("seatrial: ")


def test_unexpected_error_names_the_line_of_seatrial_that_raised_it() -> None:
    from seatrial.acquisition.core.quantities import name_ending_of_unit

    with pytest.raises(AttributeError) as raised:
        name_ending_of_unit(None)  # type: ignore[arg-type]
    assert "seatrial.acquisition.core.quantities, line " in str(unexpected_error(raised.value))


# Files that name code


MARKED = "from pathlib import Path\nPath({marker!r}).write_text('run')\n"
CALIBRATOR = """
class Mine:
    def fit(self, windows, track): ...
    def predict(self, windows): return windows.reference
"""


@pytest.fixture(scope="session")
def calibrator_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibrator on disk, hardly trained."""
    from seatrial.hybrid.calibrators import TrainedCalibrator, make_calibrator
    from seatrial.hybrid.calibrators.own import save
    from seatrial.hybrid.effects import vessel_plant
    from seatrial.hybrid.prediction.baselines import Fallback
    from seatrial.hybrid.vessel.files import load_vessel
    from tests.hybrid.windows_by_hand import random_windows

    plant, seconds = vessel_plant(load_vessel("gunnerus_short")), 30
    windows = random_windows(12, seconds, 0)
    fitted = make_calibrator("paper", 0, plant)
    vars(fitted).update(epochs=1, batch=32)
    fitted.fit((windows, windows.track), (windows, windows.track))
    region_m = np.linspace((0.5, 0.4), (3.0, 2.0), seconds)
    fallback = Fallback(np.array([1.5, 0.5]), np.array([1.0, 0.3]), region_m)
    trained = TrainedCalibrator(fitted, None, seconds, "gunnerus_short", plant, region_m, fallback, (), {})
    return save(trained, tmp_path_factory.mktemp("trained") / "calibrator").parent


@pytest.fixture
def strangers_folder(calibrator_folder: Path, tmp_path: Path) -> Path:
    """A copy of a calibrator to change."""
    return Path(shutil.copytree(calibrator_folder, tmp_path / "calib"))


def change_sidecar(folder: Path, **values: Any) -> None:
    """Change values of ``calibrator.json``; ``calibrator__method`` is that of the table ``calibrator``."""
    path = folder / "calibrator.json"
    sidecar = json.loads(path.read_text())
    for name, value in values.items():
        *tables, key = name.split("__")
        table = sidecar
        for each_table in tables:
            table = table.setdefault(each_table, {})
        table[key] = value
    path.write_text(json.dumps(sidecar))


def bring_code(folder: Path, part: str, name: str) -> Path:
    """Let a calibrator name code that it brings along; returns the file that this code would make."""
    marker, code = folder.parent / "marker", folder / "evil.py"
    code.write_text(MARKED.format(marker=str(marker)) + CALIBRATOR)
    digest = hashlib.sha256(code.read_bytes()).hexdigest()
    sidecar = json.loads((folder / "calibrator.json").read_text())
    model = {**sidecar["calibrator"], "method": name.replace("FOLDER", str(folder)), "code_sha256": digest}
    weights = shutil.copy(folder / "calibrator.safetensors", folder / "data_driven.safetensors")
    files = {**sidecar["files"], "data_driven.safetensors": hashlib.sha256(weights.read_bytes()).hexdigest()}
    change_sidecar(folder, files=files, **{part: model})
    return marker


TRIAL = '[trial]\nname = "x"\n'
SOURCE = '[[source]]\nname = "bus"\nchannels = ["heading_deg"]\n'
LISTENING = f'{TRIAL}{SOURCE}type = "udp"\nport = 10110\n'
WAYS: dict[str, tuple[str, ...]] = {
    "validate": ("validate", "RECORDING", "--calibrator", "calib"),
    "predict": ("predict", "RECORDING", "--at", "+200", "--calibrator", "calib"),
    "watch": ("watch", "trial.toml", "--calibrator", "calib", "--duration", "0"),
    "report": ("report", "RECORDING", "--calibrator", "calib", "--no-pdf"),
}


@pytest.mark.parametrize("name", ["FOLDER/evil.py:Mine", "calib/evil.py:Mine", "./calib/../calib/evil.py:Mine"],
                         ids=["absolute", "relative", "dotted"])  # fmt: skip
@pytest.mark.parametrize("part", ["calibrator", "data_driven"])
@pytest.mark.parametrize("way", WAYS)
def test_calibrator_runs_no_code_that_it_brings_along(
    way: str, part: str, name: str, strangers_folder: Path, voyage: Path, command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    marker = bring_code(strangers_folder, part, name)
    monkeypatch.chdir(strangers_folder.parent)
    Path("trial.toml").write_text(LISTENING)
    shutil.copy(voyage, "voyage.mcap")
    line = refused(command(*("voyage.mcap" if word == "RECORDING" else word for word in WAYS[way])))
    assert not marker.exists(), "the code of a stranger was executed"
    assert "--method FILE.py:CLASS" in line or part == "data_driven"


def test_report_of_a_folder_runs_no_code_of_the_calibrator_in_it(
    strangers_folder: Path, voyage: Path, command: Command
) -> None:
    folder = strangers_folder.rename(strangers_folder.with_name("calibrator"))
    marker = bring_code(folder, "calibrator", "FOLDER/evil.py:Mine")
    shutil.copy(voyage, folder.with_name("voyage.mcap"))
    refused(command("report", folder.parent, "--no-pdf"))
    assert not marker.exists()


@pytest.mark.parametrize("call", ["load_calibrator", "validate", "predict", "load_case"])
def test_script_runs_no_code_that_a_calibrator_brings_along(
    call: str, strangers_folder: Path, voyage: Path
) -> None:
    marker = bring_code(strangers_folder, "calibrator", "FOLDER/evil.py:Mine")
    calls: dict[str, Callable[[], object]] = {
        "load_calibrator": lambda: st.load_calibrator(strangers_folder),
        "validate": lambda: st.validate(voyage, strangers_folder),
        "predict": lambda: st.predict(voyage, "+200", strangers_folder),
        "load_case": lambda: st.load_case([voyage], strangers_folder),
    }
    with pytest.raises(InputError, match="method"):
        calls[call]()
    assert not marker.exists()


@pytest.mark.parametrize("change", ["# another version\n", None], ids=["changed", "missing"])
def test_named_code_of_another_version_is_not_executed(
    change: str | None, strangers_folder: Path, tmp_path: Path
) -> None:
    marker = bring_code(strangers_folder, "calibrator", "FOLDER/evil.py:Mine")
    code = strangers_folder / "evil.py"
    code.write_text(code.read_text() + change) if change else code.unlink()
    with pytest.raises(InputError, match=r"another version|no longer exists"):
        st.load_calibrator(strangers_folder, f"{code}:Mine")
    assert not marker.exists()


def test_calibrator_opens_no_vessel_file_by_its_path(strangers_folder: Path, voyage: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    pipe = tmp_path / "elsewhere" / "ship.toml"
    os.mkfifo(pipe)
    change_sidecar(strangers_folder, vessel__name=str(pipe))
    assert "ship" in str(st.predict(voyage, "+200", strangers_folder, horizon_s=15).model)


@pytest.mark.attack
def test_result_of_a_batch_cannot_name_another_folder(voyage: Path, tmp_path: Path, command: Command) -> None:
    """A report is written for each result, into the folder that bears its recording's name."""
    (tmp_path / "recordings").mkdir()
    shutil.copy(voyage, tmp_path / "recordings" / "voyage.mcap")
    folders = "report", tmp_path / "out", "--recordings", tmp_path / "recordings", "--no-pdf", "--no-interactive"
    assert command("batch", tmp_path / "recordings", "-o", tmp_path / "out", "--workers", "1").code == 0
    path = tmp_path / "out" / "voyage" / "summary.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "name": "../../elsewhere"}))
    assert command(*folders).code == 0
    assert (tmp_path / "out" / "voyage" / "report.html").is_file()
    assert not list(tmp_path.parent.glob("elsewhere*"))


# Recordings that name files


def recording_with(path: Path, configuration: str, attachments: dict[str, bytes] | None = None) -> Path:
    """A recording with raw input and this configuration attached."""
    from seatrial.acquisition.core.trial import Frame, Trial
    from seatrial.acquisition.recording.writer import RecordingWriter

    attached = {"configuration.toml": configuration.encode(), **(attachments or {})}
    with RecordingWriter(path, Trial(name="x"), attached) as writer:
        for second in range(5):
            writer.write_raw(Frame("bus", "can", bytes(8), 10**18 + second * 10**9, second * 10**9, 0x123))
    return path


NAMING = {
    "dbc": f'{TRIAL}{SOURCE}type = "can"\ninterface = "virtual"\nchannel = "0"\ndbc = "FILE"\n',
    "pack": LISTENING + '[[pack]]\nname = "FILE"\n',
}


@pytest.mark.parametrize("kind", NAMING)
@pytest.mark.parametrize("file", ["pipe.toml", "/dev/zero", "secret.toml", "../secret.toml", "/proc/self/mem"])
def test_redecode_opens_nothing_that_a_recording_names(
    file: str, kind: str, tmp_path: Path, command: Command
) -> None:
    """Only what is attached to it; a pipe would hang, a device never end, a file be read out."""
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "secret.toml").write_text('password = "hunter2"\n')
    recording = recording_with(tmp_path / "theirs.mcap", NAMING[kind].replace("FILE", file))
    line = refused(command("redecode", recording, "-o", tmp_path / "new.mcap"))
    assert "attachment" in line
    assert "--config" in line
    assert "hunter2" not in line
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.parametrize(
    "name",
    ["../../bus.dbc", "/tmp/bus.dbc", "bus\x00.dbc", "..", "b" * 400 + ".dbc", "a/../../b.pack"],
    ids=["parent", "absolute", "zero byte", "folder", "long", "parent of a pack"],
)
def test_redecode_writes_no_attachment_where_its_name_leads(name: str, tmp_path: Path, command: Command) -> None:
    recording = recording_with(tmp_path / "theirs.mcap", LISTENING, {name: b"x"})
    before = sorted(tmp_path.parent.rglob("*"))
    done = command("redecode", recording, "-o", tmp_path / "new.mcap")
    assert "Traceback" not in done.err
    assert set(tmp_path.parent.rglob("*")) - set(before) <= {tmp_path / "new.mcap"}


def test_redecode_runs_no_command_that_a_recording_names(tmp_path: Path, command: Command) -> None:
    """Neither the alarms' commands nor the class of a source are run."""
    code, marker = tmp_path / "evil.py", tmp_path / "marker"
    code.write_text(MARKED.format(marker=str(marker)) + "class Evil:\n    def read(self, timeout_s): ...\n")
    configuration = (
        f'{TRIAL}{SOURCE}type = "own"\nclass = "{code}:Evil"\n'
        f'[[alarm]]\nname = "a"\nfigure = "free_gb"\nbelow = 1e9\nfor_s = 0\ncommand = ["touch", "{marker}"]\n'
    )
    recording = recording_with(tmp_path / "theirs.mcap", configuration)
    command("redecode", recording, "-o", tmp_path / "new.mcap")
    assert (tmp_path / "new.mcap").exists()
    assert not marker.exists()


# Text of others on the terminal, in logs and on pages


COMMANDS_ON_A_FILE: dict[str, tuple[str, ...]] = {
    "info": ("info",), "check": ("check",), "windows": ("windows", "-o", "w.parquet"), "report": ("report",),
    "emulate": ("emulate", "x.mcap"), "validate": ("validate",), "record": ("record", "--check"),
    "plan": ("plan", "--vessel"), "batch": ("batch", "-o", "o"), "predict": ("predict", "--at", "+1"),
    "redecode": ("redecode", "-o", "o.mcap"),
}  # fmt: skip
HOSTILE = {
    "clears the screen": "calm\x1b[2J",
    "sets the title": "calm\x1b]0;root\x07",
    "rings": "calm\x07",
    "goes back": "calm\x08\x08\x08\x08storm",
    "overwrites the line": "calm\rseatrial: all is well",
    "control in one byte": "calm\x9b2J",
    "reversed": "calm \u202eedoc",
    "isolated": "calm \u2066x\u2069",
    "no UTF-8": "calm\udcff",
    "hidden": "calm\x1b[8msecret\x1b[0m",
    "link": "calm\x1b]8;;http://example.org\x07here\x1b]8;;\x07",
    "delete": "calm\x7f",
}
hostile = pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def shown(*texts: str) -> None:
    """Nothing in these texts is obeyed, and what they begin with is shown."""
    for text in texts:
        unobeyed(text)
        assert "calm" in text


def unobeyed(text: str) -> None:
    raw = OBEYED.search(text)
    assert raw is None, f"raw {raw[0]!r} in {text!r}"


def drawn(renderable: object) -> str:
    """What a terminal gets, without the styles that rich adds."""
    from io import StringIO

    from seatrial.acquisition.core.errors import Terminal

    stream = StringIO()
    Terminal(file=stream, force_terminal=True, color_system="standard", width=200).print(renderable)
    return re.sub("\x1b\\[[0-9;]*m", "", stream.getvalue())


@hostile
def test_terminal_shows_escaped_text_wherever_it_stands(text: str) -> None:
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    table = Table(title=text, caption=text)
    table.add_column(text)
    table.add_row(text)
    table.add_row(Text(text, "bold"))
    table.add_row(Text.assemble((text, "red"), " and more"))
    for renderable in (text, Text(text), table, Group(text, table), Panel(text, title="x")):
        shown(drawn(renderable))


@pytest.mark.parametrize(
    "text", ["[/]", "[/bold] x", "[red]x", "[link=http://example.org]x[/link]", ":boom:", "[m/s]"]
)
def test_terminal_takes_no_text_for_markup(text: str) -> None:
    from rich.table import Table

    table = Table(text)
    table.add_row(text)
    for renderable in (text, table):
        assert text in drawn(renderable)


@hostile
@pytest.mark.parametrize("form", ["text", "json"])
def test_log_shows_escaped_text(form: Any, text: str) -> None:
    from io import StringIO

    from seatrial.acquisition.logger.health import LOG, log_to

    stream = StringIO()
    with log_to(stream, form):
        LOG.info("mark: %s", text)
    shown(stream.getvalue())
    if form == "json":
        assert json.loads(stream.getvalue())["text"] == f"mark: {text}"


def test_mark_cannot_pass_for_a_line_of_the_log_or_of_the_display() -> None:
    from io import StringIO

    from seatrial.acquisition.logger.health import LOG, Health, log_to
    from seatrial.acquisition.logger.record import Picture

    stream, text = StringIO(), "calm\nerror: the disk is full"
    with log_to(stream, "text"):
        LOG.info(text)
    assert not any(line.startswith("error") for line in stream.getvalue().splitlines())
    health = Health({}, ("heading_deg",))
    health.events.append((0, "info", text))
    (line,) = [row for row in drawn(Picture(health, frozenset(), None)).splitlines() if "the disk" in row]
    assert "calm" in line


@hostile
def test_page_shows_escaped_text(text: str) -> None:
    from seatrial.analysis.report.pages import render

    shown(render("base.html", title=text, subtitle=text, body=text).html)


@hostile
def test_recording_with_such_texts_is_listed(text: str, tmp_path: Path, command: Command) -> None:
    times = pd.date_range("2026-03-01", periods=30, freq="s", tz="UTC")
    table = pd.DataFrame({"heading_deg": np.linspace(0.0, 10.0, 30)}, index=times)
    fields = {name: text.encode("utf-8", "replace").decode() for name in ("place", "crew_notes", "loading")}
    st.write(table, tmp_path / "calm.mcap", **fields)
    for name in ("info", "check"):
        done = command(name, tmp_path / "calm.mcap")
        assert done.code == 0, done.err
        unobeyed(done.out + done.err)


@pytest.mark.attack
@hostile
@pytest.mark.parametrize("place", ["column", "cell", "name of the file"])
def test_table_with_such_texts_is_imported_or_refused(
    place: str, text: str, tmp_path: Path, command: Command
) -> None:
    column, cell, name = (text if place == each else "calm" for each in ("column", "cell", "name of the file"))
    quoted = (column.replace('"', ""), cell.replace('"', ""))
    rows = "".join(f'2026-03-01T00:00:{second:02d}Z,{second},5.0,"{quoted[1]}"\n' for second in range(60))
    path = tmp_path / f"{name.replace('/', '_')}.csv"
    path.write_bytes(f'time,heading_deg,wind_speed_mps,"{quoted[0]}"\n{rows}'.encode("utf-8", "surrogateescape"))
    done = command(
        "import", path, "-o", tmp_path / "calm.mcap", "--yes", "--allow-missing", "--vessel", "gunnerus_short"
    )
    assert done.code in (0, 1)
    assert "Traceback" not in done.err
    unobeyed(done.out + done.err)


@pytest.mark.attack
@pytest.mark.parametrize("name", [*COMMANDS_ON_A_FILE])
@hostile
def test_complaint_about_a_file_shows_its_name(name: str, text: str, tmp_path: Path, command: Command) -> None:
    path = tmp_path / text.replace("/", "_")
    done = command(*COMMANDS_ON_A_FILE[name], path)
    assert done.code in (1, 2)
    unobeyed(done.out + done.err)


@pytest.mark.attack
@hostile
def test_wrong_usage_shows_escaped_arguments(text: str, command: Command) -> None:
    for arguments in (("recover", "a.mcap", text), (text,), ("info", f"--{text}"), ("simulate", "--seed", text)):
        done = command(*arguments)
        assert done.code == 2
        unobeyed(done.out + done.err)


# Inputs that are no files


INPUTS: dict[str, tuple[str, ...]] = {
    "info": ("info", "INPUT"), "check": ("check", "INPUT"), "export": ("export", "INPUT", "-o", "t.csv"),
    "smooth": ("smooth", "INPUT", "-o", "s.parquet"), "windows": ("windows", "INPUT", "-o", "w.parquet"),
    "manoeuvres": ("manoeuvres", "INPUT"), "recover": ("recover", "INPUT", "-o", "new.mcap"),
    "migrate": ("migrate", "INPUT", "-o", "new.mcap"), "redecode": ("redecode", "INPUT", "-o", "new.mcap"),
    "redecode configuration": ("redecode", "voyage.mcap", "--config", "INPUT", "-o", "new.mcap"),
    "emulate": ("emulate", "INPUT", "trial.toml"), "emulate configuration": ("emulate", "voyage.mcap", "INPUT"),
    "validate": ("validate", "INPUT"), "validate calibrator": ("validate", "voyage.mcap", "--calibrator", "INPUT"),
    "predict": ("predict", "INPUT", "--at", "+200"),
    "predict commands": ("predict", "voyage.mcap", "--at", "+200", "--commands", "INPUT"),
    "train": ("train", "INPUT", "-o", "trained"), "evaluate": ("evaluate", "INPUT"),
    "evaluate code": ("evaluate", "voyage.mcap", "--method", "INPUT:Mine"),
    "diagnose": ("diagnose", "INPUT", "-o", "diagnosis"),
    "diagnose effects": ("diagnose", "voyage.mcap", "-o", "diagnosis", "--effects", "INPUT"),
    "identify": ("identify", "INPUT", "-o", "ship.toml"), "report": ("report", "INPUT", "--no-pdf"),
    "speed-power": ("speed-power", "INPUT"),
    "speed-power conditions": ("speed-power", "voyage.mcap", "--conditions", "INPUT"),
    "import": ("import", "INPUT", "-o", "new.mcap", "--yes"),
    "import map": ("import", "table.csv", "-o", "new.mcap", "--columns", "INPUT"),
    "record": ("record", "INPUT", "--check", "--duration", "0"), "watch": ("watch", "INPUT", "--duration", "0"),
    "discover configuration": ("discover", "INPUT", "--duration", "0.1"),
    "discover dbc": ("discover", "udp:10999", "--duration", "0.1", "--dbc", "INPUT"),
    "campaign": ("campaign", "INPUT", "-o", "campaign"), "effects": ("effects", "--effects", "INPUT"),
    "vessel": ("vessel", "check", "INPUT"), "plan": ("plan", "--vessel", "INPUT"),
    "batch": ("batch", "INPUT", "-o", "out"), "check own": ("check", "voyage.mcap", "--check", "INPUT:own"),
}  # fmt: skip
ENDINGS = {
    "import": ".csv", "evaluate code": ".py", "check own": ".py", "diagnose effects": ".py", "effects": ".py",
    "predict commands": ".csv", "discover dbc": ".dbc",
    **dict.fromkeys((name for name in INPUTS if "configuration" in name), ".toml"),
    **dict.fromkeys(("import map", "record", "watch", "campaign", "vessel", "plan"), ".toml"),
}  # fmt: skip


IRREGULAR = "socket", "zero", "full", "folder", "circle", "broken link"


def longer(value: object) -> Any:
    """A value of a parameter whose attacks are left to ``make attack``."""
    return pytest.param(value, marks=pytest.mark.attack)


def make_irregular(kind: str, path: Path) -> None:
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(path.name)
    elif kind == "folder":
        path.mkdir()
    elif kind == "broken link":
        path.symlink_to("nowhere")
    elif kind == "circle":
        path.symlink_to(path.name)
    else:
        path.symlink_to(f"/dev/{kind}")


@pytest.mark.parametrize(
    "kind", ["pipe", *map(longer, ("socket", "zero", "full", "folder", "circle", "broken link"))]
)
@pytest.mark.parametrize("name", INPUTS)
def test_input_that_is_no_file_is_refused(name: str, kind: str, place: Path, command: Command) -> None:
    """A pipe without a writer, and a device without an end, would be read for ever."""
    path = place / f"input{ENDINGS.get(name, '.mcap')}"
    make_irregular(kind, path)
    (place / "trial.toml").write_text(LISTENING)
    with limited(60):
        done = command(*(word.replace("INPUT", path.name) for word in INPUTS[name]))
    assert done.code in (1, 2), done.out
    assert "unexpectedly" not in done.err
    assert "Traceback" not in done.err


@contextlib.contextmanager
def limited(seconds: int) -> Iterator[None]:
    """Fail, instead of waiting for ever, where the main thread hangs."""

    def fail(number: int, frame: object) -> None:
        pytest.fail(f"hangs for {seconds} s")  # no Exception: no guard takes it for the command's

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


# Numbers, years and nests that no file of ours has


NESTS = {
    "array": "[" * 5_000 + "]" * 5_000,
    "tables": "{a = " * 5_000 + "1" + "}" * 5_000,
    "object": '{"a":' * 5_000,
}
IMPORT = "import", "table.csv", "-o", "new.mcap", "--allow-missing"
PROPOSED = *IMPORT, "--yes", "--vessel", "gunnerus_short"
NESTED_TOML = {
    "array": f"x = {NESTS['array']}\n",
    "tables": f"x = {NESTS['tables']}\n",
    "dotted": f"{'a.' * 3_000}a = 1\n",
    "dotted table": f"[{'a.' * 3_000}a]\n",
    "long number": f"x = {'9' * 9_000}\n",
}
TOML_COMMANDS: dict[str, tuple[str, ...]] = {
    "record": ("record", "FILE", "--check", "--duration", "0"),
    "watch": ("watch", "FILE", "--duration", "0"),
    "discover": ("discover", "FILE"),
    "vessel": ("effects", "--vessel", "FILE"),
    "import": ("import", "table.csv", "--columns", "FILE", "-o", "new.mcap"),
    "campaign": ("campaign", "FILE", "-o", "campaign"),
    "speed-power": ("speed-power", "voyage.mcap", "--conditions", "FILE"),
    "redecode": ("redecode", "voyage.mcap", "--config", "FILE", "-o", "new.mcap"),
}
TABLE = "time,heading_deg,north_m,east_m\n" + "".join(
    f"2026-03-01T00:00:{second:02d}Z,{second},{second},{second}\n" for second in range(60)
)


@pytest.fixture
def place(tmp_path: Path, voyage: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: a folder with a sound recording and a sound table."""
    shutil.copy(voyage, tmp_path / "voyage.mcap")
    (tmp_path / "table.csv").write_text(TABLE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("nest", NESTED_TOML)
@pytest.mark.parametrize("name", TOML_COMMANDS)
def test_nested_toml_is_refused_where_it_is_read(name: str, nest: str, place: Path, command: Command) -> None:
    (place / "file.toml").write_text(NESTED_TOML[nest])
    line = refused(command(*("file.toml" if word == "FILE" else word for word in TOML_COMMANDS[name])))
    assert "file.toml" in line
    assert "unexpectedly" not in line


@pytest.mark.parametrize("nest", ["array", *nightly("object")])
@pytest.mark.parametrize("key", ["channels", "actuators", "place"])
def test_nested_json_in_a_run_sheet_is_no_failure(nest: str, key: str, tmp_path: Path, command: Command) -> None:
    from seatrial.acquisition.core.trial import Sample, Trial
    from seatrial.acquisition.recording.writer import RecordingWriter

    path = tmp_path / "theirs.mcap"
    with RecordingWriter(path, Trial(**{"name": "x", key: NESTS[nest]}), {}) as writer:
        for second in range(30):
            time_ns = 10**18 + second * 10**9
            writer.write_sample(Sample("heading_deg", 5.0, "gps", time_ns, 0, time_ns, time_ns, "table", 1))
    for arguments in (("info",), ("check",), ("export", "-o", tmp_path / "t.csv"), ("report", "--no-pdf")):
        done = command(*arguments, path)
        assert "unexpectedly" not in done.err
        assert done.code in (0, 1)


@pytest.mark.parametrize("text", [*NESTS.values(), "[]", '{"trial": []}', '{"trial": {"name": {}}}', "\x00", "5"])
def test_json_beside_a_table_is_no_failure(text: str, place: Path, command: Command) -> None:
    (place / "table.csv.json").write_text(text)
    done = command(*PROPOSED)
    assert done.code == 0, done.err


YEARS = [
    "0001-01-01T00:00:00Z", "9999-12-31T23:59:59Z", "0000-01-01T00:00:00Z", "0001-01-01T00:00:00+14:00",
    "1677-09-21T00:12:43Z", "1969-12-31T23:59:59Z", "2262-04-11T23:47:17Z", "99999-01-01T00:00:00Z",
]  # fmt: skip


@pytest.mark.parametrize("year", YEARS)
def test_year_that_no_recording_holds_is_refused_with_its_row(year: str, place: Path, command: Command) -> None:
    """Also 1960: such times would become the first of January 1970, without a word."""
    lines = TABLE.splitlines()
    lines[6] = year + lines[6][20:]
    (place / "table.csv").write_text("\n".join(lines) + "\n")
    line = refused(command(*PROPOSED))
    assert "row 6 of column 'time'" in line
    assert year in line


@pytest.mark.parametrize("year", YEARS)
def test_table_of_such_years_alone_is_refused_or_said_to_have_no_date(
    year: str, place: Path, command: Command
) -> None:
    """A clock that was not set has durations all the same; a year beyond all is none."""
    first, *lines = TABLE.splitlines()
    (place / "table.csv").write_text("\n".join([first, *(year + line[20:] for line in lines)]) + "\n")
    done = command(*PROPOSED)
    if done.code == 0:
        assert re.search(r"(was not set|moved to 1970).*durations", done.err)
    else:
        assert year in refused(done)


@pytest.mark.parametrize("form", ["seconds", "excel", "matlab", "%Y%m%d%H%M%S", "%d.%m.%Y %H:%M:%S", "ms", "ns"])
@pytest.mark.parametrize("cell", ["1e308", "-1e308", "nan", "1e19", "-1", "99991231235959", "01.01.0001 00:00:00"])
def test_times_of_other_forms_end_in_no_traceback(form: str, cell: str, place: Path, command: Command) -> None:
    text = TABLE.replace("2026-03-01T00:00:05Z", cell)
    (place / "table.csv").write_text(text)
    time = f'format = "seconds"\nunit = "{form}"' if form in ("ms", "ns") else f'format = "{form}"\nzone = "UTC"'
    channels = '[channels.heading_deg]\ncolumn = "heading_deg"\nunit = "deg"\n'
    (place / "map.toml").write_text(f'[time]\ncolumn = "time"\n{time}\n[trial]\nname = "x"\n{channels}')
    line = refused(
        command(
            "import", "table.csv", "-o", "new.mcap", "--columns", "map.toml", "--allow-missing", "--ignore-unknown"
        )
    )
    assert "unexpectedly" not in line


@pytest.mark.attack
@pytest.mark.parametrize("channel", ["north_m", "heading_deg", "surge_mps", "yaw_rate_dps", "wind_speed_mps"])
@pytest.mark.parametrize("rows", [slice(100, 101), slice(None, None, 2), slice(None)], ids=["one", "half", "all"])
@pytest.mark.parametrize("number", [1e308, -1e160, np.inf])
def test_number_beyond_any_channel_counts_as_missing(
    number: float, rows: slice, channel: str, place: Path, command: Command
) -> None:
    """Its square is no number, and it would dominate every sum."""
    table = st.read("voyage.mcap")
    table.loc[table.index[rows], channel] = number
    st.write(table, "changed.mcap", vessel="gunnerus_short")
    arguments = ("check",), ("smooth", "-o", "s.parquet"), ("windows", "-o", "w.parquet"), ("validate",)
    for name, *options in arguments if channel in ("north_m", "yaw_rate_dps") else arguments[:2]:
        done = command(name, "changed.mcap", *options)
        assert done.code in (0, 1)
        assert "unexpectedly" not in done.err
        assert "Warning" not in done.err
    with contextlib.suppress(SeatrialError):
        assert np.nanmax(np.abs(st.prepare("changed.mcap", repair=False).to_numpy())) < 1e30


# Folders and files that fail wherever they are first needed


WEIGHTS: dict[str, Callable[[dict[str, Any]], object]] = {
    "not a number": lambda tensors: tensors["network.0.weight"].fill(np.nan),
    "infinite": lambda tensors: tensors["output.mean"].fill(np.inf),
    "beyond bounds": lambda tensors: tensors["network.2.weight"].fill(1e300),
    "no deviation": lambda tensors: tensors["input.deviation"].fill(0.0),
    "negative deviation": lambda tensors: tensors["output.deviation"].fill(-1.0),
    "flat": lambda tensors: tensors.update({"input.range": tensors["input.range"].ravel()}),
    "short": lambda tensors: tensors.update({"usual_error_m": np.ones(1)}),
    "missing": lambda tensors: tensors.pop("usual_error_m"),
    "integers": lambda tensors: tensors.update({"network.0.bias": np.ones(10, np.int64)}),
    "halves": lambda tensors: tensors.update({"input.mean": tensors["input.mean"].astype(np.float16)}),
    "empty": lambda tensors: tensors.update({"network.4.bias": np.zeros(0)}),
    "one more name": lambda tensors: tensors.update({"../../evil": np.ones(1)}),
}


HUGE_SHAPE = b'{"x":{"dtype":"F64","shape":[4611686018427387904],"data_offsets":[0,8]}}'


def rewrite_weights(folder: Path, content: bytes) -> None:
    """Weights with the hash that the sidecar says, as a stranger would make them."""
    (folder / "calibrator.safetensors").write_bytes(content)
    change_sidecar(folder, files={"calibrator.safetensors": hashlib.sha256(content).hexdigest()})


@pytest.mark.parametrize("change", WEIGHTS)
def test_weights_of_another_kind_are_refused(
    change: str, strangers_folder: Path, voyage: Path, command: Command
) -> None:
    weights = load_file(strangers_folder / "calibrator.safetensors")
    tensors = {name: np.array(values) for name, values in weights.items()}
    WEIGHTS[change](tensors)
    rewrite_weights(strangers_folder, save_tensors(tensors))
    done = command("predict", voyage, "--at", "+200", "--calibrator", strangers_folder)
    assert "unexpectedly" not in done.err
    assert done.code == (0 if change == "one more name" else 1)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"\x00" * 7, (2**63 - 1).to_bytes(8, "little"), (2**40).to_bytes(8, "little") + b"{}",
        b"\x02\0\0\0\0\0\0\0{}", (10_000).to_bytes(8, "little") + b"[" * 10_000,
        len(HUGE_SHAPE).to_bytes(8, "little") + HUGE_SHAPE + bytes(8),
    ],
    ids=["empty", "short", "endless head", "long head", "nothing", "nested head", "huge shape"],
)  # fmt: skip
def test_weights_that_are_no_file_of_tensors_are_refused(
    content: bytes, strangers_folder: Path, voyage: Path, command: Command
) -> None:
    rewrite_weights(strangers_folder, content)
    line = refused(command("predict", voyage, "--at", "+200", "--calibrator", strangers_folder))
    assert "is damaged or was edited" in line


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("horizon_s", -1), ("horizon_s", 10**9), ("past_s", -5), ("region_m", [[1e300, 1.0]] * 30),
        ("region_m", []), ("reserve", []), ("vessel__numbers", {}), ("vessel__name", "\x1b[2J"),
        ("calibrator__inputs", []),
        ("calibrator__seed", -1), ("trained_at", "0001-01-01T00:00:00Z"), ("trained_at", "9999-12-31T23:59:59Z"),
        ("files", {}), ("files", {"calibrator.safetensors": "../../x"}), ("metrics", []), ("format", [[[]]]),
        ("actuators", "x" * 10_000), ("data", [{"path": "/dev/zero", "sha256": "0" * 64, "part": [0, 100]}]),
    ],
)  # fmt: skip
def test_sidecar_with_another_value_ends_in_no_traceback(
    key: str, value: object, strangers_folder: Path, voyage: Path, command: Command
) -> None:
    change_sidecar(strangers_folder, **{key: value})
    done = command("predict", voyage, "--at", "+200", "--calibrator", strangers_folder)
    assert done.code in (0, 1)
    assert "unexpectedly" not in done.err
    assert "Warning" not in done.err
    unobeyed(done.out + done.err)


@pytest.mark.parametrize(
    "change",
    [
        {"name": ["x"]}, {"findings": "many"}, {"start": "0001-01-01"}, {"start": []}, {"samples": 1e308},
        {"windows_dropped": ["x"]}, {"manoeuvres": "x"}, {"missing": 5}, {"indices": {"a": "b"}},
        {"provenance": "x"},
    ],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_result_that_is_none_is_no_row_of_the_index(change: dict[str, Any]) -> None:
    from seatrial.analysis.batch import is_index_row

    row = {"name": "a", "status": "done", "cause": "", "findings": 3, "start": "2026-03-01T00:00:00+00:00"}
    assert is_index_row(row)
    assert not is_index_row({**row, **change}) or set(change) <= {"start", "samples", "name"}


# What a terminal, a pipe and a signal do to a command


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["INT", "TERM"])
@pytest.mark.parametrize("name", ["info", "check", "smooth", "export", "validate", "predict", "report", "diagnose"])
def test_signal_ends_a_command_without_a_traceback(
    name: str, number: int, code: int, place: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: object) -> Iterator[object]:
        os.kill(os.getpid(), number)
        time.sleep(5.0)
        yield

    monkeypatch.setattr("seatrial.acquisition.recording.reader.MessageStream.batches", interrupted)
    monkeypatch.setattr("seatrial.acquisition.recording.reader.MessageStream.__iter__", interrupted)
    done = command(*(word.replace("INPUT", "voyage.mcap") for word in INPUTS[name]))
    assert done.code in (130, code)
    assert "Traceback" not in done.err
    assert not list(place.glob("*.part"))


@pytest.mark.attack
@pytest.mark.parametrize(
    "redirection",
    [">&-", "2>&-", "<&-", ">&- 2>&- <&-", "| true", "> /dev/full", "2> /dev/full", "> /dev/full 2>&1"],
)
@pytest.mark.parametrize("arguments", ["info voyage.mcap", "check voyage.mcap --json", "effects", "info none.mcap"])
def test_missing_or_failing_stream_ends_in_no_traceback(arguments: str, redirection: str, place: Path) -> None:
    """A full disk loses what was asked for: that is a failure; a reader that has gone is none."""
    script = f'set -o pipefail; "{sys.executable}" -m seatrial {arguments} {redirection}'
    outcome = run(["bash", "-c", script], place).survived()
    lost = "/dev/full" in redirection and not redirection.startswith("2")
    assert outcome.code == int("none" in arguments or lost)


@pytest.mark.attack
@pytest.mark.parametrize(
    "environment", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}], ids=str
)
@pytest.mark.parametrize("name", ["voy\udcffage", "voy\x1b[2Jage", "Überfahrt ✓", "voy\nage"])
def test_name_that_the_terminal_cannot_show_is_no_failure(
    name: str, environment: dict[str, str], place: Path
) -> None:
    (place / "voyage.mcap").rename(place / f"{name}.mcap")
    outputs = ("windows", "-o", "w.parquet"), ("export", "-o", f"{name}.csv"), ("report",), ("train", "-o", name)
    for arguments in (("info",), ("check",), *outputs):
        run_seatrial(*arguments, os.fsencode(f"{name}.mcap"), cwd=place, environment=environment).done()


@pytest.mark.attack
@pytest.mark.parametrize("mode", [0o000, 0o200], ids=["no rights", "write only"])
def test_file_without_the_right_to_read_is_refused(mode: int, place: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("the superuser may read everything")
    for name in ("voyage.mcap", "table.csv"):
        (place / name).chmod(mode)
    run_seatrial("info", "voyage.mcap", cwd=place).refused()
    run_seatrial(*IMPORT, "--yes", cwd=place).refused()
