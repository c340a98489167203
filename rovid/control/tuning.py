"""Gains from damping and bandwidth, and how far the loop is from instability."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.control.actuator_response import ComplexArray
from rovid.control.control_law import ControlLaw, effect_torque
from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects.base import TERM_STATES
from rovid.model.model import Model
from rovid.store.parameter_file import Parameters

_FREQUENCIES = 1200
# The sampled plant's response folds back about every multiple of the sampling frequency; it falls as the cube of that.
_FOLDS = np.arange(-15, 16)
_NUDGE = 1e-4  # rad, rad/s
# Of the rate, from next to nothing to the fastest; and at how many angles in a quarter of each is looked.
_SWINGS, _ANGLES = 12, 6
_NOTHING = 1e-30  # of a gain
_PHASE_MARGIN, _SENSITIVITY_PEAK = 45.0, 1.6
BANDWIDTHS = np.geomspace(0.01, 20.0, 120)
# Of the identified inertia, when it is drawn from its uncertainty.
_LEAST_INERTIA = 0.2


def pd_gains(inertia: float, damping: float, bandwidth: float) -> tuple[float, float]:
    """Gains kp in N m/rad and kd in N m s/rad for a ``damping`` ratio and ``bandwidth`` (natural frequency) in rad/s.

    Of ``I*rdot + kd*r + kp*psi = 0``, what is left where the aid cancels the drag: Ramesh et al. 2013, eq. 13, with the
    yaw inertia in kg m^2 where the paper has the mass.
    """
    return inertia * bandwidth**2, 2.0 * damping * bandwidth * inertia


def damping_ratio(kp: float, kd: float, inertia: float) -> float:
    """``kd / (2*sqrt(inertia*kp))``."""
    return kd / (2.0 * math.sqrt(inertia * kp))


@dataclass(frozen=True, kw_only=True)
class Margins:
    """How much more gain, phase lag and delay the loop stands; the smallest over all its crossings.

    Attributes
    ----------
    stable
        By Nyquist's criterion; where it is not, the gain has to fall by -gain_db, and the phase margin is negative.
    gain_db, gain_down_db
        The gain may rise, or fall, by so much; infinite where nothing limits it.
    phase_deg, delay_s
        NaN where the gain never crosses one.
    lag_s
        Time constant of a further first-order lag that the loop stands.
    crossover
        rad/s; the highest frequency at which the gain is one.
    sensitivity_peak
        Largest of |1/(1 + L)|.
    """

    stable: bool
    gain_db: float
    gain_down_db: float
    phase_deg: float
    delay_s: float
    lag_s: float
    crossover: float
    sensitivity_peak: float


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenLoop:
    """The loop about rest, opened at the torque.

    Attributes
    ----------
    law
        Its controller.
    motion
        (n, n) and (n,): how the states of the linearised motion change with each other, and with the torque; heading
        first and rate second.
    actuators
        Frequencies in rad/s and the (f,) response from wanted to acting torque, per interval of the controller.
    delay
        s, between a heading and the command that it leads to.
    """

    law: ControlLaw
    motion: tuple[FloatArray, FloatArray]
    actuators: tuple[FloatArray, ComplexArray]
    delay: float = 0.0

    def transfer(self, frequency: FloatArray) -> ComplexArray:
        """(f,) L at the (f,) frequencies in rad/s, below half the sampling frequency; sampled exactly."""
        period = self.law.period
        matrix, by_torque = self.motion
        folds = 2.0 * math.pi / period * _FOLDS
        s = 1j * (frequency[:, None] + folds)
        # c adj(sI - A) b = det(sI - A + b c) - det(sI - A), with c the heading; b of the size of one.
        own, scale = np.poly(matrix), float(np.max(np.abs(by_torque)))
        closed = matrix.copy()
        closed[:, 0] -= by_torque / scale
        added = np.poly(closed) - own
        heading = scale * np.polyval(added, s) / np.polyval(own, s)
        # Held over the period, which is the same in every fold, delayed, and sampled.
        held = -np.expm1(-1j * frequency * period) / period
        sampled = np.exp(-1j * frequency * self.delay) * ((heading / s) @ np.exp(-1j * folds * self.delay))
        return np.asarray(self.controller(frequency) * self.actuation(frequency) * held * sampled)

    def controller(self, frequency: FloatArray) -> ComplexArray:
        """(f,) wanted torque per heading, with its sign turned."""
        law = self.law
        back = np.exp(-1j * frequency * law.period)
        rate = law.blend * (1.0 - back) / law.period / (1.0 - (1.0 - law.blend) * back)
        # What the law does against torques at rest has a slope at the heading it starts from.
        change = law.static_torque(_NUDGE, _NUDGE) - law.static_torque(-_NUDGE, -_NUDGE)
        slope = change / (2.0 * _NUDGE)
        return np.asarray(law.kp - slope + (law.kd - law.linear_drag) * rate)

    def actuation(self, frequency: FloatArray) -> ComplexArray:
        """(f,) response of the actuators, between the probes by gain and by delay."""
        known, response = self.actuators
        lags = np.empty(len(known))
        lag = 0.0
        for at, (w, value) in enumerate(zip(known, response, strict=True)):
            # A delay turns the phase by more than half a turn from probe to probe, but changes little itself.
            lag -= float(np.angle(value * np.exp(1j * w * lag))) / w
            lags[at] = lag
        gain = np.interp(frequency, known, np.abs(response))
        delay = np.interp(frequency, known, lags)
        return np.asarray(gain * np.exp(-1j * frequency * delay))

    def total_lag(self, frequency: float) -> float:
        """All that delays the loop, in s, at ``frequency`` in rad/s; holding and difference take half a period each."""
        response = complex(self.actuation(np.array([frequency]))[0])
        late = self.delay + self.law.period + self.law.rate_filter
        return late - float(np.angle(response)) / frequency

    def margins(self) -> Margins:
        """From the transfer over five decades up to half the sampling frequency."""
        highest = math.pi / self.law.period
        frequency = np.geomspace(1e-5 * highest, highest * (1.0 - 1e-9), _FREQUENCIES)
        response = self.transfer(frequency)
        x, size = np.log(frequency), np.log(np.maximum(np.abs(response), _NOTHING))
        # The phase above -180 degrees; at low frequency, as of a constant, 1/s or 1/s^2, between none and 180.
        above = np.unwrap(np.angle(response)) + math.pi
        above -= 2.0 * math.pi * round((above[0] - 0.5 * math.pi) / (2.0 * math.pi))
        stable, up, down = _gain_margins(x, size, above)
        crossovers, phases, delays = [], [], []
        for at, _ in _crossings(x, size):
            phase = float(np.interp(at, x, above))
            if stable:
                phase %= 2.0 * math.pi
            crossovers.append(math.exp(at))
            phases.append(phase)
            delays.append(phase / math.exp(at))
        return Margins(
            stable=stable,
            gain_db=_decibel(up),
            gain_down_db=_decibel(down),
            phase_deg=math.degrees(min(phases, default=math.nan)),
            delay_s=min(delays, default=math.nan),
            lag_s=_lag_margin(frequency, response) if stable else 0.0,
            crossover=max(crossovers, default=math.nan),
            sensitivity_peak=float(np.max(np.abs(1.0 / (1.0 + response)))),
        )


def _gain_margins(x: FloatArray, size: FloatArray, above: FloatArray) -> tuple[bool, float, float]:
    """Whether the loop is stable, and by how much its gain may rise and fall, as logarithms.

    By Nyquist's criterion: where the phase passes -180 degrees with a gain above one, it comes back as often.
    """
    rest, beyond, balance = [], [], 0
    for at, falling in _crossings(x, above):
        gain = float(np.interp(at, x, size))
        if gain > 0.0:
            beyond.append(gain)
            balance += 1 if falling else -1
        elif gain <= 0.0:
            rest.append(-gain)
    down = min(beyond, default=math.inf)
    if balance != 0:
        return False, -max(beyond), down
    return True, min(rest, default=math.inf), down


def _lag_margin(frequency: FloatArray, response: ComplexArray) -> float:
    """The least t in s with L/(1 + jwt) = -1: where the real part of L is -1, its imaginary part is -w*t."""
    x = np.log(frequency)
    at = np.array([place for place, _ in _crossings(x, response.real + 1.0)])
    lags = -np.interp(at, x, response.imag) / np.exp(at)
    return float(np.min(lags[lags > 0.0], initial=math.inf))


def _crossings(x: FloatArray, y: FloatArray) -> list[tuple[float, bool]]:
    """Where (n,) ``y`` passes zero, and whether it falls there."""
    at = np.flatnonzero((y[:-1] > 0.0) != (y[1:] > 0.0))
    between = x[at] + (x[at + 1] - x[at]) * y[at] / (y[at] - y[at + 1])
    return list(zip(between.tolist(), (y[at] > 0.0).tolist(), strict=True))


def _decibel(logarithm: float) -> float:
    """The natural ``logarithm`` of a gain in dB."""
    return 20.0 * logarithm / math.log(10.0)


def linearise(model: Model, fastest: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """(n, n) and (n,): the motion about rest at heading zero; heading, rate, and the states of the effects.

    What rubs damps slow motion alone: effects damp here as little as they do any swing of the rate up to ``fastest``
    in rad/s. Drag damps as at rest, for what it does beyond is taken off again by the controller's aid.
    """
    torque = effect_torque(model)
    count = len(model.terms.kinds)
    size = 2 + count * TERM_STATES

    def change(state: FloatArray, push: float) -> FloatArray:
        angle, rate, own = state[0], state[1], state[2:].reshape(count, TERM_STATES)
        extra, slopes = 0.0, np.zeros((count, TERM_STATES))
        if torque is not None:
            extra, slopes = torque(rate, angle, push, 0.0, own)
        acceleration = (push + extra - model.linear_drag * rate) / model.inertia
        return np.concatenate(([rate, acceleration], slopes.ravel()))

    rest, matrix = np.zeros(size), _slopes(change, size)
    if torque is not None and fastest > _NUDGE:
        swings = [_swung(change, size, amplitude) for amplitude in np.geomspace(_NUDGE, fastest, _SWINGS)]
        matrix[:, 1] = max(swings, key=lambda column: column[1])
    by_torque = 0.5 * (change(rest, 1.0) - change(rest, -1.0))
    moves = np.flatnonzero(np.any(matrix != 0.0, axis=1) | (by_torque != 0.0))
    return matrix[np.ix_(moves, moves)], by_torque[moves]


def _slopes(change: Callable[[FloatArray, float], FloatArray], size: int) -> FloatArray:
    """(n, n) slopes of the ``change`` about rest along each of ``size`` states, without a push."""
    slopes = np.empty((size, size))
    for at in range(size):
        nudge = _NUDGE * np.eye(size)[at]
        slopes[:, at] = (change(nudge, 0.0) - change(-nudge, 0.0)) / (2.0 * _NUDGE)
    return slopes


def _swung(change: Callable[[FloatArray, float], FloatArray], size: int, amplitude: float) -> FloatArray:
    """(n,) of what a sine of the rate, of ``amplitude`` in rad/s, makes of the ``change``, the sine by its amplitude.

    The describing function: Gelb and Vander Velde 1968, chapter 2.
    """
    sines = np.sin((np.arange(_ANGLES) + 0.5) * 0.5 * math.pi / _ANGLES)
    rates = amplitude * sines[:, None] * np.eye(size)[1]
    answers = np.array([change(rate, 0.0) - change(-rate, 0.0) for rate in rates])
    return np.asarray(sines @ answers / (_ANGLES * amplitude))


def largest_bandwidth(loop_of: Callable[[float], OpenLoop], limit: float) -> float:
    """The largest bandwidth in rad/s below ``limit`` at which the margins are comfortable.

    Phase margin 45 degrees, sensitivity peak 1.6, and a delay margin of as long as all that delays the loop already.

    Raises
    ------
    DataError
        There is none.
    """
    for bandwidth in BANDWIDTHS[::-1]:
        if bandwidth > limit:
            continue
        if _is_comfortable(loop_of(float(bandwidth))):
            return float(bandwidth)
    raise DataError(
        f"no bandwidth above {BANDWIDTHS[0]:g} rad/s leaves a comfortable margin: the loop is delayed too much.",
        mend="Give --bandwidth, or --kp and --kd, or shorten --period and --delay.",
    )


def _is_comfortable(loop: OpenLoop) -> bool:
    """Whether phase margin, sensitivity peak and delay margin leave room for what the model does not know."""
    margins = loop.margins()
    damped = margins.phase_deg >= _PHASE_MARGIN and margins.sensitivity_peak <= _SENSITIVITY_PEAK
    return damped and margins.stable and margins.delay_s >= loop.total_lag(margins.crossover)


def sample_models(parameters: Parameters, count: int, seed: int) -> list[Model]:
    """``count`` models from the covariance in the parameter file, each parameter within its physical bounds."""
    names = list(parameters.entries)
    matrix = _covariance(parameters, names)
    centre = np.array([parameters.entries[name].value for name in names])
    scale = _scale(matrix, centre)
    # One square root for all draws; rounding of the file may leave it not quite definite.
    values, vectors = np.linalg.eigh(np.nan_to_num(matrix / np.outer(scale, scale)))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) * scale[:, None]
    chance = np.random.default_rng(seed).standard_normal((count, len(names)))
    bounds = np.array([_bounds(parameters.model(), name) for name in names])
    models = []
    for row in np.clip(centre + chance @ root.T, *bounds.T):
        entries = {}
        for name, value in zip(names, row, strict=True):
            entries[name] = replace(parameters.entries[name], value=float(value))
        models.append(replace(parameters, entries=entries).model())
    return models


def _covariance(parameters: Parameters, names: Sequence[str]) -> FloatArray:
    """(p, p) of the file."""
    matrix = np.zeros((len(names), len(names)))
    for row, column in np.ndindex(matrix.shape):
        matrix[row, column] = _of_pair(parameters, names[row], names[column])
    return matrix


def _of_pair(parameters: Parameters, first: str, second: str) -> float:
    """Covariance of two parameters; the file has each pair once, in either order."""
    turned = parameters.covariance.get((second, first), 0.0)
    return parameters.covariance.get((first, second), turned)


def _scale(matrix: FloatArray, centre: FloatArray) -> FloatArray:
    """(p,) standard deviations; the size of the ``centre`` where there are none."""
    spread = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    return np.asarray(np.where(spread > 0.0, spread, np.maximum(np.abs(centre), 1.0)))


def _bounds(model: Model, name: str) -> tuple[float, float]:
    """Of a parameter of the file; those in units of a search's scale are bounded by their sign alone."""
    key, _, parameter = name.rpartition(".")
    if name == "inertia":
        return _LEAST_INERTIA * model.inertia, math.inf
    if not key:
        return 0.0, math.inf
    effect = next(effect for effect in model.effects if effect.key == key)
    own = next(p for p in effect.parameters if p.name == parameter)
    if own.scale == "one":
        return own.low, own.high
    least = 0.0 if own.low >= 0.0 else -math.inf
    return least, math.inf
