"""The motion with its uncertainty: laws of motion, noise levels from the data, Kalman filter and smoother."""
