"""``seatrial migrate``: a recording whose messages are JSON as one whose messages are protobuf.

Everything else is copied as it is: what others recorded, metadata, attachments, times and numbers of messages.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from mcap import records as mcap
from mcap.writer import Writer

from acquisition.core.channel import Channel
from acquisition.core.channels import channels_known_to
from acquisition.core.errors import InputError
from acquisition.core.progress import Progress
from acquisition.recording.messages import ENCODING, ENCODING_BEFORE, Topic, decode, encode
from acquisition.recording.reader import REMEDY, read_trial
from acquisition.recording.recover import Definitions, Saving, copy_intact
from acquisition.recording.schemas import channel_metadata, kind_of


class Migration(Saving):
    """Copies records, our messages in JSON as protobuf: ``converted`` counts them by topic.

    ``kept`` are those that fit no schema of today; they stay JSON, and are read as such.
    """

    def __init__(self, writer: Writer, definitions: Definitions, known: Mapping[str, Channel]) -> None:
        self.converted: Counter[str] = Counter()
        self.kept: Counter[str] = Counter()
        self._known = known
        self._numbers: dict[str, int] = {}
        self._kinds: dict[str, int] = {}
        super().__init__(writer, definitions)

    def keep_topic(self, channel: mcap.Channel) -> None:
        if not self._define(channel):
            super().keep_topic(channel)

    def take_message(self, message: mcap.Message) -> None:
        channel = self.definitions.find(mcap.Channel, message.channel_id)
        number = None if channel is None else self._define(channel)
        if channel is None or number is None:
            super().take_message(message)
            return
        try:
            data = encode(channel.topic, decode(Topic(channel.topic, ENCODING_BEFORE), message.data))
        except (KeyError, TypeError, ValueError, OverflowError):
            self.kept[channel.topic] += 1
            super().take_message(message)
        else:
            self.converted[channel.topic] += 1
            self.add(replace(message, data=data), number, channel.topic)

    def _define(self, channel: mcap.Channel) -> int | None:
        """The copy's number of one of our topics in JSON; None for any other channel."""
        topic = channel.topic
        if channel.message_encoding != ENCODING_BEFORE:
            return None
        if topic not in self._numbers:
            try:
                kind, metadata = kind_of(topic), channel_metadata(topic, self._known)
            except (KeyError, IndexError):
                return None
            if kind.title not in self._kinds:
                self._kinds[kind.title] = self.writer.register_schema(kind.title, ENCODING, kind.descriptors)
            number = self.writer.register_channel(topic, ENCODING, self._kinds[kind.title], metadata)
            self._numbers[topic] = number
        return self._numbers[topic]


def migrate(source: Path, target: Path, progress: Progress = lambda share: None) -> Migration:
    """Write the recording ``source`` anew as ``target``, with messages as they are recorded today.

    ``progress`` takes the share done. Raises :class:`InputError` for a damaged recording and for one that has no
    messages in JSON, :class:`StorageError` when ``target`` exists, cannot be written, or does not read back as it
    was written. ``source`` is only read.
    """
    known = channels_known_to(read_trial(source))
    return copy_intact(source, target, lambda writer, found: Migration(writer, found, known), _check, progress)


def _check(migrated: Migration, source: Path) -> None:
    if migrated.found.damaged_chunks or migrated.found.lost_bytes:
        raise InputError("is damaged", where=str(source), why=migrated.found.reasons, fix=f"first {REMEDY}")
    if not migrated.converted:
        why = f"{migrated.found.messages:,} messages, none of ours in JSON"
        raise InputError("has nothing to migrate", where=str(source), why=why, fix="use it as it is")
