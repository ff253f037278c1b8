"""Effects that change many of the hull's numbers at once: length, depth of water, trim, a skeg."""

from __future__ import annotations

from math import pi, tan

from tests.benchmarks.other_ship.sheet import Sheet

ADDED_LATERAL_AREA_M = 4.0
TURNING = ("Yur", "Yuur", "Yrrr", "Y_absr_r", "Nur", "Nuur", "Nrrr", "N_absr_r")


def lengthen(sheet: Sheet, length_m: float) -> None:
    """Strip theory in short: every coefficient with the length, once more for every lever arm in it."""
    size = sheet.numbers["dimensions"]
    s = (size["length_between_perpendiculars_m"] + length_m) / size["length_between_perpendiculars_m"]
    size["length_between_perpendiculars_m"] += length_m
    size["length_overall_m"] += length_m
    for name, power in {"mass_kg": 1, "Xud": 1, "Yvd": 1, "Yrd": 2, "yaw_inertia_kgm2": 3, "Nrd": 3}.items():
        sheet.numbers["inertia"][name] *= s**power
    for section, arms in (("surge", 1), ("sway", 1), ("yaw", 2)):
        for name in sheet.numbers[section]:
            sheet.numbers[section][name] *= s**0.8 if name == "Xuu" else s ** (arms + name.count("r"))
    for side in ("port", "starboard"):
        sheet.numbers["pods"][f"{side}_x_m"] -= length_m / 2
    sheet.numbers["tunnel"]["x_m"] += length_m / 2
    sheet.numbers["wind"]["lateral_area_m2"] += ADDED_LATERAL_AREA_M * length_m


def over_shallows(sheet: Sheet, depth_m: float) -> None:
    """Derivatives of whole forces grow with draught over depth (Hirano et al., West-Japan SNA 69, 1985).

    The aspect ratio's own share is that of the catalogue, 1 - g, so that a depth means the same there and here.
    """
    size = sheet.numbers["dimensions"]
    y = 0.5 * pi * size["draught_m"] / depth_m
    slender = size["draught_m"] / size["length_between_perpendiculars_m"]
    below = [(y / tan(y)) ** power if y else 1.0 for power in (2.3, 1.7, 0.7)]
    force, moment, turning = (1.0 / (g + slender * (1.0 - g)) for g in below)
    for section, drifting in (("sway", force), ("yaw", moment)):
        for name in sheet.numbers[section]:
            sheet.hull_growth[name] = turning if name in TURNING else drifting
    sheet.added_mass_growth = (force, moment)


def trim(sheet: Sheet, shift_m: float) -> None:
    """The hull's side force acts further forward."""
    for name in sheet.numbers["yaw"]:
        sheet.numbers["yaw"][name] += shift_m * sheet.numbers["sway"]["Y" + name[1:]]


def add_skeg(sheet: Sheet, area_m2: float) -> None:
    """A low fin of aspect ratio one at the pods: lift -(pi/4) rho A u (v + x r), with its moment."""
    x = 0.5 * (sheet.numbers["pods"]["port_x_m"] + sheet.numbers["pods"]["starboard_x_m"])
    lift = 0.25 * pi * sheet.numbers["water_density_kgpm3"] * area_m2
    for section, name, arm in (("sway", "Yuv", 1.0), ("sway", "Yur", x), ("yaw", "Nuv", x), ("yaw", "Nur", x * x)):
        sheet.numbers[section][name] -= lift * arm
