"""Vehicles that hide something, and how they move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tools.cases import Case, all_cases
from tools.hidden import FORMS, Hidden
from tools.simulate import MICRO, SUBSTEP, Held, Motion, simulate
from tools.truth import ROSUB, VEHICLES, Attitude, Disturbance, Dynamics, FloatArray, IntArray, Truth

# What brings a vehicle back is nothing that there is in yaw.
LAWS = [(effect, form) for effect, forms in FORMS.items() if effect != "restoring_curve" for form in forms]
STRONG = {vehicle.name: {c.name: c for c in all_cases(vehicle)} for vehicle in VEHICLES}


def strong(vehicle: Truth, effect: str, form: str) -> Case:
    return STRONG[vehicle.name][f"{effect}-{form}-strong"]


def quiet(truth: Truth) -> Truth:
    """``truth`` without disturbance, roll, pitch and heading noise."""
    return replace(
        truth,
        disturbance=Disturbance(standard_deviation=0.0),
        attitude=Attitude(roll=0.0, pitch=0.0, wander=0.0),
        instruments=replace(truth.instruments, angle_noise=0.0),
    )


def free(truth: Truth = ROSUB) -> Truth:
    """A quiet ``truth`` without drag: its rate is the integral of its torque over its inertia."""
    inertia = truth.dynamics.inertia
    return replace(quiet(truth), dynamics=Dynamics(inertia=inertia, quadratic_drag=0.0, linear_drag=0.0))


def hiding(truth: Truth, effect: str, form: str, **parameters: float) -> Truth:
    one = Hidden(effect=effect, form=form, parameters=parameters)
    return replace(truth, hidden=(*truth.hidden, one))


def ticks(duration: float, offset: int = 0) -> IntArray:
    return np.arange(0, round(duration * MICRO) + 1, 50_000) + offset


def move(
    truth: Truth,
    *levels: tuple[float, float],
    duration: float = 20.0,
    only: str | None = None,
    sample: IntArray | None = None,
    substep: int = SUBSTEP,
) -> Motion:
    """Motion under ``levels``: (time in s, command from neutral), each held to the next."""
    instant = np.array([round(time * MICRO) for time, _ in levels])
    value = np.array([level for _, level in levels])
    commands = [
        Held(
            instant=instant,
            value=thruster.curve.neutral + value * (only in {None, thruster.name}),
            neutral=thruster.curve.neutral,
        )
        for thruster in truth.thrusters
    ]
    wanted = ticks(duration) if sample is None else sample
    return simulate(truth, commands, wanted, np.random.default_rng(5), substep=substep)


def torque(truth: Truth, *, command: float, only: str | None = None) -> float:
    """Mean torque in N m over a second at ``command`` from neutral, of a vehicle without drag."""
    return truth.dynamics.inertia * float(move(truth, (0.0, command), duration=1.0, only=only).rate[-1])


def moved(truth: Truth, command: float) -> tuple[Motion, FloatArray, slice]:
    """The motion under a held ``command``, what inertia and drag need beside its torque, and where that is known."""
    motion = move(truth, (0.0, command), duration=300.0)
    left = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO) + np.array([plain_drag(r) for r in motion.rate])
    return motion, left - ROSUB.yaw_torque(command), slice(2, -2)


def plain_drag(r: float) -> float:
    d = ROSUB.dynamics
    return (d.quadratic_drag * abs(r) + d.linear_drag) * r
