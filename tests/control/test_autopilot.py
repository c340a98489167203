"""Gains of autopilots in a loop that follows their sources line by line: margins hold, and the trim stops the drift."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.control.actuators import AUTOPILOTS, AutopilotLaw, autopilot_loop, autopilot_parameters, default_gains
from rovid.control.control_law import LoopConditions
from rovid.control.tuning import Margins
from rovid.core.array_types import FloatArray
from rovid.export.interface import ExportInput
from rovid.export.thruster_curves import constant_trim
from rovid.model.model import Model
from rovid.store.parameter_file import Entry
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.control.loops import PAPER, VEHICLE, with_effect

LINEAR = ThrustCurve(command=np.array([1100.0, 1500.0, 1900.0]), thrust=np.array([-300.0, 0.0, 300.0]))
EVEN = Vehicle(
    name="even", thrusters=(Thruster(name="bow", arm=0.5, curve=LINEAR), Thruster(name="stern", arm=-0.3, curve=LINEAR))
)
LAG, DELAY = 0.4, 0.3
ROVER = {
    "ATC_STR_ANG_P": "ATC_ANG_YAW_P",
    **{f"ATC_STR_RAT_{key}": f"ATC_RAT_YAW_{key}" for key in ("P", "I", "D", "FF", "IMAX", "FLTT", "FLTE", "FLTD")},
}


class Loop:
    """ArduPilot's AC_P and AC_PID::update_all with get_ff, or PX4's control_attitude_geo, with their parameters."""

    def __init__(self, name: str, parameters: dict[str, float]) -> None:
        self.period, self.px4 = AUTOPILOTS[name].period, name == "px4"
        self.values = {ROVER.get(key, key): value for key, value in parameters.items()}
        self.target = self.error = self.derivative = self.integrator = 0.0

    def output(self, error: float, gyro: float) -> float:
        p, dt = self.values, self.period
        if self.px4:
            return p["UUV_YAW_P"] * math.sin(error) - p["UUV_YAW_D"] * gyro

        def alpha(hertz: float) -> float:
            return dt / (dt + 1.0 / (2.0 * math.pi * hertz)) if hertz > 0.0 else 1.0

        last = self.error
        self.target += alpha(p["ATC_RAT_YAW_FLTT"]) * (p["ATC_ANG_YAW_P"] * error - self.target)
        self.error += alpha(p["ATC_RAT_YAW_FLTE"]) * (self.target - gyro - self.error)
        self.derivative += alpha(p["ATC_RAT_YAW_FLTD"]) * ((self.error - last) / dt - self.derivative)
        most = p["ATC_RAT_YAW_IMAX"]
        self.integrator = min(max(self.integrator + self.error * p["ATC_RAT_YAW_I"] * dt, -most), most)
        pid = p["ATC_RAT_YAW_P"] * self.error + self.integrator + p["ATC_RAT_YAW_D"] * self.derivative
        # ArduSub does not add it.
        return pid + p.get("ATC_RAT_YAW_FF", 0.0) * self.target


def headings(
    loop: Loop,
    model: Model,
    vehicle: Vehicle,
    *,
    seconds: float,
    start: float = 0.0,
    factor: float = 1.0,
    delay: float = 0.0,
    lag: float = 0.0,
    torque: float = 0.0,
    trim: dict[str, float] | None = None,
) -> FloatArray:
    """Headings in rad with the set point 0, in plain steps of 5 ms or the loop's period."""
    step = min(loop.period, 0.005)
    every, late = round(loop.period / step), round(delay / step)
    heading, rate, acting, output = start, 0.0, 0.0, 0.0
    waiting, rows = [0.0] * (late + 1), []
    for at in range(round(seconds / step)):
        if at % every == 0:
            output = min(max(factor * loop.output(-heading, rate), -1.0), 1.0)
        waiting[at % (late + 1)] = output
        delayed = waiting[(at + 1) % (late + 1)]
        total = 0.0
        for thruster in vehicle.thrusters:
            curve = thruster.curve
            assert curve is not None
            low, high = curve.command[0], curve.command[-1]
            rest = (trim or {}).get(thruster.name, 0.5 * (low + high))
            command = rest + math.copysign(delayed, delayed * thruster.arm) * 0.5 * (high - low)
            total += thruster.arm * float(np.interp(command, curve.command, curve.thrust))
        acting += (total - acting) * (-math.expm1(-step / lag) if lag else 1.0)
        drag = (model.linear_drag + model.quadratic_drag * abs(rate)) * rate
        rate += step * (acting + torque - drag) / model.inertia
        heading += step * rate
        rows.append(heading)
    return np.array(rows)


def tuned(name: str, model: Model, vehicle: Vehicle, delay: float = 0.0) -> tuple[AutopilotLaw, Margins]:
    conditions = LoopConditions(torque_in_use=80.0, heading_noise=1e-4, delay=delay)
    law, loop, _ = autopilot_loop(model, vehicle, conditions, AUTOPILOTS[name], default_gains(model, 0.7))
    return law, loop.margins()


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_the_promised_margins_hold_in_the_autopilots_loop(name: str) -> None:
    law, margins = tuned(name, with_effect("thruster_lag", LAG), EVEN, DELAY)
    parameters = autopilot_parameters(AUTOPILOTS[name], law)
    assert margins.stable
    assert margins.phase_deg >= 45.0
    assert 3.0 < margins.gain_db < 30.0
    swings = {}
    for share in (0.9, 1.1):
        gain = 10.0 ** (margins.gain_db / 20.0)
        for kind, factor, late in (("gain", share * gain, DELAY), ("delay", 1.0, DELAY + share * margins.delay_s)):
            course = headings(
                Loop(name, parameters), PAPER, EVEN, seconds=120.0, start=1e-4, factor=factor, delay=late, lag=LAG
            )
            middle, end = (float(np.ptp(np.array_split(course, 4)[at])) for at in (1, 3))
            swings[kind, share] = end / middle
    # Within 10 % of the limit the oscillation dies out, beyond it grows.
    assert swings["gain", 0.9] < 0.5
    assert swings["delay", 0.9] < 0.5
    assert swings["gain", 1.1] > 2.0
    assert swings["delay", 1.1] > 2.0


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_the_trim_stops_nine_tenths_of_the_drift_by_a_constant_torque(name: str) -> None:
    torque = 9.0
    model = with_effect("bias_torque", torque)
    law, _ = tuned(name, model, VEHICLE)
    parameters = autopilot_parameters(AUTOPILOTS[name], law)
    subject = ExportInput(
        model=model,
        vehicle=VEHICLE,
        entries={"bias_torque.torque": Entry(value=torque, standard_error=0.1, unit="N m", method="")},
        largest_rate=0.2,
        commands=np.array([[-5.0, 5.0], [-5.0, 5.0]]),
        reference={},
    )
    shares = constant_trim(subject.curves, subject.value("bias_torque", "torque"))
    arms = {one.name: one.arm for one in VEHICLE.thrusters}
    assert sum(arms[one.thruster] * one.thrust for one in shares) == pytest.approx(-torque)
    trim = {one.thruster: one.command for one in shares}
    drift = [
        float(np.max(np.abs(headings(Loop(name, parameters), PAPER, VEHICLE, seconds=60.0, torque=torque, trim=own))))
        for own in (None, trim)
    ]
    assert drift[0] > math.radians(0.3)
    assert drift[1] < 0.1 * drift[0]


def test_without_linear_drag_a_low_gain_ends_in_a_slow_oscillation_of_the_integral() -> None:
    """Three integrators: the phase is below -180 degrees at low frequency, and the gain has a lower limit."""
    law, margins = tuned("ardusub", replace(PAPER, linear_drag=0.0), EVEN, DELAY)
    assert margins.stable
    assert str(law.derivative) == "0.0"
    s = 1j * np.geomspace(1e-3, 0.5, 100_000) * law.angle
    filtered = 1.0 / (1.0 + s / (2.0 * math.pi * law.error_filter))
    pid = law.full * law.gain * filtered * (law.proportional + law.integral / s)
    response = (law.angle * filtered + s) * pid * np.exp(-s * DELAY) / (PAPER.inertia * s**2)
    lowest = np.flatnonzero(np.diff(np.sign(response.imag)))[0]
    assert response.real[lowest] < -1.0
    # The loop is sampled at 400 Hz, far above these frequencies.
    assert margins.gain_down_db == pytest.approx(20.0 * math.log10(-response.real[lowest]), abs=0.05)


def test_a_trim_beyond_a_curve_has_no_command() -> None:
    model = with_effect("bias_torque", 1e4)
    entries = {"bias_torque.torque": Entry(value=1e4, standard_error=0.1, unit="N m", method="")}
    commands = np.array([[1100.0, 1900.0]] * 2)
    subject = ExportInput(model=model, vehicle=EVEN, entries=entries, largest_rate=0.2, commands=commands, reference={})
    assert all(math.isnan(one.command) for one in constant_trim(subject.curves, 1e4))
    assert constant_trim(subject.curves, 0.0) == []
