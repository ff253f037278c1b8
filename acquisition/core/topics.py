"""MQTT topic patterns with wildcards."""

from __future__ import annotations


def covers(pattern: str, topics: str) -> bool:
    """Whether a pattern matches a topic, or all topics of another pattern: ``+`` is one level, ``#`` the rest.

    >>> covers("ship/NMEA/#", "ship/NMEA/GPGGA"), covers("ship/+/x", "ship/#"), covers("#", "$SYS/uptime")
    (True, False, False)
    """
    theirs = topics.split("/")
    for number, level in enumerate(pattern.split("/")):
        if level == "#":
            return number > 0 or not topics.startswith("$")
        if number >= len(theirs) or theirs[number] == "#" or level not in ("+", theirs[number]):
            return False
    return len(theirs) == len(pattern.split("/"))


def overlap(one: str, other: str) -> bool:
    """Whether some topic matches both patterns.

    >>> overlap("ship/+/Heading", "ship/MRU/+"), overlap("ship/MRU/Roll", "ship/MRU/Pitch")
    (True, False)
    """
    shorter, longer = sorted((one.split("/"), other.split("/")), key=len)
    for level, beside in zip(shorter, longer, strict=False):
        if "#" in (level, beside):
            return True
        if "+" not in (level, beside) and level != beside:
            return False
    return len(shorter) == len(longer) or longer[len(shorter)] == "#"
