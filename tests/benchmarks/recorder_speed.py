"""How many times as fast as a saturated 250 kbit/s bus the recorder takes frames from a log; prints the ratio.

Run as ``python tests/benchmarks/recorder_speed.py [LOG...]``: with CAN logs of your own, or a made-up candump log
in which seven of eight frames are of groups that become channels. Reading, decoding, deriving and recording
(raw frames and samples, compressed and synced) are all in it.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.logger.record import record

SATURATED_HZ = 1900
FRAMES = 100_000
MESSAGES = (
    "09F11223#FF7B2CFF7FFF7FFC", "09F11323#FF10270000FFFFFF", "0DF11923#FFFF7F64009CFFFF",
    "09F80123#80C3CE25803D3306", "09F80223#FFFC7B2C0402FFFF", "0DFD0223#FF2003E803F8FFFF",
    "0DF50323#FF0402FFFFFFFFFF", "1DFF1123#AABBCCDDEEFF0011",
)  # fmt: skip
CHANNELS = (
    "north_m", "east_m", "heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "wind_direction_deg",
    "wind_speed_mps", "roll_deg", "pitch_deg", "speed_through_water_mps",
)  # fmt: skip


def made_up_log(path: Path) -> Path:
    lines = (
        f"({1_790_000_000 + number / SATURATED_HZ:.6f}) can0 {MESSAGES[number % len(MESSAGES)]}"
        for number in range(FRAMES)
    )
    path.write_text("\n".join(lines) + "\n")
    return path


def measure(log: Path, folder: Path) -> None:
    listed = ", ".join(f'"{name}"' for name in CHANNELS)
    (folder / "speed.toml").write_text(
        f'[trial]\nname = "speed"\n[[source]]\nname = "bus"\ntype = "can_file"\npath = "{log.resolve()}"\n'
        f"channels = [{listed}]\n"
    )
    config = load_config(folder / "speed.toml")
    started_s, cpu_s = time.perf_counter(), time.process_time()
    _, health = record(config, folder / "out")
    took_s, cpu_s = time.perf_counter() - started_s, time.process_time() - cpu_s
    frames = health.sources["bus"].frames
    print(
        f"{log.name}: {frames:,} frames, {health.samples:,} samples in {took_s:.2f} s: {frames / took_s:,.0f} "
        f"frames/s, {frames / took_s / SATURATED_HZ:.1f} times a saturated bus; {1e6 * cpu_s / frames:.1f} us each"
    )


def main(logs: list[Path]) -> None:
    sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        measure(made_up_log(folder / "warm_up.log"), folder)
        for log in logs or [folder / "warm_up.log"]:
            measure(log, folder)


if __name__ == "__main__":
    main([Path(each) for each in sys.argv[1:]])
