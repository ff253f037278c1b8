"""A source that floods: its own budget is kept, what it had no room for is counted, the others lose nothing."""

from __future__ import annotations

import re
import socket
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.trial_file import parse_config
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Frame
from seatrial.acquisition.logger.pipeline import RateBudget
from tests.acquisition.conftest import config_text, free_port
from tests.acquisition.test_faults import recording, udp
from tests.acquisition.test_running import say

BUDGET_KB_S, SAVED_S = 20.0, 10.0


def frames(size: int, count: int) -> list[Frame]:
    return [Frame("line", "nmea0183", bytes(size), 0, 0)] * count


@given(
    rate=st.floats(100.0, 1e6),
    reads=st.lists(st.tuples(st.floats(0.0, 30.0), st.integers(0, 300), st.integers(0, 50)), max_size=30),
)
def test_never_more_is_kept_than_the_time_has_earned(rate: float, reads: list[tuple[float, int, int]]) -> None:
    budget, now_s, kept = RateBudget(rate, 0.0), 0.0, 0
    for pause_s, size, count in reads:
        now_s += pause_s
        admitted = budget.count_admitted_frames(frames(size, count), now_s)
        assert 0 <= admitted <= count
        kept += admitted * size
        assert kept <= rate * (now_s + SAVED_S) * (1 + 1e-9)


def test_a_source_within_its_budget_loses_nothing() -> None:
    """A full CAN bus for an hour, by the second, and one burst of what it has saved."""
    budget = RateBudget(1e6, 0.0)
    assert all(budget.count_admitted_frames(frames(8, 1900), second) == 1900 for second in map(float, range(3600)))
    assert budget.count_admitted_frames(frames(1000, 9000), 3600.0) == 9000


def test_a_flood_on_one_line_costs_the_others_nothing(tmp_path: Path) -> None:
    """Junk as fast as it can be sent beside a rate of turn that counts; both as datagrams."""
    junk, sound, stop = free_port(), free_port(), threading.Event()

    def flood() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            while not stop.is_set():
                line.sendto(b"\xff junk" * 150, ("127.0.0.1", junk))

    sources = udp("junk", junk) + f"budget_kb_s = {BUDGET_KB_S}\n" + udp("sound", sound, "yaw_rate_dps")
    began_s = time.monotonic()
    with recording(tmp_path, sources) as running:
        thread = threading.Thread(target=flood)
        thread.start()
        for number in range(300):
            say(sound, f"TIROT,{60 * (number % 50)},A")
            time.sleep(0.005)
        stop.set()
        thread.join()
        running.wait_for_frames("sound", 300)
        took_s = time.monotonic() - began_s
    assert running.recording.series["yaw_rate_dps"].value.tolist() == [float(each % 50) for each in range(300)]
    assert running.sources["sound"].dropped == 0
    kept = running.raw("junk")
    assert sum(len(each.payload) for each in kept) <= BUDGET_KB_S * 1e3 * (took_s + SAVED_S)
    health = running.sources["junk"]
    assert health.over_budget > 0
    assert health.frames - health.over_budget == len(kept)
    assert health.dropped >= health.over_budget
    over = [re.search("junk: over its budget of 20 kB/s by ([0-9,]+) frames", text) for text in running.events]
    assert sum(int(each[1].replace(",", "")) for each in over if each) == health.over_budget


@pytest.mark.parametrize("budget", ["0", "-1", "inf", '"much"'])
def test_a_budget_is_a_positive_number(budget: str) -> None:
    with pytest.raises(ConfigurationError, match="budget_kb_s"):
        parse_config(config_text(f'type = "udp"\nport = 1\nbudget_kb_s = {budget}\n'), "trial.toml")
