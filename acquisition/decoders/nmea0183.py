r"""NMEA 0183: lines to samples. No sentence without a sound checksum; what each says is in ``sentences.py``.

Before a sentence may stand what a multiplexer or gateway says of it, a TAG block
(``\s:GN01,c:1795255200*hh\$GPGGA,...``), and the prefix that IEC 61162-450 puts before both in a datagram.

A line may hold anything else besides: the beginning of a sentence whose end was lost, noise, several sentences.
Each intact sentence in it is decoded (:func:`sentences_in`); the line itself is recorded as it came.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from operator import xor
from typing import Literal, NamedTuple

from seatrial.acquisition.config.declarations import SentenceField, Transducer
from seatrial.acquisition.config.sections import Clock, Thrusters
from seatrial.acquisition.core.actuators import DEFAULT, Actuators
from seatrial.acquisition.core.channel import Channel
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.frames import Fix, Frame, Group, safe_label, sensor_of
from seatrial.acquisition.core.units import Linear
from seatrial.acquisition.decoders import DeclaredReaders, Decoder, FurtherSenders
from seatrial.acquisition.decoders.clock import SourceClock, nearest_day, utc_ns
from seatrial.acquisition.decoders.interleaved import InterleavedSources
from seatrial.acquisition.decoders.receivers import Receivers
from seatrial.acquisition.decoders.sentences import Fields, SentenceReading, machinery_readers, readers

_DATAGRAM_PREFIX = b"UdPbC\0"
_TAG_BLOCK = re.compile(rb"\\([\x20-\x7e]*?)\*([0-9A-Fa-f]{2})\\")
_SECONDS = re.compile(r"(\d{1,10})(?:\.(\d{1,9}))?")
_MILLISECONDS = re.compile(r"\d{13}")
_MOST_SENSORS = 1_000  # whose fixes are kept: any talker and any source of a TAG block names one
_SENTENCE = re.compile(rb"[$!]{1,2}([\x20-\x7e]{3,})\*([0-9A-Fa-f]{2})")  # some devices say $$
_UNCHECKED = re.compile(rb"[$!]{1,2}([A-Za-z0-9]{5,16},[\x20-\x29\x2b-\x7e]*)")
NO_CHECKSUM = "comes without a checksum"
_LONGEST_TAG = 16  # letters; no maker's own is known that has more, and noise must not name devices without end
_ADDRESS = rb"[A-Za-z0-9]{3,%d}," % _LONGEST_TAG
_TEXT = rb" \x22#%-)+-\[\]-~"  # what is printable and neither begins nor ends a sentence or a TAG block
_EMBEDDED = re.compile(  # no sentence begins inside another: where one seems to, the other was cut
    rb"(?:\\[^\\]{1,200}\\)?[$!]{1,2}(?P<body>" + _ADDRESS + rb"(?:[" + _TEXT + rb"]|[$!](?!" + _ADDRESS + rb"))*+)"
    rb"\*(?P<sum>[0-9A-Fa-f]{2})"
)
_ALONE = re.compile(rb"(?:\\[^\\$!]{1,200}\\)?[$!][" + _TEXT + rb"]*+\*[0-9A-Fa-f]{2}")
"""Nearly every line: nothing but one sentence, of which only the sum is to be looked at."""
_WITH_A_FIX = frozenset({"VTG", "GST"})
"""Sentences that follow a position without repeating it."""
_LABEL = re.compile(rb"[\t" + _TEXT + rb"]{0,200}")


@dataclass(frozen=True, slots=True)
class TaggedSentence:
    """A sentence without its envelope, and what the envelope said; ``sound`` is False where that was spoilt."""

    sentence: bytes
    time_ns: int | None = None
    source: str = ""
    sound: bool = True


def checksum(body: bytes) -> int:
    """The exclusive or of the bytes before ``*``, the same for sentences and TAG blocks.

    >>> f"{checksum(b'RCTRD,3,-17.8,R,,V,'):02X}"
    '59'
    """
    return reduce(xor, body, 0)


def split_tag(line: bytes) -> TaggedSentence:
    r"""A line as its sentence with the TAG block's time (c:, UTC, ns since 1970) and source (s:).

    A block with a wrong checksum says nothing, but the sentence behind it has a checksum of its own.

    >>> split_tag(rb"\s:GN01,c:1795255200*3E\$HEHDT,12.3,T*1F")
    TaggedSentence(sentence=b'$HEHDT,12.3,T*1F', time_ns=1795255200000000000, source='GN01', sound=True)
    """
    line = line.removeprefix(_DATAGRAM_PREFIX)
    if not line.startswith(b"\\"):
        return TaggedSentence(line)
    match = _TAG_BLOCK.match(line)
    if match is None or int(match[2], 16) != checksum(match[1]):
        return TaggedSentence(line[line.rfind(b"\\") + 1 :], sound=False)
    items = dict(item.split(":", 1) for item in match[1].decode("ascii").split(",") if ":" in item)
    source = safe_label(items.get("s", ""))
    return TaggedSentence(line[match.end() :], unix_ns(items.get("c", "")), source)


def unix_ns(text: str) -> int | None:
    """Seconds or, with 13 digits, milliseconds since 1970 as ns; None for anything else.

    >>> unix_ns("1795255200.25") == unix_ns("1795255200250")
    True
    """
    if _MILLISECONDS.fullmatch(text):
        return int(text) * 1_000_000
    match = _SECONDS.fullmatch(text)
    if match is None:
        return None
    return int(match[1]) * 1_000_000_000 + int((match[2] or "").ljust(9, "0"))


def split_sentence(line: bytes, *, unchecked: bool = False) -> tuple[str, list[str]] | None:
    """The tag without its dollar sign and the fields of a sound sentence; None for anything else.

    ``unchecked`` takes a sentence without a checksum for sound.
    """
    match = _SENTENCE.fullmatch(line)
    if match is None and unchecked:
        match = _UNCHECKED.fullmatch(line)
    elif match is not None and int(match[2], 16) != checksum(match[1]):
        return None
    if match is None:
        return None
    tag, *fields = match[1].decode("ascii").split(",")
    return tag, fields


def sentences_in(line: bytes) -> list[bytes]:
    r"""The intact sentences of a line, each with its TAG block, and between them the parts that are none.

    A line in which no sentence stands apart is one part. A label, text around a sentence that could be no sentence
    itself (a time, a name), is left out.

    >>> sentences_in(rb"$HEHDT,1$HEHDT,12.3,T*1F")
    [b'$HEHDT,1', b'$HEHDT,12.3,T*1F']
    >>> sentences_in(rb"12:00:00 \s:GN01*75\$HEHDT,12.3,T*1F!AIVDM,1")
    [b'\\s:GN01*75\\$HEHDT,12.3,T*1F', b'!AIVDM,1']
    """
    line = line.removeprefix(_DATAGRAM_PREFIX)
    parts = [line] if _ALONE.fullmatch(line) else cut_at_sentences(line)
    return parts if len(parts) == 1 else [part for part in parts if not _LABEL.fullmatch(part)]


def cut_at_sentences(line: bytes) -> list[bytes]:
    """The line in parts, none of them empty: a sentence that is intact and stands apart is one of them."""
    parts, end = list[bytes](), 0
    for sentence in _EMBEDDED.finditer(line):
        if checksum(sentence["body"]) == int(sentence["sum"], 16):
            parts += [line[end : sentence.start()], sentence[0]]
            end = sentence.end()
    return [part for part in (*parts, line[end:]) if part]


def has_sentence(line: bytes, *, unchecked: bool = False) -> bool:
    """Whether there is an intact sentence in a line, by its checksum or, ``unchecked``, without one."""
    return any(
        split_sentence(split_tag(part).sentence, unchecked=unchecked) is not None for part in sentences_in(line)
    )


_ANY = "?"
"""Stands for a unit that XDR tells by a letter that is not in its table."""

_XDR_UNITS = {
    ("A", "D"): "deg", ("A", "R"): "rad", ("C", "C"): "degC", ("C", "K"): "K", ("C", "F"): "degF", ("D", "M"): "m",
    ("D", "I"): "in", ("F", "H"): "Hz", ("H", "P"): "%", ("I", "A"): "A", ("N", "N"): "N", ("P", "B"): "bar",
    ("P", "P"): "Pa", ("R", "L"): "l/s", ("T", "R"): "rpm", ("U", "V"): "V", ("V", "M"): "m3",
}  # fmt: skip
"""The units of XDR by the letters of the transducer's type and of the unit (gpsd's account of NMEA 0183)."""


class _Field(NamedTuple):
    """One field that carries a channel."""

    channel: Channel
    origin: SentenceField
    step: Linear

    def read(self, fields: Fields) -> SentenceReading:
        for place, wanted in self.origin.when.items():
            if fields.text(int(place) - 1) not in ((wanted,) if isinstance(wanted, str) else wanted):
                return SentenceReading()
        number = fields.number(self.origin.field - 1)
        seconds = None if self.origin.time is None else fields.seconds_of_day(self.origin.time - 1)
        values = [] if number is None else [(self.channel.name, self.step.apply(number))]
        return SentenceReading(values, seconds_of_day=seconds)


class _Transducer(NamedTuple):
    """One transducer that carries a channel; the steps by the unit that the sentence tells, "" where it tells none.

    XDR has four fields for each: type, value, unit, name.
    """

    channel: Channel
    name: str
    steps: Mapping[str, Linear]

    def read(self, fields: Fields) -> SentenceReading:
        for place in range(0, len(fields) - 3, 4):
            number, letter = fields.number(place + 1), fields.text(place + 2)
            if fields.text(place + 3) == self.name and number is not None:
                unit = _XDR_UNITS.get((fields.text(place), letter), letter and _ANY)
                step = self.steps.get(unit)
                if step is None:
                    return SentenceReading(refused="unit unknown")
                return SentenceReading([(self.channel.name, step.apply(number))])
        return SentenceReading()


def _steps(channel: Channel, origin: Transducer) -> dict[str, Linear]:
    """The step from each unit of XDR that measures what the channel does; from any, where the origin gives one."""
    if origin.unit is not None or origin.full_scale is not None:
        return dict.fromkeys(("", _ANY, *_XDR_UNITS.values()), origin.step_to(channel))
    steps = {"": origin.step_to(channel)}
    for unit in _XDR_UNITS.values():
        with suppress(ConfigurationError):
            steps[unit] = origin.step_to(channel, unit)
    return steps


class DeclaredSentences(DeclaredReaders[str, _Field | _Transducer]):
    """What sentences say of declared channels, by their letters."""

    def __init__(self, wanted: Sequence[tuple[Channel, SentenceField | Transducer]]) -> None:
        super().__init__()
        for channel, origin in wanted:
            if isinstance(origin, SentenceField):
                self.setdefault(origin.sentence, []).append(_Field(channel, origin, origin.step_to(channel)))
            else:
                transducer = _Transducer(channel, origin.transducer, _steps(channel, origin))
                self.setdefault("XDR", []).append(transducer)

    def read(self, kind: str, fields: Fields) -> SentenceReading:
        """What a sentence says; of several origins of one channel in it the first that has a value counts."""
        readings = [reader.read(fields) for reader in self[kind]]
        values = dict(value for reading in reversed(readings) for value in reading.values)
        seconds = next((reading.seconds_of_day for reading in readings if reading.seconds_of_day is not None), None)
        refused = next((reading.refused for reading in readings if reading.refused), "")
        return SentenceReading(list(values.items()), refused=refused, seconds_of_day=seconds)


class Nmea0183Decoder(Decoder):
    """One line; the date comes from ZDA, RMC or TAG blocks, as position sentences tell only the time of day."""

    def __init__(
        self,
        thrusters: Thrusters | None = None,
        stamps: Clock = "receiver",
        theoretical_wind: Literal["ground", "water"] = "ground",
        actuators: Actuators = DEFAULT,
        reduction_ratios: Mapping[str, float] | None = None,
        rated_rpm: Mapping[str, float] | None = None,
        *,
        declared: Sequence[tuple[Channel, SentenceField | Transducer]] = (),
        unchecked: bool = False,
    ) -> None:
        super().__init__()
        self._unchecked = unchecked
        self._tell_gga: set[str] = set()
        self._receivers = Receivers(self.notices)
        self._interleaved = InterleavedSources(self.notices)
        self._senders = FurtherSenders()
        self.clock = SourceClock(stamps, "nmea0183 ZDA, RMC or TAG", self.notices)
        numbered = thrusters or Thrusters.model_validate({}, context={"actuators": actuators})
        machinery = machinery_readers(numbered, actuators, reduction_ratios or {}, rated_rpm or {})
        self._readers = readers(theoretical_wind) | machinery
        self._declared = DeclaredSentences(declared)

    def decode(self, frame: Frame) -> list[Group]:
        return self.decode_line(frame, frame.payload)

    def decode_line(self, frame: Frame, line: bytes, time_ns: int | None = None) -> list[Group]:
        """The samples in a line that came in a frame; ``time_ns`` is the time that was stated beside it."""
        groups: list[Group] = []
        parts, sender = sentences_in(line), self._senders.label(frame.sender)
        for part in parts:
            tagged = split_tag(part)
            if sender:
                tagged = replace(tagged, source=f"{tagged.source}{'.' if tagged.source else ''}{sender}")
            tagged = tagged if time_ns is None else replace(tagged, time_ns=time_ns)
            groups += self._decode(frame, tagged, alone=len(parts) == 1)
        return groups

    def _decode(self, frame: Frame, tagged: TaggedSentence, *, alone: bool) -> list[Group]:
        """The samples in a sentence, with what its envelope said; beside others one without a sum was cut off."""
        sentence = split_sentence(tagged.sentence, unchecked=self._unchecked and alone)
        if not tagged.sound:
            self.refused["TAG block with a wrong checksum"] += 1
        if sentence is None:
            if tagged.sound or tagged.sentence.startswith((b"$", b"!")):  # a TAG block alone is one fault, not two
                has_none = alone and _UNCHECKED.fullmatch(tagged.sentence) is not None
                self.refused[NO_CHECKSUM if has_none else "no sound checksum"] += 1
            return []
        if tagged.time_ns is not None:  # which is then this sentence's time too, unless it tells its own
            self.clock.announce(tagged.time_ns, frame)
        tag, fields = sentence
        if not tag.isalnum() or len(tag) > _LONGEST_TAG:
            self.refused["no talker and kind"] += 1
            return []
        talker, kind = ("P", tag) if tag.startswith("P") else (tag[:-3], tag[-3:])  # P: a maker's own
        groups: list[Group] = []
        if kind not in self._readers and kind not in self._declared:
            self.note_unknown(tag)
        if kind in self._readers:
            reading = self._readers[kind](Fields(fields))
            if reading.refused or not (reading.values or reading.date or reading.sigma_m):
                self.refused[reading.refused or "no value"] += 1
            if kind in self._declared:
                values = [pair for pair in reading.values if pair[0] not in self._declared.channels_in(kind)]
                reading = replace(reading, values=values)
            groups = self._groups(reading, frame, talker, kind, tagged)
        if kind in self._declared:
            reading = self._declared.read(kind, Fields(fields))
            if reading.refused:
                self.refused[reading.refused] += 1
            groups += self._groups(reading, frame, talker, kind, tagged)
        return groups

    def _groups(
        self, reading: SentenceReading, frame: Frame, talker: str, kind: str, tagged: TaggedSentence
    ) -> list[Group]:
        label = _label(frame.origin, talker, kind, tagged, reading)
        number = self._receiver(kind, sensor_of(label), reading, frame)
        name = f"receiver{number}" if number > 1 else self._further_source(kind, label, reading, frame)
        if name:
            tagged = replace(tagged, source=f"{tagged.source}{'.' if tagged.source else ''}{name}")
            label = _label(frame.origin, talker, kind, tagged, reading)
        self._note_fix(kind, sensor_of(label), reading)
        return self.clock.group(frame, label, reading.values, self._told_ns(reading, frame), reading.quality)

    def _receiver(self, kind: str, sensor: str, reading: SentenceReading, frame: Frame) -> int:
        """Which of several receivers that have one name says it."""
        position = dict(reading.values)
        if reading.seconds_of_day is not None and {"latitude_deg", "longitude_deg"} <= position.keys():
            place = position["latitude_deg"], position["longitude_deg"]
            return self._receivers.number(sensor, kind, reading.seconds_of_day, frame.monotonic_ns, place)
        return self._receivers.last(sensor) if kind in _WITH_A_FIX else 1

    def _further_source(self, kind: str, label: str, reading: SentenceReading, frame: Frame) -> str:
        """Which of several sources of one name says what has neither time nor position; empty for the first."""
        if reading.seconds_of_day is not None or kind in _WITH_A_FIX or not reading.values:
            return ""
        number = self._interleaved.number(label, *reading.values[0], frame.monotonic_ns)
        return f"source{number}" if number > 1 else ""

    def _note_fix(self, kind: str, sensor: str, reading: SentenceReading) -> None:
        """GGA tells it finer than the modes of the other sentences, which count where it does not come."""
        former = self.fixes.get(sensor, Fix())
        if reading.sigma_m is not None:
            fix = former._replace(sigma_m=reading.sigma_m)
        elif reading.fix is not None and (kind == "GGA" or sensor not in self._tell_gga):
            fix = former._replace(kind=reading.fix, height_m=reading.height_m)
        else:
            return
        if kind == "GGA":
            self._tell_gga.add(sensor)
        self.fixes.pop(sensor, None)
        self.fixes[sensor] = fix  # the last to have reported stands last
        if len(self.fixes) > _MOST_SENSORS:
            oldest = next(iter(self.fixes))
            del self.fixes[oldest]
            self._tell_gga.discard(oldest)

    def _told_ns(self, reading: SentenceReading, frame: Frame) -> int | None:
        """When the sentence says its values were true; what tells the date too also sets the line's clock."""
        if reading.seconds_of_day is None:
            return None
        if reading.date is not None:
            told_ns = utc_ns(reading.date, reading.seconds_of_day)
            self.clock.announce(told_ns, frame)
            return told_ns
        now_ns = self.clock.at(frame)
        return None if now_ns is None else nearest_day(reading.seconds_of_day, now_ns)


def _label(origin: str, talker: str, kind: str, tagged: TaggedSentence, reading: SentenceReading) -> str:
    """Who says it: line, talker, the device behind a gateway if it is named, sentence, meaning if it has several.

    ``line/II:MWV apparent``, ``line/GP@GN01:GGA``.
    """
    device = f"{talker}@{tagged.source}" if tagged.source else talker
    meaning = f" {reading.meaning}" if reading.meaning else ""
    return f"{origin}/{device}:{kind}{meaning}"
