"""A log of another vehicle or payload: the model of the other logs does not predict it; or logs in two groups.

Each log deviates from the model of all by a share of its inertia and of its drag (`quick_model`). The deviation is
compared with its own error, with the scatter of the other logs, which ordinary logs in hard water have, and with what
hidden causes do to logs of another amplitude, pace or thruster. A log that belongs with a drive which all logs share
(`common_drive`) is not foreign. Two payloads are found where two levels explain the deviations far better than one
level with scatter, and than a trend with amplitude, rate, pace, shape or time.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import plus_minus
from rovid.faults.base import Detection, Detectors, RunsData, named, without
from rovid.faults.command_roles import misassigned
from rovid.faults.common_causes import (
    JointModel,
    at_rest,
    common_drive,
    dead_thrusters,
    least_unexplained,
    replaces_groups,
    unexplained,
    with_common_torque,
)
from rovid.faults.log_regressors import LogRegressors, solved
from rovid.faults.quick_model import LogMoments, QuickModel, fit_quick_model, log_name
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# Logs that are compared, and that may be of two kinds: fewer have no majority, or too few of each kind.
_MIN_LOGS, _MIN_GROUPED = 3, 4
# False-alarm rate of a campaign whose logs scatter normally.
_LEVEL = 1e-3
# Smallest relative deviation of a foreign log, beyond two standard errors, and of two groups.
_MIN_DEVIATION, _MIN_STEP = 0.2, 0.06
# Logarithm of the share of the usual RMS torque, about its mean, that a log needs: another log says nothing by itself.
_EXCITED = np.log(0.2)
_CERTAIN = 3.0  # Standard errors by which a factor is negative; no vehicle has a negative inertia or drag.
_OPPOSITE = " That is impossible: its heading or its commands have the opposite sign, or its columns changed places."
# A heading in radians that is read as degrees: the motion seems this much smaller. Largest relative error to say so.
_RADIAN, _PRECISE = 180.0 / np.pi, 0.1
_IN_RADIANS = " Its heading seems to be in radians, and that of the others in degrees."
# A motion of another size: factors of the inertia, by which the drag grows or falls at least.
_SIZES = {2.0: "half", 0.5: "twice"}
# Probability of a foreign log where a guessed thrust curve, or a drive of all logs, explains the deviation as well.
_EVEN = 0.5
# The same factor may come from a guessed thrust curve, and the log from the same vehicle.
_GUESSED = "Or the guessed thrust curve is wrong at its thrust. The log was kept: measure the curve, and check again."
# Share of a deviation that a drive leaves at most: a lag as long as the vehicle's time constant makes errors large.
_LESS = 0.5
# A drive that the other logs do not contradict.
_DRIVEN = "Or {} acts in all logs: the others agree with that as well. The log was kept."
_EACH_KIND = "No log was set aside: fit each kind by itself. A diagnosis names causes by the larger kind alone."
# Two kinds of logs in equal numbers; share of the residual that a model of one kind leaves: a tenth of the variance.
_NO_MAJORITY, _OWN = "Or the others are foreign: neither kind is a majority. No log was set aside.", 0.32
# Standard error as a share of the deviation, from which its size is unknown: a third leaves one digit. Decision.
_UNSIZED = 1.0 / 3.0
# Probability of a deviation, or of residuals, with which a log that was foreign does not return. Convention.
_UNUSUAL = 0.05
# Least scatter between logs of the logarithm of the unexplained torque: a few equal logs show a smaller one by chance.
_SCATTER = 0.1
# Deviation of the inertia, or of the drag, that a log which returns excludes by two standard errors. Decision.
_EXCLUDED = 0.5
# Largest relative standard error of a log that takes part in groups.
_MAX_ERROR = 0.05
# Quantity of a step that another scale of all thrust explains as well, and the likelihood ratio by which that is less
# likely: one in 20.
_BOTH, _UNLIKELY = "inertia and drag", 6.0
# Quantity -> the parameters that differ between the groups: inertia, quadratic and linear drag.
_SCALED = {
    "inertia": np.array([1.0, 0.0, 0.0]),
    "quadratic drag": np.array([0.0, 1.0, 0.0]),
    "drag": np.array([0.0, 1.0, 1.0]),
    _BOTH: np.ones(3),
}
# Likelihood ratio of two levels against one with scatter: 99.5 % quantile of the best split of n normal deviates, by
# 20 000 draws for each n from 4 to 30: 23 up to seven logs, and 1.1 more with each log.
_MIN_RATIO, _RATIO_AT_ZERO, _RATIO_PER_LOG = 23.0, 15.0, 1.1
#: The same ratio less this is the 95 % quantile.
LIKELY = 6.5
# Passes at most in which the larger group settles.
_SPLITS = 6
# Variance of the relative scatter within one level.
_SCATTERS = np.append(0.01**2, np.geomspace(0.012**2, 4.0, 30))


@dataclass(frozen=True, kw_only=True)
class _Groups:
    """Two groups of logs: the likelihood ratio, the relative step with its error, and the logs of each level."""

    ratio: float
    step: float
    error: float
    high: tuple[str, ...]
    low: tuple[str, ...]
    quantity: str
    excess: float  #: Of the ratio over that of chance.

    @property
    def smaller(self) -> tuple[str, ...]:
        """The logs of the level that fewer logs have."""
        return min(self.high, self.low, key=len)


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    dead = dead_thrusters(data.runs, data.vehicle)
    data = replace(data, runs=at_rest(data.runs, data.vehicle, dead))
    # A hull that moves ahead turns by itself (Munk moment), which in yaw alone is a thruster that does not push.
    while not data.vehicle.planar and (misfit := misassigned(data.runs, data.vehicle)):
        so = "" if misfit.after is None else f", and {100.0 * misfit.after:.0f} % with that"
        text = (
            f"{misfit.log} does not belong to the other logs: {misfit.what}. Their model leaves "
            f"{100.0 * misfit.before:.0f} % of the variance of its torque unexplained{so}."
        )
        fault = Fault(fault="foreign_log", logs=(misfit.log,), at=misfit.at, text=text, remedy="set_aside")
        yield Detection(fault=fault, done="The log was set aside.", repair=partial(without, log=misfit.log))
        data = without(data, misfit.log)
    model, found = fit_quick_model(data.runs, data.vehicle), list[Detection[RunsData]]()
    # A majority is one of the logs that say something on the model. A wrong sign shows without a majority.
    opposite = set() if model is None else {log.name for log in model.regressors if log.is_opposite}
    count = 0 if model is None else len(model.logs) - len(opposite)
    # Without the foreign logs the scatter of the others is smaller, which may show further ones.
    rest, odd, kept = data, 0, set[str]()
    while model is not None and len(model.logs) >= _MIN_LOGS:
        least = float(np.median([log.features[0] for log in model.logs])) + _EXCITED
        foreign = [log for log in model.logs if log.features[0] > least and _is_foreign(log, len(model.logs))]
        if data.vehicle.planar:
            # Sway and surge change the yaw that a log shows, but not the sign of its inertia.
            foreign = [log for log in foreign if 1.0 + log.deviation[0] + _CERTAIN * log.standard_errors[0] < 0.0]
        foreign = [log for log in foreign if log.name not in kept and _explains_itself(log, model)]
        foreign = _with_own_model(foreign, model)
        if not foreign:
            break
        alike = [log for log in foreign if log.name not in opposite]
        names = {log.name for log in alike}
        if belong := {log for log in names if _has_common_torque(log, names, rest, model)}:
            kept, drive = kept | belong, None
        elif drive := common_drive(rest.runs, data.vehicle, model, names) if alike else None:
            kept |= _belonging(alike, drive.model)
        odd += sum(log.name not in opposite | kept for log in foreign)
        if 2 * odd >= count:
            divided = [*_without_majority([log for log in alike if log.name not in kept], rest, model)]
            found, model = found + divided, None if divided else model
            break
        for log in foreign:
            if log.name not in kept:
                found.append(_foreign(log, len(model.logs), data.vehicle))
                rest = without(rest, log.name)
            elif drive is not None and not drive.is_shown:
                found.append(_doubtful(_foreign(log, len(model.logs), data.vehicle), _DRIVEN.format(drive.name)))
        model = fit_quick_model(rest.runs, data.vehicle)
    yield from found
    groups = [] if model is None or data.vehicle.planar else significant_groups(model)
    if model is not None and groups:
        best = max(groups, key=lambda each: each.ratio)
        if not replaces_groups(rest.runs, data.vehicle, model, (best.high, best.low), significant_groups):
            text = (
                f"The logs are of two kinds, as with two payloads or two vehicles: the {best.quantity} of "
                f"{named(best.high)} is {plus_minus(1.0 + best.step, best.error)} times that of {named(best.low)}."
            )
            fault = Fault(fault="foreign_log", logs=best.smaller, text=text, size=1.0 + best.step, confidence=0.97)
            fault = replace(fault, standard_error=best.error)
            yield Detection(fault=fault, done=_EACH_KIND)


def _is_foreign(log: LogMoments, count: int) -> bool:
    sizes = np.abs(log.deviation) - 2.0 * log.standard_errors
    inertia, drag = 1.0 + log.deviation
    if drag < 0.0 and inertia > _CERTAIN * log.standard_errors[0]:
        sizes = sizes[:1]  # No vehicle has that, but an autopilot that holds against a disturbance seems to.
    return count * log.chance < _LEVEL and bool(sizes.max() > _MIN_DEVIATION)


def _explains_itself(log: LogMoments, model: QuickModel) -> bool:
    """Whether another inertia and drag leave half of the residual variance at most, as of another vehicle."""
    own = _regressors(log, model)
    before, change = own.forcing - own.x @ model.values, solved(log.slope, log.score)
    after = before - own.x @ change
    # The sensor noise counts as much more as the inertia is larger.
    scale = (model.inertia + change[0]) ** 2
    noise = scale * sum(int(run.valid.sum()) * run.rates.acceleration_noise**2 for run in own.runs)
    return bool(after @ after - noise < _LESS * (before @ before))


def _with_own_model(foreign: Sequence[LogMoments], model: QuickModel) -> list[LogMoments]:
    """Those of the ``foreign`` logs that one model of all logs does not explain; all where no other is left."""
    names = {log.name for log in foreign}
    usual = [one for one in model.regressors if one.name not in names]
    return [log for log in foreign if not usual or not JointModel(_regressors(log, model), usual).explains]


def _regressors(log: LogMoments, model: QuickModel) -> LogRegressors:
    return next(each for each in model.regressors if each.name == log.name)


def _belonging(logs: Sequence[LogMoments], model: QuickModel) -> set[str]:
    """Names of foreign ``logs`` that deviate by far less from another ``model`` of all, and not significantly."""
    pairs = [(log, own) for log in logs for own in model.logs if own.name == log.name]
    return {log.name for log, own in pairs if _is_less(own, log) and not _is_foreign(own, len(model.logs))}


def _has_common_torque(log: str, foreign: Collection[str], data: RunsData, model: QuickModel) -> bool:
    """Whether a ``log`` belongs to those that are not ``foreign`` by a torque of the sizes that these show."""
    others, vehicle = [run for run in data.runs if log_name(run) not in foreign], data.vehicle
    runs = [*others, *(run for run in data.runs if log_name(run) == log)]
    plain, most = fit_quick_model(others, vehicle), _LESS * unexplained(model, {log})
    every = with_common_torque(runs, plain) if plain else ()
    likely = (acting for acting in every if least_unexplained(acting, vehicle, model, {log}) < most)
    return any(belonging(log, runs, acting, vehicle) for acting in likely)


def _is_less(own: LogMoments, before: LogMoments) -> bool:
    return bool(np.abs(own.deviation).max() < _LESS * np.abs(before.deviation).max())


def belonging(log: str, plain: Sequence[Run], acting: Sequence[Run], vehicle: Vehicle) -> bool:
    """Whether a ``log`` that is foreign by the ``plain`` torques belongs to the others by the ``acting`` torques.

    Its deviation and the variance of its unexplained torque are at most half as large, and usual for a log of the same
    vehicle. The usual unexplained torque is in Student's prediction interval of one further log, with logarithms as
    normal deviates. A log that determines neither its inertia nor its drag does not belong.
    """
    from scipy.special import stdtrit

    before, after = (fit_quick_model(runs, vehicle) for runs in (plain, acting))
    old, new = ({each.name: each for each in model.logs} if model else {} for model in (before, after))
    if log not in old or log not in new or len(new) < _MIN_LOGS:
        return False
    first, own = old.pop(log), new.pop(log)
    plainly, others = (np.array([each.log_residual for each in logs.values()]) for logs in (old, new))
    if np.mean(others) > np.mean(plainly):
        return False  # The causes do not act in the other logs.
    scatter = max(np.std(others, ddof=1), _SCATTER)
    reach = stdtrit(len(others) - 1, 1.0 - _UNUSUAL) * scatter * np.sqrt(1.0 + 1.0 / len(others))
    is_less = own.log_residual < first.log_residual + 0.5 * np.log(_LESS) and _is_less(own, first)
    is_same = own.chance > _UNUSUAL and np.min(np.abs(own.deviation) + 2.0 * own.standard_errors) < _EXCLUDED
    return bool(is_less and is_same and own.log_residual < np.mean(others) + reach)


def _without_majority(
    foreign: Sequence[LogMoments], data: RunsData, model: QuickModel
) -> Iterator[Detection[RunsData]]:
    """Foreign logs that are as many as the others, if a model of their own explains them."""
    before = {log.name: log.misfit for log in foreign}
    own = fit_quick_model([run for run in data.runs if log_name(run) in before], data.vehicle)
    if own and len(own.logs) == len(before) and all(log.misfit < _OWN * before[log.name] for log in own.logs):
        for log in foreign:
            yield _doubtful(_foreign(log, len(model.logs), data.vehicle), _NO_MAJORITY)


def _foreign(log: LogMoments, count: int, vehicle: Vehicle) -> Detection[RunsData]:
    at = int(np.argmax(np.abs(log.deviation) / log.standard_errors))
    factor, error = 1.0 + float(log.deviation[at]), float(log.standard_errors[at])
    what, is_opposite = ("inertia", "drag")[at], factor + _CERTAIN * error < 0.0
    # A size that no vehicle has, or an uncertain one, is no size of another vehicle.
    is_sized = is_opposite or (factor > 0.0 and error < _UNSIZED * abs(factor - 1.0))
    is_radians = at == 0 and error < _PRECISE * factor and abs(factor - _RADIAN) < _CERTAIN * error
    own = f"its {what} is {plus_minus(factor, error)} times theirs" if is_sized else f"its own {what} is not determined"
    text = (
        f"{log.name} does not belong to the other logs: their model leaves {100.0 * log.misfit:.0f} % of its torque "
        f"unexplained, and {own}.{_OPPOSITE * is_opposite}{_IN_RADIANS * is_radians}{_size_text(log, vehicle)}"
    )
    fault = Fault(
        fault="foreign_log",
        logs=(log.name,),
        text=text,
        size=factor if is_sized else None,
        standard_error=error if is_sized else None,
        confidence=1.0 - min(0.05, count * log.chance),
        remedy="set_aside",
        may_be_explained=not (is_opposite or is_radians),
    )
    if vehicle.assumptions.includes_curve and factor > 0.0 and not is_radians:
        # At another thrust, an error of the guessed curve changes inertia and drag by a factor.
        return _doubtful(Detection(fault=fault), _GUESSED)
    return Detection(fault=fault, done="It was set aside.", repair=partial(without, log=log.name))


def _size_text(log: LogMoments, vehicle: Vehicle) -> str:
    """Sentence on a motion that may be logged at another size; empty where its factors do not fit."""
    (inertia, drag), (error, drag_error) = 1.0 + log.deviation, _CERTAIN * log.standard_errors
    for factor, size in _SIZES.items():
        least, most = sorted((factor, factor**2))
        if (
            abs(inertia - factor) < error < _CERTAIN * _PRECISE * factor
            and least - drag_error < drag < most + drag_error
        ):
            return f" Its {vehicle.axis.position_words} may be logged at {size} its size."
    return ""


def _doubtful(detection: Detection[RunsData], done: str) -> Detection[RunsData]:
    """The same fault without a remedy, where something else explains the deviation as well."""
    return Detection(fault=replace(detection.fault, remedy="none", confidence=_EVEN, may_be_explained=False), done=done)


def minority_payload(runs: Sequence[Run], vehicle: Vehicle, less: float = 0.0) -> tuple[str, ...]:
    """The smaller of two groups of logs with another inertia or drag; empty if another scale of all thrust may act."""
    model = fit_quick_model(runs, vehicle)
    groups = [] if model is None else significant_groups(model, less)
    best = max(groups, key=lambda each: each.ratio, default=None)
    if best is None or any(each.quantity == _BOTH and each.ratio > best.ratio - _UNLIKELY for each in groups):
        return ()
    return best.smaller


def significant_groups(model: QuickModel, less: float = 0.0) -> list[_Groups]:
    """The best split in two groups by each quantity, if it is significant by a likelihood ratio that is ``less``."""
    # (3,) difference of each log's own parameters from the common model, and its (3, 3) information.
    slopes = [np.linalg.pinv(log.slope, rcond=1e-10) for log in model.logs]
    pairs = list(zip(slopes, model.logs, strict=True))
    weights = [np.linalg.pinv(slope @ log.noise @ slope.T, rcond=1e-10, hermitian=True) for slope, log in pairs]
    own = [slope @ log.score for slope, log in pairs]
    found = [_settled_groups(model, own, weights, quantity) for quantity in _SCALED]
    return [each for each in found if each and each.excess > -less and each.step > _MIN_STEP]


def _settled_groups(
    model: QuickModel, own: Sequence[FloatArray], weights: Sequence[FloatArray], quantity: str
) -> _Groups | None:
    """The best split by deviations from the mean of the larger group.

    The mean of all is a model of neither group: the error of its other parameters would scatter the logs of one group.
    """
    larger, found = {log.name for log in model.logs}, None
    for _ in range(_SPLITS):
        among = [at for at, log in enumerate(model.logs) if log.name in larger]
        product = np.sum([weights[at] @ own[at] for at in among], axis=0)
        mean = np.linalg.pinv(np.sum([weights[at] for at in among], axis=0), rcond=1e-10, hermitian=True) @ product
        pulls = [weight @ (each - mean) for weight, each in zip(weights, own, strict=True)]
        found = _groups(model.logs, pulls, weights, _SCALED[quantity] * (model.values + mean), quantity)
        if found is None or larger == (others := {*found.high, *found.low} - {*found.smaller}):
            break
        larger = others
    return found


def _groups(
    logs: Sequence[LogMoments],
    pulls: Sequence[FloatArray],
    weights: Sequence[FloatArray],
    direction: FloatArray,
    quantity: str,
) -> _Groups | None:
    """The best split if only the parameters in this ``direction`` differ between the logs."""
    variances = 1.0 / np.array([direction @ weight @ direction for weight in weights]).clip(1e-300)
    deviations = variances * np.array([direction @ pull for pull in pulls])
    used = np.flatnonzero(variances < _MAX_ERROR**2)
    if len(used) < _MIN_GROUPED:
        return None
    used = used[np.argsort(deviations[used])]
    d, v = deviations[used], variances[used]
    features = np.array([logs[at].features for at in used.tolist()]).T
    one = max(_likelihood(d, v, feature).max() for feature in (np.zeros(len(d)), *features))
    cuts = range(2, len(d) - 1)
    two = [(_likelihood(d[:cut], v[:cut]) + _likelihood(d[cut:], v[cut:])).max() for cut in cuts]
    cut, ratio = cuts[int(np.argmax(two))], 2.0 * (max(two) - one)
    (low, low_error), (high, high_error) = _mean(d[:cut], v[:cut]), _mean(d[cut:], v[cut:])
    step = (high - low) / (1.0 + low) if low > -1.0 else 0.0
    needed = max(_MIN_RATIO, _RATIO_AT_ZERO + _RATIO_PER_LOG * len(d))
    names = [logs[at].name for at in used.tolist()]
    return _Groups(
        ratio=ratio,
        step=float(step),
        error=float(np.hypot(low_error, high_error) / (1.0 + low)),
        high=tuple(sorted(names[cut:])),
        low=tuple(sorted(names[:cut])),
        quantity=quantity,
        excess=ratio - needed,
    )


def _likelihood(d: FloatArray, variances: FloatArray, feature: FloatArray | None = None) -> FloatArray:
    """Log-likelihood of (n,) deviations about a level, or a line along a ``feature``, for each scatter."""
    w = 1.0 / (variances + _SCATTERS[:, None])
    total = w.sum(axis=1)
    mean = (w * d).sum(axis=1) / total
    squares = (w * (d - mean[:, None]) ** 2).sum(axis=1)
    if feature is not None:
        x = feature - (w * feature).sum(axis=1, keepdims=True) / total[:, None]
        size = (w * x**2).sum(axis=1)
        squares -= (w * x * d).sum(axis=1) ** 2 / size.clip(1e-300)
    return np.asarray(0.5 * np.log(w).sum(axis=1) - 0.5 * squares)


def _mean(d: FloatArray, variances: FloatArray) -> tuple[float, float]:
    """Mean with its error, by the scatter of the deviations."""
    w = 1.0 / (variances + _SCATTERS[int(np.argmax(_likelihood(d, variances)))])
    return float((w * d).sum() / w.sum()), float(w.sum() ** -0.5)


DETECTORS: Detectors = {"runs": (_detect,)}
