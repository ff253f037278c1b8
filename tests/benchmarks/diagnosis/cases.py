"""The cases of the benchmark by group: which trial, how much is hidden in it, what the analyst lacks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np

from seatrial.hybrid.effects import CATALOGUE
from tests.benchmarks.diagnosis.design import Design
from tests.benchmarks.other_ship.outside import OUTSIDE

Size = Literal["small", "designed", "full"]
GROUPS = ("nothing", "singles", "model_off", "pairs", "triples", "outside", "without", "cannot_tell")

DESIGNED = {
    "nothing": 80, "singles": 60, "model_off": 15, "pairs": 30, "triples": 20, "outside": 25, "without": 40,
    "cannot_tell": 30,
}  # fmt: skip
"""How many of all cases the designed set has of each group."""

_USUAL = Design(0, "", "", 0.0)
_PROGRAMME_S, _SHORT_S, _SMALL_S = 3600.0, 1800.0, 1500.0
_NULL_SEED, _SEED = 300_000, 600_000
_SEEDS = 8
_OWN_EVERY = 10
_ABOUT_TOLERANCE = 1.3  # percent of the thrusters' mean square; their range is larger
_VARIATIONS: tuple[dict[str, Any], ...] = (
    {},
    {"model_error_percent": _ABOUT_TOLERANCE, "model_error_form": "coefficients"},
    {"model_error_percent": _ABOUT_TOLERANCE, "model_error_form": "polynomial"},
    {"noise": 2.0},
    {"correlated": True},
    {"outliers": 0.01},
    {"gaps": 0.03},
    {"rate_hz": 2.0, "model_error_percent": 2.0, "model_error_form": "coefficients"},
    {"rate_hz": 1.0},
    {"rate_hz": 4.0},
    {"rate_hz": 5.0, "noise": 2.0},
    {"outliers": 0.01, "gaps": 0.03, "noise": 2.0},
    {"correlated": True, "model_error_percent": 2.0, "model_error_form": "polynomial"},
)
"""Of trials in which nothing is hidden. Coprime in number with seas and programmes: all meet all."""


@dataclass(frozen=True, slots=True)
class Case:
    """One case: ``multiple`` is the size of what is hidden in units of its predicted limit.

    ``effects`` are hidden; where they are empty, ``number`` effects of different families are drawn. ``outside`` is
    one of :data:`OUTSIDE`. ``blind`` takes what is hidden out of the analyst's catalogue.
    """

    group: str
    design: Design
    effects: tuple[str, ...] = ()
    number: int = 0
    multiple: float = 0.0
    outside: str = ""
    blind: bool = False

    @property
    def key(self) -> str:
        """The case in one word."""
        what = "+".join(self.effects) or self.outside or (f"{self.number}-drawn" if self.number else "nothing")
        return f"{self.group}/{self.design.key}/{what}/x{self.multiple:g}"

    @property
    def sound_design(self) -> Design:
        """The trial from which sizes follow: the same with an exact model."""
        return replace(self.design, model_error_percent=0.0, model_error_form=_USUAL.model_error_form)


def cases_of(size: Size) -> list[Case]:
    """All cases, by group in the order of :data:`GROUPS`; ``designed`` are 300 drawn once from all."""
    if size == "designed":
        return _drawn_once(cases_of("full"))
    make = {
        "nothing": _nothing, "singles": _singles, "model_off": _model_off, "pairs": _pairs, "triples": _triples,
        "outside": _outside, "without": _without, "cannot_tell": _cannot_tell,
    }  # fmt: skip
    return [case for group in GROUPS for case in make[group](size)]


def _drawn_once(cases: list[Case]) -> list[Case]:
    random, drawn = np.random.default_rng(0), []
    for group in GROUPS:
        own = [case for case in cases if case.group == group]
        drawn += [own[number] for number in sorted(random.choice(len(own), DESIGNED[group], replace=False))]
    return drawn


def _design(programme: str, sea: str, seed: int, size: Size, **other: Any) -> Design:
    whole = _PROGRAMME_S if programme == "programme" else _SHORT_S
    return Design(seed, sea, programme, whole if size == "full" else _SMALL_S, **other)


def _nothing(size: Size) -> list[Case]:
    seas = ("calm", "gentle", "moderate", "rough")
    programmes = ("programme", "zigzags", "straights", "harbour", "one_speed")
    count = 300 if size == "full" else len(_VARIATIONS)
    return [
        Case(
            "nothing",
            _design(
                programmes[number % 5],
                seas[number % 4],
                _NULL_SEED + number,
                size,
                **_VARIATIONS[number % len(_VARIATIONS)],
            ),
        )
        for number in range(count)
    ]


def _family(programme: str, sea: str, number: int, size: Size, own: bool = False) -> Design:
    """One of a few trials of each kind, so that limits need not be predicted for every case."""
    kinds = list(product(("calm", "gentle", "moderate", "rough"), ("programme", "zigzags", "other")))
    place = kinds.index((sea, programme if programme in ("programme", "zigzags") else "other"))
    seed = _SEED + 100 * place + number % (1 if size == "small" else 2 if own else _SEEDS)
    return _design(programme, sea, seed, size, simulator="own" if own else "other")


def _singles(size: Size) -> list[Case]:
    names = list(CATALOGUE)
    kinds = list(product(("calm", "gentle", "moderate"), ("programme", "zigzags")))
    if size == "small":
        some = ("ocean_current", "heading_bias", "loading", "thrust_loss_port", "cross_flow_drag", "position_delay")
        return [
            Case("singles", _family("programme", "gentle", 0, size), (name,), 1, multiple)
            for name, multiple in product(some, (2.0, 4.0))
        ]
    cases = []
    for number, (name, (sea, programme), multiple) in enumerate(product(names, kinds, (1.2, 2.0, 4.0))):
        own = number % _OWN_EVERY == 0
        cases.append(Case("singles", _family(programme, sea, number // 3, size, own), (name,), 1, multiple))
    return cases


def _model_off(size: Size) -> list[Case]:
    """Singles where the model is off by about the tolerance: intervals have to hold the truth there, too."""
    cases = []
    for number, name in enumerate(CATALOGUE if size == "full" else ("hull_fouling", "thrust_loss_port")):
        sea, programme = ("calm", "gentle", "moderate")[number % 3], ("programme", "zigzags")[number % 2]
        form = ("coefficients", "polynomial")[number // 2 % 2]
        design = replace(
            _family(programme, sea, number, size), model_error_percent=_ABOUT_TOLERANCE, model_error_form=form
        )
        cases.append(Case("model_off", design, (name,), 1, 3.0))
    return cases


def _drawn(group: str, number: int, count: int, size: Size) -> list[Case]:
    """So many effects together; trials and multiples of the limit in turn."""
    kinds = [("gentle", "programme"), ("calm", "programme"), ("moderate", "programme"), ("calm", "zigzags")]
    kinds = kinds[:1] if size == "small" else kinds
    cases = []
    for each in range(count):
        sea, programme = kinds[each % len(kinds)]
        design = _family(programme, sea, each // len(kinds), size)
        # No two cases of a trial have the same multiple, and so none the same key.
        multiple = round(2.0 + 2.0 * (each + 0.5) / count, 3)
        cases.append(Case(group, design, number=number, multiple=multiple))
    return cases


def _pairs(size: Size) -> list[Case]:
    return _drawn("pairs", 2, 100 if size == "full" else 4, size)


def _triples(size: Size) -> list[Case]:
    return _drawn("triples", 3, 60 if size == "full" else 2, size)


def _outside(size: Size) -> list[Case]:
    if size == "small":
        some = ("yaw_moment_4psi", "sheared_current", "fading_thrust")
        return [
            Case("outside", _family("programme", "gentle", 0, size), multiple=3.0, outside=name) for name in some
        ]
    cases = []
    for name, sea, number in product(OUTSIDE, ("calm", "gentle", "moderate"), range(5)):
        # Zigzags at 20 degrees and less show nothing of a stall at 25.
        programme = "zigzags" if number > 2 and name != "one_sided_stall" else "programme"
        cases.append(Case("outside", _family(programme, sea, number, size), multiple=3.0, outside=name))
    return cases


def _without(size: Size) -> list[Case]:
    names = list(CATALOGUE) if size == "full" else ["hull_fouling", "azimuth_offset_port", "heading_bias"]
    kinds = [("gentle", "programme"), ("moderate", "zigzags")] if size == "full" else [("gentle", "programme")]
    return [
        Case("without", _family(programme, sea, number, size), (name,), 1, 3.0, blind=True)
        for number, name in enumerate(names)
        for sea, programme in kinds
    ]


def _cannot_tell(size: Size) -> list[Case]:
    """Every effect in trials of one heading, of one speed, and of thrusters that are always alike."""
    programmes = ("one_heading", "one_speed", "straight", "zigzags")
    designs = [
        replace(_family(programme, sea, number, size), duration_s=_SMALL_S)
        for number, (programme, sea) in enumerate(product(programmes, ("calm", "gentle")))
    ]
    names = list(CATALOGUE)
    if size == "small":
        designs, names = designs[:1], ["loading", "towed_load", "sway_asymmetry", "azimuth_offset_port"]
    return [Case("cannot_tell", design, (name,), 1, 3.0) for design, name in product(designs, names)]
