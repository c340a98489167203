"""What the thrusters give, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from tests.tools.motions import free, hiding, move, moved, quiet, torque
from tools.hidden import Hidden
from tools.simulate import MICRO
from tools.truth import ROSUB


def test_slewed_thrust_gives_the_integral_of_its_ramp() -> None:
    rate, end = 0.7, 1.55
    truth = hiding(free(), "slew_limit", "hard", rate=rate)
    time = np.linspace(0.0, 5.0, 500_001)
    thrust = ROSUB.thrusters[0].curve.thrust(np.minimum(rate * time, end))
    exact = cumulative_trapezoid(0.86 * thrust / 5057.0, time, initial=0)
    motion = move(truth, (0.0, end), duration=5.0)
    np.testing.assert_allclose(motion.rate, np.interp(motion.instant / MICRO, time, exact), rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("form", ["first_order", "quadratic"])
def test_lagged_step_is_the_closed_form(form: str) -> None:
    lag = 0.6
    parameters = {"time_constant": lag} | ({"thrust": ROSUB.middle_thrust} if form == "quadratic" else {})
    one = Hidden(effect="thruster_lag", form=form, parameters=parameters)
    motion = move(replace(free(), hidden=(one,)), (0.0, ROSUB.middle), duration=5.0)
    time = motion.instant / MICRO
    # n = tanh(t/2 tau) from rest at the reference thrust; the integral of its square.
    missing = lag * -np.expm1(-time / lag) if form == "first_order" else 2.0 * lag * np.tanh(time / (2.0 * lag))
    np.testing.assert_allclose(motion.rate, ROSUB.middle_torque / 5057.0 * (time - missing), rtol=1e-7, atol=1e-12)


def test_lag_before_the_curve_spends_time_in_the_dead_zone() -> None:
    lag, command = 0.5, 1.5
    motion = move(hiding(free(), "thruster_lag", "command", time_constant=lag), (0.0, command), duration=3.0)
    time = np.linspace(0.0, 3.0, 300_001)
    thrust = ROSUB.thrusters[0].curve.thrust(command * -np.expm1(-time / lag))
    exact = cumulative_trapezoid(0.86 * thrust / 5057.0, time, initial=0)
    np.testing.assert_allclose(motion.rate, np.interp(motion.instant / MICRO, time, exact), rtol=0.0, atol=1e-8)
    starts = -lag * np.log(1.0 - 0.3 / command)
    assert (motion.rate[motion.instant / MICRO < starts] == 0.0).all()


def test_dead_zones_give_no_thrust_and_then_what_they_should() -> None:
    shift = hiding(free(), "thruster_deadband", "shift", deadband=0.15)
    jump = hiding(free(), "thruster_deadband", "jump", deadband=0.15)
    for truth in (shift, jump):
        assert torque(truth, command=0.44) == torque(truth, command=-0.44) == 0.0
    assert torque(shift, command=1.5) == pytest.approx(ROSUB.yaw_torque(1.35))
    assert torque(shift, command=-1.5) == pytest.approx(ROSUB.yaw_torque(-1.35))
    assert torque(jump, command=0.46) == pytest.approx(ROSUB.yaw_torque(0.46))


def test_static_thrust_errors() -> None:
    middle = ROSUB.middle_thrust
    forward, reverse = ROSUB.yaw_torque(1.55), ROSUB.yaw_torque(-1.55)
    weak = hiding(free(), "thrust_asymmetry", "gain", reverse_gain=0.8)
    assert torque(weak, command=1.55) == pytest.approx(forward)
    assert torque(weak, command=-1.55) == pytest.approx(0.8 * reverse)
    growing = hiding(free(), "thrust_asymmetry", "growing", reverse_gain=0.8, thrust=middle)
    assert torque(growing, command=-1.55) == pytest.approx(reverse * (1.0 + 0.2 * reverse / forward))
    power = hiding(free(), "thrust_curve_shape", "power", exponent=0.8, thrust=middle)
    assert torque(power, command=-1.55) == pytest.approx(forward * -((-reverse / forward) ** 0.8))
    soft = hiding(free(), "thrust_curve_shape", "saturating", loss=0.3, thrust=middle)
    assert torque(soft, command=1.55) == pytest.approx(forward)
    assert torque(soft, command=0.8) > ROSUB.yaw_torque(0.8)


def test_one_thruster_is_weak_alone_or_only_beside_the_other() -> None:
    half = ROSUB.middle_torque / 2.0
    for form, alone in (("gain", 0.7), ("interaction", 1.0)):
        one = Hidden(effect="thruster_imbalance", form=form, thruster="aft", parameters={"gain": 0.7})
        truth = replace(free(), hidden=(one,))
        assert torque(truth, command=1.55) == pytest.approx(1.7 * half)
        assert torque(truth, command=1.55, only="aft") == pytest.approx(alone * half)
        assert torque(truth, command=1.55, only="fore") == pytest.approx(half)


def test_sag_with_load_settles_and_with_time_goes_on() -> None:
    total = 2.0 * ROSUB.middle_thrust
    load = hiding(free(), "supply_sag", "load", sag=0.15, time_constant=0.5, thrust=total)
    elapsed = hiding(free(), "supply_sag", "elapsed", drift=0.9)
    full = ROSUB.middle_torque / 5057.0
    motion = move(load, (0.0, 1.55), duration=10.0)
    time = motion.instant / MICRO
    np.testing.assert_allclose(motion.rate, full * (time - 0.15 * (time + 0.5 * np.expm1(-time / 0.5))), atol=1e-9)
    exact = full * (time - 0.9 / 3600.0 * time**2 / 2.0)
    np.testing.assert_allclose(move(elapsed, (0.0, 1.55), duration=10.0).rate, exact, atol=1e-9)


def test_thrust_follows_the_logged_voltage() -> None:
    truth = hiding(free(), "supply_sag", "voltage", exponent=1.1, wander=4.0)
    motion = move(truth, (0.0, 1.55), duration=60.0)
    share = 1.0 + np.asarray(motion.supply) / truth.instruments.supply
    slope = np.gradient(motion.rate, motion.instant / MICRO)[1:-1]
    np.testing.assert_allclose(slope, ROSUB.middle_torque / 5057.0 * share[1:-1] ** 1.1, rtol=1e-4)
    assert np.ptp(share) > 0.02


@pytest.mark.parametrize("form", ["bilinear", "open_water"])
def test_loss_by_advance_speed_is_in_the_steady_balance(form: str) -> None:
    k, arm, thrust = 25.0, 0.43, ROSUB.middle_thrust
    rate = move(hiding(quiet(ROSUB), "advance_speed_loss", form, coefficient=k), (0.0, 1.55), duration=120.0).rate[-1]
    j = k * arm * rate / np.sqrt(thrust)
    minerva = 1.0 + (-0.25 * j - 0.66 * j**2 + 0.50 * j**3) / 0.24
    share = 1.0 - j if form == "bilinear" else minerva
    assert 3532.0 * rate**2 + 132.0 * rate == pytest.approx(2.0 * arm * thrust * share, rel=1e-9)
    assert 0.7 < share < 0.95


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_curve_bent_in_the_command_is_the_same_law_both_ways(way: float) -> None:
    bent = hiding(free(), "thrust_curve_shape", "command", exponent=1.2)
    full = ROSUB.thrusters[0].curve.limit - 0.3
    for share in (0.1, 0.3, 1.0):
        told, acts = 0.3 + share * full, 0.3 + share**1.2 * full
        assert torque(bent, command=way * told) == pytest.approx(ROSUB.yaw_torque(way * acts))
    assert torque(bent, command=way * 0.29) == 0.0


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_thrust_is_lost_to_the_logged_speed(way: float) -> None:
    motion, left, at = moved(hiding(quiet(ROSUB), "advance_speed_loss", "measured", coefficient=2.0), way * 1.55)
    root = np.sqrt(abs(ROSUB.yaw_torque(way * 1.55)) / 0.86)
    np.testing.assert_allclose(left[at], -0.86 * 2.0 * root * motion.channels["surge_velocity"][at], atol=0.1)
