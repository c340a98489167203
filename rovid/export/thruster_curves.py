"""Thrust curves that include the memoryless effects, and the lag in front of or behind them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.formatting import identifiers, xml_comment
from rovid.effects import Effect
from rovid.effects.actuator_inputs import neutral_commands
from rovid.effects.thruster_imbalance import thruster_of
from rovid.model.actuator_model import ActuatorModel, CommandSeries
from rovid.model.bound_effects import BoundEffect
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Memoryless effects between the command and the thrust of one thruster.
_CURVE_EFFECTS = ("thruster_deadband", "thrust_asymmetry", "thrust_curve_shape", "thruster_imbalance")
# Number of points before simplification, and its tolerance relative to the largest thrust; not visible in the rate.
_POINTS, _TOLERANCE = 2001, 1e-5
# Names that simulators use for parts of their own; the link of a thruster is its name with "_link".
_RESERVED = ("base", "base_link", "bias_torque", "yaw")
# Keys of the lag of the thrust, behind the curve, and of the command, in front of the curve.
THRUST_LAG, COMMAND_LAG = "thruster_lag", "thruster_lag:command"


class ThrusterLag(NamedTuple):
    """First-order lag of all thrusters: time constant in s, and key of the effect; 0 and empty without a lag."""

    time_constant: float
    key: str

    @classmethod
    def of(cls, key: str, values: Mapping[str, float]) -> Self | None:
        """The lag of the effect ``key``; None for an effect that is no such lag."""
        return cls(values["time_constant"], key) if key in {THRUST_LAG, COMMAND_LAG} else None


NO_LAG = ThrusterLag(0.0, "")


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrusterCurve:
    """Steady thrust of one thruster over its command, memoryless effects included."""

    name: str
    identifier: str  #: Unique name for XML, YAML and topics.
    arm: float  #: m; torque = arm * thrust, positive where it turns the heading up.
    neutral: float  #: Command of no thrust.
    #: ``command``, ``thrust``: (m,) in the unit of the log, and in N (N m for a logged torque).
    command: FloatArray
    thrust: FloatArray
    #: 1 ahead and -1 astern in turn, as the places are not known; 0 for a logged torque, which has no thruster.
    side: int

    def __call__(self, command: FloatArray) -> FloatArray:
        """Thrust in N."""
        return np.interp(command, self.command, self.thrust)


class ThrusterUnit(NamedTuple):
    """A thruster in a simulator: it pushes from a place along a direction."""

    curve: ThrusterCurve
    x: float  #: m ahead.
    y: float  #: m to starboard.
    direction: float  #: rad, 0 ahead, positive to starboard.
    lever: tuple[float, float, float]  #: Force along surge and sway, and torque in yaw, of 1 N.

    @property
    def flu(self) -> tuple[str, str]:
        """Place and direction in FLU axes, both as x and y."""
        ahead, left = np.round((math.cos(self.direction), -math.sin(self.direction)), 15) + 0.0
        return f"{self.x:.10g} {0.0 - self.y:.10g}", f"{ahead:.10g} {left:.10g}"


def is_of_curve(effect: Effect) -> bool:
    """Whether a thrust curve represents the effect."""
    return effect.id in _CURVE_EFFECTS and thruster_of(effect.form) == effect.form


def thruster_curves(vehicle: Vehicle, limits: FloatArray, effects: Sequence[BoundEffect]) -> list[ThrusterCurve]:
    """Thrust curve of each thruster with the memoryless ``effects``, with no more points than necessary.

    ``limits``: (k, 2) smallest and largest command, of a thruster without a curve.
    """
    names = identifiers([thruster.name for thruster in vehicle.thrusters], taken=_RESERVED)
    neutral, actuators = neutral_commands(vehicle), ActuatorModel(tuple(effects))
    curves = []
    for index, thruster in enumerate(vehicle.thrusters):
        low, high = limits[index]
        command = np.unique([low, 0.0, high] if thruster.curve is None else thruster.curve.command)
        if effects:
            command = np.union1d(command, np.linspace(command.min(), command.max(), _POINTS))
        commands = np.tile(neutral, (len(command), 1))
        commands[:, index] = command
        trial = Trial.from_commands(np.arange(len(command), dtype=np.float64), commands)
        thrust = actuators.thrust(CommandSeries.from_trials(vehicle, [trial]))[:, index]
        kept = _corners(command, thrust)
        curves.append(
            ThrusterCurve(
                name=thruster.name,
                identifier=names[index],
                arm=thruster.arm,
                neutral=float(neutral[index]),
                command=command[kept],
                thrust=thrust[kept],
                side=0 if thruster.curve is None else 1 - 2 * (index % 2),
            )
        )
    return curves


class TrimShare(NamedTuple):
    """Constant thrust in N of one thruster, and the command for it; NaN beyond the ends of its curve."""

    thruster: str
    thrust: float
    command: float

    @property
    def text(self) -> str:
        """Thrust and command in words."""
        command = f"command {self.command:.4g}" if math.isfinite(self.command) else "beyond its curve"
        return f"{self.thrust:+.3g} N ({command})"


def constant_trim(thrusters: Sequence[ThrusterCurve], torque: float) -> list[TrimShare]:
    """The least change of all thrusts that cancels a constant ``torque`` in N m; empty without one."""
    curves = [one for one in thrusters if one.side and one.arm] if torque else []
    shares = []
    for curve in curves:
        # Least squares of the thrusts with the sum of arm times thrust equal to minus the torque.
        thrust = -torque * curve.arm / sum(one.arm**2 for one in curves)
        order = np.argsort(curve.thrust, kind="stable")
        command = np.interp(thrust, curve.thrust[order], curve.command[order], left=np.nan, right=np.nan)
        shares.append(TrimShare(curve.name, thrust, float(command)))
    return shares


def _corners(x: FloatArray, y: FloatArray) -> IntArray:
    """Rows between which (m,) ``y`` is linear: Ramer 1972, Douglas and Peucker 1973, by vertical distance."""
    tolerance = _TOLERANCE * max(float(np.max(np.abs(y))), 1e-300)
    kept, spans = {0, len(x) - 1}, [(0, len(x) - 1)]
    while spans:
        first, last = spans.pop()
        inside, ends = slice(first, last + 1), [first, last]
        distance = np.abs(y[inside] - np.interp(x[inside], x[ends], y[ends]))
        worst = first + int(np.argmax(distance))
        if last - first > 1 and distance.max() > tolerance:
            kept.add(worst)
            spans += [(first, worst), (worst, last)]
    return np.array(sorted(kept), dtype=np.intp)


def number_list(values: FloatArray) -> str:
    """Numbers separated by spaces."""
    return " ".join(f"{value:.10g}" for value in values)


def curve_comment(curve: ThrusterCurve) -> str:
    """A thrust curve as an XML comment for people and scripts."""
    return xml_comment(f"{curve.name}: command {number_list(curve.command)} | thrust {number_list(curve.thrust)}")


# ---- thrusters with a first-order lag in front of the curve, as in uuv_simulator and Stonefish


def thruster_inputs(curves: list[ThrusterCurve], lag: ThrusterLag) -> tuple[list[ThrusterCurve], str]:
    """Curves from input to thrust with zero input at rest, where the lag starts, and a note on the input.

    If thrust lags, behind the curve, the input is the steady thrust itself.
    """
    if lag.key != THRUST_LAG:
        inputs = [replace(curve, command=curve.command - curve.neutral, neutral=0.0) for curve in curves]
        return inputs, "The thrusters' input is the command less its neutral value."
    inputs = []
    for curve in curves:
        ends = np.array([min(float(curve.thrust.min()), 0.0), max(float(curve.thrust.max()), 0.0)])
        inputs.append(replace(curve, command=ends, thrust=ends, neutral=0.0))
    note = "The thrusters' input is the steady thrust in N, by the curves in the file: thrust lags, not command."
    return inputs, note
