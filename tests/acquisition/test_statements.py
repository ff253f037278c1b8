"""What people state of a trial: in a configuration, in a column map, or afterwards beside the recordings."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.run_sheet import (
    CONDITIONS_FILE,
    Conditions,
    InstrumentsSection,
    Particulars,
    RunSheet,
    Statement,
    conditions_in_trial,
    load_statement,
    particulars_in_trial,
    read_statement_text,
    standard_errors_in_trial,
    statement_from_text,
)
from seatrial.acquisition.core.errors import ConfigurationError
from seatrial.acquisition.core.trial import Trial

LENGTHS = st.none() | st.floats(1.0, 400.0)
ACCURACIES = st.dictionaries(st.sampled_from(["heading_deg", "north_m"]), st.floats(0.01, 9.0))
STATEMENTS = st.builds(
    Statement,
    trial=st.builds(RunSheet, vessel=st.sampled_from(["", "a ship"]), draught_m=st.none() | st.floats(1.0, 20.0)),
    conditions=st.builds(Conditions, length_m=LENGTHS, gm_m=st.none() | st.floats(-1.0, 9.0)),
    instruments=st.builds(InstrumentsSection, antenna_forward_m=LENGTHS, accuracy=ACCURACIES),
    particulars=st.builds(Particulars, ship_type=st.sampled_from(["", "tanker"]), mcr_kw=LENGTHS,
                          rudders=st.none() | st.integers(1, 4)),
)  # fmt: skip


@given(STATEMENTS)
def test_statements_survive_text_and_recording(statement: Statement) -> None:
    assert statement_from_text(statement.as_text()) == statement
    recorded = Trial.from_metadata(statement.apply_to_trial(Trial("trial")).as_metadata())
    assert conditions_in_trial(recorded) == statement.conditions
    assert particulars_in_trial(recorded) == statement.particulars
    assert standard_errors_in_trial(recorded) == statement.instruments.accuracy
    assert recorded.vessel == statement.trial.vessel
    assert recorded.antenna_forward_m == statement.instruments.antenna_forward_m


@given(STATEMENTS, STATEMENTS)
def test_later_statements_count_for_more(first: Statement, second: Statement) -> None:
    trial = second.apply_to_trial(first.apply_to_trial(Trial("trial")))
    assert conditions_in_trial(trial) == second.conditions.completed_from(first.conditions)
    assert particulars_in_trial(trial).stated() == {**first.particulars.stated(), **second.particulars.stated()}
    assert trial.name == "trial"


def test_file_of_conditions_alone_and_file_of_tables(tmp_path: Path) -> None:
    alone, tables = tmp_path / "alone.toml", tmp_path / CONDITIONS_FILE
    alone.write_text("length_m = 200.0\n")
    tables.write_text('[conditions]\nlength_m = 200.0\n[particulars]\nrudder_type = "spade"\n')
    assert load_statement(alone).conditions == load_statement(tables).conditions == Conditions(length_m=200.0)
    assert load_statement(tables).particulars.rudder_type == "spade"
    assert (
        read_statement_text(None, tmp_path)
        == read_statement_text(None, tmp_path / "a.mcap")
        == read_statement_text(tables, alone)
    )
    assert read_statement_text(None, tmp_path / "elsewhere" / "a.mcap") == ""
    in_subfolder = tmp_path / "recordings" / "a.mcap"
    assert read_statement_text(None, in_subfolder, tmp_path) == read_statement_text(tables)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[particulars]\nrudder_typ = 'spade'\n", "did you mean rudder_type"),
        ("length = 200.0\n", "did you mean length_m"),
        ("[particulars]\nmcr_kw = -3.0\n", "mcr_kw"),
        ("[instruments.accuracy]\nheading_deg = 0.0\n", "heading_deg"),
        ("[source]\ntype = 'udp'\n", "source"),
    ],
)
def test_unknown_and_impossible_statements_are_errors(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / CONDITIONS_FILE
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=words) as error:
        load_statement(path)
    assert f"{CONDITIONS_FILE}, line" in str(error.value)


@pytest.mark.parametrize("damaged", ["{", "[1]", '{"length_m": "long"}', "[" * 5000])
def test_unreadable_metadata_are_left_out_with_a_warning(damaged: str, caplog: pytest.LogCaptureFixture) -> None:
    trial = Trial("trial", conditions=damaged, particulars=damaged, accuracy=damaged)
    assert (conditions_in_trial(trial), particulars_in_trial(trial), standard_errors_in_trial(trial)) == (
        Conditions(),
        Particulars(),
        {},
    )
    assert len(caplog.records) == 3
