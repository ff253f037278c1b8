"""Pages and figures: they read results, nothing below knows them."""
