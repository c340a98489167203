"""Thrust of the thrusters: curves from raw bench readings, and the common scale of all curves.

Heading data alone never determine the scale: s times the thrust with s times inertia and drag gives the same motion.
A pull, a lift, or a step of known inertia determines it.
"""

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError, LogError
from rovid.core.stats import NORMAL_95, t_quantile
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
        """Confidence interval by Student's t, whose degrees of freedom grow with the share of the reference.

        Those of Welch and Satterthwaite grow with its square: with three readings, 95 % intervals then hold in 92 %,
        and in 98 % if both errors have a quantile of their own. These hold in 94 to 96 %.
        """
        relative = math.hypot(self.scatter, self.reference_error)
        freedom = self.degrees_of_freedom * (relative / self.scatter) ** 2 if self.scatter else math.inf
        reach = t_quantile(0.5 + level / 2.0, freedom) * relative
        return self.value * math.exp(-reach), self.value * math.exp(reach)

    @property
    def error_for_fits(self) -> float:
        """Standard error of a normal distribution with this 95 % interval: larger with few readings."""
        return self.value * math.log(self.interval()[1] / self.value) / NORMAL_95


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
