"""Files from strangers: none runs code, opens what it names, writes to the terminal, or ends in a traceback."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import seatrial as st
from acquisition.core.errors import InputError, unexpected
from tests.conftest import Command, Done, Simulated


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

    monkeypatch.setattr("acquisition.recording.grouping.read_together", fail)
    line = refused(command("info", "trial.mcap"))
    assert words in line
    assert len(line) < 600


def test_debug_variable_shows_the_traceback(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acquisition.recording.grouping.read_together", lambda paths: 1 // 0)
    monkeypatch.setenv("SEATRIAL_DEBUG", "1")
    done = command("info", "trial.mcap")
    assert done.code == 1
    assert "Traceback (most recent call last)" in done.err
    assert done.err.splitlines()[-1].startswith("seatrial: ")


def test_unexpected_error_names_the_line_of_seatrial_that_raised_it() -> None:
    from acquisition.core.units import ending_of

    with pytest.raises(AttributeError) as raised:
        ending_of(None)  # type: ignore[arg-type]
    assert "acquisition.core.units, line " in str(unexpected(raised.value))


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
    from hybrid.calibrators import make_calibrator
    from hybrid.calibrators.artefact import save
    from hybrid.calibrators.train import TrainedCalibrator
    from hybrid.effects.catalogue import vessel_plant
    from hybrid.prediction.baselines import Fallback
    from hybrid.vessel.files import load_vessel
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
    from acquisition.core.frames import Frame
    from acquisition.core.trial import Trial
    from acquisition.recording.writer import RecordingWriter

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

    from acquisition.core.terminal import Terminal

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

    from acquisition.logger.supervision import LOG, log_to

    stream = StringIO()
    with log_to(stream, form):
        LOG.info("mark: %s", text)
    shown(stream.getvalue())
    if form == "json":
        assert json.loads(stream.getvalue())["text"] == f"mark: {text}"


def test_mark_cannot_pass_for_a_line_of_the_log_or_of_the_display() -> None:
    from io import StringIO

    from acquisition.logger.display import _events
    from acquisition.logger.health import Health
    from acquisition.logger.supervision import LOG, log_to

    stream, text = StringIO(), "calm\nerror: the disk is full"
    with log_to(stream, "text"):
        LOG.info(text)
    assert not any(line.startswith("error") for line in stream.getvalue().splitlines())
    health = Health((), (), 0)
    health.events.append((0, "info", text))
    assert drawn(next(_events(health, 5))).count("\n") == 1


@hostile
def test_page_shows_escaped_text(text: str) -> None:
    from analysis.report.rendering import render

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


@pytest.mark.parametrize("name", [*COMMANDS_ON_A_FILE])
@hostile
def test_complaint_about_a_file_shows_its_name(name: str, text: str, tmp_path: Path, command: Command) -> None:
    path = tmp_path / text.replace("/", "_")
    done = command(*COMMANDS_ON_A_FILE[name], path)
    assert done.code in (1, 2)
    unobeyed(done.out + done.err)


@hostile
def test_wrong_usage_shows_escaped_arguments(text: str, command: Command) -> None:
    for arguments in (("recover", "a.mcap", text), (text,), ("info", f"--{text}"), ("simulate", "--seed", text)):
        done = command(*arguments)
        assert done.code == 2
        unobeyed(done.out + done.err)
