"""Every trial simulated without what the diagnosis found, with some of it, and with all of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.threads import thread_map
from rovid.diagnose.cross_validation import split_runs
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.signal_regressors import is_signal
from rovid.effects import Effect
from rovid.model.model import Model
from rovid.model.simulation import HORIZONS, TrialSimulation, pooled_fit, simulate_runs
from rovid.store.study import Study


@dataclass(frozen=True, kw_only=True, eq=False)
class NestedSimulation:
    """A model, and every trial simulated with it."""

    model: Model
    simulations: tuple[TrialSimulation, ...]


def simulate_nested_models(study: Study, diagnosis: Diagnosis) -> tuple[NestedSimulation, ...]:
    """Of the model without what was found, those between, and the one with all of it; a single one where nothing was.

    Trials that were diagnosed in parts, of which each follows a signal by itself, are simulated in these.
    """
    base, extended = diagnosis.base, diagnosis.extended
    if study.runs is None or base is None or extended is None:
        return ()
    runs, models = study.runs, [base.model]
    if extended.model.effects:
        models += [*diagnosis.nested_models, extended.model]
    if any(map(is_signal, extended.model.effects)):
        runs = split_runs(runs.items, study.vehicle, runs.cutoff) or runs

    def simulated(model: Model) -> NestedSimulation:
        return NestedSimulation(model=model, simulations=tuple(simulate_runs(runs.items, model, study.vehicle)))

    return tuple(thread_map(simulated, models))


def effects_of(stages: Sequence[NestedSimulation]) -> tuple[Effect, ...]:
    """What was found and a simulation shows, in the order of the models: what single stages have first."""
    found: dict[str, Effect] = {}
    for stage in stages:
        for effect in stage.model.effects:
            if not effect.is_wave:
                found.setdefault(effect.key, effect)
    return tuple(found.values())


def worst_first(simulations: Sequence[TrialSimulation]) -> list[int]:
    """Which trial has the largest error of the rate, which the next; those without any last."""
    errors = [item.fit.rmse if math.isfinite(item.fit.rmse) else -1.0 for item in simulations]
    return sorted(range(len(errors)), key=lambda number: -errors[number])


@dataclass(frozen=True, kw_only=True)
class SimulationErrors:
    """What a simulation is off by: the rate in rad/s or m/s, and R² of it; horizon in s -> position in rad or m."""

    rate: float
    r2: float
    position: dict[float, float | None]


def simulation_errors(simulations: Sequence[TrialSimulation]) -> SimulationErrors:
    """Of all trials together; positions as root mean squares over those that are long enough."""
    fit, position = pooled_fit(simulations), {}
    for horizon in HORIZONS:
        known = [error for item in simulations if (error := item.position_errors.get(horizon)) is not None]
        position[horizon] = float(np.sqrt(np.mean(np.square(known)))) if known else None
    return SimulationErrors(rate=fit.rmse, r2=fit.r2, position=position)
