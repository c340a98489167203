"""What may be hidden: each effect in laws of our own, its size from just visible to overwhelming for the vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tools.wide.motion import IN_SERIES, OF_COMMAND, OF_ROTOR, OF_SPIN, OF_TORQUE
from tools.wide.vehicle import Vehicle

ALL = ("inertia", "quadratic_drag", "linear_drag")


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A hidden cause.

    Attributes
    ----------
    physics
        Fields of `Physics` that it sets.
    parameters
        True values by the names of the catalogue, where the law is the catalogue's own.
    comparable
        Parameters of the plain model whose true value the law leaves defined.
    shortest
        Shortest time in s that the integration has to resolve.
    slow
        Time in s by which it slows the answer; programmes are drawn to suit it.
    """

    effect: str
    form: str
    strength: float
    physics: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    comparable: tuple[str, ...] = ALL
    shortest: float = np.inf
    slow: float = 0.0
    delay: float = 0.0  # s
    jitter: float = 0.0  # share of the delay
    wave: float = 0.0  # N m, amplitude
    wave_frequency: float = 0.0  # rad/s
    wave_damping: float = 0.0  # 0: a sine
    once: float = 0.0  # rad, added to the measured heading
    once_phase: float = 0.0
    twice: float = 0.0  # rad
    twice_phase: float = 0.0
    weak_name: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """What sizes are measured by: the vehicle, a random generator, and the campaign's times in s."""

    vehicle: Vehicle
    rng: np.random.Generator
    longest_run: float
    day: float
    speed: float  # m/s ahead, typical
    sway: float  # m/s, typical
    fastest_wave: float  # rad/s that the heading resolves

    def between(self, weak: float, strong: float, strength: float) -> float:
        """A size on a logarithmic scale."""
        return float(weak * (strong / weak) ** strength)

    def spread(self, low: float, high: float) -> float:
        """A number with a uniform logarithm, whatever the strength."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def either(self) -> float:
        """A sign."""
        return float(self.rng.choice([-1.0, 1.0]))

    def phase(self) -> float:
        """An angle in rad."""
        return float(self.rng.uniform(-np.pi, np.pi))

    def ratio(self, weak: float, strong: float, strength: float) -> float:
        """A factor above or below 1."""
        factor = 1.0 + self.between(weak, strong, strength)
        return factor if self.either() > 0.0 else 1.0 / factor


Maker = Callable[[Scene, float, str], Cause]


def _deadband(s: Scene, k: float, form: str) -> Cause:
    share = s.between(0.02, 0.3, k)
    physics = {"deadband": share}
    if form == "smooth":
        physics["edge"] = 0.4 * share
    if form == "jump":
        physics["jump"] = 1.0
    named = {} if form == "smooth" else {"deadband": share * s.vehicle.span}
    return Cause(effect="thruster_deadband", form=form, strength=k, physics=physics, parameters=named)


def _asymmetry(s: Scene, k: float, form: str) -> Cause:
    gain = 1.0 - s.between(0.05, 0.6, k)
    physics = {"reverse": gain, "reverse_grows": 1.0 if form == "growing" else 0.0}
    named = {"reverse_gain": gain} if form == "gain" else {}
    return Cause(effect="thrust_asymmetry", form=form, strength=k, physics=physics, parameters=named)


def _imbalance(s: Scene, k: float, form: str) -> Cause:
    index = int(s.rng.integers(len(s.vehicle.names)))
    gain = 1.0 - s.between(0.15, 0.9, k)
    physics = {"weak": gain, "weak_index": float(index), "weak_beside": 1.0 if form == "beside" else 0.0}
    return Cause(
        effect="thruster_imbalance", form=form, strength=k, physics=physics, parameters={"gain": gain},
        weak_name=s.vehicle.names[index],
    )  # fmt: skip


def _shape(s: Scene, k: float, form: str) -> Cause:
    # The thrust at which the bench is right is a convention: it scales inertia and drag.
    if form == "power":
        exponent = s.ratio(0.06, 0.7, k)
        physics, named = {"power": exponent}, {"exponent": exponent}
    elif form == "saturating":
        loss = s.between(0.02, 0.5, k)
        physics, named = {"saturating": loss}, {"loss": loss}
    else:
        exponent = s.ratio(0.06, 0.7, k)
        physics, named = {"command_power": exponent}, {"exponent": exponent}
    return Cause(effect="thrust_curve_shape", form=form, strength=k, physics=physics, parameters=named, comparable=())


def _sag(s: Scene, k: float, form: str) -> Cause:
    tau = s.vehicle.time_constant
    if form == "load":
        sag, time = s.between(0.08, 0.8, k), tau * s.spread(0.3, 10.0)
        physics, named = {"sag": sag, "sag_time": time}, {"sag": sag, "time_constant": time}
    elif form == "drift":
        drift = s.between(0.08, 0.7, k) / s.longest_run
        physics, named = {"fade": drift}, {"drift": 3600.0 * drift}
    elif form == "day":
        drift = s.between(0.08, 0.7, k) / s.day
        physics, named = {"day_fade": drift}, {"drift": 3600.0 * drift}
    else:
        power = s.between(0.3, 4.0, k)
        physics, named = {"voltage_power": power}, {"exponent": power}
    return Cause(effect="supply_sag", form=form, strength=k, physics=physics, parameters=named)


def _lag(s: Scene, k: float, form: str) -> Cause:
    kinds = {"torque": OF_TORQUE, "command": OF_COMMAND, "spin": OF_SPIN, "rotor": OF_ROTOR, "series": IN_SERIES}
    time = s.between(0.05, 5.0, k) * s.vehicle.time_constant
    physics = {"lag": time, "lag_kind": float(kinds[form])}
    named = {"time_constant": time}
    shortest = time
    if form == "series":
        physics["second_lag"] = shortest = time * float(s.rng.uniform(0.2, 0.8))
        named = {}
    if form == "rotor":
        shortest = 0.3 * time
    return Cause(effect="thruster_lag", form=form, strength=k, physics=physics, parameters=named, shortest=shortest,
                 slow=time)  # fmt: skip


def _delay(s: Scene, k: float, form: str) -> Cause:
    delay = s.between(0.05, 3.0, k) * s.vehicle.time_constant
    jitter = float(s.rng.uniform(0.2, 0.9)) if form == "scattered" else 0.0
    named = {"delay": delay} if form == "constant" else {}
    return Cause(
        effect="command_delay", form=form, strength=k, delay=delay, jitter=jitter, parameters=named, slow=delay
    )


def _slew(s: Scene, k: float, form: str) -> Cause:
    time = s.between(0.2, 8.0, k) * s.vehicle.time_constant
    physics = {"slew_up": 1.0 / time}
    if form == "hard":
        physics["slew_down"] = 1.0 / time
    return Cause(effect="slew_limit", form=form, strength=k, physics=physics,
                 parameters={"rate": s.vehicle.span / time}, shortest=time, slow=0.6 * time)  # fmt: skip


def _hysteresis(s: Scene, k: float, form: str) -> Cause:
    share = s.between(0.04, 0.4, k)
    name = "play" if form == "play" else "schmitt"
    named = {"width": share * s.vehicle.span}
    return Cause(effect="command_hysteresis", form=form, strength=k, physics={name: share}, parameters=named)


def _advance(s: Scene, k: float, form: str) -> Cause:
    # Advance number at full thrust and full rate: the share of the thrust that is lost there.
    share = s.between(0.04, 0.5, k)
    root = float(np.sqrt(np.median(s.vehicle.full_thrusts)))
    if form == "measured":
        size = share * root / s.speed
        physics = {"advance_surge": size}
    else:
        size = share * root / (float(np.median(np.abs(s.vehicle.arms))) * s.vehicle.full_rate)
        physics = {"advance": size, "advance_curved": 1.0 if form == "curved" else 0.0}
    named = {} if form == "curved" else {"coefficient": size}
    return Cause(effect="advance_speed_loss", form=form, strength=k, physics=physics, parameters=named,
                 shortest=0.5 * s.vehicle.time_constant)  # fmt: skip


def _bias(s: Scene, k: float, form: str) -> Cause:
    torque = s.either() * s.between(0.02, 0.4, k) * s.vehicle.torque
    return Cause(effect="bias_torque", form=form, strength=k, physics={"bias": torque}, parameters={"torque": torque})


def _curvature(s: Scene, k: float, form: str) -> Cause:
    v = s.vehicle
    rate = {"full_rate": v.full_rate}
    if form == "cubic":
        cubic = s.between(0.1, 3.0, k) * v.torque / v.full_rate**3
        return Cause(effect="drag_curvature", form=form, strength=k, physics={"cubic": cubic},
                     parameters={"cubic": cubic}, shortest=0.3 * v.time_constant)  # fmt: skip
    if form == "exponent":
        exponent = 2.0 + s.either() * s.between(0.15, 0.9, k)
        return Cause(effect="drag_curvature", form=form, strength=k, physics=rate | {"exponent": exponent},
                     parameters={"exponent": exponent}, comparable=("inertia", "linear_drag"))  # fmt: skip
    loss = s.between(0.1, 0.7, k)
    return Cause(effect="drag_curvature", form=form, strength=k, physics=rate | {"crisis": loss},
                 comparable=("inertia",))  # fmt: skip


def _drag_asymmetry(s: Scene, k: float, form: str) -> Cause:
    ratio = s.ratio(0.06, 1.5, k)
    name = "astern_drag" if form == "all" else "astern_quadratic"
    return Cause(effect="drag_asymmetry", form=form, strength=k, physics={name: ratio}, parameters={"ratio": ratio})


def _coulomb(s: Scene, k: float, form: str) -> Cause:
    v = s.vehicle
    torque = s.between(0.02, 0.35, k) * v.torque
    rate = v.full_rate * {"sharp": 0.004, "tanh": s.spread(0.03, 0.15), "stribeck": 0.01}[form]
    physics = {"coulomb": torque, "coulomb_rate": rate}
    if form == "stribeck":
        physics |= {"stribeck": float(s.rng.uniform(0.2, 0.8)), "stribeck_rate": v.full_rate * s.spread(0.03, 0.15)}
    named = {} if form == "stribeck" else {"torque": torque}
    return Cause(effect="coulomb_resistance", form=form, strength=k, physics=physics, parameters=named,
                 shortest=6.0 * v.inertia * rate / torque)  # fmt: skip


def _oscillatory(s: Scene, k: float, form: str) -> Cause:
    v = s.vehicle
    gain = s.between(0.3, 6.0, k)
    angle = min(s.spread(0.2, 2.0) * v.full_rate * v.time_constant, 6.0)
    physics = {"oscillatory": gain, "oscillatory_angle": angle, "algebraic": 1.0 if form == "algebraic" else 0.0}
    return Cause(effect="oscillatory_drag", form=form, strength=k, physics=physics,
                 parameters={"gain": gain, "swept_angle": angle}, shortest=0.5 * v.time_constant)  # fmt: skip


def _memory(s: Scene, k: float, form: str) -> Cause:
    v = s.vehicle
    inertia, time = s.between(0.08, 2.5, k) * v.inertia, s.spread(0.4, 6.0) * v.time_constant
    named = {"inertia": inertia, "time_constant": time}
    physics = {"memory": inertia, "memory_time": time}
    if form == "two times":
        share = float(s.rng.uniform(0.3, 0.7))
        physics = {"memory": share * inertia, "memory_time": time, "second_memory": (1.0 - share) * inertia,
                   "second_time": time * s.spread(0.1, 0.4)}  # fmt: skip
        named = {}
    if form == "porous":
        physics["porous_rate"] = v.full_rate
        named = {}
    shortest = min(physics["memory_time"], physics.get("second_time", np.inf)) / (1.0 + inertia / v.inertia)
    return Cause(effect="added_mass_memory", form=form, strength=k, physics=physics, parameters=named,
                 shortest=0.5 * shortest, slow=0.5 * time)  # fmt: skip


def _swirl(s: Scene, k: float, form: str) -> Cause:
    v = s.vehicle
    coupling, time = s.between(0.06, 0.7, k), s.spread(2.0, 20.0) * v.time_constant
    if form == "first order":
        physics = {"swirl": coupling, "swirl_time": time}
        return Cause(effect="entrained_swirl", form=form, strength=k, physics=physics,
                     parameters={"coupling": coupling, "time_constant": time}, slow=0.2 * time)  # fmt: skip
    # In the steady state drag(r - w) = brake w|w|; w = coupling * r at the full rate. Water answers in about `time`.
    slip = (1.0 - coupling) * v.full_rate
    drag = v.quadratic_drag * slip**2 + v.linear_drag * slip
    brake = drag / (coupling * v.full_rate) ** 2
    water = time * (2.0 * v.quadratic_drag * slip + v.linear_drag + 2.0 * brake * coupling * v.full_rate)
    return Cause(effect="entrained_swirl", form=form, strength=k, physics={"annulus": water, "annulus_brake": brake},
                 slow=0.2 * time)  # fmt: skip


def _tether(s: Scene, k: float, form: str) -> Cause:
    v = s.vehicle
    span = max(4.0 * v.full_rate * v.time_constant, 0.5)  # rad that it turns in some time constants
    stiffness = s.between(0.03, 0.8, k) * v.torque / span
    physics = {"tether": stiffness}
    named = {"stiffness": stiffness}
    if form == "stiffening":
        physics["tether_angle"] = span * s.spread(0.5, 2.0)
        named["angle"] = physics["tether_angle"]
    if form == "rest":
        physics["tether_fixed"] = 1.0
    rocking = np.sqrt(v.inertia / stiffness)
    return Cause(effect="tether_torsion", form=form, strength=k, physics=physics, parameters=named,
                 shortest=0.5 * float(rocking))  # fmt: skip


def _heading(s: Scene, k: float, form: str) -> Cause:
    size = s.between(0.03, 0.4, k) * s.vehicle.torque
    physics: dict[str, float] = {}
    named: dict[str, float] = {}
    if form in {"one cycle", "mixed"}:
        physics |= {"once": size, "once_phase": s.phase()}
        named = {"amplitude": size} if form == "one cycle" else {}
    if form in {"two cycles", "mixed"}:
        second = size * (1.0 if form == "two cycles" else float(s.rng.uniform(0.3, 1.0)))
        physics |= {"twice": second, "twice_phase": s.phase()}
        named = {"amplitude": size} if form == "two cycles" else {}
    return Cause(effect="heading_dependent_torque", form=form, strength=k, physics=physics, parameters=named)


def _wave(s: Scene, k: float, form: str) -> Cause:
    frequency = min(s.spread(0.7, 6.0) / s.vehicle.time_constant, s.fastest_wave)
    size = s.between(0.03, 0.6, k) * s.vehicle.torque
    damping = float(s.rng.uniform(0.02, 0.1)) if form == "narrow band" else 0.0
    return Cause(effect="wave_torque", form=form, strength=k, wave=size, wave_frequency=frequency,
                 wave_damping=damping, parameters={"amplitude": size, "frequency": frequency},
                 shortest=0.5 / frequency)  # fmt: skip


def _seiche(s: Scene, k: float, form: str) -> Cause:
    frequency = min(s.spread(0.7, 5.0) / s.vehicle.time_constant, s.fastest_wave)
    gain, damping = s.between(0.04, 0.6, k), s.spread(0.01, 0.1)
    physics = {"seiche": gain, "seiche_frequency": frequency, "seiche_damping": damping,
               "seiche_by_thrust": 1.0 if form == "thrust" else 0.0}  # fmt: skip
    named = {"gain": gain, "frequency": frequency, "damping": damping}
    return Cause(effect="tank_seiche", form=form, strength=k, physics=physics, parameters=named,
                 shortest=0.5 / frequency)  # fmt: skip


def _deviation(s: Scene, k: float, form: str) -> Cause:
    size = s.between(0.04, 0.3, k)
    second = 0.5 * size * (1.0 if form == "two cycles" else float(s.rng.uniform(0.3, 1.0)))
    one, two = form in {"one cycle", "mixed"}, form in {"two cycles", "mixed"}
    named = {"one cycle": {"amplitude": size}, "two cycles": {"amplitude": second}}.get(form, {})
    return Cause(
        effect="heading_deviation", form=form, strength=k, parameters=named, once=size if one else 0.0,
        once_phase=s.phase(), twice=second if two else 0.0, twice_phase=s.phase(),
    )  # fmt: skip


def _damping(s: Scene, k: float, form: str) -> Cause:
    share = s.between(0.06, 2.0, k) * s.vehicle.torque / s.vehicle.full_rate
    if form == "linear":
        physics, named = {"speed_linear": share / s.speed}, {"linear": share / s.speed}
    else:
        physics, named = {"speed_quadratic": share / s.speed**2}, {"quadratic": share / s.speed**2}
    return Cause(effect="speed_dependent_damping", form=form, strength=k, physics=physics, parameters=named,
                 shortest=0.3 * s.vehicle.time_constant)  # fmt: skip


def _sideslip(s: Scene, k: float, form: str) -> Cause:
    size = s.either() * s.between(0.05, 0.7, k) * s.vehicle.torque / s.sway
    if form == "drift":
        physics, named = {"sideslip": size}, {"coefficient": size}
    else:
        physics, named = {"munk": size / s.speed}, {"munk": size / s.speed}
    return Cause(effect="sideslip_moment", form=form, strength=k, physics=physics, parameters=named)


# Effect -> its forms and its maker.
_ALL: Mapping[str, tuple[tuple[str, ...], Maker]] = {
    "thruster_deadband": (("hard", "smooth", "jump"), _deadband),
    "thrust_asymmetry": (("gain", "growing"), _asymmetry),
    "thruster_imbalance": (("gain", "beside"), _imbalance),
    "thrust_curve_shape": (("power", "saturating", "command"), _shape),
    "supply_sag": (("load", "drift", "day", "voltage"), _sag),
    "thruster_lag": (("torque", "command", "spin", "rotor", "series"), _lag),
    "command_delay": (("constant", "scattered"), _delay),
    "slew_limit": (("hard", "soft start"), _slew),
    "command_hysteresis": (("play", "switch"), _hysteresis),
    "advance_speed_loss": (("own turn", "curved", "measured"), _advance),
    "bias_torque": (("constant",), _bias),
    "drag_curvature": (("cubic", "exponent", "crisis"), _curvature),
    "drag_asymmetry": (("all", "quadratic"), _drag_asymmetry),
    "coulomb_resistance": (("sharp", "tanh", "stribeck"), _coulomb),
    "oscillatory_drag": (("exponential", "algebraic"), _oscillatory),
    "added_mass_memory": (("one time", "two times", "porous"), _memory),
    "entrained_swirl": (("first order", "annulus"), _swirl),
    "tether_torsion": (("linear", "stiffening", "rest"), _tether),
    "heading_dependent_torque": (("one cycle", "two cycles", "mixed"), _heading),
    "wave_torque": (("sine", "narrow band"), _wave),
    "tank_seiche": (("acceleration", "thrust"), _seiche),
    "heading_deviation": (("one cycle", "two cycles", "mixed"), _deviation),
    "speed_dependent_damping": (("linear", "quadratic"), _damping),
    "sideslip_moment": (("drift", "munk"), _sideslip),
}
FORMS: Mapping[str, tuple[str, ...]] = {effect: forms for effect, (forms, _) in _ALL.items()}
NEEDS_SPEED = frozenset({("advance_speed_loss", "measured"), ("speed_dependent_damping", "linear"),
                         ("speed_dependent_damping", "quadratic"), ("sideslip_moment", "drift"),
                         ("sideslip_moment", "munk")})  # fmt: skip
NEEDS_TURNS = frozenset({"heading_dependent_torque", "heading_deviation", "tether_torsion"})
NEEDS_QUADRATIC = frozenset({"drag_curvature", "oscillatory_drag", "drag_asymmetry"})


def make(scene: Scene, effect: str, form: str, strength: float) -> Cause:
    """A cause of a strength from 0 (just visible) to 1 (overwhelming)."""
    return _ALL[effect][1](scene, strength, form)
