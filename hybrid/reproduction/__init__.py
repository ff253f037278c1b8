"""The results of Wang, Li et al. 2021 from scratch: its campaign, its Table III and its figures."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from seatrial.acquisition.core.errors import ConfigurationError

SOURCES = Path(__file__).resolve().parents[2] / "notebooks"


def notebook(name: str) -> Any:
    """The module of a notebook of ``notebooks/``, for a command that runs its functions without a kernel.

    The folder goes onto the path, which worker processes inherit. Raises :class:`ConfigurationError` where the
    notebooks are not installed.
    """
    if not (SOURCES / f"{name}.py").is_file():
        raise ConfigurationError("the notebooks are not installed", where=str(SOURCES), fix="run from a checkout")
    if str(SOURCES) not in sys.path:
        sys.path.append(str(SOURCES))
    return import_module(name)
