"""What the compiled terms of the equation of motion are told."""

from __future__ import annotations

from typing import NamedTuple

from rovid.jit.decorators import compiled

# Room for each term of the equation of motion: parameters and states of its own.
TERM_PARAMETERS = 4
TERM_STATES = 2
# Of a term: its parameters in their order, or its states.
Numbers = tuple[float, ...]


class Body(NamedTuple):
    """The plain model that effects are added to; in yaw, SI and rad.

    ``stiffness`` in N m/rad and ``trim`` in rad are those of the restoring torque, 0 along an axis without one.
    """

    inertia: float
    quadratic_drag: float
    linear_drag: float
    stiffness: float = 0.0
    trim: float = 0.0


class Instant(NamedTuple):
    """The motion at one instant, and what else there is.

    Attributes
    ----------
    rate, slip
        rad/s, over ground and through the water about the hull, which may go along.
    angle, start
        rad, since the start of the trial, and the position there: their sum is the position, in yaw the heading.
    push
        N m, the thrusters' torque.
    race
        N^0.5 m^2, the sum over the thrusters of the root of their thrust times their arm squared.
    surge, sway
        m/s, ahead and to starboard.
    body
        The plain model.
    """

    rate: float
    relative_rate: float
    angle: float
    start: float
    thruster_torque: float
    wash: float
    surge: float
    sway: float
    body: Body


@compiled
def drag(body: Body, rate: float) -> float:
    """Drag in N m of the plain model at ``rate`` in rad/s through the water; against it."""
    return (body.quadratic_drag * abs(rate) + body.linear_drag) * rate
