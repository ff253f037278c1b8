"""Wire to recording: sources, decoders, the pipeline that joins them, and the MCAP recording.

The way of a sample: ``sources`` -> ``decoders`` -> ``derive`` -> ``recording``, joined by ``pipeline``.
This package knows nothing of ``analysis`` and ``hybrid``.
"""
