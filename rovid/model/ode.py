"""The equation of motion: its integration from an initial state, its terms along a measured trajectory, and its past.

A drive with memory (lag, delay, slew limit, sagging supply) starts in a state that follows from commands that no log
has. The torque that acted is known better: it balanced the drag, if the motion was steady. So a vehicle at rest whose
command is on has just been switched on, and one that turns with neutral commands has just been switched off.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, starmap
from weakref import WeakKeyDictionary

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import interpolate_gaps, neutral_commands
from rovid.effects.base import TERM_STATES, Body
from rovid.model.bound_effects import Equation, PackedTerms
from rovid.model.torque_input import TorqueInput
from rovid.trial.rates import resample, uniform_grid, white_noise
from rovid.trial.trial import Past, Trial
from rovid.trial.vehicle import Vehicle

# The initial rate comes from the first positions: over at most so many sampling intervals and rad of a swing's phase,
# from as many samples.
_START_INTERVALS = 40.0
_START_PHASE = 0.5
_START_SAMPLES = 5
# Ratio of the residuals of these positions to the sensor noise, above which the rate varied too much for a parabola and
# half the time is taken. A quantised position has residuals up to 1.6 times the estimate of its noise.
_START_MISFIT = 2.5
# Initial rates of trials without a natural frequency.
_INITIAL_RATES: WeakKeyDictionary[Trial, float] = WeakKeyDictionary()
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


def integrate(
    equation: Equation,
    time: FloatArray,
    torque_input: TorqueInput,
    initial: tuple[float, float],
    states: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """(n,) rate in rad/s and angle in rad at the instants ``time`` in s.

    ``initial``: Rate, and angle since the start of the trial, at the first instant.
    ``states``: (m * TERM_STATES,) states of the terms there; zeros by default.
    """
    body, terms, start = equation
    return integrate_batch(body, terms, time, torque_input, np.array([start]), np.array([initial]), states)


def integrate_batch(
    body: Body,
    terms: PackedTerms,
    time: FloatArray,
    torque_input: TorqueInput,
    starts: FloatArray,
    first: FloatArray,
    states: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """`integrate` for r concatenated trials.

    ``starts``: (r,) positions at the start of each trial.
    ``first``: (r, 2) rate and angle at the first instant of each.
    """
    from rovid.model import kernels

    if len(terms.kinds) or torque_input.timing_moment.any():
        all_states = np.zeros((len(starts), len(terms.kinds) * TERM_STATES))
        if states is not None:
            all_states[:] = states
        inputs = torque_input.torque, torque_input.timing_moment, torque_input.effect_inputs
        return kernels.simulate_effects(torque_input.offsets, time, inputs, starts, first, all_states, body, terms)
    rates, angles = [], []
    for rows, begin in zip(starmap(slice, pairwise(torque_input.offsets.tolist())), first, strict=True):
        rate, angle = kernels.simulate(time[rows], torque_input.torque[rows], body, begin[0])
        rates.append(rate)
        angles.append(angle + begin[1])
    return np.concatenate(rates), np.concatenate(angles)


def evaluate_along(
    equation: Equation,
    period: float,
    trajectory: Sequence[FloatArray],
    effect_inputs: FloatArray,
    states: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """(n,) torque in N m of all terms, and their (n, m * TERM_STATES) states, along a measured trajectory.

    ``period``: s between the instants.
    ``trajectory``: (n,) rate, angle since the start of the trial, and thruster torque. Gaps are interpolated linearly.
    ``effect_inputs``: (n, 3) as in `TorqueInput`, with the same interpolation.
    ``states``: (m * TERM_STATES,) states of the terms at the first instant; zeros by default.
    """
    from rovid.model.kernels import effects_along

    motion, inputs = (
        np.column_stack([interpolate_gaps(values) for values in series]) for series in (trajectory, effect_inputs.T)
    )
    offsets, periods, starts = np.array([0, len(motion)]), np.array([period]), np.array([equation.start])
    return effects_along(offsets, periods, motion, inputs, starts, equation.body, equation.terms, states)


def initial_rate(trial: Trial, natural_frequency: float = 0.0) -> float:
    """Rate at the first sample: from the gyro, or the slope of the first positions.

    The slope is taken over at most 40 intervals before the first change of a command. With a ``natural_frequency`` in
    rad/s the time is a fraction of its period.
    """
    if natural_frequency > 0.0:
        return driven_initial_rate(trial, natural_frequency, most_misfit=math.inf)[0]
    # Every simulation needs it.
    if trial not in _INITIAL_RATES:
        _INITIAL_RATES[trial] = driven_initial_rate(trial, most_misfit=math.inf)[0]
    return _INITIAL_RATES[trial]


def driven_initial_rate(
    trial: Trial, natural_frequency: float = 0.0, most_misfit: float = _START_MISFIT
) -> tuple[float, float]:
    """`initial_rate` of a vehicle that a torque may accelerate, and its standard deviation by the sensor noise.

    The time is shorter where the residuals of the positions exceed the sensor noise by the factor ``most_misfit``.
    """
    changed = np.flatnonzero(np.any(trial.commands != trial.commands[0], axis=1))
    # Half an interval more: rounding decides nothing.
    longest = (_START_INTERVALS + 0.5) * trial.sampling_interval
    unchanged = trial.time[changed[0]] - trial.time[0] if changed.size else longest
    limit = _START_PHASE / natural_frequency if natural_frequency > 0.0 else longest
    known = np.flatnonzero(trial.measured)
    early = known[trial.time[known] <= trial.time[0] + min(unchanged, limit, longest)]
    early = early if len(early) >= _START_SAMPLES else known[:_START_SAMPLES]
    time = trial.time[early] - trial.time[0]
    if trial.rate is not None and (measured := np.isfinite(trial.rate[early])).any():
        rates, noise = trial.rate[early][measured], white_noise(trial.rate)
        if natural_frequency > 0.0 and measured.sum() > 1:
            return _start_of_polynomial(time[measured], rates, 1, noise, derivative=0)[:2]
        rates = rates[:_START_SAMPLES]
        return float(np.mean(rates)), noise / len(rates) ** 0.5
    angle, noise = trial.body_position[early], white_noise(trial.body_position[trial.measured])
    if len(time) < _START_SAMPLES:
        return 0.0, math.inf
    degree = 2 if len(time) > _START_SAMPLES or natural_frequency > 0.0 else 1
    while True:
        rate, error, misfit = _start_of_polynomial(time, angle - angle[0], degree, noise, derivative=1)
        if misfit <= most_misfit or len(time) < 2 * _START_SAMPLES:
            return rate, error
        time, angle = time[: len(time) // 2], angle[: len(time) // 2]


def _start_of_polynomial(
    time: FloatArray, values: FloatArray, degree: int, noise: float, *, derivative: int
) -> tuple[float, float, float]:
    """Value or first ``derivative`` at zero of a polynomial, its error by the ``noise``, and residuals over noise."""
    found = np.polynomial.polynomial.polyfit(time, values, degree)
    powers = np.polynomial.polynomial.polyvander(time, degree)
    error = noise * float(np.linalg.norm(np.linalg.pinv(powers)[derivative]))
    freedom = max(len(time) - degree - 1, 1)
    misfit = float(np.linalg.norm(values - powers @ found)) / freedom**0.5 / noise if noise > 0.0 else 0.0
    return float(found[derivative]), error, misfit


def euler_heading(trial: Trial, rate: FloatArray) -> FloatArray:
    """(n,) rad of heading since the first instant, from the (n,) body ``rate`` and the logged roll and pitch."""
    assert trial.roll is not None and trial.pitch is not None  # noqa: S101, PT018 - narrowed by the caller
    grid = uniform_grid(trial)
    roll, pitch = (_smooth_tilt(trial, values, grid) for values in (trial.roll, trial.pitch))
    pitch_rate = np.gradient(pitch, trial.time)
    slope = (rate + pitch_rate * np.sin(roll)) / (np.cos(roll) * np.cos(pitch))
    return np.concatenate(([0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(trial.time))))


def _smooth_tilt(trial: Trial, values: FloatArray, grid: FloatArray) -> FloatArray:
    known = resample(trial, values, grid)
    finite = np.isfinite(known)
    return np.interp(trial.time, grid[finite], known[finite]) if finite.any() else np.zeros(len(trial.time))


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
    known = trial.past or Past(time=np.zeros(0), commands=np.zeros((0, trial.commands.shape[1])))
    begin = known.time[0] if len(known.time) else 0.0
    time = np.append(begin - trial.sampling_interval, known.time)
    return replace(trial, past=Past(time=time, commands=np.concatenate((commands, known.commands)), estimated=True))


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
