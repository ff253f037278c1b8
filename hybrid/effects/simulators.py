"""Simulators as users name them: their own file, or one that names it and the effects that were added to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import FiniteFloat

from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.files import load_toml, write_text
from seatrial.hybrid.effects import simulator_with
from seatrial.hybrid.vessel.black_box import BlackBox, bare_simulator
from seatrial.hybrid.vessel.files import is_simulator, names_simulator, tree_as_toml


def load_simulator(name: str | Path) -> BlackBox:
    """The simulator of ``FILE.fmu`` or ``FILE.py:CLASS``, with the map beside it.

    Parameters
    ----------
    name
        The FMU (FMI 2.0 or 3.0, co-simulation), or a class with ``step`` of a Python file, which is executed; or
        the file that a diagnosis wrote, which names one.

    Returns
    -------
    BlackBox
        The simulator, which stands wherever predictions of a model are asked for.

    Raises
    ------
    ConfigurationError
        For a simulator or map that cannot be used, naming file, line and key.

    Notes
    -----
    docs/own_simulator.md describes the class and the map.

    Examples
    --------
    >>> import pathlib, seatrial as st
    >>> size = pathlib.Path("sliding.py").write_text('''
    ... class Sliding:
    ...     length_m = 30.0
    ...     actuators = {"propeller": "propeller"}
    ...
    ...     def step(self, state, controls, wind, dt_s):
    ...         north, east, heading, surge, sway, yaw_rate = state
    ...         return [north + dt_s * surge, east, heading, surge, sway, yaw_rate]
    ... ''')
    >>> st.load_simulator("sliding.py:Sliding").name
    'Sliding'
    """
    text = str(name)
    if not is_simulator(text):
        raise ConfigurationError(f"{text!r} is no simulator", fix="give FILE.fmu, or FILE.py:CLASS")
    if names_simulator(Path(text)):
        return _simulator_with_effects(Path(text))
    return bare_simulator(text)


@dataclass(frozen=True, slots=True)
class SimulatorFile:
    """The file of a simulator with effects added: its own file, of which ``sha256`` is the fingerprint, and what a
    diagnosis found."""

    simulator: str
    sha256: str = ""
    effects: dict[str, dict[str, FiniteFloat]] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)


SimulatorFile.__pydantic_config__ = {"extra": "forbid"}  # type: ignore[attr-defined]


def _simulator_with_effects(path: Path) -> BlackBox:
    """The simulator of a file that names one. Raises :class:`ConfigurationError` also where that has changed."""
    stored = load_toml(path, SimulatorFile)
    if names_simulator(Path(stored.simulator)):
        raise ConfigurationError("names another such file", where=str(path), fix="name FILE.fmu or FILE.py:CLASS")
    model = bare_simulator(path.parent / stored.simulator)
    if stored.sha256 and stored.sha256 != model.digest:
        raise ConfigurationError(
            "was written for another version of its simulator or map", where=str(path), why=f"{model.file} differs",
            fix="diagnose again, or delete sha256 if what it adds still holds",
        )  # fmt: skip
    try:
        return replace(simulator_with(model, stored.effects), file=str(path.resolve()))
    except ConfigurationError as error:
        raise error.at(f"{path}, [effects]") from error


def save_simulator(model: BlackBox, path: Path, provenance: Mapping[str, Any]) -> None:
    """Write a simulator and the effects added to it as a file that ``--vessel`` takes."""
    effects = {name: dict(values) for name, values in model.effects.items()}
    stored = {"simulator": model.spec.source, "sha256": model.digest, "effects": effects, "provenance": provenance}
    write_text(path, tree_as_toml({key: value for key, value in stored.items() if value}))


def simulator_of(vessel: object) -> BlackBox | None:
    """The simulator that a choice of a model is or names, None for a vessel or its file. Raises
    :class:`ConfigurationError`."""
    if isinstance(vessel, BlackBox):
        return vessel
    return load_simulator(vessel) if isinstance(vessel, str | Path) and is_simulator(vessel) else None
