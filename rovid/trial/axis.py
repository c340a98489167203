"""Degrees of freedom: the signals that measure each of them, and their units."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

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

    def __reduce__(self) -> tuple[Callable[[str], Axis], tuple[str]]:
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
        if self.angular:
            return self.position_signal
        return f"{self.position_signal} or {self.rate_signal}"

    @property
    def motion_verb(self) -> str:
        """Verb for a motion along the axis."""
        if self.angular:
            return "turns"
        return "moves"

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
        if position is None:
            return None
        return position * self.display_unit[1]

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
