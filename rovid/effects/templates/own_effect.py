"""A line to a mooring on one side: the line is taut beyond an angle, and pulls the heading back.

Replace the equation, the parameters and the texts by those of your own effect. Then change the simulation in
test_own_effect.py in the same way, and run `pytest test_own_effect.py`. `rovid help own_effects` explains every field.
"""

from __future__ import annotations

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, compiled, maximum


# The torque in N m on the right-hand side of I*rdot = T - drag + torque. ``at`` is the motion: at.rate in rad/s,
# at.angle in rad since the start of the run, at.start + at.angle the heading, at.thruster_torque in N m, at.surge and
# at.sway in m/s. ``p`` holds the parameters in their order. The function is compiled: use numbers and functions of
# ``math``. maximum, minimum and where_nonnegative(x, y, otherwise) are faster than max, min and ``if``.
@compiled
def _torque(at: Instant, p: Numbers) -> float:
    stiffness, slack = p[0], p[1]
    return -stiffness * maximum(at.angle - slack, 0.0)


EFFECT: Effect = Effect(
    id="own_effect",  # the name in commands and in JSON; no name of the catalogue (`rovid help effects`)
    title="line to a mooring",
    axes=("yaw",),  # leave it out if the effect exists along every axis
    # The first parameter is the size. At its neutral value the effect has to vanish. low, high and initial_values are
    # in units of the scale: "torque" is the root mean square of the torque in the logs, "one" the parameter's own unit.
    # If the size can have either sign, give a negative low and initial values of both signs.
    parameters=(
        EffectParameter(
            name="stiffness", unit="N m/rad", neutral=0.0, low=0.0, high=5.0, initial_values=(0.1,), scale="torque"
        ),
        EffectParameter(name="slack", unit="rad", neutral=0.0, low=0.0, high=20.0, initial_values=(0.5, 2.0)),
    ),
    # For people: the equation, the pattern in the remaining error, and the run that shows the effect.
    equation="− k·(ψ − s) where ψ > s, ψ angle since the start of the run",
    fingerprint="no residual torque up to an angle on one side of the start, then a torque towards the start",
    experiment="turn slowly in one direction until the vehicle stops, then in the other direction",
    rivals=("tether_torsion",),  # effects that look similar
    acts=Term(_torque),
)
