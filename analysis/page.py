"""One HTML page that needs no network: headings, tables, large numbers, pictures embedded."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquisition.errors import storage_error
from acquisition.trial import software_version

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_CSS = """
body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:980px;margin:2em auto;padding:0 1em}
h1{font-size:1.6em;margin-bottom:.2em} h2{font-size:1.15em;margin-top:2em;border-bottom:1px solid #ddd}
table{border-collapse:collapse;margin:.8em 0}
td,th{padding:.25em .9em;text-align:right;border-bottom:1px solid #eee}
td:first-child,th:first-child,.words td,.words th{text-align:left} tr.best{font-weight:600} td{vertical-align:top}
.words td:first-child,.words th{white-space:nowrap}
details{margin:.4em 0} summary{cursor:pointer;padding:.2em 0} details>*:not(summary){margin-left:1em}
.said{margin:.7em 0;padding-left:.8em;border-left:3px solid #c5ced6}.mended{color:#00664c}
.note{background:#fdf0d3;color:#7a5200;padding:.6em 1em;border-radius:6px}
img{max-width:100%} figure{margin:1em 0} figcaption{color:#555;font-size:.92em} .sub{color:#666}
.headline{display:flex;flex-wrap:wrap;gap:1em;margin:1em 0}
.headline div{background:#f3f6f8;border-radius:6px;padding:.6em 1em}
.headline b{display:block;font-size:1.5em;color:#0072B2} @media print{body{max-width:none}}
"""


_DPI = 110  # sharp enough at the page's width; time and size grow with it


@dataclass(slots=True)
class Page:
    """A page being put together, in order."""

    title: str
    subtitle: str
    parts: list[str] = field(default_factory=list)

    def heading(self, text: str) -> None:
        """A section's heading."""
        self.parts.append(f"<h2>{escape(text)}</h2>")

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

    def figure(self, draw: Callable[[Figure], object], size_inch: tuple[float, float], caption: str) -> None:
        """A figure that ``draw`` fills, embedded as a picture."""
        import matplotlib as mpl
        from matplotlib.figure import Figure

        from analysis.plots import STYLE

        with mpl.rc_context(STYLE):  # type: ignore[arg-type]
            figure = Figure(figsize=size_inch)
            draw(figure)
            stream = BytesIO()
            figure.savefig(stream, format="png", dpi=_DPI)
        picture = base64.b64encode(stream.getvalue()).decode("ascii")
        self.parts.append(
            f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{picture}">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )

    def write(self, path: Path) -> Path:
        """Write the page. Raises :class:`StorageError`."""
        html = (
            f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(self.title)}</title>'
            f"<style>{_CSS}</style><h1>{escape(self.title)}</h1><p class=sub>{escape(self.subtitle)}</p>"
            f"{''.join(self.parts)}<p class=sub>{escape(software_version())}</p></html>\n"
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(html, encoding="utf-8")
        except OSError as error:
            raise storage_error(path, error) from error
        return path


_TICKS_S = (60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 21600.0)
_TRACK_INCH = (3.0, 8.0)
_MOST_TICKS = 10  # times of day along a track; more would lie on each other


def _track_height_inch(table: pd.DataFrame) -> float:
    """A height that fits a track to scale into a picture of 8 in."""
    extents = {name: float(table[name].max() - table[name].min()) for name in ("north_m", "east_m")}
    share = extents["north_m"] / max(extents["east_m"], 1e-3)
    return min(max(0.8 + 7.0 * share, _TRACK_INCH[0]), _TRACK_INCH[1]) if np.isfinite(share) else _TRACK_INCH[1]


def add_run_sheet(page: Page, trial: Mapping[str, str]) -> None:
    """What the recording says of itself."""
    page.heading("Run sheet")
    page.table(["", ""], [[key.replace("_", " "), value] for key, value in trial.items()], words=True)


def add_recording(page: Page, table: pd.DataFrame, windows: pd.DataFrame) -> None:
    """The track and the channels of a 1 Hz table, held windows marked."""
    from analysis import plots

    page.heading("The trial")

    duration_s = float((table.index[-1] - table.index[0]).total_seconds()) if len(table) else 0.0
    every_s = next((step for step in _TICKS_S if duration_s / step <= _MOST_TICKS), _TICKS_S[-1])

    def draw_track(figure: Figure) -> None:
        plots.track(figure.subplots(), table, windows, every_s)

    def draw_series(figure: Figure) -> None:
        groups = (
            ("heading_deg",), ("surge_mps", "sway_mps"), ("yaw_rate_dps",),
            ("port_angle_deg", "starboard_angle_deg"), ("port_rpm", "starboard_rpm", "tunnel_rpm"),
            ("wind_speed_mps",),
        )  # fmt: skip
        for axes, names in zip(figure.subplots(len(groups), 1, sharex=True), groups, strict=True):
            plots.series(axes, table, names, windows)
            axes.label_outer()

    legs = windows["leg"].nunique()
    page.figure(
        draw_track,
        (8, _track_height_inch(table)),
        f"The track, one colour a leg of held thrusters ({legs} legs), time in UTC.",
    )
    page.figure(draw_series, (9, 10), "The channels at 1 Hz; shaded where a window is held.")
