"""The model with the named effects added, as a vessel file that every command runs, with its provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hybrid.diagnosis.result import Diagnosis
from hybrid.vessel.files import with_effects
from hybrid.vessel.parameters import Vessel


def repaired(vessel: Vessel, diagnosis: Diagnosis) -> Vessel:
    """``vessel`` with what was named, and where that comes from.

    A named effect that the vessel has already takes that one's place: its value is what both come to.
    """
    effects = {
        each.name: {name: estimate.value for name, estimate in each.parameters.items()}
        for each in diagnosis.effects
    }
    notes = {
        f"diagnosis_{each.name}": "; ".join(
            f"{name} {estimate.value:.6g} ({estimate.low:.6g} to {estimate.high:.6g}) {estimate.unit}"
            for name, estimate in each.parameters.items()
        )
        for each in diagnosis.effects
    }
    result = with_effects(vessel, effects, **_plain(diagnosis.provenance), **notes, verdict=diagnosis.verdict)
    return replace(result, name=f"{vessel.name}_diagnosed", description=_description(vessel, diagnosis))


def _description(vessel: Vessel, diagnosis: Diagnosis) -> str:
    named = ", ".join(each.name for each in diagnosis.effects) or "nothing"
    return f"{vessel.description or vessel.name}; a diagnosis added {named}"


def _plain(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """What a TOML table may hold: texts and numbers."""
    return {
        f"diagnosis_{key}": value if isinstance(value, int | float) else str(value)
        for key, value in provenance.items()
    }
