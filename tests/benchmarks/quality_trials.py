"""False alarms on sound simulated trials and faults found in spoilt ones: ``make benchmark-quality``.

Ships, seas, manoeuvres, rates, noise levels, lengths and first headings are drawn by chance. Every fault is put
into a trial of its own, written as a recording and checked as `seatrial check` does it. Prints a line a trial and,
at the end, the shares with their 95 % intervals.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seatrial.acquisition.core.trial import Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import write_table
from seatrial.analysis.quality.check import check_recording
from seatrial.analysis.quality.findings import Finding
from seatrial.hybrid.simulation.trial import SimulationNoise, simulate_trial
from tests.analysis.quality import faults
from tests.analysis.quality.faults import Fault, Spoilt

MANOEUVRES = ("voyage", "programme", "paper", "zigzag_20_20", "zigzag_10_10", "turning_circle_20")
RATES_HZ = (1.0, 2.0, 5.0, 10.0)

FAULTS: dict[str, tuple[Fault, ...]] = {
    "speed_scale": tuple(faults.speed_scale(x) for x in (0.98, 1.02, 0.95, 1.1, 0.5144)),
    "yaw_rate_scale": tuple(faults.yaw_rate_scale(x) for x in (1.036, 0.9)),
    "heading_offset": tuple(faults.heading_offset(x) for x in (1.0, -2.0, 5.0, 15.0)),
    "delay of position": tuple(faults.channel_delay("position", x) for x in (0.4, 1.0, 2.0)),
    "delay of heading": tuple(faults.channel_delay("heading", x) for x in (0.5, 1.5)),
    "delay of speed": tuple(faults.channel_delay("speed", x) for x in (1.0, 2.0)),
    "position_time_jitter": (
        faults.position_time_jitter(0.3), faults.position_time_jitter(0.6), faults.position_time_jitter(0.6, 5.0),
    ),
    "heading_time_jitter": (
        faults.heading_time_jitter(0.3), faults.heading_time_jitter(0.6), faults.heading_time_jitter(0.6, 5.0),
    ),
    "heading_wrap": tuple(faults.heading_wrap_interpolated(x) for x in (0.7, 1.3)),
    "order": (faults.order_interpolated, faults.order_interpolated),
    "clock_jump": tuple(faults.clock_jump(x) for x in (2.0, 10.0, -5.0, 60.0)),
    "quantised": (
        faults.quantised("north_m", 0.5), faults.quantised("heading_deg", 1.0), faults.quantised("surge_mps", 0.1),
    ),
    "stuck": (
        faults.stuck("heading_deg", 60.0), faults.stuck("surge_mps", 40.0), faults.stuck("east_m", 30.0),
        faults.stuck("wind_speed_mps", 120.0), faults.stuck("port_rpm", 200.0),
    ),
    "spike": (
        faults.spikes("north_m", 20.0), faults.spikes("heading_deg", 15.0), faults.spikes("surge_mps", 2.0),
        faults.spikes("yaw_rate_dps", 5.0),
    ),
    "out_of_range": (faults.out_of_range("surge_mps", 327.67), faults.out_of_range("heading_deg", 655.35)),
    "gap": (faults.gap(10.0), faults.gap(60.0)),
    "duplicate": (faults.duplicates,),
    "time_backwards": (faults.time_backwards,),
    "percent_scaled": (faults.percent_scaled(203.0),),
    "wind_apparent": (faults.wind_apparent, faults.wind_apparent),
    "wind_direction_offset": (faults.wind_direction_offset(10.0), faults.wind_direction_offset(-25.0)),
}  # fmt: skip


def drawn(
    generator: np.random.Generator, *, windy: bool = False, northward: bool = False
) -> tuple[pd.DataFrame, str]:
    """A sound trial with everything about it drawn by chance, and what it is."""
    vessel = str(generator.choice(["gunnerus_short", "gunnerus_long"]))
    sea = str(generator.choice(["gentle", "moderate"] if windy else ["calm", "gentle", "moderate"]))
    manoeuvre = str(generator.choice(MANOEUVRES))
    rate_hz = float(generator.choice(RATES_HZ))
    duration_s = float(generator.uniform(900.0, 1800.0))
    noise = float(np.exp(generator.uniform(np.log(0.4), np.log(2.5))))
    heading_deg = 0.0 if northward else float(generator.uniform(0.0, 360.0))
    seed = int(generator.integers(1 << 30))
    table, _ = simulate_trial(
        vessel,
        sea,
        manoeuvre,
        duration_s,
        rate_hz,
        seed,
        noise=SimulationNoise().scaled(noise),
        heading_deg=heading_deg,
    )
    return table, f"{vessel} {sea} {manoeuvre} {rate_hz:g} Hz {duration_s:.0f} s noise x{noise:.1f}"


def findings_of(table: pd.DataFrame) -> tuple[Finding, ...]:
    """What a check of the table finds, by way of a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.mcap"
        write_table(table, path, Trial("trial", "ship"), source="simulated")
        return check_recording(read_recording(path)).findings


def clean(number: int) -> tuple[str, list[str]]:
    """A sound trial and the codes of what was found in it."""
    table, what = drawn(np.random.default_rng((number, 1)))
    return what, [f"{each.code} {each.channel} {dict(each.estimate)}" for each in findings_of(table)]


def spoilt(number: int, name: str, which: int) -> tuple[str, bool, bool | None, list[str]]:
    """A spoilt trial: what it was, whether the fault was found, whether its interval holds the truth, the rest."""
    generator = np.random.default_rng((number, 2))
    windy, northward = name.startswith("wind") or name == "stuck", name == "heading_wrap"
    table, what = drawn(generator, windy=windy, northward=northward)
    case = FAULTS[name][which](table, generator)
    findings = findings_of(case.table)
    due = [each for each in findings if is_due(each, case)]
    rest = [f"{each.code} {each.channel} {dict(each.estimate)}" for each in findings if not is_due(each, case)]
    held = holds(due[0], case) if due else None
    return (
        f"{name}[{which}] in {what}: {[dict(each.estimate) for each in due]} truth {case.truth}",
        bool(due),
        held,
        rest,
    )


def is_due(finding: Finding, case: Spoilt) -> bool:
    """Whether a finding is the one that the fault should give."""
    return finding.code == case.code and (
        not case.channels or finding.channel in case.channels or not finding.channel
    )


def holds(finding: Finding, case: Spoilt) -> bool | None:
    """Whether the interval of the estimate holds the truth; None without one."""
    if not case.truth or "low" not in finding.estimate:
        return None
    true = next(iter(case.truth.values()))
    return bool(finding.estimate["low"] <= true <= finding.estimate["high"])


def interval(found: int, of: int) -> str:
    """A share with its exact 95 % interval (Clopper and Pearson 1934)."""
    low = beta.ppf(0.025, found, of - found + 1) if found else 0.0
    high = beta.ppf(0.975, found + 1, of - found) if found < of else 1.0
    return f"{found} of {of} ({100 * low:.0f} to {100 * high:.0f} %)"


def main(rounds: int, first: int) -> None:
    began = time.perf_counter()
    with ProcessPoolExecutor(2) as pool:
        sound = list(pool.map(clean, range(first, first + 50 * rounds)))
        cases = [(name, which) for name, several in FAULTS.items() for which in range(len(several))] * rounds
        numbers = range(first + 1000, first + 1000 + len(cases))
        results = list(pool.map(spoilt, numbers, *zip(*cases, strict=True)))
    print("FALSE FINDINGS on sound trials")
    for what, codes in sound:
        if codes:
            print(f"  {what}: {codes}")
    print("NOT FOUND, or not inside the interval")
    for what, found, held, _ in results:
        if not found or held is False:
            print(f"  {'missed' if not found else 'outside'}: {what}")
    print("ALSO FOUND in spoilt trials")
    for what, _, _, rest in results:
        if rest:
            print(f"  {what.split(':')[0]}: {rest}")
    alarms = Counter(bool(codes) for _, codes in sound)[True]
    print(f"sound trials with a finding: {interval(alarms, len(sound))}")
    print(f"faults found: {interval(sum(found for _, found, _, _ in results), len(results))}")
    judged = [held for _, _, held, _ in results if held is not None]
    print(f"inside their interval: {interval(sum(judged), len(judged))}")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1, int(sys.argv[2]) if len(sys.argv) > 2 else 0)
