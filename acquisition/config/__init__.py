"""A trial's TOML file: read, checked, and every complaint names the line to change."""
