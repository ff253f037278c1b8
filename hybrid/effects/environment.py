"""Effects of the environment: water and air that move, waves that push."""

from __future__ import annotations

from math import cos, hypot, radians, sin

from numba import njit

from seatrial.hybrid.vessel.effect import DIRECTION, Effect, Parameter, Values, scaling
from seatrial.hybrid.vessel.plant import Plant
from seatrial.hybrid.vessel.wind import wind_force


def _drift(plant: Plant, values: Values) -> Plant:
    force, to_rad = values["force_n"], radians(values["direction_deg"])
    north = plant.drift_force_n * plant.drift_north + force * cos(to_rad)
    east = plant.drift_force_n * plant.drift_east + force * sin(to_rad)
    total = hypot(north, east)
    if total == 0.0:
        return plant.replaced(drift_force_n=0.0)
    return plant.replaced(drift_force_n=total, drift_north=north / total, drift_east=east / total)


@njit(error_model="numpy")
def _wind_minus_still_air(time_s, state, control, environment, parameters):  # type: ignore[no-untyped-def]
    """What a steady wind does beyond still air, which the model has where none was recorded."""
    cosine, sine, u, v = cos(state[2]), sin(state[2]), state[3], state[4]
    north, east = parameters
    u_air, v_air = north * cosine + east * sine, east * cosine - north * sine
    X, Y, N = wind_force(environment.plant, u - u_air, v - v_air)
    still_X, still_Y, still_N = wind_force(environment.plant, u, v)
    return X - still_X, Y - still_Y, N - still_N


def _wind(name: str, coefficient: str, what: str, confused_with: tuple[str, ...] = ()) -> Effect:
    return scaling(
        name,
        "environment",
        (coefficient,),
        (1.5, 0.2),
        what=f"{what}: {coefficient} times a factor at every angle",
        source="Isherwood, Wind resistance of merchant ships, Trans. RINA 115 (1973): scatter of each coefficient",
        confused_with=confused_with,
    )


EFFECTS = (
    Effect(
        "ocean_current", family="environment", kind="physics",
        what="Steady uniform current: hull and pods feel the velocity relative to the moving water",
        source="Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 10",
        parameters=(Parameter("speed_mps", "m/s", 0.0, 0.0, 3.0, 0.2, 0.03), DIRECTION),
        change=lambda plant, values: plant.shifted(
            current_north_mps=values["speed_mps"] * cos(radians(values["direction_deg"])),
            current_east_mps=values["speed_mps"] * sin(radians(values["direction_deg"])),
        ),
        chart="polar",
        confused_with=("speed_scale",),
        scope="day",
    ),
    Effect(
        "wave_drift", family="environment", kind="physics",
        what="Mean second-order wave force: 0.35 F cos b ahead, F sin b abeam, 0.06 Loa F sin 2b in yaw",
        source="Form of the mean drift force over the wave angle, after Faltinsen, Sea Loads (1990), ch. 5",
        parameters=(Parameter("force_n", "N", 0.0, 0.0, 60e3, 2e3, 500.0), DIRECTION),
        change=_drift,
        chart="polar",
        confused_with=("ocean_current", "wind_direction_bias", "wind_side_load", "wind_speed_scale"),
        scope="day",
    ),
    scaling(
        "wind_load", "environment", ("wind_load_factor",), (1.5, 0.2),
        what="All wind coefficients times a factor: more or less windage than the tables say",
        source="Blendermann, Parameter identification of wind loads on ships, J. Wind Eng. Ind. Aerodyn. 51 (1994)",
        confused_with=(
            "wave_drift", "wind_direction_bias", "wind_drag", "wind_side_load", "wind_speed_scale", "wind_yaw_load",
        ),
    ),
    _wind("wind_drag", "CX", "Wind force along the ship"),
    _wind("wind_side_load", "CY", "Wind force across the ship"),
    _wind("wind_yaw_load", "CN", "Yaw moment of the wind", ("wind_direction_bias",)),
)  # fmt: skip
"""Current, waves and wind."""

STEADY_WIND = Effect(
    "steady_wind", family="environment", kind="physics",
    what="A steady wind, in a trial of which none was recorded: hull and house feel the air that moves",
    source="Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021), ch. 10",
    parameters=(Parameter("speed_mps", "m/s", 0.0, 0.0, 40.0, 5.0, 0.5), DIRECTION),
    change=lambda plant, values: plant.with_force(
        _wind_minus_still_air,
        values["speed_mps"] * cos(radians(values["direction_deg"])),
        values["speed_mps"] * sin(radians(values["direction_deg"])),
    ) if values["speed_mps"] > 0.0 else plant,
    chart="polar",
    confused_with=("ocean_current", "wave_drift"),
    scope="day",
)  # fmt: skip
"""Of no ship and no plan: only a diagnosis without a record of the wind looks for it."""
