"""Shared by all of Seatrial: angles, units, channels, errors, frames and samples, progress."""
