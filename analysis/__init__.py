"""Recording to table, table to one trustworthy row a second, rows to held windows."""
