"""The innovation likelihood: its optimum, evaluation of several models together, the limit of the disturbance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.levenberg_marquardt import TOLERANCE, StopReason, minimize
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS
from rovid.estimate.output_error import fit_output_error
from rovid.estimate.parametrization import DISTURBANCE, INERTIA
from rovid.store.study import open_study
from tests import synthetic
from tests.estimate.test_maximum_likelihood import advanced_commands, write_short_day
from tests.predictions import NOISE, TIME, TORQUE


def test_the_fit_of_an_incomplete_model_converges(tmp_path: Path) -> None:
    write_short_day(tmp_path / "day")
    advanced_commands(tmp_path / "day", 32)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    objective = InnovationLikelihood(
        InnovationData(runs.items, None, fit_output_error(runs.items)), DISTURBANCE_LIMITS[-2]
    )
    first = objective.parametrization.initial()
    soon, late = minimize(objective, first, iterations=25), minimize(objective, first, iterations=300, tolerance=1e-6)
    # By scoring alone it would still be thousands away.
    assert soon.value - late.value < 1.0
    begun = minimize(objective, first, iterations=1)
    assert minimize(objective, late.x).stop_reason is StopReason.CONVERGED
    assert begun.stop_reason is StopReason.MAX_ITERATIONS
    # The remaining gain is large after one step and below the tolerance at the end.
    assert begun.remaining_gain > begun.value - late.value
    assert soon.remaining_gain <= TOLERANCE


def test_objectives_evaluated_together_equal_each_alone() -> None:
    """Of waves, of water that rings, of terms with states and of none, in whatever order."""
    data = InnovationData([synthetic.run(TIME, TORQUE, noise=NOISE)], synthetic.LOGGED, synthetic.ROSUB)
    names = ("wave_torque", "tank_seiche", "bias_torque", "added_mass_memory", "thruster_lag", "wave_torque")
    objectives = [InnovationLikelihood(data, DISTURBANCE_LIMITS[0], (effect_named(name),)) for name in names]
    pairs = [(objective, objective.parametrization.initial()) for objective in objectives]
    for (objective, x), together in zip(pairs, InnovationLikelihood.evaluate_each(pairs), strict=True):
        alone = objective.innovations(x)
        scatter = np.sqrt(alone.variance)
        # All lanes take the integration steps of the lane that needs most.
        assert np.max(np.abs(together.error - alone.error) / scatter) < 1e-3
        assert np.max(np.abs(np.sqrt(together.variance) / scatter - 1.0)) < 1e-3


@pytest.mark.parametrize(("limit", "missed", "at_limit"), [(0.01, 0.5, True), (0.01, 0.0, False), (1e-7, 0.0, False)])
def test_a_disturbance_is_at_its_limit_where_half_of_it_is_less_likely(
    limit: float, missed: float, *, at_limit: bool
) -> None:
    """A limit is inactive for a complete model, and for a disturbance too small to show in any reading."""
    data = InnovationData([synthetic.run(TIME, TORQUE, noise=NOISE)], synthetic.LOGGED, synthetic.ROSUB)
    objective = InnovationLikelihood(data, limit)
    x = objective.parametrization.initial()
    x[INERTIA] += missed
    x[DISTURBANCE] = objective.parametrization.high[DISTURBANCE]
    half = x.copy()
    half[DISTURBANCE] -= np.log(2.0)
    assert objective.at_limit(x) is at_limit
    assert not objective.at_limit(half)


@pytest.mark.parametrize(("share", "at_limit"), [(0.9, False), (1.0, False), (2.5, True)])
def test_a_disturbance_as_large_as_the_limit_is_not_limited(share: float, *, at_limit: bool) -> None:
    """A complete model, and a disturbance of that share of the limit: only one that exceeds it counts."""
    time = synthetic.clock(600.0, 5.0)
    torque = 250.0 * np.sin(time / 9.0) + 150.0 * np.sign(np.sin(time / 31.0))
    limit = 0.05
    size = share * limit * float(np.sqrt(np.mean(torque**2)))
    water = synthetic.gauss_markov(len(time), 0.2, size, 2.0, np.random.default_rng(4))
    noise = np.random.default_rng(5).normal(0.0, 3e-4, len(time))
    runs = [synthetic.run(time, torque, disturbance=water, noise=noise)]
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), limit)
    fitted = fit(objective, objective.parametrization.initial())
    assert fitted.is_white or at_limit
    assert fitted.at_limit is at_limit
