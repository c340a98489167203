"""The degrees of freedom: what each is measured by, and in what units."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from rovid.core.errors import ConfigError, suggestion


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One degree of freedom, in body axes (SNAME 1950): x forward, y to starboard, z down.

    Attributes
    ----------
    positions
        Signals in rovid.toml that measure the position along it, any of which will do. Its sense is that in which
        this signal grows.
    rate
        The signal that measures its rate.
    arm
        Key of a thruster's lever in rovid.toml: m for an angle, the share of the thrust along it otherwise.
    fixes
        Signals that tell the position together: where on the map the vehicle is, and its heading.
    angular
        Whether it is an angle.
    rights
        Whether gravity brings the vehicle back, so that a constant torque tilts it and no more.
    """

    name: str
    position_signals: tuple[str, ...]
    rate_signal: str
    arm_key: str
    angular: bool
    fix_signals: tuple[str, ...] = ()
    self_righting: bool = False

    def __reduce__(self) -> tuple[Callable[[str], Axis], tuple[str]]:
        # There is one of each, wherever it goes.
        return axis_named, (self.name,)

    @property
    def position_signal(self) -> str:
        """What the position is called, in text and in keys of JSON."""
        return self.position_signals[0]

    @property
    def position_words(self) -> str:
        """As ``position``, for people."""
        return self.position_signal.replace("_", " ")

    @property
    def rate_words(self) -> str:
        """As ``rate``, for people."""
        return self.rate_signal.replace("_", " ")

    @property
    def required_signals(self) -> str:
        """Keys of rovid.toml that hold what is measured, for messages."""
        if self.angular:
            return self.position_signal
        return f"{self.position_signal} or {self.rate_signal}"

    @property
    def motion_verb(self) -> str:
        """What a vehicle does that goes along it."""
        return "turns" if self.angular else "moves"

    @property
    def force_name(self) -> str:
        """What drives it."""
        return "torque" if self.angular else "force"

    @property
    def rate_unit(self) -> str:
        """Unit of the rate."""
        return self.unit("rad/s")

    @property
    def force_unit(self) -> str:
        """Unit of what drives it."""
        return self.unit("N m")

    def reword(self, text: str) -> str:
        """``text`` that was written of a torque."""
        return text.replace("torque", self.force_name)

    @property
    def display_unit(self) -> tuple[str, float]:
        """Unit in which people read positions, and how many of it are one of SI."""
        return ("deg", 180.0 / math.pi) if self.angular else ("m", 1.0)

    def to_display(self, position: float | None) -> float | None:
        """A position in SI in the unit in which people read it."""
        return None if position is None else position * self.display_unit[1]

    def measured_quantity(self, *, integrated: bool) -> tuple[str, str, float]:
        """Name of what is measured, the unit in which people read it, and how many of it are one of SI.

        ``integrated`` where that is the rate alone.
        """
        if integrated:
            return self.rate_words, self.rate_unit, 1.0
        return self.position_words, *self.display_unit

    def unit(self, angular: str) -> str:
        """The unit along this axis of what has the unit ``angular`` in yaw.

        Frequencies have to be left out: theirs is rad/s along any axis.
        """
        if self.angular:
            return angular
        for turning, straight in _STRAIGHT.items():
            angular = angular.replace(turning, straight)
        return angular


# In this order: a torque over an angle loses its metre first.
_STRAIGHT: Mapping[str, str] = {"kg m^2": "kg", "kg m²": "kg", "N m": "N", "(N)^": "N^", "rad": "m", "deg": "m"}

YAW = Axis(name="yaw", position_signals=("heading",), rate_signal="yaw_rate", arm_key="yaw_arm", angular=True)


def _level(name: str) -> Axis:
    """Surge or sway."""
    return Axis(
        name=name,
        position_signals=(f"{name}_position",),
        rate_signal=f"{name}_velocity",
        arm_key=name,
        angular=False,
        fix_signals=("north", "east", "heading"),
    )


def _tilt(name: str) -> Axis:
    """Roll or pitch."""
    return Axis(
        name=name,
        position_signals=(name,),
        rate_signal=f"{name}_rate",
        arm_key=f"{name}_arm",
        angular=True,
        self_righting=True,
    )


AXES: Mapping[str, Axis] = {
    "yaw": YAW,
    "surge": _level("surge"),
    "sway": _level("sway"),
    "heave": Axis(
        name="heave",
        position_signals=("depth", "heave_position"),
        rate_signal="heave_velocity",
        arm_key="heave",
        angular=False,
    ),
    "roll": _tilt("roll"),
    "pitch": _tilt("pitch"),
}


# What people call them besides -> axis.
_ALSO = {"heading": "yaw", "ahead": "surge", "sideways": "sway", "depth": "heave", "heel": "roll", "trim": "pitch"}


def axis_named(name: str) -> Axis:
    """The axis of this name.

    Raises
    ------
    ConfigError
        There is none.
    """
    if name not in AXES:
        raise ConfigError(
            f"is {name!r}; one of {', '.join(AXES)} was expected.", where="--axis", mend=suggestion(name, AXES, _ALSO)
        )
    return AXES[name]


def other_axes(signals: Collection[str], keys: Collection[str]) -> list[str]:
    """Names of the axes but yaw that a rovid.toml is about.

    One of its ``signals`` measures the motion along them, and a force or one of its thrusters, whose ``keys`` name
    their levers, drives it; where there are no thrusters, gravity may.
    """
    found = []
    for axis in AXES.values():
        fixed = bool(axis.fix_signals) and set(axis.fix_signals) <= set(signals)
        measured = fixed or not {*axis.position_signals, axis.rate_signal}.isdisjoint(signals)
        pushed = axis.arm_key in keys or axis.force_name in signals
        swings = axis.self_righting and not keys
        if axis is not YAW and measured and (pushed or swings):
            found.append(axis.name)
    return found
