"""A twin aboard: beside the recorder it says where the ship will be, and how far off it was before."""
