"""Foreign tables to recordings: files as they are, through a column map, to channels."""
