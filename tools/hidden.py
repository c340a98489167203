"""What a simulated truth may hide: the effects by the names of the contract, each in one or more physical forms.

The names are those of DESIGN.md's table; the physics is that of EFFECTS.md, whose entries (E01, E05, ...) are named
where a form is written down. ``outside`` holds causes that are in no catalogue; each depends on a logged signal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

OUTSIDE = "outside"


@dataclass(frozen=True)
class Form:
    """One way in which an effect can act.

    Attributes
    ----------
    says
        Description of the form.
    size
        Name of the parameter that sets the strength.
    null
        Value of ``size`` without an effect.
    others
        Names of the other parameters, all required.
    """

    says: str
    size: str
    null: float = 0.0
    others: tuple[str, ...] = ()


FORMS: Mapping[str, Mapping[str, Form]] = {
    "thruster_deadband": {
        "shift": Form("curve begins `deadband` (command unit) later on either side (Bessa, E01)", "deadband"),
        "jump": Form("no thrust up to `deadband` beyond the bench dead zone, then the bench's at once", "deadband"),
    },
    "thrust_asymmetry": {
        "gain": Form("all reverse thrust times `reverse_gain` (E02)", "reverse_gain", 1.0),
        "growing": Form(
            "reverse loss grows with thrust, to `reverse_gain` at `thrust` N (ventilation)",
            "reverse_gain",
            1.0,
            ("thrust",),
        ),
    },
    "thruster_imbalance": {
        "gain": Form("one thruster times `gain`, both ways", "gain", 1.0),
        "interaction": Form("one thruster times `gain` while another one pushes (E09)", "gain", 1.0),
    },
    "thrust_curve_shape": {
        "power": Form("thrust = F (|bench|/F)^exponent, F = `thrust` N", "exponent", 1.0, ("thrust",)),
        "saturating": Form(
            "thrust = bench (1 + loss) / (1 + loss |bench|/`thrust`): a soft limit", "loss", 0.0, ("thrust",)
        ),
        "command": Form(
            "the bench's thrust at a command, beyond its dead zone, of limit (u/limit)^exponent", "exponent", 1.0
        ),
    },
    "supply_sag": {
        "load": Form(
            "thrust (1 - sag L), L the sum of |thrust|/`thrust` through a lag of `time_constant` s (E04)",
            "sag",
            0.0,
            ("time_constant", "thrust"),
        ),
        "elapsed": Form("thrust (1 - drift t), t in h since the log began (E04, E15)", "drift"),
        "voltage": Form(
            "thrust (V/V0)^exponent; V wanders slowly by `wander` V and is logged (T200: 1.0 to 1.2)",
            "exponent",
            0.0,
            ("wander",),
        ),
    },
    "thruster_lag": {
        "first_order": Form("time_constant dF/dt + F = F(u) (E05)", "time_constant"),
        "command": Form("the same lag on the command, before the curve", "time_constant"),
        "quadratic": Form(
            "rotor n_dot = beta u - alpha n|n|; `time_constant` s is the linearised one at `thrust` N (Yoerger 1990)",
            "time_constant",
            0.0,
            ("thrust",),
        ),
    },
    "command_delay": {
        "constant": Form("F(t) = F(u(t - delay)) (E10)", "delay"),
        "polled": Form("the drive reads its command every 2 `delay` s: a delay of `delay` on average", "delay"),
    },
    "slew_limit": {
        "hard": Form("|du/dt| <= `rate` in command units/s (E06)", "rate", math.inf),
        "soft_start": Form("|u| grows by `rate` at most and falls at once", "rate", math.inf),
    },
    "command_hysteresis": {
        "play": Form("backlash of `width` (command unit) in all (E13)", "width"),
        "schmitt": Form("starts `width` beyond the bench dead zone, stops at its edge (E13)", "width"),
    },
    "advance_speed_loss": {
        "bilinear": Form("F - coefficient sqrt|F| arm r, in N^0.5 s/m (Fossen, E07)", "coefficient"),
        "open_water": Form(
            "F times Minerva's KT(J)/KT(0), J = coefficient arm r/sqrt|F|, in N^0.5 s/m (E07)", "coefficient"
        ),
        "measured": Form("F - coefficient sqrt|F| u, u the logged surge velocity, in N^0.5 s/m (E07)", "coefficient"),
    },
    "bias_torque": {
        "constant": Form("`torque` N m (E16)", "torque"),
        "wandering": Form("`torque` N m, a quarter of it coming and going with `period` s", "torque", 0.0, ("period",)),
    },
    "drag_curvature": {
        "cubic": Form("drag + cubic r^3 (E17)", "cubic"),
        "exponent": Form("DQ |r|^exponent, equal to the square law at `rate` rad/s (E17)", "exponent", 2.0, ("rate",)),
    },
    "drag_asymmetry": {
        "quadratic": Form("DQ times `ratio` where r < 0 (E18)", "ratio", 1.0),
        "whole": Form("DQ and DL times `ratio` where r < 0", "ratio", 1.0),
    },
    "coulomb_resistance": {
        "smooth": Form("`torque` tanh(r/`rate`) (E19)", "torque", 0.0, ("rate",)),
        "stiction": Form(
            "half as much again near rest: torque (1 + 0.5 exp(-(r/(5 rate))^2)) tanh(r/rate)", "torque", 0.0, ("rate",)
        ),
        "unequal": Form(
            "the first, where r < 0 times `back`, and there a linear drag of `viscous` s times `torque` besides",
            "torque",
            0.0,
            ("rate", "back", "viscous"),
        ),
    },
    "oscillatory_drag": {
        "exponential": Form(
            "DQ (1 + gain exp(-s/angle)), s swept since the last reversal, rad (E20)", "gain", 0.0, ("angle",)
        ),
        "algebraic": Form("DQ (1 + gain/(1 + s/angle))", "gain", 0.0, ("angle",)),
    },
    "added_mass_memory": {
        "trapped_water": Form(
            "`inertia` of water that follows with `time_constant` s: torque of inertia times the lagged rdot (E21)",
            "inertia",
            0.0,
            ("time_constant",),
        ),
        "cummins": Form(
            "torque mu, mu_dot = -mu/time_constant + inertia r/time_constant^2 (one-state Cummins, E21)",
            "inertia",
            0.0,
            ("time_constant",),
        ),
        "porous": Form(
            "trapped water behind a porous frame: square-law coupling, `time_constant` s at a slip of `rate` rad/s",
            "inertia",
            0.0,
            ("time_constant", "rate"),
        ),
    },
    "entrained_swirl": {
        "first_order": Form(
            "time_constant dw/dt = coupling r - w; drag acts on r - w (E23)", "coupling", 0.0, ("time_constant",)
        ),
        "annulus": Form(
            "angular momentum of a water annulus with square-law wall friction (E23); `coupling` and linearised "
            "`time_constant` s are those of a steady `rate` rad/s",
            "coupling",
            0.0,
            ("time_constant", "rate"),
        ),
    },
    "tether_torsion": {
        "linear": Form("-stiffness x, x the angle turned since the log began (E32)", "stiffness"),
        "stiffening": Form("-stiffness x (1 + (x/angle)^2)", "stiffness", 0.0, ("angle",)),
    },
    "heading_dependent_torque": {
        "one_cycle": Form("amplitude sin(psi + phase) (E33)", "amplitude", 0.0, ("phase",)),
        "two_cycles": Form("amplitude sin(2 psi + phase) (E29)", "amplitude", 0.0, ("phase",)),
        "current": Form(
            "of a current from -phase: amplitude (sin(psi + phase) + 0.6 sin 2(psi + phase)) (E29)",
            "amplitude",
            0.0,
            ("phase",),
        ),
    },
    "wave_torque": {
        "sine": Form(
            "amplitude sin(frequency t + phase), the phase random in each log (E26)", "amplitude", 0.0, ("frequency",)
        ),
        "narrow_band": Form(
            "random, `amplitude` root 2 times its standard deviation; half-power width 2 `damping` `frequency` (E26)",
            "amplitude",
            0.0,
            ("frequency", "damping"),
        ),
    },
    "tank_seiche": {
        "acceleration": Form(
            "q'' + 2 damping frequency q' + frequency^2 q = rdot; torque -gain inertia frequency q' (E25)",
            "gain",
            0.0,
            ("frequency", "damping"),
        ),
        "thrust": Form(
            "the same, driven by thrusters' torque/inertia in place of rdot", "gain", 0.0, ("frequency", "damping")
        ),
    },
    "heading_deviation": {
        "one_cycle": Form("logged heading + amplitude sin(psi + phase) (E38)", "amplitude", 0.0, ("phase",)),
        "two_cycles": Form("logged heading + amplitude sin(2 psi + phase) (E38)", "amplitude", 0.0, ("phase",)),
        "mixed": Form(
            "logged heading + amplitude (sin(psi + phase) + 0.5 sin(2 psi - phase))", "amplitude", 0.0, ("phase",)
        ),
    },
    "speed_dependent_damping": {
        "linear": Form("-linear |u| r, u the logged surge velocity", "linear"),
        "quadratic": Form("-quadratic u^2 r", "quadratic"),
    },
    "sideslip_moment": {
        "drift": Form("-coefficient v, v the logged sway velocity", "coefficient"),
        "munk": Form("-munk u v", "munk"),
    },
    "restoring_curve": {
        "cubic": Form("restoring (sin x + cubic x^2 sin x), x from the level; in pitch", "cubic"),
        "quintic": Form("restoring (sin x + quintic x^4 sin x)", "quintic"),
    },
    OUTSIDE: {
        "manipulator": Form("torque N m/rad of the manipulator's angle", "torque"),
        "tension": Form("tether tension, less its mean, times `arm` m", "arm"),
        "surge": Form("torque N m s/m of the surge speed", "torque"),
        "pitch": Form("torque N m/rad of pitch, less its mean", "torque"),
        "depth_drag": Form("all drag times 1 + gain (depth - mean)/m", "gain"),
        "supply_drag": Form("all drag times 1 + gain (supply - nominal)/V", "gain"),
    },
}

# Effect names of the contract.
EFFECTS: tuple[str, ...] = tuple(name for name in FORMS if name != OUTSIDE)

# Form of an outside cause -> the signal that drives it, as rovid.toml names it.
DRIVERS: Mapping[str, str] = {
    "manipulator": "manipulator_angle",
    "tension": "tether_tension",
    "surge": "surge_speed",
    "pitch": "pitch",
    "depth_drag": "depth",
    "supply_drag": "supply_voltage",
}


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One hidden effect: its name, its form, the parameters of that form and, where one is meant, a thruster."""

    effect: str
    form: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    thruster: str | None = None

    def __post_init__(self) -> None:
        if self.form not in FORMS.get(self.effect, {}):
            msg = f"{self.effect}/{self.form} is not known"
            raise ValueError(msg)
        wanted = {self.law.size, *self.law.others}
        if set(self.parameters) != wanted:
            msg = f"{self.effect}/{self.form} has parameters {sorted(self.parameters)}, wanted {sorted(wanted)}"
            raise ValueError(msg)
        if (self.effect == "thruster_imbalance") != (self.thruster is not None):
            msg = f"{self.effect}: a thruster is named for thruster_imbalance and for nothing else"
            raise ValueError(msg)

    @property
    def law(self) -> Form:
        """What is said of its form."""
        return FORMS[self.effect][self.form]

    @property
    def acts(self) -> bool:
        """Whether its size is other than null."""
        return self.parameters[self.law.size] != self.law.null

    def nulled(self) -> Hidden:
        """The same with its size at null."""
        return replace(self, parameters={**self.parameters, self.law.size: self.law.null})


def acting(hidden: Iterable[Hidden]) -> dict[str, Hidden]:
    """Effect -> what acts of ``hidden``; an effect may be hidden once."""
    found: dict[str, Hidden] = {}
    for one in hidden:
        if one.effect in found:
            msg = f"{one.effect} is hidden twice"
            raise ValueError(msg)
        if one.acts:
            found[one.effect] = one
    return found
