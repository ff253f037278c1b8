"""Makers of outlooks that stand in for the model's, in a module that a process of an outlook imports soon."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.analysis.conduct.outlook import Outlook, RecordedRun, RunOutlook
from seatrial.analysis.conduct.programme import PlannedRun
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.indices import Index


def all_met(recorded: Sequence[RecordedRun], remaining: Mapping[int, PlannedRun]) -> Outlook:
    """An outlook by which nothing that remains is needed, of runs whose samples came along."""
    assert all(len(table) > 100 and table["heading_deg"].notna().any() for _, table, _ in recorded)
    met = Index(1.0, 0.9, 1.1, "deg", limit=2.0, result=criteria.MET)
    runs = {place: RunOutlook(dict.fromkeys(run.purpose, met), 1.0, 0.9) for place, run in remaining.items()}
    return Outlook(runs, len(recorded), 1, 2)


def made(recorded: Sequence[RecordedRun], remaining: Mapping[int, PlannedRun]) -> Outlook:
    return Outlook({place: RunOutlook() for place in remaining}, len(recorded), 1, 2)


def refused(recorded: Sequence[RecordedRun], remaining: Mapping[int, PlannedRun]) -> Outlook:
    raise DataShortageError("only 3 segments have motion")


def killed(recorded: Sequence[RecordedRun], remaining: Mapping[int, PlannedRun]) -> Outlook:
    os._exit(9)
