"""Why a channel is missing, one reason each, and what to do: from a survey of what has come."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Container, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from seatrial.acquisition.config.configuration import TrialConfig
from seatrial.acquisition.config.declarations import GroupField, MavlinkField, Origin, SentenceField
from seatrial.acquisition.config.sections import LineSource, MqttLinks, OwnSource
from seatrial.acquisition.core.channels import POSE_AND_VELOCITY, trial_names
from seatrial.acquisition.core.errors import SeatrialError
from seatrial.acquisition.core.frames import label_parts
from seatrial.acquisition.decoders.nmea0183 import NO_CHECKSUM
from seatrial.acquisition.logger.redecode import own_configuration
from seatrial.acquisition.logger.survey import TOPIC_VALUE, Survey, TrafficKind, is_makers_own, survey_of_recording

LOOKED_AT = 10_000
"""Frames of a recording from which its summary says why something is missing: some seconds of a busy bus."""
RATED_FIX = "give rated_rpm"
VARIATION_FIX = "set magnetic_variation_deg or add a source of 127258"
_MOST_NAMED = 6
_FRESH_S = 1.5  # how old what others are derived with may be


class _Recipe(NamedTuple):
    """Channels that are derived from ``of``, if what they ``need`` besides is known."""

    channels: tuple[str, ...]
    of: str
    needs: tuple[str, ...]


_SPEEDS, _WIND = ("surge_mps", "sway_mps"), ("wind_direction_deg", "wind_speed_mps")
_RECIPES = (
    _Recipe(("heading_deg",), "heading_magnetic_deg", ("magnetic_variation_deg",)),
    _Recipe(_SPEEDS, "velocity_north_mps", ("heading_deg",)),
    _Recipe(_SPEEDS, "course_magnetic_deg", ("speed_over_ground_mps", "magnetic_variation_deg", "heading_deg")),
    _Recipe(_SPEEDS, "course_over_ground_deg", ("speed_over_ground_mps", "heading_deg")),
    _Recipe(_SPEEDS, "speed_over_ground_mps", ("course_over_ground_deg", "heading_deg")),
    _Recipe(("wind_direction_deg",), "wind_direction_magnetic_deg", ("magnetic_variation_deg",)),
    _Recipe(_WIND, "wind_angle_theoretical_deg", ("wind_speed_theoretical_mps", "heading_deg")),
    _Recipe(_WIND, "wind_angle_apparent_deg", ("wind_speed_apparent_mps", "heading_deg", *_SPEEDS)),
    _Recipe(_WIND, "wind_angle_water_deg",
            ("wind_speed_water_mps", "heading_deg", *_SPEEDS, "speed_through_water_mps")),
    _Recipe(("north_m", "east_m"), "latitude_deg", ("longitude_deg",)),
)  # fmt: skip
_POSITION = ("GGA", "GNS", "RMC", "GLL", "129025", "129029", "GLOBAL_POSITION_INT", "GPS_RAW_INT")
_CARRIERS = {
    **dict.fromkeys(("north_m", "east_m"), _POSITION),
    "heading_deg": ("HDT", "THS", "HDG", "HDM", "127250", "ATTITUDE"),
    **dict.fromkeys(_SPEEDS, ("VBW", "130578", "VTG", "RMC", "129026", "130577", "LOCAL_POSITION_NED")),
    "yaw_rate_dps": ("ROT", "127251", "ATTITUDE"),
    **dict.fromkeys(_WIND, ("MWD", "MWV", "VWR", "VWT", "130306", "WIND", "WIND_COV")),
}
"""The messages that can carry each channel of the motion, or what it is derived from."""
_OF_ACTUATORS = ("TRD", "TRC", "RPM", "RSA", "127245", "127488", "128006", "RAW_RPM")
_REMEDIES = {
    "thruster in percent": f"in percent: {RATED_FIX}",
    "engine without a reduction ratio": "tells the engine's speed: give reduction_ratios",
    "engine rpm": "tells the engine's speed: give reduction_ratios",
    "thruster not understood": "of a number that no thruster has: say in `thrusters` whose it is",
    "rpm of a single or unknown shaft": "of a shaft that the ship has not: list hers as [[actuator]]",
    "another instance": "of one more than the ship has: list hers as [[actuator]]",
    "heading without a reference": "without saying which north it counts from",
    "wind without a reference": "without saying what it refers to",
    "wind reference unknown": "without saying what it refers to",
    "course without a reference": "without saying which north it counts from",
    "not marked valid": "but is marked as not valid: see to the sensor",
    "no fix": "but without a fix: see to the antenna",
    "not available": "but its values are not available: see to the sensor",
    "no value": "but its fields are empty: see to the sensor",
    "retained by the broker, of unknown age": "but only as the broker has retained it: see to who publishes it",
    NO_CHECKSUM: 'but without a checksum: checksum = "optional" in [[source]] reads it',
    "no sound checksum": "but with wrong checksums: see to the line and its baud rate",
}
_UNREAD = {
    "127488": "tells the engine's speed: give reduction_ratios",
    "128006": "tells a thruster's speed in percent: it has no channel",
}


def missing_channels(survey: Survey) -> dict[str, str]:
    """The channels of the trial that have not come, and the reason for each."""
    received = survey.channels
    return {
        name: why_missing(name, survey) for name in trial_names(survey.config.actuators) if name not in received
    }


def missing_in(path: Path, present: Container[str]) -> dict[str, str]:
    """The channels of a recording's trial that are not ``present`` in it, and why, by its raw input.

    Empty where it carries none, or no configuration that can be read today.
    """
    with tempfile.TemporaryDirectory(prefix="seatrial-info-") as scratch:
        try:
            config = own_configuration(path, Path(scratch))
            absent = [name for name in config.watched_channels if name not in present]
            survey = survey_of_recording(config, [path], LOOKED_AT) if absent else None
        except SeatrialError:
            return {}
    if survey is None or not survey.kinds:
        return {}
    return {name: why_missing(name, survey) for name in absent}


def reasons_in(config: TrialConfig, paths: Iterable[Path], names: Iterable[str]) -> dict[str, str]:
    """Why channels did not come, by the beginning of a recording; empty words where it cannot be read."""
    try:
        survey = survey_of_recording(config, paths, LOOKED_AT)
    except SeatrialError:
        return dict.fromkeys(names, "")
    return {name: why_missing(name, survey) for name in names}


def by_reason(missing: Mapping[str, str]) -> dict[str, str]:
    """The reasons once each, by the channels that they hold for, as one text.

    >>> by_reason({"surge_mps": "no heading", "sway_mps": "no heading"})
    {'surge_mps, sway_mps': 'no heading'}
    """
    names: dict[str, list[str]] = {}
    for name, reason in missing.items():
        names.setdefault(reason, []).append(name)
    return {", ".join(channels): reason for reason, channels in names.items()}


def why_missing(name: str, survey: Survey) -> str:
    """One reason why a channel has not come, and what to do about it."""
    return what_comes(name, survey) or _nothing(name, survey)


def what_comes(name: str, survey: Survey) -> str:
    """What comes that a channel could be made of, and why it is not; empty where nothing does."""
    if labels := survey.quantities.get(name):  # on a line that is not to provide it
        line = label_parts(next(iter(labels)))[0]
        return f"{_messages(labels)} comes: add {name} to the channels of source {line!r}"
    return _not_derived(name, survey) or _refused(name, survey)


def _not_derived(name: str, survey: Survey) -> str:
    """What it would be derived from comes, but something else is missing."""
    for recipe in _RECIPES:
        labels = survey.quantities.get(recipe.of, {})
        if name not in recipe.channels or not labels:
            continue
        lacking = next((need for need in recipe.needs if not _comes(need, survey)), None)
        if lacking is not None:
            return f"{_messages(labels)} comes, but no {_words(lacking)}: {_remedy(lacking, survey)}"
        slowest = max(recipe.needs, key=lambda need: _interval_s(need, survey))
        if (interval_s := _interval_s(slowest, survey)) > _FRESH_S:
            remark = f"{_words(slowest)} only every {interval_s:.0f} s: at most {_FRESH_S} s old it serves"
            return f"{_messages(labels)} comes, but {remark}"
    return ""


def _comes(quantity: str, survey: Survey) -> bool:
    """Whether what others are derived with is known: of a line's own, of the ship's, or of the configuration."""
    if quantity == "magnetic_variation_deg" and survey.config.magnetic_variation_deg is not None:
        return True
    if quantity in POSE_AND_VELOCITY and quantity != "heading_deg":
        return bool(survey.health.channels[quantity].count)
    return quantity in survey.quantities


def _interval_s(quantity: str, survey: Survey) -> float:
    rates_hz = [tally.rate_hz for tally in survey.quantities.get(quantity, {}).values() if tally.rate_hz]
    return 1.0 / max(rates_hz) if rates_hz and quantity != "magnetic_variation_deg" else 0.0


def _remedy(quantity: str, survey: Survey) -> str:
    if quantity == "magnetic_variation_deg":
        return VARIATION_FIX
    if quantity in trial_names(survey.config.actuators):
        return why_missing(quantity, survey)
    return "the sensor leaves it out"


def _refused(name: str, survey: Survey) -> str:
    """A message that could carry it comes, but there is nothing to take from it."""
    could = {kind: tally for kind, tally in survey.kinds.items() if _can_carry(kind, name, survey)}
    for kind, tally in sorted(could.items(), key=lambda entry: -entry[1].count):
        reason = _UNREAD.get(kind.name, "")
        for why, _ in tally.refused.most_common(1):
            reason = _REMEDIES.get(why, f"but is refused: {why}")
        if not reason and kind.name in _CARRIERS.get(name, ()):
            reason = "but holds no value for it"
        if reason:
            what = kind.device if kind.name == TOPIC_VALUE else kind.name
            return f"{what} comes, {reason}" if reason.startswith(("but", "without")) else f"{what} {reason}"
    return ""


def _can_carry(what: TrafficKind, name: str, survey: Survey) -> bool:
    """Whether a message can carry a channel; one of a thruster's number only that thruster's."""
    message = what.name
    if message == TOPIC_VALUE:
        return what.device in _topics(name, survey)
    origins = _origins(name, survey)
    if name in _CARRIERS or origins:
        return message in _CARRIERS.get(name, ()) or message in origins
    kind, _, number = message.partition(" ")
    owners = [
        thruster
        for source in survey.config.sources
        if isinstance(source, LineSource | MqttLinks)
        for thruster, thruster_number in source.thrusters.numbers.items()
        if number == str(thruster_number)
    ]
    return kind in _OF_ACTUATORS and (not owners or any(name.startswith(f"{owner}_") for owner in owners))


def sources_of(name: str, survey: Survey) -> set[str]:
    """The sources on which a message comes that can carry a channel."""
    return {kind.source for kind in survey.kinds if _can_carry(kind, name, survey)}


def _nothing(name: str, survey: Survey) -> str:
    """Nothing that comes could carry it, or nothing comes at all."""
    for source in survey.config.sources:
        if name in source.channels and not survey.health.sources[source.name].frames:
            return f"nothing at all comes from {source.name!r}"
    if topics := _topics(name, survey):
        return f"nothing comes under {' or '.join(dict.fromkeys(topics))}"
    carriers = [carrier for carrier in _CARRIERS.get(name, ()) if not carrier.isupper() or len(carrier) == 3]
    if carriers:
        return f"nothing that comes carries it: {', '.join(carriers[:-1])} or {carriers[-1]} would"
    if origins := _origins(name, survey):
        return f"nothing that comes carries it: {', '.join(origins)} would"
    names = {kind.name for kind in survey.kinds}
    makers_own = {
        message
        for message in names
        if message.startswith("0x") or (message.isdigit() and is_makers_own(int(message)))
    }
    frames = "the maker's own frames" + (f" ({', '.join(sorted(makers_own)[:_MOST_NAMED])})" if makers_own else "")
    return f"nothing that comes carries it: TRD, RPM, RSA or 127245 may, or {frames} by a DBC file"


def _topics(name: str, survey: Survey) -> list[str]:
    sources = (source for source in survey.config.sources if isinstance(source, MqttLinks))
    return [
        source.values[name].topic
        for source in sources
        if name in source.values and (name in source.channels or not isinstance(source, OwnSource))
    ]


def _origins(name: str, survey: Survey) -> list[str]:
    """The messages that a declared channel may come from."""
    origins = (
        origin
        for declaration in survey.config.declared
        if declaration.channel.name == name
        for origin in declaration.origins
    )
    return list(dict.fromkeys(map(message_of, origins)))


def message_of(origin: Origin) -> str:
    """The message that an origin of a declared channel is in, by the name that a survey has for it."""
    if isinstance(origin, SentenceField):
        return origin.sentence
    if isinstance(origin, GroupField):
        return str(origin.group)
    return origin.message if isinstance(origin, MavlinkField) else "XDR"


def _messages(labels: Iterable[str]) -> str:
    """The messages in labels of sources, the most frequent first."""
    return " and ".join(list(Counter(label_parts(label)[2][0] for label in labels))[:2])


def _words(quantity: str) -> str:
    """A quantity for people: ``magnetic_variation_deg`` is the variation."""
    words = {"magnetic_variation_deg": "variation", **dict.fromkeys(_SPEEDS, "speed over ground")}
    return words.get(quantity, quantity.rpartition("_")[0].replace("_", " "))
