"""An output is complete or absent, two commands never mix, the same input gives the same bytes."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from seatrial.acquisition.core.files import LOCK_NAME
from tests.attacks import commands, interruptions
from tests.attacks.commands import PATIENCE_S, ROOT, run_seatrial
from tests.attacks.interruptions import (
    UNDISTURBED,
    Act,
    CommandLine,
    Interrupted,
    cut_off,
    hidden,
    in_fresh_process,
    interrupted_everywhere,
    paused_everywhere,
    visible,
)
from tests.conftest import Command

TRIAL, RAW, TABLE, LONG = "trial.mcap", "raw.mcap", "table.csv", "long.mcap"
SECOND_NS = 1_000_000_000
FORMATS = ("csv", "parquet", "mat", "xlsx", "nc", "db3", "mf4", "kml", "gpx")
SHIP = ("--length", "82", "--beam", "12.5", "--draught", "5.2", "--block", "0.74", "--service-speed", "6.2",
        "--propeller", "propeller,diameter=3.1", "--rudder", "rudder,area=9.5")  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, one with raw input, and a table."""
    from seatrial.acquisition.core.trial import Trial
    from seatrial.acquisition.recording.writer import write_table
    from seatrial.hybrid.simulation.trial import simulate_trial

    folder = tmp_path_factory.mktemp("inputs")
    table, _ = simulate_trial("gunnerus_long", "calm", "paper", 120.0, 1.0, 0)
    trial = Trial(name="trial", vessel="gunnerus_long", origin_latitude_deg=63.4, origin_longitude_deg=10.4)
    write_table(table, folder / TRIAL, trial, source="simulated")
    table.to_csv(folder / TABLE, index_label="time")
    _record_raw(folder)
    return folder


def _record_raw(folder: Path) -> None:
    """Two minutes of headings as sentences, decoded by the configuration beside them."""
    from seatrial.acquisition.config.trial_file import load_config
    from seatrial.acquisition.core.trial import Frame, FrameFlag
    from seatrial.acquisition.logger.pipeline import initial_health
    from seatrial.acquisition.logger.processing import FrameProcessor
    from seatrial.acquisition.protocols.nmea0183 import frame_sentence
    from seatrial.acquisition.recording.writer import RecordingWriter

    source = '[[source]]\nname = "line"\ntype = "udp"\nport = 10110\nchannels = ["heading_deg"]\n'
    (folder / "raw.toml").write_text(f'[trial]\nname = "raw"\n{source}')
    config = load_config(folder / "raw.toml")
    with RecordingWriter(folder / RAW, config.trial, config.attachments) as writer:
        processing = FrameProcessor(config, writer, initial_health(config))
        for second in range(1, 120):
            data, times = frame_sentence(f"HEHDT,{second:.1f},T").strip(), (second * SECOND_NS, second * SECOND_NS)
            processing.process(Frame("line", "nmea0183", data, *times, None, FrameFlag.NONE))


@pytest.fixture
def folder(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the inputs, and the working folder."""
    place = tmp_path / "work"
    shutil.copytree(inputs, place)
    monkeypatch.chdir(place)
    return place


def refused(done: object) -> str:
    """The one line of a command that was refused."""
    code, err = done.code, done.err  # type: ignore[attr-defined]
    lines = [line for line in err.splitlines() if line.startswith("seatrial: ")]
    assert code == 1, (code, err)
    assert len(lines) == 1, err
    return lines[0]


# ---- Two commands with one output


WRITERS: dict[str, tuple[tuple[str, ...], str]] = {
    "export": (("export", TRIAL, "-o", "out.csv"), "out.csv"),
    "import": (("import", TABLE, "-o", "out.mcap"), "out.mcap"),
    "import --preview": (("import", TABLE, "-o", "new.mcap", "--preview", "out.png"), "out.png"),
    "recover": (("recover", TRIAL, "-o", "out.mcap"), "out.mcap"),
    "migrate": (("migrate", TRIAL, "-o", "out.mcap"), "out.mcap"),
    "redecode": (("redecode", RAW, "-o", "out.mcap"), "out.mcap"),
    "check --repair": (("check", TRIAL, "--repair", "out.mcap"), "out.mcap"),
    "check": (("check", TRIAL, "-o", "out"), "out/"),
    "windows": (("windows", TRIAL, "-o", "out.parquet"), "out.parquet"),
    "smooth": (("smooth", TRIAL, "-o", "out.parquet"), "out.parquet"),
    "manoeuvres": (("manoeuvres", TRIAL, "-o", "out"), "out/"),
    "batch": (("batch", ".", "-o", "out"), "out/"),
    "discover": (("discover", RAW, "-o", "out.toml"), "out.toml"),
    "init": (("init", "out", *SHIP), "out/"),
    "simulate": (("simulate", "-o", "out.mcap"), "out.mcap"),
    "campaign": (("campaign", str(ROOT / "trials" / "campaign.toml"), "-o", "out"), "out/"),
    "demo": (("demo", "-o", "out"), "out/"),
    "plan": (("plan", "-o", "out"), "out/"),
    "plan --write": (("plan", "--write", "out.toml"), "out.toml"),
    "train": (("train", TRIAL, "-o", "out"), "out/"),
    "evaluate": (("evaluate", TRIAL, "-o", "out"), "out/"),
    "diagnose": (("diagnose", TRIAL, "-o", "out"), "out/"),
    "identify": (("identify", TRIAL, "-o", "out.toml"), "out.toml"),
    "speed-power": (("speed-power", TRIAL, "-o", "out"), "out/"),
    "report": (("report", TRIAL), "trial/"),
    "report of a folder": (("report", "out"), "out/"),
    "vessel new": (("vessel", "new", "-o", "out.toml", *SHIP), "out.toml"),
    "vessel check": (("vessel", "check", "gunnerus_long", "-o", "out.html"), "out.html"),
    "vessel export": (("vessel", "export", "otter_2m", "-o", "out.csv"), "out.csv"),
    "vessel map": (("vessel", "map", "out.fmu", "-o", "out.toml"), "out.toml"),
    "reproduce table3": (("reproduce", "table3", "-o", "out"), "out/"),
    "reproduce figures": (("reproduce", "figures", "-o", "out"), "out/"),
    "reproduce fidelity": (("reproduce", "fidelity", "-o", "out"), "out/"),
}
"""Every command that writes: its arguments, and what it writes to; a folder ends in a slash."""


@contextmanager
def other_command(output: str) -> Iterator[int]:
    """Another process that writes to an output until the end; its number."""
    code = (
        "import sys; from pathlib import Path\n"
        "from seatrial.acquisition.core.files import lock_output_file, lock_output_folder\n"
        "lock = lock_output_folder if sys.argv[1].endswith('/') else lock_output_file\n"
        "with lock(Path(sys.argv[1])): print('locked', flush=True); sys.stdin.read()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, output], env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"locked\n"
        yield process.pid
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def busy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, int]]]:
    """A folder in which other processes write to every output of :data:`WRITERS`; their numbers."""
    place = tmp_path_factory.mktemp("busy")
    with ExitStack() as stack:
        names = sorted({output for _, output in WRITERS.values()})
        pids = {
            name: stack.enter_context(other_command(str(place / name) + "/" * name.endswith("/"))) for name in names
        }
        yield place, pids


@pytest.mark.parametrize("name", WRITERS)
def test_second_command_on_an_output_is_refused_and_names_the_process(
    name: str, busy: tuple[Path, dict[str, int]], inputs: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, pids = busy
    arguments, output = WRITERS[name]
    shutil.copytree(inputs, place, dirs_exist_ok=True)
    monkeypatch.chdir(place)
    before = visible(place)
    line = refused(command(*arguments))
    assert f"process {pids[output]} " in line
    assert "wait until it ends" in line
    assert visible(place) == before


def test_every_command_with_an_output_is_attacked() -> None:
    """A new command that writes has to be in the list above."""
    import typer.main

    import seatrial

    def writing(command: Any, name: str = "") -> set[str]:
        parts = getattr(command, "commands", {})
        here = {name} if any("-o" in parameter.opts for parameter in command.params) else set[str]()
        return here.union(*(writing(part, f"{name} {word}".strip()) for word, part in parts.items()))

    with_files_of_their_own = {"record", "serve"}
    assert writing(typer.main.get_command(seatrial.app)) - with_files_of_their_own <= set(WRITERS)


def test_lock_of_a_killed_process_blocks_nobody(folder: Path, command: Command) -> None:
    for output in ("out.csv", "out/"):
        with other_command(output) as pid:
            os.kill(pid, signal.SIGKILL)
    assert hidden(folder)  # what it left
    assert command("export", TRIAL, "-o", "out.csv").code == 0
    assert command("check", TRIAL, "-o", "out").code == 0
    assert hidden(folder) == []


@pytest.mark.parametrize("alias", ["./out", "out/", "link", "../work/out"])
def test_one_folder_by_two_names_is_one_output(alias: str, folder: Path, command: Command) -> None:
    (folder / "link").symlink_to("out")
    with other_command("out/"):
        refused(command("check", TRIAL, "-o", alias))


def test_lock_does_not_outlive_its_command_or_litter(folder: Path, command: Command) -> None:
    refused(command("export", "missing.mcap", "-o", "new/deep/out.csv"))
    refused(command("check", "missing.mcap", "-o", "other/out"))
    assert not (folder / "new").exists()
    assert not (folder / "other").exists()
    assert hidden(folder) == []


PAIRS: dict[str, tuple[Act, Act, str]] = {
    "export csv": (CommandLine("export", TRIAL, "-o", "out.csv"),
                   CommandLine("export", TRIAL, "-o", "out.csv", "--rate", "0.5"), "out.csv"),
    "export parquet": (CommandLine("export", TRIAL, "-o", "out.parquet"),
                       CommandLine("export", TRIAL, "-o", "out.parquet", "--rate", "0.5"), "out.parquet"),
    "windows": (CommandLine("windows", TRIAL, "-o", "out.parquet", "--horizon", "5"),
                CommandLine("windows", TRIAL, "-o", "out.parquet", "--horizon", "8"), "out.parquet"),
    "simulate": (CommandLine("simulate", "-o", "out.mcap", "--duration", "30", "--rate", "1"),
                 CommandLine("simulate", "-o", "out.mcap", "--duration", "30", "--rate", "1", "--seed", "1"),
                 "out.truth.json"),
    "check and manoeuvres": (CommandLine("check", TRIAL, "-o", "out"),
                             CommandLine("manoeuvres", TRIAL, "-o", "out"), "out/quality.json"),
}  # fmt: skip


@pytest.mark.attack
@pytest.mark.parametrize("killed", [False, True], ids=["goes on", "is killed"])
@pytest.mark.parametrize("name", PAIRS)
def test_command_that_starts_amid_another_on_its_output_never_mixes(
    name: str, killed: bool, inputs: Path, tmp_path: Path
) -> None:
    """The first is paused at each change that it makes to the disk, and the second has all the time it wants."""
    first, second, last = PAIRS[name]
    together = name == "check and manoeuvres"
    alone = [_alone(act, inputs, tmp_path / f"alone_{number}") for number, act in enumerate((first, second))]
    ends = in_fresh_process(partial(paused_everywhere, killed=killed), first, second, inputs, tmp_path)
    assert len(ends) > 5
    for end, during, place in ends:
        assert during.code in (0, 1), during.err
        assert during.code == 0 or "is being written by another command" in during.err, during.err
        if killed:  # a dead process holds nothing
            assert during.code == 0, during.err
        else:
            assert end.code == 0 or "is being written by another command" in end.err, end.err
        state = visible(place)
        if together:  # one after the other into one folder
            assert state.items() <= {**alone[0], **alone[1]}.items()
        else:
            assert _is_whole(state, *alone, last), sorted(state)
        assert killed or hidden(place) == []


def _alone(act: Act, start: Path, place: Path) -> dict[str, bytes]:
    shutil.copytree(start, place)
    in_fresh_process(interruptions.forked, act, place)
    return visible(place)


# ---- Left-overs


def test_writers_of_one_file_have_files_of_their_own(tmp_path: Path) -> None:
    from seatrial.acquisition.core.files import atomic_file

    path = tmp_path / "out.txt"
    with atomic_file(path) as first:
        first.write_text("first")
        with atomic_file(path) as second:
            assert first != second
            second.write_text("second")
        assert path.read_text() == "second"
        with first.open("a") as stream:
            stream.write(", all of it")
    assert path.read_text() == "first, all of it"
    assert list(tmp_path.iterdir()) == [path]


def test_left_over_of_a_killed_process_goes_and_that_of_a_living_one_stays(folder: Path, command: Command) -> None:
    from seatrial.acquisition.core.files import atomic_file

    pid = os.fork()
    if pid == 0:
        with atomic_file("out.csv") as partial_path:
            partial_path.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(pid, 0)
    (dead,) = hidden(folder)
    with atomic_file("out.csv") as living:
        assert command("export", TRIAL, "-o", "out.csv").code == 0
        assert not (folder / dead).exists()
        assert living.exists()
        living.write_text("whole")
    assert (folder / "out.csv").read_text() == "whole"
    assert hidden(folder) == []


@pytest.mark.parametrize(
    "name", [".out.csv.part", ".out.csv.bak", ".out.csv.0123456789abcdef.part.txt", ".out.csv.x.part"]
)
def test_hidden_files_of_the_user_stay(name: str, folder: Path, command: Command) -> None:
    (folder / name).write_text("mine")
    assert command("export", TRIAL, "-o", "out.csv").code == 0
    assert (folder / name).read_text() == "mine"


LONGEST = {"letters": "x" * 300, "two bytes each": "å" * 150, "four bytes each": "🚢" * 80}


@pytest.mark.parametrize("ending", [".parquet", ".mcap", ".csv"])
@pytest.mark.parametrize("kind", LONGEST)
def test_longest_name_is_written(kind: str, ending: str, folder: Path, command: Command) -> None:
    room = 255 - len(ending) - (len(".json") if ending == ".csv" else 0)
    name = LONGEST[kind].encode()[:room].decode(errors="ignore") + ending
    what = ("recover", TRIAL) if ending == ".mcap" else ("export", TRIAL)
    done = command(*what, "-o", name)
    assert done.code == 0, done.err
    assert (folder / name).stat().st_size > 1000
    assert hidden(folder) == []


def test_names_that_differ_at_their_very_end_do_not_block_each_other(folder: Path, command: Command) -> None:
    stem = "x" * 240
    with other_command(f"{stem}_1.parquet"):
        assert command("export", TRIAL, "-o", f"{stem}_2.parquet").code == 0


# ---- An output that is an input, a device, a pipe

OVER_INPUTS: dict[str, tuple[tuple[str, ...], str]] = {
    "recover": (("recover", TRIAL, "-o", "{}.mcap"), TRIAL),
    "migrate": (("migrate", TRIAL, "-o", "{}.mcap"), TRIAL),
    "redecode": (("redecode", RAW, "-o", "{}.mcap"), RAW),
    "redecode of parts": (("redecode", TRIAL, RAW, "-o", "{}.mcap"), RAW),
    "redecode's configuration": (("redecode", RAW, "--config", "raw.toml", "-o", "{}.mcap"), "raw.toml"),
    "check --repair": (("check", TRIAL, "--repair", "{}.mcap"), TRIAL),
    "export": (("export", TRIAL, "-o", "{}.csv"), TRIAL),
    "windows": (("windows", TRIAL, "-o", "{}.parquet"), TRIAL),
    "smooth": (("smooth", TRIAL, "-o", "{}.parquet"), TRIAL),
    "import": (("import", TABLE, "--force", "-o", "{}.mcap"), TABLE),
    "import --write-map": (("import", TABLE, "--force", "-o", "new.mcap", "--write-map", "{}.toml"), TABLE),
    "import --preview": (("import", TABLE, "--yes", "-o", "new.mcap", "--preview", "{}.png"), TABLE),
    "identify": (("identify", TRIAL, "--vessel", "ship.toml", "-o", "{}.toml"), "ship.toml"),
    "vessel check": (("vessel", "check", "ship.toml", "-o", "{}.html"), "ship.toml"),
    "vessel export": (("vessel", "export", "ship.toml", "-o", "{}.py"), "ship.toml"),
}


@pytest.mark.parametrize("link", ["hard link", "symbolic link"])
@pytest.mark.parametrize("name", OVER_INPUTS)
def test_output_that_is_an_input_is_refused(name: str, link: str, folder: Path, command: Command) -> None:
    shutil.copy(ROOT / "trials" / "vessels" / "gunnerus_long.toml", folder / "ship.toml")
    arguments, source = OVER_INPUTS[name]
    output = folder / next(part for part in arguments if "{}" in part).format("alias")
    if link == "hard link":
        output.hardlink_to(folder / source)
    else:
        output.symlink_to(source)
    before = visible(folder)
    line = refused(command(*(part.format("alias") for part in arguments)))
    assert "is an input of this command" in line
    assert visible(folder) == before
    assert output.samefile(folder / source)


@pytest.mark.parametrize("arguments", [
    ("recover", TRIAL, "-o", TRIAL), ("redecode", RAW, "-o", RAW), ("check", TRIAL, "--repair", TRIAL),
    ("migrate", TRIAL, "-o", TRIAL), ("recover", TRIAL, "-o", f"./{TRIAL}"),
    ("redecode", RAW, "-o", f"../work/{RAW}"),
], ids=" ".join)  # fmt: skip
def test_input_named_as_the_output_is_refused(arguments: tuple[str, ...], folder: Path, command: Command) -> None:
    before = visible(folder)
    refused(command(*arguments))
    assert visible(folder) == before


def test_input_within_an_output_folder_is_refused(folder: Path, command: Command) -> None:
    """The folder has no name to compare; a file of it turns out to be an input when it is written."""
    from seatrial.acquisition.core.errors import InputError
    from seatrial.acquisition.core.files import protect_inputs, remove_file, write_text

    vessel = folder / "vessel.toml"
    vessel.write_text("mine")
    with protect_inputs([vessel, folder, folder / "missing"]):
        for change in (lambda: write_text(vessel, "other"), lambda: remove_file(vessel)):
            with pytest.raises(InputError, match="is an input"):
                change()
        write_text(folder / "other.toml", "fine")
    assert vessel.read_text() == "mine"


@pytest.mark.parametrize("kind", ["pipe", "socket", "link to a device", "link to standard output"])
def test_device_or_pipe_is_not_replaced(kind: str, folder: Path, command: Command) -> None:
    path = folder / "out.toml"
    with socket.socket(socket.AF_UNIX) as listener:
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "socket":
            listener.bind("out.toml")
        else:
            path.symlink_to("/dev/null" if kind == "link to a device" else "/proc/self/fd/1")
        before = path.lstat()
        assert "is a device or a pipe" in refused(command("vessel", "new", "-o", path, *SHIP))
        assert os.path.samestat(path.lstat(), before)
    assert hidden(folder) == []


# ---- The same bytes


@pytest.fixture(scope="module")
def twice(inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, dict[str, bytes]]]:
    """What each quick command wrote of the same input, twice, some seconds apart."""
    import seatrial

    products = []
    for number in range(2):
        place, written = tmp_path_factory.mktemp(f"same_{number}") / "work", dict[str, dict[str, bytes]]()
        shutil.copytree(inputs, place)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(place)
            for name, arguments in SAME.items():
                before = visible(place)
                patch.setattr(sys, "argv", ["seatrial", *arguments])
                with pytest.raises(SystemExit) as end:
                    seatrial.main()
                assert not end.value.code, arguments
                written[name] = {path: content for path, content in visible(place).items() if path not in before}
        products.append(written)
        if number == 0:
            time.sleep(2.1)  # the coarsest time of a format: two seconds, in ZIP
    return products


SAME = {
    **{kind: ("export", TRIAL, "-o", f"same.{kind}") for kind in FORMATS},
    "smoothed": ("smooth", TRIAL, "-o", "smoothed.parquet"),
    "windows": ("windows", TRIAL, "-o", "windows.parquet", "--horizon", "5"),
    "recovered": ("recover", TRIAL, "-o", "recovered.mcap"),
    "redecoded": ("redecode", RAW, "-o", "redecoded.mcap"),
    "repaired": ("check", TRIAL, "--repair", "repaired.mcap", "-o", "quality"),
    "imported": ("import", TABLE, "-o", "imported.mcap"),
    "simulated": ("simulate", "-o", "simulated.mcap", "--duration", "30", "--rate", "1"),
    "vessel": ("vessel", "new", "-o", "vessel.toml", *SHIP),
    "manoeuvres": ("manoeuvres", TRIAL, "-o", "manoeuvres"),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_same_input_gives_the_same_bytes(name: str, twice: list[dict[str, dict[str, bytes]]]) -> None:
    first, second = (product[name] for product in twice)
    assert first
    assert first.keys() == second.keys()
    assert [path for path in first if first[path] != second[path]] == []


@pytest.mark.attack
def test_report_gives_the_same_bytes_by_another_process(inputs: Path, tmp_path: Path) -> None:
    """HTML, PDF, SVG and JSON; another hash seed, another time zone, a later second."""
    pages = []
    for number, zone in enumerate(("UTC", "Asia/Tokyo")):
        place = tmp_path / f"{number}" / "work"
        shutil.copytree(inputs, place)
        environment = {"PYTHONHASHSEED": str(number), "TZ": zone}
        run_seatrial("report", TRIAL, cwd=place, environment=environment).done()
        run_seatrial("batch", ".", "-o", "../batch", "--workers", "1", cwd=place, environment=environment)
        pages.append(visible(place.parent))
        time.sleep(1.1)
    assert {Path(name).suffix for name in pages[0]} >= {".html", ".pdf", ".svg", ".json", ".parquet"}
    assert pages[0].keys() == pages[1].keys()
    assert [name for name in pages[0] if pages[0][name] != pages[1][name]] == []


# ---- Interruptions


def _is_whole(state: dict[str, bytes], before: dict[str, bytes], after: dict[str, bytes], last: str) -> bool:
    """Whether what is visible is that of before, that of after, or, without the file that marks it, whole files."""
    if state in (before, after):
        return True
    pieces = all(content in (before.get(name), after.get(name)) for name, content in state.items())
    return pieces and last not in state


def _cases() -> dict[str, tuple[Act | None, Act, str]]:
    exports = {
        kind: (CommandLine("export", TRIAL, "-o", f"out.{kind}", "--rate", "0.5"),
               CommandLine("export", TRIAL, "-o", f"out.{kind}"), f"out.{kind}")
        for kind in FORMATS
    }  # fmt: skip
    return {
        **{f"export {kind}": case for kind, case in exports.items()},
        "import": (CommandLine("simulate", "-o", "out.mcap", "--duration", "10"),
                   CommandLine("import", TABLE, "-o", "out.mcap", "--force"), "out.mcap"),
        "import by recognition": (None, CommandLine("import", "renamed.csv", "-o", "out.mcap", "--force", "--yes",
                                                    "--preview", "out.png"), "out.mcap"),
        "windows": (CommandLine("windows", TRIAL, "-o", "out.parquet", "--horizon", "8"),
                    CommandLine("windows", TRIAL, "-o", "out.parquet", "--horizon", "5"), "out.parquet"),
        "smooth": (None, CommandLine("smooth", TRIAL, "-o", "out.parquet"), "out.parquet"),
        "check --repair": (CommandLine("recover", TRIAL, "-o", "out.mcap"),
                           CommandLine("check", TRIAL, "--repair", "out.mcap"), "out.mcap"),
        "check": (CommandLine("check", RAW, "-o", "out"), CommandLine("check", TRIAL, "-o", "out"),
                  "out/quality.json"),
        "recover": (None, CommandLine("recover", TRIAL, "-o", "out.mcap"), "out.mcap"),
        "redecode": (None, CommandLine("redecode", RAW, "-o", "out.mcap"), "out.mcap"),
        "simulate": (CommandLine("simulate", "-o", "out.mcap", "--duration", "20", "--rate", "1"),
                     CommandLine("simulate", "-o", "out.mcap", "--duration", "30", "--rate", "1", "--seed", "1"),
                     "out.truth.json"),
        "manoeuvres": (CommandLine("manoeuvres", TRIAL, "-o", "out", "--length", "40"),
                       CommandLine("manoeuvres", TRIAL, "-o", "out"), "out/manoeuvres.json"),
        "vessel new": (CommandLine("vessel", "new", "-o", "out.toml", "--name", "earlier", *SHIP),
                       CommandLine("vessel", "new", "-o", "out.toml", *SHIP), "out.toml"),
    }  # fmt: skip


CASES = _cases()


@pytest.fixture
def begin(inputs: Path, tmp_path: Path) -> Path:
    """A folder with inputs, one of them a table of foreign names."""
    place = tmp_path / "begin" / "work"
    shutil.copytree(inputs, place)
    renamed = (place / TABLE).read_text().replace("heading_deg", "Heading [deg]").replace("time", "Time UTC")
    (place / "renamed.csv").write_text(renamed)
    return place


def assert_interrupted_well(results: list[Interrupted], begin: Path, whole: Path, last: str) -> None:
    """What each interruption left is whole, and the same command again gives what it would have given."""
    before, after = visible(begin), visible(whole)
    assert hidden(begin) == hidden(whole) == []
    assert before != after
    assert len(results) >= 3
    for end, place, resumed in results:
        _assert_results_whole(visible(place), before, after, last, end)
        assert visible(resumed) == after, end
        assert hidden(resumed) == [], end


def _assert_results_whole(
    state: dict[str, bytes], before: dict[str, bytes], after: dict[str, bytes], last: str, end: object
) -> None:
    """Each result of a batch is one of both or absent; the files around them belong together."""

    def parted(files: dict[str, bytes]) -> tuple[dict[str, bytes], dict[str, bytes]]:
        names = {name for name in files if name.startswith("out/") and name.count("/") > 1}
        return {name: files[name] for name in names}, {name: files[name] for name in files.keys() - names}

    (result, around), (old, around_old), (new, around_new) = parted(state), parted(before), parted(after)
    assert result in (old, new, {}), end
    assert _is_whole(around, around_old, around_new, last), (end, sorted(around))


@pytest.mark.attack
@pytest.mark.parametrize("name", CASES)
def test_killed_at_any_change_it_leaves_whole_files_and_is_resumed(name: str, begin: Path, tmp_path: Path) -> None:
    earlier, act, last = CASES[name]
    results = in_fresh_process(interrupted_everywhere, earlier, act, begin, interruptions.kill, tmp_path)
    assert_interrupted_well(results, begin, tmp_path / UNDISTURBED, last)
    assert {end.code for end, _, _ in results} == {-signal.SIGKILL}


@pytest.mark.attack
@pytest.mark.parametrize(
    "interruption", [interruptions.terminate, interruptions.interrupt], ids=["SIGTERM", "SIGINT"]
)
@pytest.mark.parametrize("name", ["export csv", "recover", "check"])
def test_ended_by_a_signal_it_cleans_up(
    name: str, interruption: Callable[[], None], begin: Path, tmp_path: Path
) -> None:
    earlier, act, last = CASES[name]
    results = in_fresh_process(interrupted_everywhere, earlier, act, begin, interruption, tmp_path)
    assert_interrupted_well(results, begin, tmp_path / UNDISTURBED, last)
    for end, place, _ in results:
        assert end.code in (0, 130), end
        assert "Traceback" not in end.err
        assert len(hidden(place)) <= 1, end  # the file that it was making in that moment, which holds nobody up
    assert sum(not hidden(place) for _, place, _ in results) > len(results) // 2


@pytest.mark.attack
@pytest.mark.parametrize(
    "refusal", [interruptions.refuse_full, interruptions.refuse_read_only], ids=["full disk", "read-only disk"]
)
@pytest.mark.parametrize("name", ["export csv", "import", "windows", "redecode"])
def test_refused_by_the_disk_at_any_change_it_is_one_line(
    name: str, refusal: Callable[[], None], begin: Path, tmp_path: Path
) -> None:
    earlier, act, last = CASES[name]
    results = in_fresh_process(interrupted_everywhere, earlier, act, begin, refusal, tmp_path)
    assert_interrupted_well(results, begin, tmp_path / UNDISTURBED, last)
    for end, _, _ in results:
        assert end.code in (0, 1), end  # 0: only its lock could not be removed
        if end.code:
            _assert_one_line(end)


@pytest.mark.attack
@pytest.mark.parametrize("killed", [True, False], ids=["killed", "refused"])
@pytest.mark.parametrize("name", [name for name in CASES if name != "import"])
def test_cut_off_within_a_file_it_leaves_whole_files_and_is_resumed(
    name: str, killed: bool, begin: Path, tmp_path: Path
) -> None:
    """As on a disk that is full after so many bytes of a file."""
    earlier, act, last = CASES[name]
    results = in_fresh_process(partial(cut_off, killed=killed), earlier, act, begin, tmp_path)
    assert_interrupted_well(results, begin, tmp_path / UNDISTURBED, last)
    for end, place, _ in results:
        if killed:
            assert end.code == -signal.SIGXFSZ, end
        else:
            _assert_one_line(end)
            assert hidden(place) == [], end


def _assert_one_line(end: interruptions.End) -> None:
    lines = [line for line in end.err.splitlines() if line.startswith("seatrial: ")]
    assert (end.code, len(lines)) == (1, 1), end
    assert "Traceback" not in end.err, end
    assert ".part" not in lines[0], end


# ---- Commands that take long: their writing alone, or some of their changes


@pytest.fixture(scope="module")
def long_inputs(inputs: Path, unseen: Path, small_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of twenty minutes, a folder of recordings, and a calibrator."""
    place = tmp_path_factory.mktemp("long") / "work"
    (place / "in").mkdir(parents=True)
    shutil.copy(unseen, place / LONG)
    shutil.copy(inputs / TRIAL, place / "in" / TRIAL)
    shutil.copytree(small_folder, place / "small")
    return place


class SaveCalibrator:
    """A calibrator saved, of another time than any other."""

    def __init__(self, day: int) -> None:
        self.day = day

    def __call__(self) -> None:
        from dataclasses import replace
        from datetime import UTC, datetime

        from seatrial.hybrid.calibrators.own import load, save

        save(replace(load(Path("small")), trained_at=datetime(2026, 1, self.day, tzinfo=UTC)), Path("out"))


class RunBatch:
    """A batch in this one process, so that its workers are interrupted, too."""

    def __init__(self, stride_s: int) -> None:
        self.stride_s = stride_s

    def __call__(self) -> None:
        from seatrial.analysis import batch
        from seatrial.analysis.products import Options

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(batch, "run_jobs", lambda jobs, task, *_: [task(job) for job in jobs])
            options = Options(smooth=False, pictures=False, horizon_s=5, stride_s=self.stride_s)
            batch.run_batch("in", "out", options=options)


class WriteDiagnosis:
    """A diagnosis written; it is made once, and forked with its process."""

    run: Any = None

    def __init__(self, identified: bool) -> None:
        self.identified = identified

    def __call__(self) -> None:
        from dataclasses import replace

        from seatrial.hybrid.effects import catalogue_of
        from seatrial.hybrid.vessel.files import load_vessel
        from seatrial.hybrid.workflows import diagnose_files, write_diagnosis

        ship = load_vessel("gunnerus_short")
        if WriteDiagnosis.run is None:
            WriteDiagnosis.run = diagnose_files([Path(LONG)], ship, 0.01, catalogue_of(ship), identify=False)
        write_diagnosis(replace(WriteDiagnosis.run, refit=ship if self.identified else None), ship, Path("out"))


LONG_CASES: dict[str, tuple[Act, Act, str, int]] = {
    "train": (SaveCalibrator(1), SaveCalibrator(2), "out/calibrator.json", 1000),
    "batch": (RunBatch(5), RunBatch(8), "out/index.parquet", 1000),
    "diagnose": (WriteDiagnosis(True), WriteDiagnosis(False), "out/diagnosis.json", 1000),
    "report": (CommandLine("report", LONG, "--no-pdf", "--part", "0..50"), CommandLine("report", LONG, "--no-pdf"),
               f"{Path(LONG).stem}/report.html", 4),
}  # fmt: skip


@pytest.mark.attack
@pytest.mark.parametrize("name", LONG_CASES)
def test_long_command_killed_at_any_change_leaves_whole_files_and_is_resumed(
    name: str, long_inputs: Path, tmp_path: Path
) -> None:
    earlier, act, last, most = LONG_CASES[name]
    begin = tmp_path / "begin" / "work"
    shutil.copytree(long_inputs, begin)
    run = partial(interrupted_everywhere, most=most)
    results = in_fresh_process(run, earlier, act, begin, interruptions.kill, tmp_path)
    assert_interrupted_well(results, begin, tmp_path / UNDISTURBED, last)


# ---- Disks


@contextmanager
def small_disk(place: Path, size_kb: int) -> Iterator[Path]:
    """A disk of its own; the test is skipped where none can be mounted."""
    place.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", str(place)]
    if os.geteuid() or shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root may mount a disk, and not everywhere")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False)


ON_DISK: dict[str, tuple[str, ...]] = {
    "import": ("import", f"../{TABLE}", "-o", "out.mcap"),
    "export csv": ("export", f"../{TRIAL}", "-o", "out.csv"),
    "export parquet": ("export", f"../{TRIAL}", "-o", "out.parquet"),
    "export mat": ("export", f"../{TRIAL}", "-o", "out.mat"),
    "export nc": ("export", f"../{TRIAL}", "-o", "out.nc"),
    "export xlsx": ("export", f"../{TRIAL}", "-o", "out.xlsx"),
    "recover": ("recover", f"../{TRIAL}", "-o", "out.mcap"),
    "redecode": ("redecode", f"../{RAW}", "-o", "out.mcap"),
    "check --repair": ("check", f"../{TRIAL}", "--repair", "out.mcap"),
    "check": ("check", f"../{TRIAL}", "-o", "out"),
    "windows": ("windows", f"../{TRIAL}", "-o", "out.parquet", "--horizon", "5"),
    "simulate": ("simulate", "-o", "out.mcap", "--duration", "60"),
    "report": ("report", "trial.mcap", "--no-pdf"),
}


@pytest.mark.attack
@pytest.mark.parametrize("size_kb", [4, 12])
@pytest.mark.parametrize("name", ON_DISK)
def test_full_disk_is_one_line_and_leaves_nothing(
    name: str, size_kb: int, folder: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    with small_disk(folder / "disk", size_kb) as disk:
        if name == "report":
            (disk / "trial.mcap").symlink_to(folder / TRIAL)
        before = visible(disk)
        monkeypatch.chdir(disk)
        done = command(*ON_DISK[name])
        monkeypatch.chdir(folder)
        if done.code == 0:  # what fits is whole
            assert len(visible(disk)) > len(before)
        else:
            assert "No space left" in refused(done)
            assert visible(disk) == before
        assert hidden(disk) == []


@pytest.mark.attack
@pytest.mark.parametrize("name", ON_DISK)
def test_read_only_disk_is_one_line(
    name: str, folder: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    with small_disk(folder / "disk", 4000) as disk:
        (disk / "trial.mcap").symlink_to(folder / TRIAL)
        (disk / "out").mkdir()
        before = visible(disk)
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        monkeypatch.chdir(disk)
        line = refused(command(*ON_DISK[name]))
        monkeypatch.chdir(folder)
        assert "Read-only file system" in line
        assert visible(disk) == before


@pytest.mark.attack
@pytest.mark.parametrize("name", [name for name in ON_DISK if name != "report"])
def test_folder_that_vanishes_amid_a_command_is_one_line(
    name: str, folder: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is deleted when the first temporary file of an output is there."""
    output = folder / "deep" / "er"
    output.mkdir(parents=True)
    monkeypatch.chdir(output)
    arguments = [part.replace("../", "../../") for part in ON_DISK[name]]
    with _at_first_temporary_file(partial(shutil.rmtree, output)) as times:
        done = command(*arguments)
    monkeypatch.chdir(folder)
    assert times == [1]
    line = refused(done)
    assert ".part" not in line
    assert not output.exists()


@contextmanager
def _at_first_temporary_file(fault: Callable[[], None]) -> Iterator[list[int]]:
    """Make a fault when a temporary file of an output is there, and nothing is in it yet; how often that was."""
    from seatrial.acquisition.core import files

    times: list[int] = []
    new = files._create_locked_temporary

    def and_then(*arguments: Any, **options: Any) -> Any:
        made = new(*arguments, **options)
        if not times:
            times.append(1)
            fault()
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "_create_locked_temporary", and_then)
        yield times


# ---- Two batches


@pytest.mark.attack
def test_second_batch_on_a_folder_is_refused_and_the_first_is_as_alone(inputs: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for number in range(3):
        shutil.copy(inputs / TRIAL, tmp_path / "in" / f"{number}.mcap")
    quick = ("--workers", "1", "--no-smooth", "--no-pictures")
    run_seatrial("batch", "in", "-o", "alone", *quick, cwd=tmp_path).done()
    first = commands.start([sys.executable, "-m", "seatrial", "batch", "in", "-o", "out", *quick], cwd=tmp_path)
    until = time.monotonic() + PATIENCE_S
    while not (tmp_path / "out" / LOCK_NAME).exists():
        assert time.monotonic() < until
        time.sleep(0.05)
    for other in (("batch", "in", "-o", "out", *quick, "--stride", "9"), ("check", "in/0.mcap", "-o", "out")):
        line = run_seatrial(*other, cwd=tmp_path).refused().err
        assert f"process {first.pid} " in line
    assert first.wait(PATIENCE_S) == 0
    assert visible(tmp_path / "out") == visible(tmp_path / "alone")
    assert hidden(tmp_path / "out") == []


@pytest.mark.attack
@pytest.mark.parametrize("results", [0, 1, 2])
def test_batch_killed_with_its_workers_is_resumed_as_never_killed(
    results: int, inputs: Path, tmp_path: Path
) -> None:
    (tmp_path / "in").mkdir()
    for number in range(3):
        shutil.copy(inputs / TRIAL, tmp_path / "in" / f"{number}.mcap")
    quick = ("--workers", "1", "--no-smooth", "--no-pictures")
    first = commands.start([sys.executable, "-m", "seatrial", "batch", "in", "-o", "out", *quick], cwd=tmp_path)
    until = time.monotonic() + PATIENCE_S
    while (
        not (tmp_path / "out" / LOCK_NAME).exists()
        or len(list((tmp_path / "out").glob("*/summary.json"))) < results
    ):
        assert time.monotonic() < until
        time.sleep(0.02)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait(PATIENCE_S)
    assert not (tmp_path / "out" / "index.parquet").exists()
    run_seatrial("batch", "in", "-o", "out", *quick, cwd=tmp_path).done()
    run_seatrial("batch", "in", "-o", "alone", *quick, cwd=tmp_path).done()
    assert visible(tmp_path / "out") == visible(tmp_path / "alone")
    assert hidden(tmp_path / "out") == []
