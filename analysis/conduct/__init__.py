"""A programme of trials, sailed run by run: what comes next, whether it may begin, and whether it was valid."""
