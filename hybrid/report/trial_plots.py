"""The figures of a trial's report: each function fills a figure, or axes, with one part of a case."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from seatrial.acquisition.core import quantities, ship
from seatrial.analysis.report.plots import FAINT, INK, PALETTE, Drawing, channels_figure, label_points
from seatrial.hybrid.calibrators import DomainOfApplicability, adaptive
from seatrial.hybrid.prediction.baselines import distances
from seatrial.hybrid.report import plots, prediction_errors
from seatrial.hybrid.report.text import plain, quantity_title
from seatrial.hybrid.report.trial import TrialCase

MISSING = ("missing in surge\n[m/s\u00b2]", "missing in sway\n[m/s\u00b2]", "missing in yaw\n[deg/s\u00b2]")
_NOTHING = "#DFE4E8"  # of a cell of too few seconds
_FEW_MANY = LinearSegmentedColormap.from_list("few_many", ["#F3F6F8", PALETTE[5], PALETTE[0]])
_MOST = 20  # parameters in one picture
_FANS = 40  # on one track; more would lie on each other
_CLOSE = {"typical": 0.5, "difficult": 0.9, "the worst": 1.0}  # by the share of windows that end better


def draw_residual_maps(figure: Figure, residuals: prediction_errors.Residuals) -> None:
    """The acceleration that the model lacks over pairs of quantities, and below the seconds in each cell.

    One colour scale a row; cells of too few seconds are grey.
    """
    # with the angle that the ship is steered by; without planes of which a quantity is not known
    angle = next((f"{kind}_deg" for kind in ship.ANGLES if f"{kind}_deg" in residuals.quantities), "")
    wind = prediction_errors.PLANES[-1][1]
    candidates = (*prediction_errors.PLANES[:-1], (angle, wind if wind in residuals.quantities else "yaw_rate_dps"))
    planes = [plane for plane in candidates if set(plane) <= set(residuals.quantities)]
    cells = [prediction_errors.average_in_cells(residuals, *plane) for plane in planes]
    grid = figure.subplots(
        len(prediction_errors.ACCELERATIONS) + 1, len(planes), squeeze=False, sharex="col", sharey="col"
    )
    for row, words in enumerate(MISSING):
        values = np.concatenate([plane_cells.mean[row].ravel() for plane_cells in cells])
        values = np.abs(values[np.isfinite(values)])
        extent = float(np.quantile(values, 0.98)) if values.size else 1.0
        for axes, plane_cells in zip(grid[row], cells, strict=True):
            mesh = _draw_mesh(
                axes, plane_cells, plane_cells.mean[row], cmap=plots.LESS_MORE, vmin=-extent, vmax=extent
            )
        figure.colorbar(mesh, ax=list(grid[row]), pad=0.01, label=words)
    longest_s = max(float(plane_cells.seconds.max(initial=1.0)) for plane_cells in cells)
    for axes, plane_cells, (x, _) in zip(grid[-1], cells, planes, strict=True):
        counted = np.where(plane_cells.seconds > 0, plane_cells.seconds, np.nan)
        mesh = _draw_mesh(axes, plane_cells, counted, cmap=_FEW_MANY, norm=LogNorm(1.0, max(longest_s, 2.0)))
        axes.set_xlabel(plots.axis_title(x))
    figure.colorbar(mesh, ax=list(grid[-1]), pad=0.01, label="time in a cell\n[s]")
    for row in grid:
        for axes, (_, y) in zip(row, planes, strict=True):
            axes.set_ylabel(plots.axis_title(y).replace(" [", "\n["), fontsize=8)


def _draw_mesh(axes: Axes, cells: prediction_errors.Cells, values: quantities.Floats, **look: object) -> QuadMesh:
    axes.grid(visible=False)
    axes.set_facecolor(_NOTHING)
    return axes.pcolormesh(cells.x_edges, cells.y_edges, np.ma.masked_invalid(values), **look)  # type: ignore[arg-type]


def draw_training_range(axes: Axes, ground: DomainOfApplicability) -> None:
    """Each quantity of a trial against the range of the training, which is the grey bar from 0 to 1.

    The thick line holds the middle 90 % of the trial, the thin one all; dashes are what still counts as inside. A
    quantity that the training did not vary is drawn where it was, at one half.
    """
    width = np.where(ground.high > ground.low, ground.high - ground.low, 1.0)
    shift = np.where(ground.high > ground.low, 0.0, 0.5)
    values = ground.values.reshape(-1, len(ground.names))
    low, lower, upper, high = (
        (np.quantile(values, share, axis=0) - ground.low) / width + shift for share in (0.0, 0.05, 0.95, 1.0)
    )
    rows = np.arange(len(ground.names))
    margin = ground.margin / width
    beyond = [bool(column.any()) for column in ground.outside.T]
    colours = [PALETTE[4] if is_beyond else PALETTE[0] for is_beyond in beyond]
    axes.barh(rows, 1.0, color="#E3E8EC", height=0.7, label="range of the training")
    axes.vlines(-margin, rows - 0.35, rows + 0.35, color=FAINT, linestyle="--")
    axes.vlines(1.0 + margin, rows - 0.35, rows + 0.35, color=FAINT, linestyle="--")
    axes.hlines(rows, low, high, color=colours, linewidth=1.2)
    axes.hlines(rows, lower, upper, color=colours, linewidth=4.5)
    labels = [f"{quantity_title(name)}  {a:.3g} to {b:.3g}"
              for name, a, b in zip(ground.names, ground.low, ground.high, strict=True)]  # fmt: skip
    plots.label_rows(axes, labels)
    reach = max(1.6, float(np.nanmax(np.abs(np.concatenate([low, high])))) * 1.05)
    axes.set_xlim(max(-reach, -4.0), min(1.0 + reach, 5.0))
    axes.set_xlabel("0: smallest, 1: largest value in the training [1]")
    axes.grid(visible=False, axis="y")


def time_series_drawing(case: TrialCase, name: str) -> Drawing | None:
    """The channels of a recording against time, and the motion that is predicted of it."""
    products = case.products[name]
    predicted = {} if case.obstacle else case.predicted(name)
    coloured = {plain(method): (motion, plots.COLOUR[method]) for method, motion in predicted.items()}
    return channels_figure(products.one_hz, products.window_rows, coloured, products.quality.marks)


def draw_all_errors_by_second(figure: Figure, case: TrialCase) -> None:
    """Distance, along, across, heading and speed: median and 90 %; a colour a method, a dash a share."""
    *grid, legend_axes = figure.subplots(2, 3).ravel()
    for axes, quantity in zip(grid, prediction_errors.QUANTITIES, strict=True):
        plots.draw_error_quantiles_by_second(axes, case.errors, quantity)
    legend_axes.set_axis_off()
    handles, words = grid[0].get_legend_handles_labels()
    handles += [Line2D([], [], color=INK, linestyle=style) for style in ("-", "--")]
    legend_axes.legend(handles, [*words, "median over the windows", "90 % of them"], loc="center left")


def draw_prediction_fans(figure: Figure, case: TrialCase) -> None:
    """A track with predictions on it, how all predictions spread second by second, and three of them large.

    The track is that of the recording with most windows; the three are taken from it. Where there are regions, the
    ends of the three are drawn, which would not be seen on the whole way.
    """
    judged, best, name = case.validation, case.best, case.most_judged
    panels = figure.subplot_mosaic("TTTAAA;TTTCCC;001122", height_ratios=(1.0, 1.0, 1.7))
    track_axes, fans, table = panels["T"], {"along": panels["A"], "across": panels["C"]}, case.products[name].one_hz
    chosen = prediction_errors.consecutive_windows(judged.windows)
    chosen = chosen[(judged.windows.trial == name)[chosen]]
    shown = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(_FANS, len(chosen))).astype(int))]
    tracks, colour = judged.tracks[best][shown], plots.COLOUR[best]
    track_axes.plot(table["east_m"], table["north_m"], color=INK, linewidth=1.0, label="measured")
    lifted = np.pad(tracks[..., :2], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan).reshape(-1, 2)
    track_axes.plot(lifted[:, 1], lifted[:, 0], color=colour, linewidth=1.6, label=plain(best))
    track_axes.plot(tracks[:, 0, 1], tracks[:, 0, 0], "o", color=INK, markersize=2.5, label="start of a prediction")
    plots.set_north_up_axes(track_axes)
    for component, axes in fans.items():
        plots.draw_error_fan(axes, getattr(case.errors[best], component), component, best)
        axes.set_ylabel(f"{component}\n[m]")
    plots.add_legend_above(fans["along"], 3)
    fans["along"].tick_params(labelbottom=False)
    fans["across"].set_xlabel("prediction time [s]")

    error = distances(judged.tracks[best], judged.windows.track)
    ranked = chosen[np.argsort(error[chosen, -1], kind="stable")]
    picked: dict[int, str] = {}
    for words, share in _CLOSE.items():
        picked.setdefault(int(ranked[int(share * (len(ranked) - 1))]), words)
    places = [panels[place] for place in "012"]
    for axes in places[len(picked) :]:
        axes.set_axis_off()
    for axes, place, (number, words) in zip(places, "123", picked.items(), strict=False):
        by_method = {method: judged.tracks[method][number] for method in dict.fromkeys((best, "reference"))}
        measured = judged.windows.track[number]
        if judged.region_m is None:
            _draw_whole_prediction(axes, measured, by_method)
        else:
            plots.draw_prediction_end(axes, measured, by_method, judged.region_m[number])
        axes.set_title(f"{place}: {words}, {error[number, -1]:.2g} m off", loc="left", fontsize=9)
    ends = [(x, y) for x, y in judged.windows.track[list(picked), -1, 1::-1]]
    path = table[["east_m", "north_m"]].to_numpy(dtype=float)
    label_points(track_axes, ends, ["1", "2", "3"][: len(picked)], path, color=PALETTE[4], weight="bold")
    handles = {text: handle for axes in (track_axes, panels["0"])
               for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}  # fmt: skip
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6)


def _draw_whole_prediction(
    axes: Axes, measured: quantities.Floats, tracks: Mapping[str, quantities.Floats]
) -> None:
    """Predicted tracks [H+1, 3] by method from start to end beside where the ship was; north up, to scale."""
    shown = {"measured": (measured, INK)}
    shown |= {plain(name): (track, plots.COLOUR[name]) for name, track in tracks.items()}
    for name, (track, colour) in shown.items():
        axes.plot(track[:, 1], track[:, 0], color=colour, linewidth=1.6, label=name)
        axes.plot(track[-1, 1], track[-1, 0], "o", color=colour, markersize=5)
    axes.plot(measured[0, 1], measured[0, 0], "o", color=INK, markersize=2.5)
    axes.margins(0.08)
    plots.set_north_up_axes(axes)
    axes.locator_params(nbins=4)


def draw_error_distributions(figure: Figure, case: TrialCase) -> None:
    """Errors of all windows and seconds by channel and method, the outermost 2 % beyond the axes; and by trial."""
    above, below = np.asarray(figure.subfigures(2, 1))
    for axes, quantity in zip(above.subplots(1, 4), ("along", "across", "heading", "speed"), strict=True):
        by_method = {method: getattr(components, quantity) for method, components in case.errors.items()}
        low, high = np.quantile(np.concatenate([values.ravel() for values in by_method.values()]), [0.01, 0.99])
        edges = np.linspace(low, high, 61)
        for method, values in by_method.items():
            share = 100.0 * np.histogram(values, bins=edges)[0] / values.size
            axes.stairs(share, edges, color=plots.COLOUR[method], linewidth=1.3, label=plain(method))
        axes.set(xlabel=prediction_errors.QUANTITIES[quantity], ylabel="share in a class [%]", ylim=(0.0, None))
    above.legend(*above.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    trial = case.validation.windows.trial
    mean_m = {method: components.distance.mean(axis=1) for method, components in case.errors.items()}
    by_trial = {
        name: {method: errors_m[trial == name] for method, errors_m in mean_m.items()}
        for name in dict.fromkeys(trial.tolist())
    }
    plots.draw_error_spread(below.subplots(), by_trial)


def draw_region_calibration(figure: Figure, calibration: prediction_errors.Calibration) -> None:
    """The share of positions inside the 95 % regions by second, with its bootstrap interval over legs, and the
    probability integral transform of the distances in ten classes; dotted lines are what they should be."""
    coverage_axes, transform_axes = figure.subplots(1, 2)
    seconds = np.arange(1, len(calibration.picp) + 1)
    coverage_axes.axhline(95.0, color=INK, linewidth=0.8, linestyle=":")
    low, high, colour = 100 * calibration.low, 100 * calibration.high, plots.COLOUR["hybrid"]
    coverage_axes.fill_between(seconds, low, high, color=colour, alpha=0.2, linewidth=0)
    coverage_axes.plot(seconds, 100 * calibration.picp, color=colour)
    coverage_axes.set(xlabel="prediction time [s]", ylabel="inside the 95 % region (PICP) [%]",
                      xlim=(0, seconds[-1]))  # fmt: skip
    lowest = np.nanmin(np.append(calibration.low, calibration.picp))
    coverage_axes.set_ylim(min(80.0, 100 * float(lowest) - 2.0), 100.5)

    finite = calibration.pit[np.isfinite(calibration.pit)]
    counts, edges = np.histogram(finite, bins=np.linspace(0.0, 1.0, 11))
    share = 100.0 * counts / max(counts.sum(), 1)
    transform_axes.bar(edges[:-1], share, width=0.1, align="edge", color=colour, alpha=0.6, edgecolor="white")
    transform_axes.axhline(10.0, color=INK, linewidth=0.8, linestyle=":")
    transform_axes.set(xlabel="probability integral transform (PIT) [1]", ylabel="positions [%]", xlim=(0, 1))


def draw_learned_parameters(figure: Figure, learned: adaptive.Parameters) -> None:
    """The best known parameters as factors of the model's numbers, with 95 % intervals, 1 being no change; and how
    their estimates are correlated: 1 and -1 cannot be distinguished, 0 are independent."""
    bar_axes, axes = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    factors = [parameter for parameter in learned.identified if parameter.neutral == 1.0][:_MOST]
    rows = np.arange(len(factors))
    value, low, high = (
        np.array([getattr(parameter, name) for parameter in factors]) for name in ("value", "low", "high")
    )
    colours = [PALETTE[4] if parameter.at_bound else PALETTE[0] for parameter in factors]
    bar_axes.axvline(1.0, color=INK, linewidth=0.8)
    bar_axes.hlines(rows, low, high, color=colours, linewidth=1.6)
    bar_axes.scatter(value, rows, color=colours, s=18, zorder=3)
    plots.label_rows(bar_axes, [parameter.name for parameter in factors])
    bar_axes.set_xlabel("times the model's number [1]")

    names = [parameter.name for parameter in learned.identified[:_MOST]]
    matrix = learned.correlation[: len(names), : len(names)]
    image = axes.imshow(matrix, cmap=plots.LESS_MORE, vmin=-1.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label="correlation [1]", shrink=0.8)
    for (row, column), coefficient in np.ndenumerate(matrix) if len(names) <= 8 else ():
        text = f"{coefficient:.2f}".replace("-", "\u2212")
        axes.text(column, row, text, ha="center", va="center", fontsize=8)
