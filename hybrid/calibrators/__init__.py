"""Calibrators behind one interface: the methods by name, each imported on first use."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.named_code import load

if TYPE_CHECKING:
    from seatrial.hybrid.calibrators.calibrator import Calibrator
    from seatrial.hybrid.vessel.plant import Plant

# Imported when first used.
_METHODS = {
    "paper": "seatrial.hybrid.calibrators.networks:PaperCalibrator",
    "data_driven": "seatrial.hybrid.calibrators.networks:DataDrivenCalibrator",
    "additive": "seatrial.hybrid.calibrators.networks:AdditiveCalibrator",
    "paper_adam": "seatrial.hybrid.calibrators.networks:PublishedPaperCalibrator",
    "adaptive": "seatrial.hybrid.calibrators.adaptive.calibrator:AdaptiveCalibrator",
}
INSTALL = "pip install 'seatrial[networks]'"
METHODS: tuple[str, ...] = tuple(_METHODS)
COMPARED = tuple(method for method in METHODS if method != "paper_adam")
"""The methods compared by default: ``paper_adam`` is ``paper`` again, trained for longer."""


def can_train(method: str) -> bool:
    """Whether calibrators of a method can be trained here; networks need PyTorch."""
    return "networks:" not in _METHODS.get(method, "") or find_spec("torch") is not None


def refuse_untrainable(method: str) -> None:
    """Raise :class:`ConfigurationError` unless ``method`` is a calibrator (:func:`make_calibrator`) that can be
    trained here."""
    if method not in _METHODS:
        make_calibrator(method)
    if not can_train(method):
        raise ConfigurationError(
            f"{method} is a network, and PyTorch, which trains it, is not installed",
            fix=f"{INSTALL}, or use another method",
        )


def make_calibrator(method: str, seed: int = 0, plant: Plant | None = None) -> Calibrator:
    """An untrained calibrator by its method: the name of one of ours, of an entry point of
    ``seatrial.calibrators``, or ``FILE.py:CLASS``.

    A class that is no :class:`Calibrator` is wrapped in an :class:`.OwnCalibrator`. Raises
    :class:`ConfigurationError`.
    """
    factory = load(method, "calibrators", _METHODS)
    if method in _METHODS:
        calibrator: Calibrator = factory(seed, plant)
        return calibrator
    from seatrial.hybrid.calibrators.own import own_calibrator

    return own_calibrator(factory, method, seed, plant)
