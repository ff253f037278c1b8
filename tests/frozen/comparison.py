"""Two JSON objects held against each other, number by number."""

from __future__ import annotations

from collections.abc import Iterator
from math import isclose
from typing import Any

ABSOLUTE = 1e-9
"""What is zero but for rounding is not compared by ratios."""
NOTHING = "(nothing)"


def differences(frozen: Any, now: Any, relative: float) -> list[str]:
    """One line for each path at which ``now`` is not ``frozen``: all of them, not only the first."""
    before, after = dict(leaves(frozen)), dict(leaves(now))
    return [
        f"{path}: {before.get(path, NOTHING)!r} -> {after.get(path, NOTHING)!r}{_ratio(before, after, path)}"
        for path in before | after
        if path not in before or path not in after or not _same(before[path], after[path], relative)
    ]


def leaves(plain: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every value that is neither object nor list with its path; empty objects and lists are values, too."""
    if isinstance(plain, (dict, list)) and plain:
        for key, value in plain.items() if isinstance(plain, dict) else enumerate(plain):
            yield from leaves(value, f"{path}/{key}")
    else:
        yield path, plain


def _same(before: Any, after: Any, relative: float) -> bool:
    if _number(before) and _number(after):
        return isclose(before, after, rel_tol=relative, abs_tol=ABSOLUTE * min(1.0, relative / 1e-6))
    return type(before) is type(after) and bool(before == after)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _ratio(before: dict[str, Any], after: dict[str, Any], path: str) -> str:
    old, new = before.get(path), after.get(path)
    return f" (relative {abs(new / old - 1.0):.1e})" if _number(old) and _number(new) and old else ""
