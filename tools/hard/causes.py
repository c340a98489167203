"""What may be hidden: each effect in forms of our own, its size drawn from weak to strong for the vehicle at hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tools.hard import layout as at
from tools.hard.layout import CAUSE_NAMES, Floats, no_cause
from tools.hard.vehicles import Vehicle


@dataclass(frozen=True)
class Cause:
    """A hidden cause for the simulator: numbers by place in the array, and the other quantities."""

    effect: str
    form: str
    strength: float  # 0 weak to 1 strong
    numbers: dict[int, float] = field(default_factory=dict)
    delay: float = 0.0  # s, by which commands come late
    jitter: float = 0.0  # of the delay, share
    rotor: float = 0.0  # s, time constant in place of the nominal one
    rotor_damping: float = 0.0  # second order if above 0
    swell_frequency: float = 0.0  # rad/s, of a narrow wave torque
    scale_by_run: tuple[float, ...] = ()
    bias_by_run: tuple[float, ...] = ()
    drift: float = 0.0  # share of the thrust that is lost in a second of the day

    def array(self, run: int, since: float) -> Floats:
        """The cause as it acts in a run that begins ``since`` seconds after the first."""
        array = no_cause()
        for place, value in self.numbers.items():
            array[place] = value
        if self.scale_by_run:
            array[at.SCALE] = self.scale_by_run[run % len(self.scale_by_run)]
        if self.bias_by_run:
            array[at.BIAS] = self.bias_by_run[run % len(self.bias_by_run)]
        if self.drift:
            array[at.SCALE] = 1.0 - self.drift * since
            array[at.DRIFT] = self.drift / array[at.SCALE]
        return array

    @property
    def sizes(self) -> dict[str, float | list[float]]:
        """The numbers by name, for the record of the truth."""
        sizes: dict[str, float | list[float]] = {
            CAUSE_NAMES[place].lower(): size for place, size in self.numbers.items()
        }
        for name in ("delay", "jitter", "rotor", "rotor_damping", "swell_frequency", "drift"):
            if value := getattr(self, name):
                sizes[name] = value
        if self.scale_by_run:
            sizes["scale_by_run"] = list(self.scale_by_run)
        if self.bias_by_run:
            sizes["bias_by_run"] = list(self.bias_by_run)
        return sizes


@dataclass(frozen=True)
class Scene:
    """What a cause's size is measured by."""

    vehicle: Vehicle
    rng: np.random.Generator
    runs: int
    span: float  # s, from the first run's start to the last one's end
    command: float  # of full, that the torque in use needs
    speed: float  # m/s ahead, typical
    sway: float  # m/s, typical

    def between(self, weak: float, strong: float, strength: float) -> float:
        """A size on a logarithmic scale."""
        return float(weak * (strong / weak) ** strength)

    def either(self) -> float:
        """A sign."""
        return float(self.rng.choice([-1.0, 1.0]))

    def phase(self) -> float:
        """An angle, rad."""
        return float(self.rng.uniform(-np.pi, np.pi))


Maker = Callable[[Scene, float], Cause]


def _deadband(s: Scene, k: float) -> Cause:
    soft = float(s.rng.choice([0.05, 0.25]))
    size = s.between(0.1, 0.8, k) * s.command
    form = "hard edge" if soft < 0.1 else "soft edge"
    return Cause("thruster_deadband", form, k, {at.DEADBAND: size, at.DEADBAND_SOFT: soft})


def _asymmetry(s: Scene, k: float) -> Cause:
    gain = 1.0 - s.between(0.1, 0.6, k)
    pure = bool(s.rng.random() < 0.5)
    thrust = 1e-6 if pure else 0.3 * s.vehicle.torque_in_use
    return Cause("thrust_asymmetry", "gain" if pure else "grows with thrust", k,
                 {at.REVERSE: gain, at.REVERSE_THRUST: thrust})  # fmt: skip


def _imbalance(s: Scene, k: float) -> Cause:
    turning = [index for index, one in enumerate(s.vehicle.thrusters) if one.yaw]
    return Cause("thruster_imbalance", "one gain", k,
                 {at.UNEQUAL: float(s.rng.choice(turning)), at.UNEQUAL_GAIN: 1.0 - s.between(0.1, 0.7, k)})  # fmt: skip


def _shape(s: Scene, k: float) -> Cause:
    bend = s.between(0.1, 0.8, k)
    return Cause(
        "thrust_curve_shape", "power of the thrust", k, {at.SHAPE: 1.0 + bend if s.either() > 0 else 1 / (1 + bend)}
    )


def _sag(s: Scene, k: float) -> Cause:
    if s.runs > 1 and s.rng.random() < 0.6:
        return Cause("supply_sag", "falls over the day", k, drift=s.between(0.08, 0.5, k) / s.span)
    tau = s.between(0.5, 8.0, float(s.rng.random())) * s.vehicle.time_constant
    return Cause("supply_sag", "load, late", k, {at.SAG: s.between(0.6, 4.0, k), at.SAG_TIME: tau})


def _scale(s: Scene, k: float) -> Cause:
    spread = s.between(0.08, 0.4, k)
    scales = np.exp(s.rng.normal(0.0, spread, s.runs))
    return Cause("trial_scale", "thrust of each run", k, scale_by_run=tuple(float(x) for x in scales / scales.mean()))


def _lag(s: Scene, k: float) -> Cause:
    damping = float(s.rng.choice([0.0, 0.8, 1.2]))
    tau = s.between(0.12, 1.2, k) * s.vehicle.time_constant
    form = "first-order rotor" if damping == 0.0 else "second-order rotor"
    return Cause("thruster_lag", form, k, rotor=tau, rotor_damping=damping)


def _delay(s: Scene, k: float) -> Cause:
    jitter = float(s.rng.choice([0.0, 0.3]))
    return Cause("command_delay", "jittery" if jitter else "constant", k,
                 delay=s.between(0.12, 0.9, k) * s.vehicle.time_constant, jitter=jitter)  # fmt: skip


def _slew(s: Scene, k: float) -> Cause:
    up = s.command / (s.between(0.3, 1.6, k) * s.vehicle.time_constant)
    even = bool(s.rng.random() < 0.5)
    return Cause("slew_limit", "even" if even else "slower to start than to stop", k,
                 {at.SLEW_UP: up, at.SLEW_DOWN: up if even else 2.5 * up})  # fmt: skip


def _hysteresis(s: Scene, k: float) -> Cause:
    size = s.between(0.15, 0.9, k) * s.command
    if s.rng.random() < 0.5:
        return Cause("command_hysteresis", "play", k, {at.PLAY: size})
    zone = max(one.zone[0] for one in s.vehicle.thrusters)
    return Cause("command_hysteresis", "starts later than it stops", k,
                 {at.SCHMITT_ON: zone + 0.8 * size, at.SCHMITT_OFF: zone + 0.1 * size})  # fmt: skip


def _advance(s: Scene, k: float) -> Cause:
    # The ratio of the advance speed to the root of the thrust of a thruster in use: what the loss goes by.
    thrusters = [one for one in s.vehicle.thrusters if one.yaw]
    each = s.vehicle.torque_in_use / sum(abs(one.arm) for one in thrusters)
    moved = s.speed + max(abs(one.arm) for one in thrusters) * s.vehicle.rate_in_use
    ratio = moved / np.sqrt(each)
    loss = s.between(0.1, 0.7, k)
    return Cause("advance_speed_loss", "open water", k,
                 {at.ADVANCE: 0.7 * loss / ratio, at.ADVANCE_2: 0.3 * loss / ratio**2})  # fmt: skip


def _bias(s: Scene, k: float) -> Cause:
    size = s.either() * s.between(0.04, 0.4, k) * s.vehicle.torque_in_use
    return Cause("bias_torque", "constant", k, {at.BIAS: size})


def _curvature(s: Scene, k: float) -> Cause:
    vehicle = s.vehicle
    if s.rng.random() < 0.5:
        cubic = s.between(0.15, 2.0, k) * vehicle.torque_in_use / vehicle.rate_in_use**3
        return Cause("drag_curvature", "cubic", k, {at.CUBIC: cubic})
    return Cause("drag_curvature", "power", k,
                 {at.POWER: s.either() * s.between(0.2, 1.0, k), at.POWER_RATE: vehicle.rate_in_use})  # fmt: skip


def _drag_asymmetry(s: Scene, k: float) -> Cause:
    return Cause("drag_asymmetry", "quadratic part alone", k,
                 {at.ASYMMETRY: s.between(0.2, 3.0, k), at.ASYMMETRY_RATE: 0.05 * s.vehicle.rate_in_use})  # fmt: skip


def _coulomb(s: Scene, k: float) -> Cause:
    size = s.between(0.08, 0.6, k) * s.vehicle.torque_in_use
    rate = s.vehicle.rate_in_use
    stribeck = bool(s.rng.random() < 0.5)
    return Cause("coulomb_resistance", "Stribeck" if stribeck else "plain", k, {
        at.COULOMB: size, at.STICTION: size * (1.3 if stribeck else 1.0), at.STRIBECK_RATE: 0.15 * rate,
        at.COULOMB_RATE: 0.03 * rate,
    })  # fmt: skip


def _oscillatory(s: Scene, k: float) -> Cause:
    return Cause("oscillatory_drag", "wake swept through", k, {
        at.OSCILLATORY: s.between(0.8, 8.0, k), at.OSCILLATORY_ANGLE: float(s.rng.uniform(0.3, 1.2)),
        at.COULOMB_RATE: 0.03 * s.vehicle.rate_in_use,
    })  # fmt: skip


def _memory(s: Scene, k: float) -> Cause:
    vehicle = s.vehicle
    quadratic = 0.5 * vehicle.rate_in_use if s.rng.random() < 0.4 else 0.0
    return Cause("added_mass_memory", "trapped water, quadratic" if quadratic else "trapped water", k, {
        at.MEMORY: s.between(0.3, 3.0, k) * vehicle.total_inertia, at.MEMORY_QUADRATIC: quadratic,
        at.MEMORY_TIME: float(s.rng.uniform(0.5, 2.5)) * vehicle.time_constant,
    })  # fmt: skip


def _swirl(s: Scene, k: float) -> Cause:
    vehicle = s.vehicle
    inertia = vehicle.total_inertia * float(s.rng.uniform(5.0, 20.0))
    coupling = s.between(0.1, 0.6, k)  # the water's rate over the vehicle's, in the long run
    brake = vehicle.torque_in_use / (coupling * vehicle.rate_in_use) ** 2 * (1.0 - coupling)
    return Cause("entrained_swirl", "lumped, braked by its square", k, {at.SWIRL: inertia, at.SWIRL_BRAKE: brake})


def _tether(s: Scene, k: float) -> Cause:
    turned = float(s.rng.uniform(3.0, 8.0))  # rad, at which the size counts
    return Cause("tether_torsion", "hardening", k, {
        at.TETHER: s.between(0.06, 0.5, k) * s.vehicle.torque_in_use / turned,
        at.TETHER_HARDENING: float(s.rng.choice([0.0, 0.2])) / turned**2, at.TETHER_REST: float(s.rng.uniform(-1, 1)),
    })  # fmt: skip


def _heading_torque(s: Scene, k: float) -> Cause:
    size = s.between(0.05, 0.45, k) * s.vehicle.torque_in_use
    share = float(s.rng.choice([0.0, 0.5, 1.0]))
    return Cause("heading_dependent_torque", "once and twice a turn", k, {
        at.HEADING_1: size * (1.0 - share), at.HEADING_1_PHASE: s.phase(), at.HEADING_2: size * share,
        at.HEADING_2_PHASE: s.phase(),
    })  # fmt: skip


def _swell(s: Scene, k: float) -> Cause:
    frequency = float(s.rng.uniform(0.5, 2.0)) / s.vehicle.time_constant
    return Cause("wave_torque", "narrow swell", k,
                 {at.SWELL: s.between(0.1, 0.8, k) * s.vehicle.torque_in_use}, swell_frequency=frequency)  # fmt: skip


def _seiche(s: Scene, k: float) -> Cause:
    return Cause("tank_seiche", "one mode", k, {
        at.SEICHE: s.between(0.06, 0.5, k) * s.vehicle.total_inertia,
        at.SEICHE_FREQUENCY: float(s.rng.uniform(0.7, 2.5)) / s.vehicle.time_constant,
        at.SEICHE_DAMPING: float(s.rng.uniform(0.02, 0.1)),
    })  # fmt: skip


def _deviation(s: Scene, k: float) -> Cause:
    size = np.radians(s.between(2.0, 20.0, k))
    share = float(s.rng.choice([0.0, 0.3, 0.6]))
    return Cause("heading_deviation", "sin and sin 2", k, {
        at.DEVIATION_1: size * (1 - share), at.DEVIATION_1_PHASE: s.phase(), at.DEVIATION_2: size * share,
        at.DEVIATION_2_PHASE: s.phase(),
    })  # fmt: skip


def _speed(s: Scene, k: float) -> Cause:
    share = s.between(0.2, 2.5, k) * s.vehicle.torque_in_use / s.vehicle.rate_in_use  # N m s/rad at the usual speed
    square = float(s.rng.choice([0.0, 0.5]))
    return Cause("speed_dependent_damping", "linear and square" if square else "linear", k, {
        at.SPEED_LINEAR: share * (1.0 - square) / s.speed, at.SPEED_QUADRATIC: share * square / s.speed**2,
    })  # fmt: skip


def _sideslip(s: Scene, k: float) -> Cause:
    size = s.between(0.08, 0.7, k) * s.vehicle.torque_in_use / s.sway
    if s.rng.random() < 0.7:
        return Cause("sideslip_moment", "N_v v", k, {at.SIDESLIP: s.either() * size})
    return Cause("sideslip_moment", "Munk", k, {at.MUNK: s.either() * size / s.speed})


MAKERS: dict[str, Maker] = {
    "thruster_deadband": _deadband, "thrust_asymmetry": _asymmetry, "thruster_imbalance": _imbalance,
    "thrust_curve_shape": _shape, "supply_sag": _sag, "trial_scale": _scale, "thruster_lag": _lag,
    "command_delay": _delay, "slew_limit": _slew, "command_hysteresis": _hysteresis, "advance_speed_loss": _advance,
    "bias_torque": _bias, "drag_curvature": _curvature, "drag_asymmetry": _drag_asymmetry,
    "coulomb_resistance": _coulomb, "oscillatory_drag": _oscillatory, "added_mass_memory": _memory,
    "entrained_swirl": _swirl, "tether_torsion": _tether, "heading_dependent_torque": _heading_torque,
    "wave_torque": _swell, "tank_seiche": _seiche, "heading_deviation": _deviation, "speed_dependent_damping": _speed,
    "sideslip_moment": _sideslip,
}  # fmt: skip
EFFECTS = tuple(MAKERS)
# What cannot be in a campaign: a difference between runs where there is one, pods that have no rotor's advance or zone.
NEEDS_RUNS = frozenset({"trial_scale"})
# What shows where a thruster runs alone for a run or two.
ALONE = frozenset({"thruster_imbalance"})
NOT_WITH_PODS = frozenset({"advance_speed_loss", "supply_sag"})
# Thrusters in pairs against each other: a weak reverse thrust is a scale of the torque both ways, which nobody can see.
COUPLES = frozenset({"inspection", "boat"})
NOT_WITH_COUPLES = frozenset({"thrust_asymmetry"})
