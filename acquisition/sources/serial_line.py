"""Bytes from a serial port, and NMEA 0183 lines in them."""

from __future__ import annotations

import serial

from acquisition.config.sections import MavlinkSerialSource, SerialSource
from acquisition.core.errors import SourceError
from acquisition.core.frames import Frame
from acquisition.sources.lines import LineAssembler


def open_port(config: SerialSource | MavlinkSerialSource) -> serial.Serial:
    """Open the serial port of a configuration section, 8N1. Raises :class:`SourceError`."""
    try:
        return serial.Serial(config.device, config.baud_rate, timeout=0, exclusive=True)
    except (serial.SerialException, ValueError, OSError) as error:
        raise SourceError(
            f"serial line {config.device} cannot be opened",
            where=f"source {config.name!r}",
            why=str(error),
            fix="connect it, end the program that uses it, or correct `device`",
        ) from error


class SerialPort:
    """One serial port; what its bytes are is for the heirs to say."""

    lost = 0

    def __init__(self, config: SerialSource | MavlinkSerialSource) -> None:
        self.name = config.name
        self._config = config
        self._port: serial.Serial | None = None

    def open(self) -> None:
        self._port = open_port(self._config)

    def receive(self, timeout_s: float) -> bytes:
        """What has come, or nothing after the timeout. Raises :class:`SourceError`."""
        if self._port is None:
            raise SourceError("is not open", where=f"source {self.name!r}")
        try:
            if self._port.timeout != timeout_s:  # setting it asks the system for the line's settings each time
                self._port.timeout = timeout_s
            first = bytes(self._port.read(1))
            return first + bytes(self._port.read(self._port.in_waiting)) if first else b""
        except (serial.SerialException, OSError, TypeError) as error:  # pyserial raises TypeError on unplug
            raise SourceError("serial line failed", where=f"source {self.name!r}", why=str(error)) from error

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None


class SerialLine(SerialPort):
    """NMEA 0183 on one serial port."""

    def __init__(self, config: SerialSource) -> None:
        super().__init__(config)
        self._lines = LineAssembler(config.name)

    def open(self) -> None:
        super().open()
        self._lines.cut()

    def read(self, timeout_s: float) -> list[Frame] | None:
        received = self.receive(timeout_s)
        return self._lines.push(received) if received else []
