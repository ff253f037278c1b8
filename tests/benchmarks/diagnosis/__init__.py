"""The blind benchmark of the diagnosis: trials with hidden effects, what the diagnosis made of them, the scores."""
