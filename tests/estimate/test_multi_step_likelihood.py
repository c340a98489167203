"""The misfit of predictions some time ahead."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.dataset import ANGLE_NOISE_FLOOR
from rovid.estimate.fit_result import fit
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from tests.predictions import BIAS, biased, records


def test_a_constant_torque_is_found_with_its_size() -> None:
    ahead = biased()
    misfit = MultiStepLikelihood(ahead)
    plain = fit(misfit, misfit.parametrization.initial())
    with_bias = fit(misfit.with_effects((BIAS,)), np.concatenate((plain.x, [0.01])))
    assert plain.value - with_bias.value > 20.0
    assert with_bias.model.effect_values[0] == pytest.approx(12.0, rel=0.03)


def test_a_prediction_that_is_met_exactly_is_met_by_chance() -> None:
    """Else the likelihood of a horizon with one alone would have no bounds, and rounding would tell the best model."""
    ahead = records()
    alone = np.arange(len(ahead.horizon)) == 5
    misfit = MultiStepLikelihood(ahead, mask=alone)
    best = fit(misfit, misfit.parametrization.initial())
    error, variance = misfit.innovations(best.x)
    least = 2.0 * ANGLE_NOISE_FLOOR**2
    assert np.abs(error).max() < np.sqrt(least)
    assert variance.tolist() == pytest.approx([least])
    (held_out,) = misfit.held_out_values([misfit], [best.x])
    assert held_out == pytest.approx(best.value)
