"""Held windows on disk: the long table as Parquet with its account, the starts in a file beside it."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from acquisition.core.channels import BY_NAME, NAMES
from acquisition.core.errors import InputError
from analysis.tables.parquet import read_parquet, write_parquet
from analysis.windows.held import COLUMNS, HeldWindows


def write_windows(windows: HeldWindows, path: Path | str) -> None:
    """Write the windows as Parquet, the account of the candidates and their provenance in the file's metadata.

    Their starts, if they have them, go into ``<name>.starts.parquet`` beside. Raises
    :class:`acquisition.core.errors.StorageError` when a file cannot be written.
    """
    account = {
        "candidates": windows.candidates,
        "kept": windows.kept,
        "dropped": windows.dropped,
        "horizon_s": windows.horizon_s,
        "stride_s": windows.stride_s,
    }
    units = {name: BY_NAME[name].unit for name in NAMES} | {"second": "s"}
    provenance = {"provenance": json.dumps(windows.provenance)}
    write_parquet(windows.rows, path, units, {"windows": json.dumps(account), **provenance})
    if windows.starts is not None:
        states = {f"{kind}{name}": unit for name, unit in units.items() for kind in ("", "slow_")}
        about = {"covariance": "SI, angles in radians", **provenance}
        write_parquet(windows.starts, starts_path(path), states, about)


def starts_path(path: Path | str) -> Path:
    """Where the starts of windows are that are written to ``path``."""
    return Path(path).with_suffix(".starts.parquet")


def read_windows(path: Path | str) -> HeldWindows:
    """Read what :func:`write_windows` wrote. Raises :class:`InputError` for any other file."""
    rows, metadata = read_parquet(path)
    if "windows" not in metadata or set(COLUMNS) - set(rows.columns):
        raise InputError("holds no windows", where=str(path), fix="make one with `seatrial windows`")
    names = [*COLUMNS, *(["held"] if "held" in rows else [])]
    return HeldWindows(
        rows[names], **json.loads(metadata["windows"]), starts=_starts_beside(rows, path),
        provenance=json.loads(metadata.get("provenance", "{}")),
    )  # fmt: skip


def _starts_beside(rows: pd.DataFrame, path: Path | str) -> pd.DataFrame | None:
    """The starts beside a file of windows, unless they are of other windows."""
    if not starts_path(path).is_file():
        return None
    starts, _ = read_parquet(starts_path(path))
    first, keys = rows.loc[rows["second"] == 0], ["window", "trial", "start"]
    same = set(keys) <= set(starts.columns) and len(first) == len(starts)
    return starts if same and all((first[key].to_numpy() == starts[key].to_numpy()).all() for key in keys) else None
