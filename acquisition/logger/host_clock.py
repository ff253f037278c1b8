"""Who keeps this computer's clock right, and how well: what the system tells without privileges.

The kernel says whether anybody keeps it (adjtimex), the list of processes who, chrony and systemd-timesyncd how far
off it may be, a pulse a second (PPS) how far it is off.
"""

from __future__ import annotations

import ctypes
import re
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)
_PATIENCE_S = 2.0
_KEEPERS = {
    "phc2sys": "PTP", "chronyd": "NTP", "ntpd": "NTP", "ntpd-rs": "NTP", "ntp-daemon": "NTP", "openntpd": "NTP",
    "systemd-timesyn": "NTP",
}  # fmt: skip
"""Programs that keep a clock, by their names in /proc, which are cut to 15 letters."""
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}
_LATEST_PULSE_S = 2.5
HOST_CLOCK = "host clock"
"""The name of the computer's clock among the sources' states; no source can be called so."""


@dataclass(frozen=True, slots=True)
class HostClock:
    """The state of the computer's clock.

    ``error_s`` is a bound of its error, as far as its keeper tells; ``pps_offset_s`` how late the last pulse was by
    it, where there is a pulse. ``keeper`` names the programs that keep it, whether they succeed or not.
    """

    state: str = "unknown"
    keeper: str = ""
    error_s: float | None = None
    pps_offset_s: float | None = None

    @property
    def kept(self) -> bool:
        """Whether the system says that it is kept right."""
        return self.state.startswith("kept")

    def as_message(self) -> dict[str, Any]:
        errors = {"error_s": self.error_s, "pps_offset_s": self.pps_offset_s}
        fields = {key: value for key, value in errors.items() if value is not None}
        return {"source": HOST_CLOCK, "state": self.state, "keeper": self.keeper, **fields}

    def __str__(self) -> str:
        by = f" ({self.keeper})" if self.keeper else ""
        within = "" if self.error_s is None else f", within {1e3 * self.error_s:.3g} ms"
        pulse = "" if self.pps_offset_s is None else f", {1e3 * self.pps_offset_s:+.3g} ms at the pulse"
        return f"{self.state}{by}{within}{pulse}"


def kernel_state() -> str:
    """What the kernel alone says of the clock, at once: "kept by NTP or PTP", "free-running", "unknown"."""
    is_kept, _ = _kernel()
    return "unknown" if is_kept is None else "kept by NTP or PTP" if is_kept else "free-running"


def boot_metadata(boot: Path = Path("/proc/sys/kernel/random/boot_id")) -> dict[str, str]:
    """The boot since which the monotonic clock counts, and how long it stood as the computer slept [ns].

    Nothing where the system does not tell both.
    """
    try:
        slept_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
        return {"boot": boot.read_text().strip(), "slept_ns": str(max(slept_ns, 0))}
    except (OSError, AttributeError):
        return {}


def host_clock() -> HostClock:
    """Look at the clock now; asks other programs, and may take some seconds."""
    is_kept, kernel_error_s = _kernel()
    keepers = running_keepers()
    kinds = " and ".join(dict.fromkeys(_KEEPERS[keeper] for keeper in keepers))
    server_error_s = chrony_error_s(_answer("chronyc", "-n", "-c", "tracking")) if "chronyd" in keepers else None
    if "systemd-timesyn" in keepers:
        server_error_s = timesyncd_error_s(_answer("timedatectl", "show-timesync", "--property=NTPMessage"))
    return HostClock(
        state=f"kept by {kinds}" if is_kept and kinds else kernel_state(),
        keeper=", ".join(keepers),
        error_s=(kernel_error_s if server_error_s is None else server_error_s) if is_kept else None,
        pps_offset_s=pulse_offset_s(time.time()),
    )


class _Timex(ctypes.Structure):
    """The beginning of struct timex, and room for the rest of it."""

    _fields_ = [
        ("modes", ctypes.c_uint), ("offset", ctypes.c_long), ("freq", ctypes.c_long), ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long), ("status", ctypes.c_int), ("rest", ctypes.c_byte * 512),
    ]  # fmt: skip


def _kernel() -> tuple[bool | None, float | None]:
    """Whether the clock is kept, None if nobody knows, and the largest error that the kernel reckons with [s]."""
    timex: Any = _Timex()  # modes 0: read only
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    except (OSError, AttributeError):
        return None, None
    return state not in (_UNSYNCHRONISED, -1), timex.maxerror * 1e-6


def running_keepers(processes: Path = Path("/proc")) -> list[str]:
    """The programs that run and keep a clock."""
    running = set()
    for path in processes.glob("[0-9]*/comm"):
        with suppress(OSError):
            running.add(path.read_text().strip())
    return [name for name in _KEEPERS if name in running]


def _answer(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""


def chrony_error_s(report: str) -> float | None:
    """The bound that ``chronyc -c tracking`` gives: offset, root dispersion and half the root delay [s]."""
    fields = report.strip().split(",")
    with suppress(ValueError, IndexError):
        offset, delay, dispersion = (float(fields[number]) for number in (4, 10, 11))
        return abs(offset) + dispersion + delay / 2
    return None


def timesyncd_error_s(message: str) -> float | None:
    """The bound by timesyncd's last answer: root dispersion, half the root delay, and the jitter since [s]."""
    parts = [_seconds(message, name) for name in ("RootDelay", "RootDispersion", "Jitter")]
    if None in parts:
        return None
    delay, dispersion, jitter = (part or 0.0 for part in parts)
    return delay / 2 + dispersion + jitter


def _seconds(message: str, name: str) -> float | None:
    match = re.search(rf"\b{name}=((?:[\d.]+[a-zµ]* ?)+)", message)
    if match is None:
        return None
    pieces: Sequence[tuple[str, str]] = re.findall(r"([\d.]+)([a-zµ]*)", match[1])
    try:
        return sum(float(number) * _SECONDS[unit] for number, unit in pieces)
    except (KeyError, ValueError):
        return None


def pulse_offset_s(now_s: float, pulses: Path = Path("/sys/class/pps")) -> float | None:
    """By how much the last pulse missed a whole second of the clock [s]; None without a pulse of late."""
    for path in sorted(pulses.glob("*/assert")):
        with suppress(OSError, ValueError):
            at_s = float(path.read_text().partition("#")[0])
            if abs(now_s - at_s) < _LATEST_PULSE_S:
                return at_s - round(at_s)
    return None
