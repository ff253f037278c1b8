"""What each method is worth on recordings, judged on windows that it has not seen."""
