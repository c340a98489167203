"""One step of many motions at once, a lane each: a call and a choice of the term serve all of them."""

from __future__ import annotations

from typing import Any

import numba

from rovid.effects import TERMS
from rovid.effects.base import TERM_STATES, Instant
from rovid.ground.compiled import compiled, inlined
from rovid.model.kernels.step import REACH, WEIGHT, acceleration, copy, damping_of
from rovid.model.kernels.torque import jumped, numbers_of, water_of

# What the term of a lane gives, by how many states it has.
_GIVES = (
    ("total[i] += {}(at, p)",),
    ("torque, change[i, j, 0] = {}(at, p, (state[i, j, 0], state[i, j, 1]))", "total[i] += torque"),
    (
        "torque, change[i, j, 0], change[i, j, 1] = {}(at, p, (state[i, j, 0], state[i, j, 1]))",
        "total[i] += torque",
    ),
)


def _any_term() -> Any:
    """Compiled; adds the term of a ``kind`` to the ``total`` of each lane that is ``live``."""
    lines = ["def term(kind, live, rate, slip, angle, start, push, told, body, p, state, change, j, total):"]
    for kind, term in enumerate(TERMS):
        lines += [
            f"    if kind == {kind}:",
            "        for i in live:",
            "            beside = told[i, 0], told[i, 1], told[i, 2]",
            "            at = Instant(rate[i], slip[i], angle[i], start[i], push[i], *beside, body)",
        ]
        lines += [f"            {line.format(f'term_{kind}')}" for line in _GIVES[term.states]]
    namespace: dict[str, Any] = {f"term_{kind}": term.torque for kind, term in enumerate(TERMS)} | {"Instant": Instant}
    exec("\n".join(lines), namespace)  # noqa: S102 - all of it is above
    return numba.njit(error_model="numpy", nogil=True)(namespace["term"])


_term = _any_term()


@compiled
def torques_of(
    live: Any, rate: Any, angle: Any, lanes: Any, terms: Any, body: Any, state: Any, change: Any, slip: Any, total: Any
) -> None:
    """Fill in the ``total`` torque of all terms of each lane, and the rates of ``change`` of its states."""
    push, told, start = lanes
    for i in live:
        total[i], slip[i] = 0.0, rate[i]
    for j in range(terms.moving):
        p = numbers_of(terms, j)
        for i in live:
            slip[i] -= water_of(terms.kinds[j], p, (state[i, j, 0], state[i, j, 1]))
    for j in range(len(terms.kinds)):
        p = numbers_of(terms, j)
        _term(terms.kinds[j], live, rate, slip, angle, start, push, told, body, p, state, change, j, total)


@inlined
def jump_lanes(live: Any, rate: Any, terms: Any, state: Any) -> None:
    """Let the states of each lane jump that do so at its ``rate`` in rad/s."""
    for j in range(terms.remembering if terms.jumping else 0):
        for i in live:
            state[i, j, 0] = jumped(terms.kinds[j], rate[i], (state[i, j, 0], state[i, j, 1]))


@compiled
def step_lanes(
    live: Any,
    r: Any,
    a: Any,
    lanes: Any,
    terms: Any,
    body: Any,
    state: Any,
    h: Any,
    stiffness: Any,
    rooms: Any,
    work: Any,
) -> None:
    """As `rovid.model.kernels.step.step`, of each lane that is ``live``, in place.

    Parameters
    ----------
    r, a, h, stiffness
        (lanes,) rate, angle, step in s, and the fastest rate in 1/s so far, which is raised to the damping.
    lanes
        (lanes,) push in N m, (lanes, 3) race and speeds, (lanes,) position in rad at the start of the trial.
    state
        (lanes, m, TERM_STATES).
    rooms, work
        (7, lanes) and (3, lanes, m, TERM_STATES) of room.
    """
    rate, angle, extra, given, slip, turned, gained = rooms
    change, there, moved = work
    push, rows = lanes[0], terms.remembering
    for i in live:
        rate[i], angle[i] = r[i] + 1e-6 + 1e-4 * abs(r[i]), a[i]
    jump_lanes(live, rate, terms, state)
    torques_of(live, rate, angle, lanes, terms, body, state, change, slip, given)
    jump_lanes(live, r, terms, state)
    for i in live:
        rate[i], turned[i], gained[i] = r[i], 0.0, 0.0
        copy(rows, state[i], there[i])
        copy(rows, state[i], moved[i])
    for stage in range(4):
        weight = WEIGHT[stage]
        reach = REACH[stage] if stage < 3 else 0.0
        torques_of(live, rate, angle, lanes, terms, body, there, change, slip, extra)
        for i in live:
            if stage == 0:
                given[i] = (given[i] - extra[i]) / ((1e-6 + 1e-4 * abs(r[i])) * body.inertia)
            if stage == 1:
                stiffness[i] = max(stiffness[i], damping_of(rate[i], body) - given[i])
            pull = acceleration(rate[i], push[i] + extra[i], body)
            turned[i] += weight * rate[i]
            gained[i] += weight * pull
            angle[i] = a[i] + reach * h[i] * rate[i]
            rate[i] = r[i] + reach * h[i] * pull
            for j in range(rows):
                for c in range(TERM_STATES):
                    moved[i, j, c] += weight * h[i] / 6.0 * change[i, j, c]
                    there[i, j, c] = state[i, j, c] + reach * h[i] * change[i, j, c]
    for i in live:
        r[i] += h[i] * gained[i] / 6.0
        a[i] += h[i] * turned[i] / 6.0
        copy(rows, moved[i], state[i])
