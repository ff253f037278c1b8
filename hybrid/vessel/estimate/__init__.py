"""A vessel's numbers from what its owner knows: published regressions (docs/theory/estimates.md)."""
