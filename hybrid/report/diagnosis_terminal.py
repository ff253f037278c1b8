"""A diagnosis in the terminal: the verdict, the sentences, the gap."""

from __future__ import annotations

from rich.console import Group
from rich.text import Text

from hybrid.diagnosis.result import Diagnosis, Ladder
from hybrid.report.diagnosis_phrases import alternatives
from hybrid.report.diagnosis_words import ladder_sentence

_VERDICTS = {
    "named": "The model lacks what is named here.",
    "nothing_missing": "Nothing is missing beyond the tolerance.",
    "unknown": "Something is missing that the catalogue does not explain.",
    "indistinguishable": "Something is missing, and these data do not tell which of several causes it is.",
}


def summary(diagnosis: Diagnosis, ladder: Ladder | None = None) -> Group:
    """The diagnosis in some lines, and what a calibrator adds where one was trained."""
    lines = [Text(_VERDICTS[diagnosis.verdict], style="bold")]
    lines += [Text(f"- {each.sentence}") for each in diagnosis.effects]
    names = [each.name for each in diagnosis.effects]
    lines += [
        Text(f"These data cannot tell {alternatives(group, names, 'from')}.")
        for group in diagnosis.indistinguishable
    ]
    if diagnosis.unknown is not None:
        lines.append(Text(f"What remains looks like {diagnosis.unknown.looks_like}."))
    gap = diagnosis.gap
    if gap.held_out_windows:
        lines.append(
            Text(
                f"Mean distance over {gap.horizon_s} s on {gap.held_out_windows} windows that took no part: "
                f"{gap.before_m:.3f} m before, {gap.after_m:.3f} m after, {gap.floor_m:.3f} m at best."
            )
        )
    if ladder is not None:
        lines.append(Text(ladder_sentence(ladder)))
    if diagnosis.next_manoeuvre is not None:
        lines.append(Text(f"Next: {diagnosis.next_manoeuvre.what}"))
    lines += [Text(f"note: {each}", style="dim") for each in diagnosis.remarks]
    return Group(*lines)
