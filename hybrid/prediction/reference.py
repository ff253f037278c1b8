"""The reference model of recordings, whichever it is: a vessel file's plant, or a simulator of another make.

Both answer the same calls (:func:`.simulate_batch`, :func:`.filtered_starts`), so that what is predicted with one
is predicted with the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from seatrial.acquisition.core.result import ChosenModel
from seatrial.hybrid.effects import simulators, vessel_plant
from seatrial.hybrid.vessel import black_box, files

VesselChoice = files.Vessel | black_box.BlackBox | str | Path
"""What may stand for a reference model: a vessel or simulator, or its name or file."""


@dataclass(frozen=True, slots=True)
class ChosenReference:
    """A reference model, where it comes from, and how it was chosen.

    ``file`` is the name of one of Seatrial's own or a path, and means the same from any folder. ``ship`` is the
    vessel file of the model, None of a simulator.
    """

    model: black_box.MotionModel
    file: str
    choice: ChosenModel
    ship: files.Vessel | None = None

    @property
    def file_or_simulator(self) -> files.Vessel | black_box.BlackBox:
        """The vessel file, or the simulator."""
        if self.ship is not None:
            return self.ship
        assert isinstance(self.model, black_box.BlackBox)
        return self.model


def load_model(vessel: VesselChoice | None) -> black_box.MotionModel:
    """The model of a vessel with the effects of its file, or a simulator. Raises :class:`ConfigurationError`."""
    simulator = simulators.simulator_of(vessel)
    return vessel_plant(files.load_vessel(_no_simulator(vessel))) if simulator is None else simulator


def choose_reference(trials: files.Trials, vessel: VesselChoice | None = None) -> ChosenReference:
    """The model of recordings: ``vessel``, else that of the ship that they name (:func:`.reference_model`).

    Raises :class:`InputError` where no ship is named or its file is not there, :class:`ConfigurationError` for a
    model that cannot be used.
    """
    simulator = simulators.simulator_of(vessel)
    if simulator is None:
        chosen = files.reference_model(trials, _no_simulator(vessel))
        return ChosenReference(vessel_plant(chosen.vessel), chosen.file, chosen.choice, chosen.vessel)
    name = f"{simulator.name} ({Path(simulator.file).name})"
    ships = {simulator.name, Path(simulator.file.rpartition(":")[0] or simulator.file).stem}
    return ChosenReference(simulator, simulator.file, files.chosen_model(name, ships, trials))


def _no_simulator(vessel: VesselChoice | None) -> files.Vessel | str | Path | None:
    assert not isinstance(vessel, black_box.BlackBox)
    return vessel
