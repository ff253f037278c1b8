"""The commands aboard: discover, record, emulate, import, info, recover. They parse, call and print."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.acquisition.core.errors import printable
from seatrial.acquisition.core.process import echo, stop_on_signals

if TYPE_CHECKING:
    import threading

    from rich.table import Table

    from seatrial.acquisition.config.trial_file import TrialConfig
    from seatrial.acquisition.logger.health import Health
    from seatrial.acquisition.tables.propose import Proposal
    from seatrial.acquisition.tables.table_files import RawTable

Output = Annotated[Path, typer.Option("-o", "--output", help="The file or folder to write.")]
Command = Callable[..., None]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object to stdout.")]

ABOARD, RECORDINGS, TRIALS, PREDICTIONS, DIAGNOSIS = (
    "Aboard", "Recordings", "Trials", "Predictions", "What the model lacks"
)  # fmt: skip
"""The groups of commands in ``seatrial --help``."""


def writes(*files: str, folder: str = "") -> Callable[[Command], Command]:
    """Lock what a command writes while it runs, and protect what it reads.

    ``files`` and ``folder`` are the options or arguments that name outputs; every other one that names a file is an
    input, which no output may replace.
    """

    def decorate(command: Command) -> Command:
        @wraps(command)
        def run(**values: Any) -> None:
            from seatrial.acquisition.core.files import inputs_protected, locked_file, locked_folder, refuse_input

            named = [value for name, value in values.items() if name not in (*files, folder)]
            inputs = [part for value in named for part in (value if isinstance(value, list) else [value])]
            with ExitStack() as stack:
                stack.enter_context(inputs_protected(Path(part) for part in inputs if isinstance(part, str | Path)))
                for path in [Path(values[name]) for name in files if values[name] is not None]:
                    refuse_input(path)
                    stack.enter_context(locked_file(path))
                if values.get(folder) is not None:
                    stack.enter_context(locked_folder(Path(values[folder])))
                command(**values)

        return run

    return decorate


def mount(app: typer.Typer) -> None:
    """Add this package's commands to the command line; their help is what they say of themselves."""
    for command in (discover, record, emulate, mark, redecode, recover, migrate):
        app.command(rich_help_panel=ABOARD)(command)
    app.command("import", rich_help_panel=RECORDINGS)(import_)
    app.command(rich_help_panel=RECORDINGS)(info)


def record(
    config: Annotated[Path, typer.Argument(help="The trial's configuration, a TOML file.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The folder for the recording.")] = None,
    duration: Annotated[float | None, typer.Option(min=0.0, help="Stop after this many seconds.")] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Record nothing: listen, and list the channels that would be missing.")
    ] = False,
    log: Annotated[str, typer.Option(help="Log format without a terminal: text, or json lines.")] = "text",
    live: Annotated[bool, typer.Option("--live", help="Serve the live view for Foxglove and Lichtblick.")] = False,
    as_json: AsJson = False,
) -> None:
    """Record a trial; SIGINT and SIGTERM end it cleanly."""
    if log not in ("text", "json"):
        raise typer.BadParameter("is neither text nor json", param_hint="--log")
    if output is None and not check:
        raise typer.BadParameter("is missing: the folder that the recording goes into", param_hint="-o")
    with stop_on_signals() as stop:  # before the heavy imports: they take a while, and Ctrl-C may come
        from seatrial.acquisition.config.trial_file import load_config
        from seatrial.acquisition.logger.record import record as run

        trial = load_config(config)
        if check or output is None:
            _check_departure(trial, output, 10.0 if duration is None else duration, stop, as_json)
            return
        paths, health = run(trial, output, duration, stop, log_format=log, live=live)  # type: ignore[arg-type]
    if log == "text":
        _sum_up(trial, health, paths)
    try:
        echo(json.dumps(_as_json(health, paths)) if as_json else "\n".join(map(str, paths)))
    except OSError as error:  # the recording is there all the same
        echo(f"warning: {error}", err=True)


def _as_json(health: Health, paths: list[Path]) -> dict[str, Any]:
    sources = health.sources.values()
    return {
        "parts": [str(path) for path in paths],
        "frames": sum(source.frames for source in sources),
        "samples": health.samples,
        "dropped": sum(source.dropped for source in sources),
        "channels": [name for name, channel in health.channels.items() if channel.count],
    }


def _sum_up(trial: TrialConfig, health: Health, paths: list[Path]) -> None:
    from seatrial.acquisition.logger.display import summary

    echo(summary(health, paths), err=True)
    for _, level, text in health.events:  # the table that showed them is gone
        if level == "error" and sys.stderr.isatty():
            echo(f"error: {text}", err=True)
    expected = [name for name in health.names if name in trial.expected_channels]
    if silent := [name for name in expected if not health.channels[name].count]:
        from seatrial.acquisition.logger.survey import by_reason, reasons_in

        for names, reason in by_reason(reasons_in(trial, paths, silent)).items():
            echo(f"warning: nothing came of {names}{': ' if reason else ''}{reason}", err=True)


def _check_departure(
    trial: TrialConfig, folder: Path | None, duration_s: float, stop: threading.Event, as_json: bool
) -> None:
    from seatrial.acquisition.core.errors import Terminal
    from seatrial.acquisition.logger.display import preflight_table
    from seatrial.acquisition.logger.survey import check_before_departure

    echo(f"listening for {duration_s:g} s", err=True)
    readiness = check_before_departure(trial, duration_s, folder, stop)
    if as_json:
        echo(json.dumps(readiness.as_json()))
    else:
        Terminal().print(preflight_table(readiness))
    if readiness.obstacles:
        echo(f"not ready: {'; '.join(readiness.obstacles)}", err=True)
        raise typer.Exit(1)
    echo(f"ready: all {len(readiness.channels)} channels come", err=True)


@writes("output")
def discover(
    inputs: Annotated[
        list[str] | None,
        typer.Argument(
            help="Inputs: can0 or can:INTERFACE:CHANNEL, /dev/ttyUSB0, udp:PORT, tcp:ADDRESS:PORT,"
            " mqtt:ADDRESS, log files, or a configuration's sources; without any, this computer's interfaces and"
            " the usual ports."
        ),
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The configuration to write.")] = None,
    duration: Annotated[float, typer.Option(min=0.1, help="Listen for this many seconds.")] = 20.0,
    vessel: Annotated[
        str, typer.Option(help="The vessel whose actuators are recorded: a name, or a vessel file.")
    ] = "",
    dbc: Annotated[Path | None, typer.Option(help="The DBC file of the vessel's own CAN frames.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find out what buses and lines carry, and write a configuration that records it."""
    with stop_on_signals() as stop:
        from seatrial.acquisition.core.errors import InputError, StorageError, bar
        from seatrial.acquisition.core.files import write_text
        from seatrial.acquisition.discovery.discover import describe_silence, discovery_tables
        from seatrial.acquisition.discovery.discover import discover as run
        from seatrial.acquisition.discovery.listen import parse_places, usual_places

        if output is not None and output.exists():
            raise StorageError("already exists", where=str(output), fix="choose another file, or delete it")
        places = parse_places(inputs) if inputs else usual_places()
        if any(place.type != "file" for place in places):
            echo(f"listening for {duration:g} s at {', '.join(place.text for place in places)}", err=True)
        folder, name = (Path(), "discovered") if output is None else (output.parent, output.stem)
        with bar("listening") as progress:
            discovery = run(places, duration, name, vessel, dbc, folder, stop, progress)
    if as_json:
        echo(json.dumps(discovery.as_json()))
    elif discovery.survey is not None:
        from seatrial.acquisition.core.errors import Terminal

        console = Terminal()
        for table in discovery_tables(discovery):
            console.print(table)
    if discovery.survey is None:
        raise InputError(describe_silence(discovery))
    if output is not None:
        write_text(output, discovery.configuration)
        echo(f"wrote {output}; `seatrial record {output} --check` says whether it still comes", err=True)


def mark(
    text: Annotated[str, typer.Argument(help='The text of the mark, for example "start 20/20".')],
) -> None:
    """Set an event mark in the running recording."""
    from seatrial.acquisition.logger.requests import send_mark

    count = send_mark(text)
    echo(f"marked in {count} recording{'s' if count > 1 else ''}", err=True)


@writes("output")
def redecode(
    recording: Annotated[list[Path], typer.Argument(help="A recording; its parts in order.")],
    output: Output,
    config: Annotated[
        Path | None, typer.Option(help="The corrected configuration; default: the recording's own.")
    ] = None,
) -> None:
    """Rebuild a recording's channels from its raw input."""
    from seatrial.acquisition.config.trial_file import load_config
    from seatrial.acquisition.core.errors import bar
    from seatrial.acquisition.logger.display import summary
    from seatrial.acquisition.logger.survey import redecode as run

    with bar("decoding") as progress:
        result = run(recording, output, None if config is None else load_config(config), progress)
    echo(summary(result.health, [output]), err=True)
    if result.unknown:
        kept = ", ".join(f"{name} {count:,}" for name, count in result.unknown.items())
        echo(f"warning: kept raw, as no source of the configuration is called so: {kept}", err=True)
    echo(output)


def emulate(
    recording: Annotated[Path, typer.Argument(help="The recording to play.")],
    config: Annotated[Path, typer.Argument(help="The configuration with the buses and lines to play it onto.")],
    speed: Annotated[float, typer.Option(min=0.01, help="Playback speed; 1 is real time.")] = 1.0,
) -> None:
    """Play a recording onto the buses of a configuration."""
    from seatrial.acquisition.config.trial_file import load_config
    from seatrial.acquisition.core.errors import bar
    from seatrial.acquisition.emulator import emulate as run

    with bar("playing") as progress:
        played = run(recording, load_config(config), speed, progress)
    values = f"{sum(played.counts.values()):,} values of {len(played.counts)} channels"
    time = f"{played.duration_s:.1f} s, at most {1000 * played.latest_s:.0f} ms late"
    echo(f"played {values} in {played.packets:,} packets, {time}", err=True)
    if played.unsent:
        unsent = ", ".join(f"{name} {count:,}" for name, count in played.unsent.items())
        echo(f"warning: no message could carry {unsent}; position, for one, needs north and east", err=True)


@writes("output", "write_map", "preview")
def import_(
    table: Annotated[Path, typer.Argument(help="A table: .csv, .tsv, .xlsx, .parquet, .mat, .nc or .gpx.")],
    output: Output,
    columns: Annotated[
        Path | None, typer.Option(help="A column map: names and units of the table's columns.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Accept the proposal without asking.")] = False,
    answer: Annotated[
        list[str] | None, typer.Option(help="Answer a question in advance: KEY=VALUE; may be repeated.")
    ] = None,
    preview: Annotated[
        Path | None, typer.Option(help="Draw every channel as it would be recorded: a PNG file.")
    ] = None,
    write_map: Annotated[
        Path | None, typer.Option(help="The file for the proposed column map; default: beside the recording.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing recording.")] = False,
    allow_missing: Annotated[
        bool, typer.Option(help="Accept a table without some of the ship's channels.")
    ] = False,
    ignore_unknown: Annotated[bool, typer.Option(help="Ignore columns that are not channels.")] = False,
    vessel: Annotated[str | None, typer.Option(help="The table's vessel: a name, or a vessel file.")] = None,
) -> None:
    """Convert a table to a recording, by standard names, a column map, or automatic recognition."""
    from seatrial.acquisition.tables.import_table import import_proposed, import_table, is_standard
    from seatrial.acquisition.tables.table_files import read_raw

    raw, answers = None if columns else read_raw(table), _pairs(answer or [])
    if raw is None or is_standard(raw):
        summary = import_table(table, output, columns, allow_missing, ignore_unknown, vessel, force, answers)
    else:
        written = write_map or output.with_suffix(".columns.toml")
        proposal = _agree(raw, answers, vessel, yes, preview)
        summary = import_proposed(raw, proposal, output, written, vessel, force)
        echo(f"map for next time: --columns {written}", err=True)
    echo(summary, err=True)
    echo(output)


def _pairs(answers: list[str]) -> dict[str, str]:
    for answer in answers:
        if "=" not in answer:
            raise typer.BadParameter(f"{answer!r} is not KEY=VALUE", param_hint="--answer")
    return {key.strip(): value.strip() for key, _, value in (answer.partition("=") for answer in answers)}


def _agree(raw: RawTable, answers: dict[str, str], vessel: str | None, yes: bool, preview: Path | None) -> Proposal:
    """Show what is proposed; at a terminal ask what the table does not tell, and whether it is right."""
    from seatrial.acquisition.tables.import_table import propose_for
    from seatrial.acquisition.tables.propose import draw_preview, proposal_table

    proposal = propose_for(raw, answers, vessel)
    at_terminal = sys.stdin.isatty() and sys.stderr.isatty() and not yes
    while at_terminal and proposal.questions:
        question = proposal.questions[0]
        text = printable(f"{question.text} {'/'.join(question.options)}")
        answers[question.key] = typer.prompt(text, default=question.default, err=True)
        proposal = propose_for(raw, answers, vessel)
    from seatrial.acquisition.core.errors import Terminal

    Terminal(stderr=True).print(proposal_table(proposal))
    for warning in proposal.warnings:
        echo(f"warning: {warning}", err=True)
    if preview is not None:
        draw_preview(raw, proposal, preview)
        echo(f"preview: {preview}", err=True)
    if at_terminal and not typer.confirm("import it so?", default=True, err=True):
        raise typer.Exit(1)
    if not at_terminal and not yes and not proposal.unanswered:
        echo("nothing was written: use --yes to accept the proposal, --answer to correct it", err=True)
        raise typer.Exit(1)
    return proposal


_MOST_MARKS = 20


def info(
    files: Annotated[list[Path], typer.Argument(help="A recording, or the parts of one.")],
    as_json: AsJson = False,
) -> None:
    """Show what is in a recording."""
    from seatrial.acquisition.core.trial import iso
    from seatrial.acquisition.recording.grouping import counts_text, events_of, read_together
    from seatrial.acquisition.recording.reader import describe

    recording = read_together(files)
    description = describe(recording)
    events = events_of(recording)
    if as_json:
        echo(json.dumps({**description, "events": [event.as_json() for event in events]}))
        return
    from seatrial.acquisition.core.errors import Terminal
    from seatrial.acquisition.logger.survey import by_reason, missing_in

    # A path is not broken at 80 columns.
    tell = partial(Terminal().print, highlight=False, soft_wrap=True)
    unclosed = "NOT CLOSED: the recorder was killed or is still writing; `seatrial recover` makes a closed copy"
    tell(
        f"{', '.join(map(str, recording.paths))}  {'closed properly' if description['closed'] else unclosed}",
        style="bold",
    )
    if description["messages"]:
        tell(f"{description['start']} to {description['end']}")
    tell(f"{description['duration_s']:.1f} s, {description['messages']:,} messages")
    for key, value in description["trial"].items():
        if key != "channels":  # they are in the table
            tell(f"{key.replace('_', ' ')}: {value}", style="dim")
    part = recording.metadata.get("part", {})
    if recording.later_parts and recording.clock:
        tell(recording.clock)
    elif part.get("follows"):
        tell(f"part {part['number']}, follows {part['follows']}: {part['reason']}")
    Terminal().print(_channel_table(description["channels"], description["trial"]))
    for names, reason in by_reason(missing_in(recording.path, recording.series)).items():
        tell(f"missing: {names}: {reason}")
    for topic, count in description["raw"].items():
        tell(f"{topic}: {count:,} raw messages")
    if recording.predictions:
        tell(f"/prediction: {recording.predictions:,} predictions made beside the recorder")
    if events:
        tell(f"events: {counts_text(events)}")
    named = [event for event in events if event.kind in ("mark", "alarm")]
    for event in named[:_MOST_MARKS]:
        tell(f"  {iso(event.time_ns)}  {event.kind}: {event.text}")
    if len(named) > _MOST_MARKS:
        tell(f"  {len(named) - _MOST_MARKS:,} more marks and alarms: `seatrial export FILE --events -o EVENTS.csv`")


@writes("output")
def recover(
    file: Annotated[Path, typer.Argument(help="A recording that is damaged or was not closed; it is not changed.")],
    output: Output,
    as_json: AsJson = False,
) -> None:
    """Save what is intact in a damaged recording to a new one."""
    from seatrial.acquisition.core.errors import bar
    from seatrial.acquisition.recording.recover import recover as run

    with bar("recovering") as progress:
        recovered = run(file, output, progress)
    if as_json:
        echo(json.dumps(recovered.as_json()))
        return
    echo(str(recovered), err=True)
    echo(output)


@writes("output")
def migrate(
    file: Annotated[Path, typer.Argument(help="A recording with JSON messages; it is not changed.")],
    output: Output,
    as_json: AsJson = False,
) -> None:
    """Convert an old recording with JSON messages for viewers that cannot plot JSON."""
    from seatrial.acquisition.core.errors import bar
    from seatrial.acquisition.recording.recover import migrate as run

    with bar("migrating") as progress:
        migrated = run(file, output, progress)
    if as_json:
        echo(json.dumps({"converted": migrated.converted, "kept": migrated.kept}))
        return
    echo(f"{migrated.converted.total():,} of {migrated.found.messages:,} messages converted", err=True)
    if migrated.kept:
        kept = ", ".join(f"{topic} {count:,}" for topic, count in migrated.kept.items())
        echo(f"warning: kept as they were, as they fit no schema of today: {kept}", err=True)
    echo(output)


def _channel_table(channels: dict[str, Any], trial: dict[str, str]) -> Table:
    from rich.table import Table

    from seatrial.acquisition.core.ship import channel_unit, channels_of_table, known_channels

    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for title, justify in (("channel", "left"), ("unit", "left"), ("count", "right"), ("rate Hz", "right"),
                           ("gap s", "right"), ("sources", "left")):  # fmt: skip
        table.add_column(title, justify=justify, no_wrap=title != "sources", overflow="fold")  # type: ignore[arg-type]
    channels_by_name = known_channels({"trial": trial})
    order = {name: number for number, name in enumerate(channels_of_table(channels, {"trial": trial}))}
    for name, summary in sorted(channels.items(), key=lambda item: order.get(item[0], len(order))):
        table.add_row(
            name, channel_unit(name, channels_by_name), f"{summary['count']:,}", f"{summary['rate_hz']:.2f}",
            f"{summary['longest_gap_s']:.2f}", ", ".join(summary["sources"]),
        )  # fmt: skip
    return table
