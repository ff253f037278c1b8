"""What is in a recording, as the contract's JSON object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from acquisition.core.frames import iso
from acquisition.recording.reader import Recording, Series, read_recording


def describe(path: Path | str) -> dict[str, Any]:
    """Channels with counts, rates, span, sources and longest gap; raw counts; whether it was closed."""
    return describe_recording(read_recording(path))


def describe_recording(recording: Recording) -> dict[str, Any]:
    """As :func:`describe`, of a recording that is already read."""
    return {
        "closed": recording.closed,
        "messages": recording.messages,
        "start": iso(recording.start_ns),
        "end": iso(recording.end_ns),
        "duration_s": (recording.end_ns - recording.start_ns) / 1e9,
        "channels": {name: _describe_series(series) for name, series in sorted(recording.series.items())},
        "raw": recording.raw,
        "trial": recording.trial.as_metadata(),
    }


def _describe_series(series: Series) -> dict[str, Any]:
    times = np.sort(series.measured_ns)
    span_s = float(times[-1] - times[0]) / 1e9
    return {
        "count": int(times.size),
        "rate_hz": (times.size - 1) / span_s if span_s > 0 else 0.0,
        "first": iso(int(times[0])),
        "last": iso(int(times[-1])),
        "sources": sorted(series.sources),
        "longest_gap_s": float(np.diff(times).max()) / 1e9 if times.size > 1 else 0.0,
    }
