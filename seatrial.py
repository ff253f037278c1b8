"""The command line's front door: mounts the commands of the three packages, nothing else."""

from __future__ import annotations

import sys

import typer

from acquisition import cli as acquisition_cli
from acquisition.errors import SeatrialError
from analysis import cli as analysis_cli
from hybrid import cli as hybrid_cli

app = typer.Typer(
    name="seatrial",
    help="Sea-trial data logger and offline analysis: from a bus to a validated manoeuvring model.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for package_cli in (acquisition_cli, analysis_cli, hybrid_cli):
    package_cli.mount(app)


def main() -> None:
    """Run one command; an error that we raised on purpose is one line on stderr and exit code 1."""
    try:
        app()
    except SeatrialError as error:
        print(f"seatrial: {error}", file=sys.stderr)  # noqa: T201 - this is the terminal
        sys.exit(1)


if __name__ == "__main__":
    main()
