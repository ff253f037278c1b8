"""Attacks on what docs/guarantees.md promises, by area; ``make attack`` runs all, ``make test`` the quick ones."""
