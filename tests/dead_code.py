"""Dead code by vulture: `python -m tests.dead_code`. What a template calls, or a ``"module:function"``, counts as
used."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from vulture import Vulture
from vulture.config import make_config

ROOT = Path(__file__).parents[1]


def template_words() -> set[str]:
    """Every word that stands in a template."""
    pages = [path for folder in ("analysis", "hybrid") for path in (ROOT / folder).rglob("*.html")]
    return {word for page in pages for word in re.findall(r"\w+", page.read_text(encoding="utf-8"))}


def loaded_names() -> set[str]:
    """Every function that is loaded by the text ``"module:function"``."""
    sources = [
        path
        for folder in ("acquisition", "analysis", "hybrid", "notebooks")
        for path in (ROOT / folder).rglob("*.py")
    ]
    return {
        name
        for path in (ROOT / "seatrial.py", *sources)
        for name in re.findall(r'"[\w.]+:(\w+)"', path.read_text(encoding="utf-8"))
    }


def unused() -> list[str]:
    """What nothing calls, a line each; not variables, as the fields of a record are read by name."""
    settings = make_config(["--config", str(ROOT / "pyproject.toml")])
    vulture = Vulture(ignore_names=settings["ignore_names"], ignore_decorators=settings["ignore_decorators"])
    vulture.scavenge([str(ROOT / path) for path in settings["paths"]])
    known = template_words() | loaded_names()
    items = vulture.get_unused_code(min_confidence=settings["min_confidence"], sort_by_size=False)
    return [item.get_report() for item in items if item.typ != "variable" and item.name not in known]


if __name__ == "__main__":
    found = unused()
    print("\n".join(found) or "no dead code")  # noqa: T201 - this is the terminal
    sys.exit(bool(found))
