"""A season of recordings: what is made of one, of many on worker processes, and one index over all."""
