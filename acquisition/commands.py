"""Functions of ``import seatrial as st`` that are commands, too: how one becomes the other; those aboard.

A command is its function: the options are the parameters, whose types say how the command line parses them. What a
function announces while it works is shown by its command and not by a script.
"""

from __future__ import annotations

import atexit
import inspect
import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial, wraps
from importlib.util import find_spec
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, Union, get_args

import typer

from seatrial.acquisition.core import errors, process

if TYPE_CHECKING:
    import threading

    import pandas as pd
    from rich.table import Table
    from typing_extensions import TypeIs

    from seatrial.acquisition.config.trial_file import TrialConfig
    from seatrial.acquisition.core.ship import Channel
    from seatrial.acquisition.discovery.discover import Discovery
    from seatrial.acquisition.emulator import Playback
    from seatrial.acquisition.logger.health import Health
    from seatrial.acquisition.logger.survey import RedecodeSummary
    from seatrial.acquisition.recording.reader import Recording as RecordingFile
    from seatrial.acquisition.recording.recover import Migration, RecoverySummary
    from seatrial.acquisition.tables.import_table import ImportSummary, Proposal
    from seatrial.acquisition.tables.table_files import RawTable
    from seatrial.acquisition.tables.topics import TopicLog

Function = TypeVar("Function", bound=Callable[..., Any])

ABOARD, RECORDINGS, TRIALS, PREDICTIONS, DIAGNOSIS = (
    "Aboard", "Recordings", "Trials", "Predictions", "What the model lacks"
)  # fmt: skip
"""The groups of commands in ``seatrial --help``."""


@dataclass(frozen=True, slots=True)
class Parsed:
    """The type that the command line parses where a script may give more, and whether a command has to say it."""

    kind: Any
    required: bool = False


Data = Union[str, Path, Sequence[str | Path], "pd.DataFrame"]
"""A recording, or several, or a table of one."""
Recording = Annotated[
    Data, Parsed(list[Path]), typer.Argument(metavar="FILES", help="A recording, or the parts of one.")
]
Output = Annotated[str | Path, Parsed(Path), typer.Option("-o", "--output", help="The file or folder to write.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object to stdout.")]


@dataclass(frozen=True, slots=True)
class Command:
    """A function of ``seatrial`` as a command: where it stands, what it writes, and how its result is shown."""

    function: Callable[..., Any]
    panel: str
    name: str
    files: tuple[str, ...]
    folder: str
    group: str
    show: Callable[..., None] | None
    in_store: bool

    @property
    def summary(self) -> str:
        """What the command does: the first paragraph of the function's docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n\n")[0]

    def callback(self) -> Callable[..., None]:
        """The function with the types that the command line parses, and ``--json`` if its result is shown."""
        scope, parameters = self.function.__globals__, []
        for parameter in inspect.signature(self.function).parameters.values():
            annotation = eval(parameter.annotation, scope)  # as our own source has it
            base, *extras = get_args(annotation) if hasattr(annotation, "__metadata__") else (annotation,)
            if not extras:
                continue  # for scripts only
            parsed = next((extra for extra in extras if isinstance(extra, Parsed)), Parsed(base))
            default = None if parameter.default == () else parameter.default
            kind = parsed.kind | None if default is None and not parsed.required else parsed.kind
            parameters.append(
                parameter.replace(
                    kind=inspect.Parameter.KEYWORD_ONLY,
                    annotation=Annotated[kind, extras[-1]],
                    default=inspect.Parameter.empty if parsed.required else default,
                )
            )
        if self.show is not None:
            parameters.append(
                inspect.Parameter("as_json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=AsJson)
            )

        @wraps(self.function)
        def run(**values: Any) -> None:
            as_json = self.show is not None and values.pop("as_json")
            arguments = {
                name: () if value is None and signature[name].default == () else value
                for name, value in values.items()
            }
            with self._protected_files(values), process.show_announcements():
                try:
                    result = self.function(**arguments)
                except errors.UsageError as error:
                    raise typer.BadParameter(error.what, param_hint=error.where) from error
                except KeyboardInterrupt as stop:  # 128 and the signal, as shells have it
                    raise typer.Exit(143 if isinstance(stop, process.Termination) else 130) from None
                if self.show is not None:
                    self.show(result, as_json, arguments)

        signature = inspect.signature(self.function).parameters
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    @contextmanager
    def _protected_files(self, values: Mapping[str, Any]) -> Iterator[None]:
        """Lock what the command writes while it runs; every other file that it names is an input, which no output
        may replace."""
        from seatrial.acquisition.core import files

        if not self.files and not self.folder:
            yield
            return
        outputs = (*self.files, self.folder)
        named = [value for name, value in values.items() if name not in outputs]
        inputs = [part for value in named for part in (value if isinstance(value, list) else [value])]
        with ExitStack() as stack:
            stack.enter_context(files.protect_inputs(Path(part) for part in inputs if isinstance(part, str | Path)))
            for path in [Path(values[name]) for name in self.files if values[name] is not None]:
                files.refuse_protected_input(path)
                stack.enter_context(files.lock_output_file(path))
            if values.get(self.folder) is not None:
                if not self.in_store:
                    files.refuse_store(values[self.folder])
                stack.enter_context(files.lock_output_folder(Path(values[self.folder])))
            yield


def is_table(data: Data) -> TypeIs[pd.DataFrame]:
    """Whether what was given is a table of channels."""
    return hasattr(data, "columns")


def recording_paths(data: Data) -> list[Path]:
    """The files of one recording or several; those in stores are copied, and a table of channels is written to a
    recording of its own, before.

    Copies and that recording lie in temporary folders until the process ends.
    """
    if not is_table(data):
        from seatrial.acquisition.core.stores import lasting_copies

        return lasting_copies(_given_paths(data))
    folder = Path(mkdtemp(prefix="seatrial-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return [write(data, folder / "table.mcap")]


def _given_paths(data: str | Path | Sequence[str | Path]) -> list[Path]:
    """The paths of one recording or several, as they were given."""
    return [Path(data)] if isinstance(data, str | Path) else [Path(part) for part in data]


def print_result(result: Any, as_json: bool, options: Mapping[str, Any]) -> None:
    """A result on standard output: as JSON, or as a terminal shows it, the model that it is of first."""
    if as_json:
        process.print_line(json.dumps(result.as_dict()))
        return

    for line in getattr(result, "first_lines", ()):
        process.print_line(line)
    errors.Terminal().print(result)


def command(
    panel: str,
    *files: str,
    name: str = "",
    folder: str = "",
    group: str = "",
    show: Callable[..., None] | None = None,
    in_store: bool = False,
) -> Callable[[Function], Function]:
    """Make a function a command, too; the function itself stays as it is.

    Parameters
    ----------
    panel
        The group of commands that it stands in.
    *files, folder
        The parameters that name what it writes.
    name
        The name of the command, if it is not the function's.
    group
        The command before it, as in ``seatrial vessel check``.
    show
        Prints the result, ``show(result, as_json, options)``; without it the function prints by itself.
    in_store
        The folder may be in an object store.
    """

    def register_command(function: Function) -> Function:
        word = name or function.__name__.replace("_", "-")
        COMMANDS.append(Command(function, panel, word, files, folder, group, show, in_store))
        return function

    return register_command


COMMANDS: list[Command] = []
"""Every command, in the order of ``--help``."""


def mount_commands(app: typer.Typer, groups: Mapping[str, typer.Typer]) -> None:
    """Add all commands to the command line; their help is what the functions say of themselves."""
    for entry in COMMANDS:
        groups.get(entry.group, app).command(
            entry.name, rich_help_panel=None if entry.group else entry.panel, help=entry.summary
        )(entry.callback())


@command(ABOARD)
def record(
    config: Annotated[str | Path, Parsed(Path), typer.Argument(help="The trial's configuration, a TOML file.")],
    output: Annotated[
        str | Path | None, Parsed(Path), typer.Option("-o", "--output", help="The folder for the recording.")
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration", min=0.0, help="Stop after this many seconds.")
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Record nothing: listen, list the channels that would be missing, try the sinks."
        ),
    ] = False,
    log: Annotated[str, typer.Option(help="Log format without a terminal: text, or json lines.")] = "text",
    live: Annotated[bool, typer.Option("--live", help="Serve the live view for Foxglove and Lichtblick.")] = False,
    as_json: AsJson = False,
) -> list[Path]:
    """Record a trial; SIGINT and SIGTERM end it cleanly.

    Parameters
    ----------
    config
        The TOML file with the trial's sources, channels and run sheet.
    output
        The folder for the recording; needed unless ``check``.
    duration_s
        When to stop [s]; by default on a signal, with ``check`` after 10 s.
    check
        Record nothing: listen, list the channels that would be missing, and try the sinks.
    log
        "text" or "json" lines, where there is no terminal.
    live
        Serve the live view for Foxglove and Lichtblick.
    as_json
        Print the counts as one JSON object instead of the paths.

    Returns
    -------
    list of Path
        The parts of the recording; empty with ``check``.

    Raises
    ------
    ConfigurationError
        For a configuration that cannot be used.
    SourceError
        Where no source can be opened.
    StorageError
        Where the recording cannot be written.

    See Also
    --------
    discover
        Find out what buses carry, and write the configuration.
    emulate
        Play a recording onto buses, to try a configuration.
    redecode
        Rebuild the channels with a corrected configuration.

    Examples
    --------
    >>> import seatrial as st
    >>> discovery = st.discover(["bridge.log"], output="bridge.toml")
    >>> paths = st.record("bridge.toml", "recordings")
    recordings/bridge_...Z.mcap
    >>> st.read(paths)["heading_deg"].tolist()
    [90.0]
    """
    folder = None if output is None else Path(output)
    if log not in ("text", "json"):
        raise errors.UsageError("is neither text nor json", where="--log")
    if folder is not None:
        from seatrial.acquisition.core.files import refuse_store

        refuse_store(folder)
    if folder is None and not check:
        raise errors.UsageError("is missing: the folder that the recording goes into", where="-o")
    with process.stop_on_signals() as stop:  # before the heavy imports: they take a while, and Ctrl-C may come
        from seatrial.acquisition.config.trial_file import load_config

        if find_spec("fcntl") is None:
            raise errors.ConfigurationError(
                "the recorder needs a POSIX system", why="it uses terminals, locks and sockets of Linux or macOS",
                fix="record there; everything ashore works here",
            )  # fmt: skip
        from seatrial.acquisition.logger.record import record as run

        trial = load_config(config)
        if check or folder is None:
            _print_preflight_report(trial, folder, 10.0 if duration_s is None else duration_s, stop, as_json)
            return []
        paths, health = run(trial, folder, duration_s, stop, log_format=log, live=live)  # type: ignore[arg-type]
    if log == "text":
        _print_record_summary(trial, health, paths)
    sources = health.sources.values()
    counts: dict[str, Any] = {
        "parts": [str(path) for path in paths],
        "frames": sum(source.frames for source in sources),
        "samples": health.samples,
        "dropped": sum(source.dropped for source in sources),
        "channels": [name for name, channel in health.channels.items() if channel.count],
    }
    if health.sinks:
        counts["sinks"] = {
            name: {"sent": sink.sent, "dropped": sink.dropped, "error": sink.error}
            for name, sink in health.sinks.items()
        }
    try:
        process.print_line(json.dumps(counts) if as_json else "\n".join(map(str, paths)))
    except OSError as error:  # the recording is there all the same
        process.print_line(f"warning: {error}", err=True)
    return paths


def _print_record_summary(trial: TrialConfig, health: Health, paths: list[Path]) -> None:
    from seatrial.acquisition.logger.record import summary_text

    process.print_line(summary_text(health, paths), err=True)
    for _, level, text in health.events:  # the table that showed them is gone
        if level == "error" and sys.stderr.isatty():
            process.print_line(f"error: {text}", err=True)
    watched = [name for name in health.names if name in trial.expected_channels]
    listed = [*watched, *sorted(trial.expected_channels - {*watched})]
    if silent := [name for name in listed if name not in health.channels or not health.channels[name].count]:
        from seatrial.acquisition.logger.survey import missing_reasons, reason_by_channels

        for names, reason in reason_by_channels(missing_reasons(trial, paths, silent)).items():
            process.print_line(f"warning: nothing came of {names}{': ' if reason else ''}{reason}", err=True)


def _print_preflight_report(
    trial: TrialConfig, folder: Path | None, duration_s: float, stop: threading.Event, as_json: bool
) -> None:
    from seatrial.acquisition.logger.record import preflight_table
    from seatrial.acquisition.logger.survey import check_before_departure

    process.print_line(f"listening for {duration_s:g} s", err=True)
    readiness = check_before_departure(trial, duration_s, folder, stop)
    if as_json:
        process.print_line(json.dumps(readiness.as_json()))
    else:
        errors.Terminal().print(preflight_table(readiness))
    if readiness.obstacles:
        process.print_line(f"not ready: {'; '.join(readiness.obstacles)}", err=True)
        raise typer.Exit(1)
    process.print_line(f"ready: all {len(readiness.channels)} channels come", err=True)


def _print_discovery(discovery: Discovery, as_json: bool, options: Mapping[str, Any]) -> None:
    from seatrial.acquisition.discovery.discover import describe_silence, discovery_tables

    if as_json:
        process.print_line(json.dumps(discovery.as_json()))
    for table in () if as_json or discovery.survey is None else discovery_tables(discovery):
        errors.Terminal().print(table)
    if discovery.survey is None:
        raise errors.InputError(describe_silence(discovery))


@command(ABOARD, "output", show=_print_discovery)
def discover(
    inputs: Annotated[
        Sequence[str],
        Parsed(list[str]),
        typer.Argument(
            help="Inputs: can0 or can:INTERFACE:CHANNEL, /dev/ttyUSB0, udp:PORT, tcp:ADDRESS:PORT,"
            " mqtt:ADDRESS, log files, or a configuration's sources; without any, this computer's interfaces and"
            " the usual ports."
        ),
    ] = (),
    output: Annotated[
        str | Path | None, Parsed(Path), typer.Option("-o", "--output", help="The configuration to write.")
    ] = None,
    duration_s: Annotated[float, typer.Option("--duration", min=0.1, help="Listen for this many seconds.")] = 20.0,
    vessel: Annotated[
        str, typer.Option(help="The vessel whose actuators are recorded: a name, or a vessel file.")
    ] = "",
    dbc: Annotated[
        str | Path | None, Parsed(Path), typer.Option(help="The DBC file of the vessel's own CAN frames.")
    ] = None,
) -> Discovery:
    """Find out what buses and lines carry, and write a configuration that records it.

    Parameters
    ----------
    inputs
        Where to listen, ``can0``, ``/dev/ttyUSB0``, ``udp:PORT``, log files, ...; by default at this computer's
        interfaces and the usual ports.
    output
        The configuration to write.
    duration_s
        How long to listen [s].
    vessel
        The vessel whose actuators are recorded: a name, or a vessel file.
    dbc
        The DBC file of the vessel's own CAN frames.

    Returns
    -------
    Discovery
        What each input carries, and the ``configuration`` that records it; ``survey`` is None where nothing came.

    Raises
    ------
    StorageError
        For an ``output`` that exists.

    Examples
    --------
    >>> import seatrial as st
    >>> st.discover(["bridge.log"]).channels
    {'heading_deg': ['bridge/HE:HDT']}
    """
    target = None if output is None else Path(output)
    with process.stop_on_signals() as stop:
        from seatrial.acquisition.core.files import write_text
        from seatrial.acquisition.discovery.discover import discover as run
        from seatrial.acquisition.discovery.listen import parse_places, usual_places

        if target is not None and target.exists():
            raise errors.StorageError("already exists", where=str(target), fix="choose another file, or delete it")
        places = parse_places(list(inputs)) if inputs else usual_places()
        if any(place.type != "file" for place in places):
            process.announce(f"listening for {duration_s:g} s at {', '.join(place.text for place in places)}")
        folder, name = (Path(), "discovered") if target is None else (target.parent, target.stem)
        with errors.progress_bar("listening") as progress:
            discovery = run(
                places, duration_s, name, vessel, None if dbc is None else Path(dbc), folder, stop, progress
            )
    if target is not None and discovery.survey is not None:
        write_text(target, discovery.configuration)
        process.announce(f"wrote {target}; `seatrial record {target} --check` says whether it still comes")
    return discovery


@command(ABOARD)
def mark(text: Annotated[str, typer.Argument(help='The text of the mark, for example "start 20/20".')]) -> int:
    """Set an event mark in the running recording.

    Parameters
    ----------
    text
        What the event log says at this moment.

    Returns
    -------
    int
        How many recorders of this computer took it.

    Raises
    ------
    SourceError
        Where no recorder runs.

    Examples
    --------
    It needs a recorder at work:

    >>> import seatrial as st
    >>> st.mark("start 20/20")  # doctest: +SKIP
    1
    """
    from seatrial.acquisition.logger.requests import send_mark

    count = send_mark(text)
    process.announce(f"marked in {count} recording{'s' if count > 1 else ''}")
    return count


@command(ABOARD, "output")
def redecode(
    recording: Annotated[Data, Parsed(list[Path]), typer.Argument(help="A recording; its parts in order.")],
    output: Output,
    config: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="The corrected configuration; default: the recording's own."),
    ] = None,
) -> RedecodeSummary:
    """Rebuild a recording's channels from its raw input.

    Parameters
    ----------
    recording
        The file, or the files of one recording in their order.
    output
        The recording to write.
    config
        The corrected configuration; by default the recording's own.

    Returns
    -------
    RedecodeSummary
        The recorder's counts, and the sources that the configuration does not know.

    Raises
    ------
    InputError
        For a file that is no recording.

    Examples
    --------
    >>> import seatrial as st
    >>> discovery = st.discover(["bridge.log"], output="bridge.toml")
    >>> paths = st.record("bridge.toml", "recordings")
    recordings/bridge_...Z.mcap
    >>> summary = st.redecode(paths, "again.mcap", config="bridge.toml")
    >>> st.read("again.mcap")["heading_deg"].tolist()
    [90.0]
    """
    from seatrial.acquisition.config.trial_file import load_config
    from seatrial.acquisition.logger.record import summary_text
    from seatrial.acquisition.logger.survey import redecode as run

    target = Path(output)
    with errors.progress_bar("decoding") as progress:
        result = run(
            recording_paths(recording), target, None if config is None else load_config(Path(config)), progress
        )
    process.announce(summary_text(result.health, [target]))
    if result.unknown:
        kept = ", ".join(f"{name} {count:,}" for name, count in result.unknown.items())
        process.announce(f"warning: kept raw, as no source of the configuration is called so: {kept}")
    process.announce(target, err=False)
    return result


@command(ABOARD)
def emulate(
    recording: Annotated[str | Path, Parsed(Path), typer.Argument(help="The recording to play.")],
    config: Annotated[
        str | Path, Parsed(Path), typer.Argument(help="The configuration with the buses and lines to play it onto.")
    ],
    speed: Annotated[float, typer.Option(min=0.01, help="Playback speed; 1 is real time.")] = 1.0,
) -> Playback:
    """Play a recording onto the buses of a configuration.

    Parameters
    ----------
    recording
        The recording to play.
    config
        The configuration with the buses and lines to play it onto.
    speed
        How many times as fast as it was recorded.

    Returns
    -------
    Playback
        What was played: values by channel, packets, how late they were at most [s], what no message carries.

    Raises
    ------
    SourceError
        Where a bus or a line cannot be opened.

    Examples
    --------
    >>> import seatrial as st
    >>> paths = st.init("ship", vessel="gunnerus_short")
    >>> played = st.emulate("trial.mcap", "ship/trial.toml", speed=1000.0)
    >>> played.counts["heading_deg"]
    300
    """
    from seatrial.acquisition.config.trial_file import load_config
    from seatrial.acquisition.emulator import emulate as run

    with errors.progress_bar("playing") as progress:
        played = run(Path(recording), load_config(Path(config)), speed, progress)
    values = f"{sum(played.counts.values()):,} values of {len(played.counts)} channels"
    time = f"{played.duration_s:.1f} s, at most {1000 * played.latest_s:.0f} ms late"
    process.announce(f"played {values} in {played.packets:,} packets, {time}")
    if played.unsent:
        unsent = ", ".join(f"{name} {count:,}" for name, count in played.unsent.items())
        process.announce(f"warning: no message could carry {unsent}; position, for one, needs north and east")
    return played


@command(RECORDINGS, "output", "write_map", "preview", name="import")
def import_table(
    table: Annotated[
        str | Path,
        Parsed(Path),
        typer.Argument(help="A table (.csv, .xlsx, .mat, ...) or a log (.bag, .ulg, .mf4, ...)."),
    ],
    output: Output,
    columns: Annotated[
        str | Path | None, Parsed(Path), typer.Option(help="A column map: names and units of the table's columns.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Accept the proposal without asking.")] = False,
    answer: Annotated[
        Sequence[str],
        Parsed(list[str]),
        typer.Option(help="Answer a question in advance: KEY=VALUE; may be repeated."),
    ] = (),
    preview: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="Draw every channel as it would be recorded: a PNG file."),
    ] = None,
    write_map: Annotated[
        str | Path | None,
        Parsed(Path),
        typer.Option(help="The file for the proposed column map; default: beside the recording."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing recording.")] = False,
    allow_missing: Annotated[
        bool, typer.Option(help="Accept a table without some of the ship's channels.")
    ] = False,
    ignore_unknown: Annotated[bool, typer.Option(help="Ignore columns that are not channels.")] = False,
    vessel: Annotated[
        str | Path | None, Parsed(str), typer.Option(help="The table's vessel: a name, or a vessel file.")
    ] = None,
) -> ImportSummary:
    """Convert a table or log to a recording, by standard names, a column map, or automatic recognition.

    Parameters
    ----------
    table
        The file: .csv, .tsv, .xlsx, .parquet, .mat, .nc, .gpx, ...; or a log of several topics: a bag of ROS,
        .mcap, .ulg, .bin, .mf4, .tdms, .h5, .npz, .jsonl, .sqlite, a folder of .parquet.
    output
        The recording to write.
    columns
        A column map; without one the columns' names and units are recognised.
    yes
        Accept what is recognised without a question; needed in a script, unless the names are standard.
    answer
        Answers to the questions that recognition asks, ``KEY=VALUE``.
    preview
        A PNG file with every channel as it is recorded.
    write_map
        Where the map of what was recognised goes; by default beside the recording.
    force
        Replace a recording that exists.
    allow_missing
        Accept a table without some of the ship's channels.
    ignore_unknown
        Ignore columns that are not channels.
    vessel
        The table's vessel: a name, or a vessel file.

    Returns
    -------
    ImportSummary
        What was found in the table: rows, channels, and what was left out.

    Raises
    ------
    InputError
        For a table that cannot be read, and where nothing was accepted.
    StorageError
        For an ``output`` that exists, without ``force``.

    See Also
    --------
    export
        The way back, to a table.
    write
        Write a table that is in memory.

    Examples
    --------
    >>> import seatrial as st
    >>> paths = st.export("trial.mcap", "trial.csv", rate_hz=1.0)
    >>> summary = st.import_table("trial.csv", "imported.mcap")
    >>> summary.rows, len(summary.channels)
    (300, 13)
    """
    from seatrial.acquisition.core.stores import lasting_copies, place_name
    from seatrial.acquisition.tables.import_table import import_proposed, is_standard_table
    from seatrial.acquisition.tables.import_table import import_table as run
    from seatrial.acquisition.tables.topics import read_table_or_log

    (source,), target = lasting_copies([Path(table)]), Path(output)
    answers = dict[str, str]()
    for pair in answer:
        key, sign, value = pair.partition("=")
        if not sign:
            raise errors.UsageError(f"{pair!r} is not KEY=VALUE", where="--answer")
        answers[key.strip()] = value.strip()
    raw = None if columns else read_table_or_log(source, answers=answers)
    if raw is None or is_standard_table(raw):
        with errors.progress_bar("importing") as progress:
            summary = run(source, target, columns, allow_missing, ignore_unknown, vessel, force, answers, progress)
    else:
        written = Path(write_map) if write_map else target.with_suffix(".columns.toml")
        raw, proposal = _confirm_proposal(raw, answers, vessel, yes, None if preview is None else Path(preview))
        with errors.progress_bar("importing") as progress:
            summary = import_proposed(raw, proposal, target, written, vessel, force, progress)
        process.announce(f"map for next time: --columns {place_name(written)}")
    process.announce(summary)
    process.announce(place_name(target), err=False)
    return summary


def _confirm_proposal(
    raw: RawTable, answers: dict[str, str], vessel: str | Path | None, yes: bool, preview: Path | None
) -> tuple[RawTable, Proposal]:
    """Show what is proposed; at a terminal ask what the table does not tell, and whether it is right.

    Returns the table, too: the times of a log are read again by the answers that concern them.
    """
    from seatrial.acquisition.tables.import_table import draw_preview, propose_column_map
    from seatrial.acquisition.tables.topics import TIME_ANSWERS, read_table_or_log

    proposal = propose_column_map(raw, answers, vessel)
    at_terminal = sys.stdin.isatty() and sys.stderr.isatty() and not yes
    while at_terminal and proposal.questions:
        question = proposal.questions[0]
        text = errors.escape_control_characters(f"{question.text} {'/'.join(question.options)}")
        answers[question.key] = typer.prompt(text, default=question.default, err=True)
        if question in raw.questions and question.key in TIME_ANSWERS:
            raw = read_table_or_log(raw.path, answers=answers)
        proposal = propose_column_map(raw, answers, vessel)
    if process.is_announcing():
        errors.Terminal(stderr=True).print(proposal)
    for warning in proposal.warnings:
        process.announce(f"warning: {warning}")
    if preview is not None:
        draw_preview(raw, proposal, preview)
        process.announce(f"preview: {preview}")
    if at_terminal and not typer.confirm("import it so?", default=True, err=True):
        raise typer.Exit(1)
    if not at_terminal and not yes and not proposal.unanswered:
        raise errors.InputError(
            "nothing was written", fix="use --yes to accept the proposal, --answer to correct it"
        )
    return raw, proposal


_MOST_MARKS = 20


class Contents(dict[str, Any]):
    """What is in a recording: the entries of ``seatrial info --json``, and the ``recording`` as it was read.

    ``places`` are the files as they were given.
    """

    recording: RecordingFile
    places: list[str]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return dict(self)


def _print_contents(contents: Contents | TopicLog, as_json: bool, options: Mapping[str, Any]) -> None:
    if not isinstance(contents, Contents):
        _print_log(contents, as_json)
        return
    from seatrial.acquisition.core.trial import iso_utc
    from seatrial.acquisition.recording.reader import event_counts_text, events_of_recording

    if as_json:
        process.print_line(json.dumps(contents))
        return
    recording, events = contents.recording, events_of_recording(contents.recording)

    # A path is not broken at 80 columns.
    tell = partial(errors.Terminal().print, highlight=False, soft_wrap=True)
    unclosed = "NOT CLOSED: the recorder was killed or is still writing; `seatrial recover` makes a closed copy"
    tell(
        f"{', '.join(contents.places)}  {'closed properly' if contents['closed'] else unclosed}",
        style="bold",
    )
    if contents["messages"]:
        tell(f"{contents['start']} to {contents['end']}")
    tell(f"{contents['duration_s']:.1f} s, {contents['messages']:,} messages")
    for key, value in contents["trial"].items():
        if key != "channels":  # they are in the table
            tell(f"{key.replace('_', ' ')}: {value}", style="dim")
    part = recording.metadata.get("part", {})
    if recording.later_parts and recording.clock:
        tell(recording.clock)
    elif part.get("follows"):
        tell(f"part {part['number']}, follows {part['follows']}: {part['reason']}")
    errors.Terminal().print(_channel_table_of_contents(contents["channels"], contents["trial"]))
    for line in _missing_lines(contents):
        tell(line)
    for topic, count in contents["raw"].items():
        tell(f"{topic}: {count:,} raw messages")
    if recording.predictions:
        tell(f"/prediction: {recording.predictions:,} predictions made beside the recorder")
    if events:
        tell(f"events: {event_counts_text(events)}")
    named = [event for event in events if event.kind in ("mark", "alarm")]
    for event in named[:_MOST_MARKS]:
        tell(f"  {iso_utc(event.time_ns)}  {event.kind}: {event.text}")
    if len(named) > _MOST_MARKS:
        tell(f"  {len(named) - _MOST_MARKS:,} more marks and alarms: `seatrial export FILE --events -o EVENTS.csv`")


def _missing_lines(contents: Contents) -> list[str]:
    """What is missing in a recording and why; of one that was read by its index, what that leaves open."""
    from seatrial.acquisition.logger.survey import missing_reasons_by_raw_input, reason_by_channels

    index = contents.get("index")
    if index is None:
        missing = missing_reasons_by_raw_input(contents.recording.path, contents.recording.series)
        return [f"missing: {names}: {reason}" for names, reason in reason_by_channels(missing).items()]
    unread = f", nor {index['unread_events']:,} of its events" if index["unread_events"] else ""
    return [
        f"read by its index, {index['read_bytes'] / 1e6:.1f} of {index['size_bytes'] / 1e6:,.1f} MB: gaps, further "
        f"sources, and what is marked - are not known{unread}; `seatrial check` reads all of it"
    ]


def _print_log(log: TopicLog, as_json: bool) -> None:
    """Print the topics of another program's log, its span, and remarks."""
    contents = log.as_dict()
    if as_json:
        process.print_line(json.dumps(contents))
        return
    tell = partial(errors.Terminal().print, highlight=False, soft_wrap=True)
    tell(f"{log.path}  {log.format.name}, not a recording: `seatrial import` makes one of it", style="bold")
    tell(f"{contents['start']} to {contents['end']}")
    tell(f"{contents['duration_s']:.1f} s, {contents['messages']:,} messages")
    errors.Terminal().print(log)
    for remark in contents["remarks"]:
        tell(remark, style="dim")


@command(RECORDINGS, show=_print_contents)
def info(recording: Recording) -> Contents | TopicLog:
    """Show what is in a recording, or in another program's log.

    Parameters
    ----------
    recording
        The file, or the files of one recording in parts; or a log that ``import`` takes.

    Returns
    -------
    Contents or TopicLog
        A dict: ``channels`` with counts, rates [Hz], spans and sources, ``events``, ``raw`` messages by topic, the
        ``trial``, ``start``, ``end``, ``duration_s``, and whether the recording was ``closed``. Of another
        program's log its topics, with types, counts, times and the units of their fields.

    Raises
    ------
    InputError
        For a file that is missing or neither, and for files that are not of one recording.

    Examples
    --------
    >>> import seatrial as st
    >>> contents = st.info("trial.mcap")
    >>> contents["closed"], contents["channels"]["heading_deg"]["count"]
    (True, 300)
    """
    from seatrial.acquisition.core.stores import RemoteFile, is_remote, place_name
    from seatrial.acquisition.recording.reader import describe_recording, events_of_recording, read_as_one_recording

    places = [] if is_table(recording) else _given_paths(recording)
    if len(places) == 1 and is_remote(places[0]) and places[0].suffix.lower() == ".mcap":
        from seatrial.acquisition.recording.index import read_by_index

        if (indexed := read_by_index(RemoteFile(places[0]))) is not None:
            events = [event.as_json() for event in events_of_recording(indexed.recording)]
            contents = Contents(indexed.as_dict(), events=events)
            contents.recording, contents.places = indexed.recording, [place_name(places[0])]
            return contents
    paths = recording_paths(recording)
    file = paths[0] if len(paths) == 1 and paths[0].exists() else None
    if file is not None and file.suffix.lower() != ".mcap" and (log := _log_in(file)) is not None:
        return log
    read = read_as_one_recording(paths)
    if file is not None and read.is_foreign and (log := _log_in(file)) is not None:
        return log
    contents = Contents(describe_recording(read), events=[event.as_json() for event in events_of_recording(read)])
    contents.recording, contents.places = read, [place_name(path) for path in places] or [str(read.path)]
    return contents


def _log_in(file: Path) -> TopicLog | None:
    """The topics of another program's log; reading a recording takes none of what is imported for it."""
    from seatrial.acquisition.tables.topics import log_format, read_log

    kind = log_format(file)
    return None if kind is None else read_log(file, kind)


def _print_recovery(recovered: RecoverySummary, as_json: bool, options: Mapping[str, Any]) -> None:
    if as_json:
        process.print_line(json.dumps(recovered.as_json()))
        return
    process.print_line(str(recovered), err=True)
    process.print_line(options["output"])


@command(ABOARD, "output", show=_print_recovery)
def recover(
    file: Annotated[
        str | Path,
        Parsed(Path),
        typer.Argument(help="A recording that is damaged or was not closed; it is not changed."),
    ],
    output: Output,
) -> RecoverySummary:
    """Save what is intact in a damaged recording to a new one.

    Parameters
    ----------
    file
        A recording that is damaged or was not closed; it is not changed.
    output
        The recording to write.

    Returns
    -------
    RecoverySummary
        Messages that were saved and lost, by topic.

    Raises
    ------
    InputError
        For a file in which nothing of a recording is left.
    StorageError
        Where the new recording cannot be written.

    Examples
    --------
    >>> import pathlib, seatrial as st
    >>> whole = pathlib.Path("trial.mcap").read_bytes()
    >>> size = pathlib.Path("cut.mcap").write_bytes(whole[: len(whole) // 2])
    >>> summary = st.recover("cut.mcap", "recovered.mcap")
    >>> 0 < len(st.read("recovered.mcap")) < 300
    True
    """
    from seatrial.acquisition.recording.recover import recover as run

    with errors.progress_bar("recovering") as progress:
        return run(Path(file), Path(output), progress)


def _print_migration(migrated: Migration, as_json: bool, options: Mapping[str, Any]) -> None:
    if as_json:
        process.print_line(json.dumps({"converted": migrated.converted, "kept": migrated.unconverted}))
        return
    process.print_line(
        f"{migrated.converted.total():,} of {migrated.summary.saved_messages:,} messages converted", err=True
    )
    if migrated.unconverted:
        kept = ", ".join(f"{topic} {count:,}" for topic, count in migrated.unconverted.items())
        process.print_line(f"warning: kept as they were, as they fit no schema of today: {kept}", err=True)
    process.print_line(options["output"])


@command(ABOARD, "output", show=_print_migration)
def migrate(
    file: Annotated[
        str | Path, Parsed(Path), typer.Argument(help="A recording with JSON messages; it is not changed.")
    ],
    output: Output,
) -> Migration:
    """Convert an old recording with JSON messages for viewers that cannot plot JSON.

    Parameters
    ----------
    file
        A recording with JSON messages; it is not changed.
    output
        The recording to write.

    Returns
    -------
    Migration
        How many messages of each topic were converted, and which were kept as they were.

    Raises
    ------
    InputError
        For a file that is no recording.

    Examples
    --------
    >>> import seatrial as st
    >>> migration = st.migrate("old.mcap", "new.mcap")
    >>> migration.converted.total() > 0, migration.unconverted.total()
    (True, 0)
    """
    from seatrial.acquisition.recording.recover import migrate as run

    with errors.progress_bar("migrating") as progress:
        return run(Path(file), Path(output), progress)


def write(
    table: pd.DataFrame, path: str | Path, vessel: str = "", declared: Sequence[Channel] = (), **trial: Any
) -> Path:
    """Write a table of channels as a recording.

    Parameters
    ----------
    table
        A UTC index and the columns of the conventions; a ship's actuators are as their columns are named, unless
        ``trial`` lists them.
    path
        The recording to write.
    vessel
        The name of the vessel.
    declared
        Further columns (:func:`seatrial.declare`), unless the table was read from a recording that declares them.
    trial
        Fields of :class:`seatrial.acquisition.core.trial.Trial`.

    Returns
    -------
    pathlib.Path
        The recording.

    Raises
    ------
    InputError
        For a column that is no channel.
    StorageError
        Where it cannot be written.

    Examples
    --------
    >>> import pandas as pd, seatrial as st, tempfile, pathlib
    >>> index = pd.date_range("2026-05-17", periods=3, freq="1s", tz="UTC", name="time", unit="ns")
    >>> table = pd.DataFrame({"heading_deg": [10.0, 11.0, 12.0]}, index=index)
    >>> path = st.write(table, pathlib.Path(tempfile.mkdtemp()) / "trial.mcap", vessel="gunnerus_long")
    >>> st.read(path)["heading_deg"].tolist()
    [10.0, 11.0, 12.0]
    """
    from seatrial.acquisition.config.declarations import actuators_of_ship
    from seatrial.acquisition.core.ship import actuators_as_text, declared_channels_as_json, declared_channels_of
    from seatrial.acquisition.core.trial import Trial
    from seatrial.acquisition.recording.writer import write_table
    from seatrial.acquisition.tables.import_table import actuators_in_columns

    target = Path(path)
    channels = {channel.name: channel for channel in (*declared_channels_of(table.attrs), *declared)}
    fields = {
        "name": errors.printable_path(target.stem),
        "vessel": vessel,
        "channels": declared_channels_as_json(channels.values()),
    } | trial
    stated = Trial(channels=fields["channels"], vessel=vessel)
    actuators = actuators_of_ship(vessel, target.parent) or actuators_in_columns(map(str, table), stated)
    write_table(table, target, Trial(**{"actuators": actuators_as_text(actuators), **fields}), source="table")
    return target


def _channel_table_of_contents(channels: dict[str, Any], trial: dict[str, str]) -> Table:
    from rich.table import Table

    from seatrial.acquisition.core.ship import channel_unit, channels_by_name_of, possible_channels_of_table

    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for title, justify in (("channel", "left"), ("unit", "left"), ("count", "right"), ("rate Hz", "right"),
                           ("gap s", "right"), ("sources", "left")):  # fmt: skip
        table.add_column(title, justify=justify, no_wrap=title != "sources", overflow="fold")  # type: ignore[arg-type]
    channels_by_name = channels_by_name_of({"trial": trial})
    order = {name: number for number, name in enumerate(possible_channels_of_table(channels, {"trial": trial}))}
    for name, summary in sorted(channels.items(), key=lambda item: order.get(item[0], len(order))):
        table.add_row(
            name, channel_unit(name, channels_by_name), f"{summary['count']:,}", _two_decimals(summary["rate_hz"]),
            _two_decimals(summary["longest_gap_s"]), ", ".join(summary["sources"]),
        )  # fmt: skip
    return table


def _two_decimals(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
