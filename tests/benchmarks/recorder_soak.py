"""A week at sea in minutes: every frame of it through the recorder's threads, and what that does to its memory.

Eight sentences a second, as fast as the recorder takes them, stamped with the week's own times; parts of 20 MB. In
each hundredth of the week the network goes and comes back, the disk is full for a while, or the computer's clock is
set, by up to a year. Prints memory and open files on the way, and what was recorded; fails unless all was,
once. Run with the number of days:
``python tests/benchmarks/recorder_soak.py 7``.
"""

from __future__ import annotations

import gc
import os
import random
import sys
import tempfile
import time
from pathlib import Path

from seatrial.acquisition.config.trial_file import load_config
from seatrial.acquisition.core.errors import SourceError
from seatrial.acquisition.core.trial import Frame, wall_and_monotonic_ns
from seatrial.acquisition.logger import maintenance, pipeline
from seatrial.acquisition.logger.pipeline import Recorder
from seatrial.acquisition.protocols.nmea0183 import frame_sentence
from seatrial.acquisition.recording import writer
from seatrial.acquisition.recording.parts import RecordingParts
from seatrial.acquisition.recording.reader import read_recording

MESSAGES_HZ = 8
BLOCK = 400
CONFIGURATION = """
[trial]
name = "soak"
origin = { latitude_deg = 63.44, longitude_deg = 10.40 }
[recording]
split_mb = 20
[[source]]
name = "line"
type = "udp"
port = 1
budget_kb_s = 1e6  # a week passes in minutes: what a line says in a second comes in a millisecond
channels = ["north_m", "east_m", "heading_deg", "yaw_rate_dps", "surge_mps", "sway_mps", "wind_direction_deg",
            "wind_speed_mps", "port_rpm", "port_angle_deg", "starboard_rpm", "starboard_angle_deg", "tunnel_rpm"]
"""


class Week:
    """A source that says everything as fast as the recorder's inbox has room for it."""

    lost = 0

    name = "line"

    def __init__(self, days: float) -> None:
        self.wanted, self.said = int(days * 86_400 * MESSAGES_HZ), 0
        self.started = wall_and_monotonic_ns()
        self.recorder: Recorder | None = None
        self.connected = True

    def open(self) -> None:
        if not self.connected:
            raise SourceError("does not answer", where="line")

    def close(self) -> None:
        """Nothing to close."""

    def read(self, timeout_s: float) -> list[Frame] | None:
        if self.said >= self.wanted:
            return None
        if not self.connected:
            raise SourceError("the network is gone", where="line")
        if self.recorder is None or len(self.recorder._inbox) > 4 * BLOCK:
            time.sleep(0.001)
            return []
        frames = [self.frame(self.said + number) for number in range(BLOCK)]
        self.said += BLOCK
        return frames

    def frame(self, number: int) -> Frame:
        at_ns = number * 1_000_000_000 // MESSAGES_HZ
        wave = number % 3600
        texts = (
            f"GPGGA,120000,6326.{wave:04d},N,01024.{wave:04d},E,4,12,0.6,0.0,M,0.0,M,,",
            f"HEHDT,{wave / 10:.1f},T",
            f"TIROT,{wave / 100 - 18:.2f},A",
            f"VDVBW,,,V,{wave / 500:.3f},0.1,A,,V,,V",
            f"WIMWD,{wave / 10:.1f},T,,M,10.0,N,5.1,M",
            f"RCTRD,2,{wave / 20:.1f},R,,V,{wave / 10:.1f}",
            f"RCTRD,4,{wave / 20:.1f},R,,V,{wave / 10:.1f}",
            f"RCTRD,1,{wave / 20:.1f},R,,V,",
        )
        body = frame_sentence(texts[number % len(texts)]).strip()
        return Frame("line", "nmea0183", body, self.started[0] + at_ns, self.started[1] + at_ns)


class Faults:
    """What goes wrong in a week, one after the other, each for some fraction of a second of the computer's time."""

    def __init__(self, week: Week) -> None:
        self._week, self._random = week, random.Random(7)
        self._clock_ns, self._full = 0, False
        self.counts = {"network": 0, "disk": 0, "clock": 0}
        free_bytes = writer.free_and_total_bytes
        writer.free_and_total_bytes = lambda folder: (0, 10**12) if self._full else free_bytes(folder)
        maintenance.wall_and_monotonic_ns = self._now_ns

    def _now_ns(self) -> tuple[int, int]:
        wall_ns, monotonic_ns = wall_and_monotonic_ns()
        return wall_ns + self._clock_ns, monotonic_ns

    def begin(self) -> None:
        """Let the next thing go wrong."""
        kind = min(self.counts, key=lambda name: self.counts[name])
        self.counts[kind] += 1
        if kind == "network":
            self._week.connected = False
        elif kind == "disk":
            self._full = True
        else:
            self._clock_ns = self._random.choice((-1, 1)) * self._random.randrange(365 * 86_400) * 10**9

    def end(self) -> None:
        """Let everything work again; the clock stays as it was set."""
        self._week.connected, self._full = True, False


def state() -> str:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return f"{pages * os.sysconf('SC_PAGE_SIZE') / 1e6:.1f} MB, {len(os.listdir('/proc/self/fd'))} open files"  # noqa: PTH208


def main(days: float) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "soak.toml").write_text(CONFIGURATION)
        config = load_config(Path(scratch) / "soak.toml")
        week = Week(days)
        pipeline.make_source = lambda section: week  # type: ignore[assignment]
        parts = RecordingParts(Path(scratch) / "out", config.trial, config.attachments, config.recording)
        week.recorder = recorder = Recorder(config, parts)
        started_s = time.monotonic()
        recorder.start()
        told = hundredths = 0
        faults = Faults(week)
        while not recorder.ended:
            time.sleep(0.5)
            faults.end()
            if week.said * 100 // week.wanted > hundredths:
                hundredths = week.said * 100 // week.wanted
                faults.begin()
            if week.said * 10 // week.wanted > told:
                told = week.said * 10 // week.wanted
                gc.collect()
                print(f"{10 * told:3d} %  {time.monotonic() - started_s:5.0f} s  {state()}", flush=True)
        recorder.stop()
        parts.close()
        dropped = recorder.health.sources["line"].dropped
        recordings = [read_recording(path) for path in parts.paths]
        recorded = sum(sum(each.raw.values()) for each in recordings)
        span_days = (max(each.end_ns for each in recordings) - recordings[0].start_ns) / 86_400e9
        print(f"said {week.said:,}, recorded {recorded:,}, dropped {dropped:,}; {len(parts.paths)} parts")
        print(f"{span_days:.2f} days by clocks that were set, faults {faults.counts}")
        print(f"all parts closed: {all(recording.closed for recording in recordings)}")
        sys.exit(recorded != week.said or not all(recording.closed for recording in recordings))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 7.0)
