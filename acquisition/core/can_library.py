"""python-can without asammdf, which it would import wherever that is installed, to read and write measurements.

asammdf brings sympy, canmatrix and openpyxl: more than half of the time in which a recorder starts.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any


def import_without_asammdf() -> None:
    """Import python-can as if asammdf were not installed, for a process that does nothing but record."""
    if "asammdf" in sys.modules:
        return
    sys.modules["asammdf"] = None  # type: ignore[assignment]
    try:
        importlib.import_module("can")
    finally:
        del sys.modules["asammdf"]


def with_asammdf() -> Any:
    """The module ``can.io.mf4`` with asammdf; its classes raise NotImplementedError where that is not installed."""
    module = importlib.import_module("can.io.mf4")
    return module if module.asammdf else importlib.reload(module)
