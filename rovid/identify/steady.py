"""Quadratic and linear drag from steady turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from scipy import optimize, special

from rovid.campaign.axis import YAW, Axis
from rovid.effects import restoring_of
from rovid.effects.restoring import columns
from rovid.ground.arrays import BoolArray, FloatArray
from rovid.ground.errors import DataError
from rovid.ground.toml import SMALLEST
from rovid.identify.estimate import Estimate, explained
from rovid.identify.steady_points import SteadyPoint
from rovid.model.names import base_names
from rovid.motion.segments import MIN_HOLD_SECONDS

NAMES = ("quadratic_drag", "linear_drag")
# A hold at a smaller share of the largest torque is one at rest, and its rate is that of a drift.
_AT_REST = 0.02
# Rates this close together cannot tell a quadratic from a linear drag.
_MIN_RATE_RATIO = 1.25
# Nor can unknowns be told apart whose columns, each of length one, differ by no more than this.
_ALIKE = 1e-10
_ADVICE = (
    "Run held commands: at least four levels each way, from the slowest that {} the vehicle to the fastest, "
    "each for five time constants plus a minute (about 2 min for a work-class vehicle, 20 s for a small one), "
    "autopilot off."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class DragFit:
    """Drag from steady states, with everything needed to doubt it.

    Attributes
    ----------
    points
        The k points fitted.
    unsteady
        Holds that were found and left out because the rate had a trend.
    torque_error
        (k,) standard error of each point's torque balance in N m; the fit's weights are its inverse squares.
    residuals
        (k,) measured minus fitted torque in N m.
    left_out
        (k, 3) quadratic and linear drag without that point, and the torque it then is off by, in N m; NaN where the
        others do not determine both.
    directions
        The fit of each direction alone, where it has at least two levels: "up" and "down".
    r_squared
        1 - SSE/SST of torque, unweighted, centred; NaN where the torque does not vary.
    """

    estimate: Estimate
    points: tuple[SteadyPoint, ...]
    unsteady: tuple[SteadyPoint, ...]
    torque_error: FloatArray
    residuals: FloatArray
    left_out: FloatArray
    directions: dict[str, Estimate]
    r_squared: float


def fit_drag(points: Sequence[SteadyPoint], axis: Axis = YAW) -> DragFit:
    """Fit T = DQ |r| r + DL r, in heave with the net buoyancy besides, to steady states by weighted least squares.

    Points from logs are weighted by their length: the disturbance torque averages out as 1/length, and its
    density is pooled over all holds, the scatter between holds included. Rows of a table have equal weight.

    Raises
    ------
    DataError
        No steady turning, or turning against the torque.
    """
    points = [point for point in points if abs(point.rate) > SMALLEST]
    steady = [point for point in points if point.steady]
    fitted = _under_load(steady)
    if not fitted:
        raise _no_steady(points, axis)
    refused = _undetermined(fitted, axis)
    names = (*NAMES, *base_names(axis)[3:])
    design = _design(fitted, axis)
    torque = np.array([point.torque for point in fitted])
    free = np.array([name not in refused for name in names])
    if not _told_apart(design[:, free]):
        raise _outweighed(fitted, [name for name in names if name not in refused], axis)
    error = _torque_error(fitted, design, torque, free)
    values, covariance, dof = _least_squares(design, torque, error, free)
    warnings = _left_at_rest(steady, len(fitted), axis)
    below = _below_zero(names, values, covariance, free)
    if below is not None:
        warnings.append(below)
        # The covariance stays that of the free fit: it would take the zero for certain, and the other drag with it.
        kept = (values >= 0.0) | ~np.isin(names, NAMES)
        values, _, _ = _least_squares(design, torque, error, kept)
    if not (values[:2] > 0.0).any():
        raise DataError(
            f"the vehicle moves against its {axis.push} in these holds, which no drag does.",
            mend=f"Check in rovid.toml the signs of {axis.arm}, command and {axis.measures}.",
        )
    residuals = torque - design @ values
    kind = "ordinary" if _from_table(fitted) else "weighted"
    estimate = Estimate(
        names=names,
        values=values,
        covariance=covariance,
        degrees_of_freedom=dof,
        axis=axis,
        method=f"{_states(axis)}, {kind} least squares",
        samples=len(fitted),
        refused=refused,
    )
    warnings += _warnings(estimate)
    directions = {}
    # With a buoyancy to be found besides, each direction alone has too little to say.
    if design.shape[1] == len(NAMES):
        directions = _directions(fitted, design, torque, error, free, axis)
    one_sided = _direction_warning(fitted, residuals, error, directions, axis)
    if one_sided is not None:
        warnings.append(one_sided)
    return DragFit(
        estimate=replace(estimate, warnings=tuple(warnings)),
        points=fitted,
        unsteady=tuple(point for point in points if not point.steady),
        torque_error=error,
        residuals=residuals,
        left_out=_leave_one_out(design, torque, error, free),
        directions=directions,
        r_squared=explained(torque, residuals),
    )


def _under_load(steady: Sequence[SteadyPoint]) -> tuple[SteadyPoint, ...]:
    """Those that show drag: not logs of a vehicle nearly at rest, which turns as the water does."""
    least = 0.0
    if not _from_table(steady):
        least = _AT_REST * max(abs(point.torque) for point in steady)
    return tuple(point for point in steady if abs(point.torque) >= least)


def _below_zero(names: Sequence[str], values: FloatArray, covariance: FloatArray, free: BoolArray) -> str | None:
    """What is said of a drag that came out negative; None where both are free and neither did, or one is held."""
    negative = free & (values < 0.0) & np.isin(names, NAMES)
    if not negative.any() or not free.all():
        return None
    return (
        f"{names[int(np.argmax(negative))]} came out negative ({values[negative][0]:.3g} ± "
        f"{np.sqrt(np.diag(covariance))[negative][0]:.2g}), which no drag is; it is held at zero."
    )


def _design(points: Sequence[SteadyPoint], axis: Axis) -> FloatArray:
    """(k, p) what each unknown is multiplied by at each point."""
    # Along an axis that turns the vehicle back there are no steady turns: position does not matter here.
    more = columns(restoring_of(axis), np.zeros(len(points)))
    squares = [point.square_rate for point in points]
    rates = [point.rate for point in points]
    return np.column_stack((squares, rates, more))


def _states(axis: Axis) -> str:
    return "steady turns" if axis.angular else "steady states"


def _from_table(points: Sequence[SteadyPoint]) -> bool:
    return all(math.isnan(point.rate_error) for point in points)


def _no_steady(points: Sequence[SteadyPoint], axis: Axis) -> DataError:
    if not points:
        return DataError(
            f"no held command of at least {MIN_HOLD_SECONDS:g} s under which the vehicle {axis.moves}; drag cannot be "
            "read from these logs.",
            mend=_ADVICE.format(axis.moves),
        )
    worst = max(points, key=lambda point: abs(point.drift))
    return DataError(
        f"{len(points)} held commands were found but the rate was still changing in every one, "
        f"for instance by {worst.drift:.2g} {axis.unit('rad/s')} in {worst.source} from {worst.start:.0f} to "
        f"{worst.stop:.0f} s.",
        mend="Hold each command longer.",
    )


def _left_at_rest(steady: Sequence[SteadyPoint], fitted: int, axis: Axis) -> list[str]:
    """What is said of holds that are not ``fitted`` because next to nothing drives the vehicle there."""
    left = len(steady) - fitted
    if not left:
        return []
    text = (
        f"{left} of {len(steady)} holds have less than {100.0 * _AT_REST:.0f} % of the largest {axis.push}: what moves "
        "the vehicle there is a current or a tether, and they are left out."
    )
    return [text]


def _told_apart(design: FloatArray) -> bool:
    """Whether the (k, p) ``design`` determines every one of its unknowns."""
    values = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    return len(values) == design.shape[1] and bool(values[-1] > _ALIKE * values[0])


def _outweighed(points: Sequence[SteadyPoint], names: Sequence[str], axis: Axis) -> DataError:
    fastest = max(points, key=lambda point: abs(point.rate))
    return DataError(
        f"{len(points)} {_states(axis)} cannot tell {' from '.join(names)}: they are at too few rates, or that in "
        f"{fastest.source}, {fastest.rate:.3g} {axis.unit('rad/s')}, makes all others nothing.",
        mend="Give more of them at other rates; correct or delete one that cannot be.",
    )


def _undetermined(points: Sequence[SteadyPoint], axis: Axis) -> dict[str, str]:
    speeds = np.abs([point.rate for point in points])
    if speeds.max() < _MIN_RATE_RATIO * speeds.min():
        return {
            "linear_drag": f"all {_states(axis)} are at nearly the same rate "
            f"({speeds.min():.3g} to {speeds.max():.3g} {axis.unit('rad/s')}), so quadratic and linear drag cannot be "
            "told apart; it is taken as zero, and the quadratic drag and its error hold at that rate alone. "
            "Run holds at other commands."
        }
    if _from_table(points) and len(points) < 3:
        return {
            "linear_drag": f"{len(points)} rows leave nothing to judge the error by; it is taken as zero. "
            "Give three rows or more."
        }
    return {}


def _torque_error(points: Sequence[SteadyPoint], design: FloatArray, torque: FloatArray, free: BoolArray) -> FloatArray:
    if _from_table(points):
        return np.ones(len(points))
    duration = np.array([point.duration for point in points])
    rate_error = np.array([point.rate_error for point in points])
    values, _, _ = _least_squares(design, torque, 1.0 / np.sqrt(duration), free)
    slope = 2.0 * values[0] * np.abs(design[:, 1]) + values[1]
    density = float(np.mean((slope * rate_error) ** 2 * duration))
    within = density / duration
    return np.asarray(np.sqrt(within + _between(design, torque, within, free)))


def _between(design: FloatArray, torque: FloatArray, within: FloatArray, free: BoolArray) -> float:
    """Variance of the torque balance from hold to hold, N^2 m^2, that the (k,) variances ``within`` holds leave open.

    What a current or a trim does to a hold averages out over no length of it: without this a long rest would outweigh
    all turns. It is as large as the scatter about the line asks for (Paule & Mandel 1982).
    """
    dof = len(torque) - int(free.sum())

    def excess(variance: float) -> float:
        error = np.sqrt(within + variance)
        values, _, _ = _least_squares(design, torque, error, free)
        return float(np.sum(((torque - design @ values) / error) ** 2)) - dof

    if dof < 1 or excess(0.0) <= 0.0:
        return 0.0
    most = float(np.mean(torque**2))
    if not excess(most) < 0.0:
        return most
    return float(optimize.brentq(excess, 0.0, most))


def _least_squares(
    design: FloatArray, torque: FloatArray, error: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray, float]:
    """Values (p,), covariance (p, p) and degrees of freedom; columns that are not ``free`` stay zero.

    Where ``error`` is known it is believed unless the scatter about the line is larger (Birge ratio); where
    it is all ones the scatter sets the scale.
    """
    values, covariance = np.zeros(len(free)), np.zeros((len(free), len(free)))
    weighted = design[:, free] / error[:, None]
    # Columns of one length: the pseudo-inverse's cut-off then has no say in units.
    scale = np.linalg.norm(weighted, axis=0)
    inverse = np.linalg.pinv(weighted / scale) / scale[:, None]
    values[free] = inverse @ (torque / error)
    dof = len(torque) - int(free.sum())
    chi2 = float(np.sum(((torque - design @ values) / error) ** 2))
    variance, freedom = _variance(chi2, dof, known=bool(np.any(error != 1.0)))
    covariance[np.ix_(free, free)] = inverse @ inverse.T * variance
    return values, covariance, freedom


def _variance(chi2: float, dof: int, *, known: bool) -> tuple[float, float]:
    """Of an error that was taken to be one, and its degrees of freedom: those of the scatter where that sets it."""
    if dof <= 0:
        return (1.0 if known else math.nan), math.inf
    scatter = chi2 / dof
    if known and scatter <= 1.0:
        return 1.0, math.inf
    return scatter, float(dof)


def _leave_one_out(design: FloatArray, torque: FloatArray, error: FloatArray, free: BoolArray) -> FloatArray:
    rows = np.full((len(torque), 3), np.nan)
    for k in range(len(torque)):
        keep = np.arange(len(torque)) != k
        if not _told_apart(design[np.ix_(keep, free)]):
            continue
        values, _, _ = _least_squares(design[keep], torque[keep], error[keep], free)
        rows[k] = (*values[:2], torque[k] - design[k] @ values)
    return rows


def _directions(
    points: Sequence[SteadyPoint],
    design: FloatArray,
    torque: FloatArray,
    error: FloatArray,
    free: BoolArray,
    axis: Axis,
) -> dict[str, Estimate]:
    fits = {}
    for name, rows in (("up", design[:, 1] > 0), ("down", design[:, 1] < 0)):
        chosen = list(compress(points, rows))
        if len(chosen) <= free.sum() or rows.all() or _undetermined(chosen, axis):
            continue
        if not _told_apart(design[np.ix_(rows, free)]):
            continue
        values, covariance, dof = _least_squares(design[rows], torque[rows], error[rows], free)
        fits[name] = Estimate(
            names=NAMES,
            values=values,
            covariance=covariance,
            degrees_of_freedom=dof,
            method=f"{_states(axis)}, {axis.position_words} {name} only",
            samples=len(chosen),
            axis=axis,
        )
    return fits


def _direction_warning(
    points: Sequence[SteadyPoint],
    residuals: FloatArray,
    error: FloatArray,
    directions: dict[str, Estimate],
    axis: Axis,
) -> str | None:
    rates = np.array([point.rate for point in points])
    if (rates > 0).all() or (rates < 0).all():
        return (
            f"All {_states(axis)} are in one direction: a constant {axis.push} (tether, trim) or a weaker reverse "
            "thrust would pass for drag. Run the same holds the other way."
        )
    if len(directions) < 2:
        return None
    # F test: does a separate line for each direction fit better than one for both?
    rising = float(np.sum(_normalised(points, directions["up"], error, 1.0) ** 2))
    falling = float(np.sum(_normalised(points, directions["down"], error, -1.0) ** 2))
    apart = rising + falling
    together = float(np.sum((residuals / error) ** 2))
    dof = len(points) - 4
    if dof <= 0 or apart <= 0.0:
        return None
    ratio = (together - apart) / 2.0 / (apart / dof)
    p_value = float(special.fdtrc(2, dof, ratio))
    if p_value > 0.01:
        return None
    up = directions["up"].value("quadratic_drag")
    down = directions["down"].value("quadratic_drag")
    return (
        f"The two directions differ (p = {p_value:.1g}): quadratic drag {up:.4g} with the {axis.position_words} "
        f"growing, {down:.4g} with it falling. Thrust curve, a constant {axis.push} or the drag itself is not the same "
        "both ways."
    )


def _normalised(points: Sequence[SteadyPoint], fit: Estimate, error: FloatArray, sign: float) -> FloatArray:
    rows = np.array([point.rate * sign > 0 for point in points])
    design = np.array([(point.square_rate, point.rate) for point in points])[rows]
    torque = np.array([point.torque for point in points])[rows]
    return np.asarray((torque - design @ fit.values) / error[rows])


def _warnings(estimate: Estimate) -> list[str]:
    texts = [f"{name} is not determined: {reason}" for name, reason in estimate.refused.items()]
    for name in estimate.names[:2]:
        if name in estimate.refused or estimate.value(name) == 0.0 or estimate.differs_from_zero(name):
            continue
        low, high = estimate.interval(name)
        texts.append(
            f"{name} cannot be told from zero: {estimate.value(name):.3g} ± {estimate.standard_error(name):.2g} "
            f"{estimate.unit(name)}, 95 % interval {low:.3g} to {high:.3g}. Slower holds would tell."
        )
    return texts
