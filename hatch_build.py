"""How the wheel is laid out: one package ``seatrial``, whose parts are the repository's top-level folders.

An editable installation needs none of it: there :mod:`seatrial` finds the folders beside itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_FOLDERS = ("acquisition", "analysis", "hybrid", "notebooks", "trials")
_MAIN = '"""``python -m seatrial``."""\n\nfrom seatrial import main\n\nmain()\n'


class SinglePackage(BuildHookInterface[Any]):
    """Puts the folders into the package of a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called before a wheel is built; ``version`` is "standard" or "editable"."""
        if version == "editable":
            return
        main = Path(self.root, "build", "__main__.py")
        main.parent.mkdir(exist_ok=True)
        main.write_text(_MAIN, encoding="utf-8")
        places = {"seatrial.py": "seatrial/__init__.py", str(main): "seatrial/__main__.py"}
        build_data["force_include"] |= places | {folder: f"seatrial/{folder}" for folder in _FOLDERS}
