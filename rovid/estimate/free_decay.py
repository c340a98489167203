"""Period, damping ratios and ratios to the inertia of free decays, as a roll-decay test reports them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.estimate.estimate import Estimate
from rovid.model.model import Model
from rovid.signals.preprocessing import Run
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Samples in each period of a simulated swing, and number of simulated periods.
_SAMPLES, _PERIODS = 400, 2
# Difference step for error propagation, as a share of a parameter's standard error.
_STEP = 0.01


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number with its standard error and unit."""

    value: float
    standard_error: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class FreeSwing:
    """One full swing that begins at rest at ``amplitude`` rad from the level."""

    name: str  #: The trial with this as its largest swing; empty for the RMS swing of all trials.
    amplitude: float
    natural_period: Quantity  #: Undamped natural period, s.
    damping_ratio: Quantity  #: Of the linear system with the same decrement.


@dataclass(frozen=True, kw_only=True)
class FreeDecay:
    """Results of a free-decay test."""

    rms_swing: FreeSwing  #: The swing with the amplitude of the RMS tilt.
    swings: tuple[FreeSwing, ...]  #: The largest swing of each trial, at the speeds of that trial.
    natural_frequency: Quantity  #: rad/s, of ``rms_swing``.
    #: Damping ratio by the linear drag alone, and the addition by the quadratic drag per rad of amplitude.
    terms: Mapping[str, Quantity]
    over_inertia: Mapping[str, Quantity]  #: Restoring stiffness, linear and quadratic drag over the inertia.


def analyse_free_decay(model: Model, estimate: Estimate, runs: Sequence[Run], vehicle: Vehicle) -> FreeDecay:
    """Free-decay results of ``model``, with the ``estimate`` of its parameters, at the amplitudes of ``runs``."""
    level = model.restoring_values[1]
    tilts = [run.trial.position[run.trial.measured] - level for run in runs]
    rms_amplitude = math.sqrt(2.0 * float(np.mean(np.concatenate(tilts) ** 2)))

    def quantity(formula: Callable[[Model], float], unit: str) -> Quantity:
        return Quantity(value=formula(model), standard_error=_standard_error(formula, model, estimate), unit=unit)

    def swing(name: str, amplitude: float, reference: Mapping[str, float]) -> FreeSwing:
        def simulate(changed: Model) -> tuple[float, float]:
            return _period_and_damping(changed, vehicle, amplitude, reference)

        period, damping = quantity(lambda m: simulate(m)[0], "s"), quantity(lambda m: simulate(m)[1], "1")
        return FreeSwing(name=name, amplitude=amplitude, natural_period=period, damping_ratio=damping)

    rms_swing = swing("", rms_amplitude, runs[0].trial.reference)
    period = rms_swing.natural_period
    frequency = 2.0 * math.pi / period.value
    error = period.standard_error / period.value * frequency
    swings = []
    for run, tilt in zip(runs, tilts, strict=True):
        swings.append(swing(run.trial.name, float(np.max(np.abs(tilt))), _median_channels(run.trial)))
    return FreeDecay(
        rms_swing=rms_swing,
        swings=tuple(swings),
        natural_frequency=Quantity(value=frequency, standard_error=error, unit="rad/s"),
        terms={
            "linear": quantity(lambda m: m.linear_drag / (2.0 * math.sqrt(m.stiffness * m.inertia)), "1"),
            # 8/(3 pi) of frequency times amplitude is the equivalent linear drag in a sine.
            "quadratic": quantity(lambda m: 4.0 / (3.0 * math.pi) * m.quadratic_drag / m.inertia, "1/rad"),
        },
        over_inertia={
            "restoring_stiffness": quantity(lambda m: m.stiffness / m.inertia, "1/s^2"),
            "linear_drag": quantity(lambda m: m.linear_drag / m.inertia, "1/s"),
            "quadratic_drag": quantity(lambda m: m.quadratic_drag / m.inertia, "1/rad"),
        },
    )


def _median_channels(trial: Trial) -> dict[str, float]:
    """Median of each extra channel of ``trial``."""
    known = {name: values[np.isfinite(values)] for name, values in trial.extras.items()}
    return {name: float(np.median(values)) for name, values in known.items() if values.size}


def _standard_error(formula: Callable[[Model], float], model: Model, estimate: Estimate) -> float:
    """Standard error of a function of the model, by first-order propagation of the estimate's covariance."""
    values, errors = model.values, np.sqrt(np.diag(estimate.covariance))
    value, slopes = formula(model), np.zeros(len(values))
    for at in np.flatnonzero(errors > 0.0):
        step = np.where(np.arange(len(values)) == at, _STEP * errors, 0.0)
        moved = Model.from_values(values + step, model.axis, model.effects)
        slopes[at] = (formula(moved) - value) / step[at]
    return math.sqrt(float(slopes @ estimate.covariance @ slopes))


def _period_and_damping(
    model: Model, vehicle: Vehicle, amplitude: float, reference: Mapping[str, float]
) -> tuple[float, float]:
    """Natural period in s and damping ratio of a swing from ``amplitude``; NaN where the vehicle does not return."""
    time = np.linspace(0.0, _PERIODS * 2.0 * math.pi / model.natural_frequency, _PERIODS * _SAMPLES + 1)
    still = Trial.from_commands(time, np.zeros((len(time), len(vehicle.thrusters))), reference=reference)
    level = model.restoring_values[1]
    trial = replace(still, axis=model.axis, position=np.full(len(time), level + amplitude))
    rate, tilt = model.simulate(trial, model.torque_input(vehicle, trial))
    turns = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0))
    if not turns.size:
        return math.nan, math.nan
    # The rate is interpolated linearly to its zero.
    k = turns[0]
    share = rate[k] / (rate[k] - rate[k + 1])
    next_peak = float(tilt[k] + share * (tilt[k + 1] - tilt[k])) - level
    decrement = math.log(amplitude / next_peak)
    damping = decrement / math.hypot(2.0 * math.pi, decrement)
    period = float(time[k] + share * (time[k + 1] - time[k]))
    return period * math.sqrt(1.0 - damping**2), damping
