"""Estimating a model's coefficients from trials, with their errors, and finding which the data do not
determine.
"""
