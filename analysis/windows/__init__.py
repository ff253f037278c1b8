"""Held windows: stretches of a recording in which the actuators were held."""
