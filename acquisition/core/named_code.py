"""Loading code by name: ours as ``module:name``, a user's as ``FILE.py:NAME``, a package's by its entry point.

User-defined calibrators, sources, checks, manoeuvres and effects are all loaded here. An error in a user's code
becomes a :class:`UserCodeError` that names the line; its traceback goes to the log.
"""

from __future__ import annotations

import hashlib
import inspect
import logging
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import format_exception, walk_tb
from types import FunctionType, ModuleType
from typing import Any

from seatrial.acquisition.core import files, process
from seatrial.acquisition.core.errors import ConfigurationError, SeatrialError

_LOG, _LOGGED = logging.getLogger("seatrial.own"), set[tuple[str, str]]()


class UserCodeError(ConfigurationError):
    """A user's code failed: ``where`` is its file and line, ``why`` what it raised."""


def import_object(module_and_name: str) -> Any:
    """The object at ``module:name``.

    >>> import_object("math:tau") > 6.28
    True
    """
    module, _, name = module_and_name.partition(":")
    return getattr(import_module(module), name)


def split_code_reference(name: str) -> tuple[Path, str] | None:
    """The file and name in ``FILE.py:NAME``, the name "" if not given; None for anything that is no file.

    >>> split_code_reference("mine.py:Mine"), split_code_reference("mine.py"), split_code_reference("adaptive")
    ((PosixPath('mine.py'), 'Mine'), (PosixPath('mine.py'), ''), None)
    """
    file, _, attribute = name.rpartition(":")
    if file.endswith(".py"):
        return Path(file), attribute
    return (Path(name), "") if name.endswith(".py") else None


def absolute_code_reference(name: str, folder: Path | None = None) -> str:
    """``FILE.py:NAME`` with an absolute path, relative to ``folder``; other names unchanged."""
    location = split_code_reference(name)
    return name if location is None else f"{((folder or Path()) / location[0]).resolve()}:{location[1]}"


def load(name: str, group: str, ours: Mapping[str, str] | None = None) -> Any:
    """The object of a name: one of ``ours``, an entry point of ``seatrial.<group>``, or ``FILE.py:NAME``.

    A file is executed. Raises :class:`ConfigurationError` if there is none, :class:`UserCodeError` if it fails.
    """
    if ours and name in ours:
        return import_object(ours[name])
    if (location := split_code_reference(name)) is None:
        entries = _entry_points_by_name(group)
        if name in entries:
            with report_user_code_errors(name, ""):
                return entries[name].load()
        names = [*(ours or ()), *entries]
        matches = get_close_matches(name, names, n=1)
        guess = f"did you mean {matches[0]}? " if matches else ""
        choices = f"use one of {', '.join(names)}, or " if names else "give "
        raise ConfigurationError(
            f"no {group.removesuffix('s')} is called {name!r}", fix=f"{guess}{choices}FILE.py:NAME of your own"
        )

    file, attribute = location
    try:
        content = files.read_regular_file(file, process.CONFIGURATION_BYTES)
    except OSError as error:
        why, fix = error.strerror or str(error), "give a Python file as FILE.py:NAME"
        raise ConfigurationError("cannot be read", where=str(file), why=why, fix=fix) from error
    module = _execute_module_file(file.resolve(), content)
    if attribute and hasattr(module, attribute):
        return getattr(module, attribute)
    defined_names = [
        key for key, member in vars(module).items() if getattr(member, "__module__", "") == module.__name__
    ]
    what = f"defines no {attribute}" if attribute else "is a file: which of what it defines is meant is to be said"
    why = f"it defines {', '.join(defined_names) or 'nothing'}"
    raise ConfigurationError(what, where=str(file), why=why, fix=f"write {file}:{(defined_names or ['NAME'])[0]}")


def sha256_of_code(name: str, group: str) -> str:
    """The SHA-256 of the file with a user's code, which is not executed; "" for ours and for a missing file."""
    entry, location = _entry_points_by_name(group).get(name), split_code_reference(name)
    file = location[0] if location else None
    if entry is not None:
        spec = find_spec(entry.module)
        file = Path(spec.origin) if spec is not None and spec.origin else None
    return hashlib.sha256(file.read_bytes()).hexdigest() if file is not None and file.is_file() else ""


def defining_file(code: Any) -> str:
    """The file that defines a class, a function or an object's class."""
    return inspect.getsourcefile(code if isinstance(code, type | FunctionType) else type(code)) or ""


@contextmanager
def report_user_code_errors(name: str, file: str) -> Iterator[None]:
    """Run a user's code: an exception is logged once with its traceback, and becomes a :class:`UserCodeError`.

    ``file`` is the user's file, in which the traceback begins.
    """
    try:
        yield
    except SeatrialError:
        raise
    except Exception as error:
        trace = error.__traceback__
        while trace is not None and trace.tb_frame.f_code.co_filename != file:
            trace = trace.tb_next
        lines = [line for frame, line in walk_tb(trace) if frame.f_code.co_filename == file]
        line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
        where = f"{file}, line {line}" if line else file
        if (where, str(error)) not in _LOGGED:  # sources are retried: log each error once
            _LOG.error("".join(format_exception(type(error), error, trace, chain=False)).rstrip())
            _LOGGED.add((where, str(error)))
        why = error.msg if isinstance(error, SyntaxError) else f"{type(error).__name__}: {error}"
        raise UserCodeError(
            f"{name.rpartition('/')[2]} failed", where=where, why=why, fix="correct it there"
        ) from error


def require_signature(code: Any, name: str, *arguments: str, method: str = "") -> None:
    """Raise :class:`ConfigurationError` unless ``code`` can be called with these arguments.

    ``method`` names the method of the class ``code`` to check.
    """
    parameters = ("self", *arguments) if method else arguments
    signature = f"{method or name.rpartition(':')[2]}({', '.join(parameters)})"
    function = getattr(code, method, None) if method else code
    try:
        inspect.signature(function).bind(*([code] if method else []), *arguments)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        what = f"has no {method}" if method else "is no function"
        what, why = ("takes other arguments", str(error)) if callable(function) else (what, "")
        raise ConfigurationError(what, where=name, why=why, fix=f"define {signature}") from error


def _entry_points_by_name(group: str) -> dict[str, EntryPoint]:
    return {entry_point.name: entry_point for entry_point in entry_points(group=f"seatrial.{group}")}


@lru_cache
def _execute_module_file(file: Path, content: bytes) -> ModuleType:
    """A file executed as a module, once for each content. Raises :class:`UserCodeError`."""
    name = f"seatrial_own_{file.stem}_{hashlib.sha256(bytes(file) + content).hexdigest()[:12]}"
    spec = spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ConfigurationError("is not a Python file", where=str(file), fix="give a file ending in .py")
    module = sys.modules[name] = module_from_spec(spec)  # dataclasses look up annotations there
    try:
        with report_user_code_errors(str(file), str(file)):
            spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
