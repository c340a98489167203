"""Drives without a bench curve: motors with a constant, rudders, steered wheels, and orders to a rate controller."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Protocol

from rovid.core.errors import ConfigError
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Steering, ThrustCurve, Thruster

# Key of a motor's constant -> power of the command to which the thrust, or the torque, is proportional. A propeller's
# thrust is proportional to n|n| (Fossen 2011, eq. 9.8), a motor's torque to the current.
CONSTANTS: Mapping[str, int] = {"thrust_constant": 2, "torque_constant": 1}
# Key of a motor's constant -> required keys of a thruster that the constant replaces.
REPLACED: Mapping[str, tuple[str, ...]] = {"thrust_constant": ("curve",), "torque_constant": ("curve", "arm")}
MOTOR_KEYS = (*CONSTANTS, *(f"{key}_guessed" for key in CONSTANTS), "max_command")
RUDDER_KEYS = ("name", "angle", "coefficient", "wheelbase", "wheelbase_guessed", "speed")
# Suffix of the signal that is the order of a rate controller: yaw_rate_order.
ORDER_SUFFIX = "_order"


class ValueParser(Protocol):
    """Checks of single values in rovid.toml."""

    axis: Axis
    planar: bool  #: Whether surge, sway and yaw are read together.

    def error(self, place: str, message: str, mend: str = "") -> ConfigError:
        """The error at this place of the file."""

    def is_guessed(self, block: Mapping[str, Any], key: str, place: str) -> bool:
        """Whether the value is an unconfirmed guess of `rovid init`."""

    def number(self, value: Any, place: str, *, positive: bool = False) -> float:
        """The value as a number."""


def constant_of(block: Mapping[str, Any]) -> str:
    """Key of the motor's constant in a block of [[thrusters]]; empty where the block has none."""
    return next((key for key in CONSTANTS if key in block), "")


def motor_curve(block: Mapping[str, Any], place: str, parser: ValueParser) -> ThrustCurve:
    """Curve of a motor with a constant, up to ``max_command`` in both directions.

    Raises
    ------
    ConfigError
        The block has a curve, too, or no ``max_command``.
    """
    key = constant_of(block)
    unwanted = [other for other in ("curve", *CONSTANTS) if other != key and other in block]
    if key == "torque_constant" and parser.axis.arm_key in block:
        unwanted.append(parser.axis.arm_key)
    if unwanted:
        raise parser.error(place, f"has {key} and {unwanted[0]}; one of them was expected.", "Delete one.")
    if "max_command" not in block:
        mend = "Add max_command = the largest command in the unit of the log, for example 3000 for rpm or 5 for A."
        raise parser.error(place, f"has {key} and no max_command, the largest command for which it holds.", mend)
    constant = parser.number(block[key], f"{place} {key}", positive=key == "thrust_constant")
    most = parser.number(block["max_command"], f"{place} max_command", positive=True)
    return ThrustCurve.proportional(constant, most, CONSTANTS[key])


def steered(block: Mapping[str, Any], name: str, signals: Collection[str], parser: ValueParser) -> Thruster:
    """A rudder, or the steered wheels of a vehicle; one of ``signals`` is the speed.

    Raises
    ------
    ConfigError
        Both of ``coefficient`` and ``wheelbase`` are given, or there is no angle or no speed.
    """
    place = f"[[rudders]] {name!r}"
    if parser.axis.name != "yaw":
        raise parser.error(place, f"acts in yaw and not in {parser.axis.name}.", "Leave --axis out.")
    if "angle" not in block:
        raise parser.error(place, "has no angle.", 'Add angle = { csv = "COLUMN", unit = "deg" }.')
    if "coefficient" in block and "wheelbase" in block:
        text = "has a coefficient, as a rudder, and a wheelbase, as steered wheels; one of them was expected."
        raise parser.error(place, text, "Delete one.")
    speed = str(block.get("speed", "surge_velocity"))
    if speed not in signals:
        mend = f'Add {speed} = {{ csv = "COLUMN" }} to [signals], or name another signal with speed = "NAME".'
        raise parser.error(place, f"needs the speed {speed}, which is not in [signals].", mend)
    wheels = "wheelbase" in block
    key = "wheelbase" if wheels else "coefficient"
    size = parser.number(block.get(key, 1.0), f"{place} {key}", positive=wheels)
    if not size:
        raise parser.error(f"{place} {key}", "is 0; another number was expected.")
    return Thruster(
        name=name,
        arm=1.0,
        curve=None,
        scale_key=key,
        steering=Steering(speed=speed, size=size, wheels=wheels),
        is_rate_order=wheels,
        arm_guessed=key not in block or parser.is_guessed(block, key, place),
    )


def logged_drive(signals: Collection[str], parser: ValueParser, *, alone: bool) -> Thruster | None:
    """The drive that one of ``signals`` is: a torque, a force, or the order to a rate controller.

    Raises
    ------
    ConfigError
        There are two, or there are other actuators, too.
    """
    axis = parser.axis
    names = [name for name in (axis.force_name, axis.rate_signal + ORDER_SUFFIX) if name in signals]
    if not names:
        return None
    if not alone or len(names) > 1:
        others = "[[thrusters]]" if not alone else names[1]
        text = f"is given in addition to {others}; the {axis.force_name} must come from one of them."
        raise parser.error(f"[signals] {names[0]}", text, "Delete one.")
    if parser.planar and names[0] != axis.force_name:
        text = "is an order to a controller; surge, sway and yaw together need thrusters or rudders."
        raise parser.error(f"[signals] {names[0]}", text, "Leave --axes planar out.")
    return Thruster(name=names[0], arm=1.0, curve=None, is_rate_order=names[0] != axis.force_name)
