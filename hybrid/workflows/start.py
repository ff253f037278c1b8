"""``seatrial init``: a folder for the trials of a ship, in which recording and importing work at once."""

from __future__ import annotations

import json
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
from pydantic import TypeAdapter
from pymap3d import ned2geodetic

from seatrial.acquisition.config.declarations import find_vessel, vessel_names
from seatrial.acquisition.config.sources import UdpSource
from seatrial.acquisition.config.trial_file import possible_channels
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.ship import VESSELS, Actuators, Channel, control_channels
from seatrial.acquisition.recording.parts import safe_name
from seatrial.acquisition.tables.import_table import refuse_overwriting
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from seatrial.hybrid.vessel.estimate.new_vessel import NewVessel
from seatrial.hybrid.vessel.files import load_vessel, save_vessel
from seatrial.hybrid.vessel.parameters import Vessel

TEMPLATES = VESSELS.parent / "start"
_CONTROLS = "# CONTROLS\n"
_KNOT_MPS = 1852.0 / 3600.0
_EXAMPLE_S, _PLACE_DEG = 420.0, (63.44, 10.4)


def start_folder(
    folder: Path, vessel: NewVessel | str | Path, name: str = "", *, force: bool = False
) -> list[Path]:
    """Write a ship's ``vessel.toml``, ``trial.toml``, ``columns.toml`` and ``example.csv`` into a folder.

    Parameters
    ----------
    folder
        Made if it does not exist.
    vessel
        The ship: estimated from main dimensions, or a vessel's name or file. A ship that comes with Seatrial, and a
        ``vessel.toml`` that is in the folder already, are not written.
    name
        What the trial is called; by default as the folder.
    force
        Whether files that exist are replaced.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        For a file that exists, without ``force``.
    ConfigurationError
        For a vessel file at fault, and for a ship of one's own with the name of one in Seatrial.
    StorageError
        For a folder that cannot be written to.
    """
    name = safe_name(name or folder.resolve().name)
    ship, text = _ship_of(vessel, folder)
    texts = {} if text is None else {"vessel.toml": text}
    texts["trial.toml"] = _filled("trial.toml", name, ship, _listed(ship))
    texts["columns.toml"] = _filled("columns.toml", name, ship, _mapped(ship.actuators))
    for file in (*texts, "example.csv"):
        refuse_overwriting(folder / file, force)
    texts["example.csv"] = _example_table(ship)
    with written_together(folder / "trial.toml"):
        return [write_text(folder / file, text) for file, text in texts.items()]


def _ship_of(vessel: NewVessel | str | Path, folder: Path) -> tuple[Vessel, str | None]:
    """The ship, and the text of its vessel file; None where that need not be written."""
    with TemporaryDirectory(prefix="seatrial-init-") as scratch:
        copy = Path(scratch) / "vessel.toml"
        if isinstance(vessel, NewVessel):
            vessel.save(copy)
            ship, exists = load_vessel(copy), False
        else:
            file = find_vessel(vessel)
            ship = load_vessel(file)
            if file.parent == VESSELS:
                return ship, None
            save_vessel(ship, copy)
            exists = file.resolve() == (folder / "vessel.toml").resolve()
        if ship.name in vessel_names():
            fix = "give yours another one with --name, or in its vessel file"
            raise ConfigurationError(f"{ship.name} is the name of a ship in Seatrial", fix=fix)
        return ship, None if exists else copy.read_text(encoding="utf-8")


def _filled(file: str, name: str, ship: Vessel, controls: str) -> str:
    """A template with the names and the controls in their places."""
    words = {"NAME": name, "SHIP": json.dumps(ship.name)[1:-1], _CONTROLS: controls}
    template = (TEMPLATES / file).read_text(encoding="utf-8")
    return re.sub("|".join(words), lambda match: words[match[0]], template)


def _listed(ship: Vessel) -> str:
    """The controls as the list of a source of sentences has them; those that no sentence carries as a comment."""
    settings = {"name": "bridge", "type": "udp", "port": 10110, "channels": ()}
    possible = possible_channels(TypeAdapter(UdpSource).validate_python(settings), ship.actuators)
    names = [channel.name for channel in control_channels(ship.actuators)]
    rows = [f'"{name}",' if name in possible else f'# "{name}": no sentence carries it' for name in names]
    return "".join(f"{row}\n  " for row in rows)[:-2]


def _mapped(actuators: Actuators) -> str:
    """The controls as a column map has them."""
    return "".join(
        f'{channel.name:<18} = {{ column = "{_title(channel)}", unit = "{channel.unit}" }}\n'
        for channel in control_channels(actuators)
    )


def _title(channel: Channel) -> str:
    """A control as a column of a table is called: ``Port pitch %``."""
    words = channel.name.rpartition("_")[0].replace("_", " ").capitalize()
    return f"{words} {channel.unit}"


def _example_table(vessel: Vessel) -> str:
    """A 10/10 zigzag of the ship in a calm sea, by sensors so good that its columns agree by eye."""
    table, _ = simulate_trial(vessel, "calm", "zigzag_10_10", _EXAMPLE_S, 1.0, noise=SimulationNoise().scaled(0.1))
    lat, lon, _ = ned2geodetic(table["north_m"], table["east_m"], 0.0, *_PLACE_DEG, 0.0)
    knots = table[["surge_mps", "sway_mps", "wind_speed_mps"]] / _KNOT_MPS
    return pd.DataFrame({
        "Time UTC": pd.DatetimeIndex(table.index).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "Lat": lat.round(7), "Lon": lon.round(7),
        "Heading": table["heading_deg"].round(2), "ROT deg/min": (60.0 * table["yaw_rate_dps"]).round(2),
        "Speed ahead kn": knots["surge_mps"].round(2), "Speed to starboard kn": knots["sway_mps"].round(2),
        "Wind from": table["wind_direction_deg"].round(1), "Wind kn": knots["wind_speed_mps"].round(1),
        **{_title(each): table[each.name].round(1) for each in control_channels(vessel.actuators)},
    }).to_csv(index=False)  # fmt: skip
