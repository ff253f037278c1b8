"""A batch of recordings: what is computed for one, for many on worker processes, and one index over all."""
