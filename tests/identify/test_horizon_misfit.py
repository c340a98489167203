"""The misfit of predictions some time ahead."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.identify.fitted import climbed
from rovid.identify.horizon_misfit import HorizonMisfit
from tests.predictions import BIAS, biased


def test_a_constant_torque_is_found_with_its_size() -> None:
    ahead = biased()
    misfit = HorizonMisfit(ahead)
    plain = climbed(misfit, misfit.coordinates.first())
    with_bias = climbed(misfit.like((BIAS,)), np.concatenate((plain.x, [0.01])))
    assert plain.cost - with_bias.cost > 20.0
    assert with_bias.model.effect_values[0] == pytest.approx(12.0, rel=0.03)
