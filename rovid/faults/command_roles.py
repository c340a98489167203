"""Logs whose commands are not those of their thrusters: columns exchanged, reversed, copied or absent, a dead thruster.

The model of the other logs, with a gain of each thruster, predicts the torque of a log from its motion. Each hypothesis
on the commands gives another torque by the thrusters, with no free parameter but the instant of a failure. A hypothesis
is accepted if its residual is about as small as those of the other logs, and likelier than the commands as logged and
than another inertia and drag in this log.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, compress

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.faults.common_causes import JointModel, likelihood_gain
from rovid.faults.log_regressors import LogRegressors, solved
from rovid.faults.quick_model import fit_quick_model
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# Logs that are compared: with two, either may be the damaged one.
_MIN_LOGS = 3
# Likelihood (nats) over the commands as logged (1 false alarm in 1000 campaigns), and over a model of this log alone.
_LEVEL, _OVER_FOREIGN = float(np.log(1000.0)), 3.0
# Residual variance over the torque's: least of a damaged log, a fifth of the amplitude.
_MIN_SHARE = 0.04
# Residual variance over the median of the other logs, up to which a hypothesis explains a log: twice the amplitude.
_EXPLAINED = 4.0
# Largest share of the torque's variance that an explanation leaves.
_MOST = 0.25
# Least residual variance over the torque's, and over the largest of the other logs, of a log whose command is missing.
_MISSING, _ALONE = 0.1, 2.0
# Faults after which the stamps of a log are uncertain.
_UNTIMELY = {"repeated_stamps", "arrival_bursts"}
# Passes in which the weights of the logs settle.
_PASSES = 4
# Squared torque of a thruster over that of a log, that determines a gain in one log: a tenth of the amplitude.
_PRIOR = 0.01
# Share of a thruster's work, before or after a failure, that shows that it works there.
_WORKS = 0.05


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """A log whose commands are not those of its thrusters."""

    log: str
    what: str  #: Clause on what is found, without the log's name.
    at: tuple[float, ...] = ()  #: s from the log's start, of a failure within it.
    before: float  #: ``before``, ``after``: shares of the torque's variance that the others' model leaves unexplained.
    after: float | None = None  #: None if no other assignment of the commands explains the log.


@dataclass(frozen=True, kw_only=True, eq=False)
class _Hypothesis:
    what: str
    #: (n,) residual torque in N m.
    residual: FloatArray
    at: tuple[float, ...] = ()


def misassigned(runs: Sequence[Run], vehicle: Vehicle) -> Misfit | None:
    """The log whose commands are least those of its thrusters; None if each log's commands are in order."""
    model = fit_quick_model(runs, vehicle)
    if model is None or len(model.regressors) < _MIN_LOGS or len(vehicle.thrusters) < 2:
        return None
    if any(each.is_angle for each in vehicle.thrusters):
        return None
    logs = model.regressors
    # A log that moves against its torque is no measure for the others.
    agree = np.array([not log.is_opposite for log in logs])
    agree |= not agree.any()
    fits = _predictions(logs, agree)
    shares = np.array([fit.misfit for fit in fits])
    found = list[tuple[float, Misfit]]()
    for at, fit in enumerate(fits):
        others = np.arange(len(logs)) != at
        usual_logs = agree & others if (agree & others).any() else others
        usual = float(np.median(shares[usual_logs]))
        if shares[at] < max(_MIN_SHARE, _EXPLAINED * usual) or not fit.is_possible:
            continue
        joint = JointModel(fit.log, [*compress(logs, usual_logs)])
        if joint.is_usual:
            continue
        hypotheses = [*_hypotheses(fit, vehicle)]
        level = _LEVEL + np.log(len(logs) * len(hypotheses))
        likely = [
            (likelihood_gain(each.residual, fit.logged), each)
            for each in hypotheses
            if fit.share(each.residual) < min(_EXPLAINED * usual, _MOST)
            and likelihood_gain(each.residual, fit.own) > _OVER_FOREIGN
            and likelihood_gain(each.residual, joint.residual) + joint.loss > _OVER_FOREIGN
        ]
        gain, best = max(likely, key=lambda pair: pair[0], default=(0.0, None))
        if best and gain > level:
            what = " or ".join(each.what for own, each in likely if own > gain - _OVER_FOREIGN)
            after = fit.share(best.residual)
            found.append((gain, Misfit(log=fit.log.name, what=what, at=best.at, before=shares[at], after=after)))
        elif fit.share(fit.own) > max(_MISSING, _EXPLAINED * usual, _ALONE * float(np.max(shares[others]))) and (
            what := _missing(fit.log, logs, vehicle)
        ):
            found.append((0.0, Misfit(log=fit.log.name, what=what, before=shares[at])))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _predictions(logs: Sequence[LogRegressors], agree: BoolArray) -> list["_Prediction"]:
    """Each log by the model of the others that ``agree``, in which a log far from the rest counts less."""
    total = np.concatenate([log.torque for log in logs])
    shares = total @ np.concatenate([log.single for log in logs]) / (total @ total)
    slopes, scores = map(np.array, zip(*(_moments(log, shares) for log in logs), strict=True))
    # A log with more thrust than the others counts as much as one of them.
    powers = np.array([log.torque @ log.torque for log in logs])
    powers = np.maximum(powers, np.median(powers))
    usual = float(np.median([np.mean(log.torque**2) for log in logs]))
    slopes, scores = slopes / powers[:, None, None], scores / powers[:, None]
    weights = agree.astype(float)
    for _ in range(_PASSES):
        values = _fitted(weights @ scores, np.tensordot(weights, slopes, 1))
        misfits = np.array([_Prediction(log, shares, values, usual).misfit for log in logs])
        weights = agree / np.maximum(misfits / np.median(misfits[agree]), 1.0)
        weights /= weights.mean()
    others = weights * (1.0 - np.eye(len(logs)))
    others[~others.any(axis=1)] = weights
    every = zip(logs, others @ scores, np.tensordot(others, slopes, 1), strict=True)
    return [_Prediction(log, shares, _fitted(score, slope), usual) for log, score, slope in every]


def _moments(log: LogRegressors, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p, p) and (p,) products of instruments with the regressors and with the torque.

    The p parameters are inertia, quadratic and linear drag, and the relative gain of each thruster.
    """
    contrast = log.single - log.torque[:, None] * shares
    gains = -log.centred(contrast)
    x, z = np.column_stack((log.x, gains)), np.column_stack((log.z, gains))
    return z.T @ x, z.T @ log.forcing


def _fitted(score: FloatArray, slope: FloatArray) -> FloatArray:
    # A gain that the logs do not determine is the usual one.
    return solved(slope + _PRIOR * np.diag(np.arange(len(score)) >= 3), score)


def _missing(log: LogRegressors, logs: Sequence[LogRegressors], vehicle: Vehicle) -> str:
    """A clause on a command that is constant, or a copy of another one, in this log alone; empty without one."""
    # Hands may have moved the vehicle between its tests, or its stamps are uncertain.
    if log.is_cut or any(fault.fault in _UNTIMELY for run in log.runs for fault in run.trial.faults):
        return ""
    others = [other for other in logs if other is not log]
    names = [thruster.name for thruster in vehicle.thrusters]
    for at, name in enumerate(names):
        if not np.ptp(log.commands[:, at]) and all(np.ptp(other.commands[:, at]) for other in others):
            return f"the command of {name} is constant, in this log alone"
    for one, two in combinations(range(len(names)), 2):
        alike = [np.array_equal(each.commands[:, one], each.commands[:, two]) for each in (log, *others)]
        if alike[0] and not any(alike[1:]):
            return f"the commands of {names[one]} and {names[two]} are equal, in this log alone"
    return ""


class _Prediction:
    """A log, and its motion and thrusters by the parameters of other logs."""

    def __init__(self, log: LogRegressors, shares: FloatArray, values: FloatArray, usual: float) -> None:
        self.log, self._shares, self._gains = log, shares, values[3:]
        self._least = usual * len(log.torque)
        self.motion = log.x @ values[:3]
        self.logged = self.residual(log.single)
        self.misfit = self.share(self.logged)

    def torque(self, single: FloatArray) -> FloatArray:
        """(n,) torque by the (n, k) torque of each thruster, with the gains of the other logs."""
        total = single.sum(axis=1)
        return np.asarray(total + (single - total[:, None] * self._shares) @ self._gains)

    @property
    def is_possible(self) -> bool:
        """Whether the other logs' gains reverse no thruster: else they do not determine the thrusters of this log."""
        return bool(
            np.all((1.0 + self._gains - self._shares @ self._gains)[np.ptp(self.log.single, axis=0) > 0.0] > 0.0)
        )

    def residual(self, single: FloatArray) -> FloatArray:
        """(n,) residual torque with the (n, k) torque of each thruster."""
        return self.log.centred(self.motion - self.torque(single) - self.log.ambient)

    @cached_property
    def own(self) -> FloatArray:
        """(n,) residual torque by a model of this log alone: another inertia and drag, or another shape of all thrust.

        Other shapes are those of a delay, a weaker direction and a dead zone. The motion's torque is that of the other
        logs' model in size: a small inertia leaves no smaller share.
        """
        log, torque = self.log, self.motion - self.logged
        found = [self.logged]
        inertia, quadratic, linear = values = solved(log.z.T @ log.x, log.z.T @ torque)
        if inertia > 0.0 and linear + quadratic * log.rms_rate > 0.0:
            own = log.x @ values
            found.append((own - torque) * np.sqrt((self.motion @ self.motion) / (own @ own)))
        shapes = np.column_stack((torque, log.shapes))
        values = solved(shapes.T @ shapes, shapes.T @ self.motion)
        if values[0] > 0.0:
            found.append(self.motion - shapes @ values)
        return min(found, key=lambda each: float(each @ each))

    def share(self, residual: FloatArray) -> float:
        """Variance of a residual over the largest of that of the motion's torque, the thrusters', and a usual log's.

        In a log with a constant torque a disturbance is no larger than in the others.
        """
        torque = max(float(self.motion @ self.motion), float(self.log.torque @ self.log.torque), self._least)
        return float(residual @ residual) / torque


def _hypotheses(fit: _Prediction, vehicle: Vehicle) -> Iterator[_Hypothesis]:
    log = fit.log
    names = [thruster.name for thruster in vehicle.thrusters]
    used = [at for at in range(len(names)) if np.ptp(log.single[:, at]) > 0.0]
    for at in used:
        yield from _silences(fit, at, names[at])
        reversed_ = log.single * np.where(np.arange(len(names)) == at, -1.0, 1.0)
        yield _Hypothesis(what=f"the commands of {names[at]} have the opposite sign", residual=fit.residual(reversed_))
    yield _Hypothesis(what="the heading or all commands have the opposite sign", residual=fit.residual(-log.single))
    for one, two in combinations(range(len(names)), 2):
        exchanged = log.single.copy()
        for at, other in ((one, two), (two, one)):
            exchanged[:, at] = log.torque_by(vehicle.thrusters[at], other)
        what = f"the commands of {names[one]} and {names[two]} are exchanged"
        yield _Hypothesis(what=what, residual=fit.residual(exchanged))


def _silences(fit: _Prediction, at: int, name: str) -> Iterator[_Hypothesis]:
    """The thruster pushes nothing in the log, or from an instant on."""
    log = fit.log
    # Torque that the residual gains where the thruster does not push.
    push = fit.torque(log.single * (np.arange(log.single.shape[1]) == at))
    whole = fit.logged + log.centred(push)
    yield _Hypothesis(what=f"{name} does not push", residual=whole)
    work = np.cumsum(push**2) / (push @ push)
    inside = np.flatnonzero((work > _WORKS) & (work < 1.0 - _WORKS))
    if not inside.size:
        return
    # Sums from each instant on: what the silence changes in the squared residual, and in the mean that the trim takes.
    changed, mean = (np.cumsum(each[::-1])[::-1] for each in (2.0 * fit.logged * push + push**2, push))
    first = int(inside[np.argmin((changed - mean**2 / len(push))[inside])])
    residual = fit.logged + log.centred(push * (np.arange(len(push)) >= first))
    if likelihood_gain(residual, whole) > _LEVEL + np.log(len(inside)):
        instant = float(log.time[first])
        yield _Hypothesis(what=f"{name} does not push from {instant:.1f} s on", residual=residual, at=(instant,))
