"""The front door: ``import seatrial as st`` for scripts, and the command line.

The names of a script are loaded when they are used, so that importing costs nothing. Each is the function that its
command calls; it returns a table or a result that prints and plots itself.

    import seatrial as st

    table = st.prepare("trial.mcap", rate_hz=1.0)
    print(st.check("trial.mcap"))
    calibrator = st.train("earlier.mcap")
    print(st.validate("trial.mcap", calibrator))
    prediction = st.predict("trial.mcap", at="+60", calibrator=calibrator)
    diagnosis = st.diagnose("trial.mcap")
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

__path__ = [str(Path(__file__).parent)]  # in a checkout the three packages stand beside this file

import traceback
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any

from seatrial.acquisition.core import errors, named_code, process

if TYPE_CHECKING:
    import typer

_INTERRUPTED, _TERMINATED = 130, 143  # 128 and the signal, as shells have it


@cache
def _app() -> typer.Typer:
    """All commands. It is built late, so that signals are heard while it is loaded."""
    import typer

    import seatrial.hybrid.commands  # noqa: F401 - registers all commands
    from seatrial.acquisition.commands import PREDICTIONS, TRIALS, mount_commands

    class Commands(typer.core.TyperGroup):
        """All commands; a complaint about an argument, such as the name of a file, shows it escaped."""

        def invoke(self, ctx: Any) -> Any:
            try:
                return super().invoke(ctx)
            except Exception as error:
                if isinstance(message := getattr(error, "message", None), str):  # as typer's complaints have it
                    with suppress(AttributeError):  # that of a template's error cannot be set
                        error.message = errors.escape_control_characters(message)  # type: ignore[attr-defined]
                raise

    app = typer.Typer(
        name="seatrial",
        cls=Commands,
        help="Sea-trial data logger and offline analysis: from a bus to a validated manoeuvring model.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )

    @app.callback()
    def _main(
        version: bool = typer.Option(
            False, "--version", help="Print the version.", is_eager=True, callback=_say_version
        ),
    ) -> None:
        """What stands before every command."""

    groups = {name: typer.Typer(no_args_is_help=True) for name in ("vessel", "reproduce")}
    mount_commands(app, groups)
    app.add_typer(groups["vessel"], name="vessel", help="Vessel files of your own ship.", rich_help_panel=TRIALS)
    app.add_typer(
        groups["reproduce"], name="reproduce", help="Reproduce the paper's results from scratch.",
        rich_help_panel=PREDICTIONS,
    )  # fmt: skip
    return app


@cache  # to build it takes 13 ms, and a process may run several commands
def _command(app: typer.Typer) -> typer.core.TyperGroup:
    import typer

    return typer.main.get_group(app)


def _say_version(wanted: bool) -> None:
    if wanted:
        import typer

        from seatrial.acquisition.core.trial import software_version

        process.print_line(software_version())
        raise typer.Exit


_PLACES = {
    "declare": "seatrial.acquisition.core.ship:declare",
    "load_calibrator": "seatrial.hybrid.calibrators.own:load",
    "load_case": "seatrial.hybrid.report.trial:load_case",
    "load_diagnosis": "seatrial.hybrid.diagnosis.result:read_diagnosis",
    "load_simulator": "seatrial.hybrid.effects.simulators:load_simulator",
    "load_vessel": "seatrial.hybrid.vessel.files:load_vessel",
    "read": "seatrial.analysis.tables.table:read_table",
    "reproduction_sections": "seatrial.notebooks.wang2021.page:results_sections",
    "resample": "seatrial.analysis.tables.resample:resample",
    "save_calibrator": "seatrial.hybrid.calibrators.own:save",
    "save_vessel": "seatrial.hybrid.vessel.files:save_vessel",
    "sections": "seatrial.hybrid.report.text:sections",
    "vessels": "seatrial.acquisition.config.declarations:vessel_names",
    "version": "seatrial.acquisition.core.trial:software_version",
} | {
    name: f"seatrial.{package}.commands:{name}"
    for package, names in {
        "acquisition": "discover emulate import_table info mark migrate record recover redecode write",
        "analysis": "batch check events export manoeuvres open_dataset plot prepare serve smooth windows",
        "hybrid": "campaign conduct demo diagnose effects evaluate export_vessel fidelity figures identify init "
        "new_vessel plan predict report simulate speed_power table3 train validate vessel_check vessel_map watch",
    }.items()
    for name in names.split()
}
"""The names of a script: the module that each is in, and what it is called there."""

__all__ = ["main", *sorted(_PLACES)]


def __getattr__(name: str) -> Any:
    if name == "app":
        return _app()
    if name == "__version__":
        from importlib.metadata import version

        return version("seatrial")
    if name in _PLACES:
        globals()[name] = value = named_code.import_object(_PLACES[name])
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


def main() -> None:
    """Run one command; an error is one line on stderr and exit code 1.

    With ``SEATRIAL_DEBUG=1`` its traceback is printed before that line.

    Raises
    ------
    SystemExit
        Always, with the exit code of the command.

    Examples
    --------
    >>> import sys, seatrial as st
    >>> sys.argv = ["seatrial", "info", "trial.mcap"]
    >>> st.main()
    Traceback (most recent call last):
    SystemExit: 0
    """
    process.guard_standard_streams()
    try:
        with (
            process.stop_on_signals()
            if sys.argv[1:2] in (["record"], ["watch"], ["conduct"])
            else process.interrupt_on_terminate()
        ):
            if sys.argv[1:2] == ["record"]:
                process.import_can_without_asammdf()
            _command(_app())()
    except KeyboardInterrupt as stop:
        sys.exit(_TERMINATED if isinstance(stop, process.Termination) else _INTERRUPTED)
    except Exception as error:
        if os.environ.get(errors.DEBUG_VARIABLE):
            traceback.print_exception(error)
        print(f"seatrial: {errors.unexpected_error(error)}", file=sys.stderr)  # noqa: T201 - this is the terminal
        sys.exit(1)


if __name__ == "__main__":
    main()
