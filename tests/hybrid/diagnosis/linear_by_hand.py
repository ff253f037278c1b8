"""The disturbed ship as one Gaussian vector, written out: what filter and smoother are judged by."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from seatrial.acquisition.core.quantities import Floats
from seatrial.hybrid.diagnosis.disturbance_model import FORCE_UNITS, FREE, Columns, DisturbanceNoise
from seatrial.hybrid.diagnosis.linearise import LinearModel

GRAVITY_MPS2 = 9.80665
CALM_SEA = DisturbanceNoise(gust=(900.0, 700.0, 9000.0), slow=(400.0, 600.0, 5000.0), slow_s=15.0)
SWELL = DisturbanceNoise(
    waves=(0.4, 0.3, 0.01), wave_correlation=0.35, wave_frequency_radps=0.9, wave_damping=0.15, wave_towards_rad=0.7
)
DRIFT = replace(CALM_SEA, drift=(0.6, 0.004, 0.05, 0.07, 0.002), drift_s=8.0)
BOTH = replace(SWELL, drift=(0.0, 0.01, 0.03, 0.02, 0.001), drift_s=25.0)
SLOW_DRIFT = replace(SWELL, wave_drift_n=3e4, wave_drift_s=12.0, length_m=30.0)
ALL = replace(BOTH, wave_drift_n=2e4, wave_drift_s=6.0, length_m=60.0)
DISTURBANCES = {
    "calm": CALM_SEA, "swell": SWELL, "drift": DRIFT, "both": BOTH, "slow drift": SLOW_DRIFT, "all": ALL
}  # fmt: skip


def a_ship(seconds: int, seed: int) -> LinearModel:
    """A linear model of a ship's size that changes from second to second; sensors that mix; nothing measured."""
    random = np.random.default_rng(seed)
    turn = 0.03 * np.sin(np.arange(seconds) / 15.0) + 0.005 * random.standard_normal(seconds)
    psi = random.uniform(0.0, 6.0) + np.cumsum(turn)
    u, v = 4.0 + 0.5 * random.standard_normal(seconds), 0.2 * random.standard_normal(seconds)
    cosine, sine = np.cos(psi), np.sin(psi)
    A, B = np.tile(np.eye(6), (seconds, 1, 1)), np.zeros((seconds, 6, 3))
    A[:, 0, 2], A[:, 1, 2] = -u * sine - v * cosine, u * cosine - v * sine
    A[:, 0, 3], A[:, 0, 4], A[:, 1, 3], A[:, 1, 4] = cosine, -sine, sine, cosine
    A[:, 2, 5] = 1.0
    A[:, 3:, 3:] = np.diag([0.97, 0.9, 0.85]) + random.uniform(-0.03, 0.03, (seconds, 3, 3))
    B[:, 3:] = np.diag([1.5e-6, 1.0e-6, 3e-8]) * random.uniform(0.9, 1.1, (seconds, 1, 1))
    B[:, 2, 2] = 1.5e-8
    H = np.eye(6) + random.uniform(-0.05, 0.05, (seconds, 6, 6))
    origin = np.column_stack([np.cumsum(u * cosine), np.cumsum(u * sine), psi, u, v, turn])
    return LinearModel(A, B, H, np.zeros((seconds, 6)), np.zeros((seconds, 6)), origin)


@dataclass(frozen=True, slots=True)
class Dense:
    """One block as a Gaussian: states x [T n] ~ N(driven, root root'), seen y = C x + errors of variance R."""

    root: Floats
    C: Floats
    R: Floats
    onward: Floats

    @property
    def covariance(self) -> Floats:
        """Of all states [T n, T n]."""
        return np.asarray(self.root @ self.root.T)

    @property
    def seen_covariance(self) -> Floats:
        """Of all samples [6 T, 6 T]."""
        return np.asarray(self.C @ self.covariance @ self.C.T + np.diag(self.R))

    def driven(self, drive: Floats) -> Floats:
        """The states [T n, ...] that drives [T, 6, ...] bring, each into the next second."""
        seconds, n = len(drive), len(self.root) // len(drive)
        impulse = np.zeros((seconds, n, *drive.shape[2:]))
        impulse[1:, :6] = drive[:-1]
        return np.asarray(np.tensordot(self.onward, impulse.reshape(seconds * n, *drive.shape[2:]), axes=1))


def dense(linear: LinearModel, noise: DisturbanceNoise, rows: slice) -> Dense:
    """The seconds ``rows`` as one block."""
    seconds = [_second(linear, noise, k) for k in range(rows.start, rows.stop)]
    count, n = len(seconds), len(seconds[0][0])
    onward = np.eye(count * n)
    for k in range(1, count):
        before, here = slice((k - 1) * n, k * n), slice(k * n, (k + 1) * n)
        onward[here, : k * n] = seconds[k - 1][0] @ onward[before, : k * n]
    fresh = block_diag(
        *(_root(each) for each in [_begins(linear, noise, rows.start), *(Q for _, Q, _ in seconds)][:-1])
    )
    C = block_diag(*(h for _, _, h in seconds))
    return Dense(onward @ fresh, C, np.tile(noise.as_array()[:6] ** 2, count), onward)


def _root(covariance: Floats) -> Floats:
    """R with R R' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _second(linear: LinearModel, noise: DisturbanceNoise, k: int) -> tuple[Floats, Floats, Floats]:
    """Transition, what is new, and how the sensors see the states, of one second."""
    A, B = linear.A[k], linear.B[k] * FORCE_UNITS
    kept, slow = np.exp(-1.0 / noise.slow_s), np.diag((np.array(noise.slow) / FORCE_UNITS) ** 2)
    gust = np.diag((np.array(noise.gust) / FORCE_UNITS) ** 2)
    F = np.block([[A, B], [np.zeros((3, 6)), kept * np.eye(3)]])
    Q, h = block_diag(B @ gust @ B.T, slow * (1.0 - kept**2)), np.hstack([linear.H[k], np.zeros((6, 3))])
    if noise.has_waves:
        stationary, w = _swing(linear.origin[k], noise)
        values, vectors = np.linalg.eig([[0.0, 1.0], [-(w**2), -2.0 * noise.wave_damping * w]])
        swing = np.kron(np.eye(3), ((vectors * np.exp(values)) @ np.linalg.inv(vectors)).real)
        F, Q = block_diag(F, swing), block_diag(Q, stationary - swing @ stationary @ swing.T)
        h = np.hstack([h, _swing_seen(linear.origin[k])])
    if noise.wave_drift_n > 0.0:
        stays, force = np.exp(-1.0 / noise.wave_drift_s), B @ _pushed(linear.origin[k], noise)
        F = block_diag(F, [[stays]])
        F[:6, -1] = force
        Q, h = block_diag(Q, (1.0 - stays**2) * _wave_drift(noise)), np.hstack([h, np.zeros((6, 1))])
    if noise.has_drift:
        lasts = np.exp(-1.0 / noise.drift_s)
        F, Q = block_diag(F, lasts * np.eye(6)), block_diag(Q, (1.0 - lasts**2) * _drift(noise))
        h = np.hstack([h, np.eye(6)])
    return F, Q, h


def _wave_drift(noise: DisturbanceNoise) -> Floats:
    """Variance [1, 1] of the waves' slow drift in beam sea."""
    return np.array([[(noise.wave_drift_n / FORCE_UNITS[0]) ** 2]])


def _pushed(origin: Floats, noise: DisturbanceNoise) -> Floats:
    """Surge, sway and yaw [3] of a unit of wave drift, 0.35 cos b, sin b and 0.06 L sin 2b (Faltinsen 1990)."""
    b = noise.wave_towards_rad - origin[2]
    force = np.array([0.35 * np.cos(b), np.sin(b), 0.06 * noise.length_m * np.sin(2.0 * b)])
    return np.asarray(force * FORCE_UNITS[0] / FORCE_UNITS)


def _drift(noise: DisturbanceNoise) -> Floats:
    """Stationary covariance [6, 6] of the sensors' slow errors."""
    return np.diag(np.array([noise.drift[0], *noise.drift]) ** 2)


def _swing(origin: Floats, noise: DisturbanceNoise) -> tuple[Floats, float]:
    """Stationary covariance [6, 6] of swing and its speed, north, east and yaw; the frequency met [rad/s]."""
    north, east, yaw = noise.waves
    towards = noise.wave_towards_rad - origin[2]
    ahead = origin[3] * np.cos(towards) + origin[4] * np.sin(towards)
    w = abs(noise.wave_frequency_radps - noise.wave_frequency_radps**2 / GRAVITY_MPS2 * ahead)
    share = np.diag([north**2, east**2, yaw**2 * (0.1 + 0.9 * np.sin(towards) ** 2)])
    share[0, 1] = share[1, 0] = noise.wave_correlation * north * east
    return np.kron(share, np.diag([1.0, w**2])), float(w)


def _swing_seen(origin: Floats) -> Floats:
    """How the sensors see north, its speed, east, its speed, yaw and its rate [6, 6], by differences.

    The swing moves the ship over ground; her sensors report along axes that swing with her.
    """

    def seen(swing: Floats) -> Floats:
        north, north_speed, east, east_speed, yaw, rate = swing
        psi, u, v = origin[2:5]
        to_north = u * np.cos(psi) - v * np.sin(psi) + north_speed
        to_east = u * np.sin(psi) + v * np.cos(psi) + east_speed
        now = psi + yaw
        ahead, aside = (
            to_north * np.cos(now) + to_east * np.sin(now),
            to_east * np.cos(now) - to_north * np.sin(now),
        )
        return np.array([north, east, yaw, ahead, aside, rate])

    steps = 1e-6 * np.eye(6)
    return np.column_stack([(seen(step) - seen(-step)) / 2e-6 for step in steps])


def _begins(linear: LinearModel, noise: DisturbanceNoise, k: int) -> Floats:
    """Covariance of a block's first state: anything, and what is stationary."""
    slow = (np.array(noise.slow) / FORCE_UNITS) ** 2
    begins = np.diag([*FREE**2, *slow])
    if noise.has_waves:
        begins = block_diag(begins, _swing(linear.origin[k], noise)[0])
    if noise.wave_drift_n > 0.0:
        begins = block_diag(begins, _wave_drift(noise))
    return block_diag(begins, _drift(noise)) if noise.has_drift else begins


def drawn(linear: LinearModel, noise: DisturbanceNoise, edges: NDArray[np.int64], seed: int) -> Columns:
    """One column of data drawn second by second from exactly this system; drives are zero."""
    random, seen = np.random.default_rng(seed), np.empty((len(linear.A), 6))
    errors = noise.as_array()[:6]
    starts = set(edges[:-1].tolist())
    F, Q, state = np.zeros(0), np.zeros(0), np.zeros(0)
    for k in range(len(linear.A)):
        fresh = _begins(linear, noise, k) if k in starts else Q
        came = _root(fresh) @ random.standard_normal(len(fresh))
        state = came if k in starts else F @ state + came
        F, Q, h = _second(linear, noise, k)
        seen[k] = h @ state + errors * random.standard_normal(6)
    return one_column(seen)


def one_column(seen: Floats, drive: Floats | None = None) -> Columns:
    """Data alone."""
    return Columns(
        np.zeros((*seen.shape, 1)) if drive is None else drive[:, :, None].copy(),
        seen[:, :, None].copy(),
        np.zeros((len(seen), 0)),
    )
