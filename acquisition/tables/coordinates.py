"""Latitudes and longitudes as text, and hemispheres by word or letter, in a closed vocabulary of many languages.

A hemisphere that is read wrongly mirrors the track: what is not in the vocabulary is refused, and an O, which is
east in some languages and west in others, is decided by what stands beside it or asked.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import pandas as pd

from seatrial.acquisition.core.arrays import Floats
from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.units import from_degrees_and_minutes
from seatrial.acquisition.tables.column_names import plain_letters

Axis = Literal["north_south", "east_west"]
MeaningOfO = Literal["east", "west"]
_WORDS: dict[Axis, tuple[str, str]] = {
    "north_south": (
        "n north northern northward nord norden nordlich nordlig norra norr norte noord noorderbreedte nb nordre"
        " nordbreite septentrional pohjoinen polnoc sever severni kuzey север с северная 北 北纬 北緯 +1 1",
        "s south southern southward sud suden sudlich sudlig sodra soder syd sydlig sur sul zuid zuiderbreedte zb"
        " z sudbreite meridional etela poludnie jih juzni guney юг ю южная 南 南纬 南緯 -1",
    ),
    "east_west": (
        "e east eastern eastward ost osten ostlich ostlig ostra oster oost oosterlengte ol est este leste l"
        " oriental ostlange ita wschod vychod vychodni dogu восток в восточная 东 東 东经 東経 +1 1",
        "w west western westward westen westlich vest vestlig vast vastra vaster westerlengte wl v ouest oeste"
        " ovest occidental westlange lansi zachod zapad zapadni bati запад з западная 西 西经 西経 -1",
    ),
}
"""The words of the two hemispheres of each axis, the positive one first, in small letters without accents."""
_SIGNS: dict[Axis, dict[str, float]] = {
    axis: {word: sign for words, sign in zip(sides, (1.0, -1.0), strict=True) for word in words.split()}
    for axis, sides in _WORDS.items()
}
_O_IS_WEST = frozenset({"e", "l", "east", "est", "este", "leste"})
_O_IS_EAST = frozenset({"w", "v", "z", "west", "vest", "zuid"})
_EAST_OF_THE_NORTH = ("ø", "ö")  # Øst, Öst: without its accent it would be an O
_NUMBER = r"\d+(?:[.,]\d+)?"
_CELL = re.compile(
    rf"(?P<before>[^\W\d_]*)\.?\s*(?P<sign>[+-]?)\s*(?P<degrees>{_NUMBER})"
    r"\s*(?P<unit>°|º|˚|度|grad|degrees?|deg\.?|d(?=[\s\d]|$))?[\s:,-]*"
    rf"(?:(?P<minutes>{_NUMBER})\s*(?:'|′|’|´|分|minutes?|min\.?|m(?=[\s\d]|$))?[\s:]*"
    rf"(?:(?P<seconds>{_NUMBER})\s*(?:\"|″|”|''|’’|秒|seconds?|sec\.?|s(?=\s*[^\W\d_])|(?<=\d)s(?=$))?)?)?"
    r"\s*(?P<behind>[^\W\d_]*)\.?",
    re.IGNORECASE,
)
_RUSSIAN = re.compile(r"([сю])\.?\s?ш(?:\.|\b)|([вз])\.?\s?д(?:\.|\b)", re.IGNORECASE)
"""North, south, east and west of latitude and longitude in Russian, by two letters, of which the first counts."""
_DIGITS_OF_DDMM = 4  # before the point: degrees alone have three at most


def signs_of(column: pd.Series[Any], axis: Axis, o_is: MeaningOfO | None = None) -> Floats:
    """1 for north and east, -1 for south and west by the words of a column [n]; NaN for an empty cell.

    Raises :class:`InputError` for a word that is not known, and an O that may be either.
    """
    words = [_word(cell) if pd.notna(cell) else "" for cell in column.tolist()]
    o_is = o_is or meaning_of_o(words, str(column.name))
    signs = {word: _sign(word, axis, o_is, column, words.index(word)) for word in set(words)}
    return np.array([signs[word] for word in words], dtype=float)


def _word(cell: Any) -> str:
    text = _RUSSIAN.sub(r"\1\2", str(cell)).strip(" .").lower()
    return "ost" if text in _EAST_OF_THE_NORTH else plain_letters(text)


def _sign(word: str, axis: Axis, o_is: MeaningOfO | None, column: pd.Series[Any], row: int) -> float:
    word = word.removesuffix(".0")  # of a column of 1 and -1
    if not word:
        return np.nan
    if word == "o" and axis == "east_west":
        if o_is is None:
            raise InputError(
                f"column {column.name!r} has the letter O, which is east in some languages and west in others",
                fix="write E and W, or --answer o_is=east|west",
            )
        return 1.0 if o_is == "east" else -1.0
    if word not in _SIGNS[axis]:
        cell = str(column.iloc[row])
        what = f"row {row + 1} of column {column.name!r} names a hemisphere that is not known: {cell!r}"
        raise InputError(what, fix="write N and S" if axis == "north_south" else "write E and W")
    return _SIGNS[axis][word]


def names_hemispheres(column: pd.Series[Any], axis: Axis) -> bool:
    """Whether a column of text holds hemispheres of an axis alone, and at least one."""
    letters = {word for cell in column.dropna().unique() if (word := _word(cell))}
    return bool(letters) and letters <= {word for word in (*_SIGNS[axis], "o") if word.isalpha()}


def meaning_of_o(words: Iterable[str], name: str) -> MeaningOfO | None:
    """West beside an E or an L (oeste, ouest, ovest), east beside a W, V or Z (Ost, oost); None where nothing is.

    >>> meaning_of_o(["o"], "E/O"), meaning_of_o(["o", "w"], "lon"), meaning_of_o(["o"], "lon")
    ('west', 'east', None)
    """
    for hints in (set(words), set(re.findall(r"(?<![a-z])[elwvz](?![a-z])", plain_letters(name)))):
        is_west, is_east = bool(hints & _O_IS_WEST), bool(hints & _O_IS_EAST)
        if is_west != is_east:
            return "west" if is_west else "east"
    return None


def has_unclear_o(column: pd.Series[Any]) -> bool:
    """Whether a column of hemispheres, or of longitudes with them, has an O that nothing beside it decides."""
    words = [word for cell in column.dropna().astype("str").unique() for word in _words(cell)]
    return "o" in words and meaning_of_o(words, str(column.name)) is None


def _words(cell: str) -> list[str]:
    match = _CELL.fullmatch(cell.strip())
    return [_word(cell)] if match is None else [_word(match[part]) for part in ("before", "behind") if match[part]]


def degrees_of_text(
    latitude: pd.Series[Any], longitude: pd.Series[Any], o_is: MeaningOfO | None = None
) -> tuple[list[Floats], list[Floats]]:
    """Degrees of text such as 62°28.146'N, 6228.146N, 62 28 08.8 N, N62.469 or -62.469, without their hemisphere's
    sign, and the signs [n] that the text gives, NaN where it names none. NaN for what is no angle.

    Raises :class:`InputError` as :func:`signs_of`, and for a negative angle of a positive hemisphere.
    """
    cells = [[_match(cell) for cell in column.tolist()] for column in (latitude, longitude)]
    singles = [match["degrees"] for matches in cells for match in matches if match and _is_single(match)]
    is_ddmm = any(len(re.split("[.,]", text)[0]) >= _DIGITS_OF_DDMM for text in singles)
    sizes, signs = [], []
    for column, matches, axis in zip((latitude, longitude), cells, _WORDS, strict=True):
        words = [(match["behind"] or match["before"]) if match else None for match in matches]
        signs.append(signs_of(pd.Series(words, name=column.name, dtype=object), axis, o_is))
        sizes.append(np.array([_degrees(match, is_ddmm) for match in matches], dtype=float))
    return sizes, signs


def _match(cell: Any) -> re.Match[str] | None:
    return _CELL.fullmatch(_RUSSIAN.sub(r"\1\2", str(cell).strip())) if pd.notna(cell) else None


def _is_single(match: re.Match[str]) -> bool:
    return match["minutes"] is None and match["unit"] is None


def _degrees(match: re.Match[str] | None, is_ddmm: bool) -> float:
    if match is None:
        return np.nan
    whole_degrees, minutes, seconds = (
        float((match[part] or "0").replace(",", ".")) for part in ("degrees", "minutes", "seconds")
    )
    if is_ddmm and _is_single(match):
        whole_degrees = float(from_degrees_and_minutes(whole_degrees)) if whole_degrees % 100.0 < 60.0 else np.nan
    size = whole_degrees + minutes / 60.0 + seconds / 3600.0
    return -size if match["sign"] == "-" else size


def with_hemisphere(values: Floats, signs: Floats, column: pd.Series[Any]) -> Floats:
    """Angles [n] with the sign of their hemisphere [n]; :class:`InputError` where theirs says the other one."""
    wrong = np.flatnonzero((values < 0.0) & (signs > 0.0))
    if wrong.size:
        where = f"row {wrong[0] + 1} of column {column.name!r}"
        what = f"{where}, {column.iloc[wrong[0]]!r}, is negative, but of the north or the east"
        raise InputError(what, fix="correct the sign, or leave the column of hemispheres out")
    return np.asarray(np.abs(values) * signs)
