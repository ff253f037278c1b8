"""Windows of recordings in which something is certainly wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition.recording.tables import write_table
from acquisition.trial import Trial
from hybrid.gather import gather
from hybrid.truth.trial import simulate_trial

KNOT_MPS = 1852.0 / 3600.0


def test_speeds_in_knots_are_put_right_on_request(tmp_path: Path) -> None:
    """Surge and sway of a simulated trial written in knots: repaired, windows start at the speeds of the ship."""
    table, _ = simulate_trial("gunnerus_short", "calm", "voyage", 600.0, 5.0, 1)
    wrong = table.assign(**{name: table[name] / KNOT_MPS for name in ("surge_mps", "sway_mps")})
    paths = [tmp_path / "right.mcap", tmp_path / "wrong.mcap"]
    for path, each in zip(paths, (table, wrong), strict=True):
        write_table(each, path, Trial(name=path.stem), source="simulated")
    right, as_it_is = (gather([path], 15, 5).horizons for path in paths)
    repaired = gather(paths[1:], 15, 5, repair=True).horizons
    assert len(right) == len(as_it_is) == len(repaired) > 10
    surge = [np.median(each.start[:, 3]) for each in (as_it_is, right, repaired)]
    assert surge[0] == pytest.approx(surge[1] / KNOT_MPS, rel=0.01)
    assert surge[2] == pytest.approx(surge[1], rel=0.01)
