"""Simulated trials with everything that the reference model leaves out: seas, gusts, actuators, sensors."""
