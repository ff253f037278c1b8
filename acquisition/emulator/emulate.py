"""The mirror image of the logger: a recording becomes traffic on the buses and lines of a configuration.

Each source of the configuration sends the channels that it lists, in the order and at the pace of the
recording. A source with ``clock = "source"`` announces the recording's own time before each moment.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymap3d

from acquisition.config.configuration import TrialConfig
from acquisition.core.errors import InputError
from acquisition.core.progress import Progress
from acquisition.emulator.transmitters import Transmitter, open_transmitter
from acquisition.encoders import Encoder, Moment, make_encoder
from acquisition.recording.reader import Recording, read_recording


@dataclass(frozen=True, slots=True)
class Playback:
    """What was sent: moments and packets in all, values by channel, the time it took [s].

    ``unsent`` counts values that no message could carry: a north without an east at the same time, say.
    """

    moments: int
    packets: int
    counts: dict[str, int]
    unsent: dict[str, int]
    duration_s: float
    latest_s: float


def moments_of(
    recording: Recording, channels: tuple[str, ...], origin: tuple[float, float] | None
) -> Iterator[Moment]:
    """The instants at which any of ``channels`` has a sample, in order of measured time.

    Raises :class:`InputError` when positions are wanted but no origin is known.
    """
    present = [name for name in channels if name in recording.series]
    if {"north_m", "east_m"} & set(present) and origin is None:
        raise InputError(
            "has positions but no origin",
            where=str(recording.path),
            fix="give [trial] origin in the configuration",
        )
    times = np.concatenate([recording.series[name].measured_ns for name in present] or [np.empty(0, np.int64)])
    values = np.concatenate([recording.series[name].value for name in present] or [np.empty(0)])
    which = np.repeat(np.arange(len(present)), [recording.series[name].value.size for name in present])
    order = np.argsort(times, kind="stable")
    edges = np.flatnonzero(np.diff(times[order])) + 1
    for rows in np.split(order, edges) if order.size else []:
        now = {present[which[row]]: float(values[row]) for row in rows}
        yield _with_fix(int(times[rows[0]]), now, origin)


def _with_fix(time_ns: int, values: dict[str, float], origin: tuple[float, float] | None) -> Moment:
    if origin is None or "north_m" not in values or "east_m" not in values:
        fix = values.get("latitude_deg"), values.get("longitude_deg")
        return Moment(time_ns, values) if None in fix else Moment(time_ns, values, *fix)
    latitude, longitude, _ = pymap3d.ned2geodetic(values["north_m"], values["east_m"], 0.0, *origin, 0.0)
    return Moment(time_ns, values, float(latitude), float(longitude))


@dataclass(slots=True)
class _Player:
    """One source's queue of moments, its encoder and the far end of its line."""

    moments: list[Moment]
    encoder: Encoder
    outlet: Transmitter


def emulate(
    path: Path | str, config: TrialConfig, speed: float = 1.0, progress: Progress | None = None
) -> Playback:
    """Play a recording onto the buses and lines of ``config``, ``speed`` times as fast as it was.

    Raises :class:`InputError` for an unfit recording and :class:`SourceError` for a line that fails.
    """
    recording = read_recording(path)
    origin = config.trial.origin or recording.trial.origin
    players: list[_Player] = []
    try:
        for section in config.sources:
            moments = list(moments_of(recording, section.channels, origin))
            players.append(_Player(moments, make_encoder(section, config.actuators), open_transmitter(section)))
        schedule = _schedule(players)
        if not schedule:
            raise InputError("holds none of the channels that the configuration plays", where=str(path))
        for player in players:
            player.outlet.ready()
        return _play(schedule, players, speed, progress or (lambda share: None))
    finally:
        for player in players:
            player.outlet.close()


def _schedule(players: list[_Player]) -> list[tuple[int, int, int]]:
    """(time, player, moment) of everything to send, in order."""
    return sorted(
        (moment.time_ns, number, index)
        for number, player in enumerate(players)
        for index, moment in enumerate(player.moments)
    )


def _play(
    schedule: list[tuple[int, int, int]], players: list[_Player], speed: float, progress: Progress
) -> Playback:
    first_ns, last_ns = schedule[0][0], schedule[-1][0]
    span_ns = max(last_ns - first_ns, 1)
    started_s = time.monotonic()
    given: Counter[str] = Counter()
    sent: Counter[str] = Counter()
    packets_sent, latest_s = 0, 0.0
    for time_ns, number, index in schedule:
        due_s = started_s + (time_ns - first_ns) / 1e9 / speed
        wait_s = due_s - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        latest_s = max(latest_s, -wait_s)
        player = players[number]
        moment = player.moments[index]
        packets = player.encoder.encode(moment)
        player.outlet.send(packets)
        packets_sent += len(packets)
        given.update(moment.values.keys())
        for packet in packets:
            sent.update(packet.carries)
        progress((time_ns - first_ns) / span_ns)
    took_s = time.monotonic() - started_s
    return Playback(len(schedule), packets_sent, dict(sent), dict(given - sent), took_s, latest_s)
