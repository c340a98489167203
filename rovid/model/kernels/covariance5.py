"""Propagation of the covariance of five states, see `rovid.model.kernels.ekf5`.

Matrices are (25, LANES), row by row. Of symmetric ones the entries on and above the diagonal count.
"""

from typing import Any, NamedTuple

import numpy as np

from rovid.jit.simd import broadcast, load, store, traced
from rovid.model.kernels.ekf3 import NODES, WEIGHTS

SIZE = 5
# Terms of the Taylor series of the transition.
_ORDER = 6
# Entries of the transition outside the disturbance's row, and of the noise covariance on and above the diagonal.
_TRANSITION = tuple(SIZE * i + j for i in (0, 1, 3, 4) for j in range(SIZE))
_NOISE = tuple(SIZE * i + j for i in range(SIZE) for j in range(i, SIZE))
# Both are interpolated by polynomials in the damping times the step: at Chebyshev points from 0 to 0.7.
DAMPED = 0.35 * (1.0 - np.cos((2.0 * np.arange(6) + 1.0) * np.pi / 12.0))
POWERS = np.linalg.inv(np.vander(DAMPED, increasing=True))
POINTS, SERIES = len(DAMPED), len(DAMPED) * (len(_TRANSITION) + len(_NOISE))


class Slopes(NamedTuple):
    """Entries of the linearised system matrix that are not known in advance, as vectors.

    The rows of the angle and of the fourth state are known: both are integrals of the states after them.
    """

    rate_angle: Any
    rate_rate: Any
    rate_disturbance: Any
    rate_fourth: Any
    rate_fifth: Any
    disturbance: Any
    fifth_rate: Any
    fifth_fourth: Any
    fifth_fifth: Any


@traced
def add_point(powers: Any, point: int, f: Any, q: Any, series: Any) -> None:
    """Add the values ``f`` and ``q`` at a Chebyshev ``point`` to the coefficients in ``series``."""
    for n in range(POINTS):
        weight = broadcast(powers[n, point])
        for place, at in enumerate(_TRANSITION):
            store(series, POINTS * place + n, load(series, POINTS * place + n) + weight * load(f, at))
        for place, at in enumerate(_NOISE, len(_TRANSITION)):
            store(series, POINTS * place + n, load(series, POINTS * place + n) + weight * load(q, at))


@traced
def evaluate_series(series: Any, damped: Any, f: Any, q: Any) -> None:
    """Write transition ``f`` and noise covariance ``q`` by their polynomials in ``damped``, damping times step."""
    for place, at in enumerate(_TRANSITION):
        store(f, at, _polynomial(series, POINTS * place, damped))
    for place, at in enumerate(_NOISE, len(_TRANSITION)):
        store(q, at, _polynomial(series, POINTS * place, damped))


@traced
def _polynomial(series: Any, at: int, x: Any) -> Any:
    total = load(series, at + POINTS - 1)
    for n in range(2, POINTS + 1):
        total = total * x + load(series, at + POINTS - n)
    return total


@traced
def transition(system: Any, h: float, f: Any) -> None:
    """Write exp(A h) into ``f`` by its Taylor series, all rows but the disturbance's.

    The rows y of the powers of A are computed for rate and fifth state. Angle and fourth state are their integrals.
    """
    zero, one = broadcast(0.0), broadcast(1.0)
    for at in (0, 3):
        is_angle = at == 0
        y0, y1, y2, y3, y4 = zero, one if is_angle else zero, zero, zero, zero if is_angle else one
        a0, a1, a2 = one if is_angle else zero, h * y1, zero
        a3, a4 = zero if is_angle else one, h * y4
        r0, r1, r2, r3, r4 = y0, y1, y2, y3, y4
        factor = h
        for order in range(2, _ORDER + 2):
            y0, y1, y2, y3, y4 = (
                y1 * system.rate_angle,
                y0 + y1 * system.rate_rate + y4 * system.fifth_rate,
                y1 * system.rate_disturbance + y2 * system.disturbance,
                y1 * system.rate_fourth + y4 * system.fifth_fourth,
                y1 * system.rate_fifth + y3 + y4 * system.fifth_fifth,
            )
            r0, r1, r2 = r0 + factor * y0, r1 + factor * y1, r2 + factor * y2
            r3, r4 = r3 + factor * y3, r4 + factor * y4
            factor = factor * h / order
            a0, a1, a2 = a0 + factor * y0, a1 + factor * y1, a2 + factor * y2
            a3, a4 = a3 + factor * y3, a4 + factor * y4
        _store_row(f, at, (a0, a1, a2, a3, a4))
        _store_row(f, at + 1, (r0, r1, r2, r3, r4))


@traced
def _store_row(f: Any, row: int, x: Any) -> None:
    for j in range(SIZE):
        store(f, SIZE * row + j, x[j])


@traced
def add_noise(system: Any, intensity: Any, h: float, q: Any) -> None:
    """Add to ``q`` the covariance that white noise of this ``intensity`` in each state causes in ``h`` s.

    The integral of exp(A t) g g^T exp(A t)^T by Gauss-Legendre quadrature, with exp(A t) g by its Taylor series. The
    result is positive semidefinite.
    """
    for node in range(3):
        t, weight = NODES[node] * h, WEIGHTS[node] * h
        v0, v1, v2, v3, v4 = c0, c1, c2, c3, c4 = intensity
        for order in range(1, _ORDER + 1):
            share = t / order
            v0, v1, v2, v3, v4 = (
                share * v1,
                share
                * (
                    system.rate_angle * v0
                    + system.rate_rate * v1
                    + system.rate_disturbance * v2
                    + system.rate_fourth * v3
                    + system.rate_fifth * v4
                ),
                share * system.disturbance * v2,
                share * v4,
                share * (system.fifth_rate * v1 + system.fifth_fourth * v3 + system.fifth_fifth * v4),
            )
            c0, c1, c2, c3, c4 = c0 + v0, c1 + v1, c2 + v2, c3 + v3, c4 + v4
        c = (c0, c1, c2, c3, c4)
        for i in range(SIZE):
            for j in range(i, SIZE):
                at = SIZE * i + j
                store(q, at, load(q, at) + weight * c[i] * c[j])


@traced
def congruence(f: Any, p: Any, q: Any, scratch: Any) -> None:
    """Write f p f^T + q into ``p``. The disturbance's row of ``f`` has its diagonal entry alone."""
    for j in range(SIZE):
        column = (upper(p, 0, j), upper(p, 1, j), upper(p, 2, j), upper(p, 3, j), upper(p, 4, j))
        for i in range(SIZE):
            store(scratch, SIZE * i + j, load(f, SIZE * i + 2) * column[2] if i == 2 else _times(f, i, column))
    for i in range(SIZE):
        at = SIZE * i
        row = (
            load(scratch, at),
            load(scratch, at + 1),
            load(scratch, at + 2),
            load(scratch, at + 3),
            load(scratch, at + 4),
        )
        for j in range(i, SIZE):
            total = row[2] * load(f, SIZE * j + 2) if j == 2 else _times(f, j, row)
            store(p, SIZE * i + j, load(q, SIZE * i + j) + total)


@traced
def subtract_square(p: Any, column: Any, share: Any) -> None:
    """Subtract ``share * column * column^T`` from ``p``."""
    for i in range(SIZE):
        for j in range(i, SIZE):
            store(p, SIZE * i + j, load(p, SIZE * i + j) - column[i] * share * column[j])


@traced
def upper(p: Any, i: int, j: int) -> Any:
    """Entry (i, j) of a symmetric matrix."""
    return load(p, SIZE * i + j) if i <= j else load(p, SIZE * j + i)


@traced
def _times(f: Any, row: int, x: Any) -> Any:
    """A row of ``f`` times a column of five."""
    at = SIZE * row
    first = load(f, at) * x[0] + load(f, at + 1) * x[1] + load(f, at + 2) * x[2]
    return first + load(f, at + 3) * x[3] + load(f, at + 4) * x[4]
