"""Results to JSON and back: a dataclass's fields are the keys, and its types say how to read them.

``Annotated[..., Field(exclude=True)]`` leaves a field out, ``@computed_field`` above a property adds one. Arrays
(:mod:`seatrial.acquisition.core.arrays`) are nested lists. JSON knows no NaN: it is written as null, and a field
that may hold one has the type :data:`Number`, which reads null as NaN.
"""

from __future__ import annotations

import json
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BeforeValidator, TypeAdapter, ValidationError

from seatrial.acquisition.core.errors import InputError

Result = TypeVar("Result")
Number = Annotated[float, BeforeValidator(lambda value: float("nan") if value is None else value)]
"""A float that may be NaN."""


def to_json(result: Any) -> Any:
    """A dataclass, or lists and dicts of them, as plain values for JSON: NaN and infinities become None."""
    return json.loads(TypeAdapter[Any](type(result)).dump_json(result, fallback=_plain))


def from_json(kind: type[Result], values: Any) -> Result:
    """The inverse of :func:`to_json`. Raises :class:`InputError` for other values."""
    try:
        return TypeAdapter(kind).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(
            f"is not a {kind.__name__} of this version", where=place, why=first["msg"], fix="create it again"
        ) from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")
