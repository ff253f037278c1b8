"""Where training computes: on a GPU where there is one, else on the processor."""

from __future__ import annotations

import os

import torch

from acquisition.core.errors import ConfigurationError

VARIABLE = "SEATRIAL_DEVICE"
"""The environment variable that names another device than the one chosen, e.g. ``cpu`` or ``cuda:1``."""


def chosen_device() -> torch.device:
    """The device for training. Raises :class:`ConfigurationError` for one that is named but not there."""
    name = os.environ.get(VARIABLE) or ("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ConfigurationError(
            f"cannot compute on {name!r}",
            where=VARIABLE,
            why=str(error).splitlines()[0],
            fix="name a device of torch, such as cpu or cuda, or leave the variable out",
        ) from error
    return torch.device(name)
