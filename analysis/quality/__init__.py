"""What is wrong with a recording: checks of one channel, checks across channels, repairs that are certain."""
