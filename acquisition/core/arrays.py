"""The array types that signatures speak of: one name an element type; shapes stand in the docstrings."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray


class _AsLists:
    """Says to pydantic that an array is nested lists in JSON, of elements of this type; null is NaN."""

    def __init__(self, dtype: type) -> None:
        self.dtype = dtype

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(
            lambda values: np.array(values, dtype=self.dtype),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda array: array.tolist()),
        )


Floats: TypeAlias = Annotated[NDArray[np.float64], _AsLists(np.float64)]
Bools: TypeAlias = Annotated[NDArray[np.bool_], _AsLists(np.bool_)]
Ints: TypeAlias = Annotated[NDArray[np.int64], _AsLists(np.int64)]
Complexes: TypeAlias = NDArray[np.complex128]
