"""What columns are called: the quantities of a trial in the words of several languages, loggers and programs.

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


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity by the name of its channel, or a word for what becomes channels: its unit and its phrases."""

    name: str
    unit: str
    phrases: tuple[str, ...]


_TREE = tomllib.loads(Path(__file__).with_name("column_names.toml").read_text(encoding="utf-8"))
_WORDS = {name: frozenset(words.split()) for name, words in _TREE.pop("words").items()}
_WHOLE = {short: whole for whole, shorts in _TREE.pop("abbreviations").items() for short in shorts.split()}
_LATIN = 0x2E80  # where the letters of East Asia begin
_SHORT = 4  # letters: what is shorter is an abbreviation as a word only


def _plain(text: str) -> str:
    """Small letters without accents."""
    text = text.lower().replace("ß", "ss").replace("ø", "o").replace("æ", "ae").replace("œ", "oe")
    return "".join(each for each in unicodedata.normalize("NFKD", text) if not unicodedata.combining(each))


def _in_full(word: str) -> str:
    """A word that is an abbreviation, or ends in one as ``drehgeschw`` does, in full."""
    short = next((each for each in _WHOLE if word == each or (len(each) > _SHORT and word.endswith(each))), "")
    return word.removesuffix(short) + _WHOLE[short] if short else word


def _phrase(text: str) -> str:
    """A phrase as a name has it."""
    return " ".join(_in_full(word) for word in _plain(text).split())


QUANTITIES = tuple(
    Quantity(name, entry["unit"], tuple(_phrase(each) for each in entry["phrases"].split(",")))
    for name, entry in _TREE.items()
)
_PHRASES = frozenset(phrase for each in QUANTITIES for phrase in each.phrases)
LETTERS = frozenset(letter for phrase in _PHRASES for letter in phrase if ord(letter) > _LATIN)
"""The Chinese and Japanese letters of the phrases."""
PORT, STARBOARD, BOW, STERN = (_WORDS[name] for name in ("port", "starboard", "bow", "stern"))
TUNNEL, ORDER = _WORDS["tunnel"], _WORDS["order"]
_SAY_NO_MORE = PORT | STARBOARD | BOW | STERN | TUNNEL | ORDER | _WORDS["centre"] | _WORDS["nothing"]
_LEAST_COVER = 0.55  # a "vertical velocity" is no speed: half of the name says something else
_REST_COUNTS = 0.05  # of words that say nothing: the plainer of two names is meant


@dataclass(frozen=True, slots=True)
class Match:
    """What a name may mean, how much of it says so (0 to 1), and the words that it has besides."""

    quantity: Quantity
    cover: float
    rest: frozenset[str]


def words_of(name: str) -> tuple[str, ...]:
    """The words of a name in small letters without accents: ``SpeedOverGround`` is three.

    >>> words_of("Kurs ü. Grund"), words_of("windDir_rel2")
    (('kurs', 'u', 'grund'), ('wind', 'dir', 'rel', '2'))
    """
    text = re.sub(r"(?<=[a-zäöüåøæéè0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z]{2})", " ", name)
    return tuple(_in_full(word) for word in re.findall(r"[^\W\d_]+|\d+", _plain(text)))


@lru_cache(maxsize=4096)
def matches(name: str) -> tuple[Match, ...]:
    """What a column's name, without its unit, may mean; the likeliest first, nothing for unknown words."""
    words = words_of(name)
    if " ".join(words) not in _PHRASES and any(word in _WORDS["other"] or "force" in word for word in words):
        return ()
    text, joined = f" {' '.join(words)} ", "".join(words)
    found = [each for quantity in QUANTITIES if (each := _match(quantity, words, text, joined))]
    return tuple(sorted(found, key=lambda each: -each.cover))


def _match(quantity: Quantity, words: tuple[str, ...], text: str, joined: str) -> Match | None:
    """How well the longest of a quantity's phrases covers a name; single letters count as a whole name only.

    Words of sides may stand amid a phrase, and its words in another order.
    """
    plain = f" {' '.join(word for word in words if word not in PORT | STARBOARD)} "
    said = [each for each in quantity.phrases if len(each) > 1 and (f" {each} " in text or f" {each} " in plain)]
    if joined in {each.replace(" ", "") for each in quantity.phrases}:
        return Match(quantity, 1.0, frozenset())
    said += [each for each in quantity.phrases if " " in each and _in_any_order(each, words)]
    if not said:
        return None
    phrase = max(said, key=len)
    rest = list(words)
    for word in phrase.split():
        rest.remove(word)
    others = [word for word in rest if word not in _SAY_NO_MORE and not word.isdigit()]
    size = len(phrase.replace(" ", ""))
    cover = size / (size + sum(map(len, others)) + _REST_COUNTS * len(rest))
    return Match(quantity, cover, frozenset(rest)) if cover >= _LEAST_COVER else None


def _in_any_order(phrase: str, words: tuple[str, ...]) -> bool:
    """Whether a name has each word of a phrase, none of which is a single letter."""
    parts = phrase.split()
    return min(map(len, parts)) > 1 and not Counter(parts) - Counter(words)
