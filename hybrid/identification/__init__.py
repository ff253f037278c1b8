"""A model's coefficients from trials: what the data say of each, with its error, and what they do not say."""
