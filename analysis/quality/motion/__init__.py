"""Position, heading, speeds and yaw rate against each other: whether they tell of one motion."""
