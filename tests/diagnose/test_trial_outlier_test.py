"""A trial that stands out from the others."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from rovid.diagnose.bic import fit_coarse
from rovid.diagnose.posterior import ESTABLISHED
from rovid.diagnose.trial_outlier_test import outlier_probability
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.multi_step_data import MultiStepData
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from tests import synthetic
from tests.predictions import weakened


@pytest.mark.parametrize(
    ("shares", "stands"),
    [
        ((0.0, 0.0, 0.4, 0.0), True),
        ((0.0, 0.01, 0.4, -0.01, 0.0), True),
        # No more than others differ by, or than any battery does.
        ((0.2, -0.2, 0.4, 0.0), False),
        ((0.0, 0.0, 0.05, 0.0), False),
        # One of three.
        ((0.0, 0.0, 0.15), False),
    ],
)
def test_a_trial_has_to_stand_out_from_the_others(shares: Sequence[float], stands: bool) -> None:
    ahead = MultiStepData.from_data(
        InnovationData(weakened(shares), synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB
    )
    odd = effect_named("supply_sag:trial run_2")
    misfit = MultiStepLikelihood(ahead, effects=(odd,))
    begin = misfit.parametrization.initial()
    begin[-1] = 0.8
    fitted = fit_coarse(misfit, begin, 20)
    assert fitted.x[-1] < 0.99
    assert (outlier_probability(fitted, odd) >= ESTABLISHED) is stands
