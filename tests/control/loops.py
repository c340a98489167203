"""A vehicle with two thrusters, a controller, and their loop."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rovid.control.actuators import ActuatorProbe, Allocation, allocate
from rovid.control.closed_loop import ClosedLoop, ClosedLoopRun, Plant, simulate_loops
from rovid.control.control_law import ControlLaw, LoopConditions
from rovid.control.tuning import OpenLoop, linearise
from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.effects.actuator_inputs import neutral_commands
from rovid.effects.base import Scales
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

PAPER = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.37)
VOLTS = np.round(np.linspace(-5.0, 5.0, 201), 2)
CURVE = ThrustCurve(
    command=VOLTS, thrust=np.where(VOLTS > 0.0, 92.0, -52.0) * np.maximum(np.abs(VOLTS) - 0.3, 0.0) ** 2
)
# One thruster turns the vehicle with forward, the other with reverse thrust.
VEHICLE = Vehicle(
    name="test", thrusters=(Thruster(name="fore", arm=0.43, curve=CURVE), Thruster(name="aft", arm=-0.43, curve=CURVE))
)
SCALES = Scales(command=2.0, torque=126.0, rate=0.17, wash=11.0)
SETTING = LoopConditions(torque_in_use=126.0, heading_noise=math.radians(0.01))


def law(kp: float = 100.0, kd: float = 710.0, **changes: Any) -> ControlLaw:
    return replace(
        ControlLaw(kp=kp, kd=kd, period=0.1, rate_filter=0.3, quadratic_drag=3532.0, linear_drag=132.37), **changes
    )


def with_effect(key: str, *values: float, model: Model = PAPER) -> Model:
    return replace(model, effects=(*model.effects, effect_named(key)), effect_values=(*model.effect_values, *values))


def run_one(law: ControlLaw, allocation: Allocation, plant: Plant, wanted: FloatArray, start: float) -> ClosedLoopRun:
    (course,) = simulate_loops(
        [ClosedLoop(law=law, allocation=allocation, plant=plant, setpoint=wanted, initial_heading=start)]
    )
    return course


def closed(
    model: Model, controller: ControlLaw, *, seconds: float = 60.0, start: float = 90.0, wanted: float = 200.0
) -> ClosedLoopRun:
    plant = Plant(model=model, vehicle=VEHICLE)
    goal = np.full(round(seconds / controller.period), math.radians(wanted))
    return run_one(controller, allocate(VEHICLE, model), plant, goal, math.radians(start))


def whole_drive(model: Model, course: ClosedLoopRun) -> TorqueInput:
    """The drive of all commands of a run at once, of thrusters that are idle before it."""
    time = np.append(course.time, course.time[-1] + course.time[1])
    commands = np.vstack((neutral_commands(VEHICLE), course.commands))
    drive = model.actuators.torque_input(VEHICLE, Trial.from_commands(time, commands))
    return TorqueInput(
        torque=drive.torque[1:],
        timing_moment=drive.timing_moment[1:],
        effect_inputs=drive.effect_inputs[1:],
        impulse_variance=drive.impulse_variance[1:],
        offsets=np.array([0, len(course.time)]),
    )


def loop(controller: ControlLaw, delay: float = 0.0, model: Model = PAPER) -> OpenLoop:
    known = allocate(VEHICLE, model)
    probes = ActuatorProbe(
        vehicle=VEHICLE, parts=model.actuators.subdivision, allocation=known, period=controller.period, amplitude=126.0
    )
    response = probes.frequency_response(model)
    return OpenLoop(law=controller, motion=linearise(model), actuators=response, delay=delay)


def swing(model: Model, controller: ControlLaw, delay: float, allocation_of: Model) -> tuple[float, float]:
    """Range of the heading in deg, in the middle and at the end of a run after a small step."""
    plant = Plant(model=model, vehicle=VEHICLE, delay=delay)
    goal = np.full(2400, math.radians(0.5))
    course = run_one(controller, allocate(VEHICLE, allocation_of), plant, goal, 0.0)
    middle, end = np.array_split(np.degrees(course.heading), 4)[1], np.array_split(np.degrees(course.heading), 4)[3]
    return float(np.ptp(middle)), float(np.ptp(end))
