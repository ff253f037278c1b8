"""The file of sea states says of every number whether the paper's Table II states it or we assume it."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields

from seatrial.hybrid.simulation.trial import SEA_STATES, SeaState

STATED = {"wind_mps", "wave_height_m", "current_mps"}
NUMBER = re.compile(r"(?:# )?(\w+) = (\S+)(.*)")


def test_every_number_that_is_not_the_papers_is_marked() -> None:
    said = [found.groups() for line in SEA_STATES.read_text().splitlines() if (found := NUMBER.fullmatch(line))]
    assert {name for name, _, _ in said} == {field.name for field in fields(SeaState)} - {"name"}
    for name, _, remark in said:
        assert ("# assumed" in remark) == (name not in STATED), name


def test_what_is_assumed_for_all_is_what_is_simulated() -> None:
    """The remarks at the head of the file are the values that a sea state has that does not say otherwise."""
    lines = [line for line in SEA_STATES.read_text().splitlines() if line.startswith("# ")]
    said = {found[1]: float(found[2]) for line in lines if (found := NUMBER.fullmatch(line))}
    simulated = {each.name: each.default for each in fields(SeaState) if each.default is not MISSING}
    simulated.pop("name")
    assert said == simulated
