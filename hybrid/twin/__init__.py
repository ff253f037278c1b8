"""A digital twin aboard: beside the recorder it predicts where the ship will be, and evaluates its earlier
predictions."""
