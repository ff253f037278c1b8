"""A season of recordings as pages on this computer: a live view of what a batch makes."""
