"""A long noisy run in memory, and what is predicted along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.trial.preprocessing import Run
from tests import synthetic

TIME = synthetic.clock(1500.0, rate=5.0)
RNG = np.random.default_rng(0)
TORQUE = np.repeat(RNG.choice([-300.0, -120.0, 0.0, 120.0, 300.0], 60), 125)[: len(TIME)]
TORQUE = np.append(TORQUE, np.zeros(max(len(TIME) - len(TORQUE), 0)))
NOISE = 1e-4 * RNG.normal(size=len(TIME))
BIAS = effect_named("bias_torque")
WITH_BIAS = replace(synthetic.ROSUB, effects=(BIAS,), effect_values=(12.0,))


def records(torque: FloatArray = TORQUE, disturbance: FloatArray | None = None, runs: int = 1) -> MultiStepData:
    made = [synthetic.run(TIME, torque, disturbance=disturbance, noise=NOISE) for _ in range(runs)]
    whole = InnovationData(made, synthetic.LOGGED, synthetic.ROSUB)
    return MultiStepData.from_data(whole, synthetic.ROSUB)


def biased() -> MultiStepData:
    """With as many predictions as count once the constant torque is known."""
    return records(disturbance=np.full(len(TIME), 12.0)).reweighted(WITH_BIAS)


def weakened(shares: Sequence[float]) -> list[Run]:
    """As many runs of a minute, each with its share of the thrust gone."""
    runs = [
        synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600], disturbance=-share * TORQUE[:600])
        for share in shares
    ]
    return [replace(run, trial=replace(run.trial, name=f"run_{number}")) for number, run in enumerate(runs)]


def near_of(ahead: MultiStepData) -> InnovationData:
    return InnovationData(ahead.runs, ahead.vehicle, ahead.initial_model)


def fitted(key: str, ahead: MultiStepData) -> tuple[FitResult, FitResult]:
    """Multi-step fit of a model with an effect, and one-step fit of the model without."""
    effect = effect_named(key)
    misfit, near = MultiStepLikelihood(ahead, effects=(effect,)), InnovationLikelihood(near_of(ahead), 1.0)
    first = near.parametrization.initial()
    begin = np.concatenate((first, effect.initial_values[0]))
    return fit(misfit, begin), fit(near, first)


def fitted_ahead(runs: list[Run]) -> FitResult:
    misfit = MultiStepLikelihood(
        MultiStepData.from_data(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    )
    return fit(misfit, misfit.parametrization.initial())
