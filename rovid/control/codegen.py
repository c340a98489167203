"""The control law as plain C and Python source, with the identified numbers in it."""

from __future__ import annotations

import math
from string import Template

from rovid import __version__
from rovid.control.control_law import ControlLaw
from rovid.trial.assumptions import Assumptions

_C = Template("""\
/* Heading controller, model-aided PD (Ramesh et al. 2013, eq. 12). Written by rovid $version.$stamp
 *
 * Call rovid_control_start once with the heading, then rovid_control_step every $period s with the heading just read.
 * Angles in rad, wrapped or not; torque in N m, positive where it turns the heading up. No memory is allocated.
 */
#include <math.h>

typedef struct {
    double heading; /* read last, rad */
    double rate;    /* low-passed, rad/s */
    double turned;  /* since the start, rad */
} rovid_control;

static double rovid_wrapped(double angle)
{
    return angle - $whole * floor((angle + $half) / $whole);
}

void rovid_control_start(rovid_control *state, double heading)
{
    state->heading = heading;
    state->rate = 0.0;
    state->turned = 0.0;
}

double rovid_control_step(rovid_control *state, double heading, double wanted, double wanted_rate,
                          double wanted_acceleration)
{
    const double turn = rovid_wrapped(heading - state->heading);
    const double rate = state->rate + $blend * (turn / $period - state->rate);
    const double x = state->turned + turn;
    double torque;

    state->heading = heading;
    state->rate = rate;
    state->turned = x;
    /* What inertia, drag and the torques at rest need, then proportional and derivative action. */
    torque = $inertia * wanted_acceleration + ($quadratic_drag * fabs(rate) + $linear_drag) * rate
           + ($hold)
           + $kp * rovid_wrapped(wanted - heading) + $kd * (wanted_rate - rate);
$limits    return torque;
}
""")

_PYTHON = Template('''\
"""Heading controller, model-aided PD (Ramesh et al. 2013, eq. 12). Written by rovid $version.$stamp

Make one with the heading, then call ``step`` every $period s with the heading just read. Angles in rad, wrapped or not;
torque in N m, positive where it turns the heading up.
"""

from math import cos, floor, sin


def _wrapped(angle):
    return angle - $whole * floor((angle + $half) / $whole)


class Controller:
    """The state: heading read last in rad, low-passed rate in rad/s, angle turned since the start in rad."""

    def __init__(self, heading):
        self.heading, self.rate, self.turned = heading, 0.0, 0.0

    def step(self, heading, wanted, wanted_rate=0.0, wanted_acceleration=0.0):
        """Return the torque in N m to hold until the next step."""
        turn = _wrapped(heading - self.heading)
        rate = self.rate + $blend * (turn / $period - self.rate)
        x = self.turned + turn
        self.heading, self.rate, self.turned = heading, rate, x
        # What inertia, drag and the torques at rest need, then proportional and derivative action.
        torque = (
            $inertia * wanted_acceleration
            + ($quadratic_drag * abs(rate) + $linear_drag) * rate
            + ($hold)
            + $kp * _wrapped(wanted - heading)
            + $kd * (wanted_rate - rate)
        )
$limits        return torque
''')


def c_source(law: ControlLaw, guess: Assumptions) -> str:
    """C99 of ``law``, without allocation; with a word on what of it is guessed."""
    limits = _limits(law, ("<", ">"), "    if (torque {way} {value!r}) torque = {value!r};\n")
    return _C.substitute(_numbers(law), limits=limits, stamp=_stamp(guess))


def python_source(law: ControlLaw, guess: Assumptions) -> str:
    """Python of ``law``, with the standard library alone; with a word on what of it is guessed."""
    limits = _limits(law, ("max", "min"), "        torque = {way}(torque, {value!r})\n")
    return _PYTHON.substitute(_numbers(law), limits=limits, stamp=_stamp(guess))


def _stamp(guess: Assumptions) -> str:
    return f" {guess.file_notice}" if guess else ""


def _limits(law: ControlLaw, ways: tuple[str, str], statement: str) -> str:
    """A ``statement`` for each limit of the torque that there is, with the way that belongs to the low and the high."""
    text = ""
    for way, value in zip(ways, (law.lowest, law.highest), strict=True):
        if math.isfinite(value):
            text += statement.format(way=way, value=value)
    return text


def _numbers(law: ControlLaw) -> dict[str, str]:
    """The law's numbers, as either language reads them."""
    names = ("kp", "kd", "inertia", "quadratic_drag", "linear_drag", "period", "blend")
    shapes = ("1.0", "x", "x * x * x", "sin(heading)", "cos(heading)", "sin(2.0 * heading)", "cos(2.0 * heading)")
    held = [f"{value!r} * {shape}" for value, shape in zip(law.static_terms, shapes, strict=True) if value != 0.0]
    return {
        **{name: repr(float(getattr(law, name))) for name in names},
        "hold": " + ".join(held) or "0.0",
        "whole": repr(2.0 * math.pi),
        "half": repr(math.pi),
        "version": __version__,
    }
