"""Derivation: north and east, true heading, surge and sway, wind over ground, against independent arithmetic."""

from __future__ import annotations

import cmath
from math import atan2, degrees, hypot, pi, radians

import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.acquisition.config.sources import Mounting
from seatrial.acquisition.core.quantities import (
    TangentPlane,
    apparent_wind_of_water_wind,
    components_of_velocity,
    rotate_earth_to_ship,
    to_earth,
    velocity_at_reference,
    wind_over_ground,
)
from seatrial.acquisition.core.ship import angle_difference
from seatrial.acquisition.core.trial import Group, Quality, Sample, Trial
from seatrial.acquisition.logger.processing import Derivation

ORIGIN = (63.44, 10.40)
TRIAL = Trial(name="x", origin_latitude_deg=ORIGIN[0], origin_longitude_deg=ORIGIN[1])
SECOND = 1_000_000_000

angles = st.floats(0, 360, exclude_max=True)
speeds = st.floats(-15, 15)


def group(source: str, at_s: float = 0.0, **values: float) -> Group:
    at_ns = int(at_s * SECOND)
    return [Sample(name, value, source, at_ns, at_ns, at_ns) for name, value in values.items()]


class Ship:
    """A derivation whose every channel sample is admitted, and the last value of each."""

    def __init__(self, mounting: Mounting | None = None, variation_deg: float | None = None) -> None:
        mountings = {} if mounting is None else {"line": mounting}
        self.derivation = Derivation(TRIAL, frozenset({"line"}), mountings, variation_deg)
        self.values: dict[str, float] = {}
        self.sources: dict[str, str] = {}

    def says(self, source: str, at_s: float = 0.0, **values: float) -> Ship:
        samples, _ = self.derivation.derive_channels(group(source, at_s, **values))
        for sample in samples:
            self.derivation.remember_channel_sample(sample)
            self.values[sample.quantity] = sample.value
            self.sources[sample.quantity] = sample.source
        return self


@given(st.floats(-89.9, 89.9), st.floats(-180, 180), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_the_tangent_plane_is_that_of_the_geodesy_library(
    latitude_deg: float, longitude_deg: float, more_latitude_deg: float, more_longitude_deg: float
) -> None:
    point = max(-90.0, min(90.0, latitude_deg + more_latitude_deg)), longitude_deg + more_longitude_deg
    north, east, _ = pymap3d.geodetic2ned(*point, 0.0, latitude_deg, longitude_deg, 0.0)
    assert TangentPlane(latitude_deg, longitude_deg).north_east_m(*point) == pytest.approx((north, east), abs=1e-7)


@given(speeds, speeds, angles)
def test_body_and_earth_axes_are_inverse_and_keep_lengths(north: float, east: float, heading_deg: float) -> None:
    forward, starboard = rotate_earth_to_ship(north, east, radians(heading_deg))
    assert hypot(forward, starboard) == pytest.approx(hypot(north, east))
    assert to_earth(forward, starboard, radians(heading_deg)) == pytest.approx((north, east), abs=1e-9)


@pytest.mark.parametrize(
    ("heading_deg", "course_deg", "surge", "sway"),
    [(0, 0, 5, 0), (90, 90, 5, 0), (0, 90, 0, 5), (0, 270, 0, -5), (350, 10, 4.698463104, 1.710100717)],
)  # fmt: skip
def test_surge_and_sway_from_course_and_speed(
    heading_deg: float, course_deg: float, surge: float, sway: float
) -> None:
    """Another line's heading serves; the course is to starboard of the heading: sway is to starboard."""
    ship = Ship().says("gyro/HE:HDT", heading_deg=heading_deg)
    ship.says("line/GP:VTG", 0.3, course_over_ground_deg=course_deg, speed_over_ground_mps=5.0)
    assert ship.values["surge_mps"] == pytest.approx(surge, abs=1e-9)
    assert ship.values["sway_mps"] == pytest.approx(sway, abs=1e-9)
    assert ship.sources["surge_mps"] == "line/GP:VTG derived"
    assert ship.sources["course_over_ground_deg"] == "line/GP:VTG"


def test_a_heading_is_carried_on_by_the_rate_of_turn_and_then_forgotten() -> None:
    def at(seconds: float) -> Ship:
        ship = Ship().says("gyro/HE:ROT", yaw_rate_dps=6.0).says("gyro/HE:HDT", heading_deg=357.0)
        return ship.says("line/GP:VTG", seconds, course_over_ground_deg=3.0, speed_over_ground_mps=4.0)

    assert at(1.0).values["surge_mps"] == pytest.approx(4.0)
    assert at(1.0).values["sway_mps"] == pytest.approx(0.0, abs=1e-9)
    assert "surge_mps" not in at(1.6).values


def test_a_magnetic_course_needs_the_variation() -> None:
    said = {"course_magnetic_deg": 85.0, "speed_over_ground_mps": 3.0}
    assert "surge_mps" not in Ship().says("line/A:1", heading_deg=90.0).says("line/A:2", **said).values
    ship = Ship(variation_deg=5.0).says("line/A:1", heading_deg=90.0).says("line/A:2", **said)
    assert ship.values["surge_mps"] == pytest.approx(3.0)


@pytest.mark.parametrize(("magnetic_deg", "variation_deg", "true_deg"), [(358.0, 4.0, 2.0), (1.0, -3.0, 358.0)])
def test_true_heading_from_magnetic(magnetic_deg: float, variation_deg: float, true_deg: float) -> None:
    """By the configuration's variation, until a device tells it; east is positive."""
    ship = Ship(variation_deg=variation_deg).says("line/HC:HDG", heading_magnetic_deg=magnetic_deg)
    assert ship.values["heading_deg"] == pytest.approx(true_deg)
    assert ship.sources["heading_deg"] == "line/HC:HDG derived"
    assert ship.values["heading_magnetic_deg"] == magnetic_deg
    told = Ship(variation_deg=77.0).says("other/35:127258", magnetic_variation_deg=variation_deg)
    assert told.says("line/HC:HDG", heading_magnetic_deg=magnetic_deg).values["heading_deg"] == pytest.approx(
        true_deg
    )
    assert "heading_deg" not in Ship().says("line/HC:HDG", heading_magnetic_deg=magnetic_deg).values


def test_a_compass_is_corrected_for_its_mounting() -> None:
    ship = Ship(Mounting(heading_deg=-2.5)).says("line/HE:HDT", heading_deg=1.0)
    assert ship.values["heading_deg"] == pytest.approx(358.5)
    assert ship.sources["heading_deg"] == "line/HE:HDT derived"


@given(angles, speeds, speeds, st.floats(-8, 8), st.floats(-30, 30), st.floats(-6, 6))
def test_an_antenna_that_turns_with_the_ship(
    heading_deg: float, surge: float, sway: float, yaw_rate_dps: float, forward_m: float, starboard_m: float
) -> None:
    """The antenna's motion by differentiating its place on a ship that moves: an oracle without our formula."""
    step_s = 1e-3

    def antenna(seconds: float) -> complex:
        heading = radians(heading_deg + yaw_rate_dps * seconds)
        place = complex(surge, sway) * seconds * cmath.exp(1j * radians(heading_deg))
        return place + complex(forward_m, starboard_m) * cmath.exp(1j * heading)

    velocity = (antenna(step_s) - antenna(-step_s)) / (2 * step_s) * cmath.exp(-1j * radians(heading_deg))
    found = velocity_at_reference(velocity.real, velocity.imag, yaw_rate_dps, forward_m, starboard_m)
    assert found == pytest.approx((surge, sway), abs=1e-5)


def test_position_and_speed_are_those_of_the_reference_point() -> None:
    """An antenna 10 m ahead of it, the ship heading east and turning to starboard at 6 deg/s."""
    ship = Ship(Mounting(forward_m=10.0, starboard_m=2.0))
    ship.says("line/x:1", yaw_rate_dps=6.0).says("line/x:2", heading_deg=90.0)
    latitude_deg, longitude_deg, _ = pymap3d.ned2geodetic(100.0, 210.0, 0.0, *ORIGIN, 0.0)
    ship.says("line/x:3", latitude_deg=float(latitude_deg), longitude_deg=float(longitude_deg))
    assert ship.values["north_m"] == pytest.approx(102.0, abs=1e-3)  # starboard of an eastward ship is south
    assert ship.values["east_m"] == pytest.approx(200.0, abs=1e-3)
    ship.says("line/x:4", surge_mps=5.0, sway_mps=1.0)
    assert ship.values["sway_mps"] == pytest.approx(1.0 - radians(6.0) * 10.0)
    assert ship.values["surge_mps"] == pytest.approx(5.0 + radians(6.0) * 2.0)
    assert ship.sources["sway_mps"] == "line/x:4 derived"


def test_an_antenna_without_a_heading_gives_no_position() -> None:
    ship = Ship(Mounting(forward_m=10.0)).says("line/x:3", latitude_deg=63.44, longitude_deg=10.4)
    assert "north_m" not in ship.values
    assert ship.values["latitude_deg"] == 63.44


def felt_on_board(
    direction_deg: float, speed_mps: float, heading_deg: float, surge: float, sway: float
) -> tuple[float, float]:
    """What a vane and an anemometer read: the wind less the ship, as complex numbers (north + i east)."""
    wind = -speed_mps * cmath.exp(1j * radians(direction_deg))
    ship = complex(surge, sway) * cmath.exp(1j * radians(heading_deg))
    felt = -(wind - ship) * cmath.exp(-1j * radians(heading_deg))
    return degrees(atan2(felt.imag, felt.real)) % 360.0, abs(felt)  # cmath.phase fails where it underflows


@given(angles, st.floats(0.5, 30), angles, speeds, st.floats(-3, 3))
def test_true_wind_is_found_again_from_apparent(
    direction_deg: float, speed_mps: float, heading_deg: float, surge: float, sway: float
) -> None:
    angle_deg, felt_mps = felt_on_board(direction_deg, speed_mps, heading_deg, surge, sway)
    found_deg, found_mps = wind_over_ground(angle_deg, felt_mps, surge, sway, heading_deg)
    assert found_mps == pytest.approx(speed_mps, abs=1e-9)
    assert float(angle_difference(found_deg, direction_deg)) == pytest.approx(0.0, abs=1e-6)


@given(angles, st.floats(0.5, 30), st.floats(0, 15))
def test_a_wind_referred_to_the_water_is_felt_again(angle_deg: float, speed_mps: float, through_mps: float) -> None:
    felt_deg, felt_mps = apparent_wind_of_water_wind(angle_deg, speed_mps, through_mps)
    back = felt_mps * cmath.exp(1j * radians(felt_deg)) - through_mps
    assert abs(back - speed_mps * cmath.exp(1j * radians(angle_deg))) < 1e-9


def moving_ship(**more: float) -> Ship:
    """Heading 90, making 5 m/s ahead and 1 m/s to starboard."""
    ship = Ship(variation_deg=4.0).says("line/a:HDT", heading_deg=90.0)
    return ship.says("line/b:VBW", surge_mps=5.0, sway_mps=1.0, **more)


@pytest.mark.parametrize(
    ("said", "source"),
    [
        ({"wind_direction_deg": 200.0, "wind_speed_mps": 8.0}, "line/w:130306"),
        ({"wind_direction_magnetic_deg": 196.0, "wind_speed_mps": 8.0}, "line/w:130306"),
        ({"wind_angle_theoretical_deg": 110.0, "wind_speed_theoretical_mps": 8.0}, "line/w:130306"),
    ],
)
def test_every_reference_gives_the_same_wind(said: dict[str, float], source: str) -> None:
    ship = moving_ship().says(source, **said)
    assert ship.values["wind_direction_deg"] == pytest.approx(200.0)
    assert ship.values["wind_speed_mps"] == pytest.approx(8.0)


def test_apparent_wind_gives_the_same_wind_and_is_kept_too() -> None:
    angle_deg, felt_mps = felt_on_board(200.0, 8.0, 90.0, 5.0, 1.0)
    ship = moving_ship().says("line/w:x", wind_angle_apparent_deg=angle_deg, wind_speed_apparent_mps=felt_mps)
    assert ship.values["wind_direction_deg"] == pytest.approx(200.0)
    assert ship.values["wind_speed_mps"] == pytest.approx(8.0)
    assert ship.values["apparent_wind_angle_deg"] == pytest.approx(angle_deg)
    assert ship.sources["wind_direction_deg"].endswith("derived")


def test_wind_referred_to_the_water_needs_the_speed_through_it() -> None:
    """The log says 4.5 m/s; the instrument has taken that off, as if there were no leeway."""
    angle_deg, felt_mps = felt_on_board(200.0, 8.0, 90.0, 5.0, 1.0)
    water = felt_mps * cmath.exp(1j * radians(angle_deg)) - 4.5
    said = {"wind_angle_water_deg": degrees(cmath.phase(water)) % 360.0, "wind_speed_water_mps": abs(water)}
    assert "wind_speed_mps" not in moving_ship().says("line/w:x", **said).values
    ship = moving_ship(speed_through_water_mps=4.5).says("line/w:x", **said)
    assert ship.values["wind_direction_deg"] == pytest.approx(200.0)
    assert ship.values["wind_speed_mps"] == pytest.approx(8.0)


def test_a_vane_is_corrected_for_its_mounting() -> None:
    ship = Ship(Mounting(wind_angle_deg=10.0)).says("line/a:HDT", heading_deg=0.0)
    ship.says("line/w:x", wind_angle_theoretical_deg=355.0, wind_speed_theoretical_mps=8.0)
    assert ship.values["wind_direction_deg"] == pytest.approx(5.0)


@pytest.mark.parametrize("missing", ["heading", "velocity"])
def test_what_is_needed_and_missing_or_old_gives_no_wind(missing: str) -> None:
    ship = Ship()
    if missing != "heading":
        ship.says("line/a:HDT", 10.0, heading_deg=90.0)
    ship.says("line/b:VBW", 10.0 if missing != "velocity" else 8.0, surge_mps=5.0, sway_mps=1.0)
    ship.says("line/w:x", 10.0, wind_angle_apparent_deg=40.0, wind_speed_apparent_mps=9.0)
    assert "wind_direction_deg" not in ship.values
    assert ship.values["apparent_wind_speed_mps"] == 9.0


@given(st.dictionaries(
    st.sampled_from([
        "latitude_deg", "longitude_deg", "heading_deg", "heading_magnetic_deg", "magnetic_variation_deg",
        "course_over_ground_deg", "course_magnetic_deg", "speed_over_ground_mps", "velocity_north_mps",
        "velocity_east_mps", "wind_angle_apparent_deg", "wind_speed_apparent_mps", "wind_angle_water_deg",
        "wind_speed_water_mps", "wind_direction_magnetic_deg", "wind_speed_mps", "surge_mps", "sway_mps",
        "yaw_rate_dps", "port_rpm", "port_angle_deg",
    ]),
    st.floats(allow_nan=True, allow_infinity=True), min_size=1,
))  # fmt: skip
def test_no_number_however_wrong_gets_past_its_channel(values: dict[str, float]) -> None:
    from seatrial.acquisition.core.ship import BY_NAME

    derivation = Derivation(TRIAL, frozenset({"line"}), {"line": Mounting(1.0, 2.0, 3.0, 4.0)}, 5.0)
    for start in ({"heading_deg": 10.0}, {"yaw_rate_dps": 2.0}, {"surge_mps": 3.0, "sway_mps": 0.1}):
        for sample in derivation.derive_channels(group("line/x:y", **start))[0]:
            derivation.remember_channel_sample(sample)
    samples, impossible = derivation.derive_channels(group("line/x:y", **values))
    assert all(BY_NAME[sample.quantity].is_possible_value(sample.value) for sample in samples)
    assert impossible >= 0


def test_numbers_that_are_none_are_counted() -> None:
    samples, impossible = Derivation(TRIAL, frozenset()).derive_channels(
        group("line/x:y", course_over_ground_deg=float("inf"), speed_over_ground_mps=float("nan"))
    )
    assert (samples, impossible) == ([], 2)


def test_along_and_phase_agree() -> None:
    for turn in range(12):
        assert complex(*components_of_velocity(30.0 * turn, 2.0)) == pytest.approx(
            2.0 * cmath.exp(1j * pi * turn / 6)
        )


IMPOSSIBLE = [
    {"heading_magnetic_deg": 100.0, "magnetic_variation_deg": 400.0},
    {"heading_magnetic_deg": 720.5},
    {"course_over_ground_deg": 1080.0, "speed_over_ground_mps": 2.5},
    {"course_over_ground_deg": 80.0, "speed_over_ground_mps": -2.5},
    {"course_over_ground_deg": 80.0, "speed_over_ground_mps": 655.0},
    {"wind_angle_apparent_deg": 999.0, "wind_speed_apparent_mps": 5.0},
    {"wind_angle_theoretical_deg": 45.0, "wind_speed_theoretical_mps": -10.0},
    {"wind_direction_magnetic_deg": 700.0, "wind_speed_mps": 5.0},
    {"wind_direction_deg": 10.0, "wind_speed_mps": 999.0},
    {"latitude_deg": 99.0, "longitude_deg": 10.0},
    {"surge_mps": 40.0, "sway_mps": 1.0},
    {"velocity_north_mps": 3.0, "velocity_east_mps": 328.0},
]


@pytest.mark.parametrize("said", IMPOSSIBLE, ids=lambda said: next(iter(said)))
def test_what_cannot_be_true_makes_nothing_that_looks_true(said: dict[str, float]) -> None:
    """Neither by a sum that goes round the circle nor by half of a pair; and it is remembered by nobody."""
    ship = moving_ship()
    before = dict(ship.values)
    allowed = {"heading_deg", "heading_magnetic_deg"} if "magnetic_variation_deg" in said else set()
    samples, impossible = ship.derivation.derive_channels(group("line/w:x", **said))
    assert {sample.quantity for sample in samples} <= allowed
    assert impossible >= 1
    assert all(
        sample.value == 104.0 for sample in samples if sample.quantity == "heading_deg"
    )  # by the good variation
    ship.says("line/g:VTG", 0.1, course_over_ground_deg=90.0, speed_over_ground_mps=5.0)
    assert ship.values["heading_deg"] == before["heading_deg"]
    assert ship.values["surge_mps"] == pytest.approx(5.0)


@pytest.mark.parametrize("message", ["127250", "127250 magnetic derived"])
def test_velocity_is_turned_by_the_compass_that_has_the_channel(message: str) -> None:
    """Of two on a line, the one that sent last had turned it: surge and sway did not fit the recorded heading."""
    derivation, courses = Derivation(TRIAL, frozenset({"bus"})), []
    for at_s in (0.0, 0.5, 1.0, 4.0):  # at last the first is silent
        first = group("bus/10:127250", at_s, heading_deg=30.0) if at_s < 4.0 else []
        for sample in derivation.derive_channels(first)[0]:
            derivation.remember_channel_sample(sample)
        derivation.derive_channels(group(f"bus/20:{message}", at_s + 0.1, heading_deg=35.0))
        speeds = {"course_over_ground_deg": 40.0, "speed_over_ground_mps": 5.0}
        samples, _ = derivation.derive_channels(group("bus/3:129026", at_s + 0.2, **speeds))
        values = {sample.quantity: sample.value for sample in samples}
        courses.append(degrees(atan2(values["sway_mps"], values["surge_mps"])))
    assert courses == pytest.approx([10.0, 10.0, 10.0, 5.0])


def test_a_heading_that_is_refused_turns_no_velocity() -> None:
    ship = Ship().says("line/HE:HDT", heading_deg=720.0)
    ship.says("line/GP:VTG", 0.1, course_over_ground_deg=90.0, speed_over_ground_mps=5.0)
    assert "surge_mps" not in ship.values


def test_a_mounting_turns_through_north() -> None:
    ship = Ship(Mounting(heading_deg=5.0, wind_angle_deg=-5.0)).says("line/HE:HDT", heading_deg=359.0)
    assert ship.values["heading_deg"] == pytest.approx(4.0)


def test_one_speed_alone_is_moved_to_the_reference_point_too() -> None:
    ship = Ship(Mounting(forward_m=10.0, starboard_m=2.0)).says("line/x:1", yaw_rate_dps=6.0)
    ship.says("line/x:4", surge_mps=5.0)
    assert ship.values["surge_mps"] == pytest.approx(5.0 + radians(6.0) * 2.0)
    assert "sway_mps" not in ship.values


def test_without_a_rate_of_turn_what_is_moved_is_suspect() -> None:
    samples, _ = Ship(Mounting(forward_m=10.0)).derivation.derive_channels(
        group("line/x:4", surge_mps=5.0, sway_mps=1.0)
    )
    assert {sample.quality for sample in samples} == {Quality.SUSPECT}


@pytest.mark.parametrize("quality", [Quality.SUSPECT, Quality.NOT_EVALUATED])
def test_a_simulators_fix_is_no_origin(quality: Quality) -> None:
    derivation = Derivation(Trial(name="x"), frozenset({"line"}))
    fix = [each._replace(quality=quality) for each in group("line/x:1", latitude_deg=63.0, longitude_deg=10.0)]
    derivation.derive_channels(group("line/x:1", latitude_deg=0.0, longitude_deg=0.0))
    derivation.derive_channels(fix)
    assert derivation.origin == (None if quality is Quality.SUSPECT else (63.0, 10.0))
