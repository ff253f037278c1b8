"""The ship's data sheet: the numbers of a vessel file, and what hidden effects add to them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

from seatrial.acquisition.core.errors import ConfigurationError

VESSELS = Path(__file__).parents[3] / "trials" / "vessels"


@dataclass(slots=True)
class Sheet:
    """The vessel file's numbers by section, and slots of effects, which are neutral as they stand here."""

    numbers: dict[str, Any]
    # the water and what it does to the hull
    hull_growth: dict[str, float] = field(default_factory=dict)  # of whole derivatives, by water depth
    added_mass_growth: tuple[float, float] = (1.0, 1.0)  # sway, yaw
    current_mps: list[float] = field(default_factory=lambda: [0.0, 0.0])  # north, east
    drift_n: list[float] = field(default_factory=lambda: [0.0, 0.0])  # size, direction it goes to [rad]
    steady_force: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # X, Y [N], N [N m]
    dies_out_ps: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # surge, sway, yaw near rest [1/s]
    # port and starboard pod
    pod_share: list[float] = field(default_factory=lambda: [1.0, 1.0])
    pod_offset_rad: list[float] = field(default_factory=lambda: [0.0, 0.0])
    azimuth_factor: float = 1.0
    pod_astern: list[float] = field(default_factory=lambda: [1.0, 1.0])  # of the thrust of a shaft turning astern
    pod_play_rad: list[float] = field(default_factory=lambda: [0.0, 0.0])
    tunnel_half_speed_mps: float = inf  # ahead, at which half of its side force is left
    lag_s: float = 0.0
    # sensors: reported = factor x true + bias, late by the delay
    command_delay_s: float = 0.0
    position_delay_s: float = 0.0
    antenna_m: list[float] = field(default_factory=lambda: [0.0, 0.0])  # forward, starboard
    heading_delay_s: float = 0.0
    heading_bias_rad: float = 0.0
    speed_delay_s: float = 0.0
    speed_point_m: list[float] = field(default_factory=lambda: [0.0, 0.0])  # forward, starboard
    speed_turned_rad: float = 0.0
    speed_factor: float = 1.0
    sway_bias_mps: float = 0.0
    yaw_rate_factor: float = 1.0
    yaw_rate_bias_radps: float = 0.0
    vane_bias_rad: float = 0.0
    wind_speed_factor: float = 1.0


def vessel_sheet(vessel: str) -> Sheet:
    """The sheet of ``trials/vessels/<vessel>.toml``. Raises :class:`ConfigurationError` where there is none."""
    path = VESSELS / f"{vessel}.toml"
    if not path.is_file():
        raise ConfigurationError(f"no vessel {vessel!r}", fix=f"put its file into {VESSELS}")
    return Sheet(_by_parts(tomllib.loads(path.read_text(encoding="utf-8"))))


def _by_parts(tree: dict[str, Any]) -> dict[str, Any]:
    """The file's numbers as this ship's equations take them: the hull by axes, the two pods as one, the tunnel."""
    hull, actuators = tree.pop("hull"), {each["name"]: each for each in tree.pop("actuator")}
    for part, axis in (("surge", "X"), ("sway", "Y"), ("yaw", "N")):
        tree[part] = {name: value for name, value in hull.items() if name.startswith(axis)}
    places = {f"{side}_{axis}_m": actuators[side][f"{axis}_m"] for side in ("port", "starboard") for axis in "xy"}
    port = actuators["port"]
    tree["pods"] = {**port, **places, "diameter_m": port["propeller_diameter_m"]}
    tree["tunnel"] = actuators["tunnel"]
    return tree
