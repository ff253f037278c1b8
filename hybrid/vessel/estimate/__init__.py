"""A vessel's numbers from what its owner knows: published regressions, each with its source, range and usual error.

Pure functions of the main particulars; :mod:`.new_vessel` puts them together to a vessel file. The regressions,
their ranges and how well they do on two published ships are in docs/theory/estimates.md.
"""
