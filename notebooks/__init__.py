"""Worked examples, as scripts that Jupyter opens as notebooks."""
