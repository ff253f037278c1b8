"""What a ship's buses and lines carry, and a configuration that records it: places, listening, the proposal."""

from seatrial.acquisition.core import can_library  # noqa: F401 - before all modules that import python-can
