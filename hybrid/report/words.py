"""Names and numbers as people say them."""

from __future__ import annotations

import re
from collections.abc import Sequence

UNITS = {"mps": "m/s", "radps": "rad/s", "dps": "deg/s", "rps": "rev/s", "rpm": "rpm", "deg": "deg", "m": "m",
          "n": "N", "nm": "N m", "cos": "cosine", "sin": "sine"}  # fmt: skip


_SMALL_N = 100.0  # as "0" and "0.1" kN such forces would say nothing


def force_unit(largest_n: float) -> tuple[float, str]:
    """The unit in which forces up to so many newtons are legible, kN or for a model ship N: in N, and its name.

    >>> force_unit(2e4), force_unit(0.5)
    ((1000.0, 'kN'), (1.0, 'N'))
    """
    return (1e3, "kN") if largest_n >= _SMALL_N else (1.0, "N")


def plain(name: str) -> str:
    """A method's, an effect's or a channel's name for people.

    >>> plain("ocean_current")
    'ocean current'
    >>> plain("surge_force_rpm_below_0_surge_above_minus_0p5")
    'surge force rpm below 0 surge above \u22120.5'
    """
    return re.sub(r"(\d)p(\d)", r"\1.\2", name.replace("_", " ").replace("minus ", "\u2212"))


def join_words(words: Sequence[str], last: str = "and") -> str:
    """Words as a sentence lists them.

    >>> join_words(["trim", "skeg", "loading"])
    'trim, skeg and loading'
    """
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + f" {last} " + words[-1] if words else "nothing"


def no_wrap(text: str) -> str:
    """A text that is not broken over two lines."""
    return text.replace(" ", "\u00a0").replace("-", "\u2011")


def quantity_title(name: str) -> str:
    """A quantity's name with its unit in brackets.

    >>> quantity_title("yaw_rate_radps"), quantity_title("bow_angle_cos"), quantity_title("second")
    ('yaw rate [rad/s]', 'bow angle [cosine]', 'second')
    """
    what, _, suffix = name.rpartition("_")
    return f"{what.replace('_', ' ')} [{UNITS[suffix]}]" if suffix in UNITS and what else name.replace("_", " ")
