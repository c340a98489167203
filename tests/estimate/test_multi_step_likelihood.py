"""The misfit of predictions some time ahead."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.dataset import ANGLE_NOISE_FLOOR
from rovid.estimate.fit_result import climbed
from rovid.estimate.multi_step_likelihood import HorizonMisfit
from tests.predictions import BIAS, biased, records


def test_a_constant_torque_is_found_with_its_size() -> None:
    ahead = biased()
    misfit = HorizonMisfit(ahead)
    plain = climbed(misfit, misfit.coordinates.first())
    with_bias = climbed(misfit.like((BIAS,)), np.concatenate((plain.x, [0.01])))
    assert plain.cost - with_bias.cost > 20.0
    assert with_bias.model.effect_values[0] == pytest.approx(12.0, rel=0.03)


def test_a_prediction_that_is_met_exactly_is_met_by_chance() -> None:
    """Else the likelihood of a horizon with one alone would have no bounds, and rounding would tell the best model."""
    ahead = records()
    alone = np.arange(len(ahead.horizon)) == 5
    misfit = HorizonMisfit(ahead, counted=alone)
    best = climbed(misfit, misfit.coordinates.first())
    error, variance = misfit.innovations(best.x)
    least = 2.0 * ANGLE_NOISE_FLOOR**2
    assert np.abs(error).max() < np.sqrt(least)
    assert variance.tolist() == pytest.approx([least])
    (held_out,) = misfit.held_out_costs([misfit], [best.x])
    assert held_out == pytest.approx(best.cost)
