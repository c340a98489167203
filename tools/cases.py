"""The cases of a sweep: every effect in every form, weak and strong, on each vehicle; outside causes; nothing.

Sizes are shares of a vehicle's own scales (middling torque, rate, command, time constant), set from EFFECTS.md
sections 4 and 8: weak is a few times what a disturbance of 2 % of the middling torque hides in a campaign, strong is
plain to see.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np

from tools.channels import EXTRA
from tools.hidden import DRIVERS, FORMS, OUTSIDE, Hidden
from tools.truth import Truth

Size = Literal["weak", "strong"]
SIZES: tuple[Size, ...] = ("weak", "strong")


@dataclass(frozen=True, kw_only=True)
class Case:
    """Something hidden and what a diagnosis should say of it.

    Attributes
    ----------
    name
        effect-form-size.
    expected_effect
        Name in the contract; None for an outside cause and for nothing.
    expected_parameters
        In the units and with the meaning of the contract; None where the hidden form is not that of the contract.
        A parameter whose reference the contract leaves open (see `OPEN`) is left out.
    driver
        Signal on which an outside cause depends, as rovid.toml names it.
    """

    name: str
    hidden: tuple[Hidden, ...]
    expected_effect: str | None
    expected_parameters: Mapping[str, float] | None = None
    driver: str | None = None

    def of(self, vehicle: Truth) -> Truth:
        """Truth of ``vehicle`` with this hidden; with an outside cause all extra channels are logged, as decoys."""
        channels = EXTRA if self.driver else vehicle.channels
        return replace(vehicle, hidden=(*vehicle.hidden, *self.hidden), channels=channels)


# The forms that are the contract's; the first of FORMS is in all other cases.
CONTRACT_FORMS: Mapping[str, tuple[str, ...]] = {
    "supply_sag": ("load", "elapsed"),
    "drag_curvature": ("cubic", "exponent"),
    "heading_dependent_torque": ("one_cycle", "two_cycles"),
    "heading_deviation": ("one_cycle", "two_cycles"),
    "advance_speed_loss": ("bilinear", "measured"),
    "speed_dependent_damping": ("linear", "quadratic"),
    "sideslip_moment": ("drift", "munk"),
}

# What the contract names but leaves open: reference thrust or rate, sign of a phase, scale of a gain.
OPEN: Mapping[str, frozenset[str]] = {
    "supply_sag": frozenset({"sag", "thrust"}),
    "thrust_curve_shape": frozenset({"thrust"}),
    "drag_curvature": frozenset({"rate"}),
    "coulomb_resistance": frozenset({"rate"}),
    "heading_dependent_torque": frozenset({"phase"}),
    "heading_deviation": frozenset({"phase"}),
    "tank_seiche": frozenset({"gain"}),
}
# Parameters that the contract calls otherwise.
_CALLED = {("oscillatory_drag", "angle"): "swept_angle"}


@dataclass(frozen=True, kw_only=True)
class _Sizes:
    """(weak, strong) of the size parameter, and the others, which are the same in both."""

    size: tuple[float, float]
    others: Mapping[str, float] = field(default_factory=dict)


# Seconds, for work class, observation class, small vehicle: EFFECTS.md E05, E06, E10.
_LAG = ((0.15, 0.6), (0.08, 0.3), (0.03, 0.12))
_DELAY = ((0.10, 0.35), (0.06, 0.2), (0.03, 0.12))
_RISE = ((0.5, 2.0), (0.25, 1.0), (0.12, 0.4))  # of the middling command at the slew limit
_TANK = (4.62, 3.84, 2.59)  # periods of the first or second mode of tanks 15, 9 and 5 m long (E25)
_WAVE = (5.0, 3.0, 2.0)  # periods


def _class_of(vehicle: Truth) -> int:
    """0 for work class, 1 for observation class, 2 for small."""
    return 0 if vehicle.mass > 500.0 else 1 if vehicle.mass > 30.0 else 2


def _actuator_sizes(vehicle: Truth) -> dict[tuple[str, str], _Sizes]:
    kind = _class_of(vehicle)
    pace = vehicle.pace or 1.0
    thrust, rate = vehicle.middle_thrust, vehicle.middle_rate
    beyond = vehicle.middle - vehicle.thrusters[0].curve.dead_zone  # middle command beyond the dead zone
    total = thrust * len(vehicle.thrusters)
    rise = tuple(vehicle.middle / seconds for seconds in _RISE[kind])
    # A share of the middling thrust at the middling rate: coefficient sqrt(F) arm r = share F.
    loss = math.sqrt(thrust) / (abs(vehicle.thrusters[0].arm) * rate)
    deadband, width = (0.04 * beyond, 0.12 * beyond), (0.04 * beyond, 0.10 * beyond)
    lag = _LAG[kind]
    at = {"thrust": thrust}
    return {
        ("thruster_deadband", "shift"): _Sizes(size=deadband),
        ("thruster_deadband", "jump"): _Sizes(size=(0.38 * beyond, 0.60 * beyond)),
        ("thrust_asymmetry", "gain"): _Sizes(size=(0.95, 0.80)),
        ("thrust_asymmetry", "growing"): _Sizes(size=(0.95, 0.80), others=at),
        ("thruster_imbalance", "gain"): _Sizes(size=(0.93, 0.75)),
        ("thruster_imbalance", "interaction"): _Sizes(size=(0.93, 0.75)),
        ("thrust_curve_shape", "power"): _Sizes(size=(0.94, 0.80), others=at),
        ("thrust_curve_shape", "saturating"): _Sizes(size=(0.08, 0.30), others=at),
        ("supply_sag", "load"): _Sizes(size=(0.06, 0.15), others={"time_constant": 8.0 * pace, "thrust": total}),
        ("supply_sag", "elapsed"): _Sizes(size=(0.30 / pace, 0.90 / pace)),
        ("supply_sag", "voltage"): _Sizes(size=(1.1, 2.0), others={"wander": 0.08 * vehicle.instruments.supply}),
        ("thruster_lag", "first_order"): _Sizes(size=lag),
        ("thruster_lag", "command"): _Sizes(size=lag),
        ("thruster_lag", "quadratic"): _Sizes(size=lag, others=at),
        ("command_delay", "constant"): _Sizes(size=_DELAY[kind]),
        ("command_delay", "polled"): _Sizes(size=_DELAY[kind]),
        ("slew_limit", "hard"): _Sizes(size=(rise[0], rise[1])),
        ("slew_limit", "soft_start"): _Sizes(size=(rise[0], rise[1])),
        ("command_hysteresis", "play"): _Sizes(size=width),
        ("command_hysteresis", "schmitt"): _Sizes(size=(0.3 * beyond, 0.5 * beyond)),
        ("advance_speed_loss", "bilinear"): _Sizes(size=(0.08 * loss, 0.20 * loss)),
        ("advance_speed_loss", "open_water"): _Sizes(size=(0.08 * loss, 0.20 * loss)),
        ("advance_speed_loss", "measured"): _Sizes(size=(0.15 * math.sqrt(thrust), 0.5 * math.sqrt(thrust))),
        ("thrust_curve_shape", "command"): _Sizes(size=(1.06, 1.25)),
    }


def _water_sizes(vehicle: Truth) -> dict[tuple[str, str], _Sizes]:
    kind = _class_of(vehicle)
    pace = vehicle.pace or 1.0
    torque, rate, inertia = vehicle.middle_torque, vehicle.middle_rate, vehicle.dynamics.inertia
    curvature = vehicle.dynamics.quadratic_drag / rate  # N m s^3/rad^3 that doubles the square law at the middle
    memory = 1.2 * vehicle.time_constant
    turned = 20.0  # rad, about what a hold turns
    tank = {"frequency": 2.0 * math.pi / _TANK[kind], "damping": 0.04}
    wave = 2.0 * math.pi / _WAVE[kind]
    share = {name: (weak * torque, strong * torque) for name, (weak, strong) in _SHARES.items()}
    follows = {"time_constant": memory}
    swirl = {"time_constant": 60.0 * pace}
    here = {"phase": 0.8}
    return {
        ("bias_torque", "constant"): _Sizes(size=share["bias"]),
        ("bias_torque", "wandering"): _Sizes(size=share["bias"], others={"period": 300.0 * pace}),
        ("drag_curvature", "cubic"): _Sizes(size=(0.25 * curvature, 0.8 * curvature)),
        ("drag_curvature", "exponent"): _Sizes(size=(1.85, 1.6), others={"rate": rate}),
        ("drag_asymmetry", "quadratic"): _Sizes(size=(1.10, 1.30)),
        ("drag_asymmetry", "whole"): _Sizes(size=(1.10, 1.30)),
        ("coulomb_resistance", "smooth"): _Sizes(size=share["coulomb"], others={"rate": 0.05 * rate}),
        ("coulomb_resistance", "stiction"): _Sizes(size=share["coulomb"], others={"rate": 0.01 * rate}),
        ("coulomb_resistance", "unequal"): _Sizes(
            size=share["coulomb"], others={"rate": 0.05 * rate, "back": 1.5, "viscous": 1.0 / rate}
        ),
        # Of what the drag at the middle is, at a speed ahead of 0.5 m/s and sideways of 0.15 m/s.
        ("speed_dependent_damping", "linear"): _Sizes(size=(0.2 * torque / rate, 0.8 * torque / rate)),
        ("speed_dependent_damping", "quadratic"): _Sizes(size=(0.4 * torque / rate, 1.6 * torque / rate)),
        ("sideslip_moment", "drift"): _Sizes(size=(0.3 * torque, torque)),
        ("sideslip_moment", "munk"): _Sizes(size=(0.6 * torque, 2.0 * torque)),
        ("oscillatory_drag", "exponential"): _Sizes(size=(0.20, 0.60), others={"angle": 1.0}),
        ("oscillatory_drag", "algebraic"): _Sizes(size=(0.20, 0.60), others={"angle": 1.0}),
        ("added_mass_memory", "trapped_water"): _Sizes(size=(0.10 * inertia, 0.35 * inertia), others=follows),
        ("added_mass_memory", "cummins"): _Sizes(size=(0.10 * inertia, 0.35 * inertia), others=follows),
        ("added_mass_memory", "porous"): _Sizes(
            size=(0.10 * inertia, 0.35 * inertia), others={**follows, "rate": 0.5 * rate}
        ),
        ("entrained_swirl", "first_order"): _Sizes(size=(0.08, 0.22), others=swirl),
        ("entrained_swirl", "annulus"): _Sizes(size=(0.08, 0.22), others={**swirl, "rate": rate}),
        ("tether_torsion", "linear"): _Sizes(size=(0.05 * torque / turned, 0.16 * torque / turned)),
        ("tether_torsion", "stiffening"): _Sizes(
            size=(0.03 * torque / turned, 0.10 * torque / turned), others={"angle": turned}
        ),
        ("heading_dependent_torque", "one_cycle"): _Sizes(size=share["heading"], others=here),
        ("heading_dependent_torque", "two_cycles"): _Sizes(size=share["heading"], others=here),
        ("heading_dependent_torque", "current"): _Sizes(size=share["heading"], others=here),
        ("wave_torque", "sine"): _Sizes(size=share["wave"], others={"frequency": wave}),
        ("wave_torque", "narrow_band"): _Sizes(size=share["wave"], others={"frequency": wave, "damping": 0.03}),
        ("tank_seiche", "acceleration"): _Sizes(size=(0.06, 0.20), others=tank),
        ("tank_seiche", "thrust"): _Sizes(size=(0.06, 0.20), others=tank),
        ("heading_deviation", "one_cycle"): _Sizes(size=_DEVIATION, others=here),
        ("heading_deviation", "two_cycles"): _Sizes(size=_DEVIATION, others=here),
        ("heading_deviation", "mixed"): _Sizes(size=_DEVIATION, others=here),
    }


# Of the middling torque: 5 and 12 N m of bias on ROSUB.
_SHARES = {"bias": (0.04, 0.10), "coulomb": (0.04, 0.10), "heading": (0.05, 0.12), "wave": (0.08, 0.25)}
_DEVIATION = (math.radians(0.8), math.radians(3.0))


def _outside_sizes(vehicle: Truth) -> dict[tuple[str, str], _Sizes]:
    """Deviations are 0.4 rad, 30 N, 0.07 m/s, 0.002 rad, 0.7 m and a thirtieth of the supply, about."""
    torque = vehicle.middle_torque
    supply = vehicle.instruments.supply / 30.0
    return {
        (OUTSIDE, "manipulator"): _Sizes(size=(0.06 * torque / 0.4, 0.18 * torque / 0.4)),
        (OUTSIDE, "tension"): _Sizes(size=(0.06 * torque / 30.0, 0.18 * torque / 30.0)),
        (OUTSIDE, "surge"): _Sizes(size=(0.06 * torque / 0.07, 0.18 * torque / 0.07)),
        (OUTSIDE, "pitch"): _Sizes(size=(0.04 * torque / 0.002, 0.12 * torque / 0.002)),
        (OUTSIDE, "depth_drag"): _Sizes(size=(0.10 / 0.7, 0.25 / 0.7)),
        (OUTSIDE, "supply_drag"): _Sizes(size=(0.10 / supply, 0.25 / supply)),
    }


def all_cases(vehicle: Truth) -> list[Case]:
    """Nothing, then every effect in every form at both sizes, then the outside causes."""
    return [Case(name="nothing", hidden=(), expected_effect=None), *_effects(vehicle), *_outsiders(vehicle)]


def _effects(vehicle: Truth) -> Iterator[Case]:
    table = {**_actuator_sizes(vehicle), **_water_sizes(vehicle)}
    if vehicle.dynamics.restoring:
        table |= {
            ("restoring_curve", "cubic"): _Sizes(size=(-0.5, 3.0)),
            ("restoring_curve", "quintic"): _Sizes(size=(5.0, 30.0)),
        }
    for (effect, form), sizes in table.items():
        for size, value in zip(SIZES, sizes.size, strict=True):
            hidden = _hidden(vehicle, effect, form, value, sizes.others)
            yield Case(
                name=f"{effect}-{form}-{size}",
                hidden=(hidden,),
                expected_effect=effect,
                expected_parameters=_expected(hidden),
            )


def _outsiders(vehicle: Truth) -> Iterator[Case]:
    for (effect, form), sizes in _outside_sizes(vehicle).items():
        for size, value in zip(SIZES, sizes.size, strict=True):
            yield Case(
                name=f"{effect}-{form}-{size}",
                hidden=(_hidden(vehicle, effect, form, value, sizes.others),),
                expected_effect=None,
                driver=DRIVERS[form],
            )


def _hidden(vehicle: Truth, effect: str, form: str, value: float, others: Mapping[str, float]) -> Hidden:
    return Hidden(
        effect=effect,
        form=form,
        parameters={FORMS[effect][form].size: value, **others},
        thruster=vehicle.thrusters[0].name if effect == "thruster_imbalance" else None,
    )


def _expected(hidden: Hidden) -> dict[str, float] | None:
    """What the contract's parameters should come to; None for another form."""
    if hidden.form not in CONTRACT_FORMS.get(hidden.effect, (next(iter(FORMS[hidden.effect])),)):
        return None
    return {
        _CALLED.get((hidden.effect, name), name): value
        for name, value in hidden.parameters.items()
        if name not in OPEN.get(hidden.effect, frozenset())
    }


# Pairs that cannot be told apart in any campaign, or that undo each other, are no fair test (EFFECTS.md 3.1).
_TWINS: tuple[frozenset[str], ...] = (
    frozenset({"thruster_lag", "command_delay", "slew_limit"}),
    frozenset({"thruster_lag", "added_mass_memory", "oscillatory_drag"}),
    frozenset({"drag_curvature", "coulomb_resistance", "advance_speed_loss", "thrust_curve_shape", "supply_sag"}),
    frozenset({"thruster_deadband", "thrust_curve_shape", "command_hysteresis", "coulomb_resistance"}),
    frozenset({"entrained_swirl", "tether_torsion", "supply_sag"}),
    frozenset({"thrust_asymmetry", "drag_asymmetry", "thruster_imbalance", "bias_torque"}),
    frozenset({"heading_dependent_torque", "heading_deviation"}),
    frozenset({"wave_torque", "tank_seiche"}),
)


def groups(vehicle: Truth, *, together: int, count: int, seed: int, size: Size = "strong") -> list[tuple[Case, ...]]:
    """``count`` groups of ``together`` cases in the contract's forms, drawn by ``seed``, no two of them near twins."""
    rng = np.random.default_rng(seed)
    pool = [c for c in _effects(vehicle) if c.expected_parameters is not None and c.name.endswith(size)]
    found: list[tuple[Case, ...]] = []
    while len(found) < count:
        chosen = rng.choice(len(pool), together, replace=False)
        group = tuple(pool[k] for k in sorted(chosen.tolist()))
        if not any(_near(a, b) for a, b in combinations(group, 2)):
            found.append(group)
    return found


def _near(one: Case, other: Case) -> bool:
    names = {one.expected_effect, other.expected_effect}
    return len(names) == 1 or any(names <= twins for twins in _TWINS)


def truth_of(vehicle: Truth, group: tuple[Case, ...]) -> Truth:
    """Truth of ``vehicle`` with all that is hidden in ``group``."""
    for case in group:
        vehicle = case.of(vehicle)
    return vehicle


def hide(truth: Truth, text: str) -> Hidden:
    """Effect of ``text``, which is EFFECT[/FORM][@THRUSTER]:SIZE.

    The form is the first of `FORMS` where none is named, the thruster the vehicle's first. The form's further
    parameters are those of the sweep's cases (tools/cases.py).
    """
    head, colon, size = text.partition(":")
    head, _, thruster = head.partition("@")
    effect, _, form = head.partition("/")
    form = form or next(iter(FORMS.get(effect, {})), "")
    name = f"{effect}-{form}-strong"
    templates = [one for case in all_cases(truth) if case.name == name for one in case.hidden]
    if not colon or not templates:
        msg = f"{text}: wanted EFFECT[/FORM][@THRUSTER]:SIZE, with an effect and a form of tools/hidden.py"
        raise ValueError(msg)
    (one,) = templates
    return replace(one, parameters={**one.parameters, one.law.size: float(size)}, thruster=thruster or one.thruster)
