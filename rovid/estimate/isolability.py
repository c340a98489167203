"""Isolability: which pairs of causes a programme of runs can distinguish, and after how many minutes."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.threads import thread_map
from rovid.effects import Effect, forms_for
from rovid.effects.actuator_inputs import SPEEDS
from rovid.estimate.assumed_models import (
    SIZE_SHARES,
    SizedCause,
    channels,
    simulated_rates,
    sized_cause,
    split_causes,
    with_effect,
)
from rovid.estimate.dataset import rms, rms_nonzero, time_constant
from rovid.estimate.experiment_design import DECISIVE_LLR, CandidateModel, fit_objective, noise_free
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.nested_fits import scaled_start
from rovid.estimate.parametrization import COMMON, DISTURBANCE
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Shares of the initial size of the rival at which its fit may start, and steps of a coarse and of a full fit.
# Above this log-likelihood ratio (nats) of a coarse fit, the pair is separated whatever a full fit gives.
_STARTS, _COARSE_STEPS, _STEPS, _CERTAIN = (1.0, 0.2, 0.04), 3, 12, 10.0 * DECISIVE_LLR
# Expected log-likelihood ratio in nats that counts as none: rounding of the filter. Convention.
_NOTHING = 0.05
# Distance from a bound, in scaled coordinates, within which it holds a coordinate.
_AT_BOUND = 1e-3
# Readings for each time constant of the vehicle that a comparison of causes needs; closer ones are thinned.
_READINGS_PER_CONSTANT = 20.0
# Further sensors with their channels, and the errors of their means over a second: torque over the RMS torque; voltage
# over the rated one; speed in m/s. Of usual instruments.
SENSORS = {"torque cell": ("torque",), "supply voltage": ("supply_voltage",), "DVL speeds": SPEEDS}
_TORQUE_ERROR, _VOLTAGE_ERROR, _SPEED_ERROR = 0.02, 0.005, 0.01
# Blocks of the programme at whose ends the log-likelihood ratio is computed.
_BLOCKS = 300
# Least eigenvalue of a scaled information, relative to the largest, below which it is flat.
_FLAT = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class PairSeparation:
    """Expected evidence of a programme between two causes, either of which may be true; the smaller evidence counts."""

    first: str
    second: str
    gain: float  # expected log-likelihood ratio over the whole programme, in nats
    seconds: float  # s until the decision; of the repeated programme beyond its end; infinite where never
    with_sensor: Mapping[str, float] = field(default_factory=dict)  # the same with each further sensor


@dataclass(frozen=True, kw_only=True, eq=False)
class IsolabilityMatrix:
    """Pairs of causes that a programme separates, the slowest first."""

    #: ``runs``, ``seconds``: names of the runs of the programme, and their length.
    runs: tuple[str, ...]
    seconds: float
    causes: tuple[SizedCause, ...]  # causes that the programme shows
    invisible: tuple[str, ...]  # causes that change other parameters only, or nothing
    pairs: tuple[PairSeparation, ...]
    sensor_causes: Mapping[str, tuple[str, ...]]  # further sensor -> ids of effects that can be tested only with it

    @cached_property
    def open_pairs(self) -> tuple[PairSeparation, ...]:
        """Pairs that the programme does not separate."""
        return tuple(pair for pair in self.pairs if pair.seconds > self.seconds)

    def separated_by(self, sensor: str) -> list[PairSeparation]:
        """Pairs that the programme separates only with a further sensor."""
        return [pair for pair in self.open_pairs if pair.with_sensor[sensor] <= self.seconds]


def isolability(
    base: CandidateModel,
    causes: Sequence[SizedCause],
    vehicle: Vehicle,
    programme: Sequence[Trial],
    report: Callable[[str], None] = lambda _: None,
) -> IsolabilityMatrix:
    """Expected log-likelihood ratios between all ``causes``, each in turn the true one.

    The true model simulates the programme without noise. The Kalman filter of the rival predicts the simulation, with
    the disturbance and noise of ``base``. All parameters of the rival are fitted to it. Half of the remaining
    normalised sum of squares is the expected log-likelihood ratio of the best fits, docs/method.md, (21).
    """
    seconds = sum(trial.duration for trial in programme)
    found: dict[tuple[str, str], tuple[float, dict[str, float]]] = {}
    shown: list[SizedCause] = []
    for number, cause in enumerate(causes, start=1):
        report(f"Comparing causes: {cause.name}, {number} of {len(causes)} …")
        visible = _visible_fits(base, cause, vehicle, programme)
        if visible is None:
            continue
        true, fitting = visible
        shown.append(true)
        rivals = [rival for rival in causes if rival is not cause]
        for rival, gains in zip(rivals, thread_map(fitting.gains, [rival.effect for rival in rivals]), strict=True):
            decided = {sensor: _decision(one, fitting.block_ends) for sensor, one in gains.items()}
            found[true.name, rival.name] = float(gains[""][-1]), decided
    pairs = []
    for one, other in combinations([cause.name for cause in shown], 2):
        (gain, decided), (back, latest) = found[one, other], found[other, one]
        seconds_until = max(decided[""], latest[""])
        # A sensor never delays a decision.
        sensors = {name: min(max(decided[name], latest[name]), seconds_until) for name in decided if name}
        pair = PairSeparation(first=one, second=other, gain=min(gain, back), seconds=seconds_until, with_sensor=sensors)
        pairs.append(pair)
    return IsolabilityMatrix(
        runs=tuple(trial.name for trial in programme),
        seconds=seconds,
        causes=tuple(shown),
        invisible=tuple(sorted({cause.name for cause in causes}.difference(cause.name for cause in shown))),
        pairs=tuple(sorted(pairs, key=lambda pair: (-pair.seconds, pair.gain))),
        sensor_causes=_sensor_causes(vehicle, channels(programme)),
    )


def _visible_fits(
    base: CandidateModel, cause: SizedCause, vehicle: Vehicle, programme: Sequence[Trial]
) -> "tuple[SizedCause, ExpectedFits] | None":
    """The cause at its fitted size, or at the first of `SIZE_SHARES` that the programme shows, and its fits."""
    sized: SizedCause | None = cause
    while sized is not None:
        fits = ExpectedFits(base, sized, vehicle, programme)
        if fits.gains(None)[""][-1] >= DECISIVE_LLR:
            return sized, fits
        larger = [share for share in SIZE_SHARES if sized.share is not None and share > sized.share]
        sized = sized_cause(cause.effect, base, vehicle, programme, larger[0]) if larger else None
    return None


def expected_separations(
    fitted: CandidateModel,
    causes: Sequence[tuple[SizedCause, Sequence[Effect]]],
    vehicle: Vehicle,
    programme: Sequence[Trial],
) -> list[PairSeparation]:
    """Evidence of the programme between each of the ``causes``, taken as true, and its rivals."""
    found = []
    for cause, rivals in causes:
        base, _ = split_causes(fitted, [effect for effect in fitted.model.effects if effect is cause.effect])
        fits = ExpectedFits(base, cause, vehicle, programme)
        for rival, gains in zip(rivals, thread_map(fits.gains, rivals), strict=True):
            gain, seconds = float(gains[""][-1]), _decision(gains[""], fits.block_ends)
            found.append(PairSeparation(first=cause.name, second=rival.key, gain=gain, seconds=seconds))
    return found


def _sensor_causes(vehicle: Vehicle, logged: set[str]) -> dict[str, tuple[str, ...]]:
    """Ids of the effects that a vehicle with ``logged`` channels can test only with each further sensor."""
    known, found = {form.id for form in forms_for(vehicle, logged)}, {}
    for name, own in SENSORS.items():
        if not logged.issuperset(own):
            testable = dict.fromkeys(form.id for form in forms_for(vehicle, logged.union(own)))
            found[name] = tuple(one for one in testable if one not in known)
    return found


def _decision(gains: FloatArray, ends: FloatArray) -> float:
    """Time in s at which the ``gains`` at block ``ends`` decide; each repetition of the programme adds the last one."""
    reached = np.flatnonzero(gains >= DECISIVE_LLR)
    if reached.size:
        return float(ends[reached[0]])
    return float(ends[-1] * DECISIVE_LLR / gains[-1]) if gains[-1] > _NOTHING else math.inf


class ExpectedFits:
    """Fits of rivals to the programme as simulated with one true cause."""

    def __init__(self, base: CandidateModel, true: SizedCause, vehicle: Vehicle, programme: Sequence[Trial]) -> None:
        self._base, self._vehicle, self._programme = base, vehicle, programme
        truth = replace(base, model=with_effect(base.model, true.effect, true.values))
        usual = float(np.median([trial.sampling_interval for trial in programme]))
        rate = rms(simulated_rates(base.model, vehicle, programme))
        interval = time_constant(base.model, rate) / _READINGS_PER_CONSTANT
        if interval >= 2.0 * usual:
            # White noise of the same power in fewer readings.
            self._base = replace(base, noise=base.noise * math.sqrt(usual / interval))
        else:
            interval = 0.0
        simulated = [noise_free(trial, truth, vehicle) for trial in programme]
        self._objective = fit_objective(simulated, base, vehicle, interval)
        self._readings = sensor_readings(truth.model, vehicle, programme)
        begins = np.cumsum([0.0, *(trial.duration for trial in programme)])
        self._instants = np.concatenate(
            [begin + span[0] for begin, span in zip(begins[:-1], self._objective.data.innovation_spans, strict=True)]
        )
        self.block_ends = np.linspace(0.0, begins[-1], _BLOCKS + 1)[1:]

    def gains(self, rival: Effect | None) -> dict[str, FloatArray]:
        """(b,) expected log-likelihood ratio at the end of each block, with all parameters of ``rival`` refitted.

        Without further sensors, key "", and with each of `sensor_readings`.
        """
        base = self._base
        effects = base.model.effects if rival is None else (*base.model.effects, rival)
        objective = replace(self._objective, effects=effects)
        parametrization = objective.parametrization
        begin = base.coordinates(self._objective)
        starts = [begin]
        if rival:
            own = [scaled_start(rival, initial, share) for initial in rival.initial_values for share in _STARTS]
            starts = [np.concatenate((begin, one)) for one in own]
        start = objective.most_likely([np.clip(start, *parametrization.bounds) for start in starts], 1)[0]
        x, residual, jacobian = _fitted(objective, start, _COARSE_STEPS)
        if 0.5 * residual @ residual < _CERTAIN:
            x, residual, jacobian = _fitted(objective, x, _STEPS)
        norm = np.linalg.norm(jacobian, axis=0)
        scale = np.where(norm > 0.0, norm, np.inf)
        products = self._products(residual, jacobian / scale, self._instants)
        gains = {"": _projected(products)}
        if rival is None:
            return gains
        model, step = parametrization.model(x), parametrization.difference_steps(x)
        first = sensor_readings(model, self._vehicle, self._programme)
        moved = {}
        for at in range(len(x) - len(rival.parameters), len(x)):
            beside = parametrization.model(x + step[at] * (np.arange(len(x)) == at))
            moved[at] = sensor_readings(beside, self._vehicle, self._programme)
        for sensor, (instants, values) in first.items():
            change = np.zeros((len(values), len(x)))
            for at, readings in moved.items():
                change[:, at] = (values - readings[sensor][1]) / step[at]
            # As the innovations: reading less prediction, and its derivative.
            error = self._readings[sensor][1] - values
            gains[sensor] = _projected(products + self._products(error, change / scale, instants))
        return gains

    def _products(self, residual: FloatArray, jacobian: FloatArray, instants: FloatArray) -> FloatArray:
        """(b, p + 1, p + 1) products of the columns of ``jacobian`` and ``residual`` up to the end of each block."""
        joined = np.column_stack((jacobian, residual))
        block = np.minimum(np.searchsorted(self.block_ends, instants), _BLOCKS - 1)
        sums = np.zeros((_BLOCKS, joined.shape[1], joined.shape[1]))
        for at in range(joined.shape[1]):
            for other in range(at + 1):
                weights = joined[:, at] * joined[:, other]
                sums[:, at, other] = sums[:, other, at] = np.bincount(block, weights, minlength=_BLOCKS)
        return sums.cumsum(axis=0)


def _projected(products: FloatArray) -> FloatArray:
    """(b,) half the sum of squares up to the end of each block, with the parameters fitted to these readings."""
    information, gradient, square = products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1]
    step = np.linalg.pinv(information, rcond=_FLAT, hermitian=True) @ gradient[:, :, None]
    gains = 0.5 * (square - np.sum(gradient * step[:, :, 0], axis=1))
    return np.asarray(np.maximum(np.maximum.accumulate(gains), 0.0))


def _fitted(
    objective: InnovationLikelihood, start: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(p,) coordinates of the least squares, the (N,) normalised innovations there, and their (N, p) Jacobian.

    The coordinates of disturbance and noise stay as they are at the start. Columns of fixed coordinates and of those
    that are held by a bound are zero.
    """
    from scipy import optimize  # The import takes long.

    low, high = objective.parametrization.bounds
    free = [at for at in range(len(start)) if not DISTURBANCE <= at < COMMON and low[at] < high[at]]

    def point(own: FloatArray) -> FloatArray:
        x = start.copy()
        x[free] = own
        return x

    def residual(own: FloatArray) -> FloatArray:
        error, variance = objective.innovations(point(own))
        return np.asarray(error / np.sqrt(variance))

    def jacobian(own: FloatArray) -> FloatArray:
        pieces = objective.jacobian(point(own))
        return np.concatenate([piece.matrix[: len(piece.matrix) // 2, free] for piece in pieces])

    found = optimize.least_squares(
        residual, start[free], jac=jacobian, bounds=(low[free], high[free]), x_scale="jac", max_nfev=steps, ftol=1e-3
    )
    matrix = np.zeros((len(found.fun), len(start)))
    matrix[:, free] = jacobian(found.x)
    outward = np.where(found.grad > 0.0, found.x - low[free], high[free] - found.x)
    matrix[:, np.array(free)[outward < _AT_BOUND]] = 0.0
    return point(found.x), found.fun, matrix


def sensor_readings(
    model: Model, vehicle: Vehicle, programme: Sequence[Trial]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """(m,) s and (m,) means over a second, in standard deviations, of each sensor of `SENSORS` that is not logged."""
    times, columns = list[FloatArray](), list[FloatArray]()
    begin = 0.0
    bare = replace(model, effects=(), effect_values=())
    for trial in programme:
        driven, plain = (one.torque_input(vehicle, trial) for one in (model, bare))
        rest = np.abs(plain.torque) < 1e-9
        ratio = np.where(rest, 1.0, driven.torque / np.where(rest, 1.0, plain.torque))
        sags = any(effect.id == "supply_sag" for effect in model.effects)
        readings = np.column_stack((driven.torque, ratio if sags else np.ones(len(ratio)), driven.effect_inputs[:, 1]))
        second = trial.time.astype(int)
        count = np.maximum(np.bincount(second), 1)
        columns.append(np.column_stack([np.bincount(second, one) / count for one in readings.T]))
        times.append(begin + 0.5 + np.arange(len(count), dtype=np.float64))
        begin += trial.duration
    values, time = np.concatenate(columns), np.concatenate(times)
    torque = np.concatenate([bare.torque_input(vehicle, trial).torque for trial in programme])
    noise = (_TORQUE_ERROR * rms_nonzero(torque), _VOLTAGE_ERROR, _SPEED_ERROR)
    logged = channels(programme)
    sensors = zip(SENSORS, values.T / np.array(noise)[:, None], strict=True)
    return {name: (time, column) for name, column in sensors if not logged.issuperset(SENSORS[name])}
