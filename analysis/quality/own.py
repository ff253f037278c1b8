"""A check of a user's own: a function from the joined table to flags and findings, loaded by its name."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from acquisition.core.named_code import OwnCodeError, file_of, load, own_code, require_call
from analysis.quality.findings import Check, CheckResult, Finding, initial_flags
from analysis.tables.table import utc_index


def own_check(name: str) -> Check:
    """The check of that name: ``FILE.py:FUNCTION``, or an entry point of ``seatrial.checks``.

    The function takes the joined table (UTC index, a column a channel, impossible values taken out) and returns
    :class:`Finding`s, or a :class:`CheckResult` with flags. One that fails is a finding itself, ``check_failed``.
    Raises :class:`ConfigurationError` for what is not there or no such function.
    """
    function = load(name, "checks")
    require_call(function, name, "table")

    def check(table: pd.DataFrame) -> CheckResult:
        index = utc_index(table)
        try:
            with own_code(name, file_of(function)):
                return _result(function(table.copy()), table)
        except OwnCodeError as error:
            return CheckResult(
                initial_flags(table), (Finding("check_failed", "", index[0], index[-1], str(error)),)
            )

    return check


def _result(found: object, table: pd.DataFrame) -> CheckResult:
    if isinstance(found, CheckResult):
        return found
    findings = tuple(found) if isinstance(found, Iterable) else (found,)
    if not all(isinstance(each, Finding) for each in findings):
        raise TypeError(f"it returned a {type(found).__name__}, not a list of analysis.quality.findings.Finding")
    return CheckResult(initial_flags(table), findings)
