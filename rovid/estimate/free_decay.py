"""Free decays, as a roll-decay test reports them: period, damping ratios, and the ratios to the inertia."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.estimate.estimate import Estimate
from rovid.model.model import Model
from rovid.signals.preprocessing import Run
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Samples in each period of a simulated swing, and how many periods until it must have come back.
_SAMPLES, _PERIODS = 400, 2
# Of a parameter's standard error, for the slopes of what follows from it.
_NUDGE = 0.01


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number with its standard error and unit."""

    value: float
    standard_error: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class FreeSwing:
    """One swing to and fro that begins at rest at ``amplitude`` rad from the level.

    Attributes
    ----------
    name
        Of the trial whose largest swing this is; empty for the usual swing of all of them.
    natural_period
        s, of the undamped one.
    damping_ratio
        Of the linear system that loses as much in it.
    """

    name: str
    amplitude: float
    natural_period: Quantity
    damping_ratio: Quantity


@dataclass(frozen=True, kw_only=True)
class FreeDecay:
    """What decays tell.

    Attributes
    ----------
    usual
        The swing of the root mean square tilt.
    swings
        The largest of each trial, at the speeds of that trial.
    natural_frequency
        rad/s, of the usual swing.
    terms
        Damping ratio of the linear drag alone, and what the quadratic one adds for each rad of the amplitude.
    over_inertia
        Restoring stiffness, linear and quadratic drag over the inertia.
    """

    rms_swing: FreeSwing
    swings: tuple[FreeSwing, ...]
    natural_frequency: Quantity
    terms: Mapping[str, Quantity]
    over_inertia: Mapping[str, Quantity]


def analyse_free_decay(model: Model, estimate: Estimate, runs: Sequence[Run], vehicle: Vehicle) -> FreeDecay:
    """What ``model``, whose parameters are ``estimate``'s, makes of the swings of ``runs``."""
    level = model.restoring_values[1]
    tilts = [run.trial.position[run.trial.measured] - level for run in runs]
    spread = math.sqrt(2.0 * float(np.mean(np.concatenate(tilts) ** 2)))

    def swing(name: str, amplitude: float, reference: Mapping[str, float]) -> FreeSwing:
        def period(changed: Model) -> float:
            return _swung(changed, vehicle, amplitude, reference)[0]

        def damping(changed: Model) -> float:
            return _swung(changed, vehicle, amplitude, reference)[1]

        return FreeSwing(
            name=name,
            amplitude=amplitude,
            natural_period=_reading(period, model, estimate, "s"),
            damping_ratio=_reading(damping, model, estimate, "1"),
        )

    usual = swing("", spread, runs[0].trial.reference)
    frequency = 2.0 * math.pi / usual.natural_period.value
    share = usual.natural_period.standard_error / usual.natural_period.value
    formulas: Mapping[str, tuple[Callable[[Model], float], str]] = {
        "linear": (lambda m: m.linear_drag / (2.0 * math.sqrt(m.stiffness * m.inertia)), "1"),
        # 8/(3 pi) of frequency times amplitude is the linear drag that takes as much from a sine.
        "quadratic": (lambda m: 4.0 / (3.0 * math.pi) * m.quadratic_drag / m.inertia, "1/rad"),
        "restoring_stiffness": (lambda m: m.stiffness / m.inertia, "1/s^2"),
        "linear_drag": (lambda m: m.linear_drag / m.inertia, "1/s"),
        "quadratic_drag": (lambda m: m.quadratic_drag / m.inertia, "1/rad"),
    }
    readings = {name: _reading(formula, model, estimate, unit) for name, (formula, unit) in formulas.items()}
    swings = []
    for run, tilt in zip(runs, tilts, strict=True):
        largest = float(np.max(np.abs(tilt)))
        swings.append(swing(run.trial.name, largest, _channels(run.trial)))
    return FreeDecay(
        rms_swing=usual,
        swings=tuple(swings),
        natural_frequency=Quantity(value=frequency, standard_error=share * frequency, unit="rad/s"),
        terms={name: readings[name] for name in ("linear", "quadratic")},
        over_inertia={name: readings[name] for name in ("restoring_stiffness", "linear_drag", "quadratic_drag")},
    )


def _channels(trial: Trial) -> dict[str, float]:
    """Median of each further channel of ``trial``."""
    medians = {}
    for name, values in trial.extras.items():
        known = values[np.isfinite(values)]
        if known.size:
            medians[name] = float(median(known.tolist()))
    return medians


def _reading(quantity: Callable[[Model], float], model: Model, estimate: Estimate, unit: str) -> Quantity:
    """``quantity`` of the model, with the standard error that the estimate's covariance makes of it."""
    values, spread = model.values, np.sqrt(np.diag(estimate.covariance))
    value, slopes = quantity(model), np.zeros(len(values))
    for at in np.flatnonzero(spread > 0.0):
        nudge = np.where(np.arange(len(values)) == at, _NUDGE * spread, 0.0)
        nudged = quantity(_with(model, values + nudge))
        slopes[at] = (nudged - value) / nudge[at]
    variance = float(slopes @ estimate.covariance @ slopes)
    return Quantity(value=value, standard_error=math.sqrt(variance), unit=unit)


def _with(model: Model, values: FloatArray) -> Model:
    """``model`` with the (p,) ``values`` of inertia, drag, restoring torque and effects."""
    inertia, quadratic, linear, *others = (float(value) for value in values)
    own = len(model.restoring_values)
    return replace(
        model,
        inertia=inertia,
        quadratic_drag=quadratic,
        linear_drag=linear,
        restoring_values=tuple(others[:own]),
        effect_values=tuple(others[own:]),
    )


def _swung(model: Model, vehicle: Vehicle, amplitude: float, reference: Mapping[str, float]) -> tuple[float, float]:
    """Natural period in s and damping ratio of a swing from ``amplitude``; NaN where it does not come back."""
    time = np.linspace(0.0, _PERIODS * 2.0 * math.pi / model.natural_frequency, _PERIODS * _SAMPLES + 1)
    still = Trial.from_commands(time, np.zeros((len(time), len(vehicle.thrusters))), reference=reference)
    level = model.restoring_values[1]
    trial = replace(still, axis=model.axis, position=np.full(len(time), level + amplitude))
    rate, tilt = model.simulate(trial, model.torque_input(vehicle, trial))
    turns = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0))
    if not turns.size:
        return math.nan, math.nan
    # Between two samples the rate is taken to change evenly.
    k = turns[0]
    share = rate[k] / (rate[k] - rate[k + 1])
    back = float(tilt[k] + share * (tilt[k + 1] - tilt[k])) - level
    decrement = math.log(amplitude / back)
    damping = decrement / math.hypot(2.0 * math.pi, decrement)
    period = float(time[k] + share * (time[k + 1] - time[k]))
    return period * math.sqrt(1.0 - damping**2), damping
