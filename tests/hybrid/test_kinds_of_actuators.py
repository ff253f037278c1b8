"""Every kind of actuator is known to all that lists kinds or controls: none is registered by half."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import pytest

from seatrial.acquisition.core.ship import (
    ANGLES,
    CONTROLS,
    Actuator,
    actuators_from_channel_names,
    control_names,
)
from seatrial.acquisition.core.ship import KINDS as RECORDED_KINDS
from seatrial.analysis.report.plots import control_groups
from seatrial.analysis.windows.held import REASONS, TOLERANCES, sort_of, tolerance_of
from seatrial.hybrid.effects import catalogue_of_actuators, steering_angles, weights_of
from seatrial.hybrid.report.plots import RESIDUAL_QUANTITIES
from seatrial.hybrid.vessel.actuators import KINDS


@pytest.mark.parametrize("name", RECORDED_KINDS)
def test_force_and_channels_of_a_kind_agree(name: str) -> None:
    kind, controls = KINDS[name], RECORDED_KINDS[name].controls
    assert kind.entry.__annotations__["kind"] == f"Literal['{name}']"
    assert kind.angles == tuple(each in ANGLES for each in controls)
    assert {len(kind.labels), len(kind.units), len(kind.still), len(kind.alike)} == {len(controls)}
    assert set(kind.slots) <= set(kind.numbers)
    assert (kind.gear is not None) == any(kind.angles)
    assert set(kind.gear or ()) <= set(kind.entry.__dataclass_fields__)


@pytest.mark.parametrize("name", RECORDED_KINDS)
def test_a_ship_of_each_kind_is_resampled_held_drawn_and_mapped(name: str) -> None:
    ship = (Actuator("port", name), Actuator("starboard", name))
    assert {each for names in control_groups(ship).values() for each in names} == set(control_names(ship))
    assert all(tolerance_of(each, ship).span > 0.0 for each in control_names(ship))
    for quantity, names in steering_angles(ship).items():
        assert names == ("port", "starboard")
        assert quantity in weights_of(ship)
        assert quantity in RESIDUAL_QUANTITIES


@pytest.mark.parametrize("name", RECORDED_KINDS)
def test_a_recording_that_does_not_state_its_ship_keeps_every_channel(name: str) -> None:
    """The kind that is recognised from the channels may be another one, but none of its channels is lost."""
    ship = (Actuator(f"port_{name}", name), Actuator(f"starboard_{name}", name))
    assert control_names(actuators_from_channel_names(control_names(ship))) == control_names(ship)


@pytest.mark.parametrize("page", [
    "howto/add_a_sensor.md", "howto/add_a_vessel.md", "howto/import.md", "own_simulator.md",
])  # fmt: skip
def test_pages_that_list_the_kinds_list_all(page: str) -> None:
    text = (Path(__file__).parents[2] / "docs" / page).read_text(encoding="utf-8")
    assert [name for name in RECORDED_KINDS if f"`{name}`" not in text] == []


def test_every_control_has_a_tolerance_and_a_reason() -> None:
    sorts = {
        sort_of(each, (Actuator("x", kind),)) for kind in KINDS for each in control_names((Actuator("x", kind),))
    }
    assert sorts == set(TOLERANCES) == {each.removesuffix(" thruster") for each in CONTROLS}
    assert len(REASONS) == 5 + len(TOLERANCES)


@pytest.mark.parametrize("pair", list(combinations(RECORDED_KINDS, 2)))
def test_pairs_of_two_kinds_have_effects_of_their_own(pair: tuple[str, str]) -> None:
    """Each alone and both of a kind; an effect on both changes those of its kind and names no rival that is not."""
    ship = tuple(Actuator(f"{side}_{kind}", kind) for kind in pair for side in ("port", "starboard"))
    catalogue = catalogue_of_actuators(ship)
    assert len(catalogue) == sum(len(catalogue_of_actuators(ship[place : place + 2])) for place in (0, 2)) - len(
        catalogue_of_actuators(())
    )
    joint = [effect for name, effect in catalogue.items() if re.search("_both(_|$)", name)]
    assert all(rival in catalogue for effect in joint for rival in effect.confused_with)
    whats = [effect.what for effect in joint]
    assert len({*whats}) == len(whats)
