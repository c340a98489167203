"""The control law: model aid, and PD on heading and yaw rate."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import TERMS
from rovid.effects.base import TERM_STATES, Instant
from rovid.model.model import Model

# The shapes of all torques of the catalogue that act at rest: constant, winding up, and once and twice a turn.
STATIC_TERMS = 7
_TURNS = np.linspace(-2.0, 2.0, 97) * 2.0 * math.pi


class ControllerState(NamedTuple):
    """What the controller remembers: heading read last in rad, filtered rate in rad/s, angle turned in rad."""

    heading: float
    rate: float
    turned: float


@dataclass(frozen=True, kw_only=True)
class ControlLaw:
    """Model-aided PD (Ramesh et al. 2013, eq. 12), sampled.

    ``T = I*wanted_acceleration + DQ*|r|*r + DL*r + hold + kp*(wanted - heading) + kd*(wanted_rate - r)``

    where r is the difference of two headings over the period, behind a first-order low pass. A step has neither a
    wanted rate nor a wanted acceleration.

    Attributes
    ----------
    kp, kd
        N m/rad and N m s/rad.
    inertia, quadratic_drag, linear_drag
        Of the aid, in kg m^2, N m s^2/rad^2 and N m s/rad; all zero: no aid.
    hold
        (7,) N m against the torques that act at rest: factors of 1, x, x^3, sin h, cos h, sin 2h and cos 2h, x the
        angle turned since the start and h the heading in rad.
    period, rate_filter
        s; of the sampling, and the time constant of the low pass of the rate.
    lowest, highest
        N m; what the actuators can give.
    """

    kp: float
    kd: float
    period: float
    rate_filter: float
    inertia: float = 0.0
    quadratic_drag: float = 0.0
    linear_drag: float = 0.0
    static_terms: tuple[float, ...] = (0.0,) * STATIC_TERMS
    lowest: float = -math.inf
    highest: float = math.inf

    @functools.cached_property
    def blend(self) -> float:
        """Share of a new rate in the filtered one."""
        if self.rate_filter <= 0.0:
            return 1.0
        return -math.expm1(-self.period / self.rate_filter)

    @staticmethod
    def initial_state(heading: float) -> ControllerState:
        """At rest at ``heading`` in rad."""
        return ControllerState(heading, 0.0, 0.0)

    def step(
        self,
        state: ControllerState,
        heading: float,
        wanted: float,
        wanted_rate: float = 0.0,
        wanted_acceleration: float = 0.0,
    ) -> tuple[float, ControllerState]:
        """Torque in N m to hold for a period, and the new state, from a ``heading`` in rad, wrapped or not."""
        turn = wrapped(heading - state.heading)
        rate = state.rate + self.blend * (turn / self.period - state.rate)
        turned = state.turned + turn
        torque = (
            self.inertia * wanted_acceleration
            + (self.quadratic_drag * abs(rate) + self.linear_drag) * rate
            + self.static_torque(turned, heading)
            + self.kp * wrapped(wanted - heading)
            + self.kd * (wanted_rate - rate)
        )
        return min(max(torque, self.lowest), self.highest), ControllerState(heading, rate, turned)

    def static_torque(self, turned: float, heading: float) -> float:
        """Torque in N m against those that act at rest, ``turned`` rad from the start."""
        a, b, c, d, e, f, g = self.static_terms
        once = d * math.sin(heading) + e * math.cos(heading)
        twice = f * math.sin(2.0 * heading) + g * math.cos(2.0 * heading)
        return a + b * turned + c * turned * turned * turned + once + twice


def wrapped(angle: float) -> float:
    """``angle`` in rad within -pi to pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def static_terms_of(model: Model) -> tuple[float, ...]:
    """(7,) factors of ``Law.hold`` against what the effects of ``model`` do at rest.

    Read off the effects' own terms over two turns either way, so that no effect is known here by its name.
    """
    torque = effect_torque(model)
    if torque is None:
        return (0.0,) * STATIC_TERMS
    # Angle and heading are told apart by the first heading: of two that are a radian apart each gives all angles.
    rows = [(angle, angle + first) for first in (0.0, 1.0) for angle in _TURNS]
    values = np.array([torque(0.0, x, 0.0, h - x, None)[0] for x, h in rows])
    x, h = np.array(rows).T
    columns = (np.ones(len(x)), x, x**3, np.sin(h), np.cos(h), np.sin(2 * h), np.cos(2 * h))
    factors, *_ = np.linalg.lstsq(np.column_stack(columns), -values, rcond=None)
    # What rounding leaves of nothing is not written into anybody's controller.
    least = 1e-9 * float(np.max(np.abs(values)))
    return tuple(float(factor) if abs(factor) > least else 0.0 for factor in factors)


TermTorque = Callable[[float, float, float, float, FloatArray | None], tuple[float, FloatArray]]


def effect_torque(model: Model) -> TermTorque | None:
    """(rate, angle, push, first heading, (m, 2) states) -> N m of all terms, (m, 2) rates of states; None: no term."""
    terms = model.terms
    if not len(terms.kinds):
        return None
    acting = [TERMS[kind] for kind in terms.kinds]
    numbers = terms.parameters[:, 0].reshape(len(acting), -1)

    def torque(
        rate: float, angle: float, push: float, heading: float, states: FloatArray | None
    ) -> tuple[float, FloatArray]:
        own = np.zeros((len(acting), TERM_STATES)) if states is None else states
        rows = [(term, tuple(p), tuple(x)) for term, p, x in zip(acting, numbers, own, strict=True)]
        water = sum(term.entrained_rate(p, x) for term, p, x in rows if term.entrained_rate is not None)
        at = Instant(rate, rate - water, angle, heading, push, 0.0, 0.0, 0.0, model.body)
        total, change = 0.0, np.zeros_like(own)
        for (term, p, x), row in zip(rows, change, strict=True):
            given, changes = term.evaluate(at, p, x)
            row[: term.states] = changes
            total += given
        return total, change

    return torque
