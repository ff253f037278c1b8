"""The figures of a trial's report: each function fills a figure with one part of a case."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from acquisition.core.arrays import Ints
from analysis.report.plots import series
from analysis.report.trial_figures import known_groups
from hybrid.calibrators.adaptive.parameters import Parameters
from hybrid.prediction.scores import distances
from hybrid.report import map_plots, plots
from hybrid.report.case import Case
from hybrid.report.errors import QUANTITIES, Calibration
from hybrid.report.map_plots import residual_maps, training_range
from hybrid.report.motion import one_after_another
from hybrid.report.words import plain

__all__ = ["residual_maps", "training_range"]  # for the template

_SERIES = ("heading_deg", "surge_mps", "sway_mps", "yaw_rate_dps", "speed_mps")
_COMMANDS = (("port_rpm", "starboard_rpm", "tunnel_rpm"), ("port_angle_deg", "starboard_angle_deg"),
             ("wind_speed_mps",), ("wind_direction_deg",))  # fmt: skip
_ORDERS = ("port_order_rpm", "starboard_order_rpm", "port_order_angle_deg", "starboard_order_angle_deg")
_FANS = 40  # on one track; more would lie on each other
_CLOSE = {"a usual window": 0.5, "a hard one": 0.9, "the hardest": 1.0}


def time_series(figure: Figure, case: Case, name: str) -> None:
    """Measured and predicted motion of a recording over thruster settings and wind, held windows shaded."""
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
        series(axes, table, [*names, *orders], windows)
        axes.label_outer()
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    figure.align_ylabels()


def all_errors_by_second(figure: Figure, case: Case) -> None:
    """Distance, along, across, heading and speed: median and 90 %."""
    grid = figure.subplots(2, 3).ravel()
    for axes, quantity in zip(grid, QUANTITIES, strict=False):
        plots.errors_by_second(axes, case.errors, quantity)
    grid[-1].set_axis_off()
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def prediction_fans(figure: Figure, case: Case, name: str) -> None:
    """The whole track, and three stretches of it large: a usual one, a hard one and the hardest."""
    judged, table = case.validation, case.products[name].one_hz
    chosen = one_after_another(judged.windows)
    chosen = chosen[judged.windows.trial[chosen] == name]
    whole, *close = figure.subplot_mosaic(
        [["whole", "0"], ["whole", "1"], ["whole", "2"]], width_ratios=(1.35, 1.0)
    ).values()

    def draw(axes: Axes, some: Ints) -> None:
        radius_m = None if judged.radius_m is None else judged.radius_m[some]
        tracks = judged.tracks[case.best][some]
        plots.fans_on_track(axes, table, judged.windows.subset(some), tracks, radius_m, case.best)

    draw(whole, chosen[np.unique(np.linspace(0, len(chosen) - 1, min(_FANS, len(chosen))).astype(int))])
    error = distances(judged.tracks["reference"], judged.windows.track).mean(axis=1)
    ranked = chosen[np.argsort(error[chosen], kind="stable")]
    for axes, (words, share) in zip(close, _CLOSE.items(), strict=True):
        number = int(ranked[int(share * (len(ranked) - 1))])
        near = chosen[np.abs(np.flatnonzero(chosen == number)[0] - np.arange(len(chosen))) <= 1]
        draw(axes, near)
        if case.best != "reference":
            plots.tracks_beside(axes, judged.tracks["reference"][near], "reference")
        plots.look_at(axes, judged.windows.track[number], judged.tracks[case.best][number])
        axes.set_title(f"{words}, {judged.windows.start_time[number]:%H:%M:%S} UTC", loc="left", fontsize=8.5)
    handles, labels = close[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6)


def error_fans(figure: Figure, case: Case) -> None:
    """How predictions from all starts spread, ahead and aside, a column a method."""
    methods = [name for name in ("reference", "hybrid") if name in case.errors]
    grid = figure.subplots(2, len(methods), sharex=True, sharey="row", squeeze=False)
    for column, method in enumerate(methods):
        for row, component in enumerate(("along", "across")):
            plots.fan_of_errors(grid[row, column], case.errors[method], component, method)
            grid[row, column].label_outer()
            grid[row, column].legend(loc="upper left", ncols=3)
        grid[0, column].set_title(plain(method), loc="left")


def error_distributions(figure: Figure, case: Case) -> None:
    """Errors by channel, and by trial."""
    above, below = np.asarray(figure.subfigures(2, 1))
    for axes, quantity in zip(above.subplots(1, 4), ("along", "across", "heading", "speed"), strict=True):
        plots.error_histogram(axes, case.errors, quantity)
    above.legend(*above.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    trial = case.validation.windows.trial
    split = {name: each.by_trial(trial) for name, each in case.errors.items()}
    names = list(dict.fromkeys(trial.tolist()))
    plots.error_spread(
        below.subplots(), {name: {method: split[method][name] for method in split} for name in names}
    )


def region_calibration(figure: Figure, calibration: Calibration) -> None:
    """Coverage by second, and the probability integral transform."""
    left, right = figure.subplots(1, 2)
    plots.coverage_by_second(left, calibration)
    plots.transform_histogram(right, calibration)


def parameters(figure: Figure, learned: Parameters) -> None:
    """The best known parameters, and how their estimates are correlated."""
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    map_plots.parameter_bars(left, learned)
    known = learned.identified[:20]
    map_plots.correlations(right, [each.name for each in known], learned.correlation[: len(known), : len(known)])
