"""Findings by cause: one outage is one thing to read, and what is of two causes stays apart."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.recording.reader import Event
from seatrial.analysis.quality.check import DataQuality, check_table, group_findings_by_cause
from seatrial.analysis.quality.findings import Finding

ROWS = 1200
INDEX = pd.date_range("2026-06-01T08:00:00", periods=ROWS, freq="1s", tz="UTC", name="time")
GPS = ("north_m", "east_m", "speed_over_ground_mps", "surge_mps", "sway_mps")
GYRO = ("heading_deg", "yaw_rate_dps")


def silent(*outages: tuple[tuple[str, ...], int, int]) -> pd.DataFrame:
    """A table of two sources, of which some channels are silent from a second to another."""
    generator = np.random.default_rng(0)
    table = pd.DataFrame(
        {name: generator.standard_normal(ROWS).cumsum() * 0.01 for name in (*GPS, *GYRO)}, index=INDEX
    )
    table["heading_deg"] %= 360.0
    for names, start, end in outages:
        for number, name in enumerate(names):
            table.loc[INDEX[start + number % 2] : INDEX[end], name] = np.nan
    table.attrs["sources"] = {**{name: ["gps/GP:RMC derived"] for name in GPS},
                              **{name: ["gyro/HE:HDT"] for name in GYRO}}  # fmt: skip
    return table


def gaps_of(quality: DataQuality) -> list[tuple[str, ...]]:
    return [cause.channels for cause in quality.causes if cause.code == "gap"]


def test_one_outage_of_a_source_is_one_cause() -> None:
    quality = check_table(silent((GPS, 300, 420)))
    assert [set(channels) for channels in gaps_of(quality)] == [set(GPS)]
    assert len([each for each in quality.findings if each.code == "gap"]) == len(GPS)


def test_two_outages_at_two_times_are_two_causes() -> None:
    quality = check_table(silent((GPS, 300, 420), (GYRO, 700, 800)))
    assert sorted(map(len, gaps_of(quality))) == [len(GYRO), len(GPS)]


def test_what_is_derived_is_silent_with_its_inputs() -> None:
    quality = check_table(silent((("heading_deg", "yaw_rate_dps", "surge_mps"), 300, 420)))
    assert [set(channels) for channels in gaps_of(quality)] == [{"heading_deg", "yaw_rate_dps", "surge_mps"}]


def test_every_finding_has_one_cause_and_all_keys_stay() -> None:
    quality = check_table(silent((GPS, 300, 420), (GYRO, 700, 800)))
    told = [finding for cause in quality.causes for finding in cause.findings]
    assert sorted(map(id, told)) == sorted(map(id, quality.findings))
    assert {"channels", "findings", "causes"} <= quality.as_dict().keys()


def test_the_recorders_own_event_is_quoted() -> None:
    quality = check_table(silent((GPS, 300, 420)))
    at_ns = INDEX[421].value
    events = [
        Event(at_ns, "source", "warning", "gps", "source 'gps' is back after 121.0 s"),
        Event(at_ns, "source", "warning", "gyro", "source 'gyro' is back after 9.0 s"),
        Event(INDEX[900].value, "source", "warning", "gps", "gps: the queue is full"),
        Event(at_ns, "mark", "info", "", "zigzag start"),
    ]
    gaps = {name: each.gaps for name, each in quality.channels.items()}
    (cause,) = [
        each
        for each in group_findings_by_cause(quality.findings, gaps, quality.sources, events)
        if each.code == "gap"
    ]
    assert cause.events == ("source 'gps' is back after 121.0 s",)
    assert "back after 121.0 s" in cause.text


def test_spikes_of_a_position_in_metres_and_in_degrees_are_one_cause() -> None:
    def spikes(name: str, count: float) -> Finding:
        return Finding("spike", name, INDEX[3], INDEX[90], "leaves its neighbours", estimate={"count": count})

    sources = {name: ["table: a"] for name in ("east_m", "longitude_deg", "heading_deg")}
    found = [spikes("east_m", 7.0), spikes("longitude_deg", 7.0), spikes("heading_deg", 2.0)]
    assert [each.channels for each in group_findings_by_cause(found, {}, sources)] == [
        ("east_m", "longitude_deg"),
        ("heading_deg",),
    ]


@pytest.mark.parametrize("count", [3, 10, 11, 55])
def test_a_terminal_shows_ten_and_says_how_many_more(count: int) -> None:
    findings = tuple(
        Finding("spike", f"channel_{number}", INDEX[0], INDEX[9], f"finding {number}") for number in range(count)
    )
    text = str(DataQuality({}, findings, pd.DataFrame(index=INDEX)))
    assert sum(f"finding {number}." in text for number in range(count)) == min(count, 10)
    assert (f"{count - 10} more" in text) == (count > 10)
