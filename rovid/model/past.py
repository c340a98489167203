"""Commands before a log, estimated from the motion at its first sample.

A drive with memory (lag, delay, slew limit, sagging supply) starts in a state that follows from commands that no log
has. The torque that acted is known better: it balanced the drag, if the motion was steady. So a vehicle at rest whose
command is on has just been switched on, and one that turns with neutral commands has just been switched off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import neutral_commands
from rovid.effects.base import Body
from rovid.model.ode import driven_initial_rate
from rovid.trial.trial import Past, Trial
from rovid.trial.vehicle import Vehicle

# Difference between the torque of the first commands and the balance of the motion, as a share of the largest torque of
# the trial, up to which the drives count as settled: the accuracy of an initial rate from the first positions, and
# of the drag of a first fit. Convention.
_SETTLED = 0.1
# Standard deviations of the initial rate, up to which the difference is no difference. Convention.
_SIGMAS = 3.0
# Share of the largest torque up to which the first commands give no torque: a trim. Convention.
_NEGLIGIBLE = 0.02
# Time constants of the vehicle, after which nothing of the state before is left. Convention.
_FORGOTTEN = 5.0
# Change of the past torque for a sensitivity, as a share of the largest torque of the trial.
_MOVE = 0.25
# Shares of a command at which its torque is evaluated.
_SHARES = np.linspace(0.0, 1.0, 65)


def with_past(trial: Trial, body: Body, vehicle: Vehicle) -> Trial:
    """``trial`` with commands before its first one that drive the steady motion at its initial rate.

    The trial itself where no torque acted before and none is commanded at first, where commands are known for long
    before, and where no actuator drives the vehicle.
    """
    past = trial.past
    if not trial.has_actuators or (past is not None and past.estimated):
        return trial
    torques = vehicle.torque(trial)
    largest = float(np.max(np.abs(torques)))
    rate, rate_error = driven_initial_rate(trial, np.sqrt(max(body.stiffness, 0.0) / body.inertia))
    slope = 2.0 * body.quadratic_drag * abs(rate) + body.linear_drag
    first, commands = float(torques[0]), trial.commands[:1]
    if past is not None:
        constant = body.inertia / max(slope, np.sqrt(body.quadratic_drag * largest), 1e-12)
        if -past.time[0] >= _FORGOTTEN * constant:
            return trial
        first, commands = float(_torques(past.commands[:1], vehicle)[0]), past.commands[:1]
    balance = (body.quadratic_drag * abs(rate) + body.linear_drag) * rate
    if body.stiffness:
        balance += body.stiffness * np.sin(trial.first_position - body.trim)
    # Most logs begin long after a change of the commands, or at one from rest.
    usual = min(first, 0.0, key=lambda torque: abs(balance - torque))
    if abs(balance - usual) <= max(_SETTLED * largest, _SIGMAS * slope * rate_error):
        balance = usual
    if max(abs(first), abs(balance)) <= _NEGLIGIBLE * largest:
        return trial
    if balance != first:
        commands = _commands_of(balance, trial, torques, vehicle)
    return _begun_with(trial, commands)


def with_moved_past(trial: Trial, vehicle: Vehicle) -> tuple[Trial, float]:
    """``trial`` with another estimated command before its first one, and the change of its torque in N m.

    Where the commands before are known, the trial itself and 0.
    """
    past = trial.past
    if past is None or not past.estimated:
        return trial, 0.0
    torques = vehicle.torque(trial)
    before = float(_torques(past.commands[:1], vehicle)[0])
    move = _MOVE * float(np.max(np.abs(torques)))
    changed = [_commands_of(before + step, trial, torques, vehicle) for step in (-move, move)]
    changes = [float(_torques(commands, vehicle)[0]) - before for commands in changed]
    at = int(np.argmax(np.abs(changes)))
    commands = np.concatenate((changed[at], past.commands[1:]))
    return replace(trial, past=replace(past, commands=commands)), changes[at]


def _begun_with(trial: Trial, commands: FloatArray) -> Trial:
    """``trial`` with the (1, k) ``commands`` held before all that are known."""
    known = trial.past or Past(time=np.zeros(0), commands=np.zeros((0, trial.commands.shape[1])))
    begin = known.time[0] if len(known.time) else 0.0
    time = np.append(begin - trial.sampling_interval, known.time)
    return replace(trial, past=Past(time=time, commands=np.concatenate((commands, known.commands)), estimated=True))


def _commands_of(torque: float, trial: Trial, torques: FloatArray, vehicle: Vehicle) -> FloatArray:
    """(1, k) commands of this ``torque`` in N m: a share of those at the first instant of ``trial`` if these give more.

    Otherwise, a share of the commands with the largest torque of that sign.
    """
    neutral, sign = neutral_commands(vehicle), np.sign(torque)
    at = 0 if sign * torques[0] >= abs(torque) else int(np.argmax(sign * torques))
    levels = neutral + _SHARES[:, np.newaxis] * (trial.commands[at] - neutral)
    reached = np.maximum.accumulate(sign * _torques(levels, vehicle))
    share = float(np.interp(abs(torque), reached, _SHARES)) if reached[-1] > 0.0 else 0.0
    return np.asarray(neutral + share * (trial.commands[at] - neutral))[np.newaxis]


def _torques(commands: FloatArray, vehicle: Vehicle) -> FloatArray:
    """(n,) N m of (n, k) commands by the bench curves."""
    return np.asarray(vehicle.thrust(commands) @ np.array([thruster.arm for thruster in vehicle.thrusters]))
