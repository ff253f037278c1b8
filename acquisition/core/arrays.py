"""Array types for signatures, one name for each element type, and the samples of one channel as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray


class _AsLists:
    """Tells pydantic that an array is nested lists in JSON, with elements of this type; null is NaN."""

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


@dataclass(frozen=True, slots=True)
class Series:
    """The samples of one channel in order of reception: times [ns UTC], values and flags, all of shape [n].

    ``sources`` lists the distinct sources; ``source_index`` gives the one of each sample.
    """

    measured_ns: Ints
    received_ns: Ints
    value: Floats
    quality: NDArray[np.uint8]
    sources: tuple[str, ...]
    source_index: NDArray[np.int32]

    def subset(self, which: NDArray[Any]) -> Series:
        """The samples at ``which``, a mask [n] or indices."""
        return Series(
            self.measured_ns[which],
            self.received_ns[which],
            self.value[which],
            self.quality[which],
            self.sources,
            self.source_index[which],
        )

    @classmethod
    def joined(cls, parts: Sequence[Series]) -> Series:
        """The samples of one series after the other."""
        sources = tuple(dict.fromkeys(name for part in parts for name in part.sources))
        places = [np.array([sources.index(name) for name in part.sources], np.int32) for part in parts]
        index = [place[part.source_index] for place, part in zip(places, parts, strict=True)]

        def column(name: str) -> NDArray[Any]:
            return np.concatenate([getattr(part, name) for part in parts])

        numbers = column("measured_ns"), column("received_ns"), column("value"), column("quality")
        return cls(*numbers, sources, np.concatenate(index))
