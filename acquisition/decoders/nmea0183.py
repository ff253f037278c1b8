"""NMEA 0183: lines to samples. No sentence without a sound checksum; what each says is in ``sentences.py``."""

from __future__ import annotations

import re
from collections import Counter, deque
from typing import Literal

from acquisition.config.sections import Clock, Thrusters
from acquisition.core.frames import Frame, Group
from acquisition.decoders import Notices
from acquisition.decoders.clock import SourceClock, nearest_day, utc_ns
from acquisition.decoders.fields import Fields
from acquisition.decoders.sentences import Reading, readers
from acquisition.decoders.tag_block import TaggedSentence, checksum, split_tag

__all__ = ["Nmea0183Decoder", "checksum", "split_sentence"]

_SENTENCE = re.compile(rb"[$!]([\x20-\x7e]{3,})\*([0-9A-Fa-f]{2})")


def split_sentence(line: bytes) -> tuple[str, list[str]] | None:
    """The tag without its dollar sign and the fields of a sound sentence; None for anything else."""
    found = _SENTENCE.fullmatch(line)
    if found is None or int(found[2], 16) != checksum(found[1]):
        return None
    tag, *fields = found[1].decode("ascii").split(",")
    return tag, fields


class Nmea0183Decoder:
    """One line; the date comes from ZDA, RMC or TAG blocks, as position sentences tell only the time of day."""

    def __init__(
        self,
        thrusters: Thrusters | None = None,
        stamps: Clock = "receiver",
        theoretical_wind: Literal["ground", "water"] = "ground",
    ) -> None:
        self.refused: Counter[str] = Counter()
        self.notices: Notices = deque()
        self.clock = SourceClock(stamps, "nmea0183 ZDA, RMC or TAG", self.notices)
        self._readers = readers(thrusters or Thrusters(), theoretical_wind)

    def decode(self, frame: Frame) -> list[Group]:
        tagged = split_tag(frame.payload)
        sentence = split_sentence(tagged.sentence)
        if not tagged.sound:
            self.refused["TAG block with a wrong checksum"] += 1
        if sentence is None:
            self.refused["no sound checksum"] += 1
            return []
        if tagged.time_ns is not None:  # which is then this sentence's time too, unless it tells its own
            self.clock.announce(tagged.time_ns, frame)
        tag, fields = sentence
        talker, kind = tag[:-3], tag[-3:]
        if kind not in self._readers or tag.startswith("P") or not tag.isalnum():  # P: a maker's own
            return []
        reading = self._readers[kind](Fields(fields))
        told_ns = self._told_ns(reading, frame)
        label = _label(frame.origin, talker, kind, tagged, reading)
        self._count(reading)
        return self.clock.group(frame, label, reading.values, told_ns, reading.quality)

    def _count(self, reading: Reading) -> None:
        if reading.refused or not (reading.values or reading.date):
            self.refused[reading.refused or "no value"] += 1

    def _told_ns(self, reading: Reading, frame: Frame) -> int | None:
        """When the sentence says its values were true; what tells the date too also sets the line's clock."""
        if reading.seconds_of_day is None:
            return None
        if reading.date is not None:
            told_ns = utc_ns(reading.date, reading.seconds_of_day)
            self.clock.announce(told_ns, frame)
            return told_ns
        now_ns = self.clock.at(frame)
        return None if now_ns is None else nearest_day(reading.seconds_of_day, now_ns)


def _label(origin: str, talker: str, kind: str, tagged: TaggedSentence, reading: Reading) -> str:
    """Who says it: line, talker, the device behind a gateway if it is named, sentence, meaning if it has several.

    ``line/II:MWV apparent``, ``line/GP@GN01:GGA``.
    """
    device = f"{talker}@{tagged.source}" if tagged.source else talker
    meaning = f" {reading.meaning}" if reading.meaning else ""
    return f"{origin}/{device}:{kind}{meaning}"
