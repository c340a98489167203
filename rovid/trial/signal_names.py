"""Signals of rovid.toml: units, standard sources in each log format, and words in the names of columns."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from rovid.trial.axis import AXES

# Unit -> factor to SI. A thruster command keeps the unit of its bench curve.
ANGLE_UNITS = {"deg": math.pi / 180.0, "rad": 1.0}
ANGULAR_RATE_UNITS = {"deg/s": math.pi / 180.0, "rad/s": 1.0, "rpm": math.pi / 30.0}
TORQUE_UNITS = {"N m": 1.0, "kN m": 1000.0}
FORCE_UNITS = {"N": 1.0, "kN": 1000.0}
LENGTH_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
# m, mean radius of the earth. A latitude or longitude times it is an arc; `local_position` makes metres of both.
EARTH_RADIUS = 6_371_008.8
GEODETIC_UNITS = {"deg": math.radians(EARTH_RADIUS), "1e-7 deg": math.radians(1e-7 * EARTH_RADIUS)}
SPEED_UNITS = {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001, "kn": 1852.0 / 3600.0}
TIME_UNITS = ("auto", "s", "ms", "us", "ns", "iso8601")


def _motion_units() -> dict[str, Mapping[str, float]]:
    positions: dict[str, Mapping[str, float]] = {}
    rates: dict[str, Mapping[str, float]] = {}
    for axis in AXES.values():
        position, rate = (ANGLE_UNITS, ANGULAR_RATE_UNITS) if axis.angular else (LENGTH_UNITS, SPEED_UNITS)
        positions |= dict.fromkeys(axis.position_signals, position)
        # The rate, and the order to a controller that keeps it.
        rates[axis.rate_signal] = rates[f"{axis.rate_signal}_order"] = rate
    return positions | rates


# Signal -> its units. A signal of any other name is the user's own and keeps its unit.
SIGNAL_UNITS: Mapping[str, Mapping[str, float]] = {
    **_motion_units(),
    "torque": TORQUE_UNITS,
    "force": FORCE_UNITS,
    "north": LENGTH_UNITS | GEODETIC_UNITS,
    "east": LENGTH_UNITS | GEODETIC_UNITS,
}
DEFAULT_UNIT = {name: next(iter(units)) for name, units in SIGNAL_UNITS.items()}
DEFAULT_UNIT |= dict.fromkeys((name for name, units in SIGNAL_UNITS.items() if "rad/s" in units), "rad/s")

# Format -> signal -> (source, unit) that every log of the format has, so that [signals] need not name them.
STANDARD_SOURCES: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "bin": {"heading": ("ATT.Yaw", "deg"), "roll": ("ATT.Roll", "deg"), "pitch": ("ATT.Pitch", "deg")},
    "tlog": {
        "heading": ("ATTITUDE.yaw", "rad"),
        "roll": ("ATTITUDE.roll", "rad"),
        "pitch": ("ATTITUDE.pitch", "rad"),
    },
    "ulg": dict.fromkeys(("heading", "roll", "pitch"), ("vehicle_attitude.q", "rad")),
}
# Format -> the format whose sources it takes where it has none of its own.
SHARED_SOURCES: Mapping[str, str] = {"parquet": "csv", "jsonl": "csv", "mat": "csv", "bag": "mcap"}


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Source of a signal in each log format, and its conversion to SI."""

    name: str  #: A key of `SIGNAL_UNITS`, time, ``command.<thruster>`` or the user's own name.
    sources: Mapping[str, str]  #: Format (csv, mcap, ...) -> column or topic path.
    unit: str = ""  #: As written by the user.
    factor: float = 1.0  #: Factor from the logged value to SI, with the sign.
    optional: bool = False  #: A log may lack the signal.

    def __str__(self) -> str:
        """Sources, unit and sense; stored in parameter files, so its wording must not change."""
        places = [f"{kind} {source}" for kind, source in self.sources.items()]
        return ", ".join([*places, *filter(None, [self.unit]), *["turned around"] * (self.factor < 0.0)])

    @property
    def is_geodetic(self) -> bool:
        """Whether it is a latitude or a longitude."""
        return self.name in {"north", "east"} and self.unit in GEODETIC_UNITS

    def for_format(self, kind: str) -> Signal:
        """The signal with a source for ``kind``, taken from the format that shares its sources."""
        other = SHARED_SOURCES.get(kind, kind)
        if other not in self.sources:
            return self
        return replace(self, sources={kind: self.sources[other], **self.sources})


def word_set(text: str) -> frozenset[str]:
    """The words of ``text``."""
    return frozenset(text.split())


# Words in the names of columns: of clocks, of headings, of yaw rates; and words of durations that are no clock.
CLOCK_WORDS = word_set(
    """time t stamp timestamp seconds zeit utc elapsed datetime zeitstempel uhrzeit horodatage temps heure tiempo fecha
    hora tid klokkeslett tidsstempel tempo orario ora"""
)
HEADING_WORDS = word_set(
    """heading hdg yaw psi compass kurs steuerkurs kompass gier gierwinkel cap lacet azimuth azimut rumbo guinada
    guiñada gir girvinkel stevning prua bussola"""
)
YAW_RATE_WORDS = word_set(
    """gierrate drehrate giergeschwindigkeit wendegeschwindigkeit yawrate yawspeed giration girrate svingerate giro
    imbardata"""
)
NOT_CLOCK = {"h", "hours", "min", "minutes", "days", "left", "remaining"}
_WORD = re.compile(r"[A-ZÀ-Þ]?[a-zß-ÿ]+|[A-ZÀ-Þ]+(?![a-zß-ÿ])|\d+")
_RATE_UNIT_AT_END = re.compile(r"(?:dps|(?:deg|grad|grados|gradi|grader|rad|°) ?[/_] ?s)\W*$", re.IGNORECASE)


def name_words(source: str) -> set[str]:
    """Lower-case words of a name, as in ``/phins/heading.data`` or ``yawRate_dps``."""
    return {word.lower() for word in _WORD.findall(source)}


def is_per_second(source: str) -> bool:
    """Whether a name ends in the unit of an angular rate."""
    return bool(_RATE_UNIT_AT_END.search(source))
