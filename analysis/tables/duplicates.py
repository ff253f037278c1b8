"""Recordings given twice: their legs would be on both sides of every split."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from acquisition.core.errors import InputError
from analysis.tables.provenance import sha256_of


def refuse_twins(paths: Sequence[Path]) -> list[str]:
    """The SHA-256 of each recording, in their order; empty where one cannot be read, which its reader will say.

    Raises :class:`InputError` where two files hold the same.
    """
    first: dict[str, Path] = {}
    hashes = []
    for path in paths:
        digest = sha256_of(path) or ""
        twin = first.setdefault(digest, path)
        if digest and twin is not path:
            raise InputError(
                "is given twice", where=str(path), why=f"it is the same recording as {twin}", fix="give it once"
            )
        hashes.append(digest)
    return hashes
