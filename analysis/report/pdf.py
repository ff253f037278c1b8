"""A page as PDF, through WeasyPrint: A4, numbered, without the parts that only a screen has."""

from __future__ import annotations

import logging
import sys
from contextlib import redirect_stdout
from pathlib import Path

from acquisition.core.errors import ConfigurationError
from acquisition.core.files import atomic_file


def write_pdf(page: Path) -> Path:
    """Write a page of HTML beside itself as PDF and return its path.

    Raises :class:`ConfigurationError` where WeasyPrint finds no Pango, which sets its lines; :class:`StorageError`.
    """
    try:
        with redirect_stdout(sys.stderr):  # it prints what it misses, amid what a command prints as JSON
            from weasyprint import HTML
    except (ImportError, OSError) as error:
        raise ConfigurationError(
            "no PDF was written", where=str(page), why="WeasyPrint does not find the library Pango",
            fix="install it (Debian, Ubuntu: apt install libpangoft2-1.0-0; macOS: brew install pango; Windows: as "
            "WeasyPrint's documentation says), or print the page from a browser",
        ) from error  # fmt: skip
    for name in ("weasyprint", "fontTools"):
        logging.getLogger(name).setLevel(logging.ERROR)
    path = page.with_suffix(".pdf")
    with atomic_file(path) as partial:
        HTML(filename=str(page)).write_pdf(partial)
    return path
