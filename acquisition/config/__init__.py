"""A trial's TOML file: reading and checking; every error names the line to change."""
