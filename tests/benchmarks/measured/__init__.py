"""Effects hidden in measured data: a term taken out of a good model, or an error put into the record."""
