"""Position, heading, speeds and yaw rate against each other: whether they are consistent with one motion."""
