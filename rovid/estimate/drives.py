"""Drives: thrust curves from raw bench readings, the common scale of all curves, and controllers of the rate.

Heading data alone never determine the scale: s times the thrust with s times inertia and drag gives the same motion.
A pull, a lift, or a step of known inertia determines it.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError, LogError
from rovid.core.formatting import plus_minus
from rovid.core.stats import t_quantile
from rovid.effects.actuator_dynamics import delayed, lagged
from rovid.trial.axis import Axis, is_per_second, name_words, word_set
from rovid.trial.config import Config
from rovid.trial.preprocessing import Run
from rovid.trial.tables import CsvTable, suggest_columns
from rovid.trial.vehicle import ThrustCurve

STANDARD_GRAVITY = 9.80665
THRUST_UNITS = {
    "N": 1.0,
    "kN": 1000.0,
    "kgf": STANDARD_GRAVITY,
    "gf": STANDARD_GRAVITY / 1000.0,
    "lbf": 4.4482216152605,
}

# Patterns of column names in order of preference: a sheet with a PWM column has the battery's voltage too.
_COMMAND_NAMES = ("command|cmd", "pwm", "throttle|signal|input", "volt")
_THRUST_NAMES = ("thrust|force",)
# Share of the largest thrust below which a reading counts as zero, as it does below the bench's own noise: for readings
# that are exactly monotone, and for others.
_ZERO_SHARE_EXACT, _ZERO_SHARE_NOISY = 0.001, 0.005
# A gap between commands is wide if it exceeds this many median intervals.
_WIDE_GAP = 2.0
# Readings below which the scatter gives no standard error.
_FEWEST = 3
# Standard errors by which a step of inertia has to differ from zero.
_VISIBLE = 3.0
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


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrustCurveFit:
    """A thrust curve and its residuals."""

    curve: ThrustCurve
    #: ``command``, ``thrust``: (n,) the readings in order of command, thrust in N.
    command: FloatArray
    thrust: FloatArray
    residuals: FloatArray  #: (n,) reading minus curve in N.
    dead_zone: tuple[float, float] | None  #: Commands between which the thrust is zero, or None.
    noise: float  #: Largest contradiction of the readings to a monotone curve near neutral, N.

    @property
    def rms(self) -> float:
        """Root mean square of the residuals in N."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def bench_readings(
    table: CsvTable, *, command: str | None, thrust: str | None, unit: str | None
) -> tuple[FloatArray, FloatArray]:
    """Command and thrust in N from a bench table, from named columns or columns guessed by the header.

    Raises LogError if the columns or the unit are ambiguous, or a cell is not a number.
    """
    command = command or _column(table, _COMMAND_NAMES, "--command")
    thrust = thrust or _column(table, _THRUST_NAMES, "--thrust")
    return table.numbers(command), THRUST_UNITS[unit or _unit(table, thrust)] * table.numbers(thrust)


def _column(table: CsvTable, patterns: tuple[str, ...], option: str) -> str:
    for pattern in patterns:
        matches = [name for name in table.header if re.search(pattern, name, re.IGNORECASE)]
        if len(matches) == 1:
            return matches[0]
    text = f"the column is ambiguous. {suggest_columns('', table.header, table.rows)}"
    raise LogError(text, where=table.path, mend=f"Name the column with {option}.")


def _unit(table: CsvTable, column: str) -> str:
    packed = re.sub(r"[\W_]+", "", column).lower()
    for unit in sorted(THRUST_UNITS, key=len, reverse=True):
        if packed.endswith(unit.lower()) and packed != unit.lower():
            return unit
    text = f"the header of column {column!r} has no known unit of thrust."
    raise LogError(text, where=table.path, mend=f"Give it with --unit, one of {', '.join(THRUST_UNITS)}.")


def fit_thrust_curve(command: FloatArray, thrust: FloatArray) -> ThrustCurveFit:
    """Fit a monotone curve to bench readings in any order, repeats included.

    Isotonic least squares on each side of the dead zone, where the thrust is exactly zero. The curve falls with the
    command where the readings do. Raises DataError if there are fewer than three different commands, or no thrust at
    all.
    """
    order = np.argsort(command, kind="stable")
    command, thrust = command[order], thrust[order]
    levels, inverse, counts = np.unique(command, return_inverse=True, return_counts=True)
    if len(levels) < 3 or not np.any(thrust):
        raise DataError(
            f"{len(levels)} different commands and a largest thrust of {np.max(np.abs(thrust), initial=0.0):g} N: "
            "a curve needs three commands or more and some thrust."
        )
    mean = np.bincount(inverse, weights=thrust) / counts
    direction = 1.0 if np.polyfit(levels, mean, 1)[0] >= 0.0 else -1.0
    rising = direction * mean
    monotone = _isotonic(rising, counts)
    # Largest contradiction to a monotone curve near neutral, N.
    neutral = levels[int(np.argmin(np.abs(monotone)))]
    near = np.abs(levels - neutral) <= 0.3 * (levels[-1] - levels[0])
    noise = float(np.max(np.abs(rising - monotone)[near], initial=0.0))
    share = _ZERO_SHARE_NOISY if noise > 0.0 else _ZERO_SHARE_EXACT
    low, high = _idle(monotone, max(noise, share * float(np.max(np.abs(mean)))))
    values, dead_zone = monotone, None
    if low <= high:
        values[low : high + 1] = 0.0
        values[:low] = _isotonic(np.minimum(rising[:low], 0.0), counts[:low])
        values[high + 1 :] = _isotonic(np.maximum(rising[high + 1 :], 0.0), counts[high + 1 :])
    if low < high:
        ends = [_edge(levels[low::-1], values[low::-1], levels), _edge(levels[high:], values[high:], levels)]
        dead_zone = (ends[0], ends[1])
        more = [end for end in ends if end not in levels]
        levels, values = np.append(levels, more), np.append(values, np.zeros(len(more)))
        order = np.argsort(levels)
        levels, values = levels[order], values[order]
    curve = ThrustCurve(command=levels, thrust=direction * values)
    return ThrustCurveFit(
        curve=curve, command=command, thrust=thrust, residuals=thrust - curve(command), dead_zone=dead_zone, noise=noise
    )


def _edge(outwards: FloatArray, values: FloatArray, levels: FloatArray) -> float:
    """End of the dead zone on one side: its last command, the first of the commands ``outwards``.

    Across a wide gap, the line through the next two readings is extrapolated to zero thrust.
    """
    spacing = float(np.median(np.diff(levels)))
    if len(outwards) < 3 or abs(outwards[1] - outwards[0]) <= _WIDE_GAP * spacing or values[2] == values[1]:
        return float(outwards[0])
    slope = (values[2] - values[1]) / (outwards[2] - outwards[1])
    return float(np.clip(outwards[1] - values[1] / slope, *sorted(outwards[:2])))


def _isotonic(values: FloatArray, counts: np.ndarray[tuple[int], np.dtype[np.intp]]) -> FloatArray:
    if not len(values):
        return values
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(values, weights=counts).x, dtype=np.float64)


def _idle(rising: FloatArray, tolerance: float) -> tuple[int, int]:
    """First and last index of the unbroken series of readings around neutral without thrust; last < first for none."""
    centre = int(np.argmin(np.abs(rising)))
    acting = np.flatnonzero(np.abs(rising) > tolerance)
    if centre in acting:
        return centre, centre - 1
    low, high = acting[acting < centre], acting[acting > centre]
    return int(np.max(low, initial=-1)) + 1, int(np.min(high, initial=len(rising))) - 1


@dataclass(frozen=True, kw_only=True)
class ThrustScale:
    """True thrust over that of the curves."""

    value: float
    scatter: float  #: Standard error relative to ``value``, from the scatter of the readings.
    degrees_of_freedom: float  #: Of ``scatter``.
    reference_error: float  #: Relative standard error of the balance, the weight or the added inertia.
    method: str
    readings: int

    @property
    def standard_error(self) -> float:
        """Standard error of ``value``."""
        return self.value * math.hypot(self.scatter, self.reference_error)

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval: Student's t for the scatter, and a normal factor for the reference."""
        quantile = 0.5 + level / 2.0
        reach = math.hypot(
            t_quantile(quantile, self.degrees_of_freedom) * self.scatter,
            t_quantile(quantile, math.inf) * self.reference_error,
        )
        return self.value * math.exp(-reach), self.value * math.exp(reach)


def scale_from_pulls(curve: FloatArray, measured: FloatArray, reference_error: float) -> ThrustScale:
    """Ratio of (n,) ``measured`` forces to those of the ``curve``, at independent readings.

    Raises DataError if there are too few readings, or no thrust.
    """
    return _proportion(curve, measured, reference_error, "ratio of the measured forces to the curve's")


def scale_from_lifts(curve: FloatArray, weight: FloatArray, reference_error: float) -> ThrustScale:
    """Ratio of the known (n,) ``weight`` to the thrust of the ``curve`` that holds it, which scatters.

    Raises DataError if there are too few readings, or no weight.
    """
    found = _proportion(weight, curve, reference_error, "ratio of the known weights to the curve's thrust")
    return replace(found, value=1.0 / found.value)


def scale_from_step(
    before: tuple[float, float], after: tuple[float, float], added: float, reference_error: float
) -> ThrustScale:
    """Known ``added`` inertia over the step of the inertia that was fitted ``before`` and ``after`` (value, error).

    Raises DataError if the fitted inertia did not grow by more than its error.
    """
    step, error = after[0] - before[0], math.hypot(after[1], before[1])
    if not step > _VISIBLE * error:
        text = f"the fitted inertia grew by {step:.4g} ± {error:.2g}, which does not show the added {added:.4g}."
        raise DataError(text, mend="Add more, or record more sines with and without it.")
    return ThrustScale(
        value=added / step,
        scatter=error / step,
        degrees_of_freedom=math.inf,
        reference_error=reference_error,
        method="known added inertia over the step of the fitted inertia",
        readings=2,
    )


def _proportion(x: FloatArray, y: FloatArray, reference_error: float, method: str) -> ThrustScale:
    """Slope of y = slope * x as a scale.

    The ratio of the sums is the weighted regression for a variance that grows with x. The error allows for another
    variance, constant or growing with x^2: HC2 of MacKinnon and White (1985), with the degrees of freedom of Bell and
    McCaffrey (2002).
    """
    y, x = np.sign(x) * y, np.abs(x)
    if (acting := np.count_nonzero(x)) < _FEWEST:
        text = f"there are {acting} readings with a force; at least {_FEWEST} were expected."
        raise DataError(text, mend="Repeat the test.")
    total = float(np.sum(x))
    slope = float(np.sum(y)) / total
    if not slope > 0.0:
        text = "the measured force does not act in the sense of the curves' thrust."
        raise DataError(text, mend="Give pulls as positive forces, and commands that push the same way.")
    share = x / total  # the leverage
    error = math.sqrt(float(np.sum((y - slope * x) ** 2 / (1.0 - share)))) / total
    spread = share**2 / (1.0 - share)
    freedom = 1.0 / float(np.sum(share**2) + np.sum(spread) ** 2 - np.sum(spread**2))
    return ThrustScale(
        value=slope,
        scatter=error / slope,
        degrees_of_freedom=freedom,
        reference_error=reference_error,
        method=method,
        readings=len(x),
    )


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
