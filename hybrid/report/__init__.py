"""What a reader sees: errors, residuals and coverage of a trial, their figures, pages and notebooks."""
