"""The recorder: threads and queues, selection of sources, maintenance, display and supervision."""
