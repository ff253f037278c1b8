"""The mirror image of the logger: a recording back onto buses and lines."""
