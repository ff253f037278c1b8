"""A small ship of another make, as a Python class and as FMUs of both standards."""
