"""Calibrators behind one interface: the methods by name, each imported when it is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquisition.core.named_code import load

if TYPE_CHECKING:
    from hybrid.calibrators.calibrator import Calibrator
    from hybrid.vessel.plant import Plant

# Imported when first used: torch takes more than a second.
_METHODS = {
    "paper": "hybrid.calibrators.networks:PaperCalibrator",
    "data_driven": "hybrid.calibrators.networks:DataDrivenCalibrator",
    "additive": "hybrid.calibrators.networks:AdditiveCalibrator",
    "paper_adam": "hybrid.calibrators.networks:PublishedPaperCalibrator",
    "adaptive": "hybrid.calibrators.adaptive.calibrator:AdaptiveCalibrator",
}
METHODS: tuple[str, ...] = tuple(_METHODS)
COMPARED = tuple(method for method in METHODS if method != "paper_adam")
"""What is compared where nobody says which methods: ``paper_adam`` is ``paper`` again, trained for longer."""


def refuse_unknown(method: str) -> None:
    """Raise :class:`ConfigurationError` for what is no calibrator: none of ours by name, no entry point of
    ``seatrial.calibrators``, and no ``FILE.py:CLASS``.
    """
    if method not in _METHODS:
        make_calibrator(method)


def make_calibrator(method: str, seed: int = 0, plant: Plant | None = None) -> Calibrator:
    """An untrained calibrator by its method's name, as :func:`refuse_unknown` lists them.

    A class that is no :class:`Calibrator` goes into an :class:`.OwnCalibrator`. Raises :class:`ConfigurationError`.
    """
    made = load(method, "calibrators", _METHODS)
    if method in _METHODS:
        calibrator: Calibrator = made(seed, plant)
        return calibrator
    from hybrid.calibrators.own import own_calibrator

    return own_calibrator(made, method, seed, plant)
