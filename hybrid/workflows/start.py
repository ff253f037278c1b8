"""``seatrial init``: a folder for the trials of a ship, in which recording and importing work at once."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
from pymap3d import ned2geodetic

from acquisition.config.vessel_file import vessel_names
from acquisition.core.actuators import VESSELS
from acquisition.core.errors import ConfigurationError
from acquisition.core.files import write_text, written_together
from acquisition.recording.parts import safe_name
from acquisition.tables.import_table import refuse_overwriting
from hybrid.simulation.trial import Noise, simulate_trial
from hybrid.vessel.estimate.new_vessel import new_vessel
from hybrid.vessel.files import load_vessel
from hybrid.vessel.parameters import Vessel

TEMPLATES = VESSELS.parent / "start"
_KNOT_MPS = 1852.0 / 3600.0
_EXAMPLE_S, _PLACE_DEG = 420.0, (63.44, 10.4)
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
    texts = {"vessel.toml": _HEADER.format(name=name) + _example_ship(name)}
    for each in ("trial.toml", "columns.toml"):
        texts[each] = (TEMPLATES / each).read_text(encoding="utf-8").replace("NAME", name)
    for each in (*texts, "example.csv"):
        refuse_overwriting(folder / each, force)
    with TemporaryDirectory(prefix="seatrial-init-") as scratch:
        ship = load_vessel(write_text(Path(scratch) / "vessel.toml", texts["vessel.toml"]))
    texts["example.csv"] = _example_table(ship)
    with written_together(folder / "vessel.toml"):
        return [write_text(folder / file, text) for file, text in texts.items()]


def _example_ship(name: str) -> str:
    return new_vessel(
        name=name, length_m=82.0, beam_m=12.5, draught_m=5.2, block=0.74, service_speed_mps=6.2,
        propellers=["propeller, diameter=3.1"], rudders=["rudder, area=9.5"],
    ).text  # fmt: skip


def _example_table(vessel: Vessel) -> str:
    """A 10/10 zigzag of the example ship in a calm sea, by sensors so good that its columns agree by eye."""
    table, _ = simulate_trial(vessel, "calm", "zigzag_10_10", _EXAMPLE_S, 1.0, noise=Noise().scaled(0.1))
    lat, lon, _ = ned2geodetic(table["north_m"], table["east_m"], 0.0, *_PLACE_DEG, 0.0)
    knots = table[["surge_mps", "sway_mps", "wind_speed_mps"]] / _KNOT_MPS
    return pd.DataFrame({
        "Time UTC": pd.DatetimeIndex(table.index).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "Lat": lat.round(7), "Lon": lon.round(7),
        "Heading": table["heading_deg"].round(2), "ROT deg/min": (60.0 * table["yaw_rate_dps"]).round(2),
        "Speed ahead kn": knots["surge_mps"].round(2), "Speed to starboard kn": knots["sway_mps"].round(2),
        "Wind from": table["wind_direction_deg"].round(1), "Wind kn": knots["wind_speed_mps"].round(1),
        "Shaft rpm": table["propeller_rpm"].round(1), "Rudder": table["rudder_angle_deg"].round(1),
    }).to_csv(index=False)  # fmt: skip
