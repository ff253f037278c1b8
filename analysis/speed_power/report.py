"""Speed and power as text: tables for the terminal, a picture, and files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group
from rich.text import Text

from seatrial.acquisition.core.files import write_text, written_together
from seatrial.acquisition.core.quantities import KNOT_MPS
from seatrial.acquisition.core.result import terminal_table, to_json
from seatrial.analysis.report.tables import left_out_line
from seatrial.analysis.speed_power.analysis import SpeedAtPower, SpeedPower

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

RUN_TITLES = ("pair", "start", "min", "heading", "ground", "power", "wind", "current", "water", "ideal")
"""What the columns of :func:`run_rows` are called."""
SETTING_TITLES = ("power", "runs", "iterative", "95 % interval", "mean of means", "95 % interval")
CORRECTION_TITLES = ("correction", "power", "speed", "method, or why not")
UNCERTAINTY_TITLES = ("source of uncertainty", "95 % alone")
_WHOLE_KW = 100.0


def as_dict(result: SpeedPower, requested: Sequence[SpeedAtPower] = ()) -> dict[str, Any]:
    """The result as JSON has it; ``requested`` are speeds at powers that a user asked for."""
    return {**to_json(result), "asked": to_json(list(requested))}


def speed_text(speed: SpeedAtPower) -> tuple[str, str]:
    """A speed in knots and its interval, with digits that the interval bears."""
    knots = np.array([speed.speed_mps, speed.low_mps, speed.high_mps]) / KNOT_MPS
    width = 0.5 * (knots[2] - knots[1])
    digits = int(np.clip(1 - np.floor(np.log10(width)), 1, 2)) if width > 0.0 else 2
    interval = f"{knots[1]:.{digits}f} to {knots[2]:.{digits}f}" if np.isfinite(width) else ""
    return f"{knots[0]:.{digits}f} kn", interval


def result_sentence(result: SpeedPower) -> str:
    """The speed at the highest power in one sentence."""
    speed, interval = speed_text(result.fastest)
    within = f"95 % interval {interval} kn" if interval else f"no interval, as {result.no_interval}"
    return f"In still water the ship makes {speed} ({within}) at {power_text(result.fastest.power_kw)}."


def corrected_words(result: SpeedPower) -> str:
    """What the speeds are corrected for, and what not as too little is known."""
    done = ", ".join(["current", *(correction.name for correction in result.corrections if correction.applied)])
    lacking = [
        correction.name
        for correction in result.corrections
        if correction.method.startswith(("not known", "refused"))
    ]
    return f"Corrected for {done}" + (f"; not for {', '.join(lacking)}." if lacking else ".")


def run_rows(result: SpeedPower) -> list[list[str]]:
    """One row a run, with :data:`RUN_TITLES`.

    Speeds are over ground and through the water, powers as measured and without what wind, waves and water added.
    """
    return [
        [
            f"{run.double_run}", f"{run.start:%H:%M:%S}", f"{run.minutes:.1f}",
            f"{run.heading_deg:.0f} deg", _speed_text(run.speed_mps), power_text(run.power_kw),
            f"{run.wind_mps:.1f} m/s, {run.wind_from_deg:.0f} deg" if np.isfinite(run.wind_mps) else "",
            f"{corrected.current_mps / KNOT_MPS:+.2f} kn",
            _speed_text(corrected.speed_mps), power_text(corrected.power_kw),
        ]
        for corrected in result.runs for run in (corrected.run,)
    ]  # fmt: skip


def power_text(power_kw: float, signed: bool = False) -> str:
    """A power with a sensible number of digits: 10,320 kW, 85.3 kW of a boat, 0.0374 kW of a model.

    >>> power_text(10323.4), power_text(85.26), power_text(-120.4, signed=True), power_text(0.03741)
    ('10,323 kW', '85.3 kW', '-120 kW', '0.0374 kW')
    """
    digits = ",.0f" if abs(power_kw) >= _WHOLE_KW else ".3g"
    return f"{power_kw:{'+' if signed else ''}{digits}} kW"


def _speed_text(speed_mps: float) -> str:
    return f"{speed_mps / KNOT_MPS:.2f} kn"


def setting_rows(result: SpeedPower) -> list[list[str]]:
    """One row a power setting, with :data:`SETTING_TITLES`: by both methods."""
    return [
        [power_text(setting.iterative.power_kw), f"{setting.runs}", *speed_text(setting.iterative),
         *speed_text(setting.mean_of_means)]
        for setting in result.settings
    ]  # fmt: skip


def correction_rows(result: SpeedPower) -> list[list[str]]:
    """One row a correction, with :data:`CORRECTION_TITLES`: its size at the highest setting, method or why not."""
    return [
        [
            correction.name,
            power_text(correction.power_kw, signed=True) if correction.applied else "none",
            f"{correction.speed_mps / KNOT_MPS:+.2f} kn" if correction.applied else "none",
            correction.method,
        ]
        for correction in result.corrections
    ]


def uncertainty_rows(result: SpeedPower) -> list[list[str]]:
    """One row a source of uncertainty at the highest setting, the largest first: :data:`UNCERTAINTY_TITLES`."""
    return [
        [source.name, f"\N{PLUS-MINUS SIGN}{source.half_mps / KNOT_MPS:.3f} kn"] for source in result.uncertainties
    ]


def view(result: SpeedPower) -> Group:
    """Power settings, runs, corrections, sources of uncertainty, warnings and what was left out."""

    def table(titles: tuple[str, ...], rows: list[list[str]], *, words: bool = False) -> Table:
        places = range(len(titles) if words else 0)
        cells = (list(map(Text, row)) for row in rows)
        return terminal_table(None, titles, cells, left_aligned=places, wrap=not words, padding=(0, 2, 0, 0))

    curve = result.curve
    return Group(
        Text("Speed at power, ISO 15016:2015", style="bold"),
        table(SETTING_TITLES, setting_rows(result)),
        Text(f"power = {curve.a:,.1f} + {curve.b:.4g} V^{curve.q:.2f} kW, V in m/s", style="dim"),
        *([Text(f"no interval: {result.no_interval}", style="yellow")] if result.no_interval else []),
        Text(""),
        table(RUN_TITLES, run_rows(result)),
        Text(""),
        table(CORRECTION_TITLES, correction_rows(result), words=True),
        Text(""),
        *([table(UNCERTAINTY_TITLES, uncertainty_rows(result), words=True)] if result.uncertainties else []),
        Text(""),
        *(Text(f"note: {warning}", style="yellow") for warning in result.warnings),
        *(Text(left_out_line(candidate), style="dim") for candidate in result.left_out),
    )


def draw(figure: Figure, result: SpeedPower) -> None:
    """Power over speed: the runs as measured and as corrected, the curve with its band, the mean of means."""
    from seatrial.analysis.report.plots import FAINT, PALETTE

    axes = figure.subplots()
    powers = [point.power_kw for point in result.band]
    speeds, low, high = (np.array([getattr(point, name) for point in result.band]) / KNOT_MPS
                         for name in ("speed_mps", "low_mps", "high_mps"))  # fmt: skip
    if not result.no_interval:
        axes.fill_betweenx(powers, low, high, color=PALETTE[0], alpha=0.25, linewidth=0.0, label="95 % interval")
    axes.plot(speeds, powers, color=PALETTE[0], label="iterative method")
    points = np.array([[(pair.run.speed_mps, pair.speed_mps), (pair.run.power_kw, pair.power_kw)]
                       for pair in result.runs])  # fmt: skip
    knots, kilowatts = points[:, 0].T / KNOT_MPS, points[:, 1].T
    axes.plot(knots, kilowatts, color=FAINT, linewidth=0.8)
    axes.plot(knots[0], kilowatts[0], "o", color=FAINT, markersize=5, label="runs, speed over ground")
    axes.plot(knots[1], kilowatts[1], "o", color=PALETTE[0], markersize=5, label="runs, corrected")
    for number, setting in enumerate(result.settings):
        mean = setting.mean_of_means
        sides = np.nan_to_num([[mean.speed_mps - mean.low_mps], [mean.high_mps - mean.speed_mps]]) / KNOT_MPS
        axes.errorbar(mean.speed_mps / KNOT_MPS, mean.power_kw, xerr=sides, fmt="s", color=PALETTE[4], markersize=5,
                      capsize=3, label="" if number else "mean of means")  # fmt: skip
    axes.set_xlabel("speed [kn]")
    axes.set_ylabel("power at the shafts [kW]")
    axes.legend(loc="upper left")


def write_speed_power(result: SpeedPower, folder: Path) -> list[Path]:
    """Write ``speed_power.json`` and the picture. Raises :class:`StorageError`."""
    from seatrial.analysis.report.pages import write_figure

    plain = folder / "speed_power.json"
    with written_together(plain):
        write_text(plain, json.dumps(as_dict(result), indent=2) + "\n")
        return [plain, *write_figure(result.plot(), folder, "speed_power", ("png", "svg"))]
