"""Quantities for people."""

from __future__ import annotations

_UNITS = {"mps": "m/s", "radps": "rad/s", "dps": "deg/s", "rps": "rev/s", "rpm": "rpm", "deg": "deg", "m": "m",
          "cos": "cosine", "sin": "sine"}  # fmt: skip


def quantity_title(name: str) -> str:
    """A quantity's name with its unit in brackets.

    >>> quantity_title("yaw_rate_radps"), quantity_title("port_angle_cos"), quantity_title("second")
    ('yaw rate [rad/s]', 'port angle [cosine]', 'second')
    """
    what, _, suffix = name.rpartition("_")
    return f"{what.replace('_', ' ')} [{_UNITS[suffix]}]" if suffix in _UNITS and what else name.replace("_", " ")
