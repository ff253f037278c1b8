"""Reading and validating TOML files; every error names the line to change."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import read_regular
from seatrial.acquisition.core.process import CONFIGURATION_BYTES

Model = TypeVar("Model")
_TABLE = re.compile(r"^\s*\[(?P<array>\[)?\s*(?P<path>[^\[\]]+?)\s*\]")
_MOST_LEVELS = 16  # nested tables and lists; a configuration has at most six
_UNKNOWN_KEY = ("unexpected_keyword_argument", "extra_forbidden")
"""Reported first: a misspelt key is often the reason why another is missing."""
_ENDLESS_KEY = re.compile(r"(?:\.[^\n=,.]+){100}")
_KEY = re.compile(r"^\s*(?P<path>[\w.\-\"' ]+?)\s*=")


def read_text(path: Path | str) -> str:
    """The text of a configuration file. Raises :class:`ConfigurationError` if it cannot be read."""
    try:
        text = read_regular(path, CONFIGURATION_BYTES, ConfigurationError).decode("utf-8")
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except ConfigurationError:
        raise
    except FileNotFoundError as error:
        raise ConfigurationError("does not exist", where=str(path), fix="check the path") from error
    except (OSError, ValueError) as error:
        why = "it is no text" if isinstance(error, UnicodeDecodeError) else str(error)
        why = error.strerror or why if isinstance(error, OSError) else why
        raise ConfigurationError("cannot be read", where=str(path), why=why, fix="give a TOML file") from error


def load_toml(path: Path | str, model: type[Model]) -> Model:
    """Read ``path`` and validate it as ``model``, a pydantic dataclass or model.

    Raises :class:`ConfigurationError` whose text names file, line and key of the first complaint.
    """
    text = read_text(path)
    return validate(parse_toml(text, path), text, path, model)


def parse_toml(text: str, path: Path | str) -> dict[str, Any]:
    """The tables of a TOML text that came from ``path``. Raises :class:`ConfigurationError`."""
    invalid, where, fix = "is not valid TOML", str(path), "correct it there"
    if _ENDLESS_KEY.search(text):  # for which the library takes memory by the square
        raise ConfigurationError(invalid, where=where, why="a key has more than 100 parts", fix=fix)
    try:
        tree = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a plain ValueError
        why = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise ConfigurationError(invalid, where=where, why=why, fix=fix) from error
    level: list[Any] = [tree]
    for _ in range(_MOST_LEVELS):  # beyond which recursions would not end
        members = (value.values() if isinstance(value, dict) else value for value in level)
        level = [value for values in members for value in values if isinstance(value, dict | list)]
        if not level:
            return tree
    raise ConfigurationError(f"has tables or lists in more than {_MOST_LEVELS} levels", where=where, fix=fix)


def validate(
    raw: dict[str, Any], text: str, path: Path | str, model: type[Model], context: dict[str, Any] | None = None
) -> Model:
    """Validate parsed TOML as ``model``; ``text`` is for counting lines, ``context`` for validators."""
    try:
        return TypeAdapter(model).validate_python(raw, context=context)
    except ValidationError as error:
        details = min(error.errors(), key=lambda details: details["type"] not in _UNKNOWN_KEY)
        kind, location = details["type"], details["loc"]
        keys: list[str | int] = []
        node: Any = raw
        for part in location:
            is_present = part < len(node) if isinstance(node, list) and isinstance(part, int) else False
            is_present = is_present or (isinstance(node, dict) and part in node)
            # what a table lacks on the way is the tag of a union, which does not occur in the file
            if is_present or not isinstance(node, dict) or part == location[-1]:
                keys.append(part)
            node = node[part] if is_present else node
        if kind.startswith("union_tag"):
            keys.append("type")
        hint, value = "", details.get("input")
        if kind in _UNKNOWN_KEY:
            problem, hint = "is not a known key here", _hint(str(keys[-1]), location, model)
        elif kind in ("missing", "missing_argument"):
            problem = "is missing"
        else:
            problem = str(details["msg"]).removeprefix("Value error, ")
            problem = f"{value!r}: {problem}" if isinstance(value, str | int | float) else problem
        further = f"{error.error_count() - 1} more after this one" if error.error_count() > 1 else ""
        raise ConfigurationError(
            f"{'.'.join(map(str, keys)) or 'file'}: {problem}",
            where=f"{path}, line {line_of(text, keys)}",
            fix="; ".join(filter(None, [hint, further])),
        ) from error


def _hint(key: str, location: Sequence[str | int], model: type[Model]) -> str:
    """What a user may have meant by an unknown key: one that its table has, or the table that it belongs to."""
    schema = TypeAdapter(model).json_schema()
    definitions = schema.get("$defs", {})
    tables = [schema]
    for part in location[:-1]:  # the tag of a union leads nowhere in the schema
        tables = [table for parent in tables for table in _members(parent, part, definitions)] or tables
    options = [option for table in tables for option in _options(table, definitions)]
    possible = {name for option in options for name in option.get("properties", {})}
    if matches := get_close_matches(key, possible - {key}, n=1):
        return f"did you mean {matches[0]}?"
    is_elsewhere = any(key in table.get("properties", {}) for table in (schema, *definitions.values()))
    return "it belongs to another table, or to another type of this one" if is_elsewhere else ""


def _options(node: dict[str, Any], definitions: dict[str, Any]) -> list[dict[str, Any]]:
    """The schemas that a node of a JSON schema refers to; several for a union."""
    if "$ref" in node:
        return _options(definitions[node["$ref"].rpartition("/")[2]], definitions)
    members = node.get("anyOf") or node.get("oneOf") or ()
    return [option for member in members for option in _options(member, definitions)] or [node]


def _members(node: dict[str, Any], part: str | int, definitions: dict[str, Any]) -> list[dict[str, Any]]:
    """The nodes below one at a part of pydantic's location: a key, an index, or the tag of a union."""
    tags = node.get("discriminator", {}).get("mapping", {})
    if part in tags:
        return [{"$ref": tags[part]}]
    options = _options(node, definitions)
    if isinstance(part, int):
        return [option["items"] for option in options if isinstance(option.get("items"), dict)]
    entries = [option.get("properties", {}).get(part, option.get("additionalProperties")) for option in options]
    return [entry for entry in entries if isinstance(entry, dict)]


def line_of(text: str, keys: Sequence[str | int]) -> int:
    """The line (from 1) of the deepest part of ``keys`` that the text has; 1 if it has none.

    >>> line_of("a = 1\\n[[source]]\\nname = 'x'\\n[[source]]\\nname = 'y'", ["source", 1, "name"])
    5
    """
    lines: dict[tuple[str | int, ...], int] = {}
    counts: dict[tuple[str, ...], int] = {}  # of the elements of arrays of tables
    prefix: tuple[str | int, ...] = ()
    for number, line in enumerate(text.splitlines(), start=1):
        match = _TABLE.match(line) or _KEY.match(line)
        if match is None:
            continue
        parts = tuple(part.strip().strip("\"'") for part in match["path"].split("."))
        if match.re is _KEY:
            lines.setdefault((*prefix, *parts), number)
            continue
        if match["array"]:
            counts = {path: count for path, count in counts.items() if path[: len(parts)] != parts} | {
                parts: counts.get(parts, -1) + 1  # nested arrays count from 0 again in each element
            }
        prefix = ()
        for depth, part in enumerate(parts, start=1):
            count = counts.get(parts[:depth])
            prefix += (part,) if count is None else (part, count)
        lines.setdefault(prefix, number)
        if match["array"]:
            lines.setdefault(prefix[:-1], number)
    return next((lines[path] for depth in range(len(keys), 0, -1) if (path := tuple(keys[:depth])) in lines), 1)
