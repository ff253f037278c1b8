"""The terminal: lines and tables go out here, with other people's text escaped instead of obeyed.

Names of files, marks of the crew and cells of tables come from anywhere. A control character in them would move
the cursor, clear the screen or hide a warning; brackets would be taken for rich's markup.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.protocol import rich_cast
from rich.segment import Segment
from rich.text import Text

from seatrial.acquisition.core.text import printable

_PIPED_COLUMNS = 200


class Terminal(Console):
    """A console that shows text as it is: no markup, no emoji, control characters escaped.

    In a pipe or a file, which have no width, no table is cut to that of a terminal.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)
        if "width" not in options and "COLUMNS" not in os.environ and not self.is_terminal:
            self.width = _PIPED_COLUMNS

    def render_str(self, text: str, **options: Any) -> Text:
        """As rich's; it also measures the cells of tables by this."""
        return super().render_str(printable(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich's, which calls it for whatever is in a table or a group, too."""
        shown = rich_cast(renderable)
        return super().render(_escaped(shown) if isinstance(shown, Text) else shown, options)


def _escaped(text: Text) -> Text:
    """A text itself, or without its inner styles where it has to be escaped."""
    shown = printable(text.plain)
    if shown == text.plain:
        return text
    return Text(shown, text.style, justify=text.justify, overflow=text.overflow, no_wrap=text.no_wrap)
