"""Speed and power for people: tables for the terminal, a picture, and files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from acquisition.core.files import write_text, written_together
from acquisition.core.serialisation import to_json
from acquisition.core.units import KNOT_MPS
from analysis.manoeuvres.report import left_out_line
from analysis.speed_power.analysis import SpeedAtPower, SpeedPower

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Group

_RUNS = ("pair", "start", "min", "heading", "ground", "power", "current", "water", "ideal")
_SETTINGS = ("power", "runs", "iterative", "95 % interval", "mean of means", "95 % interval")


def as_dict(result: SpeedPower, asked: Sequence[SpeedAtPower] = ()) -> dict[str, Any]:
    """The result as JSON has it; ``asked`` are speeds at powers that somebody wants to know."""
    return {**to_json(result), "asked": to_json(list(asked))}


def speed_text(speed: SpeedAtPower) -> tuple[str, str]:
    """A speed in knots and its interval, with digits that the interval bears."""
    knots = np.array([speed.speed_mps, speed.low_mps, speed.high_mps]) / KNOT_MPS
    width = 0.5 * (knots[2] - knots[1])
    digits = int(np.clip(1 - np.floor(np.log10(width)), 1, 2)) if width > 0.0 else 2
    interval = f"{knots[1]:.{digits}f} to {knots[2]:.{digits}f}" if np.isfinite(width) else ""
    return f"{knots[0]:.{digits}f} kn", interval


def sentence(result: SpeedPower) -> str:
    """The speed at the highest power in one sentence."""
    speed, interval = speed_text(result.fastest)
    within = f" (95 % interval {interval} kn)" if interval else ""
    return f"In still water she makes {speed}{within} at {result.fastest.power_kw:,.0f} kW."


def corrected_words(result: SpeedPower) -> str:
    """What the speeds are corrected for, and what not as too little is known."""
    done = ", ".join(["current", *(each.name for each in result.corrections if each.applied)])
    lacking = [each.name for each in result.corrections if each.method.startswith("not known")]
    return f"Corrected for {done}" + (
        f"; not for {', '.join(lacking)}, of which too little is known." if lacking else "."
    )


def run_rows(result: SpeedPower) -> list[list[str]]:
    """One row a run, speeds in knots."""
    return [
        [
            f"{each.run.double_run}", f"{each.run.start:%H:%M:%S}", f"{each.run.minutes:.1f}",
            f"{each.run.heading_deg:.0f} deg", f"{each.run.speed_mps / KNOT_MPS:.2f} kn",
            f"{each.run.power_kw:.4g} kW", f"{each.current_mps / KNOT_MPS:+.2f} kn",
            f"{each.speed_mps / KNOT_MPS:.2f} kn", f"{each.power_kw:.4g} kW",
        ]
        for each in result.runs
    ]  # fmt: skip


def setting_rows(result: SpeedPower) -> list[list[str]]:
    """One row a power setting, both methods beside each other."""
    return [
        [
            f"{each.iterative.power_kw:.4g} kW",
            f"{each.runs}",
            *speed_text(each.iterative),
            *speed_text(each.mean_of_means),
        ]
        for each in result.settings
    ]


def view(result: SpeedPower) -> Group:
    """Power settings, runs, corrections, warnings and what was left out."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    def table(header: tuple[str, ...], rows: list[list[str]]) -> Table:
        made = Table(box=None, header_style="dim", padding=(0, 2, 0, 0))
        for title in header:
            made.add_column(title, justify="right")
        for row in rows:
            made.add_row(*map(Text, row))
        return made

    curve = result.curve
    return Group(
        Text("Speed at power, ISO 15016:2015", style="bold"),
        table(_SETTINGS, setting_rows(result)),
        Text(f"power = {curve.a:.4g} + {curve.b:.4g} V^{curve.q:.2f} kW, V in m/s", style="dim"),
        Text(""),
        table(_RUNS, run_rows(result)),
        Text(""),
        *(Text(f"{each.name}: {'corrected, ' if each.applied else 'not corrected, '}{each.method}")
          for each in result.corrections),
        *(Text(f"note: {each}", style="yellow") for each in result.warnings),
        *(Text(left_out_line(each), style="dim") for each in result.left_out),
    )  # fmt: skip


def draw(figure: Figure, result: SpeedPower) -> None:
    """Power over speed: the runs as measured and as corrected, the curve with its band, the mean of means."""
    from analysis.report.plots import FAINT, PALETTE

    axes = figure.subplots()
    powers = [each.power_kw for each in result.band]
    speeds, low, high = (np.array([getattr(each, name) for each in result.band]) / KNOT_MPS
                         for name in ("speed_mps", "low_mps", "high_mps"))  # fmt: skip
    axes.fill_betweenx(powers, low, high, color=PALETTE[0], alpha=0.25, linewidth=0.0, label="95 % interval")
    axes.plot(speeds, powers, color=PALETTE[0], label="iterative method")
    points = np.array([[(each.run.speed_mps, each.speed_mps), (each.run.power_kw, each.power_kw)]
                       for each in result.runs])  # fmt: skip
    knots, kilowatts = points[:, 0].T / KNOT_MPS, points[:, 1].T
    axes.plot(knots, kilowatts, color=FAINT, linewidth=0.8)
    axes.plot(knots[0], kilowatts[0], "o", color=FAINT, markersize=5, label="runs, speed over ground")
    axes.plot(knots[1], kilowatts[1], "o", color=PALETTE[0], markersize=5, label="runs, corrected")
    for number, setting in enumerate(result.settings):
        mean = setting.mean_of_means
        half = np.nan_to_num(mean.high_mps - mean.low_mps) / 2.0 / KNOT_MPS
        axes.errorbar(mean.speed_mps / KNOT_MPS, mean.power_kw, xerr=half, fmt="s", color=PALETTE[4], markersize=5,
                      capsize=3, label="" if number else "mean of means")  # fmt: skip
    axes.set_xlabel("speed [kn]")
    axes.set_ylabel("power at the shafts [kW]")
    axes.legend(loc="upper left")


def write_speed_power(result: SpeedPower, folder: Path) -> list[Path]:
    """Write ``speed_power.json`` and the picture. Raises :class:`StorageError`."""
    from analysis.report.figures import write_figure

    plain = folder / "speed_power.json"
    with written_together(plain):
        write_text(plain, json.dumps(as_dict(result), indent=2) + "\n")
        return [plain, *write_figure(result.plot(), folder, "speed_power", ("png", "svg"))]
