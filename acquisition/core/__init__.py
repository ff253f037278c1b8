"""What all of Seatrial shares: angles, units, channels, errors, frames and samples, progress."""
