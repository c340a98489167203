"""A trial that stands out from the others."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from rovid.diagnose.odd_trial import stands_out
from rovid.diagnose.odds import ESTABLISHED
from rovid.diagnose.rivals import quickly_climbed
from rovid.effects import effect_named
from rovid.identify.horizon_misfit import HorizonMisfit
from rovid.identify.horizons import HorizonRecords
from rovid.identify.readings import Readings
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
    ahead = HorizonRecords.of(Readings(weakened(shares), synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB)
    odd = effect_named("supply_sag:trial run_2")
    misfit = HorizonMisfit(ahead, effects=(odd,))
    begin = misfit.coordinates.first()
    begin[-1] = 0.8
    fitted = quickly_climbed(misfit, begin, 20)
    assert fitted.x[-1] < 0.99
    assert (stands_out(fitted, odd) >= ESTABLISHED) is stands
