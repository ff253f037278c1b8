"""What all figures of predictions share: one colour and one title a method."""

from __future__ import annotations

from analysis.plots import PALETTE

COLOUR = {
    "constant_velocity": PALETTE[3],
    "reference": PALETTE[4],
    "data_driven": PALETTE[2],
    "hybrid": PALETTE[0],
}
"""One colour a method, in every figure."""


def title_of(method: str) -> str:
    """A method's name for people.

    >>> title_of("constant_velocity")
    'constant velocity'
    """
    return method.replace("_", " ")
