"""A result is the same after a way through JSON, whatever is in it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field, computed_field

from seatrial.acquisition.core.errors import InputError
from seatrial.acquisition.core.quantities import Floats, Ints
from seatrial.acquisition.core.result import Number, from_json, to_json


@dataclass(frozen=True, slots=True)
class Part:
    value: Number
    unit: str


@dataclass(frozen=True, slots=True)
class Whole:
    parts: Mapping[str, Part]
    tracks: Floats
    legs: Ints
    names: tuple[str, ...]
    rest: Part | None = None
    inside: Annotated[int, Field(exclude=True)] = 3

    @computed_field  # type: ignore[prop-decorator]
    @property
    def count(self) -> int:
        """The number of parts."""
        return len(self.parts)


def test_a_result_goes_to_json_and_back() -> None:
    whole = Whole({"a": Part(math.nan, "m")}, np.array([[1.0, np.nan]]), np.array([4]), ("x", "y"), Part(2.0, "1"))
    values = to_json(whole)
    assert values == {
        "parts": {"a": {"value": None, "unit": "m"}}, "tracks": [[1.0, None]], "legs": [4], "names": ["x", "y"],
        "rest": {"value": 2.0, "unit": "1"}, "count": 1,
    }  # fmt: skip
    back = from_json(Whole, json.loads(json.dumps(values, allow_nan=False)))
    assert math.isnan(back.parts["a"].value)
    np.testing.assert_array_equal(back.tracks, whole.tracks)
    assert back.legs.dtype == np.int64
    assert (back.names, back.rest, back.inside) == (whole.names, whole.rest, 3)


def test_numpys_numbers_are_numbers() -> None:
    assert to_json({"a": np.float64(1.5), "b": [np.int64(2)], "c": np.array([np.inf])}) == {
        "a": 1.5, "b": [2], "c": [None],
    }  # fmt: skip


def test_what_does_not_fit_is_one_clear_error() -> None:
    with pytest.raises(InputError, match=r"parts\.a\.unit: is not a Whole of this version"):
        from_json(Whole, {"parts": {"a": {"value": 1.0}}, "tracks": [], "legs": [], "names": []})
