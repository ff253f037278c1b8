"""Manoeuvres found in a table of channels, and the indices that describe a ship by them."""
