"""Linear estimation, once: process models, Kalman filter and smoother, noise levels by likelihood, the motion."""
