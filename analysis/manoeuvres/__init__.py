"""Manoeuvres found in a table of the 13 channels, and the indices that describe a ship by them."""

from analysis.manoeuvres.find import find_manoeuvres
from analysis.manoeuvres.indices import Current, Index, Manoeuvre, as_json

__all__ = ["Current", "Index", "Manoeuvre", "as_json", "find_manoeuvres"]
