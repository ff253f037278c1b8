"""Many long calls in several processes, the results in the order asked for.

The workers of :mod:`analysis.batch.batch` make files of recordings and say in a row how it went; here values come
back, nothing is on the disk, and an error is to end it all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any

from acquisition.core.progress import Progress


def in_order(asked: Sequence[tuple[Any, ...]], workers: int, progress: Progress) -> Iterator[Any]:
    """The result of each call, given as a function and its arguments, in order whichever process ends first."""
    if workers < 2:
        for number, (function, *arguments) in enumerate(asked):
            yield function(*arguments)
            progress((number + 1) / len(asked))
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_one_core_each) as processes:
        running = [processes.submit(*each) for each in asked]
        try:
            for done, each in enumerate(as_completed(running), start=1):
                each.result()
                progress(done / len(running))
        except BaseException:
            processes.shutdown(wait=False, cancel_futures=True)
            raise
        yield from (each.result() for each in running)


def _one_core_each() -> None:
    """Let a process use one core: threads of several processes would wait for each other."""
    import numba
    import torch

    numba.set_num_threads(1)
    torch.set_num_threads(1)
