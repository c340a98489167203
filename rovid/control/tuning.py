"""PD gains from damping ratio and bandwidth, stability margins of the open loop, and models from the covariance."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from rovid.control.control_law import effect_torque
from rovid.core.array_types import ComplexArray, FloatArray
from rovid.core.errors import DataError
from rovid.effects.base import TERM_STATES
from rovid.model.model import Model
from rovid.store.parameter_file import Parameters

# Number of frequencies of the open loop, and the largest lowest one in rad/s.
_FREQUENCIES, _LOWEST = 1200, 3e-4
# Multiples of the sampling frequency for aliasing in the sampled plant, whose response falls with the cube.
_ALIASES = np.arange(-15, 16)
# rad, phase from -180 degrees that counts as -180 degrees at the Nyquist frequency.
_ROUNDING = 1e-3
# rad and rad/s, step of central differences.
_DIFFERENCE = 1e-4
# Amplitudes of the rate for the describing function, and angles in a quarter of a period.
_AMPLITUDES, _ANGLES = 12, 6
# Smallest gain, for its logarithm.
_MIN_GAIN = 1e-30
# Sufficient margins: deg, and largest sensitivity.
PHASE_MARGIN, SENSITIVITY_PEAK = 45.0, 1.6
# rad/s, bandwidths to try.
BANDWIDTHS = np.geomspace(0.01, 20.0, 120)
# Lower bound of a drawn inertia, or of a positive time or rate, relative to the estimate.
_LEAST_SHARE = 0.2


def pd_gains(inertia: float, damping: float, bandwidth: float) -> tuple[float, float]:
    """Gains kp in N m/rad and kd in N m s/rad for a ``damping`` ratio and ``bandwidth`` (natural frequency) in rad/s.

    They are those of ``I*rdot + kd*r + kp*psi = 0``, where the aid cancels the drag: Ramesh et al. 2013, eq. 13, with
    the yaw inertia in kg m^2 in place of the mass.
    """
    return inertia * bandwidth**2, 2.0 * damping * bandwidth * inertia


def damping_ratio(kp: float, kd: float, inertia: float) -> float:
    """``kd / (2*sqrt(inertia*kp))``."""
    return kd / (2.0 * math.sqrt(inertia * kp))


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Stability margins, the smallest over all crossings."""

    #: By the Nyquist criterion. In an unstable loop the gain has to fall by -gain_db, and the phase margin is negative.
    stable: bool
    #: ``gain_db``, ``gain_down_db``: largest increase and decrease of the gain; infinite if unlimited.
    gain_db: float
    gain_down_db: float
    #: ``phase_deg``, ``delay_s``: naN if the gain never crosses one.
    phase_deg: float
    delay_s: float
    lag_s: float  #: s, largest time constant of an additional first-order lag.
    crossover: float  #: rad/s, highest frequency with a gain of one.
    sensitivity_peak: float  #: Maximum of |1/(1 + L)|.


class FeedbackLaw(Protocol):
    """A sampled controller of heading: period and lag in s, and its response."""

    @property
    def period(self) -> float: ...  # noqa: D102
    @property
    def lag(self) -> float: ...  # noqa: D102

    def feedback(self, frequency: FloatArray) -> tuple[ComplexArray, ComplexArray | float]:
        """(f,) negative wanted torque per heading, and per yaw rate, at (f,) ``frequency`` in rad/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenLoop:
    """The loop about rest, opened at the torque."""

    law: FeedbackLaw
    #: (n, n) and (n,): state and input matrix of the linearised motion, with heading and rate as the first two states
    #: and torque as the input.
    motion: tuple[FloatArray, FloatArray]
    #: Frequencies in rad/s and the (f,) response from wanted to acting torque.
    actuators: tuple[FloatArray, ComplexArray]
    delay: float = 0.0  #: s, from a heading to the command that it leads to.

    def transfer(self, frequency: FloatArray) -> ComplexArray:
        """(f,) L at (f,) frequencies in rad/s below the Nyquist frequency, exact for the sampled loop."""
        period = self.law.period
        matrix, by_torque = self.motion
        aliases = 2.0 * math.pi / period * _ALIASES
        s = 1j * (frequency[:, None] + aliases)
        # c adj(sI - A) b = det(sI - A + b c) - det(sI - A), with c the heading; b of the size of one.
        own, scale = np.poly(matrix), float(np.max(np.abs(by_torque)))
        closed = matrix.copy()
        closed[:, 0] -= by_torque / scale
        added = np.poly(closed) - own
        heading = scale * np.polyval(added, s) / np.polyval(own, s)
        # Zero-order hold, which is equal for all aliases; delay; sampling.
        held = -np.expm1(-1j * frequency * period) / period
        late = np.exp(-1j * aliases * self.delay)
        by_heading, by_rate = self.law.feedback(frequency)
        # Sums in place of products of matrices, whose threads take ten times as long here.
        sampled = by_heading * np.sum(heading / s * late, axis=1) + by_rate * np.sum(heading * late, axis=1)
        return np.asarray(np.exp(-1j * frequency * self.delay) * sampled * self.actuation(frequency) * held)

    def actuation(self, frequency: FloatArray) -> ComplexArray:
        """(f,) response of the actuators, with gain and delay interpolated."""
        known, response = self.actuators
        lags = np.empty(len(known))
        lag = 0.0
        for at, (w, value) in enumerate(zip(known, response, strict=True)):
            # From one frequency to the next, the phase may change by more than half a turn, but the delay by little.
            lag -= float(np.angle(value * np.exp(1j * w * lag))) / w
            lags[at] = lag
        gain = np.interp(frequency, known, np.abs(response))
        delay = np.interp(frequency, known, lags)
        return np.asarray(gain * np.exp(-1j * frequency * delay))

    def total_lag(self, frequency: float) -> float:
        """Total delay in s at ``frequency`` in rad/s."""
        response = complex(self.actuation(np.array([frequency]))[0])
        return self.delay + self.law.lag - float(np.angle(response)) / frequency

    def margins(self) -> Margins:
        """Margins from the response over five decades or more up to the Nyquist frequency."""
        highest = math.pi / self.law.period
        frequency = np.geomspace(min(1e-5 * highest, _LOWEST), highest * (1.0 - 1e-9), _FREQUENCIES)
        response = self.transfer(frequency)
        x, size = np.log(frequency), np.log(np.maximum(np.abs(response), _MIN_GAIN))
        # Phase above -180 degrees. At low frequency, as of a constant, 1/s or 1/s^2, it is between 0 and 180 degrees.
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
        # A lag of t in s is at its margin where L/(1 + jwt) = -1: Re L is -1, and Im L is -w*t.
        real = np.array([place for place, _ in _crossings(x, response.real + 1.0)])
        lags = -np.interp(real, x, response.imag) / np.exp(real)
        return Margins(
            stable=stable,
            gain_db=_decibel(up),
            gain_down_db=_decibel(down),
            phase_deg=math.degrees(min(phases, default=math.nan)),
            delay_s=min(delays, default=math.nan),
            lag_s=float(np.min(lags[lags > 0.0], initial=math.inf)) if stable else 0.0,
            crossover=max(crossovers, default=math.nan),
            sensitivity_peak=float(np.max(np.abs(1.0 / (1.0 + response)))),
        )


def _gain_margins(x: FloatArray, size: FloatArray, above: FloatArray) -> tuple[bool, float, float]:
    """Whether the loop is stable, and the largest increase and decrease of its gain as natural logarithms.

    By the Nyquist criterion, the phase of a stable loop passes -180 degrees with a gain above one as often downwards as
    upwards, and once more upwards if it begins below, as with three integrators.
    """
    rest, beyond, balance = [], [], int(above[0] < 0.0)
    for at, falling in _crossings(x, above):
        gain = float(np.interp(at, x, size))
        if gain > 0.0:
            beyond.append(gain)
            balance += 1 if falling else -1
        elif gain <= 0.0:
            rest.append(-gain)
    # At the Nyquist frequency the response is real.
    if size[-1] <= 0.0 and abs(math.remainder(above[-1], 2.0 * math.pi)) < _ROUNDING:
        rest.append(-float(size[-1]))
    down = min(beyond, default=math.inf)
    if balance != 0:
        return False, -max(beyond, default=math.inf), down
    return True, min(rest, default=math.inf), down


def _crossings(x: FloatArray, y: FloatArray) -> list[tuple[float, bool]]:
    """Zero crossings of (n,) ``y``, and whether ``y`` falls there."""
    at = np.flatnonzero((y[:-1] > 0.0) != (y[1:] > 0.0))
    between = x[at] + (x[at + 1] - x[at]) * y[at] / (y[at] - y[at + 1])
    return list(zip(between.tolist(), (y[at] > 0.0).tolist(), strict=True))


def _decibel(logarithm: float) -> float:
    """The natural ``logarithm`` of a gain in dB."""
    return 20.0 * logarithm / math.log(10.0)


def linearise(model: Model, fastest: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """(n, n) state and (n,) input matrix about rest at heading zero, for heading, rate, and states of the effects.

    Friction damps slow motion most. Effects have the smallest damping over amplitudes of the rate up to ``fastest`` in
    rad/s, by describing functions. Drag has its damping at rest, as the model aid cancels the rest.
    """
    torque = effect_torque(model)
    count = len(model.terms.kinds)
    size = 2 + count * TERM_STATES

    def derivative(state: FloatArray, push: float) -> FloatArray:
        angle, rate, own = state[0], state[1], state[2:].reshape(count, TERM_STATES)
        extra, slopes = 0.0, np.zeros((count, TERM_STATES))
        if torque is not None:
            extra, slopes = torque(rate, angle, push, 0.0, own)
        acceleration = (push + extra - model.linear_drag * rate) / model.inertia
        return np.concatenate(([rate, acceleration], slopes.ravel()))

    matrix = np.empty((size, size))
    for at in range(size):
        step = _DIFFERENCE * np.eye(size)[at]
        matrix[:, at] = (derivative(step, 0.0) - derivative(-step, 0.0)) / (2.0 * _DIFFERENCE)
    if torque is not None and fastest > _DIFFERENCE:
        amplitudes = np.geomspace(_DIFFERENCE, fastest, _AMPLITUDES)
        columns = [_describing_function(derivative, size, amplitude) for amplitude in amplitudes]
        matrix[:, 1] = max(columns, key=lambda column: column[1])
    rest = np.zeros(size)
    by_torque = 0.5 * (derivative(rest, 1.0) - derivative(rest, -1.0))
    moves = np.flatnonzero(np.any(matrix != 0.0, axis=1) | (by_torque != 0.0))
    return matrix[np.ix_(moves, moves)], by_torque[moves]


def _describing_function(
    derivative: Callable[[FloatArray, float], FloatArray], size: int, amplitude: float
) -> FloatArray:
    """(n,) response of the state derivatives to a sine of the rate with ``amplitude`` in rad/s, per amplitude.

    Source: Gelb and Vander Velde 1968, chapter 2.
    """
    sines = np.sin((np.arange(_ANGLES) + 0.5) * 0.5 * math.pi / _ANGLES)
    rates = amplitude * sines[:, None] * np.eye(size)[1]
    differences = np.array([derivative(rate, 0.0) - derivative(-rate, 0.0) for rate in rates])
    return np.asarray(sines @ differences / (_ANGLES * amplitude))


def largest_bandwidth(loop_of: Callable[[float], OpenLoop], limit: float) -> float:
    """Largest bandwidth in rad/s below ``limit`` with sufficient margins.

    They are a phase margin of 45 degrees, a sensitivity peak of 1.6, and a delay margin as long as the total delay.
    """
    for bandwidth in BANDWIDTHS[::-1].tolist():
        if bandwidth <= limit:
            loop = loop_of(bandwidth)
            margins = loop.margins()
            damped = margins.phase_deg >= PHASE_MARGIN and margins.sensitivity_peak <= SENSITIVITY_PEAK
            if damped and margins.stable and margins.delay_s >= loop.total_lag(margins.crossover):
                return float(bandwidth)
    text = f"no bandwidth above {BANDWIDTHS[0]:g} rad/s has sufficient margins: the delay of the loop is too long."
    raise DataError(text, mend="Give --bandwidth, or --kp and --kd, or shorten --period and --delay.")


def sample_models(parameters: Parameters, count: int, seed: int) -> list[Model]:
    """``count`` models from the covariance of the parameters, each parameter within its physical bounds."""
    names = list(parameters.entries)
    centre = np.array([parameters.entries[name].value for name in names])
    # The file has each pair once, in either order.
    pairs = parameters.covariance
    matrix = np.array([[pairs.get((a, b), pairs.get((b, a), 0.0)) for b in names] for a in names])
    errors = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(errors > 0.0, errors, np.maximum(np.abs(centre), 1.0))
    # Square root of the covariance. Rounded numbers in the file may make the matrix slightly indefinite.
    values, vectors = np.linalg.eigh(np.nan_to_num(matrix / np.outer(scale, scale)))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) * scale[:, None]
    normal = np.random.default_rng(seed).standard_normal((count, len(names)))
    bounds = np.array([_bounds(parameters.model(), *pair) for pair in zip(names, centre.tolist(), strict=True)])
    models = []
    for row in np.clip(centre + normal @ root.T, *bounds.T).tolist():
        entries = {}
        for name, value in zip(names, row, strict=True):
            entries[name] = replace(parameters.entries[name], value=value)
        models.append(replace(parameters, entries=entries).model())
    return models


def _bounds(model: Model, name: str, value: float) -> tuple[float, float]:
    """Bounds of a parameter with this ``value``; one in units of the search is only bounded by its sign."""
    key, _, parameter = name.rpartition(".")
    if name == "inertia":
        return _LEAST_SHARE * value, math.inf
    if not key:
        return 0.0, math.inf
    effect = next(effect for effect in model.effects if effect.key == key)
    own = next(p for p in effect.parameters if p.name == parameter)
    if own.scale == "one":
        return own.low, own.high
    low, high = own.bounds()
    return (_LEAST_SHARE * value if low > 0.0 else low), high
