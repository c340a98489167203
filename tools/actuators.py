"""From commands to the thrust that the thrusters would give at rest, and the torques and factors that time alone sets.

Everything is given at the start, the middle and the end of each step of the integration: shape (3, steps).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from tools.channels import CHANNELS, SPEEDS, SUPPLY, Signal
from tools.hidden import OUTSIDE, Hidden
from tools.paths import Path, acting_path
from tools.truth import MICRO, FloatArray, IntArray, Thruster, Truth

_compiled = numba.njit(cache=True)

_HOUR = 3600.0  # s
_WAVES = 40  # sines of equal energy that make up a narrow band


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """Steps of the integration: ``knots`` in us at their ends."""

    knots: IntArray

    @property
    def length(self) -> IntArray:
        """Of each step, in us."""
        return np.diff(self.knots)

    @property
    def after(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """From each step's start to the three instants, in us."""
        length = self.length.astype(np.float64)
        return np.zeros(len(length)), length / 2.0, length

    def at_stages(self, signal: Signal) -> FloatArray:
        """Deviation of ``signal`` at the three instants."""
        return np.stack([signal.at(time) for time in self.time])

    @property
    def time(self) -> FloatArray:
        """(3, steps) s."""
        return np.stack([(self.knots[:-1] + after) / MICRO for after in self.after])


def paths(truth: Truth, offsets: Sequence[tuple[IntArray, FloatArray]], hidden: Mapping[str, Hidden]) -> list[Path]:
    """Acting command of each thruster, from (instants in us, command less neutral)."""
    return [
        acting_path(instant, value, thruster.curve.dead_zone, hidden)
        for thruster, (instant, value) in zip(truth.thrusters, offsets, strict=True)
    ]


def static_thrust(truth: Truth, acting: Sequence[Path], steps: Steps, hidden: Mapping[str, Hidden]) -> FloatArray:
    """(3, steps, thrusters) thrust in N at rest, without lag and load sag, which have states of their own."""
    bench = [_bench(thruster, path, steps, hidden) for thruster, path in zip(truth.thrusters, acting, strict=True)]
    thrust = np.stack(bench, axis=-1)
    thrust = _shaped(thrust, hidden.get("thrust_curve_shape"))
    thrust = _uneven(thrust, hidden.get("thrust_asymmetry"))
    return _unbalanced(thrust, truth, hidden.get("thruster_imbalance"))


def _bench(thruster: Thruster, path: Path, steps: Steps, hidden: Mapping[str, Hidden]) -> FloatArray:
    """(3, steps) N of one thruster by its curve, dead zone and command lag included."""
    offset = np.stack([path.over(steps.knots[:-1], after) for after in steps.after])
    lag = hidden.get("thruster_lag")
    if lag and lag.form == "command":
        offset = _lagged(offset, steps.length / MICRO, lag.parameters["time_constant"])
    curve = thruster.curve
    shape = hidden.get("thrust_curve_shape")
    if shape and shape.form == "command":
        full = curve.limit - curve.dead_zone
        beyond = np.maximum(np.abs(offset) - curve.dead_zone, 0.0)
        bent = curve.dead_zone + full * (beyond / full) ** shape.parameters["exponent"]
        offset = np.where(beyond > 0.0, np.sign(offset) * bent, 0.0)
    zone = hidden.get("thruster_deadband")
    if zone and zone.form == "shift":
        offset = np.sign(offset) * np.maximum(np.abs(offset) - zone.parameters["deadband"], 0.0)
    if zone and zone.form == "jump":
        offset = np.where(np.abs(offset) > curve.dead_zone + zone.parameters["deadband"], offset, 0.0)
    return curve.thrust(offset + curve.neutral)


def _lagged(offset: FloatArray, length: FloatArray, time_constant: float) -> FloatArray:
    """First-order lag of what is linear in each step, exactly; ``length`` of the steps and time constant in s."""
    return np.asarray(_first_order(np.ascontiguousarray(offset), length, time_constant))


@_compiled
def _first_order(offset: FloatArray, length: FloatArray, time_constant: float) -> FloatArray:
    out = np.empty_like(offset)
    held = 0.0
    for k in range(len(length)):
        begin, slope = offset[0, k], (offset[2, k] - offset[0, k]) / length[k]
        out[0, k] = held
        for stage in range(1, 3):
            time = 0.5 * length[k] * stage
            follows = begin - slope * time_constant
            out[stage, k] = follows + slope * time + (held - follows) * np.exp(-time / time_constant)
        held = out[2, k]
    return out


def _shaped(thrust: FloatArray, hidden: Hidden | None) -> FloatArray:
    if hidden is None or hidden.form == "command":
        return thrust
    share = np.abs(thrust) / hidden.parameters["thrust"]
    if hidden.form == "power":
        return np.asarray(np.sign(thrust) * hidden.parameters["thrust"] * share ** hidden.parameters["exponent"])
    loss = hidden.parameters["loss"]
    return np.asarray(thrust * (1.0 + loss) / (1.0 + loss * share))


def _uneven(thrust: FloatArray, hidden: Hidden | None) -> FloatArray:
    if hidden is None:
        return thrust
    loss = np.full(thrust.shape, 1.0 - hidden.parameters["reverse_gain"])
    if hidden.form == "growing":
        loss *= np.abs(thrust) / hidden.parameters["thrust"]
    return np.where(thrust < 0.0, (1.0 - loss) * thrust, thrust)


def _unbalanced(thrust: FloatArray, truth: Truth, hidden: Hidden | None) -> FloatArray:
    if hidden is None:
        return thrust
    number = [thruster.name for thruster in truth.thrusters].index(hidden.thruster or "")
    weak = np.full(thrust.shape[:2], hidden.parameters["gain"])
    if hidden.form == "interaction":
        others = np.delete(thrust, number, axis=-1)
        weak = np.where(np.any(others != 0.0, axis=-1), weak, 1.0)
    out = thrust.copy()
    out[..., number] *= weak
    return out


def thrust_factor(
    truth: Truth, steps: Steps, signals: Mapping[str, Signal], hidden: Mapping[str, Hidden]
) -> FloatArray:
    """(3, steps) factor on all thrust that time or the supply voltage sets."""
    sag = hidden.get("supply_sag")
    if sag and sag.form == "elapsed":
        return np.asarray(1.0 - sag.parameters["drift"] * steps.time / _HOUR)
    if sag and sag.form == "voltage":
        share = 1.0 + steps.at_stages(signals[SUPPLY]) / truth.instruments.supply
        return np.asarray(share ** sag.parameters["exponent"])
    return np.ones((3, len(steps.length)))


def _speed(name: str, steps: Steps, signals: Mapping[str, Signal]) -> FloatArray:
    """(3, steps) m/s."""
    return CHANNELS[name].mean + steps.at_stages(signals[name])


def moving_thrust(
    thrust: FloatArray, steps: Steps, signals: Mapping[str, Signal], hidden: Mapping[str, Hidden]
) -> FloatArray:
    """(3, steps, thrusters) what is left of ``thrust`` in N where the vehicle's own speed carries the thrusters."""
    loss = hidden.get("advance_speed_loss")
    if loss is None or loss.form != "measured":
        return thrust
    ahead = _speed(SPEEDS[0], steps, signals)[..., np.newaxis]
    return np.asarray(thrust - loss.parameters["coefficient"] * np.sqrt(np.abs(thrust)) * ahead)


def speed_damping(steps: Steps, signals: Mapping[str, Signal], hidden: Mapping[str, Hidden]) -> FloatArray:
    """(3, steps) N m s/rad of linear damping that the speed ahead adds."""
    damping = hidden.get("speed_dependent_damping")
    if damping is None:
        return np.zeros((3, len(steps.length)))
    ahead = _speed(SPEEDS[0], steps, signals)
    if damping.form == "linear":
        return damping.parameters["linear"] * np.abs(ahead)
    return damping.parameters["quadratic"] * ahead**2


def drag_factor(steps: Steps, signals: Mapping[str, Signal], hidden: Mapping[str, Hidden]) -> FloatArray:
    """(3, steps) factor on all drag that a logged signal sets."""
    outside = hidden.get(OUTSIDE)
    driver = {"depth_drag": "depth", "supply_drag": SUPPLY}.get(outside.form) if outside else None
    if outside is None or driver is None:
        return np.ones((3, len(steps.length)))
    return np.asarray(1.0 + outside.parameters["gain"] * steps.at_stages(signals[driver]))


def outer_torque(
    steps: Steps,
    signals: Mapping[str, Signal],
    pitch: Callable[[FloatArray], FloatArray],
    hidden: Mapping[str, Hidden],
    rng: np.random.Generator,
) -> FloatArray:
    """(3, steps) torque in N m that neither thrusters nor motion set; ``pitch`` in rad at (n,) s, less its mean."""
    total = np.zeros((3, len(steps.length)))
    if bias := hidden.get("bias_torque"):
        total = total + _bias(steps, bias, rng)
    if wave := hidden.get("wave_torque"):
        total = total + _wave(steps, wave, rng)
    if slip := hidden.get("sideslip_moment"):
        across = _speed(SPEEDS[1], steps, signals)
        along = _speed(SPEEDS[0], steps, signals) if slip.form == "munk" else 1.0
        total = total - slip.parameters[slip.law.size] * along * across
    if outside := hidden.get(OUTSIDE):
        total = total + _outside(steps, signals, pitch, outside)
    return total


def _bias(steps: Steps, hidden: Hidden, rng: np.random.Generator) -> FloatArray:
    torque = np.full((3, len(steps.length)), hidden.parameters["torque"])
    if hidden.form == "wandering":
        phase = rng.uniform(0.0, 2.0 * np.pi)
        torque *= 1.0 + 0.25 * np.sin(2.0 * np.pi * steps.time / hidden.parameters["period"] + phase)
    return torque


def _wave(steps: Steps, hidden: Hidden, rng: np.random.Generator) -> FloatArray:
    """A sine, or sines of equal energy at the quantiles of a resonance's spectrum."""
    amplitude, frequency = hidden.parameters["amplitude"], np.array([hidden.parameters["frequency"]])
    if hidden.form == "narrow_band":
        quantile = (np.arange(_WAVES) + rng.uniform(0.0, 1.0, _WAVES)) / _WAVES
        spread = np.tan(np.pi * np.clip(quantile - 0.5, -0.46, 0.46))  # the tails beyond 8 half-widths folded in
        frequency = np.abs(frequency * (1.0 + hidden.parameters["damping"] * spread))
    total = np.zeros((3, len(steps.length)))
    for one in frequency:
        total += np.sin(one * steps.time + rng.uniform(0.0, 2.0 * np.pi))
    return np.asarray(amplitude * total / np.sqrt(len(frequency)))


def _outside(
    steps: Steps, signals: Mapping[str, Signal], pitch: Callable[[FloatArray], FloatArray], hidden: Hidden
) -> FloatArray:
    if hidden.form == "manipulator":
        return hidden.parameters["torque"] * np.radians(steps.at_stages(signals["manipulator_angle"]))
    if hidden.form == "tension":
        return hidden.parameters["arm"] * steps.at_stages(signals["tether_tension"])
    if hidden.form == "surge":
        return hidden.parameters["torque"] * steps.at_stages(signals["surge_speed"])
    if hidden.form == "pitch":
        return hidden.parameters["torque"] * np.stack([pitch(time) for time in steps.time])
    return np.zeros((3, len(steps.length)))
