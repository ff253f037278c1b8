"""Names and numbers of a diagnosis as people read them."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from hybrid.report.words import listed, plain

_SMALL = 0.001

DEPENDS = {
    "heading": "the heading",
    "place": "the place",
    "time": "time",
    "azimuth": "large azimuth angles",
    "operating point": "speed and thrusters",
    "speed": "the speed",
    "drift": "the speed sideways",
    "turning": "the yaw rate",
    "thrust": "the thrust ahead",
    "side thrust": "the thrust sideways",
}
"""What something unknown may depend on."""


ONE_OF_THEM = "one effect of their family that is not in the catalogue"
"""What all effects of a group may stand for that are named together."""


def alternatives(group: Sequence[str], named: Sequence[str], last: str = "or") -> str:
    """Effects of which the data do not tell which it is; or, where all are named, that may be one unknown.

    >>> alternatives(["trim", "skeg"], ["trim"])
    'trim or skeg'
    >>> alternatives(["trim", "skeg"], ["skeg", "trim"], "from")
    'trim and skeg from one effect of their family that is not in the catalogue'
    """
    words = [plain(name) for name in group]
    return f"{listed(words)} {last} {ONE_OF_THEM}" if set(group) <= set(named) else listed(words, last)


def number(value: float) -> str:
    """Three figures, without exponents where people read none.

    >>> number(-0.01234), number(12345.6), number(inf)
    ('−0.0123', '12,346', 'no end')
    """
    if value == inf:
        return "no end"
    size = abs(value)
    text = f"{value:,.0f}" if size >= 100.0 else f"{value:.3g}"
    return text.replace("-", "\u2212") if "e" not in text else text


def percent(share: float) -> str:
    """A share in whole percent, or one figure below ten.

    >>> percent(0.834), percent(0.01)
    ('83 %', '1 %')
    """
    return f"{100.0 * share:.0f} %" if abs(share) >= 0.0995 else f"{100.0 * share:.2g} %"


def chance(p_value: float) -> str:
    """The chance of something where there is nothing.

    >>> chance(0.012), chance(1e-9)
    ('p = 0.012', 'p < 0.001')
    """
    return f"p < {_SMALL:g}" if p_value < _SMALL else f"p = {p_value:.2g}"


def parameter_title(name: str, unit: str) -> str:
    """A parameter's name without its unit.

    >>> parameter_title("time_constant_s", "s"), parameter_title("resistance_factor", "1")
    ('time constant', 'resistance factor')
    """
    return plain(name if unit == "1" or "_" not in name else name.rsplit("_", 1)[0])
