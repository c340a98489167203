"""Quadratic and linear drag from steady turns, with errors under a disturbance of unknown memory."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus, round_to_error
from rovid.core.input_files import SMALLEST
from rovid.core.stats import chi2_sf, f_sf
from rovid.estimate.estimate import Estimate, r_squared
from rovid.estimate.steady_points import SteadyPoint, TorqueBalance, WlsSolution, pooled_errors
from rovid.model.parameter_names import base_names
from rovid.trial.axis import YAW, Axis
from rovid.trial.segments import MIN_HOLD

NAMES = ("quadratic_drag", "linear_drag")
# Share of the largest torque below which a hold counts as at rest, and its rate as drift.
_AT_REST = 0.02
# Least ratio of the fastest to the slowest rate that distinguishes quadratic from linear drag.
_MIN_RATE_RATIO = 1.25
# Least number of holds beyond the unknowns. With one, the scatter between holds has one degree of freedom, and three
# standard errors would have to be 64 times the scatter.
_MIN_FREEDOM = 2
# Largest p-value of the F test at which the two directions are reported as different.
_DIFFERENT_P = 0.01
# Memories of a disturbance in usual lengths of a hold, from none to one that outlasts a series of holds; convention.
_MEMORIES = (0.02, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
# Variance of a torque that each hold has for itself, over that of the disturbance in a part of a hold: none, a quarter
# and three quarters of both; convention.
_OWN = (0.0, 1.0 / 3.0, 3.0)
# Variance of the noise of a part, over that of the disturbance in it; convention. It keeps parts of equal times apart.
_NOISE = 1e-4
# Probabilities of an error beyond two and three standard errors: that of the normal distribution; convention.
_BEYOND = {2.0: 0.0455, 3.0: 0.01}
_ADVICE = (
    "Run held commands: at least four levels each way, from the slowest that {} the vehicle to the fastest, "
    "each for five time constants plus a minute (about 2 min for a work-class vehicle, 20 s for a small one), "
    "autopilot off."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class DragFit:
    """Drag from steady states, with diagnostics."""

    estimate: Estimate
    points: tuple[SteadyPoint, ...]  #: The k points fitted.
    unsteady: tuple[SteadyPoint, ...]  #: Holds that were left out because the rate had a trend.
    #: (k,) standard error of each point's torque balance in N m; the weights are its inverse squares. Ones where
    #: unknown; see ``torque_error_known``.
    torque_error: FloatArray
    residuals: FloatArray  #: (k,) measured minus fitted torque in N m.
    #: (k, 3) quadratic and linear drag without that point, and the residual of its torque, in N m; NaN where the others
    #: do not determine both.
    left_out: FloatArray
    #: The fit of each direction alone, where it has at least two levels: "up" and "down".
    directions: dict[str, Estimate]
    r_squared: float  #: 1 - SSE/SST of torque, unweighted, centred; NaN where the torque does not vary.

    @property
    def torque_error_known(self) -> bool:
        """Whether the points have known errors; rows of a table have not, and weigh alike."""
        return not _from_table(self.points)


def fit_drag(points: Sequence[SteadyPoint], axis: Axis = YAW) -> DragFit:
    """Fit T = DQ |r| r + DL r, in heave plus the net buoyancy, to steady states by weighted least squares.

    Points from logs are weighted by their length: the disturbance torque averages out as 1/length, and its density is
    pooled over all holds, the scatter between holds included. Rows of a table have equal weight. Raises DataError if
    there is no steady turn, or the vehicle turns against the torque.
    """
    points = [point for point in points if abs(point.rate) > SMALLEST]
    steady = [point for point in points if point.steady]
    table = _from_table(steady)
    # A vehicle nearly at rest drifts with the water.
    least = 0.0 if table else _AT_REST * max(abs(point.torque) for point in steady)
    fitted = tuple(point for point in steady if abs(point.torque) >= least)
    if not fitted:
        raise _no_steady(points, axis)
    refused = _undetermined(fitted, axis)
    names = (*NAMES, *base_names(axis)[3:])
    balance = TorqueBalance.of(fitted, axis, np.array([name not in refused for name in names]))
    if not balance.is_determined:
        raise _not_distinguishable(fitted, [name for name in names if name not in refused], axis)
    if not table:
        if balance.degrees_of_freedom < _MIN_FREEDOM:
            raise _too_few(fitted, balance, axis)
        balance = pooled_errors(balance, fitted)
    solution = _solve(balance, fitted, table=table)
    negative = balance.free & (solution.values < 0.0) & np.isin(names, NAMES)
    clipped = bool(negative.any() and balance.free.all())
    warnings = list[str]()
    if len(fitted) < len(steady):
        warnings.append(
            f"{len(steady) - len(fitted)} of {len(steady)} holds have less than {100.0 * _AT_REST:.0f} % of the "
            f"largest {axis.force_name} and are left out: there the vehicle moves with a current or by its tether."
        )
    if clipped:
        at = int(np.argmax(negative))
        value = plus_minus(solution.values[at], np.sqrt(solution.covariance[at, at]))
        warnings.append(f"{names[at]} came out negative ({value}), which no drag is; it is held at zero.")
        # The covariance stays that of the free fit, since taking the zero as certain would understate both errors.
        kept = (solution.values >= 0.0) | ~np.isin(names, NAMES)
        solution = solution._replace(values=replace(balance, free=kept).solve().values)
    if not (solution.values[:2] > 0.0).any():
        text = f"the vehicle moves against its {axis.force_name} in these holds, which no drag does."
        mend = f"Check in rovid.toml the signs of {axis.arm_key}, command and {axis.required_signals}."
        raise DataError(text, mend=mend)
    residuals = balance.residuals(solution.values)
    method = f"{_states(axis)}, {'weighted' if balance.error_known else 'ordinary'} least squares"
    estimate = replace(_estimate(method, names, solution, axis, len(fitted)), refused=refused)
    rows = {"up": balance.design[:, 1] > 0, "down": balance.design[:, 1] < 0}
    # With a net buoyancy as a further unknown, one direction alone determines too little.
    directions = _fit_directions(fitted, balance, rows, axis) if len(names) == len(NAMES) else {}
    warnings += _parameter_warnings(estimate)
    warnings += _direction_warnings(fitted, balance, residuals, rows, directions, axis)
    return DragFit(
        estimate=replace(estimate, warnings=tuple(warnings)),
        points=fitted,
        unsteady=tuple(point for point in points if not point.steady),
        torque_error=balance.error,
        residuals=residuals,
        left_out=balance.leave_one_out(),
        directions=directions,
        r_squared=r_squared(balance.torque, residuals),
    )


def _estimate(method: str, names: tuple[str, ...], solution: WlsSolution, axis: Axis, samples: int) -> Estimate:
    return Estimate(method=method, names=names, axis=axis, samples=samples, **solution._asdict())


def _states(axis: Axis) -> str:
    return "steady turns" if axis.angular else "steady states"


def _from_table(points: Sequence[SteadyPoint]) -> bool:
    """Whether the points come from a table, without errors of their rates."""
    return all(math.isnan(point.rate_error) for point in points)


def _no_steady(points: Sequence[SteadyPoint], axis: Axis) -> DataError:
    if not points:
        return DataError(
            f"no held command of at least {MIN_HOLD:g} periods of the cut-off under which the vehicle "
            f"{axis.motion_verb}; drag cannot be determined from these logs.",
            mend=_ADVICE.format(axis.motion_verb),
        )
    worst = max(points, key=lambda point: abs(point.drift))
    return DataError(
        f"{len(points)} held commands were found but the rate was still changing in every one, "
        f"for instance by {worst.drift:.2g} {axis.unit('rad/s')} in {worst.source} from {worst.start:.0f} to "
        f"{worst.stop:.0f} s.",
        mend="Hold each command longer.",
    )


def _not_distinguishable(points: Sequence[SteadyPoint], names: Sequence[str], axis: Axis) -> DataError:
    fastest = max(points, key=lambda point: abs(point.rate))
    return DataError(
        f"{len(points)} {_states(axis)} do not distinguish {' from '.join(names)}: there are too few different rates, "
        f"or the rate in {fastest.source}, {fastest.rate:.3g} {axis.unit('rad/s')}, is so large that all others are "
        "negligible.",
        mend=f"Give more {_states(axis)} at other rates; correct or delete an impossible one.",
    )


def _too_few(points: Sequence[SteadyPoint], balance: TorqueBalance, axis: Axis) -> DataError:
    unknowns, states = int(balance.free.sum()), _states(axis)
    few = f"1 {states.removesuffix('s')} is" if len(points) == 1 else f"{len(points)} {states} are"
    return DataError(
        f"{few} too few for {unknowns} unknown{'s' * (unknowns > 1)}: a disturbance that outlasts a hold shows "
        f"only in the scatter between holds, so the errors would be unknown. At least {unknowns + _MIN_FREEDOM} "
        "steady holds were expected.",
        mend=_ADVICE.format(axis.motion_verb),
    )


def _undetermined(points: Sequence[SteadyPoint], axis: Axis) -> dict[str, str]:
    """Parameters that these ``points`` do not determine, with reasons."""
    speeds = np.abs([point.rate for point in points])
    slowest, fastest = speeds.min(), speeds.max()
    if fastest < _MIN_RATE_RATIO * slowest:
        return {
            "linear_drag": f"all {_states(axis)} are at nearly the same rate ({slowest:.3g} to {fastest:.3g} "
            f"{axis.unit('rad/s')}), which does not distinguish quadratic from linear drag. The linear drag is taken "
            "as zero; the quadratic drag and its error hold at that rate only. Run holds at other commands."
        }
    if _from_table(points) and len(points) <= len(NAMES):
        return {
            "linear_drag": f"{len(points)} rows leave no residual to estimate the error from; the linear drag is taken "
            "as zero. Give three rows or more."
        }
    return {}


def _parameter_warnings(estimate: Estimate) -> Iterator[str]:
    """Warnings of parameters that are undetermined or not significantly different from zero."""
    for name, reason in estimate.refused.items():
        yield f"{name} is not determined: {reason}"
    for name in NAMES:
        value = estimate.value(name)
        if name in estimate.refused or value == 0.0 or estimate.differs_from_zero(name):
            continue
        error, (low, high) = estimate.standard_error(name), estimate.interval(name)
        other = "slower" if name == "linear_drag" else "faster"
        yield (
            f"{name} is not significantly different from zero: {plus_minus(value, error)} {estimate.unit(name)}, 95 % "
            f"interval {round_to_error(low, error)} to {round_to_error(high, error)}. Steady states alone need {other} "
            "holds; the fit of whole logs may need another run (`rovid plan`)."
        )


def _fit_directions(
    points: Sequence[SteadyPoint], balance: TorqueBalance, directions: dict[str, BoolArray], axis: Axis
) -> dict[str, Estimate]:
    """The fit of each direction alone, where its points determine one, with errors as those of all points."""
    table = _from_table(points)
    fits, least = {}, 1 if table else _MIN_FREEDOM
    for name, rows in directions.items():
        part, chosen = balance.subset(rows), list(compress(points, rows))
        if part.degrees_of_freedom < least or rows.all() or _undetermined(chosen, axis) or not part.is_determined:
            continue
        method, solution = f"{_states(axis)}, {axis.position_words} {name} only", _solve(part, chosen, table=table)
        fits[name] = _estimate(method, NAMES, solution, axis, len(chosen))
    return fits


def _solve(balance: TorqueBalance, points: Sequence[SteadyPoint], *, table: bool) -> WlsSolution:
    """The solution of the balance; points of logs have errors that allow for a lasting disturbance."""
    solution = balance.solve()
    if table:
        return solution
    return solution._replace(covariance=lasting_covariance(balance, points), degrees_of_freedom=math.inf)


def _direction_warnings(
    points: Sequence[SteadyPoint],
    balance: TorqueBalance,
    residuals: FloatArray,
    directions: dict[str, BoolArray],
    fits: dict[str, Estimate],
    axis: Axis,
) -> Iterator[str]:
    """Warnings of runs in one direction only, and of a difference between the two directions.

    The difference is tested by its covariance, which allows for lasting disturbances, or for a table by an F test.
    """
    if any(rows.all() for rows in directions.values()):
        yield (
            f"All {_states(axis)} are in one direction: a constant {axis.force_name} (tether, trim) or a weaker "
            "reverse thrust would pass for drag. Run the same holds the other way."
        )
        return
    spare = len(balance.torque) - 2 * len(NAMES)
    if len(fits) < len(directions) or spare <= 0:
        return
    if balance.error_known:
        # The drag of both directions, and half of the difference between them.
        signed = np.sign(balance.design[:, 1:2]) * balance.design
        both = replace(balance, design=np.hstack((balance.design, signed)), free=np.ones(2 * len(NAMES), dtype=bool))
        difference, covariance = both.solve().values[2:], lasting_covariance(both, points)[2:, 2:]
        p_value = chi2_sf(len(NAMES), float(difference @ np.linalg.solve(covariance, difference)))
    else:
        separate = sum(balance.subset(rows).chi2(fits[name].values) for name, rows in directions.items())
        if separate <= 0.0:
            return
        together = float(np.sum((residuals / balance.error) ** 2))
        p_value = f_sf(len(NAMES), spare, (together - separate) / len(NAMES) / (separate / spare))
    if p_value <= _DIFFERENT_P:
        up, down = (plus_minus(one.value(NAMES[0]), one.standard_error(NAMES[0])) for one in fits.values())
        yield (
            f"The two directions differ (p = {p_value:.1g}): quadratic drag {up} with the "
            f"{axis.position_words} growing, {down} with it falling. Thrust curve, a constant "
            f"{axis.force_name} or the drag itself is not the same both ways."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Parts:
    """The n parts of the holds of one log."""

    hold: IntArray  #: (n,) number of the hold among all.
    start: FloatArray  #: (n,) s.
    length: FloatArray  #: (n,) s.
    torque: FloatArray  #: (n,) N m, less what the rate of the part differs from that of the hold.
    share: FloatArray  #: (n,) of the part in its hold.

    def shapes(self, memory: float, scale: float) -> FloatArray:
        """(m, n, n) covariances of the torque balances for each of `_OWN`, over the disturbance's in a usual part."""
        shared = _mean_covariance(self.start, self.length, memory) / scale
        same_hold = np.equal.outer(self.hold, self.hold)
        own = np.array(_OWN)[:, np.newaxis, np.newaxis]
        return np.asarray(shared + own * same_hold + _NOISE * np.eye(len(self.hold)))


def lasting_covariance(balance: TorqueBalance, points: Sequence[SteadyPoint]) -> FloatArray:
    """(p, p) covariance of `TorqueBalance.solve` under a disturbance of unknown memory; docs/method.md, (7a).

    Each memory and each share in question has a weight by its restricted likelihood of the torque balances of all
    parts of the holds, and a Student distribution of the errors by its size. The weighted sum of these distributions
    gives the errors: two of them are exceeded as rarely as with a normal distribution, and three in one of a hundred.
    """
    solver, logs = balance.solver(), _parts_by_log(balance, points)
    design = balance.design[:, balance.free]
    usual = float(np.mean([point.duration for point in points]))
    freedom = sum(len(one.hold) for one in logs) - len(solver)
    part = np.array([usual / max(len(points[0].parts), 1)])
    likelihoods, covariances = [], []
    for memory in _MEMORIES:
        scale = float(_mean_covariance(np.zeros(1), part, memory * usual)[0, 0])
        rows, covariance = [], np.zeros((len(_OWN), len(solver), len(solver)))
        log_determinant = np.zeros(len(_OWN))
        for one in logs:
            shapes = one.shapes(memory * usual, scale)
            factors = np.linalg.cholesky(shapes)
            spread = solver[:, one.hold] * one.share
            rows.append(np.linalg.solve(factors, np.column_stack((design[one.hold], one.torque))[np.newaxis]))
            covariance += spread @ shapes @ spread.T
            log_determinant += np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        triangles = np.linalg.qr(np.concatenate(rows, axis=1), mode="r")
        diagonals = np.abs(np.diagonal(triangles, axis1=1, axis2=2))
        log_determinant += np.log(diagonals[:, :-1]).sum(axis=1)
        size = diagonals[:, -1].clip(1e-150)
        likelihoods.append(-log_determinant - freedom * np.log(size))
        covariances.append(covariance * size[:, np.newaxis, np.newaxis] ** 2 / freedom)
    likelihood = np.concatenate(likelihoods)
    weights = np.exp(likelihood - likelihood.max())
    mixed = _mixture(weights / weights.sum(), np.concatenate(covariances), freedom)
    covariance = np.zeros((len(balance.free), len(balance.free)))
    covariance[np.ix_(balance.free, balance.free)] = mixed
    return covariance


def _parts_by_log(balance: TorqueBalance, points: Sequence[SteadyPoint]) -> list[_Parts]:
    """The parts of the holds of each log; a hold without parts is one."""
    values, logs = balance.solve().values[:2], []
    for source in dict.fromkeys(point.source for point in points):
        every = []
        for number, point in enumerate(points):
            if point.source != source:
                continue
            means = np.array(point.parts or ((point.square_rate, point.rate),))
            count, each = len(means), point.duration / len(means)
            torque = balance.torque[number] - (means - balance.design[number, :2]) @ values
            start = point.start + each * np.arange(count)
            every.append((np.full(count, number), start, np.full(count, each), torque, np.full(count, 1.0 / count)))
        hold, begin, length, deviating, share = (np.concatenate(column) for column in zip(*every, strict=True))
        logs.append(_Parts(hold=hold, start=begin, length=length, torque=deviating, share=share))
    return logs


def _mean_covariance(start: FloatArray, length: FloatArray, memory: float) -> FloatArray:
    """(n, n) covariance of the means over n intervals of a Gauss-Markov process of unit variance."""

    def integral(first: FloatArray, second: FloatArray) -> FloatArray:
        """Second antiderivative of the correlation, of all differences."""
        gap = np.abs(np.subtract.outer(first, second)) / memory
        return np.asarray(gap + np.expm1(-gap))

    stop = start + length
    total = integral(stop, start) + integral(start, stop) - integral(stop, stop) - integral(start, start)
    return np.asarray(memory**2 * total / np.outer(length, length))


def _mixture(weights: FloatArray, covariances: FloatArray, freedom: int) -> FloatArray:
    """(p, p) covariance of a weighted sum of Student distributions, with errors that hold as by `_BEYOND`."""
    from scipy import optimize, special

    errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    # The widest distributions would decide the correlation of the sum.
    correlation = np.tensordot(weights, covariances / (errors[:, :, np.newaxis] * errors[:, np.newaxis, :]), 1)

    def reach(each: FloatArray, probability: float) -> float:
        def excess(width: float) -> float:
            return 2.0 * float(weights @ special.stdtr(freedom, -width / each)) - probability

        # No Student distribution with two or more degrees of freedom reaches ten times its error.
        return float(optimize.brentq(excess, 0.0, 10.0 * float(each.max())))

    widths = [max(reach(each, beyond) / count for count, beyond in _BEYOND.items()) for each in errors.T]
    return np.asarray(correlation * np.outer(widths, widths))
