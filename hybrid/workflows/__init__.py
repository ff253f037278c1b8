"""The jobs behind the commands: train, validate, predict, diagnose, demo."""
