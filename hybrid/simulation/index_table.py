"""A table of the standard indices of a ship: measured, and by a model before and after a fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any

import numpy as np
import pandas as pd

from seatrial.analysis.manoeuvres.indices import Index, overshoot_from_order_name, unit_in_name

FAMILIES = {
    "turn": ("advance_m", "transfer_m", "tactical_diameter_m", "initial_turning_m"),
    "overshoot": (overshoot_from_order_name(1), overshoot_from_order_name(2)),
    "stop": ("track_reach_m", "head_reach_m", "stopping_time_s"),
}
"""The indices of the table, by the family in which the errors of a model's form are alike."""

NAMES = tuple(name for names in FAMILIES.values() for name in names)
"""The indices of the table."""

_NOTICED = 0.02  # of an index: a smaller difference is none

FormErrors = Mapping[str, tuple[float, int]]
"""By family of index the relative error of a model's form, and of how many indices it is."""


def family_of(name: str) -> str:
    """The family of an index.

    >>> family_of("advance_m")
    'turn'
    """
    return next(family for family, names in FAMILIES.items() if name in names)


@dataclass(frozen=True, slots=True)
class PredictedIndex:
    """An index of a manoeuvre, by two models.

    ``before`` and ``after`` are of the same test from a straight approach; ``replayed_before`` and ``replayed`` of
    the recorded helm; ``held_out`` is that of the model fitted without this recording, as ``replayed`` where it
    could be, else as ``after``. None where there is none: ``measured`` of a test that was not sailed.
    """

    test: str
    side: str
    name: str
    measured: Index | None = None
    before: float | None = None
    after: float | None = None
    predicted: Index | None = None
    replayed_before: float | None = None
    replayed: float | None = None
    held_out: float | None = None
    start: pd.Timestamp | None = None

    @property
    def is_replayed(self) -> bool:
        """Whether both models were run with the recorded helm."""
        return self.replayed_before is not None and self.replayed is not None

    @property
    def moved(self) -> tuple[float, float] | None:
        """The differences from the measured value before and after, of the replays where there are any, relative to
        it; None where one is missing."""
        pair = (self.replayed_before, self.replayed) if self.is_replayed else (self.before, self.after)
        if self.measured is None or not self.measured.value or pair[0] is None or pair[1] is None:
            return None
        value = self.measured.value
        return (pair[0] - value) / abs(value), (pair[1] - value) / abs(value)

    @property
    def is_worse(self) -> bool:
        """Whether the value moved away from the measured one by more than that is uncertain."""
        if self.moved is None or self.measured is None:
            return False
        width = 0.5 * (self.measured.high - self.measured.low) / abs(self.measured.value)
        noticed = max(_NOTICED, width if isfinite(width) else 0.0)
        before, after = map(abs, self.moved)
        return bool(after > noticed and after > before + noticed)

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> PredictedIndex:
        """The inverse of :meth:`as_json`."""
        name, predicted = row["name"], row["predicted"]
        return cls(
            row["test"], row["side"], name,
            _index_of(name, row["measured"], row["measured_low"], row["measured_high"]),
            row["before"], row["after"],
            None if predicted is None else _index_of(name, *(predicted[key] for key in ("value", "low", "high"))),
            row["replayed_before"], row["replayed"], row["held_out"],
            None if row["start"] is None else pd.Timestamp(row["start"]),
        )  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """With the keys of the contract."""
        measured, predicted = self.measured, self.predicted
        return {
            "test": self.test, "side": self.side, "name": self.name, "unit": unit_in_name(self.name),
            "start": None if self.start is None else self.start.isoformat(),
            "measured": None if measured is None else measured.value,
            "measured_low": _finite_or_none(measured.low) if measured else None,
            "measured_high": _finite_or_none(measured.high) if measured else None,
            "before": self.before, "after": self.after,
            "predicted": None if predicted is None else {
                "value": predicted.value, "low": _finite_or_none(predicted.low),
                "high": _finite_or_none(predicted.high),
            },
            "replayed_before": self.replayed_before, "replayed": self.replayed, "held_out": self.held_out,
            "worse": self.is_worse,
        }  # fmt: skip


def _index_of(name: str, value: float | None, low: float | None, high: float | None) -> Index | None:
    """An index from JSON."""
    low, high = (nan if bound is None else bound for bound in (low, high))
    return None if value is None else Index(value, low, high, unit_in_name(name))


def _finite_or_none(value: float) -> float | None:
    return float(value) if isfinite(value) else None


@dataclass(frozen=True, slots=True)
class IndexTable:
    """The indices of two models, the sailed manoeuvres first; ``form_errors`` are relative, by family of index.

    ``speed_mps`` is the approach speed of the standard manoeuvres, the median of those sailed; None without any."""

    rows: tuple[PredictedIndex, ...] = ()
    form_errors: FormErrors = field(default_factory=dict)
    speed_mps: float | None = None

    @property
    def headline(self) -> str:
        """What the fit did to the measured indices, and first whether it made any worse; empty without any."""
        moves = [(row, *row.moved) for row in self.rows if row.moved is not None]
        if not moves:
            return ""
        before, after = np.median(np.abs([move[1:] for move in moves]), axis=0)  # small ones err by many times
        replayed = ", replayed with the recorded helm," * all(row.is_replayed for row, _, _ in moves)
        subject = f"Half of {len(moves)} measured indices" if len(moves) > 1 else "The measured index"
        are = "are" if len(moves) > 1 else "is"
        summary = f"{subject}{replayed} {are} met within {after:.0%}, before within {before:.0%}."
        worse = [
            f"{row.name} of {row.test} {row.side}".strip()
            + f" ({'replayed ' * row.is_replayed}{start:+.0%} before, {end:+.0%} now)"
            for row, start, end in moves if row.is_worse
        ]  # fmt: skip
        if not worse:
            return summary
        judged = "The model is worse" if after > before else "The model is worse in part"
        return f"{judged}: {', '.join(worse)}. {summary}"

    @classmethod
    def from_json(cls, rows: Iterable[Mapping[str, Any]]) -> IndexTable:
        """The inverse of :meth:`as_json`, without the errors of the form."""
        return cls(tuple(map(PredictedIndex.from_json, rows)))

    def as_json(self) -> list[dict[str, Any]]:
        """A row an index, with the keys of the contract."""
        return [row.as_json() for row in self.rows]
