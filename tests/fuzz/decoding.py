"""What must hold of every frame that any decoder is given, whatever is in it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from seatrial.acquisition.core.ship import BY_NAME, Channel
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.logger.processing import Derivation
from seatrial.acquisition.protocols import Decoder


def check_frame(
    decoder: Decoder, derivation: Derivation, frame: Frame, known: Mapping[str, Channel] = BY_NAME
) -> None:
    """Decode a frame: no empty group, finite values, channel samples that their channels hold, counts that grow."""
    refused = decoder.refused.total()
    for group in decoder.decode(frame):
        assert group, "an empty group"
        assert all(math.isfinite(sample.value) for sample in group), group
        samples, impossible = derivation.derive_channels(group)
        assert impossible >= 0
        for sample in samples:
            assert known[sample.quantity].is_possible_value(sample.value), sample
            derivation.remember_channel_sample(sample)
    assert decoder.refused.total() >= refused
    decoder.notices.clear()
