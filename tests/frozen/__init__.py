"""What the program said of the same input before its house was rebuilt, and whether it still does."""
