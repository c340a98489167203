"""A long noisy run in memory, and what is predicted along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.estimate.filter_data import Readings
from rovid.estimate.fit_result import Fitted, climbed
from rovid.estimate.innovation_likelihood import InnovationMisfit
from rovid.estimate.multi_step_data import HorizonRecords
from rovid.estimate.multi_step_likelihood import HorizonMisfit
from rovid.signals.preprocessing import Run
from tests import synthetic

TIME = synthetic.clock(1500.0, rate=5.0)
RNG = np.random.default_rng(0)
TORQUE = np.repeat(RNG.choice([-300.0, -120.0, 0.0, 120.0, 300.0], 60), 125)[: len(TIME)]
TORQUE = np.append(TORQUE, np.zeros(max(len(TIME) - len(TORQUE), 0)))
NOISE = 1e-4 * RNG.normal(size=len(TIME))
BIAS = effect_named("bias_torque")
WITH_BIAS = replace(synthetic.ROSUB, effects=(BIAS,), effect_values=(12.0,))


def records(torque: FloatArray = TORQUE, disturbance: FloatArray | None = None, runs: int = 1) -> HorizonRecords:
    made = [synthetic.run(TIME, torque, disturbance=disturbance, noise=NOISE) for _ in range(runs)]
    whole = Readings(made, synthetic.LOGGED, synthetic.ROSUB)
    return HorizonRecords.of(whole, synthetic.ROSUB)


def biased() -> HorizonRecords:
    """With as many predictions as count once the constant torque is known."""
    return records(disturbance=np.full(len(TIME), 12.0)).counting(WITH_BIAS)


def weakened(shares: Sequence[float]) -> list[Run]:
    """As many runs of a minute, each with its share of the thrust gone."""
    runs = [
        synthetic.run(TIME[:600], TORQUE[:600], noise=NOISE[:600], disturbance=-share * TORQUE[:600])
        for share in shares
    ]
    return [replace(run, trial=replace(run.trial, name=f"run_{number}")) for number, run in enumerate(runs)]


def near_of(ahead: HorizonRecords) -> Readings:
    return Readings(ahead.runs, ahead.vehicle, ahead.start)


def fitted(key: str, ahead: HorizonRecords) -> tuple[Fitted, Fitted]:
    """A model with an effect by predictions, and one without any by each next reading."""
    effect = effect_named(key)
    misfit, near = HorizonMisfit(ahead, effects=(effect,)), InnovationMisfit(near_of(ahead), 1.0)
    first = near.coordinates.first()
    begin = np.concatenate((first, effect.starts[0]))
    return climbed(misfit, begin), climbed(near, first)


def fitted_ahead(runs: list[Run]) -> Fitted:
    misfit = HorizonMisfit(HorizonRecords.of(Readings(runs, synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB))
    return climbed(misfit, misfit.coordinates.first())
