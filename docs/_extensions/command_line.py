"""The directive ``seatrial-commands``: every command with its arguments and options, read from the command line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx


_KINDS = {
    "Path": "path",
    "list[Path]": "path",
    "int": "integer",
    "float": "number",
    "str": "text",
    "list[str]": "text",
}


def commands() -> Iterator[tuple[str, Any]]:
    """Every command by its full name, those of a group after the group."""
    import typer.main

    import seatrial

    def below(prefix: str, command: Any) -> Iterator[tuple[str, Any]]:
        for name, each in getattr(command, "commands", {}).items():
            yield f"{prefix} {name}", each
            yield from below(f"{prefix} {name}", each)

    return below("seatrial", typer.main.get_command(seatrial.app))


def described(name: str, command: Any) -> str:
    """One command as Markdown."""
    if getattr(command, "commands", None):
        return f"## {name}\n\n{command.help}\n\n```text\n{name} COMMAND\n```"
    arguments = [each for each in command.params if is_argument(each)]
    options = [each for each in command.params if not is_argument(each)]
    usage = " ".join([name, *map(_placeholder, arguments), *(["[OPTIONS]"] if options else [])])
    rows = [_row(f"`{_placeholder(each)}`", each) for each in arguments]
    rows += [_row(_flags(each), each) for each in options]
    table = "\n".join(["| argument, option | value | what it is |", "|---|---|---|", *rows])
    return f"## {name}\n\n{command.help}\n\n```text\n{usage}\n```\n\n{table if rows else ''}"


def is_argument(parameter: Any) -> bool:
    """Whether a parameter is given by its place, not by a name."""
    return not parameter.opts[0].startswith("-")


def _placeholder(argument: Any) -> str:
    return f"{argument.name.upper()}{'...' if argument.nargs == -1 else ''}"


def _flags(option: Any) -> str:
    return ", ".join(f"`{each}`" for each in sorted([*option.opts, *option.secondary_opts], key=len))


def _row(label: str, parameter: Any) -> str:
    text = (parameter.help or "").replace("|", "\\|")
    default = parameter.default
    if parameter.required and not is_argument(parameter):
        text += " Required."
    elif isinstance(default, str | int | float) and not isinstance(default, bool):
        text += f" Default: `{default}`."
    return f"| {label} | {_kind(parameter)} | {text} |"


def _kind(parameter: Any) -> str:
    annotation = str(parameter.type_descriptor.annotation)
    name = _KINDS.get(re.sub(r"<class '|'>|pathlib(\._local)?\.", "", annotation), "")
    if getattr(parameter, "multiple", False):
        name += ", repeatable"
    if parameter.min is not None and parameter.max is not None:
        return f"{name}, {parameter.min:g} to {parameter.max:g}"
    return f"{name}, {parameter.min:g} or more" if parameter.min is not None else name


class SeatrialCommands(SphinxDirective):
    """All commands, each a section."""

    def run(self) -> list[nodes.Node]:
        """The sections."""
        self.env.note_reread()  # the page is made of the program, which may have changed
        text = "\n\n".join(described(name, command) for name, command in commands())
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("seatrial-commands", SeatrialCommands)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
