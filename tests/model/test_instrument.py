"""What a compass that is off shows, and back."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.model.acting import Acting
from rovid.model.instrument import Instrument
from tests.synthetic import clock

OFF = Instrument((Acting(effect_named("heading_deviation"), np.array([0.08, 0.5])),))
PLAIN = Instrument((Acting(effect_named("bias_torque"), np.array([20.0])),))


def test_what_is_measured_tells_the_true_heading_and_its_slope() -> None:
    time = clock(60.0, 5.0)
    true, rate = 0.15 * time, np.full(len(time), 0.15)
    measured, shown = OFF.as_measured(true, rate)
    assert shown == pytest.approx(np.gradient(measured, time), abs=1e-3 * 0.15)
    found, gain = OFF.as_true(measured)
    assert found == pytest.approx(true, abs=1e-5)
    assert gain == pytest.approx(shown / 0.15, abs=1e-5)


def test_an_instrument_that_shows_the_true_heading_leaves_it() -> None:
    heading, rate = np.linspace(0.0, 9.0, 50), np.linspace(-0.1, 0.2, 50)
    assert not PLAIN.deviates
    assert OFF.deviates
    assert np.array_equal(PLAIN.as_measured(heading, rate), (heading, rate))
    assert np.array_equal(PLAIN.as_true(heading), (heading, np.ones(50)))
    assert not PLAIN.deviation(heading).any()
