"""A propeller of controllable pitch on a fixed shaft. Controls: shaft [rev/s] and pitch [full ahead = 1].

Its force is that of :mod:`.propeller`, where ``k_0`` goes with the pitch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from pydantic import StrictFloat as Number

from seatrial.acquisition.core.quantities import Floats
from seatrial.analysis.compiling import Record, compiled
from seatrial.hybrid.vessel.actuators import RPM_PER_RPS, Drive, propeller


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllablePropellerEntry(propeller.Blades):
    """A propeller of controllable pitch in a vessel file; the coefficients are those of its full pitch ahead."""

    kind: Literal["controllable_propeller"]
    pitch_lag_s: Number


@compiled
def fill_work(p: Record, row: Floats, control: Floats, first: int, work: Floats) -> None:
    """How a controllable propeller's shaft turns, and its pitch, while ``control`` holds."""
    work[propeller.SHAFT_RPS], work[propeller.PITCH] = propeller.shaft_speed(control[first]), control[first + 1]


def drives(entry: ControllablePropellerEntry) -> tuple[Drive, Drive]:
    """How the shaft [rev/s] and the pitch [1] follow their orders."""
    return (*propeller.drives(entry), Drive(entry.pitch_lag_s, limit=1.0))


DEFINITION = replace(
    propeller.DEFINITION, entry=ControllablePropellerEntry, labels=("rps", "pitch"),
    units=(1.0 / RPM_PER_RPS, 0.01), angles=(False, False), drives=drives, fill_work=fill_work, still=(0.05, 0.02),
    alike=(0.3, 0.05),
)  # fmt: skip
