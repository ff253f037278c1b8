"""Linear estimation: process models, Kalman filter and smoother, maximum-likelihood noise levels, ship motion."""
