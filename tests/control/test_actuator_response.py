"""Sines through the actuators."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.control.actuator_response import ActuatorProbe
from rovid.control.allocation import allocate
from rovid.core.errors import DataError
from tests.control.loops import PAPER, VEHICLE, with_effect


def test_no_sine_is_sent_where_thrusters_turn_one_way() -> None:
    model = with_effect("thruster_lag", 1.0)
    probes = ActuatorProbe(vehicle=VEHICLE, parts=1, allocation=allocate(VEHICLE, PAPER), period=0.1, amplitude=0.0)
    assert np.all(probes.frequency_response(PAPER)[1] == 1.0)
    with pytest.raises(DataError, match="one way only"):
        probes.frequency_response(model)
