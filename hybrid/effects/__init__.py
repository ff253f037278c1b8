"""The catalogue of effects that a model may lack: what each is, and what it does to a plant."""

from seatrial.hybrid.effects.catalogue import (
    CATALOGUE,
    Catalogue,
    apply_effects,
    catalogue_with,
    load_effects,
    parse_effect,
    vessel_plant,
)
from seatrial.hybrid.vessel.effect import FAMILIES, Effect, Parameter

__all__ = [
    "CATALOGUE",
    "FAMILIES",
    "Catalogue",
    "Effect",
    "Parameter",
    "apply_effects",
    "catalogue_with",
    "load_effects",
    "parse_effect",
    "vessel_plant",
]
