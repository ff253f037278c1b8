"""The directive ``seatrial-inputs``: every kind of input with its rules, read from the program."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx


class SeatrialInputs(SphinxDirective):
    """All inputs, a row each."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        from seatrial.acquisition.sources import INPUTS

        self.env.note_reread()  # the page is made of the program, which may have changed
        rows = [
            f"| `{name}` | {each.what} | {'yes' if each.live else ''} | {each.identity} | {each.times} |"
            for name, each in INPUTS.items()
        ]
        head = [
            "| form or type | what | live | a source of its own is | times in a file |",
            "|---|---|---|---|---|",
        ]
        return self.parse_text_to_nodes("\n".join([*head, *rows]))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("seatrial-inputs", SeatrialInputs)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
