"""The commands of the model. They parse, call and print; nothing else."""

from hybrid.cli.model import mount

__all__ = ["mount"]
