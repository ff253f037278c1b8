r"""NMEA 0183: lines to samples, one reader a sentence, none without a valid checksum; and channels to sentences.

Before a sentence there may be a multiplexer's or gateway's TAG block (``\s:GN01,c:1795255200*hh\$GPGGA,...``),
and the prefix that IEC 61162-450 puts before both in a datagram. A line may hold anything else besides: the
beginning of a sentence whose end was lost, noise, several sentences. Each intact sentence in it is decoded
(:func:`split_into_sentences_and_rest`); the line itself is recorded as it came.

Rudders are distinguished by their place in RSA and ROR (HTD has only one), shafts by their number in RPM and PRC,
azimuth and tunnel thrusters by theirs in TRD and TRC (IEC 61162-1). Of two rudders or shafts the port one is listed
first.

Everything is read here and not by a library: the available ones refuse a sentence for one field that they cannot
read, lack VWR and VWT, and take the real numbers of TRD for integers. A field that holds no number is missing;
only what is marked valid counts; what is refused has a reason. The encoder writes more decimals than the minimum
where the format allows them.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from math import floor
from operator import xor
from typing import Any, Literal, NamedTuple

from seatrial.acquisition.config.declarations import SentenceField, Transducer
from seatrial.acquisition.config.sources import Clock, LineSource, MqttLinks, Thrusters
from seatrial.acquisition.core import errors, quantities, ship, trial
from seatrial.acquisition.protocols import NO_SATELLITES, DeclaredReaders, Decoder, FurtherSenders, Moment, Packet
from seatrial.acquisition.protocols.clock import (
    InterleavedSources,
    Receivers,
    SourceClock,
    nearest_utc_ns_of_day_time,
    utc_ns_of_date,
)

_DATAGRAM_PREFIX = b"UdPbC\0"
_TAG_BLOCK = re.compile(rb"\\([\x20-\x7e]*?)\*([0-9A-Fa-f]{2})\\")
_SECONDS = re.compile(r"(\d{1,10})(?:\.(\d{1,9}))?")
_MILLISECONDS = re.compile(r"\d{13}")
_MOST_SENSORS = 1_000  # whose fixes are kept: any talker and any source of a TAG block names one
_SENTENCE = re.compile(rb"[$!]{1,2}([\x20-\x7e]{3,})\*([0-9A-Fa-f]{2})")  # some devices say $$
_UNCHECKED = re.compile(rb"[$!]{1,2}([A-Za-z0-9]{5,16},[\x20-\x29\x2b-\x7e]*)")
NO_CHECKSUM = "comes without a checksum"
_LONGEST_TAG = 16  # letters; no proprietary one is known with more, and noise must not name unbounded devices
_ADDRESS = rb"[A-Za-z0-9]{3,%d}," % _LONGEST_TAG
_TEXT = rb" \x22#%-)+-\[\]-~"  # printable characters that neither begin nor end a sentence or a TAG block
_EMBEDDED = re.compile(  # no sentence begins inside another: where one seems to, the other was cut
    rb"(?:\\[^\\]{1,200}\\)?[$!]{1,2}(?P<body>" + _ADDRESS + rb"(?:[" + _TEXT + rb"]|[$!](?!" + _ADDRESS + rb"))*+)"
    rb"\*(?P<sum>[0-9A-Fa-f]{2})"
)
_SINGLE = re.compile(rb"(?:\\[^\\$!]{1,200}\\)?[$!][" + _TEXT + rb"]*+\*[0-9A-Fa-f]{2}")
"""Nearly every line: nothing but one sentence, of which only the checksum is still to be verified."""
_WITH_A_FIX = frozenset({"VTG", "GST"})
"""Sentences that follow a position without repeating it."""
_LABEL = re.compile(rb"[\t" + _TEXT + rb"]{0,200}")
_ANY = "?"
"""Stands for a unit that XDR gives by a letter that is not in its table."""
_XDR_UNITS = {
    ("A", "D"): "deg", ("A", "R"): "rad", ("C", "C"): "degC", ("C", "K"): "K", ("C", "F"): "degF", ("D", "M"): "m",
    ("D", "I"): "in", ("F", "H"): "Hz", ("H", "P"): "%", ("I", "A"): "A", ("N", "N"): "N", ("P", "B"): "bar",
    ("P", "P"): "Pa", ("R", "L"): "l/s", ("T", "R"): "rpm", ("U", "V"): "V", ("V", "M"): "m3",
}  # fmt: skip
"""The units of XDR by the letters of the transducer's type and of the unit (gpsd's account of NMEA 0183)."""
_ROUNDED_KMH = 0.15  # knots and km/h, each to a tenth
_NUMBER = re.compile(r"[+-]?(\d{1,9}(\.\d*)?|\.\d+)")
_DEGREES_AND_MINUTES = re.compile(r"(\d{1,3})([0-5]\d(?:\.\d*)?)")
_TIME_OF_DAY = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d(?:\.\d*)?|60(?:\.\d*)?)")
_SIGNS = {"N": 1.0, "S": -1.0, "E": 1.0, "W": -1.0}
MPS_OF_UNIT = {"N": quantities.KNOT_MPS, "K": 1.0 / 3.6, "M": 1.0, "S": 0.44704}  # S: statute miles per hour
NOT_VALID = "not marked valid"
_BEST_MODES = "RFPDAEMSN"
_FIX_OF_MODE = {"N": 0, "A": 1, "D": 2, "P": 3, "R": 4, "F": 5, "E": 6, "M": 7, "S": 8}
Values = list[tuple[str, float]]


@dataclass(frozen=True, slots=True)
class TaggedSentence:
    """A sentence without its envelope, and what the envelope states; ``sound`` is False where that was damaged."""

    sentence: bytes
    time_ns: int | None = None
    source: str = ""
    sound: bool = True


def xor_checksum(body: bytes) -> int:
    """The exclusive or of the bytes before ``*``, the same for sentences and TAG blocks.

    >>> f"{xor_checksum(b'RCTRD,3,-17.8,R,,V,'):02X}"
    '59'
    """
    return reduce(xor, body, 0)


def split_tag_block(line: bytes) -> TaggedSentence:
    r"""A line as its sentence with the TAG block's time (c:, UTC, ns since 1970) and source (s:).

    The time is in seconds or, with 13 digits, in milliseconds, and None where it is anything else.
    A block with a wrong checksum is ignored, but the sentence after it has its checksum.

    >>> split_tag_block(rb"\s:GN01,c:1795255200*3E\$HEHDT,12.3,T*1F")
    TaggedSentence(sentence=b'$HEHDT,12.3,T*1F', time_ns=1795255200000000000, source='GN01', sound=True)
    """
    line = line.removeprefix(_DATAGRAM_PREFIX)
    if not line.startswith(b"\\"):
        return TaggedSentence(line)
    match = _TAG_BLOCK.match(line)
    if match is None or int(match[2], 16) != xor_checksum(match[1]):
        return TaggedSentence(line[line.rfind(b"\\") + 1 :], sound=False)
    items = dict(item.split(":", 1) for item in match[1].decode("ascii").split(",") if ":" in item)
    time_ns, text = None, items.get("c", "")
    if _MILLISECONDS.fullmatch(text):
        time_ns = int(text) * 1_000_000
    elif seconds := _SECONDS.fullmatch(text):
        time_ns = int(seconds[1]) * trial.NANO + int((seconds[2] or "").ljust(9, "0"))
    return TaggedSentence(line[match.end() :], time_ns, trial.safe_source_label(items.get("s", "")))


def split_sentence(line: bytes, *, unchecked: bool = False) -> tuple[str, list[str]] | None:
    """The tag without its dollar sign and the fields of a valid sentence; None for anything else.

    ``unchecked`` accepts a sentence without a checksum.
    """
    match = _SENTENCE.fullmatch(line)
    if match is not None and int(match[2], 16) != xor_checksum(match[1]):
        return None
    if match is None and unchecked:
        match = _UNCHECKED.fullmatch(line)
    if match is None:
        return None
    tag, *fields = match[1].decode("ascii").split(",")
    return tag, fields


def split_into_sentences_and_rest(line: bytes) -> list[bytes]:
    r"""The intact sentences of a line, each with its TAG block, and between them the parts that are none.

    A line without an intact sentence is one part. A label, text around a sentence that cannot be a sentence itself
    (a time, a name), is dropped.

    >>> split_into_sentences_and_rest(rb"$HEHDT,1$HEHDT,12.3,T*1F")
    [b'$HEHDT,1', b'$HEHDT,12.3,T*1F']
    >>> split_into_sentences_and_rest(rb"12:00:00 \s:GN01*75\$HEHDT,12.3,T*1F!AIVDM,1")
    [b'\\s:GN01*75\\$HEHDT,12.3,T*1F', b'!AIVDM,1']
    """
    line = line.removeprefix(_DATAGRAM_PREFIX)
    parts = [line] if _SINGLE.fullmatch(line) else split_at_sentences(line)
    return parts if len(parts) == 1 else [part for part in parts if not _LABEL.fullmatch(part)]


def split_at_sentences(line: bytes) -> list[bytes]:
    """The line in parts, none of them empty: an intact sentence is one of them."""
    parts, end = list[bytes](), 0
    for sentence in _EMBEDDED.finditer(line):
        if xor_checksum(sentence["body"]) == int(sentence["sum"], 16):
            parts += [line[end : sentence.start()], sentence[0]]
            end = sentence.end()
    return [part for part in (*parts, line[end:]) if part]


def has_sentence(line: bytes, *, unchecked: bool = False) -> bool:
    """Whether there is an intact sentence in a line, by its checksum or, ``unchecked``, without one."""
    return any(
        split_sentence(split_tag_block(part).sentence, unchecked=unchecked) is not None
        for part in split_into_sentences_and_rest(line)
    )


class _Field(NamedTuple):
    """One field that carries a channel."""

    channel: ship.Channel
    origin: SentenceField
    step: quantities.Linear

    def read(self, fields: Fields) -> SentenceReading:
        for place, required in self.origin.when.items():
            if fields.text_at(int(place) - 1) not in ((required,) if isinstance(required, str) else required):
                return SentenceReading()
        number = fields.number_at(self.origin.field - 1)
        seconds = None if self.origin.time is None else fields.seconds_of_day_at(self.origin.time - 1)
        values = [] if number is None else [(self.channel.name, self.step.apply(number))]
        return SentenceReading(values, seconds_of_day=seconds)


class _Transducer(NamedTuple):
    """One transducer that carries a channel; the steps by the unit in the sentence, "" where it has none.

    XDR has four fields for each: type, value, unit, name.
    """

    channel: ship.Channel
    name: str
    steps: Mapping[str, quantities.Linear]

    def read(self, fields: Fields) -> SentenceReading:
        for place in range(0, len(fields) - 3, 4):
            number, letter = fields.number_at(place + 1), fields.text_at(place + 2)
            if fields.text_at(place + 3) == self.name and number is not None:
                unit = _XDR_UNITS.get((fields.text_at(place), letter), letter and _ANY)
                step = self.steps.get(unit)
                if step is None:
                    return SentenceReading(refused="unit unknown")
                return SentenceReading([(self.channel.name, step.apply(number))])
        return SentenceReading()


class DeclaredSentences(DeclaredReaders[str, _Field | _Transducer]):
    """The declared channels in sentences, by their letters."""

    def __init__(self, declared: Sequence[tuple[ship.Channel, SentenceField | Transducer]]) -> None:
        super().__init__()
        for channel, origin in declared:
            if isinstance(origin, SentenceField):
                self.setdefault(origin.sentence, []).append(
                    _Field(channel, origin, origin.conversion_to_channel(channel))
                )
                continue
            # from each unit of XDR that measures what the channel does; from any, where the origin gives one
            steps = {"": origin.conversion_to_channel(channel)}
            if origin.unit is not None or origin.full_scale is not None:
                steps = dict.fromkeys(("", _ANY, *_XDR_UNITS.values()), steps[""])
            else:
                for unit in _XDR_UNITS.values():
                    with suppress(errors.ConfigurationError):
                        steps[unit] = origin.conversion_to_channel(channel, unit)
            self.setdefault("XDR", []).append(_Transducer(channel, origin.transducer, steps))

    def undeclared_transducers(self, kind: str, fields: Fields) -> list[str]:
        """The names of transducers in a sentence that no channel is declared to come from."""
        if kind != "XDR":
            return []
        declared = {reader.name for reader in self[kind] if isinstance(reader, _Transducer)}
        names = (fields.text_at(place) for place in range(3, len(fields), 4))
        return [name for name in names if name.isprintable() and name not in declared | {""}]

    def read(self, kind: str, fields: Fields) -> SentenceReading:
        """The channels in a sentence; of several origins of one channel in it the first that has a value counts."""
        readings = [reader.read(fields) for reader in self[kind]]
        values = dict(value for reading in reversed(readings) for value in reading.values)
        seconds = next((reading.seconds_of_day for reading in readings if reading.seconds_of_day is not None), None)
        refused = next((reading.refused for reading in readings if reading.refused), "")
        return SentenceReading(list(values.items()), refused=refused, seconds_of_day=seconds)


class Nmea0183Decoder(Decoder):
    """One line; the date comes from ZDA, RMC or TAG blocks, as position sentences have only the time of day."""

    def __init__(
        self,
        thrusters: Thrusters | None = None,
        stamps: Clock = "receiver",
        theoretical_wind: Literal["ground", "water"] = "ground",
        actuators: ship.Actuators = ship.DEFAULT,
        reduction_ratios: Mapping[str, float] | None = None,
        rated_rpm: Mapping[str, float] | None = None,
        *,
        declared: Sequence[tuple[ship.Channel, SentenceField | Transducer]] = (),
        unchecked: bool = False,
    ) -> None:
        super().__init__()
        self._unchecked = unchecked
        self._sends_gga: set[str] = set()
        self._receivers = Receivers(self.notices)
        self._interleaved = InterleavedSources(self.notices)
        self._senders = FurtherSenders()
        self.clock = SourceClock(stamps, "nmea0183 ZDA, RMC or TAG", self.notices)
        numbered = thrusters or Thrusters.model_validate({}, context={"actuators": actuators})
        machinery = machinery_readers(numbered, actuators, reduction_ratios or {}, rated_rpm or {})
        self._readers = motion_readers(theoretical_wind) | machinery
        self._declared = DeclaredSentences(declared)

    def decode(self, frame: trial.Frame) -> list[trial.Group]:
        return self.decode_line(frame, frame.payload)

    def decode_line(self, frame: trial.Frame, line: bytes, time_ns: int | None = None) -> list[trial.Group]:
        """The samples in a line that came in a frame; ``time_ns`` is the time that the log states beside it."""
        groups: list[trial.Group] = []
        parts, sender = split_into_sentences_and_rest(line), self._senders.label(frame.sender)
        for part in parts:
            tagged = split_tag_block(part)
            tagged = tagged if time_ns is None else replace(tagged, time_ns=time_ns)
            groups += self._decode(frame, tagged, sender, alone=len(parts) == 1)
        return groups

    def _decode(self, frame: trial.Frame, tagged: TaggedSentence, sender: str, *, alone: bool) -> list[trial.Group]:
        """The samples in a sentence; one without a checksum that is not alone in its line was cut off."""
        sentence = split_sentence(tagged.sentence, unchecked=self._unchecked and alone)
        if not tagged.sound:
            self.refused["TAG block with a wrong checksum"] += 1
        if sentence is None:
            if tagged.sound or tagged.sentence.startswith((b"$", b"!")):  # a TAG block alone is one fault, not two
                lacks_checksum = alone and _UNCHECKED.fullmatch(tagged.sentence) is not None
                self.refused[NO_CHECKSUM if lacks_checksum else "no sound checksum"] += 1
            return []
        if tagged.time_ns is not None:  # which is then this sentence's time too, unless it states one
            self.clock.announce(tagged.time_ns, frame)
        tag, fields = sentence
        if not tag.isalnum() or len(tag) > _LONGEST_TAG:
            self.refused["no talker and kind"] += 1
            return []
        talker, kind = ("P", tag) if tag.startswith("P") else (tag[:-3], tag[-3:])  # P: proprietary
        groups: list[trial.Group] = []
        device = ".".join(filter(None, (tagged.source, sender)))
        if kind not in self._readers and kind not in self._declared:
            self.count_unknown_message(tag)
        if kind in self._readers:
            reading = self._readers[kind](Fields(fields))
            if reading.refused or not (reading.values or reading.date or reading.sigma_m):
                self.refused[reading.refused or "no value"] += 1
            if kind in self._declared:
                reading = replace(reading, values=self._declared.values_not_declared(kind, reading.values))
            groups = self._group_reading(reading, frame, talker, kind, device)
        if kind in self._declared:
            for name in self._declared.undeclared_transducers(kind, Fields(fields)):
                self.count_unknown_message(f"{tag} {name}")
            reading = self._declared.read(kind, Fields(fields))
            if reading.refused:
                self.refused[reading.refused] += 1
            groups += self._group_reading(reading, frame, talker, kind, device)
        return groups

    def _group_reading(
        self, reading: SentenceReading, frame: trial.Frame, talker: str, kind: str, device: str
    ) -> list[trial.Group]:
        """The values of a sentence, under the line, its talker, the ``device`` behind a gateway if it is named, the
        sentence, and its meaning if it has several: ``line/II:MWV apparent``, ``line/GP@GN01:GGA``.

        Which of several receivers or sources of one name they are from is part of the device.
        """

        def label(device: str) -> str:
            meaning = f" {reading.meaning}" if reading.meaning else ""
            return f"{frame.origin}/{talker}{'@' if device else ''}{device}:{kind}{meaning}"

        seconds, position = reading.seconds_of_day, dict(reading.values)
        name, number = "receiver", 1
        if seconds is not None and {"latitude_deg", "longitude_deg"} <= position.keys():
            place = position["latitude_deg"], position["longitude_deg"]
            number = self._receivers.receiver_number(
                trial.line_and_device(label(device)), kind, seconds, frame.monotonic_ns, place
            )
        elif kind in _WITH_A_FIX:
            number = self._receivers.last_receiver_number(trial.line_and_device(label(device)))
        elif seconds is None and reading.values:
            name = "source"
            number = self._interleaved.source_number(label(device), *reading.values[0], frame.monotonic_ns)
        source = label(device if number == 1 else ".".join(filter(None, (device, f"{name}{number}"))))
        self._remember_fix_quality(kind, trial.line_and_device(source), reading)
        source_ns = None
        if seconds is not None and reading.date is not None:  # then it also sets the line's clock
            source_ns = utc_ns_of_date(reading.date, seconds)
            self.clock.announce(source_ns, frame)
        elif seconds is not None and (now_ns := self.clock.utc_ns_at_frame(frame)) is not None:
            source_ns = nearest_utc_ns_of_day_time(seconds, now_ns)
        return self.clock.group_values(frame, source, reading.values, source_ns, reading.quality)

    def _remember_fix_quality(self, kind: str, sensor: str, reading: SentenceReading) -> None:
        """GGA has finer kinds of fix than the modes of other sentences, which count where it does not come."""
        former = self.fixes.get(sensor, trial.Fix())
        if reading.sigma_m is not None:
            fix = former._replace(sigma_m=reading.sigma_m)
        elif reading.fix is not None and (kind == "GGA" or sensor not in self._sends_gga):
            fix = former._replace(kind=reading.fix, height_m=reading.height_m)
        else:
            return
        if kind == "GGA":
            self._sends_gga.add(sensor)
        self.fixes.pop(sensor, None)
        self.fixes[sensor] = fix  # in the order of the last reports
        if len(self.fixes) > _MOST_SENSORS:
            oldest = next(iter(self.fixes))
            del self.fixes[oldest]
            self._sends_gga.discard(oldest)


class Fields:
    """The fields of one sentence, of which some may be empty or missing."""

    def __init__(self, texts: list[str]) -> None:
        self._texts = texts

    def __len__(self) -> int:
        return len(self._texts)

    def text_at(self, index: int, absent: str = "") -> str:
        return self._texts[index].strip() if index < len(self._texts) else absent

    def number_at(self, index: int) -> float | None:
        text = self.text_at(index)
        return float(text) if _NUMBER.fullmatch(text) else None

    def number_with_letter_at(self, index: int, letter: str) -> float | None:
        """A number followed by the letter of its unit or reference, which some devices leave empty."""
        return self.number_at(index) if self.text_at(index + 1) in (letter, "") else None

    def eastward_angle_at(self, index: int) -> float | None:
        """An angle [deg] followed by E or W, east positive."""
        angle_deg, letter = self.number_at(index), self.text_at(index + 1)
        return None if angle_deg is None or letter not in ("E", "W") else _SIGNS[letter] * angle_deg

    def latitude_or_longitude_at(self, index: int, letters: str) -> float | None:
        """``ddmm.mmmm`` followed by one of two letters, as degrees, north and east positive."""
        match, letter = _DEGREES_AND_MINUTES.fullmatch(self.text_at(index)), self.text_at(index + 1)
        if match is None or letter not in tuple(letters):
            return None
        return _SIGNS[letter] * (int(match[1]) + float(match[2]) / 60.0)

    def first_speed_mps(self, *places: tuple[int, str]) -> float | None:
        """The first speed that is there, of those at an index in a unit; so the finest unit comes first.

        The letter after a number names its unit, the place only where that is empty: some devices omit the first of
        two speeds, and not its place.
        """
        for index, unit in places:
            speed, factor = self.number_at(index), MPS_OF_UNIT.get(self.text_at(index + 1) or unit)
            if speed is not None and factor is not None:
                return speed * factor
        return None

    def seconds_of_day_at(self, index: int) -> float | None:
        """``hhmmss.sss`` as seconds since midnight; the leap second is the next day's first."""
        match = _TIME_OF_DAY.fullmatch(self.text_at(index))
        return int(match[1]) * 3600 + int(match[2]) * 60 + float(match[3]) if match else None


@dataclass(frozen=True, slots=True)
class SentenceReading:
    """The values in one sentence. ``meaning`` distinguishes what one kind of sentence can report; ``refused`` is
    why something in it was refused, empty if nothing was. ``fix``, ``height_m`` and ``sigma_m`` are the receiver's
    report of its fix, as in :class:`Fix`.
    """

    values: Values = field(default_factory=list)
    meaning: str = ""
    quality: trial.Quality = trial.Quality.NOT_EVALUATED
    refused: str = ""
    date: dt.date | None = None
    seconds_of_day: float | None = None
    fix: int | None = None
    height_m: float | None = None
    sigma_m: tuple[float, float, float] | None = None


Reader = Callable[[Fields], SentenceReading]


def drop_missing_values(*pairs: tuple[str, float | None]) -> Values:
    """Those of the pairs that have a value."""
    return [(name, value) for name, value in pairs if value is not None]


def _speed_in_knots_at(fields: Fields, index: int) -> float | None:
    knots = fields.number_at(index)
    return None if knots is None else knots * quantities.KNOT_MPS


def _read_fix(
    fields: Fields, place: int, time: int, fix: int | None, movement: Values | None = None, **further: Any
) -> SentenceReading:
    """A position at a place with its time, by the number of its fix in GGA, and what ``further`` is reported."""
    position = drop_missing_values(
        ("latitude_deg", fields.latitude_or_longitude_at(place, "NS")),
        ("longitude_deg", fields.latitude_or_longitude_at(place + 2, "EW")),
    )
    values = (position if len(position) == 2 else []) + (movement or [])  # one coordinate alone is of no use
    seconds = fields.seconds_of_day_at(time)
    return SentenceReading(values, quality=_quality_of_fix(fix), seconds_of_day=seconds, fix=fix, **further)


def _quality_of_fix(fix: int | None) -> trial.Quality:
    """Dead reckoning, manual input and a simulator are recorded, and marked as suspect."""
    return trial.Quality.SUSPECT if fix in NO_SATELLITES else trial.Quality.NOT_EVALUATED


def _read_gga(fields: Fields) -> SentenceReading:
    code = fields.text_at(5)
    if code in ("0", ""):
        return SentenceReading(refused=NOT_VALID, fix=0)
    height_m, geoid_m = fields.number_with_letter_at(8, "M"), fields.number_with_letter_at(10, "M")
    height_m = None if height_m is None else height_m + (geoid_m or 0.0)
    return _read_fix(fields, 1, 0, int(code) if code in tuple("123456789") else None, height_m=height_m)


def _read_gns(fields: Fields) -> SentenceReading:
    """The fix of a receiver of several constellations: of their modes, one letter each, the best holds."""
    modes = [mode for mode in _BEST_MODES if mode in fields.text_at(5)]
    if not modes or modes[0] == "N":
        return SentenceReading(refused=NOT_VALID, fix=0)
    height_m, geoid_m = fields.number_at(8), fields.number_at(9)
    height_m = None if height_m is None else height_m + (geoid_m or 0.0)
    return _read_fix(fields, 1, 0, _FIX_OF_MODE[modes[0]], height_m=height_m)


def _read_gst(fields: Fields) -> SentenceReading:
    """The errors of the fix: standard deviations of latitude, longitude and height [m]."""
    north_m, east_m, up_m = (fields.number_at(index) for index in (5, 6, 7))
    if north_m is None or east_m is None or up_m is None:
        return SentenceReading()
    return SentenceReading(sigma_m=(east_m, north_m, up_m))


def _read_gll(fields: Fields) -> SentenceReading:
    mode = fields.text_at(6)
    if fields.text_at(5, absent="A") != "A" or mode == "N":
        return SentenceReading(refused=NOT_VALID, fix=0)
    return _read_fix(fields, 0, 4, _FIX_OF_MODE.get(mode))


def _read_rmc(fields: Fields) -> SentenceReading:
    mode = fields.text_at(11)
    if fields.text_at(1) != "A" or mode == "N":
        return SentenceReading(refused=NOT_VALID, fix=0)
    ddmmyy, date = fields.text_at(8), None
    if re.fullmatch(r"\d{6}", ddmmyy):  # 80 to 99 are of the last century, as of receivers without the date
        year = int(ddmmyy[4:])
        date = _date_or_none(year + (1900 if year >= 80 else 2000), int(ddmmyy[2:4]), int(ddmmyy[:2]))
    movement = drop_missing_values(
        ("course_over_ground_deg", fields.number_at(7)),
        ("speed_over_ground_mps", _speed_in_knots_at(fields, 6)),
        ("magnetic_variation_deg", fields.eastward_angle_at(9)),
    )
    return _read_fix(fields, 2, 0, _FIX_OF_MODE.get(mode), movement, date=date)


def _read_zda(fields: Fields) -> SentenceReading:
    parts = [fields.text_at(index) for index in (3, 2, 1)]
    date = _date_or_none(*map(int, parts)) if all(re.fullmatch(r"\d{1,4}", part) for part in parts) else None
    seconds = fields.seconds_of_day_at(0)
    refused = "no time" if date is None or seconds is None else ""
    return SentenceReading(date=date, seconds_of_day=seconds, refused=refused)


def _date_or_none(year: int, month: int, day: int) -> dt.date | None:
    try:
        return dt.date(year, month, day)
    except ValueError:
        return None


def _read_vtg(fields: Fields) -> SentenceReading:
    mode = fields.text_at(8)
    if mode == "N":
        return SentenceReading(refused=NOT_VALID)
    if len(fields) == 4 and not any(fields.text_at(index).isalpha() for index in range(4)):
        # before NMEA 2.3: course true and magnetic, speed in knots and km/h, which disagree if the sentence was cut
        course, knots, kmh = (fields.number_at(index) for index in (0, 2, 3))
        if knots is None or kmh is None or abs(knots * 1.852 - kmh) > _ROUNDED_KMH:
            return SentenceReading(refused="a form that is not known")
        speed: float | None = knots * quantities.KNOT_MPS
    else:
        course, speed = fields.number_with_letter_at(0, "T"), fields.first_speed_mps((4, "N"), (6, "K"))
    values = drop_missing_values(("course_over_ground_deg", course), ("speed_over_ground_mps", speed))
    return SentenceReading(values, quality=_quality_of_fix(_FIX_OF_MODE.get(mode)))


def _read_ths(fields: Fields) -> SentenceReading:
    mode = fields.text_at(1)
    if mode not in tuple("AEMS"):
        return SentenceReading(refused=NOT_VALID)
    heading = drop_missing_values(("heading_deg", fields.number_at(0)))
    return SentenceReading(heading, quality=_quality_of_fix(_FIX_OF_MODE[mode]))


def _read_hdg(fields: Fields) -> SentenceReading:
    sensor, deviation = fields.number_at(0), fields.eastward_angle_at(1)
    # A sum may pass north; a sensor reading beyond a turn is passed on for the range check.
    if sensor is not None and deviation is not None and 0.0 <= sensor <= 360.0:
        sensor = (sensor + deviation) % 360.0
    pair = ("heading_magnetic_deg", sensor), ("magnetic_variation_deg", fields.eastward_angle_at(3))
    return SentenceReading(drop_missing_values(*pair))


def _read_rot(fields: Fields) -> SentenceReading:
    rate_deg_per_min = fields.number_at(0)
    if fields.text_at(1) != "A":
        return SentenceReading(refused=NOT_VALID)
    return SentenceReading([] if rate_deg_per_min is None else [("yaw_rate_dps", rate_deg_per_min / 60.0)])


def _read_vbw(fields: Fields) -> SentenceReading:
    ground = drop_missing_values(
        ("surge_mps", _speed_in_knots_at(fields, 3)), ("sway_mps", _speed_in_knots_at(fields, 4))
    )
    water = drop_missing_values(("speed_through_water_mps", _speed_in_knots_at(fields, 0)))
    ground_valid, water_valid = fields.text_at(5) == "A", fields.text_at(2) == "A"
    is_refused = (ground and not ground_valid) or (water and not water_valid)
    values = (ground if ground_valid else []) + (water if water_valid else [])
    return SentenceReading(values, refused=NOT_VALID if is_refused else "")


def _read_mwv(fields: Fields, theoretical: str) -> SentenceReading:
    reference = {"R": "apparent", "T": theoretical}.get(fields.text_at(1))
    if reference is None:
        return SentenceReading(refused="wind reference unknown")
    if fields.text_at(4) != "A":
        return SentenceReading(refused=NOT_VALID)
    speed, unit = fields.number_at(2), MPS_OF_UNIT.get(fields.text_at(3))
    if speed is None or unit is None:
        reading = _apparent_wind_reading(fields.number_at(0), None, reference)
        return reading if speed is None else replace(reading, refused="unit unknown")
    return _apparent_wind_reading(fields.number_at(0), speed * unit, reference)


def _read_vwr_or_vwt(fields: Fields, reference: str) -> SentenceReading:
    """VWR and VWT: up to 180 degrees to the left or right of the bow."""
    angle, sign = fields.number_at(0), {"R": 1.0, "L": -1.0}.get(fields.text_at(1))
    signed = None if angle is None or sign is None or not 0.0 <= angle <= 180.0 else sign * angle
    return _apparent_wind_reading(signed, fields.first_speed_mps((2, "N"), (4, "M"), (6, "K")), reference)


def _apparent_wind_reading(angle_deg: float | None, speed_mps: float | None, reference: str) -> SentenceReading:
    pair = (f"wind_angle_{reference}_deg", angle_deg), (f"wind_speed_{reference}_mps", speed_mps)
    return SentenceReading(drop_missing_values(*pair), reference)


def _read_mwd(fields: Fields, place: int = 0) -> SentenceReading:
    """MWD, and the same from a place on in MDA, behind the weather."""
    speeds = fields.first_speed_mps((place + 4, "N"), (place + 6, "M"))
    speed = drop_missing_values(("wind_speed_mps", speeds))
    true = drop_missing_values(("wind_direction_deg", fields.number_with_letter_at(place, "T")))
    magnetic = drop_missing_values(("wind_direction_magnetic_deg", fields.number_with_letter_at(place + 2, "M")))
    return SentenceReading(true + speed) if true or not magnetic else SentenceReading(magnetic + speed, "magnetic")


def _read_pashr(fields: Fields) -> SentenceReading:
    """The heading of an inertial system, behind the time; its other angles are declared in a pack."""
    seconds = fields.seconds_of_day_at(0)
    if seconds is None or fields.text_at(2) != "T":
        return SentenceReading(refused="a form that is not known")
    return SentenceReading(drop_missing_values(("heading_deg", fields.number_at(1))), seconds_of_day=seconds)


_READERS: dict[str, Reader] = {
    "GGA": _read_gga,
    "GNS": _read_gns,
    "GST": _read_gst,
    "GLL": _read_gll,
    "RMC": _read_rmc,
    "ZDA": _read_zda,
    "VTG": _read_vtg,
    "HDT": lambda fields: SentenceReading(
        drop_missing_values(("heading_deg", fields.number_with_letter_at(0, "T")))
    ),
    "THS": _read_ths,
    "HDG": _read_hdg,
    "HDM": lambda fields: SentenceReading(
        drop_missing_values(("heading_magnetic_deg", fields.number_with_letter_at(0, "M")))
    ),
    "ROT": _read_rot,
    "VBW": _read_vbw,
    # the headings in it repeat those of another device
    "VHW": lambda fields: SentenceReading(
        drop_missing_values(("speed_through_water_mps", fields.first_speed_mps((4, "N"), (6, "K"))))
    ),
    "MWD": _read_mwd,
    "MDA": partial(_read_mwd, place=12),
    "PASHR": _read_pashr,
}


def motion_readers(theoretical_wind: Literal["ground", "water"]) -> dict[str, Reader]:
    """The reader of each sentence of motion, wind and time, by its last three letters."""
    theoretical = "theoretical" if theoretical_wind == "ground" else "water"
    return {
        **_READERS,
        "MWV": partial(_read_mwv, theoretical=theoretical),
        "VWR": partial(_read_vwr_or_vwt, reference="apparent"),
        "VWT": partial(_read_vwr_or_vwt, reference=theoretical),
    }


_Controls = dict[float, tuple[str, str]]
"""The channels of each thruster's shaft speed and angle, empty if it has none, by its number in TRD and TRC."""


def _read_rudder_angles(fields: Fields, channels: tuple[str, ...]) -> SentenceReading:
    """RSA and ROR: starboard or single rudder first, then port. A single one may have either sensor."""
    if len(channels) > 2:
        return SentenceReading(refused="more than two rudders")
    valid = [fields.number_at(index) if fields.text_at(index + 1) == "A" else None for index in (0, 2)]
    if fields.text_at(1) != "A" and fields.text_at(3) != "A":
        return SentenceReading(refused=NOT_VALID)
    if len(channels) == 1:
        return SentenceReading(
            drop_missing_values((channels[0], valid[0] if fields.text_at(1) == "A" else valid[1]))
        )
    port, starboard = channels
    return SentenceReading(drop_missing_values((port, valid[1]), (starboard, valid[0])))


def _read_heading_control(fields: Fields, channels: tuple[str, ...]) -> SentenceReading:
    """HTD: the rudder angle that a heading or track control system orders, and its side."""
    if len(channels) > 1:
        return SentenceReading(refused="one order to several rudders")
    angle, sign = fields.number_at(1), {"R": 1.0, "L": -1.0}.get(fields.text_at(2))
    ordered = None if angle is None or sign is None or angle < 0.0 else sign * angle
    return _rename_to_orders(SentenceReading(drop_missing_values((channels[0], ordered))))


def _read_rpm(fields: Fields, shafts: ship.Actuators, reduction_ratios: Mapping[str, float]) -> SentenceReading:
    """A shaft's speed and pitch; an engine's speed stands for its shaft's where its reduction ratio is known."""
    source, number = fields.text_at(0), fields.number_at(1)
    if source not in ("S", "E"):
        return SentenceReading(refused="rpm of no shaft")
    shaft = ship.shaft_of_number(number, shafts)
    if shaft is None:
        return SentenceReading(refused="rpm of a single or unknown shaft")
    ratio = reduction_ratios.get(shaft.name) if source == "E" else 1.0
    if ratio is None:
        return SentenceReading(refused="engine rpm")
    if fields.text_at(4) != "A":
        return SentenceReading(refused=NOT_VALID)
    rpm = fields.number_at(2)
    values = _shaft_values(shaft, None if rpm is None else rpm / ratio, fields.number_at(3))
    return SentenceReading(values, f"{'shaft' if source == 'S' else 'engine'} {number:.0f}")


def _shaft_values(shaft: ship.Actuator, rpm: float | None, pitch_percent: float | None) -> list[tuple[str, float]]:
    """Those of the two values that a shaft has a channel for: pitch only with a controllable one."""
    channels = {channel.name for channel in shaft.channels}
    values = drop_missing_values((f"{shaft.name}_rpm", rpm), (f"{shaft.name}_pitch_percent", pitch_percent))
    return [(name, value) for name, value in values if name in channels]


def _shaft_speed_rpm(value: float | None, mode: str, rated_rpm: float | None) -> float | None:
    """A shaft's speed by its mode: R rpm, P percent of the rated one; None where it is neither, or not known."""
    if value is None or mode == "R":
        return value
    return None if mode != "P" or rated_rpm is None else value * rated_rpm / 100.0


def _read_propulsion_order(
    fields: Fields, shafts: ship.Actuators, rated_rpm: Mapping[str, float]
) -> SentenceReading:
    """PRC: lever, its status, rpm, its mode, pitch, its mode, location, shaft."""
    shaft = ship.shaft_of_number(fields.number_at(7), shafts)
    if shaft is None:
        return SentenceReading(refused="order to an unknown shaft")
    rpm = _shaft_speed_rpm(fields.number_at(2), fields.text_at(3), rated_rpm.get(shaft.name))
    pitch_percent = fields.number_at(4) if fields.text_at(5) == "P" else None
    return _rename_to_orders(
        SentenceReading(_shaft_values(shaft, rpm, pitch_percent), f"shaft {fields.number_at(7):.0f}")
    )


def _read_thruster(fields: Fields, controls: _Controls, rated_rpm: Mapping[str, float]) -> SentenceReading:
    """TRD and TRC: number, rpm, its mode, pitch, its mode, azimuth, which is the direction of the thrust.

    ``rated_rpm`` is by channel.
    """
    number = fields.number_at(0)
    shaft, azimuth = ("", "") if number is None else controls.get(number, ("", ""))
    if not shaft:
        return SentenceReading(refused="thruster not understood")
    speed, mode = fields.number_at(1), fields.text_at(2)
    rpm = drop_missing_values((shaft, _shaft_speed_rpm(speed, mode, rated_rpm.get(shaft))))
    angle = drop_missing_values((azimuth, fields.number_at(5))) if azimuth else []
    if rpm or speed is None:
        return SentenceReading(rpm + angle)
    return SentenceReading(angle, refused="thruster in percent" if mode == "P" else NOT_VALID)


def _rename_to_orders(reading: SentenceReading, *, fills_channels: bool = False) -> SentenceReading:
    """The values as those ordered; as those of the channels, too, where they stand for them."""
    orders = [(ship.order_channel_name(name), value) for name, value in reading.values]
    return replace(reading, values=orders + (reading.values if fills_channels else []))


def machinery_readers(
    thrusters: Thrusters,
    actuators: ship.Actuators,
    reduction_ratios: Mapping[str, float],
    rated_rpm: Mapping[str, float],
) -> dict[str, Reader]:
    """The reader of each of these sentences, by its last three letters, on a ship with these actuators."""
    controls: _Controls = {}
    for actuator in actuators:
        if actuator.name in thrusters.numbers:
            shaft, azimuth, *_ = (*(channel.name for channel in actuator.channels), "")
            controls[thrusters.numbers[actuator.name]] = shaft, azimuth
    rated_by_channel = {f"{name}_rpm": rpm for name, rpm in rated_rpm.items()}
    thruster = partial(_read_thruster, controls=controls, rated_rpm=rated_by_channel)
    demand = thrusters.channels_from == "demand"
    ignored = SentenceReading(refused="thruster response where demands are wanted")
    angles, shafts = ship.rudder_channels(actuators), ship.shafts_in_rpm_sentences(actuators)
    machinery: dict[str, Reader] = {
        "RSA": partial(_read_rudder_angles, channels=angles),
        "RPM": partial(_read_rpm, shafts=shafts, reduction_ratios=reduction_ratios),
        "TRD": (lambda fields: ignored) if demand else thruster,
        "TRC": lambda fields: _rename_to_orders(thruster(fields), fills_channels=demand),
    }
    if ship.rudder_names(actuators):
        machinery["ROR"] = lambda fields: _rename_to_orders(_read_rudder_angles(fields, angles))
        machinery["HTD"] = partial(_read_heading_control, channels=angles)
    if not {propulsor.name for propulsor in shafts} & thrusters.numbers.keys():  # else TRC has the orders to them
        machinery["PRC"] = partial(_read_propulsion_order, shafts=shafts, rated_rpm=rated_rpm)
    return machinery


def frame_sentence(body: str) -> bytes:
    """The sentence of a body, which is between ``$`` and ``*``.

    >>> frame_sentence("RCTRD,2,400.5,R,,V,90.8")
    b'$RCTRD,2,400.5,R,,V,90.8*55\\r\\n'
    """
    return f"${body}*{xor_checksum(body.encode('ascii')):02X}\r\n".encode("ascii")


def format_degrees_and_minutes(angle_deg: float, digits: int) -> str:
    """An angle without its sign as ``ddmm.mmmmmm``; ``digits`` for the degrees.

    >>> format_degrees_and_minutes(-10.5, 3)
    '01030.000000'
    """
    micro_minutes = round(abs(angle_deg) * 60e6)
    degrees, remainder = divmod(micro_minutes, 60_000_000)
    return f"{degrees:0{digits}d}{remainder // 1_000_000:02d}.{remainder % 1_000_000:06d}"


class Nmea0183Encoder:
    """GGA, HDT, ROT, VBW, MWD; the ship's actuators; ZDA first where the line announces the time.

    Of actuators RSA and ROR, RPM and PRC, TRD and TRC; TRC for TRD where the line takes orders for responses.
    """

    def __init__(
        self, config: LineSource | MqttLinks, actuators: ship.Actuators, channels: Mapping[str, ship.Channel]
    ) -> None:
        self._announces = isinstance(config, LineSource) and config.clock == "source"
        numbers, angles = config.thrusters.numbers, ship.rudder_channels(actuators)
        responses = "TRC" if config.thrusters.channels_from == "demand" else "TRD"
        ship_shafts = ship.shaft_numbers(ship.shafts_in_rpm_sentences(actuators))
        devices: list[tuple[tuple[str, ...], Body, Body]] = []
        if len(angles) <= 2:
            kinds = partial(_rudder_sentence, "RSA"), partial(_rudder_sentence, "ROR")
            devices.append((tuple(reversed(angles)), *kinds))
        for name, number in numbers.items():
            pair = (f"{name}_rpm", f"{name}_angle_deg")
            kinds = partial(_thruster_sentence, responses, number), partial(_thruster_sentence, "TRC", number)
            devices.append((pair, *kinds))
        for name, number in ship_shafts.items():
            if name not in numbers:
                pair = (f"{name}_rpm", f"{name}_pitch_percent")
                kinds = partial(_shaft_sentence, "RPM", number), partial(_shaft_sentence, "PRC", number)
                devices.append((pair, *kinds))
        self._sentences = list(_NAVIGATION.items())
        for names, response, order in devices:
            self._sentences += [(names, response), (tuple(map(ship.order_channel_name, names)), order)]

    def encode(self, moment: Moment) -> list[Packet]:
        utc = trial.EPOCH + dt.timedelta(microseconds=floor(moment.time_ns / 1000))  # rounded down
        clock = f"{utc:%H%M%S.%f}"
        packets = [Packet(frame_sentence(f"GPZDA,{clock},{utc:%d,%m,%Y},00,00"))] if self._announces else []
        latitude_deg, longitude_deg = moment.latitude_deg, moment.longitude_deg
        if latitude_deg is not None and longitude_deg is not None:
            latitude = f"{format_degrees_and_minutes(latitude_deg, 2)},{'N' if latitude_deg >= 0 else 'S'}"
            longitude = f"{format_degrees_and_minutes(longitude_deg, 3)},{'E' if longitude_deg >= 0 else 'W'}"
            fix = f"GPGGA,{clock},{latitude},{longitude},4,12,0.6,0.0,M,0.0,M,,"
            packets.append(Packet(frame_sentence(fix), carries=moment.channels_in_fix))
        for names, body in self._sentences:
            if carries := moment.present(*names):
                packets.append(Packet(frame_sentence(body(*map(moment.values.get, names))), carries=carries))
        return packets


Body = Callable[..., str]
"""A sentence's body from the values of channels, None for one that is not known."""


def _rudder_sentence(kind: str, starboard_deg: float | None, port_deg: float | None = None) -> str:
    """The starboard or single rudder, then the port one."""
    fields = [
        f"{_format_scaled(angle_deg, 1.0, 4)},{_unit_letter_or_invalid(angle_deg, 'A')}"
        for angle_deg in (starboard_deg, port_deg)
    ]
    return f"ER{kind},{','.join(fields)}{',B' if kind == 'ROR' else ''}"


def _thruster_sentence(kind: str, number: int, rpm: float | None, angle_deg: float | None) -> str:
    ending = ",B,R" if kind == "TRC" else ""
    speed, mode = _format_scaled(rpm, 1.0, 3), _unit_letter_or_invalid(rpm, "R")
    return f"RC{kind},{number},{speed},{mode},,V,{_format_angle_in_turn(angle_deg, 3)}{ending}"


def _shaft_sentence(kind: str, number: int, rpm: float | None, pitch_percent: float | None) -> str:
    speed, pitch = _format_scaled(rpm, 1.0, 3), _format_scaled(pitch_percent, 1.0, 3)
    if kind == "RPM":
        return f"ERRPM,S,{number},{speed},{pitch},A"
    speed_mode, pitch_mode = _unit_letter_or_invalid(rpm, "R"), _unit_letter_or_invalid(pitch_percent, "P")
    return f"ERPRC,,V,{speed},{speed_mode},{pitch},{pitch_mode},B,{number}"


def _unit_letter_or_invalid(value: float | None, unit: str) -> str:
    """The letter of a value's unit, V for invalid where it is missing."""
    return "V" if value is None else unit


def _format_scaled(value: float | None, scale: float, digits: int) -> str:
    return "" if value is None else f"{value * scale:.{digits}f}"


def _format_angle_in_turn(angle_deg: float | None, digits: int) -> str:
    """An angle from 0 to just below 360; rounding comes first, or 359.99999 would be sent as 360.0000."""
    return "" if angle_deg is None else f"{round(angle_deg % 360.0, digits) % 360.0:.{digits}f}"


_NAVIGATION: dict[tuple[str, ...], Body] = {
    ("heading_deg",): lambda heading: f"HEHDT,{_format_angle_in_turn(heading, 4)},T",
    ("yaw_rate_dps",): lambda rate: f"TIROT,{rate * 60.0:.3f},A",
    ("surge_mps", "sway_mps"): lambda surge, sway: (
        f"VDVBW,,,V,{_format_scaled(surge, 1.0 / quantities.KNOT_MPS, 4)},"
        f"{_format_scaled(sway, 1.0 / quantities.KNOT_MPS, 4)},A,,V,,V"
    ),
    ("wind_direction_deg", "wind_speed_mps"): lambda direction, speed: (
        f"WIMWD,{_format_angle_in_turn(direction, 3)},T,,M,{_format_scaled(speed, 1.0 / quantities.KNOT_MPS, 3)},N,"
        f"{_format_scaled(speed, 1.0, 3)},M"
    ),
}
"""The sentences of motion and wind by the channels that they carry."""
