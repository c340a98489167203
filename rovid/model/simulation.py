"""Free-running simulation of trials, compared to the measurement."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES
from rovid.model.bound_effects import unknown_states
from rovid.model.model import Model
from rovid.model.ode import evaluate_along, integrate, with_past
from rovid.model.torque_input import TorqueInput
from rovid.trial.preprocessing import Run
from rovid.trial.rates import resample
from rovid.trial.vehicle import Vehicle

# s; horizons of the position errors.
HORIZONS = (10.0, 60.0)
# Rate in rad/s, or torque in N m, of a model that diverges: squares of larger numbers overflow.
_DIVERGED = 1e100


@dataclass(frozen=True, kw_only=True)
class FitMeasures:
    """Agreement of simulated and measured rate."""

    samples: int  #: Number of compared instants.
    r2: float  #: 1 - SSE/SST of the rate; NaN if the measured rate is constant.
    fit_percent: float  #: 100 (1 - |y - yhat| / |y - mean(y)|), Ljung's NRMSE fit.
    rmse: float  #: Root mean square error in rad/s.


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialSimulation:
    """Free-running simulation of one trial from its first sample."""

    run: Run
    fit: FitMeasures
    #: ``measured``, ``simulated``: (m,) rate in rad/s or m/s on the run's uniform grid, both through the same filter.
    measured: FloatArray
    simulated: FloatArray
    position: FloatArray  #: (n,) simulated position in rad or m at the trial's instants.
    #: Horizon in s -> RMS position error that long after a restart. A restart has the measured position and rate, and
    #: the states that effects have on the measured trajectory. Restarts are one horizon apart. None if no segment
    #: without a gap is as long.
    position_errors: dict[float, float | None]


def simulate_runs(runs: Sequence[Run], model: Model, vehicle: Vehicle) -> list[TrialSimulation]:
    """Simulate every run with the commands of its trial, and compare it to the measurement."""
    return [_simulate(run, model, vehicle) for run in runs]


def _states_at_start(run: Run, model: Model, vehicle: Vehicle, torque_input: TorqueInput) -> FloatArray:
    """(m * TERM_STATES,) states with which the simulated rate of a ``run`` is nearest to the measured one."""

    def rate(states: FloatArray) -> FloatArray:
        return run.rates.smooth_samples(run.trial, model.simulate(run.trial, torque_input, states)[0])

    return _nearest_states(_unknown_states(run, model, vehicle, torque_input.torque), rate, run.rates.rate)


def _unknown_states(run: Run, model: Model, vehicle: Vehicle, torque: FloatArray) -> FloatArray:
    """(k, m * TERM_STATES) standard deviation of each unknown state at the first sample, one in a row; none at rest."""
    unknown = list[tuple[int, float]]()
    is_known = model.terms.stateful and bool(np.isfinite(run.rates.rate).any())
    if is_known and with_past(run.trial, model.body, vehicle).past is not None:
        rate, size = (math.sqrt(float(np.nanmean(np.square(one)))) for one in (run.rates.rate, torque))
        unknown = [one for one in unknown_states(model.terms, rate, size / model.inertia) if one[1] > 0.0]
    begins = np.zeros((len(unknown), TERM_STATES * len(model.terms.kinds)))
    begins[range(len(unknown)), [at for at, _ in unknown]] = [std for _, std in unknown]
    return begins


def _nearest_states(begins: FloatArray, series: Callable[[FloatArray], FloatArray], wanted: FloatArray) -> FloatArray:
    """(s,) states with which the (n,) ``series`` is nearest to the ``wanted`` one.

    The errors of the series from rest are regressed on what each of the (k, s) ``begins`` changes. The prior of its
    share is the standard normal distribution.
    """
    at_rest = np.zeros(begins.shape[1])
    if not len(begins):
        return at_rest
    from_rest, *others = map(series, (at_rest, *begins))
    known = np.isfinite(wanted) & (np.abs((from_rest, *others)) < _DIVERGED).all(axis=0)
    error, changes = (wanted - from_rest)[known], np.column_stack([(one - from_rest)[known] for one in others])
    best = np.linalg.lstsq(changes, error)[0]
    noise = float(np.sum((error - changes @ best) ** 2)) / max(len(error), 1)
    shares = np.linalg.lstsq(changes.T @ changes + noise * np.eye(len(begins)), changes.T @ error)[0]
    return np.asarray(shares @ begins)


def simulated_rate(run: Run, model: Model, torque_input: TorqueInput) -> FloatArray:
    """(m,) free-running rate, through the same filter as the measured one."""
    return run.rates.smooth_samples(run.trial, *model.simulate_rates([run.trial], torque_input))


def acting_torque(run: Run, model: Model, vehicle: Vehicle) -> FloatArray:
    """(m,) torque in N m of the thrusters and of all terms of effects, along the measured motion, filtered as it is."""
    held = filtered_input(run, model, vehicle)
    return held.torque + terms_along(run, model, vehicle, held)[0]


def filtered_input(run: Run, model: Model, vehicle: Vehicle) -> TorqueInput:
    """(m,) torque input on the grid of the ``run``, through the same filter as the motion."""
    return model.torque_input(vehicle, run.trial).mapped(partial(run.rates.filter_held, run.trial))


def terms_along(
    run: Run,
    model: Model,
    vehicle: Vehicle,
    held: TorqueInput,
    motion: tuple[FloatArray, FloatArray] | None = None,
    stride: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """(m,) torque in N m of all terms along the measured motion of a ``run``, and (s,) their states at its start.

    The states are those that leave the least torque unexplained, as the ``held`` torque input and the acceleration show
    it. ``motion``: (m,) rate and angle since the start of the trial, at each ``stride``-th instant of the grid.
    """
    equation, rates, grid = model.equation_for(run.trial), run.rates, slice(None, None, stride)
    if motion is None:
        angle = rates.position - equation.start
        motion = full_rate(rates.rate, angle, rates.kernel.period), angle
    period, course = stride * rates.kernel.period, (*motion, held.torque[grid])

    def terms(states: FloatArray) -> FloatArray:
        return evaluate_along(equation, period, course, held.effect_inputs[grid], states)[0]

    wanted = model.inertia * rates.acceleration + model.drag(rates.rate) - held.torque
    states = _nearest_states(_unknown_states(run, model, vehicle, held.torque), terms, wanted[grid])
    return terms(states), states


def full_rate(rate: FloatArray, angle: FloatArray, period: float) -> FloatArray:
    """(m,) rate, also at the ends of a trial, where the filter gives none: the water moves there already."""
    return np.where(np.isfinite(rate), rate, np.gradient(angle, period))


def pooled_fit(simulations: Sequence[TrialSimulation]) -> FitMeasures:
    """Agreement over all samples of all trials."""
    measured, simulated = zip(*((item.measured, item.simulated) for item in simulations), strict=True)
    return fit_measures(np.concatenate(measured), np.concatenate(simulated))


def fit_measures(measured: FloatArray, simulated: FloatArray) -> FitMeasures:
    """Agreement of two series at the instants at which both are finite."""
    known = np.isfinite(measured) & np.isfinite(simulated)
    y, error = measured[known], (measured - simulated)[known]
    if not known.any():
        return FitMeasures(samples=0, r2=np.nan, fit_percent=np.nan, rmse=np.nan)
    sse, sst = float(error @ error), float(np.sum((y - y.mean()) ** 2))
    ratio, rmse = sse / sst if sst > 0.0 else np.nan, float(np.sqrt(sse / len(error)))
    fit_percent = 100.0 * (1.0 - float(np.sqrt(ratio)))
    return FitMeasures(samples=int(known.sum()), r2=1.0 - ratio, fit_percent=fit_percent, rmse=rmse)


def _simulate(run: Run, model: Model, vehicle: Vehicle) -> TrialSimulation:
    torque_input = model.torque_input(vehicle, run.trial)
    rate, position = model.simulate(run.trial, torque_input, _states_at_start(run, model, vehicle, torque_input))
    simulated = run.rates.smooth_samples(run.trial, rate)
    return TrialSimulation(
        run=run,
        fit=fit_measures(run.rates.rate, simulated),
        measured=run.rates.rate,
        simulated=simulated,
        position=position,
        position_errors=_position_errors(run, model, vehicle, torque_input),
    )


def _position_errors(run: Run, model: Model, vehicle: Vehicle, torque_input: TorqueInput) -> dict[float, float | None]:
    rates, trial = run.rates, run.trial
    # Angle about the body's own axis: the measured position without the sensor's deviation and the effect of logged
    # tilt.
    true, gain = model.heading_sensor.to_true(trial.position)
    body = trial.body_position - (trial.position - true)
    angle, gain = (resample(trial, values, rates.time) for values in (body, gain))
    at_grid = np.searchsorted(trial.time, rates.time + 1e-9, side="right") - 1
    torque, effect_inputs = torque_input.torque[at_grid], torque_input.effect_inputs[at_grid]
    rate, turned = rates.rate if rates.from_gyro else rates.rate / gain, angle - angle[np.isfinite(angle)][0]
    equation = model.equation_for(trial)
    motion = full_rate(rate, turned, rates.kernel.period), turned
    first = None
    if model.terms.stateful:
        _, first = terms_along(run, model, vehicle, filtered_input(run, model, vehicle), motion)
    _, states = evaluate_along(equation, rates.kernel.period, (*motion, torque), effect_inputs, first)

    def predicted_turn(at: int, end: int) -> float:
        part = slice(at, end + 1)
        held, initial = TorqueInput.held(torque[part], effect_inputs[part]), (float(rate[at]), float(turned[at]))
        _, reached = integrate(equation, rates.time[part], held, initial, states[at])
        return float(reached[-1] - initial[1])

    found: dict[float, float | None] = {}
    for horizon in HORIZONS:
        length = round(horizon / rates.kernel.period)
        errors = []
        for start in range(0, len(rates.time) - length, length):
            known = np.flatnonzero(np.isfinite(rate[start : start + length]))
            # After a gap the filter gives no rate for a while: restart at its first one.
            if not known.size or known[0] > rates.kernel.half_width / rates.kernel.period + 1:
                continue
            at = start + int(known[0])
            end = at + length
            # Neither the turn in a gap is measured, nor perhaps the commands there.
            if end < len(angle) and np.isfinite(angle[at : end + 1]).all():
                errors.append(predicted_turn(at, end) - (angle[end] - angle[at]))
        found[horizon] = float(np.sqrt(np.mean(np.square(errors)))) if errors else None
    return found


@dataclass(frozen=True, kw_only=True)
class SimulationErrors:
    """RMS error of the rate in rad/s or m/s, its R²; horizon in s -> RMS error of the position in rad or m."""

    rate: float
    r2: float
    position: dict[float, float | None]


def simulation_errors(simulations: Sequence[TrialSimulation]) -> SimulationErrors:
    """Errors of all trials together; of the position over the trials that last long enough."""
    fit, position = pooled_fit(simulations), {}
    for horizon in HORIZONS:
        known = [error for item in simulations if (error := item.position_errors.get(horizon)) is not None]
        position[horizon] = float(np.sqrt(np.mean(np.square(known)))) if known else None
    return SimulationErrors(rate=fit.rmse, r2=fit.r2, position=position)
