"""Results that print and plot themselves, and go to JSON and back.

A result names the functions that show it, ``"module:function"``; they are loaded when it is printed or plotted.
So no result imports a page, and plotting code is loaded only when needed.

In JSON a dataclass's fields are the keys, and its types say how to read them. ``Annotated[...,
Field(exclude=True)]`` leaves a field out, ``@computed_field`` above a property adds one. Arrays
(:mod:`seatrial.acquisition.core.quantities`) are nested lists. NaN, which JSON lacks, is written as null, and a
field that may hold one has the type :data:`Number`, which reads null as NaN.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from io import StringIO
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic_core import core_schema

from seatrial.acquisition.core import errors, files, named_code

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.console import RenderableType
    from rich.table import Table
    from rich.text import Text

_WIDTH = 110  # columns


class Result:
    """A result with a rich rendering for the terminal, the same text as its ``str``, and a figure.

    ``view`` makes a rich renderable of the result; ``drawing`` draws it into a matplotlib figure of
    ``size_inch``, called as ``drawing(figure, result)``; ``frame`` is the entry of
    :meth:`as_dict` that becomes a table.
    """

    __slots__ = ()
    view: ClassVar[str]
    drawing: ClassVar[str]
    frame: ClassVar[str] = ""
    size_inch: ClassVar[tuple[float, float]] = (9.0, 5.0)

    def __rich__(self) -> RenderableType:
        renderable: RenderableType = named_code.import_object(self.view)(self)
        return renderable

    def __str__(self) -> str:
        text = StringIO()
        errors.Terminal(file=text, width=_WIDTH).print(self)
        return "\n".join(line.rstrip() for line in text.getvalue().rstrip().split("\n"))

    def __repr__(self) -> str:
        """The class and the first line that the terminal shows."""
        return f"<{type(self).__name__}: {str(self).strip().partition(chr(10))[0].strip()}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the table of the terminal, and the figure below it."""
        from base64 import b64encode

        console = errors.Terminal(file=StringIO(), width=_WIDTH, record=True)
        console.print(self)
        table = console.export_html(inline_styles=True, code_format='<pre style="line-height:1.25">{code}</pre>')
        picture = b64encode(named_code.import_object("seatrial.analysis.report.pages:png_of")(self.plot())).decode()
        return f'{table}<img src="data:image/png;base64,{picture}" style="max-width:100%">'

    def to_frame(self) -> pd.DataFrame:
        """The main numbers of the result as a table: the entry :attr:`frame` of its JSON object, a row each.

        Raises NotImplementedError for a result that has no such entry.
        """
        if not self.frame:
            raise NotImplementedError(f"{type(self).__name__} has no single table: see its fields")
        import pandas as pd

        entries = self.as_dict()[self.frame]
        return (
            pd.DataFrame.from_dict(entries, orient="index") if isinstance(entries, dict) else pd.DataFrame(entries)
        )

    def as_dict(self) -> dict[str, Any]:
        """The result as plain values for JSON."""
        raise NotImplementedError

    def plot(self) -> Figure:
        """The result as a matplotlib figure."""
        draw = named_code.import_object(self.drawing)
        fill_figure = named_code.import_object("seatrial.analysis.report.pages:fill_figure")
        figure: Figure = fill_figure(lambda canvas: draw(canvas, self), self.size_inch)
        return figure


@dataclass(frozen=True, slots=True)
class ChosenModel:
    """The model that a result was computed with: its name, and a remark if it is not that of the recordings."""

    name: str
    doubt: str = ""

    def __str__(self) -> str:
        return f"model: {self.name}{self.doubt}"

    @property
    def remarks(self) -> dict[str, list[str]]:
        """The first entries of a JSON object: empty if the model is that of the recordings."""
        return {"remarks": [str(self)]} if self.doubt else {}


@dataclass(frozen=True, slots=True, repr=False)
class ModelResult(Result):
    """A result computed with a model; it prints first which model it was and any limits of its measurements."""

    model: ChosenModel | None = field(default=None, kw_only=True)

    def __str__(self) -> str:
        return "\n".join([*self.first_lines, Result.__str__(self)])

    @property
    def measurements(self) -> str:
        """Limits of the measurements used as truth, if any."""
        return ""

    @property
    def first_lines(self) -> list[str]:
        return [str(part) for part in (self.measurements, self.model) if part]

    @property
    def remarks(self) -> dict[str, list[str]]:
        """The first entries of its JSON object."""
        remarks = [self.measurements] if self.measurements else []
        remarks += [] if self.model is None else self.model.remarks.get("remarks", [])
        return {"remarks": remarks} if remarks else {}


def terminal_table(
    title: str | None,
    columns: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    best_row: int | None = None,
    left_aligned: Collection[int] = (0,),
    *,
    wrap: bool = False,
    **look: Any,
) -> Table:
    """A table for a terminal: the columns with the numbers ``left_aligned`` to the left, others to the right.

    Row ``best_row`` is bold. Where a line is too short, words are broken, or with ``wrap`` the heads of numbers;
    numbers never. ``look`` is what else :class:`rich.table.Table` takes.
    """
    from rich.table import Table

    usual = {"title_justify": "left", "caption_justify": "left", "box": None, "header_style": "dim"}
    table = Table(title=title, **{**usual, **look})
    for number, name in enumerate(columns):
        word = number in left_aligned
        table.add_column(name, justify="left" if word else "right", overflow="fold", no_wrap=word == wrap)
    for number, row in enumerate(rows):
        table.add_row(*row, style="bold" if number == best_row else "")
    return table


Decoded = TypeVar("Decoded")


class _NullAsNaN:
    """Has pydantic read null as NaN; its BeforeValidator would be loaded with every command."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.no_info_before_validator_function(
            lambda value: float("nan") if value is None else value, handler(source)
        )


Number = Annotated[float, _NullAsNaN()]
"""A float that may be NaN."""


def to_json(result: Any) -> Any:
    """A dataclass, or lists and dicts of them, as plain values for JSON: NaN and infinities become None."""

    def plain_value(value: Any) -> Any:
        if isinstance(value, np.generic | np.ndarray):
            return value.tolist()
        raise TypeError(f"{type(value).__name__} cannot be written as JSON")

    return json.loads(files.type_adapter(type(result)).dump_json(result, fallback=plain_value))


def from_json(result_class: type[Decoded], content: Any) -> Decoded:
    """The inverse of :func:`to_json`. Raises :class:`InputError` for other values."""
    import pydantic

    try:
        return files.type_adapter(result_class).validate_python(content)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise errors.InputError(
            f"is not a {result_class.__name__} of this version",
            where=place,
            why=first["msg"],
            fix="create it again",
        ) from error
