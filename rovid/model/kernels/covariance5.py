"""How the covariance of five states goes on: angle, rate, disturbance, and two that swing, the first their integral.

Matrices are (25, LANES), row by row; of the symmetric ones what stands on and above the diagonal counts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rovid.jit.simd import broadcast, load, store
from rovid.jit.tracing import traced
from rovid.model.kernels.ekf3 import NODES, WEIGHTS

SIZE = 5
# Of the series for the transition.
_ORDER = 6
# Of the transition what the disturbance's row does not say, and of the noise what stands on and above the diagonal.
_MOVED = tuple(SIZE * i + j for i in (0, 1, 3, 4) for j in range(SIZE))
_GROWN = tuple(SIZE * i + j for i in range(SIZE) for j in range(i, SIZE))
# How strongly the rate is damped at the points by which both are told, over a step; and by them the powers of that.
DAMPED = 0.35 * (1.0 - np.cos((2.0 * np.arange(6) + 1.0) * np.pi / 12.0))
POWERS = np.linalg.inv(np.vander(DAMPED, increasing=True))
POINTS, SERIES = len(DAMPED), len(DAMPED) * (len(_MOVED) + len(_GROWN))


class Swing(NamedTuple):
    """Slopes of the five states by time that are not known beforehand, by the state and what it depends on; lanes.

    Of the angle and the fourth state it is known: they are the integrals of those behind them.
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
    """Add to the ``series`` of ``powers`` what ``f`` and ``q`` are at a ``point``."""
    for n in range(POINTS):
        weight = broadcast(powers[n, point])
        for place, at in enumerate(_MOVED):
            store(series, POINTS * place + n, load(series, POINTS * place + n) + weight * load(f, at))
        for place, at in enumerate(_GROWN, start=len(_MOVED)):
            store(series, POINTS * place + n, load(series, POINTS * place + n) + weight * load(q, at))


@traced
def by_series(series: Any, damped: Any, f: Any, q: Any) -> None:
    """Write transition and noise by their ``series`` into ``f`` and ``q``, so strongly ``damped`` over a step."""
    for place, at in enumerate(_MOVED):
        store(f, at, _polynomial(series, POINTS * place, damped))
    for place, at in enumerate(_GROWN, start=len(_MOVED)):
        store(q, at, _polynomial(series, POINTS * place, damped))


@traced
def _polynomial(series: Any, at: int, x: Any) -> Any:
    total = load(series, at + POINTS - 1)
    for n in range(2, POINTS + 1):
        total = total * x + load(series, at + POINTS - n)
    return total


@traced
def transition(swing: Any, h: float, f: Any) -> None:
    """Write exp(slopes h) into ``f``, by its series, but what a step leaves of the disturbance.

    Row by row: the derivative of the angle's row is the rate's, and so it is of the two states, the first of which is
    the integral of the other.
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
                y1 * swing.rate_angle,
                y0 + y1 * swing.rate_rate + y4 * swing.fifth_rate,
                y1 * swing.rate_disturbance + y2 * swing.disturbance,
                y1 * swing.rate_fourth + y4 * swing.fifth_fourth,
                y1 * swing.rate_fifth + y3 + y4 * swing.fifth_fifth,
            )
            r0, r1, r2 = r0 + factor * y0, r1 + factor * y1, r2 + factor * y2
            r3, r4 = r3 + factor * y3, r4 + factor * y4
            factor = factor * h / order
            a0, a1, a2 = a0 + factor * y0, a1 + factor * y1, a2 + factor * y2
            a3, a4 = a3 + factor * y3, a4 + factor * y4
        _write_row(f, at, (a0, a1, a2, a3, a4))
        _write_row(f, at + 1, (r0, r1, r2, r3, r4))


@traced
def _write_row(f: Any, row: int, x: Any) -> None:
    store(f, SIZE * row, x[0])
    store(f, SIZE * row + 1, x[1])
    store(f, SIZE * row + 2, x[2])
    store(f, SIZE * row + 3, x[3])
    store(f, SIZE * row + 4, x[4])


@traced
def add_noise(swing: Any, kicks: Any, h: float, q: Any) -> None:
    """Add to ``q`` what white noise that ``kicks`` the five states so much grows in ``h`` s.

    By Gauss and Legendre, with its path to each node as a series: no covariance comes out of that negative.
    """
    for node in range(3):
        t, weight = NODES[node] * h, WEIGHTS[node] * h
        v0, v1, v2, v3, v4 = c0, c1, c2, c3, c4 = kicks
        for order in range(1, _ORDER + 1):
            share = t / order
            v0, v1, v2, v3, v4 = (
                share * v1,
                share
                * (
                    swing.rate_angle * v0
                    + swing.rate_rate * v1
                    + swing.rate_disturbance * v2
                    + swing.rate_fourth * v3
                    + swing.rate_fifth * v4
                ),
                share * swing.disturbance * v2,
                share * v4,
                share * (swing.fifth_rate * v1 + swing.fifth_fourth * v3 + swing.fifth_fifth * v4),
            )
            c0, c1, c2, c3, c4 = c0 + v0, c1 + v1, c2 + v2, c3 + v3, c4 + v4
        _add_to_row(q, 0, weight * c0, (c0, c1, c2, c3, c4))
        _add_to_row(q, 1, weight * c1, (c0, c1, c2, c3, c4))
        _add_to_row(q, 2, weight * c2, (c0, c1, c2, c3, c4))
        _add_to_row(q, 3, weight * c3, (c0, c1, c2, c3, c4))
        _add_to_row(q, 4, weight * c4, (c0, c1, c2, c3, c4))


@traced
def _add_to_row(q: Any, row: int, by: Any, c: Any) -> None:
    """Add ``by`` times ``c`` on and above the diagonal."""
    for j in range(SIZE):
        if j >= row:
            store(q, SIZE * row + j, load(q, SIZE * row + j) + by * c[j])


@traced
def congruence(f: Any, p: Any, q: Any, room: Any) -> None:
    """Write f p f^T + q into ``p``; the disturbance follows from itself alone."""
    for j in range(SIZE):
        p0, p1, p2 = upper(p, 0, j), upper(p, 1, j), upper(p, 2, j)
        p3, p4 = upper(p, 3, j), upper(p, 4, j)
        for i in range(SIZE):
            if i == 2:
                store(room, SIZE * i + j, load(f, SIZE * i + 2) * p2)
            else:
                store(room, SIZE * i + j, _times(f, i, (p0, p1, p2, p3, p4)))
    for i in range(SIZE):
        row = (
            load(room, SIZE * i),
            load(room, SIZE * i + 1),
            load(room, SIZE * i + 2),
            load(room, SIZE * i + 3),
            load(room, SIZE * i + 4),
        )
        for j in range(i, SIZE):
            total = row[2] * load(f, SIZE * j + 2) if j == 2 else _times(f, j, row)
            store(p, SIZE * i + j, load(q, SIZE * i + j) + total)


@traced
def take(p: Any, column: Any, share: Any) -> None:
    """Take a ``share`` of the square of a ``column`` of ``p`` from it."""
    for i in range(SIZE):
        for j in range(i, SIZE):
            store(p, SIZE * i + j, load(p, SIZE * i + j) - column[i] * share * column[j])


@traced
def upper(p: Any, i: int, j: int) -> Any:
    """Entry of a symmetric matrix, which stands on or above the diagonal."""
    return load(p, SIZE * i + j) if i <= j else load(p, SIZE * j + i)


@traced
def _times(f: Any, row: int, x: Any) -> Any:
    """A row of ``f`` times a column of five."""
    at = SIZE * row
    first = load(f, at) * x[0] + load(f, at + 1) * x[1] + load(f, at + 2) * x[2]
    return first + load(f, at + 3) * x[3] + load(f, at + 4) * x[4]
