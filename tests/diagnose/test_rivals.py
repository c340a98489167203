"""Which fits count as causes that there may be."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.diagnose.rivals import is_plausible
from rovid.effects import effect_named
from rovid.identify.fitted import Fitted
from rovid.identify.innovations import InnovationMisfit
from rovid.identify.readings import Readings
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

WAVE = effect_named("wave_torque")
FEW = 500
SLOWEST = 2.0 * np.pi / float(np.ptp(TIME[:FEW]))


@pytest.fixture(scope="module")
def misfit() -> InnovationMisfit:
    runs = [synthetic.run(TIME[:FEW], TORQUE[:FEW], noise=NOISE[:FEW])]
    return InnovationMisfit(Readings(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, (WAVE,))


@pytest.mark.parametrize(("frequency", "plausible"), [(SLOWEST, False), (1.5 * SLOWEST, True)])
def test_a_wave_without_a_cycle_in_any_run_is_none(
    misfit: InnovationMisfit, frequency: float, *, plausible: bool
) -> None:
    coordinates = misfit.coordinates
    x = coordinates.first()
    x[coordinates.before_effects :] = 0.05, frequency, 0.04
    fitted = Fitted.at(misfit, np.clip(x, coordinates.low, coordinates.high))
    assert is_plausible(fitted) is plausible


def test_a_wave_that_is_no_narrow_band_is_none(misfit: InnovationMisfit) -> None:
    coordinates = misfit.coordinates
    x = coordinates.first()
    x[coordinates.before_effects :] = 0.05, 2.0 * SLOWEST, coordinates.high[-1]
    assert not is_plausible(Fitted.at(misfit, x))
