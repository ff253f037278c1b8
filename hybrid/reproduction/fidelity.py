"""The functions of a notebook, for a command that runs them without a kernel."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

from acquisition.core.errors import ConfigurationError

SOURCES = Path(__file__).resolve().parents[2] / "notebooks"


def notebook(name: str) -> Any:
    """The module of a notebook of ``notebooks/``, which computes nothing when it is loaded.

    Worker processes get its functions by value, since they cannot import it. Raises :class:`ConfigurationError`
    where the notebooks are not installed.
    """
    import cloudpickle

    path = SOURCES / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ConfigurationError("the notebooks are not installed", where=str(path), fix="run from a checkout")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look for the types of their fields
    spec.loader.exec_module(module)
    cloudpickle.register_pickle_by_value(module)
    return module
