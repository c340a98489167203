"""Compiled Runge-Kutta steps and free-running simulation of the planar model.

State: heading; u, v, r through the water; disturbances X, Y, N; change of the current to north and to east; position to
north and to east. Arrays have room for all of them. Rows that are not in use stay zero.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.jit.decorators import compiled
from rovid.planar.equations import fastest, has_couplings, slopes, speed_jacobian
from rovid.planar.model import CURRENT_INDEX

# Room for the states, a whole number of SIMD vectors.
STATES = 12
HEADING, SURGE, YAW, FORCE, CURRENT, NORTH = 0, 1, 3, 4, 7, 9
# Step in shares of the shortest time constant; the transition matrix is a series of fourth order.
STEP_SHARE = 0.4
MAX_SUBSTEPS = 50


@compiled
def advance_state(
    c: Any, coupled: bool, yaw_only: bool, held: Any, decays: Any, h: float, north: float, east: float, x: Any
) -> None:
    """Runge-Kutta step of heading, speeds and position of ``x`` over ``h`` s in a current to ``north`` and ``east``."""
    psi, u, v, r = x[0], x[1], x[2], x[3]
    dx, dy, dn = x[FORCE], x[FORCE + 1], x[FORCE + 2]
    if yaw_only:
        inverse, linear, quadratic, torque = 1.0 / c[2], c[6], c[9], held[2]
        a1 = (torque + dn - (linear + quadratic * abs(r)) * r) * inverse
        r2 = r + 0.5 * h * a1
        a2 = (torque + dn * decays[0, 2] - (linear + quadratic * abs(r2)) * r2) * inverse
        r3 = r + 0.5 * h * a2
        a3 = (torque + dn * decays[0, 2] - (linear + quadratic * abs(r3)) * r3) * inverse
        r4 = r + h * a3
        a4 = (torque + dn * decays[1, 2] - (linear + quadratic * abs(r4)) * r4) * inverse
        x[0] = psi + h / 6.0 * (r + 2.0 * r2 + 2.0 * r3 + r4)
        x[3] = r + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        return
    mx, my, mn = dx * decays[0, 0], dy * decays[0, 1], dn * decays[0, 2]
    au1, av1, ar1 = slopes(c, coupled, held, u, v, r, dx, dy, dn)
    u2, v2, r2 = u + 0.5 * h * au1, v + 0.5 * h * av1, r + 0.5 * h * ar1
    au2, av2, ar2 = slopes(c, coupled, held, u2, v2, r2, mx, my, mn)
    u3, v3, r3 = u + 0.5 * h * au2, v + 0.5 * h * av2, r + 0.5 * h * ar2
    au3, av3, ar3 = slopes(c, coupled, held, u3, v3, r3, mx, my, mn)
    u4, v4, r4 = u + h * au3, v + h * av3, r + h * ar3
    au4, av4, ar4 = slopes(c, coupled, held, u4, v4, r4, dx * decays[1, 0], dy * decays[1, 1], dn * decays[1, 2])
    x[0] = psi + h / 6.0 * (r + 2.0 * r2 + 2.0 * r3 + r4)
    x[1] = u + h / 6.0 * (au1 + 2.0 * au2 + 2.0 * au3 + au4)
    x[2] = v + h / 6.0 * (av1 + 2.0 * av2 + 2.0 * av3 + av4)
    x[3] = r + h / 6.0 * (ar1 + 2.0 * ar2 + 2.0 * ar3 + ar4)
    # Simpson's rule for the position; heading and speeds in the middle of the step are those of the cubic through both
    # ends.
    um = 0.5 * (u + x[1]) + h / 8.0 * (au1 - au4)
    vm = 0.5 * (v + x[2]) + h / 8.0 * (av1 - av4)
    pm = 0.5 * (psi + x[0]) + h / 8.0 * (r - x[3])
    c0, s0, c1, s1, c2, s2 = math.cos(psi), math.sin(psi), math.cos(pm), math.sin(pm), math.cos(x[0]), math.sin(x[0])
    x[NORTH] += h * north + h / 6.0 * (u * c0 - v * s0 + 4.0 * (um * c1 - vm * s1) + x[1] * c2 - x[2] * s2)
    x[NORTH + 1] += h * east + h / 6.0 * (u * s0 + v * c0 + 4.0 * (um * s1 + vm * c1) + x[1] * s2 + x[2] * c2)


@compiled
def simulate_runs(
    offsets: Any, time: Any, inputs: Any, starts: Any, speed_scale: Any, yaw_only: bool, c: Any, states: Any
) -> None:
    """Free-running simulation of one run after the other, from (runs, 6) ``starts`` as of the filter.

    Writes (n, 12) ``states``; the forces of the disturbance stay zero.
    """
    x, decays, jacobian = np.zeros(STATES), np.ones((2, 4)), np.zeros((3, 3))
    coupled = has_couplings(c)
    north, east = c[CURRENT_INDEX], c[CURRENT_INDEX + 1]
    for run in range(len(offsets) - 1):
        x[:] = 0.0
        cosine, sine = math.cos(starts[run, 0]), math.sin(starts[run, 0])
        x[HEADING], x[YAW] = starts[run, 0], starts[run, 3]
        if not yaw_only:
            x[SURGE] = starts[run, 1] - north * cosine - east * sine
            x[SURGE + 1] = starts[run, 2] + north * sine - east * cosine
            x[NORTH], x[NORTH + 1] = starts[run, 4], starts[run, 5]
        for k in range(offsets[run], offsets[run + 1]):
            if k > offsets[run]:
                interval, held = time[k] - time[k - 1], inputs[k - 1]
                speed_jacobian(c, coupled, held, speed_scale, x[1], x[2], x[3], jacobian)
                steps = min(int(interval * fastest(c, jacobian, yaw_only) / STEP_SHARE) + 1, MAX_SUBSTEPS)
                for _ in range(steps):
                    advance_state(c, coupled, yaw_only, held, decays, interval / steps, north, east, x)
            for j in range(STATES):
                states[k, j] = x[j]
