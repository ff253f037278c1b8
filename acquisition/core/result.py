"""Results that print and plot themselves.

A result names the functions that show it, ``"module:function"``; they are loaded when it is printed or plotted. So
no result imports a page, and none costs more than its numbers until somebody looks at it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from io import StringIO
from typing import TYPE_CHECKING, Any, ClassVar

from acquisition.core.named_code import imported

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

_WIDTH = 110  # columns


class Result:
    """A result that rich prints as a terminal shows it, with the same as its ``str``, and with a figure.

    ``view`` makes a renderable of the result; ``drawing`` fills a matplotlib figure of ``size_inch`` with it, as
    ``drawing(figure, result)``.
    """

    __slots__ = ()
    view: ClassVar[str]
    drawing: ClassVar[str]
    size_inch: ClassVar[tuple[float, float]] = (9.0, 5.0)

    def __rich__(self) -> RenderableType:
        shown: RenderableType = imported(self.view)(self)
        return shown

    def __str__(self) -> str:
        from rich.console import Console

        text = StringIO()
        Console(file=text, width=_WIDTH).print(self)
        return "\n".join(line.rstrip() for line in text.getvalue().rstrip().split("\n"))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """What a notebook shows of it."""
        printer.text(str(self))

    def plot(self) -> Figure:
        """The result as a matplotlib figure."""
        draw = imported(self.drawing)
        filled: Figure = imported("analysis.report.figures:fill_figure")(
            lambda figure: draw(figure, self), self.size_inch
        )
        return filled


@dataclass(frozen=True, slots=True)
class ChosenModel:
    """Which model a result was asked of: its name, and what to say of it first where it is not the recordings'."""

    name: str
    doubt: str = ""

    def __str__(self) -> str:
        return f"model: {self.name}{self.doubt}"

    @property
    def remarks(self) -> dict[str, list[str]]:
        """What a JSON object says first: nothing where the model is that of the recordings."""
        return {"remarks": [str(self)]} if self.doubt else {}


@dataclass(frozen=True, slots=True)
class ModelResult(Result):
    """A result that a model was asked for; what is to be known of its measurements, and which model it was, are the
    first lines of what it prints.
    """

    model: ChosenModel | None = field(default=None, kw_only=True)

    def __str__(self) -> str:
        return "\n".join([*self.first_lines, Result.__str__(self)])

    @property
    def measurements(self) -> str:
        """What is to be known of the measurements that it was judged by, if anything."""
        return ""

    @property
    def first_lines(self) -> list[str]:
        """What it says before anything else."""
        return [str(each) for each in (self.measurements, self.model) if each]

    @property
    def remarks(self) -> dict[str, list[str]]:
        """What a JSON object of it says first."""
        said = [self.measurements] if self.measurements else []
        said += [] if self.model is None else self.model.remarks.get("remarks", [])
        return {"remarks": said} if said else {}
