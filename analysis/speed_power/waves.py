"""What waves add to the resistance: STAWAVE-1 and STAWAVE-2 of ISO 15016:2015, annex D (ITTC 7.5-04-01-01.1).

Both are for waves from up to 45 deg off the bow; waves from elsewhere are taken to add nothing. STAWAVE-1 is for a
ship that hardly heaves and pitches, as its waves are short; STAWAVE-2 adds what heave and pitch take.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from seatrial.acquisition.config.conditions import Conditions
from seatrial.acquisition.core.quantities import Bools, Floats

GRAVITY_MPS2 = 9.80665
BOW_DEG = 45.0
_GYRADIUS_SHARE = 0.25  # of the length: the pitch of a ship whose radius of gyration is not known
_FREQUENCIES = 200
_LOWEST_SHARE, _HIGHEST_SHARE = 0.65, 5.9  # of the peak's frequency: between them lies 99.8 % of the energy
STAWAVE_1 = ("beam_m", "bow_length_m")
STAWAVE_2 = ("length_m", "beam_m", "draught_m", "displacement_m3")
_RANGES = {
    "L_PP": (75.0, 350.0), "L_PP / B": (4.0, 9.0), "B / T": (2.2, 5.5), "Fr": (0.10, 0.30), "C_B": (0.50, 0.90),
}  # fmt: skip
"""Where STAWAVE-2 may be used: ITTC 7.5-04-01-01.2 (2014)."""


def from_ahead(heading_deg: Floats, wave_from_deg: Floats) -> Bools:
    """The runs with waves from up to 45 deg off the bow."""
    off = (wave_from_deg - heading_deg + 180.0) % 360.0 - 180.0
    return np.asarray(np.abs(off) <= BOW_DEG)


def stawave1_n(given: Conditions, height_m: Floats) -> Floats:
    """R_AWL = rho g H^2 B sqrt(B / L_BWL) / 16 [N] of head waves of a significant height [m]."""
    beam, bow = given.number("beam_m"), given.number("bow_length_m")
    return np.asarray(given.water_density_kgpm3 * GRAVITY_MPS2 * height_m**2 * beam * np.sqrt(beam / bow) / 16.0)


def stawave2_n(given: Conditions, height_m: Floats, period_s: Floats, speed_mps: Floats) -> Floats:
    """R_AWL [N] of head waves of a significant height [m] and mean period T01 [s], at speeds through the water.

    The response in regular waves, times twice the spectrum of ITTC 1978, 173 H^2 / (T^4 w^5) exp(-691 / (T^4 w^4)).
    """
    peak = (0.8 * 691.0) ** 0.25 / period_s
    share = np.geomspace(_LOWEST_SHARE, _HIGHEST_SHARE, _FREQUENCIES)
    omega = peak[:, np.newaxis] * share
    fourth = (period_s**4)[:, np.newaxis]
    spectrum = 173.0 * (height_m**2)[:, np.newaxis] / fourth / omega**5 * np.exp(-691.0 / fourth / omega**4)
    response = regular_waves_n(given, omega, speed_mps[:, np.newaxis])
    return np.asarray(2.0 * np.trapezoid(response * spectrum, omega, axis=1))


def regular_waves_n(given: Conditions, omega: Floats, speed_mps: Floats) -> Floats:
    """R_AW / zeta_A^2 [N/m^2] of STAWAVE-2 in regular head waves of a frequency [rad/s]: motion and reflection."""
    from scipy.special import i1e, k1e

    L, B, T = (given.number(name) for name in STAWAVE_2[:3])
    C_B = given.number("displacement_m3") / (L * B * T)
    k_yy = (given.pitch_gyradius_m or _GYRADIUS_SHARE * L) / L
    rho_g = given.water_density_kgpm3 * GRAVITY_MPS2
    Fr = speed_mps / np.sqrt(GRAVITY_MPS2 * L)
    ratio = np.sqrt(L / GRAVITY_MPS2) * np.cbrt(k_yy) / (1.17 * Fr**-0.143) * omega
    a = 60.3 * C_B**1.34
    b = np.where(ratio < 1.0, 11.0, -8.5)
    d = np.where(ratio < 1.0, 14.0, -566.0 * (L / B) ** -2.66)
    motion = ratio**b * np.exp(b / d * (1.0 - ratio**d)) * a * Fr**1.5 * np.exp(-3.5 * Fr)
    f = 0.692 * (speed_mps / np.sqrt(T * GRAVITY_MPS2)) ** 0.769 + 1.81 * C_B**6.95
    x = 1.5 * omega**2 / GRAVITY_MPS2 * T
    # pi^2 I^2 / (pi^2 I^2 + K^2), of the scaled Bessel functions: I alone is beyond a float's range in short waves
    transmitted = (k1e(x) / i1e(x) * np.exp(-2.0 * x) / np.pi) ** 2
    return np.asarray(4.0 * rho_g * B**2 / L * motion + 0.5 * rho_g * B * f / (1.0 + transmitted))


def stawave1_limit_m(length_m: float) -> float:
    """The highest waves [m] of STAWAVE-1: 2.25 sqrt(L_PP / 100 m)."""
    return float(2.25 * np.sqrt(length_m / 100.0))


def outside_stawave2(given: Conditions, slowest_mps: float, fastest_mps: float) -> Iterator[str]:
    """Where a ship at speeds through the water lies outside the range of STAWAVE-2."""
    L, B, T = (given.number(name) for name in STAWAVE_2[:3])
    froude = [speed / np.sqrt(GRAVITY_MPS2 * L) for speed in (slowest_mps, fastest_mps)]
    values = {
        "L_PP": [L], "L_PP / B": [L / B], "B / T": [B / T], "Fr": froude,
        "C_B": [given.number("displacement_m3") / (L * B * T)],
    }  # fmt: skip
    for name, (low, high) in _RANGES.items():
        for value in values[name]:
            if not low <= value <= high:
                yield f"{name} of {value:.3g} is not {low:g} to {high:g}"
                break
