"""Calibrators behind one interface: the methods by name, each imported when it is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from acquisition.core.errors import ConfigurationError

if TYPE_CHECKING:
    from hybrid.calibrators.calibrator import Calibrator
    from hybrid.vessel.plant import Plant

# Imported when first used: torch takes more than a second.
_METHODS = {
    "paper": ("hybrid.calibrators.networks", "PaperCalibrator"),
    "data_driven": ("hybrid.calibrators.networks", "DataDrivenCalibrator"),
    "additive": ("hybrid.calibrators.networks", "AdditiveCalibrator"),
    "paper_adam": ("hybrid.calibrators.networks", "PublishedPaperCalibrator"),
    "adaptive": ("hybrid.calibrators.adaptive.calibrator", "AdaptiveCalibrator"),
}
METHODS: tuple[str, ...] = tuple(_METHODS)
COMPARED = tuple(method for method in METHODS if method != "paper_adam")
"""What is compared where nobody says which methods: ``paper_adam`` is ``paper`` again, trained for longer."""


def refuse_unknown(method: str) -> None:
    """Raise :class:`ConfigurationError` for the name of no calibrator."""
    if method not in _METHODS:
        raise ConfigurationError(f"no calibrator is called {method!r}", fix=f"use one of {', '.join(METHODS)}")


def make_calibrator(method: str, seed: int = 0, plant: Plant | None = None) -> Calibrator:
    """An untrained calibrator by its method's name. Raises :class:`ConfigurationError`."""
    refuse_unknown(method)
    module, name = _METHODS[method]
    calibrator: Calibrator = getattr(import_module(module), name)(seed, plant)
    return calibrator
