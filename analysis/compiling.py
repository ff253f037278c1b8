"""How the numerical core is compiled: the decorator's settings, and the digest that invalidates stale caches.

numba stores a compiled kernel beside its source file and looks only at that file to see whether the kernel is
current. Ours call functions of other files, so every cached kernel closes over a digest of them all
(:func:`source_stamp`): after a change of any equation the kernels compile again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias

from numba import config, get_num_threads, njit, set_num_threads
from numba.core.registry import CPUDispatcher

Record: TypeAlias = Any
"""A numpy record, such as a packed plant; inside compiled code its fields are attributes."""

_WORTH_THREADS = 20_000  # steps of a ship

# Sums may be fused, but NaN and infinity keep their meaning: a missing sample is a NaN, no gate an infinite limit.
FAST = {"contract"}


class _Part(CPUDispatcher):  # type: ignore[misc]  # numba has no types
    """A function that is compiled into kernels only; Python calls it as it is written."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self.py_func(*arguments, **named)


def compiled(function: Callable[..., Any]) -> Any:
    """Decorate a small function that kernels are made of: it is compiled into each kernel that calls it.

    Left to itself LLVM keeps calls that hand arrays over piece by piece: 1.65 times the time of a bare loop,
    against 1.03 inlined, for 2 s more of compilation (``tests/benchmarks/simulator_speed.py``). Without a way in
    from Python a kernel is compiled in three quarters of the time.
    """
    if config.DISABLE_JIT:
        return function
    options = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    part = njit(fastmath=FAST, error_model="numpy", **options)(function)
    part.__class__ = _Part  # or numba would jump to the way in that is not there
    return part


@compiled
def copy_row(result, values):  # type: ignore[no-untyped-def]
    """Copy ``values`` [n] to ``result``.

    An assignment would be compiled with the message of its error, a whole formatter of strings: 2 s a kernel.
    """
    for i in range(result.size):
        result[i] = values[i]


def dispatch_by_code(functions: Sequence[Any], code_of: Any, code: int = 0) -> Any:
    """One compiled function that calls that of ``functions`` whose number ``code_of`` gives for the arguments."""
    function = functions[code]
    if code == len(functions) - 1:
        return function
    dispatch_rest = dispatch_by_code(functions, code_of, code + 1)

    @compiled
    def dispatch(*arguments):  # type: ignore[no-untyped-def]
        if code_of(*arguments) == code:
            return function(*arguments)
        return dispatch_rest(*arguments)

    return dispatch


@contextmanager
def threads_for(steps: int) -> Iterator[None]:
    """All threads for a parallel kernel that computes so many steps of a ship, or one thread for few steps.

    Waking threads and waiting for the last of them costs more than it brings below some ten milliseconds, and on a
    busy machine ten times as much: a diagnosis of 75 min alongside other work took 234 s with four threads for
    every batch of 18,000 steps, and 107 s with one.
    """
    threads = get_num_threads()
    set_num_threads(threads if steps > _WORTH_THREADS else 1)
    try:
        yield
    finally:
        set_num_threads(threads)


def source_stamp(*places: Path) -> int:
    """A digest of Python sources: files, all files in folders and below them, and this file's settings."""
    digest = sha256(Path(__file__).read_bytes())
    for place in places:
        for source in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(source.read_bytes())
    return int(digest.hexdigest()[:15], 16)
