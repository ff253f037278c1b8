"""Comparison of methods on recordings, by cross-validation."""
