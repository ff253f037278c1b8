"""Coverage-guided fuzzing of MQTT messages, from a payload to channel samples.

The first byte chooses the topic: sentences, a number, degrees and minutes, JSON. Nothing may raise, every value is
finite, and every channel sample is one that its channel can hold.
"""

from __future__ import annotations

import atheris

with atheris.instrument_imports(include=["acquisition"]):
    from seatrial.acquisition.config.sources import MqttSource, TopicValue
    from seatrial.acquisition.core.trial import Frame, FrameFlag, Trial
    from seatrial.acquisition.logger.processing import Derivation
    from seatrial.acquisition.protocols import make_decoders
    from tests.fuzz.decoding import check_frame
    from tests.fuzz.running import fuzz

START_NS = 1_779_019_200_000_000_000
TRIAL = Trial(name="fuzz", origin_latitude_deg=63.44, origin_longitude_deg=10.4)
VALUES = {
    "heading_deg": TopicValue(topic="heading", unit="rad"),
    "latitude_deg": TopicValue(topic="latitude", unit="ddmm"),
    "longitude_deg": TopicValue(topic="longitude", unit="ddmm"),
    "apparent_wind_angle_deg": TopicValue(topic="wind", unit="deg", field="wind.angle"),
    "apparent_wind_speed_mps": TopicValue(topic="wind", unit="knots", field="wind.speed", scale=-1.0),
}
SOURCE = MqttSource(name="line", type="mqtt", topics=("NMEA/#",), values=VALUES, channels=tuple(VALUES))
TOPICS = ("NMEA/x", "heading", "latitude", "longitude", "wind")
SEEDS = (
    b"\x002023-11-03T09:41:02.769765Z $HEHDT,12.5,T*2B\n!AIVDM,1,1,,A,13HOI:0P0000VOHLCnHQKwvL05Ip,0*23",
    b"\x01-1.5e-3,2023-11-03T09:41:02Z,rad,x", b"\x011699004462.5 2.5", b"\x026326.4,1699004462", b"\x03None",
    b'\x04{"wind": {"angle": 45, "speed": "-3"}, "time": "2023-11-03T09:41:02Z"}', b'\x04{"wind.angle": 1}',
)  # fmt: skip


def one_input(data: bytes) -> None:
    """The first byte chooses topic and flag; messages are parted by zero bytes and come 0.1 s after each other."""
    choice, messages = data[0] if data else 0, data[1:].split(b"\0\0")
    (decoder,) = make_decoders(SOURCE)
    derivation = Derivation(TRIAL, frozenset({"line"}))
    topic = TOPICS[choice % len(TOPICS)].encode()
    flags = FrameFlag.RETAINED if choice & 0x80 else FrameFlag.NONE
    for number, message in enumerate(messages):
        at_ns = START_NS + number * 100_000_000
        check_frame(decoder, derivation, Frame("line", "mqtt", topic + b"\0" + message, at_ns, at_ns, flags=flags))


if __name__ == "__main__":
    fuzz(one_input, SEEDS, 600)
