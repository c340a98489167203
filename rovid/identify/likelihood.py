"""Maximum likelihood of Kalman-filter innovations: all parameters from all trials at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.optimize import Bounds, minimize

from rovid.effects import Effect
from rovid.effects.base import Scales, neutral_commands
from rovid.identify.estimate import Estimate
from rovid.identify.free_run import fit_free_run, free_run_r2
from rovid.model import Model, initial_rate
from rovid.rates import body_angle
from rovid.runs import Run
from rovid.simulation import compare
from rovid.trial import FloatArray
from rovid.vehicle import Vehicle

NAMES = ("inertia", "quadratic_drag", "linear_drag")
# Upper limits of the disturbance, as shares of the torque in use, from loose to tight. Without a limit the
# disturbance explains whatever the model does not, and the parameters go where they like.
LIMITS = (0.05, 0.02, 0.01, 0.005)
# The free-running simulation may lose this much R^2 against the fit that looks at nothing else.
_R2_LOSS = 0.01
# Where the disturbance is at its limit, the fit is tried again with this many times as much.
_LOOSER = 2.5
_RATE_ERROR = 0.2  # of the rate's root mean square: how well the first rate of a trial is known
_ANGLE_NOISE_FLOOR = 1e-5  # rad; no heading is better, and one from an autopilot's filter would claim to be
_BLOCK_SECONDS = 40.0
# Steps for slopes and for curvatures: of the logarithms and scaled drags, and shares of an effect's parameter.
_SLOPE_STEPS = (1e-5, 1e-4)
_CURVATURE_STEPS = (1e-3, 1e-2)
_TRIAL_ITERATIONS = 12
_WHITE_LAGS = 20
_WHITE_P = 1e-3
_KURTOSIS = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LikelihoodFit:
    """Maximum-likelihood estimate and what it says of the disturbance.

    Attributes
    ----------
    log_likelihood
        Of the innovations of all trials.
    disturbance, correlation_time
        Standard deviation of the disturbance torque in N m and its memory in s.
    heading_noise
        Standard deviation of the white noise of the heading in rad.
    limit
        Share of the torque in use that the disturbance was allowed.
    at_limit
        Whether it would take more.
    white
        Whether the normalised innovations are white (Ljung-Box) and free of heavy tails.
    free_run_r2, base_r2
        R^2 of the free-running yaw rate with this model, and with the fit that looks at nothing else.
    """

    estimate: Estimate
    log_likelihood: float
    disturbance: float
    correlation_time: float
    heading_noise: float
    limit: float
    at_limit: bool
    white: bool
    free_run_r2: float
    base_r2: float


def fit_likelihood(
    runs: Sequence[Run], vehicle: Vehicle | None = None, effects: tuple[Effect, ...] = ()
) -> LikelihoodFit:
    """Estimate inertia, drag, effects, disturbance and heading noise together by the prediction-error method.

    The likelihood of the innovations of an extended Kalman filter (Ljung 1999, section 7.4; Schweppe 1965) with a
    first-order Gauss-Markov disturbance torque is right under feedback, with gaps and at any sampling. It starts
    from the free-running fit. The disturbance is limited; the limit is tightened until the free-running simulation
    is as good as that of the fit that looks at nothing else. Effects are put in after that, from each of their starts.

    Parameters
    ----------
    vehicle
        Needed by effects that act between command and torque.

    Raises
    ------
    DataError
        The vehicle was not excited enough.
    """
    base = fit_free_run(runs)
    base_r2 = free_run_r2(runs, base)
    best: tuple[_Problem, FloatArray, float] | None = None
    for limit in LIMITS:
        problem = _Problem(runs, base, limit)
        x = problem.solve()
        r2 = free_run_r2(runs, problem.model(x))
        if best is None or r2 > best[2]:
            best = problem, x, r2
        if r2 >= base_r2 - _R2_LOSS:
            break
    assert best is not None  # noqa: S101 - there are limits
    problem, x, r2 = best
    if effects:
        problem, x = _with_effects(problem, x, base, vehicle, effects)
        r2 = _r2_with_effects(problem, x)
    return problem.result(x, r2=r2, base_r2=base_r2)


def _with_effects(
    bare: _Problem, x: FloatArray, base: Model, vehicle: Vehicle | None, effects: tuple[Effect, ...]
) -> tuple[_Problem, FloatArray]:
    """Continue from the fit without effects: the likeliest of all starts."""
    problem = _Problem(bare.runs, base, bare.limit, vehicle=vehicle, effects=effects)
    tries = []
    for number in range(max(len(parameter.starts) for parameter in problem.parameters)):
        problem.start[: len(x)] = x
        problem.start[len(x) :] = [p.starts[min(number, len(p.starts) - 1)] for p in problem.parameters]
        tries.append(problem.solve(iterations=_TRIAL_ITERATIONS))
    # A few steps tell which start leads lower.
    problem.start[:] = min(tries, key=problem.cost)
    return problem, problem.solve()


def _r2_with_effects(problem: _Problem, x: FloatArray) -> float:
    model = problem.model(x)
    pairs = zip(problem.runs, problem.torques(model), strict=True)
    simulated = [run.rates.smooth_samples(run.trial, model.simulate(run.trial, torque)[0]) for run, torque in pairs]
    measured = np.concatenate([run.rates.yaw_rate for run in problem.runs])
    return compare(measured, np.concatenate(simulated)).r2


class _Problem:
    """The likelihood as a function of scaled, unconstrained-as-possible coordinates.

    x = log I, DQ and DL over their scale, log of disturbance, correlation time and heading noise.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        start: Model,
        limit: float,
        *,
        vehicle: Vehicle | None = None,
        effects: tuple[Effect, ...] = (),
    ) -> None:
        self.runs = runs
        self.vehicle = vehicle
        self.effects = effects
        self.limit = limit
        self.angles = [body_angle(run.trial) for run in runs]
        self.missing = [np.full(len(run.trial.time), np.nan) for run in runs]
        rates = np.concatenate([run.rates.yaw_rate for run in runs])
        self.rate = max(float(np.sqrt(np.nanmean(rates**2))), 1e-9)
        drag = start.quadratic_drag * self.rate + start.linear_drag
        self.scale = np.array([drag / self.rate, drag])
        torque = np.concatenate([run.torque for run in runs])
        self.torque = float(np.sqrt(np.mean(torque[torque != 0.0] ** 2)))
        noise = max(float(np.median([run.rates.heading_noise for run in runs])), _ANGLE_NOISE_FLOOR)
        top = math.log(limit * self.torque)
        self.parameters = [parameter for effect in effects for parameter in effect.parameters]
        scales = Scales(command=_command_in_use(runs, vehicle), torque=self.torque, rate=self.rate)
        self.units = np.array([scales.of(parameter) for parameter in self.parameters])
        self.start = np.array(
            [
                math.log(start.inertia),
                start.quadratic_drag / self.scale[0],
                start.linear_drag / self.scale[1],
                min(math.log(0.01 * self.torque), top - 0.1),
                math.log(4.0),
                math.log(noise),
                *(parameter.starts[0] for parameter in self.parameters),
            ]
        )
        angle = (math.log(_ANGLE_NOISE_FLOOR), math.log(0.2))
        low = [parameter.low for parameter in self.parameters]
        high = [parameter.high for parameter in self.parameters]
        self.bounds = (
            np.array([self.start[0] - 2.5, 0.0, 0.0, top - 9.0, math.log(0.2), angle[0], *low]),
            np.array([self.start[0] + 2.5, np.inf, np.inf, top, math.log(100.0), angle[1], *high]),
        )

    def solve(self, *, iterations: int = 300) -> FloatArray:
        """Most likely x, from ``self.start``."""
        solution = minimize(
            self.cost,
            self.start,
            jac=self.gradient,
            method="L-BFGS-B",
            bounds=Bounds(*self.bounds),
            options={"maxiter": iterations},
        )
        return np.asarray(solution.x)

    def steps(self, x: FloatArray, sizes: tuple[float, float]) -> FloatArray:
        """Small changes of ``x``: an effect's parameter in proportion to itself, or to its start where it is gone."""
        starts = np.array([abs(parameter.starts[0]) or 1.0 for parameter in self.parameters])
        return np.concatenate((np.full(6, sizes[0]), sizes[1] * np.maximum(np.abs(x[6:]), 0.1 * starts)))

    def gradient(self, x: FloatArray) -> FloatArray:
        """Slope of the cost by forward differences, backward at an upper bound; on all cores at once."""
        step = self.steps(x, _SLOPE_STEPS)
        step = np.where(x + step > self.bounds[1], -step, step)
        with ThreadPoolExecutor() as pool:
            costs = list(pool.map(self.cost, [x, *(x + row for row in np.diag(step))]))
        return (np.array(costs[1:]) - costs[0]) / step

    def model(self, x: FloatArray) -> Model:
        return Model(
            inertia=math.exp(x[0]),
            quadratic_drag=float(x[1] * self.scale[0]),
            linear_drag=float(x[2] * self.scale[1]),
            effects=self.effects,
            effect_values=tuple(float(value) for value in x[6:] * self.units),
        )

    def torques(self, model: Model) -> list[FloatArray]:
        """(n,) torque of each run after the effects between command and torque."""
        if self.vehicle is None:
            return [run.torque for run in self.runs]
        return [model.torque(self.vehicle, run.trial) for run in self.runs]

    def innovations(self, x: FloatArray) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """(time, innovation, variance) of each run, where the heading was measured; the first is the start."""
        from rovid.kernels import innovations

        model = self.model(x)
        terms, active = model.terms()
        noise = np.array([*np.exp(x[3:6]), 1.0])
        out = []
        for run, torque, angle, missing in zip(self.runs, self.torques(model), self.angles, self.missing, strict=True):
            start = np.array([initial_rate(run.trial), _RATE_ERROR * self.rate])
            error, variance = innovations(
                run.trial.time, torque, angle, missing, model.base(run.trial), terms, active, noise, start
            )
            known = np.flatnonzero(np.isfinite(error[:, 0]))[1:]
            out.append((run.trial.time[known], error[known, 0], variance[known, 0]))
        return out

    def cost(self, x: FloatArray) -> float:
        total = 0.0
        for _, error, variance in self.innovations(x):
            total += 0.5 * float(np.sum(np.log(2.0 * np.pi * variance) + error**2 / variance))
        return total if math.isfinite(total) else 1e12

    def block_costs(self, x: FloatArray) -> FloatArray:
        """Cost summed over blocks of time; what the scores' scatter is judged by."""
        sums = []
        for time, error, variance in self.innovations(x):
            pieces = 0.5 * (np.log(2.0 * np.pi * variance) + error**2 / variance)
            sums.append(np.bincount((time / _BLOCK_SECONDS).astype(np.intp), weights=pieces))
        return np.concatenate(sums)

    def covariance(self, x: FloatArray, *, sandwich: bool) -> FloatArray:
        """Of inertia, drags and effects: inverse curvature, or the sandwich that allows for coloured innovations."""
        # All of them, a drag at its bound too: to take its zero for certain would make the rest look certain.
        free = range(len(x))
        step = self.steps(x, _CURVATURE_STEPS)
        scores, curvature = [], np.zeros((len(free), len(free)))
        centre = self.block_costs(x)
        sides = {}
        for i, k in enumerate(free):
            for sign in (1, -1):
                sides[i, sign] = self.block_costs(self._moved(x, {k: sign * step[k]}))
            scores.append((sides[i, 1] - sides[i, -1]) / (2.0 * step[k]))
            curvature[i, i] = float(np.sum(sides[i, 1] - 2.0 * centre + sides[i, -1])) / step[k] ** 2
        for i, k in enumerate(free):
            for j in range(i):
                both = self.block_costs(self._moved(x, {k: step[k], free[j]: step[free[j]]}))
                mixed = float(np.sum(both - sides[i, 1] - sides[j, 1] + centre)) / (step[k] * step[free[j]])
                curvature[i, j] = curvature[j, i] = mixed
        inverse = _inverse(curvature)
        if sandwich:
            matrix = np.stack(scores, axis=1)
            matrix = matrix - matrix.mean(axis=0)
            inverse = inverse @ (matrix.T @ matrix * len(matrix) / (len(matrix) - 1)) @ inverse
        physical = [0, 1, 2, *range(6, len(x))]
        size = np.array([math.exp(x[0]), *self.scale, *self.units])
        return np.asarray(inverse[np.ix_(physical, physical)] * np.outer(size, size))

    def physical(self, x: FloatArray) -> FloatArray:
        """Inertia, drags and the effects' parameters in their units."""
        model = self.model(x)
        return np.array([model.inertia, model.quadratic_drag, model.linear_drag, *model.effect_values])

    def loosened(self, x: FloatArray) -> _Problem:
        """The same problem from ``x`` with a looser limit of the disturbance."""
        limit = _LOOSER * self.limit
        looser = _Problem(self.runs, self.model(x), limit, vehicle=self.vehicle, effects=self.effects)
        looser.scale = self.scale
        looser.start[:] = x
        return looser

    @staticmethod
    def _moved(x: FloatArray, steps: dict[int, float]) -> FloatArray:
        moved = x.copy()
        for k, step in steps.items():
            moved[k] += step
        return moved

    def result(self, x: FloatArray, *, r2: float, base_r2: float) -> LikelihoodFit:
        model = self.model(x)
        white = innovations_are_white([error / np.sqrt(variance) for _, error, variance in self.innovations(x)])
        at_limit = x[3] > self.bounds[1][3] - 1e-3
        samples = sum(int(run.trial.measured.sum()) for run in self.runs)
        covariance = self.covariance(x, sandwich=not white)
        if at_limit:
            # The limit is a choice; what a looser one would change is part of the uncertainty.
            shift = self.physical(self.loosened(x).solve()) - self.physical(x)
            covariance = covariance + np.outer(shift, shift)
        estimate = Estimate(
            names=(*NAMES, *(f"{effect.key}.{p.name}" for effect in self.effects for p in effect.parameters)),
            values=self.physical(x),
            covariance=covariance,
            method="maximum likelihood of Kalman-filter innovations",
            samples=samples,
            warnings=tuple(self._warnings(model, white=white, at_limit=bool(at_limit))),
        )
        return LikelihoodFit(
            estimate=estimate,
            log_likelihood=-self.cost(x),
            disturbance=math.exp(x[3]),
            correlation_time=math.exp(x[4]),
            heading_noise=math.exp(x[5]),
            limit=self.limit,
            at_limit=bool(at_limit),
            white=white,
            free_run_r2=r2,
            base_r2=base_r2,
        )

    def _warnings(self, model: Model, *, white: bool, at_limit: bool) -> list[str]:
        texts = []
        if at_limit:
            texts.append(
                f"The disturbance torque would exceed {100 * self.limit:.2g} % of the torque in use "
                f"({self.limit * self.torque:.3g} N m): the model misses something that these data show. The "
                f"standard errors include what a limit {_LOOSER:g} times as high would change."
            )
        if not white:
            texts.append(
                "The innovations are not white: the standard errors come from the scatter between stretches of the "
                "logs, not from the curvature of the likelihood."
            )
        texts += [f"{name} is held at zero, its lower bound." for name in NAMES[1:] if getattr(model, name) == 0.0]
        return texts


def _inverse(curvature: FloatArray) -> FloatArray:
    """Inverse of a curvature; a direction in which the likelihood is flat, or a saddle, gets a large variance."""
    size = np.sqrt(np.abs(np.diag(curvature))).clip(1e-300)
    values, vectors = np.linalg.eigh(curvature / np.outer(size, size))
    return np.asarray((vectors / np.maximum(values, 1e-6)) @ vectors.T / np.outer(size, size))


def innovations_are_white(series: Sequence[FloatArray]) -> bool:
    """Whether normalised innovations are white (Ljung-Box over all trials) and without heavy tails.

    Spikes leave innovations white, so that the kurtosis is looked at too.
    """
    count = sum(len(z) for z in series)
    power = sum(float(z @ z) for z in series)
    statistic = 0.0
    for lag in range(1, _WHITE_LAGS + 1):
        product = sum(float(z[lag:] @ z[:-lag]) for z in series if len(z) > lag)
        statistic += (product / power) ** 2 / (count - lag)
    p_value = float(special.gammaincc(_WHITE_LAGS / 2.0, count * (count + 2.0) * statistic / 2.0))
    fourth = sum(float(np.sum(z**4)) for z in series) * count / power**2
    return p_value > _WHITE_P and fourth - 3.0 < _KURTOSIS


def _command_in_use(runs: Sequence[Run], vehicle: Vehicle | None) -> float:
    """Largest departure of any command from neutral."""
    neutral = 0.0 if vehicle is None else neutral_commands(vehicle)
    return max(float(np.max(np.abs(run.trial.commands - neutral))) for run in runs)
