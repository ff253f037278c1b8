"""The program as its users call it, and its files as anybody can read them: no internal module is imported here."""

from __future__ import annotations

import io
import json
import sys
import tomllib
from contextlib import redirect_stdout
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
from mcap.reader import make_reader

ROOT = Path(__file__).resolve().parents[2]
PROSE = frozenset({"sentence", "text", "what", "source", "why", "looks_like", "remarks", "description", "title"})
"""Wording may improve; the figures that it quotes stand beside it."""
VOLATILE = frozenset(
    {"software_version", "recordings_sha256", "recording_sha256", "version_of_software", "version"}
)


def seatrial(*arguments: object) -> str:
    """What the command line prints to stdout, run in this process so that compiled code is kept.

    Raises :class:`RuntimeError` if it fails; its own message went to stderr.
    """
    command = ["seatrial", *map(str, arguments)]
    printed = io.StringIO()
    with patch.object(sys, "argv", command), redirect_stdout(printed):
        try:
            _entry_point()()
        except SystemExit as end:
            if end.code:
                raise RuntimeError(f"exit code {end.code}: {' '.join(command)}") from None
    return printed.getvalue()


@cache
def _entry_point() -> Any:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["scripts"]["seatrial"].partition(":")
    return getattr(import_module(module), name)


def answer(*arguments: object) -> Any:
    """The JSON object that a command prints with ``--json``, without prose, versions and digests of files."""
    return figures_of(json.loads(seatrial(*arguments, "--json")))


def figures_of(plain: Any) -> Any:
    """``plain`` without the keys whose values are prose or belong to one run."""
    if isinstance(plain, dict):
        return {key: figures_of(value) for key, value in plain.items() if key not in PROSE | VOLATILE}
    return [figures_of(value) for value in plain] if isinstance(plain, list) else plain


def simulate(name: str, manoeuvre: str, duration_s: float, sea_state: str = "calm", *more: object) -> str:
    """Simulate a trial at 1 Hz in the present folder; the file's name."""
    file = f"{name}.mcap"
    fixed = ("--manoeuvre", manoeuvre, "--duration", duration_s, "--sea-state", sea_state)
    seatrial("simulate", "-o", file, *fixed, *(() if "--rate" in more else ("--rate", 1)), *more)
    return file


def table_digest(file: str | Path) -> dict[str, Any]:
    """Each column of a Parquet file in a few numbers; ``ramp`` is the mean of value times place, in 0 to 1."""
    table = pd.read_parquet(file)
    if table.index.name is not None:
        table = table.reset_index()
    return {"rows": len(table), "columns": {str(name): _column_digest(table[name]) for name in table}}


def _column_digest(column: pd.Series) -> dict[str, Any]:
    if pd.api.types.is_datetime64_any_dtype(column):
        seconds = column.astype("datetime64[ns, UTC]").astype("int64") / 1e9
        return {"first": str(column.min()), "last": str(column.max()), "mean_s": float(seconds.mean())}
    if not (pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column)):
        texts = column.astype(str)
        return {"first": texts.iloc[0], "last": texts.iloc[-1], "distinct": int(texts.nunique())}
    values = column.to_numpy(dtype=float, na_value=np.nan)
    there = np.isfinite(values)
    place = np.arange(len(values)) / max(len(values), 1)
    values, place = values[there], place[there]
    if not len(values):
        return {"values": 0}
    return {
        "values": len(values),
        "sum": float(values.sum()),
        "mean": float(values.mean()),
        "rms": float(np.sqrt(np.mean(values**2))),
        "ramp": float(np.mean(values * place)),
    }


def topics(file: str | Path) -> dict[str, Any]:
    """The topics of a recording: encodings, schema and the schema's properties with their types."""
    with Path(file).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None:
        raise RuntimeError(f"{file} was not closed")
    said = {}
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        said[channel.topic] = {
            "message_encoding": channel.message_encoding,
            "schema": schema.name,
            "schema_encoding": schema.encoding,
            "properties": {k: v["type"] for k, v in json.loads(schema.data)["properties"].items()},
        }
    return said
