"""The MCAP recording: the only place that knows the file format."""
