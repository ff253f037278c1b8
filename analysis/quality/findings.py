"""What a check says: flags beside the data, and findings in words with their size.

Flags are those of QARTOD (:class:`acquisition.core.frames.Quality`): 1 good, 2 not evaluated, 3 suspect, 4 bad,
9 missing. A check never drops a row; it returns flags of the same index as the data it was given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from acquisition.core.frames import Quality

Flags = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: where, how large, how sure, and what to do.

    ``start`` and ``end`` bound it in UTC; ``text`` is one sentence a person reads, ``remedy`` one more that
    says what to do. ``estimate`` holds its size in the names of the contract, with ``low`` and ``high`` of
    the main figure's 95 % interval beside it. ``certain`` marks what `--repair` may put right by itself.
    """

    code: str
    channel: str
    start: pd.Timestamp
    end: pd.Timestamp
    text: str
    remedy: str = ""
    estimate: Mapping[str, float] = field(default_factory=dict)
    certain: bool = False

    def as_json(self) -> dict[str, Any]:
        """The finding with the keys of the contract; the remedy ends the text."""
        return {
            "code": self.code,
            "channel": self.channel,
            "start": self.start.isoformat(),
            "end": self.end.isoformat(),
            "text": f"{self.text.rstrip('.')}. {self.remedy}".strip(),
            "estimate": dict(self.estimate),
        }


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check across channels.

    ``flags`` has the table's index and a column for each channel that the check evaluated, as uint8.
    """

    flags: pd.DataFrame
    findings: tuple[Finding, ...] = ()


Check = Callable[[pd.DataFrame], CheckResult]
"""A check across channels: from the joined table of raw samples, in the order of measured time."""


def initial_flags(table: pd.DataFrame, names: tuple[str, ...] = ()) -> pd.DataFrame:
    """Flags before a check: missing where ``table`` has no value, else not evaluated."""
    columns = {
        name: np.where(table[name].isna(), Quality.MISSING, Quality.NOT_EVALUATED).astype(np.uint8)
        for name in names
    }
    return pd.DataFrame(columns, index=table.index)


_PRECEDENCE = (Quality.NOT_EVALUATED, Quality.GOOD, Quality.SUSPECT, Quality.BAD, Quality.MISSING)
_RANK = np.zeros(max(_PRECEDENCE) + 1, dtype=np.uint8)
for _rank, _flag in enumerate(_PRECEDENCE):
    _RANK[_flag] = _rank


def merge_flags(first: Flags, second: Flags) -> Flags:
    """The graver of two flags, value by value; what was judged counts more than what was not.

    >>> merge_flags(np.array([1, 2, 3, 9], np.uint8), np.array([2, 1, 4, 4], np.uint8)).tolist()
    [1, 1, 4, 9]
    """
    return np.where(_RANK[first] >= _RANK[second], first, second).astype(np.uint8)
