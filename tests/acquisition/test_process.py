"""Signals that end the work, wherever in the process they arrive."""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Callable

import pytest

from seatrial.acquisition.core.process import Termination, interrupt_on_terminate
from tests.attacks.commands import PATIENCE_S


def terminated_in_finaliser() -> None:
    """SIGTERM arrives while an object is taken apart."""

    class Ending:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGTERM)

    Ending()


def terminated_in_collection() -> None:
    """SIGTERM arrives in a callback of the garbage collector, such as that of distributed."""

    def callback(phase: str, info: dict[str, int]) -> None:
        if phase == "stop":
            signal.raise_signal(signal.SIGTERM)

    gc.callbacks.append(callback)
    try:
        gc.collect()
    finally:
        gc.callbacks.remove(callback)


def work_until_terminated(arrive: Callable[[], None]) -> None:
    with interrupt_on_terminate():
        arrive()
        threading.Event().wait(PATIENCE_S)


@pytest.mark.parametrize(
    "arrive", [lambda: signal.raise_signal(signal.SIGTERM), terminated_in_finaliser, terminated_in_collection]
)
def test_sigterm_ends_the_work_wherever_it_arrives(arrive: Callable[[], None]) -> None:
    """Python drops an exception that is raised in a finaliser or a callback of the collector."""
    handler = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Termination):
        work_until_terminated(arrive)
    assert signal.getsignal(signal.SIGTERM) == handler
