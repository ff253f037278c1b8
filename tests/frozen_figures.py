"""What the commands say and write about ten recordings, kept to compare a restructured product with it:

    python -m tests.frozen_figures record DIR
    python -m tests.frozen_figures compare DIR

`compare` runs all commands again, prints every figure that differs by more than a millionth and every line of text
that differs, and ends with status 1 if there are any. Versions, hashes and sizes of files are left out.
"""

from __future__ import annotations

import difflib
import html
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SEATRIAL_DATA", ROOT.parent / "shared" / "data")).resolve()
PLACES = {"DATA": DATA, "MAPS": ROOT / "trials" / "columns", "ROOT": ROOT}
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
ENVIRONMENT = {
    **os.environ, **dict.fromkeys(THREADS, "1"), "COLUMNS": "120", "PYTHONHASHSEED": "0", "TZ": "UTC",
    "PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))),
}  # fmt: skip

RECORDINGS = """\
import DATA/gunnerus_2019_docking/docking_2019-11-09_part1.csv --columns MAPS/gunnerus_2019_docking.toml \
-o docking.mcap
import DATA/gunnerus_2022_trials/trials_2022-10-27_part1.csv --columns MAPS/gunnerus_2022_trials.toml -o trials.mcap
import DATA/esso_osaka/zigzag/zigzag_31-Jul-2020_13_14_21.csv.gz --columns MAPS/esso_osaka.toml -o zigzag.mcap
import DATA/esso_osaka/turning/turn_14-Sep-2020_13_39_32.csv.gz --columns MAPS/esso_osaka.toml -o turn.mcap
simulate --vessel gunnerus_short --manoeuvre zigzag_20_20 --duration 400 --rate 2 --seed 1 -o short_ship.mcap
simulate --vessel gunnerus_long --sea-state gentle --manoeuvre paper --duration 900 --rate 2 --seed 2 -o gentle.mcap
simulate --vessel gunnerus_identified --sea-state moderate --duration 600 --rate 2 --seed 3 -o moderate.mcap
simulate --vessel kvlcc2_7m --manoeuvre zigzag_20_20 --duration 300 --rate 2 --seed 4 \
--hide hull_fouling:resistance_factor=1.5 -o fouled.mcap
simulate --vessel otter_2m --sea-state gentle --duration 600 --rate 2 --seed 5 -o otter.mcap
simulate --vessel gunnerus_long --sea-state gentle --manoeuvre reciprocal --duration 1500 --rate 2 --seed 2 \
-o runs.mcap
export runs.mcap -o runs.csv
import powered.csv --yes --vessel gunnerus_long -o powered.mcap
""".splitlines()
ALL = "docking trials zigzag turn short_ship gentle moderate fouled otter powered"
COMMANDS = {
    "info {0}.mcap --json": ALL,
    "check {0}.mcap -o check_{0} --json": ALL,
    "windows {0}.mcap -o windows_{0}.parquet --json": ALL,
    "manoeuvres {0}.mcap -o manoeuvres_{0} --json": ALL,
    "validate {0}.mcap --json": ALL,
    "validate {0}.mcap --any --json": "otter",
    **dict.fromkeys(("info {0}.mcap", "check {0}.mcap", "manoeuvres {0}.mcap", "validate {0}.mcap"), "zigzag"),
    "speed-power {0}.mcap -o speed_{0} --json": "powered turn",
    "speed-power averages.csv --conditions day.toml -o speed_{0} --json": "averages",
    "evaluate {0}.mcap -o evaluate_{0} --json": "zigzag",
    "evaluate {0}.mcap --stride 15 --draws 1 --method adaptive --method additive --json": "docking gentle turn",
    "diagnose {0}.mcap --part 0..40 -o diagnose_{0} --json": "docking",
    "diagnose {0}.mcap -o diagnose_{0} --json": "zigzag moderate fouled",
    "identify {0}.mcap -o identified_{0}.toml --json": "zigzag fouled",
    "report {0}.mcap --no-pdf --no-interactive --json": "docking zigzag short_ship fouled",
}

AVERAGES = """\
start,duration_min,heading_deg,speed_over_ground_kn,shaft_power_kw,rpm,true_wind_speed_mps,true_wind_direction_deg
2026-05-01 08:00,12,30,11.30,3020,70.1,5.0,300
2026-05-01 08:40,12,210,12.05,3010,70.0,6.0,310
2026-05-01 09:20,12,30,13.42,5240,84.0,5.5,305
2026-05-01 10:00,12,210,13.98,5250,84.1,5.2,300
2026-05-01 10:40,12,30,15.61,8080,97.0,4.5,300
2026-05-01 11:20,12,210,15.52,8060,97.1,4.6,305
"""
DAY = "length_m = 180\nfrontal_area_m2 = 620\npropulsive_efficiency = 0.7\nwind_resistance = [0.8, 0.1, -0.6]\n"

VOLATILE = {
    r"\b[0-9a-f]{64}\b": "HASH",
    r"\bseatrial \d[\w.+]*": "seatrial VERSION",
    r"\b[\d,]+ bytes\b": "BYTES",
    r"\b[\w.]+, line \d+: (?=failed unexpectedly)": "",  # where in the code
}
LEFT_OUT = {"software_version", "recordings_sha256", "sha256", "identified_at", "trained_at"}
NUMBERS = {int, float}
LONG = 60  # a list of more numbers or texts is summarised


def lines_of(text: str, folder: Path) -> list[str]:
    """The lines of a text without what changes with the run."""
    for name, place in {"FOLDER": folder, **PLACES}.items():
        text = text.replace(str(place), name)
    for pattern, name in VOLATILE.items():
        text = re.sub(pattern, name, text)
    return [line.strip() for line in text.splitlines() if line.strip()]


def summary(value: Any, folder: Path) -> Any:
    """JSON or TOML without what changes with the run."""
    if isinstance(value, dict):
        return {key: summary(entry, folder) for key, entry in value.items() if key not in LEFT_OUT}
    if isinstance(value, list):
        numbers = [entry for entry in value if type(entry) in NUMBERS]
        if len(numbers) > LONG:
            return {"count": len(value), "numbers": len(numbers), **pd.Series(numbers).agg(["mean", "std"])}
        if len(value) > LONG and isinstance(value[0], str):
            return {"count": len(value), "first": value[0], "last": value[-1]}
        return [summary(entry, folder) for entry in value]
    return "\n".join(lines_of(value, folder)) if isinstance(value, str) else value


def contents(path: Path, folder: Path) -> Any:
    """The lines or figures of a file; of a table the statistics of its columns."""
    if path.suffix in {".csv", ".parquet"}:
        table = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
        return json.loads(table.describe(include="all").to_json(date_format="iso", double_precision=15))
    if path.suffix == ".html":
        text = re.sub(r"(?s)<(script|style|svg)\b.*?</\1>|<[^>]+>", "\n", path.read_text(encoding="utf-8"))
        return lines_of(html.unescape(text), folder)
    if path.suffix in {".json", ".toml"}:
        read = json.loads if path.suffix == ".json" else tomllib.loads
        return summary(read(path.read_text(encoding="utf-8")), folder)
    return "written"


def outcome(command: str, folder: Path) -> Any:
    """What a command says, its exit code, and what is in the files that it writes."""
    earlier = set(folder.rglob("*"))
    arguments = [re.sub(r"^(DATA|MAPS)", lambda name: str(PLACES[name[0]]), word) for word in command.split()]
    call = [sys.executable, "-m", "seatrial", *arguments]
    done = subprocess.run(call, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
    try:
        printed = summary(json.loads(done.stdout), folder)
    except json.JSONDecodeError:
        printed = lines_of(done.stdout, folder)
    written = sorted(path for path in set(folder.rglob("*")) - earlier if path.is_file())
    files = {str(path.relative_to(folder)): contents(path, folder) for path in written}
    result = {"code": done.returncode, "stdout": printed, "stderr": lines_of(done.stderr, folder), "files": files}
    return json.loads(json.dumps(result, default=str))


def outcomes() -> Iterator[tuple[str, Any]]:
    """Every command with its outcome."""
    on_recordings = [command.format(name) for command, names in COMMANDS.items() for name in names.split()]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        (folder / "averages.csv").write_text(AVERAGES, encoding="utf-8")
        (folder / "day.toml").write_text(DAY, encoding="utf-8")
        for command in (*RECORDINGS, *on_recordings):
            yield command, outcome(command, folder)
            if command.startswith("export") and (folder / "runs.csv").exists():
                table = pd.read_csv(folder / "runs.csv").eval("shaft_power_kw = 2e-4 * abs(port_rpm) ** 3")
                table.to_csv(folder / "powered.csv", index=False)


def differences(place: str, before: Any, after: Any) -> Iterator[str]:
    """A line for every figure or line of text that differs."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys((*before, *after)):
            yield from differences(f"{place} / {key}", before.get(key, "(absent)"), after.get(key, "(absent)"))
    elif isinstance(before, list) and isinstance(after, list):
        if all(isinstance(entry, str) for entry in (*before, *after)):
            changes = list(difflib.unified_diff(before, after, n=0, lineterm=""))[2:]
            yield from (f"{place}: {line}" for line in changes if not line.startswith("@@"))
        elif len(before) != len(after):
            yield f"{place}: {len(before)} entries -> {len(after)} entries"
        else:
            for number, (old, new) in enumerate(zip(before, after, strict=True)):
                yield from differences(f"{place} / {number}", old, new)
    elif before != after:
        numbers = {type(before), type(after)} <= NUMBERS
        if not (numbers and math.isclose(before, after, rel_tol=1e-6, abs_tol=1e-9)):
            yield f"{place}: {before} -> {after}"


def main(task: str, name: str) -> int:
    path, differing = Path(name) / "figures.json", False
    if task == "record":
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(dict(outcomes()), indent=1), encoding="utf-8")
        return 0
    recorded = json.loads(path.read_text(encoding="utf-8"))
    for command, result in outcomes():
        for line in differences(command, recorded.get(command, "(absent)"), result):
            print(line, flush=True)  # noqa: T201 - this is the terminal
            differing = True
    return int(differing)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in {"record", "compare"}:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
