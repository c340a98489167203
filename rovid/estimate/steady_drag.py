"""Quadratic and linear drag from steady turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus, round_to_error, significant
from rovid.core.stats import f_sf
from rovid.core.toml import SMALLEST
from rovid.estimate.drag_wls import TorqueBalance, WlsSolution, with_pooled_errors
from rovid.estimate.estimate import Estimate, r_squared
from rovid.estimate.steady_points import SteadyPoint
from rovid.model.parameter_names import base_names
from rovid.signals.segments import MIN_HOLD_SECONDS
from rovid.trial.axis import YAW, Axis

NAMES = ("quadratic_drag", "linear_drag")
# A hold at a smaller share of the largest torque is one at rest, and its rate is that of a drift.
_AT_REST = 0.02
# Rates this close together cannot tell a quadratic from a linear drag.
_MIN_RATE_RATIO = 1.25
# The two directions differ where chance alone would part them so far less often than this.
_BY_CHANCE = 0.01
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
        (k,) standard error of each point's torque balance in N m; the fit's weights are its inverse squares. Ones
        where it is not known; see ``torque_error_known``.
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

    @property
    def torque_error_known(self) -> bool:
        """Whether the points say how well their torque is known; rows of a table do not, and weigh alike."""
        return not _from_table(self.points)


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
    balance = _balance(fitted, axis, names, refused)
    solution = balance.solve()
    below = _below_zero(names, solution, balance.free)
    if below:
        # The covariance stays that of the free fit: it would take the zero for certain, and the other drag with it.
        kept = (solution.values >= 0.0) | ~np.isin(names, NAMES)
        solution = solution._replace(values=balance.with_free(kept).solve().values)
    if not (solution.values[:2] > 0.0).any():
        raise DataError(
            f"the vehicle moves against its {axis.force_name} in these holds, which no drag does.",
            mend=f"Check in rovid.toml the signs of {axis.arm_key}, command and {axis.required_signals}.",
        )
    residuals = balance.residuals(solution.values)
    kind = "weighted" if balance.error_known else "ordinary"
    estimate = _estimate(f"{_states(axis)}, {kind} least squares", names, solution, axis, len(fitted))
    estimate = replace(estimate, refused=refused)
    # With a buoyancy to be found besides, each direction alone has too little to say.
    alone = len(names) == len(NAMES)
    directions = _directions(fitted, balance, axis) if alone else {}
    warnings = (
        *_left_at_rest(steady, len(fitted), axis),
        *below,
        *_warnings(estimate),
        *_direction_warnings(balance, residuals, directions, axis),
    )
    return DragFit(
        estimate=replace(estimate, warnings=warnings),
        points=fitted,
        unsteady=tuple(point for point in points if not point.steady),
        torque_error=balance.error,
        residuals=residuals,
        left_out=balance.leave_one_out(),
        directions=directions,
        r_squared=r_squared(balance.torque, residuals),
    )


def _balance(points: Sequence[SteadyPoint], axis: Axis, names: Sequence[str], refused: dict[str, str]) -> TorqueBalance:
    """Of ``points``, with what is not ``refused`` free."""
    free = np.array([name not in refused for name in names])
    balance = TorqueBalance.of(points, axis, free)
    if not balance.is_determined:
        raise _outweighed(points, [name for name in names if name not in refused], axis)
    return balance if _from_table(points) else with_pooled_errors(balance, points)


def _estimate(method: str, names: tuple[str, ...], solution: WlsSolution, axis: Axis, samples: int) -> Estimate:
    return Estimate(
        names=names,
        values=solution.values,
        covariance=solution.covariance,
        degrees_of_freedom=solution.degrees_of_freedom,
        method=method,
        samples=samples,
        axis=axis,
    )


def _under_load(steady: Sequence[SteadyPoint]) -> tuple[SteadyPoint, ...]:
    """Those that show drag: not logs of a vehicle nearly at rest, which turns as the water does."""
    least = 0.0
    if not _from_table(steady):
        least = _AT_REST * max(abs(point.torque) for point in steady)
    return tuple(point for point in steady if abs(point.torque) >= least)


def _below_zero(names: Sequence[str], solution: WlsSolution, free: BoolArray) -> list[str]:
    """What is said of a drag that came out negative; nothing where neither of two free ones did, or one is held."""
    values, errors = solution.values, np.sqrt(np.diag(solution.covariance))
    negative = free & (values < 0.0) & np.isin(names, NAMES)
    if not negative.any() or not free.all():
        return []
    at = int(np.argmax(negative))
    text = (
        f"{names[at]} came out negative ({plus_minus(values[at], errors[at])}), which no drag is; it is held at zero."
    )
    return [text]


def _states(axis: Axis) -> str:
    return "steady turns" if axis.angular else "steady states"


def _from_table(points: Sequence[SteadyPoint]) -> bool:
    """Whether the rates come from a table, which knows no error of theirs."""
    return all(math.isnan(point.rate_error) for point in points)


def _no_steady(points: Sequence[SteadyPoint], axis: Axis) -> DataError:
    if not points:
        return DataError(
            f"no held command of at least {MIN_HOLD_SECONDS:g} s under which the vehicle {axis.motion_verb}; drag cannot be "
            "read from these logs.",
            mend=_ADVICE.format(axis.motion_verb),
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
        f"{left} of {len(steady)} holds have less than {100.0 * _AT_REST:.0f} % of the largest {axis.force_name}: what moves "
        "the vehicle there is a current or a tether, and they are left out."
    )
    return [text]


def _outweighed(points: Sequence[SteadyPoint], names: Sequence[str], axis: Axis) -> DataError:
    fastest = max(points, key=lambda point: abs(point.rate))
    return DataError(
        f"{len(points)} {_states(axis)} cannot tell {' from '.join(names)}: they are at too few rates, or that in "
        f"{fastest.source}, {fastest.rate:.3g} {axis.unit('rad/s')}, makes all others nothing.",
        mend="Give more of them at other rates; correct or delete one that cannot be.",
    )


def _undetermined(points: Sequence[SteadyPoint], axis: Axis) -> dict[str, str]:
    """Parameters that these ``points`` do not determine, and why."""
    speeds = np.abs([point.rate for point in points])
    slowest, fastest = speeds.min(), speeds.max()
    why = ""
    if fastest < _MIN_RATE_RATIO * slowest:
        why = (
            f"all {_states(axis)} are at nearly the same rate ({slowest:.3g} to {fastest:.3g} {axis.unit('rad/s')}), "
            "so quadratic and linear drag cannot be told apart; it is taken as zero, and the quadratic drag and its "
            "error hold at that rate alone. Run holds at other commands."
        )
    elif _from_table(points) and len(points) < len(NAMES) + 1:
        why = f"{len(points)} rows leave nothing to judge the error by; it is taken as zero. Give three rows or more."
    return {"linear_drag": why} if why else {}


def _directions(points: Sequence[SteadyPoint], balance: TorqueBalance, axis: Axis) -> dict[str, Estimate]:
    """The fit of each direction alone, where the points that way determine one."""
    fits = {}
    for name, rows in _ways(balance):
        part, chosen = balance.subset(rows), list(compress(points, rows))
        if part.degrees_of_freedom <= 0 or rows.all() or _undetermined(chosen, axis) or not part.is_determined:
            continue
        method = f"{_states(axis)}, {axis.position_words} {name} only"
        fits[name] = _estimate(method, NAMES, part.solve(), axis, len(chosen))
    return fits


def _ways(balance: TorqueBalance) -> list[tuple[str, BoolArray]]:
    """Each direction, and which points are that way."""
    rates = balance.design[:, 1]
    return [("up", rates > 0), ("down", rates < 0)]


def _direction_warnings(
    balance: TorqueBalance, residuals: FloatArray, directions: dict[str, Estimate], axis: Axis
) -> list[str]:
    """What is said where there is one direction alone, or where the two differ."""
    ways = _ways(balance)
    if any(rows.all() for _, rows in ways):
        text = (
            f"All {_states(axis)} are in one direction: a constant {axis.force_name} (tether, trim) or a weaker reverse "
            "thrust would pass for drag. Run the same holds the other way."
        )
        return [text]
    if len(directions) < len(ways):
        return []
    p_value = _p_of_one_line(balance, residuals, directions)
    if not p_value <= _BY_CHANCE:
        return []
    up, down = (directions[name].value("quadratic_drag") for name, _ in ways)
    return [_said_to_differ(up, down, p_value, axis)]


def _said_to_differ(up: float, down: float, p_value: float, axis: Axis) -> str:
    return (
        f"The two directions differ (p = {p_value:.1g}): quadratic drag {significant(up, 4)} with the "
        f"{axis.position_words} growing, {significant(down, 4)} with it falling. Thrust curve, a constant {axis.force_name} "
        "or the drag itself is not the same both ways."
    )


def _p_of_one_line(balance: TorqueBalance, residuals: FloatArray, directions: dict[str, Estimate]) -> float:
    """Probability of lines for each direction that fit so much better than one for both by chance alone (F test).

    One where nothing is left to judge by.
    """
    apart = sum(balance.subset(rows).chi2(directions[name].values) for name, rows in _ways(balance))
    together = float(np.sum((residuals / balance.error) ** 2))
    more = len(NAMES)
    spare = len(balance.torque) - 2 * len(NAMES)
    if spare <= 0 or apart <= 0.0:
        return 1.0
    ratio = (together - apart) / more / (apart / spare)
    return f_sf(more, spare, ratio)


def _warnings(estimate: Estimate) -> list[str]:
    """What is said of a parameter that is not determined, or that may as well be zero."""
    texts = [f"{name} is not determined: {reason}" for name, reason in estimate.refused.items()]
    for name in NAMES:
        value = estimate.value(name)
        if name in estimate.refused or value == 0.0 or estimate.differs_from_zero(name):
            continue
        error, (low, high) = estimate.standard_error(name), estimate.interval(name)
        texts.append(
            f"{name} cannot be told from zero: {plus_minus(value, error)} {estimate.unit(name)}, 95 % interval "
            f"{round_to_error(low, error)} to {round_to_error(high, error)}. Slower holds would tell."
        )
    return texts
