"""What a ship's buses and lines carry, and a configuration that records it: places, listening, the proposal."""
