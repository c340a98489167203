"""Checks of tables, blocks and values of a rovid.toml, and actuators of its blocks: motors, levers, rudders.

Each error names the place inside the file.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rovid.core.errors import NAME_LENGTH, ConfigError, join_words, suggestion
from rovid.core.input_files import expected_number
from rovid.trial.axis import AXES, DEFAULT_UNIT, PLANAR, SIGNAL_UNITS, TIME_UNITS, YAW, Axis, Signal
from rovid.trial.log_files import KINDS
from rovid.trial.tables import read_curve
from rovid.trial.vehicle import WATER_DENSITY, Rudder, Steering, ThrustCurve, Thruster

# Suffix of the key that marks a value as a guess of `rovid init`: yaw_arm_guessed.
GUESSED = "_guessed"
# Signals that depend on the place where they are measured.
_PLACED_SIGNALS = ("surge_velocity", "sway_velocity", "north", "east")


# Key of a motor's constant -> power of the command to which the thrust, or the torque, is proportional. A propeller's
# thrust is proportional to n|n| (Fossen 2011, eq. 9.8), a motor's torque to the current.
_CONSTANTS: Mapping[str, int] = {"thrust_constant": 2, "torque_constant": 1}
# Key of a motor's constant -> required keys of a thruster that the constant replaces.
_REPLACED: Mapping[str, tuple[str, ...]] = {"thrust_constant": ("curve",), "torque_constant": ("curve", "arm")}
_ARMS = tuple(axis.arm_key for axis in AXES.values())
_GEOMETRY_KEYS = ("position", "direction", "azimuth", "diameter")
_THRUSTER_KEYS = ("name", *_ARMS, "curve", "command", "outside", *(key + GUESSED for key in (*_ARMS, "curve")))
_THRUSTER_KEYS += (*_CONSTANTS, *(key + GUESSED for key in _CONSTANTS), "max_command", *_GEOMETRY_KEYS)
_RUDDER_KEYS: tuple[str, ...] = ("name", "angle", "coefficient", "wheelbase", "wheelbase_guessed", "speed")
_RUDDER_KEYS += ("position", "area", "lift", "behind", "slipstream", "stall")
# Keys of a thruster that the coupled model needs: one of them at least.
_PLANAR_LEVERS = ("surge", "sway", "yaw_arm")
# Levers below this, in shares or in m, are the rounding of cosines.
_ROUNDING = 1e-9
# 1/rad; slope of the lift of a rudder of aspect ratio 1.5: 6.13 a/(a + 2.25) (Fujii 1960). A fit begins there.
_LIFT_SLOPE = 2.45
_ANGLE = 'Add angle = { csv = "COLUMN", unit = "deg" }.'


class ConfigValues:
    """The file at ``path``, read along ``axis``; `PLANAR` stands for surge, sway and yaw together."""

    def __init__(self, path: Path, axis: Axis) -> None:
        self.path = path
        self.planar = axis is PLANAR
        self.axis = YAW if self.planar else axis

    def error(self, place: str, message: str, mend: str = "") -> ConfigError:
        """The error at this place of the file."""
        return ConfigError(message, where=f"{self.path}: {place}", mend=mend)

    def table(self, document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
        """The table of this name; empty where there is none."""
        value = document.get(name, {})
        if not isinstance(value, dict):
            raise self.error(name, f"is {value!r}; a table [{name}] was expected.")
        return value

    def blocks(self, document: Mapping[str, Any], name: str) -> list[Any]:
        """The blocks of this name."""
        value = document.get(name, [])
        if not isinstance(value, list):
            raise self.error(name, f"must be written [[{name}]], one block each.")
        return value

    def require_block(self, block: Any, name: str, place: str, keys: Sequence[str]) -> None:
        """Refuse all but a block with known ``keys``."""
        if not isinstance(block, dict):
            raise self.error(place, f"is {block!r}; a block [[{name}]] was expected.")
        self.require_known(block, keys, place)

    def require_known(self, table: Iterable[str], keys: Sequence[str], place: str) -> None:
        """Refuse unknown keys."""
        for key in table:
            if key not in keys:
                raise self.error(place, f"{key!r} is not known here.", suggestion(key, keys))

    def number(self, value: Any, place: str, *, positive: bool = False) -> float:
        """The value as a number."""
        expected = expected_number(value, positive=positive)
        if expected:
            raise self.error(place, f"is {value!r}; {expected} was expected.")
        return float(value)

    def name(self, value: Any, place: str) -> str:
        """The value as a name."""
        text = str(value)
        if len(text) > NAME_LENGTH:
            raise self.error(place, f"is a name of {len(text)} characters; {NAME_LENGTH} at most were expected.")
        return text

    def signal(self, name: str, value: Any, place: str, *, like: str = "") -> Signal:
        """The signal of this ``value``; in the units of the signal ``like`` if that is given."""
        entry = {"csv": value} if isinstance(value, str) else value
        if not isinstance(entry, dict) or not entry:
            raise self.error(place, f'is {value!r}; {{ csv = "<column>", mcap = "<topic.field>" }} was expected.')
        self.require_known(entry, (*KINDS, "unit", "sign", *["position"] * (name in _PLACED_SIGNALS)), place)
        position = self.place_of(entry, place) if "position" in entry else None
        for key, text in entry.items():
            if key not in {"sign", "position"} and not isinstance(text, str):
                raise self.error(f"{place} {key}", f"is {text!r}; text was expected.")
        sources = {key: text for key, text in entry.items() if key not in {"unit", "sign", "position"}}
        units, default = SIGNAL_UNITS.get(like or name), DEFAULT_UNIT.get(like or name, "")
        if name == "time":
            units, default = dict.fromkeys(TIME_UNITS, 1.0), "auto"
        unit = entry.get("unit", default)
        sign = self.number(entry.get("sign", 1), f"{place} sign")
        if abs(sign) != 1:
            raise self.error(f"{place} sign", f"is {sign:g}; 1 or -1 was expected.")
        if units is not None and unit not in units:
            raise self.error(f"{place} unit", f"is {unit!r}; one of {', '.join(units)} was expected.")
        factor = 1.0 if units is None else units[unit]
        return Signal(name=name, sources=sources, unit=unit, factor=sign * factor, position=position)

    def is_guessed(self, block: Mapping[str, Any], key: str, place: str) -> bool:
        """Whether a value is marked as a guess: by true, or by the guessed value as long as it is unchanged."""
        mark = block.get(key + GUESSED, False)
        if isinstance(mark, bool):
            return mark
        if isinstance(mark, str) is not isinstance(block[key], str):
            expected = f"the guessed value of {key}, true or false was expected."
            raise self.error(f"{place} {key}{GUESSED}", f"is {mark!r}; {expected}")
        return bool(mark == block[key])

    def require(self, block: Mapping[str, Any], key: str, place: str, mend: str) -> None:
        """Refuse a block without this key."""
        if key not in block:
            raise self.error(place, f"has no {key}.", mend)

    def refuse_both(self, block: Mapping[str, Any], key: str, others: Iterable[str], place: str) -> None:
        """Refuse a block that has one of the ``others`` next to ``key``."""
        if twice := [other for other in others if other in block]:
            raise self.error(place, f"has {key} and {twice[0]}; one of them was expected.", "Delete one.")

    def place_of(self, block: Mapping[str, Any], place: str) -> tuple[float, float]:
        """The ``position`` of a block in m."""
        pair = block["position"]
        if not isinstance(pair, list) or len(pair) != 2:
            text = f"is {pair!r}; two numbers in m were expected, ahead and to starboard."
            raise self.error(f"{place} position", text, "Write position = [-0.4, 0.2].")
        x, y = (self.number(number, f"{place} position") for number in pair)
        return x, y

    # Actuators: thrusters, motors without a bench curve, levers from place and direction, rudders.

    @property
    def example_arm(self) -> str:
        """Lever of a thruster, as a line for messages."""
        return f"{self.axis.arm_key} = {'0.43' if self.axis.angular else '1.0'}"

    def actuators(
        self, blocks: Sequence[Any], rudders: Sequence[Any], signals: dict[str, Signal]
    ) -> tuple[list[Thruster], list[Signal]]:
        """Actuators along the axis and their commands; a logged drive is removed from ``signals``."""
        pairs: list[tuple[Thruster, Signal]] = []
        diameters: dict[str, float | None] = {}  # Of the propellers, in m; None where not given.
        for index, block in enumerate(blocks):
            pairs += self.thruster(index, block)
            name = str(block.get("name", f"thruster_{index + 1}"))
            place = f"[[thrusters]] {name!r} diameter"
            diameters[name] = self.number(block["diameter"], place, positive=True) if "diameter" in block else None
        for index, block in enumerate(rudders):
            place = f"[[rudders]] number {index + 1}"
            self.require_block(block, "rudders", place, _RUDDER_KEYS)
            name = self.name(block.get("name", f"rudder_{index + 1}"), f"{place} name")
            one = self.planar_rudder(block, name, diameters) if self.planar else self.steered(block, name, signals)
            angle = self.signal(f"command.{name}", block["angle"], f"[[rudders]] {name!r} angle", like="heading")
            pairs.append((one, angle))
        if (drive := self.logged_drive(signals, alone=not pairs)) is not None:
            pairs = [(drive, signals.pop(drive.name))]
        return [thruster for thruster, _ in pairs], [command for _, command in pairs]

    def thruster(self, index: int, block: Mapping[str, Any]) -> list[tuple[Thruster, Signal]]:
        """The thruster and its command, and its azimuth angle; nothing if it does not act along the axis."""
        place = f"[[thrusters]] number {index + 1}"
        self.require_block(block, "thrusters", place, _THRUSTER_KEYS)
        name = self.name(block.get("name", f"thruster_{index + 1}"), f"{place} name")
        place = f"[[thrusters]] {name!r}"
        block = self.with_levers(block, place)
        # Keys of a thruster, one of which it has if it acts along the axis.
        levers = _PLANAR_LEVERS if self.planar else (self.axis.arm_key,)
        acts = [key for key in levers if key in block]
        if not acts and any(other in block for other in _ARMS):
            return []
        # Key of the motor's constant; empty where the block has none.
        constant, arm_key = next((key for key in _CONSTANTS if key in block), ""), self.axis.arm_key
        replaced = _REPLACED.get(constant, ())
        if not acts and "arm" not in replaced:
            expected = " or ".join([", ".join(levers[:-1]), levers[-1]][not levers[:-1] :])
            raise self.error(place, f"has no {expected}.", f"Add {self.example_arm}.")
        for key, example in {"curve": '"thrust_curve.csv"', "command": '{ csv = "…" }'}.items():
            if key not in replaced:
                self.require(block, key, place, f"Add {key} = {example}.")
        outside = block.get("outside", "refuse")
        if outside not in {"refuse", "clamp"}:
            raise self.error(f"{place} outside", f'is {outside!r}; "refuse" or "clamp" was expected.')
        lever = {key: self.number(block.get(key, 0.0), f"{place} {key}") for key in (*_PLANAR_LEVERS, arm_key)}
        if constant:
            curve = self.motor_curve(block, constant, place)
        else:
            given = block["curve"]
            curve = given if isinstance(given, ThrustCurve) else read_curve(self.path.parent / str(given))
        guessed = [key for key in ([constant] if constant else acts) if self.is_guessed(block, key, place)]
        scale_key = constant if constant == "torque_constant" or self.planar else ""
        if self.planar and not scale_key:
            scale_key = join_words(guessed)
        thruster = Thruster(
            name=name,
            clamp=outside == "clamp",
            arm=lever[arm_key] if arm_key in block or acts else 1.0,
            curve=curve,
            scale_key=scale_key,
            surge_share=lever["surge"],
            sway_share=lever["sway"] if self.planar else 0.0,
            position=self.place_of(block, place) if "position" in block else None,
            arm_guessed=bool(guessed),
            curve_guessed=not constant and self.is_guessed(block, "curve", place),
        )
        pairs = [(thruster, self.signal(f"command.{name}", block["command"], f"{place} command"))]
        if "azimuth" in block:
            # The actuator whose command is the azimuth angle.
            turning = Thruster(name=f"{name}.azimuth", arm=0.0, curve=None, turns=name)
            angle = self.signal(f"command.{turning.name}", block["azimuth"], f"{place} azimuth", like="heading")
            pairs.append((turning, angle))
        return pairs

    def require_actuators(self, blocks: Sequence[Any], thrusters: Sequence[Thruster]) -> None:
        """Refuse a vehicle without actuators, and two of one name."""
        place, axis = "[[thrusters]]", self.axis
        # A self-righting vehicle can be released from a tilt, without a thruster.
        if not thrusters and not axis.self_righting:
            if not blocks:
                raise self.error(place, f"there are none, and no {axis.force_name} is mapped in [signals].")
            raise self.error(place, f"none has {axis.arm_key}.", f"Add {self.example_arm}.")
        names = [thruster.name for thruster in thrusters]
        if len(set(names)) < len(names):
            raise self.error(place, f"two have the same name among {names}.", "Name each differently.")

    def motor_curve(self, block: Mapping[str, Any], key: str, place: str) -> ThrustCurve:
        """Curve of a motor with the constant ``key``, up to ``max_command`` in both directions.

        Raises ConfigError if the block has a curve, too, or no ``max_command``.
        """
        others = {"torque_constant": ("curve", "thrust_constant", self.axis.arm_key)}
        self.refuse_both(block, key, others.get(key, ("curve", "torque_constant")), place)
        if "max_command" not in block:
            mend = "Add max_command = the largest command in the unit of the log, for example 3000 for rpm or 5 for A."
            raise self.error(place, f"has {key} and no max_command, the largest command for which it holds.", mend)
        constant = self.number(block[key], f"{place} {key}", positive=key == "thrust_constant")
        most = self.number(block["max_command"], f"{place} max_command", positive=True)
        return ThrustCurve.proportional(constant, most, _CONSTANTS[key])

    def steered(self, block: Mapping[str, Any], name: str, signals: Collection[str]) -> Thruster:
        """A rudder, or the steered wheels of a vehicle; one of ``signals`` is the speed.

        Raises ConfigError if both of ``coefficient`` and ``wheelbase`` are given, or there is no angle or no speed.
        """
        place = f"[[rudders]] {name!r}"
        if self.axis.name != "yaw":
            raise self.error(place, f"acts in yaw and not in {self.axis.name}.", "Leave --axis out.")
        self.require(block, "angle", place, _ANGLE)
        if "coefficient" in block and "wheelbase" in block:
            text = "has a coefficient, as a rudder, and a wheelbase, as steered wheels; one of them was expected."
            raise self.error(place, text, "Delete one.")
        speed = str(block.get("speed", "surge_velocity"))
        if speed not in signals:
            mend = f'Add {speed} = {{ csv = "COLUMN" }} to [signals], or name another signal with speed = "NAME".'
            if {"north", "surge_velocity"} & {*signals}:
                mend += " `--axes planar` estimates the speed from what is logged."
            raise self.error(place, f"needs the speed {speed}, which is not in [signals].", mend)
        wheels = "wheelbase" in block
        key = "wheelbase" if wheels else "coefficient"
        size = self.number(block.get(key, 1.0), f"{place} {key}", positive=wheels)
        if not size:
            raise self.error(f"{place} {key}", "is 0; another number was expected.")
        steering = Steering(speed=speed, size=size, wheels=wheels)
        one = Thruster(name=name, arm=1.0, curve=None, scale_key=key, steering=steering, is_rate_order=wheels)
        return replace(one, arm_guessed=key not in block or self.is_guessed(block, key, place))

    def logged_drive(self, signals: Collection[str], *, alone: bool) -> Thruster | None:
        """The drive that one of ``signals`` is: a torque, a force, or the order to a rate controller.

        Raises ConfigError if there are two, or there are other actuators, too.
        """
        axis = self.axis
        names = [name for name in (axis.force_name, axis.rate_signal + "_order") if name in signals]
        if not names:
            return None
        if not alone or len(names) > 1:
            others = "[[thrusters]]" if not alone else names[1]
            text = f"is given in addition to {others}; the {axis.force_name} must come from one of them."
            raise self.error(f"[signals] {names[0]}", text, "Delete one.")
        if self.planar and names[0] != axis.force_name:
            text = "is an order to a controller; surge, sway and yaw together need thrusters or rudders."
            raise self.error(f"[signals] {names[0]}", text, "Leave --axes planar out.")
        return Thruster(name=names[0], arm=1.0, curve=None, is_rate_order=names[0] != axis.force_name)

    def with_levers(self, block: Mapping[str, Any], place: str) -> Mapping[str, Any]:
        """The ``block`` of a thruster with ``surge``, ``sway`` and ``yaw_arm`` in place of position and direction.

        surge = cos(direction), sway = sin(direction), yaw_arm = x sway - y surge (Fossen 2011, eq. 12.230). A lever of
        zero is left out. Raises ConfigError if the same lever is given twice, or not at all.
        """
        given = [key for key in _GEOMETRY_KEYS if key in block]
        if not given:
            return block
        levers: dict[str, float] = {}
        if "azimuth" in block and not self.planar:
            text = "turns the thrust, which a single axis cannot follow."
            raise self.error(f"{place} azimuth", text, "Give --axes planar.")
        if "azimuth" in block and "position" not in block:
            mend = "Add position = [x, y] in m, x ahead and y to starboard."
            raise self.error(place, "has an azimuth and no position.", mend)
        if "direction" in block or "azimuth" in block:
            self.refuse_both(block, "direction" if "direction" in block else "azimuth", ("surge", "sway"), place)
            direction = math.radians(self.number(block.get("direction", 0.0), f"{place} direction"))
            levers = {"surge": math.cos(direction), "sway": math.sin(direction)}
        if "position" in block:
            self.refuse_both(block, "position", ("yaw_arm",), place)
            if not levers and not {"surge", "sway"} & block.keys():
                mend = "Add direction = 0 for thrust ahead, in deg, positive to starboard."
                raise self.error(place, "has a position and no direction.", mend)
            x, y = self.place_of(block, place)
            known = {key: self.number(block.get(key, 0.0), f"{place} {key}") for key in ("surge", "sway")} | levers
            levers["yaw_arm"] = x * known["sway"] - y * known["surge"]
        return {**block, **{key: value for key, value in levers.items() if abs(value) > _ROUNDING}}

    def planar_rudder(self, block: Mapping[str, Any], name: str, diameters: Mapping[str, float | None]) -> Thruster:
        """A rudder of the coupled model; ``diameters`` are those of the thrusters' propellers in m, None where unknown.

        Raises ConfigError if there is no angle or no position, no thruster of the name ``behind``, or the block
        describes steered wheels.
        """
        place = f"[[rudders]] {name!r}"
        self.require(block, "angle", place, _ANGLE)
        if "wheelbase" in block:
            words = "is steered wheels, which surge, sway and yaw together do not have."
            raise self.error(place, words, "Leave --axes planar out.")
        mend = "Add position = [x, y] in m from the origin, x ahead (aft is negative) and y to starboard."
        self.require(block, "position", place, mend)
        x, y = self.place_of(block, place)
        numbers = {
            key: self.number(block[key], f"{place} {key}", positive=key != "coefficient")
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
            raise self.error(f"{place} behind", text)
        slipstream, diameter = numbers.get("slipstream"), diameters.get(behind)
        if slipstream is None and diameter is not None:
            # Momentum theory: the square of the speed far behind a propeller grows by 2 T/(rho A).
            slipstream = 2.0 / (WATER_DENSITY * 0.25 * math.pi * diameter**2)
        stall = math.radians(numbers["stall"]) if "stall" in numbers else None
        rudder = Rudder(position=(x, y), lift=lift, behind=behind, slipstream=slipstream, stall=stall)
        # In place of a torque, which depends on the speed: its sense, for detectors of faults.
        return Thruster(name=name, arm=-x * (lift or 1.0), curve=None, rudder=rudder)
