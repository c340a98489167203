"""Drives without a bench curve, levers of actuators from their place and direction, and rudders."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from rovid.trial.config_values import ConfigValues
from rovid.trial.hull import WATER_DENSITY
from rovid.trial.vehicle import Rudder, Steering, ThrustCurve, Thruster

# Key of a motor's constant -> power of the command to which the thrust, or the torque, is proportional. A propeller's
# thrust is proportional to n|n| (Fossen 2011, eq. 9.8), a motor's torque to the current.
CONSTANTS: Mapping[str, int] = {"thrust_constant": 2, "torque_constant": 1}
# Key of a motor's constant -> required keys of a thruster that the constant replaces.
REPLACED: Mapping[str, tuple[str, ...]] = {"thrust_constant": ("curve",), "torque_constant": ("curve", "arm")}
MOTOR_KEYS = (*CONSTANTS, *(f"{key}_guessed" for key in CONSTANTS), "max_command")
RUDDER_KEYS = ("name", "angle", "coefficient", "wheelbase", "wheelbase_guessed", "speed")
# Suffix of the signal that is the order of a rate controller: yaw_rate_order.
ORDER_SUFFIX = "_order"
_ANGLE = 'Add angle = { csv = "COLUMN", unit = "deg" }.'


def constant_of(block: Mapping[str, Any]) -> str:
    """Key of the motor's constant in a block of [[thrusters]]; empty where the block has none."""
    return next((key for key in CONSTANTS if key in block), "")


def motor_curve(block: Mapping[str, Any], place: str, parser: ConfigValues) -> ThrustCurve:
    """Curve of a motor with a constant, up to ``max_command`` in both directions.

    Raises ConfigError if the block has a curve, too, or no ``max_command``.
    """
    key = constant_of(block)
    others = [other for other in ("curve", *CONSTANTS) if other != key]
    if key == "torque_constant":
        others.append(parser.axis.arm_key)
    parser.refuse_both(block, key, others, place)
    if "max_command" not in block:
        mend = "Add max_command = the largest command in the unit of the log, for example 3000 for rpm or 5 for A."
        raise parser.error(place, f"has {key} and no max_command, the largest command for which it holds.", mend)
    constant = parser.number(block[key], f"{place} {key}", positive=key == "thrust_constant")
    most = parser.number(block["max_command"], f"{place} max_command", positive=True)
    return ThrustCurve.proportional(constant, most, CONSTANTS[key])


def steered(block: Mapping[str, Any], name: str, signals: Collection[str], parser: ConfigValues) -> Thruster:
    """A rudder, or the steered wheels of a vehicle; one of ``signals`` is the speed.

    Raises ConfigError if both of ``coefficient`` and ``wheelbase`` are given, or there is no angle or no speed.
    """
    place = f"[[rudders]] {name!r}"
    if parser.axis.name != "yaw":
        raise parser.error(place, f"acts in yaw and not in {parser.axis.name}.", "Leave --axis out.")
    parser.require(block, "angle", place, _ANGLE)
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
    steering = Steering(speed=speed, size=size, wheels=wheels)
    arm_guessed = key not in block or parser.is_guessed(block, key, place)
    return Thruster(
        name=name, arm=1.0, curve=None, scale_key=key, steering=steering, is_rate_order=wheels, arm_guessed=arm_guessed
    )


def logged_drive(signals: Collection[str], parser: ConfigValues, *, alone: bool) -> Thruster | None:
    """The drive that one of ``signals`` is: a torque, a force, or the order to a rate controller.

    Raises ConfigError if there are two, or there are other actuators, too.
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


GEOMETRY_KEYS = ("position", "direction", "azimuth", "diameter")
RUDDER_GEOMETRY_KEYS = ("position", "area", "lift", "behind", "slipstream", "stall")
# Keys of a thruster that the coupled model needs: one of them at least.
PLANAR_LEVERS = ("surge", "sway", "yaw_arm")
# Levers below this, in shares or in m, are the rounding of cosines.
_ROUNDING = 1e-9
# 1/rad; slope of the lift of a rudder of aspect ratio 1.5: 6.13 a/(a + 2.25) (Fujii 1960). A fit begins there.
_LIFT_SLOPE = 2.45


def with_levers(block: Mapping[str, Any], place: str, parser: ConfigValues) -> Mapping[str, Any]:
    """The ``block`` of a thruster with ``surge``, ``sway`` and ``yaw_arm`` in place of position and direction.

    surge = cos(direction), sway = sin(direction), yaw_arm = x sway - y surge (Fossen 2011, eq. 12.230). A lever of zero
    is left out. Raises ConfigError if the same lever is given twice, or not at all.
    """
    given = [key for key in GEOMETRY_KEYS if key in block]
    if not given:
        return block
    levers: dict[str, float] = {}
    if "azimuth" in block and not parser.planar:
        text = "turns the thrust, which a single axis cannot follow."
        raise parser.error(f"{place} azimuth", text, "Give --axes planar.")
    if "azimuth" in block and "position" not in block:
        mend = "Add position = [x, y] in m, x ahead and y to starboard."
        raise parser.error(place, "has an azimuth and no position.", mend)
    if "direction" in block or "azimuth" in block:
        parser.refuse_both(block, "direction" if "direction" in block else "azimuth", ("surge", "sway"), place)
        direction = math.radians(parser.number(block.get("direction", 0.0), f"{place} direction"))
        levers = {"surge": math.cos(direction), "sway": math.sin(direction)}
    if "position" in block:
        parser.refuse_both(block, "position", ("yaw_arm",), place)
        if not levers and not {"surge", "sway"} & block.keys():
            mend = "Add direction = 0 for thrust ahead, in deg, positive to starboard."
            raise parser.error(place, "has a position and no direction.", mend)
        x, y = parser.place_of(block, place)
        known = {key: parser.number(block.get(key, 0.0), f"{place} {key}") for key in ("surge", "sway")} | levers
        levers["yaw_arm"] = x * known["sway"] - y * known["surge"]
    return {**block, **{key: value for key, value in levers.items() if abs(value) > _ROUNDING}}


def propeller_diameters(blocks: Sequence[Any], parser: ConfigValues) -> dict[str, float | None]:
    """Propeller diameter in m of each of [[thrusters]] by name; None where it is not given."""
    found: dict[str, float | None] = {}
    for index, block in enumerate(blocks):
        name = str(block.get("name", f"thruster_{index + 1}"))
        place = f"[[thrusters]] {name!r} diameter"
        found[name] = parser.number(block["diameter"], place, positive=True) if "diameter" in block else None
    return found


def planar_rudder(
    block: Mapping[str, Any], name: str, diameters: Mapping[str, float | None], parser: ConfigValues
) -> Thruster:
    """A rudder of the coupled model; ``diameters`` are those of the thrusters' propellers in m, None where unknown.

    Raises ConfigError if there is no angle or no position, no thruster of the name ``behind``, or the block describes
    steered wheels.
    """
    place = f"[[rudders]] {name!r}"
    parser.require(block, "angle", place, _ANGLE)
    if "wheelbase" in block:
        words = "is steered wheels, which surge, sway and yaw together do not have."
        raise parser.error(place, words, "Leave --axes planar out.")
    mend = "Add position = [x, y] in m from the origin, x ahead (aft is negative) and y to starboard."
    parser.require(block, "position", place, mend)
    x, y = parser.place_of(block, place)
    numbers = {
        key: parser.number(block[key], f"{place} {key}", positive=key != "coefficient")
        for key in ("area", "lift", "coefficient", "slipstream", "stall")
        if key in block
    }
    lift = numbers.get("lift")
    if lift is None and "area" in numbers:
        lift = 0.5 * WATER_DENSITY * numbers["area"] * _LIFT_SLOPE
    if lift is None and "coefficient" in numbers and x:
        lift = abs(numbers["coefficient"] / x)
    behind = str(block.get("behind", ""))
    if behind and behind not in diameters:
        text = f"is {behind!r}; the name of a thruster was expected: {', '.join(diameters) or 'there is none'}."
        raise parser.error(f"{place} behind", text)
    slipstream, diameter = numbers.get("slipstream"), diameters.get(behind)
    if slipstream is None and diameter is not None:
        # Momentum theory: the square of the speed far behind a propeller grows by 2 T/(rho A).
        slipstream = 2.0 / (WATER_DENSITY * 0.25 * math.pi * diameter**2)
    stall = math.radians(numbers["stall"]) if "stall" in numbers else None
    rudder = Rudder(position=(x, y), lift=lift, behind=behind, slipstream=slipstream, stall=stall)
    # In place of a torque, which depends on the speed: its sense, for detectors of faults.
    return Thruster(name=name, arm=-x * (lift or 1.0), curve=None, rudder=rudder)
