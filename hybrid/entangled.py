"""Which estimates these data cannot tell apart in size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ENTANGLED = 0.95
"""Two estimates correlated by so much, either way, are one in all but name."""


def entangled_pairs(names: Sequence[str], correlation: NDArray[np.float64]) -> list[tuple[str, str, float]]:
    """Pairs of ``names`` [P] whose estimates hang together, and their correlation, from all of them [P, P].

    >>> entangled_pairs(["mass", "drag"], np.array([[1.0, -0.97], [-0.97, 1.0]]))
    [('drag', 'mass', -0.97)]
    """
    return [
        (names[one], names[other], float(correlation[one, other]))
        for one in range(len(names)) for other in range(one) if abs(correlation[one, other]) > ENTANGLED
    ]  # fmt: skip
