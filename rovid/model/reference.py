"""The compiled loops once more in plain Python: short, slow, and without SIMD. Tests hold `rovid.model.kernels` to it.

Numbers of equations refer to docs/method.md. Every interval is divided into many equal steps, so that no step-size rule
is needed. The kernels differ from this module by their larger steps alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import expm

from rovid.core.array_types import FloatArray
from rovid.effects.base import Body, Instant, Term
from rovid.model.bound_effects import BoundEffect, effects_at
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput

# Steps in each interval.
STEPS = 10
# States of the filter: angle, rate, disturbance torque, and two of an oscillator.
_ANGLE, _RATE, _DISTURBANCE, _FIRST, _SECOND = range(5)


@dataclass(frozen=True)
class Motion:
    """Angle in rad since the start of the trial, rate in rad/s, and the states of each term."""

    angle: float
    rate: float
    states: tuple[FloatArray, ...]

    def plus(self, slope: "Motion", h: float) -> "Motion":
        """The motion after ``h`` s with this slope."""
        states = tuple(x + h * dx for x, dx in zip(self.states, slope.states, strict=True))
        return Motion(self.angle + h * slope.angle, self.rate + h * slope.rate, states)


@dataclass(frozen=True)
class Inputs:
    """Inputs that are held over an interval: torque in N m, and wash, surge and sway speed."""

    thruster_torque: float
    effect_inputs: FloatArray


@dataclass(frozen=True, eq=False)
class ReferenceEquation:
    """The equation of motion, eq. (1), with terms of effects."""

    body: Body  #: The plain model.
    effects: Sequence[BoundEffect]  #: Effects with their parameters.
    start: float = 0.0  #: Position in rad at the start of the trial.

    @cached_property
    def terms(self) -> list[tuple[Term, tuple[float, ...]]]:
        """Terms with their parameters."""
        return [(term, tuple(one.parameters.tolist())) for one, term in effects_at(self.effects, Term)]

    def at_rest(self) -> tuple[FloatArray, ...]:
        """States of all terms before any motion."""
        return tuple(np.zeros(term.states) for term, _ in self.terms)

    def terms_at(self, motion: Motion, inputs: Inputs) -> tuple[float, tuple[FloatArray, ...]]:
        """Torque of all terms in N m, and the derivatives of their states, eq. (2) and (3)."""
        water = 0.0
        for (term, p), x in zip(self.terms, motion.states, strict=True):
            if term.entrained_rate is not None:
                water += _plain(term.entrained_rate)(p, x)
        relative_rate = motion.rate - water
        wash, surge, sway = inputs.effect_inputs
        at = Instant(
            motion.rate, relative_rate, motion.angle, self.start, inputs.thruster_torque, wash, surge, sway, self.body
        )
        total, derivatives = 0.0, []
        for (term, p), x in zip(self.terms, motion.states, strict=True):
            if term.states:
                torque, *derivative = _plain(term.torque)(at, p, x)
            else:
                torque, derivative = _plain(term.torque)(at, p), []
            total += float(torque)
            derivatives.append(np.array(derivative))
        return total, tuple(derivatives)

    def slope(self, motion: Motion, inputs: Inputs, other_torque: float) -> Motion:
        """Time derivative of the motion, eq. (1); ``other_torque`` in N m does not come from the thrusters."""
        terms, derivatives = self.terms_at(motion, inputs)
        drag = (self.body.quadratic_drag * abs(motion.rate) + self.body.linear_drag) * motion.rate
        acceleration = (inputs.thruster_torque + other_torque + terms - drag) / self.body.inertia
        return Motion(motion.rate, acceleration, derivatives)

    def after_resets(self, motion: Motion) -> Motion:
        """The motion with the states that terms reset at this rate."""
        states = []
        for (term, _), x in zip(self.terms, motion.states, strict=True):
            states.append(x if term.reset is None else np.array([_plain(term.reset)(motion.rate, x)]))
        return Motion(motion.angle, motion.rate, tuple(states))

    def step(self, motion: Motion, inputs: Inputs, other_torque: float, h: float) -> Motion:
        """The motion after one classical Runge-Kutta step of ``h`` s."""
        motion = self.after_resets(motion)
        k1 = self.slope(motion, inputs, other_torque)
        k2 = self.slope(motion.plus(k1, 0.5 * h), inputs, other_torque)
        k3 = self.slope(motion.plus(k2, 0.5 * h), inputs, other_torque)
        k4 = self.slope(motion.plus(k3, h), inputs, other_torque)
        for k, share in ((k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)):
            motion = motion.plus(k, share / 6.0 * h)
        return motion

    def damping(self, motion: Motion, inputs: Inputs) -> float:
        """-d(acceleration)/d(rate) in 1/s, eq. (4); with effects never negative."""
        drag = 2.0 * self.body.quadratic_drag * abs(motion.rate) + self.body.linear_drag
        if not self.terms:
            return drag / self.body.inertia
        nudge = 1e-6 + 1e-4 * abs(motion.rate)
        here, _ = self.terms_at(self.after_resets(motion), inputs)
        nudged = Motion(motion.angle, motion.rate + nudge, motion.states)
        there, _ = self.terms_at(self.after_resets(nudged), inputs)
        return max((drag - (there - here) / nudge) / self.body.inertia, 0.0)


def _plain(function: Any) -> Any:
    """The Python function behind a compiled one."""
    return getattr(function, "py_func", function)


def simulate(
    equation: ReferenceEquation, time: FloatArray, torque_input: TorqueInput, initial: Motion
) -> tuple[FloatArray, FloatArray]:
    """Free-running simulation of one trial: (n,) rate in rad/s and angle in rad."""
    motions = [initial]
    for k in range(len(time) - 1):
        motion, inputs = motions[-1], Inputs(torque_input.torque[k], torque_input.effect_inputs[k])
        h = (time[k + 1] - time[k]) / STEPS
        for _ in range(STEPS):
            motion = equation.step(motion, inputs, 0.0, h)
        # Torque that came late in the interval: eq. (5).
        late = torque_input.timing_moment[k] / equation.body.inertia
        drag_damping = 2.0 * equation.body.quadratic_drag * abs(motion.rate) + equation.body.linear_drag
        rate = motion.rate - drag_damping / equation.body.inertia * late
        motions.append(Motion(motion.angle + late, rate, motion.states))
    return np.array([one.rate for one in motions]), np.array([one.angle for one in motions])


def predict(
    equation: ReferenceEquation, period: float, torque_input: TorqueInput, initial: Motion, steps_ahead: int
) -> FloatArray:
    """(1 + steps_ahead,) angle turned after each interval of ``period`` s since a restart, eq. (6)."""
    _, angle = simulate(equation, np.arange(steps_ahead + 1.0) * period, torque_input, initial)
    return angle - initial.angle


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviations and correlation time of a filter's noise."""

    #: ``disturbance``, ``correlation_time``: of the coloured disturbance torque, in N m and s.
    disturbance: float
    correlation_time: float
    #: ``angle``, ``rate``: of the white measurement noise, in rad and rad/s.
    angle: float
    rate: float


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter:
    """Filter with three states, or five if the model has a wave torque or an oscillatory effect, eq. (7) to (11)."""

    model: Model
    noise: Noise
    start: float = 0.0

    @cached_property
    def equation(self) -> ReferenceEquation:
        """Equation of motion of the mean."""
        return ReferenceEquation(self.model.body, self.model.bound_effects, self.start)

    @cached_property
    def has_wave(self) -> bool:
        """Whether the oscillator is a wave torque."""
        return len(self.model.wave_parameters) > 0

    @cached_property
    def oscillatory(self) -> int | None:
        """Index of the oscillatory term, if its states have a covariance."""
        if self.has_wave:
            return None
        found = [j for j, (term, _) in enumerate(self.equation.terms) if term.oscillatory]
        return found[0] if found else None

    @property
    def size(self) -> int:
        """Number of states."""
        return 5 if self.has_wave or self.oscillatory is not None else 3

    def system(self, motion: Motion, inputs: Inputs) -> tuple[FloatArray, FloatArray]:
        """Matrix A of the linearised motion, eq. (8), and intensity Q of the white noise, eq. (9)."""
        body, noise = self.model.body, self.noise
        a, q = np.zeros((self.size, self.size)), np.zeros((self.size, self.size))
        a[_ANGLE, _RATE] = 1.0
        a[_RATE, _ANGLE] = -body.stiffness / body.inertia
        a[_RATE, _RATE] = -self.equation.damping(motion, inputs)
        a[_RATE, _DISTURBANCE] = 1.0 / body.inertia
        a[_DISTURBANCE, _DISTURBANCE] = -1.0 / noise.correlation_time
        q[_DISTURBANCE, _DISTURBANCE] = 2.0 * noise.disturbance**2 / noise.correlation_time
        if self.has_wave:
            amplitude, frequency, damping = self.model.wave_parameters
            a[_RATE, _FIRST] = 1.0 / body.inertia
            a[_FIRST, _SECOND] = 1.0
            a[_SECOND, _FIRST], a[_SECOND, _SECOND] = -(frequency**2), -2.0 * damping * frequency
            q[_SECOND, _SECOND] = 2.0 * damping * frequency**3 * amplitude**2
        if self.oscillatory is not None:
            a[_FIRST, _SECOND] = 1.0
            # The term is linear in the rate and in its states: differences give its slopes.
            rest, unit = Motion(0.0, 0.0, self.equation.at_rest()), np.eye(2)
            for column, changed in (
                (_RATE, Motion(0.0, 1.0, rest.states)),
                (_FIRST, self._with_oscillator(rest, unit[0])),
                (_SECOND, self._with_oscillator(rest, unit[1])),
            ):
                still = Inputs(0.0, np.zeros(3))
                (t1, d1), (t0, d0) = self.equation.terms_at(changed, still), self.equation.terms_at(rest, still)
                a[_SECOND, column] = d1[self.oscillatory][1] - d0[self.oscillatory][1]
                if column != _RATE:
                    a[_RATE, column] = (t1 - t0) / body.inertia
        return a, q

    def _with_oscillator(self, motion: Motion, x: FloatArray) -> Motion:
        states = [x if j == self.oscillatory else own for j, own in enumerate(motion.states)]
        return Motion(motion.angle, motion.rate, tuple(states))

    def innovations(
        self,
        time: FloatArray,
        torque_input: TorqueInput,
        measured: FloatArray,
        initial_rate: tuple[float, float],
        past: tuple[FloatArray, float] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """(n, 2) innovations of angle and rate, and their variances; NaN where not measured.

        ``measured``: (n, 2) angle in rad and rate in rad/s.
        ``initial_rate``: rad/s, and its standard deviation.
        ``past``: (n,) change of the torque of each interval by 1 N m before the first instant, and the standard
            deviation of the torque before in N m, eq. (12a). It is the last state. None if that torque is known.
        """
        innovation, variance = np.full((2, *measured.shape), np.nan)
        noise_variance = np.array([self.noise.angle, self.noise.rate]) ** 2
        origin, inertia = measured[0, 0], self.model.body.inertia
        motion, others = Motion(0.0, initial_rate[0], self.equation.at_rest()), np.zeros(self.size - 2)
        p = np.zeros((self.size, self.size))
        p[:3, :3] = np.diag([noise_variance[0], initial_rate[1] ** 2, self.noise.disturbance**2])
        if past is not None:
            others, p = np.append(others, 0.0), np.pad(p, ((0, 1), (0, 1)))
            p[-1, -1] = past[1] ** 2
        if self.has_wave:
            amplitude, frequency, _ = self.model.wave_parameters
            p[3:5, 3:5] = 0.5 * amplitude**2 * np.diag([1.0, frequency**2])
        for k in range(len(time)):
            if k > 0:
                inputs = Inputs(torque_input.torque[k - 1], torque_input.effect_inputs[k - 1])
                interval = time[k] - time[k - 1]
                for _ in range(STEPS):
                    response = None if past is None else past[0][k - 1]
                    motion, others, p = self._propagate(motion, others, p, inputs, interval / STEPS, response)
                # Late torque, eq. (5), and an impulse at an unknown time in the interval, eq. (10).
                late = torque_input.timing_moment[k - 1] / inertia
                rate = motion.rate - self.equation.damping(motion, inputs) * late
                motion = Motion(motion.angle + late, rate, motion.states)
                impulse = torque_input.impulse_variance[k - 1] / inertia**2
                p[:2, :2] += impulse * np.array([[interval**2 / 3.0, interval / 2.0], [interval / 2.0, 1.0]])
            for m in np.flatnonzero(np.isfinite(measured[k])):
                predicted = origin + motion.angle if m == _ANGLE else motion.rate
                innovation[k, m] = measured[k, m] - predicted
                variance[k, m] = p[m, m] + noise_variance[m]
                # Kalman gain and measurement update, eq. (11).
                gain = p[:, m] / variance[k, m]
                p = p - np.outer(gain, p[m])
                motion, others = self._updated(motion, others, gain * innovation[k, m])
        return innovation, variance

    def _propagate(
        self, motion: Motion, others: FloatArray, p: FloatArray, inputs: Inputs, h: float, response: float | None = None
    ) -> tuple[Motion, FloatArray, FloatArray]:
        """Mean and covariance after ``h`` s; ``others`` are the states after angle and rate.

        With a ``response`` in N m the last state is an unknown number that adds so much torque for each unit.
        """
        a, q = self.system(motion, inputs)
        if response is not None:
            a, q = (np.pad(matrix, ((0, 1), (0, 1))) for matrix in (a, q))
            a[_RATE, -1] = response / self.model.body.inertia
        # Van Loan 1978: transition matrix and covariance of the noise.
        n = len(a)
        exponential = expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * h)
        transition = exponential[n:, n:].T
        # Disturbance, and wave torque, at the middle of the step.
        middle = expm(0.5 * h * a[2:, 2:]) @ others
        other_torque = middle[0] + (middle[1] if self.has_wave else 0.0)
        if response is not None:
            other_torque += response * others[-1]
        motion = self.equation.step(motion, inputs, other_torque, h)
        if self.oscillatory is None:
            others = transition[2:, 2:] @ others
        else:
            others = np.array([transition[2, 2] * others[0], *motion.states[self.oscillatory], *others[3:]])
        return motion, others, transition @ p @ transition.T + transition @ exponential[:n, n:]

    def _updated(self, motion: Motion, others: FloatArray, change: FloatArray) -> tuple[Motion, FloatArray]:
        others = others + change[2:]
        motion = Motion(motion.angle + change[_ANGLE], motion.rate + change[_RATE], motion.states)
        if self.oscillatory is not None:
            motion = self._with_oscillator(motion, others[1:3])
        return motion, others
