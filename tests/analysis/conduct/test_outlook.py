"""The outlook on the runs that remain: what is sailed last, what is shown, and the process that makes it."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from seatrial.acquisition.core.errors import DataShortageError
from seatrial.acquisition.core.trial import Sample, Trial
from seatrial.acquisition.recording.reader import read_recording
from seatrial.acquisition.recording.writer import RecordingWriter
from seatrial.analysis.conduct.conductor import Conductor
from seatrial.analysis.conduct.outlook import (
    Outlook,
    OutlookMaker,
    OutlookProcess,
    RecordedRun,
    RunOutlook,
    outlook_lines,
    stored_table_of_span,
    table_of_span,
)
from seatrial.analysis.conduct.programme import TrialProgramme, programme_from_template
from seatrial.analysis.manoeuvres import criteria
from seatrial.analysis.manoeuvres.conducted import JudgedSpan, conducted_runs
from seatrial.analysis.manoeuvres.indices import Index
from tests.analysis.conduct.outlooks import killed, made, refused
from tests.conftest import nightly

PROGRAMME = programme_from_template("imo", 200.0, 7.7, wind_from_deg=0.0)
PLACES = {run.sided_name: place for place, run in enumerate(PROGRAMME.run)}
CIRCLE = PLACES["turning circle 35 deg to port"]


def outlook_of(result: str, *places: int, programme: TrialProgramme = PROGRAMME, gain: float = 1.0) -> Outlook:
    """The outlook in which all criteria of some runs have a result."""
    index = Index(700.0, 650.0, 750.0, "m", 3.5, 1000.0, result=result)
    runs = {place: RunOutlook(dict.fromkeys(programme.run[place].purpose, index), gain, 0.8) for place in places}
    return Outlook(runs, 3, 21, 51)


def order_of(conductor: Conductor) -> list[int]:
    """The places in the order in which they come, each aborted and left out."""
    places = []
    while conductor.place is not None:
        places.append(conductor.place)
        conductor.skip()
    return places


def test_a_run_whose_criteria_are_predicted_to_be_met_comes_last_and_is_not_dropped() -> None:
    first = Conductor(PROGRAMME).place
    assert first is not None
    conductor = Conductor(PROGRAMME)
    conductor.take_outlook(outlook_of(criteria.MET, first))
    assert conductor.place != first
    order = order_of(conductor)
    assert sorted(order) == sorted(PLACES.values())
    assert order[-1] == first


def test_skipped_run_says_what_was_predicted_of_it_ashore_too() -> None:
    conductor = Conductor(PROGRAMME)
    conductor.take_outlook(outlook_of(criteria.MET, *PLACES.values()))
    entry = conductor.skip()
    assert entry is not None
    assert "limit 5" in entry.reasons[0]
    (run,) = conducted_runs([(0, conductor.marks[-1])])
    assert (run.outcome, run.name) == ("skipped", entry.name)
    assert "; ".join(run.reasons) == entry.reasons[0]


@pytest.mark.parametrize("result", [criteria.CANNOT_BE_SAID, criteria.NOT_MET])
def test_a_run_whose_criterion_is_open_or_missed_is_sailed_as_planned(result: str) -> None:
    conductor = Conductor(PROGRAMME)
    conductor.take_outlook(outlook_of(result, *PLACES.values()))
    assert order_of(conductor) == order_of(Conductor(PROGRAMME))


def test_a_run_with_another_purpose_besides_is_needed() -> None:
    circle = PROGRAMME.run[CIRCLE]
    outlook = outlook_of(criteria.MET, CIRCLE).runs[CIRCLE]
    assert outlook.is_needless(circle)
    assert not outlook.is_needless(replace(circle, purpose=(*circle.purpose, "yaw damping")))
    assert not outlook.is_needless(replace(circle, purpose=()))


def test_of_runs_for_coefficients_that_comes_first_which_tells_most_for_its_time() -> None:
    programme = programme_from_template("identification", 200.0, 7.7, wind_from_deg=0.0)
    conductor = Conductor(programme)
    first_priority = [place for place, run in enumerate(programme.run) if run.priority == 1]
    best = first_priority[-1]
    outlook = outlook_of(criteria.NOT_SHOWN, *first_priority, programme=programme, gain=1.0)
    told = replace(outlook.runs[best], gain=50.0)
    conductor.take_outlook(replace(outlook, runs={**outlook.runs, best: told}))
    conductor.skip()
    assert conductor.place == best


def test_skipped_run_is_not_spoken_of_and_advice_agrees_with_the_outlook() -> None:
    conductor = Conductor(PROGRAMME)
    place = conductor.place
    assert place is not None
    entry = conductor.abort()
    assert entry is not None
    assert conductor.repeat_advice(entry).startswith("sail it again")
    conductor.take_outlook(outlook_of(criteria.MET, place, CIRCLE))
    assert "need not be sailed again" in conductor.repeat_advice(entry)
    conductor.place = place
    conductor.skip()
    assert conductor.wanted_outlook is not None
    assert list(conductor.wanted_outlook.runs) == [CIRCLE]


def test_time_left_goes_to_the_runs_that_come_first() -> None:
    conductor = Conductor(PROGRAMME)
    whole = conductor.runs_within(conductor.minutes_needed + 1.0)
    assert len(whole) == len(PROGRAMME.run)
    for minutes in (0.0, 20.0, 60.0):
        assert conductor.runs_within(minutes) == whole[: len(conductor.runs_within(minutes))]
    assert not conductor.runs_within(1.0)


def test_lines_say_value_interval_and_limit_in_ship_lengths() -> None:
    lines = outlook_lines(outlook_of(criteria.MET, CIRCLE), CIRCLE, PROGRAMME.run, 200.0)
    assert lines[0] == (
        "turning circle 35 deg to port need not be sailed: advance 3.5 L (3.25 to 3.75), limit 5; "
        "tactical diameter 3.5 L (3.25 to 3.75), limit 5"
    )
    known = "the runs so far determine 21 of 51 coefficients of the ship's model"
    assert lines[-1] == f"{known}; the next would make their intervals 11% narrower"
    assert not outlook_lines(None, CIRCLE, PROGRAMME.run, 200.0)


def test_what_is_not_known_of_a_run_is_null_in_json() -> None:
    conductor = Conductor(PROGRAMME)
    outlook = outlook_of(criteria.MET, CIRCLE)
    conductor.take_outlook(replace(outlook, runs={**outlook.runs, 0: RunOutlook()}))  # as of a thruster test
    content = json.loads(json.dumps(conductor.as_dict(), allow_nan=False))["outlook"]
    known, unknown = content["runs"]
    assert (content["sailed"], content["known"], content["coefficients"]) == (3, 21, 51)
    assert (known["place"], known["gain"], known["predicted"]["advance"]["limit"]) == (CIRCLE, 1.0, 1000.0)
    assert (unknown["gain"], unknown["left"], unknown["predicted"]) == (None, None, {})


@pytest.mark.parametrize(
    ("maker", "words"), [(made, ""), (killed, "has ended"), *nightly((refused, "too little has been sailed yet"))]
)
def test_a_process_that_fails_or_dies_is_a_reason_and_nothing_else(maker: OutlookMaker, words: str) -> None:
    run = RecordedRun(PROGRAMME.run[0], pd.DataFrame({"surge_mps": [1.0]}), valid=True)
    process = OutlookProcess(maker)
    assert process.result() is None
    for _ in range(2):  # one after the other
        process.begin([run], {CIRCLE: PROGRAMME.run[CIRCLE]})
        while (result := process.result()) is None:
            time.sleep(0.05)
        if isinstance(result, Outlook):
            assert (result.sailed, list(result.runs)) == (1, [CIRCLE])
        assert words in (result if isinstance(result, str) else "")
    process.begin([], {})
    process.close()
    assert not process.is_working


def recorded_hour(path: Path, start_ns: int) -> Path:
    """An hour of four channels at 1 Hz, in chunks of ten seconds."""
    with RecordingWriter(path, Trial(name="bay", vessel="gunnerus"), {}) as writer:
        for second in range(3600):
            for number, name in enumerate(("north_m", "east_m", "heading_deg", "port_rpm")):
                time_ns = start_ns + second * 10**9
                value = float(second % 360 + number)
                writer.write_sample(Sample(name, value, "x", time_ns, time_ns, time_ns - number * 10**8))
            if second % 10 == 9:
                writer.flush()
    return path


@pytest.mark.parametrize(("begin_s", "end_s"), [(600, 900), (3500, 3700), (-500, 60), (3590, 3610)])
def test_samples_of_a_stored_run_are_those_of_the_whole_recordings_and_nothing_else_is_read(
    tmp_path: Path, begin_s: int, end_s: int
) -> None:
    """Of two recordings, one after the other; what is damaged far from the run, and so would not be read, costs
    nothing."""
    start_ns = pd.Timestamp("2026-06-01T06:00:00Z").value
    paths = [recorded_hour(tmp_path / f"{hour}.mcap", start_ns + hour * 3600 * 10**9) for hour in range(2)]
    start, end = (pd.Timestamp(start_ns + second * 10**9, tz="UTC") for second in (begin_s, end_s))
    span, whole = JudgedSpan("zigzag", start, end), [read_recording(path) for path in paths]
    series = {name: [recording.series[name] for recording in whole] for name in whole[0].series}
    expected = table_of_span(whole[-1], series, span)
    for path in paths:
        content = bytearray(path.read_bytes())
        content[len(content) // 2 : len(content) // 2 + 100] = bytes(100)  # half an hour from its ends
        path.write_bytes(content)
    pd.testing.assert_frame_equal(stored_table_of_span(paths, span), expected)
    assert np.all(expected.index >= start)
    with pytest.raises(DataShortageError):
        stored_table_of_span([tmp_path / "gone.mcap"], span)
