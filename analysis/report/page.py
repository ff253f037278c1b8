"""One HTML page that needs no network: headings, tables, large numbers, pictures embedded."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from acquisition.core.errors import storage_error
from acquisition.recording.trial import software_version

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CSS = """
body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:980px;margin:2em auto;padding:0 1em}
h1{font-size:1.6em;margin-bottom:.2em} h2{font-size:1.15em;margin-top:2em;border-bottom:1px solid #ddd}
h3{font-size:1em;margin-top:1.4em;margin-bottom:.4em}
table{border-collapse:collapse;margin:.8em 0}
td,th{padding:.25em .9em;text-align:right;border-bottom:1px solid #eee}
td:first-child,th:first-child,.words td,.words th{text-align:left} tr.best{font-weight:600} td{vertical-align:top}
.words td:first-child,.words th{white-space:nowrap}
details{margin:.4em 0} summary{cursor:pointer;padding:.2em 0} details>*:not(summary){margin-left:1em}
.said{margin:.7em 0;padding-left:.8em;border-left:3px solid #c5ced6}.mended{color:#00664c}
.note{background:#fdf0d3;color:#7a5200;padding:.6em 1em;border-radius:6px}
nav{margin:1.2em 0;line-height:1.9}
img{max-width:100%} figure{margin:1em 0} figcaption{color:#555;font-size:.92em} .sub{color:#666}
.headline{display:flex;flex-wrap:wrap;gap:1em;margin:1em 0}
.headline div{background:#f3f6f8;border-radius:6px;padding:.6em 1em}
.headline b{display:block;font-size:1.5em;color:#0072B2} @media print{body{max-width:none}}
"""


@dataclass(slots=True)
class Page:
    """A page, or a section of one, being put together in order; ``level`` is that of its headings."""

    title: str = ""
    subtitle: str = ""
    level: int = 2
    parts: list[str] = field(default_factory=list)
    figures: dict[str, Figure] = field(default_factory=dict)

    def heading(self, text: str) -> None:
        """A section's heading."""
        self.parts.append(f"<h{self.level}>{escape(text)}</h{self.level}>")

    def text(self, text: str) -> None:
        """A paragraph."""
        self.parts.append(f"<p>{escape(text)}</p>")

    def note(self, text: str) -> None:
        """What nobody may miss, on a coloured ground."""
        self.parts.append(f'<p class="note">{escape(text)}</p>')

    def statement(self, what: str, about: str, text: str, mended: str = "") -> None:
        """One thing that is said: what in bold, what it is about, a sentence, and what was done about it."""
        done = f'<br><span class="mended">{escape(mended)}</span>' if mended else ""
        self.parts.append(
            f'<p class="said"><b>{escape(what)}</b> <span class="sub">· {escape(about)}</span><br>'
            f"{escape(text)}{done}</p>"
        )

    @contextmanager
    def details(self, summary: str, *, opened: bool = False) -> Iterator[None]:
        """What is added within is shown after a click on ``summary``, or at once if ``opened``."""
        self.parts.append(f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>")
        yield
        self.parts.append("</details>")

    def headline(self, figures: Mapping[str, str]) -> None:
        """The few numbers that matter, large."""
        cells = (f"<div><b>{escape(value)}</b>{escape(name)}</div>" for name, value in figures.items())
        self.parts.append(f'<div class="headline">{"".join(cells)}</div>')

    def table(
        self, header: list[str], rows: list[list[str]], best: int | None = None, *, words: bool = False
    ) -> None:
        """A table; ``best`` is the row that is set in bold. Numbers stand to the right, ``words`` to the left."""
        head = "".join(f"<th>{escape(each)}</th>" for each in header) if any(header) else ""
        body = ""
        for number, row in enumerate(rows):
            cells = "".join(f"<td>{escape(each)}</td>" for each in row)
            body += f"<tr{' class=best' if number == best else ''}>{cells}</tr>"
        css = " class=words" if words else ""
        self.parts.append(f"<table{css}>{f'<tr>{head}</tr>' if head else ''}{body}</table>")

    def figure(
        self, draw: Callable[[Figure], object], size_inch: tuple[float, float], caption: str, name: str = ""
    ) -> None:
        """A figure that ``draw`` fills, embedded as a picture and kept by ``name``, or by how its caption
        begins."""
        from analysis.report.figures import file_name, filled, png_of

        figure = filled(draw, size_inch)
        self.figures[name or file_name(caption)] = figure
        self.picture(png_of(figure), caption)

    def picture(self, png: bytes, caption: str) -> None:
        """A picture that is there already, embedded."""
        data = base64.b64encode(png).decode("ascii")
        self.parts.append(
            f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )

    def write(self, path: Path) -> Path:
        """Write the page. Raises :class:`StorageError`."""
        return write_document(self.title, self.subtitle, "".join(self.parts), path)


def write_document(title: str, subtitle: str, body: str, path: Path) -> Path:
    """Write HTML in the house's look: ``body`` is markup, the rest text. Raises :class:`StorageError`."""
    html = (
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
        f"<style>{_CSS}</style><h1>{escape(title)}</h1><p class=sub>{escape(subtitle)}</p>"
        f"{body}<p class=sub>{escape(software_version())}</p></html>\n"
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(html, encoding="utf-8")
    except OSError as error:
        raise storage_error(path, error) from error
    return path
