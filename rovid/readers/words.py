"""The words of a column's or field's name, and those that speak of a clock."""

from __future__ import annotations

import re

CLOCK = {"time", "t", "stamp", "timestamp", "seconds", "zeit", "utc", "elapsed"}
CLOCK |= {
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
}
NOT_CLOCK = {"h", "hours", "min", "minutes", "days", "left", "remaining"}
_WORDS = re.compile(r"[A-ZÀ-Þ]?[a-zß-ÿ]+|[A-ZÀ-Þ]+(?![a-zß-ÿ])|\d+")


def words(source: str) -> set[str]:
    """Lower-case words of a name, as in ``/phins/heading.data`` or ``yawRate_dps``."""
    return {word.lower() for word in _WORDS.findall(source)}
