"""Manoeuvres found in a table of channels, and the indices that describe a ship by them."""

from seatrial.analysis.manoeuvres.find import find_manoeuvres, manoeuvres_and_left_out
from seatrial.analysis.manoeuvres.indices import Current, Index, LeftOut, Manoeuvre, as_json

__all__ = ["Current", "Index", "LeftOut", "Manoeuvre", "as_json", "find_manoeuvres", "manoeuvres_and_left_out"]
