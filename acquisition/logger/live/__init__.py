"""What the crew sees while a recording runs."""
