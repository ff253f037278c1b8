"""What a file said of its trial at its very beginning, before any fix could become the origin.

The run sheet's last word holds for a reader; whoever decodes anew begins with the first.
"""

from __future__ import annotations

from pathlib import Path

from mcap.records import Metadata

from acquisition.core.trial import Trial
from acquisition.recording.reader import open_recording
from acquisition.recording.scan import Damage, scan


def trial_at_beginning(path: Path) -> Trial:
    """The first run sheet in the file; empty if damage or the end comes before it. Raises :class:`InputError`."""
    with open_recording(path) as stream:
        for found in scan(stream):
            if isinstance(found, Damage):
                break
            if isinstance(found.record, Metadata) and found.record.name == "trial":
                return Trial.from_metadata(found.record.metadata)
    return Trial()
