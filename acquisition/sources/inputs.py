"""What can be recorded, and by which rules: who counts as a source of its own in it, and what its times count from.

The documentation's page of inputs is made of :data:`INPUTS`; a test holds it against the forms that are read.
"""

from __future__ import annotations

from typing import NamedTuple


class Input(NamedTuple):
    """A kind of input: what it is, who is a source of its own in it, and what its times are.

    ``live`` says whether it can come over a line as well as from a file.
    """

    what: str
    identity: str
    times: str
    live: bool = False


_ADDRESS = "the device's address, or its NAME once it has claimed one"
_BUS = "; of several buses in one log each"
_TALKER = (
    "the talker, with the source of a TAG block; satellite talkers (GP, GN, GL ...) are one receiver, two positions"
    " of one moment more than 10 m apart two; values that take turns between two levels are of two; at one port"
    " each address"
)
_COMPONENT = "the system, and every component but the autopilot; at one port each address"
_SINCE_GATEWAY = "since the gateway started; UTC where the bus or a sentence tells it near the log's beginning"
_OF_DAY = "time of day; the date is that of the bus or a sentence, else of the file's last change, which is said"

INPUTS: dict[str, Input] = {
    "nmea0183": Input(
        "sentences, TAG blocks, with anything that a logger wrote before them", _TALKER,
        "before the sentence: date and time (UTC or with a zone; the whole log decides whether the day or the month"
        " comes first), seconds to nanoseconds since 1970, or time of day; else of the TAG block", live=True,
    ),
    "candump": Input(
        "can-utils, with every option", f"{_ADDRESS}{_BUS} interface",
        "UTC; `-tA` this computer's zone; `-tz`, `-td` since the start or the previous frame", live=True,
    ),
    "savvycan": Input(
        "SavvyCAN's table of frames", f"{_ADDRESS}{_BUS} in the column Bus", "since 1970 or since the log began"
    ),
    "canboat": Input(
        "canboat's lines: time, priority, group, source, destination, bytes", _ADDRESS,
        "UTC or with a zone, to the nanosecond", live=True,
    ),
    "yacht_devices": Input("Yacht Devices RAW, Actisense's CAN ASCII", _ADDRESS, _OF_DAY, live=True),
    "n2k_ascii": Input("Actisense N2K ASCII", _ADDRESS, _OF_DAY, live=True),
    "actisense": Input("Actisense's binary messages 93, 95, D0", _ADDRESS, _SINCE_GATEWAY, live=True),
    "ikonvert": Input("Digital Yacht iKonvert, NavLink2", _ADDRESS, _SINCE_GATEWAY, live=True),
    "seasmart": Input(
        "`$PCDIN` (SeaSmart, Chetco and many since)", _ADDRESS,
        "since the gateway started, or 1/1024 s since 2010", live=True,
    ),
    "mxpgn": Input(
        "`$MXPGN` (ShipModul MiniPlex)", _ADDRESS, "none: of what came before, or of what the bus tells", live=True
    ),
    "opencpn": Input("voyage data recorder of OpenCPN, CSV of both kinds", _ADDRESS, "UTC"),
    "garmin": Input("chart plotters' CSV", _ADDRESS, "since it started, or UTC"),
    "ebl": Input("Actisense EBL", _ADDRESS, "UTC"),
    "ydvr": Input("Yacht Devices' recorders, .DAT", _ADDRESS, "in the minute; UTC where the bus tells it"),
    "yd_can": Input(
        "Yacht Devices' recorders, .CAN", _ADDRESS, "since the recorder started; UTC where the bus tells it"
    ),
    "pcap": Input(
        "tcpdump and Wireshark on SocketCAN, the older form", f"{_ADDRESS}; captured on all interfaces, each", "UTC"
    ),
    "pcapng": Input("the newer form", f"{_ADDRESS}{_BUS} interface", "UTC"),
    "asc": Input(
        "Vector's ASC", f"{_ADDRESS}{_BUS} channel",
        "since the date in its header (this computer's zone), since the line before (`timestamps relative`), or"
        " times of day, which is said",
    ),
    "blf": Input("Vector's BLF, by python-can", f"{_ADDRESS}{_BUS} channel", "UTC"),
    "trc": Input(
        "PEAK's TRC, by python-can", f"{_ADDRESS}{_BUS} channel",
        "since its start, by the line for that or by its comments",
    ),
    "mavlink": Input("MAVLink over a network or a serial line", _COMPONENT, "of reception", live=True),
    "mavlink_file": Input(
        "telemetry logs of ground stations (.tlog)", _COMPONENT,
        "UTC; of a clock that was not set the distances, and the date by SYSTEM_TIME, by the clock once it was set,"
        " or by the file's last change, which is said",
    ),
    "mqtt": Input("MQTT, values and sentences", "the topic", "of reception, or beside the value", live=True),
    "mqtt_file": Input("R/V Gunnerus' SQLite log of MQTT messages", "the topic", "UTC, of the log"),
    "can": Input("a CAN bus of this computer, by python-can", _ADDRESS, "of the system's reception", live=True),
}  # fmt: skip
"""Every kind of input, by its ``form`` or by the ``type`` of its source."""
