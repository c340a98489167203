"""The words of a column's or field's name, and those that speak of a clock or of a heading."""

from __future__ import annotations

import re

CLOCK_WORDS = {"time", "t", "stamp", "timestamp", "seconds", "zeit", "utc", "elapsed"}
CLOCK_WORDS |= {
    "datetime",
    "zeitstempel",
    "uhrzeit",
    "horodatage",
    "temps",
    "heure",
    "tiempo",
    "fecha",
    "hora",
    "tid",
    "klokkeslett",
    "tidsstempel",
    "tempo",
    "orario",
    "ora",
}
HEADING_WORDS = {"heading", "hdg", "yaw", "psi", "compass", "kurs", "steuerkurs", "kompass", "gier", "gierwinkel"}
HEADING_WORDS |= {"cap", "lacet", "azimuth", "azimut", "rumbo", "guinada", "guiñada", "gir", "girvinkel", "stevning"}
HEADING_WORDS |= {"prua", "bussola"}
YAW_RATE_WORDS = {
    "gierrate",
    "drehrate",
    "giergeschwindigkeit",
    "wendegeschwindigkeit",
    "yawrate",
    "yawspeed",
    "giration",
}
YAW_RATE_WORDS |= {"girrate", "svingerate", "giro", "imbardata"}
NOT_CLOCK = {"h", "hours", "min", "minutes", "days", "left", "remaining"}
_WORDS = re.compile(r"[A-ZÀ-Þ]?[a-zß-ÿ]+|[A-ZÀ-Þ]+(?![a-zß-ÿ])|\d+")


# At the end of a name: a rate of turn.
_PER_SECOND = re.compile(r"(?:dps|(?:deg|grad|grados|gradi|grader|rad|°) ?[/_] ?s)\W*$", re.IGNORECASE)


def is_per_second(source: str) -> bool:
    """Whether a name ends in the unit of a rate of turn."""
    return bool(_PER_SECOND.search(source))


def name_words(source: str) -> set[str]:
    """Lower-case words of a name, as in ``/phins/heading.data`` or ``yawRate_dps``."""
    return {word.lower() for word in _WORDS.findall(source)}
