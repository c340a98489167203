"""Motion in surge, sway and yaw as simulators compute it: their terms, their integrator, their step.

In axes x ahead, y to starboard, z down, with nu through the water and C of the mass matrix (Fossen 2011, (6.65)):

    M nu' + C(nu) nu = tau + constant - linear nu - sum over j, k of absolute[:, j, k] nu_j |nu_k|

A part of M may be lagged: it multiplies the acceleration of the step before, through a filter (uuv_simulator).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import compiled

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
        return _run(start, np.ascontiguousarray(forces), every, *self._numbers(self.step))

    def decay(self, starts: FloatArray, step: float, count: int) -> FloatArray:
        """(m, 2) kinetic energy at the end over the initial one, and number of steps to rest; in still water.

        ``starts``: (m, 3) velocities; ``count`` steps of ``step`` s.
        """
        numbers = list(self._numbers(step))
        numbers[5:7] = np.zeros(3), np.zeros(2)
        return _decay(np.ascontiguousarray(starts), count, self.total_mass, *numbers)

    def _numbers(self, step: float) -> tuple[object, ...]:
        return (
            np.linalg.inv(self.mass),
            self.total_mass,
            np.ascontiguousarray(self.linear),
            np.ascontiguousarray(self.absolute),
            np.ascontiguousarray(self.lagged),
            np.asarray(self.constant, dtype=np.float64),
            np.asarray(self.current, dtype=np.float64),
            self.filter_weight,
            self.inertia_in_water,
            step,
            int(self.scheme),
            np.ascontiguousarray(self.mass),
        )


@compiled
def _damping(nu: FloatArray, linear: FloatArray, absolute: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        total = 0.0
        for j in range(3):
            factor = linear[i, j]
            for k in range(3):
                factor += absolute[i, j, k] * abs(nu[k])
            total += factor * nu[j]
        out[i] = total


@compiled
def _coriolis(nu: FloatArray, mass: FloatArray, out: FloatArray) -> None:
    """C(nu) nu of a symmetric mass matrix."""
    ahead = mass[0, 0] * nu[0] + mass[0, 1] * nu[1] + mass[0, 2] * nu[2]
    across = mass[1, 0] * nu[0] + mass[1, 1] * nu[1] + mass[1, 2] * nu[2]
    out[0], out[1], out[2] = -across * nu[2], ahead * nu[2], across * nu[0] - ahead * nu[1]


@compiled
def _slope(
    state: FloatArray,
    force: FloatArray,
    filtered: FloatArray,
    inverse: FloatArray,
    total_mass: FloatArray,
    linear: FloatArray,
    absolute: FloatArray,
    lagged: FloatArray,
    constant: FloatArray,
    current: FloatArray,
    in_water: bool,
    out: FloatArray,
) -> None:
    """Derivatives of the velocities over ground in body axes."""
    cosine, sine = np.cos(state[0]), np.sin(state[0])
    ahead, side = cosine * current[0] + sine * current[1], -sine * current[0] + cosine * current[1]
    nu = np.array([state[1] - ahead, state[2] - side, state[3]])
    drag, inertia = np.empty(3), np.empty(3)
    _damping(nu, linear, absolute, drag)
    _coriolis(nu if in_water else state[1:4], total_mass, inertia)
    right = np.empty(3)
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
def _advance(
    state: FloatArray,
    filtered: FloatArray,
    before: FloatArray,
    force: FloatArray,
    inverse: FloatArray,
    total_mass: FloatArray,
    linear: FloatArray,
    absolute: FloatArray,
    lagged: FloatArray,
    constant: FloatArray,
    current: FloatArray,
    weight: float,
    in_water: bool,
    step: float,
    scheme: int,
    mass: FloatArray,
) -> None:
    """One step of ``state`` (heading, velocities over ground) in place."""
    for i in range(3):
        filtered[i] = (1.0 - weight) * filtered[i] + weight * before[i]
    slope = np.empty(3)
    _slope(state, force, filtered, inverse, total_mass, linear, absolute, lagged, constant, current, in_water, slope)
    if scheme == 3:
        sum_nu, sum_heading = slope.copy(), state[3]
        middle = np.empty(4)
        for stage in range(3):
            part = step if stage == 2 else 0.5 * step
            middle[0] = state[0] + part * (state[3] if stage == 0 else middle[3])
            for i in range(3):
                middle[i + 1] = state[i + 1] + part * slope[i]
            _slope(
                middle,
                force,
                filtered,
                inverse,
                total_mass,
                linear,
                absolute,
                lagged,
                constant,
                current,
                in_water,
                slope,
            )
            factor = 1.0 if stage == 2 else 2.0
            sum_heading += factor * middle[3]
            for i in range(3):
                sum_nu[i] += factor * slope[i]
        state[0] += step * sum_heading / 6.0
        for i in range(3):
            state[i + 1] += step * sum_nu[i] / 6.0
        return
    if scheme == 2:
        # One Newton step of the damping: (M + h dD/dnu) nu' = forces.
        drag, later, nu = np.empty(3), np.empty(3), state[1:4].copy()
        _damping(nu, linear, absolute, drag)
        matrix = mass.copy()
        for j in range(3):
            nudge = 1e-6 * max(abs(nu[j]), 1e-3)
            nu[j] += nudge
            _damping(nu, linear, absolute, later)
            nu[j] -= nudge
            for i in range(3):
                matrix[i, j] += step * (later[i] - drag[i]) / nudge
        slope = np.linalg.solve(matrix, mass @ slope)
    # Velocity of the water in the acceleration through the water: it turns in body axes.
    cosine, sine = np.cos(state[0]), np.sin(state[0])
    ahead, side = cosine * current[0] + sine * current[1], -sine * current[0] + cosine * current[1]
    before[0], before[1], before[2] = slope[0] - state[3] * side, slope[1] + state[3] * ahead, slope[2]
    if scheme == 0:
        for i in range(3):
            state[i + 1] += step * slope[i]
        state[0] += step * state[3]
        return
    across = slope[1] + state[3] * state[1]
    along = slope[0] - state[3] * state[2]
    u, v = state[1] + step * along, state[2] + step * across
    state[3] += step * slope[2]
    state[0] += step * state[3]
    # The velocity in axes of the world stays, and the body turns.
    turn_cosine, turn_sine = np.cos(step * state[3]), np.sin(step * state[3])
    state[1], state[2] = turn_cosine * u + turn_sine * v, -turn_sine * u + turn_cosine * v


@compiled
def _run(
    start: FloatArray,
    forces: FloatArray,
    every: int,
    inverse: FloatArray,
    total_mass: FloatArray,
    linear: FloatArray,
    absolute: FloatArray,
    lagged: FloatArray,
    constant: FloatArray,
    current: FloatArray,
    weight: float,
    in_water: bool,
    step: float,
    scheme: int,
    mass: FloatArray,
) -> FloatArray:
    state, filtered, before = start.copy(), np.zeros(3), np.zeros(3)
    rows = np.empty((len(forces) // every, 4))
    for k in range(len(rows) * every):
        if k % every == 0:
            rows[k // every] = state
        _advance(
            state,
            filtered,
            before,
            forces[k],
            inverse,
            total_mass,
            linear,
            absolute,
            lagged,
            constant,
            current,
            weight,
            in_water,
            step,
            scheme,
            mass,
        )
    return rows


@compiled
def _decay(
    starts: FloatArray,
    count: int,
    energy_mass: FloatArray,
    inverse: FloatArray,
    total_mass: FloatArray,
    linear: FloatArray,
    absolute: FloatArray,
    lagged: FloatArray,
    constant: FloatArray,
    current: FloatArray,
    weight: float,
    in_water: bool,
    step: float,
    scheme: int,
    mass: FloatArray,
) -> FloatArray:
    found = np.empty((len(starts), 2))
    force = np.zeros(3)
    for at in range(len(starts)):
        state, filtered, before = np.zeros(4), np.zeros(3), np.zeros(3)
        state[1:] = starts[at]
        first = energy = _energy(state, energy_mass)
        last = 0
        for k in range(count):
            _advance(
                state,
                filtered,
                before,
                force,
                inverse,
                total_mass,
                linear,
                absolute,
                lagged,
                constant,
                current,
                weight,
                in_water,
                step,
                scheme,
                mass,
            )
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
def _energy(state: FloatArray, mass: FloatArray) -> float:
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += 0.5 * state[i + 1] * mass[i, j] * state[j + 1]
    return total
