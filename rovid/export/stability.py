"""Verdict on an exported model: whether it comes to rest at the simulator's step, and the largest step that does.

Two conditions, in still water without thrust: the eigenvalues of one step of the linearised equation at rest, filter
states included, lie within the unit circle; and the integration from speeds all over the envelope of the logs, with
the simulator's own scheme, loses its kinetic energy in about the time that the exact equation takes.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.export.body_equation import AT_REST, BodyEquation, Scheme

# Share of the initial kinetic energy for a simulator, after `_PATIENCE` times the time to rest of the exact equation.
_SIMULATED_REST, _PATIENCE = 0.02, 4.0
# Least number of steps of one integration: close to the limit a motion rings for long.
_LEAST_STEPS = 200
# Tolerance of eigenvalues: with quadratic drag alone they are exactly 1 at rest.
_ROUNDING = 1e-9
# Largest number of steps of one integration. A longer one takes larger steps, far below the fastest time constant.
_MOST_STEPS = 100_000
# Step that follows the exact equation, in shares of its fastest time constant.
_RESOLVED = 0.02
# Steps of the exact equation in its fastest time constant, and the longest integration in those time constants.
_FINE, _LONGEST = 10.0, 2_000.0
_BISECTIONS, _DOUBLINGS = 12, 24
# Number of random speeds inside the envelope, half of which are mirror images.
_INSIDE = 32
# Shares of the envelope for yaw alone.
_ALONE = (-1.0, -0.5, -0.2, 0.2, 0.5, 1.0)
# A step counts as stable only with these shares of it: beyond the limit there are islands of chance stability.
_SHARES = (1.0, 0.85, 0.7)


class Stability(NamedTuple):
    """Verdict about one file."""

    stable: bool
    step: float  #: s, of the simulator.
    largest_stable_step: float | None  #: s; None where no step is stable.
    rest_time: float | None  #: s to a tenth of the speed in the exact equation; None where it does not come to rest.
    envelope: tuple[float, float, float]  #: Largest speeds in m/s and rad/s, in both directions.
    text: str


def envelope_starts(envelope: FloatArray) -> FloatArray:
    """(m, 3) velocities all over the envelope: corners, edges and faces, the same at half of it, and random ones.

    Port and starboard are alike: the first of sway and yaw that is not zero is positive. Yaw alone has both signs.
    """
    if not np.any(envelope[:2]):
        return np.outer(_ALONE, envelope)
    grid = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
    inside = np.random.default_rng(0).uniform(-1.0, 1.0, (_INSIDE, 3))
    shares = np.concatenate((grid, 0.5 * grid, inside))
    shares = shares[(shares[:, 1] > 0.0) | ((shares[:, 1] == 0.0) & (shares[:, 2] >= 0.0))]
    starts = shares * envelope
    return np.unique(starts[np.any(starts != 0.0, axis=1)], axis=0)


@lru_cache(maxsize=32)
def judge_stability(equation: BodyEquation, speeds: tuple[float, float, float]) -> Stability:
    """The verdict for the largest ``speeds`` in m/s and rad/s; one equation of several formats is judged once."""
    starts = envelope_starts(np.array(speeds))
    # The largest rate in 1/s of the equation, linearised at the starts.
    fastest = max(*(float(np.max(np.abs(np.linalg.eigvals(_jacobian(equation, start))))) for start in starts), 1e-9)
    # Whether a small motion grows by the linear damping of the exact equation.
    rates = np.linalg.eigvals(np.linalg.solve(equation.total_mass, equation.linear))
    grows_at_rest = bool(np.min(rates.real) < -_ROUNDING * max(1.0, float(np.max(np.abs(rates)))))
    rest = None if grows_at_rest else _time_to_rest(equation, starts, fastest)
    if rest is None:
        text = "The model itself does not come to rest from every speed in the logs: its drag is too small along one "
        text += "axis, or its coupling terms feed energy. No step of the simulator mends this."
        return Stability(False, equation.step, None, None, speeds, text)

    def is_stable(step: float) -> bool:
        return all(_is_stable(equation, starts, share * step, rest, fastest) for share in _SHARES)

    stable = is_stable(equation.step)
    largest = _largest_step(is_stable, equation.step, stable, rest)
    return Stability(stable, equation.step, largest, rest, speeds, _text(stable, equation.step, largest, rest))


def _text(stable: bool, step: float, largest: float | None, rest: float) -> str:
    if stable:
        within = f"up to a step of {largest:.2g} s" if largest is not None else ""
        text = f"Stable at the simulator's step of {step:g} s: from every speed in the logs the model slows to a tenth "
        return f"{text}within {rest:.3g} s. Stable {within}."
    if largest is None:
        return (
            f"Unstable at the simulator's step of {step:g} s and at every smaller one: the added mass multiplies the "
            "acceleration of the step before, and that loop diverges."
        )
    return f"Unstable at the simulator's step of {step:g} s. The largest stable step is {largest:.2g} s."


def _jacobian(equation: BodyEquation, speeds: FloatArray) -> FloatArray:
    """(3, 3) derivative of the accelerations by the velocities in still water, nothing lagged."""
    exact = replace(equation, constant=np.zeros(3), current=np.zeros(2), scheme=Scheme.BODY_EULER)
    columns = []
    for axis in range(3):
        size = 1e-6 * max(abs(float(speeds[axis])), 1e-3)
        ends = [_acceleration(exact, speeds + sign * size * np.eye(3)[axis]) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    return np.column_stack(columns)


def _acceleration(equation: BodyEquation, nu: FloatArray) -> FloatArray:
    mass = equation.total_mass
    drag = equation.linear @ nu + np.einsum("ijk,j,k", equation.absolute, nu, np.abs(nu))
    drag[2] = (drag[2] + equation.cubic * nu[2] ** 3) * (equation.ratio if nu[2] < 0.0 else 1.0)
    momentum = mass @ nu
    turning = np.array([-momentum[1] * nu[2], momentum[0] * nu[2], momentum[1] * nu[0] - momentum[0] * nu[1]])
    return np.asarray(np.linalg.solve(mass, -drag - turning), dtype=np.float64)


def _time_to_rest(equation: BodyEquation, starts: FloatArray, fastest: float) -> float | None:
    """Time in s in which the exact equation comes to rest from all ``starts``; None if never."""
    exact = replace(
        equation, mass=equation.total_mass, lagged=np.zeros((3, 3)), scheme=Scheme.RUNGE_KUTTA, filter_weight=1.0
    )
    step = 1.0 / (_FINE * fastest)
    count = int(_FINE)
    while count <= _FINE * _LONGEST:
        ends, last = exact.decay(starts, step, count).T
        if np.max(ends) < AT_REST:
            return float(np.max(last)) * step
        count *= 2
    return None


def _is_stable(equation: BodyEquation, starts: FloatArray, step: float, rest: float, fastest: float) -> bool:
    if _spectral_radius(equation, step) > 1.0 + _ROUNDING:
        return False
    if not np.any(equation.lagged):
        # A much smaller step follows the exact equation as closely as this one.
        step = max(step, _RESOLVED / fastest)
    count = max(math.ceil(_PATIENCE * rest / step), _LEAST_STEPS)
    if count > _MOST_STEPS:
        step, count = _PATIENCE * rest / _MOST_STEPS, _MOST_STEPS
    ends = equation.decay(starts, step, count)[:, 0]
    return bool(np.all(ends < _SIMULATED_REST))


def _spectral_radius(equation: BodyEquation, step: float) -> float:
    """Largest magnitude of the eigenvalues of one step, linearised at rest: velocities, acceleration and its filter."""
    inverse, damping = np.linalg.inv(equation.mass), equation.linear
    identity = np.eye(3)
    if equation.scheme is Scheme.RUNGE_KUTTA:
        x = -step * np.linalg.inv(equation.total_mass) @ damping
        return _radius(identity + x + x @ x / 2.0 + x @ x @ x / 6.0 + x @ x @ x @ x / 24.0)
    if equation.scheme is Scheme.WORLD_IMPLICIT:
        return _radius(np.asarray(np.linalg.solve(equation.mass + step * damping, equation.mass), dtype=np.float64))
    weight = equation.filter_weight
    # x = (nu, acceleration of the step before, filtered acceleration).
    filtered = np.hstack((np.zeros((3, 3)), weight * identity, (1.0 - weight) * identity))
    acceleration = inverse @ (-np.hstack((damping, np.zeros((3, 6)))) - equation.lagged @ filtered)
    velocity = np.hstack((identity, np.zeros((3, 6)))) + step * acceleration
    return _radius(np.vstack((velocity, acceleration, filtered)))


def _radius(matrix: FloatArray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def _largest_step(is_stable: Callable[[float], bool], step: float, stable: bool, rest: float) -> float | None:
    """The largest stable step to two digits, by doubling or halving and bisection; at most the time to rest."""
    low = high = step
    for _ in range(_DOUBLINGS):
        if stable:
            high = min(2.0 * low, max(rest, low))
            if not is_stable(high):
                break
            low = high
            if low >= rest:
                return low
        else:
            low = 0.5 * high
            if is_stable(low):
                break
            high = low
    else:
        return low if stable else None
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        if is_stable(middle):
            low = middle
        else:
            high = middle
        if high < 1.03 * low:
            break
    # Two digits, rounded down; never below a stable step of the simulator.
    digits = 10.0 ** (math.floor(math.log10(low)) - 1)
    rounded = math.floor(low / digits + 1e-9) * digits
    return max(rounded, step) if stable else rounded
