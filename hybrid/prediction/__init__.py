"""Predictions without training: windows as arrays, baselines, scores, prediction regions."""
