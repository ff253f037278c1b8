"""Wire to recording: sources, protocols, the recorder, and the MCAP recording."""
