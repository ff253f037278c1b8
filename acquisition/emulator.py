"""Plays a recording as traffic onto the buses and lines of a configuration: the mirror image of the logger.

Each source of the configuration sends the channels that it lists, in the order and at the pace of the
recording. A source with ``clock = "source"`` announces the recording's own time before each moment.
"""

from __future__ import annotations

import os
import select
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d

from seatrial.acquisition.config import sources, trial_file
from seatrial.acquisition.core.errors import InputError, Progress, SourceError, storage_error
from seatrial.acquisition.protocols import Encoder, Moment, Packet, make_encoder
from seatrial.acquisition.recording.reader import Recording, read_recording
from seatrial.acquisition.sources import source_error

_WRITE_TIMEOUT_S = 5.0
_WAIT_S = 30.0
_BLOCK_BYTES = 4096
_POLL_S = 0.1
_MOST_UNANSWERED = 20  # messages, as many as a broker takes at once by default


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


def iterate_moments(
    recording: Recording, channels: tuple[str, ...], origin: tuple[float, float] | None
) -> Iterator[Moment]:
    """The instants at which any of ``channels`` has a sample, in order of measured time.

    Raises :class:`InputError` when positions are wanted but no origin is known.
    """
    present = [name for name in channels if name in recording.series]
    if {"north_m", "east_m"} & set(present) and origin is None:
        fix = "give [trial] origin in the configuration"
        raise InputError("has positions but no origin", where=str(recording.path), fix=fix)
    times = np.concatenate([recording.series[name].measured_ns for name in present] or [np.empty(0, np.int64)])
    samples = np.concatenate([recording.series[name].value for name in present] or [np.empty(0)])
    channel_index = np.repeat(np.arange(len(present)), [recording.series[name].value.size for name in present])
    order = np.argsort(times, kind="stable")
    edges = np.flatnonzero(np.diff(times[order])) + 1
    for rows in np.split(order, edges) if order.size else []:
        values = {present[channel_index[row]]: float(samples[row]) for row in rows}
        position = values.get("latitude_deg"), values.get("longitude_deg")
        if origin is not None and {"north_m", "east_m"} <= values.keys():
            latitude, longitude, _ = pymap3d.ned2geodetic(values["north_m"], values["east_m"], 0.0, *origin, 0.0)
            position = float(latitude), float(longitude)
        yield Moment(int(times[rows[0]]), values, *(() if None in position else position))


def emulate(
    path: Path | str, config: trial_file.TrialConfig, speed: float = 1.0, progress: Progress | None = None
) -> Playback:
    """Play a recording onto the buses and lines of ``config``, ``speed`` times as fast as it was.

    Raises :class:`InputError` for an unfit recording and :class:`SourceError` for a line that fails.
    """
    recording = read_recording(path)
    origin = config.trial.origin or recording.trial.origin
    transmitters: list[Transmitter] = []
    schedule: list[tuple[Moment, Encoder, Transmitter]] = []
    try:
        for section in config.sources:
            moments = list(iterate_moments(recording, section.channels, origin))
            encoder = make_encoder(section, config.actuators, config.known_channels)
            transmitters.append(open_transmitter(section))
            schedule += [(moment, encoder, transmitters[-1]) for moment in moments]
        if not schedule:
            raise InputError("contains none of the configuration's channels", where=str(path))
        schedule.sort(key=lambda entry: entry[0].time_ns)
        for transmitter in transmitters:
            transmitter.ready()
        return _transmit_schedule(schedule, speed, progress or (lambda share: None))
    finally:
        for transmitter in transmitters:
            transmitter.close()


def _transmit_schedule(
    schedule: list[tuple[Moment, Encoder, Transmitter]], speed: float, progress: Progress
) -> Playback:
    first_ns = schedule[0][0].time_ns
    span_ns = max(schedule[-1][0].time_ns - first_ns, 1)
    started_s = time.monotonic()
    offered: Counter[str] = Counter()
    sent: Counter[str] = Counter()
    packets_sent, latest_s = 0, 0.0
    for moment, encoder, transmitter in schedule:
        due_s = started_s + (moment.time_ns - first_ns) / 1e9 / speed
        wait_s = due_s - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        latest_s = max(latest_s, -wait_s)
        packets = encoder.encode(moment)
        transmitter.send(packets)
        packets_sent += len(packets)
        offered.update(moment.values.keys())
        for packet in packets:
            sent.update(packet.carries)
        progress((moment.time_ns - first_ns) / span_ns)
    took_s = time.monotonic() - started_s
    return Playback(len(schedule), packets_sent, dict(sent), dict(offered - sent), took_s, latest_s)


@dataclass(frozen=True, slots=True)
class Transmitter:
    """One bus or line to send on, the far end of a source; ``errors`` are those of ``write``.

    ``ready`` waits until a receiver can listen. It raises :class:`SourceError` when none comes.
    """

    config: sources.AnySource
    write: Callable[[list[Packet]], object]
    close: Callable[[], object]
    ready: Callable[[], object] = lambda: None
    errors: tuple[type[Exception], ...] = (OSError,)

    def send(self, packets: list[Packet]) -> None:
        """Send the packets in order. Raises :class:`SourceError`."""
        try:
            self.write(packets)
        except SourceError:
            raise
        except self.errors as error:
            fix = "check the line and who listens on it"
            raise source_error(self.config, "cannot be sent", str(error), fix) from error


def open_transmitter(config: sources.AnySource) -> Transmitter:
    """Open the far end of a source. Raises :class:`SourceError`."""
    if config.type not in _OPENERS:
        fix = "play onto can, serial, udp, tcp, file, mavlink or mqtt"
        raise source_error(config, f"cannot play onto a {config.type} source", fix=fix)
    return _OPENERS[config.type](config)


def _join_payloads(packets: list[Packet]) -> bytes:
    return b"".join(packet.payload for packet in packets)


def _open_can(config: sources.CanSource) -> Transmitter:
    import can

    from seatrial.acquisition.sources.lines import open_bus

    bus, errors = open_bus(config), (can.CanError, OSError)

    def write(packets: list[Packet]) -> None:
        for packet in packets:
            identifier, extended = packet.identifier, packet.extended
            bus.send(can.Message(arbitration_id=identifier, data=packet.payload, is_extended_id=extended))

    def close() -> None:
        with suppress(*errors):
            bus.shutdown()

    return Transmitter(config, write, close, errors=errors)


def _open_serial(config: sources.SerialSource) -> Transmitter:
    """On closing, the system sends what it holds before it lets the line go."""
    from seatrial.acquisition.sources.lines import open_port

    port = open_port(config)
    port.write_timeout = _WRITE_TIMEOUT_S
    return Transmitter(config, lambda packets: port.write(_join_payloads(packets)), port.close)


def _open_udp(config: sources.UdpSource | sources.MavlinkSource) -> Transmitter:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def write(packets: list[Packet]) -> None:
        if payload := _join_payloads(packets):
            with suppress(ConnectionRefusedError):  # no receiver listens yet, which is no fault of a datagram's
                link.sendto(payload, (config.address, config.port))

    return Transmitter(config, write, link.close)


def _open_tcp(config: sources.TcpSource) -> Transmitter:
    """The gateway's side: waits for the logger to connect, then serves that one connection."""
    try:
        server = socket.create_server((config.address, config.port))
    except OSError as error:
        problem = f"TCP {config.address}:{config.port} cannot be served"
        raise source_error(config, problem, str(error)) from error
    server.settimeout(_WAIT_S)

    @cache
    def accept_logger() -> socket.socket:
        try:
            return server.accept()[0]
        except OSError as error:
            raise source_error(config, "no logger connected", str(error), "start it") from error

    def close() -> None:
        if accept_logger.cache_info().currsize:
            accept_logger().close()
        server.close()

    return Transmitter(
        config, lambda packets: accept_logger().sendall(_join_payloads(packets)), close, ready=accept_logger
    )


def _open_file(config: sources.FileSource) -> Transmitter:
    try:
        file = config.path.open("wb")
    except OSError as error:
        raise storage_error(config.path, error) from error

    def close() -> None:
        file.flush()
        os.fsync(file.fileno())
        file.close()

    return Transmitter(config, lambda packets: file.write(_join_payloads(packets)), close)


def _open_mqtt(config: sources.MqttSource) -> Transmitter:
    """A publisher, no faster than the broker answers: some drop unanswered messages when a client leaves."""
    from seatrial.acquisition.sources.lines import connect_to_broker, receive_one_message

    client = connect_to_broker(config, keep_alive_s=0)  # a recording may be quiet for long
    unanswered: deque[Any] = deque()

    def await_acknowledgements(limit: int) -> None:
        """Wait until all but so many of the messages are the broker's."""
        until_s = time.monotonic() + _WRITE_TIMEOUT_S
        while len(unanswered) > limit:
            receive_one_message(config, client, _POLL_S)
            while unanswered and unanswered[0].is_published():
                unanswered.popleft()
            if time.monotonic() > until_s:
                raise TimeoutError("the broker accepts nothing")

    def write(packets: list[Packet]) -> None:
        for packet in packets:
            topic, _, message = packet.payload.partition(b"\0")
            unanswered.append(client.publish(topic.decode(), message, qos=1))
            await_acknowledgements(_MOST_UNANSWERED)

    def close() -> None:
        with suppress(SourceError, OSError):  # of a lost connection, which has been reported
            await_acknowledgements(0)
        client.disconnect()

    return Transmitter(config, write, close)


_OPENERS: dict[str, Callable[[Any], Transmitter]] = {
    "can": _open_can,
    "serial": _open_serial,
    "udp": _open_udp,
    "mavlink": _open_udp,
    "tcp": _open_tcp,
    "file": _open_file,
    "mqtt": _open_mqtt,
}
"""What opens the far ends of sources, by their types."""


class NullModem:
    """A context manager; what is written to ``emulator_device`` can be read from ``logger_device``."""

    def __enter__(self) -> NullModem:
        import pty  # systems without pseudo-terminals analyse recordings all the same
        import tty

        self._near, self._near_port = pty.openpty()
        self._far, self._far_port = pty.openpty()
        for port in (self._near_port, self._far_port):
            tty.setraw(port)
        self.emulator_device, self.logger_device = os.ttyname(self._near_port), os.ttyname(self._far_port)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._forward_bytes, name="null modem", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        for descriptor in (self._near, self._near_port, self._far, self._far_port):
            os.close(descriptor)

    def _forward_bytes(self) -> None:
        while not self._stop.is_set():
            readable, _, _ = select.select([self._near], [], [], _POLL_S)
            if readable:
                pending = os.read(self._near, _BLOCK_BYTES)
                while pending and not self._stop.is_set():
                    _, writable, _ = select.select([], [self._far], [], _POLL_S)
                    if writable:
                        pending = pending[os.write(self._far, pending) :]
