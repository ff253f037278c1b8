"""What the system tells of its clock: who keeps it, how far off it may be, how far off it is at the pulse."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.acquisition.logger import health as module
from seatrial.acquisition.logger.health import (
    HostClock,
    chrony_error_bound_s,
    kernel_clock_state,
    last_pulse_offset_s,
    read_host_clock,
    running_clock_programs,
    timesyncd_error_bound_s,
)


def test_this_computer_can_be_asked() -> None:
    clock = read_host_clock()
    assert clock.is_kept == (kernel_clock_state() == "kept by NTP or PTP")
    assert (clock.error_s is not None) == clock.is_kept


def test_chronys_bound_is_offset_dispersion_and_half_the_delay() -> None:
    """Its manual: the error is at most the offset, the root dispersion and half of the root delay."""
    report = "C0A80105,192.168.1.5,2,1790000000.1,-0.0002,1e-5,2e-5,-12.3,0.0,0.05,0.0040,0.0011,64.2,Normal\n"
    assert chrony_error_bound_s(report) == pytest.approx(0.0002 + 0.0011 + 0.0020)
    assert chrony_error_bound_s("506 Cannot talk to daemon") is None
    assert chrony_error_bound_s("") is None


def test_timesyncds_bound_is_by_its_last_answer() -> None:
    message = (
        "NTPMessage={ Leap=0, Version=4, Mode=4, Stratum=2, Precision=-23, RootDelay=30.517ms,"
        " RootDispersion=457us, Reference=C0A80101, Ignored=no, PacketCount=7, Jitter=1.5ms }"
    )
    assert timesyncd_error_bound_s(message) == pytest.approx(0.030517 / 2 + 457e-6 + 1.5e-3)
    slow = message.replace("Jitter=1.5ms", "Jitter=1min 2.5s").replace("RootDelay=30.517ms", "RootDelay=0")
    assert timesyncd_error_bound_s(slow) == pytest.approx(62.5 + 457e-6)
    assert timesyncd_error_bound_s("NTPMessage={ }") is None


@pytest.mark.parametrize(("at", "now_s", "offset_s"), [
    ("1790000000.000012345#17", 1790000000.4, 12.345e-6), ("1789999999.999900000#17", 1790000000.9, -1e-4),
    ("1790000000.000012345#17", 1790000009.0, None), ("0.000000000#0", 1790000000.0, None), ("", 1.0, None),
])  # fmt: skip
def test_the_pulse_tells_how_far_off_the_clock_is(
    tmp_path: Path, at: str, now_s: float, offset_s: float | None
) -> None:
    assert last_pulse_offset_s(now_s, tmp_path) is None
    (tmp_path / "pps0").mkdir()
    (tmp_path / "pps0" / "assert").write_text(at)
    found = last_pulse_offset_s(now_s, tmp_path)
    assert found == (None if offset_s is None else pytest.approx(offset_s, abs=3e-7))


def test_the_keepers_are_found_among_the_processes(tmp_path: Path) -> None:
    for number, name in enumerate(("bash", "chronyd", "phc2sys", "chronyd")):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "comm").write_text(f"{name}\n")
    assert running_clock_programs(tmp_path) == ["phc2sys", "chronyd"]


@pytest.mark.parametrize(("kernel", "keepers", "report", "said"), [
    ((True, 0.5), ["chronyd"], "", "kept by NTP (chronyd), within 500 ms"),
    ((True, 0.5), ["chronyd"], "A,b,2,0,1e-4,0,0,0,0,0,2e-4,3e-4,1,Normal", "kept by NTP (chronyd), within 0.5 ms"),
    ((True, 2e-6), ["phc2sys"], "", "kept by PTP (phc2sys), within 0.002 ms"),
    ((True, 0.5), [], "", "kept by NTP or PTP, within 500 ms"),
    ((False, 16.0), ["chronyd"], "", "free-running (chronyd)"),
    ((None, None), [], "", "unknown"),
])  # fmt: skip
def test_the_state_in_words(
    monkeypatch: pytest.MonkeyPatch,
    kernel: tuple[bool | None, float | None],
    keepers: list[str],
    report: str,
    said: str,
) -> None:
    monkeypatch.setattr(module, "_read_kernel_clock", lambda: kernel)
    monkeypatch.setattr(module, "running_clock_programs", lambda: keepers)
    monkeypatch.setattr(module, "_command_output", lambda *command: report)
    monkeypatch.setattr(module, "last_pulse_offset_s", lambda now_s: None)
    assert str(read_host_clock()) == said
    assert str(HostClock("free-running", pps_offset_s=-0.0015)) == "free-running, -1.5 ms at the pulse"
