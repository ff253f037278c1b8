"""The profile of an effect whose size varies over a trial.

Currents differ from day to day, a tow may be dropped, a tide turns. Such an effect has a size in each of
several pieces of a trial, and its signatures are those of the constant effect times the weight of each piece in
each second. It joins the catalogue beside the constant effect, and the evidence decides between the two: every
further size has to pay for itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.log import Log
from seatrial.hybrid.effects import Catalogue
from seatrial.hybrid.vessel.effect import Effect

Shape = Literal["recordings", "until", "since", "step", "drift"]

_MOST = 0.5  # of the time has to be in recordings with more than one leg
_LEVELS = 24
"""Steps into which a drift is divided for linearisation; between them it is followed to first order."""


@dataclass(frozen=True, slots=True)
class TimeProfile:
    """The profile of an effect's size over a trial.

    A separate size in each of the ``times_s`` recordings (their numbers); one size ``until`` a time, ``since``
    a time, or on both sides of it (``step``); or a linear ``drift`` from the first of two times to the second.
    Times are UTC since 1970 [s], ``interval_s`` is the 95 % interval of the time of a change.
    """

    shape: Shape
    times_s: tuple[float, ...]
    interval_s: tuple[float, float] | None = None

    @property
    def pieces(self) -> int:
        """The number of pieces with separate sizes."""
        return {"recordings": len(self.times_s), "until": 1, "since": 1, "step": 2, "drift": 2}[self.shape]

    def shares(self, log: Log) -> Floats:
        """The weight of each piece's size in each second [T, pieces]."""
        if self.shape == "recordings":
            return np.asarray(log.recording[:, None] == np.array(self.times_s), dtype=np.float64)
        if self.shape == "drift":
            first, last = self.times_s
            late = np.clip((log.time_s - first) / max(last - first, 1.0), 0.0, 1.0)
        else:
            late = np.asarray(log.time_s >= self.times_s[0], dtype=np.float64)
        ends = {"until": (1.0 - late,), "since": (late,)}
        return np.column_stack(ends.get(self.shape, (1.0 - late, late)))

    def levels(self, log: Log) -> Floats:
        """The weights rounded to a few levels, each constant within a block."""
        mean = [np.bincount(log.block, weights=share) / np.bincount(log.block) for share in self.shares(log).T]
        levels = _LEVELS if self.shape == "drift" else 1
        return np.asarray(np.round(np.column_stack(mean)[log.block] * levels) / levels)


@dataclass(frozen=True)
class TimeVaryingEffect(Effect):
    """An effect ``of`` the catalogue whose size follows a profile: the coordinates of its pieces in order."""

    of: str = ""
    profile: TimeProfile = TimeProfile("since", (0.0,))

    @property
    def base(self) -> str:
        """The name in the catalogue."""
        return self.of

    def pieces(self, free: Sequence[float]) -> list[tuple[float, ...]]:
        """Free coordinates of each piece."""
        width = len(free) // self.profile.pieces
        return [tuple(free[first : first + width]) for first in range(0, len(free), width)]

    def bounded(self, free: Sequence[float]) -> tuple[float, ...]:
        """The closest free coordinates within bounds, piece by piece."""
        return tuple(
            coordinate
            for piece in self.pieces(free)
            for coordinate in super(TimeVaryingEffect, self).bounded(piece)
        )

    @property
    def free_scale(self) -> tuple[float, ...]:
        """The typical size of each free coordinate."""
        return super().free_scale * self.profile.pieces

    @property
    def smallest_free(self) -> tuple[float, ...]:
        """The smallest size of interest of each free coordinate."""
        return super().smallest_free * self.profile.pieces


def time_varying(effect: Effect, profile: TimeProfile) -> TimeVaryingEffect:
    """An effect with a profile, under a name of its own."""
    values = {attribute.name: getattr(effect, attribute.name) for attribute in fields(Effect)}
    return TimeVaryingEffect(
        **{**values, "name": f"{effect.name}, {profile.shape}"}, of=effect.name, profile=profile
    )


def with_recordings(catalogue: Catalogue, log: Log) -> Catalogue:
    """The catalogue plus environmental and sensor effects with a separate size in each recording.

    The catalogue itself if there is only one recording, or most of the time is in recordings of a single leg:
    there is no other leg to test such a size on.
    """
    recordings = tuple(np.unique(log.recording).tolist())
    legs = {recording: np.unique(log.leg[log.recording == recording]).size for recording in recordings}
    judged = np.isin(log.recording, [recording for recording in recordings if legs[recording] > 1])
    if len(recordings) < 2 or judged.mean() < _MOST:
        return catalogue
    profile = TimeProfile("recordings", recordings)
    varying = [time_varying(effect, profile) for effect in catalogue.values() if effect.scope != "ship"]
    return {**catalogue, **{effect.name: effect for effect in varying}}


def time_varying_among(names: Iterable[str], catalogue: Catalogue) -> list[TimeVaryingEffect]:
    """Those of ``names`` that have a profile."""
    return [effect for effect in map(catalogue.__getitem__, names) if isinstance(effect, TimeVaryingEffect)]


def base_names(names: Iterable[str], catalogue: Catalogue) -> tuple[str, ...]:
    """Names as in the catalogue, each once."""
    return tuple(dict.fromkeys(catalogue[name].base for name in names))
