"""One source a channel: who is preferred, when it changes hands, and what the event log says of it."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import CanSource, Device, MavlinkSource, UdpSource
from seatrial.acquisition.core.trial import Fix, Sample
from seatrial.acquisition.logger.health import SILENT_NS
from seatrial.acquisition.logger.processing import Selector

SECOND = 1_000_000_000
HEADING = ("heading_deg",)
WIND = ("wind_direction_deg", "north_m")


def line(name: str, channels: tuple[str, ...] = HEADING) -> UdpSource:
    return UdpSource(name=name, channels=channels, type="udp", port=1)


def bus(*devices: str, channels: tuple[str, ...] = (*HEADING, *WIND)) -> CanSource:
    listed = tuple(Device(name, address=number) for number, name in enumerate(devices))
    return CanSource(name="bus", channels=channels, type="can", interface="x", channel="x", devices=listed)


def sample(source: str, at_s: float, quantity: str = "heading_deg") -> Sample:
    at_ns = round(at_s * SECOND)
    return Sample(quantity, 1.0, source, 0, at_ns, 0)


def admitted(selector: Selector, *said: tuple[str, float], quantity: str = "heading_deg") -> list[str]:
    """The sources of those of ``said``, (source, second), that have the channel."""
    return [
        source for source, at_s in said if selector.select_and_report_handover(sample(source, at_s, quantity))[0]
    ]


def test_the_order_in_the_file_is_the_order_of_preference() -> None:
    selector = Selector((line("first"), line("second"), line("third")))
    said = [("third/HE:HDT", 0.0), ("second/HE:HDT", 0.1), ("third/HE:HDT", 0.2), ("first/HE:HDT", 0.3)]
    said += [("second/HE:HDT", 0.4), ("third/HE:HDT", 0.5), ("first/HE:HDT", 0.6)]
    assert admitted(selector, *said) == ["third/HE:HDT", "second/HE:HDT", "first/HE:HDT", "first/HE:HDT"]


def test_autopilot_goes_before_its_companion() -> None:
    """A companion's ATTITUDE had the heading, of another compass, before the autopilot's GLOBAL_POSITION_INT."""
    selector = Selector((MavlinkSource(name="boat", channels=HEADING, type="mavlink", port=1),))
    said = [("boat/1.191:ATTITUDE", 0.0), ("boat/1:GLOBAL_POSITION_INT", 0.1), ("boat/1.191:ATTITUDE", 0.2)]
    assert admitted(selector, *said) == ["boat/1.191:ATTITUDE", "boat/1:GLOBAL_POSITION_INT"]


def test_a_source_provides_only_what_it_lists() -> None:
    selector = Selector((line("first"), line("second", WIND)))
    assert admitted(selector, ("second/HE:HDT", 0.0), ("unknown/HE:HDT", 9.0)) == []
    assert admitted(selector, ("first/WI:MWD", 0.0), quantity="wind_direction_deg") == []
    assert selector.select_and_report_handover(sample("first/HE:HDT", 9.1)) == (True, None)


def test_fail_over_comes_after_two_and_a_half_seconds_and_back_at_once() -> None:
    selector = Selector((line("first"), line("second")))
    assert selector.select_and_report_handover(sample("first/HE:HDT", 1.0)) == (True, None)
    assert selector.select_and_report_handover(sample("second/HE:HDT", 3.5)) == (False, None)
    assert (
        selector.select_and_report_handover(sample("second/HE:HDT", 3.6))[1].text
        == "heading_deg: from first/HE:HDT to second/HE:HDT"
    )
    assert selector.select_and_report_handover(sample("second/HE:HDT", 3.7)) == (True, None)
    assert (
        selector.select_and_report_handover(sample("first/HE:HDT", 3.8))[1].text
        == "heading_deg: from second/HE:HDT to first/HE:HDT"
    )
    assert selector.select_and_report_handover(sample("second/HE:HDT", 3.9)) == (False, None)


def test_one_channel_changes_hands_and_the_other_does_not() -> None:
    selector = Selector((line("first", (*HEADING, *WIND)), line("second", (*HEADING, *WIND))))
    for at_s in (0.0, 1.0, 2.0, 3.0):
        selector.select_and_report_handover(sample("first/WI:MWD", at_s, "wind_direction_deg"))
    selector.select_and_report_handover(sample("first/HE:HDT", 0.0))
    assert admitted(selector, ("second/HE:HDT", 3.0)) == ["second/HE:HDT"]
    assert admitted(selector, ("second/WI:MWD", 3.0), quantity="wind_direction_deg") == []


def test_the_devices_of_a_bus_have_their_order_and_all_others_come_after_them() -> None:
    selector = Selector((bus("gyro", "compass"), line("line")))
    worst_first = ["line/HE:HDT", "bus/77:127250", "bus/compass:127250", "bus/gyro:127250"]
    said = [(source, 0.1 * number) for number, source in enumerate(worst_first)]
    assert admitted(selector, *said) == worst_first
    assert admitted(selector, *((source, 0.5) for source in worst_first)) == worst_first[-1:]


def test_of_devices_that_are_not_listed_the_first_that_came_stays() -> None:
    """By address and by NAME; a lower address is no better."""
    selector = Selector((bus("gyro"),))
    said = [("bus/77:127250", 0.0), ("bus/3:127250", 1.0), ("bus/c0508c00e7e0b87f:127250", 2.0)]
    said += [("bus/77:127250", 2.4), ("bus/3:127250", 4.8), ("bus/3:127250", 5.0), ("bus/77:127250", 5.1)]
    assert admitted(selector, *said) == ["bus/77:127250", "bus/77:127250", "bus/3:127250"]


@pytest.mark.parametrize(
    ("finer", "coarser"),
    [
        ("line/GP:GGA derived", "line/GP:RMC derived"),
        ("line/GP:GGA derived", "line/GP:GLL derived"),
        ("bus/2:129025 derived", "bus/2:129029 derived"),
        ("bus/2:129026 derived", "bus/2:130577 derived"),
        ("link/1:LOCAL_POSITION_NED", "link/1:GLOBAL_POSITION_INT derived"),
        ("link/1:GLOBAL_POSITION_INT derived", "link/1:GPS_RAW_INT derived"),
        ("line/HE:HDT", "line/HE:HDM derived"),
        ("line/HE:HDT", "line/HE:HDG derived"),
        ("bus/2:127250", "bus/2:127250 derived"),
        ("bus/2:130306", "bus/2:130306 theoretical derived"),
        ("bus/2:130306 theoretical derived", "bus/2:130306 apparent derived"),
        ("bus/2:130306 theoretical derived", "bus/2:130306 water derived"),
        ("line/WI:MWD", "line/WI:MWD magnetic derived"),
        ("line/WI:MWD", "line/WI:MWV theoretical derived"),
        ("line/WI:MWV theoretical derived", "line/WI:MWV apparent derived"),
        ("line/WI:MWV apparent derived", "line/WI:VWR apparent derived"),
    ],
)
def test_of_two_messages_of_a_device_the_one_nearer_to_the_channel_has_it(finer: str, coarser: str) -> None:
    """Whichever comes first, and however often the other comes."""
    channels = ("wind_direction_deg",)
    sources = (line("line", channels), bus(channels=channels), line("link", channels))
    for order in ((finer, coarser), (coarser, finer)):
        selector = Selector(sources)
        said = [(source, 0.1 * number) for number, source in enumerate(order)]
        said += [(coarser, 0.1 * number) for number in range(2, 26)]
        assert admitted(selector, *said, quantity="wind_direction_deg")[-1] == finer
        assert admitted(selector, (coarser, 9.0), quantity="wind_direction_deg") == [coarser]


def test_a_position_is_always_derived_which_makes_it_no_worse() -> None:
    """GGA in degrees and another message in metres would both be somebody's fix: the first stays."""
    selector = Selector((line("line", ("north_m",)),))
    said = [("line/GP:GGA derived", 0.0), ("line/GN:GNS", 0.1)]
    assert admitted(selector, *said, quantity="north_m") == ["line/GP:GGA derived"]


def test_the_preferred_line_has_the_channel_even_by_its_coarser_message() -> None:
    """Line before device, device before message."""
    selector = Selector((bus("gps", channels=("north_m",)), line("line", ("north_m",))))
    said = [("line/GP:GGA derived", 0.0), ("bus/9:129025 derived", 0.1), ("bus/gps:129029 derived", 0.2)]
    said += [("bus/9:129025 derived", 0.3), ("line/GP:GGA derived", 0.4)]
    assert admitted(selector, *said, quantity="north_m") == [source for source, _ in said[:3]]


def fixed(source: str, at_s: float, told_s: float | None = None, quantity: str = "north_m") -> Sample:
    told_ns = None if told_s is None else round(told_s * SECOND)
    return Sample(quantity, 1.0, source, 0, round(at_s * SECOND), 0, told_ns)


def test_a_receiver_that_changes_its_talker_goes_on_without_a_gap_and_without_a_word() -> None:
    """By the seconds of its fixes, in whatever bursts they come; without them by its usual interval."""
    for told in (True, False):
        selector = Selector((line("gps", ("north_m",)),))
        talkers = ["GN", "GN", "GN", "GP", "GP", "GN", "GL", "GN"]
        for second, talker in enumerate(talkers):
            came_s = second if not told else 4 * (second // 4)
            said = fixed(f"gps/{talker}:GGA derived", came_s, second if told else None)
            assert selector.select_and_report_handover(said) == (True, None), (told, second)


@pytest.mark.parametrize("talkers", ["GP GN", "GN GP", "GN GL GA", "GP GN GN BD"])
@pytest.mark.parametrize("stamped", [True, False])
def test_a_receiver_that_changes_its_talker_from_the_first_fix_on_keeps_its_fixes(
    talkers: str, stamped: bool
) -> None:
    """All but those before a talker comes again, by which the time between two fixes is known."""
    names = talkers.split()
    selector = Selector((line("gps", ("north_m",)),))
    said = [
        fixed(f"gps/{names[second % len(names)]}:GGA derived", second, second if stamped else None)
        for second in range(60)
    ]
    results = [selector.select_and_report_handover(each) for each in said]
    assert set(results[len(names) :]) == {(True, None)}


@pytest.mark.parametrize("first_late", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("stamped", [True, False])
def test_two_receivers_heard_from_within_a_burst_do_not_mix(first_late: float, stamped: bool) -> None:
    """Whichever is heard first, and whatever their outputs are apart."""
    selector = Selector((line("gps", ("north_m",)),))
    said = [
        fixed(f"gps/{talker}:GGA derived", second + late, second if stamped else None)
        for second in range(30)
        for talker, late in (("GP", 0.0), ("GN", first_late or 0.05))
    ][1 if first_late else 0 :]
    sources = [each.source for each in said if selector.select_and_report_handover(each)[0]]
    assert len(set(sources[2:])) == 1
    assert len(sources) >= 28


def test_two_receivers_on_a_line_that_tell_their_fixes_side_by_side_do_not_mix() -> None:
    selector = Selector((line("gps", ("north_m",)),))
    said = [
        (f"gps/{talker}:GGA derived", second + late)
        for second in range(9)
        for talker, late in (("GP", 0.0), ("GN", 0.1))
    ]
    del said[6]  # one fix of the first is lost: no reason to put in one of the other
    assert set(admitted(selector, *said, quantity="north_m")) == {"gps/GP:GGA derived"}
    text = "north_m: from gps/GP:GGA derived to gps/GN:GGA derived"
    assert selector.select_and_report_handover(fixed("gps/GN:GGA derived", 20.0))[1].text == text


def test_the_sentences_of_one_receiver_do_not_compete() -> None:
    """One a fix becomes the position, and that GGA has taken over from RMC is no news."""
    selector = Selector((line("gps", ("north_m",)),))
    said = [(f"gps/{name} derived", second) for second in range(5) for name in ("GN:RMC", "GP:GGA", "GN:GLL")]
    results = [selector.select_and_report_handover(fixed(source, at_s)) for source, at_s in said]
    assert [source for (source, _), (accepted, _) in zip(said, results, strict=True) if accepted] == [
        "gps/GN:RMC derived", *5 * ["gps/GP:GGA derived"],
    ]  # fmt: skip
    assert {handover for _, handover in results} == {None}
    assert selector.select_and_report_handover(fixed("gps/GN:GLL derived", 9.0)) == (True, None)


def test_a_position_without_satellites_gives_way_and_comes_back() -> None:
    fixes = {"first/GN": Fix(4), "second/GN": Fix(1)}
    selector = Selector((line("first", ("north_m",)), line("second", ("north_m",))), fixes)
    said = [("first/GP:GGA", 0.0), ("second/GP:GGA", 0.1)]
    assert admitted(selector, *said, quantity="north_m") == ["first/GP:GGA"]
    fixes["first/GN"] = Fix(6)  # dead reckoning
    said = [("first/GP:GGA", 1.0), ("second/GP:GGA", 1.1), ("first/GP:GGA", 2.0), ("second/GP:GGA", 2.1)]
    assert admitted(selector, *said, quantity="north_m") == ["first/GP:GGA", *2 * ["second/GP:GGA"]]
    fixes["first/GN"] = Fix(1)
    assert admitted(selector, ("first/GP:GGA", 3.0), quantity="north_m") == ["first/GP:GGA"]


def test_of_those_that_stand_in_the_better_fix_has_the_position() -> None:
    """The first in the file has it, whatever its fix; when it fails, fixes count before the order."""
    fixes = {"first/GN": Fix(1), "second/GN": Fix(1), "third/GN": Fix(4)}
    selector = Selector(tuple(line(name, ("north_m",)) for name in ("first", "second", "third")), fixes)
    every = [f"{name}/GP:GGA" for name in ("third", "first", "second")]
    assert admitted(selector, *((name, 0.0) for name in every), quantity="north_m")[-1] == "first/GP:GGA"
    assert admitted(selector, *((name, 3.0) for name in (every[2], every[0], every[2])), quantity="north_m") == [
        "second/GP:GGA", "third/GP:GGA",
    ]  # fmt: skip


def test_of_two_receivers_on_a_bus_the_better_fix_has_the_position() -> None:
    selector = Selector((bus(channels=("north_m",)),), {"bus/9": Fix(1), "bus/12": Fix(5)})
    said = [("bus/9:129025 derived", 0.0), ("bus/12:129025 derived", 0.1), ("bus/9:129025 derived", 0.2)]
    assert admitted(selector, *said, quantity="north_m") == [source for source, _ in said[:2]]


RANKED = ("first/HE:HDT", "first/HE:HDG derived", "bus/gyro:127250", "bus/7:127250", "last/HE:HDT")
"""Each of them another rank, the best first."""
SAID = st.lists(st.tuples(st.sampled_from(RANKED), st.integers(0, 4 * SECOND)), min_size=1, max_size=60)


@given(SAID)
def test_two_sources_never_mix(said: list[tuple[str, int]]) -> None:
    """It changes hands only to a better source or from a silent one, says so, and never starves."""
    selector = Selector((line("first"), bus("gyro"), line("last")))
    now_ns, let_through = 0, []
    for source, pause_ns in said:
        now_ns += pause_ns
        accepted, handover = selector.select_and_report_handover(Sample("heading_deg", 1.0, source, 0, now_ns, 0))
        former, former_ns = let_through[-1] if let_through else (source, now_ns)
        assert accepted or (former != source and now_ns - former_ns <= SILENT_NS)
        assert accepted or source != RANKED[0]
        text = "" if handover is None else handover.text
        assert text == (f"heading_deg: from {former} to {source}" if accepted and former != source else "")
        if accepted:
            let_through.append((source, now_ns))
    for (former, former_ns), (latter, latter_ns) in pairwise(let_through):
        better = RANKED.index(latter) < RANKED.index(former)
        assert former == latter or better or latter_ns - former_ns > SILENT_NS
