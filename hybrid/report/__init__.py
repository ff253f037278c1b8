"""What a reader gets to see: errors, residuals and coverage of a trial, their pictures, and the notebooks of
them."""
