"""Motion in surge, sway and yaw as simulators compute it: their terms, their integrator, their step.

In axes x ahead, y to starboard, z down, with nu through the water and C of the mass matrix (Fossen 2011, (6.65)):

    M nu' + C(nu) nu = tau + constant - linear nu - sum over j, k of absolute[:, j, k] nu_j |nu_k|

Yaw has a cubic drag, a factor of all drag at negative rates, and a stiffness in addition.

A part of M may be lagged: it multiplies the acceleration of the step before, through a filter (uuv_simulator).
"""

from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import compiled
from rovid.planar.equations import slopes
from rovid.planar.model import COUPLING_INDEX, INPUT_COUNT, RUDDER_COUNT, RUDDER_INDEX

# Index of the constant forces among the coefficients of the planar model.
_BIAS = COUPLING_INDEX["bias_torque:planar"]

# Share of the initial kinetic energy at which a vehicle counts as at rest: a tenth of the speed.
AT_REST = 0.01
# The same, at which an integration ends: below it the drag is linear.
_ENDS = 1e-5
# The same for a motion that has diverged.
_DIVERGED = 1e6


class Scheme(IntEnum):
    """Integrators of rigid-body engines; the heading follows with the new yaw rate."""

    BODY_EULER = 0  #: Semi-implicit Euler of the velocities in body axes: DART.
    WORLD_EULER = 1  #: Of the velocities in axes of the world: ODE, Bullet.
    WORLD_IMPLICIT = 2  #: The same with implicit damping: MuJoCo's implicitfast.
    RUNGE_KUTTA = 3  #: Classical, of fourth order, in body axes.


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyEquation:
    """Numbers of a file, in the simulator's equation."""

    mass: FloatArray  #: (3, 3), in kg, kg m and kg m^2: lagged part excluded.
    linear: FloatArray  #: (3, 3) linear damping, positive where it opposes the motion.
    absolute: FloatArray  #: (3, 3, 3) damping nu_j |nu_k|.
    lagged: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))  #: (3, 3) lagged mass.
    filter_weight: float = 1.0  #: Weight of the newest acceleration.
    constant: FloatArray = field(default_factory=lambda: np.zeros(3))  #: (3,) N, N and N m.
    current: FloatArray = field(default_factory=lambda: np.zeros(2))  #: (2,) m/s to north and east.
    #: Whether inertia and Coriolis force are those of the velocity through the water; else over ground.
    inertia_in_water: bool = True
    #: ``cubic``, ``ratio``, ``stiffness``: in yaw, in N m s^3/rad^3, factor of the drag at negative rates, and N m/rad.
    cubic: float = 0.0
    ratio: float = 1.0
    stiffness: float = 0.0
    #: Coefficients of the planar model, whose equation then stands in place of mass and damping; else empty.
    coefficients: FloatArray = field(default_factory=lambda: np.zeros(0))
    step: float  #: s.
    scheme: Scheme

    @property
    def total_mass(self) -> FloatArray:
        """(3, 3) mass matrix, lagged part included."""
        return np.asarray(self.mass + self.lagged)

    def simulate(self, forces: FloatArray, heading: float = 0.0, every: int = 1) -> FloatArray:
        """(m, 4) heading and velocities over ground at each ``every``-th step, from rest over ground.

        ``forces`` (n, 3): X, Y in N and N in N m in each step of `step` s.
        """
        start = np.array([heading, 0.0, 0.0, 0.0])
        rows: FloatArray = _run(start, np.ascontiguousarray(forces), every, self._numbers(self.step, still=False))
        return rows

    def decay(self, starts: FloatArray, step: float, count: int) -> FloatArray:
        """(m, 2) kinetic energy at the end over the initial one, and number of steps to rest; in still water.

        ``starts``: (m, 3) velocities; ``count`` steps of ``step`` s.
        """
        found: FloatArray = _decay(
            np.ascontiguousarray(starts), count, self.total_mass, self._numbers(step, still=True)
        )
        return found

    def _numbers(self, step: float, *, still: bool) -> tuple[Any, ...]:
        share = 0.0 if still else 1.0
        coefficients = self.coefficients.copy()
        if len(coefficients) and still:
            coefficients[_BIAS : _BIAS + 3] = 0.0
        return (
            np.linalg.inv(self.mass),
            self.total_mass,
            np.ascontiguousarray(self.linear),
            np.ascontiguousarray(self.absolute),
            np.ascontiguousarray(self.lagged),
            share * np.asarray(self.constant, dtype=np.float64),
            share * np.asarray(self.current, dtype=np.float64),
            self.filter_weight,
            self.inertia_in_water,
            step,
            int(self.scheme),
            np.ascontiguousarray(self.mass),
            coefficients,
            np.zeros(INPUT_COUNT + 2 * max((len(coefficients) - RUDDER_INDEX) // RUDDER_COUNT, 0)),
            np.array([self.cubic, self.ratio, share * self.stiffness]),
            np.empty((7, 4)),  # vectors of the compiled loops, which allocate none
        )


@lru_cache(maxsize=32)
def yaw_equation(
    inertia: float, linear: float, quadratic: float, *, added: float = 0.0, bias: float = 0.0, **terms: Any
) -> BodyEquation:
    """Yaw alone, with further fields of `BodyEquation` in ``terms``; surge and sway stay at rest.

    ``inertia`` and lagged ``added`` inertia in kg m^2, ``linear`` and ``quadratic`` drag in N m s/rad and
    N m s^2/rad^2, ``bias`` in N m.
    """
    absolute = np.zeros((3, 3, 3))
    absolute[2, 2, 2] = quadratic
    return BodyEquation(
        mass=inertia * np.eye(3),
        linear=linear * np.eye(3),
        absolute=absolute,
        lagged=added * np.eye(3),
        constant=np.array([0.0, 0.0, bias]),
        **terms,
    )


@compiled
def _damping(nu: Any, linear: Any, absolute: Any, yaw: Any, out: Any) -> None:
    for i in range(3):
        total = 0.0
        for j in range(3):
            factor = linear[i, j]
            for k in range(3):
                factor += absolute[i, j, k] * abs(nu[k])
            total += factor * nu[j]
        out[i] = total
    out[2] += yaw[0] * nu[2] ** 3
    if nu[2] < 0.0:
        out[2] *= yaw[1]


@compiled
def _coriolis(nu: Any, mass: Any, out: Any) -> None:
    """C(nu) nu of a symmetric mass matrix."""
    ahead = mass[0, 0] * nu[0] + mass[0, 1] * nu[1] + mass[0, 2] * nu[2]
    across = mass[1, 0] * nu[0] + mass[1, 1] * nu[1] + mass[1, 2] * nu[2]
    out[0], out[1], out[2] = -across * nu[2], ahead * nu[2], across * nu[0] - ahead * nu[1]


@compiled
def _slope(state: Any, force: Any, filtered: Any, numbers: Any, out: Any) -> None:
    """Derivatives of the velocities over ground in body axes."""
    inverse, total, linear, absolute, lagged, constant, current, _, in_water, _, _, _, coefficients, held, yaw, work = (
        numbers
    )
    cosine, sine = np.cos(state[0]), np.sin(state[0])
    ahead, side = cosine * current[0] + sine * current[1], -sine * current[0] + cosine * current[1]
    nu, drag, inertia, right = work[0, :3], work[1, :3], work[2, :3], work[3, :3]
    nu[0], nu[1], nu[2] = state[1] - ahead, state[2] - side, state[3]
    if len(coefficients) > 0:
        held[0], held[1], held[2] = force[0], force[1], force[2]
        out[0], out[1], out[2] = slopes(coefficients, True, held, nu[0], nu[1], nu[2], 0.0, 0.0, 0.0)
    else:
        _damping(nu, linear, absolute, yaw, drag)
        drag[2] += yaw[2] * state[0]
        _coriolis(nu if in_water else state[1:4], total, inertia)
        for i in range(3):
            right[i] = force[i] + constant[i] - drag[i] - inertia[i]
            for j in range(3):
                right[i] -= lagged[i, j] * filtered[j]
        for i in range(3):
            out[i] = inverse[i, 0] * right[0] + inverse[i, 1] * right[1] + inverse[i, 2] * right[2]
    if in_water:
        # The uniform current turns in body axes.
        out[0] += state[3] * side
        out[1] -= state[3] * ahead


@compiled
def _runge_kutta(state: Any, slope: Any, force: Any, filtered: Any, numbers: Any, step: float) -> None:
    """The rest of a Runge-Kutta step that begins with ``slope``."""
    sums, middle = numbers[-1][4], numbers[-1][5]
    sums[0] = state[3]
    for i in range(3):
        sums[i + 1] = slope[i]
    for stage in range(3):
        part, factor = (step, 1.0) if stage == 2 else (0.5 * step, 2.0)
        middle[0] = state[0] + part * (state[3] if stage == 0 else middle[3])
        for i in range(3):
            middle[i + 1] = state[i + 1] + part * slope[i]
        _slope(middle, force, filtered, numbers, slope)
        sums[0] += factor * middle[3]
        for i in range(3):
            sums[i + 1] += factor * slope[i]
    for i in range(4):
        state[i] += step / 6.0 * sums[i]


@compiled
def _solve(matrix: Any, mass: Any, slope: Any) -> None:
    """Solution of ``matrix`` x = ``mass`` ``slope`` in place of ``slope``, by Gaussian elimination.

    Numba takes seconds to compile numpy's, and slices.
    """
    right = np.empty(3)
    for i in range(3):
        right[i] = mass[i, 0] * slope[0] + mass[i, 1] * slope[1] + mass[i, 2] * slope[2]
    for k in range(3):
        for i in range(k + 1, 3):
            factor = matrix[i, k] / matrix[k, k]
            right[i] -= factor * right[k]
            for j in range(k, 3):
                matrix[i, j] -= factor * matrix[k, j]
    for i in range(2, -1, -1):
        for j in range(i + 1, 3):
            right[i] -= matrix[i, j] * slope[j]
        slope[i] = right[i] / matrix[i, i]


@compiled
def _advance(state: Any, filtered: Any, before: Any, force: Any, numbers: Any) -> None:
    """One step of ``state`` (heading, velocities over ground) in place."""
    _, _, linear, absolute, _, _, current, weight, _, step, scheme, mass, _, _, yaw, work = numbers
    for i in range(3):
        filtered[i] = (1.0 - weight) * filtered[i] + weight * before[i]
    slope = work[6, :3]
    _slope(state, force, filtered, numbers, slope)
    if scheme == 3:
        _runge_kutta(state, slope, force, filtered, numbers, step)
        return
    if scheme == 2:
        # One Newton step of the damping: (M + h dD/dnu) nu' = forces.
        drag, later, nu, matrix = np.empty(3), np.empty(3), state[1:4].copy(), mass.copy()
        _damping(nu, linear, absolute, yaw, drag)
        for j in range(3):
            nudge = 1e-6 * max(abs(nu[j]), 1e-3)
            nu[j] += nudge
            _damping(nu, linear, absolute, yaw, later)
            nu[j] -= nudge
            for i in range(3):
                matrix[i, j] += step * (later[i] - drag[i]) / nudge
        _solve(matrix, mass, slope)
    # The acceleration through the water: the water turns in body axes.
    cosine, sine = np.cos(state[0]), np.sin(state[0])
    ahead, side = cosine * current[0] + sine * current[1], -sine * current[0] + cosine * current[1]
    before[0], before[1], before[2] = slope[0] - state[3] * side, slope[1] + state[3] * ahead, slope[2]
    if scheme == 0:
        for i in range(3):
            state[i + 1] += step * slope[i]
        state[0] += step * state[3]
        return
    u = state[1] + step * (slope[0] - state[3] * state[2])
    v = state[2] + step * (slope[1] + state[3] * state[1])
    state[3] += step * slope[2]
    turn = step * state[3]
    state[0] += turn
    # The velocity in axes of the world stays, and the body turns.
    state[1], state[2] = np.cos(turn) * u + np.sin(turn) * v, -np.sin(turn) * u + np.cos(turn) * v


@compiled
def _run(start: Any, forces: Any, every: int, numbers: Any) -> Any:
    state, filtered, before = start.copy(), np.zeros(3), np.zeros(3)
    rows = np.empty((len(forces) // every, 4))
    for k in range(len(rows) * every):
        if k % every == 0:
            for i in range(4):
                rows[k // every, i] = state[i]
        _advance(state, filtered, before, forces[k], numbers)
    return rows


@compiled
def _decay(starts: Any, count: int, energy_mass: Any, numbers: Any) -> Any:
    found, force = np.empty((len(starts), 2)), np.zeros(3)
    for at in range(len(starts)):
        state, filtered, before = np.zeros(4), np.zeros(3), np.zeros(3)
        for i in range(3):
            state[i + 1] = starts[at, i]
        first = energy = _energy(state, energy_mass)
        last = 0
        for k in range(count):
            _advance(state, filtered, before, force, numbers)
            energy = _energy(state, energy_mass)
            if not energy < AT_REST * first:
                last = k + 1
            if not energy < _DIVERGED * first:
                energy = np.inf
                break
            if energy < _ENDS * first:
                break
        found[at, 0], found[at, 1] = energy / first, float(last)
    return found


@compiled
def _energy(state: Any, mass: Any) -> float:
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += 0.5 * state[i + 1] * mass[i, j] * state[j + 1]
    return total
