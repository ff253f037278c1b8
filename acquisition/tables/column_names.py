"""The vocabulary of column headers: the quantities that names mean, in several languages, and the units they state.

Names are compared in small letters without accents. The longest phrase that a name contains counts, and the more of
the name it covers the better. Units are those of :mod:`seatrial.acquisition.core.quantities`.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from seatrial.acquisition.core.quantities import is_unit
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
_EAST_ASIA = 0x2E80  # where the letters of East Asia begin
_SHORT_LETTERS = 4  # an abbreviation of no more letters counts as a whole word only, not at the end of one


def lower_case_without_accents(text: str) -> str:
    """A text in small letters without accents."""
    return _without_accents(text.lower().replace("ß", "ss").replace("ø", "o").replace("æ", "ae").replace("œ", "oe"))


def _without_accents(text: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))


def _expand_abbreviation(word: str) -> str:
    """A word that is an abbreviation, or ends in one as ``drehgeschw`` does, in full."""
    short = next(
        (key for key in _FULL_WORDS if word == key or (len(key) > _SHORT_LETTERS and word.endswith(key))), ""
    )
    return word.removesuffix(short) + _FULL_WORDS[short] if short else word


QUANTITIES = tuple(
    Quantity(
        name,
        entry["unit"],
        tuple(
            " ".join(_expand_abbreviation(word) for word in lower_case_without_accents(phrase).split())
            for phrase in entry["phrases"].split(",")
        ),
    )
    for name, entry in _TREE.items()
)
QUANTITY_BY_CHANNEL = {quantity.name: quantity for quantity in QUANTITIES if quantity.name in BY_NAME} | {
    f"{quantity.name}_deg": quantity for quantity in QUANTITIES if quantity.name in ("latitude", "longitude")
}
"""The quantities that are channels, by channel."""
_PHRASES = frozenset(phrase for quantity in QUANTITIES for phrase in quantity.phrases)
_WORDS_BY_PHRASE = {phrase: Counter(phrase.split()) for phrase in _PHRASES}
_COMPACT_PHRASES = {
    quantity: frozenset(phrase.replace(" ", "") for phrase in quantity.phrases) for quantity in QUANTITIES
}
EAST_ASIAN_LETTERS = frozenset(letter for phrase in _PHRASES for letter in phrase if ord(letter) > _EAST_ASIA)
"""The Chinese and Japanese characters in the phrases."""
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
_UNINFORMATIVE_WORDS = PORT | STARBOARD | BOW | STERN | TUNNEL | ORDER | _WORDS["centre"] | _WORDS["nothing"]
_MIN_COVER = 0.55  # a "vertical velocity" is no speed: half of the name means something else
_EXTRA_WORD_LETTERS = 0.05  # what an uninformative word counts, so that the plainer of two names is preferred


_MAGNETIC_BY_TRUE = {
    "heading_deg": "heading_magnetic_deg",
    **dict.fromkeys(("course_over_ground_deg", "course"), "course_magnetic"),
    **dict.fromkeys(("wind_direction_deg", "wind_direction"), "wind_direction_magnetic"),
}
_MAGNETIC_MARK = re.compile(  # elsewhere an m is a height, a mean or "measured"
    r"(?:[°º]|deg[\s_.]?)[mM](?![A-Za-z/])|[\[(]\s*M\s*[\])]"
    r"|(?<![A-Za-z])(?:HDG|COG|CMG|TWD|GWD|Hdg|Cog|Heading|Course)[ _]?M\b"
)


class Match(NamedTuple):
    """A quantity that a name may mean, and the fraction of the name that says so."""

    quantity: Quantity
    cover: float


def split_into_words(name: str) -> tuple[str, ...]:
    """The words of a name in small letters without accents: ``SpeedOverGround`` is three.

    >>> split_into_words("Kurs ü. Grund"), split_into_words("windDir_rel2")
    (('kurs', 'u', 'grund'), ('wind', 'dir', 'rel', '2'))
    """
    text = re.sub(r"(?<=[a-zäöüåøæéè0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z]{2})", " ", name)
    return tuple(
        _expand_abbreviation(word) for word in re.findall(r"[^\W\d_]+|\d+", lower_case_without_accents(text))
    )


@lru_cache(maxsize=4096)
def match_quantities(name: str) -> tuple[Match, ...]:
    """The quantities that a column's name, without its unit, may mean, the likeliest first.

    How well the longest of a quantity's phrases covers the name; single letters count as a whole name only. Words
    of sides may stand inside a phrase, and its words may be in another order, unless one is a single letter.
    """
    words = split_into_words(name)
    if " ".join(words) not in _PHRASES and any(word in _WORDS["other"] or "force" in word for word in words):
        return ()
    text, compact_text = f" {' '.join(words)} ", "".join(words)
    text_without_sides = f" {' '.join(word for word in words if word not in PORT | STARBOARD)} "
    matches, counts = [], Counter(words)
    for quantity in QUANTITIES:
        if compact_text in _COMPACT_PHRASES[quantity]:
            matches.append(Match(quantity, 1.0))
            continue
        possible = [phrase for phrase in quantity.phrases if _WORDS_BY_PHRASE[phrase].keys() <= counts.keys()]
        fitting = [
            phrase
            for phrase in possible
            if len(phrase) > 1 and (f" {phrase} " in text or f" {phrase} " in text_without_sides)
        ]
        for phrase in possible:
            parts = _WORDS_BY_PHRASE[phrase]
            if parts.total() > 1 and min(map(len, parts)) > 1 and parts <= counts:
                fitting.append(phrase)
        if not fitting:
            continue
        longest, remaining = max(fitting, key=len), list(words)
        for word in longest.split():
            remaining.remove(word)
        unexplained = [word for word in remaining if word not in _UNINFORMATIVE_WORDS and not word.isdigit()]
        size = len(longest.replace(" ", ""))
        cover = size / (size + sum(map(len, unexplained)) + _EXTRA_WORD_LETTERS * len(remaining))
        if cover >= _MIN_COVER:
            matches.append(Match(quantity, cover))
    return tuple(sorted(matches, key=lambda match: -match.cover))


def quantity_of_header(header: str) -> str:
    """The name of the quantity that a column's header most likely means; empty for none.

    >>> quantity_of_header("Mag Var [deg]"), quantity_of_header("furlongs")
    ('magnetic_variation_deg', '')
    """
    return next((match.quantity.name for match in match_quantities(split_header(header).name)), "")


def refer_to_north(quantity: Quantity, header: str) -> Quantity:
    """A direction as that from magnetic north where a column's header says so, in its name, unit or brackets.

    >>> [refer_to_north(QUANTITY_BY_CHANNEL["heading_deg"], text).name for text in ("HDG (°M)", "HdgT", "hdg_m")]
    ['heading_magnetic_deg', 'heading_deg', 'heading_deg']
    """
    name = _MAGNETIC_BY_TRUE.get(quantity.name)
    if name is None or not (_MAGNETIC_MARK.search(header) or {*split_into_words(header)} & _WORDS["magnetic"]):
        return quantity
    return next(entry for entry in QUANTITIES if entry.name == name)


_COMPONENT = re.compile(r"(.+?)[_ .\[]*(\d)\]?")
_NUMBERS_OF_COMPONENTS = (("1", "2", "3"), ("0", "1", "2"))
_EULER_ANGLES = ("roll", "pitch", "yaw")
_ANGLES, _RATES = frozenset({"orientation", "attitude", "euler", "rpy"}), frozenset({"rotational", "angular"})


def components_by_name(names: Sequence[str]) -> dict[str, str]:
    """What numbered columns hold that mean something together only: the three components of a vector of angles or
    rates of rotation, and n1, n2, ..., as the speeds of shafts are called.

    >>> components_by_name(["attitude_0", "attitude_1", "attitude_2"])["attitude_2"]
    'attitude yaw'
    """
    numbered: dict[str, dict[str, str]] = {}
    for name in names:
        if match := _COMPONENT.fullmatch(name):
            numbered.setdefault(match[1], {})[match[2]] = name
    meanings: dict[str, str] = {}
    for stem, siblings in numbered.items():
        words = split_into_words(stem)
        if words == ("n",) and len(siblings) > 1:
            meanings |= {name: f"shaft speed {number}" for number, name in siblings.items()}
        for numbers in _NUMBERS_OF_COMPONENTS:
            axes = _EULER_ANGLES if _ANGLES & {*words} else "xyz" if _RATES & {*words} else ()
            if axes and tuple(sorted(siblings)) == numbers:
                meanings |= {
                    siblings[number]: f"{' '.join(words)} {axis}"
                    for number, axis in zip(numbers, axes, strict=True)
                }
    return meanings


_SPELLINGS_BY_UNIT: dict[str, str] = {
    "deg": "deg degs degree degrees ° º deg. grad degrees_true degrees_north degrees_east degree_north degree_east"
    " degrees_n degrees_e degt deg_t °t deg(t) deg_true deg_rel deg_mag °_true °_rel degm deg_m °m deg(m) °_mag"
    " °mag gradi grados graus grader degrees_t 度 °true dd decimal_degrees decdeg",
    "rad": "rad rads radian radians radianer",
    "degE7": "dege7 1e-7deg deg*1e7",
    "ddeg": "ddeg 0.1deg 0.1_deg 0.1° deg*10 degx10 deg/10 1/10deg 1/10_deg 1/10° decideg decidegrees tenths"
    " tenths_of_degrees tenths_of_a_degree",
    "cdeg": "cdeg 0.01deg 0.01_deg 0.01° deg*100 degx100 deg/100 1/100deg 1/100_deg 1/100° centideg centidegrees"
    " hundredths hundredths_of_degrees hundredths_of_a_degree",
    "ddmm": "dmm ddm ddmm ddmm.mmmm dddmm.mmmm ddmm.mmm dddmm.mmm ddmm.mm ddmmm deg_min deg-min degmin °'",
    "m/s": "m/s 米/秒 mps ms-1 m.s-1 m*s-1 m_s m_s-1 m·s-1 m/sec meter/s metre/s m/sek mtr/s m_per_s"
    " m_per_sec meters_per_second metres_per_second",
    "knots": "kn kt kts knot knots knoten knop knots. noeud noeuds nd nds nudo nudos nodo nodi no nos"
    " sm/h nmi/h nm/h",
    "km/h": "km/h kmh kph km/t kmt km/hr",
    "cm/s": "cm/s",
    "dm/s": "dm/s",
    "mm/s": "mm/s",
    "mph": "mph mi/h mile/h miles/h",
    "ft/s": "ft/s fps ft/sec feet/s",
    "deg/s": "deg/s °/s deg/sec dps deg_s-1 deg.s-1 grad/s °/sec deg_s º/s grader/s degrees/s degree/s degree_s-1"
    " 度/秒 deg_per_s deg_per_sec deg_per_second degrees_per_second",
    "deg/min": "deg_min deg-min degmin 度/分"
    " deg/min °/min deg/m dpm °/m grad/min deg_min-1 °/minute deg/minute º/min degrees/min"
    " deg_per_min deg_per_minute degrees_per_minute",
    "rad/s": "rads radps rad/s rad/sec rads-1 rad.s-1 rad_s rad_s-1 radians/s rad_per_s rad_per_sec"
    " radians_per_second",
    "mrad/s": "mrad/s mrads mradps mrad_s milliradians/s",
    "rpm": "rpm 1/min min-1 /min u/min r/min upm o/min tr/min omdr/min rev/min giri/min min^-1 r.p.m. rpm. omw/min"
    " 转/分 回転/分 rev_per_min revs_per_min revolutions_per_minute",
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
_UNITS_BY_SPELLING: dict[str, tuple[str, ...]] = {}
for _unit, _spellings in _SPELLINGS_BY_UNIT.items():
    for _spelling in _spellings.split():
        _UNITS_BY_SPELLING[_spelling] = (*_UNITS_BY_SPELLING.get(_spelling, ()), _unit)
ELECTRICAL = frozenset({"V", "mV", "A", "mA"})
"""Units of a sensor's signal: what it measures is not known by them."""
_CASED_UNITS = {
    "Nm": ("Nm",), "NM": ("nmi",), "nm": ("nmi", "Nm"), "mW": (), "N": ("N",), "kN": ("knots",),
    **{unit: (unit,) for unit in ELECTRICAL},
}  # fmt: skip
"""Where capitals matter; ``kN`` heads columns of speeds more often than of forces, and its quantity decides."""
_NO_UNIT = re.compile(
    r"utc|gmt|local|lt|z|[ymdhms./:\-, t]+|[\d.]*f|iso.*|n/s|e/w|ns|ew|text|string|bool|float|int|enum|on/off|true|"
    r"magn?|hh.*|dd.*|yyyy.*|t[rm]m.*|jjjj.*", re.IGNORECASE,
)  # fmt: skip
_FORM_OF_TIME = re.compile(r"(?:dd|m{2,3}|(?:yy){1,2}|hh|ss)(?:\W?(?:dd|m{2,3}|(?:yy){1,2}|hh|ss))+", re.IGNORECASE)
_BRACKETED = re.compile(r"\s*[\[({<]([^\[\](){}<>]*(?:\([^()]*\))?[^\[\](){}<>]*)[\])}>]\s*")
_LONGEST_AFFIX = 3


class HeaderUnit(NamedTuple):
    """A column's name without its unit, the units that the header may mean, and the text that states them."""

    name: str
    units: tuple[str, ...]
    text: str


def parse_units(text: str) -> tuple[str, ...]:
    """The units that a text may mean, most usual first; empty for an unknown one.

    >>> parse_units("°/min"), parse_units("m s-1"), parse_units("Knoten"), parse_units("furlongs")
    (('deg/min',), ('m/s',), ('knots',), ())
    """
    text = text.strip().strip("[](){}").strip()
    if text in _CASED_UNITS:
        return _CASED_UNITS[text]
    spelling = text.lower().replace("′", "'").replace("⁻¹", "-1").replace("^", "").replace("œ", "oe")
    spelling = re.sub(r"\s*([/*·.])\s*", r"\1", spelling)
    for form in (spelling, spelling.replace(" ", "_"), spelling.replace(" ", ""), _without_accents(spelling)):
        if form in _UNITS_BY_SPELLING:
            return _UNITS_BY_SPELLING[form]
    return _scaled_units(text) or _rate_units(spelling)


_SCALED = re.compile(
    r"(?:(?P<fraction>0\.0*1)|1/(?P<divisor>10+)|10\^-(?P<digits>[123]))[\s_*]*(?P<unit>[^\W\d].*)"
)
_MULTIPLIED = re.compile(r"(?P<unit>.*\D)\s*[*x×/]\s*(?P<divisor>10+)")
_RATE = re.compile(r"(?P<size>[^/]+?)(?:/|[_ ]per[_ ])(?P<time>[a-z]+)|(?P<size2>.+?)[_ .*·]?(?P<time2>s|min|h)-1")
_RATE_NAMES = {"nmi/h": "knots", "mi/h": "mph"}


def _scaled_units(text: str) -> tuple[str, ...]:
    """The units of a text such as ``0.1 kn``, ``1/10 kn`` or ``kn*10``, which all count tenths of a knot."""
    match = _SCALED.fullmatch(text) or _MULTIPLIED.fullmatch(text)
    if match is None:
        return ()
    parts = match.groupdict()
    exponent = int(parts.get("digits") or 0) or (parts.get("fraction") or parts["divisor"] or "").count("0")
    scaled = (f"{10.0**-exponent:g} {unit}" for unit in parse_units(parts["unit"]))
    return tuple(unit for unit in scaled if is_unit(unit))


def _rate_units(spelling: str) -> tuple[str, ...]:
    """The units of a length or an angle in a time, such as ``metres/minute`` or ``km h-1``."""
    match = _RATE.fullmatch(spelling)
    if match is None:
        return ()
    sizes, times = (
        parse_units(part) for part in ((match["size"] or match["size2"]), (match["time"] or match["time2"]))
    )
    rates = (f"{size}/{time}" for size in sizes for time in times)
    return tuple(rate for rate in (_RATE_NAMES.get(rate, rate) for rate in rates) if is_unit(rate))


_SIDE = "|".join(sorted((word for word in PORT | STARBOARD if len(word) > 1), key=lambda word: (-len(word), word)))
_TOWARDS = r"(?:(?:to|towards?|is|means|when|te|trailing[ _]edge|nach|vers|til)[ _]+)*"
_SIGN_WORD = "[+-]ve|positi[vf][eo]?|negati[vf][eo]?"  # "pos" is a position
_SIGN_STATEMENT = re.compile(
    rf"(?:(?:^|(?<=[\s\[({{,;/_]))[+-]|(?<![^\W_])(?:{_SIGN_WORD}))[\s_=:]*"
    rf"{_TOWARDS}(?P<side>{_SIDE})(?![^\W_])"
    rf"|(?<![^\W_])(?P<named>{_SIDE})[\s_=:]*(?:is[ _]+)?"
    rf"(?:[+-](?=\s*(?:$|[\])}},;/]))|(?:{_SIGN_WORD})(?![^\W_]))"
)


def split_sign_statement(header: str) -> tuple[str, str]:
    """A header without what it says of its sign, and the side that counts positive; empty where it says nothing.

    A minus alone separates words; beside a plus it states the other side.

    >>> split_sign_statement("Rudder angle [deg, + stbd]"), split_sign_statement("rudder_deg_port_positive")
    (('Rudder angle [deg]', 'starboard'), ('rudder_deg', 'port'))
    >>> split_sign_statement("Rudder - port"), split_sign_statement("rpm port + stbd")
    (('Rudder - port', ''), ('rpm port + stbd', ''))
    """
    plain = lower_case_without_accents(header)
    matches = list(_SIGN_STATEMENT.finditer(plain)) if len(plain) == len(header) else []
    positive, end = "", 0
    for match in matches:
        before, end = plain[end : match.start()], match.end()
        if match["side"] and re.search(rf"(?<![^\W_])(?:{_SIDE})[\s_]*$", before):  # "port + stbd" is a sum
            return header, ""
        is_port, is_minus = (match["side"] or match["named"]) in PORT, re.search("-|neg", match[0])
        if not is_minus or re.search("-ve|neg", match[0]):
            positive = "port" if is_port != bool(is_minus) else "starboard"
    if not positive:
        return header, ""
    for match in reversed(matches):
        header = header[: match.start()] + header[match.end() :]
    header = re.sub(r"[\s,;/]*([\])}])", r"\1", header)
    return re.sub(r"\s*(?:\[\]|\(\)|\{\})|\s+(?=\s)", "", header).strip(" _,;:/="), positive


def is_unit_cell(text: str) -> bool:
    """Whether a cell of a row below the names may stand in a row of units."""
    content = text.strip().strip("[](){}").strip()
    return content in ("", "-") or bool(parse_units(content)) or bool(_NO_UNIT.fullmatch(content))


def split_header(name: str) -> HeaderUnit:
    """Split a column header into name and unit: in brackets, after a slash, comma, colon or "in", or last.

    >>> split_header("Speed over ground [kn]").name, split_header("sog_kn").units, split_header("v / (m/s)").units
    ('Speed over ground', ('knots',), ('m/s',))
    >>> split_header("Seconds of day").units
    ()
    """
    name, _ = split_sign_statement(name)
    for match in reversed(list(_BRACKETED.finditer(name))):
        units = parse_units(match[1])
        if units or _NO_UNIT.fullmatch(match[1].strip()):
            stem = (name[: match.start()] + " " + name[match.end() :]).strip(" /,;:-")
            if scaled := re.search(r"[\s_]+[x×*]\s*(10+)$", stem):  # "SOG x10 [kn]"
                units = tuple(unit for stated in units for unit in _scaled_units(f"{stated}*{scaled[1]}"))
                stem = stem[: scaled.start()]
            return HeaderUnit(stem, units, match[1].strip())
    for pattern in (r"\s+/\s*|\s*/\s+", r"\s*,\s*", r"\s+in\s+", r"\s*:\s*"):
        parts = re.split(pattern, name)
        if len(parts) > 1 and _is_balanced(parts[-1]) and (units := parse_units(parts[-1])):
            return HeaderUnit(" ".join(parts[:-1]), units, parts[-1])
    words = re.split(r"[_\s]+", name)
    if len(words) > 1 and _FORM_OF_TIME.fullmatch(words[-1]):
        return HeaderUnit(" ".join(words[:-1]), (), words[-1])
    for count in range(min(_LONGEST_AFFIX, len(words) - 1), 0, -1):
        text = " ".join(words[-count:])
        if (
            _is_balanced(text) and (units := parse_units(text)) and words[-count - 1].lower() not in ("of", "per")
        ):  # "seconds of day"
            return HeaderUnit(" ".join(words[:-count]), units, text)
    stem, _, suffix = name.rpartition("/")
    return (
        HeaderUnit(stem, units, suffix)
        if stem and _is_balanced(suffix) and (units := parse_units(suffix))
        else HeaderUnit(name, (), "")
    )


def _is_balanced(text: str) -> bool:
    """Whether a text is no piece of what stands in brackets."""
    return not re.search(r"[\])}]", re.sub(r"[\[({][^\[\](){}]*[\])}]", "", text))


def readings_of_header(name: str) -> tuple[HeaderUnit, ...]:
    """A column header with its unit split off, and with the last word of that alone: ``pos_n_m`` may be metres to
    the north, too.

    >>> [(head.name, head.units) for head in readings_of_header("pos_n_m")]
    [('pos', ('Nm',)), ('pos n', ('m',))]
    """
    head = split_header(name)
    first, _, last = head.text.rpartition(" ")
    units = parse_units(last) if first and f"{head.name} {head.text}" == " ".join(re.split(r"[_\s]+", name)) else ()
    return (head, HeaderUnit(f"{head.name} {first}", units, last)) if units else (head,)
