"""What there is to do: first the sound trials that sizes follow from, then the cases with what is hidden drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np

from seatrial.hybrid.diagnosis.planning import DISTINGUISHED
from tests.benchmarks.diagnosis.cases import Case
from tests.benchmarks.diagnosis.design import Design
from tests.benchmarks.diagnosis.outside_size import MOST
from tests.benchmarks.diagnosis.sound import ALIKE, Sound
from tests.benchmarks.diagnosis.work import Job, Planned, SizeOutside

Results = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class Plan:
    """The cases to run, and by key why others are none."""

    cases: list[Planned]
    none: dict[str, str]


def preparations(cases: Sequence[Case]) -> list[Job]:
    """Sound trials and sizes that the cases need, each once."""
    jobs: dict[str, Job] = {}
    for case in cases:
        if case.outside:
            size = SizeOutside(case.outside, case.design)
            jobs[size.key] = size
        elif case.number:
            jobs[case.sound_design.key] = case.sound_design
    return list(jobs.values())


def planned(cases: Sequence[Case], results: Results) -> Plan:
    """Draw what is hidden in each case, from its key alone: the same in every run."""

    @cache
    def sound(design: Design) -> Sound | None:
        plain = results[design.key]
        return Sound(plain) if "matrix" in plain else None

    plan = Plan([], {})
    for case in cases:
        if case.outside:
            _plan_outside(case, results, plan)
        elif not case.number:
            plan.cases.append(Planned(case, {}, {}))
        else:
            _plan_hidden(case, sound(case.sound_design), plan)
    return plan


def _plan_outside(case: Case, results: Results, plan: Plan) -> None:
    size = case.multiple * float(results[SizeOutside(case.outside, case.design).key].get("size", np.inf))
    if size > MOST.get(case.outside, np.finfo(float).max):
        plan.none[case.key] = "too small to be found in such a trial at any size that makes sense"
    else:
        plan.cases.append(Planned(case, {}, {case.outside: size}))


def _plan_hidden(case: Case, sound: Sound | None, plan: Plan) -> None:
    if sound is None:
        plan.none[case.key] = "the sound trial could not be examined"
        return
    random = np.random.default_rng(crc32(case.key.encode()))
    if case.effects:
        hidden = sound.hidden(case.effects, case.multiple, random)
    else:
        hidden = sound.apart(random, case.number, case.multiple)
    if hidden is None:
        plan.none[case.key] = "such a trial cannot identify it"
        return
    alike = sound.rivals(hidden, ALIKE if case.group == "cannot_tell" else DISTINGUISHED)
    if case.group == "cannot_tell" and not alike:
        plan.none[case.key] = "such a trial can tell it from all others"
    else:
        plan.cases.append(Planned(case, hidden, {}, tuple(alike)))
