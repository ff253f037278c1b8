"""Units as the heads of tables write them, in several languages, by the names of :mod:`acquisition.core.units`."""

from __future__ import annotations

import re
import unicodedata
from typing import NamedTuple

_NAMES: dict[str, str] = {
    "deg": "deg degs degree degrees ° º deg. grad degrees_true degrees_north degrees_east degree_north degree_east"
    " degrees_n degrees_e degt deg_t °t deg(t) deg_true deg_rel deg_mag °_true °_rel gradi grados graus"
    " grader degrees_t 度 °true dd decimal_degrees decdeg",
    "rad": "rad rads radian radians radianer",
    "degE7": "dege7 1e-7deg deg*1e7",
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
    for found in reversed(list(_BRACKETED.finditer(name))):
        units = units_called(found[1])
        if units or _NOT_UNITS.fullmatch(found[1].strip()):
            bare = (name[: found.start()] + " " + name[found.end() :]).strip(" /,;:-")
            return Headed(bare, units, found[1].strip())
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


def _without_accents(text: str) -> str:
    return "".join(each for each in unicodedata.normalize("NFKD", text) if not unicodedata.combining(each))
