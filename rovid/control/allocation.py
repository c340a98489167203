"""From torque to commands: the inverse of what the thrusters give, held long enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import ActuatorInputs, neutral_commands
from rovid.effects.actuator_inputs import actuator_inputs as actuation_of
from rovid.model.command_series import CommandSeries
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

_LEVELS = 501
# Of the largest torque: as good as none.
_TINY = 1e-9
# N m; a logged torque is commanded itself, and only then may the grid be so wide.
_UNLIMITED = np.append(0.0, np.geomspace(1e-2, 1e6, _LEVELS - 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Allocation:
    """Every thruster at the same share of its commands beyond its dead zone, in the sense that turns the vehicle.

    Attributes
    ----------
    torque, commands
        (m,) N m, increasing, and (m, k); at no torque the commands jump over the dead zone.
    limited
        Whether the ends of a bench curve limit the torque.
    """

    torque: FloatArray
    commands: FloatArray
    limited: bool

    @property
    def lowest(self) -> float:
        """N m; the largest torque that turns the heading down."""
        if not self.limited:
            return -math.inf
        return float(self.torque[0])

    @property
    def highest(self) -> float:
        """N m; the largest torque that turns the heading up."""
        if not self.limited:
            return math.inf
        return float(self.torque[-1])

    def __call__(self, torque: FloatArray) -> FloatArray:
        """(n, k) commands that give (n,) ``torque`` in N m, or as much of it as there is."""
        return np.column_stack([np.interp(torque, self.torque, column) for column in self.commands.T])


def allocate(vehicle: Vehicle, model: Model) -> Allocation:
    """Invert what ``vehicle`` gives under ``model``'s effects with commands that are held.

    A logged torque is commanded itself, without limit.
    """
    neutral = neutral_commands(vehicle)
    up, forward = _half(vehicle, model, 1.0)
    down, backward = _half(vehicle, model, -1.0)
    return Allocation(
        torque=np.concatenate((-down[::-1], [0.0], up)),
        commands=np.concatenate((backward[::-1], [neutral], forward)),
        limited=any(thruster.curve is not None for thruster in vehicle.thrusters),
    )


def bare_actuation(vehicle: Vehicle, time: FloatArray, parts: int = 1) -> ActuatorInputs:
    """What effects need to know of ``vehicle`` at the instants ``time``, without further channels."""
    still = np.zeros((len(time), len(vehicle.thrusters)))
    return actuation_of(vehicle, Trial.from_commands(time, still), parts)


def _half(vehicle: Vehicle, model: Model, way: float) -> tuple[FloatArray, FloatArray]:
    """(m,) sizes of torque, increasing from almost none, and (m, k) their commands, turning up or down."""
    where = bare_actuation(vehicle, np.array([0.0, 1.0]))
    share = np.linspace(0.0, 1.0, _LEVELS)
    columns = []
    for at, thruster in enumerate(vehicle.thrusters):
        sense = math.copysign(1.0, thruster.arm) * way
        if thruster.curve is None:
            columns.append(sense * _UNLIMITED)
            continue
        side = 1 if sense > 0.0 else 0
        edge, end = where.dead_zone[at][side], thruster.curve.command[-side]
        columns.append(edge + share * (end - edge))
    commands = np.column_stack(columns)
    # Each held in a trial of its own.
    apart = ActuatorInputs.concatenated([where] * _LEVELS)
    given = (
        way * model.actuators.torque_inputs(CommandSeries(vehicle, apart, np.repeat(commands, 2, axis=0))).torque[::2]
    )
    torque = np.maximum.accumulate(np.maximum(given, 0.0))
    # Of commands that give the same the largest, where the next torque begins; at the top the smallest.
    last = np.append(np.diff(torque) > 0.0, False)
    top = np.arange(_LEVELS) == np.searchsorted(torque, torque[-1])
    keep = last | top
    torque, commands = torque[keep], commands[keep]
    torque[0] = max(torque[0], _TINY * torque[-1])
    return torque, commands
