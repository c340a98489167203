"""Further logged signals, and what follows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tools.motions import free, move, plain_drag, quiet, strong
from tests.tools.test_simulate import excited
from tools.channels import EXTRA
from tools.hidden import DRIVERS, OUTSIDE
from tools.simulate import MICRO
from tools.truth import ROSUB, Attitude


@pytest.mark.parametrize("form", ["manipulator", "tension", "surge", "pitch"])
def test_outside_torque_is_that_of_the_logged_signal(form: str) -> None:
    truth = replace(strong(ROSUB, OUTSIDE, form).of(free()), attitude=Attitude(roll=0.0, pitch=0.0))
    (one,) = truth.hidden
    motion = move(truth, (0.0, 0.0), duration=200.0)
    signal = motion.pitch if form == "pitch" else motion.channels[DRIVERS[form]]
    deviation = {"manipulator": np.radians(signal), "tension": signal - 120.0}.get(form, signal)
    got = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO)
    error = got - one.parameters[one.law.size] * deviation
    assert np.quantile(np.abs(error), 0.97) < 0.01 * np.std(got)  # the manipulator starts and stops inside samples
    assert np.std(got) > 5.0


@pytest.mark.parametrize("form", ["depth_drag", "supply_drag"])
def test_outside_drag_follows_the_logged_signal(form: str) -> None:
    truth = strong(ROSUB, OUTSIDE, form).of(quiet(ROSUB))
    gain = truth.hidden[0].parameters["gain"]
    motion = move(truth, (0.0, 1.55), duration=300.0)
    deviation = motion.channels["depth"] - 4.0 if form == "depth_drag" else np.asarray(motion.supply)
    late = slice(400, -2)
    inertia = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO)
    plain = np.array([plain_drag(rate) for rate in motion.rate])
    balance = (ROSUB.middle_torque - inertia)[late] / plain[late]
    np.testing.assert_allclose(balance, 1.0 + gain * deviation[late], atol=1e-3)
    assert np.ptp(balance) > 0.2


def test_a_decoy_channel_changes_no_other_signal() -> None:
    case = strong(ROSUB, OUTSIDE, "surge")
    alone, beside = (excited(replace(ROSUB, hidden=case.hidden, channels=names)) for names in ((), EXTRA))
    assert set(alone.channels) == {"surge_speed"}
    assert set(beside.channels) == set(EXTRA)
    assert (alone.heading == beside.heading).all()
