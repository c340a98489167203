"""Free-running simulation against the measurement: how well, per trial and over all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.model.model import Model
from rovid.model.ode import evaluate_along, integrate
from rovid.model.torque_input import TorqueInput
from rovid.signals.preprocessing import Run
from rovid.signals.rates import resample
from rovid.trial.vehicle import Vehicle

HORIZONS = (10.0, 60.0)


@dataclass(frozen=True, kw_only=True)
class FitMeasures:
    """Agreement of simulated with measured rate.

    Attributes
    ----------
    samples
        Instants compared.
    r2
        1 - SSE/SST of the rate; NaN where the measured rate does not vary.
    fit_percent
        100 (1 - |y - yhat| / |y - mean(y)|), Ljung's NRMSE fit.
    rmse
        rad/s.
    """

    samples: int
    r2: float
    fit_percent: float
    rmse: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialSimulation:
    """One trial simulated freely from its first sample.

    Attributes
    ----------
    measured, simulated
        (m,) rate in rad/s or m/s on the run's uniform grid, through the same filter.
    position
        (n,) simulated position in rad or m at the trial's own instants.
    position_errors
        Horizon in s -> RMS position error that far after a restart from the measured position and rate, and from what
        the water did by then on the measured course; restarts one horizon apart; None where no stretch without a gap
        is as long.
    """

    run: Run
    fit: FitMeasures
    measured: FloatArray
    simulated: FloatArray
    position: FloatArray
    position_errors: dict[float, float | None]


def simulate_runs(runs: Sequence[Run], model: Model, vehicle: Vehicle) -> list[TrialSimulation]:
    """Simulate every run and compare; the effects of ``model`` act on the commands of ``vehicle`` too."""
    return [_simulate(run, model, model.torque_input(vehicle, run.trial)) for run in runs]


def simulated_rate(run: Run, model: Model, drive: TorqueInput) -> FloatArray:
    """(m,) rate of the free-running ``model``, behind the filter that the measured one went through."""
    return run.rates.smooth_samples(run.trial, *model.simulate_rates([run.trial], drive))


def pooled_fit(simulations: Sequence[TrialSimulation]) -> FitMeasures:
    """Agreement over all trials together; the mean of SST is that of all samples."""
    return fit_measures(
        np.concatenate([item.measured for item in simulations]),
        np.concatenate([item.simulated for item in simulations]),
    )


def fit_measures(measured: FloatArray, simulated: FloatArray) -> FitMeasures:
    """Agreement of two series, over the instants at which both are known."""
    known = np.isfinite(measured) & np.isfinite(simulated)
    y, error = measured[known], (measured - simulated)[known]
    if not known.any():
        return FitMeasures(samples=0, r2=np.nan, fit_percent=np.nan, rmse=np.nan)
    sse, sst = float(error @ error), float(np.sum((y - y.mean()) ** 2))
    ratio = sse / sst if sst > 0.0 else np.nan
    return FitMeasures(
        samples=int(known.sum()),
        r2=1.0 - ratio,
        fit_percent=100.0 * (1.0 - float(np.sqrt(ratio))),
        rmse=float(np.sqrt(sse / len(error))),
    )


def _simulate(run: Run, model: Model, drive: TorqueInput) -> TrialSimulation:
    rate, position = model.simulate(run.trial, drive)
    simulated = run.rates.smooth_samples(run.trial, rate)
    return TrialSimulation(
        run=run,
        fit=fit_measures(run.rates.rate, simulated),
        measured=run.rates.rate,
        simulated=simulated,
        position=position,
        position_errors=_position_errors(run, model, drive),
    )


def _position_errors(run: Run, model: Model, drive: TorqueInput) -> dict[float, float | None]:
    rates, trial = run.rates, run.trial
    # About the body's own axis: the position itself, but for what a logged tilt and the heading's deviation add to it.
    true, gain = model.heading_sensor.to_true(trial.position)
    body = trial.body_position - (trial.position - true)
    angle, gain = (resample(trial, values, rates.time) for values in (body, gain))
    at_grid = np.searchsorted(trial.time, rates.time + 1e-9, side="right") - 1
    torque, beside = drive.torque[at_grid], drive.effect_inputs[at_grid]
    rate, turned = rates.rate / gain, angle - angle[np.isfinite(angle)][0]
    # The filter has no rate at the ends of a trial, where the water already moves.
    course = np.where(np.isfinite(rate), rate, np.gradient(turned, rates.kernel.period))
    equation = model.equation_for(trial)
    _, states = evaluate_along(equation, rates.kernel.period, (course, turned, torque), beside)

    def turned_by(at: int, end: int) -> float:
        part = slice(at, end + 1)
        held, begin = TorqueInput.held(torque[part], beside[part]), (float(rate[at]), float(turned[at]))
        _, reached = integrate(equation, rates.time[part], held, begin, states[at])
        return float(reached[-1] - begin[1])

    found: dict[float, float | None] = {}
    for horizon in HORIZONS:
        length = round(horizon / rates.kernel.period)
        errors = []
        for start in range(0, len(rates.time) - length, length):
            known = np.flatnonzero(np.isfinite(rate[start : start + length]))
            # Nor has it one behind a gap: restart where it has.
            if not known.size or known[0] > rates.kernel.half_width / rates.kernel.period + 1:
                continue
            at = start + int(known[0])
            end = at + length
            # How far the vehicle turned inside a gap is not measured, nor perhaps what was commanded there.
            if end < len(angle) and np.isfinite(angle[at : end + 1]).all():
                errors.append(turned_by(at, end) - (angle[end] - angle[at]))
        found[horizon] = float(np.sqrt(np.mean(np.square(errors)))) if errors else None
    return found
