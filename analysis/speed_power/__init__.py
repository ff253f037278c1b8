"""Speed and power from runs over ground: current, wind, waves and water taken out, as ISO 15016 does."""
