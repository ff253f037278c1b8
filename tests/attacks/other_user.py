"""What another user of the computer does."""

from __future__ import annotations

import os
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NOBODY = 65_534


def as_nobody(action: Callable[[], object]) -> None:
    """Do something in a process of another user's; needs root, without which the attack cannot be made."""
    if os.getuid() != 0:
        pytest.skip("another user's doings need root")
    if process := os.fork():
        assert os.waitpid(process, 0)[1] == 0
        return
    try:
        os.setuid(NOBODY)
        action()
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(0)


@contextmanager
def open_folder() -> Iterator[Path]:
    """A folder in which everyone may write, as /tmp."""
    with tempfile.TemporaryDirectory(dir="/tmp") as place:
        Path(place).chmod(0o777)
        yield Path(place)
