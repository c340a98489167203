"""Degrees of freedom, and the signals that measure them: units, standard sources, and words in names of columns."""

import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Self

from rovid.core.errors import ConfigError, suggestion


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One degree of freedom, in body axes (SNAME 1950): x forward, y to starboard, z down."""

    name: str
    #: Signals in rovid.toml, each of which measures the position along the axis. The position is positive in the
    #: direction in which this signal grows.
    position_signals: tuple[str, ...]
    rate_signal: str  #: Signal that measures the rate.
    #: Key of a thruster's lever in rovid.toml: m for an angle, otherwise the share of the thrust along the axis.
    arm_key: str
    angular: bool  #: Whether the position is an angle.
    fix_signals: tuple[str, ...] = ()  #: Signals that determine the position together: north, east and heading.
    #: Whether gravity returns the vehicle, so that a constant torque gives a constant tilt.
    self_righting: bool = False

    def __reduce__(self) -> "tuple[Callable[[str], Axis], tuple[str]]":
        # Unpickling returns the one instance of each axis: axes are compared by identity.
        return parameter_axis, (self.name,)

    @property
    def position_signal(self) -> str:
        """Name of the position, in text and in JSON keys."""
        return self.position_signals[0]

    @property
    def position_words(self) -> str:
        """Name of the position in text for people."""
        return self.position_signal.replace("_", " ")

    @property
    def rate_words(self) -> str:
        """Name of the rate in text for people."""
        return self.rate_signal.replace("_", " ")

    @property
    def required_signals(self) -> str:
        """Keys of rovid.toml that hold the measured signal, for messages."""
        return self.position_signal if self.angular else f"{self.position_signal} or {self.rate_signal}"

    @property
    def motion_verb(self) -> str:
        """Verb for a motion along the axis."""
        return "turns" if self.angular else "moves"

    @property
    def force_name(self) -> str:
        """Name of the generalised force: torque or force."""
        return "torque" if self.angular else "force"

    @property
    def rate_unit(self) -> str:
        """Unit of the rate."""
        return self.unit("rad/s")

    @property
    def force_unit(self) -> str:
        """Unit of the generalised force."""
        return self.unit("N m")

    def reword(self, text: str) -> str:
        """``text``, written for a torque, for this axis."""
        return text.replace("torque", self.force_name)

    @property
    def display_unit(self) -> tuple[str, float]:
        """Unit in which people read positions, and its number in one SI unit."""
        return ("deg", 180.0 / math.pi) if self.angular else ("m", 1.0)

    def to_display(self, position: float | None) -> float | None:
        """Convert a position from SI to the display unit."""
        return None if position is None else position * self.display_unit[1]

    def measured_quantity(self, *, integrated: bool) -> tuple[str, str, float]:
        """Name of the measured quantity, its display unit, and the number of display units in one SI unit.

        ``integrated``: only the rate was measured.
        """
        if integrated:
            return self.rate_words, self.rate_unit, 1.0
        return self.position_words, *self.display_unit

    def unit(self, angular: str) -> str:
        """Unit along this axis of a quantity that has the unit ``angular`` in yaw; not for frequencies."""
        if self.angular:
            return angular
        for turning, straight in _LINEAR_UNITS.items():
            angular = angular.replace(turning, straight)
        return angular


# Unit in yaw -> unit along a straight axis. The order matters: a torque per angle loses its metre first.
_LINEAR_UNITS: Mapping[str, str] = {"kg m^2": "kg", "kg m²": "kg", "N m": "N", "(N)^": "N^", "rad": "m", "deg": "m"}

YAW = Axis(name="yaw", position_signals=("heading",), rate_signal="yaw_rate", arm_key="yaw_arm", angular=True)
#: Surge, sway and yaw together, for --axes planar: marks the parameter file of the coupled model. Logs are read along
#: yaw.
PLANAR = Axis(name="planar", position_signals=("heading",), rate_signal="yaw_rate", arm_key="yaw_arm", angular=True)


def parameter_file_name(axis: str) -> str:
    """Default name of the parameter file of an axis."""
    return "parameters.toml" if axis == YAW.name else f"parameters_{axis}.toml"


def _linear(name: str, *positions: str, fix: tuple[str, ...] = ()) -> Axis:
    """Surge, sway or heave."""
    rate = f"{name}_velocity"
    return Axis(name=name, position_signals=positions, rate_signal=rate, arm_key=name, angular=False, fix_signals=fix)


def _tilt(name: str) -> Axis:
    """Roll or pitch."""
    rate, arm = f"{name}_rate", f"{name}_arm"
    return Axis(name=name, position_signals=(name,), rate_signal=rate, arm_key=arm, angular=True, self_righting=True)


_FIX = ("north", "east", "heading")
AXES: Mapping[str, Axis] = {
    "yaw": YAW,
    "surge": _linear("surge", "surge_position", fix=_FIX),
    "sway": _linear("sway", "sway_position", fix=_FIX),
    "heave": _linear("heave", "depth", "heave_position"),
    "roll": _tilt("roll"),
    "pitch": _tilt("pitch"),
}
# Other name -> axis, for suggestions.
_SYNONYMS = {"heading": "yaw", "ahead": "surge", "sideways": "sway", "depth": "heave", "heel": "roll", "trim": "pitch"}


def axis_named(name: str) -> Axis:
    """The axis of this name; `ConfigError` if there is none."""
    if name == PLANAR.name:
        text = "is 'planar', which is no single degree of freedom."
        raise ConfigError(text, where="--axis", mend="Give --axes planar.")
    if name not in AXES:
        text = f"is {name!r}; one of {', '.join(AXES)} was expected."
        raise ConfigError(text, where="--axis", mend=suggestion(name, AXES, _SYNONYMS))
    return AXES[name]


def parameter_axis(name: str) -> Axis:
    """The axis of a parameter file: one degree of freedom, or `PLANAR`; `ConfigError` if there is none."""
    return PLANAR if name == PLANAR.name else axis_named(name)


def other_axes(signals: Collection[str], keys: Collection[str]) -> list[str]:
    """Names of the axes, yaw excepted, that a rovid.toml describes.

    One of ``signals`` must measure the motion, and a force or one of the thrusters' ``keys`` must drive it. Gravity may
    drive a self-righting axis where there are no thrusters.
    """
    found = []
    for axis in AXES.values():
        has_fix = bool(axis.fix_signals) and set(axis.fix_signals) <= set(signals)
        is_measured = has_fix or not {*axis.position_signals, axis.rate_signal}.isdisjoint(signals)
        is_driven = axis.arm_key in keys or axis.force_name in signals or (axis.self_righting and not keys)
        if axis is not YAW and is_measured and is_driven:
            found.append(axis.name)
    return found


# Unit -> factor to SI. A thruster command keeps the unit of its bench curve.
# 0.01 deg: MAVLink writes headings so.
ANGLE_UNITS = {"deg": math.pi / 180.0, "rad": 1.0, "0.01 deg": math.pi / 18000.0}
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
        rates |= dict.fromkeys((axis.rate_signal, f"{axis.rate_signal}_order"), rate)
    return positions | rates


# Signal -> its units. A signal of any other name is the user's own and keeps its unit.
SIGNAL_UNITS: Mapping[str, Mapping[str, float]] = {
    **_motion_units(),
    "torque": TORQUE_UNITS,
    "force": FORCE_UNITS,
    **dict.fromkeys(("north", "east"), LENGTH_UNITS | GEODETIC_UNITS),
}
DEFAULT_UNIT = {name: next(iter(units)) for name, units in SIGNAL_UNITS.items()}
DEFAULT_UNIT |= dict.fromkeys((name for name, units in SIGNAL_UNITS.items() if "rad/s" in units), "rad/s")


def meant_signal(name: str) -> str:
    """Known signal that ``name`` misspells by one letter, or abbreviates word by word; empty where it is another."""
    words = name.split("_")
    for known in (*SIGNAL_UNITS, "time", "supply_voltage"):
        parts = known.split("_")
        short = len(words) == len(parts) > 1 and all(
            len(word) > 2 and part.startswith(word) for word, part in zip(words, parts, strict=True)
        )
        if short or _one_slip(name, known):
            return known if name != known and not any(map(str.isdigit, name)) else ""
    return ""


def _one_slip(name: str, known: str) -> bool:
    """Whether one letter more, less or other, or two exchanged, make ``known`` of ``name``."""
    differ = (at for at in range(len(name)) if name[at] != known[at : at + 1])
    at = next(differ, len(name))
    one, other = name[at:], known[at:]
    return other[1:] in {one, one[1:]} or other == one[1:] or other == one[1::-1] + one[2:]


# Format -> signal -> (source, unit) that every log of the format has, so that [signals] need not name them.
STANDARD_SOURCES: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "bin": {"heading": ("ATT.Yaw", "deg"), "roll": ("ATT.Roll", "deg"), "pitch": ("ATT.Pitch", "deg")},
    "tlog": {"heading": ("ATTITUDE.yaw", "rad"), "roll": ("ATTITUDE.roll", "rad"), "pitch": ("ATTITUDE.pitch", "rad")},
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
    #: m ahead and to starboard of the origin, where the sensor measures; of the coupled model. None where not given.
    position: tuple[float, float] | None = None

    def __str__(self) -> str:
        """Sources, unit and sense; stored in parameter files, so its wording must not change."""
        places = [f"{kind} {source}" for kind, source in self.sources.items()]
        further = [*filter(None, [self.unit]), *["turned around"] * (self.factor < 0.0)]
        if self.position is not None and any(self.position):
            further.append(f"at {self.position[0]:g} m ahead and {self.position[1]:g} m to starboard")
        return ", ".join([*places, *further])

    @property
    def is_geodetic(self) -> bool:
        """Whether it is a latitude or a longitude."""
        return self.name in {"north", "east"} and self.unit in GEODETIC_UNITS

    def for_format(self, kind: str) -> Self:
        """The signal with a source for ``kind``, taken from the format that shares its sources."""
        other = SHARED_SOURCES.get(kind, kind)
        return replace(self, sources={kind: self.sources[other], **self.sources}) if other in self.sources else self


def word_set(text: str) -> frozenset[str]:
    """The words of ``text``."""
    return frozenset(text.split())


# Words in the names of columns: of clocks, of headings, of yaw rates; and words of durations that are no clock.
CLOCK_WORDS = word_set(
    """time t stamp timestamp seconds zeit utc elapsed datetime zeitstempel uhrzeit horodatage temps heure tiempo fecha
    hora tid klokkeslett tidsstempel tempo orario ora"""
)
HEADING_WORDS = word_set(
    """heading hdg hdt hdm yaw psi compass kurs steuerkurs kompass gier gierwinkel cap lacet azimuth azimut rumbo
    guinada guiñada gir girvinkel stevning prua bussola"""
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
