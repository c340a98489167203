"""How the covariance of five states goes on: angle, rate, disturbance, and two that swing, the first their integral."""

from __future__ import annotations

import math
from typing import Any

from rovid.ground.compiled import inlined
from rovid.model.kernels.filter import NODES, WEIGHTS

# Of the series for the transition: good to 1e-4 at such steps.
_ORDER = 4


@inlined
def transition(slopes: Any, h: float, f: Any) -> None:
    """Write exp(slopes h) into ``f``, by its series.

    Row by row: the derivative of the angle's row is the rate's, and so it is of the two states, the first of which is
    the integral of the other.
    """
    f[2, 2] = math.exp(slopes[2, 2] * h)
    for at in (0, 3):
        y0, y1, y2, y3, y4 = 0.0, 1.0 if at == 0 else 0.0, 0.0, 0.0, 1.0 if at == 3 else 0.0
        a0, a1, a2, a3, a4 = 1.0 if at == 0 else 0.0, h * y1, 0.0, 1.0 if at == 3 else 0.0, h * y4
        r0, r1, r2, r3, r4 = y0, y1, y2, y3, y4
        factor = h
        for order in range(2, _ORDER + 2):
            y0, y1, y2, y3, y4 = (
                y1 * slopes[1, 0],
                y0 + y1 * slopes[1, 1] + y4 * slopes[4, 1],
                y1 * slopes[1, 2] + y2 * slopes[2, 2],
                y1 * slopes[1, 3] + y4 * slopes[4, 3],
                y1 * slopes[1, 4] + y3 + y4 * slopes[4, 4],
            )
            r0 += factor * y0
            r1 += factor * y1
            r2 += factor * y2
            r3 += factor * y3
            r4 += factor * y4
            factor *= h / order
            a0 += factor * y0
            a1 += factor * y1
            a2 += factor * y2
            a3 += factor * y3
            a4 += factor * y4
        angle, rate = f[at], f[at + 1]
        angle[0] = a0
        angle[1] = a1
        angle[2] = a2
        angle[3] = a3
        angle[4] = a4
        rate[0] = r0
        rate[1] = r1
        rate[2] = r2
        rate[3] = r3
        rate[4] = r4


@inlined
def add_noise(slopes: Any, into: int, size: float, h: float, q: Any) -> None:
    """Add to ``q``, on and above its diagonal, what white noise of ``size`` into the state ``into`` grows in ``h`` s.

    By Gauss and Legendre, with its path to each node as a series: no covariance comes out of that negative.
    """
    for node in range(3):
        t, weight = NODES[node] * h, WEIGHTS[node] * h
        v0, v1, v2, v3, v4 = 0.0, 0.0, size if into == 2 else 0.0, 0.0, size if into == 4 else 0.0
        c0, c1, c2, c3, c4 = v0, v1, v2, v3, v4
        for order in range(1, _ORDER + 1):
            share = t / order
            v0, v1, v2, v3, v4 = (
                share * v1,
                share
                * (slopes[1, 0] * v0 + slopes[1, 1] * v1 + slopes[1, 2] * v2 + slopes[1, 3] * v3 + slopes[1, 4] * v4),
                share * slopes[2, 2] * v2,
                share * v4,
                share * (slopes[4, 1] * v1 + slopes[4, 3] * v3 + slopes[4, 4] * v4),
            )
            c0 += v0
            c1 += v1
            c2 += v2
            c3 += v3
            c4 += v4
        q[0, 0] += weight * c0 * c0
        q[0, 1] += weight * c0 * c1
        q[0, 2] += weight * c0 * c2
        q[0, 3] += weight * c0 * c3
        q[0, 4] += weight * c0 * c4
        q[1, 1] += weight * c1 * c1
        q[1, 2] += weight * c1 * c2
        q[1, 3] += weight * c1 * c3
        q[1, 4] += weight * c1 * c4
        q[2, 2] += weight * c2 * c2
        q[2, 3] += weight * c2 * c3
        q[2, 4] += weight * c2 * c4
        q[3, 3] += weight * c3 * c3
        q[3, 4] += weight * c3 * c4
        q[4, 4] += weight * c4 * c4


@inlined
def congruence(f: Any, p: Any, q: Any, room: Any) -> None:
    """Write f p f^T + q into ``p``; the disturbance follows from itself alone."""
    for j in range(5):
        p0 = p[0, j]
        p1 = p[1, j]
        p2 = p[2, j]
        p3 = p[3, j]
        p4 = p[4, j]
        room[0, j] = f[0, 0] * p0 + f[0, 1] * p1 + f[0, 2] * p2 + f[0, 3] * p3 + f[0, 4] * p4
        room[1, j] = f[1, 0] * p0 + f[1, 1] * p1 + f[1, 2] * p2 + f[1, 3] * p3 + f[1, 4] * p4
        room[2, j] = f[2, 2] * p2
        room[3, j] = f[3, 0] * p0 + f[3, 1] * p1 + f[3, 2] * p2 + f[3, 3] * p3 + f[3, 4] * p4
        room[4, j] = f[4, 0] * p0 + f[4, 1] * p1 + f[4, 2] * p2 + f[4, 3] * p3 + f[4, 4] * p4
    for i in range(5):
        r0 = room[i, 0]
        r1 = room[i, 1]
        r2 = room[i, 2]
        r3 = room[i, 3]
        r4 = room[i, 4]
        for j in range(i, 5):
            total = r0 * f[j, 0] + r1 * f[j, 1] + r2 * f[j, 2] + r3 * f[j, 3] + r4 * f[j, 4]
            p[i, j] = p[j, i] = q[i, j] + total
