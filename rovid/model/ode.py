"""The motion by an equation: from a start on; and what its terms do along a measured course."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, starmap
from weakref import WeakKeyDictionary

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.actuator_inputs import interpolate_gaps
from rovid.effects.base import TERM_STATES, Body
from rovid.model.packed_terms import Equation, PackedTerms
from rovid.model.torque_input import TorqueInput
from rovid.signals.rates import resample, uniform_grid
from rovid.trial.trial import Trial

_START_SECONDS = 2.0
_START_SAMPLES = 5
_START_SWING = 0.5  # rad of the phase of a swing about its level
# The rate at the first sample of each trial that does not swing.
_STEADY: WeakKeyDictionary[Trial, float] = WeakKeyDictionary()


def integrate(
    equation: Equation,
    time: FloatArray,
    drive: TorqueInput,
    begin: tuple[float, float],
    states: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """(n,) rate in rad/s and angle in rad at the instants ``time`` in s, under ``drive``.

    ``begin`` is the rate and the angle since the start of the trial at the first of them; ``states`` of the terms there
    are (m * TERM_STATES,), at rest if not given.
    """
    body, terms, start = equation
    return integrate_batch(body, terms, time, drive, np.array([start]), np.array([begin]), states)


def integrate_batch(
    body: Body,
    terms: PackedTerms,
    time: FloatArray,
    drive: TorqueInput,
    starts: FloatArray,
    first: FloatArray,
    states: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """As ``integrated``, of all r trials whose instants and drives stand one after the other.

    ``starts`` are (r,) their positions at the start, ``first`` (r, 2) their rates and angles at the first instant.
    """
    from rovid.model import kernels

    if len(terms.kinds) or drive.timing_moment.any():
        there = np.zeros((len(starts), len(terms.kinds) * TERM_STATES))
        if states is not None:
            there[:] = states
        given = drive.torque, drive.timing_moment, drive.effect_inputs
        return kernels.simulate_effects(drive.offsets, time, given, starts, first, there, body, terms)
    rates, angles = [], []
    for rows, begin in zip(starmap(slice, pairwise(drive.offsets.tolist())), first, strict=True):
        rate, angle = kernels.simulate(time[rows], drive.torque[rows], body, begin[0])
        rates.append(rate)
        angles.append(angle + begin[1])
    return np.concatenate(rates), np.concatenate(angles)


def evaluate_along(
    equation: Equation, period: float, course: Sequence[FloatArray], beside: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n,) torque in N m of all terms and their (n, m * TERM_STATES) states, on a measured ``course``.

    That is (n,) rate, angle since the start of the trial and thrusters' torque, a ``period`` in s apart; ``beside``
    is theirs as in `Drive`. What is not known of them is bridged by straight lines.
    """
    from rovid.model.kernels import effects_along

    known, told = (np.column_stack([interpolate_gaps(values) for values in series]) for series in (course, beside.T))
    begins, periods, starts = np.array([0, len(known)]), np.array([period]), np.array([equation.start])
    torque, states = effects_along(begins, periods, known, told, starts, equation.body, equation.terms)
    return torque, states


def initial_rate(trial: Trial, swing: float = 0.0) -> float:
    """Rate at the first sample: the gyro's, or the slope of the first positions.

    The slope is taken over two seconds at most, and only until the first command changes: a fast vehicle is elsewhere
    soon after. One that swings at ``swing`` rad/s is so after a fraction of a radian.
    """
    if swing > 0.0:
        return _initial_rate(trial, swing)
    # Every simulation asks for it.
    if trial not in _STEADY:
        _STEADY[trial] = _initial_rate(trial, swing)
    return _STEADY[trial]


def _initial_rate(trial: Trial, swing: float) -> float:
    early = _start_rows(trial, swing)
    time = trial.time[early] - trial.time[0]
    if trial.rate is not None and (read := np.isfinite(trial.rate[early])).any():
        if swing > 0.0 and read.sum() > 1:
            return float(np.polynomial.polynomial.polyfit(time[read], trial.rate[early][read], 1)[0])
        return float(np.mean(trial.rate[early][read][:_START_SAMPLES]))
    angle = trial.body_position[early]
    if len(time) < _START_SAMPLES:
        return 0.0
    bent = len(time) > _START_SAMPLES or swing > 0.0
    return float(np.polynomial.polynomial.polyfit(time, angle - angle[0], 2 if bent else 1)[1])


def _start_rows(trial: Trial, swing: float) -> IntArray:
    """Measured samples before the first change of a command, or the first few where those are fewer."""
    changed = np.flatnonzero(np.any(trial.commands != trial.commands[0], axis=1))
    steady = trial.time[changed[0]] - trial.time[0] if changed.size else _START_SECONDS
    most = _START_SWING / swing if swing > 0.0 else _START_SECONDS
    known = np.flatnonzero(trial.measured)
    early = known[trial.time[known] <= trial.time[0] + min(steady, most, _START_SECONDS)]
    return early if len(early) >= _START_SAMPLES else known[:_START_SAMPLES]


def euler_heading(trial: Trial, rate: FloatArray) -> FloatArray:
    """(n,) rad turned in heading since the first instant by a body's (n,) ``rate``; tilts are logged."""
    assert trial.roll is not None and trial.pitch is not None  # noqa: S101, PT018 - narrowed by the caller
    grid = uniform_grid(trial)
    roll, pitch = (_tilt(trial, values, grid) for values in (trial.roll, trial.pitch))
    pitch_rate = np.gradient(pitch, trial.time)
    slope = (rate + pitch_rate * np.sin(roll)) / (np.cos(roll) * np.cos(pitch))
    steps = 0.5 * (slope[1:] + slope[:-1]) * np.diff(trial.time)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _tilt(trial: Trial, values: FloatArray, grid: FloatArray) -> FloatArray:
    known = resample(trial, values, grid)
    finite = np.isfinite(known)
    return np.interp(trial.time, grid[finite], known[finite]) if finite.any() else np.zeros(len(trial.time))
