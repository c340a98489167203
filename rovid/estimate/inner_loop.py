"""Inner loop: a controller that keeps an ordered rate; its gain and its lag."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus
from rovid.effects.actuator_dynamics import delayed, lagged
from rovid.trial.axis import Axis, is_per_second, name_words, word_set
from rovid.trial.config import Config
from rovid.trial.preprocessing import Run

# Words in the name of an order, and of a rate.
_ORDER_WORDS = word_set(
    """cmd command commanded demand demanded desired des order ordered ref reference set setpoint setvel soll sollwert
    target consigne consigna"""
)
_RATE_WORDS = word_set("""drehrate omega rate rps setvel speed vel velocity yawrate""")
# Limits of the gain and of R^2 for a command with the name of an ordered rate, in rad/s or deg/s: a controller without
# an integrator settles up to a fifth below its order.
_GAINS, _MIN_R2 = (0.8, 1.25), 0.8
# Blocks of samples that are taken as independent for the standard errors.
_BLOCKS = 20
# Longest lag as a share of the longest log, and number of first guesses, each a quarter of the one before.
_LONGEST_LAG, _STARTS = 0.25, 6


@dataclass(frozen=True, kw_only=True)
class InnerLoop:
    """Response of the rate to its order: rate = gain * order, late by ``lag``."""

    name: str  #: Signal or column of the order.
    gain: float
    gain_error: float
    lag: float  #: s, dead time and time constant together.
    lag_error: float
    r2: float  #: Share of the variance of the rate that the late order explains.
    axis: Axis
    wheels: bool = False  #: Whether the order is that of steered wheels.

    @property
    def error(self) -> DataError:
        """The reason why there is no inertia, with gain and lag."""
        rate = self.axis.rate_words
        cause = f"is the order to a controller of the {rate}, not a {self.axis.force_name}"
        if self.wheels:
            cause = f"steers wheels: the angle sets the {rate} at each speed, not a {self.axis.force_name}"
        found = f"The {rate} does not follow it (R2 {self.r2:.2f})."
        if self.r2 > 0.0:
            gain, lag = plus_minus(self.gain, self.gain_error), plus_minus(self.lag, self.lag_error)
            found = f"The {rate} is {gain} times its order (R2 {self.r2:.2f}), with a lag of {lag} s."
        return DataError(
            f"{self.name} {cause}. {found} The drive exerts whatever {self.axis.force_name} the order needs, so these "
            "logs determine no inertia and no drag.",
            mend=f"Map the thrusters' commands, or the {self.axis.force_name} or current of the drive, instead.",
        )


def find_inner_loop(runs: Sequence[Run], config: Config) -> InnerLoop | None:
    """The inner loop behind the only command of ``config``; None if the command acts as a force or torque.

    The order of a rate is declared in rovid.toml. Otherwise its name and its gain reveal it: the rate settles near
    1 rad/s for each rad/s, or for each deg/s, of the command.
    """
    name, axis = ordered_rate(config), config.axis
    if not name:
        return None
    thruster = config.vehicle.thrusters[0]
    if thruster.is_rate_order:
        return _response(runs, name, axis, unit=1.0, wheels=thruster.steering is not None)
    for unit in (1.0, np.pi / 180.0) if axis.angular else (1.0,):
        loop = _response(runs, name, axis, unit=unit)
        low, high = _GAINS
        if low <= loop.gain <= high and loop.r2 >= _MIN_R2:
            return loop
    return None


def ordered_rate(config: Config) -> str:
    """Name of the only command, if it is the order of a rate by rovid.toml or by its name; else empty."""
    if len(config.commands) != 1:
        return ""
    thruster, signal = config.vehicle.thrusters[0], config.commands[0]
    if thruster.is_rate_order:
        return thruster.name
    for source in signal.sources.values():
        words = name_words(source)
        if words & _ORDER_WORDS and (words & _RATE_WORDS or is_per_second(source)):
            return source
    return ""


def _response(runs: Sequence[Run], name: str, axis: Axis, *, unit: float, wheels: bool = False) -> InnerLoop:
    """Gain and lag of the rate after the command, which is in ``unit`` of SI.

    Least squares of rate = gain * order + offset, the order behind a lag of first order and a dead time; everything
    through one filter.
    """
    from scipy.optimize import least_squares  # The import takes long.

    nothing = InnerLoop(name=name, gain=0.0, gain_error=0.0, lag=0.0, lag_error=0.0, r2=0.0, axis=axis, wheels=wheels)
    rate = np.concatenate([run.rates.rate for run in runs])
    known = np.concatenate([run.valid for run in runs])
    if known.sum() < 2 * _BLOCKS or not np.ptp(rate[known]) > 0.0:
        return nothing
    rate = rate[known]

    def columns(times: FloatArray) -> FloatArray:
        """(m, 2) the order in SI behind a lag and a dead time in s, through the filter of the rates, and ones."""
        lag, dead_time = times.tolist()
        late = []
        for run in runs:
            time, order = run.trial.time, run.trial.commands[:, 0] * unit
            late.append(run.rates.filter_held(run.trial, delayed(time, lagged(time, order, lag), dead_time)))
        return np.column_stack((np.concatenate(late)[known], np.ones(len(rate))))

    def fitted(times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gain and offset, and the (m,) residuals."""
        rows = columns(times)
        values = np.linalg.lstsq(rows, rate, rcond=None)[0]
        return values, rate - rows @ values

    def left(times: FloatArray) -> FloatArray:
        return fitted(times)[1]

    longest = max(run.trial.duration for run in runs) * _LONGEST_LAG
    starts = [np.array([longest / 4.0**power, 0.0]) for power in range(1, _STARTS + 1)]
    start = min(starts, key=lambda times: float(np.sum(fitted(times)[1] ** 2)))
    step = longest * 1e-4
    bounds = np.zeros(2), np.full(2, longest)
    found = least_squares(left, start, bounds=bounds, x_scale=float(start.max()), diff_step=[1e-3, 1e-3])
    times = np.asarray(found.x)
    (gain, _), residual = fitted(times)
    rows = columns(times)
    by_time = [(columns(times + step * unit_step)[:, 0] - rows[:, 0]) * gain / step for unit_step in np.eye(2)]
    jacobian = np.column_stack((rows, *by_time))
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    # Sums over blocks are independent, although successive residuals are not.
    scores = np.array([part.sum(axis=0) for part in np.array_split(jacobian * residual[:, None], _BLOCKS)])
    covariance = inverse @ (scores.T @ scores) @ inverse
    return replace(
        nothing,
        gain=float(gain),
        gain_error=float(np.sqrt(covariance[0, 0])),
        lag=float(times.sum()),
        lag_error=float(np.sqrt(covariance[2:, 2:].sum())),
        r2=max(1.0 - float(np.var(residual) / np.var(rate)), 0.0),
    )
