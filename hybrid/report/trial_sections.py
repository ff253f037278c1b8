"""The sections of a trial's report: each puts one part of a case onto a page, with its figures by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquisition.core.errors import ConfigurationError, DataShortageError
from analysis.batch.products import Products
from analysis.report.manoeuvres_page import add_manoeuvres
from analysis.report.page import Page
from analysis.report.quality_page import add_quality
from analysis.report.run_sheet import add_run_sheet, events_of, run_sheet
from analysis.report.trial_figures import add_channels, add_track, known_groups
from hybrid.report.case import Case

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SERIES = ("heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps", "speed_mps")
_COMMANDS = (("port_rpm", "starboard_rpm", "tunnel_rpm"), ("port_angle_deg", "starboard_angle_deg"),
             ("wind_speed_mps",), ("wind_direction_deg",))  # fmt: skip
INTERACTIVE = "interactive"
_A_DAY_S = 86_400.0  # received so long after: the source's clock is of another day
_ORDERS = ("port_order_rpm", "starboard_order_rpm", "port_order_angle_deg", "starboard_order_angle_deg")


def add_sheet(page: Page, case: Case) -> None:
    """The run sheet of each recording, and what happened aboard."""
    for name, products in case.products.items():
        _name_recording(page, case, name)
        add_run_sheet(page, run_sheet(products.recording, products.one_hz, products.manoeuvres, case.ship(name)))
        events = events_of(products.recording)
        if events:
            with page.details(f"{len(events)} events: marks, warnings, changes"):
                page.table(["UTC", "event"], events, words=True)


def _name_recording(page: Page, case: Case, name: str) -> None:
    if len(case.paths) > 1:
        page.heading(name)


def add_data_quality(page: Page, case: Case) -> None:
    """What was found in the data, by recording; times and sources beside."""
    for name, products in case.products.items():
        _name_recording(page, case, name)
        if not products.recording.closed:
            page.note("The recording was not closed and is read as far as it goes.")
        for shortfall in products.shortfalls:
            page.note(f"Please note: {shortfall}.")
        add_quality(page, products.quality)
        _add_repairs(page, case, products)
        _add_times(page, products)
        _add_sources(page, products)


def _add_repairs(page: Page, case: Case, products: Products) -> None:
    """What was put right before anything else, or that nothing was."""
    if not case.repair:
        page.note("Nothing was put right: values that are flagged bad are used as they are (--no-repair).")
    elif not products.repairs:
        page.text("Nothing was certain enough to be put right before what follows.")
    for each in products.repairs:
        page.text(f"Put right before what follows: {each.channel}, {each.text}, {each.changed:,} values.")


def _add_times(page: Page, products: Products) -> None:
    """How even the stamps are, and how long samples took to arrive."""
    rows = []
    for name, series in products.recording.series.items():
        if name not in products.quality.channels or series.measured_ns.size < 2:
            continue
        steps = np.diff(np.sort(series.measured_ns)) / 1e9
        late = (series.received_ns - series.measured_ns) / 1e9
        other = abs(float(np.median(late))) > _A_DAY_S
        rows.append(
            [name, f"{np.median(steps):.3f}", f"{np.quantile(steps, 0.95):.3f}", f"{steps.max():.2f}",
             "another clock" if other else f"{np.median(late):.3f}",
             "" if other else f"{np.quantile(np.abs(late - np.median(late)), 0.95):.3f}",
             ", ".join(series.sources)]
        )  # fmt: skip
    page.text(
        "Between samples, and from being measured to being received [s]; zero where the receiver's clock stamps."
    )
    page.table(
        [
            "channel",
            "between, median [s]",
            "95 % [s]",
            "longest [s]",
            "received after [s]",
            "scatter, 95 % [s]",
            "source",
        ],
        rows,
    )


def _add_sources(page: Page, products: Products) -> None:
    """Frames by source, and what was refused or dropped on the way, as the recorder counted."""
    health = products.recording.health
    if not health:
        page.text("The recording holds no word of its sources: it was imported or simulated.")
        return
    rows = [
        [name, str(each.get("state", "")), f"{each.get('frames', 0):,}", f"{each.get('rejected', 0):,}",
         ", ".join(f"{count:,} {reason}" for reason, count in (each.get("reasons") or {}).items()),
         f"{each.get('dropped', 0):,}"]
        for name, each in health.items()
    ]  # fmt: skip
    page.text("By source, as the recorder counted: frames with a wrong checksum, counter or length are refused.")
    page.table(["source", "state at the end", "frames", "refused", "why", "dropped"], rows)


def add_tracks(page: Page, case: Case) -> None:
    """Each recording's track with the ship to scale, the time, the wind and where manoeuvres began."""
    for name, products in case.products.items():
        _name_recording(page, case, name)
        windows = None if products.windows is None else products.windows.rows
        executes = [each.start for each in products.manoeuvres]
        ship = case.ship(name)
        length_m = None if ship is None else ship.over_all_m
        add_track(page, products.one_hz, windows, length_m, executes, _figure_name(case, "track", name))


def _figure_name(case: Case, what: str, trial: str) -> str:
    return what if len(case.paths) == 1 else f"{what}_{trial}"


def add_time_series(page: Page, case: Case) -> None:
    """Measured, reference and hybrid against time, over thruster settings and wind; held windows shaded."""
    for name, products in case.products.items():
        _name_recording(page, case, name)
        if products.windows is None or case.why_not or not case.predicted(name):
            add_channels(page, products.one_hz, None, _figure_name(case, "time_series", name))
            continue
        page.figure(
            lambda figure, name=name: _draw_series(figure, case, name),  # type: ignore[misc]
            (9.5, 13),
            "Measured, and predicted in windows that follow each other: each prediction starts anew from what was "
            "measured. Speeds of predictions are differences of their tracks. Shaded where thrusters were held.",
            _figure_name(case, "time_series", name),
        )


def _draw_series(figure: Figure, case: Case, name: str) -> None:
    from analysis.report import plots as trial_plots
    from hybrid.report import plots

    products = case.products[name]
    table = products.one_hz.assign(speed_mps=np.hypot(products.one_hz["surge_mps"], products.one_hz["sway_mps"]))
    windows = None if products.windows is None else products.windows.rows
    predicted = case.predicted(name)
    commands = known_groups(table, _COMMANDS)
    grid = figure.subplots(len(_SERIES) + len(commands), 1, sharex=True)
    for axes, channel in zip(grid, _SERIES, strict=False):
        plots.compared(axes, table, channel, predicted, windows)
        axes.label_outer()
    for axes, names in zip(grid[len(_SERIES) :], commands, strict=True):
        orders = [each for each in _ORDERS if each in table and each.replace("_order", "") in names]
        trial_plots.series(axes, table, [*names, *orders], windows)
        axes.label_outer()
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    figure.align_ylabels()


def write_interactive_pages(case: Case, folder: Path | str) -> dict[str, str]:
    """A page to zoom into for each recording, in ``folder``; what they are called and where, for links, or why
    not."""
    from analysis.report.interactive import write_interactive

    pages = {}
    for trial, products in case.products.items():
        windows = None if products.windows is None else products.windows.rows
        page = Path(folder) / (f"{INTERACTIVE}.html" if len(case.paths) == 1 else f"{INTERACTIVE}_{trial}.html")
        predicted = {} if windows is None or case.why_not else case.predicted(trial)
        try:
            write_interactive(page, products.one_hz, windows, predicted, products.manoeuvres, trial,
                              products.recording.path.name)  # fmt: skip
        except (ConfigurationError, DataShortageError) as error:
            pages[f"no page to zoom into: {error}"] = ""
            continue
        what = "track and channels to zoom into" + (f", {trial}" if len(case.paths) > 1 else "")
        pages[what] = page.name
    return pages


def add_indices(page: Page, case: Case) -> None:
    """Manoeuvres and their indices, in metres and ship lengths, with the limits of MSC.137(76) for information."""
    for name, products in case.products.items():
        _name_recording(page, case, name)
        if not products.manoeuvres:
            page.text("No manoeuvre was found in this recording.")
            continue
        ship = case.ship(name)
        length_m = None if ship is None else ship.between_perpendiculars_m
        add_manoeuvres(page, products.table, products.manoeuvres, length_m)
        if length_m is None:
            page.text(
                "The recording names none of the vessel files: no lengths, and no limits that follow from them."
            )
        elif length_m < 100.0:
            page.text(
                f"Lengths are between perpendiculars, {length_m:g} m. The limits were made for ships of 100 m and "
                "more with rudders, and stand here for comparison."
            )
