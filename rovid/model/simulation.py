"""Free-running simulation of trials, compared to the measurement."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.model.model import Model
from rovid.model.ode import evaluate_along, integrate
from rovid.model.torque_input import TorqueInput
from rovid.trial.preprocessing import Run
from rovid.trial.rates import resample
from rovid.trial.vehicle import Vehicle

# s; horizons of the position errors.
HORIZONS = (10.0, 60.0)


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
    return [_simulate(run, model, model.torque_input(vehicle, run.trial)) for run in runs]


def simulated_rate(run: Run, model: Model, torque_input: TorqueInput) -> FloatArray:
    """(m,) free-running rate, through the same filter as the measured one."""
    return run.rates.smooth_samples(run.trial, *model.simulate_rates([run.trial], torque_input))


def acting_torque(run: Run, model: Model, vehicle: Vehicle) -> FloatArray:
    """(m,) torque in N m of the thrusters and of all terms of effects, along the measured motion, filtered as it is."""
    held = model.torque_input(vehicle, run.trial).mapped(partial(run.rates.filter_held, run.trial))
    equation, rates = model.equation_for(run.trial), run.rates
    motion = (rates.rate, rates.position - equation.start, held.torque)
    return held.torque + evaluate_along(equation, rates.kernel.period, motion, held.effect_inputs)[0]


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


def _simulate(run: Run, model: Model, torque_input: TorqueInput) -> TrialSimulation:
    rate, position = model.simulate(run.trial, torque_input)
    simulated = run.rates.smooth_samples(run.trial, rate)
    return TrialSimulation(
        run=run,
        fit=fit_measures(run.rates.rate, simulated),
        measured=run.rates.rate,
        simulated=simulated,
        position=position,
        position_errors=_position_errors(run, model, torque_input),
    )


def _position_errors(run: Run, model: Model, torque_input: TorqueInput) -> dict[float, float | None]:
    rates, trial = run.rates, run.trial
    # Angle about the body's own axis: the measured position without the sensor's deviation and the effect of logged
    # tilt.
    true, gain = model.heading_sensor.to_true(trial.position)
    body = trial.body_position - (trial.position - true)
    angle, gain = (resample(trial, values, rates.time) for values in (body, gain))
    at_grid = np.searchsorted(trial.time, rates.time + 1e-9, side="right") - 1
    torque, effect_inputs = torque_input.torque[at_grid], torque_input.effect_inputs[at_grid]
    rate, turned = rates.rate if rates.from_gyro else rates.rate / gain, angle - angle[np.isfinite(angle)][0]
    # The filter gives no rate at the ends of a trial. The water moves there already.
    full_rate = np.where(np.isfinite(rate), rate, np.gradient(turned, rates.kernel.period))
    equation = model.equation_for(trial)
    _, states = evaluate_along(equation, rates.kernel.period, (full_rate, turned, torque), effect_inputs)

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
