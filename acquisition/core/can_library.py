"""python-can without asammdf, which it would import wherever that is installed, to read and write measurements.

asammdf brings sympy, canmatrix and openpyxl: more than half of the time in which a recorder starts. The packages
whose modules import python-can, or a library that does, import this module first.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

if "asammdf" in sys.modules:
    import can.io.mf4
else:
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # as if it were not installed
    try:
        import can.io.mf4
    finally:
        del sys.modules["asammdf"]


def with_asammdf() -> Any:
    """The module ``can.io.mf4`` with asammdf; its classes raise NotImplementedError where that is not installed."""
    return can.io.mf4 if can.io.mf4.asammdf else importlib.reload(can.io.mf4)
