"""Where a simulation and a trial disagree, which effect the model lacks, and the model with it added."""
