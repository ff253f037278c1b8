"""What columns and their units are called: the quantities of a trial in the words of several languages, loggers and
programs, and units as the heads of tables write them, by the names of :mod:`seatrial.acquisition.core.quantities`.

Words are compared as a plain run of small letters without accents; the longest phrase that a name holds counts,
the more of the name it covers the better.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from seatrial.acquisition.core.ship import BY_NAME


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity by the name of its channel, or a word for what becomes channels: its unit and its phrases."""

    name: str
    unit: str
    phrases: tuple[str, ...]


_TREE = tomllib.loads(Path(__file__).with_name("column_names.toml").read_text(encoding="utf-8"))
_WORDS = {name: frozenset(words.split()) for name, words in _TREE.pop("words").items()}
_FULL_WORDS = {short: full for full, shorts in _TREE.pop("abbreviations").items() for short in shorts.split()}
_LATIN = 0x2E80  # where the letters of East Asia begin
_SHORT = 4  # letters: what is shorter is an abbreviation as a word only


def plain_letters(text: str) -> str:
    """Small letters without accents."""
    return _without_accents(text.lower().replace("ß", "ss").replace("ø", "o").replace("æ", "ae").replace("œ", "oe"))


def _without_accents(text: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))


def _in_full(word: str) -> str:
    """A word that is an abbreviation, or ends in one as ``drehgeschw`` does, in full."""
    short = next((key for key in _FULL_WORDS if word == key or (len(key) > _SHORT and word.endswith(key))), "")
    return word.removesuffix(short) + _FULL_WORDS[short] if short else word


def _phrase(text: str) -> str:
    """A phrase as a name has it."""
    return " ".join(_in_full(word) for word in plain_letters(text).split())


QUANTITIES = tuple(
    Quantity(name, entry["unit"], tuple(_phrase(phrase) for phrase in entry["phrases"].split(",")))
    for name, entry in _TREE.items()
)
BY_CHANNEL = {quantity.name: quantity for quantity in QUANTITIES if quantity.name in BY_NAME} | {
    f"{quantity.name}_deg": quantity for quantity in QUANTITIES if quantity.name in ("latitude", "longitude")
}
"""The quantities whose channels have a name of their own."""
_PHRASES = frozenset(phrase for quantity in QUANTITIES for phrase in quantity.phrases)
LETTERS = frozenset(letter for phrase in _PHRASES for letter in phrase if ord(letter) > _LATIN)
"""The Chinese and Japanese letters of the phrases."""
PORT, STARBOARD, BOW, STERN = (_WORDS[name] for name in ("port", "starboard", "bow", "stern"))
TUNNEL, ORDER = _WORDS["tunnel"], _WORDS["order"]
TIME_WORDS = frozenset(
    word
    for quantity in QUANTITIES
    if quantity.name in ("time", "date")
    for phrase in quantity.phrases
    for word in phrase.split()
)
"""The words of columns that state the time."""
_SAY_NO_MORE = PORT | STARBOARD | BOW | STERN | TUNNEL | ORDER | _WORDS["centre"] | _WORDS["nothing"]
_LEAST_COVER = 0.55  # a "vertical velocity" is no speed: half of the name says something else
_EXTRA_WORD_COUNTS = 0.05  # of words that say nothing: the plainer of two names is meant


@dataclass(frozen=True, slots=True)
class Match:
    """What a name may mean, how much of it says so (0 to 1), and the words that it has besides."""

    quantity: Quantity
    cover: float
    remaining: frozenset[str]


def words_of(name: str) -> tuple[str, ...]:
    """The words of a name in small letters without accents: ``SpeedOverGround`` is three.

    >>> words_of("Kurs ü. Grund"), words_of("windDir_rel2")
    (('kurs', 'u', 'grund'), ('wind', 'dir', 'rel', '2'))
    """
    text = re.sub(r"(?<=[a-zäöüåøæéè0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z]{2})", " ", name)
    return tuple(_in_full(word) for word in re.findall(r"[^\W\d_]+|\d+", plain_letters(text)))


@lru_cache(maxsize=4096)
def matches(name: str) -> tuple[Match, ...]:
    """What a column's name, without its unit, may mean; the likeliest first, nothing for unknown words."""
    words = words_of(name)
    if " ".join(words) not in _PHRASES and any(word in _WORDS["other"] or "force" in word for word in words):
        return ()
    text, joined = f" {' '.join(words)} ", "".join(words)
    candidates = [match for quantity in QUANTITIES if (match := _match(quantity, words, text, joined))]
    return tuple(sorted(candidates, key=lambda candidate: -candidate.cover))


def _match(quantity: Quantity, words: tuple[str, ...], text: str, joined: str) -> Match | None:
    """How well the longest of a quantity's phrases covers a name; single letters count as a whole name only.

    Words of sides may stand amid a phrase, and its words in another order.
    """
    plain = f" {' '.join(word for word in words if word not in PORT | STARBOARD)} "
    wordings = [
        wording
        for wording in quantity.phrases
        if len(wording) > 1 and (f" {wording} " in text or f" {wording} " in plain)
    ]
    if joined in {wording.replace(" ", "") for wording in quantity.phrases}:
        return Match(quantity, 1.0, frozenset())
    wordings += [wording for wording in quantity.phrases if " " in wording and _in_any_order(wording, words)]
    if not wordings:
        return None
    phrase = max(wordings, key=len)
    remaining = list(words)
    for word in phrase.split():
        remaining.remove(word)
    unexplained = [word for word in remaining if word not in _SAY_NO_MORE and not word.isdigit()]
    size = len(phrase.replace(" ", ""))
    cover = size / (size + sum(map(len, unexplained)) + _EXTRA_WORD_COUNTS * len(remaining))
    return Match(quantity, cover, frozenset(remaining)) if cover >= _LEAST_COVER else None


def _in_any_order(phrase: str, words: tuple[str, ...]) -> bool:
    """Whether a name has each word of a phrase, none of which is a single letter."""
    parts = phrase.split()
    return min(map(len, parts)) > 1 and not Counter(parts) - Counter(words)


_NAMES: dict[str, str] = {
    "deg": "deg degs degree degrees ° º deg. grad degrees_true degrees_north degrees_east degree_north degree_east"
    " degrees_n degrees_e degt deg_t °t deg(t) deg_true deg_rel deg_mag °_true °_rel gradi grados graus"
    " grader degrees_t 度 °true dd decimal_degrees decdeg",
    "rad": "rad rads radian radians radianer",
    "degE7": "dege7 1e-7deg deg*1e7",
    "ddeg": "ddeg 0.1deg 0.1_deg 0.1° deg*10 degx10 deg/10 1/10deg 1/10_deg 1/10° decideg decidegrees tenths"
    " tenths_of_degrees tenths_of_a_degree",
    "cdeg": "cdeg 0.01deg 0.01_deg 0.01° deg*100 degx100 deg/100 1/100deg 1/100_deg 1/100° centideg centidegrees"
    " hundredths hundredths_of_degrees hundredths_of_a_degree",
    "ddmm": "dmm ddm ddmm ddmm.mmmm dddmm.mmmm ddmm.mmm dddmm.mmm ddmm.mm ddmmm deg_min deg-min degmin °'",
    "m/s": "m/s 米/秒 mps ms-1 m.s-1 m*s-1 m_s m_s-1 m·s-1 m/sec meter/s metre/s m/sek mtr/s m_per_s",
    "knots": "kn kt kts knot knots knoten knop knots. noeud noeuds nd nds nudo nudos nodo nodi no nos"
    " sm/h nmi/h nm/h",
    "km/h": "km/h kmh kph km/t kmt km/hr",
    "cm/s": "cm/s",
    "mm/s": "mm/s",
    "deg/s": "deg/s °/s deg/sec dps deg_s-1 deg.s-1 grad/s °/sec deg_s º/s grader/s degrees/s degree/s degree_s-1"
    " 度/秒",
    "deg/min": "度/分 deg/min °/min deg/m dpm °/m grad/min deg_min-1 °/minute deg/minute º/min degrees/min",
    "rad/s": "rad/s rad/sec rads-1 rad.s-1 rad_s rad_s-1 radians/s",
    "rpm": "rpm 1/min min-1 /min u/min r/min upm o/min tr/min omdr/min rev/min giri/min min^-1 r.p.m. rpm. omw/min"
    " 转/分 回転/分",
    "rps": "rps 1/s s-1 r/s hz rev/s u/s tr/s s^-1 n/s",
    "percent": "% pct percent prosent prozent procent pourcent per_cent %_max pc porcentaje por_ciento",
    "m": "m meter meters metre metres mtr mts metros metri",
    "km": "km",
    "cm": "cm",
    "mm": "mm",
    "ft": "ft feet",
    "nmi": "nmi nm sm",
    "s": "s sec secs second seconds sek sekunden sekunder seconde secondes segundos secondi sekunde",
    "ms": "ms msec millis milliseconds millisec",
    "us": "us µs μs usec microseconds",
    "ns": "ns nsec nanoseconds",
    "min": "min minutes minuten minutter",
    "h": "h hr hrs hours stunden timer",
    "d": "d day days tage dager",
    "kW": "kw",
    "MW": "mw",
    "W": "w watt",
    "Nm": "nm n.m n*m n·m n_m n-m",
    "kNm": "knm kn.m kn*m kn·m kn_m kn-m",
    "N": "n newton",
    "hPa": "hpa mbar",
    "degC": "°c degc celsius c degrees_c",
    "1": "1 - n/a none",
}
_BY_NAME: dict[str, tuple[str, ...]] = {}
for _unit, _words in _NAMES.items():
    for _word in _words.split():
        _BY_NAME[_word] = (*_BY_NAME.get(_word, ()), _unit)
_CASED = {"Nm": ("Nm",), "NM": ("nmi",), "nm": ("nmi", "Nm"), "mW": (), "N": ("N",), "kN": ("knots",)}
"""Where capitals matter; ``kN`` heads columns of speeds more often than of forces, and its quantity decides."""
_NOT_UNITS = re.compile(
    r"utc|gmt|local|lt|z|[ymdhms./:\-, t]+|[\d.]*f|iso.*|n/s|e/w|ns|ew|text|string|bool|float|int|enum|on/off|true|"
    r"magn?|hh.*|dd.*|yyyy.*|t[rm]m.*|jjjj.*", re.IGNORECASE,
)  # fmt: skip
_BRACKETED = re.compile(r"\s*[\[({<]([^\[\](){}<>]*(?:\([^()]*\))?[^\[\](){}<>]*)[\])}>]\s*")
_LONGEST_AFFIX = 3


class Headed(NamedTuple):
    """A column's name without its unit, the units it may mean (several where one word is two), the text of it."""

    name: str
    units: tuple[str, ...]
    text: str


def units_called(text: str) -> tuple[str, ...]:
    """The units that a text may mean, most usual first; none where it is no unit that is known.

    >>> units_called("°/min"), units_called("m s-1"), units_called("Knoten"), units_called("furlongs")
    (('deg/min',), ('m/s',), ('knots',), ())
    """
    text = text.strip().strip("[](){}").strip()
    if text in _CASED:
        return _CASED[text]
    plain = text.lower().replace("′", "'").replace("⁻¹", "-1").replace("^", "").replace("œ", "oe")
    plain = re.sub(r"\s*([/*·.])\s*", r"\1", plain)
    for form in (plain, plain.replace(" ", "_"), plain.replace(" ", ""), _without_accents(plain)):
        if form in _BY_NAME:
            return _BY_NAME[form]
    return ()


def is_unit_cell(text: str) -> bool:
    """Whether a cell of a row below the names may stand in a row of units."""
    bare = text.strip().strip("[](){}").strip()
    return bare in ("", "-") or bool(units_called(bare)) or bool(_NOT_UNITS.fullmatch(bare))


def headed(name: str) -> Headed:
    """A name as it stands in the head of a table, its unit taken off: in brackets, after a slash or comma, or last.

    >>> headed("Speed over ground [kn]").name, headed("sog_kn").units, headed("v / (m/s)").units
    ('Speed over ground', ('knots',), ('m/s',))
    """
    for match in reversed(list(_BRACKETED.finditer(name))):
        units = units_called(match[1])
        if units or _NOT_UNITS.fullmatch(match[1].strip()):
            bare = (name[: match.start()] + " " + name[match.end() :]).strip(" /,;:-")
            return Headed(bare, units, match[1].strip())
    for pattern in (r"\s+/\s*|\s*/\s+", r"\s*,\s*", r"\s+in\s+", r"\s*:\s*"):
        parts = re.split(pattern, name)
        if len(parts) > 1 and (units := units_called(parts[-1])):
            return Headed(" ".join(parts[:-1]), units, parts[-1])
    words = re.split(r"[_\s]+", name)
    for count in range(min(_LONGEST_AFFIX, len(words) - 1), 0, -1):
        text = " ".join(words[-count:])
        if units := units_called(text):
            return Headed(" ".join(words[:-count]), units, text)
    stem, _, last = name.rpartition("/")
    return Headed(stem, units, last) if stem and (units := units_called(last)) else Headed(name, (), "")
