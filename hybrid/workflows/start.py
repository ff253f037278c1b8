"""``seatrial init``: a folder for the trials of a ship, in which recording and importing work at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from pymap3d import ned2geodetic

from acquisition.config.vessel_file import vessel_names
from acquisition.core.actuators import VESSELS
from acquisition.core.errors import ConfigurationError
from acquisition.core.files import write_text
from acquisition.recording.parts import safe_name
from acquisition.tables.import_table import refuse_overwriting
from hybrid.vessel.estimate.new_vessel import new_vessel

TEMPLATES = VESSELS.parent / "start"
_KNOT_MPS = 1852.0 / 3600.0
_EXAMPLE_S, _SPEED_MPS, _SWING_DEG, _PERIOD_S = 180, 6.0, 20.0, 60.0
_HEADER = """# An example, a coaster of 82 m, to be replaced by your ship:
#   seatrial vessel new -o vessel.toml --name {name} --length ... --beam ... --draught ... --block ... \\
#     --service-speed ... --propeller "propeller,diameter=..." --rudder "rudder,area=..."
# Other propellers, rudders or thrusters have other channels: list them in trial.toml and columns.toml too.
#
"""


def start_folder(folder: Path, name: str = "", *, force: bool = False) -> list[Path]:
    """Write ``vessel.toml``, ``trial.toml``, ``columns.toml`` and ``example.csv`` into a folder; their paths.

    ``name`` is what ship and trial are called, the folder's without it. Raises :class:`InputError` where one of
    them is there, without ``force``; :class:`ConfigurationError` for the name of a ship that Seatrial has;
    :class:`StorageError`.
    """
    name = safe_name(name or folder.resolve().name)
    if name in vessel_names():
        raise ConfigurationError(f"{name} is the name of a ship in Seatrial", fix="give yours another --name")
    texts = {"vessel.toml": _HEADER.format(name=name) + _example_ship(name), "example.csv": _example_table()}
    for each in ("trial.toml", "columns.toml"):
        texts[each] = (TEMPLATES / each).read_text(encoding="utf-8").replace("NAME", name)
    for each in texts:
        refuse_overwriting(folder / each, force)
    return [write_text(folder / each, text) for each, text in texts.items()]


def _example_ship(name: str) -> str:
    return new_vessel(
        name=name, length_m=82.0, beam_m=12.5, draught_m=5.2, block=0.74, service_speed_mps=6.2,
        propellers=["propeller, diameter=3.1"], rudders=["rudder, area=9.5"],
    ).text  # fmt: skip


def _example_table() -> str:
    """Three minutes of a ship that swings about north at a steady speed, as a logger aboard writes them."""
    time_s = np.arange(float(_EXAMPLE_S))
    phase = 2.0 * np.pi * time_s / _PERIOD_S
    heading_deg, rate_dps = _SWING_DEG * np.sin(phase), 2.0 * np.pi / _PERIOD_S * _SWING_DEG * np.cos(phase)
    north_m, east_m = (_SPEED_MPS * np.cumsum(each(np.deg2rad(heading_deg))) for each in (np.cos, np.sin))
    lat, lon, _ = ned2geodetic(north_m, east_m, 0.0, 63.44, 10.4, 0.0)
    start = pd.Timestamp("2026-06-01T08:00:00Z")
    return pd.DataFrame({
        "Time UTC": (start + pd.to_timedelta(time_s, unit="s")).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "Lat": lat.round(7), "Lon": lon.round(7),
        "Heading": (heading_deg % 360.0).round(2), "ROT deg/min": (60.0 * rate_dps).round(2),
        "Speed ahead kn": round(_SPEED_MPS / _KNOT_MPS, 2), "Speed to starboard kn": 0.0,
        "Wind from": 270.0, "Wind kn": 10.0, "Shaft rpm": 160.0, "Rudder": (10.0 * np.cos(phase)).round(1),
    }).to_csv(index=False)  # fmt: skip
