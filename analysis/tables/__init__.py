"""A recording as a table, resampled, exported, with its provenance."""
