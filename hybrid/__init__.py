"""The simulation model, the trained calibrator on top of it, and what both are worth."""
