"""Speed and power from runs over ground: current, wind, waves and water taken out, as ISO 15016 does."""

from seatrial.acquisition.config.run_sheet import Conditions
from seatrial.analysis.speed_power.analysis import SpeedPower, speed_power, speed_power_of_runs
from seatrial.analysis.speed_power.runs import PowerRun, power_columns, power_runs

__all__ = [
    "Conditions",
    "PowerRun",
    "SpeedPower",
    "power_columns",
    "power_runs",
    "speed_power",
    "speed_power_of_runs",
]
