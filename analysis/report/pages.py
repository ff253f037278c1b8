"""Pages from templates: one for each recording, the index of a batch, the quality report; and figures for them.

A recording's page has its run sheet, quality, track, manoeuvres and provenance. The index has a row for each
recording, to sort, filter and open, in one file that needs no network. The quality of a recording is shown at a
terminal and on a page, and written for programs as JSON and Parquet.

Templates lie in ``templates`` beside this module: ``base.html`` has the look, ``macros.html`` what pages share, as
``ui`` in every template. A page needs no network: its figures are embedded. A block may be rendered alone, as a
section of a notebook. A figure is filled by a function and can be written as SVG and PDF and, read back from what
was really drawn, as JSON: lines, points, bars, areas, images and texts of every axes, with the axes' labels.
"""

from __future__ import annotations

import base64
import json
import logging
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PathCollection, QuadMesh
from matplotlib.dates import ConciseDateFormatter, date2num, num2date
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.text import Text as DrawnText
from numpy.typing import ArrayLike, NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from seatrial.acquisition.core import errors, files, quantities, result, ship
from seatrial.acquisition.core.trial import Quality, software_version
from seatrial.acquisition.recording.reader import Recording, event_counts_text
from seatrial.analysis.quality.findings import ALL, SHIP, Finding
from seatrial.analysis.report import plots, tables
from seatrial.analysis.series import edges_of_runs
from seatrial.analysis.tables import table
from seatrial.analysis.tables.export import SIGMA_SUFFIX, write_parquet

if TYPE_CHECKING:
    from seatrial.analysis.products import Products
    from seatrial.analysis.quality.channel_checks import ChannelQuality
    from seatrial.analysis.quality.check import Cause, DataQuality

TEMPLATES = Path(__file__).parent / "templates"
Draw = Callable[[Figure], object]
ENDINGS = ("svg", "pdf", "json")
_PRINT: dict[str, object] = {**plots.STYLE, "svg.hashsalt": "seatrial", "pdf.fonttype": 42}
_DPI = 110  # sharp enough at a page's width; time and size grow with it
_PRINT_DPI = 150
_NO_DATE: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}}


@dataclass(frozen=True, slots=True)
class Page:
    """A page, or a section of one: its markup, and its figures by name."""

    html: str
    figures: dict[str, Figure] = field(default_factory=dict)
    title: str = ""

    def _repr_html_(self) -> str:
        return self.html

    def write(self, path: Path) -> Path:
        """Write the page, complete or not at all. Raises :class:`StorageError`."""
        return files.write_text(path, self.html)


@cache
def template_environment(*folders: Path) -> Environment:
    """Where templates are looked for: in ``folders``, then in this package's."""
    from seatrial.analysis.manoeuvres.motion import motion_of

    templates = Environment(
        loader=FileSystemLoader([*folders, TEMPLATES]), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
        # control characters in texts are escaped; markup is made of texts that were
        finalize=lambda text: (
            errors.escape_control_characters(text)
            if isinstance(text, str) and not isinstance(text, Markup) else text
        ),
    )  # fmt: skip
    templates.filters |= {"plain": lambda name: name.replace("_", " "), "manoeuvre_line": tables.manoeuvre_line}
    templates.globals |= {
        "version": software_version(), "level": 2, "subtitle": "", "body": "", "picture": embed_picture,
        "plots": plots, "quality_tables": sys.modules[__name__], "manoeuvre_tables": tables,
        "motion_of": motion_of,
    }  # fmt: skip
    templates.globals["ui"] = templates.get_template("macros.html").module
    return templates


def render(template: str, block: str = "", templates: Environment | None = None, **context: Any) -> Page:
    """A page from a template and what it names, or one ``block`` of it.

    In the template ``figure(draw, size_inch, caption, name, ...)`` embeds what ``draw(figure, ...)`` fills, and
    ``chart`` the same of a function that draws into axes; without a name it is how the caption begins. ``level`` is
    that of headings.
    """
    figures: dict[str, Figure] = {}

    def figure(
        draw: Callable[..., object], size_inch: tuple[float, float], caption: str, name: str = "", *arguments: Any
    ) -> Markup:
        filled = fill_figure(lambda empty: draw(empty, *arguments), size_inch)
        figures[name or figure_file_name(caption)] = filled
        return embed_picture(png_of(filled), caption)

    def chart(
        draw: Callable[..., object], size_inch: tuple[float, float], caption: str, name: str, *arguments: Any
    ) -> Markup:
        return figure(lambda empty: draw(empty.subplots(), *arguments), size_inch, caption, name)

    source = (templates or template_environment()).get_template(template)
    values = {**context, "figure": figure, "chart": chart}
    if not block:
        return Page(source.render(values), figures, context.get("title", ""))
    return Page("".join(source.blocks[block](source.new_context(values))), figures)


def embed_picture(png: bytes, caption: str) -> Markup:
    """A picture that is there already, embedded."""
    data = base64.b64encode(png).decode("ascii")
    return Markup(
        '<figure><img alt="{0}" src="data:image/png;base64,{1}"><figcaption>{0}</figcaption></figure>'
    ).format(caption, data)


def write_pdf(page: Path) -> Path:
    """Write a page of HTML as PDF into its folder, A4 and numbered, without its controls; returns the path.

    Raises :class:`ConfigurationError` where WeasyPrint finds no Pango, which sets its lines; :class:`StorageError`.
    """
    try:
        with redirect_stdout(sys.stderr):  # it prints what it misses, amid what a command prints as JSON
            from weasyprint import HTML
    except (ImportError, OSError) as error:
        raise errors.ConfigurationError(
            "no PDF was written", where=str(page), why="WeasyPrint does not find the library Pango",
            fix="install it (Debian, Ubuntu: apt install libpangoft2-1.0-0; macOS: brew install pango; Windows: as "
            "WeasyPrint's documentation says), or print the page from a browser",
        ) from error  # fmt: skip
    for name in ("weasyprint", "fontTools"):
        logging.getLogger(name).setLevel(logging.ERROR)
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # or fontTools writes the time of day into each font
    path = page.with_suffix(".pdf")
    with files.atomic_file(path) as partial:
        text = page.read_text(encoding="utf-8")  # by the name alone it does not find one that is no UTF-8
        HTML(string=text, base_url=page.absolute().as_uri()).write_pdf(partial)
    return path


def fill_figure(draw: Draw, size_inch: tuple[float, float]) -> Figure:
    """A figure of ``size_inch`` that ``draw`` has filled, in the house's style."""
    with mpl.rc_context(_PRINT):  # type: ignore[arg-type]
        figure = Figure(figsize=size_inch)
        draw(figure)
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
        figure.set_layout_engine("none")  # it is laid out, and would be again for each format
    return figure


def png_of(figure: Figure) -> bytes:
    """The figure as a picture for a page."""
    return _figure_bytes(figure, "png", _DPI)


def write_figure(figure: Figure, folder: Path, name: str, endings: Sequence[str] = ENDINGS) -> list[Path]:
    """Write ``NAME.svg``, ``NAME.pdf`` and ``NAME.json`` into ``folder``, or what ``endings`` says (``png``, too).

    The same figure gives the same bytes: there is no time of day in them. Raises :class:`StorageError`.
    """
    paths = [folder / f"{name}.{ending}" for ending in endings]
    for path, ending in zip(paths, endings, strict=True):
        with files.atomic_file(path) as partial:
            if ending == "json":
                partial.write_bytes(json.dumps(numbers_in_figure(figure)).encode() + b"\n")
            else:
                partial.write_bytes(_figure_bytes(figure, ending, _PRINT_DPI))
    return paths


def _figure_bytes(figure: Figure, ending: str, dpi: int) -> bytes:
    stream = BytesIO()
    with mpl.rc_context(_PRINT):  # type: ignore[arg-type]
        figure.savefig(stream, format=ending, metadata=_NO_DATE.get(ending), dpi=dpi)
    return stream.getvalue()


def figure_file_name(text: str) -> str:
    """A file's name from the beginning of a caption.

    >>> figure_file_name("How the error grows with the time predicted.")
    'how_the_error_grows_with_the'
    """
    return "_".join(re.findall(r"[a-z0-9]+", text.lower())[:6]) or "figure"


def numbers_in_figure(figure: Figure) -> dict[str, Any]:
    """What is drawn, as plain values for JSON: ``axes``, each with ``title``, ``x`` and ``y`` (labels with units)
    and ``drawn``: objects with a ``kind`` and the numbers of it. Times are ISO 8601, what is no number is null.
    """
    return {"axes": [
        {
            "title": axes.get_title() or axes.get_title(loc="left"),
            "x": axes.get_xlabel().replace("\n", " "), "y": axes.get_ylabel().replace("\n", " "),
            "drawn": list(_numbers_of_artists(axes)),
        }
        for axes in figure.axes
    ]}  # fmt: skip


def _numbers_of_artists(axes: Axes) -> Iterator[dict[str, Any]]:
    """The numbers of each artist, with its label if it has one; nothing of frames, grounds and empty texts."""
    for artist in axes.get_children():
        if artist not in (axes.patch, *axes.spines.values()) and artist.get_visible():
            label = str(artist.get_label())
            labelled = {} if re.match(r"_child\d|_nolegend_|$", label) else {"label": label.lstrip("_")}
            yield from ({**values, **labelled} for values in _shape_numbers(artist, axes))


def _shape_numbers(artist: Artist, axes: Axes) -> Iterator[dict[str, Any]]:
    if isinstance(artist, Line2D):
        x, y = artist.get_data()
        yield {"kind": "line", "x": _json_values(x, axes), "y": _json_values(y)}
    elif isinstance(artist, QuadMesh):
        edges = np.asarray(artist.get_coordinates())
        yield {"kind": "mesh", "x_edges": _json_values(edges[0, :, 0]), "y_edges": _json_values(edges[:, 0, 1]),
               "values": _json_rows(artist.get_array())}  # fmt: skip
    elif isinstance(artist, PathCollection):
        x, y = np.ma.filled(artist.get_offsets(), np.nan).T
        yield {"kind": "points", "x": _json_values(x, axes), "y": _json_values(y)}
    elif isinstance(artist, LineCollection):
        yield {"kind": "lines", "lines": [_corner_coordinates(segment, axes) for segment in artist.get_segments()]}
    elif isinstance(artist, Collection):
        yield {"kind": "areas", "areas": [_corner_coordinates(path.vertices, axes) for path in artist.get_paths()]}
    elif isinstance(artist, AxesImage):
        yield {"kind": "image", "values": _json_rows(artist.get_array())}
    elif isinstance(artist, Rectangle):
        x, width = artist.get_x(), artist.get_width()
        yield {"kind": "bar", "x": _json_values([x, x + width], axes),
               "y": _json_values([artist.get_y(), artist.get_y() + artist.get_height()])}  # fmt: skip
    elif isinstance(artist, Patch):
        corners = artist.get_patch_transform().transform_path(artist.get_path()).vertices
        yield {"kind": "area", **_corner_coordinates(corners, axes)}
    elif isinstance(artist, DrawnText):
        x, y = artist.get_position()
        if artist.get_text().strip() not in ("", axes.get_title(), axes.get_title("left")):
            place = {"x": _json_values([x], axes)[0], "y": _json_values([y])[0]}
            yield {"kind": "text", "text": artist.get_text(), **place}


def _corner_coordinates(points: ArrayLike, axes: Axes) -> dict[str, Any]:
    x, y = np.asarray(points, dtype=float).reshape(-1, 2).T
    return {"x": _json_values(x, axes), "y": _json_values(y)}


def _json_rows(values: Any) -> list[Any]:
    array: quantities.Floats = np.ma.filled(np.ma.masked_invalid(np.ma.asarray(values, dtype=float)), np.nan)
    return [_json_values(row) for row in np.atleast_2d(array)]


def _json_values(values: Any, axes: Axes | None = None) -> list[Any]:
    """Values for JSON: seven digits of numbers, null for what is none, ISO 8601 for times along ``axes``."""
    array: NDArray[Any] = np.asarray(values)
    if array.dtype.kind == "O" and array.size and isinstance(array.flat[0], pd.Timestamp):
        array = pd.DatetimeIndex(array).tz_convert(None).to_numpy()
    if array.dtype.kind == "M":
        return [None if np.isnat(time) else f"{np.datetime_as_string(time, 'ms')}Z" for time in array.ravel()]
    if array.dtype.kind in "US":
        return [str(text) for text in array.ravel()]
    numbers: quantities.Floats = np.ma.filled(np.ma.asarray(array, dtype=float), np.nan).ravel()
    if axes is not None and "Date" in type(axes.xaxis.get_converter()).__name__:  # matplotlib's own is private
        return [num2date(number).isoformat() if np.isfinite(number) else None for number in numbers]  # type: ignore[no-untyped-call]
    return [float(f"{number:.7g}") if np.isfinite(number) else None for number in numbers]


_FILES = ("table.parquet", "flags.parquet", "quality.json", "windows.parquet", "manoeuvres.json", "summary.json")
_SHORT_WAY_M = 200.0  # of which two decimals of a nautical mile say little
_NUMBERS = re.compile(r"[+-]?\d[\d.,]*")
Row = Mapping[str, Any]
_COLUMNS = {
    "name": "recording", "status": "status", "start": "start, UTC", "duration_s": "duration",
    "distance_m": "sailed [nmi]", "samples": "samples", "grade": "data", "findings": "findings",
    "repairs": "repairs", "windows_kept": "held windows", "manoeuvres": "manoeuvres",
    "verdict": "diagnosis",
}  # fmt: skip
_OPTIONAL = ("track", "trial", "vessel", "place", "cause", "report", "missing")
_COUNTS = ("findings_by_code", "manoeuvres", "left_out", "indices")
_BREAKS = re.compile(r"([/_])(?=\w)")  # where a long name may go on in the next line
_GRADES = {"bad": 0, "suspect": 1, "good": 2}  # the worst first
_STATUSES = {
    "failed": (0, "failed"),
    "cut off": (1, "done, cut off"),
    "gone": (2, "recording gone"),
    "waiting": (3, "not analysed yet"),
    "done": (4, "done"),
}
_NUMERIC = {"duration_s", "distance_m", "samples", "repairs", "windows_kept"}
PALETTE = ("#0072B2", "#CC79A7", "#56B4E9", "#000000", "#8C564B", "#7F7F7F", "#9467BD")
COLOURS = {Quality.GOOD: "#9CC9B5", Quality.NOT_EVALUATED: "#D9DEE2", Quality.SUSPECT: "#E69F00",
           Quality.BAD: "#D55E00"}  # fmt: skip
"""Flags, the more severe the later."""
_SUBJECTS = {ALL: "all channels", SHIP: "the ship"}  # of findings that are not about one channel
_BINS = 1200
HEADER = ["channel", "grade", "samples", "rate [Hz]", "gaps", "stuck", "spikes", "out of range", "times twice",
          "steps back"]  # fmt: skip
MOST_CAUSES = 10
"""What a terminal shows: more would push the most severe out of sight."""
_STYLES = {"good": "green", "suspect": "yellow", "bad": "bold red"}
_CHANNEL_COLUMNS = ("channel", "grade", "count", "rate Hz", "gaps", "stuck", "spikes", "range", "twice", "back")


def recording_page(products: Products, row: dict[str, Any]) -> Page:
    """The page of what was made of a recording; ``row`` is its summary."""
    provenance, one_hz = row["provenance"], products.one_hz
    repairs = {
        (repair.code, repair.channel): f"Repaired: {repair.text}, {repair.changed:,} values."
        for repair in products.repairs
    }
    findings = []  # the cells of each with what was repaired of it; the repairs that belong to none remain
    for finding in products.quality.findings:
        what, about, text = finding_cells(finding)
        text = text if ship.find_channel(text.split(" ", 1)[0]) else text[:1].upper() + text[1:]
        findings.append([what, about, text, repairs.pop((finding.code, finding.channel), "")])
    names = [name for name in map(str, one_hz) if f"{name}{SIGMA_SUFFIX}" in one_hz and ship.channel_unit(name)]
    uncertainty = []  # how well the smoother knows each channel of the motion
    for name in names:
        half, unit = 1.96 * one_hz[f"{name}{SIGMA_SUFFIX}"].dropna(), ship.channel_unit(name)
        if len(half):
            sizes = [f"\u00b1 {size:.3g} {unit}" for size in (half.median(), half.max())]
            uncertainty.append([name, *sizes, f"{len(one_hz) - len(half):,}"])
    dropped = sorted(row["windows_dropped"].items(), key=lambda entry: -entry[1])
    software = (
        value if value.startswith(key) else f"{key} {value}" for key, value in provenance["software"].items()
    )
    origin = [
        ("beside this page", ", ".join(_FILES)),
        ("recording", f"{provenance['recording']}, {provenance['bytes']:,} bytes"),
        ("SHA-256", provenance["sha256"]),
        ("options", ", ".join(f"{key} {value}" for key, value in provenance["options"].items())),
        ("software", ", ".join(software)),
    ]
    return render(
        "recording.html",
        title=products.recording.trial.name or provenance["recording"],
        subtitle=f"{provenance['recording']}, {row['start'][:10]} {row['start'][11:19]} UTC",
        headline=headline_of_recording(row), row=row, products=products,
        run_sheet=tables.run_sheet_rows(products.recording, one_hz, products.manoeuvres),
        findings=findings, other_repairs=list(repairs.values()),
        channel_header=HEADER, channels=channel_rows(products.quality),
        executes=[manoeuvre.start for manoeuvre in products.manoeuvres],
        dropped=", ".join(f"{count:,} {reason.replace('_', ' ')}" for reason, count in dropped),
        uncertainty=uncertainty if names else None, origin=origin,
    )  # fmt: skip


def headline_of_recording(row: dict[str, Any]) -> dict[str, str]:
    """The numbers at the top of a recording's page."""
    figures = {"duration": f"{row['duration_s'] / 60:.1f} min", "samples": f"{row['samples']:,}"}
    if row["distance_m"] is not None:
        metres = row["distance_m"]
        figures["sailed"] = (
            f"{metres / quantities.NAUTICAL_MILE_M:.2f} nmi" if metres > _SHORT_WAY_M else f"{metres:.0f} m"
        )
    if row["grade"]:
        figures["worst channel"] = row["grade"]
    if row["missing"]:
        figures["channels missing"] = f"{len(row['missing'])}"
    figures |= {"findings": str(row["findings"]), "repairs": str(row["repairs"])}
    if row["windows_kept"] is not None:
        figures["held windows"] = f"{row['windows_kept']} of {row['windows_candidates']}"
    if "speed_power_kw" in row["indices"]:
        figures[f"at {row['indices']['speed_power_kw']:,.0f} kW"] = speed_in_knots(row)
    return figures | {"manoeuvres": str(sum(row["manoeuvres"].values()))}


def speed_in_knots(row: Mapping[str, Any]) -> str:
    """The speed of a recording's speed trial."""
    return f"{row['indices']['speed_power_mps'] / quantities.KNOT_MPS:.2f} kn"


def event_rows(recording: Recording) -> list[list[str]]:
    """Marks, warnings and changes of configuration in order of time: when each was received, UTC, and its text.

    Events that differ only in their numbers are listed once, with their count.
    """
    rows: list[list[str]] = []
    alike: dict[str, int] = {}
    for time_ns, text in recording.events:
        pattern = _NUMBERS.sub("N", text)
        alike[pattern] = alike.get(pattern, 0) + 1
        if alike[pattern] == 1:
            rows.append([f"{pd.Timestamp(time_ns, unit='ns', tz='UTC'):%Y-%m-%d %H:%M:%S}", text])
    counts = [alike[_NUMBERS.sub("N", text)] for _, text in rows]
    return [[time, f"{text} ({count} similar events)" if count > 1 else text]
            for (time, text), count in zip(rows, counts, strict=True)]  # fmt: skip


def index_page(
    rows: Sequence[Row],
    failures: Sequence[tuple[str, list[str]]],
    title: str,
    served: Mapping[str, Any] | None = None,
) -> Page:
    """The page of rows as of :func:`seatrial.analysis.batch.summary_row` and failures by their cause.

    ``served`` is of a page of a server: its scripts' ``nonce``, how many are ``waiting``, and, where files may be
    sent, up to how many MB (``upload_mb``) and with which ``token``.
    """
    filled = [
        {**dict.fromkeys([*_COLUMNS, *_OPTIONAL]), **row, **{name: row.get(name) or {} for name in _COUNTS}}
        for row in rows
    ]
    present = [row for row in filled if row["status"] != "gone"]
    keys = ("duration_s", "distance_m", "samples", "windows_kept", "findings")
    total = {key: float(sum(row[key] or 0 for row in present)) for key in keys}
    figures = {
        "recordings": f"{len(present):,}",
        "hours": f"{total['duration_s'] / 3600:,.1f}",
        "nautical miles": f"{total['distance_m'] / quantities.NAUTICAL_MILE_M:,.1f}",
        "samples": f"{total['samples']:,.0f}",
        "held windows": f"{total['windows_kept']:,.0f}",
        "manoeuvres": f"{sum(sum(row['manoeuvres'].values()) for row in present):,}",
        "findings": f"{total['findings']:,.0f}",
        "failed": str(sum(row["status"] == "failed" for row in present)),
    }
    heads = {"vessel": "any ship", "grade": "any data", "verdict": "any diagnosis"}
    values = {key: sorted({row[key] for row in filled if row[key]}) for key in heads}
    choices = {key.replace("vessel", "ship"): (head, values[key]) for key, head in heads.items()}
    choices["kind"] = ("any manoeuvre", sorted({kind for row in filled for kind in row["manoeuvres"]}))
    verdicts = any(row["verdict"] for row in filled)
    return render(
        "index.html", title=title, rows=filled, failures=failures, figures=figures, served=served,
        columns={key: head for key, head in _COLUMNS.items() if key != "verdict" or verdicts},
        choices={name: choice for name, choice in choices.items() if choice[1]},
        numeric=_NUMERIC, ordered=_NUMERIC | {"status", "grade", "findings"}, quote=quote,
        broken=lambda name: Markup(_BREAKS.sub(r"\1<wbr>", str(escape(name)))),
        speed_in_knots=speed_in_knots, status_of=lambda row: _STATUSES[_row_status(row)],
        status_class=lambda row: _row_status(row).replace(" ", "-"), duration=duration_text,
        # the worst grade first, and within a grade the row that lacks most channels
        grade_order=lambda row: _GRADES.get(row["grade"] or "", 0) - len(row["missing"]) / 100 if row["missing"]
        else _GRADES.get(row["grade"] or "", ""),
    )  # fmt: skip


def _row_status(row: Row) -> str:
    """The status of a row, where a recording that was cut off is not simply done."""
    return "cut off" if row["status"] == "done" and row.get("closed") is False else str(row["status"])


def duration_text(seconds: float | None) -> str:
    """A duration as text.

    >>> duration_text(65.0), duration_text(3720.0)
    ('1 min 05 s', '1 h 02 min')
    """
    if seconds is None:
        return ""
    hours, remainder = divmod(round(seconds), 3600)
    return f"{hours} h {remainder // 60:02d} min" if hours else f"{remainder // 60} min {remainder % 60:02d} s"


def write_quality(
    quality: DataQuality, folder: Path, trial: Mapping[str, str], provenance: Mapping[str, Any]
) -> list[Path]:
    """Write ``quality.json``, ``flags.parquet`` and ``quality.html`` into a folder; it is made if need be.

    The page says how much is good, what was found, and has the flags over time and the counts by channel.
    ``provenance`` (:func:`seatrial.analysis.tables.table.provenance_of`) goes into both of the files for programs.

    Raises :class:`StorageError` when they cannot be written.
    """
    document, recording = quality.as_dict(), str(provenance["recording"])
    report, flags = folder / "quality.json", folder / "flags.parquet"
    origin = {"recording": recording, "findings": document["findings"], "provenance": provenance}
    metadata = {key: json.dumps(value) for key, value in origin.items()}
    grades = [channel.grade for channel in quality.channels.values()]
    counts = {f"channels {grade}": grades.count(grade) for grade in ("good", "suspect", "bad")}
    page = render(
        "quality.html", title="Data quality", subtitle=recording, quality=quality,
        headline={**counts, "findings": len(quality.findings)},
        trial=[(key.replace("_", " "), value) for key, value in trial.items() if value and key != "channels"],
    )  # fmt: skip
    with files.written_together(report):
        files.write_text(report, json.dumps({**document, "provenance": provenance}, indent=1) + "\n")
        write_parquet(quality.flags, flags, dict.fromkeys(map(str, quality.flags.columns), "QARTOD flag"), metadata)
        return [report, flags, page.write(folder / "quality.html")]


def channel_rows(quality: DataQuality, *, shares: bool = False) -> list[list[str]]:
    """A row a channel, as :data:`HEADER` says; with ``shares`` also the share of its expected samples that is
    flagged good."""
    rows = [[name, channel.grade, *channel_count_cells(channel)] for name, channel in quality.channels.items()]
    for row in rows if shares else ():
        flags = quality.flags[row[0]].to_numpy()
        expected = int((flags != Quality.MISSING).sum()) + quality.channels[row[0]].missing
        row.append(f"{(flags == Quality.GOOD).sum() / expected:.1%}" if expected else "")
    return rows


def finding_cells(finding: Finding) -> list[str]:
    """The code of a finding, its channel and times, and a sentence on it."""
    subject = _SUBJECTS.get(finding.channel, finding.channel)
    about = f"{subject} \u00b7 {finding.start:%H:%M:%S} to {finding.end:%H:%M:%S} UTC"
    return [finding.code.replace("_", " "), about, finding_text(finding)]


def draw_flags(figure: Figure, quality: DataQuality) -> None:
    """Flags by channel over time, and the findings as lines below the channel's, or across all of them."""
    axes = figure.subplots()
    stamps = table.times_ns(quality.flags)
    first, last = table.main_stretch(stamps)
    edges = np.linspace(first, last + 1, _BINS + 1)
    days = date2num(edges.astype("datetime64[ns]"))  # type: ignore[no-untyped-call]
    names = list(quality.channels)
    for row, name in enumerate(names):
        flags = binned_flags(stamps, quality.flags[name].to_numpy(), edges)
        for flag, colour in COLOURS.items():
            bars = [(days[a], days[b] - days[a]) for a, b in zip(*edges_of_runs(flags == flag), strict=True)]
            axes.broken_barh(bars, (row - 0.32, 0.5), facecolors=colour, linewidth=0)

    codes = list(dict.fromkeys(finding.code for finding in quality.findings))
    colours = {code: PALETTE[number % len(PALETTE)] for number, code in enumerate(codes)}
    low, high = axes.get_xlim()
    for finding in quality.findings:
        start, end = date2num([finding.start, finding.end])  # type: ignore[no-untyped-call]
        # its ends are widened so that it shows
        start, end = min(start, end - 0.002 * (high - low)), max(end, start + 0.002 * (high - low))
        colour, depth = colours[finding.code], codes.index(finding.code) % 3
        if finding.channel in (ALL, SHIP):
            axes.axvspan(start, end, color=colour, alpha=0.25, linewidth=0, zorder=0)
        for row, name in enumerate(names):
            if finding.channel == ALL or name in finding.channel:
                bar = (row + 0.22 + 0.08 * depth, 0.08)
                axes.broken_barh([(start, end - start)], bar, facecolors=colour, linewidth=0)

    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(days[0], days[-1])
    axes.xaxis_date()
    axes.xaxis.set_major_formatter(ConciseDateFormatter(axes.xaxis.get_major_locator()))  # type: ignore[no-untyped-call]
    plots.draw_marks(axes, quality.marks)
    axes.tick_params(axis="y", length=0)
    axes.grid(False)
    axes.spines[["top", "right", "left"]].set_visible(False)
    legend = [Patch(color=COLOURS[flag], label=flag.name.lower())
              for flag in (Quality.GOOD, Quality.SUSPECT, Quality.BAD)]  # fmt: skip
    legend += [Patch(color=colour, label=code.replace("_", " ")) for code, colour in colours.items()]
    axes.legend(handles=legend, loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5, fontsize=7, frameon=False)


def binned_flags(stamps: quantities.Ints, flags: NDArray[np.uint8], edges: quantities.Floats) -> quantities.Ints:
    """The most severe flag in each bin of time, 0 where the channel has no sample: [bins].

    A bin without a sample between two that follow each other at the channel's own rate takes the one before.
    """
    present = flags != Quality.MISSING
    bins = np.clip(np.searchsorted(edges, stamps[present], side="right") - 1, 0, edges.size - 2)
    worst = np.zeros(edges.size - 1, dtype=np.int64)
    for flag in COLOURS:
        worst[bins[flags[present] == flag]] = flag
    longest = 2.5 * float(np.median(np.diff(bins))) if bins.size > 1 else 0.0
    sampled = pd.Series(np.where(worst, worst, np.nan))
    return np.asarray(sampled.ffill(limit=max(int(longest), 1)).fillna(0), dtype=np.int64)


def quality_view(quality: DataQuality) -> RenderableType:
    """The table of channels and each finding with its remedy, for a terminal."""
    channels: list[list[str | Text]] = [
        [name, Text(channel.grade, _STYLES[channel.grade]), *channel_count_cells(channel)]
        for name, channel in quality.channels.items()
    ]
    parts: list[RenderableType] = [
        result.terminal_table(None, _CHANNEL_COLUMNS, channels, left_aligned=(0, 1), padding=(0, 1, 0, 0))
    ]
    if missing := missing_channels_text(quality):
        parts.append(Text(missing, style="yellow"))
    parts += [Text(text, style="yellow") for text in quality.unevaluated]
    parts.append("")
    if not quality.findings:
        parts.append(Text("Nothing found.", style="green"))
    causes = quality.causes
    for cause in causes[:MOST_CAUSES]:
        start, end = cause.span
        parts += [
            Text(f"{cause.code}  {_channels_text(cause)}", style="bold"),
            Text(f"  {start:%Y-%m-%d %H:%M:%S} to {end:%H:%M:%S}", style="dim"),
            Text(f"  {cause_text(cause)}"),
        ]
    if hidden := causes[MOST_CAUSES:]:
        counts = Counter(cause.code for cause in hidden)
        kinds = ", ".join(f"{code} {count}" if count > 1 else code for code, count in counts.items())
        full_list = "`seatrial check FILE -o FOLDER` writes a page with all of them"
        parts += ["", Text(f"{len(hidden)} more, less severe ({kinds}): {full_list}", style="yellow")]
    if events := event_counts_text(list(quality.events)):
        parts.append(Text(f"in the log: {events}; `seatrial info` lists marks and alarms", style="dim"))
    return Group(*parts)


def _channels_text(cause: Cause) -> str:
    """The channels of a cause as a heading has them: the first three."""
    names = [_SUBJECTS.get(name, name) for name in cause.channels]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def cause_text(cause: Cause) -> str:
    """A cause as sentences: a finding alone as it stands, several of them as one paragraph."""
    return cause.text if len(cause.findings) > 1 or cause.events else finding_text(cause.findings[0])


def cause_cells(cause: Cause) -> list[str]:
    """The code of a cause, its channels and times, and its text."""
    what, about, _ = finding_cells(cause.findings[0])
    if len(cause.channels) > 1:
        start, end = cause.span
        about = f"{_channels_text(cause)} \u00b7 {start:%H:%M:%S} to {end:%H:%M:%S} UTC"
    return [what, about, cause_text(cause)]


def missing_channels_text(quality: DataQuality) -> str:
    """Which channels of a trial the recording lacks altogether; empty if it has all."""
    return f"not in the recording: {', '.join(quality.missing)}" if quality.missing else ""


def finding_text(finding: Finding) -> str:
    """A finding and its remedy as sentences with one full stop each."""
    return f"{finding.as_json()['text'].rstrip('.')}."


def channel_count_cells(channel: ChannelQuality) -> list[str]:
    """The counts of a channel as text, empty where nothing was found."""
    faults = (len(channel.gaps), len(channel.stuck), channel.spikes, channel.out_of_range, channel.duplicates,
              channel.time_backwards)  # fmt: skip
    return [f"{channel.count:,}", f"{channel.rate_hz:.2f}", *(f"{number:,}" if number else "" for number in faults)]
